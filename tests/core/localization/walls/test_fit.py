import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.localization.walls import Walls, moved
from mrs_people_loc.localization.walls.fit import Line, fit_walls, meeting, walls_of

SIGMA = 0.01


def line_points(begin, end, count=60):
    share = np.linspace(0.0, 1.0, count)[:, np.newaxis]
    return np.array(begin) + share * (np.array(end) - begin)


def sigmas(xy):
    return np.full(len(xy), SIGMA)


def one_wall(distance, bearing, extent, covariance=((1e-4, 0), (0, 1e-4))):
    return walls_of([Line(distance, bearing, np.array(covariance), extent)])


def points_of(walls: Walls, index: int = 0):
    """Both ends of a wall."""
    cos, sin = math.cos(walls.bearing[index]), math.sin(walls.bearing[index])
    foot = walls.distance[index] * np.array([cos, sin])
    return foot + np.outer(walls.extent[index], (-sin, cos))


@pytest.mark.parametrize(
    ("begin", "end", "distance", "bearing", "extent"),
    [
        ((2, -1), (2, 1), 2.0, 0.0, (-1, 1)),
        ((2, 1), (2, -1), 2.0, 0.0, (-1, 1)),
        ((1, 3), (-2, 3), 3.0, math.pi / 2, (-1, 2)),
        ((-2, 0.5), (-2, 3), 2.0, math.pi, (-3, -0.5)),
        ((2, 0), (0, 2), math.sqrt(2), math.pi / 4, (-math.sqrt(2), math.sqrt(2))),
    ],
)
def test_line_by_hand(begin, end, distance, bearing, extent):
    xy = line_points(begin, end)
    walls = fit_walls(xy, sigmas(xy))
    assert len(walls) == 1
    assert walls.distance[0] == pytest.approx(distance)
    assert walls.bearing[0] == pytest.approx(bearing)
    np.testing.assert_allclose(walls.extent[0], extent, atol=1e-9)
    assert not walls.is_end.any()


def test_covariance_of_a_line_seen_straight_on():
    # Independent points at y = -1 ... 1: sigma^2 / n, and sigma^2 over the sum of y^2.
    xy = line_points((2, -1), (2, 1), 101)
    walls = fit_walls(xy, sigmas(xy))
    wanted = np.diag([SIGMA**2 / 101, SIGMA**2 / np.sum(xy[:, 1] ** 2)])
    np.testing.assert_allclose(walls.covariance[0], wanted, rtol=1e-6, atol=1e-12)


def test_errors_are_as_large_as_the_covariance_says():
    rng = np.random.default_rng(4)
    nees = []
    for _ in range(300):
        angle, distance = rng.uniform(-3, 3), rng.uniform(0.5, 4)
        along = np.linspace(rng.uniform(-3, -0.5), rng.uniform(0.5, 3), 80)
        off = distance + rng.normal(0.0, SIGMA, 80)
        xy = np.stack([off, along], axis=1) @ rotation_2d(angle).T
        walls = fit_walls(xy, sigmas(xy))
        assert len(walls) == 1
        turn = math.remainder(walls.bearing[0] - angle, 2 * math.pi)
        error = np.array([walls.distance[0] - distance, turn])
        nees.append(error @ np.linalg.solve(walls.covariance[0], error))
    # The mean of 300 values of chi-square with 2 degrees: 2, standard deviation 2 / sqrt(300). The
    # covariance never shrinks where residuals happen to be small, so it may be a little less.
    assert 1.5 < np.mean(nees) < 2.4


def test_points_that_are_sure_across_the_line_count_more():
    xy = line_points((2, -1), (2, 1))
    xy[::2, 0] += 0.02
    covariance = np.tile(np.eye(2) * 0.03**2, (len(xy), 1, 1))
    covariance[::2, 0, 0] = 0.3**2
    assert fit_walls(xy, covariance).distance[0] == pytest.approx(2.0, abs=0.001)


def test_two_walls_meet_in_a_corner():
    xy = np.concatenate([line_points((3, -2), (3, 0.9)), line_points((2.9, 1), (-1, 1))])
    walls = fit_walls(xy, sigmas(xy))
    assert len(walls) == 2
    far = int(np.argmin(np.abs(walls.bearing)))
    np.testing.assert_allclose(points_of(walls, far)[1], (3, 1), atol=1e-6)
    np.testing.assert_allclose(points_of(walls, 1 - far)[0], (3, 1), atol=1e-6)
    assert walls.is_end[far].tolist() == [False, True]
    assert walls.is_end[1 - far].tolist() == [True, False]


def test_outliers_do_not_move_a_wall():
    rng = np.random.default_rng(1)
    xy = line_points((2, -2), (2, 2), 120)
    xy[rng.choice(120, 30, replace=False), 0] -= rng.uniform(0.2, 1.5, 30)
    walls = fit_walls(xy, sigmas(xy))
    assert walls.distance[0] == pytest.approx(2.0, abs=0.005)
    assert walls.bearing[0] == pytest.approx(0.0, abs=0.005)


@pytest.mark.parametrize("radius", [0.3, 1.0, 4.0])
def test_curved_surface_is_no_wall(radius):
    angle = np.linspace(-1.0, 1.0, 200) * min(1.0, 1.2 / radius)
    xy = np.stack([2.0 + radius * (1 - np.cos(angle)), radius * np.sin(angle)], axis=1)
    assert len(fit_walls(xy, np.full(len(xy), 0.005))) == 0


@pytest.mark.parametrize(("length", "count"), [(0.7, 0), (0.9, 1)])
def test_least_length(length, count):
    xy = line_points((2, 0), (2, length))
    assert len(fit_walls(xy, sigmas(xy))) == count


def test_wall_ends_where_nothing_is_on_it_for_long():
    xy = np.concatenate([line_points((2, -3), (2, -1)), line_points((2, 0), (2, 1))])
    walls = fit_walls(xy, sigmas(xy))
    np.testing.assert_allclose(walls.extent, [(-3, -1), (0, 1)], atol=1e-9)


def test_nothing_and_too_little():
    for count in (0, 1, 2, 7):
        xy = line_points((1, 0), (1, 2), count)
        assert len(fit_walls(xy, sigmas(xy))) == 0
    xy = np.ones((50, 2))  # all in one place
    assert len(fit_walls(xy, sigmas(xy))) == 0


def test_wrong_shapes_are_named():
    with pytest.raises(ValueError, match=r"\(3, 3\).*wanted: \(n, 2\)"):
        fit_walls(np.zeros((3, 3)), np.zeros(3))


poses = st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(-7, 7))


@given(st.floats(0, 5), st.floats(-3.1, 3.1), poses)
def test_moved_wall_has_the_same_points(distance, bearing, pose):
    wall = one_wall(distance, bearing, (-1.0, 2.0))
    there = moved(wall, *pose)
    wanted = points_of(wall) @ rotation_2d(pose[2]).T + pose[:2]
    got = points_of(there)
    off = min(np.abs(got - wanted).max(), np.abs(got[::-1] - wanted).max())
    assert off < 1e-9
    assert there.distance[0] >= 0
    assert -math.pi < there.bearing[0] <= math.pi
    assert there.extent[0, 0] < there.extent[0, 1]


@given(
    st.floats(0.1, 5),
    st.floats(-3, 3),
    poses,
    arrays(np.float64, (2, 2), elements=st.floats(-1e-2, 1e-2)),
)
def test_covariance_of_a_moved_wall_is_that_of_its_numbers(distance, bearing, pose, root):
    covariance = root @ root.T + 1e-6 * np.eye(2)
    wall = one_wall(distance, bearing, (-1.0, 2.0), covariance)
    there = moved(wall, *pose)
    step = 1e-6

    def numbers(d, b):
        walls = moved(one_wall(d, b, (-1.0, 2.0)), *pose)
        return walls.distance[0], walls.bearing[0]

    if there.distance[0] < 1e-3:
        return  # on the edge of turning round
    base = np.array(numbers(distance, bearing))
    columns = [
        np.array(numbers(distance + step, bearing)) - base,
        np.array(numbers(distance, bearing + step)) - base,
    ]
    jacobian = np.stack(columns, axis=1)
    jacobian[1] = np.remainder(jacobian[1] + np.pi, 2 * np.pi) - np.pi
    jacobian /= step
    wanted = jacobian @ covariance @ jacobian.T
    np.testing.assert_allclose(there.covariance[0], wanted, rtol=1e-3, atol=1e-8)


def test_wall_that_ends_at_the_middle_of_another_has_an_end():
    through, upto = one_wall(3.0, 0.0, (-2.0, 2.0)), one_wall(0.0, math.pi / 2, (-2.9, 1.0))
    walls = meeting(Walls.joined([through, upto]))
    assert walls.is_end.tolist() == [[False, False], [True, False]]
    assert walls.extent[1].tolist() == pytest.approx([-3.0, 1.0])


def test_walls_that_do_not_reach_each_other_do_not_meet():
    a, b = one_wall(3.0, 0.0, (-2.0, 0.5)), one_wall(1.0, math.pi / 2, (-2.0, 1.0))
    assert not meeting(Walls.joined([a, b])).is_end.any()


def test_parallel_walls_do_not_meet():
    a, b = one_wall(1.0, 0.0, (-2.0, 2.0)), one_wall(1.0, math.pi, (-2.0, 2.0))
    assert not meeting(Walls.joined([a, b])).is_end.any()

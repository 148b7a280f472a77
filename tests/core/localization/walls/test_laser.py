import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.localization.walls.laser import unskewed, walls_of_laser
from mrs_people_loc.localization.walls.ranges import LaserScan

NOBODY = np.zeros((0, 3))
ROUND = np.linspace(-math.pi, math.pi, 720, endpoint=False)
AHEAD = np.linspace(-0.8, 0.8, 361)


def scan(segments, angles, pose=(0.0, 0.0, 0.0), nothing=math.inf):
    """Ranges to walls, each from one point to another, by a scanner at a pose."""
    x, y, yaw = pose
    ranges = np.full(len(angles), math.inf)
    for begin, end in segments:
        a, b = ((np.array(point) - (x, y)) @ rotation_2d(yaw) for point in (begin, end))
        for i, angle in enumerate(angles):
            ray = np.array([math.cos(angle), math.sin(angle)])
            matrix = np.stack([ray, a - b], axis=1)
            if abs(np.linalg.det(matrix)) < 1e-12:
                continue
            away, share = np.linalg.solve(matrix, a)
            if away > 0 and 0 <= share <= 1:
                ranges[i] = min(ranges[i], away)
    return np.where(np.isfinite(ranges), ranges, nothing)


def find(ranges, angles, *, mounting=(0.0, 0.0, 0.0), bodies=NOBODY):
    return walls_of_laser(
        ranges, angles, sigma=0.01, max_range=12.0, mounting=mounting, bodies=bodies
    )


def by_bearing(walls, bearing):
    off = np.abs(np.remainder(walls.bearing - bearing + np.pi, 2 * np.pi) - np.pi)
    assert off.min() < 0.1
    return int(off.argmin())


def test_room_with_all_its_corners():
    room = [((-2, -3), (4, -3)), ((4, -3), (4, 1)), ((4, 1), (-2, 1)), ((-2, 1), (-2, -3))]
    walls = find(scan(room, ROUND), ROUND)
    assert len(walls) == 4
    for bearing, distance in ((0.0, 4.0), (math.pi / 2, 1.0), (math.pi, 2.0), (-math.pi / 2, 3.0)):
        i = by_bearing(walls, bearing)
        assert walls.distance[i] == pytest.approx(distance, abs=1e-3)
        assert walls.is_end[i].all()
    np.testing.assert_allclose(walls.extent[by_bearing(walls, 0.0)], (-3, 1), atol=1e-3)


@pytest.mark.slow
@given(
    st.tuples(st.floats(-0.5, 0.5), st.floats(-0.5, 0.5), st.floats(-3, 3)),
    st.floats(1.5, 4),
    st.floats(-3, 3),
)
def test_mounting_of_the_scanner(mounting, distance, bearing):
    x, y, yaw = mounting
    foot = distance * np.array([math.cos(bearing), math.sin(bearing)])
    aside = 2.0 * np.array([-math.sin(bearing), math.cos(bearing)])
    ranges = scan([(foot - aside, foot + aside)], ROUND, (x, y, yaw))
    walls = find(ranges, ROUND, mounting=mounting)
    i = by_bearing(walls, bearing)
    assert walls.distance[i] == pytest.approx(distance, abs=5e-3)
    assert math.remainder(walls.bearing[i] - bearing, 2 * math.pi) == pytest.approx(0, abs=5e-3)


def test_border_of_the_view_is_no_end_and_a_doorway_is():
    # A wall from -4 to 4, 2 m ahead, with a doorway from 0.3 to 1.2, another wall behind it.
    walls = find(scan([((2, -4), (2, 0.3)), ((2, 1.2), (2, 4)), ((5, -4), (5, 4))], AHEAD), AHEAD)
    i = int(np.flatnonzero(walls.distance < 3)[np.argmin(walls.extent[walls.distance < 3][:, 0])])
    assert walls.distance[i] == pytest.approx(2.0, abs=0.01)
    assert walls.is_end[i].tolist() == [False, True]
    assert walls.extent[i, 1] == pytest.approx(0.3, abs=0.02)


def test_what_hides_a_wall_is_not_its_end():
    # A post 1 m ahead hides the wall from 0.5 on, up to the border of the view.
    walls = find(scan([((2, -3), (2, 3)), ((1, 0.25), (1, 1.2))], AHEAD), AHEAD)
    i = by_bearing(walls, 0.0)
    i = int(np.argmax(walls.distance))
    assert walls.distance[i] == pytest.approx(2.0, abs=0.01)
    assert not walls.is_end[i].any()


def test_end_before_the_open():
    ranges = scan([((2, -3), (2, 0.5))], AHEAD, nothing=math.inf)
    assert find(ranges, AHEAD).is_end[0].tolist() == [False, True]
    # Not a number is not "nothing within range".
    ranges = scan([((2, -3), (2, 0.5))], AHEAD, nothing=math.nan)
    assert find(ranges, AHEAD).is_end[0].tolist() == [False, False]


def test_end_is_between_two_rays_or_unknown():
    """A wall beside a robot that nears its end, and an open space behind it."""
    wall = [((-5.0, 1.3), (0.0, 1.3)), ((-8.0, 6.0), (8.0, 6.0))]
    degrees = np.linspace(0.0, math.pi, 181)
    off = []
    for x in np.arange(-4.5, -0.3, 0.07):
        walls = find(scan(wall, degrees, (x, 0.0, 0.0)), degrees)
        i = np.flatnonzero(np.abs(walls.distance - 1.3) < 0.05)[0]
        # Along the wall its bearing, 90 degrees, leads backwards.
        ends, extent = walls.is_end[i], -walls.extent[i]
        if ends[0]:
            off.append(x + extent[0])
        assert ends[0] == (x > -2.9) or -3.3 < x < -2.5
    assert np.abs(off).max() < 0.08
    assert abs(np.mean(off)) < 0.02


def test_bodies_are_left_out_also_where_they_may_be():
    # Somebody who looks like a flat board, 0.85 m wide.
    ranges = scan([((1.5, -0.42), (1.5, 0.43))], AHEAD)
    assert len(find(ranges, AHEAD)) == 1
    assert len(find(ranges, AHEAD, bodies=np.array([[1.6, 0.0, 0.0]]))) == 0
    assert len(find(ranges, AHEAD, bodies=np.array([[2.2, 0.0, 0.0]]))) == 1
    assert len(find(ranges, AHEAD, bodies=np.array([[2.2, 0.0, 0.5]]))) == 0


def test_nothing_in_range():
    for nothing in (math.inf, math.nan, 0.0, 12.0):
        assert len(find(np.full(361, nothing), AHEAD)) == 0


def test_ranges_without_their_angles_are_an_error():
    with pytest.raises(ValueError, match="3 ranges and 361 angles"):
        find(np.ones(3), AHEAD)


def test_covariance_holds_what_ranges_have_in_common():
    ranges = scan([((2, -2), (2, 2))], AHEAD) + 0.02
    walls = find(ranges, AHEAD)
    error = np.array([walls.distance[0] - 2.0, walls.bearing[0]])
    assert error @ np.linalg.solve(walls.covariance[0], error) < 9.2  # 99 %
    assert math.sqrt(walls.covariance[0, 0, 0]) < 0.03


@pytest.mark.parametrize("sweep_s", [0.1, -0.1])
def test_scan_of_a_robot_that_drives_and_turns_is_that_of_one_that_stands(sweep_s):
    """Each ray is measured where the scanner was at its time, in a room, with an open side."""
    walls = [((-2, -3), (4, -3)), ((4, -3), (4, 1)), ((4, 1), (-2, 1))]
    moved_by, mounting = np.array([0.08, 0.02, 0.15]), (0.2, -0.1, 0.5)
    angles = np.linspace(-2.2, 2.2, 90)
    part = np.linspace(0.0, 1.0, 90)[:: 1 if sweep_s > 0 else -1]
    ranges = np.array([scan(walls, [a], placed(p * moved_by, mounting))[0]
                       for a, p in zip(angles, part, strict=True)])  # fmt: skip
    ranges[40] = np.nan
    found, bearings = unskewed(
        LaserScan(1, "laser", 10.0, angles, ranges, sweep_s), moved_by, mounting
    )
    assert np.isfinite(bearings).all()
    np.testing.assert_array_equal(np.isnan(found), np.isnan(ranges))
    hit = np.isfinite(found)
    assert hit.sum() > 70
    expected = scan(walls, bearings, placed(np.zeros(3), mounting))
    np.testing.assert_allclose(found[hit], expected[hit], atol=1e-9)
    assert np.abs(found[hit] - ranges[hit]).max() > 0.05


def placed(base, mounting):
    """The pose of a scanner on a robot at a pose."""
    x, y = rotation_2d(base[2]) @ mounting[:2] + base[:2]
    return x, y, base[2] + mounting[2]

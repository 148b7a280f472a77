import dataclasses
import math

import cv2
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from mrs_people_loc.config import Mounting
from mrs_people_loc.localization.walls.stereo import StereoWalls

NOBODY = np.zeros((0, 3))
#: StereoBM's results are on average so much above the truth [px]; what is drawn here is the truth.
ROUNDED = 1 / 32


def board(rectangle, distance, bearing, *, left=-3.0, right=3.0, low=0.0, high=2.8):
    """A flat surface by its line on the floor, from `left` to `right` along bearing + pi/2."""
    cos, sin = math.cos(bearing), math.sin(bearing)
    x, y = distance * cos - left * sin, distance * sin + left * cos
    wide = right - left
    return rectangle(
        corner=(x, y, low), side_a=(-wide * sin, wide * cos, 0), side_b=(0, 0, high - low)
    )


def floor(rectangle):
    return rectangle(corner=(-9, -9, 0), side_a=(18, 0, 0), side_b=(0, 18, 0), grain=0.2)


def find(head, *surfaces, people=NOBODY, change=0.0):
    disparity = head.disparity(*surfaces) + np.float32(ROUNDED) + np.asarray(change, np.float32)
    return StereoWalls(head.camera()).step(disparity, 5, people).walls


def test_wall_straight_ahead(make_head, rectangle):
    head = make_head(mounting=Mounting(height=1.0, forward=0.1))
    seen = StereoWalls(head.camera()).step(
        head.disparity(board(rectangle, 2.5, 0.0), floor(rectangle)), 17, NOBODY
    )
    assert seen.stamp_ns == 17
    assert seen.walls.distance.tolist() == pytest.approx([2.5], abs=0.03)
    assert seen.walls.bearing.tolist() == pytest.approx([0.0], abs=0.01)
    # The view is 74 degrees wide: 0.76 of the depth to each side.
    half = 0.755 * 2.4
    np.testing.assert_allclose(seen.walls.extent[0], (-half, half), atol=0.1)
    assert not seen.walls.is_end.any()


mountings = st.builds(
    Mounting,
    height=st.floats(0.8, 2.2),
    forward=st.floats(-0.5, 0.5),
    left=st.floats(-0.5, 0.5),
    pitch=st.floats(-0.1, 0.35),
    roll=st.floats(-0.2, 0.2),
    yaw=st.floats(-3.1, 3.1),
)


@given(mountings, st.floats(1.2, 3.5), st.floats(-0.6, 0.6))
@settings(max_examples=60)
def test_any_mounting_finds_the_wall(make_head, rectangle, mounting, distance, aside):
    head = make_head(mounting=mounting)
    bearing = mounting.yaw + aside
    at_lens = distance + mounting.forward * math.cos(bearing) + mounting.left * math.sin(bearing)
    assume(at_lens > 0.1)
    walls = find(head, board(rectangle, at_lens, bearing), floor(rectangle))
    assert len(walls) == 1
    assert walls.distance[0] == pytest.approx(at_lens, abs=0.02)
    assert math.remainder(walls.bearing[0] - bearing, 2 * math.pi) == pytest.approx(0.0, abs=0.01)


def test_two_walls_meet_in_their_corner(make_head, rectangle):
    head = make_head(mounting=Mounting(height=1.2, yaw=0.75))
    walls = find(
        head,
        board(rectangle, 2.4, 0.0, left=-3, right=2.0),
        board(rectangle, 2.0, math.pi / 2, left=-2.4, right=3.0),
        floor(rectangle),
    )
    assert len(walls) == 2
    ahead = int(np.argmin(np.abs(walls.bearing)))
    assert walls.distance[[ahead, 1 - ahead]].tolist() == pytest.approx([2.4, 2.0], abs=0.05)
    assert walls.is_end[ahead].tolist() == [False, True]
    assert walls.is_end[1 - ahead].tolist() == [True, False]
    assert walls.extent[ahead, 1] == pytest.approx(2.0, abs=0.05)
    assert walls.extent[1 - ahead, 0] == pytest.approx(-2.4, abs=0.05)


def test_both_walls_of_a_corridor(make_head, rectangle):
    head = make_head(mounting=Mounting(height=1.0))
    corridor = [
        board(rectangle, 1.2, math.pi / 2, left=-8, right=1),
        board(rectangle, 1.3, -math.pi / 2, left=-1, right=8),
    ]
    walls = find(head, *corridor, floor(rectangle))
    order = np.argsort(walls.bearing)
    assert walls.bearing[order].tolist() == pytest.approx([-math.pi / 2, math.pi / 2], abs=0.02)
    assert walls.distance[order].tolist() == pytest.approx([1.3, 1.2], abs=0.03)


@pytest.mark.parametrize(
    ("name", "surface", "count"),
    [
        ("a wall", {}, 1),
        ("a table on its edge", {"high": 0.75}, 0),
        ("a narrow board", {"left": -0.3, "right": 0.3}, 0),
        ("a strip under the ceiling", {"low": 1.5, "high": 2.0}, 0),
        ("a tall, wide cupboard", {"left": -0.9, "right": 0.9, "high": 2.0}, 1),
    ],
)
def test_what_is_a_wall(make_head, rectangle, name, surface, count):
    head = make_head(mounting=Mounting(height=1.0))
    behind = board(rectangle, 8.0, 0.0, left=-9, right=9, high=5)
    walls = find(head, board(rectangle, 2.4, 0.0, **surface), behind, floor(rectangle))
    assert np.count_nonzero(walls.distance < 5.0) == count


def test_floor_alone_and_nothing_at_all(make_head, rectangle):
    head = make_head(mounting=Mounting(height=1.0, pitch=0.4))
    assert len(find(head, floor(rectangle))) == 0
    nothing = np.full((120, 160), np.nan, dtype=np.float32)
    assert len(StereoWalls(head.camera()).step(nothing, 0, NOBODY).walls) == 0


def test_head_that_looks_straight_down_finds_nothing(make_head, rectangle):
    head = make_head(fx=400.0, fy=400.0, mounting=Mounting(height=2.0, pitch=math.pi / 2))
    assert len(find(head, floor(rectangle))) == 0


def test_column_is_no_wall(make_head, rectangle):
    head = make_head(mounting=Mounting(height=1.0))
    middle, radius = 3.2, 0.8
    sides = []
    for k in range(40):
        a, b = 2 * math.pi * k / 40, 2 * math.pi * (k + 1) / 40
        begin = np.array([middle + radius * math.cos(a), radius * math.sin(a), 0.0])
        end = np.array([middle + radius * math.cos(b), radius * math.sin(b), 0.0])
        sides.append(rectangle(tuple(begin), tuple(end - begin), (0, 0, 2.8)))
    assert len(find(head, *sides, floor(rectangle))) == 0


def test_person_before_a_wall_is_left_out(make_head, rectangle):
    head = make_head(mounting=Mounting(height=1.0))
    person = board(rectangle, 1.7, 0.0, left=-0.45, right=0.45, high=1.8)
    wall = board(rectangle, 3.2, 0.1)
    # Nobody else says that the flat figure is a person.
    assert 1.7 in find(head, person, wall, floor(rectangle)).distance.round(2)
    walls = find(head, person, wall, floor(rectangle), people=np.array([[1.7, 0.0, 0.0]]))
    assert (walls.distance > 3.0).all()


def test_wall_ends_where_one_looks_past_it(make_head, rectangle):
    head = make_head(mounting=Mounting(height=1.0))
    near = board(rectangle, 2.2, 0.0, left=-2.0, right=0.3)
    far = board(rectangle, 4.5, 0.0, left=-4, right=4)
    walls = find(head, near, far, floor(rectangle))
    i = int(np.argmin(walls.distance))
    assert walls.distance[i] == pytest.approx(2.2, abs=0.02)
    assert walls.extent[i, 1] == pytest.approx(0.3, abs=0.15)
    assert walls.is_end[i].tolist() == [False, True]


def test_error_of_matching_and_mounting_is_within_the_covariance(make_head, rectangle):
    rng = np.random.default_rng(2)
    nees = []
    for _ in range(60):
        mounting = Mounting(height=rng.uniform(0.8, 1.6), pitch=rng.uniform(0, 0.3))
        head = make_head(mounting=mounting)
        distance, bearing = rng.uniform(1.5, 3.5), rng.uniform(-0.7, 0.7)
        camera = head.camera()
        wrong = dataclasses.replace(
            mounting,
            pitch=mounting.pitch + rng.normal(0, 0.01),
            roll=rng.normal(0, 0.01),
            yaw=rng.normal(0, 0.005),
        )
        camera = dataclasses.replace(camera, mounting=wrong)
        noise = ROUNDED + rng.normal(0, 0.08) + rng.normal(0, 0.2, (120, 160))
        disparity = head.disparity(board(rectangle, distance, bearing), floor(rectangle)) + noise
        walls = StereoWalls(camera).step(disparity.astype(np.float32), 0, NOBODY).walls
        for d, b, covariance in zip(walls.distance, walls.bearing, walls.covariance, strict=True):
            error = np.array([d - distance, b - bearing])
            nees.append(error @ np.linalg.solve(covariance, error))
    assert len(nees) >= 50
    assert 0.3 < np.mean(nees) < 2.6
    assert np.mean(np.array(nees) < 9.2) > 0.95  # 99 % of chi-square


def test_offset_of_the_principal_points(make_head, rectangle):
    head = make_head(
        mounting=Mounting(height=1.0), centres={"left": (79.5, 59.5), "right": (76.0, 59.5)}
    )
    walls = find(head, board(rectangle, 2.0, 0.2), floor(rectangle))
    assert walls.distance.tolist() == pytest.approx([2.0], abs=0.01)


def test_larger_image_gives_the_same(make_head, rectangle):
    wall = board(rectangle, 2.2, 0.3)
    small = find(make_head(mounting=Mounting(height=1.0)), wall, floor(rectangle))
    large_head = make_head(
        width=320, height=240, fx=210.92, fy=210.92, mounting=Mounting(height=1.0)
    )
    large = find(large_head, wall, floor(rectangle))
    assert len(small) == len(large) == 1
    assert large.distance[0] == pytest.approx(small.distance[0], abs=0.01)
    assert large.bearing[0] == pytest.approx(small.bearing[0], abs=0.01)


def test_wall_is_not_turned_towards_what_stands_before_it(make_head, rectangle):
    head = make_head(mounting=Mounting(height=1.0))
    wall = board(rectangle, 1.4, math.pi / 2, left=-9, right=1)
    figures = [
        board(rectangle, 2.6, 0.0, left=left, right=left + 0.4, high=1.8) for left in (0.15, 0.9)
    ]
    disparity = head.disparity(wall, *figures, floor(rectangle)) + np.float32(ROUNDED)
    # Blocks of 9 pixels that see both a figure and the wall give something between.
    seen = np.isfinite(disparity).astype(np.float32)
    mean = cv2.blur(np.nan_to_num(disparity), (9, 9)) / np.maximum(cv2.blur(seen, (9, 9)), 1e-6)
    nearest = cv2.dilate(np.nan_to_num(disparity), np.ones((9, 9), np.uint8))
    blurred = np.where(nearest > disparity + 0.5, 0.75 * disparity + 0.25 * mean, disparity)
    walls = StereoWalls(head.camera()).step(blurred.astype(np.float32), 0, NOBODY).walls
    side = int(np.argmax(walls.bearing))
    assert walls.bearing[side] == pytest.approx(math.pi / 2, abs=0.01)
    assert walls.distance[side] == pytest.approx(1.4, abs=0.02)


@given(
    arrays(np.float32, (24, 32), elements=st.floats(-5, 60, width=32) | st.just(np.nan)),
    mountings,
    st.lists(st.tuples(st.floats(-5, 5), st.floats(-5, 5), st.floats(0, 2)), max_size=3),
)
@settings(max_examples=60)
def test_whatever_comes_walls_are_sound(make_head, coarse, mounting, people):
    head = make_head(mounting=mounting)
    disparity = np.kron(coarse, np.ones((5, 5), dtype=np.float32))
    places = np.array(people, dtype=np.float64).reshape(-1, 3)
    walls = StereoWalls(head.camera()).step(disparity, 0, places).walls
    assert len(walls) <= 4
    assert np.isfinite(walls.distance).all()
    assert (walls.distance >= 0).all()
    assert (np.linalg.eigvalsh(walls.covariance) > 0).all()
    assert (walls.extent[:, 0] < walls.extent[:, 1]).all()

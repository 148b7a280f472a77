import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from mrs_people_loc.bodies.search import HIGHEST, LOWEST, BodySearch, tolerance_px
from mrs_people_loc.config import Mounting

SIZE = {"width": 240, "height": 180, "fx": 158.0, "fy": 158.0}
BASELINE = 0.1
SCALE = SIZE["fx"] * BASELINE
STEP = 1 / SIZE["fx"]  # width of a bin of bearing [rad]

mountings = st.builds(
    Mounting,
    height=st.floats(0.7, 2.2),
    forward=st.floats(-1, 1),
    left=st.floats(-1, 1),
    pitch=st.floats(-0.1, 0.5),
    roll=st.floats(-0.2, 0.2),
    yaw=st.floats(-math.pi, math.pi),
)


def upright(rectangle, mounting, bearing, distance, *, width=0.4, low=0.4, high=1.7):
    """A rectangle that stands at a bearing and range from the lens, and faces it."""
    cos, sin = math.cos(bearing), math.sin(bearing)
    x = mounting.forward + distance * cos - 0.5 * width * sin
    y = mounting.left + distance * sin + 0.5 * width * cos
    return rectangle(
        corner=(x, y, low), side_a=(width * sin, -width * cos, 0), side_b=(0, 0, high - low)
    )


def in_view(head, surface) -> bool:
    """Whether a rectangle is in the image as a whole, with a pixel to spare."""
    m = head.mounting
    corner, a, b = (np.array(part) for part in (surface.corner, surface.side_a, surface.side_b))
    corners = np.array([corner, corner + a, corner + b, corner + a + b])
    right, down, forward = ((corners - (m.forward, m.left, m.height)) @ head.axes().T).T
    if (forward < 0.1).any():
        return False
    u = (head.width - 1) / 2 + head.fx * right / forward
    v = (head.height - 1) / 2 + head.fy * down / forward
    return bool(
        u.min() > 1 and u.max() < head.width - 2 and v.min() > 1 and v.max() < head.height - 2
    )


def search_of(head, *, min_range=0.7, max_range=6.0) -> BodySearch:
    return BodySearch(head.camera(), min_range=min_range, max_range=max_range)


def turn(angle: float) -> float:
    return math.remainder(angle, 2 * math.pi)


@pytest.mark.parametrize(
    ("inverse_range", "expected"),
    [
        (2.0, 0.45),  # 0.22 * 4 / 10 = 0.088: the matcher errs by more
        (4.0, 0.45),  # 0.352
        (5.0, 0.55),
        (10.0, 2.2),
    ],
)
def test_tolerance_matches_hand_computed_values(inverse_range, expected):
    assert tolerance_px(np.array([inverse_range]), 10.0) == pytest.approx([expected])


# ---------------------------------------------------------------------------- histogram ----


@settings(max_examples=40)
@given(mountings, st.floats(-0.35, 0.35), st.floats(1.6, 3.5), st.floats(0.2, 0.6))
def test_sum_is_vertical_extent_in_metres_for_any_mounting(
    make_head, rectangle, mounting, beside, distance, width
):
    head = make_head(**SIZE, mounting=mounting)
    surface = upright(rectangle, mounting, mounting.yaw + beside, distance, width=width)
    assume(in_view(head, surface))
    histogram = search_of(head).histogram(head.disparity(surface))
    columns = 2 * math.atan(0.5 * width / distance) / STEP
    # Pixels are whole or not at all: less than one is missing, or too many, across and along.
    pixel = distance / head.camera().fx
    rounding = pixel / width + pixel / 1.3
    assert histogram.sum() == pytest.approx(1.3 * columns, rel=rounding + 0.01)
    # All of it is at the rectangle's range: the middle is at `distance`, the borders farther.
    rows = np.flatnonzero(histogram.sum(axis=1))
    inverse = SCALE / 6.0 + (rows + 0.5) * 0.25
    nearest, farthest = SCALE / distance, SCALE / math.hypot(distance, 0.5 * width)
    assert inverse.min() > farthest - 0.13
    assert inverse.max() < nearest + 0.13


@pytest.mark.parametrize(
    ("low", "high", "counted"),
    [
        (0.0, 0.23, 0.0),  # the floor, a kerb
        (1.97, 2.3, 0.0),  # a lamp
        (0.0, 2.3, HIGHEST - LOWEST),  # a wall
        (1.0, 1.2, 0.2),
    ],
)
def test_only_heights_of_bodies_count(make_head, rectangle, low, high, counted):
    mounting = Mounting(height=1.2)
    head = make_head(**SIZE, mounting=mounting)
    surface = upright(rectangle, mounting, 0.0, 2.5, width=1.0, low=low, high=high)
    histogram = search_of(head).histogram(head.disparity(surface))
    columns = 2 * math.atan(0.2) / STEP
    assert histogram.sum() == pytest.approx(counted * columns, rel=0.06)


def test_only_ranges_within_limits_count(make_head, rectangle):
    mounting = Mounting()
    head = make_head(**SIZE, mounting=mounting)

    def total(distance: float) -> float:
        surface = upright(rectangle, mounting, 0.0, distance)
        search = search_of(head, min_range=1.5, max_range=3.0)
        return float(search.histogram(head.disparity(surface)).sum())

    assert total(3.1) == total(1.4) == 0.0
    assert total(2.9) > 0
    assert total(1.6) > 0


@pytest.mark.parametrize("value", [np.nan, 0.0, -1.0, 1e-3, 1e4])
def test_empty_view_gives_no_candidates(make_head, value):
    head = make_head()
    search = search_of(head)
    disparity = np.full((head.height, head.width), value, dtype=np.float32)
    assert search.histogram(disparity).sum() == 0
    found = search(disparity, min_extent=0.05, max_count=5)
    assert len(found) == 0
    assert found.bearing.shape == found.inverse_range.shape == found.extent.shape == (0,)


# --------------------------------------------------------------------------- candidates ----


@settings(max_examples=40)
@given(mountings, st.floats(-0.4, 0.4), st.floats(1.6, 4.0))
def test_body_position_is_correct_for_any_mounting(
    make_head, rectangle, mounting, beside, distance
):
    head = make_head(**SIZE, mounting=mounting)
    bearing = mounting.yaw + beside
    surface = upright(rectangle, mounting, bearing, distance, width=0.36)
    assume(in_view(head, surface))
    found = search_of(head)(head.disparity(surface), min_extent=0.35, max_count=1)
    assert len(found) == 1
    assert abs(turn(found.bearing[0] - bearing)) < 2.5 * STEP
    away = abs(found.inverse_range[0] - SCALE / distance)
    assert away < tolerance_px(np.array(SCALE / distance), SCALE)
    # 1.3 m of vertical extent; up to a column and a pixel are lost.
    assert found.extent[0] == pytest.approx(1.3, rel=0.13)


@pytest.mark.parametrize(
    "mounting",
    [
        Mounting(),
        Mounting(height=2.2, pitch=0.45),
        Mounting(roll=0.17),
        Mounting(forward=0.3, left=-0.4, yaw=2.9, pitch=0.1),
    ],
    ids=["level", "pitched", "rolled", "turned"],
)
def test_body_is_found_in_a_furnished_view(make_head, rectangle, mounting):
    head = make_head(mounting=mounting)
    scale = head.fx * BASELINE
    bearing = mounting.yaw + 0.15
    body = upright(rectangle, mounting, bearing, 2.4, low=0.0)
    wall = upright(rectangle, mounting, mounting.yaw, 4.5, width=12.0, low=-1.0, high=4.0)
    floor = rectangle(corner=(-9, -9, 0), side_a=(18, 0, 0), side_b=(0, 18, 0), grain=1.0)
    found = search_of(head)(head.disparity(body, wall, floor), min_extent=0.35, max_count=16)
    across = np.abs(np.angle(np.exp(1j * (found.bearing - bearing)))) * 2.4
    away = np.abs(found.inverse_range - scale / 2.4)
    assert ((across < 0.1) & (away < 0.45)).sum() == 1
    assert (np.diff(found.extent) <= 0).all()  # best first
    assert len(found) > 1  # the wall, too


def test_disparity_at_infinity_is_subtracted(make_head, rectangle):
    mounting = Mounting()
    surface = upright(rectangle, mounting, 0.1, 2.5)
    plain, shifted = make_head(), make_head(centres={"right": (72.0, 59.5)})
    assert shifted.camera().disparity_offset_px == 7.5
    one, other = (
        search_of(head)(head.disparity(surface), min_extent=0.35, max_count=1)
        for head in (plain, shifted)
    )
    assert len(one) == len(other) == 1
    np.testing.assert_allclose(other.bearing, one.bearing)
    np.testing.assert_allclose(other.inverse_range, one.inverse_range)
    np.testing.assert_allclose(other.extent, one.extent, rtol=1e-4)


@pytest.mark.parametrize(("gap", "bodies"), [(0.0, 1), (0.45, 2)])
def test_two_bodies_side_by_side_are_both_found(make_head, rectangle, gap, bodies):
    mounting = Mounting()
    head = make_head(**SIZE)
    surfaces = [
        upright(rectangle, mounting, side * math.atan(0.5 * gap / 2.5), 2.5, width=0.3)
        for side in (-1, 1)
    ]
    found = search_of(head)(head.disparity(*surfaces), min_extent=0.7, max_count=16)
    assert len(found) == bodies


def test_two_bodies_behind_each_other_are_both_found(make_head, rectangle):
    mounting = Mounting()
    head = make_head(**SIZE)
    near = upright(rectangle, mounting, 0.0, 2.0, width=0.4, high=1.2)
    far = upright(rectangle, mounting, 0.15, 3.2, width=0.4)
    search = search_of(head)
    found = search(head.disparity(near, far), min_extent=0.5, max_count=16)
    order = np.argsort(found.inverse_range)
    np.testing.assert_allclose(found.inverse_range[order], [SCALE / 3.2, SCALE / 2.0], atol=0.6)
    np.testing.assert_allclose(found.bearing[order], [0.15, 0.0], atol=0.03)
    assert list(found.extent) == sorted(found.extent, reverse=True)
    (best,) = search(head.disparity(near, far), min_extent=0.5, max_count=1).bearing
    assert best == found.bearing[0]
    assert len(search(head.disparity(near, far), min_extent=0.5, max_count=0)) == 0
    assert len(search(head.disparity(near, far), min_extent=1.0, max_count=16)) == 1


@pytest.mark.parametrize(("seen", "expected"), [(0.5, 1.3), (0.25, 0.65)])
def test_body_cut_by_the_border_is_scored_by_its_visible_part(make_head, rectangle, seen, expected):
    head = make_head(**SIZE)
    # The left border looks past `edge`; so much of the body's width is to the right of it.
    edge = math.atan(120 / SIZE["fx"])
    middle = edge + math.atan((0.5 - seen) * 0.36 / 2.0)
    surface = upright(rectangle, Mounting(), middle, 2.0, width=0.36)
    found = search_of(head)(head.disparity(surface), min_extent=0.35, max_count=1)
    assert found.extent == pytest.approx([expected], rel=0.15)
    assert found.bearing[0] > edge - 0.06


def test_half_of_a_body_must_be_in_view(make_head, rectangle):
    # At 0.4 m a person is 450 columns wide, of which the head sees 160, and 5 cm of their height.
    head = make_head(fx=1000.0, fy=1000.0, mounting=Mounting(height=1.2))
    wall = upright(rectangle, Mounting(height=1.2), 0.0, 0.4, width=2.0)
    search = search_of(head, min_range=0.3, max_range=2.0)
    seen = search.histogram(head.disparity(wall))
    assert seen.sum() / 160 == pytest.approx(0.048, rel=0.05)
    found = search(head.disparity(wall), min_extent=1e-3, max_count=1)
    assert 0.0 < found.extent[0] < 0.6 * 0.048


def test_bodies_far_apart_in_range_are_two_candidates(make_head, rectangle):
    # At 2 m and 4 m, 7.9 and 3.95 px; their windows of inverse range are three and one bin.
    mounting = Mounting(height=1.2)
    head = make_head(**SIZE, mounting=mounting)
    near, far = (
        upright(rectangle, mounting, bearing, distance, width=0.2)
        for bearing, distance in ((0.05, 2.0), (-0.03, 4.0))
    )
    found = search_of(head)(head.disparity(near, far), min_extent=0.35, max_count=4)
    assert sorted(SCALE / found.inverse_range) == pytest.approx([2.0, 4.0], rel=0.08)  # some bins

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mrs_people_loc import config as cfg
from mrs_people_loc.config import Mounting
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.cloud import CloudMaker
from mrs_people_loc.sensing.disparity import StereoMatcher

PI = math.pi
NAN = math.nan


def small_camera(**changes) -> StereoCamera:
    """3 x 2 px, f = 10 px, a baseline of 0.1 m: depth is 1 / disparity."""
    values = {"width": 3, "height": 2, "fx": 10, "fy": 10, "cx": 1, "cy": 0.5, "baseline": 0.1}
    return StereoCamera(**values | changes)


def cloud_of(disparity, *, min_range=0.5, max_range=5.0, **changes) -> np.ndarray:
    maker = CloudMaker(small_camera(**changes), min_range=min_range, max_range=max_range)
    return maker(np.array(disparity, dtype=np.float32))


def true_depth(head, points: np.ndarray) -> np.ndarray:
    """Depth of points along the optical axis of the left camera."""
    m = head.mounting
    return (points - (m.forward, m.left, m.height)) @ head.axes()[2]


def test_points_match_hand_computed_values():
    points = cloud_of([[0.5, NAN, NAN], [NAN, NAN, 1.0]])
    # Pixel (0, 0), 2 m ahead: x = 2, y = -(0 - 1) / 10 * 2, z = 1 - (0 - 0.5) / 10 * 2.
    # Pixel (2, 1), 1 m ahead: x = 1, y = -(2 - 1) / 10, z = 1 - (1 - 0.5) / 10.
    np.testing.assert_allclose(points, [[2, 0.2, 1.1], [1, -0.1, 0.95]], rtol=1e-6)
    assert points.dtype == np.float32


def test_points_of_a_head_looking_straight_down_are_correct():
    down = Mounting(height=3.0, pitch=PI / 2, forward=0.5, left=0.25)
    points = cloud_of([[0.5, NAN, NAN], [NAN, NAN, 1.0]], mounting=down)
    # The image's upper edge is ahead, its left edge to the left.
    np.testing.assert_allclose(points, [[0.6, 0.45, 1.0], [0.45, 0.15, 2.0]], rtol=1e-6)


def test_unequal_focal_lengths_and_principal_points_are_used():
    # Z = 10 * 0.1 / (2.5 - 2) = 2 m; y = -(2 - 0.5) / 10 * 2; z = 1 - (0 - 1.5) / 5 * 2
    points = cloud_of(
        [[NAN, NAN, 2.5], [NAN, NAN, NAN]], fy=5, cx=0.5, cy=1.5, disparity_offset_px=2.0
    )
    np.testing.assert_allclose(points, [[2.0, -0.3, 1.6]], rtol=1e-6)


def test_working_range_is_inclusive():
    # Disparities of 2, 0.5 and 4, 0.25 px: ranges of 0.5, 2 and 0.25, 4 m, exact in binary.
    row = [2.0, 0.5, NAN], [4.0, 0.25, 1.0]
    points = cloud_of(row, min_range=0.5, max_range=2.0, fx=8, baseline=0.125)
    np.testing.assert_allclose(points[:, 0], [0.5, 2.0, 1.0])


@pytest.mark.parametrize("value", [NAN, 0.0, -1.0, 1e-9, math.inf, -math.inf])
def test_pixels_without_disparity_give_no_points(value):
    points = cloud_of(np.full((2, 3), value))
    assert points.shape == (0, 3)
    assert points.dtype == np.float32


def test_disparity_is_not_modified():
    disparity = np.full((2, 3), 3.0, dtype=np.float32)
    CloudMaker(small_camera(disparity_offset_px=2.0), min_range=0.5, max_range=5.0)(disparity)
    np.testing.assert_array_equal(disparity, 3.0)


angles = st.floats(-PI, PI)


@given(
    mounting=st.builds(
        Mounting,
        height=st.floats(0.5, 3),
        forward=st.floats(-1, 1),
        left=st.floats(-1, 1),
        pitch=angles,
        roll=angles,
        yaw=angles,
    ),
    offset=st.floats(-10, 10),
    fy=st.floats(60, 140),
    depth=st.floats(0.7, 5.0),
)
@settings(max_examples=30)
def test_exact_disparities_give_exact_points(make_head, mounting, offset, fy, depth):
    centres = {"left": (20.0, 12.0), "right": (20.0 - offset, 12.0)}
    head = make_head(width=32, height=24, fy=fy, centres=centres, mounting=mounting)
    camera = head.camera()
    disparity = np.full((24, 32), head.fx * 0.1 / depth + offset, dtype=np.float32)
    points = CloudMaker(camera, min_range=0.6, max_range=6.0)(disparity)
    right, down, forward = head.axes()
    v, u = np.mgrid[:24, :32].reshape(2, -1, 1)
    expected = (mounting.forward, mounting.left, mounting.height) + depth * (
        (u - 20.0) / head.fx * right + (v - 12.0) / fy * down + forward
    )
    np.testing.assert_allclose(points, expected, atol=5e-5)


# ------------------------------------------------- from drawn images to known points ----

WALL = {"corner": (2, 4, -3), "side_a": (0, -8, 0), "side_b": (0, 0, 6), "grain": 0.04}
FAR_WALL = {"corner": (2.5, 8, -4), "side_a": (0, -16, 0), "side_b": (0, 0, 10)}
FLOOR = {"corner": (-5, -8, 0), "side_a": (10, 0, 0), "side_b": (0, 16, 0), "seed": 1}
HEAD_HEIGHT = {
    "corner": (-0.5, -0.5, 1.7), "side_a": (1.0, 0, 0), "side_b": (0, 1.0, 0),
    "grain": 0.025, "seed": 2,
}  # fmt: skip
LIKE = {"left": (82, 60), "right": (76, 60)}

SCENES: dict[str, tuple[dict, list[dict]]] = {
    "level": ({}, [WALL]),
    "pitched": ({"mounting": Mounting(pitch=0.3)}, [FAR_WALL, FLOOR]),
    "rolled": ({"mounting": Mounting(roll=0.3)}, [FAR_WALL, FLOOR]),
    "turned and moved": (
        {"mounting": Mounting(yaw=0.4, pitch=0.2, roll=-0.2, forward=0.3, left=-0.2)},
        [FAR_WALL, FLOOR],
    ),
    "straight down": (
        {"mounting": Mounting(height=3.0, pitch=PI / 2)},
        [FLOOR, HEAD_HEIGHT],
    ),
    "top above": ({"positions": {"top": (0, -0.1)}}, [WALL]),
    "top below": ({"positions": {"top": (0, 0.1)}}, [WALL]),
    "top far above": ({"positions": {"top": (0, -0.16)}}, [WALL]),
    "principal points": ({"centres": LIKE}, [WALL]),
    "principal points, top above": (
        {"centres": LIKE | {"top": (82, 63)}, "positions": {"top": (0, -0.1)}},
        [WALL],
    ),
    "principal points, top below": (
        {"centres": LIKE | {"top": (82, 57)}, "positions": {"top": (0, 0.1)}},
        [WALL],
    ),
    "not square": ({"fy": 80.0}, [WALL]),
    "not square, top above": ({"fy": 80.0, "positions": {"top": (0, -0.1)}}, [WALL]),
}


@pytest.mark.parametrize("scene", SCENES)
def test_simulated_surfaces_are_measured(make_head, rectangle, scene):
    changes, surfaces = SCENES[scene]
    head = make_head(**changes)
    images, truth = head.draw(*(rectangle(**surface) for surface in surfaces))
    camera = head.camera()
    low, high = 0.7, 5.0
    disparity = StereoMatcher(camera, cfg.Disparity(min_range=low, max_range=high))(images)
    points = CloudMaker(camera, min_range=low, max_range=high)(disparity)

    # Which pixels the points belong to, and what these show.
    shifted = disparity - camera.disparity_offset_px
    in_range = (shifted * high >= camera.depth_disparity) & (
        shifted * low <= camera.depth_disparity
    )
    assert len(points) == np.count_nonzero(in_range) > 0.9 * disparity.size
    error = points - truth[in_range]
    depth = true_depth(head, truth[in_range])
    error_px = error @ head.axes()[2] / depth**2 * camera.depth_disparity
    # A sixteenth of a pixel is the matcher's step; near edges the block sees both sides.
    assert abs(np.median(error_px)) < 0.06
    assert np.percentile(np.abs(error_px), 90) < 0.3


def test_box_seen_from_above_has_its_height_and_position(make_head, rectangle):
    head = make_head(mounting=Mounting(height=3.0, pitch=PI / 2, forward=0.4))
    box = {**HEAD_HEIGHT, "corner": (0.1, -0.3, 1.5), "side_a": (0.6, 0, 0), "side_b": (0, 0.9, 0)}
    images, _ = head.draw(rectangle(**FLOOR), rectangle(**box))
    camera = head.camera()
    disparity = StereoMatcher(camera, cfg.Disparity(block_size_px=9))(images)
    points = CloudMaker(camera, min_range=0.7, max_range=5.0)(disparity)
    on_box = points[points[:, 2] > 0.75]
    assert np.median(on_box[:, 2]) == pytest.approx(1.5, abs=0.03)
    extent = np.percentile(on_box[:, :2], [1, 99], axis=0)
    np.testing.assert_allclose(extent, [[0.1, -0.3], [0.7, 0.6]], atol=0.08)
    assert np.median(points[points[:, 2] < 0.75][:, 2]) == pytest.approx(0.0, abs=0.05)

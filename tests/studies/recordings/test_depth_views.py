"""Pictures with depth as what a head sees, in rooms made of boxes."""

from __future__ import annotations

import math
from pathlib import Path

import cv2
import numpy as np
import pytest

from mrs_people_loc.config import Disparity, Mounting
from mrs_people_loc.errors import BagError, FloorError
from mrs_people_loc.sensing.camera import robot_from_optical
from mrs_people_loc.sensing.disparity import StereoMatcher
from mrs_people_loc.sensing.images import StereoImages
from mrs_studies.recordings.depth_views import DepthCamera, stereo_view
from tools.box_room import BOX, CAMERA, HEAD, picture


@pytest.mark.parametrize(
    "mounting",
    [HEAD, Mounting(height=0.5), Mounting(height=1.6, pitch=math.radians(25), roll=0.1)],
)
def test_mounting_is_found_from_the_floor(mounting: Mounting) -> None:
    found = stereo_view(*picture(BOX, mounting=mounting), CAMERA).camera.mounting
    assert found.height == pytest.approx(mounting.height, abs=0.02)
    assert found.pitch == pytest.approx(mounting.pitch, abs=0.01)
    assert found.roll == pytest.approx(mounting.roll, abs=0.01)


def test_disparities_of_the_pair_are_those_of_the_depth() -> None:
    grey, depth = picture(BOX)
    view = stereo_view(grey, depth, CAMERA)
    camera = view.camera
    assert (camera.width, camera.height) == (160, 120)
    assert camera.fx == pytest.approx(142, rel=2e-3)
    assert camera.depth_disparity == pytest.approx(10.5)
    left, right = view.images(np.random.default_rng(0))
    seen = StereoMatcher(camera, Disparity())(StereoImages(0, left, right))
    # Where each pixel of the reduced view lies in the picture.
    u = (np.arange(160) - camera.cx) / camera.fx * CAMERA.fx + CAMERA.cx
    v = (np.arange(120) - camera.cy) / camera.fy * CAMERA.fy + CAMERA.cy
    wanted = 10.5 / depth[np.ix_(np.rint(v).astype(int), np.rint(u).astype(int))]
    known = np.isfinite(seen)
    assert known.mean() > 0.5
    assert np.median(np.abs(seen - wanted)[known]) < 0.1


def test_narrow_pictures_give_a_longer_focal_length() -> None:
    narrow = DepthCamera(900, 900, 319.5, 239.5)
    view = stereo_view(*picture(BOX, camera=narrow), narrow)
    assert view.camera.fx == pytest.approx(900 / 4)
    assert view.camera.depth_disparity == pytest.approx(10.5)


def test_noise_is_that_of_each_image() -> None:
    view = stereo_view(*picture(BOX), CAMERA)
    rng = np.random.default_rng(0)
    first, second = view.images(rng), view.images(rng)
    for one, other in zip(first, second, strict=True):
        difference = (one.astype(float) - other)[(one > 5) & (one < 250)]
        assert difference.std() == pytest.approx(1.5 * math.sqrt(2), rel=0.1)


def test_views_without_a_floor_a_head_or_depth_are_refused() -> None:
    grey, depth = picture()
    with pytest.raises(FloorError, match="only 2"):
        stereo_view(grey, np.where(np.indices(depth.shape)[1] < 160, depth, np.nan), CAMERA)
    with pytest.raises(FloorError):  # a wall alone
        stereo_view(grey, np.full(depth.shape, 3.0), CAMERA)
    stereo_view(*picture(mounting=Mounting(height=2.3, pitch=0.3)), CAMERA)
    for mounting in (
        Mounting(height=2.8, pitch=0.3),
        Mounting(height=0.25),
        Mounting(height=1.1, roll=0.5),
    ):
        with pytest.raises(FloorError):
            stereo_view(*picture(mounting=mounting), CAMERA)


def test_depth_is_read_in_metres(tmp_path: Path) -> None:
    colour, depth = tmp_path / "colour.png", tmp_path / "depth.png"
    cv2.imwrite(str(colour), np.full((2, 3, 3), 7, np.uint8))
    cv2.imwrite(str(depth), np.array([[0, 1000, 2000], [4000, 8000, 60000]], np.uint16))
    grey, metres = DepthCamera(1, 1, 0, 0).read(colour, depth)
    assert (grey == 7).all()
    nan = math.nan
    np.testing.assert_allclose(metres, [[nan, 1.0, 2.0], [4.0, 8.0, nan]])
    _, metres = DepthCamera(1, 1, 0, 0, 1 / 5000).read(colour, depth)
    np.testing.assert_allclose(metres, [[nan, 0.2, 0.4], [0.8, 1.6, 12.0]])
    _, metres = DepthCamera(1, 1, 0, 0, rotated=True).read(colour, depth)
    np.testing.assert_allclose(metres, [[nan, 0.125, 0.25], [0.5, 1.0, 7.5]])


def test_pictures_that_do_not_belong_together_are_refused(tmp_path: Path) -> None:
    colour, depth = tmp_path / "colour.png", tmp_path / "depth.png"
    cv2.imwrite(str(colour), np.zeros((2, 3), np.uint8))
    with pytest.raises(BagError, match="depth.png cannot be read"):
        CAMERA.read(colour, depth)
    cv2.imwrite(str(depth), np.zeros((3, 2), np.uint16))
    with pytest.raises(BagError, match=r"shape \(3, 2\); wanted: uint16 of \(2, 3\)"):
        CAMERA.read(colour, depth)


def test_boxes_stand_where_they_should() -> None:
    """The made room itself: the box's face is 2 m ahead."""
    _, depth = picture(BOX)
    rotation, lens = robot_from_optical(HEAD)
    rows, columns = np.indices(depth.shape)
    rays = np.stack([(columns - 319.5) / 525, (rows - 239.5) / 525, np.ones(depth.shape)], axis=-1)
    points = (rays * depth[..., np.newaxis]) @ rotation.T + lens
    low = points[points[..., 0] < 4.5]
    assert low[:, 2].min() == pytest.approx(0, abs=1e-6)
    front = points[(points[..., 2] > 0.1) & (points[..., 0] < 2.1)]
    assert front[:, 0].min() == pytest.approx(2.0)

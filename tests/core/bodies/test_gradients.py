import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from mrs_people_loc.bodies.appearance import DETECTOR_WINDOW, detector_weights
from mrs_people_loc.bodies.gradients import BINS, BLOCK, GradientSampler, Window, histograms_of
from mrs_people_loc.config import Mounting

#: What `HOGDescriptor.compute` of OpenCV 4.6 gave of `grey` (windows 64 x 128, and 32 x 64 of a
#: part of it), each without its border of one sample.
OPENCV = np.load(Path(__file__).with_name("hog_of_opencv.npz"))
SMALL = np.s_[30:96, 10:44]
OLDER: Any = cv2
NEEDS_HOG = pytest.mark.skipif(not hasattr(cv2, "HOGDescriptor"), reason="needs OpenCV 4")
WINDOW = Window(low=0.0, high=2.0, width=1.0, rows=64, columns=32)


@pytest.mark.parametrize(("part", "name"), [(np.s_[:, :], "values"), (SMALL, "small")])
def test_histograms_equal_the_stored_ones_of_opencv(part, name):
    values = histograms_of(OPENCV["grey"][part].astype(np.float32))
    np.testing.assert_allclose(values.ravel(), OPENCV[name], atol=1e-6)


@NEEDS_HOG
@pytest.mark.parametrize("seed", range(4))
def test_histograms_equal_those_of_opencv(seed):
    noise = np.random.default_rng(seed).integers(0, 256, (130, 66), dtype=np.uint8)
    grey = cv2.GaussianBlur(noise, (0, 0), 0.5 + seed)
    wanted = OLDER.HOGDescriptor().compute(grey, (8, 8), (0, 0), [(1, 1)])
    np.testing.assert_allclose(
        histograms_of(grey.astype(np.float32)).ravel(), np.ravel(wanted), atol=1e-6
    )


@NEEDS_HOG
def test_weights_are_those_of_opencvs_people_detector():
    wanted = np.ravel(OLDER.HOGDescriptor_getDefaultPeopleDetector()).astype(np.float32)
    np.testing.assert_array_equal(detector_weights(), wanted)


@pytest.mark.parametrize(
    ("degrees", "shares"),
    [
        (0.0, {8: 0.5, 0: 0.5}),  # orientations are at 10, 30, ... 170 degrees
        (10.0, {0: 1.0}),
        (75.0, {3: 0.75, 4: 0.25}),
        (90.0, {4: 1.0}),
        (175.0, {8: 0.75, 0: 0.25}),
        (190.0, {0: 1.0}),  # dark and bright may change places
    ],
)
def test_an_edge_is_shared_by_the_orientations_beside_it(degrees, shares):
    row, column = np.mgrid[:34.0, :34.0]
    angle = math.radians(degrees)
    root = 8.0 + 0.1 * (column * math.cos(angle) + row * math.sin(angle))
    block = histograms_of((root**2).astype(np.float32))[0].reshape(4, BINS)
    wanted = np.zeros(BINS)
    wanted[list(shares)] = list(shares.values())
    for cell in block / block.sum(axis=1, keepdims=True):
        assert np.flatnonzero(cell > 1e-3).tolist() == sorted(shares)
        if len(shares) > 1:  # the second of two that are clipped has the rest
            np.testing.assert_array_equal(np.argsort(cell)[-2:], np.argsort(wanted)[-2:])


def test_flat_windows_have_no_gradients():
    assert not histograms_of(np.full((66, 34), 128.0, dtype=np.float32)).any()


def test_samples_are_where_hand_computed(make_head):
    head = make_head(fx=100.0, fy=100.0)
    camera = head.camera()  # 1 m over the floor, level
    pixels = GradientSampler(camera, WINDOW).homographies(np.array([0.0]), np.array([2.0]))[0]
    for column, row, u, v in (
        (16.5, 32.5, 0.0, 0.0),  # the middle, 1 m up
        (0.5, 32.5, -25.0, 0.0),  # the left edge, 0.5 m away
        (16.5, 0.5, 0.0, -50.0),  # the upper edge, 1 m over the lens
        (16.5, 64.5, 0.0, 50.0),  # the floor
    ):
        x, y, depth = pixels @ (column, row, 1.0)
        assert (x / depth, y / depth) == pytest.approx((camera.cx + u, camera.cy + v))
        assert depth == pytest.approx(2.0)


def test_windows_stand_upright_wherever_the_head_looks(make_head):
    mounting = Mounting(height=1.9, forward=0.2, left=-0.3, pitch=0.35, roll=0.1, yaw=0.4)
    camera = make_head(fx=100.0, fy=100.0, mounting=mounting).camera()
    bearing, away = 0.5, 3.0
    pixels = GradientSampler(camera, WINDOW).homographies(np.array([bearing]), np.array([away]))[0]
    rotation, lens = camera.robot_from_optical
    for height, left, column, row in ((2.0, 0.5, 0.5, 0.5), (0.0, -0.5, 32.5, 64.5)):
        # The same corner in base_link.
        x = lens[0] + away * math.cos(bearing) - left * math.sin(bearing)
        y = lens[1] + away * math.sin(bearing) + left * math.cos(bearing)
        wanted = rotation.T @ (np.array([x, y, height]) - lens)
        u, v, depth = pixels @ (column, row, 1.0)
        assert depth == pytest.approx(wanted[2])
        assert u / depth == pytest.approx(camera.fx * wanted[0] / wanted[2] + camera.cx)
        assert v / depth == pytest.approx(camera.fy * wanted[1] / wanted[2] + camera.cy)


def test_blocks_outside_the_image_are_known(make_head):
    # 2 m ahead, 160 x 120 pixels show 1.6 m, and from 0.4 to 2.2 m of height or less.
    camera = make_head(fx=100.0, fy=100.0).camera()
    left = np.full((120, 160), 100, dtype=np.uint8)
    sampler = GradientSampler(camera, WINDOW)
    inside = sampler(left, np.array([0.0, 1.5]), np.array([2.0, 2.0])).inside
    assert inside[0].all()
    assert not inside[1].any()  # beside the field of view
    edge = sampler(left, np.array([math.atan2(79.5, 100.0)]), np.array([2.0 * 1.277])).inside[0]
    assert edge.reshape(3, 7).any(axis=1).tolist() == [False, False, True]
    near = sampler(left, np.array([0.0]), np.array([1.0])).inside[0]
    rows = near.reshape(3, 7).all(axis=0)  # at 1 m, 1.2 m of height are in the image
    assert rows.tolist() == [False, True, True, True, True, True, False]


def test_a_body_looks_the_same_at_any_range(make_head):
    # A dark bar 0.3 m wide and 1.6 m tall before something bright.
    camera = make_head(fx=200.0, fy=200.0).camera()
    sampler, found = GradientSampler(camera, DETECTOR_WINDOW), []
    for away in (3.0, 4.5):
        image: Any = np.full((120, 160), 200, dtype=np.uint8)
        half, up, down = (round(200.0 * size / away) for size in (0.15, 0.6, 1.0))
        cx, cy = round(camera.cx), round(camera.cy)
        image[max(cy - up, 0) : cy + down, cx - half : cx + half] = 60
        image = cv2.GaussianBlur(image, (0, 0), 3.0 / away)
        found.append(sampler(image, np.array([0.0]), np.array([away])))
    both = found[0].inside[0] & found[1].inside[0]
    one, other = (histograms.values[0][both] for histograms in found)
    edges = (np.linalg.norm(one, axis=1) > 0.5) & (np.linalg.norm(other, axis=1) > 0.5)
    assert edges.sum() > 10
    assert (one * other).sum(axis=1)[edges].mean() > 0.8  # of unit vectors


def test_no_place_has_no_histograms(make_head):
    sampler = GradientSampler(make_head().camera(), WINDOW)
    found = sampler(np.zeros((120, 160), dtype=np.uint8), np.zeros(0), np.zeros(0))
    assert found.values.shape == (0, WINDOW.blocks, BLOCK)
    assert found.inside.shape == (0, WINDOW.blocks)

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.config import Mounting
from mrs_people_loc.errors import CameraError
from mrs_people_loc.sensing.camera import CameraModel, StereoCamera

PI = math.pi
NAN, INF = math.nan, math.inf


def model(*, fx=100.0, fy=100.0, cx=79.5, cy=59.5, tx=0.0, ty=0.0, **changes) -> CameraModel:
    """A camera of 160 x 120 px; tx and ty are P[3] and P[7]."""
    k = np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]])
    p = np.hstack([k, [[tx], [ty], [0.0]]])
    fields = {"width": 160, "height": 120, "k": k, "d": (), "r": np.eye(3), "p": p}
    return CameraModel(**fields | changes)


def with_entry(name: str, index: tuple[int, int], value: float) -> CameraModel:
    """`model()` with one entry of a matrix changed."""
    good = model()
    matrix = getattr(good, name).copy()
    matrix[index] = value
    return dataclasses.replace(good, **{name: matrix})


# ------------------------------------------------------------------------- one camera ----


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: model(width=0), "image size is 0x120; allowed: more than 0x0"),
        (lambda: model(height=0), "image size is 160x0"),
        (lambda: model(height=-1), "image size is 160x-1"),
        (lambda: model(k=np.eye(2)), r"k has shape \(2, 2\); wanted: \(3, 3\)"),
        (lambda: model(r=np.zeros(9)), r"r has shape \(9,\); wanted: \(3, 3\)"),
        (lambda: model(p=np.eye(3)), r"p has shape \(3, 3\); wanted: \(3, 4\)"),
        (lambda: with_entry("k", (0, 2), NAN), "k holds NaN or infinite"),
        (lambda: with_entry("r", (2, 2), INF), "r holds NaN or infinite"),
        (lambda: with_entry("p", (0, 3), NAN), "p holds NaN or infinite"),
        (lambda: model(d=(0.1, NAN, 0.0, 0.0, 0.0)), "d holds NaN or infinite"),
        (lambda: with_entry("p", (0, 0), 0.0), "focal length in p is 0, 100 px; allowed: at least"),
        (lambda: with_entry("p", (1, 1), 0.0), "focal length in p is 100, 0 px"),
        (lambda: with_entry("p", (0, 0), -5.0), "focal length in p is -5, 100 px"),
    ],
)
def test_a_bad_calibration_is_refused(make, message):
    with pytest.raises(CameraError, match=message):
        make()


@pytest.mark.parametrize("name", ["k", "r", "p"])
def test_integers_become_floats(name):
    matrix = getattr(model(), name).astype(int).tolist()
    assert getattr(model(**{name: matrix}), name).dtype == np.float64


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: with_entry("k", (0, 0), 0.0), "focal length in k is 0"),
        (lambda: with_entry("k", (1, 1), 0.0), "focal length in k"),
        (lambda: model(r=np.zeros((3, 3))), r"r is no rotation .orthonormal.*: \[\[0.0, 0.0, 0"),
        (lambda: model(r=-np.eye(3)), "r is no rotation"),
        (lambda: model(r=np.diag([2.0, 0.5, 1.0])), "r is no rotation"),
        (lambda: model(r=np.full((3, 3), 1e300)), "r is no rotation"),
        (lambda: model(d=(0.1,) * 5, distortion_model="omni"), "distortion_model is 'omni'"),
        (lambda: model(d=(0.1,) * 5, distortion_model=""), "distortion_model is ''; allowed: plum"),
        (lambda: model(d=(0.1,) * 3), "d has 3 coefficients; plumb_bob takes 4 or 5"),
        (
            lambda: model(d=(0.1,) * 5, distortion_model="rational_polynomial"),
            "d has 5 coefficients; rational_polynomial takes 8 or 12 or 14",
        ),
        (
            lambda: model(d=(0.1,) * 5, distortion_model="equidistant"),
            "d has 5 coefficients; equidistant takes 4",
        ),
    ],
)
def test_calibration_that_cannot_be_rectified_is_refused(make, message):
    camera = make()  # rectified images need none of it
    with pytest.raises(CameraError, match=message):
        camera.check_raw()


def test_any_size_and_focal_length_above_0_is_allowed():
    model(width=1, height=1, fx=0.5, fy=0.5).check_raw()


def test_without_distortion_the_model_is_irrelevant():
    model(d=(), distortion_model="omni").check_raw()
    model(d=(0.1, 0.0, 0.0, 0.0), distortion_model="plumb_bob").check_raw()


# ----------------------------------------------------------------------------- scaling ----


def test_scaling_by_half_matches_hand_computed_values():
    # Pixel centres are whole numbers, edges are halves: u -> (u + 0.5) / 2 - 0.5.
    large = model(width=320, height=240, fx=210.0, fy=200.0, cx=159.5, cy=100.0, tx=-21.0, ty=10.0)
    small = large.scaled_to_fit(160, 120)
    assert (small.width, small.height) == (160, 120)
    np.testing.assert_allclose(small.k, [[105, 0, 79.5], [0, 100, 49.75], [0, 0, 1]])
    np.testing.assert_allclose(small.p, [[105, 0, 79.5, -10.5], [0, 100, 49.75, 5], [0, 0, 1, 0]])
    assert (small.d, small.distortion_model) == (large.d, large.distortion_model)


@pytest.mark.parametrize(
    ("size", "fit", "scaled"),
    [
        ((640, 360), (160, 120), (160, 90)),  # the width decides
        ((640, 640), (160, 120), (120, 120)),  # the height decides
        ((333, 250), (160, 120), (160, 120)),  # rounded: each axis has its own scale
        ((160, 120), (160, 120), (160, 120)),
        ((100, 50), (160, 120), (100, 50)),  # never up
        ((160, 121), (160, 120), (159, 120)),
    ],
)
def test_scaled_sizes_are_correct(size, fit, scaled):
    small = model(width=size[0], height=size[1], fx=200.0, cx=50.0).scaled_to_fit(*fit)
    assert (small.width, small.height) == scaled
    sx, sy = scaled[0] / size[0], scaled[1] / size[1]
    assert small.p[0, 0] == pytest.approx(200.0 * sx)
    assert small.p[1, 1] == pytest.approx(100.0 * sy)
    assert small.p[0, 2] == pytest.approx(50.5 * sx - 0.5)
    assert small.p[1, 2] == pytest.approx(60.0 * sy - 0.5)


@given(width=st.integers(161, 2000), height=st.integers(121, 2000), baseline=st.floats(0.05, 1))
def test_scaling_keeps_the_baselines(width, height, baseline):
    size = {"width": width, "height": height, "fx": 300.0, "fy": 280.0}
    models = (
        model(**size),
        model(**size, tx=-300.0 * baseline),
        model(**size, ty=280.0 * 2 * baseline),
    )
    camera = StereoCamera.from_models(*(m.scaled_to_fit(160, 120) for m in models))
    assert camera.baseline == pytest.approx(baseline)
    assert camera.vertical_baseline == pytest.approx(2 * baseline)


# --------------------------------------------------------------------------- the head ----


def test_binocular_head_matches_hand_computed_values():
    mounting = Mounting(height=1.2, pitch=0.1)
    camera = StereoCamera.from_models(
        model(fx=105.0, fy=80.0, cx=82.0, cy=61.0),
        model(fx=105.0, fy=80.0, cx=76.5, cy=61.2, tx=-10.5),
        mounting=mounting,
    )
    assert camera == StereoCamera(
        width=160,
        height=120,
        fx=105.0,
        fy=80.0,
        cx=82.0,
        cy=61.0,
        baseline=pytest.approx(0.1),
        disparity_offset_px=5.5,
        mounting=mounting,
    )
    assert camera.vertical_baseline == camera.vertical_offset_px == 0.0
    assert camera.depth_disparity == pytest.approx(10.5)
    assert camera.disparity_of(2.0) == pytest.approx(10.5 / 2.0 + 5.5)


def test_papers_head_has_a_disparity_of_16_px_at_66_cm():
    camera = StereoCamera.from_models(model(fx=105.46, fy=105.46), model(
        fx=105.46, fy=105.46, tx=-10.546
    ))  # fmt: skip
    assert camera.disparity_of(1.0) == pytest.approx(10.546)
    assert camera.disparity_of(5.0) == pytest.approx(2.109, abs=1e-3)
    assert camera.disparity_of(0.66) == pytest.approx(16.0, abs=0.03)


@pytest.mark.parametrize(
    ("ty", "cy", "baseline", "offset"),
    [
        (8.0, 59.5, 0.10, 0.0),  # above: Ty = +fy * height
        (-8.0, 59.5, -0.10, 0.0),  # below
        (8.0, 62.5, 0.10, 3.0),  # above: a point is lower in `top`, more so by the offset
        (-8.0, 62.5, -0.10, -3.0),  # below: it is higher
    ],
)
def test_trinocular_head_matches_hand_computed_values(ty, cy, baseline, offset):
    camera = StereoCamera.from_models(
        model(fy=80.0), model(fy=80.0, tx=-10.0), model(fy=80.0, cy=cy, ty=ty)
    )
    assert camera.vertical_baseline == pytest.approx(baseline)
    assert camera.vertical_offset_px == pytest.approx(offset)
    assert camera.baseline == pytest.approx(0.1)


def test_baselines_are_relative_to_the_left_camera():
    camera = StereoCamera.from_models(model(tx=3.0, ty=2.0), model(tx=-7.0), model(ty=12.0))
    assert camera.baseline == pytest.approx(0.1)
    assert camera.vertical_baseline == pytest.approx(0.1)


RIGHT = model(tx=-10.0)
TOP = model(ty=10.0)


@pytest.mark.parametrize(
    ("right", "top", "message"),
    [
        (model(width=320, tx=-10.0), None, "right camera_info is 320x120; wanted as left: 160x120"),
        (RIGHT, model(height=60, ty=10.0), "top camera_info is 160x60; wanted as left: 160x120"),
        (model(fx=100.11, tx=-10.0), None, "right camera_info has focal length 100.11 px; wanted"),
        (model(fy=99.0, tx=-10.0), None, "right camera_info has focal length 99 px"),
        (RIGHT, model(fx=99.0, ty=10.0), "top camera_info has focal length 99 px"),
        (model(cy=60.1, tx=-10.0), None, r"right camera_info has cy = 60.1 px; wanted as left: 5"),
        (RIGHT, model(cx=80.1, ty=10.0), r"top camera_info has cx = 80.1 px; wanted as left: 79"),
        (model(), None, r"baseline is 0: P\[3\] of the right camera_info is missing"),
        (model(tx=-0.009), None, "baseline is 0"),
        (model(tx=10.0), None, r"baseline is -0.1 m: P\[3\] .* is 10; .* left and right swapped"),
        (RIGHT, model(), r"vertical baseline is 0: P\[7\] of the top camera_info is missing"),
        (RIGHT, model(ty=0.009), "vertical baseline is 0"),
    ],
)
def test_incompatible_cameras_are_refused(right, top, message):
    with pytest.raises(CameraError, match=message):
        StereoCamera.from_models(model(), right, top)


def test_small_differences_of_rectified_cameras_are_allowed():
    right = model(fx=100.09, fy=99.91, cy=60.0, tx=-10.0)
    top = model(fx=99.91, fy=100.09, cx=79.0, ty=10.0)
    StereoCamera.from_models(model(), right, top)
    tiny = StereoCamera.from_models(model(), model(tx=-0.011), model(ty=-0.011))
    assert tiny.baseline == pytest.approx(0.00011)
    assert tiny.vertical_baseline == pytest.approx(-0.00011)


# --------------------------------------------------------------------------- mounting ----


@pytest.mark.parametrize(
    ("mounting", "right", "down", "forward"),
    [
        (Mounting(), (0, -1, 0), (0, 0, -1), (1, 0, 0)),
        (Mounting(yaw=PI / 2), (1, 0, 0), (0, 0, -1), (0, 1, 0)),  # looks to the left
        (Mounting(pitch=PI / 2), (0, -1, 0), (-1, 0, 0), (0, 0, -1)),  # straight down
        (Mounting(roll=PI / 2), (0, 0, -1), (0, 1, 0), (1, 0, 0)),  # its right side is down
        (Mounting(pitch=PI / 2, yaw=PI / 2), (1, 0, 0), (0, -1, 0), (0, 0, -1)),
    ],
)
def test_mounted_head_has_the_expected_axes(mounting, right, down, forward):
    head = dataclasses.replace(StereoCamera.from_models(model(), RIGHT), mounting=mounting)
    rotation, _ = head.robot_from_optical
    np.testing.assert_allclose(rotation, np.transpose([right, down, forward]), atol=1e-15)


def test_mounted_head_has_the_expected_position():
    mounting = Mounting(height=1.3, forward=0.2, left=-0.1, yaw=1.0)
    head = StereoCamera.from_models(model(), RIGHT, mounting=mounting)
    np.testing.assert_array_equal(head.robot_from_optical[1], [0.2, -0.1, 1.3])


@given(pitch=st.floats(-PI, PI), roll=st.floats(-PI, PI), yaw=st.floats(-PI, PI))
def test_mounting_rotates_the_head_by_its_angles(make_head, pitch, roll, yaw):
    head = make_head(mounting=Mounting(pitch=pitch, roll=roll, yaw=yaw))
    rotation, _ = head.camera().robot_from_optical
    np.testing.assert_allclose(rotation, head.axes().T, atol=1e-12)

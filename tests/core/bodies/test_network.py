import math

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.bodies import network
from mrs_people_loc.bodies.network import (
    COLUMNS,
    HALF_WIDTH,
    HIGH,
    LOW,
    ROWS,
    PersonNetwork,
    normalized,
    sample_windows,
)
from mrs_people_loc.config import Mounting
from mrs_people_loc.errors import ConfigError

TILTED = Mounting(height=1.4, pitch=0.2, forward=0.2, left=-0.3, yaw=0.7, roll=-0.05)
ROW, COLUMN = (HIGH - LOW) / ROWS, 2 * HALF_WIDTH / COLUMNS


def random_image(head, seed=0) -> np.ndarray:
    rng = np.random.default_rng(seed)
    return rng.integers(0, 256, (head.height, head.width), dtype=np.uint8)


def scores(head, image, bearing, ranges) -> np.ndarray:
    return PersonNetwork(head.camera())(image, np.array(bearing), np.array(ranges))


def place_of(head, bearing, distance, row, column):
    """Column and row [px] of a sample, by the axes of the head."""
    m = head.mounting
    across = HALF_WIDTH - (column + 0.5) * COLUMN
    ray = np.array(
        [
            distance * math.cos(bearing) - across * math.sin(bearing),
            distance * math.sin(bearing) + across * math.cos(bearing),
            HIGH - (row + 0.5) * ROW - m.height,
        ]
    )
    right, down, forward = head.axes() @ ray
    camera = head.camera()
    return (camera.fx * right / forward + camera.cx, camera.fy * down / forward + camera.cy)


# ------------------------------------------------------------------------------ windows ----


@pytest.mark.parametrize("distance", [1.5, 2.8, 4.5])
@pytest.mark.parametrize(("row", "column"), [(20, 4), (20, 20), (30, 12), (15, 8)])
def test_samples_are_where_the_head_sees_them(make_head, distance, row, column):
    head = make_head(mounting=TILTED)
    across, down = np.meshgrid(np.arange(head.width), np.arange(head.height))
    bearing = TILTED.yaw + 0.05
    u, v = place_of(head, bearing, distance, row, column)
    place = head.camera(), np.array([bearing]), np.array([distance])
    for ramp, wanted in ((across, u), (down, v)):  # a ramp stays what it is when it is smoothed
        camera, *at = place
        grey, inside = sample_windows(camera, ramp.astype(np.uint8), *at)
        assert inside[0, row, column]
        assert grey[0, row, column] == pytest.approx(wanted, abs=0.05)


def test_mask_ends_with_the_image(make_head):
    head = make_head(mounting=Mounting(height=1.0))
    edge = math.atan(0.5 * head.width / head.fx)
    _, inside = sample_windows(
        head.camera(), random_image(head), np.array([edge, -edge]), np.array([3.0, 3.0])
    )
    assert not inside[0, :, : COLUMNS // 2 - 2].any()
    assert inside[0, ROWS // 2, COLUMNS // 2 + 2 :].all()
    np.testing.assert_array_equal(inside[0], inside[1, :, ::-1])


def test_nothing_behind_the_lens_is_in_the_image(make_head):
    head = make_head(mounting=Mounting(height=1.0))
    _, inside = sample_windows(head.camera(), random_image(head), np.array([3.1]), np.array([2.0]))
    assert not inside.any()


# ------------------------------------------------------------------------ normalization ----


@given(st.integers(0, 99), st.floats(0.0, 1.0))
def test_input_has_no_mean_and_ignores_what_is_outside(seed, share):
    rng = np.random.default_rng(seed)
    grey = rng.uniform(0, 255, (2, ROWS, COLUMNS)).astype(np.float32)
    inside = rng.uniform(size=grey.shape) < share
    values = normalized(grey, inside)
    assert values.dtype == np.float32
    assert values.shape == (2, 2, ROWS, COLUMNS)
    np.testing.assert_array_equal(values[:, 1], inside)
    assert not values[:, 0][~inside].any()
    np.testing.assert_allclose(values[:, 0].sum(axis=(1, 2)), 0.0, atol=0.05)
    other = np.where(inside, grey, 7.0).astype(np.float32)
    np.testing.assert_array_equal(normalized(other, inside), values)


def test_input_has_a_deviation_of_nearly_one_whatever_the_contrast():
    rng = np.random.default_rng(0)
    root = rng.uniform(8, 12, (1, ROWS, COLUMNS))
    everywhere = np.ones(root.shape, dtype=bool)
    for contrast in (1.0, 3.0):
        grey = ((10 + contrast * (root - 10)) ** 2 - 1).astype(np.float32)
        deviation = contrast * root.std()
        assert normalized(grey, everywhere)[:, 0].std() == pytest.approx(
            deviation / (deviation + 0.5), rel=1e-3
        )


# ------------------------------------------------------------------------------ network ----


def test_score_of_a_place_does_not_depend_on_the_others(make_head):
    head = make_head(mounting=Mounting(height=1.0))
    image = random_image(head)
    bearing, ranges = np.linspace(-0.4, 0.4, 7), np.linspace(1.0, 4.5, 7)
    find = PersonNetwork(head.camera())
    together = find(image, bearing, ranges)
    assert together.dtype == np.float64
    assert np.ptp(together) > 0.1
    for k in range(7):
        alone = find(image, bearing[k : k + 1], ranges[k : k + 1])
        np.testing.assert_allclose(alone, together[k : k + 1], atol=1e-4)


def test_no_places_have_no_scores(make_head):
    assert scores(make_head(), random_image(make_head()), [], []).shape == (0,)


def drawn_figure(head, distance, *, grey=60, floor=150) -> np.ndarray:
    """A dark figure of a head, shoulders, trunk and legs before something bright and uneven."""
    rng = np.random.default_rng(1)
    image = cv2.GaussianBlur(rng.normal(floor, 40, (head.height, head.width)), (0, 0), 6)
    m, cx, cy = head.fx / distance, (head.width - 1) / 2, (head.height - 1) / 2

    def v(height):
        return cy + (head.mounting.height - height) * m

    def filled(across, low, high):
        corners = [(cx + x * m, v(z)) for x, z in zip(across, (low, low, high, high), strict=True)]
        cv2.fillPoly(image, [np.rint(corners).astype(np.int32)], float(grey))

    filled((-0.2, 0.2, 0.22, -0.22), 0.85, 1.45)
    filled((-0.18, -0.04, -0.02, -0.18), 0.0, 0.9)
    filled((0.04, 0.18, 0.18, 0.02), 0.0, 0.9)
    centre = (round(cx), round(v(1.63)))
    cv2.ellipse(image, centre, (round(0.08 * m), round(0.12 * m)), 0, 0, 360, float(grey), -1)
    return np.clip(image, 0, 255).astype(np.uint8)


@pytest.mark.parametrize("distance", [2.0, 3.0, 4.0])
def test_figure_is_rather_a_person_than_what_is_beside_or_upside_down(make_head, distance):
    head = make_head(mounting=Mounting(height=0.875))  # the middle of the figure
    image = drawn_figure(head, distance)
    beside = 0.7 / distance
    at = scores(head, image, [0.0, beside, -beside], [distance] * 3)
    (turned,) = scores(head, image[::-1].copy(), [0.0], [distance])
    assert at[0] > max(at[1], at[2], turned) + 1.0


# ------------------------------------------------------------------------------- errors ----


@pytest.mark.parametrize("name", ["absent.onnx", "body_model.json"])
def test_missing_or_broken_file_is_an_error(monkeypatch, make_head, name):
    monkeypatch.setattr(network, "_FILE", name)
    with pytest.raises(ConfigError, match=f"{name} cannot be read"):
        PersonNetwork(make_head().camera())

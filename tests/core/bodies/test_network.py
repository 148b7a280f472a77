import math

import cv2
import numpy as np
import pytest

from mrs_people_loc.bodies import network
from mrs_people_loc.bodies.network import (
    COLUMNS,
    HALF_WIDTH,
    HIGH,
    LOW,
    ROWS,
    WINDOW_ACROSS,
    WINDOW_HEIGHTS,
    PersonNetwork,
    normalized,
    window_input,
)
from mrs_people_loc.bodies.patches import upright_pixels
from mrs_people_loc.config import Mounting
from mrs_people_loc.errors import ConfigError

TILTED = Mounting(height=1.4, pitch=0.2, forward=0.2, left=-0.3, yaw=0.7, roll=-0.05)
NOISE = np.random.default_rng(0).integers(0, 256, (120, 160), dtype=np.uint8)


def place_of(head, bearing, distance, height, across):
    """Column and row [px] of a sample, by the axes of the head."""
    ray = np.array(
        [
            distance * math.cos(bearing) - across * math.sin(bearing),
            distance * math.sin(bearing) + across * math.cos(bearing),
            height - head.mounting.height,
        ]
    )
    right, down, forward = head.axes() @ ray
    camera = head.camera()
    return (camera.fx * right / forward + camera.cx, camera.fy * down / forward + camera.cy)


# -------------------------------------------------------------------------------- input ----


def test_channels_are_normalized_in_the_image_and_around():
    grey = NOISE.copy()
    grey[:, 80:] //= 8  # its right half is dark
    whole, around = normalized(grey)
    assert whole.dtype == np.float32
    assert whole.shape == (128, 160)
    assert not whole[120:].any()
    assert not around[120:].any()
    assert whole[:120].mean() == pytest.approx(0.0, abs=1e-4)
    assert whole[:120].std() == pytest.approx(1.0, abs=0.2)
    bright, dark = around[:120, 10:70].std(), around[:120, 90:150].std()
    assert bright == pytest.approx(dark, rel=0.25)
    assert whole[:120, :80].mean() > whole[:120, 80:].mean() + 1.0


def test_faint_noise_stays_faint():
    faint = np.random.default_rng(1).integers(100, 102, (120, 160), dtype=np.uint8)
    assert np.abs(normalized(faint)).max() < 0.5


# ----------------------------------------------------------------------------- features ----


@pytest.mark.parametrize(
    ("more", "shape"),
    [
        ({}, (32, 40)),
        ({"width": 640, "height": 480, "fx": 560.0, "fy": 560.0}, (32, 40)),
        ({"width": 320, "height": 240, "fx": 140.0, "fy": 140.0}, (64, 80)),
    ],
)
def test_there_is_a_cell_for_so_many_pixels_of_a_wide_lens(make_head, more, shape):
    head = make_head(**more)
    image = np.zeros((head.height, head.width), np.uint8)
    assert PersonNetwork(head.camera()).features(image).shape == (*shape, 16)


# ------------------------------------------------------------------------------ windows ----


@pytest.mark.parametrize("distance", [1.5, 2.8, 4.5])
@pytest.mark.parametrize(("row", "column"), [(5, 1), (5, 5), (7, 3), (4, 2)])
def test_samples_are_where_the_head_sees_them(make_head, distance, row, column):
    head = make_head(mounting=TILTED)
    bearing = TILTED.yaw + 0.05
    height = HIGH - (row + 0.5) * (HIGH - LOW) / ROWS
    across = HALF_WIDTH - (column + 0.5) * 2.0 * HALF_WIDTH / COLUMNS
    place = np.array([bearing]), np.array([distance])
    u, v, _, inside = upright_pixels(head.camera(), *place, WINDOW_HEIGHTS, WINDOW_ACROSS)
    wanted = place_of(head, bearing, distance, height, across)
    assert inside[0, row, column]
    assert (u[0, row, column], v[0, row, column]) == pytest.approx(wanted, abs=1e-3)


def test_mask_ends_with_the_image(make_head):
    head = make_head(mounting=Mounting(height=1.0))
    edge = math.atan(0.5 * head.width / head.fx)
    place = np.array([edge, -edge]), np.array([3.0, 3.0])
    *_, inside = upright_pixels(head.camera(), *place, WINDOW_HEIGHTS, WINDOW_ACROSS)
    assert not inside[0, :, : COLUMNS // 2].any()
    assert inside[0, ROWS // 2, COLUMNS // 2 :].all()
    np.testing.assert_array_equal(inside[0], inside[1, :, ::-1])


def test_nothing_behind_the_lens_is_in_the_image(make_head):
    head = make_head(mounting=Mounting(height=1.0))
    place = np.array([3.1]), np.array([2.0])
    *_, inside = upright_pixels(head.camera(), *place, WINDOW_HEIGHTS, WINDOW_ACROSS)
    assert not inside.any()


def test_window_is_told_its_size_and_nothing_of_what_is_outside():
    rng = np.random.default_rng(0)
    inside = rng.uniform(size=(2, ROWS, COLUMNS)) < 0.6
    features = rng.uniform(size=(2, ROWS, COLUMNS, 3)).astype(np.float32)
    size = np.array([60.0, 60.0 * math.e])
    values = window_input(features, inside, size)
    assert values.dtype == np.float32
    cells = values[:, :-1].reshape(2, ROWS, COLUMNS, 4)
    np.testing.assert_array_equal(cells[..., 3], inside)
    np.testing.assert_array_equal(cells[inside][:, :3], features[inside])
    assert not cells[~inside].any()
    np.testing.assert_allclose(values[:, -1], [0.0, 1.0], atol=1e-6)


# ---------------------------------------------------------------------------------- scores ----


def scores(head, image, bearing, ranges) -> np.ndarray:
    return PersonNetwork(head.camera())(image, np.array(bearing), np.array(ranges))


def test_score_of_a_place_does_not_depend_on_the_others(make_head):
    head = make_head(mounting=Mounting(height=1.0))
    bearing, ranges = np.linspace(-0.4, 0.4, 7), np.linspace(1.0, 4.5, 7)
    together = scores(head, NOISE, bearing, ranges)
    assert together.dtype == np.float64
    assert np.ptp(together) > 0.1
    for k in range(7):
        alone = scores(head, NOISE, bearing[k : k + 1], ranges[k : k + 1])
        np.testing.assert_allclose(alone, together[k : k + 1], atol=1e-4)


def test_no_places_have_no_scores(make_head):
    assert scores(make_head(), NOISE, [], []).shape == (0,)


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
    image, beside = drawn_figure(head, distance), 0.7 / distance
    figure, *others = scores(head, image, [0.0, beside, -beside], [distance] * 3)
    (turned,) = scores(head, image[::-1].copy(), [0.0], [distance])
    assert figure > max(*others, turned) + 1.0


# ------------------------------------------------------------------------------- errors ----


@pytest.mark.parametrize("part", ["_FEATURES", "_WINDOW"])
@pytest.mark.parametrize("name", ["absent.onnx", "body_model.json"])
def test_missing_or_broken_file_is_an_error(monkeypatch, make_head, part, name):
    monkeypatch.setattr(network, part, name)
    with pytest.raises(ConfigError, match=f"{name} cannot be read"):
        PersonNetwork(make_head().camera())

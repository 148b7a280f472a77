import math

import cv2
import numpy as np
import pytest

from mrs_people_loc.bodies import person_map
from mrs_people_loc.bodies.patches import PatchSampler
from mrs_people_loc.bodies.person_map import CELL, PersonMap, normalized
from mrs_people_loc.config import Mounting
from mrs_people_loc.errors import ConfigError

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


# ---------------------------------------------------------------------------------- map ----


@pytest.mark.parametrize(
    ("more", "shape"),
    [
        ({}, (32, 40)),
        ({"width": 640, "height": 480, "fx": 560.0, "fy": 560.0}, (32, 40)),
        ({"width": 320, "height": 240, "fx": 140.0, "fy": 140.0}, (64, 80)),
    ],
)
def test_map_has_a_cell_for_so_many_pixels_of_a_wide_lens(make_head, more, shape):
    head = make_head(**more)
    image = np.zeros((head.height, head.width), np.uint8)
    assert PersonMap(head.camera()).log_odds(image).shape == shape


def patches_of(head, bearing, ranges, disparity=None):
    camera = head.camera()
    if disparity is None:
        disparity = np.full((head.height, head.width), np.nan, np.float32)
    inverse = camera.depth_disparity / np.array(ranges, dtype=float)
    return PatchSampler(camera)(disparity, np.array(bearing, dtype=float), inverse)


@pytest.mark.parametrize("scale", [1, 4])
@pytest.mark.parametrize(
    ("low", "high", "least", "most"),
    [(0.1, 2.0, 0.7, 1.0), (0.1, 1.4, 0.7, 1.0), (0.8, 1.4, -0.1, 0.4), (0.8, 2.0, 0.7, 1.0)],
)
def test_two_of_three_parts_decide(make_head, monkeypatch, scale, low, high, least, most):
    size = {"width": 160 * scale, "height": 120 * scale, "fx": 140.0 * scale, "fy": 140.0 * scale}
    head = make_head(mounting=Mounting(height=1.0), **size)
    bearing, away = 0.2, 3.0
    rows, columns = np.indices((32, 40))

    def shown(_self, _left):
        """1 where somebody is between two heights, by rows and columns of the map."""
        u, below = place_of(head, bearing, away, low, 0.0)
        _, above = place_of(head, bearing, away, high, 0.0)
        row, column = ((index + 0.5) * CELL * scale - 0.5 for index in (rows, columns))
        inside = (row > above) & (row < below) & (np.abs(column - u) < 9 * scale)
        return inside.astype(np.float32)

    monkeypatch.setattr(PersonMap, "log_odds", shown)
    image = np.zeros((head.height, head.width), np.uint8)
    (found,) = PersonMap(head.camera())(image, patches_of(head, [bearing], [away]))
    assert least < found < most


def test_what_is_not_in_the_image_or_behind_something_nearer_says_nothing(make_head):
    head = make_head(mounting=Mounting(height=1.0))
    see = PersonMap(head.camera())
    np.testing.assert_array_equal(see(NOISE, patches_of(head, [1.5], [2.0])), 0.0)
    nearer = np.full((120, 160), head.camera().depth_disparity / 2.0, np.float32)
    behind, before = see(NOISE, patches_of(head, [0.0, 0.0], [4.0, 1.5], nearer))
    assert behind == 0.0
    assert abs(before) > 0.1
    assert see(NOISE, patches_of(head, [], [])).shape == (0,)


def test_a_body_does_not_depend_on_the_others(make_head):
    head = make_head(mounting=Mounting(height=1.0))
    see = PersonMap(head.camera())
    patches = patches_of(head, np.linspace(-0.4, 0.4, 7), np.linspace(1.0, 4.5, 7))
    together = see(NOISE, patches)
    assert together.dtype == np.float64
    for k in range(7):
        alone = see(NOISE, patches.select(slice(k, k + 1)))
        np.testing.assert_allclose(alone, together[k : k + 1], atol=1e-6)


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
    see, image, beside = PersonMap(head.camera()), drawn_figure(head, distance), 0.9 / distance
    patches = patches_of(head, [0.0, beside, -beside], [distance] * 3)
    figure, *others = see(image, patches)
    turned = see(image[::-1].copy(), patches)[0]
    assert figure > max(*others, turned) + 0.2


# ------------------------------------------------------------------------------- errors ----


@pytest.mark.parametrize("name", ["absent.onnx", "body_model.json"])
def test_missing_or_broken_file_is_an_error(monkeypatch, make_head, name):
    monkeypatch.setattr(person_map, "_FILE", name)
    with pytest.raises(ConfigError, match=f"{name} cannot be read"):
        PersonMap(make_head().camera())


def test_another_file_is_named(make_head, tmp_path):
    with pytest.raises(ConfigError, match=r"other\.onnx cannot be read"):
        PersonMap(make_head().camera(), tmp_path / "other.onnx")

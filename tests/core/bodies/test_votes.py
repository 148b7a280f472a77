import math

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mrs_people_loc.bodies.patches import ACROSS, Patches, PatchSampler
from mrs_people_loc.bodies.votes import vote
from mrs_people_loc.config import Mounting

HEAD = {"fx": 100.0, "fy": 100.0}  # baseline 0.1 m: 5 px at 2 m
FINE = 4  # grains of the drawn texture per pixel


def texture(seed: int, contrast: float = 40.0) -> np.ndarray:
    """Grey values as a lens gives them, `FINE` of them per pixel, 40 px wider than an image."""
    rng = np.random.default_rng(seed)
    noise = rng.normal(0.0, 1.0, (120 * FINE, 200 * FINE)).astype(np.float32)
    smooth = cv2.GaussianBlur(noise, (0, 0), 1.2 * FINE)
    return 128.0 + contrast * smooth / smooth.std()


def pair(fine, disparity, *, gain=1.0, offset=0.0, noise=0.0, seed=0):
    """Left and right image of a texture; `disparity` is a number or one per column of `right`."""
    v, u = np.mgrid[:120, :160].astype(np.float32)

    def drawn(column):
        # Column 0 is 20 px inside the texture, on both sides there is more of it.
        x, y = (column + 20) * FINE, v * FINE
        image = cv2.remap(fine, x, y, cv2.INTER_CUBIC, borderMode=cv2.BORDER_REPLICATE)
        return image + np.random.default_rng([seed, int(column[0, 5])]).normal(0, noise, v.shape)

    left = drawn(u)
    right = gain * drawn((u + disparity).astype(np.float32)) + offset
    return (np.rint(np.clip(image, 0, 255)).astype(np.uint8) for image in (left, right))


def patches_at(head, bearing=(0.0,), distance=(2.0,), disparity=None) -> Patches:
    """Patches whose samples are all at their own disparity, to a tenth of the tolerance."""
    bearing, inverse = np.array(bearing), head.fx * 0.1 / np.array(distance)
    seen = np.full((120, 160), 5.05, dtype=np.float32) if disparity is None else disparity
    return PatchSampler(head.camera())(seen, bearing, inverse)


def voted(left, right, patches: Patches, *, offset_px=0.0) -> tuple[np.ndarray, np.ndarray]:
    """Voted differences of disparity and their standard deviations [px]."""
    found = vote(left, right, patches, offset_px=offset_px)
    return found.shift, found.sigma


@settings(max_examples=60)
@given(
    st.integers(0, 10**6), st.floats(-0.9, 0.9), st.floats(0.8, 1.25), st.floats(-20.0, 20.0),
)  # fmt: skip
def test_shift_is_found_for_any_gain_and_offset(make_head, seed, shift, gain, offset):
    left, right = pair(texture(seed), 5.0 + shift, gain=gain, offset=offset)
    found, sigma = voted(left, right, patches_at(make_head(**HEAD)))
    assert found.shape == sigma.shape == (1,)
    assert found[0] == pytest.approx(shift, abs=0.03)
    assert 0 < sigma[0] < 0.03


def test_disparity_at_infinity_is_added(make_head):
    head = make_head(**HEAD, centres={"right": (76.0, 59.5)})  # 3.5 px
    left, right = pair(texture(1), 5.0 + 3.5 + 0.3)
    patches = patches_at(head, disparity=np.full((120, 160), 8.5, dtype=np.float32))
    found, _ = voted(left, right, patches, offset_px=3.5)
    assert found == pytest.approx([0.3], abs=0.03)


def seen_of(patches: Patches, more_px: float):
    """Images of a patch's own surface, nearer by some pixels, and the disparity of `left`."""
    inside = patches.inside[0]
    u, v, expected = (part[0][inside] for part in (patches.u, patches.v, patches.expected))
    # The disparity of any plane is linear in the image.
    a, b, c = np.linalg.lstsq(np.stack([u, v, np.ones_like(u)], axis=1), expected, rcond=None)[0]
    v, u = np.mgrid[:120, :160].astype(np.float32)
    # right(u) shows what left shows at u + d, where d is that of u + d.
    left, right = pair(texture(5), (a * u + b * v + c + more_px) / (1 - a))
    return left, right, (a * u + b * v + c + more_px).astype(np.float32)


@pytest.mark.parametrize(
    ("mounting", "bearing", "least", "most"),
    [
        (Mounting(height=1.4, pitch=0.3, roll=0.2), 0.0, 0.7, 1.0),
        (Mounting(), 0.3, 0.7, 1.0),
        (Mounting(), math.atan(0.795), 0.3, 0.6),  # half of the body is beyond the left border
    ],
    ids=["tilted", "beside", "cut"],
)
def test_oblique_surface_in_the_image_is_measured(make_head, mounting, bearing, least, most):
    head = make_head(**HEAD, mounting=mounting)
    distance = 2.0 / math.cos(bearing)
    patches = patches_at(head, (bearing,), (distance,))
    left, right, disparity = seen_of(patches, 0.4)
    patches = patches_at(head, (bearing,), (distance,), disparity)
    assert least < np.isfinite(patches.difference[0][:, np.abs(ACROSS) < 0.28]).mean() < most
    found, _ = voted(left, right, patches)
    assert found == pytest.approx([0.4], abs=0.03)


def test_bodies_vote_independently(make_head):
    head = make_head(**HEAD)
    # To the left of the middle at 2 m and 0.3 px nearer, to the right of it 0.2 px farther.
    u = np.mgrid[:120, :160][1]
    left, right = pair(texture(2), np.where(u < 75, 5.3, 4.8))
    bearing = (math.atan(0.35), math.atan(-0.35))
    patches = patches_at(head, bearing, tuple(2.0 * math.hypot(1.0, 0.35) for _ in bearing))
    both, _ = voted(left, right, patches)
    assert both == pytest.approx([0.3, -0.2], abs=0.03)
    swapped = patches_at(head, bearing[::-1], (2.0 * math.hypot(1.0, 0.35),) * 2)
    np.testing.assert_allclose(voted(left, right, swapped)[0], both[::-1], atol=1e-5)


def test_contrast_separates_the_body_from_the_background(make_head):
    """A body 0.3 m wide in front of a wall, in a patch that its windows fill completely."""
    head = make_head(**HEAD)
    u = np.mgrid[:120, :160][1]
    behind = np.abs(u + 5 - 79.5) >= 9
    left, right = pair(texture(3), np.where(behind, 2.5, 5.0), noise=1.0)
    alone = vote(left, right, patches_at(head), offset_px=0.0).contrast
    rows = slice(2, 20)
    assert alone[0, rows, np.abs(ACROSS) < 0.1].mean() > 0.15
    assert alone[0, rows, np.abs(ACROSS) > 0.3].mean() < -0.15
    # Beside another body it says the same.
    two = vote(left, right, patches_at(head, (0.5, 0.0), (2.2, 2.0)), offset_px=0.0).contrast
    np.testing.assert_allclose(two[1], alone[0], atol=1e-5)


def test_pixels_outside_the_body_do_not_vote(make_head):
    head = make_head(**HEAD)
    u = np.mgrid[:120, :160][1]
    # A wall, 2.5 px behind, fills the patch but for 0.3 m in the middle.
    body = np.abs(u - 79.5) < 9
    behind = np.abs(u + 5 - 79.5) >= 9
    left, right = pair(texture(3), np.where(behind, 2.5, 5.2))
    seen = np.where(body, 5.2, 2.5).astype(np.float32)
    patches = patches_at(head, disparity=seen)
    found, _ = voted(left, right, patches)
    assert found == pytest.approx([0.2], abs=0.06)
    # If all were of it, they would vote for something else.
    wrong, _ = voted(left, right, patches_at(head))
    assert abs(wrong[0] - 0.2) > 0.1


@pytest.mark.parametrize("shift", [3.0, -3.0, 9.0])
def test_votes_are_bounded(make_head, shift):
    left, right = pair(texture(6), 5.0 + shift)
    found, _ = voted(left, right, patches_at(make_head(**HEAD)))
    assert abs(found[0]) <= 1.2 + 1e-6


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_without_texture_the_vote_is_undefined(make_head, grey):
    flat = np.full((120, 160), grey, dtype=np.uint8)
    found, sigma = voted(flat, flat, patches_at(make_head(**HEAD)))
    assert found == pytest.approx([0.0], abs=1e-3)
    assert sigma[0] > 1.0


def test_without_samples_the_vote_is_undefined(make_head):
    nothing = np.full((120, 160), np.nan, dtype=np.float32)
    left, right = pair(texture(7), 5.5)
    patches = patches_at(make_head(**HEAD), disparity=nothing)
    found, sigma = voted(left, right, patches)
    assert found == pytest.approx([0.0], abs=1e-6)
    assert sigma[0] > 1.0


def test_no_bodies_give_no_votes(make_head):
    left, right = pair(texture(8), 5.0)
    found, sigma = voted(left, right, patches_at(make_head(**HEAD), (), ()))
    assert found.shape == sigma.shape == (0,)


def test_sigma_equals_the_size_of_the_errors(make_head):
    patches = patches_at(make_head(**HEAD))
    sigmas = []
    for contrast in (10.0, 40.0):
        fine, votes = texture(9, contrast), []
        for seed in range(40):
            left, right = pair(fine, 5.25, noise=6.0, seed=seed)
            votes.append(voted(left, right, patches))
        found, sigma = (np.array(part)[:, 0] for part in zip(*votes, strict=True))
        assert 0.5 < found.std() / sigma.mean() < 2.0
        sigmas.append(sigma.mean())
    assert sigmas[0] > 2 * sigmas[1]

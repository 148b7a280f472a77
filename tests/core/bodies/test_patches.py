import math

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from mrs_people_loc.bodies.patches import ACROSS, HEIGHTS, Patches, PatchSampler, in_rows, quantiles
from mrs_people_loc.config import Mounting

SHAPE = (len(HEIGHTS), len(ACROSS))
SIZE = {"width": 240, "height": 180, "fx": 158.0, "fy": 158.0}
SCALE = SIZE["fx"] * 0.1

mountings = st.builds(
    Mounting,
    height=st.floats(0.5, 2.4),
    forward=st.floats(-1, 1),
    left=st.floats(-1, 1),
    pitch=st.floats(-0.3, 0.6),
    roll=st.floats(-0.3, 0.3),
    yaw=st.floats(-math.pi, math.pi),
)


TILTED = Mounting(height=2.2, pitch=0.45, forward=0.2, left=-0.3, yaw=2.0)


def nowhere(head) -> np.ndarray:
    return np.full((head.height, head.width), np.nan, dtype=np.float32)


def one(head, disparity, bearing, distance) -> Patches:
    inverse = np.array([head.fx * 0.1 / distance])
    return PatchSampler(head.camera())(disparity, np.array([bearing]), inverse)


def at(height: float, across: float) -> tuple[int, int, int]:
    """Index of the sample nearest to a height and a distance to the left."""
    return 0, int(np.abs(HEIGHTS - height).argmin()), int(np.abs(ACROSS - across).argmin())


def front(rectangle, mounting, bearing, distance, *, width=0.4, top=1.7):
    """A rectangle that stands at a bearing and range from the lens, and faces it."""
    cos, sin = math.cos(bearing), math.sin(bearing)
    x = mounting.forward + distance * cos - 0.5 * width * sin
    y = mounting.left + distance * sin + 0.5 * width * cos
    return rectangle(corner=(x, y, 0), side_a=(width * sin, -width * cos, 0), side_b=(0, 0, top))


# ------------------------------------------------------------------------------ samples ----


def test_samples_are_evenly_spaced_and_symmetric():
    np.testing.assert_allclose(np.diff(ACROSS), 0.05, atol=1e-6)
    np.testing.assert_allclose(np.diff(HEIGHTS), 0.075, atol=1e-6)
    np.testing.assert_allclose(ACROSS, -ACROSS[::-1], atol=1e-7)


def test_level_camera_matches_hand_computed_values(make_head):
    # f = 100 px, baseline 0.1 m, principal point (79.5, 59.5), 1 m up.
    head = make_head(fx=100.0, fy=100.0)
    patches = one(head, nowhere(head), 0.0, 2.0)
    assert patches.u.shape == patches.v.shape == patches.inside.shape == (1, *SHAPE)
    # 0.5 m to the left, 1.6 m up: 50 px per metre.
    assert patches.u[at(1.6, 0.5)] == pytest.approx(79.5 - 25.0, abs=1e-3)
    assert patches.v[at(1.6, 0.5)] == pytest.approx(59.5 - 30.0, abs=1e-3)
    assert patches.v[at(0.1, 0.0)] == pytest.approx(59.5 + 45.0, abs=1e-3)
    np.testing.assert_allclose(patches.expected, 5.0, atol=1e-5)
    # The image's upper border is at 2.2 m.
    inside = np.repeat((HEIGHTS < 2.2)[np.newaxis, :, np.newaxis], len(ACROSS), axis=2)
    np.testing.assert_array_equal(patches.inside, inside)
    assert patches.tolerance == pytest.approx([0.22 * 25 / 10])


def test_off_axis_position_matches_hand_computed_values(make_head):
    head = make_head(fx=100.0, fy=100.0)
    patches = one(head, nowhere(head), math.pi / 6, 2.0)
    # At bearing 30 degrees: z = 1.732, and what is 0.5 m to the left is 0.25 m nearer.
    z = 2 * math.cos(math.pi / 6)
    middle, beside = at(1.0, 0.0), at(1.0, 0.5)
    assert patches.expected[middle] == pytest.approx(10 / z, rel=1e-5)
    assert patches.u[middle] == pytest.approx(79.5 - 100 / z, abs=1e-3)
    assert patches.expected[beside] == pytest.approx(10 / (z - 0.25), rel=1e-5)
    left = 1.0 + 0.5 * math.cos(math.pi / 6)
    assert patches.u[beside] == pytest.approx(79.5 - 100 * left / (z - 0.25), abs=1e-3)
    # Tolerance is in inverse range; a pixel of disparity is 1 / cos of it here.
    assert patches.tolerance == pytest.approx([0.55 / math.cos(math.pi / 6)], rel=1e-4)


@given(mountings, st.floats(-0.5, 0.5), st.floats(0.8, 6.0))
def test_samples_are_projections_of_an_upright_surface(make_head, mounting, beside, distance):
    head = make_head(mounting=mounting)
    bearing = mounting.yaw + beside
    patches = one(head, nowhere(head), bearing, distance)
    cos, sin = math.cos(bearing), math.sin(bearing)
    across, heights = np.meshgrid(ACROSS.astype(float), HEIGHTS.astype(float))
    points = np.stack(
        [distance * cos - across * sin, distance * sin + across * cos, heights - mounting.height],
        axis=-1,
    )
    right, down, forward = np.moveaxis(points @ head.axes().T, -1, 0)
    ahead = forward > 0.3
    u = 79.5 + head.fx * right[ahead] / forward[ahead]
    v = 59.5 + head.fy * down[ahead] / forward[ahead]
    np.testing.assert_allclose(patches.u[0][ahead], u, atol=0.02)
    np.testing.assert_allclose(patches.v[0][ahead], v, atol=0.02)
    np.testing.assert_allclose(
        patches.expected[0][ahead], head.fx * 0.1 / forward[ahead], rtol=1e-4
    )
    assert not patches.inside[0][forward < 0.05].any()
    border = np.minimum.reduce([u + 0.5, 159.5 - u, v + 0.5, 119.5 - v])
    np.testing.assert_array_equal(
        patches.inside[0][ahead][np.abs(border) > 0.05], border[np.abs(border) > 0.05] > 0
    )


# --------------------------------------------------------------------------- difference ----


def test_difference_is_observed_minus_expected_disparity(make_head):
    head = make_head(fx=100.0, fy=100.0, centres={"right": (76.5, 59.5)})  # 3 px at infinity
    disparity = np.full((120, 160), 8.25, dtype=np.float32)
    disparity[:, 80:] = np.nan
    patches = one(head, disparity, 0.0, 2.0)
    np.testing.assert_allclose(patches.expected, 5.0, atol=1e-5)
    known = patches.inside & (patches.u < 79.4)
    np.testing.assert_allclose(patches.difference[known], 0.25, atol=1e-5)
    assert np.isnan(patches.difference[~known]).all()
    assert known.sum() == (HEIGHTS < 2.2).sum() * (ACROSS > 0.0).sum()


def test_nearest_pixel_is_sampled(make_head):
    head = make_head(fx=100.0, fy=100.0)
    v, u = np.mgrid[:120, :160].astype(np.float32)
    patches = one(head, u + 1000 * v, 0.0, 2.1)
    seen = patches.difference + patches.expected
    inside = patches.inside
    expected = np.floor(patches.u + 0.5) + 1000 * np.floor(patches.v + 0.5)
    np.testing.assert_allclose(seen[inside], expected[inside], atol=0.02)


def test_samples_behind_the_lens_are_empty(make_head):
    head = make_head()
    patches = one(head, np.full((120, 160), 5.0, dtype=np.float32), math.pi, 2.0)
    assert not patches.inside.any()
    assert np.isnan(patches.difference).all()
    assert np.isfinite(patches.u).all()
    assert np.isfinite(patches.expected).all()


@settings(max_examples=40)
@given(mountings, st.floats(-0.3, 0.3), st.floats(1.5, 4.0))
def test_surface_at_the_candidate_has_zero_difference(
    make_head, rectangle, mounting, beside, distance
):
    head = make_head(**SIZE, mounting=mounting)
    bearing = mounting.yaw + beside
    disparity = head.disparity(front(rectangle, mounting, bearing, distance))
    patches = one(head, disparity, bearing, distance)
    # Up to 2 px within its borders it is seen, beyond it is not.
    metres = 2 * distance / SIZE["fx"] / 0.7
    body = (np.abs(ACROSS) < 0.2 - metres) & (1.7 - metres > HEIGHTS)[:, np.newaxis]
    assume((patches.inside[0] & body).sum() > 20)
    # A pixel beside the sample shows another part of the surface, where it is tilted in the view.
    np.testing.assert_allclose(patches.difference[0][patches.inside[0] & body], 0.0, atol=0.1)
    beyond = (np.abs(ACROSS) > 0.2 + metres) | (1.7 + metres < HEIGHTS)[:, np.newaxis]
    assert np.isnan(patches.difference[0][beyond]).all()


# ------------------------------------------------------------------------------ centred ----


@settings(max_examples=40)
@given(
    st.sampled_from([Mounting(), TILTED]),
    st.floats(1.8, 3.5),
    st.floats(-0.15, 0.15),
    st.floats(-0.4, 0.4),
)  # fmt: skip
def test_centring_moves_to_the_surface(make_head, rectangle, mounting, distance, across, more_px):
    head = make_head(**SIZE, mounting=mounting)
    disparity = head.disparity(front(rectangle, mounting, mounting.yaw, distance))
    inverse = SCALE / distance
    patches = PatchSampler(head.camera()).centred(
        disparity, np.array([mounting.yaw + across / distance]), np.array([inverse + more_px])
    )
    assert patches.bearing == pytest.approx([mounting.yaw], abs=0.025 / distance)
    assert patches.inverse_range == pytest.approx([inverse], abs=0.04)
    again = PatchSampler(head.camera())(disparity, patches.bearing, patches.inverse_range)
    np.testing.assert_array_equal(patches.difference, again.difference)


def test_centring_is_bounded(make_head):
    head = make_head(fx=100.0, fy=100.0)
    sampler = PatchSampler(head.camera())
    disparity = nowhere(head)
    disparity[:, :65] = 12.0  # 0.15 m to the left of a place 1 m away, and on
    patches = sampler.centred(disparity, np.zeros(1), np.array([10.0]))
    # Twice 0.12 m, the second time at 10.6 px, and twice 0.6 px.
    assert patches.bearing == pytest.approx([0.12 + 0.12 * 1.06], abs=1e-6)
    assert patches.inverse_range == pytest.approx([10.6 + 0.6 * math.cos(0.12)], abs=1e-4)


def test_centring_without_samples_does_not_move(make_head):
    head = make_head()
    bearing, inverse = np.array([0.1, -0.2]), np.array([5.0, 3.0])
    patches = PatchSampler(head.camera()).centred(nowhere(head), bearing, inverse)
    np.testing.assert_array_equal(patches.bearing, bearing)
    np.testing.assert_array_equal(patches.inverse_range, inverse)
    assert np.isnan(patches.difference).all()


def test_no_candidates_give_no_patches(make_head):
    head = make_head()
    patches = PatchSampler(head.camera()).centred(nowhere(head), np.empty(0), np.empty(0))
    assert len(patches) == 0
    assert patches.difference.shape == patches.u.shape == (0, *SHAPE)
    assert patches.tolerance.shape == (0,)


def test_candidates_are_independent(make_head, rectangle):
    head = make_head(**SIZE)
    disparity = head.disparity(front(rectangle, Mounting(), 0.1, 2.0))
    bearing, inverse = np.array([0.12, -0.1, 0.05]), SCALE / np.array([2.0, 3.0, 2.1])
    sampler = PatchSampler(head.camera())
    together = sampler.centred(disparity, bearing, inverse)
    for k in range(3):
        alone = sampler.centred(disparity, bearing[k : k + 1], inverse[k : k + 1])
        for name, values in vars(alone).items():
            np.testing.assert_allclose(getattr(together, name)[k], values[0], atol=2e-4)


# ---------------------------------------------------------------------------- quantiles ----


@given(st.data(), st.integers(1, 4), st.integers(1, 12))
def test_quantiles_equal_numpys(data, rows, columns):
    values = data.draw(hnp.arrays(np.float32, (rows, columns), elements=st.floats(-9, 9, width=32)))
    chosen = data.draw(hnp.arrays(bool, (rows, columns)))
    values[~chosen] = np.nan
    shares = (0.0, 0.1, 0.25, 0.5, 0.9, 1.0)
    got = quantiles(values, chosen, shares)
    assert got.shape == (rows, len(shares))
    for row in range(rows):
        mine = values[row, chosen[row]].astype(float)
        want = np.quantile(mine, shares) if len(mine) else np.zeros(len(shares))
        np.testing.assert_allclose(got[row], want, atol=1e-6)


def test_quantiles_of_no_rows_are_empty():
    nothing = np.empty((0, 5), dtype=np.float32)
    assert quantiles(nothing, nothing > 0, (0.5, 0.9)).shape == (0, 2)


def test_samples_of_each_patch_become_a_row():
    values = np.arange(12).reshape(2, 3, 2)
    np.testing.assert_array_equal(in_rows(values), [range(6), range(6, 12)])
    assert in_rows(np.empty((0, 3, 2))).shape == (0, 6)


@pytest.mark.parametrize("px", [0.0, 0.3])
def test_far_candidates_stay_at_finite_range(make_head, px):
    """Samples with zero or little disparity move a far position away, but never past infinity."""
    head = make_head()
    seen = np.full((120, 160), px, dtype=np.float32)
    patches = PatchSampler(head.camera()).centred(seen, np.array([0.0]), np.array([0.35]))
    assert 0.0 < patches.inverse_range[0] <= 0.35
    assert np.isfinite(patches.u).all()

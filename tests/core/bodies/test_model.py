import copy
import dataclasses
import json
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.bodies.model import (
    DEPTH,
    EVEN,
    ODD,
    BodyModel,
    Evidence,
    Layered,
    Linear,
    Scaled,
    fitted,
    gather_evidence,
)
from mrs_people_loc.bodies.patches import ACROSS, HEIGHTS, Patches
from mrs_people_loc.bodies.votes import Vote
from mrs_people_loc.errors import ConfigError

SHAPE = (len(HEIGHTS), len(ACROSS))
SCALE = 10.0  # focal length times baseline [px m]
PARTS = ("human", "across", "depth", "across_log_sigma", "depth_log_sigma")


def patches_of(difference, *, inside=None, inverse_range=5.0, tolerance=0.5) -> Patches:
    """Patches with these differences [px], shape (n, heights, across)."""
    difference = np.array(difference, dtype=np.float32).reshape(-1, *SHAPE)
    n = len(difference)
    inside = np.ones(difference.shape, dtype=bool) if inside is None else inside
    difference[~inside] = np.nan
    return Patches(
        bearing=np.zeros(n),
        inverse_range=np.full(n, inverse_range),
        u=np.zeros_like(difference),
        v=np.zeros_like(difference),
        expected=np.full_like(difference, inverse_range),
        difference=difference,
        inside=inside,
        tolerance=np.full(n, tolerance),
    )


def evidence_of(
    patches: Patches,
    extent=1.0,
    shift=0.0,
    shift_sigma=0.0,
    contrast=None,
    scale=SCALE,
    focal=100.0,
) -> Evidence:
    n = len(patches)
    contrast = Vote.nothing(n).contrast if contrast is None else contrast
    vote = Vote(np.full(n, shift), np.full(n, shift_sigma), contrast)
    return gather_evidence(patches, np.full(n, extent), vote, depth_disparity=scale, focal=focal)


def random_patches(seed: int, n: int = 3) -> Patches:
    """A body of random shape before and behind random things, partly not seen or not in view."""
    rng = np.random.default_rng(seed)
    difference = rng.normal(0.0, rng.uniform(0.2, 2.0), (n, *SHAPE))
    difference[rng.uniform(size=difference.shape) < rng.uniform(0, 0.6)] = np.nan
    inside = np.ones(difference.shape, dtype=bool)
    inside[:, : rng.integers(0, 8)] = False
    inside[:, :, : rng.integers(0, 8)] = False
    return patches_of(difference, inside=inside, inverse_range=rng.uniform(2.0, 12.0))


def mirrored(patches: Patches) -> Patches:
    return dataclasses.replace(
        patches,
        difference=patches.difference[:, :, ::-1].copy(),
        inside=patches.inside[:, :, ::-1].copy(),
    )


# ----------------------------------------------------------------------------- evidence ----


@given(st.integers(0, 10**6))
def test_mirroring_keeps_even_evidence_and_negates_odd_evidence(seed):
    patches = random_patches(seed)
    contrast = np.random.default_rng(seed).uniform(-1, 1, (len(patches), *SHAPE))
    seen = evidence_of(patches, 1.1, 0.2, 0.04, contrast.astype(np.float32))
    other = evidence_of(mirrored(patches), 1.1, 0.2, 0.04, contrast[:, :, ::-1].astype(np.float32))
    np.testing.assert_allclose(other.even, seen.even, atol=1e-5)
    np.testing.assert_allclose(other.odd, -seen.odd, atol=1e-5)
    np.testing.assert_allclose(other.depth, seen.depth, atol=1e-5)
    assert np.abs(seen.odd).max() > 0.01


@given(st.integers(0, 10**6))
def test_patches_are_evaluated_independently(seed):
    patches = random_patches(seed, 4)
    together = evidence_of(patches)
    alone = evidence_of(Patches(**{name: value[2:3] for name, value in vars(patches).items()}))
    for name in ("even", "odd", "depth"):
        np.testing.assert_allclose(
            getattr(together, name)[2], getattr(alone, name)[0], rtol=1e-4, atol=1e-5
        )


@pytest.mark.parametrize("n", [0, 1, 3])
@pytest.mark.parametrize("value", [0.0, np.nan, -9.0, 1e4])
def test_evidence_is_finite_and_has_the_stated_width(n, value):
    evidence = evidence_of(patches_of(np.full((n, *SHAPE), value)))
    for name, width in (("even", EVEN), ("odd", ODD), ("depth", DEPTH)):
        values = getattr(evidence, name)
        assert values.shape == (n, width)
        assert values.dtype == np.float64
        assert np.isfinite(values).all()


def test_patches_are_not_modified():
    patches = random_patches(4)
    before = copy.deepcopy(patches)
    evidence_of(patches)
    for name, value in vars(before).items():
        np.testing.assert_array_equal(getattr(patches, name), value)


def test_shares_match_hand_computed_values():
    # 0.28 m to either side is a body up to 1.5 m, the rest is 4 tolerances behind it.
    difference = np.full(SHAPE, -2.0)
    body = (np.abs(ACROSS) < 0.29) & (HEIGHTS < 1.5)[:, np.newaxis]
    difference[body] = 0.0
    even = evidence_of(patches_of(difference)).even[0]
    # Seven bands of height by four stripes, the trunk first; then the lesser side of the two
    # stripes beside the body.
    sizes = (28, 14) * 4
    same, same_beside, behind, behind_beside, front, _, depth, _ = np.split(
        even[: sum(sizes)], np.cumsum(sizes)[:-1]
    )
    of_body = np.zeros((7, 4))
    of_body[:4, :2] = 1.0
    np.testing.assert_allclose(same.reshape(7, 4), of_body, atol=1e-6)
    np.testing.assert_allclose(behind.reshape(7, 4), 1 - of_body, atol=1e-6)
    np.testing.assert_allclose(depth.reshape(7, 4), -2 * (1 - of_body), atol=1e-6)
    np.testing.assert_array_equal(same_beside, 0)
    np.testing.assert_allclose(behind_beside, 1, atol=1e-6)
    np.testing.assert_array_equal(front, 0)


@pytest.mark.parametrize(
    ("relative", "same", "behind", "front"),
    [
        (0.0, 1.0, 0.0, 0.0),
        (0.9, 1.0, 0.0, 0.0),
        (1.25, 0.75, 0.0, 0.25),
        (-1.5, 0.5, 0.5, 0.0),
        (2.0, 0.0, 0.0, 1.0),
        (-7.0, 0.0, 1.0, 0.0),
        (np.nan, 0.0, 0.0, 0.0),
    ],
)
def test_classes_have_soft_boundaries(relative, same, behind, front):
    even = evidence_of(patches_of(np.full(SHAPE, relative * 0.5))).even[0]
    got = [even[start] for start in (0, 42, 84)]
    assert got == pytest.approx([same, behind, front], abs=1e-6)


def test_scalars_match_hand_computed_values():
    # 5 px are 2 m; a pixel more or less is 0.4 m. Half of the body 0.1 px nearer, half farther.
    difference = np.full(SHAPE, 0.1)
    difference[::2] = -0.1
    even = evidence_of(patches_of(difference), extent=1.3).even[0]
    assert even[-11:-5] == pytest.approx([2.0, 0.5, 1.3, 0.5 * 0.4, 0.1 * 0.4, 0.0], abs=1e-3)
    # A body's 0.3 px, and 0.06 m, which are 0.15 px; 0.06 m across, and a pixel of 2 / 100 m.
    sizes = [math.log(math.hypot(0.3, 0.15)), math.log(math.hypot(0.06, 0.02))]
    assert even[-5:-3] == pytest.approx(sizes)
    np.testing.assert_array_equal(even[-3:], 0.0)  # no farther than 2 m
    farther = evidence_of(patches_of(difference), scale=17.5).even[0]  # 3.5 m
    assert farther[-3:] == pytest.approx([1.5, 0.5, 0.0])


def test_centroids_and_slope_match_hand_computed_values():
    # A plane, 0.5 px nearer per metre to the left; from 1.6 m only its left half is there.
    difference = np.broadcast_to(0.5 * ACROSS, SHAPE).astype(np.float64).copy()
    difference[np.ix_(HEIGHTS > 1.59, ACROSS < -0.01)] = np.nan
    odd = evidence_of(patches_of(difference)).odd[0]
    left = ACROSS[(ACROSS > -0.01) & (ACROSS < 0.33)].mean()
    assert odd[:4] == pytest.approx([0, 0, 0, 0], abs=1e-6)  # slices up to 1.55 m
    assert odd[5] == pytest.approx(left, abs=1e-5)  # from 1.6 m
    assert 0 < odd[4] < left
    moment = np.mean(ACROSS[np.abs(ACROSS) < 0.33] ** 2)
    # A little less than the true slope, for what a narrow body says of it is noise.
    assert odd[6] == pytest.approx(0.5 * 0.4 * moment / (moment + 1e-3), rel=0.03)


def test_depth_matches_hand_computed_values():
    difference = np.full(SHAPE, 0.3)
    difference[HEIGHTS > 1.0] = 0.2
    difference[:, np.abs(ACROSS) > 0.4] = -4.0
    depth = evidence_of(patches_of(difference), shift=0.25, shift_sigma=0.7).depth[0]
    rows = (HEIGHTS > 0.31) & (HEIGHTS < 1.95)
    mean = np.where(HEIGHTS > 1.0, 0.2, 0.3)[rows].mean()
    # Quantiles, mean, that of the upper body, the vote, its sigma (at most 0.5).
    direct = [0.2, 0.2, 0.2, 0.3, 0.3, mean, 0.2, 0.25, 0.5]
    worth = math.sqrt(2.5)  # a metre of depth is 2.5 px
    assert depth[:9] == pytest.approx(direct, abs=1e-5)
    assert depth[9:18] == pytest.approx(np.array(direct) / worth, abs=1e-5)
    assert depth[18:27] == pytest.approx(np.array(direct) * worth, abs=1e-5)
    assert depth[27:] == pytest.approx([worth, 2.5, 1 / worth])


@given(st.integers(0, 10**6), st.floats(0.5, 2.5))
def test_heads_to_which_a_metre_of_depth_is_the_same_pixels_see_the_same_depth(seed, farther):
    patches = random_patches(seed)
    # So much farther away, by a head of the square of that: range over inverse range is the same.
    away = dataclasses.replace(patches, inverse_range=patches.inverse_range * farther)
    seen = evidence_of(patches, 1.1, 0.2, 0.04, focal=100.0)
    other = evidence_of(away, 1.1, 0.2, 0.04, scale=SCALE * farther**2, focal=100.0 * farther)
    np.testing.assert_allclose(other.depth, seen.depth, rtol=1e-9)
    np.testing.assert_allclose(other.odd, seen.odd, rtol=1e-6, atol=1e-9)
    # All but the range itself.
    np.testing.assert_allclose(other.even[:, :-11], seen.even[:, :-11])
    np.testing.assert_allclose(other.even[:, -9:-3], seen.even[:, -9:-3], rtol=1e-6)


# ------------------------------------------------------------------------------- models ----


def test_linear_part_matches_hand_computed_values():
    part = Linear(Scaled(np.array([1.0, 0.0]), np.array([2.0, 0.5])), np.array([3.0, -1.0]), 0.25)
    # (5 - 1) / 2 = 2 and 1 / 0.5 = 2; then 99 and -99, cut at 4.
    values = np.array([(5.0, 1.0), (99.0, -99.0), (1.0, 0.0)])
    np.testing.assert_allclose(part(values), [3 * 2 - 2 + 0.25, 12 + 4 + 0.25, 0.25])
    assert part(np.empty((0, 2))).shape == (0,)


def test_layered_part_matches_hand_computed_values():
    part = Layered(
        Scaled(np.zeros(1), np.ones(1)),
        hidden=np.array([[1.0, -2.0]]),
        bias=np.array([0.5, 0.0]),
        output=np.array([2.0, 1.0]),
        offset=-1.0,
    )
    want = 2 * math.tanh(0.3 + 0.5) + math.tanh(-0.6) - 1
    np.testing.assert_allclose(part(np.array([[0.3]])), [want])


def random_model(seed: int) -> BodyModel:
    rng = np.random.default_rng(seed)

    def scaled(width: int) -> Scaled:
        return Scaled(rng.normal(size=width), rng.uniform(0.1, 2.0, width))

    def linear(width: int) -> Linear:
        return Linear(scaled(width), rng.normal(size=width), float(rng.normal()))

    hidden = int(rng.integers(1, 5))
    human = Layered(
        scaled(EVEN),
        rng.normal(size=(EVEN, hidden)),
        rng.normal(size=hidden),
        rng.normal(size=hidden),
        float(rng.normal()),
    )
    return BodyModel(
        human, linear(ODD), linear(DEPTH), linear(EVEN), linear(EVEN), fitted().appearance
    )


def answers(model: BodyModel, seed: int) -> list[np.ndarray]:
    rng = np.random.default_rng(seed)
    even, odd, depth = (rng.normal(size=(4, width)) for width in (EVEN, ODD, DEPTH))
    return [
        model.human(even),
        model.across(odd),
        model.depth(depth),
        model.across_log_sigma(even),
        model.depth_log_sigma(even),
    ]


@given(st.integers(0, 10**6))
def test_model_is_unchanged_by_saving_and_loading(seed):
    model = random_model(seed)
    text = json.dumps(model.to_mapping())
    read = BodyModel.from_mapping(json.loads(text))
    assert json.dumps(read.to_mapping()) == text
    for one, other in zip(answers(model, seed), answers(read, seed), strict=True):
        np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize("name", PARTS)
@pytest.mark.parametrize(
    ("change", "what"),
    [
        (lambda m, n: m.pop(n), "cannot be read"),
        (lambda m, n: m.update({n: [1.0]}), "cannot be read"),
        (lambda m, n: m[n].pop("scale"), "cannot be read"),
        (lambda m, n: m[n].pop("offset"), "cannot be read"),
        (lambda m, n: m[n].update(more=1.0), "cannot be read"),
        (lambda m, n: m[n].update(mean="a"), "cannot be read"),
        (lambda m, n: m[n].update(scale=[[1.0], [1.0, 2.0]]), "cannot be read"),
        (lambda m, n: m[n].update(offset=math.nan), "NaN or infinite"),
        (lambda m, n: m[n]["mean"].__setitem__(0, math.inf), "NaN or infinite"),
        (lambda m, n: m[n]["mean"].pop(), "takes .* numbers; wanted"),
        (lambda m, n: m[n]["scale"].append(1.0), "takes .* numbers; wanted"),
        (lambda m, n: m[n]["scale"].__setitem__(3, 0.0), "scale"),
        (lambda m, n: m[n]["hidden" if n == "human" else "weights"].pop(), "wanted"),
    ],
)
def test_a_bad_model_is_refused(name, change, what):
    mapping = random_model(0).to_mapping()
    change(mapping, name)
    with pytest.raises(ConfigError, match=rf"body model: {name} .*{what}"):
        BodyModel.from_mapping(mapping)


@pytest.mark.parametrize("key", ["bias", "output"])
def test_a_layer_that_does_not_fit_is_refused(key):
    mapping = random_model(0).to_mapping()
    mapping["human"][key].append(1.0)
    with pytest.raises(ConfigError, match="body model: human .*wanted"):
        BodyModel.from_mapping(mapping)


@pytest.mark.parametrize("document", [[], "text", None, 3.0, {}])
def test_file_that_is_not_a_model_is_refused(document):
    with pytest.raises(ConfigError, match="body model: human cannot be read"):
        BodyModel.from_mapping(document)


def test_fitted_model_distinguishes_left_from_right():
    model = fitted()
    assert fitted() is model
    odd = np.random.default_rng(3).normal(size=(20, ODD))
    np.testing.assert_allclose(model.across(-odd), -model.across(odd), atol=1e-12)
    assert model.across(odd).std() > 0
    assert answers(BodyModel.from_mapping(model.to_mapping()), 1)[0] == pytest.approx(
        answers(model, 1)[0]
    )

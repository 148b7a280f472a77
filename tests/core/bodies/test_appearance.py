import dataclasses

import numpy as np
import pytest

from mrs_people_loc.bodies.appearance import (
    DETECTOR_VIEW,
    DETECTOR_WINDOW,
    Appearance,
    AppearanceModel,
    Looks,
    Scores,
    block_score,
    detector_blocks,
    detector_score,
    detector_weights,
)
from mrs_people_loc.bodies.gradients import BLOCK, Histograms
from mrs_people_loc.bodies.model import fitted
from mrs_people_loc.bodies.network import PersonNetwork
from mrs_people_loc.errors import ConfigError

NOISE = np.random.default_rng(3).integers(0, 256, (120, 160), dtype=np.uint8)


def model_of(**changes) -> AppearanceModel:
    """A model in which nothing counts, but for the changes."""
    nothing = AppearanceModel(
        human=0.0,
        above=0.0,
        detector=0.0,
        network=0.0,
        offset=0.0,
        detector_middle=np.zeros(DETECTOR_WINDOW.blocks),
    )
    return dataclasses.replace(nothing, **changes)


def scores(head, model, human, bearing=0.0, ranges=2.0, image=NOISE):
    human = np.array(human, dtype=float)
    at = np.full(len(human), bearing), np.full(len(human), ranges)
    return Appearance(head.camera())(model, image, *at, human)


def test_human_test_counts_within_limits(make_head):
    model = model_of(human=0.5, above=1.5, offset=-1.0)
    found = scores(make_head(), model, [-6.0, -3.0, -2.0, 0.0, 4.0, 6.0])
    np.testing.assert_allclose(found, [-2.0, -2.0, -2.0, -1.0, 1.0, 4.0])


def test_what_the_human_test_rules_out_is_not_looked_at(make_head):
    found = scores(make_head(), model_of(offset=9.0), [-8.1, -20.0, -7.9])
    np.testing.assert_allclose(found, [-8.1, -20.0, 9.0])


def test_weights_count_in_their_order():
    combined = Scores(np.array([5.0, -9.0]), np.full(2, 3.0), np.full(2, 2.0)).combined(
        model_of(human=1.0, above=10.0, detector=100.0, network=1000.0, offset=0.5).weights
    )
    np.testing.assert_allclose(combined, [4.0 + 10.0 + 300.0 + 2000.0 + 0.5, -9.0])


def test_network_and_detector_are_weighted(make_head):
    at = np.array([0.1]), np.array([2.0])
    own = PersonNetwork(make_head().camera())(NOISE, *at)
    seen = scores(make_head(), model_of(network=0.5), [0.0], bearing=0.1)
    assert seen == pytest.approx(0.5 * own)
    assert abs(own) > 0.1
    detector = scores(make_head(), model_of(detector=1.0), [0.0])
    assert abs(detector) > 0.1
    assert scores(make_head(), model_of(detector=-2.0), [0.0]) == pytest.approx(-2.0 * detector)


def test_what_is_not_in_the_image_says_nothing(make_head):
    model = model_of(detector=1.0)
    assert scores(make_head(), model, [0.0], bearing=1.5) == 0.0
    network = [
        scores(make_head(), model_of(network=1.0), [0.0], bearing=1.5, image=image)
        for image in (NOISE, 255 - NOISE)
    ]
    assert network[0] == pytest.approx(network[1])


def test_block_scores_match_hand_computed_values():
    detector = np.array([[1.0, 2.0, 3.0, 4.0]] * 2, dtype=np.float32)
    inside = np.array([[True] * 4, [True, False, False, False]])
    score = block_score(detector, inside, np.array([0.5, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(score, [9.5, 0.5 / np.sqrt(0.25)])


def looks_of(values, inside=True):
    inside = np.full(values.shape[:2], inside)
    return Looks(*detector_blocks(Histograms(values, inside)), np.zeros(len(values)))


@pytest.mark.parametrize("cells", [0, 1, 2])
def test_people_detector_finds_its_pattern_up_to_a_cell_aside(cells):
    weights = detector_weights()[:-1].reshape(-1, BLOCK)
    values = np.zeros((1, DETECTOR_VIEW.blocks, BLOCK), dtype=np.float32)
    values[0, 15 * cells : 15 * cells + DETECTOR_WINDOW.blocks] = weights  # 15 blocks a column
    middle = np.full(DETECTOR_WINDOW.blocks, 0.01)
    wanted = (weights.astype(np.float64) ** 2).sum() - middle.sum()
    looks = looks_of(values)
    assert looks.detector.shape == (1, 3, DETECTOR_WINDOW.blocks)
    np.testing.assert_allclose(detector_score(looks, middle), [wanted], rtol=1e-5)
    np.testing.assert_allclose(looks.detector[0, cells], (weights**2).sum(axis=1), rtol=1e-5)


def test_best_window_is_that_of_the_place():
    detector = np.zeros((2, 3, DETECTOR_WINDOW.blocks), dtype=np.float32)
    detector[0, 2, 7], detector[1, 0, 7] = 3.0, 4.0
    looks = Looks(detector, np.ones(detector.shape, dtype=bool), np.zeros(2))
    np.testing.assert_allclose(detector_score(looks, np.zeros(detector.shape[2])), [3.0, 4.0])


def test_nobody_has_no_score(make_head):
    assert scores(make_head(), fitted().appearance, []).shape == (0,)


def test_model_is_read_as_it_is_written():
    model = fitted().appearance
    read = AppearanceModel.from_mapping(model.to_mapping())
    for name, value in vars(model).items():
        np.testing.assert_array_equal(getattr(read, name), value)


@pytest.mark.parametrize(
    ("name", "value", "match"),
    [
        ("offset", None, "appearance cannot be read"),
        ("human", "much", "appearance cannot be read"),
        ("detector", float("nan"), "appearance holds NaN"),
        ("network", [1.0], r"network of shape \(1,\); wanted: \(\)"),
        ("detector_middle", [1.0], r"detector_middle of shape \(1,\); wanted: \(105,\)"),
    ],
)
def test_wrong_model_is_refused(name, value, match):
    mapping = fitted().appearance.to_mapping()
    if value is None:
        del mapping[name]
    else:
        mapping[name] = value
    with pytest.raises(ConfigError, match=match):
        AppearanceModel.from_mapping(mapping)

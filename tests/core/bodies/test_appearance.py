import dataclasses

import numpy as np
import pytest

from mrs_people_loc.bodies.appearance import (
    DETECTOR_VIEW,
    DETECTOR_WINDOW,
    Appearance,
    AppearanceModel,
    block_score,
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
    found = scores(make_head(), model_of(offset=9.0), [-6.1, -20.0, -5.9])
    np.testing.assert_allclose(found, [-6.1, -20.0, 9.0])


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
    values = np.zeros((2, 4, BLOCK), dtype=np.float32)
    values[:, :, 0] = 1.0
    weights = np.zeros((4, BLOCK))
    weights[:, 0] = [1.0, 2.0, 3.0, 4.0]
    inside = np.array([[True] * 4, [True, False, False, False]])
    score = block_score(Histograms(values, inside), weights, np.array([0.5, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(score, [9.5, 0.5 / np.sqrt(0.25)])


@pytest.mark.parametrize("cells", [0, 1, 2])
def test_people_detector_finds_its_pattern_up_to_a_cell_aside(cells):
    weights = detector_weights()[:-1].reshape(-1, BLOCK)
    values = np.zeros((1, DETECTOR_VIEW.blocks, BLOCK), dtype=np.float32)
    values[0, 15 * cells : 15 * cells + DETECTOR_WINDOW.blocks] = weights  # 15 blocks a column
    inside = np.ones((1, DETECTOR_VIEW.blocks), dtype=bool)
    middle = np.full(DETECTOR_WINDOW.blocks, 0.01)
    wanted = (weights.astype(np.float64) ** 2).sum() - middle.sum()
    score = detector_score(Histograms(values, inside), middle)
    np.testing.assert_allclose(score, [wanted], rtol=1e-5)


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

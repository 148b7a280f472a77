import dataclasses

import numpy as np
import pytest

from mrs_people_loc.bodies.appearance import (
    DETECTOR_WINDOW,
    FITTED_WINDOW,
    Appearance,
    AppearanceModel,
    block_score,
)
from mrs_people_loc.bodies.gradients import BLOCK, Histograms
from mrs_people_loc.bodies.model import fitted
from mrs_people_loc.errors import ConfigError

NOISE = np.random.default_rng(3).integers(0, 256, (120, 160), dtype=np.uint8)


def model_of(**changes) -> AppearanceModel:
    """A model in which nothing counts, but for the changes."""
    nothing = AppearanceModel(
        human=0.0,
        above=0.0,
        detector=0.0,
        fitted=0.0,
        offset=0.0,
        detector_middle=np.zeros(DETECTOR_WINDOW.blocks),
        fitted_middle=np.zeros(FITTED_WINDOW.blocks),
        fitted_weights=np.zeros((FITTED_WINDOW.blocks, BLOCK)),
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


def test_classifiers_are_weighted(make_head):
    middle = np.full(FITTED_WINDOW.blocks, -1.0)
    one = scores(make_head(), model_of(fitted=1.0, fitted_middle=middle), [0.0])
    assert one == pytest.approx(FITTED_WINDOW.blocks)  # all of it is in the image
    assert scores(make_head(), model_of(fitted=0.5, fitted_middle=middle), [0.0]) == 0.5 * one
    detector = scores(make_head(), model_of(detector=1.0), [0.0])
    assert abs(detector) > 0.1
    assert scores(make_head(), model_of(detector=-2.0), [0.0]) == pytest.approx(-2.0 * detector)


def test_what_is_not_in_the_image_says_nothing(make_head):
    model = model_of(detector=1.0, fitted=1.0, fitted_middle=np.ones(FITTED_WINDOW.blocks))
    assert scores(make_head(), model, [0.0], bearing=1.5) == 0.0


def test_block_scores_match_hand_computed_values():
    values = np.zeros((2, 4, BLOCK), dtype=np.float32)
    values[:, :, 0] = 1.0
    weights = np.zeros((4, BLOCK))
    weights[:, 0] = [1.0, 2.0, 3.0, 4.0]
    inside = np.array([[True] * 4, [True, False, False, False]])
    score = block_score(Histograms(values, inside), weights, np.array([0.5, 0.0, 0.0, 0.0]))
    np.testing.assert_allclose(score, [9.5, 0.5 / np.sqrt(0.25)])


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
        ("fitted", [1.0], r"fitted of shape \(1,\); wanted: \(\)"),
        ("detector_middle", [1.0], r"detector_middle of shape \(1,\); wanted: \(105,\)"),
        ("fitted_weights", [[1.0]], r"fitted_weights of shape \(1, 1\); wanted: \(21, 36\)"),
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

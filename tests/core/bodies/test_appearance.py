import dataclasses

import numpy as np
import pytest

from mrs_people_loc.bodies.appearance import AppearanceModel, Scores
from mrs_people_loc.bodies.model import fitted
from mrs_people_loc.errors import ConfigError


def combined(log_odds, by_network=0.0, **weights):
    """What a model says in which nothing counts but the given weights."""
    model = AppearanceModel(human=0.0, above=0.0, network=0.0, offset=0.0)
    scores = Scores(np.array(log_odds, dtype=float), np.full(len(log_odds), by_network))
    return scores.combined(dataclasses.replace(model, **weights).weights)


def test_human_test_counts_within_limits():
    found = combined([-6.0, -3.0, -2.0, 0.0, 4.0, 6.0], human=0.5, above=1.5, offset=-1.0)
    np.testing.assert_allclose(found, [-2.5, -2.5, -2.0, -1.0, 1.0, 4.0])


def test_what_the_human_test_rules_out_keeps_its_log_odds():
    np.testing.assert_allclose(combined([-8.1, -20.0, -7.9], offset=9.0), [-8.1, -20.0, 9.0])


def test_weights_count_in_their_order():
    weights = {"human": 1.0, "above": 2.0, "network": 3.0, "offset": 0.5}
    np.testing.assert_allclose(combined([5.0], 7.0, **weights), 4.0 + 2.0 + 21.0 + 0.5)


def test_network_says_nothing_against_what_has_a_persons_shape_beyond_doubt():
    found = combined([-3.0, 4.0, 4.25, 4.5, 5.0, 9.0], by_network=-2.0, network=1.0)
    np.testing.assert_allclose(found, [-2.0, -2.0, -1.5, -1.0, 0.0, 0.0])
    found = combined([-3.0, 4.0, 5.0, 9.0], by_network=2.0, network=1.0)
    np.testing.assert_allclose(found, 2.0)


def test_nobody_has_no_score():
    assert combined([]).shape == (0,)


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
        ("above", float("nan"), "appearance holds NaN"),
        ("human", [1.0], "appearance cannot be read"),
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

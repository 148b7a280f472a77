import dataclasses

import numpy as np
import pytest

from mrs_people_loc.bodies.appearance import Appearance, AppearanceModel, Looks, Scores
from mrs_people_loc.bodies.model import fitted
from mrs_people_loc.bodies.network import PersonNetwork
from mrs_people_loc.bodies.patches import PatchSampler
from mrs_people_loc.bodies.person_map import PersonMap
from mrs_people_loc.errors import ConfigError


def combined(log_odds, of_window=0.0, of_image=0.0, **weights):
    """What a model says in which nothing counts but the given weights."""
    model = AppearanceModel(human=0.0, above=0.0, window=0.0, image=0.0, offset=0.0)
    count = len(log_odds)
    looks = Looks(np.full(count, of_window), np.full(count, of_image))
    scores = Scores(np.array(log_odds, dtype=float), looks)
    return scores.combined(dataclasses.replace(model, **weights).weights)


def test_human_test_counts_within_limits():
    found = combined([-6.0, -3.0, -2.0, 0.0, 4.0, 6.0], human=0.5, above=1.5, offset=-1.0)
    np.testing.assert_allclose(found, [-2.0, -2.0, -2.0, -1.0, 1.0, 4.0])


def test_what_the_human_test_rules_out_keeps_its_log_odds():
    np.testing.assert_allclose(combined([-8.1, -20.0, -7.9], offset=9.0), [-8.1, -20.0, 9.0])


def test_weights_count_in_their_order():
    weights = {"human": 1.0, "above": 2.0, "window": 3.0, "image": 10.0, "offset": 0.5}
    np.testing.assert_allclose(combined([5.0], 7.0, -0.2, **weights), 4.0 + 2.0 + 21.0 - 1.0 + 0.5)


def test_map_speaks_against_people_only():
    np.testing.assert_allclose(combined([0.0, 0.0], of_image=3.0, image=1.0), 0.0)
    np.testing.assert_allclose(combined([0.0, 0.0], of_image=-3.0, image=1.0), -3.0)


def test_map_says_nothing_of_what_has_a_persons_shape_beyond_doubt():
    found = combined([-3.0, 4.0, 4.5, 5.0, 6.0, 9.0], of_image=-2.0, image=1.0)
    np.testing.assert_allclose(found, [-2.0, -2.0, -1.5, -1.0, 0.0, 0.0])


def test_nobody_has_no_score():
    assert combined([]).shape == (0,)


def test_both_networks_see_the_same_bodies(make_head):
    camera = make_head().camera()
    image = np.random.default_rng(3).integers(0, 256, (120, 160), dtype=np.uint8)
    bearing, ranges = np.array([0.1, -0.2]), np.array([2.0, 3.0])
    nothing = np.full(image.shape, np.nan, np.float32)
    patches = PatchSampler(camera)(nothing, bearing, camera.depth_disparity / ranges)
    looks = Appearance(camera)(image, bearing, ranges, patches)
    np.testing.assert_array_equal(looks.window, PersonNetwork(camera)(image, bearing, ranges))
    np.testing.assert_array_equal(looks.image, PersonMap(camera)(image, patches))


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

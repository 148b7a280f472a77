"""Covariances of robots' poses relative to their team."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.localization.filter.team_frame import covariance_in_team


def team(*xy: tuple[float, float]) -> np.ndarray:
    return np.array([(x, y, 0.1 * k) for k, (x, y) in enumerate(xy)])


def random_covariance(seed: int, size: int) -> np.ndarray:
    root = np.random.default_rng(seed).normal(size=(size, size))
    return root @ root.T / size


def test_robot_alone_is_sure_of_its_place_in_its_team():
    assert covariance_in_team(team((3.0, 4.0)), random_covariance(1, 3), 0) == pytest.approx(
        np.zeros((3, 3)), abs=1e-12
    )


def test_half_of_one_robots_error_along_the_line_of_two_is_each_ones():
    """The team's middle is off by half of what one robot is off; two of two have all of it."""
    covariance = np.zeros((6, 6))
    covariance[0, 0] = 4.0
    for index in (0, 1):
        expected = np.diag([2.0, 0.0, 0.0])
        made = covariance_in_team(team((-1.0, 5.0), (1.0, 5.0)), covariance, index)
        assert made == pytest.approx(expected, abs=1e-12)


def rigid_errors(places: np.ndarray, motion: np.ndarray) -> np.ndarray:
    """How the covariance of one motion of the whole team, about the origin, shows in its poses."""
    effect = np.zeros((len(places), 3, 3))
    effect[:] = np.eye(3)
    effect[:, 0, 2], effect[:, 1, 2] = -places[:, 1], places[:, 0]
    stacked = effect.reshape(-1, 3)
    return stacked @ motion @ stacked.T


@given(st.integers(0, 1000), st.integers(1, 5))
def test_errors_of_the_whole_team_are_not_in_it(seed, count):
    rng = np.random.default_rng(seed)
    places = rng.uniform(-5.0, 5.0, (count, 3))
    own = random_covariance(seed, 3 * count)
    shared = rigid_errors(places, 10.0 * random_covariance(seed + 1, 3))
    for index in range(count):
        made = covariance_in_team(places, own + shared, index)
        assert made == pytest.approx(covariance_in_team(places, own, index), abs=1e-8)


@given(st.integers(0, 1000), st.integers(2, 5))
def test_it_is_a_covariance(seed, count):
    places = np.random.default_rng(seed).uniform(-5.0, 5.0, (count, 3))
    made = covariance_in_team(places, random_covariance(seed, 3 * count), count - 1)
    assert np.array_equal(made, made.T)
    assert np.linalg.eigvalsh(made)[0] > -1e-9


def test_independent_errors_of_two_robots_add_to_that_of_their_difference():
    covariance = np.diag([0.01, 0.01, 0.0] * 2)
    places = team((-2.0, 0.0), (2.0, 0.0))
    one, other = (covariance_in_team(places, covariance, k) for k in (0, 1))
    assert one[0, 0] + other[0, 0] == pytest.approx(0.02)

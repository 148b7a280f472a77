"""Negative evidence, by values that are worked out by hand, and its limits."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.following.negative_evidence import not_found


def somebody(seed: int):
    """States and covariances of three people."""
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(3, 4, 4))
    return rng.normal(size=(3, 4)), root @ root.transpose(0, 2, 1) + 1e-3 * np.eye(4)


def test_place_and_velocity_match_hand_computed_values():
    """At x + sqrt(3) m, a sixth of the distribution, they would be found in 6 of 10 cases."""
    state = np.array([[2.0, 5.0, 0.0, 0.0]])
    covariance = np.eye(4)[np.newaxis]
    covariance[0, 0, 2] = covariance[0, 2, 0] = 0.5
    after, updated, share = not_found(state, covariance, 0.4, lambda at: at[..., 0] > 2.1)
    assert share == pytest.approx([1.0 / 6.0])
    # Weights 1/6, 4/6 and 0.4/6, in sum 0.9.
    moved = math.sqrt(3.0) * (0.4 - 1.0) / 6.0 / 0.9
    variance = 3.0 * (1.4 / 6.0) / 0.9 - moved**2
    np.testing.assert_allclose(after, [[2.0 + moved, 5.0, 0.5 * moved, 0.0]], atol=1e-12)
    expected = np.diag([variance, 1.0, 1.0 - 0.25 * (1.0 - variance), 1.0])
    expected[0, 2] = expected[2, 0] = 0.5 * variance
    np.testing.assert_allclose(updated[0], expected, atol=1e-12)


@pytest.mark.parametrize("in_view", [False, True])
def test_view_of_nothing_or_everything_changes_no_place(in_view):
    state, covariance = somebody(1)
    after, updated, share = not_found(
        state, covariance, 0.3, lambda at: np.full(at.shape[:2], in_view)
    )
    np.testing.assert_allclose(after, state, atol=1e-9)
    np.testing.assert_allclose(updated, covariance, atol=1e-9)
    np.testing.assert_allclose(share, float(in_view))


@given(seed=st.integers(0, 1000), missed=st.floats(0.01, 1.0))
def test_covariances_stay_covariances(seed, missed):
    state, covariance = somebody(seed)
    rng = np.random.default_rng(seed)
    _, updated, share = not_found(
        state, covariance, missed, lambda at: rng.random(at.shape[:2]) < 0.5
    )
    np.testing.assert_allclose(updated, updated.transpose(0, 2, 1), atol=1e-9)
    assert np.linalg.eigvalsh(updated).min() > -1e-9
    assert ((share >= 0.0) & (share <= 1.0 + 1e-12)).all()


def test_known_place_stays():
    """A covariance without extent: there is no other place where they could be."""
    state = np.array([[1.0, 2.0, 0.3, 0.0]])
    after, updated, _ = not_found(
        state, np.zeros((1, 4, 4)), 0.1, lambda at: np.ones(at.shape[:2], dtype=bool)
    )
    np.testing.assert_allclose(after, state, atol=1e-4)
    np.testing.assert_allclose(updated, np.zeros((1, 4, 4)), atol=1e-8)

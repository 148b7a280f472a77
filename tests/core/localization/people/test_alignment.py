import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.localization.people.alignment import Places, align, fit

#: Standard deviations of 1 m, 1 m and 25 degrees.
WIDE = np.diag([1.0, 1.0, math.radians(25.0) ** 2])
#: Of 0.1 m, 0.1 m and 2 degrees.
NARROW = np.diag([0.01, 0.01, math.radians(2.0) ** 2])
PEOPLE = [(2.0, 0.0), (3.0, 1.5), (4.0, -1.0), (2.5, -2.0), (5.0, 0.5)]


def places(xy, sigma=0.05, sample=0):
    xy = np.array(xy, dtype=float).reshape(-1, 2)
    covariance = np.tile(sigma**2 * np.eye(2), (len(xy), 1, 1))
    return Places(xy, covariance, np.broadcast_to(sample, len(xy)).astype(np.intp))


# -------------------------------------------------------------------------------------- align ----


def test_move_and_turn_by_hand():
    """A turn with cosine 0.96 and sine 0.28 (16.26 degrees), then a move by (0.5, -0.2)."""
    own = places([(1.0, 0.0), (0.0, 1.0), (2.0, 2.0), (-1.0, 1.0)])
    others = places([(0.22, 0.76), (1.46, 0.08), (-0.74, 0.48), (1.86, 2.28)])
    found = align(own, others, WIDE)
    assert found is not None
    np.testing.assert_allclose(found.move, (0.5, -0.2), atol=0.01)
    assert found.turn == pytest.approx(math.asin(0.28), abs=0.01)
    assert dict(zip(found.own.tolist(), found.others.tolist(), strict=True)) == {
        0: 1, 1: 0, 2: 3, 3: 2,
    }  # fmt: skip
    assert found.evidence > 4.0
    assert found.margin > 4.0


def test_people_whom_only_one_sees_are_not_matched():
    own = places([*PEOPLE, (8.0, 3.0), (0.5, 4.0)])
    others = places([(9.0, -4.0), *(np.array(PEOPLE) + (0.6, -0.4)), (1.0, -5.0)])
    found = align(own, others, WIDE)
    assert found is not None
    assert found.own.tolist() == [0, 1, 2, 3, 4]
    assert found.others.tolist() == [1, 2, 3, 4, 5]
    np.testing.assert_allclose(found.move, (0.6, -0.4), atol=0.01)


def test_equally_good_moves_have_no_margin():
    """Three people in a row, seen halfway between: to the left, or to the right."""
    own = places([(3.0, -1.0), (3.0, 0.0), (3.0, 1.0), (3.0, 2.0)])
    others = places([(3.0, -0.5), (3.0, 0.5), (3.0, 1.5)])
    found = align(own, others, WIDE)
    assert found is not None
    assert abs(found.move[1]) == pytest.approx(0.5, abs=0.02)
    assert found.margin == pytest.approx(0.0, abs=0.01)


def test_pose_that_is_known_settles_which_of_two_moves():
    own = places([(3.0, -1.0), (3.0, 0.0), (3.0, 1.0)])
    others = places([(3.0, 0.1), (3.0, 1.1), (3.0, 2.1)])  # two are moved by 0.1, or all by 1.1
    wide, narrow = align(own, others, WIDE), align(own, others, NARROW)
    assert wide is not None
    assert narrow is not None
    assert wide.margin < 3.0
    assert len(wide.own) == 3
    assert (narrow.own.tolist(), narrow.others.tolist()) == ([1, 2], [0, 1])
    assert narrow.margin > 4.0


def test_two_people_are_not_turned_by_half_a_turn():
    found = align(places([(2.0, 1.0), (2.0, -1.0)]), places([(2.1, -1.0), (2.1, 1.0)]), WIDE)
    assert found is not None
    assert found.turn == pytest.approx(0.0, abs=0.01)
    assert found.others.tolist() == [1, 0]


def test_two_people_are_evidence_only_where_poses_are_known():
    two = [(2.0, 1.0), (3.0, -1.0)]
    narrow, wide = align(places(two), places(two), NARROW), align(places(two), places(two), WIDE)
    assert narrow is not None
    assert wide is not None
    assert narrow.evidence > 4.0 > wide.evidence


def test_one_person_is_evidence_where_nobody_else_is_seen_and_poses_are_known():
    one, near = places([(2.0, 1.0)]), places([(2.1, 0.95)])
    narrow, wide = align(one, near, NARROW), align(one, near, WIDE)
    assert narrow is not None
    assert wide is not None
    assert narrow.evidence > 3.0 > wide.evidence
    assert align(one, places([(4.0, 1.0)]), NARROW) is None
    assert align(one, places([(2.1, 0.95), (3.0, -1.0)]), NARROW) is None


def test_one_place_tells_nothing_about_the_turn():
    own, others = np.array([[2.0, 0.0]]), np.array([[2.3, 0.1]])
    covariance = np.array([np.diag([0.01, 0.0025])])
    state, unsure = fit(own, covariance, others, covariance, 0.0)
    np.testing.assert_allclose(state, (0.3, 0.1, 0.0), atol=1e-9)
    assert unsure[2, 2] == pytest.approx(1.0)
    # Where the place is brought to is as sure as both places are, whatever the turn.
    to_place = np.array([[1.0, 0.0, 0.0], [0.0, 1.0, 2.0]])
    np.testing.assert_allclose(to_place @ unsure @ to_place.T, 2.0 * covariance[0], atol=1e-9)


def test_priors_are_equally_likely():
    """Of two priors the mean likelihood counts: half of one where the other makes it impossible."""
    own, others = places(PEOPLE), places(np.array(PEOPLE) + (0.8, 0.0))
    alone, both = align(own, others, WIDE), align(own, others, NARROW, WIDE)
    assert alone is not None
    assert both is not None
    assert both.evidence == pytest.approx(alone.evidence - math.log(2.0), abs=1e-3)


def test_probability_of_the_wider_prior():
    own, others = places(PEOPLE), places(np.array(PEOPLE) + (0.8, 0.0))
    alone = align(own, others, WIDE)
    rarely = align(own, others, NARROW, WIDE, wider=0.1)
    assert alone is not None
    assert rarely is not None
    assert rarely.evidence == pytest.approx(alone.evidence - math.log(10.0), abs=1e-3)
    only = align(own, others, WIDE, wider=0.1)
    assert only is not None
    assert only.evidence == pytest.approx(alone.evidence)


@pytest.mark.parametrize(
    ("own", "others"),
    [
        ([], PEOPLE),
        (PEOPLE, []),
        (PEOPLE[:1], PEOPLE),
        (PEOPLE, [(90.0, 90.0), (91.0, 92.0)]),
        ([(2.0, 0.0), (2.0, 0.0)], [(2.0, 0.0)]),
    ],
)
def test_fewer_than_two_matches_give_nothing(own, others):
    assert align(places(own), places(others), WIDE) is None


def test_only_places_of_one_time_match():
    moved = np.array(PEOPLE) + (0.3, 0.0)
    assert align(places(PEOPLE, sample=0), places(moved, sample=1), WIDE) is None
    samples = [0, 0, 1, 1, 2]
    found = align(places(PEOPLE, sample=samples), places(moved, sample=samples), WIDE)
    assert found is not None
    assert found.own.tolist() == found.others.tolist() == [0, 1, 2, 3, 4]


@given(st.integers(0, 10_000), st.integers(4, 12))
def test_any_move_and_turn_is_found(seed, count):
    random = np.random.default_rng(seed)
    true = random.uniform((-1.0, -1.0, -0.4), (1.0, 1.0, 0.4))
    cells = random.permutation(36)[:count]
    own = np.stack([cells // 6, cells % 6], axis=1) * 1.5 + random.uniform(-0.4, 0.4, (count, 2))
    others = random.permutation(own @ rotation_2d(true[2]).T + true[:2])
    found = align(places(own, 0.03), places(others, 0.03), WIDE)
    assert found is not None
    if found.margin > 3.0:
        assert len(found.own) == count
        np.testing.assert_allclose([*found.move, found.turn], true, atol=0.02)


# ---------------------------------------------------------------------------------------- fit ----


def test_fit_of_two_people_by_hand():
    """At (1, 0) and (-1, 0), each with 0.02 m^2 from both sides together.

    The mean of two has half of that; the turn is half the difference across, over 1 m: likewise.
    """
    two = np.array([(1.0, 0.0), (-1.0, 0.0)])
    unsure = np.tile(0.01 * np.eye(2), (2, 1, 1))
    state, covariance = fit(two, unsure, two + (0.3, 0.4), unsure, 0.0)
    np.testing.assert_allclose(state, (0.3, 0.4, 0.0), atol=1e-12)
    np.testing.assert_allclose(covariance, np.diag([0.01, 0.01, 0.01]), atol=1e-12)


@given(st.integers(0, 10_000), st.integers(2, 8))
def test_fit_of_exact_places_is_exact(seed, count):
    random = np.random.default_rng(seed)
    true = random.uniform((-3.0, -3.0, -1.0), (3.0, 3.0, 1.0))
    own = random.uniform(-5.0, 5.0, (count, 2)) + 3.0 * np.arange(count)[:, np.newaxis]
    root = random.uniform(-0.2, 0.2, (2, count, 2, 2))
    unsure = root @ root.transpose(0, 1, 3, 2) + 0.01 * np.eye(2)
    others = own @ rotation_2d(true[2]).T + true[:2]
    state, covariance = fit(own, unsure[0], others, unsure[1], true[2] + 0.2)
    np.testing.assert_allclose(state, true, atol=1e-6)
    assert (np.linalg.eigvalsh(covariance) > 0).all()


def test_fit_is_as_unsure_as_it_says():
    """Normalized squared errors of 500 draws: 3 on average, +- 0.33 (3 standard errors)."""
    random = np.random.default_rng(1)
    own = np.array(PEOPLE)
    here = np.array([np.diag([0.01, 0.04])] * 5)
    there = np.array([[[0.02, 0.01], [0.01, 0.03]]] * 5)
    true = np.array([0.3, -0.2, 0.2])
    nees = []
    for _ in range(500):
        seen = own + random.multivariate_normal((0, 0), here[0], 5)
        others = own @ rotation_2d(true[2]).T + true[:2]
        others = others + random.multivariate_normal((0, 0), there[0], 5)
        state, covariance = fit(seen, here, others, there, 0.0)
        nees.append((state - true) @ np.linalg.solve(covariance, state - true))
    assert np.mean(nees) == pytest.approx(3.0, abs=0.33)

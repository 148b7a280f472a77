"""Scores that were worked out by hand."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_sim.scoring.positions import interval_of, match, score, summary
from mrs_tools.bags.records import Estimate, Truth

MS = 1_000_000
NOBODY = (math.nan, math.nan)


def estimate(stamp_ms, *positions, covariance=((0.01, 0.0), (0.0, 0.01)), centre=None) -> Estimate:
    xy = np.array(positions, dtype=float).reshape(-1, 2)
    return Estimate(
        stamp_ns=stamp_ms * MS,
        positions=xy,
        covariances=np.tile(np.array(covariance, dtype=float), (len(xy), 1, 1)),
        centre=None if centre is None else np.array(centre, dtype=float),
    )


def truth(rows, visible=None) -> Truth:
    """Rows: stamp in ms -> positions."""
    return Truth.build(
        [stamp * MS for stamp in rows],
        [np.array(row, dtype=float).reshape(-1, 2) for row in rows.values()],
        None if visible is None else [np.array(v, dtype=bool) for v in visible],
    )


# ------------------------------------------------------------------------------------- match


def test_match_prefers_more_pairs_to_nearer_ones():
    # The first found is nearest to the second true one, but then the second found has nobody.
    found = np.array([[0.0, 0.0], [0.5, 0.0]])
    true = np.array([[-0.3, 0.0], [0.2, 0.0]])
    one, other, away = match(found, true)
    assert one.tolist() == [0, 1]
    assert other.tolist() == [0, 1]
    np.testing.assert_allclose(away, [0.3, 0.3])


def test_match_minimizes_the_sum_of_distances():
    found = np.array([[0.0, 0.0], [0.2, 0.0]])
    true = np.array([[0.21, 0.0], [0.05, 0.0]])
    one, other, away = match(found, true)
    assert dict(zip(one.tolist(), other.tolist(), strict=True)) == {0: 1, 1: 0}
    assert away.sum() == pytest.approx(0.06)


@pytest.mark.parametrize(("away", "pairs"), [(0.40, 1), (0.4001, 0)])
def test_match_distance_is_inclusive(away, pairs):
    assert len(match(np.array([[1.0, 0.0]]), np.array([[1.0, away]]))[0]) == pairs


@pytest.mark.parametrize(
    ("found", "true"), [([], [(1, 1)]), ([(1, 1)], []), ([], []), ([(1, 1)], [NOBODY])]
)
def test_match_of_no_people_is_empty(found, true):
    one, other, away = match(
        np.array(found, dtype=float).reshape(-1, 2), np.array(true, dtype=float).reshape(-1, 2)
    )
    assert len(one) == len(other) == len(away) == 0


# ------------------------------------------------------------------------------------- truth


def test_truth_is_interpolated():
    moving = truth({0: [(0, 0), (5, 5)], 100: [(0.2, -0.1), (5, 5)]})
    positions, visible = moving.at(25 * MS)
    np.testing.assert_allclose(positions, [(0.05, -0.025), (5, 5)])
    assert visible.all()


@pytest.mark.parametrize(("stamp", "x"), [(-500, 0.0), (0, 0.0), (100, 0.2), (900, 0.2)])
def test_truth_is_constant_beyond_its_ends_and_exact_at_its_stamps(stamp, x):
    positions, _ = truth({0: [(0, 0)], 100: [(0.2, 0)]}).at(stamp * MS)
    assert positions[0, 0] == pytest.approx(x)


@pytest.mark.parametrize(("stamp", "there"), [(10, False), (50, False), (51, True), (90, True)])
def test_person_in_one_message_is_present_on_its_side(stamp, there):
    positions, _ = truth({0: [NOBODY], 100: [(1, 2)]}).at(stamp * MS)
    assert np.isfinite(positions).all() == there
    if there:
        np.testing.assert_allclose(positions, [(1, 2)])


def test_truth_takes_any_order_any_number_of_people_and_the_last_of_one_stamp():
    made = Truth.build(
        [200, 100, 100],
        [np.array([[1.0, 1.0]]), np.array([[9.0, 9.0]]), np.array([[2.0, 2.0], [3.0, 3.0]])],
        [None, None, np.array([True, False])],
    )
    assert made.stamps_ns.tolist() == [100, 200]
    np.testing.assert_allclose(made.positions[0], [(2, 2), (3, 3)])
    np.testing.assert_allclose(made.positions[1], [(1, 1), NOBODY])
    assert made.visible.tolist() == [[True, False], [True, True]]


def test_missing_truth_is_handled():
    positions, visible = truth({}).at(0)
    assert positions.shape == (0, 2)
    assert visible.shape == (0,)


def test_visibility_is_that_of_the_nearer_message():
    made = truth({0: [(1, 1)], 100: [(1, 1)]}, visible=[[False], [True]])
    assert [bool(made.at(ms * MS)[1][0]) for ms in (0, 50, 51, 100)] == [False, False, True, True]


# ------------------------------------------------------------------------------------ intervals


@pytest.mark.parametrize(
    ("stamps", "truths", "wanted"),
    [
        ([0, 100, 200, 300, 700], [], 100),
        ([300, 0, 100], [], 150),  # the median of 100 and 200
        ([0, 0, 100], [], 100),  # a repeated stamp is no interval
        ([5], [0, 50, 100], 50),
        ([], [0, 50, 100], 50),
        ([5], [5], 200),
    ],
)
def test_interval_is_the_median_between_estimates(stamps, truths, wanted):
    assert interval_of([s * MS for s in stamps], [t * MS for t in truths]) == wanted * MS


def test_nearest_estimate_within_half_an_interval_counts():
    there = truth({stamp: [(0, 0)] for stamp in (0, 100, 200, 300, 400)})
    # Every 100 ms, 10 ms late; that of 200 is missing.
    estimates = [estimate(stamp + 10, (0.1, 0)) for stamp in (0, 100, 300, 400)]
    frames = score(there, estimates)
    assert [f.estimate for f in frames] == [0, 1, None, 2, 3]
    assert [f.missed.tolist() for f in frames] == [[], [], [0], [], []]
    people = summary(frames)["people"]
    assert (people["true"], people["estimates"], people["matched"]) == (5, 4, 4)
    assert (people["recall"], people["precision"]) == (0.8, 1.0)


def test_half_an_interval_is_inclusive_and_the_earlier_of_two_counts():
    there = truth({stamp: [(0, 0)] for stamp in (0, 50, 100, 150, 200)})
    estimates = [estimate(stamp, (0, 0)) for stamp in (0, 100, 200)]
    assert [f.estimate for f in score(there, estimates)] == [0, 0, 1, 1, 2]
    late = [estimate(stamp + 1, (0, 0)) for stamp in (0, 100, 200)]
    assert [f.estimate for f in score(there, late, interval_ns=98 * MS)] == [0, 0, 1, 1, 2]
    assert [f.estimate for f in score(there, late, interval_ns=97 * MS)] == [0, None, 1, None, 2]


def test_estimates_without_a_frame_nearby_do_not_count():
    frames = score(truth({1000: [(0, 0)]}), [estimate(t, (5, 5)) for t in (0, 500, 1000, 1500)])
    people = summary(frames)["people"]
    assert (people["true"], people["estimates"], people["matched"]) == (1, 1, 0)


def test_moving_people_are_compared_at_the_estimates_stamp():
    # 1 m/s along x; the estimate is 40 ms late and 3 cm aside of the true way.
    walk = truth({stamp: [(stamp / 1000, 0)] for stamp in (0, 100, 200)})
    estimates = [estimate(t + 40, ((t + 40) / 1000, 0.03)) for t in (0, 100)]
    frames = score(walk, estimates)
    assert [f.stamp_ns // MS for f in frames] == [0, 100, 200]
    np.testing.assert_allclose(frames[0].errors, [0.03])
    np.testing.assert_allclose(frames[1].errors, [0.03])
    assert frames[2].estimate is None  # 60 ms away, more than 50


# ------------------------------------------------------------------------------------ estimates


def test_estimate_without_identities_has_id_zero():
    nothing = estimate(0, (1, 2), (3, 4))
    assert nothing.ids.tolist() == [0, 0]
    np.testing.assert_array_equal(nothing.velocities, [NOBODY, NOBODY])
    assert nothing.coasting.tolist() == [False, False]


@pytest.mark.parametrize(
    ("given", "reason"),
    [
        ({"ids": np.array([1])}, r"ids has shape \(1,\); wanted: \(2,\)"),
        ({"velocities": np.zeros(2)}, r"velocities has shape \(2,\); wanted: \(2, 2\)"),
        ({"coasting": np.ones(3, dtype=bool)}, "coasting has shape"),
        ({"ids": np.array([4, 4])}, "twice"),
    ],
)
def test_inconsistent_estimate_is_refused(given, reason):
    with pytest.raises(ValueError, match=reason):
        Estimate(0, np.zeros((2, 2)), np.zeros((2, 2, 2)), **given)


# -------------------------------------------------------------------------------------- people


def test_counts_and_errors_match_hand_computed_values():
    there = truth({0: [(0, 0), (2, 0), (4, 0)], 100: [(0, 0), (2, 0), NOBODY]})
    estimates = [
        estimate(0, (0.1, 0), (2, 0.3), (7, 7), centre=(2, 0.5)),  # misses one, one is false
        estimate(100, (0, -0.2), centre=(1, 0)),  # misses one
    ]
    frames = score(there, estimates)
    assert [f.missed.tolist() for f in frames] == [[2], [1]]
    assert [f.false.tolist() for f in frames] == [[2], []]
    assert summary(frames) == {
        "frames": 2,
        "people": {
            "true": 5,
            "estimates": 4,
            "matched": 3,
            "recall": 0.6,
            "precision": 0.75,
            "frames_without_false": 1,
            "error_m": {
                "mean": pytest.approx(0.2),
                "median": pytest.approx(0.2),
                "p95": pytest.approx(0.29),  # 0.1, 0.2, 0.3: 90 % of the way to the last
                "max": pytest.approx(0.3),
            },
            # 0.1 and 0.2 of sigma 0.1: 1 and 4; 0.3: 9, more than 5.991.
            "coverage_95": pytest.approx(2 / 3),
        },
        # The true centres are (2, 0) and (1, 0).
        "group": {
            "centre_error_m": {"mean": pytest.approx(0.25), "p95": pytest.approx(0.475)},
        },
    }


def test_undefined_figures_are_none():
    undefined = {"mean": None, "median": None, "p95": None, "max": None}
    nothing = summary([])
    assert nothing["frames"] == 0
    assert nothing["people"] == {
        "true": 0, "estimates": 0, "matched": 0, "recall": None, "precision": None,
        "frames_without_false": 0, "error_m": undefined, "coverage_95": None,
    }  # fmt: skip
    assert nothing["group"] == {"centre_error_m": {"mean": None, "p95": None}}
    silent = summary(score(truth({0: [(0, 0)], 100: [(0, 0)]}), []))["people"]
    assert (silent["true"], silent["recall"], silent["precision"]) == (2, 0.0, None)
    assert silent["error_m"] == undefined
    false = summary(score(truth({0: [NOBODY]}), [estimate(0, (1, 1), centre=(1, 1))]))
    assert (false["people"]["recall"], false["people"]["precision"]) == (None, 0.0)
    assert false["group"]["centre_error_m"]["mean"] is None


def test_unseen_people_are_neither_required_nor_false():
    there = truth({0: [(0, 0), (2, 0), (4, 0)]}, visible=[[True, False, False]])
    frames = score(there, [estimate(0, (0, 0.1), (2, 0.1), (6, 0), centre=(1.3, 0.4))])
    (frame,) = frames
    assert frame.required.tolist() == [True, False, False]
    assert frame.ignored.tolist() == [1]
    assert frame.false.tolist() == [2]
    assert frame.missed.tolist() == []
    report = summary(frames)
    people = report["people"]
    assert (people["true"], people["estimates"], people["matched"]) == (1, 2, 1)
    assert report["group"]["centre_error_m"]["mean"] == pytest.approx(0.5)  # from (1, 0)


def test_required_people_are_matched_before_others():
    # The only one found is nearer to the unseen person.
    there = truth({0: [(0, 0), (0.3, 0)]}, visible=[[True, False]])
    (frame,) = score(there, [estimate(0, (0.25, 0))])
    assert frame.pairs.tolist() == [[0, 0]]
    assert len(frame.ignored) == len(frame.false) == 0


def test_unseen_person_excuses_one_estimate_only():
    there = truth({0: [(0, 0)]}, visible=[[False]])
    (frame,) = score(there, [estimate(0, (0.1, 0), (-0.1, 0))])
    assert len(frame.ignored) == 1
    assert len(frame.false) == 1


@pytest.mark.parametrize(
    ("away", "beside", "false"), [(0.69, [2], [1]), (0.71, [], [1, 2])], ids=["near", "far"]
)
def test_false_estimates_near_optional_people_are_ignored_within_their_limit(away, beside, false):
    there = truth({0: [(0, 0), (5, 0)]}, visible=[[True, False]])
    # The first is found, the second is beside that required person, the third beside the optional.
    given = estimate(0, (0, 0), (0.5, 0), (5 + away, 0))
    (frame,) = score(dataclasses.replace(there, ignore_within=0.70), [given])
    assert (frame.beside.tolist(), frame.false.tolist()) == (beside, false)
    assert len(frame.ignored) == 0
    assert summary([frame])["people"]["estimates"] == 1 + len(false)
    (unlimited,) = score(there, [given])
    assert (unlimited.beside.tolist(), unlimited.false.tolist()) == ([], [1, 2])


@pytest.mark.parametrize(
    ("covariance", "offset", "inside"),
    [
        (((0.04, 0), (0, 0.0001)), (0.3, 0.0), True),  # 1.5 sigma along x
        (((0.04, 0), (0, 0.0001)), (0.0, 0.3), False),  # 30 sigma along y
        # Long along (1, 1): variances 0.05 there and 0.01 across.
        (((0.03, 0.02), (0.02, 0.03)), (0.2, 0.2), True),  # 0.08 / 0.05 = 1.6
        (((0.03, 0.02), (0.02, 0.03)), (0.2, -0.2), False),  # 0.08 / 0.01 = 8
        (((0.01, 0), (0, 0.01)), (0.2447, 0), True),  # 5.988
        (((0.01, 0), (0, 0.01)), (0.2448, 0), False),  # 5.993
        (((0, 0), (0, 0)), (0.0, 0.0), False),  # is none
        (((math.nan, 0), (0, 1)), (0.0, 0.0), False),
        (((-1, 0), (0, -1)), (0.0, 0.0), False),
        (((1, 2), (2, 1)), (0.0, 0.0), False),
    ],
)
def test_coverage_matches_hand_computed_values(covariance, offset, inside):
    frames = score(
        truth({0: [(1, 1)]}), [estimate(0, np.add((1, 1), offset), covariance=covariance)]
    )
    assert summary(frames)["people"]["coverage_95"] == float(inside)


# ---------------------------------------------------------------------------------- properties

coordinates = st.floats(-5, 5, allow_nan=False).map(lambda value: round(value, 3))
places = st.lists(st.tuples(coordinates, coordinates), max_size=6)


@given(st.lists(places, min_size=1, max_size=4))
def test_truth_itself_has_the_perfect_score(rows):
    there = truth({100 * i: row for i, row in enumerate(rows)})
    frames = score(there, [estimate(100 * i, *row) for i, row in enumerate(rows)])
    people = summary(frames)["people"]
    assert people["true"] == people["estimates"] == people["matched"] == sum(map(len, rows))
    if people["true"]:
        assert people["error_m"]["max"] == 0.0
        assert people["coverage_95"] == 1.0


@given(places, places, st.randoms(use_true_random=False))
def test_order_of_people_does_not_matter(found, true, random):
    there = truth({0: true})
    before = summary(score(there, [estimate(0, *found)]))["people"]
    random.shuffle(found)
    random.shuffle(true)
    after = summary(score(truth({0: true}), [estimate(0, *found)]))["people"]
    for count in ("true", "estimates", "matched"):
        assert after[count] == before[count]
    assert after["error_m"]["mean"] == pytest.approx(before["error_m"]["mean"])
    assert after["matched"] <= min(after["true"], after["estimates"])


@given(places, places, st.lists(st.booleans(), min_size=6, max_size=6))
def test_each_estimate_is_matched_ignored_or_false(found, true, seen):
    there = truth({0: true}, visible=[seen[: len(true)]])
    there = dataclasses.replace(there, ignore_within=1.0)
    (frame,) = score(there, [estimate(0, *found)])
    parts = [frame.pairs[:, 0], frame.ignored, frame.beside, frame.false]
    assert sorted(np.concatenate(parts).tolist()) == list(range(len(found)))
    assert frame.required[frame.pairs[:, 1]].all()

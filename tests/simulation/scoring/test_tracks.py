"""Scores of identities and velocities that were worked out by hand."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_sim.scoring.positions import score
from mrs_people_sim.scoring.tracks import (
    TrackScores,
    follow,
    gospa,
    score_tracks,
    true_velocities,
)
from mrs_tools.bags.records import Estimate, Truth

MS = 1_000_000
NOBODY = (math.nan, math.nan)


def truth(rows, visible=None) -> Truth:
    """A row of positions each 100 ms."""
    return Truth.build(
        [100 * MS * index for index in range(len(rows))],
        [np.array(row, dtype=float).reshape(-1, 2) for row in rows],
        None if visible is None else [np.array(v, dtype=bool) for v in visible],
    )


def estimate(stamp_ms, tracks, velocities=None) -> Estimate:
    """Tracks: id -> position."""
    xy = np.array([*tracks.values()], dtype=float).reshape(-1, 2)
    return Estimate(
        stamp_ns=round(stamp_ms * MS),
        positions=xy,
        covariances=np.zeros((len(xy), 2, 2)),
        ids=np.array([*tracks], dtype=np.int64),
        velocities=np.array(velocities or [NOBODY] * len(xy), dtype=float).reshape(-1, 2),
    )


def estimated(*rows) -> list[Estimate]:
    """Tracks each 100 ms; None: no estimate."""
    return [estimate(100 * i, row) for i, row in enumerate(rows) if row is not None]


def scored(there: Truth, estimates: list[Estimate]) -> TrackScores:
    return score_tracks(there, score(there, estimates), estimates)


def identities(there: Truth, estimates: list[Estimate]) -> list[dict[int, int]]:
    """By frame, the identity of each person who counts."""
    return [
        {int(person): int(f.ids[i]) for i, person in f.pairs[f.counted]}
        for f in follow(score(there, estimates), estimates)
    ]


# ----------------------------------------------------------------------------------- CLEAR MOT

A, B = (0.0, 0.0), (2.0, 0.0)


def test_all_figures_of_one_recording_match_hand_computed_values():
    there = truth([(A, B)] * 5)
    # The first is followed by 1, lost, followed by 1 again. The second is followed by 2 with
    # 0.1 m, then by 3. 9 is nobody, twice.
    estimates = estimated(
        {1: (0, 0), 2: (2, 0.1)},
        {1: (0, 0), 2: (2, 0.1), 9: (5, 5)},
        {2: (2, 0.1), 9: (5, 5)},
        {1: (0, 0), 3: (2, 0)},
        {1: (0, 0), 3: (2, 0)},
    )
    scores = scored(there, estimates)
    # One missed, two false: sqrt(c^2 / 2 = 0.08, and the pairs' 0.01).
    of_frames = [0.1, math.sqrt(0.01 + 0.08), math.sqrt(0.01 + 0.16), 0.0, 0.0]
    assert scores.report() == {
        "mota": pytest.approx(1 - (1 + 2 + 1) / 10),
        "motp_m": pytest.approx(0.3 / 9),
        # 1 is the first's for 4 frames, 2 the second's for 3; 10 true, 11 found.
        "idf1": pytest.approx(2 * 7 / (10 + 11)),
        "idp": pytest.approx(7 / 11),
        "idr": pytest.approx(7 / 10),
        "id_switches": 1,
        "switches_per_person_minute": pytest.approx(60.0),  # one in 10 x 0.1 s
        "fragments": 1,
        "mostly_tracked": 1.0,  # 0.8 and 1
        "mostly_lost": 0.0,
        "gospa": pytest.approx(sum(of_frames) / 5),
        "velocity_error_mps": {"mean": None, "p95": None},
    }
    assert (scores.frames, scores.people, scores.tracks) == (5, 2, 4)
    assert (scores.true, scores.found, len(scores.errors)) == (10, 11, 9)


def test_identity_is_kept_within_the_distance_though_another_is_nearer():
    there = truth([(A,)] * 3)
    estimates = estimated({1: (0.1, 0)}, {1: (0.4, 0), 2: (0.0, 0)}, {1: (0.401, 0), 2: (0.0, 0)})
    assert identities(there, estimates) == [{0: 1}, {0: 1}, {0: 2}]
    scores = scored(there, estimates)
    assert scores.switches == 1
    assert scores.errors.tolist() == pytest.approx([0.1, 0.4, 0.0])
    assert scores.report()["mota"] == pytest.approx(1 - (2 + 1) / 3)  # two false and a switch


def test_kept_identity_may_leave_another_person_missed():
    # Optimal would be two pairs: 1 with the second and 2 with the first.
    there = truth([((0, 0), (3, 0)), ((0, 0), (0.6, 0))])
    estimates = estimated({1: (0, 0)}, {1: (0.3, 0), 2: (-0.3, 0)})
    assert len(score(there, estimates)[1].pairs) == 2
    assert identities(there, estimates) == [{0: 1}, {0: 1}]


def test_exchanged_identities_are_two_switches():
    there = truth([(A, B)] * 4)
    estimates = estimated({1: A, 2: B}, {1: A, 2: B}, {1: B, 2: A}, {1: B, 2: A})
    scores = scored(there, estimates)
    assert (scores.switches, scores.fragments) == (2, 0)
    assert scores.report()["mota"] == pytest.approx(1 - 2 / 8)
    assert scores.report()["idf1"] == pytest.approx(0.5)


@pytest.mark.parametrize(("after", "switches"), [(1, 0), (7, 1)])
def test_gap_is_a_fragment_and_a_switch_only_if_the_identity_differs(after, switches):
    there = truth([(A,)] * 5)
    scores = scored(there, estimated({1: A}, {}, None, {after: A}, {after: A}))
    assert (scores.switches, scores.fragments) == (switches, 1)
    assert scores.report()["mota"] == pytest.approx(1 - (2 + switches) / 5)


def test_late_start_or_final_loss_is_no_fragment():
    there = truth([(A, B)] * 4)
    scores = scored(there, estimated({1: A}, {1: A}, {2: B}, {2: B}))
    assert (scores.switches, scores.fragments) == (0, 0)
    assert (scored(there, estimated({}, {}, {9: (7, 7)}, {})).fragments) == 0


def test_returning_person_keeps_their_last_identity():
    there = truth([(A,), (NOBODY,), (NOBODY,), (A,)])
    assert scored(there, estimated({1: A}, {}, {}, {1: A})).switches == 0
    again = scored(there, estimated({1: A}, {}, {}, {2: A}))
    assert (again.switches, again.fragments, again.true) == (1, 0, 2)
    # A track of somebody who has left is false.
    assert scored(there, estimated({1: A}, {1: A}, {1: A}, {1: A})).report()["mota"] == 0.0


def test_identity_belongs_to_the_person_who_had_it_later():
    near = (0.3, 0.0)
    there = truth([(A, NOBODY), (NOBODY, near), (A, near), (A, near)])
    estimates = estimated({1: A}, {1: near}, {1: (0.1, 0)}, {1: (0.1, 0), 2: A})
    assert identities(there, estimates) == [{0: 1}, {1: 1}, {1: 1}, {1: 1, 0: 2}]
    assert scored(there, estimates).switches == 1


def test_identity_tracked_while_unseen_is_remembered():
    near, far = (0.3, 0.0), (9.0, 0.0)
    there = truth(
        [(A, far), (far, near), (A, far), (A, near)], visible=[*[(1, 1)] * 2, (0, 1), (1, 1)]
    )
    # 1 is the first's, the second's, the first's unseen.
    estimates = estimated({1: A}, {1: near}, {1: A}, {1: (0.1, 0)})
    assert identities(there, estimates) == [{0: 1}, {1: 1}, {}, {0: 1}]


def test_people_match_within_another_distance():
    there = truth([(A,)] * 2)
    estimates = estimated({1: (0.9, 0)}, {1: (0.9, 0)})
    assert len(scored(there, estimates).errors) == 0
    frames = score(there, estimates, distance=1.0)
    wide = score_tracks(there, frames, estimates, distance=1.0)
    assert (len(wide.errors), wide.idtp) == (2, 2)
    assert wide.report()["gospa"] == pytest.approx(0.9)


def test_frames_that_share_an_estimate_cause_no_switch():
    there = truth([(A,)] * 5)
    estimates = [estimate(t, {1: A}) for t in (0, 200, 400)]
    scores = scored(there, estimates)
    assert (scores.true, scores.found, len(scores.errors), scores.switches) == (5, 5, 5, 0)


def test_only_estimates_with_an_id_are_tracks():
    there = truth([(A, B)] * 2)
    estimates = [
        replace(e, ids=np.array(ids))
        for e, ids in zip(estimated({1: A, 2: B}, {1: A, 2: B}), ([1, 0], [0, 0]), strict=True)
    ]
    scores = scored(there, estimates)
    assert (scores.true, scores.found, len(scores.errors)) == (4, 1, 1)
    assert scores.report()["mota"] == pytest.approx(0.25)


def test_without_identities_scores_are_undefined():
    there = truth([(A,)] * 2)
    estimates = [replace(e, ids=np.zeros(1, dtype=np.int64)) for e in estimated({1: A}, {1: A})]
    for nothing in (scored(there, estimates), TrackScores(), scored(truth([]), estimated({1: A}))):
        report = nothing.report()
        assert report.pop("velocity_error_mps") == {"mean": None, "p95": None}
        assert set(report.values()) == {None}
    nobody = scored(truth([(NOBODY,)]), estimated({1: A})).report()
    assert (nobody["mota"], nobody["idf1"], nobody["id_switches"]) == (None, 0.0, 0)


# ------------------------------------------------------------------- people whom no robot sees


def test_unseen_people_have_no_frame_and_their_estimates_are_ignored():
    there = truth([(A, B)] * 4, visible=[(1, 1), (1, 0), (1, 0), (1, 1)])
    kept = scored(there, estimated(*[{1: A, 2: B}] * 4))
    lost = scored(there, estimated({1: A, 2: B}, {1: A}, {1: A}, {1: A, 2: B}))
    for scores in (kept, lost):
        assert (scores.true, scores.found, len(scores.errors)) == (6, 6, 6)
        assert (scores.switches, scores.fragments, scores.idtp) == (0, 0, 6)
        assert scores.report()["mota"] == scores.report()["idf1"] == 1.0
        assert scores.report()["gospa"] == 0.0
        assert scores.person_s == pytest.approx(0.6)


def test_new_identity_after_an_unseen_gap_is_one_switch():
    there = truth([(A,)] * 4, visible=[(1,), (0,), (0,), (1,)])
    for hidden in ({1: A}, {}, {2: A}):
        scores = scored(there, estimated({1: A}, hidden, hidden, {2: A}))
        assert (scores.switches, scores.true, scores.found) == (1, 2, 2)
    # What fits them while they are not visible is not theirs: 1 was.
    assert scored(there, estimated({1: A}, {2: A}, {2: A}, {1: A})).switches == 0


def test_identity_of_an_unseen_person_is_not_given_to_a_neighbour():
    near = (0.3, 0.0)
    there = truth([(A, near)] * 3, visible=[(1, 1), (0, 1), (1, 1)])
    # The neighbour's own track is missing for a frame; the other is nearer to the neighbour.
    estimates = estimated({1: A, 2: near}, {1: (0.2, 0)}, {1: A, 2: near})
    assert identities(there, estimates) == [{0: 1, 1: 2}, {}, {0: 1, 1: 2}]
    scores = scored(there, estimates)
    assert (scores.switches, scores.fragments) == (0, 1)
    assert scores.report()["mota"] == pytest.approx(1 - 1 / 5)


def test_free_identity_is_given_to_required_people_first():
    there = truth([(A, (0.3, 0.0))], visible=[(1, 0)])
    scores = scored(there, estimated({1: (0.25, 0)}))
    assert (scores.true, scores.found, len(scores.errors)) == (1, 1, 1)


def test_track_that_leaves_an_unseen_person_is_false():
    there = truth([(A,)] * 2, visible=[(1,), (0,)])
    assert scored(there, estimated({1: A}, {1: (0.5, 0)})).report()["mota"] == 0.0


# --------------------------------------------------------------------------- identities overall


def test_idf1_assigns_one_identity_per_person_and_recording():
    there = truth([(A,)] * 10)
    scores = scored(there, estimated(*[{1: A}] * 6, *[{2: A}] * 4))
    report = scores.report()
    assert scores.idtp == 6
    assert (report["idp"], report["idr"], report["idf1"]) == (0.6, 0.6, 0.6)
    assert report["mota"] == 0.9


def test_idf1_assigns_each_identity_to_one_person():
    # 1 follows the first for 3 frames, then the second for 4; 2 follows nobody else.
    there = truth([(A, B)] * 7)
    scores = scored(there, estimated(*[{1: A}] * 3, *[{1: B, 2: A}] * 4))
    assert scores.idtp == 8  # 1 is the second's, 2 the first's
    assert scores.report()["idf1"] == pytest.approx(16 / (14 + 11))


def test_frames_of_unseen_people_count_for_no_identity():
    # The neighbour is never seen: of the two that were the first's, none is theirs.
    there = truth([(A, (0.3, 0.0))] * 2, visible=[(1, 0)] * 2)
    assert scored(there, estimated({1: (0.15, 0)}, {2: (0.15, 0)})).idtp == 1


@pytest.mark.parametrize(
    ("frames", "tracked", "lost"), [(10, 1, 0), (8, 1, 0), (7, 0, 0), (2, 0, 0), (1, 0, 1)]
)
def test_mostly_tracked_and_mostly_lost_match_hand_computed_values(frames, tracked, lost):
    there = truth([(A, NOBODY)] * 10)  # who is never there is no person
    report = scored(there, estimated(*[{1: A}] * frames, *[{}] * (10 - frames))).report()
    assert (report["mostly_tracked"], report["mostly_lost"]) == (tracked, lost)


def test_recordings_are_pooled_by_their_counts():
    there = truth([(A,)] * 4)
    one = scored(there, estimated(*[{1: A}] * 4))
    other = scored(
        truth([(A, B)] * 4), estimated({1: A, 2: B}, {1: A, 2: B}, {3: A}, {3: (0, 0.3)})
    )
    total = one + other
    report = total.report()
    assert report["mota"] == pytest.approx(1 - (2 + 1) / 12)  # not the mean of 1 and 0.625
    assert report["idf1"] == pytest.approx(2 * (4 + 4) / (12 + 10))
    assert report["motp_m"] == pytest.approx(0.3 / 10)
    assert report["id_switches"] == 1  # 1 of the other is not 1 of the one
    assert report["switches_per_person_minute"] == pytest.approx(60 / 1.2)
    assert report["mostly_tracked"] == pytest.approx(2 / 3)
    assert total.people == 3
    # A recording in which nobody is followed counts.
    blind = scored(there, estimated({}, {}, {}, {}))
    assert blind.report()["mota"] is None
    assert (one + blind).report()["mota"] == 0.5
    assert (one + TrackScores()).report() == one.report()


# --------------------------------------------------------------------------------------- GOSPA


@pytest.mark.parametrize(
    ("found", "true", "wanted"),
    [
        ([], [], 0.0),
        ([(1, 1)], [(1, 1)], 0.0),
        ([(1, 1.3)], [(1, 1)], 0.3),
        ([(1, 1.39)], [(1, 1)], 0.39),
        ([(1, 9)], [(1, 1)], 0.4),  # c: one missed and one false
        ([NOBODY], [(1, 1)], 0.4),
        ([], [(1, 1)], 0.4 / math.sqrt(2)),
        ([(1, 1), (2, 2)], [], 0.4),
        ([(0, 0.3), (5, 5)], [(0, 0), (2, 0)], 0.5),  # 0.09 + 0.16
        # 0.25^2 + 0.25^2 is less than 0.3^2 + 0.2^2: squares count, not distances.
        ([(0, 0), (0, 0.05)], [(0.25, 0), (0.25, 0.05)], math.sqrt(0.125)),
    ],
)
def test_gospa_matches_hand_computed_values(found, true, wanted):
    sets = [np.array(places, dtype=float).reshape(-1, 2) for places in (found, true)]
    assert gospa(*sets) == pytest.approx(wanted)
    assert gospa(*sets[::-1]) == pytest.approx(wanted)


def test_gospa_with_other_cut_off_and_exponent_is_correct():
    one, two = np.array([[0.0, 0.0], [9.0, 9.0]]), np.array([[0.0, 1.5]])
    assert gospa(one, two, distance=2.0, power=1) == pytest.approx(1.5 + 1.0)
    assert gospa(one, two, distance=1.0, power=1) == pytest.approx(1.5)


# -------------------------------------------------------------------------------------- velocity


def velocity(there: Truth, ms: float, person: int = 0) -> list[float]:
    stamps = np.array([round(ms * MS)], dtype=np.int64)
    return [float(v) for v in true_velocities(there, stamps, np.array([person]))[0]]


def test_true_velocity_is_the_central_difference_over_the_window():
    # x = t^2 / 2 at 10 Hz: the velocity is t, and central differences of it are exact.
    there = truth([((0.5 * (0.1 * i) ** 2, -0.3 * i),) for i in range(11)])
    assert velocity(there, 500) == pytest.approx([0.5, -3.0])
    assert velocity(there, 800) == pytest.approx([0.8, -3.0])
    # Between the messages the positions are interpolated: 0.15^2 / 2 becomes 0.0125, likewise.
    assert velocity(there, 350) == pytest.approx([(0.1525 - 0.0125) / 0.4, -3.0])


def test_true_velocity_at_the_ends_uses_the_available_window():
    there = truth([((0.5 * (0.1 * i) ** 2, 0),) for i in range(11)])
    assert velocity(there, 0) == pytest.approx([0.02 / 0.2, 0.0])
    assert velocity(there, 100) == pytest.approx([0.045 / 0.3, 0.0])
    assert velocity(there, 1000) == pytest.approx([(0.5 - 0.32) / 0.2, 0.0])
    for outside in (-10, 1010):
        assert np.isnan(velocity(there, outside)).all()


def test_true_velocity_of_a_temporary_person_uses_their_time():
    walk = [NOBODY, NOBODY, *((0.1 * i, 0.0) for i in range(2, 8)), NOBODY, (5, 5), NOBODY]
    there = truth([(xy, (0, 0)) for xy in walk])
    for ms in (200, 240, 300, 450, 600, 700):
        assert velocity(there, ms) == pytest.approx([1.0, 0.0]), ms
    # Near the message of their last frame, but less than half of their window is there.
    for ms in (0, 160, 740, 800, 900):
        assert np.isnan(velocity(there, ms)).all(), ms
    assert velocity(there, 900, person=1) == [0.0, 0.0]


def test_true_velocity_of_too_little_truth_is_undefined():
    assert np.isnan(velocity(truth([(A,)]), 0)).all()
    nobody = true_velocities(truth([]), np.empty(0, np.int64), np.empty(0, np.intp))
    assert nobody.shape == (0, 2)


def test_velocity_errors_need_a_track_with_velocity():
    there = truth([((0.1 * i, 0), (0, 3)) for i in range(5)])  # 1 m/s, and standing
    estimates = [
        estimate(100 * i, {1: (0.1 * i, 0), 2: (0, 3), 9: (7, 7)}, [(1, 0.1), v, (5, 5)])
        for i, v in enumerate([(0.3, 0.4), NOBODY, NOBODY, (0, 0), NOBODY])
    ]
    scores = scored(there, estimates)
    assert sorted(scores.velocity_errors) == pytest.approx([0, 0.1, 0.1, 0.1, 0.1, 0.1, 0.5])
    errors = scores.report()["velocity_error_mps"]
    assert errors["mean"] == pytest.approx(1 / 7)
    assert errors["p95"] == pytest.approx(0.1 + 0.7 * 0.4)  # 70 % of the way to the last


def test_velocities_are_compared_at_the_estimates_own_stamp():
    there = truth([((0.5 * (0.1 * i) ** 2, 0),) for i in range(11)])
    (late,) = [estimate(540, {1: (0.1458, 0)}, [(0.5, 0)])]
    scores = score_tracks(there, score(there, [late], interval_ns=100 * MS), [late])
    # (0.74 s: 0.2745; 0.34 s: 0.0585 along the straight pieces)
    assert scores.velocity_errors == pytest.approx([abs((0.274 - 0.058) / 0.4 - 0.5)])


# ----------------------------------------------------------------------------------- properties

walks = st.integers(0, 2**32 - 1).map(np.random.default_rng)


@given(walks)
def test_truth_itself_has_the_perfect_score(rng):
    places = np.cumsum(rng.normal(0, 0.1, (12, 4, 2)), axis=0) + [(0, 0), (9, 0), (0, 9), (9, 9)]
    there = truth([row.tolist() for row in places])
    estimates = estimated(*[dict(zip((5, 3, 8, 2), row.tolist(), strict=True)) for row in places])
    moving = [
        replace(
            e,
            velocities=true_velocities(there, np.full(4, e.stamp_ns, dtype=np.int64), np.arange(4)),
        )
        for e in estimates
    ]
    report = scored(there, moving).report()
    assert report == {
        "mota": 1.0, "motp_m": 0.0, "idf1": 1.0, "idp": 1.0, "idr": 1.0, "id_switches": 0,
        "switches_per_person_minute": 0.0, "fragments": 0, "mostly_tracked": 1.0,
        "mostly_lost": 0.0, "gospa": 0.0, "velocity_error_mps": {"mean": 0.0, "p95": 0.0},
    }  # fmt: skip


@pytest.mark.slow
@given(walks)
def test_neither_names_nor_order_matter(rng):
    frames, people = 15, 5
    places = np.cumsum(rng.normal(0, 0.2, (frames, people, 2)), axis=0)
    seen = rng.random((frames, people)) < 0.8
    found = places + rng.normal(0, 0.2, places.shape)
    there = truth([row.tolist() for row in places], seen)
    names, order = rng.permutation(100)[:people] + 1, rng.permutation(people)
    mixed = truth([row[order].tolist() for row in places], seen[:, order])

    def tracks(names, order):
        return estimated(*[{int(names[i]): tuple(row[i]) for i in order} for row in found])

    one = scored(there, tracks(np.arange(1, people + 1), range(people)))
    other = scored(mixed, tracks(names, rng.permutation(people)))
    figures = [vars(scores) for scores in (one, other)]
    for name in figures[0].keys() - {"errors", "velocity_errors"}:
        assert figures[0][name] == pytest.approx(figures[1][name]), name
    assert sorted(one.errors) == pytest.approx(sorted(other.errors))


def test_tracks_near_optional_people_are_ignored_within_their_limit():
    """The second person need not be found; their track is 0.6 m from them."""
    there = truth([(A, B)] * 3, visible=[[True, False]] * 3)
    estimates = estimated(*[{1: A, 2: (2.6, 0.0)}] * 3)
    assert scored(there, estimates).report()["mota"] == 0.0
    tolerant = replace(there, ignore_within=0.7)
    report = scored(tolerant, estimates).report()
    assert (report["mota"], report["idf1"], report["gospa"]) == (1.0, 1.0, 0.0)

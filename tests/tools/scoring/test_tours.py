"""Scores of guided tours, on tours of a few seconds that are worked out by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mrs_people_loc.guiding.guidance import Guidance, Post, Role, State
from mrs_tools.scoring.poses import PoseTrack
from mrs_tools.scoring.records import Estimate, Truth
from mrs_tools.scoring.tours import TourRecord, TourScores, score_tour

S = 1_000_000_000
STAMPS = np.arange(0, 10 * S + 1, S // 5)
T = STAMPS / S


def track(x, y=0.0, stamps=STAMPS) -> PoseTrack:
    x, y = np.broadcast_arrays(np.asarray(x, float), np.asarray(y, float))
    x, y = (np.broadcast_to(v, len(stamps)) for v in (x, y))
    poses = np.stack([x, y, np.zeros(len(stamps))], axis=1)
    return PoseTrack(stamps, poses, np.zeros((len(stamps), 3, 3)))


def people(*ways) -> Truth:
    """The people's x over time; y is 0, 1, 2, ... m."""
    xs = np.stack([np.broadcast_to(np.asarray(way, float), len(T)) for way in ways], axis=1)
    ys = np.where(np.isfinite(xs), np.arange(len(ways)), np.nan)
    return Truth(STAMPS, np.stack([xs, ys], axis=2), np.zeros(xs.shape, dtype=bool))


def found(truth: Truth, *, left_out=lambda t, person: False, off=0.0) -> list[Estimate]:
    estimates = []
    for stamp, xy in zip(STAMPS.tolist(), truth.positions, strict=True):
        xy = xy + [off, 0.0]
        kept = [
            k for k in range(len(xy)) if not left_out(stamp / S, k) and np.isfinite(xy[k]).all()
        ]
        estimates.append(Estimate(stamp, xy[kept], np.zeros((len(kept), 2, 2))))
    return estimates


def statuses(posts=None, *, last=State.FINISHED, lost=()) -> list[Guidance]:
    """The group sets off at 1 s; the end is said at 9 s and again at 10 s."""
    posts = posts or {}

    def state(t: float) -> State:
        return State.GATHERING if t < 1.0 else State.LEADING if t < 9.0 else last

    return [
        Guidance(int(t * S), state(t), way_m=3.0 * t, lost=lost, posts=posts)
        for t in np.arange(0.0, 10.5, 0.5).tolist()
    ]


def record(truth=None, robots=None, **changes) -> TourRecord:
    truth = people(T, T) if truth is None else truth
    robots = {"a": track(T + 2.0)} if robots is None else robots
    return TourRecord(**{
        "statuses": statuses(), "truth": truth, "robots": robots, "estimates": found(truth),
        **changes,
    })  # fmt: skip


def test_a_tour_that_is_finished():
    scores = score_tour(record())
    assert (scores.tours, scores.finished, scores.people, scores.lost) == (1, 1, 2, 0)
    assert scores.times_s == pytest.approx([8.0])
    assert scores.way_m == pytest.approx([27.0])
    assert scores.path_m == pytest.approx([8.0])  # from 1 s to 9 s, 1 m/s
    assert scores.least_m == pytest.approx([2.0])
    assert scores.near_s == scores.own_motion_s == scores.alone_s == 0.0


@pytest.mark.parametrize("last", [State.LEADING, State.CANCELLED])
def test_a_tour_that_is_not(last):
    scores = score_tour(record(statuses=statuses(last=last, lost=(7,))))
    assert (scores.finished, len(scores.times_s), scores.given_up) == (0, 0, 1)


def test_a_tour_that_never_began():
    only = [Guidance(0, State.GATHERING), Guidance(S, State.CANCELLED)]
    report = score_tour(record(statuses=only)).report()
    assert (report["tours"], report["finished"], report["people"]) == (1, 0, 0)
    assert report["seen"] == {"mean": None, "min": None}


def test_who_is_seen_and_for_how_long():
    # 41 times from 1 s to 9 s; the second person is missing at those 10 of [3, 5).
    truth = people(T, T)
    gaps = found(truth, left_out=lambda t, person: person == 1 and 3.0 <= t < 5.0)
    assert score_tour(record(truth, estimates=gaps)).seen == pytest.approx([1.0, 31 / 41])
    assert score_tour(record(truth, estimates=found(truth, off=0.45))).seen == pytest.approx(1.0)
    assert score_tour(record(truth, estimates=found(truth, off=0.55))).seen == pytest.approx(0.0)
    assert score_tour(record(truth, estimates=[])).seen == pytest.approx([0.0, 0.0])


def test_who_is_lost():
    # Two go on; one stays at 0 m and is 9 m behind; one is not there any more.
    truth = people(T, T, 0.0, np.where(T < 5.0, T, np.nan))
    scores = score_tour(record(truth))
    assert (scores.people, scores.lost) == (4, 2)


def test_near_a_person_by_whose_motion():
    # Toward somebody at 0.5 m/s from 2 m to 0.3 m; below 0.5 m from 3 s on, below 0.45 m from
    # 3.1 s on, and standing from 3.4 s on.
    x = 2.0 - np.minimum(0.5 * T, 1.7)
    truth = people(0.0, 0.0)
    towards = score_tour(record(truth, {"a": track(x)}))
    assert towards.least_m == pytest.approx([0.3], abs=1e-6)
    assert towards.near_s == pytest.approx(6.0, abs=0.15)
    assert towards.own_motion_s == pytest.approx(0.3, abs=0.15)
    # The same distances, but the person comes.
    comes = score_tour(record(people(x, x), {"a": track(0.0)}))
    assert comes.near_s == pytest.approx(6.0, abs=0.15)
    assert comes.own_motion_s == 0.0


def test_errors_of_the_formation_count_where_robot_and_post_are_known():
    posts = {
        name: Post(Role.REAR, np.array([0.0, 3.0]), 0.0, 1.0) for name in ("stands", "failed", "x")
    }
    early = STAMPS[STAMPS <= 5 * S]
    robots = {"stands": track(4.0), "failed": track(0.0, stamps=early), "b": track(9.0)}
    errors = score_tour(record(robots=robots, statuses=statuses(posts))).formation_m
    # Statuses of 1, 1.5, ... 9 s; the second robot is known up to 5 s.
    assert sorted(errors) == pytest.approx([3.0] * 9 + [5.0] * 17)


def test_a_straggler_alone_beside_a_robot_and_back():
    # One stops at 1 m from 1 s to 6 s, while two go on to 8 m; then they are there at once.
    onward = np.minimum(np.maximum(T, 1.0), 8.0)
    stays = np.where(T < 6.0, 1.0, onward)
    truth = people(stays, onward, onward)
    scores = score_tour(record(truth, {"a": track(20.0)}))
    assert (scores.stragglers, scores.back) == (1, 1)
    # Beyond 2.5 m of the second person, who is 1 m to the left: from 1 + 2.29 s to 5.8 s.
    assert scores.alone_s == pytest.approx(5.8 - 1.0 - 2.29, abs=0.15)
    # A robot 1 m beside them from 4 s on.
    fetched = score_tour(record(truth, {"a": track(np.where(T < 4.0, 20.0, 2.0))}))
    assert fetched.alone_s == pytest.approx(4.0 - 1.0 - 2.29, abs=0.25)
    never = score_tour(record(people(1.0, onward, onward), {"a": track(20.0)}))
    assert (never.stragglers, never.back) == (1, 0)


def test_scores_add_up():
    one = score_tour(record())
    other = score_tour(record(statuses=statuses(last=State.CANCELLED)))
    both = one + other
    assert (both.tours, both.finished, both.people) == (2, 1, 4)
    assert both.report()["time_s"] == pytest.approx(8.0)
    assert dataclasses.asdict(TourScores() + one)["people"] == 2

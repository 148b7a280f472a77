"""Scores of guided tours, on tours of a few seconds that are worked out by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mrs_people_loc.guiding.guidance import Guidance, Post, Role, State
from mrs_people_sim.scoring.poses import PoseTrack
from mrs_people_sim.scoring.tours import TourRecord, TourScores, score_tour
from mrs_tools.bags.records import Estimate, Truth

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
    assert report["seen"] == {"mean": None, "min": None, "detected": None}


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


def lead(x: float, speed: float = 0.5) -> list[Guidance]:
    """A leader with a post at x all the time, finished in the end."""
    posts = {"a": Post(Role.LEADER, np.array([x, 0.0]), 0.0, speed)}
    return [dataclasses.replace(one, speed=speed) for one in statuses(posts)]


def test_a_tour_without_its_group_at_the_end_is_not_finished_and_everybody_is_lost():
    # Two stand at 0 and 1 m; the leader goes to 20 m, and the guide says that it is finished.
    robots = {"a": track(2.0 * T)}
    alone = score_tour(record(people(0.0, 1.0), robots, statuses=lead(20.0)))
    assert (alone.finished, len(alone.times_s), alone.lost) == (0, 0, 2)
    there = score_tour(record(people(16.0, 17.0), robots, statuses=lead(20.0)))
    assert (there.finished, there.lost) == (1, 0)
    # One of three is 10.9 m from the end: less than 6 m from the others, who are 5.9 m from it.
    late = score_tour(record(people(14.2, 14.2, 9.3), robots, statuses=lead(20.0)))
    assert (late.finished, late.lost) == (1, 1)


def test_who_is_only_predicted_is_seen_but_not_detected():
    truth = people(T, T)
    half = [
        dataclasses.replace(one, coasting=np.array([False, one.stamp_ns >= 5 * S]))
        for one in found(truth)
    ]
    scores = score_tour(record(truth, estimates=half))
    assert scores.seen == pytest.approx([1.0, 1.0])
    # 20 of the 41 times from 1 s to 9 s are before 5 s.
    assert scores.detected == pytest.approx([1.0, 20 / 41])


def test_contacts_are_counted_once_each():
    # At 0.4 m of the first person in [2, 4) and [6, 7) s, else 3 m off.
    x = np.where(((T >= 2.0) & (T < 4.0)) | ((T >= 6.0) & (T < 7.0)), 0.4, 3.0)
    assert score_tour(record(people(0.0), {"a": track(x)})).contacts == 2
    assert score_tour(record(people(0.0), {"a": track(x + 0.1)})).contacts == 0


def test_contacts_by_whose_motion_and_times_by_own_motion():
    # To 0.4 m of somebody at 0.5 m/s, from 0.45 m on for 0.1 s; and likewise the person comes.
    x = np.minimum(0.5 * T, 1.6)
    drives = score_tour(record(people(2.0), {"a": track(x)}))
    assert (drives.contacts, drives.own_contacts) == (1, 1)
    assert drives.own_longest_s == pytest.approx([0.1], abs=0.11)
    comes = score_tour(record(people(2.0 - x), {"a": track(0.0)}))
    assert (comes.contacts, comes.own_contacts, comes.own_longest_s.max()) == (1, 0, 0.0)


def test_bystanders_count_by_their_distance_alone():
    truth = people(T, 0.8)
    member = np.tile([1, 0], (len(truth), 1))
    truth = Truth(truth.stamps_ns, truth.positions, truth.visible, member)
    scores = score_tour(record(truth, {"a": track(0.0)}))
    assert (scores.people, scores.lost, len(scores.seen)) == (1, 0, 1)
    assert scores.bystander_m == pytest.approx([np.hypot(0.8, 1.0)])
    assert len(score_tour(record(people(T), {"a": track(0.0)})).bystander_m) == 0


@pytest.mark.parametrize(("person", "post", "expected"), [(1.5, 3.0, 5.0), (9.0, 3.0, 0.0),
                                                          (1.5, 0.2, 0.0)])  # fmt: skip
def test_robots_stand_off_that_are_held_up_beside_somebody(person, post, expected):
    # It stands all the time; the tour lasts for 8 s, 3 s of which tell that it stands.
    posts = {"a": Post(Role.REAR, np.array([post, 0.0]), 0.0, 0.5)}
    scores = score_tour(record(people(person), {"a": track(0.0)}, statuses=statuses(posts)))
    assert scores.stood_off_s == pytest.approx(expected, abs=0.3)


def test_spread_is_that_of_people_about_their_middle():
    # Rows of people are 1 m apart; the middle one of three is the middle.
    scores = score_tour(record(people(0.0, 0.0, 0.0), {"a": track(9.0)}))
    assert scores.spread_m == pytest.approx([np.sqrt(2.0 / 3.0)])


def test_changes_of_the_leader_are_counted():
    def led(name: str) -> dict[str, Post]:
        return {name: Post(Role.LEADER, np.zeros(2), 0.0, 0.5)}

    said = statuses(led("a"))
    said = [dataclasses.replace(one, posts=led("b")) if one.stamp_ns > 5 * S else one
            for one in said]  # fmt: skip
    assert score_tour(record(people(0.0), {"a": track(0.0)}, statuses=said)).leaders == 1


def test_leader_that_drives_is_measured_from_its_way_and_one_that_waits_from_its_post():
    # 0.3 m beside the way, along x, on which its post is 1.5 m ahead.
    def driven(speed: float) -> list[Guidance]:
        return [
            dataclasses.replace(
                one,
                speed=speed,
                posts={"a": Post(Role.LEADER, np.array([one.stamp_ns / S + 1.5, 0.0]), 0.0, 1.0)},
            )
            for one in statuses()
        ]

    robots = {"a": track(T, 0.3)}
    goes = score_tour(record(people(T), robots, statuses=driven(1.0))).formation_m
    assert goes[5:] == pytest.approx(0.3)
    waits = score_tour(record(people(T), robots, statuses=driven(0.0))).formation_m
    assert waits == pytest.approx(np.hypot(1.5, 0.3))


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

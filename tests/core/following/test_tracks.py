"""Tracking: filters to the equation, who is who, births, ends, and time that does as it likes."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest

from mrs_people_loc import config as cfg
from mrs_people_loc.following.tracks import Tracker, TracksTuning, _Motion
from mrs_people_loc.people import NOBODY, Expected, Person
from oracle.tracks import filtered, published

MS = 1_000_000
SIGMA = 0.04


def person(x, y, *, at_ns, score=4.0, sigma=SIGMA, height=1.7, robots=("a",), covariance=None):
    if covariance is None:
        covariance = np.eye(2) * sigma**2
    return Person(
        np.array([x, y], dtype=float), covariance, height, 0.1, robots, 0, score, stamp_ns=at_ns
    )


def tracker(**changes) -> Tracker:
    return Tracker(cfg.PlannerConfig.from_mapping({"tracking": changes}).tracking)


def follow(follower: Tracker, ways, *, steps, dt_ms=100, noise=SIGMA, seed=0, **fields):
    """Runs people who are where `ways(t)` says, NaN: not found; what comes out, by step."""
    rng = np.random.default_rng(seed)
    out = []
    for step in range(steps):
        now = step * dt_ms * MS
        places = np.array(ways(step * dt_ms / 1000.0), dtype=float)
        found = [
            person(*(place + rng.normal(0, noise, 2)), at_ns=now, **fields)
            for place in places
            if np.isfinite(place).all()
        ]
        out.append(follower.step(found, now))
    return out


def ids(people) -> list[int]:
    return [one.id for one in people]


# ------------------------------------------------------------------------------ the filter ----


def test_filter_equals_the_textbook_filter():
    """Irregular intervals, covariances of any direction, scans that are older than the interval."""
    rng = np.random.default_rng(3)
    times = np.cumsum(rng.integers(40, 300, 40)) * MS
    stamps = times - rng.integers(0, 90, 40) * MS
    stamps[0] = times[0]
    covariances = []
    for _ in times:
        root = rng.normal(0, 0.05, (2, 2))
        covariances.append(root @ root.T + 4e-4 * np.eye(2))
    way = np.stack([1.0 + 0.8 * stamps / 1e9, 2.0 - 0.5 * stamps / 1e9], axis=1)
    found = [
        np.array(rng.multivariate_normal(at, c)) for at, c in zip(way, covariances, strict=True)
    ]
    follower = tracker(acceleration=0.6, lasting_share=0.0, gate=20.0)
    wanted = filtered(found, covariances, stamps.tolist(), times.tolist(), follower.config)
    for k, now in enumerate(times.tolist()):
        (got,) = follower.step(
            [person(*found[k], at_ns=int(stamps[k]), covariance=covariances[k])], now
        )
        state, covariance = wanted[k]
        np.testing.assert_allclose(got.position, state[:2], atol=1e-9)
        np.testing.assert_allclose(got.velocity, state[2:], atol=1e-9)
        np.testing.assert_allclose(got.covariance, published(*wanted[k]), atol=1e-9)
        np.testing.assert_allclose(got.velocity_covariance, covariance[2:, 2:], atol=1e-9)
        assert got.id == 1
        assert not got.coasting


@pytest.mark.slow
def test_position_and_velocity_covariances_are_consistent():
    """With white noise: the share of the truth in the 95 % ellipses, over many people."""
    inside, inside_v, total = 0, 0, 0
    for seed in range(30):
        rng = np.random.default_rng(seed)
        follower = tracker(acceleration=0.5, lasting_share=0.0, gate=20.0)
        state, q = np.array([0.0, 0.0, rng.normal(0, 0.5), rng.normal(0, 0.5)]), 0.25
        for k in range(60):
            t = 0.1
            one = np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]]) * q
            state = state + [t * state[2], t * state[3], 0, 0]
            state = state + rng.multivariate_normal(np.zeros(4), np.kron(one, np.eye(2)))
            place = state[:2] + rng.normal(0, SIGMA, 2)
            (got,) = follower.step([person(*place, at_ns=k * 100 * MS)], k * 100 * MS)
            off, off_v = got.position - state[:2], got.velocity - state[2:]
            inside += off @ np.linalg.solve(got.covariance, off) < 5.991
            inside_v += off_v @ np.linalg.solve(got.velocity_covariance, off_v) < 5.991
            total += 1
    assert 0.93 < inside / total < 0.97
    assert 0.93 < inside_v / total < 0.97


def test_velocity_of_a_walker_converges():
    out = follow(tracker(), lambda t: [(1.2 * t, 0.3 * t)], steps=60)
    velocities = np.array([people[0].velocity for people in out[20:]])
    assert np.abs(velocities.mean(axis=0) - (1.2, 0.3)).max() < 0.05
    assert np.hypot(*(velocities - (1.2, 0.3)).T).mean() < 0.18


def test_lasting_share_of_the_variance_is_not_filtered():
    still = lambda t: [(1.0, 1.0)]  # noqa: E731
    sure = follow(tracker(lasting_share=0.0), still, steps=50)[-1][0].covariance
    lasting = follow(tracker(lasting_share=0.5), still, steps=50)[-1][0].covariance
    np.testing.assert_allclose(lasting - sure, 0.87**2 * 0.5 * SIGMA**2 * np.eye(2), rtol=1e-6)


@pytest.mark.parametrize(("speed", "lead"), [(0.0, 0.0), (0.1, 0.0125), (0.4, 0.05), (1.2, 0.05)])
def test_published_ellipse_is_longer_along_the_velocity_of_who_walks(speed, lead):
    """The head leads the trunk by up to 5 cm; the filter itself does not get wider."""
    way = lambda t: [(0.6 * speed * t, 0.8 * speed * t)]  # noqa: E731
    out = follow(tracker(), way, steps=50, noise=0.0)
    along, across = np.array([0.6, 0.8]), np.array([-0.8, 0.6])
    covariance = out[-1][0].covariance
    more = along @ covariance @ along - across @ covariance @ across
    assert more == pytest.approx(lead**2, rel=1e-3, abs=1e-9)
    if not speed:
        return
    plain = Tracker(cfg.Tracking(), TracksTuning(lead=0.0))
    expected = [(follow(each, way, steps=50, noise=0.0), each.expect(5000 * MS))[1]
                for each in (tracker(), plain)]  # fmt: skip
    np.testing.assert_array_equal(expected[0].covariance, expected[1].covariance)


# ------------------------------------------------------------------------------ who is who ----


def test_each_person_keeps_an_id_for_any_order():
    rng = np.random.default_rng(0)
    follower = tracker()
    places = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.2), (3.0, 3.0)])
    names = {}
    for k in range(50):
        now = k * 100 * MS
        order = rng.permutation(4)
        moved = places + (0.05 * k, 0.02 * k)
        out = follower.step([person(*moved[i], at_ns=now) for i in order], now)
        assert ids(out) == [1, 2, 3, 4]
        for i, place in enumerate(moved):
            nearest = min(out, key=lambda one: math.dist(one.position, place))
            assert names.setdefault(i, nearest.id) == nearest.id


@pytest.mark.parametrize("seed", range(20))
@pytest.mark.parametrize("hidden", [False, True])
def test_two_people_passing_within_30_cm_keep_their_ids(seed, hidden):
    """Towards each other, at 1 m/s; closer than 0.6 m one may occlude the other."""

    def ways(t):
        one, other = np.array([t - 2.0, 0.0]), np.array([2.0 - t, 0.3])
        if hidden and np.hypot(*(one - other)) < 0.6:
            other = np.array([np.nan, np.nan])
        return [one, other]

    out = follow(tracker(), ways, steps=41, seed=seed)
    (one, other), (one_after, other_after) = out[5], out[-1]
    assert (one_after.id, other_after.id) == (one.id, other.id)
    if one.position[0] > 0:
        one_after, other_after = other_after, one_after
    assert one_after.position[0] > 1.5
    assert other_after.position[0] < -1.5


@pytest.mark.parametrize("seed", range(10))
def test_two_people_walking_side_by_side_keep_their_ids(seed):
    out = follow(tracker(), lambda t: [(t, 0.0), (t, 0.4)], steps=100, seed=seed)
    assert {tuple(ids(people)) for people in out} == {(1, 2)}
    below, above = sorted(out[0], key=lambda one: one.position[1])
    for people in out:
        by_id = {one.id: one.position[1] for one in people}
        assert by_id[below.id] < by_id[above.id]


def test_assignment_is_optimal_and_not_greedy():
    """Assigning the nearest pair first would leave the other detection out of reach."""
    follower = tracker(gate=4.0)
    for k in range(10):
        follower.step([person(0.0, 0, at_ns=0), person(0.3, 0, at_ns=0)], k * 100 * MS)
    now = 1000 * MS
    out = follower.step([person(0.16, 0, at_ns=now), person(0.44, 0, at_ns=now)], now)
    assert ids(out) == [1, 2]
    assert not any(one.coasting for one in out)
    assert out[0].position[0] < out[1].position[0]


def test_height_distinguishes_people():
    """Of two people close together, a detection between both is the one of that height."""
    follower = tracker()
    for k in range(20):
        now = k * 100 * MS
        follower.step(
            [person(0, 0, at_ns=now, height=1.5), person(0.4, 0, at_ns=now, height=1.9)], now
        )
    out = follower.step([person(0.2, 0.0, at_ns=2000 * MS, height=1.9)], 2000 * MS)
    assert [one.coasting for one in out] == [True, False]


# ------------------------------------------------------------------------- births and ends ----


def test_high_score_confirms_a_person_at_once():
    (one,) = tracker(sure_score=2.0, start_time=0.0).step([person(1, 2, at_ns=0, score=2.0)], 0)
    assert one.id == 1
    np.testing.assert_array_equal(one.velocity, (0, 0))
    np.testing.assert_allclose(one.velocity_covariance, 0.8**2 * np.eye(2))


def test_low_score_confirms_a_person_after_birth_time():
    follower = tracker(sure_score=3.0, birth_score=0.5, birth_time=0.25, start_time=0.0)
    reported = [
        follower.step([person(1, 2, at_ns=k * 100 * MS, score=1.0)], k * 100 * MS) for k in range(6)
    ]
    assert [len(people) for people in reported] == [0, 0, 0, 1, 1, 1]
    assert reported[-1][0].age_s == pytest.approx(0.5)


def test_at_the_start_all_detections_are_new_people():
    follower = tracker(birth_score=0.5, start_time=0.35, birth_time=0.2)
    for k in range(4):
        out = follower.step([person(5.0 * i, 0, at_ns=0, score=1.0) for i in range(k + 1)], k * MS)
        assert ids(out) == list(range(1, k + 2))
    found = [person(5.0 * i, 0, at_ns=0, score=1.0) for i in range(5)]
    assert ids(follower.step(found, 500 * MS)) == [1, 2, 3, 4]
    assert ids(follower.step(found, 700 * MS)) == [1, 2, 3, 4, 5]


@pytest.mark.parametrize(("score", "people"), [(1.0, 1), (0.9, 0)])
def test_detection_below_birth_score_is_nobody_even_at_the_start(score, people):
    assert len(tracker().step([person(0, 0, at_ns=0, score=score)], 0)) == people


def test_detection_is_of_a_person_rather_than_of_what_may_become_one():
    """One at 0, what is no person yet at 0.6 m, and then a single detection between them."""
    follower = tracker(start_time=0.0, birth_time=9.0, sure_score=6.0)
    for k in range(10):
        now = k * 100 * MS
        found = [person(0, 0, at_ns=now, score=8.0), person(0.6, 0, at_ns=now, score=2.0)]
        assert ids(follower.step(found, now)) == [1]
    (one,) = follower.step([person(0.4, 0, at_ns=1000 * MS, score=4.0, sigma=0.2)], 1000 * MS)
    assert not one.coasting


@pytest.mark.parametrize(("speed", "coasting"), [(1.8, 1), (2.2, 0)])
def test_track_that_is_too_fast_for_a_person_does_not_coast(speed, coasting):
    """Detections of several people in turn, as where images come once a second."""
    follower = tracker(max_speed=2.0)
    follow(follower, lambda t: [(speed * t, 0.0)], steps=30, noise=0.0)
    assert len(follower.step([], 3000 * MS)) == coasting


def test_flickering_detection_starts_no_track():
    follower = tracker(sure_score=3.0, doubt_time=0.1, start_time=0.0)
    for k in range(40):
        found = [person(1, 2, at_ns=0, score=2.0)] if k % 5 == 0 else []
        assert follower.step(found, k * 100 * MS) == ()


def test_low_score_never_confirms_a_person():
    follower = tracker(birth_score=0.5, doubt_score=0.0, start_time=0.0)
    for k in range(100):
        assert follower.step([person(1, 2, at_ns=0, score=0.3)], k * 100 * MS) == ()


def test_track_with_fading_evidence_is_terminated():
    follower = tracker(keep_score=-1.0, evidence_time=0.5)
    lengths = [
        len(follower.step([person(1, 2, at_ns=0, score=4.0 if k < 10 else -3.0)], k * 100 * MS))
        for k in range(40)
    ]
    assert lengths[:10] == [1] * 10
    assert lengths[-1] == 0


def hidden_between(begin, end, speed=0.5):
    def ways(t):
        return [(speed * t, 0.0) if not begin <= t < end else (np.nan, np.nan)]

    return ways


def a_pair_walks(follower, *, hidden_s, sees, turn_s=math.inf, speed=0.5):
    """Two people of one group; the second is not found from 4 s on, and they turn left together."""
    follower.group_of = {1: 7, 2: 7}
    out = []
    for step in range(40 + round(10 * hidden_s)):
        t = step / 10.0
        x, y = speed * min(t, turn_s), speed * max(t - turn_s, 0.0)
        found = [person(x, y, at_ns=step * 100 * MS)]
        if t < 4.0:
            found.append(person(x, y + 1.0, at_ns=step * 100 * MS))
        out.append(
            follower.step(found, step * 100 * MS, lambda xy, _all, _own: np.full(len(xy), sees))
        )
    return out, np.array([x, y + 1.0])


def test_hidden_member_of_a_group_walks_on_with_it():
    follower = tracker(hidden_time=8.0, coast_share=10.0)
    out, place = a_pair_walks(follower, hidden_s=6.0, sees=False, turn_s=5.0)
    assert ids(out[-1]) == [1, 2]
    hidden = out[-1][1]
    assert hidden.coasting
    # It turns later, by `adapt_s` and the lag of the other's filter; straight on it was 3.5 m off.
    assert math.dist(hidden.position, place) < 0.6
    assert hidden.covariance[0, 0] > 4 * out[39][1].covariance[0, 0]
    speed_of_the_other = out[-1][0].velocity
    np.testing.assert_allclose(hidden.velocity, speed_of_the_other, atol=0.05)


@pytest.mark.parametrize(
    ("change", "sees", "hidden_s", "lasts"),
    [
        ({}, False, 7.8, True),
        ({}, False, 8.3, False),  # hidden_time is over
        ({}, True, 0.8, True),
        ({}, True, 1.3, False),  # in view: coast_time
        ({"hidden_time": 0.0}, False, 1.3, False),
        ({"coast_share": 0.5}, False, 1.9, True),  # it was seen for 4 s
        ({"coast_share": 0.5}, False, 2.3, False),
    ],
)
def test_hidden_member_lasts_for_the_hidden_time(change, sees, hidden_s, lasts):
    follower = tracker(**{"hidden_time": 8.0, "coast_share": 10.0, **change})
    out, _ = a_pair_walks(follower, hidden_s=hidden_s, sees=sees)
    assert (2 in ids(out[-1])) == lasts


def test_who_has_not_been_seen_for_long_is_hidden_with_where_they_were():
    follower = tracker(hidden_time=8.0, coast_share=10.0, in_view_time=0.4)
    out, _ = a_pair_walks(follower, hidden_s=2.0, sees=False)
    second = [people[1] for people in out[10:]]
    # Last seen at 3.9 s.
    assert [one.seen_at is not None for one in second] == [k > 43 for k in range(10, 60)]
    assert second[-1].seen_at.tolist() == [0.5 * 3.9, 1.0]
    assert second[-1].stamp_ns == 3900 * MS
    assert all(people[0].seen_at is None for people in out)


def test_hidden_member_is_where_no_robot_looks():
    """They are last seen at y = 1 m. In plain view up to y = 0.9 m, they would be found there."""
    out = {}
    for border in (-math.inf, 0.9):

        def sees(xy, _people, _own, border=border):
            return xy[:, 1] < border

        follower = tracker(hidden_time=8.0, coast_share=10.0)
        a_pair_walks(follower, hidden_s=0.1, sees=False)
        for step in range(41, 70):
            now = step * 100 * MS
            found = [person(0.05 * step, 0.0, at_ns=now)]
            people = follower.step(found, now, sees)
        assert ids(people) == [1, 2]
        out[border] = people[1]
    anywhere, beyond = out.values()
    assert anywhere.position[1] == pytest.approx(1.0, abs=0.05)
    sigma = math.sqrt(anywhere.covariance[1, 1])
    assert 0.3 * sigma < beyond.position[1] - anywhere.position[1] < 1.5 * sigma
    assert beyond.covariance[1, 1] < 0.8 * anywhere.covariance[1, 1]
    assert beyond.position[0] == pytest.approx(anywhere.position[0], abs=0.02)


def test_hidden_member_is_moved_off_walls():
    """Last seen at y = 1 m, at a wall that comes to y = 1.3 m, they slide along it."""
    follower = tracker(hidden_time=8.0, coast_share=10.0)
    a_pair_walks(follower, hidden_s=0.1, sees=False)
    for step in range(41, 60):
        now = step * 100 * MS
        found = [person(0.05 * step, 0.0, at_ns=now)]
        people = follower.step(
            found, now, lambda xy, _all, _own: np.zeros(len(xy), dtype=bool),
            lambda xy: np.maximum(xy, (-np.inf, 1.3)),
        )  # fmt: skip
    assert ids(people) == [1, 2]
    assert people[0].position[1] == pytest.approx(0.0, abs=0.1)  # who is seen is where they are
    assert people[1].position[1] == pytest.approx(1.3, abs=0.01)
    assert people[1].position[0] == pytest.approx(0.05 * 59, abs=0.1)


@pytest.mark.parametrize("alone", ["another group", "far", "stands"])
def test_who_does_not_walk_with_a_group_is_not_kept(alone):
    follower = tracker(hidden_time=8.0, coast_share=10.0)
    speed = 0.0 if alone == "stands" else 0.5
    out, _ = a_pair_walks(follower, hidden_s=0.5, sees=False, speed=speed)
    assert ids(out[-1]) == [1, 2]
    if alone == "another group":
        follower.group_of = {1: 7, 2: 8}
    off = 5.0 if alone == "far" else 0.0
    for step in range(45, 60):
        now, x = step * 100 * MS, speed * step / 10.0 + off
        out = follower.step(
            [person(x, 0.0, at_ns=now)], now, lambda xy, _all, _own: np.zeros(len(xy), dtype=bool)
        )
    assert 2 not in ids(out)


def test_hidden_person_who_comes_out_elsewhere_keeps_their_id():
    follower = tracker(hidden_time=8.0, coast_share=10.0, sure_score=3.0)
    out, place = a_pair_walks(follower, hidden_s=4.0, sees=False)
    assert ids(out[-1]) == [1, 2]
    for step in range(80, 84):
        now, there = step * 100 * MS, (0.05 * step, 0.0)
        found = [person(*there, at_ns=now), person(place[0], place[1] + 1.4, at_ns=now)]
        out = follower.step(found, now, lambda xy, _all, _own: np.zeros(len(xy), dtype=bool))
    assert ids(out) == [1, 2]
    assert not out[1].coasting
    assert out[1].position[1] == pytest.approx(place[1] + 1.4, abs=0.2)


def test_motion_in_company_equals_small_steps_of_its_equation():
    """dv = (u - v) / tau dt + noise, dx = v dt, with the noise of the lone motion."""
    t, acceleration, adapt_s, steps = 0.7, 0.6, 0.5, 20000
    move, noise, shift = _Motion.in_company(t, acceleration, adapt_s)
    dt = t / steps
    small = np.array([[1.0, dt], [0.0, 1.0 - dt / adapt_s]])
    pull = np.array([0.0, dt / adapt_s])
    x, p, one = np.zeros(2), np.zeros((2, 2)), np.eye(2)
    for _ in range(steps):
        x, p, one = small @ x + pull, small @ p @ small.T, small @ one
        p[1, 1] += acceleration**2 * dt
    along = np.ix_([0, 2], [0, 2])
    np.testing.assert_allclose(move[along], one, atol=1e-4)
    np.testing.assert_allclose(noise[along], p, rtol=1e-3)
    np.testing.assert_allclose(shift, x, atol=1e-4)
    lone = _Motion.in_company(t, acceleration, 1e3)
    np.testing.assert_allclose(lone.noise, _Motion.alone(t, acceleration).noise, rtol=1e-2)


def test_occluded_person_coasts_at_constant_velocity():
    out = follow(tracker(coast_time=1.5), hidden_between(3.0, 4.0), steps=60)
    assert all(ids(people) == [1] for people in out)
    assert [people[0].coasting for people in out] == [30 <= k < 40 for k in range(60)]
    hidden = out[39][0]
    assert math.dist(hidden.position, (0.5 * 3.9, 0.0)) < 0.35
    assert hidden.robots == ()
    assert hidden.label == -1
    assert hidden.covariance[0, 0] > 4 * out[29][0].covariance[0, 0]
    assert hidden.height == pytest.approx(1.7)


def test_long_occlusion_ends_a_track_and_return_restores_its_id():
    follower = tracker(coast_time=1.0, memory=5.0, sure_score=6.0)
    out = follow(follower, hidden_between(3.0, 5.5), steps=80)
    assert [len(people) for people in out[30:58]] == [1] * 10 + [0] * 17 + [1]
    assert {one.id for people in out for one in people} == {1}
    assert out[-1][0].age_s == pytest.approx(7.9)


@pytest.mark.parametrize(("off", "who"), [(0.29, 1), (0.6, 2)])
def test_detection_within_a_body_width_is_assigned_for_any_covariance(off, who):
    follower = tracker()
    for step in range(20):
        follower.step([person(0, 0, at_ns=step * 100 * MS)], step * 100 * MS)
    for step in range(20, 25):  # 0.3 m is more than four times sqrt(0.04^2 + 0.03^2) m
        out = follower.step([person(off, 0, at_ns=step * 100 * MS, score=8.0)], step * 100 * MS)
        assert out[-1].id == who


def test_person_hidden_again_after_a_return_is_remembered():
    def ways(t):
        hidden = 3.0 <= t < 5.45 or 5.75 < t < 6.45
        return [(np.nan, np.nan) if hidden else (0.4 * t, 0.0)]

    out = follow(tracker(coast_time=1.0, memory=5.0, sure_score=6.0), ways, steps=80)
    assert [len(people) for people in out[55:68]] == [0, 0, 1, *[1] * 7, 1, 1, 1]
    assert {one.id for people in out for one in people} == {1}


def test_return_after_memory_or_from_elsewhere_gets_a_new_id():
    late = follow(tracker(coast_time=1.0, memory=2.0), hidden_between(3.0, 5.5), steps=80)
    assert ids(late[-1]) == [2]

    def elsewhere(t):
        return [(0.0, 0.0) if t < 3 else (np.nan, np.nan) if t < 5 else (9.0, 9.0)]

    assert ids(follow(tracker(), elsewhere, steps=80)[-1]) == [2]


def test_of_several_lost_people_the_likeliest_returns():
    """One was lost long ago 3.4 m away, with a large covariance; the other just now, 0.4 m away."""
    follower = tracker(coast_time=0.5, memory=10.0)
    for k in range(150):
        now = k * 100 * MS
        places = [(0.0, 0.0)] if k < 60 else []
        places += [(3.0, 0.0)] if k < 120 else []
        follower.step([person(*place, at_ns=now) for place in places], now)
    for k in range(150, 155):
        out = follower.step([person(3.4, 0.0, at_ns=k * 100 * MS)], k * 100 * MS)
    assert ids(out) == [2]


@pytest.mark.parametrize(("height", "who"), [(1.9, 1), (1.5, 2)])
def test_of_two_lost_people_the_one_of_the_same_height_returns(height, who):
    """Half a metre from where each of them was lost."""
    follower = tracker()
    for k in range(20):
        now = k * 100 * MS
        tall, small = person(0, 0, at_ns=now, height=1.9), person(1, 0, at_ns=now, height=1.5)
        assert ids(follower.step([tall, small], now)) == [1, 2]
    now = 3500 * MS
    assert follower.step([], now) == ()
    assert ids(follower.step([person(0.5, 0, at_ns=now, score=8.0, height=height)], now)) == [who]


@pytest.mark.parametrize(("returned_ms", "who"), [(3900, 1), (4100, 2)])
def test_memory_is_bounded_by_the_time_of_observation(returned_ms, who):
    """2 s here: who was not seen for longer is new."""
    follower = tracker(memory=10.0)
    for k in range(21):
        follower.step([person(0, 0, at_ns=k * 100 * MS)], k * 100 * MS)
    assert follower.step([], 3500 * MS) == ()
    now = returned_ms * MS
    assert ids(follower.step([person(0, 0, at_ns=now, score=8.0)], now)) == [who]


def test_return_faster_than_max_speed_gets_a_new_id():
    """Lost for 8 s at 1.5 m/s, the prediction is 12 m ahead; 17 m is too far."""
    for reached, wanted in ((12.0, 1), (17.5, 2)):
        follower = tracker(memory=10.0, gate=20.0)
        for k in range(100):
            follower.step([person(0.15 * k, 0, at_ns=k * 100 * MS)], k * 100 * MS)
        x = 0.15 * 99 + reached
        for k in range(179, 184):
            out = follower.step([person(x, 0, at_ns=k * 100 * MS)], k * 100 * MS)
        assert ids(out) == [wanted]


def test_coasting_is_bounded_by_the_time_of_observation():
    follower = tracker(coast_share=0.5, doubt_time=0.0)
    follower.step([person(0, 0, at_ns=0)], 0)
    follower.step([person(0, 0, at_ns=0)], 400 * MS)
    assert len(follower.step([], 500 * MS)) == 1
    assert len(follower.step([], 600 * MS)) == 1
    assert len(follower.step([], 700 * MS)) == 0


def test_ids_never_repeat():
    follower = tracker(memory=0.0, coast_time=0.0)
    seen = []
    for k in range(30):
        found = [person(5.0 * (k % 3), 0, at_ns=0, score=9.0)] if k % 2 else []
        out = follower.step(found, k * 100 * MS)
        seen += ids(out)
    assert seen == sorted(set(seen))
    assert len(seen) == 15


def test_where_there_is_no_room_the_likeliest_are_followed():
    follower = tracker(max_tracks=2)
    found = [person(x, 0, at_ns=0, score=score) for x, score in ((0, 2), (3, 7), (6, 4))]
    people = follower.step(found, 0)
    assert sorted(one.position[0] for one in people) == [3.0, 6.0]
    assert follower.turned_away == 1


def test_state_is_bounded():
    follower = tracker(max_tracks=10)
    rng = np.random.default_rng(0)
    for k in range(50):
        now = k * 100 * MS
        found = [person(*place, at_ns=now) for place in rng.uniform(-50, 50, (30, 2))]
        assert len(follower.step(found, now)) <= 10
        held = len(follower._tracks) + len(follower._lost)
        assert held <= 20
    assert follower.turned_away > 0


# ------------------------------------------------------------------------------------ time ----


def test_variance_of_an_unobserved_person_is_bounded():
    follower = tracker(acceleration=0.5, any_velocity=0.8)
    follower.step([person(0, 0, at_ns=0, sigma=0.2)], 0)
    # After 1 s: 0.2^2 + 0.8^2 + 0.5^2 / 3 m^2. After a minute it would be 20304 m^2.
    for after_s, variance in ((1, 0.04 + 0.64 + 0.25 / 3), (60, 25.0)):
        (covariance,) = follower.expect(after_s * 1000 * MS).covariance
        np.testing.assert_allclose(covariance, variance * np.eye(2), atol=1e-12)


def test_late_scan_at_the_same_time_ages_and_loses_no_track():
    """The scan of a late robot arrives by itself: no track ages, none is lost."""
    follower = tracker(start_time=0.0)
    follow(follower, lambda t: [(1.0, 0.0), (3.0, 0.0)], steps=10)
    before = follower.step([person(1, 0, at_ns=0), person(3, 0, at_ns=0)], 1000 * MS)
    after = follower.step([person(3, 0, at_ns=0, robots=("b",))], 1000 * MS)
    assert ids(before) == ids(after) == [1, 2]
    assert [one.age_s for one in before] == [one.age_s for one in after]
    assert [one.coasting for one in after] == [True, False]
    assert [(one.robots, one.label) for one in after] == [((), -1), (("b",), 0)]
    assert after[1].covariance[0, 0] < before[1].covariance[0, 0]
    assert follower.jumps_back == 0


def test_zero_and_infinite_covariances_are_handled():
    """A cluster of one cell has no extent; poses may have infinite variances."""
    follower = tracker()
    for k in range(5):
        now = k * 100 * MS
        sure = person(1, 0, at_ns=now, covariance=np.zeros((2, 2)))
        unsure = person(5, 0, at_ns=now, covariance=np.full((2, 2), np.inf))
        out = follower.step([sure, unsure], now)
    assert ids(out) == [1, 2]
    assert all(np.isfinite(one.covariance).all() for one in out)
    assert not out[0].coasting


@pytest.mark.parametrize("back_s", [1.1, 100.0])
def test_jump_back_of_time_resets_all_tracks(back_s):
    """A clock that is set, or a bag that restarts, even if people have not moved."""
    follower = tracker()
    offset = 200_000 * MS
    for k in range(20):
        follower.step([person(1, 1, at_ns=0), person(3, 1, at_ns=0)], offset + k * 100 * MS)
    # Seen as before, somebody else, and nobody where the second one was: no ghost of them is left.
    start = offset + 1900 * MS - round(back_s * 1e9)
    for k in range(20):
        now = start + k * 100 * MS
        assert len(follower.expect(now)) == (2 if k else 0)
        out = follower.step([person(1, 1, at_ns=now), person(9, 1, at_ns=now)], now)
        assert ids(out) == [3, 4]  # from the first interval on, as in the beginning
        assert not any(one.coasting for one in out)
    assert follower.jumps_back == 1
    assert out[0].age_s == pytest.approx(1.9)


def test_time_set_back_by_a_second_loses_no_track():
    follower = tracker()
    for now in [*range(0, 2001, 100), *range(1000, 3001, 100)]:
        out = follower.step([person(1, 1, at_ns=now * MS)], now * MS)
        assert ids(out) == [1]
    assert follower.jumps_back == 0
    assert out[0].age_s == pytest.approx(3.0)


def test_late_scans_do_not_set_the_time_back():
    """One robot's scans every 0.1 s, another's after them, 50 ms older; a person walks at 1 m/s."""
    follower = tracker()
    for k in range(100):
        now, late = k * 100 * MS, k * 100 * MS - 50 * MS
        (one,) = follower.step([person(0.1 * k, 0, at_ns=now)], now)
        (other,) = follower.step([person(0.1 * k - 0.05, 0, at_ns=late)], late)
    assert follower.jumps_back == 0
    assert one.age_s == other.age_s == pytest.approx(9.9)
    assert one.velocity is not None
    assert one.velocity[0] == pytest.approx(1.0, abs=0.01)
    assert one.position[0] == pytest.approx(9.9, abs=0.01)
    assert other.position[0] == pytest.approx(9.85, abs=0.01)  # where they were at that time


def test_results_already_returned_do_not_change():
    follower = tracker()
    follow(follower, lambda t: [(1.0, 0.0)], steps=5)
    (before,) = follower.step([person(1, 0, at_ns=500 * MS)], 500 * MS)
    x, y = before.position
    follower.step([person(1.1, 0, at_ns=500 * MS)], 500 * MS)
    assert tuple(before.position) == (x, y)


def test_missing_intervals_lose_no_standing_person():
    follower = tracker()
    follow(follower, lambda t: [(1.0, 1.0), (2.0, 1.0)], steps=30)
    out = follower.step([person(1, 1, at_ns=5000 * MS), person(2, 1, at_ns=5000 * MS)], 5000 * MS)
    assert ids(out) == [1, 2]


def test_late_scan_updates_the_position_at_its_own_time():
    """A person at 1 m/s is observed 0.1 s before the interval: the result is for its time."""
    follower = tracker()
    for k in range(60):
        now = k * 100 * MS
        (one,) = follower.step([person(0.1 * k - 0.1, 0, at_ns=now - 100 * MS)], now)
    assert one.position[0] == pytest.approx(5.9, abs=0.01)


# -------------------------------------------------------------------------------- expected ----


def test_expected_positions_are_extrapolated():
    follower = tracker()
    assert len(follower.expect(0)) == 0
    follow(follower, lambda t: [(0.5 * t, 0.0), (5.0, 5.0)], steps=40, noise=0.0)
    expected = follower.expect(4400 * MS)
    np.testing.assert_allclose(expected.xy, [(2.2, 0.0), (5.0, 5.0)], atol=0.02)
    assert (expected.covariance[:, 0, 0] > SIGMA**2 / 4).all()
    (one, _) = follower.step([], 3900 * MS)
    assert one.position[0] == pytest.approx(1.95, abs=0.02)  # it stayed as it was


def test_nearest_expected_person_within_gate_and_reach_is_found():
    expected = Expected(
        np.array([(0.0, 0.0), (1.0, 0.0)]), np.tile(0.01 * np.eye(2), (2, 1, 1)),
        np.array([1, 2]), np.array([False, False]),
    )  # fmt: skip
    xy = np.array([(0.1, 0.0), (0.9, 0.1), (0.5, 3.0), (0.45, 0.0)])
    covariance = np.tile(0.01 * np.eye(2), (4, 1, 1))
    assert expected.near(xy, covariance, gate=4.0, reach=1.0).tolist() == [0, 1, -1, 0]
    assert NOBODY.near(xy, covariance, gate=4.0, reach=1.0).tolist() == [-1] * 4
    assert expected.near(np.empty((0, 2)), np.empty((0, 2, 2)), gate=4.0, reach=1.0).tolist() == []


def test_parameters_may_change_at_any_time():
    follower = tracker()
    follow(follower, lambda t: [(1.0, 1.0)], steps=10)
    follower.config = tracker(coast_time=0.0).config
    assert follower.step([], 1000 * MS) == ()


def test_order_of_detections_does_not_matter():
    places = [(0.0, 0.0), (0.5, 0.1), (0.2, 0.6)]
    results = []
    for order in itertools.permutations(range(3)):
        follower = tracker()
        for k in range(12):
            now = k * 100 * MS
            found = [person(places[i][0] + 0.02 * k, places[i][1], at_ns=now) for i in order]
            out = follower.step(found, now)
        results.append(sorted(tuple(one.position.round(9)) for one in out))
    assert all(result == results[0] for result in results)

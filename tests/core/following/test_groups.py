"""Groups: who walks together, stragglers without flicker, splits and merges, and what is said."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mrs_people_loc import config as cfg
from mrs_people_loc.following.groups import Groups
from mrs_people_loc.people import Person, gather

MS = 1_000_000
NOWHERE = (math.nan, math.nan)


def person(who, x, y, *, v=(0.0, 0.0), age_s=10.0, coasting=False, sigma=0.05):
    return Person(
        np.array([x, y], dtype=float), np.eye(2) * sigma**2, 1.7, 0.1, ("a",), 0,
        id=who, velocity=np.array(v, dtype=float), velocity_covariance=0.01 * np.eye(2),
        age_s=age_s, coasting=coasting,
    )  # fmt: skip


def groups_with(**changes) -> Groups:
    return Groups(cfg.PlannerConfig.from_mapping({"groups": changes}).groups)


class Run:
    """Groups over time: people are where `ways` says, by id; NaN: not followed."""

    def __init__(self, groups: Groups | None = None, dt_ms: int = 100) -> None:
        self.groups = groups or groups_with()
        self.dt_ms, self.now_ns, self.ages = dt_ms, 0, {}
        self.reported: list[tuple[float, str]] = []
        self.out: list[tuple] = []

    def go(self, ways, seconds, *, coasting=(), noise=0.0):
        rng = np.random.default_rng(1)
        begin = self.now_ns
        while self.now_ns < begin + seconds * 1e9:
            t = (self.now_ns - begin) / 1e9
            places, later = ways(t), ways(t + 1e-3)
            people = []
            for who, place in sorted(places.items()):
                if not np.isfinite(place).all():
                    continue
                self.ages[who] = self.ages.get(who, -self.dt_ms / 1000) + self.dt_ms / 1000
                v = (np.array(later[who]) - place) / 1e-3
                at = np.array(place) + rng.normal(0, noise, 2)
                people.append(person(who, *at, v=v, age_s=self.ages[who], coasting=who in coasting))
            out, events = self.groups.step(people, self.now_ns)
            self.out.append(out)
            self.reported += [(self.now_ns / 1e9, event) for event in events]
            self.now_ns += self.dt_ms * MS
        return self

    @property
    def events(self) -> list[str]:
        return [event for _, event in self.reported]

    @property
    def last(self) -> dict[int, tuple[int, ...]]:
        return {group.id: group.members for group in self.out[-1]}

    def away(self, who) -> list[bool]:
        """Whether somebody is a straggler, step by step."""
        return [any(who in group.stragglers for group in out) for out in self.out]


def standing(**places):
    """People who stand: `p1=(x, y)` and so on."""
    fixed = {int(name[1:]): place for name, place in places.items()}
    return lambda t: fixed


# --------------------------------------------------------------------------------- figures ----


def test_centre_velocity_and_spread_match_hand_computed_values():
    people = [
        person(4, 0, 0, v=(1, 0)), person(2, 2, 0, v=(0, 1)), person(9, 1, 3, v=(0.5, 0.5)),
    ]  # fmt: skip
    group = gather(people)
    assert group is not None
    np.testing.assert_allclose(group.centre, (1, 1))
    np.testing.assert_allclose(group.covariance, np.eye(2) * 0.05**2 / 3)
    np.testing.assert_allclose(group.velocity, (0.5, 0.5))
    np.testing.assert_allclose(group.velocity_covariance, np.eye(2) * 0.01 / 3)
    assert group.radius == pytest.approx(2.0)
    assert group.rms_spread == pytest.approx(math.sqrt((2 + 2 + 4) / 3))
    assert group.size == 3
    assert group.members == (2, 4, 9)


def test_group_of_untracked_people_has_no_velocity():
    one = Person(np.zeros(2), np.eye(2), 1.7, 0.1, ("a",), 0)
    group = gather([one, one])
    assert group is not None
    assert group.velocity is None
    assert group.velocity_covariance is None
    assert group.members == ()
    assert gather([]) is None


# ---------------------------------------------------------------------------------- groups ----


def test_no_people_form_no_group():
    assert groups_with().step([], 0) == ((), ())


def test_people_present_at_the_start_form_one_group():
    run = Run().go(standing(p1=(0, 0), p2=(1, 0), p3=(2, 0), p4=(9, 0)), 1.0)
    assert [set(out[0].members) for out in run.out] == [{1, 2, 3}] * 10
    assert {group.id for out in run.out for group in out} == {1, 2}
    assert run.last == {1: (1, 2, 3), 2: (4,)}
    assert run.events == []


def test_chain_of_people_is_one_group():
    run = Run().go(standing(p1=(0, 0), p2=(2, 0), p3=(4, 0), p4=(6, 0)), 1.0)
    assert run.last == {1: (1, 2, 3, 4)}
    assert run.out[-1][0].radius == pytest.approx(3.0)


def test_person_who_walks_with_a_group_for_join_time_joins_it():
    run = Run(groups_with(join_time=2.0))
    run.go(standing(p1=(0, 0), p2=(1, 0)), 3.0)
    run.go(standing(p1=(0, 0), p2=(1, 0), p5=(1, 1)), 3.0)
    assert run.last == {1: (1, 2, 5)}
    assert [event for event in run.reported if event[0] < 4.9] == []
    assert run.events == ["person 5 joins group 1"]


@pytest.mark.parametrize(
    ("gap", "coasting", "members"),
    [
        (2.0, (), {1: (1, 2, 3)}),
        (2.3, (), {1: (1, 2), 2: (3,)}),  # 2.5 m less a margin of 0.4 m is 2.1 m
        (2.0, (3,), {1: (1, 2), 2: (3,)}),  # where they are predicted is no sign
    ],
)
def test_only_who_is_seen_near_a_group_joins_it(gap, coasting, members):
    run = Run().go(standing(p1=(0, 0), p2=(1, 0)), 3.0)
    run.go(standing(p1=(0, 0), p2=(1, 0), p3=(1 + gap, 0)), 4.0, coasting=coasting)
    assert run.last == members


def test_passing_stranger_joins_no_group():
    def ways(t):
        walking = 0.8 * t
        return {
            1: (walking, 0.0), 2: (walking - 1, 0.5), 3: (walking - 2, 0.0),
            7: (20 - 1.2 * t, 1.0),
        }  # fmt: skip

    run = Run().go(ways, 20.0)
    assert run.events == []
    assert run.last[1] == (1, 2, 3)
    assert not any(run.away(7))


# ------------------------------------------------------------------------------ stragglers ----


def falling_behind(speed=1.0, until=60.0):
    """Three walk at 1 m/s; the third stands from 3 s on, until the others wait for them."""

    def ways(t):
        ahead = min(t, until) * speed
        return {1: (ahead, 0.0), 2: (ahead, 1.0), 3: (min(ahead, 3.0 * speed), 0.5)}

    return ways


def nearest_other(ways, who, t) -> float:
    places = {k: np.array(v) for k, v in ways(t).items()}
    return min(math.dist(places[who], place) for k, place in places.items() if k != who)


def test_straggler_is_flagged_within_a_second_of_crossing_the_limit():
    ways = falling_behind()
    run = Run(groups_with(distance=2.5, leave_time=0.5)).go(ways, 12.0)
    crossed = next(k for k in range(120) if nearest_other(ways, 3, k / 10) > 2.5)
    reported = run.away(3)
    assert not any(reported[:crossed])
    first = reported.index(True)
    assert 0.4 <= (first - crossed) / 10 < 1.0
    assert all(reported[first:])
    assert run.events == ["person 3 has fallen behind or left group 1"]
    group = next(group for group in run.out[-1] if group.id == 1)
    assert group.members == (1, 2)
    assert group.stragglers[3] == pytest.approx(0.5 + (119 - first) / 10)


@pytest.mark.parametrize(("together_s", "straggler"), [(1.0, False), (3.0, True)])
def test_only_who_was_a_member_for_join_time_is_a_straggler(together_s, straggler):
    """2 s, of which the time until it is noticed that they left, 0.5 s, is a part."""
    run = Run().go(standing(p1=(0, 0), p2=(1, 0), p3=(2, 0)), together_s)
    run.go(standing(p1=(0, 0), p2=(1, 0), p3=(20, 0)), 3.0)
    assert run.last == {1: (1, 2), 2: (3,)}
    assert run.away(3)[-1] == any(run.away(3)) == straggler
    assert run.events == ["person 3 has fallen behind or left group 1"] * straggler


def test_returning_straggler_is_unflagged():
    def ways(t):
        ahead = min(t, 8.0)
        third = 3.0 if 3 < t < 10 else t if t <= 3 else min(3.0 + 1.2 * (t - 10), 7.0)
        return {1: (ahead, 0.0), 2: (ahead, 1.0), 3: (third, 0.5)}

    run = Run().go(ways, 20.0)
    assert run.last == {1: (1, 2, 3)}
    assert run.out[-1][0].stragglers == {}
    assert len(run.events) == 2
    assert "person 3 is back with group 1 after" in run.events[1]


@pytest.mark.parametrize("seed", range(5))
def test_person_at_the_limit_raises_no_repeated_events(seed):
    """A person stands at the limit for a minute, with detection errors of 10 cm."""
    rng = np.random.default_rng(seed)
    groups, reported = groups_with(distance=2.5), []
    for k in range(600):
        people = [
            person(1, *rng.normal(0, 0.1, 2)), person(2, *rng.normal((0.5, 0.5), 0.1)),
            person(3, *rng.normal((2.5, 0.0), 0.1)),
        ]  # fmt: skip
        out, _ = groups.step(people, k * 100 * MS)
        reported.append(any(3 in group.stragglers for group in out))
    assert np.count_nonzero(np.diff(reported)) <= 1


def test_occluded_person_is_no_straggler_while_possibly_near():
    """The track coasts, 0.5 m/s slower than the group."""

    def ways(t):
        return {1: (t, 0.0), 2: (t, 1.0), 3: (0.3 * t, 0.5)}

    groups = groups_with(distance=2.5)
    for k in range(60):
        t = k / 10
        places = ways(t)
        hidden = t > 2.0
        people = [person(i, *places[i], v=(1, 0), age_s=t) for i in (1, 2)]
        sigma = 0.05 + 0.4 * max(0.0, t - 2.0)
        people.append(person(3, *places[3], v=(0.5, 0), coasting=hidden, sigma=sigma, age_s=t))
        out, _ = groups.step(people, k * 100 * MS)
        assert out[0].members == (1, 2, 3)


def test_member_unseen_for_long_is_reported_missing():
    run = Run(groups_with(missing_time=5.0, forget_time=20.0))
    run.go(standing(p1=(0, 0), p2=(1, 0), p3=(0, 1)), 4.0)
    run.go(standing(p1=(0, 0), p2=(1, 0)), 30.0)
    assert run.events == [
        "person 3 of group 1 has not been seen for 5 s",
        "person 3 has left group 1",
    ]
    reported = run.away(3)
    assert reported.index(True) / 10 == pytest.approx(8.9, abs=0.11)
    assert not reported[-1]


def test_briefly_lost_member_stays_a_member():
    run = Run()
    run.go(standing(p1=(0, 0), p2=(1, 0), p3=(0, 1)), 4.0)
    run.go(standing(p1=(0, 0), p2=(1, 0)), 3.0)
    run.go(standing(p1=(0, 0), p2=(1, 0), p3=(0.5, 1)), 1.0)
    assert run.last == {1: (1, 2, 3)}
    assert run.events == []


def test_occluded_person_still_links_others():
    """The middle one of three people, who are 2 m apart, is not tracked for a while."""
    run = Run(groups_with(missing_time=5.0))
    run.go(standing(p1=(0, 0), p2=(2, 0), p3=(4, 0)), 4.0)
    run.go(standing(p1=(0, 0), p3=(4, 0)), 4.0)
    assert run.last == {1: (1, 3)}
    run.go(standing(p1=(0, 0), p2=(2, 0), p3=(4, 0)), 1.0)
    assert run.last == {1: (1, 2, 3)}
    assert run.events == []
    run.go(standing(p1=(0, 0), p3=(4, 0)), 8.0)  # they do not come back
    assert len(run.out[-1]) == 2


# ----------------------------------------------------------------------- splits and merges ----


def two_halves(t):
    """Four walk together; after 3 s two of them turn off, and come back after 15 s."""
    aside = 0.0 if t < 3 else min(t - 3, 5.0) if t < 15 else max(0.0, 5.0 - (t - 15))
    return {1: (t, 0.0), 2: (t, 0.8), 3: (t, 1.6 + aside), 4: (t, 2.4 + aside), 5: (t, -0.8)}


def test_group_splits_and_merges_and_keeps_its_id():
    run = Run().go(two_halves, 30.0)
    sizes = [tuple(sorted((g.id, g.members) for g in out)) for out in run.out]
    assert sizes[0] == ((1, (1, 2, 3, 4, 5)),)
    assert ((1, (1, 2, 5)), (2, (3, 4))) in sizes
    assert sizes[-1] == ((1, (1, 2, 3, 4, 5)),)
    assert len(set(sizes)) == 2  # nothing in between
    assert run.events[0] == "people 3, 4 split from group 1 as group 2"
    assert all("is back with group 1 after" in event for event in run.events[1:])
    assert len(run.events) == 3


def test_of_two_halves_the_one_of_the_oldest_members_keeps_the_id():
    run = Run().go(standing(p3=(0, 0), p4=(1, 0)), 3.0)
    run.go(standing(p1=(1, 1), p2=(0, 1), p3=(0, 0), p4=(1, 0)), 4.0)
    assert run.last == {1: (1, 2, 3, 4)}
    run.go(standing(p1=(21, 1), p2=(20, 1), p3=(0, 0), p4=(1, 0)), 2.0)
    assert run.last[1] == (3, 4)


def test_two_nearby_groups_merge():
    def ways(t):
        x = 8.0 - min(t, 10.0) * 0.6
        return {1: (0, 0), 2: (0, 1), 3: (1, 0), 6: (x, 0), 7: (x, 1)}

    run = Run().go(ways, 16.0)
    assert run.last == {1: (1, 2, 3, 6, 7)}
    assert run.events == ["group 2 (people 6, 7) merges into group 1"]


def test_missing_members_are_kept_when_groups_merge():
    def ways(t):
        x = 8.0 - min(t, 10.0) * 0.6
        return {1: (0, 0), 2: (0, 1), 3: (1, 0), 6: (x, 0), 7: (x, 1), 8: (x, 2)}

    def hidden(t):
        return {who: place for who, place in ways(t + 8.0).items() if who != 8}

    run = Run(groups_with(missing_time=6.0)).go(ways, 8.0)
    assert len(run.out[-1]) == 2
    run.go(hidden, 10.0)
    assert run.last == {1: (1, 2, 3, 6, 7)}
    assert "group 2 (people 6, 7) merges into group 1" in run.events
    assert run.events[-1] == "person 8 of group 1 has not been seen for 6 s"
    assert list(run.out[-1][0].stragglers) == [8]


def test_ids_of_groups_never_repeat():
    run = Run()
    for k in range(5):
        run.go(lambda t, k=k: {10 * k + 1: (0, 0), 10 * k + 2: (1, 0)}, 1.0)
    assert [out[0].id for out in run.out] == sorted(1 + k // 10 for k in range(50))


def test_jump_back_of_time_resets_all_groups():
    """No previous member is reported missing or as a straggler."""
    run = Run()
    run.go(standing(p1=(0, 0), p2=(1, 0)), 5.0)
    run.now_ns = 0
    for _ in range(100):
        run.go(standing(p3=(0, 0), p4=(1, 0), p5=(2, 0)), 0.1)
        (group,) = run.out[-1]
        assert (group.id, group.members, group.stragglers) == (2, (3, 4, 5), {})
    assert run.events == []


@pytest.mark.slow
def test_state_of_groups_is_bounded():
    """A thousand passers-by leave no state behind."""
    groups = groups_with(missing_time=1.0, forget_time=2.0)
    for k in range(3000):
        people = [person(1, 0, 0), person(2, 1, 0)]
        people += [person(3 + k // 3 + i, 6.0 + 3 * i, 0, age_s=0.0) for i in range(3)]
        groups.step(people, k * 100 * MS)
        assert len(groups._rosters) < 60
    assert groups.step([person(1, 0, 0), person(2, 1, 0)], 3000 * 100 * MS)[0][0].id == 1


def test_parameters_may_change_at_any_time():
    run = Run().go(standing(p1=(0, 0), p2=(1.5, 0)), 3.0)
    run.groups.config = groups_with(distance=1.0, margin=0.1).config
    run.go(standing(p1=(0, 0), p2=(1.5, 0)), 3.0)
    assert len(run.out[-1]) == 2


def test_long_pause_counts_as_one_second_apart():
    run = Run(groups_with(leave_time=3.0)).go(lambda t: {1: (0, 0), 2: (1, 0)}, 1.0)
    run.now_ns += 8_000 * MS
    run.go(lambda t: {1: (0, 0), 2: (9, 0)}, 1.0)
    assert [group.members for group in run.out[-1]] == [(1, 2)]
    run.go(lambda t: {1: (0, 0), 2: (9, 0)}, 2.0)
    assert [group.members for group in run.out[-1]] == [(1,), (2,)]

"""Who is lost, when relative poses of two robots do not fit; who is doubted after a silence."""

import math
from dataclasses import replace

import numpy as np
import pytest

from core.localization.tours import as_walls
from mrs_people_loc.config import Localization
from mrs_people_loc.geometry import rotation_2d, wrap_angle
from mrs_people_loc.localization.filter.observations import (
    Claimed,
    Joined,
    Met,
    PeopleStand,
    WallsSeen,
    pose_from,
)
from mrs_people_loc.localization.filter.team_filter import FilterTuning, TeamFilter
from mrs_people_loc.localization.filter.team_state import TeamState
from mrs_people_loc.localization.odometry import Odometry

S = 1_000_000_000
TRUE = {
    "a": np.array([0.0, 0.0, 0.0]),
    "b": np.array([2.0, 0.5, 0.2]),
    "c": np.array([2.0, -0.5, -0.1]),
}
REFUSED = FilterTuning().lost_after


def standing(second):
    return Odometry(1_000 * S + round(second * S), 0.0, 0.0, 0.0, 0.0, 0.0)


def joined(wrong, own="a"):
    """The filter of a robot, and its state after three have said where they stand, one wrongly."""
    team = TeamFilter(own, Localization())
    state = TeamState()
    for robot, place in TRUE.items():
        said = place + (np.array([1.0, 0.0, 0.0]) if robot == wrong else 0.0)
        covariance = np.diag([1e-4, 1e-4, 1e-5])
        state = team.apply(state, Joined(robot, standing(0), said, covariance))
    return team, state


def met(team, state, pair, begin, count=1, places=TRUE):
    """The state after two robots have met so often, five times a second."""
    relative, *_ = pose_from(places[pair[0]], places[pair[1]])
    for k in range(count):
        now = standing(begin + 0.2 * k)
        covariance = np.diag([0.04**2, 0.04**2, 0.02**2])
        state = team.apply(state, Met(pair[0], now, pair[1], now, relative, covariance))
    return state


def lost(state):
    return {robot for robot, trust in state.trust.items() if trust.times_lost}


def off(state, robot):
    i = state.at(robot)
    return float(np.hypot(*(state.mean[i : i + 2] - TRUE[robot][:2])))


@pytest.mark.parametrize("wrong", ["b", "c"])
@pytest.mark.parametrize("seconds", [1.0, 10.0], ids=["lately", "long ago"])
def test_of_two_team_mates_the_one_that_fitted_nobody_is_lost(wrong, seconds):
    right = "c" if wrong == "b" else "b"
    team, state = joined(wrong)
    state = met(team, state, ("a", right), 1.0)
    state = met(team, state, ("b", "c"), 1.0 + seconds, REFUSED)
    assert lost(state) == {wrong}
    state = met(team, state, ("b", "c"), 3.0 + seconds, 5)
    assert max(off(state, robot) for robot in TRUE) < 0.05


def test_own_robot_is_lost_if_it_alone_fitted_nobody():
    team, state = joined("a")
    state = met(team, state, ("b", "c"), 1.0)
    state = met(team, state, ("a", "b"), 10.0, REFUSED)
    assert lost(state) == {"a"}


@pytest.mark.parametrize("wrong", ["b", "c"])
def test_of_two_unknown_team_mates_none_is_lost_until_one_is_known(wrong):
    right = "c" if wrong == "b" else "b"
    team, state = joined(wrong)
    state = met(team, state, ("b", "c"), 1.0, 3 * REFUSED)
    assert lost(state) == set()
    assert off(state, wrong) == pytest.approx(1.0)
    assert off(state, right) == pytest.approx(0.0, abs=1e-9)
    state = met(team, state, ("a", right), 10.0)
    state = met(team, state, ("b", "c"), 20.0, REFUSED)
    assert lost(state) == {wrong}


def test_of_the_own_robot_and_a_team_mate_that_never_fitted_the_team_mate_is_lost():
    for wrong in ("a", "b"):
        team, state = joined(wrong)
        assert lost(met(team, state, ("a", "b"), 1.0, REFUSED)) == {"b"}


@pytest.mark.parametrize(
    ("wrong", "wall"),
    [("b", (0.0, 1.5, 4.0, 1.5)), ("a", (4.0, -2.0, 4.0, 2.0))],
    ids=["along", "across"],
)
def test_known_wall_confirms_nothing_along_itself(wrong, wall):
    """One of two robots says that it is 1 m farther on; b alone sees the wall, which fits."""
    known = as_walls([wall], (0.02, 0.01))
    _, state = joined(wrong)
    team = TeamFilter("a", Localization(), known)
    x, y, yaw = TRUE["b"]
    seen = (np.reshape(wall, (2, 2)) - (x, y)) @ rotation_2d(yaw)
    state = team.apply(
        state, WallsSeen("b", standing(0.5), as_walls([seen.reshape(-1)], (0.02, 0.01)))
    )
    assert state.sources["b", "known walls"].accepted == 1
    assert lost(met(team, state, ("a", "b"), 1.0, REFUSED)) == {wrong}


@pytest.mark.parametrize("degrees", [25.0, 40.0, -52.0, 65.0])
def test_robot_that_sees_its_wall_turned_was_turned_itself(degrees):
    team, state = joined("")
    wall = np.array([[-3.0, 1.5], [3.0, 1.5]])
    for k in range(6):
        state = team.apply(
            state, WallsSeen("a", standing(0.2 * k), as_walls([wall.reshape(-1)], (0.02, 0.01)))
        )
    assert len(state.walls) == 1
    seen = (wall @ rotation_2d(math.radians(degrees))).reshape(1, 4)
    turned = as_walls(seen, (0.02, 0.01))
    for k in range(REFUSED):
        assert lost(state) == set()
        state = team.apply(state, WallsSeen("a", standing(2.0 + 0.2 * k), turned))
    assert lost(state) == {"a"}


def test_both_are_lost_if_they_fitted_each_other_alone():
    team, state = joined("")
    state = met(team, state, ("b", "c"), 1.0)
    carried = {**TRUE, "b": TRUE["b"] + [0.0, 1.0, 0.0]}
    state = met(team, state, ("b", "c"), 10.0, REFUSED, carried)
    assert lost(state) == {"b", "c"}


def test_team_mate_that_pulled_the_team_far_after_a_silence_is_not_doubted_once_it_agrees():
    """Both have drifted for long; b, which does not hear a, is 0.9 m from where a has it."""
    team, covariance, state = (
        TeamFilter("a", Localization()),
        np.diag([0.25, 0.25, 0.01]),
        TeamState(),
    )
    for robot in "ab":
        state = team.apply(state, Joined(robot, standing(0), TRUE[robot], covariance))

    def refused_after(east, *seconds):
        nonlocal state
        for second in seconds:
            said = TRUE["b"] + (east, 0.0, 0.0)
            state = team.apply(state, Claimed("b", standing(second), said, covariance))
        return state.trust["b"].claims_refused

    assert refused_after(0.0, 0.5) == 0
    assert refused_after(0.9, *np.arange(20.0, 30.0, 0.25)) == 0
    assert off(state, "b") == pytest.approx(0.9, abs=0.05)
    # Nor if it differs by a little, but it is if it differs by much.
    assert refused_after(1.05, *np.arange(30.0, 35.0, 0.25)) == 0
    assert refused_after(1.5, 35.0, 35.25, 35.5) == 3


@pytest.mark.parametrize(("seconds", "doubted"), [(0.8, False), (1.0, True)])
def test_robot_is_doubted_once_its_claims_have_not_fitted_for_a_second(seconds, doubted):
    """Of two filters one closes a loop a moment earlier, and its whole team jumps."""
    team, state = joined("")
    for second in np.arange(2.0, 2.05 + seconds, 0.2):
        said = TRUE["b"] + (1.0, 0.0, 0.0)
        state = team.apply(state, Claimed("b", standing(second), said, np.diag([1.0, 1.0, 0.01])))
        assert state.trust["b"].claims_refused
    assert team.is_refused(state.trust["b"]) == doubted


@pytest.mark.parametrize(("speed", "doubted"), [(0.02, False), (0.1, True)])
def test_filters_may_drift_apart_slowly_for_long(speed, doubted):
    """What b states runs away from where a has it, and pulls a's whole team along."""
    team, covariance, state = (
        TeamFilter("a", Localization()),
        np.diag([1.0, 1.0, 0.01]),
        TeamState(),
    )
    for robot in "ab":
        state = team.apply(state, Joined(robot, standing(0), TRUE[robot], covariance))
    for second in np.arange(0.25, 60.0, 0.25):
        said = TRUE["b"] + (speed * second, 0.0, 0.0)
        state = team.apply(state, Claimed("b", standing(second), said, covariance))
    assert (state.trust["b"].claims_refused > 0) == doubted
    if not doubted:
        assert off(state, "a") > 0.9 * speed * 60.0 - 0.1


def test_claims_move_what_no_known_wall_holds_and_no_known_wall():
    """Else filters that agree with each other would turn the map, and believe it."""
    line = as_walls([(0.0, 1.5, 4.0, 1.5)], (0.02, 0.01))
    team, state = TeamFilter("a", Localization(), line), TeamState()
    for robot in "ab":
        state = team.apply(state, Joined(robot, standing(0), TRUE[robot], np.diag([0.01] * 3)))
    state = team.apply(state, WallsSeen("a", standing(0.1), line))
    assert state.has_map
    before = state
    for second in np.arange(0.25, 5.0, 0.25):
        said = TRUE["b"] + (0.2, 0.1, 0.05)
        state = team.apply(state, Claimed("b", standing(second), said, np.diag([0.01] * 3)))
    assert state.sources["b", "claim"].accepted == 19
    walls = slice(state.wall_at(0), None)
    np.testing.assert_array_equal(state.mean[walls], before.mean[walls])
    a, b = state.at("a"), state.at("b")
    np.testing.assert_allclose(state.mean[a : a + 3], before.mean[a : a + 3], atol=0.001)
    assert np.linalg.norm(state.mean[b : b + 2] - said[:2]) < 0.1
    unsure, as_unsure = (np.sqrt(np.diag(s.covariance)) for s in (state, before))
    np.testing.assert_allclose(unsure, as_unsure, rtol=0.01)


# ------------------------------------------------------------------------------------ found again

#: b is turned by 90 degrees and 3 m from where it was.
CARRIED = {**TRUE, "b": TRUE["b"] + (1.8, -2.4, math.pi / 2)}
PAIRS = ("a", "b"), ("b", "c"), ("a", "c")


def meeting(team, state, seconds, places=TRUE, pairs=PAIRS):
    """The state after these pairs have met at each of these times."""
    for second in seconds:
        for pair in pairs:
            state = met(team, state, pair, second, 1, places)
    return state


def wrong(state, robot, places):
    """What the pose of a robot is wrong by relative to a: shape (3,)."""
    i, k = state.at("a"), state.at(robot)
    said, *_ = pose_from(state.mean[i : i + 3], state.mean[k : k + 3])
    true, *_ = pose_from(places["a"], places[robot])
    return np.array([*(said - true)[:2], wrap_angle(said[2] - true[2])])


def test_robot_that_was_turned_and_carried_is_placed_by_one_relative_pose():
    team, state = joined("")
    state = meeting(team, state, np.arange(1.0, 3.0, 0.8))
    state = meeting(team, state, [4.0], CARRIED)
    assert lost(state) == set()
    before = state.mean[state.at("b") : state.at("b") + 3].copy()
    # It is lost as soon as it is known that it is not the other, and placed by that pose.
    state = meeting(team, state, [4.8], CARRIED)
    assert lost(state) == {"b"}
    assert not state.trust["b"].lost
    assert np.hypot(*(state.mean[state.at("b") :][:2] - before[:2])) == pytest.approx(3.0, abs=0.1)
    np.testing.assert_allclose(wrong(state, "b", CARRIED), 0.0, atol=0.02)
    np.testing.assert_allclose(wrong(state, "c", CARRIED), 0.0, atol=0.02)
    # Not surer than the relative pose; the innocent are as sure as before.
    i = state.at("b")
    assert state.covariance[i, i] < 2 * 0.04**2
    assert np.linalg.eigvalsh(state.covariance)[0] > -1e-12
    state = meeting(team, state, np.arange(5.6, 10.0, 0.8), CARRIED)
    assert {robot: trust.times_lost for robot, trust in state.trust.items()} == {
        "a": 0, "b": 1, "c": 0
    }  # fmt: skip


@pytest.mark.parametrize(("away", "least", "most"), [(1.0, 0.85, 0.95), (4.5, 0.5, 0.7)])
def test_end_of_a_known_wall_counts_the_less_the_flatter_it_is_seen(away, least, most):
    """By how much of 0.25 m a robot is corrected that is 1 m beside a wall, so far from its end."""
    known = replace(as_walls([[0.0, -1.0, 10.0, -1.0]]), is_end=np.array([[True, True]]))
    team, place = TeamFilter("a", Localization(), known), np.array([10.0 - away, 0.0, 0.0])
    told, covariance = place + [0.25, 0.0, 0.0], np.diag([0.3**2, 1e-4, 1e-5])
    state = team.apply(TeamState(), Joined("a", standing(0), told, covariance))
    seen = as_walls([[-2.0, -1.0, away, -1.0]], (0.01, 0.01))
    seen = replace(seen, is_end=np.array([[False, True]]))
    state = team.apply(state, WallsSeen("a", standing(0.1), seen))
    assert least < (told[0] - state.mean[0]) / 0.25 < most


def test_robot_that_was_known_less_surely_is_placed_as_soon_as_it_is_lost():
    """3 m off is seven standard deviations: no odometry is wrong by that three times in a row."""
    team, state = joined("")
    state = meeting(team, state, np.arange(1.0, 3.0, 0.8))
    state = state.widened("b", (0.4, 0.4, 0.4))
    times = 4.0 + 0.8 * np.arange(FilterTuning().refuted_after)
    state = meeting(team, state, times[:-1], CARRIED)
    assert lost(state) == set()
    state = meeting(team, state, times[-1:], CARRIED, pairs=[("a", "b")])
    assert lost(state) == {"b"}
    assert not state.trust["b"].lost
    np.testing.assert_allclose(wrong(state, "b", CARRIED), 0.0, atol=0.02)


@pytest.mark.parametrize(("sigma", "is_recognized"), [(1.0, True), (3.0, False)])
def test_unknown_wall_is_recognized_by_who_knows_about_where_it_is(sigma, is_recognized):
    """A parallel one that nobody has seen yet would fit as well."""
    team, state = joined("")
    ends = np.array([(0.0, 1.5), (4.0, 1.5)])
    by_a, by_b = (
        WallsSeen(robot, standing(second), as_walls([np.ravel(of_robot)], (0.02, 0.01)))
        for robot, second, of_robot in (
            ("a", 1.0, ends),
            ("b", 1.1, (ends - TRUE["b"][:2]) @ rotation_2d(TRUE["b"][2])),
        )
    )
    state = before = team.apply(state, by_a).widened("b", (sigma, sigma, 0.02))
    state = team.apply(state, by_b)
    assert [set(wall.sights) for wall in state.walls] == [{"a", "b"} if is_recognized else {"a"}]
    assert np.array_equal(state.mean, before.mean) != is_recognized


def test_robots_that_fit_each_other_are_not_lost_because_a_third_was_carried():
    team, state = joined("", own="b")
    state = meeting(team, state, np.arange(1.0, 3.0, 0.8))
    state = meeting(team, state, np.arange(4.0, 8.0, 0.8), CARRIED)
    # Also in the filter of the robot that was carried itself.
    assert lost(state) == {"b"}
    np.testing.assert_allclose(wrong(state, "b", CARRIED), 0.0, atol=0.02)


def test_what_only_the_lost_robot_has_seen_is_dropped():
    team, state = joined("")
    state = meeting(team, state, np.arange(1.0, 3.0, 0.8))
    two = np.array([(2.0, 0.4), (2.5, -0.6)]), np.tile(0.01 * np.eye(2), (2, 1, 1))
    for robot in "ab":
        state = team.apply(state, PeopleStand(robot, standing(3.0), two[0], two[1]))
        line = (0.0, 1.5, 4.0, 1.5) if robot == "a" else (-1.0, -2.0, 3.0, -2.0)
        state = team.apply(state, WallsSeen(robot, standing(3.0), as_walls([line], (0.02, 0.01))))
    assert [person.first for person in state.people] == ["a", "a", "b", "b"]
    assert [set(wall.sights) for wall in state.walls] == [{"a"}, {"b"}]
    state = meeting(team, state, [4.0, 4.8], CARRIED)
    assert lost(state) == {"b"}
    assert [person.first for person in state.people] == ["a", "a"]
    assert [set(wall.sights) for wall in state.walls] == [{"a"}]
    assert len(state.mean) == 6 * 3 + 2 * 2 + 2


# ------------------------------------------------------------------------ begins again elsewhere

ELSEWHERE = np.array([40.0, 3.0, 1.0])


def restarted(place=ELSEWHERE, second=4.0):
    """a, b and c have met; then b begins again and says to be at a place."""
    team, state = joined("")
    state = meeting(team, state, np.arange(1.0, 3.0, 0.8))
    covariance = np.diag([0.1**2, 0.1**2, 0.05**2])
    return team, team.apply(state, Joined("b", standing(second), place, covariance))


def test_team_mate_that_begins_again_far_off_is_not_believed():
    team, state = restarted()
    assert state.trust["b"].astray
    others = [state.at(robot) + k for robot in "ac" for k in range(3)]
    before, people, walls = state.mean[others].copy(), state.people, state.walls
    for second in np.arange(4.1, 6.0, 0.25):
        wall = as_walls([(0.0, 1.5, 4.0, 1.5)], (0.02, 0.01))
        seen = np.array([(2.0, 0.4)]), 0.01 * np.eye(2)[np.newaxis]
        for told in (
            WallsSeen("b", standing(second), wall),
            PeopleStand("b", standing(second), *seen),
            Claimed("b", standing(second), ELSEWHERE + (0.5, 0.0, 0.0), np.diag([1e-4] * 3)),
        ):
            state = team.apply(state, told)
    np.testing.assert_array_equal(state.mean[others], before)
    assert (state.people, state.walls) == (people, walls)
    assert state.trust["b"].lost


@pytest.mark.parametrize("pair", [("a", "b"), ("b", "c")])
def test_it_is_believed_once_a_relative_pose_says_where_it_is(pair):
    team, state = restarted()
    state = meeting(team, state, [5.0], pairs=[pair])
    trust = state.trust["b"]
    assert (trust.lost, trust.astray) == (False, False)
    np.testing.assert_allclose(wrong(state, "b", TRUE), 0.0, atol=0.05)
    state = meeting(team, state, np.arange(5.8, 8.0, 0.8))
    assert {robot for robot, trust in state.trust.items() if trust.lost} == set()
    assert not state.trust["a"].times_lost
    assert not state.trust["c"].times_lost
    seen = WallsSeen("b", standing(9.0), as_walls([(0.0, 1.5, 4.0, 1.5)], (0.02, 0.01)))
    assert len(team.apply(state, seen).walls) == len(state.walls) + 1


def test_team_mate_that_begins_again_where_it_was_is_believed():
    _, state = restarted(TRUE["b"] + (0.3, 0.0, 0.0))
    assert "b" not in state.trust
    # So it is where it may have driven to meanwhile.
    _, state = restarted(TRUE["b"] + (20.0, 0.0, 0.0), second=30.0)
    assert "b" not in state.trust

"""Who is lost, when relative poses of two robots do not fit; who is doubted after a silence."""

import numpy as np
import pytest

from mrs_people_loc.config import Localization
from mrs_people_loc.localization.filter.observations import Claimed, Joined, Met, pose_from
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

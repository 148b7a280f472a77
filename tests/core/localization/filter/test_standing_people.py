"""People who stand as landmarks of a robot that is alone."""

import dataclasses

import numpy as np
import pytest

from mrs_people_loc.config import Localization
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.localization.filter.kalman import gates_of
from mrs_people_loc.localization.filter.observations import Joined, PeopleStand
from mrs_people_loc.localization.filter.standing_people import StandingLandmarks, StandingTuning
from mrs_people_loc.localization.filter.team_filter import TeamFilter
from mrs_people_loc.localization.filter.team_state import TeamState
from mrs_people_loc.localization.odometry import Odometry

S = 1_000_000_000
PEOPLE = np.array([(3.0, 0.5), (4.0, -1.5), (2.5, -0.8)])
SIGMA = 0.05
CONFIG = Localization(wheel_sigmas=(0.0, 0.0, 0.0))
GATES = gates_of(CONFIG.gate)


def stands(second=0.0, yaw=0.0):
    """Dead reckoning of a robot that stands, and turns by this [rad]: errors of 0.05 / rad."""
    return Odometry(S + round(second * S), 0.0, 0.0, yaw, 0.0, 0.05**2 * abs(yaw))


def sight(people, odometry, yaw=0.0, robot="a"):
    """What a robot at the origin, turned by this, sees of people in the map, without errors."""
    xy = np.reshape(people, (-1, 2)) @ rotation_2d(yaw)
    return PeopleStand(robot, odometry, xy, np.tile(SIGMA**2 * np.eye(2), (len(xy), 1, 1)))


def joined():
    team = TeamFilter("a", CONFIG)
    return team, team.apply(
        TeamState(), Joined("a", stands(), np.zeros(3), np.diag([1e-4, 1e-4, 1e-4]))
    )


def places(state):
    return state.mean[state.person_at(0) : state.wall_at(0)].reshape(-1, 2)


def test_people_are_added_where_they_are_seen():
    team, state = joined()
    state = team.apply(state, sight(PEOPLE, stands(0.1)))
    np.testing.assert_allclose(places(state), PEOPLE)
    assert [person.first for person in state.people] == ["a"] * 3
    # As sure as the sight, the start's 1 cm, and its 0.01 rad at that distance.
    i = state.person_at(0)
    assert state.covariance[i, i] == pytest.approx(SIGMA**2 + 1e-4 + 0.5**2 * 1e-4)
    assert state.covariance[i + 1, i + 1] == pytest.approx(SIGMA**2 + 1e-4 + 3.0**2 * 1e-4)


def test_robot_that_turns_with_wrong_odometry_is_corrected():
    """A turn of 0.4 rad that its odometry takes for 0.44, in five steps."""
    team, state = joined()
    for k in range(6):
        turn = 0.08 * k
        state = team.apply(state, sight(PEOPLE, stands(0.5 * k, 1.1 * turn), turn))
    assert state.sources["a", "standing people"].accepted == 15
    assert len(state.people) == 3
    sigma = np.sqrt(state.covariance[2, 2])
    assert state.mean[2] == pytest.approx(0.4, abs=0.015)
    assert abs(state.mean[2] - 0.4) < 2.0 * sigma < 0.06
    np.testing.assert_allclose(state.mean[:2], 0.0, atol=0.02)


def test_same_sights_again_make_no_more_people():
    team, state = joined()
    for k in range(20):
        state = team.apply(state, sight(PEOPLE, stands(0.2 * k)))
    assert len(state.people) == 3
    np.testing.assert_allclose(places(state), PEOPLE, atol=1e-6)


def test_somebody_who_may_be_either_of_two_is_not_used():
    team, state = joined()
    state = team.apply(state, sight([(3.0, 0.1), (3.0, -0.1)], stands(0.1)))
    people, before = len(state.people), state.mean.copy()
    state = team.apply(state, sight([(3.0, 0.0)], stands(0.2)))
    assert len(state.people) == people
    np.testing.assert_array_equal(state.mean, before)
    assert ("a", "standing people") not in state.sources


def test_two_seen_at_once_are_two_people():
    """One of two who stand 0.5 m apart: the other one of a sight of both is not them, too."""
    team, state = joined()
    two = np.array([(3.0, 0.0), (3.0, 0.5)])
    state = team.apply(state, sight(two[:1], stands(0.1)))
    for k in range(3):
        state = team.apply(state, sight(two, stands(0.2 + 0.1 * k)))
    np.testing.assert_allclose(places(state), two, atol=1e-6)
    assert state.sources["a", "standing people"].accepted == 5


def test_who_they_are_is_told_by_errors_of_a_single_sight():
    """Errors that last make a sight count less, and do not make somebody 1 m away the same."""
    team, state = joined()
    state = team.apply(state, sight(PEOPLE[:1], stands(0.1)))
    before = state.mean[:3].copy()
    away = sight(PEOPLE[:1] + (0.0, 1.0), stands(0.2))
    away = dataclasses.replace(away, covariance=100.0 * away.covariance, inflated=100.0)
    state = team.apply(state, away)
    assert len(state.people) == 2
    np.testing.assert_array_equal(state.mean[:3], before)


def test_who_went_away_is_somebody_new():
    team, state = joined()
    state = team.apply(state, sight(PEOPLE[:1], stands(0.1)))
    before = state.mean[:3].copy()
    state = team.apply(state, sight(PEOPLE[:1] + (0.0, 1.0), stands(0.2)))
    assert len(state.people) == 2
    np.testing.assert_array_equal(state.mean[:3], before)


def test_who_is_unseen_for_long_is_dropped():
    team, state = joined()
    state = team.apply(state, sight(PEOPLE, stands(0.0)))
    unseen_s = StandingTuning().unseen_s
    state = team.apply(state, sight(PEOPLE[:1], stands(unseen_s - 1.0)))
    assert len(state.people) == 3
    state = team.apply(state, sight(PEOPLE[:1], stands(unseen_s + 1.0)))
    np.testing.assert_allclose(places(state), PEOPLE[:1], atol=1e-6)


def test_places_are_less_sure_with_time():
    team, state = joined()
    state = team.apply(state, sight(PEOPLE, stands(0.0)))
    i = state.person_at(0)
    before = state.covariance[i, i]
    state = team.apply(state, sight(np.zeros((0, 2)), stands(25.0)))
    assert state.covariance[i, i] == pytest.approx(before + 25.0 * StandingTuning().sway ** 2)


def test_of_too_many_those_unseen_for_longest_are_dropped():
    landmarks = StandingLandmarks(GATES, StandingTuning(most=3))
    _, state = joined()
    for k in range(5):
        state = landmarks.take(state, sight([(3.0, 2.0 * k)], stands(0.1 * k)))
    np.testing.assert_allclose(places(state), [(3.0, 4.0), (3.0, 6.0), (3.0, 8.0)], atol=1e-9)

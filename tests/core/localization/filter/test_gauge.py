"""What a team cannot know from itself alone: where it is as a whole, and how it is turned."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm

from core.localization.tours import as_walls
from mrs_people_loc.config import Localization
from mrs_people_loc.localization.filter.kalman import corrected
from mrs_people_loc.localization.filter.observations import (
    Joined,
    Met,
    WallsSeen,
    pose_from,
    wall_from,
)
from mrs_people_loc.localization.filter.team_filter import TeamFilter
from mrs_people_loc.localization.filter.team_state import (
    Landmark,
    Standing,
    TeamState,
    changed,
)
from mrs_people_loc.localization.odometry import Odometry

S = 1_000_000_000
ROUGH = np.array([1.0, 1.0, math.radians(15.0)])
NAMES = ("a", "b", "c")
POSES = st.tuples(st.floats(-20.0, 20.0), st.floats(-20.0, 20.0), st.floats(-3.0, 3.0))
GAUGES = st.tuples(st.floats(-5.0, 5.0), st.floats(-5.0, 5.0), st.floats(-2.0, 2.0)).map(np.array)
STILL = Odometry(0, 0.0, 0.0, 0.0, 0.0, 0.0)


def gauge(state, step=1e-6):
    """How the state changes with a motion of the whole team about the origin, shape (n, 3)."""

    def moved(by):
        return state.moved(np.zeros(3), by).mean

    return np.stack([moved(step * a) - moved(-step * a) for a in np.eye(3)], axis=1) / (2 * step)


def information(state):
    """What is known about that motion, shape (3, 3)."""
    basis = gauge(state)
    return basis.T @ np.linalg.solve(state.covariance, basis)


@st.composite
def states(draw):
    """Three robots, their wheels, two people and two walls with some covariance."""
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    poses = np.array([draw(POSES) for _ in NAMES])
    walls = tuple(Landmark(tuple(rng.uniform(-20, 20, 2)), (-1.0, 1.0)) for _ in range(2))
    people = Standing("b", 0), Standing("somebody who left", 0)
    mean = np.concatenate([poses.ravel(), 0.01 * rng.normal(size=9), 5.0 * rng.normal(size=8)])
    root = 0.2 * rng.normal(size=(26, 26))
    covariance = root @ root.T + 0.01 * np.eye(26)
    odometry = dict.fromkeys(NAMES, STILL)
    return TeamState(mean, covariance, odometry, people=people, walls=walls)


@given(states(), GAUGES)
def test_correction_that_is_a_motion_of_the_team_moves_the_team(state, by):
    x, y, turn = by
    motion = expm([[0.0, -turn, x], [turn, 0.0, y], [0.0, 0.0, 0.0]])
    wanted = state.moved(np.zeros(3), np.array([motion[0, 2], motion[1, 2], turn])).mean
    mean, carried = state.stepped(gauge(state) @ by, np.arange(3, 6))
    np.testing.assert_allclose(mean, wanted, atol=1e-6)
    after = changed(state, mean=mean)
    np.testing.assert_allclose(carried @ gauge(state), gauge(after), atol=1e-6)


@given(
    states(),
    st.sampled_from(["robot", "person", "wall"]),
    st.floats(0.1, 0.5),
    st.floats(-0.5, 0.5),
)
def test_relative_observation_tells_nothing_about_the_motion(state, kind, offset, turn):
    """However far it corrects the state."""
    columns = {
        "robot": np.arange(6),
        "person": np.r_[0:3, state.person_at(1) + np.arange(2)],
        "wall": state.columns("a", 1),
    }[kind]
    off = np.array([offset, -offset, turn]) if kind == "robot" else np.array([offset, turn])

    def predicted(part):
        if kind == "wall":
            return wall_from(part, state.walls[1].anchor)
        if kind == "person":
            value, by_robot, by_other = pose_from(part[:3], np.array([*part[3:], 0.0]))
            return value[:2], np.hstack([by_robot[:2], by_other[:2, :2]])
        value, by_robot, by_other = pose_from(part[:3], part[3:])
        return value, np.hstack([by_robot, by_other])

    seen = predicted(state.mean[columns])[0] + off

    def model(part):
        value, jacobian = predicted(part)
        return seen - value, jacobian

    made, _ = corrected(state, columns, model, 1e-4 * np.eye(len(off)))
    assert (made.mean != state.mean).any()
    before, after = information(state), information(made)
    np.testing.assert_allclose(after, before, rtol=1e-5, atol=1e-5 * np.abs(before).max())


@pytest.mark.slow
@settings(max_examples=10)
@given(st.integers(0, 2**32 - 1))
def test_team_that_sees_only_itself_never_knows_its_place_better_than_at_the_start(seed):
    """Three robots that are told wrong by 1 m and 15 degrees meet, turn, and see two walls."""
    rng = np.random.default_rng(seed)
    team, state = TeamFilter("a", Localization()), TeamState()
    true = {"a": np.zeros(3), "b": np.array([2.0, 0.5, 0.2]), "c": np.array([2.0, -0.5, -0.1])}
    for name, place in true.items():
        told = place + ROUGH * rng.normal(size=3)
        state = team.apply(state, Joined(name, STILL, told, np.diag(ROUGH**2)))
    known = information(state)
    for k in range(1, 40):
        now = Odometry(k * S // 4, 0.0, 0.0, 0.1 * k, 1e-6 * k, 1e-6 * k)
        at = {name: place + [0.0, 0.0, 0.1 * k] for name, place in true.items()}
        for one, other in (("a", "b"), ("b", "c"), ("a", "c")):
            relative = pose_from(at[one], at[other])[0] + 0.03 * rng.normal(size=3)
            state = team.apply(state, Met(one, now, other, now, relative, 1e-3 * np.eye(3)))
        for name in NAMES:
            seen = as_walls([wall_seen(at[name], y) for y in (3.0, -3.0)], (0.02, 0.02))
            state = team.apply(state, WallsSeen(name, now, seen))
        before, known = known, information(state)
        scale = np.sqrt(np.outer(np.diag(before), np.diag(before)))
        assert np.linalg.eigvalsh((before - known) / scale)[0] > -1e-4
    assert state.sources["a", "relative"].accepted > 30
    assert state.sources["a", "walls"].accepted > 20
    # Nor does it say so.
    i = state.at("a")
    assert state.covariance[i + 2, i + 2] >= np.linalg.inv(known)[2, 2]


def wall_seen(at, y):
    """A wall along x, in the frame of a robot: from (x, y) to (x, y)."""
    c, s = math.cos(at[2]), math.sin(at[2])
    ends = np.array([[-3.0, y], [3.0, y]]) - at[:2]
    return (ends @ np.array([[c, -s], [s, c]])).ravel()


@pytest.mark.parametrize("seed", range(4))
def test_wall_does_not_tell_the_way_along_it(seed):
    """Three robots that start known to 1 m and 15 degrees see one wall again and again."""
    rng = np.random.default_rng(seed)
    team, state = TeamFilter("a", Localization()), TeamState()
    true = {"a": np.zeros(3), "b": np.array([-4.0, 0.5, 0.2]), "c": np.array([-4.0, -0.5, -0.1])}
    for name, place in true.items():
        told = place + ROUGH * rng.normal(size=3)
        state = team.apply(state, Joined(name, STILL, told, np.diag(ROUGH**2)))
    for k in range(1, 20):
        now = Odometry(k * S // 5, 0.0, 0.0, 0.0, 1e-6 * k, 1e-6 * k)
        for name, place in true.items():
            ends = wall_seen(place, -1.5) + 0.02 * rng.normal(size=4)
            seen = as_walls([ends], (0.02, 0.02))
            state = team.apply(state, WallsSeen(name, now, seen))
    assert all(state.sources[name, "walls"].accepted >= 15 for name in NAMES[1:])
    c, s = math.cos(state.mean[-1]), math.sin(state.mean[-1])
    between = np.zeros((2, len(state.mean)))
    between[0, [0, 1, 3, 4]] = s, -c, -s, c
    between[1, [2, 5]] = -1.0, 1.0
    along, heading = np.sqrt(np.diag(between @ state.covariance @ between.T))
    assert along > 0.8 * math.sqrt(2.0)
    assert heading < math.radians(3.0)


def test_robots_that_meet_know_the_teams_heading_as_well_as_their_starts_together():
    """Three independent headings known to 15 degrees, at one place: 15 / sqrt(3)."""
    team, state = TeamFilter("a", Localization()), TeamState()
    for name in NAMES:
        state = team.apply(state, Joined(name, STILL, np.zeros(3), np.diag([1e-6, 1e-6, 0.07])))
    for k in range(1, 20):
        now = Odometry(k * S, 0.0, 0.0, 0.0, 0.0, 0.0)
        for one, other in (("a", "b"), ("b", "c")):
            met = Met(one, now, other, now, np.array([0.0, 0.0, 0.1]), 1e-6 * np.eye(3))
            state = team.apply(state, met)
    headings = [state.covariance[3 * i + 2, 3 * i + 2] for i in range(3)]
    assert headings == pytest.approx([0.07 / 3] * 3, rel=1e-3)

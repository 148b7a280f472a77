"""Robots whose poses are wrong by any turn and distance."""

import math

import numpy as np
import pytest

from core.localization.people.test_relative_poses import (
    FIVE,
    THREE_ROBOTS,
    TWO_ROBOTS,
    Team,
    draw,
)
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.localization.people.alignment import MovingPlaces, align_anywhere
from mrs_people_loc.localization.people.relative_poses import RelativePoses, RelativePosesTuning

#: What a pose is wrong by: 40 m, half a turn.
FAR = (-24.0, 32.0, math.pi)
LIFTED = (0.1, 0.0, math.radians(40.0))
CARRIED = (1.2, -0.9, math.radians(52.0))
#: People who walk, each to somewhere else [m/s].
APART = np.array([(1.0, 0.0), (-0.3, 0.9), (0.0, 0.0), (0.4, -1.1), (-0.8, -0.5)])


def moving(xy, velocity, sigma=0.06, velocity_sigma=0.12):
    xy, velocity = np.array(xy, dtype=float).reshape(-1, 2), np.array(velocity, dtype=float)
    unsure = np.tile(np.eye(2), (len(xy), 1, 1))
    sample = np.zeros(len(xy), np.intp)
    return MovingPlaces(
        xy, sigma**2 * unsure, sample, velocity * np.ones_like(xy), velocity_sigma**2 * unsure
    )


def windows(team, count, *, relative=None, lost=(), first=0):
    """By window, the measurements."""
    relative = relative or RelativePoses()
    found = []
    for window in range(first, first + count):
        found.append([])
        for t in 0.8 * window + 0.1 * np.arange(8):
            seen = {name: team.seen(name, t) for name in team.robots}
            poses = {name: team.pose(name, t) for name in team.robots}
            found[-1] += relative.step(seen, poses, lost)
    return found


def group(random, count):
    """People who are 0.5 to 3 m from another one, and not less from anybody."""
    xy = [np.zeros(2)]
    while len(xy) < count:
        way = rotation_2d(random.uniform(0.0, 2.0 * np.pi))[0] * random.uniform(0.5, 3.0)
        new = xy[random.integers(len(xy))] + way
        if np.hypot(*(np.array(xy) - new).T).min() > 0.5:
            xy.append(new)
    return np.array(xy)


def walking(random, count):
    speed, way = random.uniform(0.5, 1.4, (2, count)) * ((1.0,), (2.0 * np.pi / 0.9,))
    return speed[:, np.newaxis] * np.stack([np.cos(way), np.sin(way)], 1)


def lost_team(seed, *, shared, walks, alone=0, robots="abc"):
    """Robots about a group, each of which believes to be anywhere.

    Args:
        seed: Of the draw.
        shared: People whom all see.
        walks: Share of people who walk.
        alone: People whom only one robot sees, for each of them.
        robots: Names.
    """
    random = np.random.default_rng(seed)
    count = shared + alone * len(robots)
    people, velocity = random.permutation(group(random, count)), walking(random, count)
    # Of those whom all see, and of the others, the last ones stand.
    velocity[math.ceil(walks * shared) : shared] = 0.0
    velocity[shared + math.ceil(walks * (count - shared)) :] = 0.0
    others = random.permutation(np.arange(shared, count)).reshape(len(robots), alone)
    unseen = {name: np.delete(others, k, axis=0).ravel().tolist() for k, name in enumerate(robots)}
    angles = random.uniform(0.0, 2.0 * np.pi, len(robots))
    away = random.uniform(3.0, 5.0, len(robots))[:, np.newaxis]
    at = people.mean(axis=0) + away * np.stack([np.cos(angles), np.sin(angles)], 1)
    return Team(
        people,
        {n: (*xy, a + math.pi) for n, xy, a in zip(robots, at.tolist(), angles, strict=True)},
        reported={
            name: random.uniform((-40.0, -40.0, -math.pi), (40.0, 40.0, math.pi)) for name in robots
        },
        unseen=unseen,
        stated=(random.uniform(0.05, 0.15), random.uniform(0.03, 0.08)),
        pass_by=velocity,
        seed=seed,
    )


# ------------------------------------------------------------------------------ align_anywhere ----


def test_any_turn_and_distance_by_hand():
    """Three people who walk, turned by 143.13 degrees (cosine -0.8, sine 0.6), and 40 m away."""
    own = moving([(2.0, 0.0), (3.0, 1.5), (4.0, -1.0)], [(1.0, 0.0), (0.0, 0.0), (0.0, 1.0)])
    others = moving(
        [(37.4, 3.2), (36.7, 0.6), (38.4, 1.2), (41.0, 4.0)],
        [(-0.6, -0.8), (0.0, 0.0), (-0.8, 0.6), (0.3, 0.3)],
    )
    found = align_anywhere(own, others)
    assert found is not None
    assert math.cos(found.turn) == pytest.approx(-0.8, abs=0.02)
    assert math.sin(found.turn) == pytest.approx(0.6, abs=0.02)
    np.testing.assert_allclose(found.move, (40.0, 0.0), atol=0.05)
    assert dict(zip(found.own.tolist(), found.others.tolist(), strict=True)) == {0: 2, 1: 1, 2: 0}
    assert found.evidence > 3.0
    assert found.margin > 3.0


SQUARE = [(0.0, 0.0), (2.0, 0.0), (2.0, 2.0), (0.0, 2.0)]
TRIANGLE = [(0.0, 0.0), (2.0, 0.0), (1.0, math.sqrt(3.0))]
LINE = [(1.2 * k, 0.0) for k in range(5)]


def test_robot_that_is_lost_helps_nobody():
    """Two people are shared with each of the others: with one of them alone that is too few."""
    team = Team(FIVE, THREE_ROBOTS, reported={"b": FAR}, unseen=BY_TWO, pass_by=0.6 * APART)
    assert not any(windows(team, 5, lost={"a", "b"}))


@pytest.mark.parametrize("xy", [SQUARE, TRIANGLE, LINE], ids=["square", "triangle", "line"])
def test_constellations_that_look_alike_from_several_sides_have_no_margin(xy):
    found = align_anywhere(moving(xy, (0.0, 0.0)), moving(xy, (0.0, 0.0)))
    assert found is not None
    assert len(found.own) == len(xy)
    assert found.margin == pytest.approx(0.0, abs=0.01)


def test_velocities_tell_the_sides_of_a_square():
    turned = np.array(SQUARE) @ rotation_2d(2.0).T
    found = align_anywhere(moving(SQUARE, (1.0, 0.0)), moving(turned, rotation_2d(2.0) @ (1, 0)))
    assert found is not None
    assert found.turn == pytest.approx(2.0, abs=0.01)
    assert found.margin > 5.0


def test_velocities_of_people_who_walk_alike_prove_no_more_for_more_people():
    """What everybody does tells nobody from another: the second group proves it, and the rest not.

    Six people who stand and six who walk alike differ by what their common velocity proves.
    """
    xy = group(np.random.default_rng(4), 6)

    def proved(count):
        stand, walk = (
            align_anywhere(moving(xy[:count], v), moving(xy[:count], v))
            for v in ((0.0, 0.0), (1.0, 0.0))
        )
        assert stand is not None
        assert walk is not None
        return walk.evidence - stand.evidence

    assert 2.0 < proved(6) < 6.0
    assert proved(6) == pytest.approx(proved(4), abs=1.0)


@pytest.mark.parametrize("count", [0, 1])
def test_nobody_and_one_person_give_nothing(count):
    few, three = moving(TRIANGLE[:count], (0.0, 0.0)), moving(TRIANGLE, (0.0, 0.0))
    assert align_anywhere(few, three) is None
    assert align_anywhere(three, few) is None


# ----------------------------------------------------------------------------- relative poses ----


@pytest.mark.parametrize("wrong_by", [FAR, LIFTED, CARRIED])
def test_robot_that_is_elsewhere_is_measured_at_the_fifth_window(wrong_by):
    """After three windows that found nothing, one that finds it and one that confirms it."""
    team = Team(FIVE, TWO_ROBOTS, reported={"b": wrong_by}, pass_by=APART, sigmas=(0.1, 0.1, 0.03))
    found = windows(team, 6)
    assert [len(of_window) for of_window in found[:3]] == [0, 0, 0]
    measured = [one for of_window in found for one in of_window]
    assert measured
    for one in measured:
        np.testing.assert_allclose(team.error(one), 0.0, atol=0.25)


def test_robot_that_is_said_to_be_lost_is_measured_at_the_second_window():
    team = Team(FIVE, TWO_ROBOTS, reported={"b": FAR}, pass_by=APART)
    found = windows(team, 3, lost={"b"})
    assert [len(of_window) for of_window in found] == [0, 1, 1]
    lost_first = Team(FIVE, TWO_ROBOTS, reported={"a": FAR}, pass_by=APART)
    assert [len(of_window) for of_window in windows(lost_first, 3, lost={"a"})] == [0, 1, 1]


def test_robots_that_drive_are_carried_on_by_odometry():
    """The way of the lost one is turned as it is: by 180 degrees."""
    team = Team(FIVE, TWO_ROBOTS, reported={"b": FAR}, velocity=(0.8, 0.3), pass_by=0.6 * APART)
    measured = [one for of_window in windows(team, 5, lost={"b"}) for one in of_window]
    assert len(measured) >= 3
    for one in measured:
        np.testing.assert_allclose(team.error(one), 0.0, atol=0.25)


#: Whom robots do not see: two people are shared by a and b, two others by b and c.
BY_TWO = {"a": [2, 3, 4], "b": [2], "c": [0, 1]}


@pytest.mark.parametrize("robot", ["a", "b", "c"])
def test_lost_robot_is_found_by_people_of_whom_each_other_robot_sees_two(robot):
    """Whichever name it has: it sees 0, 1 and 3, 4; another one 0, 1; the third one 2, 3, 4."""
    names = {"b": robot, **dict(zip("ac", sorted({*"abc"} - {robot}), strict=True))}
    robots = {names[name]: pose for name, pose in THREE_ROBOTS.items()}
    unseen = {names[name]: people for name, people in BY_TWO.items()}
    team = Team(FIVE, robots, reported={robot: FAR}, unseen=unseen, pass_by=0.6 * APART)
    measured = [one for of_window in windows(team, 5, lost={robot}) for one in of_window]
    of_lost = [one for one in measured if robot in (one.robot, one.other)]
    assert len({frozenset((one.robot, one.other)) for one in of_lost}) == 2
    for one in of_lost:
        np.testing.assert_allclose(team.error(one), 0.0, atol=0.25)


@pytest.mark.parametrize("robot", ["a", "b", "c"])
def test_robot_that_nobody_calls_lost_is_found_by_those_who_are_measured_with_each_other(robot):
    """It shares two people with each of them, who share two others."""
    six = np.concatenate([FIVE, [(3.3, 2.8)]])
    names = {"b": robot, **dict(zip("ac", sorted({*"abc"} - {robot}), strict=True))}
    robots = {names[name]: pose for name, pose in THREE_ROBOTS.items()}
    unseen = {
        names[name]: people for name, people in {"a": [3, 4], "b": [2, 5], "c": [0, 1]}.items()
    }
    team = Team(
        six, robots, reported={robot: FAR}, sigmas=(0.1, 0.1, 0.03), unseen=unseen,
        pass_by=0.6 * np.concatenate([APART, [(0.2, 0.7)]]),
    )  # fmt: skip
    measured = [one for of_window in windows(team, 8) for one in of_window]
    of_wrong = [one for one in measured if robot in (one.robot, one.other)]
    assert of_wrong
    for one in of_wrong:
        np.testing.assert_allclose(team.error(one), 0.0, atol=0.25)


@pytest.mark.parametrize("xy", [SQUARE, TRIANGLE, LINE], ids=["square", "triangle", "line"])
def test_ambiguous_constellations_wait(xy):
    robots = {"a": (-4.0, 0.5, 0.0), "b": (5.0, -3.0, 2.2), "c": (0.0, 6.0, -1.6)}
    for seed in range(3):
        reported = {"b": FAR, "c": CARRIED}
        team = Team(np.array(xy), robots, reported=reported, seed=seed)
        assert not any(windows(team, 8, lost={"b"}))


def test_two_people_are_not_enough():
    team = Team(FIVE[:2], TWO_ROBOTS, reported={"b": FAR}, pass_by=APART[:2])
    assert not any(windows(team, 8, lost={"b"}))


def test_pose_that_jumps_between_two_windows_is_confirmed_later():
    """As it does when a filter has found the robot, and was wrong."""
    relative = RelativePoses()
    team = Team(FIVE, TWO_ROBOTS, reported={"b": FAR}, pass_by=APART)
    assert not any(windows(team, 1, relative=relative, lost={"b"}))
    team.reported = {"b": (5.0, -3.0, 1.0)}
    found = windows(team, 4, relative=relative, lost={"b"}, first=1)
    assert not found[0]
    measured = [one for of_window in found for one in of_window]
    assert measured
    for one in measured:
        np.testing.assert_allclose(team.error(one), 0.0, atol=0.25)


def test_robots_that_are_where_they_say_are_measured_as_without_the_search():
    never = RelativePosesTuning(anywhere_after=10**9)
    for seed in range(5):
        options = {"velocity": (0.7, 0.0), "sigmas": (0.1, 0.1, 0.03)}
        with_it = draw(seed, 3, **options).run(3.0)
        without = draw(seed, 3, **options).run(3.0, RelativePoses(never))
        assert with_it
        for one, other in zip(with_it, without, strict=True):
            np.testing.assert_array_equal(one.pose, other.pose)
            np.testing.assert_array_equal(one.covariance, other.covariance)


# ------------------------------------------------------------------------------------- by draw ----


def found_in_time(teams):
    """Share of pairs that are measured within three windows since robots are lost; all errors."""
    pairs, errors = 0, []
    for team in teams:
        relative = RelativePoses()
        windows(team, 1, relative=relative)
        found = windows(team, 3, relative=relative, lost=set(team.robots), first=1)
        measured = [one for of_window in found for one in of_window]
        first = {(one.robot, one.other): one for one in reversed(measured)}
        pairs += len(first)
        errors += [(team.error(one), one.covariance) for one in first.values()]
    return pairs / (len(teams) * math.comb(len(teams[0].robots), 2)), errors


@pytest.mark.slow
def test_lost_robots_are_found_by_four_people_and_more_of_whom_half_walk():
    teams = [
        lost_team(seed, shared=4 + seed % 4, walks=0.5, alone=seed % 4 // 2 + seed % 2)
        for seed in range(60)
    ]
    share, errors = found_in_time(teams)
    assert share >= 0.95
    assert max(np.hypot(*error[:2]) for error, _ in errors) < 0.8
    nees = [error @ np.linalg.solve(covariance, error) for error, covariance in errors]
    assert 0.75 < np.mean(nees) < 3.3


@pytest.mark.slow
def test_lost_robots_are_found_by_three_people_who_walk():
    share, errors = found_in_time([lost_team(seed, shared=3, walks=1.0) for seed in range(60)])
    assert share >= 0.95
    assert max(np.hypot(*error[:2]) for error, _ in errors) < 0.8


@pytest.mark.slow
@pytest.mark.parametrize("walks", [0.0, 0.5, 1.0])
def test_robots_that_see_different_people_are_not_measured(walks):
    """340 windows of each kind."""
    for seed in range(85):
        count = 3 + seed % 8
        team = lost_team(seed, shared=0, walks=walks, alone=count, robots="ab")
        assert not any(windows(team, 5, lost={"b"})), seed

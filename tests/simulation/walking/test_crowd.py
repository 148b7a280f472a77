import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mrs_people_sim.models.rooms import floor_plan
from mrs_people_sim.scene import Furniture, Room
from mrs_people_sim.walking.crowd import Crowd
from mrs_people_sim.walking.crowd_ground import Clearance, Trail
from mrs_people_sim.walking.stragglers import Straggling

DT = 0.05
SPOTS = np.array([[2.0, 2.0], [2.0, 3.0], [1.2, 2.5], [2.8, 2.5]])


def hall(*furniture):
    return Clearance(floor_plan(Room(length=30.0, width=5.0), furniture))


def lead(crowd, path, *, others=(), speed=0.6, seconds=0.0, leader=0, look=None):
    """A robot drives along a path while people walk, and then stands."""
    at = np.array(path[0], dtype=float)
    for goal in (*path[1:], None):
        for _ in range(10_000):
            left = np.zeros(2) if goal is None else np.array(goal) - at
            far = float(np.linalg.norm(left))
            if goal is not None and far < 1e-6:
                break
            if goal is None and seconds <= 0:
                return
            velocity = left / max(far, 1e-9) * min(speed, far / DT)
            seconds -= DT if goal is None else 0.0
            at = at + velocity * DT
            robots = np.array([*others[:leader], at, *others[leader:]])
            moves = np.zeros_like(robots)
            moves[leader] = velocity
            crowd.step(DT, robots, moves, leader)
            if look is not None:
                look(at)


# ---------------------------------------------------------------------------- where people are


def test_clearance_is_the_distance_to_walls_and_furniture():
    clearance = hall(Furniture(kind="block", x=15.0, y=2.5, size=(1.0, 1.0, 2.0)))
    places = np.array([[15.0, 0.5], [13.0, 2.5], [29.0, 4.0], [15.3, 2.5]])
    distance, out = clearance.at(places)
    assert distance == pytest.approx([0.5, 1.5, 1.0, -0.2], abs=0.06)
    assert out[[0, 1, 3]] == pytest.approx(np.array([[0, 1], [-1, 0], [1, 0]]), abs=0.1)


def test_a_trail_becomes_shorter_where_the_leader_comes_back():
    trail = Trail(np.zeros(2))
    for x in np.arange(0.0, 3.0, 0.04):
        trail.extend(np.array([x, 0.0]))
    assert trail.length == pytest.approx(2.9, abs=0.11)
    for x in np.arange(3.0, 2.0, -0.04):
        trail.extend(np.array([x, 0.0]))
    assert trail.length == pytest.approx(2.0, abs=0.15)
    places, ahead = trail.at(np.array([1.0, 9.0]))
    assert places == pytest.approx(np.array([[1.0, 0.0], [2.0, 0.0]]), abs=0.15)
    assert ahead == pytest.approx(np.array([[1.0, 0.0], [1.0, 0.0]]), abs=1e-9)


@pytest.mark.parametrize("aside", [0.0, 0.1, 0.25, 0.4])
def test_a_trail_has_no_fold_where_the_leader_comes_back_beside_it(aside: float) -> None:
    trail = Trail(np.zeros(2))
    for x in np.arange(0.0, 3.0, 0.04):
        trail.extend(np.array([x, 0.0]))
    for part in np.arange(0.0, 1.0, 0.05):
        trail.extend(np.array([3.0 - part, aside * part]))
    for x in np.arange(2.0, 6.0, 0.04):
        trail.extend(np.array([x, aside]))
    _, ahead = trail.at(np.arange(0.0, trail.length, 0.1))
    assert ahead[:, 0].min() > 0.5
    assert trail.length == pytest.approx(6.0, abs=0.5)


def test_a_trail_goes_round_a_corner_and_the_end_of_a_wall() -> None:
    trail = Trail(np.zeros(2))
    for x in np.arange(0.0, 3.0, 0.04):
        trail.extend(np.array([x, 0.0]))
    for y in np.arange(0.0, 0.6, 0.04):
        trail.extend(np.array([3.0, y]))
    for x in np.arange(3.0, 0.0, -0.04):
        trail.extend(np.array([x, 0.6]))
    assert trail.length == pytest.approx(6.6, abs=0.3)


# ------------------------------------------------------------------------------------ following


def test_people_follow_at_their_distance_and_stop_with_the_leader():
    crowd = Crowd(SPOTS, hall(), 1)
    places = []
    path = [(4.0, 2.5), (16.0, 2.5)]
    lead(crowd, path, look=lambda at: places.append((at[0], crowd.xy[:, 0].copy())))
    behind = np.array([x - people for x, people in places[200:]])
    assert behind.min() > 0.8
    assert behind.max() < 4.5
    lead(crowd, [(16.0, 2.5)], seconds=15.0)
    assert np.linalg.norm(crowd.velocity, axis=1).max() < 0.1
    toward = np.array([16.0, 2.5]) - crowd.xy
    turned = np.arctan2(toward[:, 1], toward[:, 0]) - crowd.yaw
    assert np.cos(turned).min() > 0.5  # they look at it


def test_people_stand_round_the_leader_in_rows():
    crowd = Crowd(np.concatenate([SPOTS, SPOTS + [0.4, 1.0]]), hall(), 3)
    lead(crowd, [(4.0, 2.5), (8.0, 2.5)], seconds=15.0)
    off = crowd.xy - [8.0, 2.5]
    assert np.linalg.norm(off, axis=1).min() > 1.2
    assert np.abs(np.arctan2(off[:, 1], -off[:, 0])).max() < math.radians(75.0)
    apart = np.linalg.norm(crowd.xy[:, None] - crowd.xy[None], axis=2)
    assert np.sort(apart, axis=1)[:, 1].min() > 0.7


def test_nobody_leads_and_nobody_walks():
    crowd = Crowd(SPOTS, hall(), 1)
    for _ in range(100):
        crowd.step(DT, np.empty((0, 2)), np.empty((0, 2)), None)
    assert np.linalg.norm(crowd.xy - SPOTS, axis=1).max() < 0.5
    assert np.linalg.norm(crowd.velocity, axis=1).max() < 0.05


def test_the_same_seed_walks_the_same():
    ends = []
    for seed in (3, 3, 4):
        crowd = Crowd(SPOTS, hall(), seed)
        lead(crowd, [(4.0, 2.5), (8.0, 2.5)])
        ends.append(crowd.xy)
    assert (ends[0] == ends[1]).all()
    assert np.abs(ends[0] - ends[2]).max() > 0.05


def test_a_new_leader_from_behind_is_followed_once_it_has_passed():
    crowd = Crowd(SPOTS, hall(), 2)
    lead(crowd, [(4.0, 2.5), (9.0, 2.5)], others=[(0.5, 2.5)])
    at = crowd.xy[:, 0].mean()
    dead = np.array([9.0, 2.5])
    lead(crowd, [(4.0, 1.0), (8.0, 0.8)], others=[dead], leader=1)
    assert abs(crowd.xy[:, 0].mean() - at) < 1.0
    lead(crowd, [(8.0, 0.8), (14.0, 2.5), (20.0, 2.5)], others=[dead], leader=1)
    assert crowd.xy[:, 0].min() > 20.0 - 5.0


def test_a_robot_that_comes_is_evaded():
    crowd = Crowd(np.array([[8.0, 2.5]]), hall(), 1)
    nearest = []
    x = 4.0
    for _ in range(160):
        x += 0.6 * DT
        crowd.step(DT, np.array([[x, 2.45]]), np.array([[0.6, 0.0]]), None)
        nearest.append(np.linalg.norm(crowd.xy[0] - [x, 2.45]))
    assert min(nearest) > 0.45
    assert nearest[-1] > 0.45


# ----------------------------------------------------------------------------------- stragglers


@pytest.mark.parametrize("robot_comes", [False, True])
def test_a_straggler_stays_until_time_is_over_or_a_robot_comes(robot_comes):
    crowd = Crowd(SPOTS, hall(), 5, (Straggling(1, after=3.0, stays=20.0),))
    lead(crowd, [(4.0, 2.5), (14.0, 2.5)])
    assert crowd.stragglers.who.tolist() == [1]
    assert crowd.xy[1, 0] < np.delete(crowd.xy[:, 0], 1).min() - 1.0
    others = [crowd.xy[1] + [-1.0, -0.5]] if robot_comes else []
    lead(crowd, [(14.0, 2.5)], others=others, seconds=3.0)
    assert len(crowd.stragglers.who) == (not robot_comes)
    lead(crowd, [(14.0, 2.5)], others=others, seconds=30.0)
    assert not len(crowd.stragglers.who)
    (stay,) = crowd.stragglers.stays
    assert (stay.person, stay.fetched) == (1, robot_comes)
    assert stay.end_s - stay.begin_s == pytest.approx(20.0, abs=0.1) or robot_comes
    assert np.linalg.norm(crowd.xy[1] - [14.0, 2.5]) < 3.5


# ------------------------------------------------------------------------------------- never


@settings(max_examples=4, deadline=None)
@given(seed=st.integers(0, 1000), count=st.integers(1, 10), y=st.floats(0.6, 4.4))
def test_nobody_is_ever_in_a_wall_or_in_somebody_else(seed, count, y):
    wall = [
        Furniture(kind="wall", x=9.0, y=1.0, size=(0.06, 2.0, 2.8)),
        Furniture(kind="wall", x=9.0, y=4.1, size=(0.06, 1.8, 2.8)),  # a door of 1.2 m
    ]
    clearance = hall(*wall)
    rng = np.random.default_rng(seed)
    grid = np.stack(np.meshgrid([2.0, 3.0, 4.0], [1.0, 2.0, 3.0, 4.0]), axis=-1).reshape(-1, 2)
    crowd = Crowd(grid[rng.permutation(len(grid))[:count]], clearance, seed)
    moved = []

    def look(at):
        distance = clearance.at(crowd.xy)[0]
        assert distance.min() > 0.09
        apart = np.linalg.norm(crowd.xy[:, None] - crowd.xy[None], axis=2)
        np.fill_diagonal(apart, math.inf)
        assert apart.min() > 0.3
        moved.append(np.linalg.norm(crowd.velocity, axis=1).max())

    lead(crowd, [(5.0, y), (7.5, 2.6), (10.5, 2.6), (15.0, y)], seconds=5.0, look=look)
    assert max(moved) < 2.0
    assert (crowd.xy[:, 0] > 9.0).mean() > 0.6  # through the door, not through the wall


def test_who_leaves_walks_back_along_the_way_whatever_robots_do():
    crowd = Crowd(SPOTS, hall(), 5, (Straggling(1, after=6.0, leaves=True),))
    lead(crowd, [(4.0, 2.5), (16.0, 2.5)], seconds=15.0)
    assert crowd.stragglers.leaving.tolist() == [1]
    assert crowd.stragglers.stays == []
    assert crowd.xy[1] == pytest.approx(SPOTS.mean(axis=0), abs=1.5)
    assert (np.delete(crowd.xy, 1, axis=0)[:, 0] > 11.0).all()

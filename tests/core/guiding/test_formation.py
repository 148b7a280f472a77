"""Posts around the group: where, for whom, and how they change."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mrs_people_loc.config import GuideConfig
from mrs_people_loc.guiding.formation import FormationPlanner, Scenery
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.guidance import Role
from mrs_people_loc.guiding.way import Way
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_loc.team.poses import Pose

STRAIGHT = Way([[0.0, 0.0], [40.0, 0.0]])
#: Two in front, one behind: 1.6 m to the leader at 11.6 m.
THREE = np.array([[10.0, 0.6], [10.0, -0.6], [9.0, 0.0]])
ROBOTS = {"a": (11.6, 0.0), "b": (7.0, 1.0), "c": (7.0, -1.0), "d": (6.0, 0.0)}


def config(**changes) -> GuideConfig:
    return GuideConfig.from_mapping(changes)


def pose(x, y, yaw=0.0):
    return Pose(0, x, y, yaw)


def poses(names, at=ROBOTS):
    return {name: pose(*at[name]) for name in names}


def corridor(width: float) -> FreeSpace:
    """Free between walls at +-width/2 about the x axis, from -10 to 40 m."""
    rows = np.full((120, 1000), 100)
    y = -3.0 + 0.05 * (np.arange(120) + 0.5)
    rows[np.abs(y) < 0.5 * width] = 0
    grid = OccupancyGrid(0.05, -10.0, -3.0, 0.0, rows.astype(np.int8))
    return FreeSpace(grid)


class Run:
    """A formation over time; robots are at once on their posts."""

    def __init__(self, names="abc", *, way=STRAIGHT, space=None, **changes):
        self.way = way
        self.formation = FormationPlanner(config(**changes), way, space or FreeSpace.unbounded())
        self.robots, self.now_s = poses(names), 0.0

    def step(
        self, people=THREE, *, moving=True, straggler=None, leader_m=None, unseen_s=None, speed=0.0
    ):
        people = np.asarray(people, dtype=float).reshape(-1, 2)
        along = self.way.nearest(people)
        first = along.max() + 1.6 if leader_m is None else leader_m
        self.now_s += 0.2
        out = self.formation.step(
            Scenery(
                people,
                along,
                straggler,
                "a",
                first,
                speed,
                self.robots,
                moving,
                self.now_s,
                unseen_s,
            )
        )
        self.robots = {name: pose(post.xy[0], post.xy[1], post.yaw) for name, post in out.items()}
        return out

    def steps(self, count, *args, **kwargs):
        for _ in range(count):
            out = self.step(*args, **kwargs)
        return out


def test_the_leader_is_on_the_way_and_its_head_looks_at_the_group():
    (post,) = Run("a").step(speed=0.5).values()
    assert post.role is Role.LEADER
    assert post.speed == 0.5
    assert post.xy == pytest.approx([11.6, 0.0])
    assert abs(post.yaw) == pytest.approx(math.pi)  # it drives in reverse
    assert Run("a", looks_back=["a"]).step()["a"].yaw == pytest.approx(0.0)
    # Nor does a base that cannot reverse.
    assert Run("a", base={"max_reverse": 0.0}).step()["a"].yaw == pytest.approx(0.0)


def test_a_robot_behind_is_at_the_distance_and_looks_along_the_way():
    run = Run("ab")
    run.robots |= poses("b", {"b": (7.5, 0.0)})
    post = run.step([[9.0, 0.0]])["b"]
    assert post.role is Role.REAR
    assert post.xy[0] == pytest.approx(9.0 - 1.3)
    assert post.yaw == pytest.approx(0.0)
    assert abs(Run("ab", looks_back=["b"]).step()["b"].yaw) == pytest.approx(math.pi)


def test_a_post_behind_is_ahead_of_where_it_belongs_while_the_group_moves():
    still, moved = (Run("ab").step([[9.0, 0.0]], speed=v)["b"] for v in (0.0, 0.5))
    ahead, left = moved.xy - still.xy
    assert 0.1 < ahead < 0.5  # of a lag of 0.2 to 1 s
    assert left == pytest.approx(0.0)


def test_a_hidden_person_brings_a_post_that_sees_them():
    # From behind on the way, the one at 9 m hides the one at 9.8 m, whom the leader does not see:
    # those at 10.4 m hide them.
    people = [[9.0, 0.0], [9.8, 0.0], [10.4, 0.0]]
    post = Run("ab").step(people)["b"]
    assert abs(post.xy[1]) >= 0.5


def test_in_a_narrow_corridor_robots_are_in_file_on_the_way():
    out = Run("abcd", space=corridor(1.0)).step([[10.0, 0.0], [9.2, 0.1]])
    behind = sorted((out[name].xy for name in "bcd"), key=lambda xy: -xy[0])
    assert np.allclose([y for _, y in behind], 0.0, atol=0.11)
    assert behind[0][0] == pytest.approx(9.2 - 1.3)
    assert (np.diff([x for x, _ in behind]) <= -0.9 + 1e-6).all()


def test_beside_a_group_only_while_it_stands():
    column = [[10.4 - 0.8 * k, 0.0] for k in range(8)]
    run = Run("abc", formation={"hysteresis": 0.0})
    assert [run.steps(20, column)[name].role for name in "bc"] == [Role.REAR] * 2
    standing = run.steps(20, column, moving=False)
    assert Role.SIDE in {post.role for post in standing.values()}
    for post in standing.values():  # all look at the group's centre
        away = np.array([7.6, 0.0]) - post.xy
        assert math.cos(math.atan2(away[1], away[0]) - post.yaw) == pytest.approx(1.0)
    assert [run.step(column)[name].role for name in "bc"] == [Role.REAR] * 2


def test_the_nearest_robot_fetches_a_straggler_from_the_side_away_from_the_group():
    run = Run("abc", way=STRAIGHT)
    people = np.append(THREE, [[4.0, -1.0]], axis=0)
    out = run.step(people, straggler=3, moving=False)
    assert [name for name in "abc" if out[name].role is Role.FETCHER] == ["c"]
    off = out["c"].xy - people[3]
    assert np.hypot(*off) == pytest.approx(1.3)
    assert off @ (people[3] - [9.5, 0.0]) > 0.9 * 1.3 * np.hypot(5.5, 1.0)
    assert math.atan2(*-off[::-1]) == pytest.approx(out["c"].yaw)
    # Once chosen it goes on, though another one is nearer.
    run.robots |= poses("b", {"b": (3.5, -1.0)})
    assert run.step(people, straggler=3, moving=False)["c"].role is Role.FETCHER
    assert run.step(THREE)["c"].role is Role.REAR


def test_a_robot_that_sees_everybody_where_it_stands_stays_there():
    run = Run("ab")
    run.robots |= poses("b", {"b": (6.9, 0.6)})
    post = run.steps(20, [[9.0, 0.0]], moving=False)["b"]
    assert post.xy == pytest.approx([6.9, 0.6])


def test_who_has_not_been_seen_brings_a_post_that_sees_them():
    # From no post can both be seen; the robot is between the posts that see one.
    run, people = Run("ab", formation={"reach": 2.6}), np.array([[9.0, 1.9], [9.0, -1.9]])
    run.robots |= poses("b", {"b": (7.7, 0.0)})
    for unseen_s in ([4.0, 0.0], [0.0, 4.0]):
        out = run.steps(20, people, leader_m=20.0, unseen_s=np.array(unseen_s))
        assert out["b"].xy[1] * (unseen_s[0] - unseen_s[1]) > 0.0


def test_posts_stay_while_they_are_good():
    run, rng = Run("abc"), np.random.default_rng(3)
    first = run.step()
    for _ in range(25):
        out = run.step(THREE + rng.normal(0.0, 0.05, THREE.shape))
        for name in "bc":
            assert np.hypot(*(out[name].xy - first[name].xy)) < 0.4


def test_a_better_view_is_taken_after_the_hold_and_not_before():
    run = Run("ab", formation={"hold": 3.0, "hysteresis": 0.05})
    alone = [[9.0, 0.0]]
    hidden = [[10.4, 0.0], [9.8, 0.0], [9.0, 0.0]]
    run.robots |= poses("b", {"b": (7.7, 0.0)})
    before = run.step(alone)["b"].xy[1]
    assert run.steps(14, hidden)["b"].xy[1] == pytest.approx(before)
    assert abs(run.steps(2, hidden)["b"].xy[1] - before) >= 0.5


def test_a_robot_that_fails_and_returns():
    run = Run("abcd")
    run.steps(3)
    lost = run.robots.pop("d")
    assert run.step().keys() == {"a", "b", "c"}
    run.robots["d"] = lost
    out = run.step()
    places = np.array([post.xy for post in out.values()])
    assert len(out) == 4
    assert _least(places, places) >= 0.9 - 1e-9


def test_nobody_is_seen_and_nobody_follows():
    out = Run("abc").step(np.empty((0, 2)), leader_m=5.0)
    assert out["a"].xy == pytest.approx([5.0, 0.0])
    assert max(out[name].xy[0] for name in "bc") == pytest.approx(5.0 - 1.6 - 1.3)


def test_without_a_free_post_a_robot_stays_and_looks_at_the_group():
    run = Run("ab", space=corridor(0.5), safety={"wall_distance": 0.3})
    post = run.step([[10.0, 0.0]])["b"]
    assert post.xy == pytest.approx([7.0, 1.0])
    assert post.yaw == pytest.approx(math.atan2(-1.0, 3.0))


def _least(one, other):
    away = np.linalg.norm(one[:, None] - other, axis=2)
    if one is other:
        away[np.diag_indices(len(one))] = np.inf
    return away.min()


@st.composite
def groups(draw):
    n = draw(st.integers(1, 8))
    x = draw(st.lists(st.floats(7.0, 12.0), min_size=n, max_size=n))
    y = draw(st.lists(st.floats(-1.2, 1.2), min_size=n, max_size=n))
    return np.array([x, y]).T


@settings(max_examples=30)
@given(groups(), st.booleans(), st.sampled_from([6.0, 2.4, 1.4]))
def test_posts_are_apart_off_people_and_free(people, moving, width):
    space = corridor(width)
    run = Run("abcd", space=space)
    run.formation._moved_s = -10.0
    posts = run.step(people, moving=moving)
    places = np.array([post.xy for post in posts.values()])
    assert _least(places, places) >= 0.9 - 1e-6
    assert _least(places[1:], people) >= 0.85 * 1.3 - 1e-6
    assert (space.clearance(places) >= 0.35).all()


@settings(max_examples=30)
@given(groups())
def test_ways_to_posts_do_not_cross(people):
    run = Run("abcd")
    start = {name: np.array([pose.x, pose.y]) for name, pose in run.robots.items()}
    posts = run.step(people)
    for one, other in (("b", "c"), ("b", "d"), ("c", "d")):
        assert not _cross(start[one], posts[one].xy, start[other], posts[other].xy)


def _cross(a, b, c, d):
    def side(p, q, r):
        return (q[0] - p[0]) * (r[1] - p[1]) - (q[1] - p[1]) * (r[0] - p[0])

    return side(a, b, c) * side(a, b, d) < -1e-9 and side(c, d, a) * side(c, d, b) < -1e-9


@pytest.mark.parametrize("moving", [True, False])
def test_a_group_as_in_a_mirror_gets_posts_as_in_a_mirror(moving):
    people, flip = np.array([[10.0, 0.9], [9.6, -0.3], [9.1, 0.5], [8.2, 0.8]]), [1.0, -1.0]
    one, other = (Run("abc").steps(20, of, moving=moving) for of in (people, people * flip))
    xy = sorted(tuple(np.round(one[name].xy, 6)) for name in "bc")
    mirrored = sorted(tuple(np.round(other[name].xy * flip, 6)) for name in "bc")
    assert xy == mirrored

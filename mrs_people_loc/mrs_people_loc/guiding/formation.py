"""Posts of the robots around the group, chosen by what the team would see from them.

The leader is on the way, ahead of the group. The others have posts behind it and, while it stands,
beside it: of all sets of candidates that are free, apart and off people, the one from which the
team sees most. Candidates are laid out along the way, relative to the group, so that posts move on
with it and bend with the way; where the way is narrow they shrink to its middle line, one behind
the other.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import linear_sum_assignment

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Bool, Float, Int, StructOfArrays
from mrs_people_loc.geometry import wrap_angle
from mrs_people_loc.guiding import views
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.guidance import Post, Role
from mrs_people_loc.guiding.way import Way
from mrs_people_loc.team.poses import Pose


@dataclass(frozen=True)
class FormationTuning:
    """Constants of the posts, chosen by hand.

    Attributes:
        margin: Posts are farther apart than robots have to be, and farther from walls, by these
            [m, m].
        rows: Posts behind the group are the distance from people and so many times the distance
            from robot to robot behind the last person.
        columns: ... and so far to the left of the group's middle [m].
        beside: Posts beside a standing group: at these shares of its length, from its rear on,
        off: ... and so many times the distance to its left and right.
        ahead: While the group moves a post has to be free for so far ahead [m].
        narrowing: Where a post is not free, its distance from the way shrinks by these factors.
        closer: A post may be nearer to people than the distance, by this factor: they move.
        second_side: What it is worth to see a person from a second side, from `side` [rad] on;
            to see them at all is worth 1.
        unseen: Who is not seen is worth more by this each second,
        unseen_s: ... for this time [1/s, s].
        farther: What it costs to be behind, per metre, as a share of all that can be seen.
        changed: An assignment that keeps a robot on its post may be longer by this [m].
        drift: The group's ends and middle move by at most this [m/s]: people appear and vanish.
        around: Angles between the posts of a fetcher around a straggler [rad].
    """

    margin: tuple[float, float] = (0.3, 0.1)
    rows: tuple[float, ...] = (0.0, 0.5, 1.0, 2.0)
    columns: tuple[float, ...] = (0.0, -0.35, 0.35, -0.7, 0.7, -1.05, 1.05, -1.5, 1.5, -2.0, 2.0)
    beside: tuple[float, ...] = (0.0, 0.5, 1.0)
    off: tuple[float, ...] = (1.0, 1.6)
    ahead: tuple[float, ...] = (0.0, 0.5, 1.0)
    narrowing: tuple[float, ...] = (1.0, 0.8, 0.6, 0.4, 0.2, 0.0)
    closer: float = 0.85
    second_side: float = 0.25
    side: float = math.radians(60.0)
    unseen: float = 0.5
    unseen_s: float = 4.0
    farther: float = 0.02
    changed: float = 0.5
    drift: float = 1.5
    around: float = math.radians(30.0)


FORMATION_TUNING = FormationTuning()


@dataclass(frozen=True)
class Scenery:
    """What the posts are chosen from.

    Attributes:
        people: Those who are guided, stragglers too [m], shape (n, 2).
        people_m: How far along the way each is [m], shape (n,).
        straggler: Index of the person to fetch; None: nobody.
        leader: Name of the robot that leads.
        leader_m: Where on the way its post is [m].
        leader_speed: Its speed on the way there [m/s].
        robots: Poses of those that take part, by name; the leader, too.
        moving: Whether the group goes on; else the robots turn to it.
        now_s: Time [s].
        unseen_s: For how long each person has not been seen [s], shape (n,); None: all are seen.
    """

    people: Float
    people_m: Float
    straggler: int | None
    leader: str
    leader_m: float
    leader_speed: float
    robots: Mapping[str, Pose]
    moving: bool
    now_s: float
    unseen_s: Float | None = None


@dataclass(frozen=True)
class _Frame:
    """The group along the way: its rear, its front, and its middle's distance to the left [m]."""

    rear: float
    front: float
    left: float
    half_width: float

    def towards(self, other: _Frame, step: float) -> _Frame:
        """This one, each number by at most a step nearer to that of another."""
        one, two = (np.array([f.rear, f.front, f.left, f.half_width]) for f in (self, other))
        return _Frame(*(one + np.clip(two - one, -step, step)).tolist())


@dataclass(frozen=True)
class _Candidates(StructOfArrays):
    """Posts to choose from: where, where the head looks, what it costs; the number stays."""

    number: Int
    xy: Float
    gaze: Float
    cost: Float
    beside: Bool


class FormationPlanner:
    """Chooses posts, and keeps them while they are good.

    Args:
        config: Parameters.
        way: Of the tour.
        space: Where robots may be.
        tuning: Constants.
    """

    def __init__(
        self,
        config: cfg.GuideConfig,
        way: Way,
        space: FreeSpace,
        tuning: FormationTuning = FORMATION_TUNING,
    ) -> None:
        self._config, self._way, self._space, self._tuning = config, way, space, tuning
        self._frame: _Frame | None = None
        self._time_s = self._chosen_s = self._moved_s = -math.inf
        self._held: dict[str, int] = {}
        self._fetcher, self._fetcher_angle = "", math.nan

    def configure(self, config: cfg.GuideConfig) -> None:
        """Takes another configuration, from the next step on."""
        self._config = config

    def step(self, now: Scenery) -> dict[str, Post]:
        """Posts of all robots that take part.

        Args:
            now: Where people and robots are.
        """
        others = [name for name in now.robots if name != now.leader]
        frame = self._follow(now)
        posts = {}
        if now.leader in now.robots:
            posts[now.leader] = self._leader(now)
        if now.straggler is not None and others:
            self._fetcher = self._who_fetches(now, others)
            posts[self._fetcher] = self._fetch(now, now.people[now.straggler])
            others.remove(self._fetcher)
        else:
            self._fetcher, self._fetcher_angle = "", math.nan
        return posts | self._behind(now, frame, others, posts)

    # ------------------------------------------------------------------------------ the group ----

    def _follow(self, now: Scenery) -> _Frame:
        """The group's frame, which moves on steadily."""
        keep = np.arange(len(now.people)) != (-1 if now.straggler is None else now.straggler)
        if not keep.any():
            keep[:] = True
        frame = self._frame_of(now.people[keep], now.people_m[keep], now.leader_m)
        past = now.now_s - self._time_s
        if self._frame is not None and 0.0 <= past < 2.0:
            frame = self._frame.towards(frame, self._tuning.drift * past)
        self._frame, self._time_s = frame, now.now_s
        if now.moving:
            self._moved_s = now.now_s
        return frame

    def _frame_of(self, people: Float, people_m: Float, leader_m: float) -> _Frame:
        if not len(people):
            last = leader_m - self._config.pace.lead
            return _Frame(last, last, 0.0, 0.0)
        ahead = self._way.ahead(people_m)
        off = people - self._way.at(people_m)
        left = ahead[:, 0] * off[:, 1] - ahead[:, 1] * off[:, 0]
        low, high = float(left.min()), float(left.max())
        return _Frame(
            float(people_m.min()), float(people_m.max()), 0.5 * (low + high), 0.5 * (high - low)
        )

    def _centre(self, frame: _Frame) -> Float:
        return self._way.at(0.5 * (frame.rear + frame.front), frame.left)

    def _yaw(self, gaze: float, robot: str, along: float, moving: bool) -> float:
        """Heading of a base whose head is to look somewhere."""
        yaw = gaze + math.pi if robot in self._config.looks_back else gaze
        reverses = moving and math.cos(yaw - along) < 0.0
        return wrap_angle(along if reverses and self._config.base.max_reverse == 0.0 else yaw)

    # --------------------------------------------------------------------- leader and fetcher ----

    def _leader(self, now: Scenery) -> Post:
        xy = self._way.at(now.leader_m)
        along = _angle(self._way.ahead(now.leader_m))
        gaze = along + math.pi
        if not now.moving and self._frame is not None:
            gaze = _angle(self._centre(self._frame) - xy)
        yaw = self._yaw(gaze, now.leader, along, now.moving)
        return Post(Role.LEADER, xy, yaw, now.leader_speed)

    def _who_fetches(self, now: Scenery, others: Sequence[str]) -> str:
        if self._fetcher in others:
            return self._fetcher
        goal = now.people[now.straggler if now.straggler is not None else 0]
        return min(others, key=lambda name: math.dist(_place(now.robots[name]), goal))

    def _fetch(self, now: Scenery, straggler: Float) -> Post:
        """A post beside a straggler, on the side that is away from the group."""
        tuning, config = self._tuning, self._config
        frame = self._frame
        away = math.nan if frame is None else _angle(straggler - self._centre(frame))
        turns = np.arange(round(2.0 * math.pi / tuning.around)) * tuning.around
        preferred = away if math.isnan(self._fetcher_angle) else self._fetcher_angle
        angles = preferred + turns
        xy = straggler + config.formation.distance * np.stack(
            [np.cos(angles), np.sin(angles)], axis=1
        )
        bad = ~(self._is_free(xy) & self._space.is_visible(xy, straggler[np.newaxis]))
        off = np.linalg.norm(xy[:, np.newaxis] - now.people, axis=2).min(axis=1)
        bad |= off < tuning.closer * config.formation.distance
        turned = np.abs((angles - away + math.pi) % (2.0 * math.pi) - math.pi)
        changed = 0.25 * math.pi * (turns != 0.0)
        best = int(np.argmin(turned + changed + 10.0 * bad))
        self._fetcher_angle = float(angles[best])
        gaze = self._fetcher_angle + math.pi
        yaw = self._yaw(gaze, self._fetcher, gaze, moving=False)
        return Post(Role.FETCHER, xy[best], yaw, config.base.max_speed)

    # ------------------------------------------------------------------------------ all others ----

    def _behind(
        self, now: Scenery, frame: _Frame, names: Sequence[str], fixed: Mapping[str, Post]
    ) -> dict[str, Post]:
        """Posts of those behind and beside the group."""
        candidates = self._candidates(now, frame, fixed)
        rows = self._choose(now, candidates, names, fixed)
        xy = candidates.xy[rows]
        robots = np.array([_place(now.robots[name]) for name in names]).reshape(-1, 2)
        cost = np.linalg.norm(robots[:, np.newaxis] - xy, axis=2)
        held = np.array([self._held.get(name, -1) for name in names], dtype=np.intp)
        cost -= self._tuning.changed * (held[:, np.newaxis] == candidates.number[rows])
        chosen = dict(zip(*linear_sum_assignment(cost), strict=True))
        posts, self._held = {}, {}
        for k, name in enumerate(names):
            if k not in chosen:  # no free post: it stays, and looks at the group
                gaze = _angle(self._centre(frame) - robots[k])
                yaw = self._yaw(gaze, name, gaze, moving=False)
                posts[name] = Post(Role.REAR, robots[k], yaw, self._config.base.max_speed)
                continue
            row = rows[chosen[k]]
            gaze = float(candidates.gaze[row])
            yaw = self._yaw(gaze, name, gaze, now.moving)
            role = Role.SIDE if candidates.beside[row] else Role.REAR
            posts[name] = Post(role, candidates.xy[row], yaw, self._config.base.max_speed)
            self._held[name] = int(candidates.number[row])
        return posts

    def _candidates(self, now: Scenery, frame: _Frame, fixed: Mapping[str, Post]) -> _Candidates:
        """Posts that are free, off people and apart from those that are taken."""
        tuning, config = self._tuning, self._config
        apart, distance = self._apart, config.formation.distance
        rows, columns = np.array(tuning.rows) * apart, np.array(tuning.columns)
        back = np.repeat(rows, len(columns))
        along = frame.rear - distance - back
        left = np.tile(columns, len(rows))
        still = now.now_s - self._moved_s >= config.formation.hold
        if still and not now.moving:
            off = frame.half_width + distance * np.array(tuning.off)
            share, aside = np.meshgrid(tuning.beside, np.append(-off, off))
            length = frame.front - frame.rear
            along = np.append(along, frame.rear + share.ravel() * length)
            left = np.append(left, aside.ravel())
        xy, free = self._narrowed(along, frame.left + left, now.moving)
        near = np.linalg.norm(xy[:, np.newaxis] - now.people, axis=2) < tuning.closer * distance
        taken = np.array([post.xy for post in fixed.values()]).reshape(-1, 2)
        close = np.linalg.norm(xy[:, np.newaxis] - taken, axis=2) < apart
        gaze = _angles(self._way.ahead(along) if now.moving else self._centre(frame) - xy)
        number = np.arange(len(xy))
        cost = tuning.farther * np.append(back, np.zeros(len(xy) - len(back)))
        every = _Candidates(number, xy, gaze, cost, number >= len(back))
        return every.select(free & ~near.any(axis=1) & ~close.any(axis=1))

    @property
    def _apart(self) -> float:
        return self._config.safety.robot_distance + self._tuning.margin[0]

    def _is_free(self, xy: Float) -> Bool:
        least = self._config.safety.wall_distance + self._tuning.margin[1]
        return np.asarray(self._space.clearance(xy) >= least)

    def _narrowed(self, along: Float, left: Float, moving: bool) -> tuple[Float, Bool]:
        """Places, moved towards the way until they are free, and whether they are."""
        factors = np.array(self._tuning.narrowing)
        ahead = np.array(self._tuning.ahead if moving else (0.0,))
        lefts = left[:, np.newaxis] * factors
        way = along[:, np.newaxis, np.newaxis] + ahead
        swept = self._way.at(way, lefts[..., np.newaxis])
        free = self._is_free(swept)
        # On the way itself as near to walls as robots may be: there the tour was checked.
        free[:, -1] = self._space.clearance(swept[:, -1]) >= self._config.safety.wall_distance
        xy = swept[..., 0, :]
        reached = self._space.is_visible(self._way.at(along)[:, np.newaxis], xy)
        good = free.all(axis=-1) & reached
        first = good.argmax(axis=1)
        every = np.arange(len(along))
        return xy[every, first], good[every, first]

    def _choose(
        self, now: Scenery, candidates: _Candidates, names: Sequence[str],
        fixed: Mapping[str, Post],
    ) -> Int:  # fmt: skip
        """Rows of the candidates that are taken: as many as there are robots, or as can be."""
        config = self._config.formation
        held = [
            int(row) for name in names
            for row in np.flatnonzero(candidates.number == self._held.get(name, -1))
        ]  # fmt: skip
        apart = np.linalg.norm(candidates.xy[:, np.newaxis] - candidates.xy, axis=2) >= self._apart
        kept = len(held) == len(names) == len(self._held) and all(
            apart[a, b] for a, b in itertools.combinations(held, 2)
        )
        if kept and now.now_s - self._chosen_s < config.hold:
            return np.array(held, dtype=np.intp)
        size = len(names)
        while not len(sets := _sets(apart, size)):
            size -= 1
        worth = self._worth(now, candidates, fixed, sets)
        best = int(worth.argmax())
        if kept:
            current = np.array(sorted(held), dtype=np.intp)
            same = int((sets == current).all(axis=1).argmax())
            if worth[best] <= worth[same] * (1.0 + config.hysteresis):
                return current
        self._chosen_s = now.now_s
        return np.asarray(sets[best])

    def _worth(
        self, now: Scenery, candidates: _Candidates, fixed: Mapping[str, Post], sets: Int
    ) -> Float:
        """What sets of posts are worth, given the posts that are fixed, shape (c,)."""
        tuning = self._tuning
        taken = np.array([post.xy for post in fixed.values()]).reshape(-1, 2)
        gaze = [
            post.yaw + (math.pi if name in self._config.looks_back else 0.0)
            for name, post in fixed.items()
        ]
        team = views.TeamView(
            np.concatenate([candidates.xy, taken]), np.append(candidates.gaze, gaze), now.people,
            self._config.formation, self._space, tuning.side,
        )  # fmt: skip
        always = np.arange(len(candidates), len(candidates) + len(taken))
        sets_of_all = np.concatenate([sets, np.broadcast_to(always, (len(sets), len(taken)))], 1)
        seen, second = team.of(sets_of_all)
        unseen_s = np.zeros(len(now.people)) if now.unseen_s is None else now.unseen_s
        weight = 1.0 + tuning.unseen * np.minimum(unseen_s, tuning.unseen_s)
        worth = (seen + tuning.second_side * second) @ weight / max(weight.sum(), 1.0)
        return np.asarray(worth - candidates.cost[sets].sum(axis=1))


def _sets(apart: Bool, size: int) -> Int:
    """All sets of so many candidates, any two of them apart, each ascending, shape (c, size)."""
    every = itertools.combinations(range(len(apart)), size)
    sets = np.array(list(every), dtype=np.intp).reshape(-1, size) if size else np.empty((1, 0), int)
    good = np.ones(len(sets), dtype=bool)
    for a, b in itertools.combinations(range(size), 2):
        good &= apart[sets[:, a], sets[:, b]]
    return sets[good]


def _place(pose: Pose) -> tuple[float, float]:
    return pose.x, pose.y


def _angle(vector: Float) -> float:
    return math.atan2(vector[1], vector[0])


def _angles(vectors: Float) -> Float:
    return np.asarray(np.arctan2(vectors[:, 1], vectors[:, 0]))

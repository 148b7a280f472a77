"""Posts of the robots around the group, chosen by what the team would see from them.

The leader is on the way, ahead of the group. The others have posts behind it and, while it stands,
beside it: of all sets of candidates that are free, apart and off people, the one from which the
team sees most, less what it costs to go there. Candidates are laid out along the way, relative to
the group, so that posts move on with it and bend with the way; where the way is narrow they shrink
to its middle line, one behind the other.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Bool, Float, Int
from mrs_people_loc.geometry import wrap_angle
from mrs_people_loc.guiding.candidates import Candidates, Frame, Layout, angle_of
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.guidance import Post, Role
from mrs_people_loc.guiding.views import TeamView
from mrs_people_loc.guiding.way import Way
from mrs_people_loc.team.poses import Pose


@dataclass(frozen=True)
class FormationTuning:
    """Constants of the choice of posts, chosen by hand.

    Attributes:
        second_side: What it is worth to see a person from a second side, from `side` [rad] on;
            to see them at all is worth 1.
        unseen: Who is not seen is worth more by this each second,
        unseen_s: ... for this time [1/s, s].
        changed: An assignment that keeps a robot on its post may be longer by this [m].
        most: Sets of three posts are made of so many candidates: those that are worth most alone.
        follow_s: Posts behind a group that moves are ahead of where they belong by its way in this
            time [s]: people are known late, and robots trail a post that moves.
        drift: The group's ends and middle move by at most this [m/s]: people appear and vanish.
        pause_s: ... unless they come after a longer pause [s].
        around: Angle between the posts of a fetcher around a straggler [rad].
        other_side: A fetcher goes to another one only where it is nearer to the side away from
            the group by this [rad].
        not_free: ... and to one that is not free only where none is: it counts as farther by this
            [rad].
    """

    second_side: float = 0.25
    side: float = math.radians(60.0)
    unseen: float = 0.5
    unseen_s: float = 4.0
    changed: float = 0.5
    most: int = 20
    follow_s: float = 0.3
    drift: float = 1.5
    pause_s: float = 2.0
    around: float = math.radians(30.0)
    other_side: float = math.radians(45.0)
    not_free: float = 10.0


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
        leader_left: How far to the left of the way its post is [m].
        robots: Poses of those that take part, by name; the leader, too.
        moving: Whether the group goes on; else the robots turn to it.
        overtakes: Whether the leader has to pass the group first; then it looks where it drives.
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
    overtakes: bool = False
    leader_left: float = 0.0


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
        self._layout = Layout(config, way, space)
        self._frame: Frame | None = None
        self._time_s = self._chosen_s = self._moved_s = -math.inf
        self._held: dict[str, int] = {}
        self._numbers: dict[str, int] = {}
        self._fetcher, self._fetcher_angle = "", math.nan

    def configure(self, config: cfg.GuideConfig, space: FreeSpace) -> None:
        """Takes another configuration and another map, from the next step on."""
        self._config = self._layout.config = config
        self._space = self._layout.space = space

    def step(self, now: Scenery) -> dict[str, Post]:
        """Posts of all robots that take part.

        Args:
            now: Where people and robots are.
        """
        frame = self._follow(now)
        others = [name for name in now.robots if name != now.leader]
        posts = {}
        if now.leader in now.robots:
            posts[now.leader] = self._lead(now, frame)
        if now.straggler is not None and others:
            straggler = now.people[now.straggler]
            self._fetcher = self._who_fetches(now, straggler, others)
            posts[self._fetcher] = self._fetch(now, frame, straggler)
            others.remove(self._fetcher)
        else:
            self._fetcher, self._fetcher_angle = "", math.nan
        return posts | self._accompany(now, frame, others, posts)

    def _follow(self, now: Scenery) -> Frame:
        """The group's frame without the straggler; it moves on steadily."""
        keep = np.arange(len(now.people)) != (-1 if now.straggler is None else now.straggler)
        if len(now.people):
            keep = keep if keep.any() else ~keep
            frame = Frame.of(self._way, now.people[keep], now.people_m[keep])
        else:
            last = now.leader_m - self._config.pace.lead
            frame = Frame(last, last, 0.0, 0.0)
        past_s = now.now_s - self._time_s
        if self._frame is not None and 0.0 <= past_s < self._tuning.pause_s:
            frame = self._frame.towards(frame, self._tuning.drift * past_s)
        self._frame, self._time_s = frame, now.now_s
        if now.moving:
            self._moved_s = now.now_s
        return frame

    def _yaw(self, gaze: float, robot: str, along: float | None = None) -> float:
        """Heading of a base whose head is to look somewhere.

        Args:
            gaze: Where to [rad].
            robot: Its name.
            along: Where it drives meanwhile [rad]; None: nowhere.
        """
        yaw = gaze + math.pi if robot in self._config.looks_back else gaze
        if along is not None and math.cos(yaw - along) < 0.0 and not self._config.base.max_reverse:
            return wrap_angle(along)
        return wrap_angle(yaw)

    # --------------------------------------------------------------------- leader and fetcher ----

    def _lead(self, now: Scenery, frame: Frame) -> Post:
        xy = self._way.at(now.leader_m, now.leader_left)
        along = angle_of(self._way.ahead(now.leader_m))
        if now.overtakes:
            yaw = self._yaw(along, now.leader)
        elif now.moving:
            yaw = self._yaw(along + math.pi, now.leader, along)
        else:
            yaw = self._yaw(angle_of(frame.centre(self._way) - xy), now.leader)
        return Post(Role.LEADER, xy, yaw, now.leader_speed)

    def _who_fetches(self, now: Scenery, straggler: Float, others: Sequence[str]) -> str:
        if self._fetcher in others:
            return self._fetcher
        return min(others, key=lambda name: math.dist(_place(now.robots[name]), straggler))

    def _fetch(self, now: Scenery, frame: Frame, straggler: Float) -> Post:
        """A post beside a straggler, as far as possible on the side away from the group."""
        away = angle_of(straggler - frame.centre(self._way))
        held = away if math.isnan(self._fetcher_angle) else self._fetcher_angle
        count = round(2.0 * math.pi / self._tuning.around)
        angles = held + self._tuning.around * np.arange(count, dtype=np.float64)
        xy, good = self._layout.beside(straggler, now.people, angles)
        cost = np.abs((angles - away + math.pi) % (2.0 * math.pi) - math.pi)
        cost[1:] += self._tuning.other_side
        best = int(np.argmin(np.where(good, cost, cost + self._tuning.not_free)))
        self._fetcher_angle = float(angles[best])
        yaw = self._yaw(self._fetcher_angle + math.pi, self._fetcher)
        return Post(Role.FETCHER, xy[best], yaw, self._config.base.max_speed)

    # ---------------------------------------------------------------------------- all others ----

    def _accompany(
        self, now: Scenery, frame: Frame, names: Sequence[str], fixed: Mapping[str, Post]
    ) -> dict[str, Post]:
        """Posts behind and beside the group."""
        candidates = self._candidates(now, frame, names, fixed)
        rows = self._choose(now, candidates, names, fixed)
        taken = candidates.select(rows)
        assigned = self._assign(now, taken, names)
        speed, posts, self._held = self._config.base.max_speed, {}, {}
        shift = self._tuning.follow_s * now.leader_speed if now.moving else 0.0
        for name in names:
            if name not in assigned:  # no free post: it stays, and looks at the group
                here = np.array(_place(now.robots[name]))
                yaw = self._yaw(angle_of(frame.centre(self._way) - here), name)
                posts[name] = Post(Role.REAR, here, yaw, speed)
                continue
            row = assigned[name]
            gaze = float(taken.gaze[row])
            yaw = self._yaw(gaze, name, gaze if now.moving else None)
            role = Role.SIDE if taken.beside[row] else Role.REAR
            xy = taken.xy[row] + shift * np.array([math.cos(gaze), math.sin(gaze)])
            posts[name] = Post(role, xy, yaw, speed)
            self._held[name] = int(taken.number[row])
        return posts

    def _candidates(
        self, now: Scenery, frame: Frame, names: Sequence[str], fixed: Mapping[str, Post]
    ) -> Candidates:
        """Posts that are apart from those that are fixed."""
        if now.moving:
            found = self._layout.behind(frame, now.people)
        else:
            robots = {
                self._numbers.setdefault(name, len(self._numbers)): np.array(
                    _place(now.robots[name])
                )
                for name in names
            }
            still = now.now_s - self._moved_s >= self._config.formation.hold
            found = self._layout.around(frame, now.people, robots, beside=still)
        taken = np.array([post.xy for post in fixed.values()]).reshape(-1, 2)
        away = np.linalg.norm(found.xy[:, np.newaxis] - taken, axis=2)
        return found.select((away >= self._layout.apart).all(axis=1))

    def _assign(self, now: Scenery, taken: Candidates, names: Sequence[str]) -> dict[str, int]:
        """Which post each robot takes: the least sum of distances, so that ways do not cross."""
        from scipy.optimize import linear_sum_assignment  # here: it takes long to load

        robots = np.array([_place(now.robots[name]) for name in names]).reshape(-1, 2)
        held = np.array([self._held.get(name, -1) for name in names], dtype=np.intp)
        cost = np.linalg.norm(robots[:, np.newaxis] - taken.xy, axis=2)
        cost -= self._tuning.changed * (held[:, np.newaxis] == taken.number)
        pairs = zip(*linear_sum_assignment(cost), strict=True)
        return {names[robot]: int(row) for robot, row in pairs}

    def _choose(
        self,
        now: Scenery,
        candidates: Candidates,
        names: Sequence[str],
        fixed: Mapping[str, Post],
    ) -> Int:
        """Rows of the candidates that are taken: as many as there are robots, or as can be."""
        config = self._config.formation
        numbers = [self._held.get(name, -1) for name in names]
        held = np.flatnonzero(np.isin(candidates.number, numbers))
        away = np.linalg.norm(candidates.xy[:, np.newaxis] - candidates.xy, axis=2)
        apart = away >= self._layout.apart
        kept = len(held) == len(names) == len(self._held) and all(
            apart[a, b] for a, b in itertools.combinations(held, 2)
        )
        if kept and now.now_s - self._chosen_s < config.hold:
            return held
        sets = self._possible(now, candidates, fixed, apart, len(names), held)
        worth = self._worth(now, candidates, fixed, sets)
        best = int(worth.argmax())
        if kept:
            same = int((sets == held).all(axis=1).argmax())
            if worth[best] <= worth[same] + config.hysteresis * abs(worth[same]):
                return held
        self._chosen_s = now.now_s
        return np.asarray(sets[best])

    def _possible(
        self,
        now: Scenery,
        candidates: Candidates,
        fixed: Mapping[str, Post],
        apart: Bool,
        size: int,
        held: Int,
    ) -> Int:
        """Sets of so many posts that are apart, or of as many as can be, shape (c, size)."""
        if size > 2 and len(candidates) > self._tuning.most:
            single = np.arange(len(candidates))
            worth = self._worth(now, candidates, fixed, single[:, np.newaxis])
            best = np.union1d(np.argsort(-worth, kind="stable")[: self._tuning.most], held)
            sets = _sets(apart[np.ix_(best, best)], size)
            if len(sets):
                return np.asarray(best[sets])
        while not len(sets := _sets(apart, size)):
            size -= 1
        return sets

    def _worth(
        self, now: Scenery, candidates: Candidates, fixed: Mapping[str, Post], sets: Int
    ) -> Float:
        """What sets of posts are worth beside those that are fixed, shape (c,)."""
        tuning, config = self._tuning, self._config
        taken = np.array([post.xy for post in fixed.values()]).reshape(-1, 2)
        back = [math.pi if name in config.looks_back else 0.0 for name in fixed]
        gaze = np.array([post.yaw for post in fixed.values()]) + back
        team = TeamView(
            np.concatenate([candidates.xy, taken]),
            np.append(candidates.gaze, gaze),
            now.people,
            config.formation,
            self._space,
            tuning.side,
        )
        always = np.arange(len(candidates), len(candidates) + len(taken))
        always = np.broadcast_to(always, (len(sets), len(taken)))
        seen, second = team.of(np.concatenate([sets, always], axis=1))
        unseen_s = np.zeros(len(now.people)) if now.unseen_s is None else now.unseen_s
        weight = 1.0 + tuning.unseen * np.minimum(unseen_s, tuning.unseen_s)
        worth = (seen + tuning.second_side * second) @ weight / max(weight.sum(), 1.0)
        return np.asarray(worth - candidates.cost[sets].sum(axis=1))


def _sets(apart: Bool, size: int) -> Int:
    """All sets of so many candidates, any two of them apart, each ascending, shape (c, size)."""
    if not size:
        return np.empty((1, 0), dtype=np.intp)
    every = itertools.combinations(range(len(apart)), size)
    sets = np.array(list(every), dtype=np.intp).reshape(-1, size)
    good = np.ones(len(sets), dtype=bool)
    for a, b in itertools.combinations(range(size), 2):
        good &= apart[sets[:, a], sets[:, b]]
    return sets[good]


def _place(pose: Pose) -> tuple[float, float]:
    return pose.x, pose.y

"""A group that walks with its own dynamics, and the team that drives with it in formation.

Everybody is driven by forces, as in `motion.walk_about` (Helbing & Molnar, Social force model for
pedestrian dynamics, Physical Review E 51, 1995): towards their goal at their preferred speed, away
from people, robots, walls and furniture. Members of the group are held together, too: they slow
down or hurry along the way when they are ahead of the others or behind, and are drawn to the
group's centre when they are far from it (Moussaid et al., The walking behaviour of pedestrian
social groups and its impact on crowd dynamics, PLoS ONE 5(4), 2010). Preferred speeds and sides
wander. The magnitudes are ours, chosen so that walks look plausible.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import CubicSpline

from mrs_people_loc.geometry import wrap_angle
from mrs_people_loc.guiding.way import Way
from mrs_people_sim.models.rooms import SIZES
from mrs_people_sim.motion import LEAD_S, STEP_S, Track, push, rounded, times
from mrs_people_sim.scene import Person, Robot, Scene

Rng = np.random.Generator

#: Step of the simulation [s].
_DT = 2 * STEP_S
#: Axes of two people never come closer than this [m].
_APART = 0.42
#: A straggler stays this far behind the group's middle [m].
_BEHIND = 4.6
#: A person who dawdles goes on when they are this far from the group's centre [m].
_DAWDLED = 1.5
#: A goal or start this close to a wall is a door: who reaches it is gone [m].
_DOOR = 0.7
#: Robots keep their axis this far from people, other robots, and walls and furniture [m].
_ROBOT_PERSON, _ROBOT_ROBOT, _ROBOT_WALL = 0.75, 0.75, 0.40
#: Fastest a robot drives [m/s], speeds up [m/s^2] and turns [rad/s].
_ROBOT_SPEED, _ROBOT_PUSH, _ROBOT_TURN = 1.6, 2.0, 0.9
#: A loop goes on for this much longer than anybody walks [m].
_LOOP_EXTRA = 32.0
#: Where somebody is who is not there: nobody is near [m].
_NOWHERE = 1.0e4


@dataclass(frozen=True)
class Walked:
    """What became of a walk.

    Attributes:
        people: Tracks, by index of the person.
        robots: Tracks, by name.
        groups: Number of the group that each person of the scene belongs to, 0 for none; one row
            every `step` seconds from `start` on, shape (samples, people).
        start: Time of the first row [s].
        step: Time between rows [s].
    """

    people: dict[int, Track]
    robots: dict[str, Track]
    groups: NDArray
    start: float
    step: float

    def groups_at(self, time: float) -> NDArray:
        """Number of each person's group at a time [s], int32, shape (people,)."""
        row = round((time - self.start) / self.step)
        found: NDArray = self.groups[min(max(row, 0), len(self.groups) - 1)]
        return found


def way_of(scene: Scene) -> Way:
    """The way of a scene's group: what `walk.path` says, or along the middle of the room."""
    walk, room = scene.walk, scene.room
    path = walk.path
    if not path:
        if room.length >= room.width:
            path = (0.8, room.width / 2, room.length - 0.8, room.width / 2)
        else:
            path = (room.length / 2, 0.8, room.length / 2, room.width - 0.8)
    duration = (scene.timing.frames - 1) / scene.timing.rate
    return way_along(path, loop=walk.loop, length=1.5 * walk.speed * duration)


def way_along(path: Sequence[float], *, loop: bool = False, length: float = 0.0) -> Way:
    """The way along a path.

    Args:
        path: x0, y0, x1, y1, ... [m].
        loop: Whether its end leads to its beginning, again and again.
        length: At least so long, if it is a loop [m].
    """
    points = np.array(path, dtype=np.float64).reshape(-1, 2)
    if loop:
        around = np.linalg.norm(np.diff(points, axis=0, append=points[:1]), axis=1).sum()
        rounds = math.ceil((length + _LOOP_EXTRA) / around)
        points = np.concatenate([*([points] * rounds), points[:1]])
    return Way(rounded(points, 201), rounding=0.0)


class Boxes:
    """Walls of the room and what stands in it, as boxes that nobody enters.

    Args:
        scene: The scene.
    """

    def __init__(self, scene: Scene) -> None:
        self._size = np.array([scene.room.length, scene.room.width])
        pieces = [f for f in scene.furniture if f.z < 1.0]
        self._centre = np.array([[f.x, f.y] for f in pieces]).reshape(-1, 2)
        edges = [(f.size or SIZES[f.kind])[:2] for f in pieces]
        self._half = 0.5 * np.array(edges).reshape(-1, 2)
        yaw = np.array([f.yaw for f in pieces])
        self._cos, self._sin = np.cos(yaw), np.sin(yaw)

    def clearances(self, places: NDArray) -> tuple[NDArray, NDArray]:
        """How far places are from each wall and thing, and which way is out.

        Args:
            places: Where [m], shape (n, 2).

        Returns:
            Distances [m], negative inside, shape (n, 4 + things), and unit vectors away, shape
            (n, 4 + things, 2).
        """
        n = len(places)
        walls = np.concatenate([places, self._size - places], axis=1)
        out = np.broadcast_to([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]], (n, 4, 2))
        if not len(self._centre):
            return walls, out
        off = places[:, None] - self._centre
        x = off[..., 0] * self._cos + off[..., 1] * self._sin
        y = off[..., 1] * self._cos - off[..., 0] * self._sin
        local = np.stack([x, y], axis=-1)
        beyond = np.abs(local) - self._half
        outside = np.maximum(beyond, 0.0)
        away = np.linalg.norm(outside, axis=-1)
        inside = away == 0.0
        sign = np.where(local < 0, -1.0, 1.0)
        nearest = (beyond == beyond.max(axis=-1, keepdims=True)) * sign
        normal = np.where(
            inside[..., None], nearest, outside * sign / np.maximum(away, 1e-9)[..., None]
        )
        away = np.where(inside, beyond.max(axis=-1), away)
        turned = np.stack(
            [
                normal[..., 0] * self._cos - normal[..., 1] * self._sin,
                normal[..., 0] * self._sin + normal[..., 1] * self._cos,
            ],
            axis=-1,
        )
        return np.concatenate([walls, away], axis=1), np.concatenate([out, turned], axis=1)

    def at_wall(self, place: Sequence[float]) -> bool:
        """Whether there is a door: it is so close to a wall of the room."""
        at = np.asarray(place[:2])
        return bool(min(at.min(), (self._size - at).min()) < _DOOR)


class Wander:
    """Numbers of mean 0 and deviation 1 that change slowly, one per person."""

    def __init__(self, count: int, periods: tuple[float, float], rng: Rng) -> None:
        self._rate = 2 * math.pi / rng.uniform(*periods, (4, count))
        self._phase = rng.uniform(0, 2 * math.pi, (4, count))

    def at(self, time: float) -> NDArray:
        """The numbers at a time [s], shape (count,)."""
        waves: NDArray = np.sin(self._rate * time + self._phase).sum(axis=0) / math.sqrt(2.0)
        return waves


def walk_together(
    scene: Scene,
    others: Mapping[int, Track],
    robots: Mapping[str, Track],
    duration: float,
    rng: Rng,
) -> Walked:
    """Walks the members of a scene's group, those who walk on their own, and the team.

    Args:
        scene: The scene, its layout expanded.
        others: Tracks of people who do neither, by index.
        robots: Tracks of robots without a post, by name.
        duration: Length of the scene [s].
        rng: Source of randomness.
    """
    return _Simulation(scene, others, robots, duration, rng).run()


class _Simulation:
    def __init__(
        self,
        scene: Scene,
        others: Mapping[int, Track],
        robots: Mapping[str, Track],
        duration: float,
        rng: Rng,
    ) -> None:
        self._scene, self._walk = scene, scene.walk
        self._way, self._boxes = way_of(scene), Boxes(scene)
        self._others = [*others.values(), *robots.values()]
        self._indices = [k for k, p in enumerate(scene.people) if p.member or p.walks]
        self._people: list[Person] = [scene.people[k] for k in self._indices]
        self._names = [name for name, robot in scene.robots.items() if robot.post]
        self._team: list[Robot] = [scene.robots[name] for name in self._names]
        self._times = np.arange(-LEAD_S, duration + LEAD_S + 2 * _DT, _DT)
        self._duration = duration
        n = len(self._people)
        people = self._people
        self._member = np.array([p.member for p in people], dtype=bool)
        self._speed = np.array([p.speed for p in people])
        never = math.inf
        # When somebody begins to fall behind, and how long they then stay far behind.
        self._behind = np.array([p.behind or (never, 0.0) for p in people]).reshape(n, 2)
        self._leaves = np.array([p.leaves if p.leaves >= 0 else never for p in people])
        self._joins = np.array([p.joins for p in people])
        goals = [p.goal or (p.x, p.y) for p in people]
        self._goals = np.array(goals, dtype=np.float64).reshape(n, 2)
        self._door = np.array([bool(p.goal) and self._boxes.at_wall(p.goal) for p in people])
        self._tempo = Wander(n, (5.0, 16.0), rng)
        self._side = Wander(n, (9.0, 30.0), rng)
        self._order = Wander(n, (12.0, 40.0), rng)
        self._pauses, self._looks = self._dawdling(rng)
        #: Half the group's length along the way.
        self._reach = 0.25 + 0.35 * self._walk.gap * math.sqrt(max(int(self._member.sum()), 1))
        self._start_people()
        self._start_team()
        self._reference = self._posts()

    def _start_people(self) -> None:
        """The state of the people at the beginning."""
        people, n = self._people, len(self._people)
        self._position = np.array([[p.x, p.y] for p in people], dtype=np.float64).reshape(n, 2)
        self._along = self._way.nearest(self._position) if n else np.zeros(0)
        self._left = (self._joins < 0) & self._member  # in the group now
        self._gone = np.zeros(n, dtype=bool)
        # Where members like to be: before or behind the others, left or right.
        ahead = self._way.ahead(self._along) if n else np.zeros((0, 2))
        aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
        offset = ((self._position - self._way.at(self._along)) * aside).sum(axis=1)
        self._offset = np.clip(offset, -self._walk.width / 2, self._walk.width / 2)
        self._velocity = np.where(self._left[:, None], ahead * self._walk.speed, 0.0)
        self._facing = np.array([[math.cos(p.yaw), math.sin(p.yaw)] for p in people]).reshape(n, 2)
        self._facing[self._left] = ahead[self._left]
        self._middle = float(self._along[self._left].mean()) if self._left.any() else 0.0
        self._last = float(self._along[self._left].min()) if self._left.any() else 0.0

    def _start_team(self) -> None:
        """The state of the team at the beginning."""
        self._pace = self._walk.speed
        lead = max((r.post[0] for r in self._team if r.post), default=0.0)
        self._end = self._way.length - max(lead, 0.0) - 0.5
        self._drive = np.array([[r.x, r.y] for r in self._team], dtype=np.float64).reshape(-1, 2)
        self._driving = np.zeros_like(self._drive)
        if len(self._team) and len(self._people):
            self._driving += self._way.ahead(self._middle) * self._walk.speed
        self._heading = np.array([r.yaw for r in self._team], dtype=np.float64)

    def _dawdling(self, rng: Rng) -> tuple[NDArray, NDArray]:
        """When each member stops to look at something, and to which side.

        Returns:
            Beginning and end of each pause [s], shape (n, pauses, 2), and 1 for left, -1 for
            right, shape (n,).
        """
        pauses: list[list[tuple[float, float]]] = []
        for _ in self._people:
            mine, time = [], 0.0
            while self._walk.dawdle > 0:
                time += rng.exponential(60.0 / self._walk.dawdle)
                if time > self._duration:
                    break
                lasts = rng.uniform(1.5, 4.0)
                mine.append((time, time + lasts))
                time += lasts
            pauses.append(mine)
        most = max((len(mine) for mine in pauses), default=0)
        filled = [mine + [(math.inf, math.inf)] * (most - len(mine)) for mine in pauses]
        found = np.array(filled, dtype=np.float64).reshape(len(pauses), most, 2)
        return found, rng.choice((-1.0, 1.0), len(pauses))

    # --------------------------------------------------------------------------- people ----

    def run(self) -> Walked:
        count, n = len(self._times), len(self._people)
        ways, faces = np.empty((count, n, 2)), np.empty((count, n, 2))
        there = np.empty((count, n), dtype=bool)
        drives, headings = np.empty((count, *self._drive.shape)), np.empty((count, len(self._team)))
        groups = np.zeros((count, len(self._scene.people)), dtype=np.int32)
        for k, now in enumerate(self._times):
            ways[k], faces[k], there[k] = self._position, self._facing, ~self._gone
            drives[k], headings[k] = self._drive, self._heading
            groups[k, self._indices] = self._left & ~self._gone
            self._step(float(now))
        t = times(self._duration)
        yaws = np.unwrap(np.arctan2(faces[..., 1], faces[..., 0]), axis=0)
        people, robots = {}, {}
        for i, index in enumerate(self._indices):
            xy = CubicSpline(self._times, ways[:, i])(t)
            seen = there[np.rint((t - self._times[0]) / _DT).astype(int), i]
            xy[~seen] = np.nan
            people[index] = Track(-LEAD_S, xy, CubicSpline(self._times, yaws[:, i])(t))
        for i, name in enumerate(self._names):
            xy = CubicSpline(self._times, drives[:, i])(t)
            yaw = CubicSpline(self._times, np.unwrap(headings[:, i]))(t)
            robots[name] = Track(-LEAD_S, xy, yaw, free=True)
        return Walked(people, robots, groups, -LEAD_S, _DT)

    def _step(self, now: float) -> None:
        wish = self._wishes(now)
        force = (wish - self._velocity) / 0.5 + self._forces(now, wish)
        strong = np.linalg.norm(force, axis=1, keepdims=True)
        force *= np.minimum(1.0, 6.0 / np.maximum(strong, 1e-9))
        self._velocity = self._velocity + force * _DT
        pace = np.linalg.norm(self._velocity, axis=1, keepdims=True)
        fastest = np.maximum(1.9 * self._walk.speed, 1.3 * self._speed)[:, None]
        self._velocity *= np.minimum(1.0, fastest / np.maximum(pace, 1e-6))
        before = self._position
        self._position = self._kept_apart(before + self._velocity * _DT, now)
        self._velocity = (self._position - before) / _DT
        self._gone |= (
            self._door
            & (~self._member | (now >= self._leaves))
            & (np.linalg.norm(self._goals - self._position, axis=1) < 0.3)
        )
        self._along = self._way.nearest(self._position, self._along)
        self._turn(now)
        self._bookkeeping(now)
        self._drive_on()

    def _bookkeeping(self, now: float) -> None:
        """Who is in the group, and where it is along the way."""
        left = self._left & (now < self._leaves)
        if left.any():
            centre = self._position[left].mean(axis=0)
            self._go_on(now, centre)
            away = np.linalg.norm(self._position - centre, axis=1)
            comes = self._member & ~self._left & (now >= self._joins) & (self._joins >= 0)
            comes &= (now < self._leaves) & (away < self._reach + 0.9)
            if comes.any():
                # The part of the way that they are on may have changed in the meantime.
                near = np.full(int(comes.sum()), self._along[left].mean())
                self._along[comes] = self._way.nearest(self._position[comes], near)
                left |= comes
        self._left = left
        far_behind = self._straggling(now) & (self._far_behind(now) > _BEHIND - 0.3)
        self._behind[:, 1] -= np.where(far_behind, _DT, 0.0)
        if left.any():
            with_it = left & ~self._straggling(now)
            chosen = with_it if with_it.any() else left
            # Smoothly, also when somebody comes or goes, and without falling behind them.
            pace = float((self._velocity * self._way.ahead(self._along)).sum(axis=1)[chosen].mean())
            self._pace += (pace - self._pace) * _DT / 0.5
            self._middle += self._smoothly(float(self._along[chosen].mean()) - self._middle)
            self._last += self._smoothly(float(self._along[left].min()) - self._last)

    def _smoothly(self, behind: float) -> float:
        """How far something goes on in a step that is so far behind where it should be [m]."""
        step = self._pace * _DT + behind * (1.0 - math.exp(-_DT / 0.8))
        return float(np.clip(step, -0.8 * _DT, 1.6 * _DT))

    def _straggling(self, now: float) -> NDArray:
        found: NDArray = (now >= self._behind[:, 0]) & (self._behind[:, 1] > 0)
        return found

    def _lag(self) -> NDArray:
        """How far everybody is behind the group's middle along the way [m], shape (n,)."""
        return self._middle - self._along

    def _far_behind(self, now: float) -> NDArray:
        """How far everybody is behind those who go on [m], shape (n,).

        As the crow flies, but round a corner not much less than along the way.
        """
        chosen = self._left & ~self._straggling(now)
        if not chosen.any():
            return self._lag()
        away = np.linalg.norm(self._position - self._position[chosen].mean(axis=0), axis=1)
        lag = self._lag()
        found: NDArray = np.maximum(np.minimum(lag, away), lag - 1.5)
        return found

    def _wishes(self, now: float) -> NDArray:
        """Velocities that people would like to have [m/s], shape (n, 2)."""
        walk, way = self._walk, self._way
        lag = self._lag()
        # Members: along the way, on their side of it, at their own pace, near the others.
        pace = walk.speed * (1.0 + 0.15 * self._tempo.at(now))
        pace *= np.clip((self._end - self._middle) / 1.0, 0.0, 1.0)
        place = lag + 0.4 * walk.wander * self._reach * self._order.at(now)
        beyond = np.sign(place) * np.maximum(np.abs(place) - 0.6 * self._reach, 0.0)
        pace = np.clip(pace + 0.5 * beyond, 0.55 * pace, 1.7 * walk.speed)
        straggling = self._straggling(now)
        behind = self._far_behind(now)
        slow = np.clip(self._pace + 0.5 * (behind - _BEHIND), 0.0, 1.7 * walk.speed)
        slow = np.where(behind < _BEHIND, np.minimum(slow, 0.15 * walk.speed), slow)
        pace = np.where(straggling, slow, pace)
        pace = np.where(self._dawdles(now) & ~straggling, 0.0, pace)
        if len(self._drive):
            # Nobody overtakes the guide.
            lead = [i for i, r in enumerate(self._team) if r.post[0] > 0 and abs(r.post[1]) < 0.8]
            if lead:
                guide = float(self._way_of_robots()[lead].max())
                pace = pace * np.clip((guide - 0.9 - self._along) / 0.6, 0.0, 1.0)
        half = walk.width / 2
        side = np.clip(self._offset + 0.45 * walk.wander * half * self._side.at(now), -half, half)
        ahead = way.at(self._along + 1.2, side) - self._position
        wish = unit(ahead) * pace[:, None]
        # Others: to their goals; who has not joined yet waits, then makes for the group.
        left = np.linalg.norm(self._goals - self._position, axis=1, keepdims=True)
        free = unit(self._goals - self._position) * self._speed[:, None]
        free *= np.where(self._door[:, None], 1.0, np.minimum(1.0, left / 0.5))
        if self._left.any():
            centre = self._position[self._left].mean(axis=0)
            coming = unit(centre + 0.8 * way.ahead(self._middle) * walk.speed - self._position)
            coming *= 1.5 * walk.speed
            comes = self._member & ~self._left & (now < self._leaves)
            waits = comes & (now < self._joins)
            free = np.where(comes[:, None], np.where(waits[:, None], 0.0, coming), free)
        found: NDArray = np.where(self._left[:, None], wish, free)
        return found

    def _dawdles(self, now: float) -> NDArray:
        pauses = self._pauses
        return np.asarray(((pauses[..., 0] <= now) & (now < pauses[..., 1])).any(axis=1))

    def _go_on(self, now: float, centre: NDArray) -> None:
        """Members that are left behind while they look at something have seen enough."""
        far = np.linalg.norm(self._position - centre, axis=1) > _DAWDLED
        far &= (self._along < self._middle) & self._dawdles(now)
        begun = far[:, None] & (self._pauses[..., 0] <= now)
        self._pauses[..., 1] = np.where(
            begun, np.minimum(self._pauses[..., 1], now), self._pauses[..., 1]
        )

    def _forces(self, now: float, wish: NDArray) -> NDArray:
        """Accelerations by what is near, shape (n, 2) [m/s^2]."""
        position = self._real()
        # Groups that keep close let others come closer, too.
        close = min(0.5, 0.2 + 0.375 * self._walk.gap)
        force = push(position, position, close, skip_self=True)
        force += self._comfort(position, wish, self._straggling(now) | self._dawdles(now))
        there = self._fixed(now)
        if len(there):
            force += push(position, there, 0.55)
        if len(self._drive):
            force += push(position, self._drive, 0.75)
        gap, out = self._boxes.clearances(self._position)
        force += (6.0 * np.exp(-(gap - 0.28) / 0.12)[..., None] * out).sum(axis=1)
        # Cohesion: to the centre of the group, whoever is far from it (Moussaid et al. 2010).
        held = self._left & ~self._straggling(now) & ~self._dawdles(now)
        if held.any():
            centre = position[held].mean(axis=0)
            away = centre - position
            far = np.linalg.norm(away, axis=1)
            pull = 0.6 * np.clip(far - 1.3 * self._reach, 0.0, 1.0) * held
            force += pull[:, None] * unit(away)
        return force

    def _comfort(self, position: NDArray, wish: NDArray, stays: NDArray) -> NDArray:
        """What keeps people a step apart; strangers who meet evade to the right."""
        away = position[:, None] - position[None]
        distance = np.linalg.norm(away, axis=2)
        both = self._left[:, None] & self._left[None]
        strength = np.where(
            both,
            0.5 * np.exp(-(distance - self._walk.gap) / 0.15),
            1.6 * np.exp(-(distance - 0.9) / 0.25),
        )
        np.fill_diagonal(strength, 0.0)
        towards = -away / np.maximum(distance, 1e-6)[..., None]
        heading = unit(wish)
        ahead = (towards * heading[:, None]).sum(axis=2)
        # In the group all around: were it only those in front, all would go slower and slower.
        strength = np.minimum(strength, 3.0) * np.where(both, 1.0, 0.35 + 0.325 * (1.0 + ahead))
        # Past them, on the side where they are not; two who meet head-on keep to the right.
        side = heading[:, None, 0] * towards[..., 1] - heading[:, None, 1] * towards[..., 0]
        closing = ((wish[:, None] - self._velocity[None]) * towards).sum(axis=2)
        meets = (wish[:, None] * self._velocity[None]).sum(axis=2) < -0.1
        evade = np.where(meets & (np.abs(side) < 0.3) | (side > 0), -1.0, 1.0)
        aside = np.stack([-heading[:, 1], heading[:, 0]], axis=1)
        past = np.where((ahead > 0.4) & (closing > 0.1), np.where(meets, 1.0, 0.7), 0.0) * evade
        direction = -towards + past[..., None] * aside[:, None]
        total: NDArray = (strength[..., None] * direction).sum(axis=1)
        # Who stays behind is not pushed along by the others.
        along = self._way.ahead(self._along)
        onward = np.maximum((total * along).sum(axis=1), 0.0) * (stays & self._left)
        total -= onward[:, None] * along
        return total

    def _real(self) -> NDArray:
        """Positions; those who are gone are far from everybody and from each other."""
        nowhere = _NOWHERE * (1.0 + np.arange(len(self._position)))[:, None]
        return np.where(self._gone[:, None], nowhere, self._position)

    def _fixed(self, now: float) -> NDArray:
        """Where those are whose way is given [m], shape (k, 2)."""
        there = np.array([[p.x, p.y] for p in (o.at(now) for o in self._others)]).reshape(-1, 2)
        return there[np.isfinite(there).all(axis=1)]

    def _kept_apart(self, places: NDArray, now: float) -> NDArray:
        """The places, moved so that no body is in another, in a robot or in a wall."""
        fixed = self._fixed(now)
        for _ in range(3):
            alone = np.where(self._gone, np.nan, 1.0)[:, None]
            away = (places * alone)[:, None] - (places * alone)[None]
            distance = np.linalg.norm(away, axis=2)
            np.fill_diagonal(distance, np.inf)
            lack = np.maximum(_APART - np.nan_to_num(distance, nan=np.inf), 0.0)
            move = 0.5 * lack[..., None] * away / np.maximum(distance, 1e-6)[..., None]
            places = places + np.nan_to_num(move).sum(axis=1)
            for solid, least in ((self._drive, 0.5), (fixed, _APART)):
                if len(solid):
                    away = places[:, None] - solid[None]
                    distance = np.linalg.norm(away, axis=2)
                    lack = np.maximum(least - distance, 0.0)
                    places = places + (
                        lack[..., None] * away / np.maximum(distance, 1e-6)[..., None]
                    ).sum(axis=1)
            gap, out = self._boxes.clearances(places)
            places = places + (np.maximum(0.24 - gap, 0.0)[..., None] * out).sum(axis=1)
        return np.where(self._gone[:, None], self._position, places)

    def _turn(self, now: float) -> None:
        """People face where they go; who dawdles looks aside."""
        pace = np.linalg.norm(self._velocity, axis=1, keepdims=True)
        gain = np.clip(pace / 0.5 - 0.2, 0.0, 1.0) * _DT / 0.3
        target = unit(self._velocity)
        idle = (self._dawdles(now) & self._left)[:, None] & (pace < 0.3)
        ahead = self._way.ahead(self._along)
        aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1) * self._looks[:, None]
        gain = np.where(idle, _DT / 0.6, gain)
        target = np.where(idle, aside, target)
        # Round the nearer side: about face is a turn, not a jump.
        across = self._facing[:, 0] * target[:, 1] - self._facing[:, 1] * target[:, 0]
        cosine = (self._facing * target).sum(axis=1)
        angle = np.arctan2(across, cosine) * gain[:, 0]
        angle = np.clip(angle, -4.0 * _DT, 4.0 * _DT)
        c, s = np.cos(angle), np.sin(angle)
        x, y = self._facing.T
        self._facing = np.stack([c * x - s * y, s * x + c * y], axis=1)

    # --------------------------------------------------------------------------- robots ----

    def _way_of_robots(self) -> NDArray:
        near = np.array([self._base(r) + r.post[0] for r in self._team])
        return self._way.nearest(self._drive, near)

    def _base(self, robot: Robot) -> float:
        """Where along the way a robot's post is measured from [m]."""
        return min(self._last, self._middle) if robot.sweeps else self._middle

    def _posts(self) -> NDArray:
        """Where the robots should be [m], shape (robots, 2)."""
        if not self._team:
            return np.zeros((0, 2))
        along = np.array([self._base(r) + r.post[0] for r in self._team])
        return self._way.at(along, np.array([r.post[1] for r in self._team]))

    def _drive_on(self) -> None:
        """Robots make for their posts; they never close in on what is near."""
        if not self._team:
            return
        posts = self._posts()
        ahead = (posts - self._reference) / _DT
        self._reference = posts
        want = ahead + 1.0 * (posts - self._drive)
        want = shortened(want, _ROBOT_SPEED)
        people = self._real()
        gap, out = self._boxes.clearances(self._drive)
        for i in range(len(self._team)):
            for _ in range(4):
                for places, speeds, least in (
                    (people, self._velocity, _ROBOT_PERSON),
                    (np.delete(self._drive, i, 0), np.delete(self._driving, i, 0), _ROBOT_ROBOT),
                ):
                    away = places - self._drive[i]
                    distance = np.linalg.norm(away, axis=1)
                    for j in np.flatnonzero(distance < 2.5):
                        to = away[j] / max(distance[j], 1e-6)
                        limit = 1.2 * (distance[j] - least) + min(float(speeds[j] @ to), 0.5)
                        want[i] -= max(float(want[i] @ to) - limit, 0.0) * to
                for j in np.flatnonzero(gap[i] < 1.5):
                    limit = 1.5 * (gap[i, j] - _ROBOT_WALL)
                    want[i] += max(float(-want[i] @ out[i, j]) - limit, 0.0) * out[i, j]
        want = shortened(want, _ROBOT_SPEED)
        change = shortened((want - self._driving) / _DT, _ROBOT_PUSH)
        self._driving = self._driving + change * _DT
        drive = self._drive + self._driving * _DT
        gap, out = self._boxes.clearances(drive)
        drive = drive + (np.maximum(0.28 - gap, 0.0)[..., None] * out).sum(axis=1)
        self._drive = drive
        self._look()

    def _look(self) -> None:
        """Robots turn to the group, as fast as they can turn smoothly."""
        if not self._left.any():
            return
        centre = self._position[self._left].mean(axis=0)
        last = self._way.at(self._last)
        for i, robot in enumerate(self._team):
            at = 0.5 * (centre + last) if robot.sweeps else centre
            x, y = at - self._drive[i]
            turn = wrap_angle(math.atan2(y, x) - self._heading[i]) / 0.7
            self._heading[i] += float(np.clip(turn, -_ROBOT_TURN, _ROBOT_TURN)) * _DT


def unit(vectors: NDArray) -> NDArray:
    """The vectors, of length 1; zero where they are zero."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    found: NDArray = vectors / np.maximum(length, 1e-6)
    return found


def shortened(vectors: NDArray, longest: NDArray | float) -> NDArray:
    """The vectors, none of them longer than that."""
    length = np.linalg.norm(vectors, axis=-1, keepdims=True)
    found: NDArray = vectors * np.minimum(1.0, longest / np.maximum(length, 1e-9))
    return found

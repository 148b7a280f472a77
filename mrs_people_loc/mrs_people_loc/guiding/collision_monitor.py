"""What is in the way limits a robot's velocity, whatever the map and the people say.

The semantics are those of Nav2's Collision Monitor, model "approach" (docs.nav2.org): the robot, a
circle, is moved along the arc that it is to drive, and its speed is scaled so that the time to the
first contact stays at least `time_before_collision`; a source that has delivered and falls silent
stops it. Beyond that:

- `stop_distance` is left to what is in the way. The robot may always turn, and drive away.
- It is no faster than it can brake within what is left, its reaction included.
- What was seen is moved by the robot's own motion since, and counts for the longer time before a
  collision the older it is. What is out of scan now, such as somebody who is too near for a
  head, is remembered until the sensor sees that it is gone.
- Where no sensor sees the way, the robot is no faster than `crawl`.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import Enum
from typing import Any, NamedTuple

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray

from mrs_people_loc.arrays import Bool, Float, StructOfArrays
from mrs_people_loc.config import CollisionMonitoring
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.guiding.drive import Velocity
from mrs_people_loc.guiding.obstacles import SECTORS, ObstacleScan


@dataclass(frozen=True)
class MonitorTuning:
    """Constants of the monitor, chosen by hand.

    Attributes:
        reaction: A command takes effect after this time [s].
        own: What is nearer to base_link than this share of the radius is part of the robot.
        sideways: What touches the robot, and lies in a direction whose cosine from that of its
            motion is less than this, is not come nearer to.
        stands: A lower speed than this is none [m/s].
        most_wanted: A command of more than this is an error [m/s], [rad/s].
        rounds: A lower speed makes another arc of the same turn, which is looked at again, so often
            at most.
        gap: Nobody fits between sectors that are seen and nearer together than twice this [rad],
            unless ...
        cone: ... the field of view is as narrow as this, as that of a sonar [rad]: it is deaf to
            whose middle is beside it, and its echoes, which may be anywhere across it, are neither
            remembered nor followed.
        near: The way is looked at from this distance on [m]: what is nearer is seen in the same
            direction, or was.
        step: In these steps [m].
        aside: ... and so many places to both sides of it, as far as from where who `walks` is in
            the way when the robot is, or before it has stopped.
        memory: What is out of the field of view is remembered for so long [s], ...
        long_memory: ... and for so long where it is nearer than `near`, where sensors have gaps
            [s].
        behind: What is seen so far behind it shows that an obstacle is gone [m].
        most_age: What was seen earlier counts as so old [s].
        most_points: Remembered of a source, at most.
        odometry: Without odometry for so long, motion is that of the commands [s].
        walks: What moves, and who comes from where no sensor looks, may go in any direction as
            fast as this [m/s].
        moved: What a sensor sees where it saw past it by more than this [m], and this share of the
            range, ...
        before: ... at a time of from so long ago to so long ago [s] ...
        around: ... and in so many sectors to both sides of it, moves.
        forward: ... and by so much of that ahead of where it was.
        margin: Nearer than this beyond the radius is contact with what moves [m]; ...
        horizon: ... looked for within this time [s], ...
        dt: ... in these steps [s].
        history: Motion is remembered for so long [s].
    """

    reaction: float = 0.2
    own: float = 0.5
    sideways: float = 0.2
    stands: float = 0.01
    most_wanted: float = 20.0
    rounds: int = 4
    gap: float = 0.14
    cone: float = 1.0
    near: float = 0.7
    step: float = 0.1
    aside: int = 4
    memory: float = 2.0
    long_memory: float = 10.0
    behind: float = 0.3
    most_age: float = 0.5
    most_points: int = 1000
    odometry: float = 0.3
    walks: float = 1.2
    moved: tuple[float, float] = (0.15, 0.08)
    before: tuple[float, float] = (0.15, 0.6)
    around: int = 2
    forward: float = 0.5
    margin: float = 0.15
    horizon: float = 2.0
    dt: float = 0.05
    history: float = 2.0


MONITOR_TUNING = MonitorTuning()


class Action(Enum):
    """What the monitor does."""

    PASSES = "passes"
    SLOWS = "slows"
    CRAWLS = "crawls"
    STOPS = "stops"
    FAILS = "fails"


@dataclass(frozen=True)
class Verdict:
    """What a robot may do.

    Attributes:
        velocity: To be driven.
        action: What has become of the wanted velocity.
        reason: Why, in words; empty: it passes.
    """

    velocity: Velocity = (0.0, 0.0)
    action: Action = Action.PASSES
    reason: str = ""


@dataclass(frozen=True)
class _Obstacles(StructOfArrays):
    """Points of obstacles.

    Attributes:
        xy: [m], shape (n, 2).
        moves: Which of them do, shape (n,).
        seen_s: When they were seen [s], shape (n,).
    """

    xy: Float
    moves: Bool
    seen_s: Float


class _Past(NamedTuple):
    """A scan of before.

    Attributes:
        scan: It.
        seen_s: Of that time [s].
        free: How far it saw in each sector and in those around it [m], shape (SECTORS,).
    """

    scan: ObstacleScan
    seen_s: float
    free: Float


@dataclass(frozen=True)
class _Source:
    """What is known by one sensor.

    Attributes:
        scan: Its last one.
        seen_s: Of that time [s].
        came_s: When it came [s].
        covered: The sectors that are seen, or that nobody fits into, shape (SECTORS,).
        obstacles: What it has seen, in the frame of `_Motion`.
        past: Scans of before.
    """

    scan: ObstacleScan
    seen_s: float
    came_s: float
    covered: Bool
    obstacles: _Obstacles
    past: tuple[_Past, ...] = ()


class CollisionMonitor:
    """Limits the velocity of one robot.

    Times are seconds of one clock that is never set back.

    Args:
        config: Parameters; may be replaced at any time.
        tuning: Constants.

    Attributes:
        expected: Names of sensors that have to deliver: before they have, the robot stands.
    """

    def __init__(self, config: CollisionMonitoring, tuning: MonitorTuning = MONITOR_TUNING) -> None:
        self.config, self._tuning = config, tuning
        self._pressed: dict[str, bool] = {}
        self._refused: dict[str, str] = {}
        self.expected: tuple[str, ...] = ()
        self.reset()

    def reset(self) -> None:
        """Forgets all that was seen; a bumper stays as it was."""
        self._sources: dict[str, _Source] = {}
        self._refused.clear()
        self._motion = _Motion(self._tuning)

    # ---- inputs ----

    def take_scan(self, name: str, scan: ObstacleScan, seen_s: float, now_s: float) -> None:
        """Takes what a sensor sees.

        Args:
            name: The sensor's.
            scan: What it sees.
            seen_s: When it did [s].
            now_s: Now [s].
        """
        tuning, before = self._tuning, self._sources.get(name)
        self._refused.pop(name, None)
        past: tuple[_Past, ...] = ()
        self._motion.advance(now_s)
        is_cone = np.count_nonzero(scan.looks) < tuning.cone / (2.0 * math.pi) * SECTORS
        if before is not None and not is_cone:
            through = np.where(before.scan.seen, before.scan.ranges, 0.0)
            free = _around(through, tuning.around).min(axis=1)
            past = (*before.past, _Past(before.scan, before.seen_s, free))
            past = tuple(one for one in past if one.seen_s >= seen_s - tuning.before[1])
        points = self._motion.from_robot(scan.places, seen_s)
        moves = self._were_free(points, past, seen_s)
        new = _Obstacles(points, moves, np.full(len(points), seen_s))
        new = new.select(np.hypot(*scan.places.T) > tuning.own * self.config.radius)
        if before is not None and not is_cone:
            kept = before.obstacles.select(self._are_out_of_sight(before, scan, seen_s))
            new = _Obstacles.joined([new, kept]).select(slice(tuning.most_points))
        covered = scan.seen if is_cone else _widened(scan.seen, tuning.gap)
        self._sources[name] = _Source(scan, seen_s, now_s, covered, new, past)
        for other in self._sources.keys() - {name}:
            self._sources[other] = self._without_gone(self._sources[other], scan, seen_s)

    def _were_free(self, points: Float, past: Sequence[_Past], seen_s: float) -> Bool:
        """Where a sensor saw past a place a moment ago, shape (n,)."""
        tuning, free = self._tuning, np.zeros(len(points), dtype=bool)
        for one in past if len(points) else ():
            if one.seen_s <= seen_s - tuning.before[0]:
                sectors, away = one.scan.sectors_of(self._motion.to_robot(points, one.seen_s))
                free |= one.free[sectors] > away + tuning.moved[0] + tuning.moved[1] * away
        return free

    def _are_out_of_sight(self, before: _Source, scan: ObstacleScan, seen_s: float) -> Bool:
        """What was seen before and may be there still, as nothing is seen in its direction."""
        sectors, away = scan.sectors_of(self._motion.to_robot(before.obstacles.xy, seen_s))
        age_s, tuning = seen_s - before.obstacles.seen_s, self._tuning
        fresh = age_s < np.where(away < tuning.near, tuning.long_memory, tuning.memory)
        unseen = ~scan.seen[sectors]
        return np.asarray(unseen & (away < scan.reach) & (scan.looks[sectors] | fresh))

    def _without_gone(self, source: _Source, scan: ObstacleScan, seen_s: float) -> _Source:
        """A source without what has left its field of view, and another sensor sees to be gone."""
        remembered = source.obstacles.seen_s < source.seen_s
        if not remembered.any():
            return source
        here = self._motion.to_robot(source.obstacles.xy, seen_s)
        sectors, away = scan.sectors_of(here)
        seen_through = scan.seen[sectors] & (scan.ranges[sectors] > away + self._tuning.behind)
        out = ~source.scan.looks[source.scan.sectors_of(here)[0]]
        kept = ~(remembered & out & seen_through)
        return replace(source, obstacles=source.obstacles.select(kept))

    def refuse(self, name: str, why: str) -> None:
        """What a sensor says cannot be used: the robot stands until something can."""
        self._refused[name] = why

    def take_odometry(self, x: float, y: float, yaw: float, at_s: float) -> None:
        """Takes where the robot is by its odometry [m], [rad], at a time [s]."""
        self._motion.take_odometry((x, y, yaw), at_s)

    def take_contact(self, name: str, *, pressed: bool) -> None:
        """Takes what a bumper says, or what else stops the robot while it is true."""
        self._pressed[name] = pressed

    # ---- outputs ----

    def step(self, wanted: Velocity, now_s: float) -> Verdict:
        """What the robot may drive with until the next step.

        Args:
            wanted: Speed ahead [m/s] and rate of turn [rad/s] that it is told to drive with.
            now_s: Now [s].
        """
        self._motion.advance(now_s)
        verdict = self._judge(wanted, now_s)
        self._motion.velocity = verdict.velocity
        return verdict

    def obstacles(self, now_s: float) -> Float:
        """What is known around the robot, in base_link [m], shape (n, 2)."""
        return self._known(now_s).xy

    def _judge(self, wanted: Velocity, now_s: float) -> Verdict:
        speed, turn = wanted
        fault = self._fault(now_s)
        most = self._tuning.most_wanted
        if not (abs(speed) <= most and abs(turn) <= most):  # NaN compares false
            fault = fault or f"the command is {speed:g} m/s, {turn:g} rad/s"
        if fault:
            return Verdict(action=Action.FAILS, reason=fault)
        if abs(speed) < self._tuning.stands:
            return Verdict((0.0, turn))
        left, action, why = self._past_obstacles(wanted, now_s)
        most = self._seen_speed((math.copysign(left, speed), turn))
        if most < left:
            left, action, why = most, Action.CRAWLS, "no sensor sees where it drives"
        return Verdict((math.copysign(left, speed) if left else 0.0, turn), action, why)

    def _past_obstacles(self, wanted: Velocity, now_s: float) -> tuple[float, Action, str]:
        """The highest speed that obstacles allow [m/s], and why."""
        known, (speed, turn) = self._known(now_s), wanted
        left, action, why = abs(speed), Action.PASSES, ""
        for _ in range(self._tuning.rounds):
            velocity = math.copysign(left, speed), turn
            allowed, nearest = self._most_speed(known, velocity, abs(speed), now_s)
            if allowed >= left:
                break
            left, action = allowed, Action.SLOWS
            why = _in_words(known.xy[nearest], self._source_of(nearest))
            if left < self._tuning.stands:
                return 0.0, Action.STOPS, why
        return left, action, why

    def _fault(self, now_s: float) -> str:
        """Why the robot has to stand, whatever is around it; empty: it has not."""
        for name, pressed in self._pressed.items():
            if pressed:
                return f"{name} is true"
        for name, why in self._refused.items():
            return f"{name} {why}"
        for name in self.expected:
            if name not in self._sources:
                return f"nothing has come of {name} yet"
        timeout = self.config.source_timeout
        for name, source in self._sources.items():
            silent_s = now_s - source.came_s
            if silent_s > timeout:
                return f"nothing has come of {name} for {silent_s:.1f} s; allowed: {timeout:g} s"
            age_s = source.came_s - source.seen_s
            if age_s > timeout:
                return f"{name} is {age_s:.1f} s old when it comes; allowed: {timeout:g} s"
        return ""

    def _known(self, now_s: float) -> _Obstacles:
        """Obstacles in base_link, source by source."""
        parts = [one.obstacles for one in self._sources.values()]
        if not parts:
            return _Obstacles(np.empty((0, 2)), np.empty(0, dtype=bool), np.empty(0))
        known = _Obstacles.joined(parts)
        return replace(known, xy=self._motion.to_robot(known.xy, now_s))

    def _source_of(self, point: int) -> str:
        """The name of the source of one of the known points."""
        ends = np.cumsum([len(one.obstacles) for one in self._sources.values()])
        return list(self._sources)[int(np.searchsorted(ends, point, side="right"))]

    def _most_speed(
        self, known: _Obstacles, velocity: Velocity, wanted: float, now_s: float
    ) -> tuple[float, int]:
        """The highest speed [m/s] that obstacles allow on an arc, and the one that does so.

        Args:
            known: Obstacles in base_link.
            velocity: Of the arc.
            wanted: Speed that is scaled by times to collision [m/s].
            now_s: Now [s].
        """
        if not len(known):
            return math.inf, -1
        config, tuning = self.config, self._tuning
        ages = np.clip(now_s - known.seen_s, 0.0, tuning.most_age)
        way = way_to_contact(known.xy, velocity, config.radius, tuning.sideways)
        left = np.maximum(way - config.stop_distance, 0.0)
        most = left / (config.time_before_collision + ages)
        most = np.minimum(most, braking_speed(left, config.deceleration, tuning.reaction))
        moving = np.flatnonzero(known.moves)
        times = self._times_to_contact(known.xy[moving], ages[moving], velocity)
        brakes = config.deceleration * np.maximum(times - tuning.reaction, 0.0)
        most[moving] = np.minimum(most[moving], brakes)
        nearest = int(np.lexsort((way, most))[0])
        return float(most[nearest]), nearest

    def _times_to_contact(self, xy: Float, ages: Float, velocity: Velocity) -> Float:
        """When what moves, anywhere, may be ahead of the robot, and touch it [s]; inf: never.

        Args:
            xy: Where that was [m], shape (n, 2).
            ages: ... so long ago [s], shape (n,).
            velocity: Of the robot.
        """
        tuning, (speed, turn) = self._tuning, velocity
        times = np.arange(0.0, tuning.horizon, tuning.dt)
        places = _along_arc(speed * times, velocity)
        headings = turn * times + (0.0 if speed > 0.0 else math.pi)
        off = xy[:, np.newaxis] - places
        ahead = off[:, :, 0] * np.cos(headings) + off[:, :, 1] * np.sin(headings)
        reach = self.config.radius + tuning.margin + tuning.walks * (ages[:, np.newaxis] + times)
        meets = np.hypot(off[:, :, 0], off[:, :, 1]) < reach
        meets &= ahead > -tuning.forward * tuning.walks * times
        return np.asarray(np.where(meets.any(axis=1), times[meets.argmax(axis=1)], np.inf))

    def _seen_speed(self, velocity: Velocity) -> float:
        """The highest speed that what is seen of an arc allows [m/s].

        It is that from which the first place that no sensor sees is `time_before_collision` away.
        """
        config, tuning, (speed, turn) = self.config, self._tuning, velocity
        if abs(speed) <= config.crawl:
            return math.inf
        first = tuning.near - config.radius
        last = max(abs(speed) * config.time_before_collision + config.stop_distance, first)
        ways = np.arange(first, last + 0.5 * tuning.step, tuning.step)
        heading = ways * turn / abs(speed)
        across = np.stack([-np.sin(heading), np.cos(heading)], axis=-1)[:, np.newaxis]
        share = np.linspace(-1.0, 1.0, 2 * tuning.aside + 1)[:, np.newaxis]
        stops_s = tuning.reaction + abs(speed) / config.deceleration
        aside = config.radius + tuning.walks * np.minimum(ways / abs(speed), stops_s)
        looked = _along_arc(math.copysign(1.0, speed) * ways, velocity)[:, np.newaxis]
        looked = looked + share * aside[:, np.newaxis, np.newaxis] * across
        seen = self._are_seen(looked.reshape(-1, 2)).reshape(len(ways), -1).all(axis=1)
        if seen.all():
            return math.inf
        unseen = int(seen.argmin())
        left = float(ways[unseen]) if unseen else 0.0
        return max(config.crawl, left / config.time_before_collision)

    def _are_seen(self, xy: Float) -> Bool:
        """Which places in base_link some sensor sees, shape (n,)."""
        seen = np.zeros(len(xy), dtype=bool)
        for source in self._sources.values():
            sectors, away = source.scan.sectors_of(xy)
            seen |= source.covered[sectors] & (away <= source.scan.reach)
        return seen


def way_to_contact(
    points: Float, velocity: Velocity, radius: float, sideways: float = 0.2
) -> Float:
    """How far a circle moves along an arc until it touches points [m], shape (n,).

    On the straight line it touches (x, y) after x - sqrt(r^2 - y^2). On an arc about (0, c), with
    c = speed / turn, a point at the distance D from (0, c) is touched where the robot is off its
    direction, seen from there, by the angle d, with cos d = (D^2 + c^2 - r^2) / (2 D |c|).

    Args:
        points: In base_link, the circle's middle [m], shape (n, 2).
        velocity: Speed, not 0 [m/s], and rate of turn [rad/s].
        radius: Of the circle [m].
        sideways: A point in the circle is touched at once where the cosine of its direction from
            that of the motion is more than this, else never.

    Returns:
        inf: never.
    """
    speed, turn = velocity
    x, y = points[:, 0], points[:, 1]
    away, ahead = np.hypot(x, y), x * math.copysign(1.0, speed)
    if abs(turn) < 1e-6 * abs(speed) + 1e-12:
        rest = radius**2 - y**2
        way = np.where(
            (rest >= 0.0) & (ahead > 0.0), ahead - np.sqrt(np.maximum(rest, 0.0)), np.inf
        )
    else:
        centre = speed / turn
        off = y - centre
        from_centre = np.maximum(np.hypot(x, off), 1e-9)
        cosine = (from_centre**2 + centre**2 - radius**2) / (2.0 * from_centre * abs(centre))
        bearing = math.copysign(1.0, turn) * (np.arctan2(off, x) - math.atan2(-centre, 0.0))
        angle = (bearing - np.arccos(np.clip(cosine, -1.0, 1.0))) % (2.0 * math.pi)
        way = np.where(np.abs(cosine) <= 1.0, abs(centre) * angle, np.inf)
    inside = np.where(ahead > sideways * away, 0.0, np.inf)
    return np.asarray(np.where(away <= radius, inside, way))


def braking_speed(left: Float, deceleration: float, reaction: float) -> Float:
    """The speed v [m/s] from which a base stops within what is left, v t + v^2 / (2 a) = s.

    Args:
        left: s [m], shape (n,).
        deceleration: a [m/s^2].
        reaction: t [s].
    """
    reacts = deceleration * reaction
    return np.asarray(np.sqrt(reacts**2 + 2.0 * deceleration * left) - reacts)


class _Motion:
    """How the robot has moved: by its odometry, and without one as it was told to.

    Its frame is base_link at the beginning.

    Attributes:
        velocity: What it was told last.
    """

    def __init__(self, tuning: MonitorTuning) -> None:
        self._tuning = tuning
        self.velocity: Velocity = (0.0, 0.0)
        self._poses: deque[tuple[float, float, float, float]] = deque()  # time, x, y, yaw
        self._odometry: tuple[float, float, float] | None = None
        self._heard_s = -math.inf

    def take_odometry(self, pose: tuple[float, float, float], at_s: float) -> None:
        """Takes where odometry says that it is."""
        before, self._odometry, self._heard_s = self._odometry, pose, at_s
        if before is None or not self._poses:
            self._poses = self._poses or deque([(at_s, 0.0, 0.0, 0.0)])
        elif at_s > self._poses[-1][0]:
            x, y = np.subtract(pose[:2], before[:2]) @ rotation_2d(before[2])
            turned = math.remainder(pose[2] - before[2], 2.0 * math.pi)
            self._append(at_s, float(x), float(y), turned)

    def advance(self, now_s: float) -> None:
        """The time has gone on."""
        if not self._poses:
            self._poses.append((now_s, 0.0, 0.0, 0.0))
        elif now_s - self._heard_s > self._tuning.odometry:
            dt = now_s - self._poses[-1][0]
            if dt > 0.0:
                self._append(now_s, *self._as_told(dt))
        while self._poses[0][0] < now_s - self._tuning.history and len(self._poses) > 1:
            self._poses.popleft()

    def to_robot(self, points: Float, at_s: float) -> Float:
        """Points of its frame in base_link of a time [s]."""
        x, y, yaw = self._at(at_s)
        return np.asarray((points - [x, y]) @ rotation_2d(yaw))

    def from_robot(self, points: Float, at_s: float) -> Float:
        """Points of base_link of a time [s] in its frame."""
        x, y, yaw = self._at(at_s)
        return np.asarray(points @ rotation_2d(yaw).T + [x, y])

    def _at(self, at_s: float) -> tuple[float, float, float]:
        if not self._poses:
            return 0.0, 0.0, 0.0
        last_s, x, y, yaw = self._poses[-1]
        if at_s >= last_s:
            dx, dy, turned = self._as_told(min(at_s - last_s, self._tuning.odometry))
            (ahead, left) = rotation_2d(yaw) @ (dx, dy)
            return x + float(ahead), y + float(left), yaw + turned
        after = bisect_left(self._poses, (at_s,))
        if after == 0:
            return self._poses[0][1:]
        (first_s, *first), (then_s, *then) = self._poses[after - 1], self._poses[after]
        since, dt = at_s - first_s, then_s - first_s
        x, y, yaw = ((b - a) / dt * since + a for a, b in zip(first, then, strict=True))
        return x, y, yaw

    def _as_told(self, dt: float) -> tuple[float, float, float]:
        """Motion in base_link for a time [s]."""
        (x, y) = _along_arc(np.array([self.velocity[0] * dt]), self.velocity)[0]
        return float(x), float(y), self.velocity[1] * dt

    def _append(self, at_s: float, ahead: float, left: float, turned: float) -> None:
        _, x, y, yaw = self._poses[-1]
        dx, dy = rotation_2d(yaw) @ (ahead, left)
        self._poses.append((at_s, x + float(dx), y + float(dy), yaw + turned))


def _along_arc(ways: Float, velocity: Velocity) -> Float:
    """Where a robot is after ways along an arc [m], negative ones backwards, shape (n, 2)."""
    speed, turn = velocity
    if abs(turn) < 1e-6 * abs(speed) + 1e-12 or speed == 0.0:
        return np.stack([ways, np.zeros_like(ways)], axis=1)
    centre = speed / turn
    angle = ways / centre
    return np.stack([centre * np.sin(angle), centre * (1.0 - np.cos(angle))], axis=1)


def _widened(sectors: Bool, angle: float) -> Bool:
    """The sectors, and those that are no farther from one of them than an angle [rad]."""
    return np.asarray(_around(sectors, round(angle / (2.0 * math.pi) * SECTORS)).any(axis=1))


def _around(sectors: NDArray[Any], count: int) -> NDArray[Any]:
    """What holds in each sector and in so many to both sides, shape (SECTORS, 2 count + 1)."""
    padded = sectors[np.arange(-count, SECTORS + count) % SECTORS]
    return sliding_window_view(padded, 2 * count + 1)


def _in_words(xy: Float, source: str) -> str:
    """Where an obstacle is, and who sees it."""
    x, y = map(float, xy)
    where = "ahead" if abs(y) <= x else "behind" if abs(y) <= -x else "left" if y > 0 else "right"
    return f"{math.hypot(x, y):.2f} m {where} is something, by {source}"

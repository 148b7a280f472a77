"""Velocity of a differential drive on its way to a post.

A dynamic window approach (Fox, Burgard & Thrun, The dynamic window approach to collision avoidance,
IEEE Robotics & Automation Magazine 4(1), 1997): of the arcs that the base can drive next, those are
allowed after which it can still brake in time; of these it takes the one that is nearest to what
leads to the post, gets ahead and keeps clear.

What is in time: towards a person the robot is never faster than a gain times the distance that is
left to `safety.person_distance`, for people who go on as they walk and for people who stop. So it
comes to rest there, and who comes nearer does so by their own motion. Likewise for team-mates.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from mrs_people_loc.arrays import Bool, Float, StructOfArrays
from mrs_people_loc.config import GuideConfig
from mrs_people_loc.config.guide import Base
from mrs_people_loc.geometry import rotation_2d, wrap_angle
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.guidance import Post
from mrs_people_loc.team.poses import Pose


@dataclass(frozen=True)
class DriveTuning:
    """Constants of driving, chosen by hand in simulation.

    Attributes:
        speeds: Number of speeds that are tried.
        turns: Number of rates of turn that are tried, for each of them.
        reaction: An arc is driven for this time before the robot brakes [s]: until the next command
            takes effect.
        horizon: Arcs are compared by where they lead within this time [s], or sooner if the post is
            nearer.
        gain_still: Highest speed towards a person, by the distance that is left, if they stop now
            [1/s].
        gain_walking: ... if they go on [1/s]; less, for they may also turn.
        gain_robot: ... towards a team-mate [1/s].
        aside: People's places have errors: of any speed near them, this share counts as towards
            them.
        tolerance: Speeds towards somebody under this are none [m/s].
        clear: More distance than this beyond the smallest one is as good as any [m]: to people, to
            robots, to walls.
        near: The robot goes by the post itself within this distance; farther off by a point so far
            ahead on its path [m].
        arrived: It stops nearer to the post than this [m] ...
        left: ... and starts again farther off than this [m]; both are twice as much across the
            post's heading, where it would have to turn first.
        aligned: It stops turning on the post at this difference [rad] ...
        turned: ... and starts again at this one [rad].
        pass_within: It looks for a way past team-mates ahead that are nearer than this [m] ...
        pass_left: ... on their left if they are so far to its right [m], else on their right ...
        pass_by: ... with so much more than the smallest distance [m].
        blocked: One of two robots that block each other for this time [s] makes room for the other
            one ...
        gives_way: ... for this time [s].
    """

    speeds: int = 9
    turns: int = 11
    reaction: float = 0.2
    horizon: float = 1.2
    gain_still: float = 1.5
    gain_walking: float = 0.8
    gain_robot: float = 1.5
    aside: float = 0.25
    tolerance: float = 0.03
    clear: tuple[float, float, float] = (0.35, 0.1, 0.15)
    near: float = 0.8
    arrived: float = 0.06
    left: float = 0.12
    aligned: float = 0.04
    turned: float = 0.15
    pass_within: float = 2.0
    pass_left: float = 0.3
    pass_by: float = 0.3
    blocked: float = 1.5
    gives_way: float = 6.0


DRIVE_TUNING = DriveTuning()
#: Steps in which braking, and what comes later, is looked at [s]; longer ones where braking would
#: take more than so many.
_STEP, _LATER_STEP, _MOST_STEPS = 0.1, 0.15, 12
#: Cost of: missing the wanted speed, and turn; a metre of way to go; nearness to people and robots,
#: and to walls.
_SPEED_COST, _TURN_COST, _WAY_COST, _NEAR_COST, _WALL_COST = 1.0, 0.4, 0.3, 0.6, 0.15
#: Wanted speed and turn, by distance and by error of the heading [1/s].
_SPEED_GAIN, _TURN_GAIN = 3.0, 2.5
#: Two robots that block each other: the one that comes first in this direction makes room, at most
#: at this speed [m/s].
_ORDER, _MAKING_ROOM = np.array([0.8, 0.6]), 0.4
#: Ahead or backwards: weights of turning now against turning on the post, and of keeping to the
#: gear; farther off than this [m] it rather drives ahead.
_TURN_NOW, _GEAR, _FAR = 0.4, 0.4, 3.0
#: Distances to the post across its heading count by this share.
_ACROSS = 0.5
#: A slower team-mate stands [m/s]: the path leads past it, unless it is in the way.
_STANDS = 0.05
#: Clearance in a place that is too near to a wall may get less by rounding only [m].
_ROUNDING = 0.002


@dataclass(frozen=True)
class _Fastest:
    """How fast a base may go now.

    Attributes:
        ahead: [m/s].
        back: [m/s].
        turn: [rad/s].
    """

    ahead: float
    back: float
    turn: float

    @classmethod
    def of(cls, base: Base, stands_within: float) -> _Fastest:
        """The base's highest speeds from which it stands within a time [s]."""
        speed = base.deceleration * stands_within
        turn = base.turn_acceleration * stands_within
        return cls(
            min(base.max_speed, speed), min(base.max_reverse, speed), min(base.max_turn, turn)
        )


@dataclass(frozen=True)
class _Others(StructOfArrays):
    """People and team-mates, as they may move from now on.

    Attributes:
        xy: Now [m], shape (n, 2).
        velocity: [m/s], shape (n, 2).
        keep: Smallest distance to them [m], shape (n,).
        gain: Speed towards them by distance [1/s], shape (n,).
        aside: Share of any speed that counts as towards them, shape (n,).
        clear: More distance than this beyond `keep` is as good as any [m], shape (n,).
    """

    xy: Float
    velocity: Float
    keep: Float
    gain: Float
    aside: Float
    clear: Float


@dataclass(frozen=True)
class _Mates(StructOfArrays):
    """Team-mates now.

    Attributes:
        xy: [m], shape (m, 2).
        velocity: [m/s], shape (m, 2).
    """

    xy: Float
    velocity: Float


@dataclass(frozen=True)
class _Arcs(StructOfArrays):
    """Where arcs lead, at times from now on.

    Attributes:
        xy: [m], shape (n, times, 2).
        yaw: [rad], shape (n, times).
        speed: Ahead [m/s], shape (n, times).
    """

    xy: Float
    yaw: Float
    speed: Float


class Drive:
    """Drives one robot to its post.

    Args:
        config: Limits of its base and what it avoids; may be replaced at any time.
        tuning: Constants.

    Attributes:
        config: Limits of the base and what it avoids.
    """

    def __init__(self, config: GuideConfig, *, tuning: DriveTuning = DRIVE_TUNING) -> None:
        self.config, self._tuning = config, tuning
        self._arrived = self._aligned = self._backwards = False
        self._blocked_s = self._giving_way_s = 0.0

    def step(
        self,
        pose: Pose,
        twist: tuple[float, float],
        post: Post | None,
        *,
        people: Float,
        people_velocity: Float,
        people_age: float = 0.0,
        robots: Float,
        robots_velocity: Float | None = None,
        space: FreeSpace,
        path: Float | None = None,
        stands_within: float = math.inf,
        dt: float = 0.05,
    ) -> tuple[float, float]:
        """The velocity to drive with.

        Args:
            pose: Of base_link in the common frame, now.
            twist: Speed ahead [m/s] and rate of turn [rad/s], now: measured, or as commanded last.
            post: Where it goes; None: it stops.
            people: Where they were seen last, in the common frame [m], shape (n, 2).
            people_velocity: [m/s], 0 where unknown, shape (n, 2).
            people_age: Time since then [s].
            robots: Where its team-mates are now [m], shape (m, 2).
            robots_velocity: [m/s], shape (m, 2); None: they stand.
            space: Free floor.
            path: To the post, from `FreeSpace.path`, shape (k, 2); None: straight on.
            stands_within: It goes no faster than it can stop in this time, once the next step is
                due [s].
            dt: Until the next step [s].

        Returns:
            Speed ahead [m/s] and rate of turn [rad/s].
        """
        if post is None or stands_within <= 0.0:
            return self._ramped(twist, (0.0, 0.0), dt)
        others = self._others(pose, people, people_velocity, people_age, robots, robots_velocity)
        still = np.zeros_like(robots)
        mates = _Mates(robots, still if robots_velocity is None else robots_velocity)
        post, carrot = self._aim(pose, twist, post, path, mates, space, dt)
        fastest = _Fastest.of(self.config.base, stands_within)
        wanted = self._wanted(pose, post, carrot, fastest)
        speeds, turns = self._candidates(post.speed, fastest, wanted)
        allowed = self._are_allowed(pose, twist, speeds, turns, others, space)
        if not allowed.any():
            return self._ramped(twist, (0.0, 0.0), dt)
        speeds, turns = speeds[allowed], turns[allowed]
        costs = self._costs(pose, twist, speeds, turns, wanted, carrot, others, space)
        best = int(costs.argmin())
        return self._ramped(twist, (float(speeds[best]), float(turns[best])), dt)

    def _aim(
        self,
        pose: Pose,
        twist: tuple[float, float],
        post: Post,
        path: Float | None,
        mates: _Mates,
        space: FreeSpace,
        dt: float,
    ) -> tuple[Post, Float]:
        """Where it goes, past team-mates, and the point that it drives to now [m], shape (2,)."""
        here = np.array([pose.x, pose.y])
        carrot = self._carrot(here, post, path, space)
        mate = None if self._arrived else self._meeting(here, carrot, post, mates)
        if self._gives_way(here, mate, twist[0], dt) and mate is not None:
            post = self._room_made(here, post, mate, space)
            return post, post.xy
        return post, carrot if mate is None else self._past(here, carrot, mate, space)

    def _ramped(
        self, twist: tuple[float, float], wanted: tuple[float, float], dt: float
    ) -> tuple[float, float]:
        """What of the wanted velocity can be reached by then."""
        base, after = self.config.base, np.array([dt])
        v = _ramp(twist[0], np.array([[wanted[0]]]), after, base.acceleration, base.deceleration)
        turn = base.turn_acceleration
        w = _ramp(twist[1], np.array([[wanted[1]]]), after, turn, turn)
        return float(v[0, 0]), float(w[0, 0])

    def _others(
        self,
        pose: Pose,
        people: Float,
        people_velocity: Float,
        people_age: float,
        robots: Float,
        robots_velocity: Float | None,
    ) -> _Others:
        """Everybody near: people as they go on and as they stop, team-mates likewise."""
        safety, tuning = self.config.safety, self._tuning
        clear, clear_of_robot, _ = tuning.clear
        still = safety.person_distance, tuning.gain_still, tuning.aside, clear
        walking = safety.person_distance, tuning.gain_walking, tuning.aside, clear
        mate = safety.robot_distance, tuning.gain_robot, 0.0, clear_of_robot
        kinds = [
            (people, np.zeros_like(people), still),
            (people + people_velocity * people_age, people_velocity, walking),
            (robots, np.zeros_like(robots), mate),
        ]
        if robots_velocity is not None:
            kinds.append((robots, robots_velocity, mate))
        others = _Others.concatenate(
            [
                _Others(xy, velocity, *np.broadcast_to(np.array([how]).T, (4, len(xy))))
                for xy, velocity, how in kinds
            ]
        )
        away = np.linalg.norm(others.xy - (pose.x, pose.y), axis=1)
        fastest = np.linalg.norm(others.velocity, axis=1) + self.config.base.max_speed
        reach = others.keep + fastest * tuning.horizon + self.config.base.max_speed / others.gain
        return others.select(away < reach)

    def _carrot(self, here: Float, post: Post, path: Float | None, space: FreeSpace) -> Float:
        """The point that the robot drives to now, if nobody is in the way [m], shape (2,)."""
        end = np.asarray(post.xy, dtype=np.float64)
        if path is None or len(path) < 2:
            return end
        return self._on_path(here, np.concatenate([path[:-1], end[np.newaxis]]), space)

    def _past(self, here: Float, carrot: Float, mate: Float, space: FreeSpace) -> Float:
        """The point to drive to past a team-mate who comes: to the right, if there is room."""
        ahead = (carrot - here) / np.linalg.norm(carrot - here)
        right = np.array([ahead[1], -ahead[0]])
        if (mate - here) @ right > self._tuning.pass_left:
            right = -right
        beside = mate + (self.config.safety.robot_distance + self._tuning.pass_by) * right
        if space.clearance(beside) < self.config.safety.wall_distance:
            return carrot
        return np.asarray(beside)

    def _meeting(self, here: Float, carrot: Float, post: Post, mates: _Mates) -> Float | None:
        """The nearest team-mate that stands in the way or comes, and is not behind the post."""
        ahead = (carrot - here) / max(float(np.linalg.norm(carrot - here)), 1e-6)
        offset, keep = mates.xy - here, self.config.safety.robot_distance
        distance = np.linalg.norm(offset, axis=1)
        left = float(np.linalg.norm(post.xy - here)) + keep
        meets = distance < min(self._tuning.pass_within, left)
        meets &= (offset @ ahead > 0.5 * distance) & (mates.velocity @ ahead < 0.1)
        stands = np.linalg.norm(mates.velocity, axis=1) < _STANDS
        meets &= ~stands | (np.abs(offset @ [-ahead[1], ahead[0]]) < keep)
        if not meets.any():
            return None
        nearest: Float = mates.xy[int(np.where(meets, distance, np.inf).argmin())]
        return nearest

    def _gives_way(self, here: Float, mate: Float | None, speed: float, dt: float) -> bool:
        """Whether the robot makes room for a team-mate: one of two that block each other does."""
        tuning = self._tuning
        if mate is None:
            self._blocked_s = self._giving_way_s = 0.0
            return False
        if self._giving_way_s > 0.0:
            self._giving_way_s -= dt
            return True
        self._blocked_s = self._blocked_s + dt if abs(speed) < 0.05 else 0.0
        # Both robots know both places: one of them comes first in this order.
        if self._blocked_s > tuning.blocked and float((here - mate) @ _ORDER) < 0.0:
            self._blocked_s, self._giving_way_s = 0.0, tuning.gives_way
            return True
        return False

    def _room_made(self, here: Float, post: Post, mate: Float, space: FreeSpace) -> Post:
        """Where to go to make room for a team-mate: away from it, rather where there is space."""
        offset = here - mate
        angles = math.atan2(offset[1], offset[0]) + np.linspace(-1.6, 1.6, 9)
        away = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        step = max(self._tuning.pass_within - float(np.linalg.norm(offset)), 0.0)
        clearance = np.minimum(space.clearance(here + 0.5 * away), space.clearance(here + away))
        value = np.minimum(clearance, 1.0) + 0.5 * np.cos(np.linspace(-1.6, 1.6, 9))
        best = away[int(value.argmax())]
        return replace(post, xy=here + step * best, speed=min(post.speed, _MAKING_ROOM))

    def _on_path(self, here: Float, path: Float, space: FreeSpace) -> Float:
        """The farthest point of a path, up to `near` ahead, that the robot can go to straight."""
        steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
        ways = np.concatenate([[0.0], np.cumsum(steps)])
        every = np.arange(0.0, ways[-1] + 0.05, 0.05)
        points = np.stack([np.interp(every, ways, path[:, k]) for k in (0, 1)], axis=1)
        nearest = int(((points - here) ** 2).sum(axis=1).argmin())
        ahead = points[nearest : nearest + 1 + round(self._tuning.near / 0.05)][::-2]
        part = np.linspace(0.1, 1.0, 10)[:, np.newaxis, np.newaxis]
        clearance = space.clearance(here + part * (ahead - here)).min(axis=0)
        good = clearance >= min(self.config.safety.wall_distance, clearance.max())
        found: Float = ahead[int(good.argmax())]
        return found

    def _wanted(
        self, pose: Pose, post: Post, carrot: Float, fastest: _Fastest
    ) -> tuple[float, float]:
        """Speed and rate of turn with which nothing is in the way."""
        base, tuning = self.config.base, self._tuning
        here = np.array([pose.x, pose.y])
        left, off = float(np.linalg.norm(post.xy - here)), carrot - here
        bearing = math.atan2(off[1], off[0])
        self._backwards = self._goes_backwards(pose, post, bearing, left)
        error = wrap_angle(bearing - pose.yaw + (math.pi if self._backwards else 0.0))
        passed = left < tuning.left and abs(error) > 1.0
        along, across = (post.xy - here) @ rotation_2d(post.yaw)
        near = math.hypot(along, _ACROSS * across)
        self._arrived = near < (tuning.left if self._arrived else tuning.arrived) or passed
        if self._arrived:
            error = wrap_angle(post.yaw - pose.yaw)
            self._aligned = abs(error) < (tuning.turned if self._aligned else tuning.aligned)
            return 0.0, 0.0 if self._aligned else self._turn(error, fastest)
        self._aligned = False
        brakes = math.sqrt(base.deceleration * left)
        slows = _SPEED_GAIN * max(left - 0.5 * tuning.arrived, 0.0)
        most = fastest.back if self._backwards else fastest.ahead
        speed = min(most, post.speed, brakes, slows)
        speed *= max(math.cos(min(1.5 * abs(error), math.pi)), 0.0)
        return -speed if self._backwards else speed, self._turn(error, fastest)

    def _goes_backwards(self, pose: Pose, post: Post, bearing: float, left: float) -> bool:
        """Whether it drives backwards: as it turns least now and on the post."""
        if self.config.base.max_reverse <= 0.0:
            return False
        ahead = math.cos(post.yaw - bearing) + _TURN_NOW * math.cos(pose.yaw - bearing)
        ahead += -_GEAR if self._backwards else _GEAR
        return ahead + min(max(left / _FAR - 1.0, 0.0), 1.0) < 0.0

    def _turn(self, error: float, fastest: _Fastest) -> float:
        """Rate of turn that takes away an error of the heading."""
        brakes = math.sqrt(self.config.base.turn_acceleration * abs(error))
        most = min(fastest.turn, brakes)
        return max(-most, min(most, _TURN_GAIN * error))

    def _candidates(
        self, speed: float, fastest: _Fastest, wanted: tuple[float, float]
    ) -> tuple[Float, Float]:
        """Speeds and rates of turn that are tried, shapes (n,)."""
        tuning = self._tuning
        ahead, back = min(speed, fastest.ahead), min(speed, fastest.back)
        likely = wanted[0] * np.array([1.0, 0.5, 0.25, 0.0])
        speeds = np.concatenate([likely, np.linspace(-back, ahead, tuning.speeds)])
        turns = np.linspace(-fastest.turn, fastest.turn, tuning.turns)
        turns = np.concatenate([[wanted[1]], turns])
        both = np.stack(np.meshgrid(speeds, turns, indexing="ij"), axis=-1).reshape(-1, 2)
        return both[:, 0], both[:, 1]

    def _are_allowed(
        self,
        pose: Pose,
        twist: tuple[float, float],
        speeds: Float,
        turns: Float,
        others: _Others,
        space: FreeSpace,
    ) -> Bool:
        """Which arcs avoid people, robots and walls until the robot stands, shape (n,)."""
        base, tuning = self.config.base, self._tuning
        fastest = max(abs(twist[0]), base.max_speed, base.max_reverse)
        brakes_s = max(fastest / base.deceleration, _STEP)
        steps = min(math.ceil(brakes_s / _STEP), _MOST_STEPS)
        reacts: Float = _STEP * np.arange(1.0, round(tuning.reaction / _STEP) + 1)
        times = np.concatenate([reacts, reacts[-1] + np.linspace(0.0, brakes_s, steps + 1)[1:]])
        arcs = self._arcs(pose, twist, speeds, turns, times, brakes_at=tuning.reaction)
        allowed = np.ones(len(speeds), dtype=bool)
        if len(others):
            offset, distance = _offsets(arcs, others, times)
            ahead = np.stack([np.cos(arcs.yaw), np.sin(arcs.yaw)], axis=-1)
            moves = ahead * arcs.speed[..., np.newaxis]
            towards = np.einsum("ktnd,ktd->ktn", offset, moves) / np.maximum(distance, 1e-6)
            towards += others.aside * np.abs(arcs.speed)[..., np.newaxis]
            most = np.maximum(others.gain * (distance - others.keep), tuning.tolerance)
            allowed &= (towards <= most).all(axis=(1, 2))
        clearance = space.clearance(arcs.xy)
        now = float(space.clearance(np.array([pose.x, pose.y])))
        wall = self.config.safety.wall_distance
        return np.asarray(allowed & (clearance >= min(wall, now - _ROUNDING)).all(axis=1))

    def _costs(
        self,
        pose: Pose,
        twist: tuple[float, float],
        speeds: Float,
        turns: Float,
        wanted: tuple[float, float],
        carrot: Float,
        others: _Others,
        space: FreeSpace,
    ) -> Float:
        """What is against each arc, shape (n,)."""
        base, tuning = self.config.base, self._tuning
        goal = np.array([pose.x, pose.y]) if self._arrived else carrot
        left = min(float(np.linalg.norm(goal - (pose.x, pose.y))), 1.0)
        until = min(max(left / max(abs(wanted[0]), 0.1), 3 * _LATER_STEP), tuning.horizon)
        times: Float = _LATER_STEP * np.arange(1.0, round(until / _LATER_STEP) + 1)
        arcs = self._arcs(pose, twist, speeds, turns, times)
        cost = _SPEED_COST * ((speeds - wanted[0]) / base.max_speed) ** 2
        cost += _TURN_COST * ((turns - wanted[1]) / base.max_turn) ** 2
        cost += _WAY_COST * left * np.linalg.norm(arcs.xy[:, -1] - goal, axis=1)
        if len(others):
            free = (_offsets(arcs, others, times)[1] - others.keep) / others.clear
            cost += _NEAR_COST * np.clip(1.0 - free.min(axis=(1, 2)), 0.0, 3.0) ** 2
        free = space.clearance(arcs.xy).min(axis=1) - self.config.safety.wall_distance
        return np.asarray(cost + _WALL_COST * np.clip(1.0 - free / tuning.clear[2], 0.0, 3.0) ** 2)

    def _arcs(
        self,
        pose: Pose,
        twist: tuple[float, float],
        speeds: Float,
        turns: Float,
        times: Float,
        brakes_at: float | None = None,
    ) -> _Arcs:
        """Where the robot gets with wanted speeds and rates of turn, within its limits."""
        base = self.config.base
        up, down, turn = base.acceleration, base.deceleration, base.turn_acceleration
        v = _ramp(twist[0], speeds[:, np.newaxis], times, up, down)
        w = _ramp(twist[1], turns[:, np.newaxis], times, turn, turn)
        if brakes_at is not None:
            last = int(np.flatnonzero(times <= brakes_at + 1e-9)[-1])
            since = times[last + 1 :] - times[last]
            v[:, last + 1 :] = _shrunk(v[:, last, np.newaxis], since * down)
            w[:, last + 1 :] = _shrunk(w[:, last, np.newaxis], since * turn)
        step = np.diff(times, prepend=0.0)
        turned = _means(w, twist[1]) * step
        yaw = pose.yaw + np.cumsum(turned, axis=1)
        middle, way = yaw - 0.5 * turned, _means(v, twist[0]) * step
        moves = way[..., np.newaxis] * np.stack([np.cos(middle), np.sin(middle)], axis=-1)
        return _Arcs(np.cumsum(moves, axis=1) + (pose.x, pose.y), yaw, v)


def _offsets(arcs: _Arcs, others: _Others, times: Float) -> tuple[Float, Float]:
    """Vectors and distances from a robot on arcs to the others, (n, times, others[, 2])."""
    there = others.xy + times[:, np.newaxis, np.newaxis] * others.velocity
    offset = there - arcs.xy[:, :, np.newaxis]
    return offset, np.asarray(np.hypot(offset[..., 0], offset[..., 1]))


def _ramp(start: float, wanted: Float, times: Float, up: float, down: float) -> Float:
    """A velocity on its way to a wanted one: faster by `up`, slower by `down` a second.

    Args:
        start: Velocity now.
        wanted: Shape (n, 1).
        times: From now on [s], shape (t,).
        up: [1/s^2].
        down: [1/s^2].

    Returns:
        Shape (n, t).
    """
    size, target = abs(start), wanted * (1.0 if start >= 0.0 else -1.0)
    same = size + np.clip(target - size, -down * times, up * times)
    slowing = size - down * times
    back = -np.minimum(-target, up * np.maximum(times - size / down, 0.0))
    other = np.where(slowing > 0.0, slowing, back)
    return np.asarray(np.where(target >= 0.0, same, other) * (1.0 if start >= 0.0 else -1.0))


def _means(values: Float, first: float) -> Float:
    """Means over the steps that end with these values, shape (n, t)."""
    before = np.concatenate([np.full((len(values), 1), first), values[:, :-1]], axis=1)
    return np.asarray(0.5 * (before + values))


def _shrunk(values: Float, by: Float) -> Float:
    return np.asarray(np.sign(values) * np.maximum(np.abs(values) - by, 0.0))

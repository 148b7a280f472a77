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
            them, ...
        aside_within: ... and more of it nearer than this, as the errors turn their bearing more
            [m], ...
        aside_most: ... but no more than so many times as much: whoever is too near is left.
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
        meets: A team-mate within this cone ahead (the cosine of its half angle) is met ...
        comes: ... unless it moves ahead by more than this [m/s].
        stands: A slower team-mate stands [m/s]: the path leads past it, unless it is in the way.
        blocked: One of two robots that block each other, slower than `stands` for this time [s],
            makes room for the other one ...
        gives_way: ... for this time [s].
        order: Of the two it is the one that comes first in this direction, in the common frame: ...
        making_room: ... at most at this speed [m/s],
        room: ... away from the other one by no more than this angle [rad],
        room_tried: ... so many of which are tried,
        room_wanted: ... where there is up to this clearance, looked at so far away [m], ...
        room_away: ... traded for the cosine of the angle at this rate [m].
        path_step: Distance of the points of a path [m], every other one of which is tried, ...
        path_samples: ... and number of places on the line to each that have to be free.
        step: Steps in which braking is looked at [s] ...
        most_steps: ... longer ones where braking would take more than so many,
        later_step: ... and in which what comes later is [s], ...
        least_later: ... for so many of them at least.
        speed_gain: Wanted speed by distance [1/s], ...
        short: ... to this share of `arrived` before the post, ...
        turn_gain: ... and rate of turn by the error of the heading [1/s].
        slows: The wanted speed falls with the cosine of so many times the error of the heading.
        passed: A post that is near and farther aside than this has been passed [rad].
        across: Distances to the post across its heading count by this share.
        turn_now: Ahead or backwards: weight of turning now against turning on the post, ...
        gear: ... and of keeping to the gear;
        far: ... farther off than this [m] it rather drives ahead, by a weight that grows to 1 at
            twice as far.
        shares: Of the wanted speed, which are tried, too.
        speed_cost: Cost of missing the wanted speed, by the square of its share of the highest, ...
        turn_cost: ... and likewise of missing the wanted turn;
        way_cost: ... of a metre of way to go [1/m],
        way_far: ... that counts in full from this distance on [m];
        near_cost: ... of nearness to people and robots,
        wall_cost: ... and to walls, by the square of what is missing of `clear`, ...
        near_most: ... of which no more counts than this.
        creep: The time to the post is that at this speed, if the wanted one is less [m/s].
        rounding: Clearance in a place that is too near to a wall may get less by this only [m].
    """

    speeds: int = 9
    turns: int = 11
    reaction: float = 0.2
    horizon: float = 1.2
    gain_still: float = 1.5
    gain_walking: float = 0.8
    gain_robot: float = 1.5
    aside: float = 0.25
    aside_within: float = 0.8
    aside_most: float = 2.4
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
    meets: float = 0.5
    comes: float = 0.1
    stands: float = 0.05
    blocked: float = 1.5
    gives_way: float = 6.0
    order: tuple[float, float] = (0.8, 0.6)
    making_room: float = 0.4
    room: float = 1.6
    room_tried: int = 9
    room_wanted: float = 1.0
    room_away: float = 0.5
    path_step: float = 0.05
    path_samples: int = 10
    step: float = 0.1
    most_steps: int = 12
    later_step: float = 0.15
    least_later: int = 3
    speed_gain: float = 3.0
    short: float = 0.5
    turn_gain: float = 2.5
    slows: float = 1.5
    passed: float = 1.0
    across: float = 0.5
    turn_now: float = 0.4
    gear: float = 0.4
    far: float = 3.0
    shares: tuple[float, ...] = (1.0, 0.5, 0.25, 0.0)
    speed_cost: float = 1.0
    turn_cost: float = 0.4
    way_cost: float = 0.3
    way_far: float = 1.0
    near_cost: float = 0.6
    wall_cost: float = 0.15
    near_most: float = 3.0
    creep: float = 0.1
    rounding: float = 0.002


DRIVE_TUNING = DriveTuning()

#: Speed ahead [m/s] and rate of turn [rad/s].
Velocity = tuple[float, float]


@dataclass(frozen=True)
class Situation:
    """What the next velocity of a robot is chosen by.

    Attributes:
        config: Limits of its base, and what it avoids.
        pose: Of its base_link in the common frame, now.
        twist: Its velocity now: measured, or as commanded last.
        post: Where it goes; None: it stops.
        people: Where they were seen last, in the common frame [m], shape (n, 2).
        people_velocity: [m/s], 0 where unknown, shape (n, 2).
        people_age: Time since then [s].
        robots: Where its team-mates are now [m], shape (m, 2).
        robots_velocity: [m/s], shape (m, 2).
        space: Free floor.
        path: To the post, from `FreeSpace.path`, shape (k, 2); None: straight on.
        stands_within: It goes no faster than it can stop in this time, once the next step is due
            [s].
        dt: Until the next step [s].
    """

    config: GuideConfig
    pose: Pose
    twist: Velocity
    post: Post | None
    people: Float
    people_velocity: Float
    robots: Float
    robots_velocity: Float
    space: FreeSpace
    people_age: float = 0.0
    path: Float | None = None
    stands_within: float = math.inf
    dt: float = 0.05

    @property
    def here(self) -> Float:
        """Where the robot is [m], shape (2,)."""
        return np.array([self.pose.x, self.pose.y])


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
        tuning: Constants.
    """

    def __init__(self, tuning: DriveTuning = DRIVE_TUNING) -> None:
        self._tuning = tuning
        self._arrived = self._aligned = self._backwards = False
        self._blocked_s = self._giving_way_s = 0.0

    def step(self, now: Situation) -> Velocity:
        """The velocity to drive with until the next step."""
        if now.post is None or now.stands_within <= 0.0:
            return _ramped(now, (0.0, 0.0))
        tuning = self._tuning
        others = _others(now, tuning)
        post, carrot = self._aim(now, now.post)
        fastest = _Fastest.of(now.config.base, now.stands_within)
        wanted = self._wanted(now, post, carrot, fastest)
        tried = _tried(post.speed, fastest, wanted, tuning)
        allowed = tried[_are_allowed(now, tried, others, tuning)]
        if not len(allowed):
            return _ramped(now, (0.0, 0.0))
        goal = now.here if self._arrived else carrot
        best = int(_costs(now, allowed, wanted, goal, others, tuning).argmin())
        return _ramped(now, (float(allowed[best, 0]), float(allowed[best, 1])))

    def _aim(self, now: Situation, post: Post) -> tuple[Post, Float]:
        """Where it goes, past team-mates, and the point that it drives to now [m], shape (2,)."""
        carrot = _carrot(now, post, self._tuning)
        mate = None if self._arrived else _met(now, post, carrot, self._tuning)
        if self._gives_way(now, mate) and mate is not None:
            post = _room_made(now, post, mate, self._tuning)
            return post, post.xy
        return post, carrot if mate is None else _past(now, carrot, mate, self._tuning)

    def _gives_way(self, now: Situation, mate: Float | None) -> bool:
        """Whether the robot makes room for a team-mate: one of two that block each other does."""
        tuning = self._tuning
        if mate is None:
            self._blocked_s = self._giving_way_s = 0.0
            return False
        if self._giving_way_s > 0.0:
            self._giving_way_s -= now.dt
            return True
        self._blocked_s = self._blocked_s + now.dt if abs(now.twist[0]) < tuning.stands else 0.0
        # Both robots know both places: one of them comes first in this order.
        if self._blocked_s > tuning.blocked and float((now.here - mate) @ tuning.order) < 0.0:
            self._blocked_s, self._giving_way_s = 0.0, tuning.gives_way
            return True
        return False

    def _wanted(self, now: Situation, post: Post, carrot: Float, fastest: _Fastest) -> Velocity:
        """The velocity with which nothing is in the way."""
        base, tuning, here, yaw = now.config.base, self._tuning, now.here, now.pose.yaw
        left, off = float(np.linalg.norm(post.xy - here)), carrot - here
        bearing = math.atan2(off[1], off[0])
        self._backwards = self._goes_backwards(now, post, bearing, left)
        error = wrap_angle(bearing - yaw + (math.pi if self._backwards else 0.0))
        passed = left < tuning.left and abs(error) > tuning.passed
        along, across = (post.xy - here) @ rotation_2d(post.yaw)
        near = math.hypot(along, tuning.across * across)
        self._arrived = near < (tuning.left if self._arrived else tuning.arrived) or passed
        if self._arrived:
            error = wrap_angle(post.yaw - yaw)
            self._aligned = abs(error) < (tuning.turned if self._aligned else tuning.aligned)
            return 0.0, 0.0 if self._aligned else _turn(base, error, fastest, tuning)
        self._aligned = False
        brakes = math.sqrt(base.deceleration * left)
        slows = tuning.speed_gain * max(left - tuning.short * tuning.arrived, 0.0)
        most = fastest.back if self._backwards else fastest.ahead
        speed = min(most, post.speed, brakes, slows)
        speed *= max(math.cos(min(tuning.slows * abs(error), math.pi)), 0.0)
        return -speed if self._backwards else speed, _turn(base, error, fastest, tuning)

    def _goes_backwards(self, now: Situation, post: Post, bearing: float, left: float) -> bool:
        """Whether it drives backwards: as it turns least now and on the post."""
        tuning = self._tuning
        if now.config.base.max_reverse <= 0.0:
            return False
        ahead = math.cos(post.yaw - bearing) + tuning.turn_now * math.cos(now.pose.yaw - bearing)
        ahead += -tuning.gear if self._backwards else tuning.gear
        return ahead + min(max(left / tuning.far - 1.0, 0.0), 1.0) < 0.0


# ---- where to ----


def _carrot(now: Situation, post: Post, tuning: DriveTuning) -> Float:
    """The point to drive to if nobody is in the way [m], shape (2,).

    The farthest one of the path, up to `near` ahead, to which it is free straight on.
    """
    end = np.asarray(post.xy, dtype=np.float64)
    if now.path is None or len(now.path) < 2:
        return end
    here, path = now.here, np.concatenate([now.path[:-1], end[np.newaxis]])
    steps = np.linalg.norm(np.diff(path, axis=0), axis=1)
    ways = np.concatenate([[0.0], np.cumsum(steps)])
    every = np.arange(0.0, ways[-1] + tuning.path_step, tuning.path_step)
    points = np.stack([np.interp(every, ways, path[:, k]) for k in (0, 1)], axis=1)
    nearest = int(((points - here) ** 2).sum(axis=1).argmin())
    ahead = points[nearest : nearest + 1 + round(tuning.near / tuning.path_step)][::-2]
    samples = tuning.path_samples
    part = np.linspace(1.0 / samples, 1.0, samples)[:, np.newaxis, np.newaxis]
    clearance = now.space.clearance(here + part * (ahead - here)).min(axis=0)
    good = clearance >= min(now.config.safety.wall_distance, clearance.max())
    found: Float = ahead[int(good.argmax())]
    return found


def _met(now: Situation, post: Post, carrot: Float, tuning: DriveTuning) -> Float | None:
    """The nearest team-mate that stands in the way or comes, and is not behind the post."""
    here, velocity = now.here, now.robots_velocity
    ahead = (carrot - here) / max(float(np.linalg.norm(carrot - here)), 1e-6)
    offset, keep = now.robots - here, now.config.safety.robot_distance
    distance = np.linalg.norm(offset, axis=1)
    left = float(np.linalg.norm(post.xy - here)) + keep
    meets = distance < min(tuning.pass_within, left)
    meets &= (offset @ ahead > tuning.meets * distance) & (velocity @ ahead < tuning.comes)
    stands = np.linalg.norm(velocity, axis=1) < tuning.stands
    meets &= ~stands | (np.abs(offset @ [-ahead[1], ahead[0]]) < keep)
    if not meets.any():
        return None
    nearest: Float = now.robots[int(np.where(meets, distance, np.inf).argmin())]
    return nearest


def _past(now: Situation, carrot: Float, mate: Float, tuning: DriveTuning) -> Float:
    """The point to drive to past a team-mate who comes: to the right, if there is room."""
    here, safety = now.here, now.config.safety
    ahead = (carrot - here) / np.linalg.norm(carrot - here)
    right = np.array([ahead[1], -ahead[0]])
    if (mate - here) @ right > tuning.pass_left:
        right = -right
    beside = mate + (safety.robot_distance + tuning.pass_by) * right
    return carrot if now.space.clearance(beside) < safety.wall_distance else np.asarray(beside)


def _room_made(now: Situation, post: Post, mate: Float, tuning: DriveTuning) -> Post:
    """Where to go to make room for a team-mate: away from it, rather where there is space."""
    here = now.here
    offset, aside = here - mate, np.linspace(-tuning.room, tuning.room, tuning.room_tried)
    angles = math.atan2(offset[1], offset[0]) + aside
    away = np.stack([np.cos(angles), np.sin(angles)], axis=1)
    step = max(tuning.pass_within - float(np.linalg.norm(offset)), 0.0)
    far = tuning.room_wanted * away
    clearance = np.minimum(now.space.clearance(here + 0.5 * far), now.space.clearance(here + far))
    value = np.minimum(clearance, tuning.room_wanted) + tuning.room_away * np.cos(aside)
    best = away[int(value.argmax())]
    return replace(post, xy=here + step * best, speed=min(post.speed, tuning.making_room))


def _turn(base: Base, error: float, fastest: _Fastest, tuning: DriveTuning) -> float:
    """Rate of turn that takes away an error of the heading."""
    brakes = math.sqrt(base.turn_acceleration * abs(error))
    most = min(fastest.turn, brakes)
    return max(-most, min(most, tuning.turn_gain * error))


# ---- which velocity ----


def _others(now: Situation, tuning: DriveTuning) -> _Others:
    """Everybody near: people as they go on and as they stop, team-mates likewise."""
    safety, base = now.config.safety, now.config.base
    clear, clear_of_robot, _ = tuning.clear
    still = safety.person_distance, tuning.gain_still, tuning.aside, clear
    walking = safety.person_distance, tuning.gain_walking, tuning.aside, clear
    mate = safety.robot_distance, tuning.gain_robot, 0.0, clear_of_robot
    later = now.people + now.people_velocity * now.people_age
    others = _Others.joined(
        [
            _Others(xy, velocity, *np.broadcast_to(np.array([how]).T, (4, len(xy))))
            for xy, velocity, how in (
                (now.people, np.zeros_like(now.people), still),
                (later, now.people_velocity, walking),
                (now.robots, np.zeros_like(now.robots), mate),
                (now.robots, now.robots_velocity, mate),
            )
        ]
    )
    away = np.linalg.norm(others.xy - now.here, axis=1)
    fastest = np.linalg.norm(others.velocity, axis=1) + base.max_speed
    return others.select(
        away < others.keep + fastest * tuning.horizon + base.max_speed / others.gain
    )


def _tried(speed: float, fastest: _Fastest, wanted: Velocity, tuning: DriveTuning) -> Float:
    """Velocities to choose from, up to a speed [m/s, rad/s], shape (n, 2)."""
    ahead, back = min(speed, fastest.ahead), min(speed, fastest.back)
    likely = wanted[0] * np.array(tuning.shares)
    speeds = np.concatenate([likely, np.linspace(-back, ahead, tuning.speeds)])
    turns = np.linspace(-fastest.turn, fastest.turn, tuning.turns)
    turns = np.concatenate([[wanted[1]], turns])
    return np.stack(np.meshgrid(speeds, turns, indexing="ij"), axis=-1).reshape(-1, 2)


def _are_allowed(now: Situation, tried: Float, others: _Others, tuning: DriveTuning) -> Bool:
    """Which velocities avoid people, robots and walls until the robot stands, shape (n,)."""
    base = now.config.base
    fastest = max(abs(now.twist[0]), base.max_speed, base.max_reverse)
    brakes_s = max(fastest / base.deceleration, tuning.step)
    steps = min(math.ceil(brakes_s / tuning.step), tuning.most_steps)
    reacts: Float = tuning.step * np.arange(1.0, round(tuning.reaction / tuning.step) + 1)
    times = np.concatenate([reacts, reacts[-1] + np.linspace(0.0, brakes_s, steps + 1)[1:]])
    arcs = _arcs(now, tried, times, brakes_at=tuning.reaction)
    allowed = np.ones(len(tried), dtype=bool)
    if len(others):
        x, y, distance = _offsets(arcs, others, times)
        yaw, speed = arcs.yaw[..., np.newaxis], arcs.speed[..., np.newaxis]
        towards = x * (speed * np.cos(yaw)) + y * (speed * np.sin(yaw))
        away = np.maximum(distance, 1e-6)
        towards /= away
        nearer = np.clip(tuning.aside_within / away, 1.0, tuning.aside_most)
        towards += others.aside * nearer * np.abs(speed)
        most = np.maximum(others.gain * (distance - others.keep), tuning.tolerance)
        allowed &= (towards <= most).all(axis=(1, 2))
    clearance = now.space.clearance(arcs.xy)
    least = float(now.space.clearance(now.here)) - tuning.rounding
    least = min(now.config.safety.wall_distance, least)
    return np.asarray(allowed & (clearance >= least).all(axis=1))


def _costs(
    now: Situation, tried: Float, wanted: Velocity, goal: Float, others: _Others,
    tuning: DriveTuning,
) -> Float:  # fmt: skip
    """What is against each velocity, shape (n,)."""
    base, most = now.config.base, tuning.near_most
    left = min(float(np.linalg.norm(goal - now.here)), tuning.way_far)
    until = left / max(abs(wanted[0]), tuning.creep)
    until = min(max(until, tuning.least_later * tuning.later_step), tuning.horizon)
    times: Float = tuning.later_step * np.arange(1.0, round(until / tuning.later_step) + 1)
    arcs = _arcs(now, tried, times)
    cost = tuning.speed_cost * ((tried[:, 0] - wanted[0]) / base.max_speed) ** 2
    cost += tuning.turn_cost * ((tried[:, 1] - wanted[1]) / base.max_turn) ** 2
    cost += tuning.way_cost * left * np.linalg.norm(arcs.xy[:, -1] - goal, axis=1)
    if len(others):
        *_, distance = _offsets(arcs, others, times)
        free = (distance - others.keep) / others.clear
        cost += tuning.near_cost * np.clip(1.0 - free.min(axis=(1, 2)), 0.0, most) ** 2
    free = now.space.clearance(arcs.xy).min(axis=1) - now.config.safety.wall_distance
    cost += tuning.wall_cost * np.clip(1.0 - free / tuning.clear[2], 0.0, most) ** 2
    return np.asarray(cost)


# ---- how a base moves ----


def _ramped(now: Situation, wanted: Velocity) -> Velocity:
    """What of the wanted velocity can be reached by the next step."""
    base, after = now.config.base, np.array([now.dt])
    turn = base.turn_acceleration
    v = _ramp(now.twist[0], np.array([[wanted[0]]]), after, base.acceleration, base.deceleration)
    w = _ramp(now.twist[1], np.array([[wanted[1]]]), after, turn, turn)
    return float(v[0, 0]), float(w[0, 0])


def _arcs(now: Situation, wanted: Float, times: Float, brakes_at: float | None = None) -> _Arcs:
    """Where the robot gets with wanted velocities, within its limits.

    Args:
        now: Where it is.
        wanted: [m/s, rad/s], shape (n, 2).
        times: From now on [s], shape (t,).
        brakes_at: It brakes after this time [s]; None: never.
    """
    base, pose, twist = now.config.base, now.pose, now.twist
    up, down, turn = base.acceleration, base.deceleration, base.turn_acceleration
    v = _ramp(twist[0], wanted[:, :1], times, up, down)
    w = _ramp(twist[1], wanted[:, 1:], times, turn, turn)
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
    return _Arcs(np.cumsum(moves, axis=1) + now.here, yaw, v)


def _offsets(arcs: _Arcs, others: _Others, times: Float) -> tuple[Float, Float, Float]:
    """Vectors (x, y) and distances from a robot on arcs to the others, (n, times, others)."""
    there = others.xy + times[:, np.newaxis, np.newaxis] * others.velocity
    x, y = (there[..., k] - arcs.xy[..., k, np.newaxis] for k in (0, 1))
    return x, y, np.sqrt(x * x + y * y)


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

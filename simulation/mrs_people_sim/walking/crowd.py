"""People who follow a leading robot and react to what is near.

Everybody is driven by social forces: towards where they want to be at the speed they like (Helbing
& Molnar, Social force model for pedestrian dynamics, Physical Review E 51, 1995); away from people
and robots with whom they would collide, and from walls, with the forces that Moussaid et al.
measured (Experimental study of the behavioural mechanisms underlying self-organization in human
crowds, Proc. R. Soc. B 276, 2009); in a group, away from members who are too close and towards its
centre from far (Moussaid et al., The walking behaviour of pedestrian social groups and its impact
on crowd dynamics, PLoS ONE 5(4), 2010). How they follow a robot is ours: along its trail, each at
their own distance and on their own side, with their own reaction time. While it stands they spread
round it. Bystanders follow nobody; some of them see no robots.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Float, Int
from mrs_people_sim.walking.bystanders import Bystanders
from mrs_people_sim.walking.crowd_ground import Clearance, Trail
from mrs_people_sim.walking.stragglers import Stragglers, Straggling
from mrs_people_sim.walking.walks import Wander, shortened, unit

#: Axes of two people, and of a person and a robot, never come closer than this [m].
_APART, _FROM_ROBOT = 0.42, 0.42
#: Axes of people stay this far from walls and furniture [m].
_FROM_WALL = 0.20
#: Farthest that somebody gets in a step [m]; less than twice `_FROM_WALL`: nobody is on the other
#: side of a thin wall.
_STRIDE = 0.15
#: Time in which people reach the velocity that they want [s] (Moussaid et al. 2009).
_RELAXATION = 0.54
#: People stand round a leader in rows: distance of the first one, and from row to row [m]; half of
#: the sector that they fill [rad]; and from one to the next [m].
_ROW, _HALF_CIRCLE, _BESIDE = (1.6, 0.9), math.radians(60.0), 0.95
#: ... once it has been standing for so long [s].
_STANDS_S = 4.0
#: Who catches up is faster by this.
_HURRY = 1.35
#: Strongest force [m/s^2].
_STRONGEST = 4.0


@dataclass(frozen=True)
class Habits:
    """How people differ; each value is drawn for a person, evenly between two bounds.

    Attributes:
        speed: Preferred speed [m/s].
        distance: Distance behind the leader [m].
        side: Distance to the left of its trail [m].
        reaction: Time until they notice that the leader goes on or stops [s].
        start: They set out when they are so far behind their place [m].
    """

    speed: tuple[float, float] = (0.9, 1.3)
    distance: tuple[float, float] = (1.2, 2.5)
    side: tuple[float, float] = (-0.9, 0.9)
    reaction: tuple[float, float] = (0.4, 1.2)
    start: tuple[float, float] = (0.3, 0.7)


class Crowd:
    """People who follow a robot, and bystanders, who are the last ones of all arrays.

    Args:
        xy: Where they stand at first [m], shape (n, 2).
        clearance: Walls and furniture.
        seed: Of everything that is left to chance.
        stragglers: Who stays behind.
        habits: How people differ.
        bystanders: Who is there, too.

    Attributes:
        guided: How many follow.
        xy: Where they are [m], shape (n, 2).
        velocity: How they move [m/s], shape (n, 2).
        yaw: Where they face [rad], shape (n,).
        time: Since the start [s].
        walked: How far everybody has walked [m], shape (n,).
        stragglers: Who of them stays behind.
    """

    def __init__(
        self,
        xy: Float,
        clearance: Clearance,
        seed: int,
        stragglers: tuple[Straggling, ...] = (),
        habits: Habits = Habits(),
        bystanders: Bystanders | None = None,
    ) -> None:
        rng = np.random.default_rng([seed, 91])
        self._bystanders = bystanders or Bystanders()
        self.guided = len(xy)
        self.xy: Float = np.concatenate([np.reshape(xy, (-1, 2)), self._bystanders.start])
        count = len(self.xy)
        self.velocity: Float = np.zeros((count, 2))
        self.yaw: Float = rng.uniform(-math.pi, math.pi, count)
        self.time = 0.0
        self.walked = np.zeros(count)
        self.stragglers = Stragglers(stragglers, clearance)
        self._clearance = clearance
        self._speed, self._distance, self._side, self._reaction, self._start = (
            rng.uniform(*bounds, count)
            for bounds in (
                habits.speed, habits.distance, habits.side, habits.reaction, habits.start
            )
        )  # fmt: skip
        # A larger group is longer: the distances of those in front stay, more are behind.
        self._distance += 0.18 * max(self.guided - 5, 0) * (self._distance - habits.distance[0])
        self._wander = Wander(count, (8.0, 25.0), rng)
        self._gaze = Wander(count, (4.0, 15.0), rng)
        self._hurries = np.zeros(count, dtype=bool)
        self._trail: Trail | None = None
        self._leader: int | None = None
        self._along = np.zeros(count)
        self._noticed = np.zeros(count)
        self._walks = np.zeros(count, dtype=bool)
        self._stands_for = 0.0
        self._bearing = np.zeros(count)

    def step(self, dt: float, robots: Float, robot_velocities: Float, leader: int | None) -> None:
        """Walks on.

        Args:
            dt: For so long [s], 0.02 to 0.05.
            robots: Where they are [m], shape (m, 2).
            robot_velocities: How they move [m/s], shape (m, 2).
            leader: Which of them leads; None: nobody does, and people stand.
        """
        self._follow(dt, robots, robot_velocities, leader)
        goes_on = self.stragglers.step(self.time, dt, self.xy, self.walked, robots)
        self._hurries[goes_on] = True
        wish, cap = self._wishes(robots)
        at = None if leader is None else robots[leader]
        strolling = self._bystanders.step(self.time, self.xy[self.guided :], at)
        wish[self.guided :], cap[self.guided :, 0] = strolling, 1.2 * self._bystanders.speed
        force = (wish - self.velocity) / _RELAXATION
        force += self._from_people() + self._from_walls() + self._together()
        from_robots = _evading(self.xy, self.velocity, robots, robot_velocities, nearer=0.25)
        from_robots[self.guided :][self._bystanders.ignores] = 0.0
        force += from_robots
        self.velocity = self.velocity + shortened(force, _STRONGEST) * dt
        self.velocity = shortened(self.velocity, cap)
        before = self.xy
        self.xy = self._kept_apart(before + self.velocity * dt, robots)
        moved = self.xy - before
        # Who is held up does not go on pushing.
        self.velocity = np.where(
            np.abs(moved / dt) < np.abs(self.velocity), moved / dt, self.velocity
        )
        self.walked += np.linalg.norm(moved, axis=1)
        self.time += dt
        self._turn(dt, robots)

    # ------------------------------------------------------------------------- following ----

    def _follow(self, dt: float, robots: Float, velocities: Float, leader: int | None) -> None:
        """Keeps the trail of the leader, and where everybody is along it."""
        if leader is None:
            self._walks[:] = False
            return
        at = robots[leader]
        if self._trail is None:
            self._trail = Trail(self.xy[: self.guided].mean(axis=0))
        elif leader != self._leader:
            self._trail.take_over(at)
            self._walks[:] = False
        self._leader = leader
        self._trail.extend(at)
        self._noticed = np.minimum(self._noticed, self._trail.length)
        stands = float(np.linalg.norm(velocities[leader])) < 0.08
        self._stands_for = self._stands_for + dt if stands else 0.0
        if self._stands_for <= dt:
            toward = self.xy - at
            self._bearing = np.arctan2(toward[:, 1], toward[:, 0])
        self._along = self._trail.nearest(self.xy, self._along)
        # What the leader does is noticed late.
        self._noticed += (self._trail.length - self._noticed) * dt / (self._reaction + dt)
        gap = self._gap()
        self._walks = (gap > self._start) | (self._walks & (gap > 0.1))
        self._hurries &= gap > 0.3

    def _gap(self) -> Float:
        """How far everybody is behind their place along the trail [m], shape (n,)."""
        distance = self._distance + 0.25 * self._wander.at(self.time)
        return self._noticed - np.maximum(distance, 1.0) - self._along

    def _wishes(self, robots: Float) -> tuple[Float, Float]:
        """Velocities that people would like to have, (n, 2), and their highest speeds, (n, 1)."""
        count = len(self.xy)
        speed = np.where(self._hurries, _HURRY, 1.0) * self._speed
        cap = 1.4 * speed[:, None]
        if self._trail is None or self._leader is None:
            return np.zeros((count, 2)), cap
        gap = self._gap()
        pace = np.clip(gap / 0.9, 0.0, speed) * self._walks
        target = self._along + np.minimum(1.0, np.maximum(gap, 0.3))
        places, ahead = self._trail.at(target)
        # Beside the trail where it is straight; round a corner and through a door on it.
        straight = (ahead * self._trail.at(self._along)[1]).sum(axis=1)
        room = np.maximum(self._clearance.at(places)[0] - 0.4, 0.0) * np.clip(straight, 0.0, 1.0)
        side = np.clip(self._side + 0.2 * self._wander.at(self.time + 60.0), -room, room)
        places = places + side[:, None] * _left_of(ahead)
        wish = unit(places - self.xy) * pace[:, None]
        if self._stands_for > _STANDS_S:
            wish = np.where(self._walks[:, None], wish, self._spread(robots[self._leader]))
        who = self.stragglers.who
        wish[who] = shortened((self.stragglers.spots - self.xy[who]) / 0.8, 0.6)
        leaving = self.stragglers.leaving
        back = self._trail.at(self._along[leaving] - 1.0)[0] - self.xy[leaving]
        wish[leaving] = shortened(back / 0.8, speed[leaving, None])
        return wish, cap

    def _spread(self, leader: Float) -> Float:
        """Velocities of those who stand round the leader, to see it past the others, (n, 2)."""
        wish = np.zeros_like(self.xy)
        off = self.xy - leader
        near = np.linalg.norm(off, axis=1) < 6.0
        near[self._are_away()] = False
        who = np.flatnonzero(near)
        if not len(who):
            return wish
        sin, cos = np.sin(self._bearing[who]).mean(), np.cos(self._bearing[who]).mean()
        middle = math.atan2(float(sin), float(cos))
        bearing = _wrapped(np.arctan2(off[who, 1], off[who, 0]) - middle)
        places = leader + _rows(np.linalg.norm(off[who], axis=1), bearing, middle)
        distance, out = self._clearance.at(places)
        places = places + np.maximum(0.4 - distance, 0.0)[:, None] * out
        toward = places - self.xy[who]
        far = np.linalg.norm(toward, axis=1, keepdims=True)
        # Nobody goes past the leader, nor close to it, where a wall leaves no place in the row.
        seen = places - leader
        angle = _wrapped(np.arctan2(seen[:, 1], seen[:, 0]) - middle)
        free = (np.abs(angle) < 1.2 * _HALF_CIRCLE) & (np.linalg.norm(seen, axis=1) > 1.2)
        wish[who] = unit(toward) * np.clip((far - 0.25) / 1.0, 0.0, 0.5) * free[:, None]
        return wish

    # ----------------------------------------------------------------------------- forces ----

    def _from_people(self) -> Float:
        """Accelerations away from people, shape (n, 2) [m/s^2]."""
        force = _evading(self.xy, self.velocity, self.xy, self.velocity, skip_self=True)
        # Moussaid et al. 2010: members of a group step apart when they are closer than this.
        away = self.xy[:, None] - self.xy[None]
        distance = np.linalg.norm(away, axis=2)
        close = (distance < 0.8) & (distance > 1e-6)
        force += (close[..., None] * away / np.maximum(distance, 1e-6)[..., None]).sum(axis=1)
        return force

    def _are_away(self) -> Int:
        """Who does not keep to the group, shape (k,)."""
        others = np.arange(self.guided, len(self.xy))
        return np.concatenate([self.stragglers.who, self.stragglers.leaving, others])

    def _from_walls(self) -> Float:
        """Accelerations away from walls (Moussaid et al. 2009), shape (n, 2) [m/s^2]."""
        distance, out = self._clearance.at(self.xy)
        push: Float = 3.0 * np.exp(-np.maximum(distance - 0.25, -0.1) / 0.1)[:, None] * out
        return push

    def _together(self) -> Float:
        """Accelerations towards the centre of the group from far (Moussaid et al. 2010), (n, 2).

        Only for who follows in sight of it, and weaker than theirs: the trail holds them, too.
        """
        held = self._walks & ~self._hurries
        held[self._are_away()] = False
        if held.sum() < 2:
            return np.zeros_like(self.xy)
        toward = self.xy[held].mean(axis=0) - self.xy
        far = np.linalg.norm(toward, axis=1)
        limit = 0.5 * (int(held.sum()) - 1)
        pull = 0.5 * np.clip(far - limit, 0.0, 1.0) * held
        force: Float = pull[:, None] * unit(toward)
        return force

    def _kept_apart(self, places: Float, robots: Float) -> Float:
        """The places, moved so that no body is in another or in a robot, and none in a wall."""
        for _ in range(3):
            places = places + 0.5 * _lacking(places, places, _APART, skip_self=True)
            places = places + _lacking(places, robots, _FROM_ROBOT)
            distance, out = self._clearance.at(places)
            places = places + np.maximum(_FROM_WALL - distance, 0.0)[:, None] * out
        places = self.xy + shortened(places - self.xy, _STRIDE)
        free = self._clearance.at(places)[0] >= 0.5 * _FROM_WALL
        free |= self._clearance.at(self.xy)[0] < 0.5 * _FROM_WALL
        return np.where(free[:, None], places, self.xy)

    def _turn(self, dt: float, robots: Float) -> None:
        """People face where they walk; who stands faces the leader, or what they look at."""
        pace = np.linalg.norm(self.velocity, axis=1)
        walking = np.arctan2(self.velocity[:, 1], self.velocity[:, 0])
        standing = self.yaw.copy()
        if self._leader is not None and len(robots) > self._leader:
            toward = robots[self._leader] - self.xy
            standing = np.arctan2(toward[:, 1], toward[:, 0]) + 0.25 * self._gaze.at(self.time)
            standing[self.guided :] = self.yaw[self.guided :]
        who = self.stragglers.who
        out = self._clearance.at(self.xy[who])[1]
        standing[who] = np.arctan2(-out[:, 1], -out[:, 0])
        target = np.where(pace > 0.25, walking, standing)
        turn = _wrapped(target - self.yaw) / 0.5
        self.yaw = _wrapped(self.yaw + np.clip(turn, -2.5, 2.5) * dt)


def _rows(distance: Float, bearing: Float, middle: float) -> Float:
    """Places in rows of a sector round a leader, the nearest people in the first row, shape (n, 2).

    Args:
        distance: Of the people from it [m], shape (n,).
        bearing: Theirs, from the middle of the sector [rad], shape (n,).
        middle: Of the sector [rad].
    """
    places, order, first, radius = np.empty((len(distance), 2)), np.argsort(distance), 0, _ROW[0]
    while first < len(order):
        fit = int(2.0 * _HALF_CIRCLE * radius / _BESIDE) + 1
        row = order[first : first + fit]
        row = row[np.argsort(bearing[row])]
        step = min(_BESIDE / radius, 2.0 * _HALF_CIRCLE / max(len(row) - 1, 1))
        angle = middle + step * (np.arange(len(row)) - 0.5 * (len(row) - 1))
        places[row] = radius * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        first, radius = first + fit, radius + _ROW[1]
    return places


def _evading(
    xy: Float, velocity: Float, others: Float, their_velocity: Float, *, nearer: float = 0.0,
    skip_self: bool = False,
) -> Float:  # fmt: skip
    """Accelerations that evade others, shape (n, 2) [m/s^2] (Moussaid et al. 2009).

    Args:
        xy: Of those who evade [m], shape (n, 2).
        velocity: Theirs [m/s], shape (n, 2).
        others: Whom they evade [m], shape (m, 2).
        their_velocity: Of these [m/s], shape (m, 2).
        nearer: By how much wider they are than people [m].
        skip_self: `others` are `xy`.
    """
    if not len(others) or not len(xy):
        return np.zeros_like(xy)
    strength, gamma, slow, turn, weight = 4.5, 0.35, 2.0, 3.0, 2.0
    toward = others[None] - xy[:, None]
    distance = np.linalg.norm(toward, axis=2)
    unit = toward / np.maximum(distance, 1e-6)[..., None]
    interaction = weight * (velocity[:, None] - their_velocity[None]) + unit
    size = np.maximum(np.linalg.norm(interaction, axis=2), 1e-6)
    ahead = interaction / size[..., None]
    cross = ahead[..., 0] * unit[..., 1] - ahead[..., 1] * unit[..., 0]
    angle = np.arctan2(cross, (ahead * unit).sum(axis=2))
    reach = gamma * size
    force = strength * np.exp(-np.maximum(distance - nearer, 0.0) / reach)
    brake = np.exp(-((turn * reach * angle) ** 2))
    # Who meets somebody head-on passes on the right.
    side = np.where(np.abs(angle) < 1e-3, 1.0, np.sign(angle))
    aside = np.exp(-((slow * reach * angle) ** 2)) * side
    away = -(brake[..., None] * ahead + aside[..., None] * _left_of(ahead))
    # Those who stand do not circle about each other; they step aside for a robot that comes.
    still = (size < 1.3) & (skip_self | (np.linalg.norm(their_velocity, axis=1) < 0.05))
    away = np.where(still[..., None], -unit, away)
    if skip_self:
        np.fill_diagonal(force, 0.0)
    total: Float = (force[..., None] * away).sum(axis=1)
    return total


def _lacking(xy: Float, others: Float, least: float, *, skip_self: bool = False) -> Float:
    """How far to move so that no other is nearer than a distance [m], shape (n, 2)."""
    if not len(others):
        return np.zeros_like(xy)
    away = xy[:, None] - others[None]
    distance = np.linalg.norm(away, axis=2)
    if skip_self:
        np.fill_diagonal(distance, np.inf)
    lack = np.maximum(least - distance, 0.0)
    moved: Float = (lack[..., None] * away / np.maximum(distance, 1e-6)[..., None]).sum(axis=1)
    return moved


def _wrapped(angle: NDArray) -> NDArray:
    """The same angles in [-pi, pi)."""
    found: NDArray = (angle + math.pi) % (2.0 * math.pi) - math.pi
    return found


def _left_of(vectors: NDArray) -> NDArray:
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)

"""What a robot knows of its team's poses and of walls, at one time."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Float, Int
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.localization.filter.observations import Point
from mrs_people_loc.localization.filter.team_frame import STATE_TUNING, covariance_in_team
from mrs_people_loc.localization.odometry import (
    TRUE_WHEELS,
    Odometry,
    by_wheels,
    carried_on,
    motion,
    rotation_of,
    wandered,
)

_Value = TypeVar("_Value")


def changed(value: _Value, **changes: Any) -> _Value:
    """As `dataclasses.replace`, for values that need no check: in a tenth of the time."""
    made = object.__new__(type(value))
    vars(made).update(vars(value))
    vars(made).update(changes)
    return made


@dataclass(frozen=True)
class Sight:
    """How one robot has seen a wall.

    Attributes:
        count: How often it was recognized.
        extent: The part of it that was seen last, along the wall from its anchor [m].
        stamp_ns: When [ns].
    """

    count: int
    extent: Point
    stamp_ns: int


@dataclass(frozen=True)
class Landmark:
    """A wall of the state, except for its distance and bearing.

    Attributes:
        anchor: Its fixed point in the map [m].
        extent: The part of it that was seen so far, along it from the anchor [m].
        known: Its index among the known walls; -1: it is none.
        sights: By robot.
    """

    anchor: Point
    extent: Point
    known: int = -1
    sights: Mapping[str, Sight] = field(default_factory=dict)

    @property
    def seen_ns(self) -> int:
        """When it was seen last [ns]; 0: never."""
        return max((sight.stamp_ns for sight in self.sights.values()), default=0)

    def seen_by(self, robot: str, extent: Point, stamp_ns: int) -> Landmark:
        """The same after a robot recognized it."""
        before = self.sights.get(robot)
        count = 1 if before is None else before.count + 1
        whole = min(extent[0], self.extent[0]), max(extent[1], self.extent[1])
        sights = {**self.sights, robot: Sight(count, extent, stamp_ns)}
        return changed(self, extent=whole, sights=sights)


@dataclass(frozen=True)
class Standing:
    """A person of the state who stands, except for their place.

    Attributes:
        first: The robot that has seen them first.
        seen_ns: When they were seen last [ns].
    """

    first: str
    seen_ns: int


@dataclass(frozen=True)
class Source:
    """How the observations of one kind fit, of one robot or of two that meet.

    Attributes:
        accepted: How many, so far.
        refused: How many, so far.
        innovation: Of the last one: prediction error in sigmas (root of the normalized square over
            its degrees of freedom; 1 is usual).
        stamp_ns: Of the last accepted [ns]; 0: none.
        in_a_row: How many were refused in a row, since ...
        since_ns: ... this time [ns].
    """

    accepted: int = 0
    refused: int = 0
    innovation: float = 0.0
    stamp_ns: int = 0
    in_a_row: int = 0
    since_ns: int = 0

    def noted(self, accepted: bool, squared: float, freedom: int, stamp_ns: int) -> Source:
        """The same after one more observation.

        Args:
            accepted: Whether it fitted.
            squared: Squared Mahalanobis length of the prediction error.
            freedom: Its degrees of freedom.
            stamp_ns: Time [ns].
        """
        innovation = math.sqrt(max(squared, 0.0) / freedom)
        if accepted:
            return Source(self.accepted + 1, self.refused, innovation, stamp_ns)
        return changed(
            self,
            refused=self.refused + 1,
            innovation=innovation,
            in_a_row=self.in_a_row + 1,
            since_ns=self.since_ns if self.in_a_row else stamp_ns,
        )

    def restarted(self) -> Source:
        """The same where the next refused one is the first in a row."""
        return changed(self, in_a_row=0, since_ns=0)


@dataclass(frozen=True)
class Trust:
    """Whether what a robot observes fits where it is believed to be.

    Attributes:
        refused: Observations in a row that did not.
        since_ns: When the first of these was [ns].
        lost: Whether it was carried away or placed wrongly, and nothing has fitted since.
        astray: Whether it began again where it cannot be, and nothing has fitted since.
        lost_ns: When that was noticed last [ns]; 0: never.
        times_lost: How often.
        contradicted: Sights with walls that fit and walls that contradict, since it recognized one
            of the latter.
        contradicted_ns: When the first of these was [ns].
        disputed: Observations in a row that contradict what only one other robot has seen.
        claims_refused: Claims in a row of its pose that do not fit.
        claims_refused_ns: When the first of these was [ns].
        off: How far the last refused claim or disputed wall was off [m].
        claimed_ns: When it claimed its pose last [ns]; 0: never.
        contact_ns: When it was heard again after its last silence [ns]; 0: it was never silent.
        pulled: By how much its claims moved the team since then, or since filters had time to agree
            [m].
        noise: What the modelled noise of its odometry is multiplied by, as observations say.
        reached: Its dead reckoning when one fitted last; None: never.
    """

    refused: int = 0
    since_ns: int = 0
    lost: bool = False
    astray: bool = False
    lost_ns: int = 0
    times_lost: int = 0
    contradicted: int = 0
    contradicted_ns: int = 0
    disputed: int = 0
    claims_refused: int = 0
    claims_refused_ns: int = 0
    off: float = 0.0
    claimed_ns: int = 0
    contact_ns: int = 0
    pulled: float = 0.0
    noise: float = 1.0
    reached: Odometry | None = None


_UNKNOWN = Trust()


@dataclass(frozen=True)
class Misfit:
    """A known wall that is not where the map says.

    Attributes:
        count: How often it was seen elsewhere.
        offset: How far, the mean [m]; positive: farther from the robot than in the map.
        agreed: How often in a row a wall was seen where the map says, since it is not looked for.
    """

    count: int
    offset: float
    agreed: int = 0


class Reckoned(NamedTuple):
    """A robot's pose, carried on by dead reckoning.

    Attributes:
        place: The pose, shape (3,).
        jacobian: By the pose before and the errors of the wheels, shape (3, 6).
        noise: Covariance that the way adds, shape (3, 3).
        before: Covariance of the pose before and of the errors of the wheels, shape (6, 6).
    """

    place: Float
    jacobian: Float
    noise: Float
    before: Float

    @property
    def covariance(self) -> Float:
        """Of the pose, shape (3, 3)."""
        return self.jacobian @ self.before @ self.jacobian.T + self.noise

    def carried_on(self, covariance: Float) -> Float:
        """A covariance of the pose before, at this one, shape (3, 3)."""
        by_place = self.jacobian[:, :3]
        return by_place @ covariance @ by_place.T + self.noise


@dataclass(frozen=True)
class TeamState:
    """Poses of robots and walls with their joint covariance; never changed, only replaced.

    Attributes:
        mean: x, y [m], yaw [rad] of each robot, then the systematic errors of the wheels of each
            (`Wheels`), then x, y [m] of people who stand, then distance [m] and bearing [rad] of
            each wall, shape (n,).
        covariance: Shape (n, n).
        odometry: By robot, in the order of `mean`: dead reckoning at the time that its pose in
            `mean` is of. It is carried on only when something is observed.
        people: In the order of `mean`.
        people_ns: Time that the places of people are of [ns].
        walls: Likewise.
        sources: How observations fit, by robot and kind.
        trust: By robot.
        meetings: How relative poses fit, by pair of robots.
        misfits: Known walls that were never recognized but seen elsewhere, by index.
    """

    mean: Float = field(default_factory=lambda: np.zeros(0))
    covariance: Float = field(default_factory=lambda: np.zeros((0, 0)))
    odometry: Mapping[str, Odometry] = field(default_factory=dict)
    people: tuple[Standing, ...] = ()
    people_ns: int = 0
    walls: tuple[Landmark, ...] = ()
    sources: Mapping[tuple[str, str], Source] = field(default_factory=dict)
    trust: Mapping[str, Trust] = field(default_factory=dict)
    meetings: Mapping[tuple[str, str], Source] = field(default_factory=dict)
    misfits: Mapping[int, Misfit] = field(default_factory=dict)

    @property
    def has_map(self) -> bool:
        """Whether some of the walls are known."""
        return any(wall.known >= 0 for wall in self.walls)

    def at(self, robot: str) -> int:
        """Where a robot's pose begins in `mean`."""
        return 3 * list(self.odometry).index(robot)

    def wheels_at(self, robot: str) -> int:
        """Where the systematic errors of a robot's wheels begin in `mean`."""
        return 3 * len(self.odometry) + self.at(robot)

    def wall_at(self, index: int) -> int:
        """Where a wall begins in `mean`."""
        return self.person_at(len(self.people)) + 2 * index

    def person_at(self, index: int) -> int:
        """Where a person's place begins in `mean`."""
        return 6 * len(self.odometry) + 2 * index

    def columns(self, robot: str, wall: int) -> Int:
        """Indices of a robot's pose and of a wall, shape (5,)."""
        r, w = self.at(robot), self.wall_at(wall)
        return np.array([r, r + 1, r + 2, w, w + 1])

    def pose_of(self, robot: str, odometry: Odometry) -> Reckoned:
        """A robot's pose when its dead reckoning is this."""
        place, jacobian, noise = self._ahead(robot, odometry)
        own = self._pose_and_wheels(robot)
        return Reckoned(place, jacobian, noise, self.covariance[own[:, np.newaxis], own])

    def _ahead(self, robot: str, odometry: Odometry) -> tuple[Float, Float, Float]:
        """A robot's pose when its dead reckoning is this.

        Returns:
            The pose, shape (3,), its Jacobian by the pose before and the wheels, shape (3, 6), and
            the covariance that the way adds, shape (3, 3).
        """
        i, w = self.at(robot), self.wheels_at(robot)
        before, place = self.odometry[robot], self.mean[i : i + 3]
        if before.stamp_ns == odometry.stamp_ns:
            return place, np.eye(3, 6), np.zeros((3, 3))
        seconds = (odometry.stamp_ns - before.stamp_ns) / 1e9
        moved, noise = motion(before, odometry)
        noise = self.trust.get(robot, _UNKNOWN).noise * noise
        moved, by_errors = by_wheels(moved, self.mean[w : w + 3], seconds)
        made, by_place = carried_on(place, moved)
        rotation, jacobian = rotation_of(float(place[2])), np.empty((3, 6))
        jacobian[:, :3], jacobian[:, 3:] = by_place, rotation @ by_errors
        return made, jacobian, rotation @ noise @ rotation.T

    def _pose_and_wheels(self, robot: str) -> Int:
        """Indices of a robot's pose and of the errors of its wheels, shape (6,)."""
        i, w = self.at(robot), self.wheels_at(robot)
        return np.array([i, i + 1, i + 2, w, w + 1, w + 2])

    def in_team(self, robot: str, others: Collection[str]) -> Float:
        """Covariance of a robot's pose relative to it and these others, shape (3, 3)."""
        team = [name for name in self.odometry if name == robot or name in others]
        at = np.array([self.at(n) + k for n in team for k in range(3)])
        places = self.mean[at].reshape(-1, 3)
        return covariance_in_team(places, self.covariance[at[:, np.newaxis], at], team.index(robot))

    def carried_on(self, robot: str, odometry: Odometry, wheels: Float) -> TeamState:
        """The state with a robot at the time of this dead reckoning; `wheels`: see `with_robot`."""
        before, i, w = self.odometry[robot], self.at(robot), self.wheels_at(robot)
        if before.stamp_ns == odometry.stamp_ns:
            return self
        block, both = slice(i, i + 3), self._pose_and_wheels(robot)
        mean, covariance = self.mean.copy(), self.covariance.copy()
        mean[block], jacobian, noise = self._ahead(robot, odometry)
        covariance[block] = jacobian @ covariance[both]
        covariance[:, block] = covariance[:, both] @ jacobian.T
        covariance[block, block] += noise
        own = range(w, w + 3)
        covariance[own, own] += wheels * wandered(before, odometry)
        return changed(
            self,
            mean=mean,
            covariance=covariance,
            odometry={**self.odometry, robot: odometry},
        )

    def with_robot(
        self, robot: str, odometry: Odometry, place: Float, covariance: Float, wheels: Float
    ) -> TeamState:
        """The state with one more robot, whose pose is independent of the rest.

        Args:
            robot: Its name.
            odometry: Its dead reckoning.
            place: Its pose, shape (3,).
            covariance: Of the pose, shape (3, 3).
            wheels: Variances of the systematic errors of its wheels, shape (3,).
        """
        i, n = 3 * len(self.odometry), len(self.mean)
        mean = np.insert(np.insert(self.mean, 2 * i, TRUE_WHEELS), i, place)
        made = _inserted(self.covariance, 2 * i, np.zeros((3, n)), np.diag(wheels))
        made = _inserted(made, i, np.zeros((3, n + 3)), covariance)
        return changed(
            self,
            mean=mean,
            covariance=made,
            odometry={**self.odometry, robot: odometry},
        )

    def replaced(self, robot: str, place: Float, across: Float, covariance: Float) -> TeamState:
        """The state with a robot at another place, without what only it has seen.

        Args:
            robot: The robot.
            place: Its pose, shape (3,).
            across: Covariance of that pose with the state, shape (3, n); that with what was the
                robot's pose does not count.
            covariance: Of that pose, shape (3, 3).
        """
        i = self.at(robot)
        mean, joint = self.mean.copy(), self.covariance.copy()
        mean[i : i + 3] = place
        joint[i : i + 3], joint[:, i : i + 3] = across, across.T
        joint[i : i + 3, i : i + 3] = covariance
        state = changed(self, mean=mean, covariance=joint)
        for k in reversed(range(len(self.walls))):
            if self.walls[k].known < 0 and set(self.walls[k].sights) == {robot}:
                state = state.without_wall(k)
        for k in reversed(range(len(self.people))):
            if self.people[k].first == robot:
                state = state.without_person(k)
        return state

    def with_wall(self, wall: Landmark, line: Float, across: Float, covariance: Float) -> TeamState:
        """The state with one more wall.

        Args:
            wall: The wall.
            line: Its distance and bearing, shape (2,).
            across: Their covariance with the state, shape (2, n).
            covariance: Shape (2, 2).
        """
        n = len(self.mean)
        return changed(
            self,
            mean=np.append(self.mean, line),
            covariance=_inserted(self.covariance, n, across, covariance),
            walls=(*self.walls, wall),
        )

    def with_person(
        self, person: Standing, place: Float, across: Float, covariance: Float
    ) -> TeamState:
        """The state with one more person; the arguments are those of `with_wall`."""
        i = self.person_at(len(self.people))
        return changed(
            self,
            mean=np.insert(self.mean, i, place),
            covariance=_inserted(self.covariance, i, across, covariance),
            people=(*self.people, person),
        )

    def without_person(self, index: int) -> TeamState:
        """The state without a person."""
        i = self.person_at(index)
        people = self.people[:index] + self.people[index + 1 :]
        return changed(self._without(np.array([i, i + 1])), people=people)

    def without_robot(self, robot: str) -> TeamState:
        """The state without a robot, and without what was noted about it."""
        others = {name: value for name, value in self.odometry.items() if name != robot}
        return changed(
            self._without(self._pose_and_wheels(robot)),
            odometry=others,
            sources={key: value for key, value in self.sources.items() if key[0] != robot},
            trust={name: value for name, value in self.trust.items() if name != robot},
            meetings={pair: value for pair, value in self.meetings.items() if robot not in pair},
        )

    def without_wall(self, index: int) -> TeamState:
        """The state without a wall."""
        i = self.wall_at(index)
        walls = self.walls[:index] + self.walls[index + 1 :]
        return changed(self._without(np.array([i, i + 1])), walls=walls)

    def widened(self, robot: str, sigmas: tuple[float, float, float]) -> TeamState:
        """The state with a robot's pose less sure by these, independently [m, m, rad]."""
        i = self.at(robot)
        covariance = self.covariance.copy()
        covariance[range(i, i + 3), range(i, i + 3)] += np.square(sigmas)
        return changed(self, covariance=covariance)

    def stepped(self, step: Float, reference: Int) -> tuple[Float, Float]:
        """The mean after a correction, and how errors about it follow from those before.

        Robots and walls that see only each other do not know where they are as a whole. An EKF
        whose errors are differences of coordinates believes to learn it, as what a common turn
        does to them depends on the estimate (Huang, Mourikis & Roumeliotis 2010, "Observability-
        based rules for designing consistent EKF SLAM"). Here the error of a pose is a motion of the
        map, as in the right-invariant EKF (Barrau & Bonnabel 2015, "An EKF-SLAM algorithm with
        consistency properties"): the same error of all poses is a motion of the whole team. The
        rest of a robot's error turns with it: what walls tell is in its base_link, and the way
        along them stays unknown when its heading is corrected; known walls do not turn with it.

        Args:
            step: Correction, shape (n,).
            reference: Indices of the pose of the robot that observes, shape (3,), for walls that no
                robot of the team has seen.

        Returns:
            The mean, shape (n,), and the matrix, shape (n, n), that turns errors at the mean
            before into those at this one.
        """
        robots, n = 3 * len(self.odometry), len(step)
        mean, carried = self.mean + step, np.eye(n)
        # Vectors of the plane are complex numbers.
        x, y, turn = step[:robots].reshape(-1, 3).T
        way = _chord(x + 1j * y, turn)
        mean[0:robots:3] += way.real - x
        mean[1:robots:3] += way.imag - y
        i = np.arange(0, robots, 3)
        carried[i, i + 2], carried[i + 1, i + 2] = -way.imag, way.real
        shape = None
        if np.abs(turn).max() > STATE_TUNING.least_turn and not self.has_map:
            shape = self._turned_shape(turn)
            carried[:robots, :robots] += shape
        if self.people:
            self._step_people(step, int(reference[0]), shape, mean, carried)
        if self.walls:
            self._step_walls(step, int(reference[0]), shape, mean, carried)
        return mean, carried

    def _step_walls(
        self, step: Float, reference: int, shape: Float | None, mean: Float, carried: Float
    ) -> None:
        """Completes `stepped` for the walls, in place.

        A line has no error along it, but where a motion brings it depends on that, too, once its
        bearing is corrected: it is taken from the robot that has seen it first.
        """
        begin = self.wall_at(0)
        origin = self._origins((next(iter(wall.sights), "") for wall in self.walls), reference)
        # From the anchors; vectors of the plane are complex numbers.
        off = self.mean[origin] + 1j * self.mean[origin + 1]
        off -= np.array([complex(*wall.anchor) for wall in self.walls])
        shift = step[origin] + 1j * step[origin + 1] - 1j * step[origin + 2] * off
        before, after = np.exp(1j * np.stack([self.mean[begin + 1 :: 2], mean[begin + 1 :: 2]]))
        rise = after - before
        mean[begin::2] += (before.conj() * (_chord(shift, -step[begin + 1 :: 2]) - shift)).real
        lines = np.arange(begin, len(step), 2)
        if shape is not None:
            x, y = after.real[:, np.newaxis], after.imag[:, np.newaxis]
            carried[lines, : len(shape)] += x * shape[origin] + y * shape[origin + 1]
        carried[lines, origin] += rise.real
        carried[lines, origin + 1] += rise.imag
        carried[lines, origin + 2] += (rise.conj() * -1j * off).real

    def _turned_shape(self, turn: Float) -> Float:
        """What turns of the robots add to how errors are carried on, shape (3 k, 3 k).

        What a wall tells about a robot is in its base_link: it turns with it. What all robots have
        in common, a motion of the map, does not.

        Args:
            turn: Of each robot [rad], shape (k,).
        """
        count = len(turn)
        i = np.arange(0, 3 * count, 3)
        # Errors of places beside the common motion: the mean of the errors and of the turns.
        places = self.mean[i] + 1j * self.mean[i + 1]
        own = np.empty((count, 3 * count), dtype=np.complex128)
        own[:, 0::3] = np.eye(count) - 1.0 / count
        own[:, 1::3] = 1j * own[:, 0::3]
        own[:, 2::3] = (-1j / count) * (places - places.mean())[:, np.newaxis]
        own *= (np.exp(1j * turn) - 1.0)[:, np.newaxis]
        made = np.zeros((3 * count, 3 * count))
        made[i], made[i + 1] = own.real, own.imag
        return made

    def _step_people(
        self, step: Float, reference: int, shape: Float | None, mean: Float, carried: Float
    ) -> None:
        """Completes `stepped` for people, in place: likewise."""
        i = np.arange(self.person_at(0), self.wall_at(0), 2)
        origin = self._origins((person.first for person in self.people), reference)
        straight = step[i] + 1j * step[i + 1]
        way = _chord(straight, step[origin + 2])
        mean[i] += (way - straight).real
        mean[i + 1] += (way - straight).imag
        if shape is not None:
            carried[i, : len(shape)] += shape[origin]
            carried[i + 1, : len(shape)] += shape[origin + 1]
        carried[i, origin + 2] -= way.imag
        carried[i + 1, origin + 2] += way.real

    def _origins(self, firsts: Iterable[str], reference: int) -> Int:
        """Where the poses of the robots that have seen things first begin in `mean`."""
        at = {robot: 3 * k for k, robot in enumerate(self.odometry)}
        return np.array([at.get(first, reference) for first in firsts])

    def drawn(self, robot: str, step: Float) -> TeamState:
        """The state with a pose moved, and the others as far as their errors go with it.

        What a map holds in its place hardly moves, and known walls do not.

        Args:
            robot: Whose pose.
            step: By how much: x, y [m], yaw [rad], shape (3,).
        """
        pose = self.at(robot) + np.arange(3)
        across = self.covariance[:, pose]
        steps = across @ np.linalg.solve(across[pose], step)
        for k, wall in enumerate(self.walls):
            if wall.known >= 0:
                steps[self.wall_at(k) + np.arange(2)] = 0.0
        mean, carried = self.stepped(steps, pose)
        covariance = carried @ self.covariance @ carried.T
        return changed(self, mean=mean, covariance=0.5 * (covariance + covariance.T))

    def moved(self, origin: Float, target: Float) -> TeamState:
        """The state moved and turned as a whole, so that one pose becomes another.

        Args:
            origin: x, y [m], yaw [rad], shape (3,).
            target: What it becomes, shape (3,).
        """
        turn = float(target[2] - origin[2])
        rotation = rotation_2d(turn)
        shift = target[:2] - rotation @ origin[:2]
        robots = 3 * len(self.odometry)
        mean, jacobian = self.mean.copy(), np.eye(len(self.mean))
        for i in range(0, robots, 3):
            mean[i : i + 2] = rotation @ self.mean[i : i + 2] + shift
            mean[i + 2] += turn
            jacobian[i : i + 2, i : i + 2] = rotation
        for i in range(self.person_at(0), self.wall_at(0), 2):
            mean[i : i + 2] = rotation @ self.mean[i : i + 2] + shift
            jacobian[i : i + 2, i : i + 2] = rotation
        for k, wall in enumerate(self.walls):
            i = self.wall_at(k)
            bearing = float(mean[i + 1]) + turn
            c, s = math.cos(bearing), math.sin(bearing)
            dx, dy = rotation @ wall.anchor + shift - wall.anchor
            mean[i : i + 2] = mean[i] + c * dx + s * dy, bearing
            jacobian[i, i + 1] = c * dy - s * dx
        covariance = jacobian @ self.covariance @ jacobian.T
        return changed(self, mean=mean, covariance=covariance)

    def _without(self, indices: Int) -> TeamState:
        keep = np.delete(np.arange(len(self.mean)), indices)
        return changed(self, mean=self.mean[keep], covariance=self.covariance[np.ix_(keep, keep)])


def _chord(way: NDArray[np.complex128], turn: Float) -> NDArray[np.complex128]:
    """Where ways lead that turn evenly by an angle: the exponential map of SE(2)."""
    half = 0.5 * turn + 1e-200  # not 0
    return np.asarray(way * np.exp(1j * half) * (np.sin(half) / half))


def _inserted(covariance: Float, at: int, across: Float, own: Float) -> Float:
    """A covariance with further rows and columns at an index."""
    n, more = len(covariance), len(own)
    made = np.empty((n + more, n + more))
    old = np.r_[0:at, at + more : n + more]
    new = slice(at, at + more)
    made[np.ix_(old, old)] = covariance
    made[new, new] = own
    made[new, old] = across
    made[old, new] = across.T
    return made

"""Dead reckoning and how its uncertainty grows.

The errors of a differential drive are modelled as in Chong & Kleeman 1997 ("Accurate odometry and
error modelling for a mobile robot"): white in the way, so that variances grow in proportion to the
way and to the turn. Carrying the covariance on from step to step is the uncertainty evolution of
Watanabe & Yuta 1990 (POEM). Beside them are errors that stay the same for long (`Wheels`), as those
of unequal wheels and of a wrong wheelbase (Borenstein & Feng 1996, "Measurement and correction of
systematic odometry errors in mobile robots").
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.clocks import Order, StampOrder
from mrs_people_loc.config import Localization
from mrs_people_loc.errors import PoseError
from mrs_people_loc.geometry import wrap_angle
from mrs_people_loc.team.poses import Pose, is_jump


@dataclass(frozen=True)
class OdometryTuning:
    """Constants of dead reckoning, chosen by hand.

    Attributes:
        max_ahead_ns: How far the newest motion is extrapolated [ns].
        longest_ns: Between two that are farther apart in time, as messages were lost [ns], ...
        longest_turn: ... and in heading [rad], it is not known when the robot turned.
        most_stated: Covariances of the odometry's message count up to so many times the modelled
            growth.
        max_variances: Of position and heading between two times: beyond, nothing is known [m^2,
            rad^2].
        turn: Odometry that jumps (`is_jump`), or turns by more than this [rad] ...
        turn_speed: ... and this speed [rad/s] explain, starts again ...
        jump_variances: ... and what the robot did meanwhile is unknown: variances of position and
            heading [m^2, rad^2].
        turns_from: A faster turn is more than noise, whatever the steps that it is read in [rad/s].
        step: Ways are counted in steps of this, at least [m].
        stops_dead: Odometry that says the same after a step of at least this speed [m/s] ...
        hangs_after_s: ... for longer than this [s] hangs: no robot stops so suddenly. It may drive
            on as before, for ...
        hangs_s: ... so long at most [s], ...
        hangs_turn: ... and turn by this standard deviation [rad/s].
        wander: Systematic errors of wheels change in a metre of way, and that of turns in a radian,
            by this share of what they may be at the start; it grows with the root.
    """

    max_ahead_ns: int = 100_000_000
    longest_ns: int = 220_000_000
    longest_turn: float = 0.03
    most_stated: float = 25.0
    max_variances: tuple[float, float] = (1e4, 10.0)
    turn: float = 1.0
    turn_speed: float = 6.0
    jump_variances: tuple[float, float] = (0.5**2, 0.2**2)
    turns_from: float = 0.1
    step: float = 0.1
    stops_dead: float = 0.2
    hangs_after_s: float = 0.3
    hangs_s: float = 5.0
    hangs_turn: float = 0.1
    wander: float = 0.05


_TUNING = OdometryTuning()


@dataclass(frozen=True)
class Odometry:
    """Dead reckoning since a robot's start.

    The errors of two pieces of the way are independent, so what lies between two of these has the
    differences of the variances, whatever was lost between them.

    Attributes:
        stamp_ns: Time [ns].
        x: Position in the odometry's frame [m].
        y: Position [m].
        yaw: Heading [rad].
        position_variance: Variance of the position, along the way and likewise across, that the way
            so far has added by itself, without the effect of the heading [m^2]; it never falls.
        heading_variance: Likewise of the heading [rad^2].
    """

    stamp_ns: int
    x: float
    y: float
    yaw: float
    position_variance: float
    heading_variance: float


#: Systematic errors of wheels, shape (3,): the true way is longer than that of the odometry by this
#: share, the true turn is greater by this many radians per metre (driven backwards: less), and by
#: this share.
Wheels = Float
#: What odometry without systematic errors has.
TRUE_WHEELS: Wheels = np.zeros(3)


def by_wheels(moved: Float, wheels: Wheels, seconds: float = 0.0) -> tuple[Float, Float]:
    """What a robot moved, by what its odometry says and the systematic errors of its wheels.

    The turn by which the odometry is wrong accrues evenly along the way. Noise of the odometry must
    not look like a way: where a turn is not more than noise, or a motion is to the side, it tells
    nothing about wheels (errors in variables: their estimates would shrink towards no motion).

    Args:
        moved: x, y [m] and yaw [rad] of the end in base_link at the beginning by odometry, shape
            (3,); a way so short that its chord is as long.
        wheels: The errors.
        seconds: How long it took [s]; 0: there is no noise.

    Returns:
        The same, corrected, and its Jacobian by `wheels`, shape (3, 3).
    """
    way, aside, turn = moved.tolist()
    squared = turn * turn
    least = (_TUNING.turns_from * seconds) ** 2
    driven = turn * (1.0 - least / squared) if squared > least else 0.0
    x, y, more = _corrected(way, aside, driven, wheels.tolist())
    c, s = math.cos(0.5 * more), math.sin(0.5 * more)
    jacobian = np.array(
        [
            [c * way, -0.5 * y * way, -0.5 * y * driven],
            [s * way, 0.5 * x * way, 0.5 * x * driven],
            [0.0, way, driven],
        ]
    )
    return np.array([x, y, turn + more]), jacobian


def _corrected(
    way: float, aside: float, turn: float, wheels: Sequence[float]
) -> tuple[float, float, float]:
    """Where a way [m] leads with errors of the wheels: x, y [m], and how much more it turns."""
    scale, per_metre, per_radian = wheels
    more = per_metre * way + per_radian * turn
    c, s = math.cos(0.5 * more), math.sin(0.5 * more)
    longer = (1.0 + scale) * way
    return c * longer - s * aside, s * longer + c * aside, more


def motion(begin: Odometry, end: Odometry) -> tuple[Float, Float]:
    """What a robot moved between two times, by its odometry.

    The heading's errors accrue evenly along a straight way, so that they contribute a third of
    what the final heading error would across the way, and correlate with it.

    Returns:
        x, y [m] and yaw [rad] of the end in base_link at the beginning, shape (3,), and their
        covariance, shape (3, 3).
    """
    c, s = math.cos(begin.yaw), math.sin(begin.yaw)
    east, north = end.x - begin.x, end.y - begin.y
    dx, dy = c * east + s * north, c * north - s * east
    position = min(
        max(end.position_variance - begin.position_variance, 0.0), _TUNING.max_variances[0]
    )
    heading = min(max(end.heading_variance - begin.heading_variance, 0.0), _TUNING.max_variances[1])
    third, half = heading / 3.0, heading / 2.0
    covariance = np.array(
        [
            [position + third * dy * dy, -third * dx * dy, -half * dy],
            [-third * dx * dy, position + third * dx * dx, half * dx],
            [-half * dy, half * dx, heading],
        ]
    )
    return np.array([dx, dy, wrap_angle(end.yaw - begin.yaw)]), covariance


def wandered(begin: Odometry, end: Odometry) -> Float:
    """What systematic errors of wheels gain between two times, shape (3,).

    Returns:
        Variances over those at the start.
    """
    way = math.hypot(end.x - begin.x, end.y - begin.y)
    turn = abs(wrap_angle(end.yaw - begin.yaw))
    return _TUNING.wander**2 * np.array([way, way, turn])


def carried_on(place: Float, moved: Float) -> tuple[Float, Float]:
    """A pose after a motion, and its derivative by the pose before.

    Args:
        place: x, y [m] and yaw [rad], shape (3,).
        moved: Likewise, in the frame of `place`.

    Returns:
        The new pose, shape (3,) (its yaw is not wrapped), and the Jacobian, shape (3, 3); that by
        the motion is the rotation by the pose's yaw.
    """
    c, s = math.cos(place[2]), math.sin(place[2])
    dx, dy = c * moved[0] - s * moved[1], s * moved[0] + c * moved[1]
    jacobian = np.array([[1.0, 0.0, -dy], [0.0, 1.0, dx], [0.0, 0.0, 1.0]])
    return np.array([place[0] + dx, place[1] + dy, place[2] + moved[2]]), jacobian


def rotation_of(yaw: float) -> Float:
    """The matrix that turns x, y of x, y, yaw by an angle [rad], shape (3, 3)."""
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


def turned(covariance: Float, yaw: float) -> Float:
    """The covariance of x, y, yaw in a frame that is turned by -yaw, shape (3, 3)."""
    rotation = rotation_of(yaw)
    return np.asarray(rotation @ covariance @ rotation.T)


@dataclass
class DeadReckoning:
    """A robot's odometry with the variances that its way has added.

    Attributes:
        config: The noise.
        order: Of the stamps.
        jumps: How often the odometry jumped, as it does when a base starts again, so far.
        hangs_s: For how long it hangs, as that of a driver that has died [s]; 0: it does not.
        hung_ns: When it hung last [ns]; 0: never.
        way: What the robot drove since it began [m]; to and fro within `_TUNING.step` is none.
    """

    config: Localization
    order: StampOrder = field(default_factory=StampOrder)
    jumps: int = 0
    hangs_s: float = 0.0
    hung_ns: int = 0
    way: float = 0.0
    _speed: float = 0.0  # of the last step, or of the one before it stopped dead [m/s]
    _counted: tuple[float, float] | None = None
    _last: tuple[Pose, Odometry] | None = None

    @property
    def hangs(self) -> bool:
        """Whether the odometry hangs now."""
        return self.hangs_s > _TUNING.hangs_after_s

    def take(self, pose: Pose) -> Odometry:
        """Takes the pose in the odometry's frame.

        The first one, or the first after the clock jumped back, begins with variances of zero.
        Where the odometry jumps, the robot stays where it was, less surely; where it hung before,
        that is what it drove meanwhile.

        Raises:
            PoseError: The stamp is not newer than the last one.
        """
        newest_ns, order = self.order.newest_ns, self.order.take(pose.stamp_ns)
        if order is Order.LATE:
            raise PoseError(f"stamp is {pose.stamp_ns} ns; wanted: newer than {newest_ns} ns")
        if order is Order.NEWER and self._last is not None:
            made = self._after(*self._last, pose)
        else:
            made = Odometry(pose.stamp_ns, pose.x, pose.y, pose.yaw, 0.0, 0.0)
            self.hangs_s = self._speed = 0.0
            self.way, self._counted = 0.0, (made.x, made.y)
        self._last = pose, made
        self._count(made.x, made.y)
        return made

    def _count(self, x: float, y: float) -> None:
        """Counts the way to a place."""
        assert self._counted is not None
        way = math.dist((x, y), self._counted)
        if way > _TUNING.step:
            self.way += way
            self._counted = x, y

    def _after(self, before: Pose, so_far: Odometry, pose: Pose) -> Odometry:
        """Dead reckoning at a pose, after that at the pose before."""
        x, y, yaw = so_far.x, so_far.y, so_far.yaw
        hung = self._hung(before, pose)
        if hung is not None:
            position, heading = hung
        elif not self._catches_up(before, pose) and (
            is_jump(before, pose) or _is_turned(before, pose)
        ):
            position, heading = _TUNING.jump_variances
            self.jumps += 1
        else:
            position, heading = self._growth(before, pose)
            east, north = pose.x - before.x, pose.y - before.y
            c, s = math.cos(before.yaw), math.sin(before.yaw)
            turn = wrap_angle(pose.yaw - before.yaw)
            way, aside = c * east + s * north, c * north - s * east
            dx, dy, more = _corrected(way, aside, turn, self.config.wheels)
            c, s = math.cos(yaw), math.sin(yaw)
            x, y, yaw = x + c * dx - s * dy, y + s * dx + c * dy, yaw + turn + more
        return Odometry(
            pose.stamp_ns,
            x, y, wrap_angle(yaw),
            so_far.position_variance + position,
            so_far.heading_variance + heading,
        )  # fmt: skip

    def _hung(self, before: Pose, pose: Pose) -> tuple[float, float] | None:
        """What a step adds to the variances while the odometry hangs; None: it does not."""
        seconds = (pose.stamp_ns - before.stamp_ns) / 1e9
        if (pose.x, pose.y, pose.yaw) != (before.x, before.y, before.yaw):
            return None
        if self._speed < _TUNING.stops_dead:
            self._speed = 0.0
            return None
        begin, end = self.hangs_s, self.hangs_s + seconds
        self.hangs_s = end
        if end <= _TUNING.hangs_after_s:
            return 0.0, 0.0
        self.hung_ns = pose.stamp_ns
        # From its beginning on: what it drove meanwhile grows with time, and its variance squared.
        begin = 0.0 if begin <= _TUNING.hangs_after_s else min(begin, _TUNING.hangs_s)
        more = min(end, _TUNING.hangs_s) ** 2 - begin**2
        return self._speed**2 * more, _TUNING.hangs_turn**2 * more

    def _catches_up(self, before: Pose, pose: Pose) -> bool:
        """Whether odometry that hung says now what the robot drove meanwhile; it hangs no more."""
        way = math.hypot(pose.x - before.x, pose.y - before.y)
        seconds = (pose.stamp_ns - before.stamp_ns) / 1e9
        hung, most = self.hangs, 2.0 * self._speed * self.hangs_s
        self.hangs_s, self._speed = 0.0, way / seconds
        return hung and way < most

    def _growth(self, before: Pose, pose: Pose) -> tuple[float, float]:
        """What a step adds to the variances of position [m^2] and heading [rad^2]."""
        config = self.config
        way = math.hypot(pose.x - before.x, pose.y - before.y)
        turn = abs(wrap_angle(pose.yaw - before.yaw))
        position = config.position_noise**2 * way
        heading = config.heading_noise**2 * way + config.turn_noise**2 * turn
        (xx, xy, _), (_, yy, _), (_, _, stated) = (pose.covariance - before.covariance).tolist()
        # An error of the heading adds to the position's covariance in one direction only.
        least = 0.5 * (xx + yy) - math.hypot(0.5 * (xx - yy), xy)
        # Some bases state large covariances while they drive, and small ones while they stand.
        return (
            max(position, min(least, _TUNING.most_stated * position)),
            max(heading, min(stated, _TUNING.most_stated * heading)),
        )


def _is_turned(before: Pose, pose: Pose) -> bool:
    seconds = (pose.stamp_ns - before.stamp_ns) / 1e9
    return abs(wrap_angle(pose.yaw - before.yaw)) > _TUNING.turn + _TUNING.turn_speed * seconds


@dataclass
class OdometryTrack:
    """The last dead reckoning of one robot, to be read at any time between.

    Attributes:
        span_ns: What is older than the newest by more is forgotten [ns].
    """

    span_ns: int = 5_000_000_000
    _stamps: list[int] = field(default_factory=list)
    _values: list[Odometry] = field(default_factory=list)

    @property
    def newest(self) -> Odometry | None:
        """The newest; None: there is none."""
        return self._values[-1] if self._values else None

    def add(self, odometry: Odometry) -> None:
        """Takes one; those that come late are put in their place, repeated ones are dropped."""
        stamps, values = self._stamps, self._values
        if not stamps or odometry.stamp_ns > stamps[-1]:
            stamps.append(odometry.stamp_ns)
            values.append(odometry)
        else:
            index = bisect.bisect_left(stamps, odometry.stamp_ns)
            if stamps[index] != odometry.stamp_ns:
                stamps.insert(index, odometry.stamp_ns)
                values.insert(index, odometry)
        # Rarely, and many at once: removing the first of a list moves all others.
        if stamps[-1] - stamps[0] > 1.5 * self.span_ns:
            first = bisect.bisect_left(stamps, stamps[-1] - self.span_ns)
            del stamps[:first], values[:first]

    def covers(self, stamp_ns: int) -> bool:
        """Whether there is some on both sides of a time, or at it."""
        return bool(self._stamps) and self._stamps[0] <= stamp_ns <= self._stamps[-1]

    def tells(self, stamp_ns: int) -> bool:
        """Whether it covers a time, and when the robot turned about then."""
        if not self.covers(stamp_ns):
            return False
        index = bisect.bisect_left(self._stamps, stamp_ns)
        if self._stamps[index] == stamp_ns:
            return True
        one, other = self._values[index - 1], self._values[index]
        turn = abs(wrap_angle(other.yaw - one.yaw))
        is_long = other.stamp_ns - one.stamp_ns > _TUNING.longest_ns
        return not (is_long and turn > _TUNING.longest_turn)

    def at(self, stamp_ns: int) -> Odometry:
        """Dead reckoning at a time, interpolated; extrapolated by at most `max_ahead_ns`.

        Raises:
            PoseError: There is none near that time.
        """
        stamps, values = self._stamps, self._values
        if not stamps:
            raise PoseError("no odometry has arrived")
        ahead_ns = _TUNING.max_ahead_ns
        if not stamps[0] <= stamp_ns <= stamps[-1] + ahead_ns:
            away = max(stamps[0] - stamp_ns, stamp_ns - stamps[-1]) / 1e9
            raise PoseError(
                f"the nearest odometry is {away:.3f} s away; allowed: {ahead_ns / 1e9:g} s "
                "past the newest"
            )
        index = bisect.bisect_left(stamps, stamp_ns)
        if index < len(stamps) and stamps[index] == stamp_ns:
            return values[index]
        if len(stamps) == 1:
            return values[0]
        index = min(index, len(stamps) - 1)
        return _between(values[index - 1], values[index], stamp_ns)


def _between(one: Odometry, other: Odometry, stamp_ns: int) -> Odometry:
    """Linear in time between two, or past the second."""
    part = (stamp_ns - one.stamp_ns) / (other.stamp_ns - one.stamp_ns)
    rest = 1.0 - part
    return Odometry(
        stamp_ns,
        rest * one.x + part * other.x,
        rest * one.y + part * other.y,
        one.yaw + part * wrap_angle(other.yaw - one.yaw),
        rest * one.position_variance + part * other.position_variance,
        rest * one.heading_variance + part * other.heading_variance,
    )

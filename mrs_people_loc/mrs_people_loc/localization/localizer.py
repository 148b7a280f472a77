"""A robot's estimate of where it and its team are."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.config import Localization
from mrs_people_loc.errors import PoseError
from mrs_people_loc.geometry import wrap_angle
from mrs_people_loc.localization.filter.observations import (
    Claimed,
    Joined,
    Left,
    Met,
    PeopleStand,
    Placed,
    Reached,
    WallsSeen,
    pose_from,
)
from mrs_people_loc.localization.filter.team_filter import History, TeamFilter
from mrs_people_loc.localization.filter.team_state import Misfit, Source, TeamState, Trust
from mrs_people_loc.localization.filter.wall_landmarks import WallLandmarks
from mrs_people_loc.localization.mailbox import Inbox, Measured, Outbox, RecentSet
from mrs_people_loc.localization.odometry import DeadReckoning, Odometry, OdometryTrack, Wheels
from mrs_people_loc.localization.shared import StandingPeople, TeamMeasurement, TeamPose
from mrs_people_loc.localization.walls import NOBODY, SeenWalls, Walls, moved
from mrs_people_loc.team.poses import Pose


@dataclass(frozen=True)
class LocalizerTuning:
    """Constants of the localizer, chosen by hand.

    Attributes:
        tick_ns: A robot's pose is carried on at least so often [ns].
        claim_ns: What a team-mate's filter says about its pose is compared so often [ns].
        max_clock_ns: A team-mate whose stamps differ by more from the own odometry's is not heard
            [ns] ...
        clock_named_ns: ... and is named for so long after it was heard [ns].
        silent_ns: A team-mate that was not heard of for so long is silent [ns] ...
        left_ns: ... and after this time it has left [ns].
        sigmas: Bounds of standard deviations of poses that come [m], [rad].
        misfits: A known wall is named after it was seen elsewhere so often.
        mate_sigmas: Where a team-mate may be is within so many standard deviations ...
        mate_speed: ... and what it drives since it was heard [m/s] ...
        mate_off: ... and this, at most [m].
    """

    tick_ns: int = 1_000_000_000
    claim_ns: int = 250_000_000
    max_clock_ns: int = 1_000_000_000
    clock_named_ns: int = 10_000_000_000
    silent_ns: int = 2_000_000_000
    left_ns: int = 120_000_000_000
    sigmas: tuple[float, float] = (1e-4, 100.0)
    misfits: int = 5
    mate_sigmas: float = 3.0
    mate_speed: float = 0.6
    mate_off: float = 0.5


_TUNING = LocalizerTuning()


@dataclass(frozen=True)
class LocalizationState:
    """What a robot knows about where its team is, for people and diagnostics.

    Attributes:
        stamp_ns: Of the robot's newest odometry [ns].
        poses: Of the robots in the map, each at its newest odometry.
        sources: How observations fit, by robot and kind: `walls`, `known walls`, `corners`,
            `absolute`, `relative` and `sighting` (both robots), `standing people`, `claim` (what
            team-mates say about themselves).
        trust: By robot: whether it was carried away, whether its claims fit, how noisy its odometry
            is.
        wheels: Systematic errors of the robot's wheels (`Wheels`), with those that its odometry is
            corrected by, shape (3,) ...
        wheel_sigmas: ... and their standard deviations, shape (3,).
        way: What it has driven so far [m].
        doubted: Team-mates that say or see what does not fit, and by how much [m].
        misfits: Known walls that are not where the map says, by index.
        walls: Walls of the state in the map, with their covariances.
        known: Index of each among the known walls; -1: it is none.
        clocks: By team-mate whose clock is too far off: by how much [s].
        late: Observations that came too late, or for whose time there is no odometry, so far.
        resets: How often the clock jumped back, so far.
        jumps: How often the odometry jumped, so far.
        hung_ns: When it hung last: it said the same after a step at speed [ns]; 0: never.
    """

    stamp_ns: int
    poses: Mapping[str, Pose]
    sources: Mapping[tuple[str, str], Source]
    trust: Mapping[str, Trust]
    wheels: Wheels
    wheel_sigmas: Float
    way: float
    doubted: Mapping[str, float]
    misfits: Mapping[int, Misfit]
    walls: Walls
    known: tuple[int, ...]
    clocks: Mapping[str, float]
    late: int
    resets: int
    jumps: int
    hung_ns: int = 0


class _Placed(NamedTuple):
    """A pose of the robot, and what it was made from.

    Attributes:
        odometry: Its dead reckoning.
        state: Of the team.
        heard: The team-mates that were heard.
        in_team: `TeamState.in_team` of these; None: none was heard.
        pose: The pose.
    """

    odometry: Odometry
    state: TeamState
    heard: list[str]
    in_team: Float | None
    pose: Pose


@dataclass
class _Mate:
    """What came from a team-mate."""

    track: OdometryTrack = field(default_factory=OdometryTrack)
    clock_ns: int = 0
    at_ns: int = 0
    seen: RecentSet = field(default_factory=RecentSet)


class Localizer:
    """Estimates the poses of a robot and its team from what it and they measure.

    Args:
        robot: The robot's name.
        config: Start, noise of the odometry, gate.
        known: Known walls, in the map.
    """

    def __init__(self, robot: str, config: Localization, known: Walls | None = None) -> None:
        self.robot = robot
        self.config = config
        self._filter = TeamFilter(robot, config, known)
        self._inbox = Inbox(robot, self._track_of)
        self._resets = self._late = 0
        self._reckoning = DeadReckoning(config)
        self._begin()

    def _begin(self) -> None:
        self._history = History(self._filter)
        self._track = OdometryTrack()
        self._mates: dict[str, _Mate] = {}
        self._inbox.clear()
        self._outbox = Outbox()
        self._placed: _Placed | None = None

    def reset(self) -> None:
        """Forgets everything; the next odometry is the start."""
        self._reckoning = DeadReckoning(self.config)
        self._begin()

    def configure(self, config: Localization) -> None:
        """Takes another noise of the odometry, from the next one on.

        The start, the gate and the wheels stay: what is estimated is in addition to these.
        """
        config = dataclasses.replace(
            config, wheels=self.config.wheels, wheel_sigmas=self.config.wheel_sigmas
        )
        self.config = self._reckoning.config = config

    def take_known(self, walls: Walls) -> None:
        """Takes known walls, in the map.

        Args:
            walls: All of them: those known before with their indices, and further ones.
        """
        self._filter.walls = WallLandmarks(walls, self._filter.gates)

    @property
    def way(self) -> float:
        """What the robot has driven so far [m]."""
        return self._reckoning.way

    @property
    def has_begun(self) -> bool:
        """Whether there was odometry; what comes before is not used."""
        return self._track.newest is not None

    # ------------------------------------------------------------------------------- what comes in

    def take_odometry(self, pose: Pose) -> Pose:
        """Takes the robot's pose in the frame of its odometry.

        Where `localization.start` is empty, the first one is where the robot starts in the map.

        Returns:
            base_link in the map.

        Raises:
            PoseError: The stamp is not newer than the last one.
        """
        before = self._track.newest
        odometry = self._reckoning.take(pose)
        if before is not None and odometry.stamp_ns < before.stamp_ns:
            self._resets += 1
            self._begin()
            before = None
        self._track.add(odometry)
        if before is None:
            self._start(odometry)
        else:
            self._tick(self.robot, self._track, before.stamp_ns)
        self._add_due()
        return self._own_pose(odometry, self._history.newest)

    def _start(self, odometry: Odometry) -> None:
        start = self.config.start or (odometry.x, odometry.y, odometry.yaw)
        sigmas = np.maximum(self.config.start_sigmas, _TUNING.sigmas[0])
        covariance = np.diag(np.square(sigmas))
        self._history.add(Joined(self.robot, odometry, np.array(start), covariance))

    def take_walls(self, seen: SeenWalls) -> None:
        """Takes walls that the robot sees, once there is odometry for their stamp."""
        self._take(seen)

    def take_absolute(self, pose: Pose) -> None:
        """Takes a measured pose of base_link in the map, likewise.

        Raises:
            PoseError: Its covariance has no full rank.
        """
        _check_rank(pose.covariance)
        self._take(pose)

    def take_relative(self, relative: TeamMeasurement) -> None:
        """Takes what the planner measured of robots, likewise of these.

        Raises:
            PoseError: It is of a robot to itself, or its covariance has no full rank.
        """
        if isinstance(relative, StandingPeople):
            self._take(relative)
            return
        if relative.robot == relative.other:
            raise PoseError(f"relative pose is of {relative.robot} to itself; wanted: two robots")
        if not np.isfinite(relative.pose).all():
            raise PoseError(f"relative pose is {relative.pose.tolist()}; wanted: finite")
        _check_rank(relative.covariance)
        self._take(relative)

    def _take(self, seen: Measured) -> None:
        if self.has_begun:
            self._inbox.add(seen)
            self._add_due()

    def take_teammate(self, told: TeamPose) -> None:
        """Takes what a team-mate tells; what it told before is recognized."""
        newest = self._track.newest
        if told.robot == self.robot or newest is None:
            return
        mate = self._mates.setdefault(told.robot, _Mate())
        mate.at_ns = newest.stamp_ns
        mate.clock_ns = told.odometry.stamp_ns - newest.stamp_ns
        if abs(mate.clock_ns) > _TUNING.max_clock_ns:
            return
        self._take_mates_odometry(told, mate)
        measured: list[SeenWalls | Pose] = [*told.walls, *told.absolute]
        for seen in measured:
            key = type(seen), seen.stamp_ns
            if key not in mate.seen and mate.track.tells(seen.stamp_ns):
                mate.seen.add(key)
                self._add(told.robot, mate.track, seen)

    def _take_mates_odometry(self, told: TeamPose, mate: _Mate) -> None:
        newest = mate.track.newest
        if newest is None:
            self._join(told, mate)
            return
        odometry = told.odometry
        if odometry.stamp_ns <= newest.stamp_ns:
            mate.track.add(odometry)
            return
        if (
            odometry.position_variance < newest.position_variance - 1e-12
            or odometry.heading_variance < newest.heading_variance - 1e-12
        ):
            self._join(told, mate)
            return
        mate.track.add(odometry)
        self._tick(told.robot, mate.track, newest.stamp_ns)
        if odometry.stamp_ns // _TUNING.claim_ns > newest.stamp_ns // _TUNING.claim_ns:
            place, covariance = _arrays(told.pose)
            self._history.add(Claimed(told.robot, odometry, place, covariance))

    def _join(self, told: TeamPose, mate: _Mate) -> None:
        """A team-mate begins, or begins again."""
        mate.track = OdometryTrack()
        mate.track.add(told.odometry)
        place, covariance = _arrays(told.pose)
        self._history.add(Joined(told.robot, told.odometry, place, covariance))

    # ------------------------------------------------------------------------------- what goes out

    def pose_at(self, stamp_ns: int) -> Pose:
        """base_link in the map at a time.

        Raises:
            PoseError: There is no odometry near that time.
        """
        return self._own_pose(self._track.at(stamp_ns), self._history.until(stamp_ns))

    def odometry_at(self, stamp_ns: int) -> Odometry:
        """The robot's dead reckoning at a time.

        Raises:
            PoseError: There is none near that time.
        """
        return self._track.at(stamp_ns)

    def mates_at(self, stamp_ns: int) -> Float:
        """Where team-mates that are heard are (`walls.NOBODY`) at a time [ns], shape (n, 3).

        None are where there is no odometry near that time.
        """
        state, found = self._history.newest, []
        try:
            own = state.pose_of(self.robot, self._track.at(stamp_ns)).place
        except PoseError:
            return NOBODY
        i = state.at(self.robot)
        for mate in state.odometry:
            if not self._is_heard(mate, _TUNING.silent_ns):
                continue
            last, j = self._mates[mate].track.newest, state.at(mate)
            assert last is not None
            place = state.pose_of(mate, last).place
            (x, y, _), by_own, by_mate = pose_from(own, place)
            columns = [*range(i, i + 3), *range(j, j + 3)]
            jacobian = np.hstack([by_own, by_mate])[:2]
            relative = jacobian @ state.covariance[np.ix_(columns, columns)] @ jacobian.T
            off = _TUNING.mate_sigmas * math.sqrt(np.linalg.eigvalsh(relative)[1])
            off += _TUNING.mate_speed * abs(stamp_ns - last.stamp_ns) / 1e9
            found.append((x, y, min(off, _TUNING.mate_off)))
        return np.array(found).reshape(-1, 3)

    def share(self) -> TeamPose:
        """What the team is to hear now.

        Raises:
            PoseError: There is no odometry yet.
        """
        newest = self._track.newest
        if newest is None:
            raise PoseError("no odometry has arrived")
        state = self._history.newest
        told = self._outbox.message(self.robot, self._own_pose(newest, state), newest)
        own, doubted = state.trust.get(self.robot), self._doubted(state)
        lost = (own is not None and own.lost) or self._is_adrift(state)
        return dataclasses.replace(told, lost=lost, doubted=tuple(sorted(doubted)))

    def _is_adrift(self, state: TeamState) -> bool:
        """Whether the odometry hangs, or did since it was known where the robot is to others."""
        reckoning, sources = self._reckoning, state.sources
        fits = (sources.get((self.robot, kind), Source()) for kind in ("relative", "absolute"))
        told_ns = max(fit.stamp_ns for fit in fits)
        return reckoning.hangs or (0 < told_ns <= reckoning.hung_ns)

    @property
    def state(self) -> LocalizationState:
        """What it knows now."""
        state, newest = self._history.newest, self._track.newest
        newest_ns = 0 if newest is None else newest.stamp_ns
        poses = {}
        for robot in state.odometry:
            last = self._track_of(robot).newest
            if last is not None:
                poses[robot] = _pose(last, state, robot)
        wheels, wheel_sigmas = self._wheels(state)
        return LocalizationState(
            stamp_ns=newest_ns,
            poses=poses,
            sources=state.sources,
            trust=state.trust,
            wheels=wheels,
            wheel_sigmas=wheel_sigmas,
            way=self.way,
            doubted=self._doubted(state),
            misfits={k: m for k, m in state.misfits.items() if m.count >= _TUNING.misfits},
            walls=_walls_of(state),
            known=tuple(wall.known for wall in state.walls),
            clocks={
                name: mate.clock_ns / 1e9
                for name, mate in self._mates.items()
                if abs(mate.clock_ns) > _TUNING.max_clock_ns
                and self._is_heard(name, _TUNING.clock_named_ns)
            },
            late=self._late + self._inbox.late,
            resets=self._resets,
            jumps=self._reckoning.jumps,
            hung_ns=self._reckoning.hung_ns,
        )

    def _wheels(self, state: TeamState) -> tuple[Wheels, Float]:
        """Systematic errors of the robot's wheels, to first order, and standard deviations."""
        wheels, sigmas = np.array(self.config.wheels), np.array(self.config.wheel_sigmas)
        if self.robot not in state.odometry:
            return wheels, sigmas
        i = state.wheels_at(self.robot) + np.arange(3)
        return wheels + state.mean[i], np.sqrt(state.covariance[i, i])

    def _doubted(self, state: TeamState) -> dict[str, float]:
        disputed = self._filter.tuning.lost_after
        return {
            robot: trust.off
            for robot, trust in state.trust.items()
            if robot != self.robot
            and (trust.lost or self._filter.is_refused(trust) or trust.disputed >= disputed)
        }

    # -------------------------------------------------------------------------------------- inside

    def _add_due(self) -> None:
        """Adds the measurements that there is odometry for by now."""
        for seen in self._inbox.due():
            if isinstance(seen, SeenWalls | Pose):
                newest = self._track.newest
                assert newest is not None
                self._outbox.add(seen, newest.stamp_ns)
            self._late += not self._add(self.robot, self._track, seen)

    def _add(self, robot: str, track: OdometryTrack, seen: Measured) -> bool:
        """Adds a measurement of a robot to the history; False: it is too old, or there already."""
        if isinstance(seen, SeenWalls):
            return self._history.add(WallsSeen(robot, track.at(seen.stamp_ns), _usable(seen.walls)))
        if isinstance(seen, Pose):
            place, covariance = _arrays(seen)
            return self._history.add(Placed(robot, track.at(seen.stamp_ns), place, covariance))
        if isinstance(seen, StandingPeople):
            odometry = self._track_of(seen.robot).at(seen.stamp_ns)
            return self._history.add(
                PeopleStand(seen.robot, odometry, seen.xy, seen.covariance, seen.inflated)
            )
        return self._history.add(
            Met(
                seen.robot,
                self._track_of(seen.robot).at(seen.stamp_ns),
                seen.other,
                self._track_of(seen.other).at(seen.other_stamp_ns),
                np.asarray(seen.pose, dtype=np.float64),
                seen.covariance,
                seen.inflated,
            )
        )

    def _tick(self, robot: str, track: OdometryTrack, before_ns: int) -> None:
        """Carries a robot's pose on once a second; robots that are silent for long leave."""
        newest = track.newest
        assert newest is not None
        tick_ns = newest.stamp_ns // _TUNING.tick_ns * _TUNING.tick_ns
        if before_ns >= tick_ns or not track.covers(tick_ns):
            return
        self._history.add(Reached(robot, track.at(tick_ns)))
        if robot == self.robot:
            for name, mate in list(self._mates.items()):
                if self._is_heard(name, _TUNING.left_ns):
                    continue
                last = mate.track.newest
                if last is not None:
                    self._history.add(Left(name, dataclasses.replace(last, stamp_ns=tick_ns)))
                del self._mates[name]

    def _track_of(self, robot: str) -> OdometryTrack:
        if robot == self.robot:
            return self._track
        mate = self._mates.get(robot)
        return OdometryTrack() if mate is None else mate.track

    def _own_pose(self, odometry: Odometry, state: TeamState) -> Pose:
        """base_link in the map, also relative to the team-mates that are heard, if any is."""
        heard = [name for name in state.odometry if self._is_heard(name, _TUNING.silent_ns)]
        last = self._placed
        if last is not None and last.state is state and last.heard == heard:
            if last.odometry is odometry:
                return last.pose
            in_team = last.in_team
        else:
            in_team = state.in_team(self.robot, heard) if heard else None
        pose = _pose(odometry, state, self.robot, in_team)
        self._placed = _Placed(odometry, state, heard, in_team, pose)
        return pose

    def _is_heard(self, robot: str, within_ns: int) -> bool:
        """Whether a team-mate was heard while the own odometry went on by no more than this."""
        mate, newest = self._mates.get(robot), self._track.newest
        return mate is not None and newest is not None and newest.stamp_ns - mate.at_ns < within_ns


def _pose(odometry: Odometry, state: TeamState, robot: str, in_team: Float | None = None) -> Pose:
    """A robot's pose; `in_team`: `TeamState.in_team`, at the time of the state."""
    made = state.pose_of(robot, odometry)
    if in_team is not None:
        in_team = made.carried_on(in_team)
    x, y, yaw = made.place.tolist()
    return Pose(odometry.stamp_ns, x, y, wrap_angle(yaw), made.covariance, in_team)


def _arrays(pose: Pose) -> tuple[Float, Float]:
    """A pose and its covariance, that one positive definite."""
    covariance = 0.5 * (pose.covariance + pose.covariance.T)
    values, vectors = np.linalg.eigh(covariance)
    least, largest = _TUNING.sigmas
    values = np.clip(values, least**2, largest**2)
    return np.array([pose.x, pose.y, pose.yaw]), (vectors * values) @ vectors.T


def _usable(walls: Walls) -> Walls:
    """Those walls whose values are finite and whose covariances are positive definite."""
    lines = np.stack([walls.distance, walls.bearing], axis=1)
    (xx, xy), (yx, yy) = np.moveaxis(walls.covariance, 0, 2)
    finite = np.isfinite(lines).all(axis=1) & np.isfinite(walls.extent).all(axis=1)
    with np.errstate(invalid="ignore"):
        return walls.select(finite & (xx > 0) & (xx * yy - xy * yx > 0))


def _check_rank(covariance: Float) -> None:
    if not np.isfinite(covariance).all() or np.linalg.eigvalsh(covariance)[0] <= 0:
        raise PoseError(
            f"covariance of x, y, yaw is {covariance.tolist()}; wanted: positive definite"
        )


def _walls_of(state: TeamState) -> Walls:
    """The walls of a state in the map's normal form."""
    count, begin = len(state.walls), state.wall_at(0)
    lines = state.mean[begin:].reshape(-1, 2)
    blocks = state.covariance[begin:, begin:].reshape(count, 2, count, 2)
    anchors = np.array([wall.anchor for wall in state.walls]).reshape(-1, 2)
    beside_anchors = Walls(
        distance=lines[:, 0],
        bearing=lines[:, 1],
        covariance=blocks[range(count), :, range(count)],
        extent=np.array([wall.extent for wall in state.walls]).reshape(-1, 2),
        is_end=np.zeros((count, 2), dtype=bool),
    )
    return moved(beside_anchors, anchors[:, 0], anchors[:, 1], 0.0)

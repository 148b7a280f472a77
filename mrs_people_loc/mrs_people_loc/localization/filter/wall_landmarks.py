"""Walls as landmarks: which wall of the state, or of the map, a robot sees."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.geometry import squared_mahalanobis, wrap_angle
from mrs_people_loc.localization.filter.kalman import Residual, corrected, noted, wrapped
from mrs_people_loc.localization.filter.observations import (
    Point,
    WallsSeen,
    beside_anchor,
    end_from,
    wall_at,
    wall_from,
)
from mrs_people_loc.localization.filter.team_state import Landmark, Misfit, TeamState, changed
from mrs_people_loc.localization.walls import Walls


@dataclass(frozen=True)
class WallTuning:
    """Constants, chosen by hand.

    Attributes:
        max_walls: So many are kept; the one unseen for longest is dropped.
        max_gap: Parts of one line with a larger gap between are two walls [m].
        max_offset: A wall seen farther off than this, and than three sigmas, is another one [m].
        max_turn: Likewise its direction [rad].
        max_behind: A robot that is believed to be farther behind a face does not see it [m].
        same_offset: Two walls that are closer than this and ...
        same_turn: ... this are told apart by nothing; neither is one made so close to another.
        apart: Of several walls that fit, one is taken if its squared Mahalanobis length is less by
            this.
        sure_offset: A wall that is not known is not recognized where its place, relative to the
            robot, is less sure than this [m]: parallel ones may be as near.
        established: A wall is established for a robot that recognized it so often.
        lately_s: What a robot saw within this time it must see again [s].
        others_lately_s: What others saw within this time, likewise [s].
        doubtful_s: Walls that were not established are dropped after this time [s].
        new_sigmas: Walls that are measured worse than this are not added [m, rad].
        end_sigma: Standard deviation of the place of a wall's end [m], and ...
        end_turn: ... of the direction in which it is seen, about a pixel [rad].
        direction_lasts: The error of a wall's direction relative to a robot is the same in so many
            sights.
        misfits: A known wall that was seen elsewhere so often, and never recognized, is no longer
            looked for ...
        forgiven: ... until a wall was seen where the map says so often in a row.
        near: Known walls farther than this are not looked for [m].
    """

    max_walls: int = 12
    max_gap: float = 2.0
    max_offset: float = 1.5
    max_turn: float = 1.2
    max_behind: float = 0.5
    same_offset: float = 0.15
    same_turn: float = 0.1
    apart: float = 9.0
    sure_offset: float = 2.2
    established: int = 5
    lately_s: float = 5.0
    others_lately_s: float = 30.0
    doubtful_s: float = 3.0
    new_sigmas: tuple[float, float] = (0.2, 0.2)
    end_sigma: float = 0.1
    end_turn: float = 0.01
    direction_lasts: float = 50.0
    misfits: int = 10
    forgiven: int = 50
    near: float = 10.0


_TUNING = WallTuning()


@dataclass(frozen=True)
class Verdict:
    """How the walls of one sight fitted.

    Attributes:
        fitted: Number that were recognized.
        refused: Number that contradict established walls.
        missed_ns: When the robot recognized one of these last [ns]; 0: never.
        shared: Whether a recognized one is known, or was seen by another robot.
        off: How far one is from where only one other robot has seen it [m]; None: none is.
    """

    fitted: int = 0
    refused: int = 0
    missed_ns: int = 0
    shared: bool = False
    off: float | None = None


@dataclass(frozen=True)
class _Seen:
    """One wall as a robot sees it now."""

    robot: str
    stamp_ns: int
    line: Float
    covariance: Float
    extent: Point
    is_end: tuple[bool, bool]


@dataclass(frozen=True)
class _Candidate:
    """A wall that may be the one that is seen.

    Attributes:
        index: In the state; of a known wall that is not in the state, its index there.
        in_state: Which of the two.
        side: See `wall_from`.
        offset: By how much it is seen farther away than predicted [m].
        turn: By how much its bearing is seen greater than predicted [rad].
        extent: The part that is seen now, along it from its anchor [m].
        squared: Squared Mahalanobis length of the two.
        sigma: Standard deviation of `offset` [m].
    """

    index: int
    in_state: bool
    side: float
    offset: float
    turn: float
    extent: Point
    squared: float = math.inf
    sigma: float = 0.0


class WallLandmarks:
    """Recognizes walls, corrects the state by them, and adds new ones.

    Args:
        known: Known walls in the map.
        gates: Largest squared Mahalanobis length by degrees of freedom.
        tuning: Constants.
    """

    def __init__(
        self, known: Walls | None, gates: Mapping[int, float], tuning: WallTuning = _TUNING
    ) -> None:
        self.gates = gates
        self.tuning = tuning
        self.known = _KnownWalls(known)

    def take(self, state: TeamState, seen: WallsSeen) -> tuple[TeamState, Verdict]:
        """The state after a sight, and how it fitted."""
        verdict, walls = Verdict(), seen.walls
        for k in range(len(walls)):
            one = _Seen(
                seen.robot,
                seen.odometry.stamp_ns,
                np.array([walls.distance[k], walls.bearing[k]]),
                walls.covariance[k],
                (float(walls.extent[k, 0]), float(walls.extent[k, 1])),
                (bool(walls.is_end[k, 0]), bool(walls.is_end[k, 1])),
            )
            state, verdict = self._take_one(state, one, verdict)
        return state, verdict

    def _take_one(
        self, state: TeamState, seen: _Seen, verdict: Verdict
    ) -> tuple[TeamState, Verdict]:
        state = self._forgiven(state, seen)
        candidates = self._candidates(state, seen)
        fits = sorted(
            (c for c in candidates if c.squared <= self.gates[2]), key=lambda c: c.squared
        )
        if fits and self._is_clear(fits) and self._is_sure(state, fits[0]):
            return self._take_fit(state, seen, fits[0], candidates, verdict)
        if fits:
            return state, verdict
        against = [c for c in candidates if c.in_state]
        strong = [c for c in against if self._contradicts(state, seen, c)]
        close = [c for c in against if self._is_close(c)]
        for candidate in (strong + close)[:1]:
            wall = state.walls[candidate.index]
            found = Residual(candidate.squared, 2)
            state = noted(state, seen.robot, _kind(wall), False, found, seen.stamp_ns)
            if not strong:
                return state, verdict
            missed_ns = wall.sights[seen.robot].stamp_ns if seen.robot in wall.sights else 0
            missed_ns = max(verdict.missed_ns, missed_ns)
            return state, changed(verdict, refused=verdict.refused + 1, missed_ns=missed_ns)
        verdict = self._disputed(state, seen, against, verdict)
        return self._added(self._misfitted(state, seen, candidates), seen), verdict

    def _take_fit(
        self,
        state: TeamState,
        seen: _Seen,
        fit: _Candidate,
        candidates: list[_Candidate],
        verdict: Verdict,
    ) -> tuple[TeamState, Verdict]:
        """Takes a wall that is recognized."""
        if fit.in_state and state.walls[fit.index].known < 0:
            state = self._misfitted(state, seen, candidates)
            if len(state.walls[fit.index].sights) == 1:
                against = [c for c in candidates if c.in_state and c is not fit]
                verdict = self._disputed(state, seen, against, verdict)
        state, wall = self._recognized(state, seen, fit)
        shared = verdict.shared or wall.known >= 0 or len(wall.sights) > 1
        return state, changed(verdict, fitted=verdict.fitted + 1, shared=shared)

    def _disputed(
        self, state: TeamState, seen: _Seen, against: list[_Candidate], verdict: Verdict
    ) -> Verdict:
        """The verdict with how far a wall is from where others see it."""
        for candidate in against:
            if candidate.squared > self.gates[2] and self._others(state, seen, candidate):
                verdict = changed(verdict, off=abs(candidate.offset))
        return verdict

    def _is_close(self, candidate: _Candidate) -> bool:
        """Whether a wall there would hardly differ from this one."""
        return (
            abs(candidate.offset) < self.tuning.same_offset
            and abs(candidate.turn) < self.tuning.same_turn
        )

    def _is_sure(self, state: TeamState, fit: _Candidate) -> bool:
        """Whether no other wall, of those that nobody has seen yet, would fit as well."""
        is_known = not fit.in_state or state.walls[fit.index].known >= 0
        return is_known or fit.sigma < self.tuning.sure_offset

    def _is_clear(self, fits: list[_Candidate]) -> bool:
        """Whether the best of several is the one, or as good as another."""
        best = fits[0]
        return all(
            other.squared - best.squared > self.tuning.apart
            or (
                abs(other.offset - best.offset) < self.tuning.same_offset
                and abs(other.turn - best.turn) < self.tuning.same_turn
            )
            for other in fits[1:]
        )

    def _candidates(self, state: TeamState, seen: _Seen) -> list[_Candidate]:
        """Walls that are roughly where one is seen."""
        place, sigmas = _place_of(state, seen.robot)
        lines = state.mean[state.wall_at(0) :].reshape(-1, 2).tolist()
        found = [
            self._candidate(k, True, wall, lines[k], place, seen, sigmas)
            for k, wall in enumerate(state.walls)
        ]
        there = {wall.known for wall in state.walls}
        for k in self.known.near((place[0], place[1]), self.tuning.near):
            if k not in there and not self._is_misfit(state, k):
                wall, line = self.known.landmarks[k], self.known.lines[k].tolist()
                found.append(self._candidate(k, False, wall, line, place, seen, sigmas))
        candidates = [candidate for candidate in found if candidate is not None]
        if not candidates:
            return []
        covariances = np.array([self._of_residual(state, seen, c) for c in candidates])
        off = np.array([(c.offset, c.turn) for c in candidates])
        squared = squared_mahalanobis(off, covariances).tolist()
        sigmas = np.sqrt(covariances[:, 0, 0]).tolist()
        return [
            changed(c, squared=one, sigma=sigma)
            for c, one, sigma in zip(candidates, squared, sigmas, strict=True)
        ]

    def _candidate(
        self,
        index: int,
        in_state: bool,
        wall: Landmark,
        line: list[float],
        place: list[float],
        seen: _Seen,
        sigmas: tuple[float, float],
    ) -> _Candidate | None:
        distance, bearing = line
        c, s = math.cos(bearing), math.sin(bearing)
        dx, dy = place[0] - wall.anchor[0], place[1] - wall.anchor[1]
        away, turn = distance - c * dx - s * dy, seen.line[1] + place[2] - bearing
        side = -1.0 if wall.known >= 0 and math.cos(turn) < 0 else 1.0
        turn = wrap_angle(turn if side > 0 else turn - math.pi)
        offset = float(seen.line[0]) - side * away
        if side * away < -self.tuning.max_behind:
            return None
        if abs(turn) > self.tuning.max_turn + sigmas[1]:
            return None
        if abs(offset) > self.tuning.max_offset + sigmas[0]:
            return None
        foot = c * dy - s * dx + side * float(seen.line[0]) * math.sin(turn)
        ends = [foot + side * math.cos(turn) * end for end in seen.extent]
        extent = min(ends), max(ends)
        gap = max(extent[0] - wall.extent[1], wall.extent[0] - extent[1])
        if gap > self.tuning.max_gap + sigmas[0]:
            return None
        return _Candidate(index, in_state, side, offset, turn, extent)

    def _of_residual(self, state: TeamState, seen: _Seen, candidate: _Candidate) -> Float:
        """Covariance of the difference between seen and predicted, shape (2, 2)."""
        i = state.at(seen.robot)
        robot = np.arange(i, i + 3)
        if candidate.in_state:
            columns = state.columns(seen.robot, candidate.index)
            part = state.mean[columns]
            covariance = state.covariance[columns[:, np.newaxis], columns]
            anchor = state.walls[candidate.index].anchor
        else:
            k = candidate.index
            part = np.concatenate([state.mean[robot], self.known.lines[k]])
            covariance = np.zeros((5, 5))
            covariance[:3, :3] = state.covariance[i : i + 3, i : i + 3]
            covariance[3:, 3:] = self._of_known(state, k)
            anchor = self.known.landmarks[k].anchor
        _, jacobian = wall_from(part, anchor, candidate.side)
        return np.asarray(jacobian @ covariance @ jacobian.T + seen.covariance)

    def _of_known(self, state: TeamState, index: int) -> Float:
        """Covariance of a known wall that is not in the state, shape (2, 2).

        Where more walls were elsewhere than are where the map says, others may be off as far.
        """
        covariance: Float = self.known.covariances[index]
        off = [abs(m.offset) for k, m in state.misfits.items() if self._is_misfit(state, k)]
        recognized = sum(wall.known >= 0 for wall in state.walls)
        if index in state.misfits or len(off) <= recognized:
            return covariance
        return np.asarray(covariance + np.diag([max(off) ** 2, 0.0]))

    def _recognized(
        self, state: TeamState, seen: _Seen, candidate: _Candidate
    ) -> tuple[TeamState, Landmark]:
        """The state corrected by a wall, and that wall."""
        index, side = candidate.index, candidate.side
        if not candidate.in_state:
            state = self._without_surplus(state, seen.stamp_ns)
            index, k = len(state.walls), candidate.index
            across = np.zeros((2, len(state.mean)))
            covariance = self._of_known(state, k)
            state = state.with_wall(
                self.known.landmarks[k], self.known.lines[k], across, covariance
            )
            misfits = {other: m for other, m in state.misfits.items() if other != k}
            state = changed(state, misfits=misfits)
        wall = state.walls[index]

        def model(part: Float) -> tuple[Float, Float]:
            predicted, jacobian = wall_from(part, wall.anchor, side)
            return wrapped(seen.line - predicted), jacobian

        columns = state.columns(seen.robot, index)
        noise = seen.covariance + self._of_direction(state, seen, index)
        state, found = corrected(state, columns, model, noise)
        state = noted(state, seen.robot, _kind(wall), True, found, seen.stamp_ns)
        if wall.known >= 0:
            state = self._ends(state, seen, index, side)
        landmark = wall.seen_by(seen.robot, candidate.extent, seen.stamp_ns)
        walls = (*state.walls[:index], landmark, *state.walls[index + 1 :])
        return changed(state, walls=walls), landmark

    def _of_direction(self, state: TeamState, seen: _Seen, index: int) -> Float:
        """What an unsure direction of a wall adds to the covariance of a sight, shape (2, 2).

        A wall tells nothing about the way along it. An EKF believes to learn that, too, when it
        takes distances to one wall with different directions; that of a known wall stays the same.
        The product of the two errors is the second-order term of the prediction (Bar-Shalom, Li &
        Kirubarajan 2001, "Estimation with Applications to Tracking and Navigation", section 10.3),
        and is taken for noise here, as much more of it as it is the same from sight to sight.
        """
        added, joint = np.zeros((2, 2)), state.covariance
        if state.walls[index].known >= 0:
            return added
        _, _, yaw, _, at = state.columns(seen.robot, index).tolist()
        variance = float(joint[yaw, yaw] + joint[at, at] - joint[yaw, at] - joint[at, yaw])
        bearing = float(state.mean[at])
        along = np.array([-math.sin(bearing), math.cos(bearing)])
        place = state.in_team(seen.robot, state.odometry)[:2, :2]
        added[0, 0] = self.tuning.direction_lasts * variance * float(along @ place @ along)
        return added

    def _ends(self, state: TeamState, seen: _Seen, index: int, side: float) -> TeamState:
        """The state corrected by the ends of a known wall."""
        wall, columns = state.walls[index], state.columns(seen.robot, index)
        for k in range(2):
            which = k if side > 0 else 1 - k
            if not (seen.is_end[k] and self.known.is_end[wall.known][which]):
                continue
            end, at = self.known.landmarks[wall.known].extent[which], seen.extent[k]
            # The farther along the wall, the flatter it is seen.
            away = max(float(seen.line[0]), self.tuning.end_sigma)
            turned = self.tuning.end_turn * (away**2 + at**2) / away
            noise = np.array([[self.tuning.end_sigma**2 + turned**2]])

            def model(part: Float, end: float = end, at: float = at) -> tuple[Float, Float]:
                predicted, jacobian = end_from(part, wall.anchor, end, side)
                return at - predicted, jacobian

            made, found = corrected(state, columns, model, noise)
            accepted = found.squared <= self.gates[1]
            state = made if accepted else state
            state = noted(state, seen.robot, "corners", accepted, found, seen.stamp_ns)
        return state

    def _contradicts(self, state: TeamState, seen: _Seen, candidate: _Candidate) -> bool:
        """Whether a wall was there a moment ago, for this robot or for two others or the map."""
        wall = state.walls[candidate.index]
        own = wall.sights.get(seen.robot)
        if (
            own is not None
            and own.count >= self.tuning.established
            and seen.stamp_ns - own.stamp_ns < 1e9 * self.tuning.lately_s
            and _overlap(own.extent, candidate.extent)
        ):
            return True
        others = self._others(state, seen, candidate)
        return others >= 2 or (others >= 1 and wall.known >= 0)

    def _others(self, state: TeamState, seen: _Seen, candidate: _Candidate) -> int:
        """How many other robots saw a wall in the part that is seen now."""
        return sum(
            robot != seen.robot
            and sight.count >= self.tuning.established
            and seen.stamp_ns - sight.stamp_ns < 1e9 * self.tuning.others_lately_s
            and _overlap(sight.extent, candidate.extent)
            for robot, sight in state.walls[candidate.index].sights.items()
        )

    def _is_misfit(self, state: TeamState, index: int) -> bool:
        """Whether a known wall is no longer looked for."""
        misfit = state.misfits.get(index)
        return misfit is not None and misfit.count >= self.tuning.misfits

    def _forgiven(self, state: TeamState, seen: _Seen) -> TeamState:
        """Counts misfits where a wall is seen where the map says; enough make them known again."""
        if not state.misfits:
            return state
        misfits = dict(state.misfits)
        place, sigmas = _place_of(state, seen.robot)
        for k, misfit in state.misfits.items():
            if not self._is_misfit(state, k):
                continue
            wall, line = self.known.landmarks[k], self.known.lines[k].tolist()
            candidate = self._candidate(k, False, wall, line, place, seen, sigmas)
            if candidate is None or not _overlap(candidate.extent, wall.extent):
                continue
            if self._is_close(candidate):
                misfits[k] = changed(misfit, agreed=misfit.agreed + 1)
            elif abs(candidate.turn) < self.tuning.same_turn:
                misfits[k] = changed(misfit, agreed=0)
            if misfits[k].agreed >= self.tuning.forgiven:
                del misfits[k]
        return changed(state, misfits=misfits)

    def _misfitted(self, state: TeamState, seen: _Seen, candidates: list[_Candidate]) -> TeamState:
        """Counts known walls that are not seen where an unknown one is."""
        misfits = dict(state.misfits)
        for candidate in candidates:
            near = abs(candidate.offset) < self.tuning.max_offset
            if candidate.in_state or not near or abs(candidate.turn) > self.tuning.same_turn:
                continue
            before = misfits.get(candidate.index, Misfit(0, 0.0))
            count = before.count + 1
            mean = before.offset + (candidate.offset - before.offset) / count
            misfits[candidate.index] = Misfit(count, mean)
            found = Residual(candidate.squared, 2)
            state = noted(state, seen.robot, "known walls", False, found, seen.stamp_ns)
        return changed(state, misfits=misfits)

    def _added(self, state: TeamState, seen: _Seen) -> TeamState:
        """The state with the wall that is seen as a new one."""
        sigmas = np.sqrt(np.diagonal(seen.covariance))
        if (sigmas > self.tuning.new_sigmas).any():
            return state
        state = self._without_surplus(state, seen.stamp_ns)
        i = state.at(seen.robot)
        place = state.mean[i : i + 3]
        x, y, yaw = place.tolist()
        distance, bearing = seen.line.tolist()
        wall = _landmark(distance, yaw + bearing, seen.extent, origin=(x, y))
        line, by_pose, by_seen = wall_at(place, seen.line, wall.anchor)
        across = by_pose @ state.covariance[i : i + 3]
        covariance = (
            by_pose @ state.covariance[i : i + 3, i : i + 3] @ by_pose.T
            + by_seen @ seen.covariance @ by_seen.T
        )
        wall = wall.seen_by(seen.robot, wall.extent, seen.stamp_ns)
        return state.with_wall(wall, line, across, covariance)

    def _without_surplus(self, state: TeamState, stamp_ns: int) -> TeamState:
        """The state with room for one more wall."""
        for k in reversed(range(len(state.walls))):
            wall = state.walls[k]
            sights = sum(sight.count for sight in wall.sights.values())
            unseen_s = (stamp_ns - wall.seen_ns) / 1e9
            if sights < self.tuning.established and unseen_s > self.tuning.doubtful_s:
                state = state.without_wall(k)
        while len(state.walls) >= self.tuning.max_walls:
            oldest = min(range(len(state.walls)), key=lambda k: state.walls[k].seen_ns)
            state = state.without_wall(oldest)
        return state


class _KnownWalls:
    """Known walls beside anchors in the middle of each."""

    def __init__(self, walls: Walls | None) -> None:
        count = 0 if walls is None else len(walls)
        self.landmarks: list[Landmark] = []
        self.lines = np.zeros((count, 2))
        self.covariances = np.zeros((count, 2, 2))
        self.is_end = [(False, False)] * count
        self._middles, self._halves = np.zeros((count, 2)), np.zeros(count)
        if walls is None:
            return
        self.is_end = [(bool(ends[0]), bool(ends[1])) for ends in walls.is_end]
        for k in range(count):
            distance, bearing = float(walls.distance[k]), float(walls.bearing[k])
            begin, end = walls.extent[k].tolist()
            wall = _landmark(distance, bearing, (begin, end), known=k)
            self.lines[k], jacobian = beside_anchor(distance, bearing, wall.anchor)
            self.covariances[k] = jacobian @ walls.covariance[k] @ jacobian.T
            self.landmarks.append(wall)
            self._middles[k], self._halves[k] = wall.anchor, wall.extent[1]

    def near(self, place: Point, distance: float) -> list[int]:
        """Those that may be within a distance of a place [m]."""
        if not self.landmarks:
            return []
        away = np.hypot(self._middles[:, 0] - place[0], self._middles[:, 1] - place[1])
        return [int(k) for k in np.flatnonzero(away < self._halves + distance)]


def _place_of(state: TeamState, robot: str) -> tuple[list[float], tuple[float, float]]:
    """A robot's pose, and three sigmas of its place [m] and heading [rad]."""
    i = state.at(robot)
    variances = np.diagonal(state.covariance)[i : i + 3].tolist()
    sigmas = 3.0 * math.sqrt(variances[0] + variances[1]), 3.0 * math.sqrt(variances[2])
    return state.mean[i : i + 3].tolist(), sigmas


def _landmark(
    distance: float,
    bearing: float,
    extent: Point,
    *,
    origin: Point = (0.0, 0.0),
    known: int = -1,
) -> Landmark:
    """A wall whose anchor is in the middle of its extent, in normal form beside an origin [m]."""
    c, s = math.cos(bearing), math.sin(bearing)
    middle, half = 0.5 * (extent[0] + extent[1]), 0.5 * (extent[1] - extent[0])
    anchor = origin[0] + distance * c - middle * s, origin[1] + distance * s + middle * c
    return Landmark(anchor, (-half, half), known)


def _kind(wall: Landmark) -> str:
    return "walls" if wall.known < 0 else "known walls"


def _overlap(one: Point, other: Point) -> bool:
    """Whether two parts of a line share half of the shorter one."""
    shared = min(one[1], other[1]) - max(one[0], other[0])
    return shared > 0.5 * min(one[1] - one[0], other[1] - other[0])

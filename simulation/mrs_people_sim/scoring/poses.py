"""Scoring poses of robots against the true ones.

The rules, in one place:

- Poses of a robot are compared at their own stamps, no more often than every `STEP_NS`; the true
  pose is interpolated there. Gaps of more than `GAP_NS` are not bridged.
- **Relative**: where a team-mate is in a robot's base_link, for every ordered pair of the team,
  every `STEP_NS`, all poses interpolated. A robot's error of heading enters with the distance of
  the team-mate.
- **In the team**: each robot's error after the motion that brings the poses of the whole team
  nearest to the true ones (`aligning_motion`), at the same times.
- **Along and across** are components of the error in the map along the way of the team: the
  direction in which the mean of the true positions moves. While it stands, that in which it moved
  before.
- **NEES**, the normalized estimation error squared e' P^-1 e of x, y and yaw (Bar-Shalom, Li &
  Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section 5.4). Errors
  of a run at successive times, and those of team-mates, are correlated: the 95 % bounds of the mean
  are those of as many independent values as there are runs. That of relative positions, x and y,
  takes the covariances of two robots relative to their team (`Pose.in_team`) for independent.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import permutations
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from mrs_people_loc.arrays import Float, Int, StructOfArrays
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.team.poses import Pose
from mrs_people_sim.scoring.positions import nothing, percentile, ratio, sums_of
from mrs_tools.bags.records import Estimate

#: Poses are compared no more often than this [ns].
STEP_NS = 100_000_000
#: Poses that are farther apart are not interpolated between [ns].
GAP_NS = 1_000_000_000
#: The way of the team is its displacement over so long before and after [ns]...
_WAY_NS = 1_000_000_000
#: ... if it is at least so long [m].
_LEAST_WAY = 0.2
#: Stands for covariances relative to the team that are not given.
_AS_COVARIANCES: Any = None
#: To align teams, each robot counts as its position and a point so far ahead of it [m].
_AHEAD = 1.0


@dataclass(frozen=True)
class PoseTrack(StructOfArrays):
    """Poses of one robot over time.

    Attributes:
        stamps_ns: Stamps [ns], ascending, int64, shape (n,).
        poses: x, y [m] and yaw [rad], shape (n, 3).
        covariances: Of these, shape (n, 3, 3); zero: not stated.
        in_team: The same relative to the robot's team; `covariances` where that is not given.
    """

    stamps_ns: NDArray[np.int64]
    poses: Float
    covariances: Float
    in_team: Float = _AS_COVARIANCES

    def __post_init__(self) -> None:
        """Checks the lengths."""
        if self.in_team is _AS_COVARIANCES:
            object.__setattr__(self, "in_team", self.covariances)
        super().__post_init__()

    @classmethod
    def build(cls, poses: Iterable[Pose]) -> PoseTrack:
        """Puts poses together; of several with one stamp the last counts."""
        by_stamp = {pose.stamp_ns: pose for pose in poses}
        ordered = [by_stamp[stamp] for stamp in sorted(by_stamp)]
        in_team = [pose.relative_to_team().covariance for pose in ordered]
        return cls(
            np.array([pose.stamp_ns for pose in ordered], dtype=np.int64),
            np.array([(pose.x, pose.y, pose.yaw) for pose in ordered]).reshape(-1, 3),
            np.array([pose.covariance for pose in ordered]).reshape(-1, 3, 3),
            np.array(in_team).reshape(-1, 3, 3),
        )

    def at(self, stamps_ns: NDArray[np.int64]) -> Float:
        """Poses at times, linear between two of them, shape (m, 3).

        NaN before the first, after the last, and in gaps of more than `GAP_NS`.

        Args:
            stamps_ns: Times [ns], int64, shape (m,).
        """
        if not len(self):
            return np.full((len(stamps_ns), 3), np.nan)
        before, after, part = self._around(stamps_ns)
        step = self.poses[after] - self.poses[before]
        step[:, 2] = wrapped(step[:, 2])
        return np.asarray(self.poses[before] + part[:, np.newaxis] * step)

    def in_team_at(self, stamps_ns: NDArray[np.int64]) -> Float:
        """Covariances relative to the team at times, likewise, shape (m, 3, 3)."""
        if not len(self):
            return np.full((len(stamps_ns), 3, 3), np.nan)
        before, after, part = self._around(stamps_ns)
        part = part[:, np.newaxis, np.newaxis]
        return np.asarray((1.0 - part) * self.in_team[before] + part * self.in_team[after])

    def _around(self, stamps_ns: NDArray[np.int64]) -> tuple[Int, Int, Float]:
        """The poses before and after times, and the part of the way between them; NaN: no pose."""
        after = np.clip(np.searchsorted(self.stamps_ns, stamps_ns), 1, max(len(self) - 1, 1))
        before, after = after - 1, np.minimum(after, len(self) - 1)
        begin, end = self.stamps_ns[before], self.stamps_ns[after]
        part = (stamps_ns - begin) / np.maximum(end - begin, 1)
        at_one = (stamps_ns == begin) | (stamps_ns == end)
        inside = (begin <= stamps_ns) & (stamps_ns <= end) & (end - begin <= GAP_NS)
        part[~(inside | at_one)] = np.nan
        return before, after, part

    def every(self, step_ns: int) -> PoseTrack:
        """The poses, thinned out to one in each period [ns]."""
        kept = np.unique(self.stamps_ns // step_ns, return_index=True)[1]
        return self.select(kept)


def wrapped(angles: Float) -> Float:
    """The same angles in [-pi, pi)."""
    return np.asarray((angles + np.pi) % (2.0 * np.pi) - np.pi)


@dataclass(frozen=True)
class PoseScores:
    """Errors of robots' poses; those of several runs are added.

    Attributes:
        runs: Recordings.
        along: Errors along the way of the team, of all robots [m], shape (n,); NaN while it has not
            moved yet.
        across: Errors to the left of it, likewise.
        heading: Errors of the heading [rad], shape (n,).
        squares: NEES, shape (n,); NaN: no covariance is stated.
        along_sigmas: Errors along the way in terms of their stated standard deviation, shape (n,);
            NaN likewise.
        apart: Errors of the position of a robot in a team-mate's base_link [m], shape (k,).
        squares_apart: Of these the NEES; NaN: no covariance is stated.
        turned: Errors of the heading of a robot relative to a team-mate's [rad], shape (k,).
        in_team: Errors of the position in the team [m], shape (j,).
        turned_in_team: Likewise of the heading [rad].
    """

    runs: int = 0
    along: Float = field(default_factory=nothing)
    across: Float = field(default_factory=nothing)
    heading: Float = field(default_factory=nothing)
    squares: Float = field(default_factory=nothing)
    along_sigmas: Float = field(default_factory=nothing)
    apart: Float = field(default_factory=nothing)
    squares_apart: Float = field(default_factory=nothing)
    turned: Float = field(default_factory=nothing)
    in_team: Float = field(default_factory=nothing)
    turned_in_team: Float = field(default_factory=nothing)

    def __add__(self, other: PoseScores) -> PoseScores:
        return PoseScores(**sums_of(self, other))

    def report(self) -> dict[str, Any]:
        """The figures; magnitudes of errors, angles in degrees, what is undefined is None."""
        sigmas = np.abs(self.along_sigmas[np.isfinite(self.along_sigmas)])
        return {
            "runs": self.runs,
            "relative": {
                "position_m": _magnitudes(self.apart),
                "heading_deg": _magnitudes(np.degrees(self.turned)),
                "nees": _nees(self.squares_apart, self.runs, 2),
            },
            "in_team": {
                "position_m": _magnitudes(self.in_team),
                "heading_deg": _magnitudes(np.degrees(self.turned_in_team)),
            },
            "along_m": _magnitudes(self.along),
            "across_m": _magnitudes(self.across),
            "heading_deg": _magnitudes(np.degrees(self.heading)),
            "along_in_3_sigma": ratio(int((sigmas <= 3.0).sum()), len(sigmas)),
            "nees": _nees(self.squares, self.runs, 3),
        }


def _nees(squares: Float, runs: int, freedom: int) -> dict[str, float | None]:
    squares = squares[np.isfinite(squares)]
    low, high = nees_bounds(runs, freedom)
    return {
        "mean": float(squares.mean()) if len(squares) else None,
        "median": percentile(squares, 50),
        "low": low,
        "high": high,
    }


def nees_bounds(runs: int, freedom: int = 3) -> tuple[float | None, float | None]:
    """The 95 % bounds of the mean NEES over independent runs; None of none.

    Args:
        runs: How many.
        freedom: Of how many components the errors are: x, y and yaw.
    """
    if not runs:
        return None, None
    low, high = chi2.ppf((0.025, 0.975), freedom * runs) / runs
    return float(low), float(high)


def _magnitudes(errors: Float) -> dict[str, float | None]:
    sizes = np.abs(errors[np.isfinite(errors)])
    return {
        "median": percentile(sizes, 50),
        "p95": percentile(sizes, 95),
        "max": percentile(sizes, 100),
    }


def score_poses(
    true: Mapping[str, PoseTrack], estimated: Mapping[str, PoseTrack]
) -> PoseScores | None:
    """Compares the poses of a run with the true ones, by the rules at the top of this module.

    Args:
        true: By robot, its true poses in the map.
        estimated: By robot, its estimated poses in the map; robots without true poses are left out.

    Returns:
        The scores; None: there is nothing to compare.
    """
    chosen = {
        name: track.every(STEP_NS) for name, track in sorted(estimated.items()) if name in true
    }
    parts = [_absolute(true, name, track) for name, track in chosen.items()]
    total = sum(parts, PoseScores(runs=1))
    if not len(total.heading):
        return None
    stamps = np.unique(np.concatenate([track.stamps_ns for track in chosen.values()]) // STEP_NS)
    errors = relative_errors(true, estimated, stamps * STEP_NS)
    covariances = relative_covariances(true, estimated, stamps * STEP_NS)
    known = np.isfinite(errors).all(axis=2)
    pairs, squares = errors[known], _squares(errors[known][:, :2], covariances[known])
    in_team = _errors_in_team(true, list(chosen), estimated, stamps * STEP_NS)
    return total + PoseScores(
        apart=np.hypot(pairs[:, 0], pairs[:, 1]),
        squares_apart=squares,
        turned=pairs[:, 2],
        in_team=np.hypot(in_team[:, 0], in_team[:, 1]),
        turned_in_team=in_team[:, 2],
    )


def _absolute(true: Mapping[str, PoseTrack], name: str, track: PoseTrack) -> PoseScores:
    at = true[name].at(track.stamps_ns)
    known = np.asarray(np.isfinite(at).all(axis=1))
    track, at = track.select(known), at[known]
    error = track.poses - at
    error[:, 2] = wrapped(error[:, 2])
    ahead = way_of_team(true, track.stamps_ns)
    left = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    along = (error[:, :2] * ahead).sum(axis=1)
    variance = np.einsum("ni,nij,nj->n", ahead, track.covariances[:, :2, :2], ahead)
    with np.errstate(divide="ignore", invalid="ignore"):
        sigmas = np.where(variance > 0.0, along / np.sqrt(variance), np.nan)
    return PoseScores(
        along=along,
        across=(error[:, :2] * left).sum(axis=1),
        heading=error[:, 2],
        squares=_squares(error, track.covariances),
        along_sigmas=sigmas,
    )


def _squares(error: Float, covariance: Float) -> Float:
    squares = np.full(len(error), np.nan)
    stated = np.linalg.det(covariance) > 0.0
    solved = np.linalg.solve(covariance[stated], error[stated][..., np.newaxis])[..., 0]
    squares[stated] = (error[stated] * solved).sum(axis=1)
    return squares


def relative_errors(
    true: Mapping[str, PoseTrack],
    estimated: Mapping[str, PoseTrack],
    stamps_ns: NDArray[np.int64],
) -> Float:
    """Errors of team-mates' poses in robots' base_link, for ordered pairs of robots.

    Args:
        true: By robot, its true poses in the map.
        estimated: By robot, its estimated poses in the map.
        stamps_ns: Times [ns], int64, shape (n,).

    Returns:
        x, y [m] and yaw [rad], shape (pairs, n, 3); NaN where one of the poses is not known.
    """
    names = sorted(set(true) & set(estimated))
    here, there = (
        {name: tracks[name].at(stamps_ns) for name in names} for tracks in (true, estimated)
    )
    errors = np.empty((len(names) * (len(names) - 1), len(stamps_ns), 3))
    for row, (one, other) in enumerate(permutations(names, 2)):
        errors[row] = relative_to(there[one], there[other]) - relative_to(here[one], here[other])
    errors[..., 2] = wrapped(errors[..., 2])
    return errors


def relative_covariances(
    true: Mapping[str, PoseTrack],
    estimated: Mapping[str, PoseTrack],
    stamps_ns: NDArray[np.int64],
) -> Float:
    """Covariances of team-mates' positions in robots' base_link, if errors are independent.

    Arguments are those of `relative_errors`.

    Returns:
        Of x and y [m^2], shape (pairs, n, 2, 2), likewise NaN where a pose is not known.
    """
    names = sorted(set(true) & set(estimated))
    poses = {name: estimated[name].at(stamps_ns) for name in names}
    stated = {name: estimated[name].in_team_at(stamps_ns) for name in names}
    covariances = np.empty((len(names) * (len(names) - 1), len(stamps_ns), 2, 2))
    for row, (one, other) in enumerate(permutations(names, 2)):
        x, y, _ = relative_to(poses[one], poses[other]).T
        # By the pose of the robot, turned into its own frame: [[-1, 0, y], [0, -1, -x]].
        by_one = np.zeros((len(stamps_ns), 2, 3))
        by_one[:, 0, 0] = by_one[:, 1, 1] = -1.0
        by_one[:, 0, 2], by_one[:, 1, 2] = y, -x
        cos, sin = np.cos(poses[one][:, 2]), np.sin(poses[one][:, 2])
        to_one = np.zeros((len(stamps_ns), 3, 3))
        to_one[:, 0, 0] = to_one[:, 1, 1] = cos
        to_one[:, 0, 1], to_one[:, 1, 0], to_one[:, 2, 2] = sin, -sin, 1.0
        by_one, by_other = by_one @ to_one, to_one[:, :2, :]
        with np.errstate(over="ignore", invalid="ignore"):  # DBL_MAX may stand for "unknown"
            covariances[row] = by_one @ stated[one] @ by_one.transpose(0, 2, 1)
            covariances[row] += by_other @ stated[other] @ by_other.transpose(0, 2, 1)
    return covariances


def _errors_in_team(
    true: Mapping[str, PoseTrack],
    names: Sequence[str],
    estimated: Mapping[str, PoseTrack],
    stamps_ns: NDArray[np.int64],
) -> Float:
    """Errors of poses after the team's were brought to the true ones, shape (n, 3).

    Times at which fewer than two robots' poses are known are left out.
    """
    there, here = (
        np.stack([tracks[name].at(stamps_ns) for name in names], axis=1)
        for tracks in (true, estimated)
    )
    known = np.asarray(np.isfinite(here + there).all(axis=2))
    errors = [np.empty((0, 3))]
    for one, other, used in zip(here, there, known, strict=True):
        if used.sum() >= 2:
            x, y, turn = aligning_motion(one[used], other[used])
            places = one[used, :2] @ rotation_2d(turn).T + (x, y)
            errors.append(np.column_stack([places, one[used, 2] + turn]) - other[used])
    found = np.concatenate(errors)
    found[:, 2] = wrapped(found[:, 2])
    return found


def relative_to(poses: Float, others: Float) -> Float:
    """Other poses in the frames of poses: x, y [m] and yaw [rad], shape (n, 3)."""
    cos, sin = np.cos(poses[:, 2]), np.sin(poses[:, 2])
    x, y, yaw = (others - poses).T
    return np.stack([cos * x + sin * y, cos * y - sin * x, yaw], axis=1)


def way_of_team(true: Mapping[str, PoseTrack], stamps_ns: NDArray[np.int64]) -> Float:
    """Unit vectors along the way of a team, shape (n, 2); NaN before it first moves.

    Args:
        true: By robot, its true poses.
        stamps_ns: Times [ns], ascending, int64, shape (n,).
    """
    tracks = [track for track in true.values() if len(track)]
    if not tracks:
        return np.full((len(stamps_ns), 2), np.nan)

    def places(shift_ns: int) -> Float:
        return np.mean([_held(track, stamps_ns + shift_ns) for track in tracks], axis=0)

    step = places(_WAY_NS) - places(-_WAY_NS)
    length = np.hypot(step[:, 0], step[:, 1])
    moves = length >= _LEAST_WAY
    # The newest time, not later, at which the team moves.
    newest = np.maximum.accumulate(np.where(moves, np.arange(len(step)), -1))
    way = step / np.maximum(length, 1e-9)[:, np.newaxis]
    return np.where((newest >= 0)[:, np.newaxis], way[newest], np.nan)


def _held(track: PoseTrack, stamps_ns: NDArray[np.int64]) -> Float:
    """Positions at times, before the first and after the last as there, shape (n, 2)."""
    return np.stack(
        [np.interp(stamps_ns, track.stamps_ns, track.poses[:, k]) for k in (0, 1)], axis=1
    )


# ------------------------------------------------------------------------- the team's own frame


def aligning_motion(estimated: Float, true: Float) -> Float:
    """The motion of the plane that brings a team's estimated poses nearest to the true ones.

    Least squares over the positions and points 1 m ahead of them, so that headings count.

    Args:
        estimated: x, y [m] and yaw [rad] of each robot, shape (n, 3), n >= 1.
        true: Likewise.

    Returns:
        Move x, y [m] and turn [rad] about the origin, shape (3,): the turn comes first.
    """
    here, there = _points(estimated), _points(true)
    a, b = here - here.mean(axis=0), there - there.mean(axis=0)
    turn = math.atan2((a[:, 0] * b[:, 1] - a[:, 1] * b[:, 0]).sum(), (a * b).sum())
    move = there.mean(axis=0) - rotation_2d(turn) @ here.mean(axis=0)
    return np.array([*move, turn])


def _points(poses: Float) -> Float:
    ahead = np.stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])], axis=1)
    return np.concatenate([poses[:, :2], poses[:, :2] + _AHEAD * ahead])


def in_true_frame(
    estimates: Sequence[Estimate],
    true: Mapping[str, PoseTrack],
    estimated: Mapping[str, PoseTrack],
) -> list[Estimate]:
    """People found by a team, moved as the team's poses have to be to fit the true ones.

    A team without a known place in the map drifts as a whole, and the people with it. What
    remains are the errors of the people relative to the team.

    Args:
        estimates: What was found.
        true: By robot, its true poses.
        estimated: By robot, the poses that the people were placed with.

    Returns:
        The estimates at whose stamp the pose of a robot is known, moved.
    """
    names = sorted(set(true) & set(estimated))
    stamps = np.array([estimate.stamp_ns for estimate in estimates], dtype=np.int64)
    both = [
        np.array([tracks[name].at(stamps) for name in names]).reshape(len(names), -1, 3)
        for tracks in (estimated, true)
    ]
    known = np.asarray(np.isfinite(both).all(axis=(0, 3)))
    return [
        _moved(estimate, aligning_motion(both[0][used, k], both[1][used, k]))
        for k, (estimate, used) in enumerate(zip(estimates, known.T, strict=True))
        if used.any()
    ]


def _moved(estimate: Estimate, motion: Float) -> Estimate:
    turn, move = rotation_2d(motion[2]), motion[:2]

    def placed(place: Float | None) -> Float | None:
        return None if place is None else turn @ place + move

    return dataclasses.replace(
        estimate,
        positions=estimate.positions @ turn.T + move,
        covariances=turn @ estimate.covariances @ turn.T,
        velocities=estimate.velocities @ turn.T,
        centre=placed(estimate.centre),
        largest=placed(estimate.largest),
    )

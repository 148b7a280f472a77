"""Lines of flat walls through points on the ground plane, and what all finders of walls share.

Hypotheses are total least squares lines of short windows of a sweep; the one with most metres of
wall on it is refined by weighted total least squares, its points are taken out, and so on. The
covariance of a line is that of its points carried through the fit (Arras & Siegwart 1997, "Feature
extraction and scene interpretation for map-based navigation and map building").
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mrs_people_loc.arrays import Bool, Float, Float32, Int, StructOfArrays
from mrs_people_loc.localization.walls import Walls, moved


@dataclass(frozen=True)
class WallFitTuning:
    """Constants of `fit_walls` and `meeting`, chosen by hand.

    Attributes:
        tolerance: A point on a wall is this near to its line [m],
        sigmas: or within so many of its standard deviations.
        min_length: A wall is at least this long [m] ...
        min_points: ... has at least so many points,
        max_gap: and no longer gap between two of them [m].
        max_bow: Of what is not flat, the middle half is farther than this from a line through the
            outer quarters, on average [m],
        bow_sigmas: and by so many standard deviations.
        spacing: A point stands for at most this much of a wall [m].
        windows: Numbers of points of the windows that lines are drawn through.
        max_lines: At most so many lines are drawn,
        max_scored: and judged by so many of the points.
        max_count: So many walls at most,
        max_tries: found in so many tries.
        rounds: Rounds of the refinement.
        min_crossing: Two walls meet at more than this angle [rad],
        max_off: and their ends are no farther from the meeting point [m].
        promising: A hypothesis is a try if this part of the least length is on it.
        singular: A matrix of 2 x 2 has no inverse where its determinant is so small against its
            trace, squared: rounding.
    """

    tolerance: float = 0.03
    sigmas: float = 3.0
    min_length: float = 0.8
    min_points: int = 8
    max_gap: float = 0.6
    max_bow: float = 0.015
    bow_sigmas: float = 3.0
    spacing: float = 0.3
    windows: tuple[int, ...] = (8, 16, 32)
    max_lines: int = 80
    max_scored: int = 360
    max_count: int = 6
    max_tries: int = 8
    rounds: int = 2
    min_crossing: float = 0.5
    max_off: float = 0.4
    promising: float = 0.6
    singular: float = 1e-12


WALL_FIT_TUNING = WallFitTuning()


@dataclass(frozen=True)
class _Sweep(StructOfArrays):
    """Points of a sweep: places [m], covariances [m^2] and the metres that each stands for."""

    x: Float
    y: Float
    xx: Float
    xy: Float
    yy: Float
    metres: Float

    def off(self, line: tuple[float, float]) -> tuple[Float, Float]:
        """How far the points are from a line (distance, bearing) [m], and the variance of that."""
        distance, bearing = line
        cos, sin = math.cos(bearing), math.sin(bearing)
        variance = self.xx * (cos * cos) + self.xy * (2.0 * cos * sin) + self.yy * (sin * sin)
        return self.x * cos + self.y * sin - distance, variance

    def along(self, bearing: float) -> Float:
        """Places of the points along a line, from the foot of its perpendicular [m]."""
        return self.y * math.cos(bearing) - self.x * math.sin(bearing)


def fit_walls(xy: Float, covariance: Float, *, tuning: WallFitTuning = WALL_FIT_TUNING) -> Walls:
    """Robust lines through points that come in the order of a sweep.

    Args:
        xy: Points [m], finite, neighbours of the sweep beside each other, shape (n, 2).
        covariance: Of each point [m^2], of full rank, shape (n, 2, 2); or standard deviations [m],
            shape (n,).
        tuning: Constants.

    Returns:
        The walls, those with most metres first; ends are where two of them meet.

    Raises:
        ValueError: The shapes do not fit together.
    """
    if covariance.ndim == 1:
        covariance = covariance[:, np.newaxis, np.newaxis] ** 2 * np.eye(2)
    if xy.shape != (len(xy), 2) or covariance.shape != (len(xy), 2, 2):
        raise ValueError(
            f"points have the shape {xy.shape} and covariances {covariance.shape}; "
            "wanted: (n, 2) and (n, 2, 2) or (n,)"
        )
    if len(xy) < tuning.min_points:
        return walls_of([])
    # In rows, which are faster than columns.
    x, y = np.ascontiguousarray(xy.T)
    xx, cross, _, yy = np.ascontiguousarray(covariance.reshape(-1, 4).T)
    metres = np.minimum(_spacing(x, y), tuning.spacing)
    sweep = _Sweep(x, y, xx, cross, yy, metres)
    lines = _window_lines(x, y, tuning)
    some = slice(None, None, max(1, -(-len(xy) // tuning.max_scored)))
    near = np.maximum(tuning.tolerance, tuning.sigmas * np.sqrt(xx[some] + yy[some]))
    support = _support(lines, xy[some], near)
    left = metres.astype(np.float32)
    worth = np.float32(some.step)
    found: list[Line] = []
    for _ in range(tuning.max_tries if len(lines) else 0):
        score = support @ left[some] * worth
        best = int(score.argmax())
        if score[best] < tuning.promising * tuning.min_length or len(found) == tuning.max_count:
            break
        wall, taken = _refined((lines[best, 0], lines[best, 1]), sweep, left > 0.0, tuning)
        if len(taken):
            left[taken] = 0.0
        else:
            left[some][support[best] > 0.0] = 0.0
        if wall is not None:
            found.append(wall)
    return meeting(walls_of(found), tuning)


class Line(NamedTuple):
    """A wall as its fit gives it.

    Attributes:
        distance: Along `bearing`, of any sign [m].
        bearing: Of the normal [rad].
        covariance: Of both, shape (2, 2).
        extent: First and last place along bearing + pi/2, from the foot [m].
        is_end: Whether the wall ends there.
    """

    distance: float
    bearing: float
    covariance: Float
    extent: tuple[float, float]
    is_end: tuple[bool, bool] = (False, False)


def walls_of(lines: Sequence[Line], x: float = 0.0, y: float = 0.0) -> Walls:
    """Walls from lines in axes whose origin is at x, y [m]."""
    count = len(lines)
    walls = Walls(
        np.array([line.distance for line in lines], dtype=np.float64),
        np.array([line.bearing for line in lines], dtype=np.float64),
        np.array([line.covariance for line in lines], dtype=np.float64).reshape(count, 2, 2),
        np.array([line.extent for line in lines], dtype=np.float64).reshape(count, 2),
        np.array([line.is_end for line in lines], dtype=np.bool_).reshape(count, 2),
    )
    return moved(walls, x, y, 0.0)


def meeting(walls: Walls, tuning: WallFitTuning = WALL_FIT_TUNING) -> Walls:
    """Walls with their ends moved to where another wall meets them."""
    if len(walls) < 2:
        return walls
    crossing = np.subtract.outer(walls.bearing, walls.bearing)  # of i against j
    # The point of line i that is `place` from its foot, d_i n_i + place t_i, is on line j.
    with np.errstate(divide="ignore", invalid="ignore"):
        beside = walls.distance[:, np.newaxis] * np.cos(crossing) - walls.distance
        place = beside / (sine := np.sin(crossing))
    place = np.where(np.abs(sine) > math.sin(tuning.min_crossing), place, np.inf)
    low, high = walls.extent[:, :1] - tuning.max_off, walls.extent[:, 1:] + tuning.max_off
    on_other = ((place > low) & (place < high)).T
    off = np.abs(place[:, np.newaxis, :] - walls.extent[:, :, np.newaxis])
    off = np.where(on_other[:, np.newaxis], off, np.inf)
    nearest = off.argmin(axis=2)
    met = off.min(axis=2) < tuning.max_off
    extent = np.where(met, place[np.arange(len(walls))[:, np.newaxis], nearest], walls.extent)
    return Walls(walls.distance, walls.bearing, walls.covariance, extent, walls.is_end | met)


def _window_lines(x: Float, y: Float, tuning: WallFitTuning) -> Float:
    """Total least squares lines of windows that overlap by half: distance, bearing, shape (m, 2).

    The distance may be negative here.
    """
    sums = np.zeros((6, len(x) + 1))
    np.cumsum([np.ones(len(x)), x, y, x * x, x * y, y * y], axis=1, out=sums[:, 1:])
    starts = [np.arange(0, max(0, len(x) - size + 1), size // 2) for size in tuning.windows]
    size = np.repeat(tuning.windows, [len(start) for start in starts])
    start = np.concatenate(starts)
    every = slice(None, None, max(1, -(-len(start) // tuning.max_lines)))
    start, size = start[every], size[every]
    n, sx, sy, sxx, sxy, syy = sums[:, start + size] - sums[:, start]
    mx, my = sx / n, sy / n
    sxx, sxy, syy = sxx - sx * mx, sxy - sx * my, syy - sy * my
    bearing = 0.5 * np.arctan2(-2.0 * sxy, syy - sxx)
    return np.stack([mx * np.cos(bearing) + my * np.sin(bearing), bearing], axis=1)


def _support(lines: Float, xy: Float, tolerance: Float) -> Float32:
    """1 for points within the tolerance of a line, 0 for others, float32, shape (m, n)."""
    normals = np.stack([np.cos(lines[:, 1]), np.sin(lines[:, 1])], axis=1).astype(np.float32)
    off = normals @ xy.T.astype(np.float32)
    off -= lines[:, :1].astype(np.float32)
    np.abs(off, out=off)
    support: Float32 = (off < tolerance.astype(np.float32)).astype(np.float32)
    return support


def _spacing(x: Float, y: Float) -> Float:
    """Half the way from each point's neighbour before it to that after it [m], shape (n,)."""
    steps, both = np.hypot(np.diff(x), np.diff(y)), np.zeros(len(x))
    both[:-1] = steps
    both[1:] += steps
    return 0.5 * both


def _refined(
    line: tuple[float, float], sweep: _Sweep, left: Bool, tuning: WallFitTuning
) -> tuple[Line | None, Int]:
    """The wall near a line, None if there is none; and which points it takes."""
    for _ in range(tuning.rounds):
        off, variance = sweep.off(line)
        near = np.maximum(tuning.tolerance**2, tuning.sigmas**2 * variance)
        index = np.flatnonzero(left & (off * off < near))
        if len(index) < tuning.min_points:
            return None, index
        along = sweep.along(line[1])[index]
        run = _longest_run(along, sweep.metres[index], tuning)
        index, along = index[run], along[run]
        # x cos(b) + y sin(b) - d: its derivatives by d and b are -1 and `along`.
        weight = 1.0 / variance[index]
        weighted = weight * along
        a, b, c = float(weight.sum()), float(weighted.sum()), float(weighted @ along)
        determinant = a * c - b * b
        if determinant <= WALL_FIT_TUNING.singular * (a + c) ** 2:
            return None, index
        covariance = np.array([[c, b], [b, a]]) / determinant
        off = off[index]
        step = covariance @ (weight @ off, -(weighted @ off))
        line = line[0] + float(step[0]), line[1] + float(step[1])
    off, variance = (values[index] for values in sweep.off(line))
    along = sweep.along(line[1])[index]
    extent = float(along.min()), float(along.max())
    if len(index) < tuning.min_points or extent[1] - extent[0] < tuning.min_length:
        return None, index
    if _is_bowed(along, extent, off, variance, tuning):
        return None, index
    excess = max(1.0, float((off * off / variance).sum()) / (len(index) - 2))
    return Line(*line, covariance * excess, extent), index


def _longest_run(along: Float, metres: Float, tuning: WallFitTuning) -> Bool:
    """Which points belong to the run with most metres and without longer gaps, shape (n,)."""
    order = np.argsort(along, kind="stable")
    ascending = along[order]
    gaps = ascending[1:] - ascending[:-1] > tuning.max_gap
    if not gaps.any():
        return np.ones(len(along), dtype=bool)
    run = np.zeros(len(along), dtype=np.intp)
    run[order[1:]] = np.cumsum(gaps)
    return np.asarray(run == np.bincount(run, metres).argmax())


def _is_bowed(
    along: Float, extent: tuple[float, float], off: Float, variance: Float, tuning: WallFitTuning
) -> bool:
    """Whether points near a line are on a curve: the middle half is to one side of the rest."""
    low, high = extent
    middle = np.abs(along - 0.5 * (low + high)) < 0.25 * (high - low)
    weight = 1.0 / variance
    inside, whole = float(weight @ middle), float(weight.sum())
    outside = whole - inside
    if not (inside and outside):
        return True
    sum_inside = float((weight * off) @ middle)
    bow = sum_inside / inside - (float(weight @ off) - sum_inside) / outside
    sigma = math.sqrt(1.0 / inside + 1.0 / outside)
    return abs(bow) > max(tuning.max_bow, tuning.bow_sigmas * sigma)

"""Scoring what was found against the ground truth.

The rules, in one place:

- A frame is a ground-truth message. The estimate nearest in time counts for it, if it is no farther
  away than half an interval; it is compared with the truth at the estimate's own stamp.
- An interval is the median time between consecutive estimates (`interval_of`): when the planner
  skips one, the truth of that time is missed; when its rate changes, what is slower than usual is.
- Found and true people match within `MATCH_DISTANCE`, one to one, optimally.
- Truth without an estimate is missed. Everybody in the truth counts, except people whom no robot
  sees: they are not required, and an estimate that fits one of them (and nobody who is required)
  counts neither as found nor as false.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from mrs_people_loc.geometry import Float

Int = NDArray[np.intp]
Bool = NDArray[np.bool_]

#: A found and a true person match when they are within this distance [m].
MATCH_DISTANCE = 0.40
#: Chi-square with 2 degrees of freedom: the squared Mahalanobis radius of the 95 % ellipse.
CHI2_95 = 5.991
#: The interval where neither estimates nor truth show one [ns].
_DEFAULT_INTERVAL_NS = 200_000_000
#: Stamps are rounded; "within" means up to this much more [ns].
_ROUNDING_NS = 1_000


def match(found: Float, true: Float, *, distance: float = MATCH_DISTANCE) -> tuple[Int, Int, Float]:
    """Pairs found with true positions, one to one, as many as possible, then as near as possible.

    Args:
        found: Positions [m], shape (n, 2).
        true: Positions [m], shape (m, 2); NaN for somebody who is not there.
        distance: Pairs are no farther apart than this [m], inclusive.

    Returns:
        Indices of the pairs in `found` and in `true`, and their distances [m], each of shape (k,).
    """
    away = np.linalg.norm(found[:, np.newaxis] - true[np.newaxis], axis=2)
    possible = away <= distance  # NaN compares false
    # A pair that is impossible costs more than any set of possible ones.
    cost = np.where(possible, away, distance * (1.0 + min(away.shape, default=0)))
    rows, columns = linear_sum_assignment(cost)
    kept = possible[rows, columns]
    rows, columns = rows[kept], columns[kept]
    return rows, columns, away[rows, columns]


@dataclass(frozen=True)
class Truth:
    """Where the people of a recording truly are, over time.

    Attributes:
        stamps_ns: Stamps [ns], ascending, int64, shape (n,).
        positions: Of each person at each stamp [m], shape (n, m, 2); NaN: not there.
        visible: Whether a robot sees the person, shape (n, m).
        groups: Number of the group that each person belongs to, 0: none, shape (n, m); None: the
            truth does not say.
    """

    stamps_ns: NDArray[np.int64]
    positions: Float
    visible: Bool
    groups: Int | None = None

    @classmethod
    def build(
        cls,
        stamps_ns: Sequence[int],
        positions: Sequence[Float],
        visible: Sequence[Bool | None] | None = None,
        groups: Sequence[NDArray[np.integer]] | None = None,
    ) -> Truth:
        """Puts messages together; of several with one stamp the last counts.

        Args:
            stamps_ns: Stamps [ns], in any order.
            positions: At each stamp [m], shape (m, 2); m may differ, who is missing is not there.
            visible: At each stamp, shape (m,); None: everybody is.
            groups: Numbers of their groups at each stamp, shape (m,); None: nothing is known.
        """
        given = visible if visible is not None else [None] * len(stamps_ns)
        homes = groups if groups is not None else [np.empty(0, dtype=np.intp)] * len(stamps_ns)
        rows = {
            stamp: (xy, seen, home)
            for stamp, xy, seen, home in zip(stamps_ns, positions, given, homes, strict=True)
        }
        count = max((len(xy) for xy, _, _ in rows.values()), default=0)
        stamps = sorted(rows)
        xys = np.full((len(rows), count, 2), np.nan)
        seens = np.ones((len(rows), count), dtype=bool)
        numbers = np.zeros((len(rows), count), dtype=np.intp)
        for index, stamp in enumerate(stamps):
            xy, seen, home = rows[stamp]
            xys[index, : len(xy)] = np.reshape(xy, (-1, 2))
            numbers[index, : len(home)] = home
            if seen is not None:
                seens[index, : len(seen)] = seen
        belong = None if groups is None else numbers
        return cls(np.array(stamps, dtype=np.int64), xys, seens, belong)

    def __len__(self) -> int:
        """Number of ground-truth messages."""
        return len(self.stamps_ns)

    def at(self, stamp_ns: int) -> tuple[Float, Bool]:
        """The truth at a time.

        Positions are interpolated linearly. Where a person is there in one of the two messages
        around that time only, the nearer message decides; before the first and after the last
        message it is the same as in that one. The nearer message also says who is visible.

        Args:
            stamp_ns: Time [ns].

        Returns:
            Positions [m], shape (m, 2), NaN: not there; and who is visible, shape (m,).
        """
        if not len(self):
            return np.empty((0, 2)), np.empty(0, dtype=bool)
        after = int(np.searchsorted(self.stamps_ns, stamp_ns))
        index = min(after, len(self) - 1)
        if after in (0, len(self)) or self.stamps_ns[index] == stamp_ns:
            return self.positions[index], self.visible[index]
        before = after - 1
        begin, end = int(self.stamps_ns[before]), int(self.stamps_ns[after])
        part = (stamp_ns - begin) / (end - begin)
        nearer = before if part <= 0.5 else after
        one, other = self.positions[before], self.positions[after]
        between = one + part * (other - one)
        both = np.isfinite(between).all(axis=1, keepdims=True)
        return np.where(both, between, self.positions[nearer]), self.visible[nearer]


@dataclass(frozen=True)
class Estimate:
    """What a system said of one interval.

    Attributes:
        stamp_ns: Its stamp [ns].
        positions: Of the people [m], shape (n, 2).
        covariances: Of the positions [m^2], shape (n, 2, 2).
        centre: Centre of gravity of all groups [m], shape (2,); None: there is none.
        largest: That of the largest group.
        ids: Of the people, int64, shape (n,); 0, and all of them if left out: not tracked.
        velocities: Of the people [m/s], shape (n, 2); NaN, and all of them if left out: unknown.
        coasting: Who of them is predicted, not seen, shape (n,); nobody if left out.
        stragglers: Ids of those who have fallen behind their groups or left them.

    Raises:
        ValueError: The arrays are not of one length, or somebody's id is somebody else's, too.
    """

    stamp_ns: int
    positions: Float
    covariances: Float
    centre: Float | None = None
    largest: Float | None = None
    ids: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    velocities: Float = field(default_factory=lambda: np.empty((0, 2)))
    coasting: Bool = field(default_factory=lambda: np.empty(0, dtype=bool))
    stragglers: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        count = len(self.positions)
        unsaid = {
            "ids": np.zeros(count, dtype=np.int64),
            "velocities": np.full((count, 2), np.nan),
            "coasting": np.zeros(count, dtype=bool),
        }
        for name, nothing in unsaid.items():
            if not len(getattr(self, name)):
                object.__setattr__(self, name, nothing)
            if getattr(self, name).shape != nothing.shape:
                raise ValueError(
                    f"{name} has shape {getattr(self, name).shape}; wanted: {nothing.shape}"
                )
        tracked = self.ids[self.ids != 0]
        if len(np.unique(tracked)) < len(tracked):
            raise ValueError(f"an id is there twice: {sorted(tracked.tolist())}")


@dataclass(frozen=True)
class Frame:
    """How one ground-truth message was met.

    Attributes:
        stamp_ns: Stamp of the message [ns].
        estimate: Index of the estimate that counts; None: there is none near enough.
        true: The positions that it was compared with [m], shape (m, 2); NaN: not there.
        required: Who has to be found, shape (m,).
        pairs: Indices of matched people in the estimate and in `true`, shape (k, 2).
        errors: Their distances [m], shape (k,).
        mahalanobis: Their squared distances in terms of the covariance, shape (k,); NaN: the
            covariance is none.
        ignored: Indices in the estimate of those that fit somebody who is not required.
        false: Indices in the estimate of those that fit nobody.
        counted: Who is required, or was found all the same, shape (m,).
        centre_error: Distance from `centre` to that of those who are counted [m]; NaN: there is no
            group.
    """

    stamp_ns: int
    estimate: int | None
    true: Float
    required: Bool
    pairs: Int
    errors: Float
    mahalanobis: Float
    ignored: Int
    false: Int
    counted: Bool
    centre_error: float

    @property
    def missed(self) -> Int:
        """Indices in `true` of those that had to be found and were not."""
        missed = self.required.copy()
        missed[self.pairs[:, 1]] = False
        return np.flatnonzero(missed)


def interval_of(stamps_ns: Iterable[int], truth_ns: Iterable[int] = ()) -> int:
    """Length of an interval [ns]: the median time between consecutive estimates.

    With fewer than two estimates it is that between ground-truth messages, with fewer than two of
    these, too, 0.2 s.

    Args:
        stamps_ns: Stamps of the estimates [ns].
        truth_ns: Stamps of the ground truth [ns].
    """
    for stamps in (stamps_ns, truth_ns):
        gaps = np.diff(np.unique(np.array(list(stamps), dtype=np.int64)))
        if len(gaps):
            return int(np.median(gaps))
    return _DEFAULT_INTERVAL_NS


def score(
    truth: Truth,
    estimates: Sequence[Estimate],
    *,
    interval_ns: int | None = None,
    distance: float = MATCH_DISTANCE,
) -> list[Frame]:
    """Compares estimates with the truth, by the rules at the top of this module.

    Args:
        truth: The truth.
        estimates: What was found, in any order.
        interval_ns: Length of an interval [ns]; None: as `interval_of` says.
        distance: Found and true people match within this [m].

    Returns:
        One frame per ground-truth message.
    """
    order = sorted(range(len(estimates)), key=lambda i: estimates[i].stamp_ns)
    stamps = np.array([estimates[i].stamp_ns for i in order], dtype=np.int64)
    if interval_ns is None:
        interval_ns = interval_of(stamps.tolist(), truth.stamps_ns.tolist())
    compared: dict[int, Frame] = {}
    frames = []
    for stamp_ns in truth.stamps_ns.tolist():
        away = np.abs(stamps - stamp_ns)
        nearest = int(np.argmin(away)) if len(away) else -1
        if nearest < 0 or 2 * int(away[nearest]) > interval_ns + _ROUNDING_NS:
            frames.append(_missed(stamp_ns, truth))
            continue
        index = order[nearest]
        if index not in compared:
            compared[index] = _compare(index, estimates[index], truth, distance)
        # Several frames may have the same estimate; then they differ by their stamp alone.
        frames.append(Frame(**{**vars(compared[index]), "stamp_ns": stamp_ns}))
    return frames


def _missed(stamp_ns: int, truth: Truth) -> Frame:
    true, visible = truth.at(stamp_ns)
    none = np.empty(0, dtype=np.intp)
    required = np.isfinite(true).all(axis=1) & visible
    return Frame(
        stamp_ns=stamp_ns,
        estimate=None,
        true=true,
        required=required,
        pairs=np.empty((0, 2), dtype=np.intp),
        errors=np.empty(0),
        mahalanobis=np.empty(0),
        ignored=none,
        false=none,
        counted=required,
        centre_error=math.nan,
    )


def _compare(index: int, estimate: Estimate, truth: Truth, distance: float) -> Frame:
    true, visible = truth.at(estimate.stamp_ns)
    required = np.isfinite(true).all(axis=1) & visible
    found = estimate.positions
    # First those who have to be found; what is left may still be somebody whom no robot sees.
    one, other, errors = match(
        found, np.where(required[:, np.newaxis], true, np.nan), distance=distance
    )
    left = np.setdiff1d(np.arange(len(found)), one)
    excused, unasked, _ = match(
        found[left], np.where(required[:, np.newaxis], np.nan, true), distance=distance
    )
    ignored = left[excused]
    counted = required.copy()
    counted[unasked] = True
    centre_error = math.nan
    if estimate.centre is not None and required.any():
        centre_error = float(np.linalg.norm(estimate.centre - true[counted].mean(axis=0)))
    return Frame(
        stamp_ns=estimate.stamp_ns,
        estimate=index,
        true=true,
        required=required,
        pairs=np.stack([one, other], axis=1),
        errors=errors,
        mahalanobis=_mahalanobis(found[one] - true[other], estimate.covariances[one]),
        ignored=ignored,
        false=np.setdiff1d(left, ignored),
        counted=counted,
        centre_error=centre_error,
    )


def _mahalanobis(offset: Float, covariance: Float) -> Float:
    """Squared distances in terms of covariances, shape (k,); NaN where there is none."""
    result = np.full(len(offset), np.nan)
    for index, (away, matrix) in enumerate(zip(offset, covariance, strict=True)):
        if np.isfinite(matrix).all() and matrix[0, 0] > 0 and np.linalg.det(matrix) > 0:
            result[index] = away @ np.linalg.solve(matrix, away)
    return result


def summary(frames: Sequence[Frame]) -> dict[str, Any]:
    """The figures of some frames: of one recording, or of several pooled.

    Returns:
        `frames`, `people` and `group` as in the JSON of `mrs evaluate`. Counts are sums over the
        frames; what is undefined is None. `coverage_95` is the share of matched people whose true
        position lies in the 95 % ellipse of the covariance given with the estimate.
    """
    errors = np.concatenate([np.empty(0), *(frame.errors for frame in frames)])
    squares = np.concatenate([np.empty(0), *(frame.mahalanobis for frame in frames)])
    centres = np.array([f.centre_error for f in frames if math.isfinite(f.centre_error)])
    true = sum(int(frame.required.sum()) for frame in frames)
    matched = len(errors)
    estimates = matched + sum(len(frame.false) for frame in frames)
    return {
        "frames": len(frames),
        "people": {
            "true": true,
            "estimates": estimates,
            "matched": matched,
            "recall": ratio(matched, true),
            "precision": ratio(matched, estimates),
            "error_m": {
                "mean": _of(np.mean, errors),
                "median": _of(np.median, errors),
                "p95": percentile(errors, 95),
                "max": _of(np.max, errors),
            },
            # NaN, no covariance, compares false: such an ellipse contains nothing.
            "coverage_95": ratio(int((squares <= CHI2_95).sum()), matched),
        },
        "group": {
            "centre_error_m": {"mean": _of(np.mean, centres), "p95": percentile(centres, 95)}
        },
    }


def nothing() -> Float:
    """No values yet."""
    return np.empty(0)


def sums_of(one: Any, two: Any) -> dict[str, Any]:
    """Two scores of one dataclass added up, field by field; lists one after the other."""
    sums: dict[str, Any] = {}
    for name in (f.name for f in fields(one)):
        mine, other = getattr(one, name), getattr(two, name)
        sums[name] = np.concatenate([mine, other]) if isinstance(mine, np.ndarray) else mine + other
    return sums


def ratio(part: float, whole: float) -> float | None:
    """Part of a whole; None if there is no whole."""
    return part / whole if whole else None


def percentile(values: Sequence[float] | Float, percent: float) -> float | None:
    """A percentile, linear between the values; None if there are none."""
    return float(np.percentile(values, percent)) if len(values) else None


def _of(function: Any, values: Float) -> float | None:
    return float(function(values)) if len(values) else None

"""Scoring what was found against the ground truth.

The rules, in one place:

- A frame is a ground-truth message. The estimate nearest in time counts for it, if it is no farther
  away than half an interval; it is compared with the truth at the estimate's own stamp.
- An interval is the median time between consecutive estimates (`interval_of`): when the planner
  skips one, the truth of that time is missed; when its rate changes, what is slower than usual is.
- Found and true people match within `MATCH_DISTANCE`, one to one, optimally.
- Truth without an estimate is missed. Everybody in the truth counts, except people that no robot
  sees: they are not required, and an estimate that fits one of them (and nobody who is required)
  counts neither as found nor as false.
- Who is hidden (`Estimate.hidden`) is not compared: only the group's centre counts with them.
- Where the truth has a distance for it (`Truth.ignore_within`), an estimate that fits nobody is
  ignored, too, if somebody who is not required is nearer than that.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, fields
from typing import Any

import numpy as np
from scipy.optimize import linear_sum_assignment

from mrs_people_loc.arrays import Bool, Float, Int
from mrs_tools.bags.records import Estimate, Truth

#: A found and a true person match when they are within this distance [m].
MATCH_DISTANCE = 0.40
#: Chi-square with 2 degrees of freedom: the squared Mahalanobis radius of the 95 % ellipse.
CHI2_95 = 5.991
#: Shares of people that are visible, which are scored by themselves: from, and below.
VISIBILITY = {
    "below_0_50": (-math.inf, 0.5),
    "0_50_to_0_75": (0.5, 0.75),
    "from_0_75": (0.75, math.inf),
}
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
class Frame:
    """How one ground-truth message was met.

    Attributes:
        stamp_ns: Stamp of the message [ns].
        estimate: Index of the estimate that counts; None: there is none near enough.
        true: The positions that it was compared with [m], shape (m, 2); NaN: not there.
        required: Who has to be found, shape (m,).
        shares: How much of each is visible, shape (m,); NaN: the truth does not say.
        pairs: Indices of matched people in the estimate and in `true`, shape (k, 2).
        errors: Their distances [m], shape (k,).
        mahalanobis: Their squared distances in terms of the covariance, shape (k,); NaN: the
            covariance is none.
        ignored: Indices in the estimate of those that fit somebody who is not required.
        beside: Indices in the estimate of those that fit nobody, but are ignored because somebody
            who is not required is nearer than `Truth.ignore_within`.
        false: Indices in the estimate of those that fit nobody.
        counted: Who is required, or was found all the same, shape (m,).
        centre_error: Distance from `centre` to that of those who are counted [m]; NaN: there is no
            group.
    """

    stamp_ns: int
    estimate: int | None
    true: Float
    required: Bool
    shares: Float
    pairs: Int
    errors: Float
    mahalanobis: Float
    ignored: Int
    beside: Int
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
        shares=truth.shares_at(stamp_ns),
        pairs=np.empty((0, 2), dtype=np.intp),
        errors=np.empty(0),
        mahalanobis=np.empty(0),
        ignored=none,
        beside=none,
        false=none,
        counted=required,
        centre_error=math.nan,
    )


def _compare(index: int, estimate: Estimate, truth: Truth, distance: float) -> Frame:
    true, visible = truth.at(estimate.stamp_ns)
    required = np.isfinite(true).all(axis=1) & visible
    found = estimate.positions
    optional = np.where(required[:, np.newaxis], np.nan, true)
    # First those who have to be found; what is left may still be somebody that no robot sees.
    shown = np.flatnonzero(~estimate.hidden)
    one, other, errors = match(
        found[shown], np.where(required[:, np.newaxis], true, np.nan), distance=distance
    )
    one = shown[one]
    left = np.setdiff1d(shown, one)
    excused, _, _ = match(found[left], optional, distance=distance)
    everybody_left = np.setdiff1d(np.arange(len(found)), one)
    _, unasked, _ = match(found[everybody_left], optional, distance=distance)
    ignored = left[excused]
    false = np.setdiff1d(left, ignored)
    away = np.linalg.norm(found[false][:, np.newaxis] - optional[np.newaxis], axis=2)
    near = (away < truth.ignore_within).any(axis=1)  # NaN compares false
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
        shares=truth.shares_at(estimate.stamp_ns),
        pairs=np.stack([one, other], axis=1),
        errors=errors,
        mahalanobis=_mahalanobis(found[one] - true[other], estimate.covariances[one]),
        ignored=ignored,
        beside=false[near],
        false=false[~near],
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
            "frames_without_false": sum(not len(frame.false) for frame in frames),
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


def recall_by_visibility(frames: Sequence[Frame]) -> dict[str, dict[str, Any]]:
    """Of some frames, who was found of those of whom so much is visible.

    Returns:
        `people.by_visibility` as in the JSON of `mrs evaluate`.
    """
    shares = np.concatenate([nothing(), *(frame.shares[frame.required] for frame in frames)])
    found = [frame.shares[frame.pairs[:, 1]] for frame in frames]
    of_found = np.concatenate([nothing(), *found])
    report = {}
    for name, (low, high) in VISIBILITY.items():
        true, matched = (int(((low <= of) & (of < high)).sum()) for of in (shares, of_found))
        report[name] = {"true": true, "matched": matched, "recall": ratio(matched, true)}
    return report


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

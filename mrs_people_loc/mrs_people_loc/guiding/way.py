"""Places along a way."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from mrs_people_loc.arrays import Float, Int
from mrs_people_loc.errors import ConfigError


@dataclass(frozen=True)
class WayTuning:
    """How finely a way is kept; chosen.

    Attributes:
        extra: Extension straight on at both ends [m].
        grain: Distance of the points that are kept [m].
        fine: Distance of the points whose mean rounds a corner [m].
        shortest: Shortest way [m].
        ends: Its extensions go on in the direction of so many grains.
        order: Of parts that are as near as each other the first one counts: each grain later costs
            this share of a grain.
    """

    extra: float = 8.0
    grain: float = 0.05
    fine: float = 0.02
    shortest: float = 0.5
    ends: int = 3
    order: float = 1e-3


WAY_TUNING = WayTuning()


class Way:
    """A way with rounded corners, extended straight on at both ends.

    Attributes:
        length: From its first point to its last one, its corners rounded [m].

    Args:
        points: In the common frame [m], two at least, shape (n, 2).
        rounding: Corners are rounded over this length of the way [m]; a right angle is cut by
            0.18 of it.
        tuning: Constants.

    Raises:
        ConfigError: There is no way through the points.
    """

    def __init__(
        self, points: ArrayLike, *, rounding: float = 2.0, tuning: WayTuning = WAY_TUNING
    ) -> None:
        self._tuning = tuning
        given = np.asarray(points, dtype=np.float64)
        if given.ndim != 2 or given.shape[1:] != (2,) or not np.isfinite(given).all():
            raise ConfigError(f"points of a way: shape {given.shape}; wanted: finite, (n, 2)")
        dense = _rounded(given, rounding, tuning.fine)
        ways = _lengths(dense)
        self.length = float(ways[-1])
        if self.length < tuning.shortest:
            raise ConfigError(f"the way is {self.length:.2f} m long; wanted: {tuning.shortest:g} m")
        at = np.arange(0.0, self.length, tuning.grain)
        middle = np.stack([np.interp(at, ways, dense[:, k]) for k in (0, 1)], axis=1)
        more = tuning.grain * np.arange(1, round(tuning.extra / tuning.grain) + 1)[:, np.newaxis]
        first, last = middle[tuning.ends] - middle[0], middle[-1] - middle[-1 - tuning.ends]
        first, last = first / np.linalg.norm(first), last / np.linalg.norm(last)
        before, after = (middle[0] - more * first)[::-1], middle[-1] + more * last
        self._points: Float = np.concatenate([before, middle, after])
        slope = np.gradient(self._points, axis=0)
        self._ahead = slope / np.maximum(np.linalg.norm(slope, axis=1, keepdims=True), 1e-9)

    def at(self, way: Float | float, left: Float | float = 0.0) -> Float:
        """Places.

        Args:
            way: How far along the way [m], shape (...); before 0 and after `length` it goes
                straight on for 8 m.
            left: How far to the left of it [m], shape (...).

        Returns:
            In the common frame [m], shape (..., 2).
        """
        row = self._row(way)
        low = row.astype(np.intp)
        part = (row - low)[..., np.newaxis]
        middle = self._points[low] * (1 - part) + self._points[low + 1] * part
        ahead = self.ahead(way)
        aside = np.stack([-ahead[..., 1], ahead[..., 0]], axis=-1)
        return np.asarray(middle + np.asarray(left)[..., np.newaxis] * aside)

    def ahead(self, way: Float | float) -> Float:
        """Unit vectors along it.

        Args:
            way: How far along the way [m], shape (...).

        Returns:
            In the common frame, shape (..., 2).
        """
        return np.asarray(self._ahead[np.rint(self._row(way)).astype(np.intp)])

    def nearest(self, xy: Float, around: Float | float | None = None, reach: float = 1.0) -> Float:
        """How far along the way it is nearest to places.

        Args:
            xy: Places in the common frame [m], shape (n, 2).
            around: Only lengths within `reach` of these count [m], shape (n,) or one for all, so
                that places stay on their part of a way that comes back; None: the whole way, and
                the first of several parts that are as near.
            reach: [m].

        Returns:
            [m], less than 0 before the way and more than `length` after it, shape (n,).
        """
        grain, extra = self._tuning.grain, self._tuning.extra
        if around is None:
            away = np.linalg.norm(self._points[np.newaxis] - xy[:, np.newaxis], axis=2)
            away += self._tuning.order * grain * np.arange(len(self._points))
            return np.asarray(away.argmin(axis=1) * grain - extra)
        most = round(min(reach / grain, len(self._points)))
        steps: Int = np.arange(-most, most + 1)
        middle = np.rint(self._row(np.reshape(around, (-1, 1)))).astype(np.intp)
        rows = np.clip(middle + steps, 0, len(self._points) - 1)  # one for all, or one for each
        points = self._points[rows] - self._points[rows[:, :1]]
        along = (points @ (xy - self._points[rows[:, 0]])[..., np.newaxis])[..., 0]
        # Half the square of the distance, but for what is the same for all of a place's points.
        nearest = (0.5 * (points**2).sum(axis=2) - along).argmin(axis=1)
        best = np.broadcast_to(rows, along.shape)[np.arange(len(xy)), nearest]
        # Between the points: how far along the way the place is from the nearest one.
        rest = ((xy - self._points[best]) * self._ahead[best]).sum(axis=1)
        return np.asarray(best * grain - extra + np.clip(rest, -grain, grain))

    def _row(self, way: Float | float) -> Float:
        row = (np.asarray(way) + self._tuning.extra) / self._tuning.grain
        return np.asarray(np.clip(row, 0.0, len(self._points) - 1.001))


def _lengths(points: Float) -> Float:
    """Length of a polyline up to each of its points [m], shape (n,)."""
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    return np.concatenate([[0.0], np.cumsum(steps)])


def _rounded(points: Float, rounding: float, fine: float) -> Float:
    """The polyline, its corners rounded by a moving mean that keeps its ends.

    The mean is over half of the way at most.
    """
    ways = _lengths(points)
    half = round(0.5 * min(rounding, 0.5 * float(ways[-1])) / fine)
    if len(points) < 3 or half < 1:
        return points
    at = np.linspace(0.0, ways[-1], round(float(ways[-1]) / fine) + 1)
    dense = np.stack([np.interp(at, ways, points[:, k]) for k in (0, 1)], axis=1)
    padded = np.pad(dense, ((half, half), (0, 0)), mode="reflect", reflect_type="odd")
    mean = np.full(2 * half + 1, 1.0 / (2 * half + 1))
    return np.stack([np.convolve(padded[:, k], mean, mode="valid") for k in (0, 1)], axis=1)

"""How what a sensor sees moves: who walks towards a robot is nearer than it seems."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Bool, Float, Int
from mrs_people_loc.guiding.obstacles import SECTORS, ObstacleScan


@dataclass(frozen=True)
class ObstacleMotionTuning:
    """Constants of `ObstacleMotion`, chosen by hand.

    Attributes:
        sectors: Obstacles in neighbouring sectors, up to so many further ones, ...
        apart: ... and no farther apart than this [m], are one thing.
        least: A thing that has less points does not move,
        widest: ... nor does one that is wider than this [m].
        same: It is the same as one that was so near at the time before [m] ...
        fastest: ... plus the way at this speed [m/s].
        views: It is followed over so many scans at most, ...
        longest: ... for so long at most [s].
        least_s: It has a velocity after so long [s], ...
        slowest: ... if that is more than this [m/s], ...
        most: ... and counts as no faster than this [m/s].
    """

    sectors: int = 2
    apart: float = 0.3
    least: int = 3
    widest: float = 1.0
    same: float = 0.2
    fastest: float = 1.5
    views: int = 6
    longest: float = 0.6
    least_s: float = 0.25
    slowest: float = 0.3
    most: float = 2.0


OBSTACLE_MOTION_TUNING = ObstacleMotionTuning()


class ObstacleMotion:
    """Follows things through the scans of one sensor.

    Args:
        tuning: Constants.
    """

    def __init__(self, tuning: ObstacleMotionTuning = OBSTACLE_MOTION_TUNING) -> None:
        self._tuning = tuning
        # Times [s] and middles [m] of things, the last one last, shape (things, views, 3).
        self._things: Float = np.full((0, tuning.views, 3), np.nan)

    def __call__(self, scan: ObstacleScan, points: Float, sensor: Float, seen_s: float) -> Float:
        """Velocities of the obstacles of a scan [m/s], shape (n, 2); 0 where none is known.

        Args:
            scan: The scan.
            points: Its obstacles in a frame that does not move [m], shape (n, 2).
            sensor: Where it was made, in that frame [m], shape (2,).
            seen_s: When [s].
        """
        tuning, velocities = self._tuning, np.zeros_like(points)
        order, thing = self._things_of(scan, points)
        count = int(thing.max(initial=-1)) + 1
        sizes = np.bincount(thing, minlength=count)
        middles = _means(points[order], thing, sizes)
        ends = np.cumsum(sizes)
        wide = np.hypot(*(points[order[ends - 1]] - points[order[ends - sizes]]).T)
        kept = (sizes >= tuning.least) & (wide <= tuning.widest)
        followed = self._follow(middles[kept], seen_s)
        found = self._velocities(followed, seen_s)
        # What is cut off by the border of the view shows only how it comes nearer.
        cut = _means(_is_border(scan)[_hit(scan)][order].astype(float), thing, sizes) > 0.0
        ahead = middles[kept] - sensor
        ahead /= np.maximum(np.hypot(*ahead.T), 1e-9)[:, np.newaxis]
        along = (found * ahead).sum(axis=1, keepdims=True) * ahead
        of_things = np.zeros((count, 2))
        of_things[kept] = np.where(cut[kept, np.newaxis], along, found)
        velocities[order] = of_things[thing]
        return velocities

    def _things_of(self, scan: ObstacleScan, points: Float) -> tuple[Int, Int]:
        """The obstacles in the order of sectors, from a free one on, and which thing each is."""
        sectors = np.flatnonzero(_hit(scan))
        free = np.flatnonzero(~_hit(scan))
        first = int(free[0]) if len(free) else 0
        order = np.argsort((sectors - first) % SECTORS, kind="stable")
        sector, xy = ((sectors - first) % SECTORS)[order], points[order]
        breaks = np.diff(sector) > self._tuning.sectors + 1
        breaks |= np.hypot(*np.diff(xy, axis=0).T) > self._tuning.apart
        thing = np.concatenate([[0], np.cumsum(breaks)]) if len(order) else np.empty(0, np.intp)
        return order, np.asarray(thing, dtype=np.intp)

    def _follow(self, middles: Float, seen_s: float) -> Float:
        """The things of now with their past, as `_things`."""
        tuning, before = self._tuning, self._things
        now = np.column_stack([np.full(len(middles), seen_s), middles])
        past = np.full((len(middles), tuning.views - 1, 3), np.nan)
        if len(before) and len(middles):
            away = np.hypot(*(middles[:, np.newaxis] - before[:, -1, 1:]).transpose(2, 0, 1))
            nearest = away.argmin(axis=1)
            rows = np.arange(len(middles))
            reach = tuning.same + tuning.fastest * (seen_s - before[nearest, -1, 0])
            same = (away.argmin(axis=0)[nearest] == rows) & (away[rows, nearest] <= reach)
            past[same] = before[nearest[same], 1:]
            past[past[:, :, 0] < seen_s - tuning.longest] = np.nan
        self._things = np.concatenate([past, now[:, np.newaxis]], axis=1)
        return self._things

    def _velocities(self, things: Float, seen_s: float) -> Float:
        """From where they were first to where they are now [m/s], shape (things, 2)."""
        tuning, rows = self._tuning, np.arange(len(things))
        first = things[rows, np.isfinite(things[:, :, 0]).argmax(axis=1)]
        lasted = seen_s - first[:, 0]
        moved = (things[:, -1, 1:] - first[:, 1:]) / np.maximum(lasted, 1e-9)[:, np.newaxis]
        speed = np.hypot(*moved.T)
        known = (lasted >= tuning.least_s) & (speed >= tuning.slowest)
        share = np.where(known, np.minimum(tuning.most / np.maximum(speed, 1e-9), 1.0), 0.0)
        return np.asarray(moved * share[:, np.newaxis])


def _hit(scan: ObstacleScan) -> Bool:
    return np.isfinite(scan.ranges)


def _is_border(scan: ObstacleScan) -> Bool:
    """Sectors at an end of the field of view."""
    looks = scan.looks
    return np.asarray(looks & ~(np.roll(looks, 1) & np.roll(looks, -1)))


def _means(values: Float, thing: Int, sizes: Int) -> Float:
    """Means of the values of each thing."""
    columns = np.atleast_2d(values.T)
    sums = [np.bincount(thing, weights=column, minlength=len(sizes)) for column in columns]
    means = np.stack(sums, axis=1) / np.maximum(sizes, 1)[:, np.newaxis]
    return np.asarray(means if values.ndim > 1 else means[:, 0])

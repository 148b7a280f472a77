"""What a robot's sensors see around it, by bearing: what `collision_monitor` goes by.

A laser scan, the cone of a sonar and the disparity image of a head all become an `ObstacleScan`:
the range to the nearest obstacle in each sector of the full turn about the sensor.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Bool, Float, Float32, Int
from mrs_people_loc.config import CollisionMonitoring
from mrs_people_loc.localization.walls.ranges import LaserScan, SonarRange
from mrs_people_loc.sensing.camera import StereoCamera

#: Sectors of a full turn; the first begins at -pi.
SECTORS = 180
_WIDTH = 2.0 * math.pi / SECTORS
#: The middles of the sectors [rad], shape (SECTORS,).
BEARINGS: Float = np.asarray(_WIDTH * (np.arange(SECTORS, dtype=np.float64) + 0.5) - math.pi)


@dataclass(frozen=True)
class ObstacleTuning:
    """Constants of obstacle scans, chosen by hand.

    Attributes:
        reach: Obstacles are looked for up to so far from a sensor [m].
        across: Of the pixels of a view so many columns are looked at, and rows as near together.
        level: Pixels whose ray's horizontal part is less than this share of it are left out.
        support: So many pixels of a sector make an obstacle, in their middle: matching errs in
            single ones, which are at all ranges, ...
        depth: ... if the last is farther away than the first by no more than this share.
        seen: A head sees a sector where this share of its pixels has a disparity.
        pings: An echo of a sonar counts for so many of its ranges, for cloth is missed at times ...
        confirms: ... if another one of these is as long within this [m]; that of another sonar is
            not; ...
        lobes: ... it may come from so many times as wide a cone.
    """

    reach: float = 3.0
    across: int = 80
    level: float = 0.35
    support: int = 14
    depth: float = 0.1
    seen: float = 0.4
    pings: int = 5
    confirms: float = 0.25
    lobes: float = 1.5


OBSTACLE_TUNING = ObstacleTuning()


@dataclass(frozen=True)
class ObstacleScan:
    """What a sensor sees at one time.

    Attributes:
        x: Where it is in base_link [m].
        y: Likewise [m].
        ranges: From there to the nearest obstacle in each sector [m], shape (SECTORS,); inf: none
            is known.
        seen: The sectors in which there is nothing nearer than that, shape (SECTORS,).
        looks: The sectors of its field of view, shape (SECTORS,).
        reach: How far it sees [m].
    """

    x: float
    y: float
    ranges: Float
    seen: Bool
    looks: Bool
    reach: float

    @property
    def places(self) -> Float:
        """Where obstacles are in base_link [m], shape (n, 2)."""
        hit = np.isfinite(self.ranges)
        ranges, bearings = self.ranges[hit], BEARINGS[hit]
        along = np.stack([np.cos(bearings), np.sin(bearings)], axis=1)
        return np.asarray([self.x, self.y] + ranges[:, np.newaxis] * along)

    def sectors_of(self, xy: Float) -> tuple[Int, Float]:
        """The sectors and the ranges [m] of places in base_link, shape (n, 2)."""
        x, y = xy[:, 0] - self.x, xy[:, 1] - self.y
        return sectors_at(np.arctan2(y, x)), np.hypot(x, y)


def sectors_at(bearings: Float) -> Int:
    """The sectors of bearings [rad]."""
    return np.asarray(np.floor((bearings + math.pi) / _WIDTH), dtype=np.intp) % SECTORS


def obstacles_of_laser(
    scan: LaserScan, mounting: tuple[float, float, float], tuning: ObstacleTuning = OBSTACLE_TUNING
) -> ObstacleScan:
    """What a laser scanner sees.

    Args:
        scan: Its scan.
        mounting: Where it is in base_link: x, y [m], yaw [rad].
        tuning: Constants.
    """
    x, y, yaw = mounting
    sectors, reach = sectors_at(scan.angles + yaw), min(scan.max_range, tuning.reach)
    too_near, measured = scan.ranges == -np.inf, ~np.isnan(scan.ranges)
    ranges = np.where(too_near, scan.min_range, scan.ranges)
    ranges = np.where(ranges > reach, np.inf, ranges)
    nearest, looks = np.full(SECTORS, np.inf), np.zeros(SECTORS, dtype=bool)
    np.minimum.at(nearest, sectors[measured], ranges[measured])
    looks[sectors] = True
    seen = np.zeros(SECTORS, dtype=bool)
    seen[sectors[measured]] = True
    return ObstacleScan(x, y, nearest, seen, looks, reach)


class SonarObstacles:
    """What a sonar sees, by its last ranges.

    Args:
        tuning: Constants.
    """

    def __init__(self, tuning: ObstacleTuning = OBSTACLE_TUNING) -> None:
        self._tuning = tuning
        self._last: deque[tuple[int, float]] = deque(maxlen=tuning.pings)

    def __call__(
        self, measured: SonarRange, mounting: tuple[float, float, float]
    ) -> tuple[ObstacleScan, float]:
        """What it sees after a further range, and how much older than that this is [s].

        Args:
            measured: The range; less than what it measures: something is there.
            mounting: Where it is in base_link: x, y [m], yaw of its axis [rad].
        """
        x, y, yaw = mounting
        reach = min(measured.max_range, self._tuning.reach)
        nearest, stamp_ns = measured.range, measured.stamp_ns
        if nearest < measured.min_range:  # REP 117: -inf is too near to be measured
            nearest = max(nearest, 0.0)
        elif nearest > reach:
            nearest = math.inf
        self._last.append((stamp_ns, nearest))
        ranges, looks = np.full(SECTORS, np.inf), np.zeros(SECTORS, dtype=bool)
        off = np.abs((BEARINGS - yaw + math.pi) % (2.0 * math.pi) - math.pi)
        looks[off <= 0.5 * measured.field_of_view] = True
        echo_ns, nearest = self._confirmed(stamp_ns)
        ranges[off <= 0.5 * self._tuning.lobes * measured.field_of_view] = nearest
        seen = looks & (not math.isnan(measured.range))
        return ObstacleScan(x, y, ranges, seen, looks, reach), max(stamp_ns - echo_ns, 0) / 1e9

    def _confirmed(self, stamp_ns: int) -> tuple[int, float]:
        """The last echo that another one confirms, and its stamp; inf: there is none."""
        stamps, ranges = zip(*reversed(self._last), strict=True)
        for k, nearest in enumerate(ranges):
            others = ranges[:k] + ranges[k + 1 :]
            if any(abs(one - nearest) <= self._tuning.confirms for one in others):
                return stamps[k], nearest
        return stamp_ns, math.inf


class HeadObstacles:
    """What a head sees: its disparities as a scan, as depthimage_to_laserscan makes one.

    Args:
        camera: The head.
        config: Says at which heights something is an obstacle.
        nearest: Least depth that is matched [m].
        tuning: Constants.

    Attributes:
        camera: The head.
        config: As above.
    """

    def __init__(
        self,
        camera: StereoCamera,
        config: CollisionMonitoring,
        *,
        nearest: float,
        tuning: ObstacleTuning = OBSTACLE_TUNING,
    ) -> None:
        self.camera, self.config, self._tuning = camera, config, tuning
        self._most = np.float32(camera.depth_disparity / nearest)
        rotation, place = camera.robot_from_optical
        step = max(round(camera.width / tuning.across), 1)
        u, v = np.arange(0, camera.width, step), np.arange(0, camera.height, step)
        uv = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
        slopes = (uv - [camera.cx, camera.cy]) / [camera.fx, camera.fy]
        rays = np.column_stack([slopes, np.ones(len(uv))]) @ rotation.T
        level = np.hypot(rays[:, 0], rays[:, 1])
        kept = level > tuning.level * np.linalg.norm(rays, axis=1)
        rays, uv, level = rays[kept], uv[kept], level[kept]
        table = _table(sectors_at(np.arctan2(rays[:, 1], rays[:, 0])), tuning.support)
        self._pixel = uv[:, 1] * camera.width + uv[:, 0]
        # Divided by a disparity [px] these are metres.
        self._out = (camera.depth_disparity * level).astype(np.float32)
        self._up = (camera.depth_disparity * rays[:, 2]).astype(np.float32)
        self._sectors, self._table, self._counts = table
        self._x, self._y, self._z = (float(one) for one in place)

    def __call__(self, disparity: Float32) -> ObstacleScan:
        """What it sees in a view.

        Args:
            disparity: [px], shape (height, width), NaN where there is none.
        """
        config, tuning = self.config, self._tuning
        found = disparity.reshape(-1)[self._pixel] - np.float32(self.camera.disparity_offset_px)
        there = (found > 0.0) & (found <= self._most)  # NaN compares false
        inverse = np.float32(1.0) / np.where(there, found, np.float32(1.0))
        ranges, z = self._out * inverse, self._up * inverse + np.float32(self._z)
        is_obstacle = there & (z >= config.min_height) & (z <= config.max_height)
        is_obstacle &= ranges <= tuning.reach
        # One more, for where a sector has less pixels than others.
        ranges = np.append(np.where(is_obstacle, ranges, np.inf), np.inf)
        near = np.sort(ranges[self._table], axis=1)
        last = near[:, tuning.support - 1 :]
        near = near[:, : last.shape[1]]
        together = np.isfinite(last) & (last <= np.float32(1.0 + tuning.depth) * near)
        nearest = np.where(together, np.float32(0.5) * (near + last), np.inf).min(axis=1)
        share = np.append(there, False)[self._table].sum(axis=1) / self._counts
        said, seen, looks = np.full(SECTORS, np.inf), *np.zeros((2, SECTORS), dtype=bool)
        said[self._sectors], looks[self._sectors] = nearest, True
        seen[self._sectors] = share >= tuning.seen
        return ObstacleScan(self._x, self._y, said, seen, looks, tuning.reach)


def _table(sector: Int, support: int) -> tuple[Int, Int, Int]:
    """Which pixels are in which sector.

    Args:
        sector: Of each pixel, shape (n,).
        support: Sectors with less pixels than twice this are left out.

    Returns:
        The sectors, shape (s,); the indices of their pixels, n where a sector has no more,
        shape (s, most); how many they are, shape (s,).
    """
    counts = np.bincount(sector, minlength=SECTORS)
    sectors = np.flatnonzero(counts >= 2 * support)
    order, begins = np.argsort(sector, kind="stable"), np.cumsum(counts) - counts
    most = int(counts.max(initial=support))  # a head that looks straight down has no sector
    column = np.arange(most)
    index = begins[sectors, np.newaxis] + column
    inside = column < counts[sectors, np.newaxis]
    table = np.where(inside, order[np.minimum(index, len(sector) - 1)], len(sector))
    return sectors, table, counts[sectors]

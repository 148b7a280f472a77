"""Walls in the disparity images of a head.

A plane is a plane in disparity space, too: with m the plane's normal in base_link over its distance
from the lens, and r a pixel's ray per metre of depth, the disparity is linear in m and its noise is
the same everywhere,

    d = f B (m . r),

and a vertical plane has no third component of m. Divided by the length of the horizontal part of r
this is the inverse range along a bearing b, (f B / distance) cos(b - bearing): a histogram over
both, as that of `bodies.search`, holds metres of vertical extent. Its peaks are points on such
curves. The curve with most metres of wall on it is refined by least squares of the pixels.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import cv2
import numpy as np

from mrs_people_loc.arrays import Bool, Float, Float32, Int, StructOfArrays
from mrs_people_loc.localization.walls import SeenWalls
from mrs_people_loc.localization.walls.fit import Line, meeting, walls_of
from mrs_people_loc.neighbours import each_pair
from mrs_people_loc.precision import PIXEL_SIGMA_PX
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.disparity import SUBPIXELS


@dataclass(frozen=True)
class StereoWallTuning:
    """Constants of `StereoWalls`, chosen by hand.

    Attributes:
        across: Of the rows and columns of pixels each one of so many is used that about this many
            columns are left: matching errs alike in neighbours.
        max_range: A wall is used up to this range [m],
        least_px: and where its disparity is larger [px]: what is far is drawn to what is near.
        lowest: Pixels lower over the floor are not used [m],
        min_level: nor those whose ray's horizontal part is shorter, per metre of depth.
        columns: Bins of bearing over the view.
        bin_px: Width of a bin of inverse range [px].
        rows: Number of these bins.
        peaks: So many peaks of each column are points ...
        min_peak: ... if they have this vertical extent [m];
        tall: more than this does not count more [m].
        min_apart: Lines are drawn through two points that are so many columns apart at least,
        max_apart: and at most.
        max_lines: So many lines are tried.
        tolerances_px: Pixels of a plane are no farther from it, ever less while it is refined [px].
        before_px: Pixels with so much more disparity than a plane are before it [px], and draw
            those to them that are within half a block of matching,
        block_px: that is so far [px].
        behind_px: Pixels with so much less disparity than the plane are seen through it [px].
        min_height: A column belongs to a wall that is seen over this height [m],
        min_part: or over this part of the height that the image shows of it ...
        least_height: ... and of this height at least [m],
        max_behind: if it is seen through over less than this part of that height.
        min_pixels: A wall has so many of the pixels at least,
        min_columns: so many columns,
        min_length: is so long [m],
        max_gap: and no more of it is hidden in one place [m].
        max_rough_px: It is flat within this: root mean square of the columns' mean residuals, by
            their pixels [px];
        rough_px: what is rougher than this is less sure in proportion [px].
        max_tilt: It is upright within this angle [rad].
        max_count: So many walls at most,
        max_tries: found in so many tries.
        body: Half the width of what is left out at a person or a team-mate [m],
        body_depth: and how far behind them [m].
        sigma_tilt: Standard deviation of the mounting's pitch and roll [rad],
        sigma_yaw: and of its yaw [rad].
        offset_px: What rectification and matching err by in common, standard deviation [px],
        across_px: and of a slope, from the image's middle to its border, across [px],
        down_px: and down [px].
        tile_px: Errors of matching are alike within a tile of this side [px].
        max_sigma: Walls whose bearing is less sure are not reported [rad].
        rounded_px: StereoBM rounds up to the next sixteenth, so by half of it on average [px].
        least_variance: Of the third component of a plane, so that it has an inverse [1 / m^2].
        nearest: Prior distance of a wall from the lens, one standard deviation [m].
        behind: Pixels of less than this part of the least inverse range of a wall are behind it.
        open: A wall ends where so many columns beside it are open.
    """

    across: int = 53
    max_range: float = 6.0
    least_px: float = 2.0
    lowest: float = 0.3
    min_level: float = 0.35
    columns: int = 48
    bin_px: float = 0.5
    rows: int = 96
    peaks: int = 3
    min_peak: float = 0.4
    tall: float = 1.5
    min_apart: int = 5
    max_apart: int = 24
    max_lines: int = 250
    tolerances_px: tuple[float, ...] = (0.6, 0.4)
    before_px: float = 0.6
    block_px: int = 6
    behind_px: float = 0.8
    min_height: float = 1.0
    min_part: float = 0.7
    least_height: float = 0.4
    max_behind: float = 0.3
    min_pixels: int = 30
    min_columns: int = 7
    min_length: float = 0.8
    max_gap: float = 0.8
    max_rough_px: float = 0.075
    rough_px: float = 0.04
    max_tilt: float = 0.12
    max_count: int = 4
    max_tries: int = 5
    body: float = 0.4
    body_depth: float = 0.5
    sigma_tilt: float = 0.01
    sigma_yaw: float = 0.005
    offset_px: float = 0.06
    across_px: float = 0.04
    down_px: float = 0.08
    tile_px: int = 5
    max_sigma: float = 0.05
    rounded_px: float = 0.5 / SUBPIXELS
    least_variance: float = 1e-12
    nearest: float = 0.1
    behind: float = 0.5
    open: int = 3


STEREO_WALL_TUNING = StereoWallTuning()


@dataclass(frozen=True)
class _Pixels(StructOfArrays):
    """Pixels of a head, or those of a view.

    Attributes:
        ray: f B times the ray in base_link per metre of depth, float32 [px m], shape (n, 3).
        level: Length of the ray's horizontal part per metre of depth, float32.
        slope: Its vertical part per metre of range, float32.
        bearing: From the image's middle [rad], float32.
        column: Bin of bearing.
        weight: Metres of vertical extent in its column that it covers at 1 m, float32.
    """

    ray: Float32
    level: Float32
    slope: Float32
    bearing: Float32
    column: Int
    weight: Float32


@dataclass(frozen=True)
class _Surface(StructOfArrays):
    """Pixels of a view that may be on walls.

    Attributes:
        pixel: Index in `_Pixels`.
        ray: As there.
        column: As there.
        disparity: Without the offset, float32 [px].
        inverse: f B over the horizontal range, float32 [px].
        height: Metres of vertical extent that it covers in its column, float32.
    """

    pixel: Int
    ray: Float32
    column: Int
    disparity: Float32
    inverse: Float32
    height: Float32


@dataclass(frozen=True)
class _Peaks(StructOfArrays):
    """Peaks of the histogram: column, inverse range [px] and weight [m^2 of wall]."""

    column: Int
    inverse: Float
    weight: Float


class StereoWalls:
    """Finds flat vertical walls in disparity images of one head.

    Whether a wall moves one view does not tell; the localizer refuses what does not stay.

    Args:
        camera: The head.
        tuning: Its constants.
    """

    def __init__(self, camera: StereoCamera, tuning: StereoWallTuning = STEREO_WALL_TUNING) -> None:
        self.camera = camera
        self._tuning = tuning
        self._scale = camera.depth_disparity
        rotation, self._lens = camera.robot_from_optical
        self._stride = max(1, round(camera.width / tuning.across))
        every = slice(self._stride // 2, None, self._stride)
        self._every = every, every
        reach = 2 * (tuning.block_px // self._stride) + 1
        self._block = np.ones((reach, reach), dtype=np.uint8)
        u, v = np.meshgrid(np.arange(camera.width)[every], np.arange(camera.height)[every])
        optical = np.stack(
            [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)]
        )
        self._shape = u.shape
        rays = np.einsum("ij,jvu->ivu", rotation, optical)
        middle = rays[:, u.shape[0] // 2, u.shape[1] // 2]
        self._ahead = math.atan2(middle[1], middle[0])
        self._usable, self._pixels, low, self._step = _tables(
            rays, self._ahead, self._scale, tuning
        )
        self._bearing = self._ahead + low + (np.arange(tuning.columns) + 0.5) * self._step
        unit = np.stack([np.cos(self._bearing), np.sin(self._bearing)], axis=1)
        self._unit = self._scale * unit
        self._least = max(self._scale / tuning.max_range, tuning.least_px)
        self._top = np.full(tuning.columns, -np.inf)
        np.maximum.at(self._top, self._pixels.column, self._pixels.slope)
        reach = np.abs(optical[:2]).max(axis=(1, 2))
        errors = [tuning.across_px / reach[0], tuning.down_px / reach[1], tuning.offset_px]
        root = rotation @ np.diag(errors) / self._scale
        self._systematic: Float = (root @ root.T)[:2, :2]

    def step(self, disparity: Float32, stamp_ns: int, bodies: Float) -> SeenWalls:
        """The walls of one view.

        Args:
            disparity: [px], float32, shape (height, width), NaN where there is none.
            stamp_ns: Of the view [ns].
            bodies: Where people and team-mates are (`walls.NOBODY`), shape (m, 3): what is there is
                left out.
        """
        values = disparity[self._every].reshape(-1)[self._usable]
        values = values - np.float32(self.camera.disparity_offset_px + self._tuning.rounded_px)
        surface = self._surface(values, bodies)
        peaks = self._peaks(surface)
        planes, support = self._lines(peaks)
        left = np.ones(len(surface), dtype=np.bool_)
        weight = peaks.weight.astype(np.float32)
        found: list[Line] = []
        for _ in range(self._tuning.max_tries if len(planes) else 0):
            score = support @ weight
            best = int(score.argmax())
            if score[best] < self._tuning.min_peak * self._tuning.min_length:
                break
            plane, wall = self._wall(planes[best], values, surface, left)
            if wall is not None:
                found.append(wall)
            off = peaks.inverse - self._unit[peaks.column] @ plane[:2]
            weight[(np.abs(off) < self._tuning.tolerances_px[0]) | (support[best] > 0.0)] = 0.0
            if len(found) == self._tuning.max_count:
                break
        return SeenWalls(stamp_ns, meeting(walls_of(found, self._lens[0], self._lens[1])))

    def _surface(self, values: Float32, bodies: Float) -> _Surface:
        """The pixels within range, over the floor, and not at bodies."""
        tuning, pixels = self._tuning, self._pixels
        inverse = values / pixels.level
        # Not only what may be on a wall, but also what is behind. NaN compares false.
        used = inverse > np.float32(self._tuning.behind * self._least)
        # The height over the lens, times inverse range, so that nothing is divided by zero.
        lowest = np.float32((tuning.lowest - self._lens[2]) / self._scale)
        used &= pixels.slope > lowest * inverse
        if len(bodies):
            off, may_be_off = bodies[:, :2] - self._lens[:2], bodies[:, 2:].astype(np.float32)
            ranges = np.hypot(off[:, 0], off[:, 1])[:, np.newaxis].astype(np.float32)
            half = np.arctan2(tuning.body + may_be_off, ranges)
            aside = np.arctan2(off[:, 1], off[:, 0])[:, np.newaxis] - self._ahead
            aside = np.remainder(aside + np.pi, 2.0 * np.pi) - np.pi
            near = np.abs(pixels.bearing - aside.astype(np.float32)) < half
            near &= inverse > np.float32(self._scale) / (ranges + tuning.body_depth + may_be_off)
            used &= ~near.any(axis=0)
        index = np.flatnonzero(used)
        inverse = inverse[index]
        height = pixels.weight[index] * np.float32(self._scale) / inverse
        return _Surface(
            index, pixels.ray[index], pixels.column[index], values[index], inverse, height
        )

    def _peaks(self, surface: _Surface) -> _Peaks:
        """The bins of inverse range with most vertical extent in each column."""
        tuning, columns = self._tuning, self._tuning.columns
        shape = tuning.rows + 2, columns
        row = np.minimum(surface.inverse * (1.0 / tuning.bin_px), tuning.rows - 1).astype(np.intp)
        place = (row + 1) * columns + surface.column
        size = shape[0] * columns
        height = np.bincount(place, surface.height, minlength=size).reshape(shape)
        moment = np.bincount(place, surface.height * surface.inverse, minlength=size).reshape(shape)
        # Over three bins each; the rows at both ends are empty.
        height3 = height[:-2] + height[1:-1] + height[2:]
        left = height3.copy()
        column, beside = np.arange(columns), np.arange(-2, 3)[:, np.newaxis]
        at_rows, at_columns = [], []
        for _ in range(tuning.peaks):
            row = left.argmax(axis=0)
            high = left[row, column] > tuning.min_peak
            high &= (row + 0.5) * tuning.bin_px > self._least - tuning.tolerances_px[0]
            at_rows.append(row[high])
            at_columns.append(column[high])
            near = row + beside
            left[np.minimum(np.maximum(near, 0), tuning.rows - 1), column] = 0.0
        row, column = np.concatenate(at_rows), np.concatenate(at_columns)
        extent = height3[row, column]
        inverse = (moment[row, column] + moment[row + 1, column] + moment[row + 2, column]) / extent
        wide = self._scale / inverse * self._step
        return _Peaks(column, inverse, np.minimum(extent, tuning.tall) * wide)

    def _lines(self, peaks: _Peaks) -> tuple[Float, Float32]:
        """Vertical planes through two peaks, shape (k, 2), and how near which peaks are to them.

        The latter is 1 for a peak on the plane and 0 for one beyond the tolerance, shape (k, n).
        """
        tuning = self._tuning
        i, j = each_pair(len(peaks))
        apart = np.abs(peaks.column[i] - peaks.column[j])
        near = (apart >= tuning.min_apart) & (apart <= tuning.max_apart)
        chosen = np.flatnonzero(near)
        chosen = chosen[:: max(1, -(-len(chosen) // tuning.max_lines))]
        unit, inverse = self._unit[peaks.column], peaks.inverse
        (ix, iy), (jx, jy) = unit[i[chosen]].T, unit[j[chosen]].T
        di, dj = inverse[i[chosen]], inverse[j[chosen]]
        planes = np.stack([di * jy - dj * iy, dj * ix - di * jx], axis=1)
        planes /= (ix * jy - iy * jx)[:, np.newaxis]
        off = (planes.astype(np.float32) @ unit.T.astype(np.float32)) - inverse.astype(np.float32)
        off *= np.float32(1.0 / tuning.tolerances_px[0])
        return planes, np.maximum(np.float32(0.0), np.float32(1.0) - off * off)

    def _wall(
        self, plane: Float, values: Float32, surface: _Surface, left: Bool
    ) -> tuple[Float, Line | None]:
        """The wall near a vertical plane, and the plane; takes its pixels out of `left`."""
        tuning = self._tuning
        fit, free = np.append(plane, 0.0), left
        for tolerance in tuning.tolerances_px:
            off = surface.disparity - surface.ray @ fit.astype(np.float32)
            near = self._unit @ fit[:2] > self._least
            on = left & (np.abs(off) < tolerance) & near[surface.column]
            used = on & free
            if np.count_nonzero(used) < tuning.min_pixels:
                left &= ~on
                return fit, None
            fit, _ = self._least_squares(surface.ray[used], surface.disparity[used], fit)
            free = ~self._beside_nearer(fit, values)[surface.pixel]
        off = surface.disparity - surface.ray @ fit.astype(np.float32)
        on = left & (np.abs(off) < tuning.tolerances_px[-1])
        along, seen, is_end = self._seen(fit, surface, on, off < -tuning.behind_px)
        kept = on & free & seen[surface.column]
        left &= ~on
        places = along[seen]
        if len(places) < tuning.min_columns or np.ptp(places) < tuning.min_length:
            return fit, None
        if np.count_nonzero(kept) < tuning.min_pixels:
            return fit, None
        measured = self._measured(surface.select(kept), fit)
        if measured is None:
            return fit, None
        extent = float(places[0]), float(places[-1])
        return fit, Line(*measured, extent, is_end)

    def _beside_nearer(self, plane: Float, values: Float32) -> Bool:
        """Pixels that share a block of matching with something before the plane: drawn to it."""
        before = np.zeros(self._shape, dtype=np.uint8)
        off = values - self._pixels.ray @ plane.astype(np.float32)
        before.reshape(-1)[self._usable] = off > self._tuning.before_px
        cv2.dilate(before, self._block, dst=before)
        beside: Bool = before.reshape(-1)[self._usable] > 0
        return beside

    def _least_squares(self, ray: Float32, disparity: Float32, plane: Float) -> tuple[Float, Float]:
        """The plane that fits pixels best, and its covariance; upright as far as the head is."""
        tuning = self._tuning
        tiles = tuning.tile_px**2 / self._stride**2
        rays = ray.astype(np.float64)
        information = rays.T @ rays
        weight = 1.0 / (PIXEL_SIGMA_PX**2 * max(1.0, tiles))
        information *= weight
        upright = tuning.sigma_tilt**2 * float(plane[:2] @ plane[:2])
        # No wall is nearer than 10 cm; so the matrix has an inverse, whatever the rays are.
        upright = max(upright, self._tuning.least_variance)
        nearest = self._tuning.nearest**2
        information.flat[::4] += (nearest, nearest, 1.0 / upright)  # its diagonal
        covariance = np.asarray(np.linalg.inv(information), dtype=np.float64)
        plane = covariance @ (rays.T @ disparity.astype(np.float64)) * weight
        return plane, covariance

    def _seen(
        self, plane: Float, surface: _Surface, on: Bool, behind: Bool
    ) -> tuple[Float, Bool, tuple[bool, bool]]:
        """Where columns meet a plane, which of them show it as one wall, and if that ends there.

        The first are measured from the foot of the perpendicular [m].
        """
        tuning, columns = self._tuning, self._tuning.columns
        height = np.bincount(surface.column[on], surface.height[on], minlength=columns)
        inverse = np.maximum(self._unit @ plane[:2], self._tuning.behind * self._least)
        ranges = self._scale / inverse
        # Where the line of sight passes the plane.
        passed = surface.height[behind] * surface.inverse[behind]
        through = np.bincount(surface.column[behind], passed, minlength=columns) / inverse
        shown = self._top * ranges + self._lens[2] - tuning.lowest
        wanted = np.clip(tuning.min_part * shown, tuning.least_height, tuning.min_height)
        opaque = through < tuning.max_behind * height
        is_open = ~opaque & (through > tuning.least_height)
        seen = (height > wanted) & opaque & (inverse > self._least)
        along = ranges * np.sin(self._bearing - math.atan2(plane[1], plane[0]))
        index = np.flatnonzero(seen)
        if not len(index):
            return along, seen, (False, False)
        # A wall goes on behind what hides it, but not through two columns that are open.
        opened = np.cumsum(is_open)[index]
        cut = along[index[1:]] - along[index[:-1]] > tuning.max_gap
        cut |= opened[1:] - opened[:-1] > 1
        run = np.append(0, np.cumsum(cut))
        seen[index[run != np.bincount(run).argmax()]] = False
        index = np.flatnonzero(seen)
        # Matching widens what is near: the next column may show either.
        count = tuning.open
        before, after = is_open[: index[0]][-1 - count : -1], is_open[index[-1] + 2 :][:count]
        is_end = [len(beyond) == count and bool(beyond.all()) for beyond in (before, after)]
        return along, seen, (is_end[0], is_end[1])

    def _measured(self, surface: _Surface, plane: Float) -> tuple[float, float, Float] | None:
        """Distance from the lens, bearing and covariance of a wall; None: not flat or not sure."""
        tuning = self._tuning
        plane, covariance = self._least_squares(surface.ray, surface.disparity, plane)
        off = surface.disparity - surface.ray @ plane.astype(np.float32)
        norm = math.hypot(plane[0], plane[1])
        if abs(math.atan2(plane[2], norm)) > tuning.max_tilt:
            return None
        distance, bearing = 1.0 / norm, math.atan2(plane[1], plane[0])
        # Mean squared residual of the columns' means, by their pixels.
        count = np.bincount(surface.column, minlength=tuning.columns)
        total = np.bincount(surface.column, off, minlength=tuning.columns)
        rough = float((total * total / np.maximum(count, 1)).sum() / len(off))
        if rough > tuning.max_rough_px**2:
            return None
        covariance *= max(1.0, rough / tuning.rough_px**2)
        cos, sin = plane[:2] / norm
        jacobian = distance * np.array([[-distance * cos, -distance * sin], [-sin, cos]])
        covariance = jacobian @ (covariance[:2, :2] + self._systematic) @ jacobian.T
        covariance[1, 1] += tuning.sigma_yaw**2
        if covariance[1, 1] > tuning.max_sigma**2:
            return None
        return distance, bearing, covariance


def _tables(
    rays: Float, ahead: float, scale: float, tuning: StereoWallTuning
) -> tuple[Int, _Pixels, float, float]:
    """Which pixels are used, what is known of them, the first bearing and a column's width [rad].

    Args:
        rays: In base_link per metre of depth, shape (3, height, width).
        ahead: Bearing of the image's middle [rad].
        scale: f B [px m].
        tuning: Constants.
    """
    level = np.hypot(rays[0], rays[1])
    bearing = np.remainder(np.arctan2(rays[1], rays[0]) - ahead + np.pi, 2.0 * np.pi) - np.pi
    slope = rays[2] / np.maximum(level, 1e-6)
    area = np.abs(
        np.gradient(bearing, axis=1) * np.gradient(slope, axis=0)
        - np.gradient(bearing, axis=0) * np.gradient(slope, axis=1)
    )
    usable = level > tuning.min_level
    # A head that looks straight down uses no pixel, and finds nothing.
    view = bearing[usable] if usable.any() else np.array([-1.0, 1.0])
    low, step = float(view.min()), float(np.ptp(view)) / tuning.columns
    column = np.minimum(((bearing[usable] - low) / step).astype(np.intp), tuning.columns - 1)
    pixels = _Pixels(
        ray=np.ascontiguousarray((scale * rays[:, usable]).T, dtype=np.float32),
        level=level[usable].astype(np.float32),
        slope=slope[usable].astype(np.float32),
        bearing=bearing[usable].astype(np.float32),
        column=column,
        weight=(area[usable] / step).astype(np.float32),
    )
    return np.flatnonzero(usable), pixels, low, step

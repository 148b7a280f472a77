"""Bodies sought in bearing and inverse range: where a robot's view holds something upright.

Depth noise runs along the line of sight and grows with the square of the range, so on the ground
plane a far body is a long smear. In bearing and inverse range it is a spot of the same size
everywhere. A histogram over both sums metres of vertical extent (each pixel counts with the area
that it covers of an upright surface at its range), so it does not matter how a head is mounted, and
a body's count does not fall with its range as its pixels do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Float, Float32, StructOfArrays
from mrs_people_loc.errors import CameraError
from mrs_people_loc.sensing.camera import StereoCamera

#: Heights that count [m]: what is lower is mostly floor, what is higher mostly wall.
LOWEST, HIGHEST = 0.25, 1.95
#: What matching errs by in a body, at most [px].
MATCHING_ERROR_PX = 0.45
#: Half of the width that is taken for a body's [m].
_HALF_WIDTH = 0.18
#: No second body within this of a better one: half a width [m].
_APART = 0.30
#: Width of a bin of inverse range [px].
_STEP_PX = 0.25
#: Pixels whose ray is steeper than this (its horizontal part for each metre of depth) see tops of
#: heads rather than upright surfaces.
_LEAST_LEVEL = 0.35
#: A head must have this share of its rays farther from the vertical than this (sine of the angle).
_LEAST_SHARE, _LEAST_UPRIGHT = 0.6, 0.45


def tolerance_px(inverse_range: Float, depth_disparity: float) -> Float:
    """How far apart in inverse range pixels of one body may lie [px].

    Matching errs by a fixed number of pixels, and a body is a fixed number of metres deep: the
    larger of both counts, or near bodies would split.

    Args:
        inverse_range: `depth_disparity` / range [px].
        depth_disparity: Focal length times baseline [px m].
    """
    return np.maximum(MATCHING_ERROR_PX, 0.22 * inverse_range * inverse_range / depth_disparity)


@dataclass(frozen=True)
class Candidates(StructOfArrays):
    """Places where a body may be, best first, a struct of arrays of one length (n,).

    Attributes:
        bearing: From the lens, to the left of base_link's x axis [rad].
        inverse_range: Focal length times baseline over the horizontal range from the lens [px].
        extent: Metres of vertical extent seen there, mean over a body's width [m].
    """

    bearing: Float
    inverse_range: Float
    extent: Float


class BodySearch:
    """Finds upright things in disparity images of one head.

    Args:
        camera: The head.
        min_range: Nearest horizontal range [m].
        max_range: Farthest horizontal range [m].

    Raises:
        CameraError: The head looks so steeply down or up that it does not see bodies upright, or
            there is nothing between the ranges.
    """

    def __init__(self, camera: StereoCamera, *, min_range: float, max_range: float) -> None:
        if min_range >= max_range:
            raise CameraError(
                f"bodies.max_range is {max_range:g}; "
                f"allowed: more than disparity.min_range, {min_range:g}"
            )
        self.camera = camera
        rotation, translation = camera.robot_from_optical
        u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        rays = np.stack(
            [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)]
        )
        ray = (rotation @ rays.reshape(3, -1)).reshape(3, *u.shape)
        level = np.hypot(ray[0], ray[1])
        usable = level > _LEAST_LEVEL
        upright = level > _LEAST_UPRIGHT * np.linalg.norm(ray, axis=0)
        if upright.mean() < _LEAST_SHARE:
            raise CameraError(
                "bodies.search is true but the head looks steeply down or up (mounting.pitch = "
                f"{camera.mounting.pitch:g} rad): most of its pixels do not see people upright; "
                "wanted: bodies.search false"
            )
        # Around the line of sight of the image's middle, so that no head looks over the seam.
        middle = ray[:, camera.height // 2, camera.width // 2]
        ahead = np.arctan2(middle[1], middle[0])
        bearing = np.angle(np.exp(1j * (np.arctan2(ray[1], ray[0]) - ahead)))
        slope = ray[2] / np.maximum(level, 1e-6)
        area = np.abs(
            np.gradient(bearing, axis=1) * np.gradient(slope, axis=0)
            - np.gradient(bearing, axis=0) * np.gradient(slope, axis=1)
        )
        self._step = 1.0 / camera.fx
        self._first = ahead + float(bearing[usable].min())
        column = ((bearing - bearing[usable].min()) / self._step).astype(np.intp)
        self._columns = int(column[usable].max()) + 1
        self._column = np.clip(column, 0, self._columns - 1).reshape(-1)
        self._level = np.where(usable, level, np.nan).astype(np.float32).reshape(-1)
        self._slope = slope.astype(np.float32).reshape(-1)
        # Metres of vertical extent of a pixel in its column, at 1 m.
        self._weight = (area / self._step).astype(np.float32).reshape(-1)
        self._lens_height = float(translation[2])

        scale = camera.depth_disparity
        self._least = scale / max_range
        rows = max(1, int(np.ceil((scale / min_range - self._least) / _STEP_PX)))
        steps = np.arange(rows, dtype=np.float64) + 0.5
        self._inverse_range: Float = self._least + steps * _STEP_PX
        reach = tolerance_px(self._inverse_range, scale) * 0.8
        self._reach = np.maximum(1, np.round(reach / _STEP_PX)).astype(np.intp)
        row = np.arange(rows)
        self._below = np.maximum(row - self._reach, 0)
        self._above = np.minimum(row + self._reach, rows)
        ranges = scale / self._inverse_range
        half = np.maximum(1, np.round(_HALF_WIDTH / ranges / self._step)).astype(np.intp)
        middle_column = np.arange(self._columns)
        self._from = np.maximum(middle_column - half[:, np.newaxis], 0)
        self._to = np.minimum(middle_column + half[:, np.newaxis] + 1, self._columns)
        # A body that the border of the image cuts is judged by what could be seen of it, but half
        # of it must be there.
        self._width = np.maximum(self._to - self._from, half[:, np.newaxis] + 1)
        self._apart = np.round(_APART / ranges / self._step).astype(np.intp)

    def __call__(self, disparity: Float32, *, min_extent: float, max_count: int) -> Candidates:
        """Places with the most vertical extent.

        Args:
            disparity: [px], float32, shape (height, width), NaN where there is none.
            min_extent: Least extent [m].
            max_count: So many at most.
        """
        extent = self._extents(self.histogram(disparity))
        found = []
        for _ in range(max_count):
            row, column = divmod(int(extent.argmax()), self._columns)
            if extent[row, column] < min_extent:
                break
            found.append((row, column, extent[row, column]))
            near, apart = 2 * self._reach[row], self._apart[row]
            extent[
                max(0, row - near) : row + near + 1, max(0, column - apart) : column + apart + 1
            ] = 0
        at_rows, columns, extents = np.array(found, dtype=np.float64).reshape(-1, 3).T
        return Candidates(
            bearing=self._first + (columns + 0.5) * self._step,
            inverse_range=self._inverse_range[at_rows.astype(np.intp)],
            extent=extents,
        )

    def histogram(self, disparity: Float32) -> Float:
        """Metres of vertical extent by inverse range (rows, far first) and bearing (columns)."""
        flat = disparity.reshape(-1)
        index = np.flatnonzero(flat > self.camera.disparity_offset_px)  # NaN compares false
        values = np.take(flat, index, mode="clip")
        if self.camera.disparity_offset_px:
            values = values - np.float32(self.camera.disparity_offset_px)
        inverse = values / np.take(self._level, index, mode="clip")
        ranges = np.float32(self.camera.depth_disparity) / inverse
        height = np.take(self._slope, index, mode="clip") * ranges
        with np.errstate(invalid="ignore"):
            row = (inverse - np.float32(self._least)) * np.float32(1.0 / _STEP_PX)
            kept = np.flatnonzero(
                (height > np.float32(LOWEST - self._lens_height))
                & (height < np.float32(HIGHEST - self._lens_height))
                & (row >= 0)
                & (row < len(self._reach))
            )
        index = index[kept]
        place = row[kept].astype(np.intp) * self._columns + self._column[index]
        weight = ranges[kept] * self._weight[index]
        shape = (len(self._reach), self._columns)
        counts = np.bincount(place, weight, minlength=shape[0] * shape[1])
        return np.asarray(counts, dtype=np.float64).reshape(shape)

    def _extents(self, histogram: Float) -> Float:
        """The histogram summed over a body's depth and averaged over its width."""
        rows, columns = histogram.shape
        sums = np.zeros((rows + 1, columns))
        np.cumsum(histogram, axis=0, out=sums[1:])
        deep = sums[self._above] - sums[self._below]
        sums = np.zeros((rows, columns + 1))
        np.cumsum(deep, axis=1, out=sums[:, 1:])
        row = np.arange(rows)[:, np.newaxis]
        wide: Float = (sums[row, self._to] - sums[row, self._from]) / self._width
        return wide

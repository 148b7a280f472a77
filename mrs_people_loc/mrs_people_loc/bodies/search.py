"""Search for upright things in a view, over bearing and inverse range.

Depth noise runs along the line of sight and grows with the square of the range, so on the ground
plane a far body is a long smear. In bearing and inverse range it is a spot of the same size
everywhere. A histogram over both sums metres of vertical extent (each pixel counts with the area
that it covers of an upright surface at its range), so it does not matter how a head is mounted, and
a body's count does not fall with its range as its pixels do.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrs_people_loc.anthropometry import APART_ACROSS, HIP_BREADTH, SURFACE_DEPTH, TALLEST
from mrs_people_loc.arrays import Float, Float32, Int, StructOfArrays
from mrs_people_loc.errors import CameraError
from mrs_people_loc.precision import BODY_TOLERANCE_PX
from mrs_people_loc.sensing.camera import StereoCamera

#: Heights that count [m]: pixels below are mostly floor, pixels above mostly wall.
LOWEST, HIGHEST = 0.25, TALLEST


@dataclass(frozen=True)
class SearchTuning:
    """Constants of the search; without another origin, chosen on the training suite.

    Attributes:
        half_width: Extents are averaged over this far to each side [m].
        apart: No second candidate this near to a better one across the line of sight [m] ...
        apart_windows: ... and within so many windows of inverse range.
        bin_px: Width of a bin of inverse range [px].
        window: Half the window of inverse range over which extents are summed, in `tolerance_px`.
        min_level: Horizontal part of a pixel's ray per metre of depth, at least: steeper rays see
            the tops of heads.
        min_upright: Sine of the angle between a ray and the vertical from which it sees people
            upright ...
        min_upright_share: ... as this share of a head's rays must.
    """

    half_width: float = HIP_BREADTH / 2.0
    apart: float = APART_ACROSS
    apart_windows: int = 2
    bin_px: float = 0.25
    window: float = 0.8
    min_level: float = 0.35
    min_upright: float = 0.45
    min_upright_share: float = 0.6


SEARCH_TUNING = SearchTuning()


def tolerance_px(inverse_range: Float, depth_disparity: float) -> Float:
    """How far apart in inverse range pixels of one body may lie [px].

    Matching errs by a fixed number of pixels, and a body is a fixed number of metres deep: the
    larger of both counts, or near bodies would split.

    Args:
        inverse_range: `depth_disparity` / range [px].
        depth_disparity: Focal length times baseline [px m].
    """
    of_depth = SURFACE_DEPTH * inverse_range * inverse_range / depth_disparity
    return np.maximum(BODY_TOLERANCE_PX, of_depth)


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


@dataclass(frozen=True)
class _Columns:
    """Where the pixels of a head are in the histogram; arrays have the shape (pixels,).

    Attributes:
        first: Bearing of the first column's border [rad].
        step: Width of a column [rad].
        count: Number of columns.
        column: Of each pixel.
        level: Horizontal part of its ray per metre of depth, float32; NaN: not used.
        slope: Vertical part of its ray per metre of range, float32.
        weight: Metres of vertical extent in its column that it covers at 1 m, float32.
    """

    first: float
    step: float
    count: int
    column: Int
    level: Float32
    slope: Float32
    weight: Float32

    @classmethod
    def of_camera(cls, camera: StereoCamera, tuning: SearchTuning) -> _Columns:
        """Columns of the width of a pixel in the middle of the image.

        Raises:
            CameraError: Too few of its rays are level.
        """
        rotation, _ = camera.robot_from_optical
        u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        rays = np.stack(
            [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)]
        )
        ray = (rotation @ rays.reshape(3, -1)).reshape(3, *u.shape)
        level = np.hypot(ray[0], ray[1])
        usable = level > tuning.min_level
        upright = level > tuning.min_upright * np.linalg.norm(ray, axis=0)
        if upright.mean() < tuning.min_upright_share:
            raise CameraError(
                "bodies.search is true but the head looks steeply down or up (mounting.pitch = "
                f"{camera.mounting.pitch:g} rad): most of its pixels do not see people upright; "
                "wanted: bodies.search false"
            )
        # Relative to the image's middle, so that the seam at pi is behind every head.
        middle = ray[:, camera.height // 2, camera.width // 2]
        ahead = np.arctan2(middle[1], middle[0])
        bearing = np.angle(np.exp(1j * (np.arctan2(ray[1], ray[0]) - ahead)))
        slope = ray[2] / np.maximum(level, 1e-6)
        area = np.abs(
            np.gradient(bearing, axis=1) * np.gradient(slope, axis=0)
            - np.gradient(bearing, axis=0) * np.gradient(slope, axis=1)
        )
        step = 1.0 / camera.fx
        column = ((bearing - bearing[usable].min()) / step).astype(np.intp)
        count = int(column[usable].max()) + 1
        return cls(
            first=ahead + float(bearing[usable].min()),
            step=step,
            count=count,
            column=np.clip(column, 0, count - 1).reshape(-1),
            level=np.where(usable, level, np.nan).astype(np.float32).reshape(-1),
            slope=slope.astype(np.float32).reshape(-1),
            weight=(area / step).astype(np.float32).reshape(-1),
        )


@dataclass(frozen=True)
class _Windows:
    """What the histogram is summed over, by row (inverse range) and column (bearing).

    Attributes:
        inverse_range: Of the rows' middles [px], shape (rows,).
        half: Half the window of inverse range [rows], shape (rows,).
        below: First row of the window, shape (rows,).
        above: Row after its last one, shape (rows,).
        left: First column of a body's width, as index of `sums` [row, column], which has one column
            more, shape (rows, columns).
        right: Column after its last one, likewise.
        width: Columns that the sum is divided by, shape (rows, columns).
        apart: Distance of candidates [columns], shape (rows,).
    """

    inverse_range: Float
    half: Int
    below: Int
    above: Int
    left: Int
    right: Int
    width: Int
    apart: Int

    @classmethod
    def of_ranges(
        cls, scale: float, least: float, most: float, columns: _Columns, tuning: SearchTuning
    ) -> _Windows:
        """Windows for inverse ranges from the least to the most [px]; `scale` is in px m."""
        count = max(1, int(np.ceil((most - least) / tuning.bin_px)))
        steps = np.arange(count, dtype=np.float64) + 0.5
        inverse_range: Float = least + steps * tuning.bin_px
        reach = tolerance_px(inverse_range, scale) * tuning.window
        half = np.maximum(1, np.round(reach / tuning.bin_px)).astype(np.intp)
        row, column = np.arange(count), np.arange(columns.count)
        ranges = scale / inverse_range
        aside = np.maximum(1, np.round(tuning.half_width / ranges / columns.step)).astype(np.intp)
        left = np.maximum(column - aside[:, np.newaxis], 0)
        right = np.minimum(column + aside[:, np.newaxis] + 1, columns.count)
        before = (columns.count + 1) * row[:, np.newaxis]
        return cls(
            inverse_range=inverse_range,
            half=half,
            below=np.maximum(row - half, 0),
            above=np.minimum(row + half, count),
            left=before + left,
            right=before + right,
            # A body that the border of the image cuts is judged by what could be seen of it, but
            # half of it must be there.
            width=np.maximum(right - left, aside[:, np.newaxis] + 1),
            apart=np.round(tuning.apart / ranges / columns.step).astype(np.intp),
        )


class BodySearch:
    """Finds upright things in disparity images of one head.

    Args:
        camera: The head.
        min_range: Nearest horizontal range [m].
        max_range: Farthest horizontal range [m].
        tuning: Its constants.

    Raises:
        CameraError: The head looks so steeply down or up that it does not see bodies upright, or
            there is nothing between the ranges.
    """

    def __init__(
        self,
        camera: StereoCamera,
        *,
        min_range: float,
        max_range: float,
        tuning: SearchTuning = SEARCH_TUNING,
    ) -> None:
        if min_range >= max_range:
            raise CameraError(
                f"bodies.max_range is {max_range:g}; "
                f"allowed: more than disparity.min_range, {min_range:g}"
            )
        self.camera = camera
        self.tuning = tuning
        _, translation = camera.robot_from_optical
        self._lens_height = float(translation[2])
        scale = camera.depth_disparity
        self._least = scale / max_range
        self._columns = _Columns.of_camera(camera, tuning)
        self._windows = _Windows.of_ranges(
            scale, self._least, scale / min_range, self._columns, tuning
        )
        self._least_px = self._least_disparities(max_range)

    def _least_disparities(self, max_range: float) -> Float32:
        """Pixels with less are too far away, too low or too high; less rounding [px]."""
        columns, lens = self._columns, self._lens_height
        with np.errstate(divide="ignore", invalid="ignore"):
            height = np.where(columns.slope > 0, HIGHEST - lens, lens - LOWEST)
            farthest = np.minimum(height / np.abs(columns.slope), max_range)
            least = self.camera.depth_disparity / farthest * columns.level
        least[farthest <= 0] = np.inf
        return np.asarray(least + self.camera.disparity_offset_px - 1e-3, dtype=np.float32)

    def __call__(self, disparity: Float32, *, min_extent: float, max_count: int) -> Candidates:
        """Places with the most vertical extent.

        Args:
            disparity: [px], float32, shape (height, width), NaN where there is none.
            min_extent: Least extent [m].
            max_count: So many at most.
        """
        columns, windows = self._columns, self._windows
        extent = self._extents(self.histogram(disparity))
        found = []
        for _ in range(max_count):
            row, column = divmod(int(extent.argmax()), columns.count)
            if extent[row, column] < min_extent:
                break
            found.append((row, column, extent[row, column]))
            near, apart = self.tuning.apart_windows * windows.half[row], windows.apart[row]
            extent[
                max(0, row - near) : row + near + 1, max(0, column - apart) : column + apart + 1
            ] = 0
        at_rows, at_columns, extents = np.array(found, dtype=np.float64).reshape(-1, 3).T
        return Candidates(
            bearing=columns.first + (at_columns + 0.5) * columns.step,
            inverse_range=windows.inverse_range[at_rows.astype(np.intp)],
            extent=extents,
        )

    def histogram(self, disparity: Float32) -> Float:
        """Metres of vertical extent by inverse range (rows, far first) and bearing (columns)."""
        columns, rows = self._columns, len(self._windows.half)
        flat = disparity.reshape(-1)
        index = np.flatnonzero(flat > self._least_px)  # NaN compares false
        values = np.take(flat, index, mode="clip")
        if self.camera.disparity_offset_px:
            values = values - np.float32(self.camera.disparity_offset_px)
        inverse = values / np.take(columns.level, index, mode="clip")
        ranges = np.float32(self.camera.depth_disparity) / inverse
        height = np.take(columns.slope, index, mode="clip") * ranges
        with np.errstate(invalid="ignore"):
            row = (inverse - np.float32(self._least)) * np.float32(1.0 / self.tuning.bin_px)
            kept = np.flatnonzero(
                (height > np.float32(LOWEST - self._lens_height))
                & (height < np.float32(HIGHEST - self._lens_height))
                & (row >= 0)
                & (row < rows)
            )
        index = index[kept]
        place = row[kept].astype(np.intp) * columns.count + columns.column[index]
        weight = ranges[kept] * columns.weight[index]
        counts = np.bincount(place, weight, minlength=rows * columns.count)
        return np.asarray(counts, dtype=np.float64).reshape(rows, columns.count)

    def _extents(self, histogram: Float) -> Float:
        """The histogram summed over a body's depth and averaged over its width."""
        windows, (rows, columns) = self._windows, histogram.shape
        sums = np.zeros((rows + 1, columns))
        np.cumsum(histogram, axis=0, out=sums[1:])
        deep = sums[windows.above] - sums[windows.below]
        sums = np.zeros((rows, columns + 1))
        np.cumsum(deep, axis=1, out=sums[:, 1:])
        wide: Float = np.take(sums, windows.right, mode="clip")
        wide -= np.take(sums, windows.left, mode="clip")
        wide /= windows.width
        return wide

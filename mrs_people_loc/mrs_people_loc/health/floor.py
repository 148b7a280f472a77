"""The mounting of a head, from the floor that it sees.

A plane is a plane in disparity space, too (v-disparity: Labayrade, Aubert & Tarel 2002): with m the
floor's normal, downwards, over the lens's height, a floor pixel's disparity is linear in m,

    d = f B (m . ray),    height = 1 / |m|,

so three pixels give a hypothesis, which least squares refine. Of all planes that may be the floor
the one is chosen that most pixels lie on and few lie below.
"""

from __future__ import annotations

import dataclasses
import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field

import cv2
import numpy as np
from numpy.typing import NDArray

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Bool, Float, Float32, Int, StructOfArrays
from mrs_people_loc.errors import FloorError
from mrs_people_loc.geometry import BODY_FROM_OPTICAL, rotation_from_rpy, wrap_angle
from mrs_people_loc.precision import PLANE_TOLERANCES_PX
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.disparity import SUBPIXELS

#: Matching draws the floor beside something that stands on it towards that, as far as its blocks
#: reach; single pixels do nothing.
_SPECKLE = np.ones((2, 2), np.uint8)
#: Errors of the floor were fitted to disparities of blocks of up to this [px].
BLOCK_PX = 11
#: StereoBM rounds up to the next sixteenth [px].
_ROUNDED_PX = 0.5 / SUBPIXELS


@dataclass(frozen=True)
class FloorTuning:
    """Constants of `FloorFinder`; chosen by hand, except for those that were fitted.

    Attributes:
        tolerances_px: A pixel on a plane differs from it by less than the first of these; while
            the floor is refined, by ever less [px].
        max_pitch_change: The head is not pitched against its configuration by more than this
            [rad]: beyond, a wall could be a floor.
        max_roll_change: Likewise rolled [rad].
        least_height: The lens is at least this high over the floor [m],
        greatest_height: and at most this high [m].
        below_px: A pixel farther from the lens than the floor by more is below it [px].
        least_disparity_px: Pixels of less disparity do not count [px]: far floor is drawn to what
            stands before and behind it.
        rows: The slope at a pixel is taken over so many rows up and down.
        straight_px: On a plane, disparities at these three rows are on a line within this [px].
        slope_px: A pixel's slope agrees with the plane's within this [px],
        slope_share: plus this share of the plane's slope.
        offset_px: What rectification and matching err by in common over whole images, standard
            deviation of the offset at `BLOCK_PX` [px]; it grows with the block. This and the next
            two were fitted: 19 of 20 mountings of simulated heads are within two of the standard
            deviations that come out.
        across_px: Likewise of a slope, from the image's middle to its border, across [px],
        down_px: and down [px].
        tile_px: Errors of matching are alike within a tile of this side [px].
        hypotheses: Planes that are tried.
        coarse: Pixels that all hypotheses are compared on,
        fine: and those that the best of them are.
        best: How many these are.
        least_part: Share of a view that the floor must fill at least, on average.
        worst_angle: Standard deviation of the head's tilt, at most [rad]; more in proportion where
            the floor fills more of a view than `large_part`.
        large_part: Share of a view that nothing fills by accident.
        worst_height: Standard deviation of the height over the height, at most.
    """

    tolerances_px: tuple[float, ...] = PLANE_TOLERANCES_PX
    max_pitch_change: float = math.radians(55.0)
    max_roll_change: float = math.radians(30.0)
    least_height: float = 0.2
    greatest_height: float = 5.0
    below_px: float = 1.0
    least_disparity_px: float = 2.0
    rows: int = 5
    straight_px: float = 0.3
    slope_px: float = 0.1
    slope_share: float = 0.3
    offset_px: float = 0.10
    across_px: float = 0.04
    down_px: float = 0.08
    tile_px: int = 16
    hypotheses: int = 4000
    coarse: int = 400
    fine: int = 2000
    best: int = 24
    least_part: float = 0.025
    worst_angle: float = math.radians(1.6)
    large_part: float = 0.05
    worst_height: float = 0.05


@dataclass(frozen=True)
class FloorWatchTuning:
    """Constants of `FloorWatch`, chosen by hand.

    Attributes:
        period_s: From one look to the next [s].
        kept_s: A look counts for so long [s].
        looks: Looks that are judged together.
        finder: Constants of each look; with blocks larger than `BLOCK_PX` the floor must fill twice
            the part.
    """

    period_s: float = 2.0
    kept_s: float = 30.0
    looks: int = 5
    finder: FloorTuning = field(
        default_factory=lambda: FloorTuning(hypotheses=200, least_part=0.015)
    )


_TUNING, _WATCH_TUNING = FloorTuning(), FloorWatchTuning()


@dataclass(frozen=True)
class Floor:
    """Mounting of a head, by the floor that it sees.

    Attributes:
        height: Of the lens over the floor [m].
        pitch: As `config.Mounting` [rad].
        roll: As `config.Mounting` [rad].
        covariance: Of height, pitch and roll, shape (3, 3).
        part: How much of a view lies on the floor, 0 to 1.
        frames: Views that it was seen in.
    """

    height: float
    pitch: float
    roll: float
    covariance: Float
    part: float
    frames: int

    @property
    def sigma(self) -> tuple[float, float, float]:
        """Standard deviations of height [m], pitch and roll [rad]."""
        height, pitch, roll = np.sqrt(np.diag(self.covariance))
        return float(height), float(pitch), float(roll)

    @property
    def sigma_tilt(self) -> float:
        """Standard deviation of which way is down [rad].

        Unlike that of roll it stays small where the head looks straight down, for there roll and
        yaw turn about the same axis.
        """
        return max(self.sigma[1], self.sigma[2] * abs(math.cos(self.pitch)))


@dataclass(frozen=True)
class _FloorPixels(StructOfArrays):
    """Pixels of several views, a struct of arrays: where, the ray, disparity and its slope."""

    frame: Int
    pixel: Int
    rays: Float32
    disparity: Float32
    slope: Float32


def in_words(mounting: Floor | cfg.Mounting) -> str:
    """Height, pitch and roll for people."""
    return (
        f"height {mounting.height:.2f} m, pitch {math.degrees(mounting.pitch):.1f} deg, "
        f"roll {math.degrees(mounting.roll):.1f} deg"
    )


class FloorFinder:
    """Finds the floor in disparity images of one head.

    Args:
        camera: The head. Its mounting tells roughly which way is down.
        block_px: The largest block that disparities were matched with [px].
        tuning: Constants.
    """

    def __init__(
        self, camera: StereoCamera, *, block_px: int = BLOCK_PX, tuning: FloorTuning = _TUNING
    ) -> None:
        self.camera = camera
        self._tuning = tuning
        self._least_pixels = tuning.least_part * camera.width * camera.height
        mounting = camera.mounting
        u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
        rays = np.stack(
            [(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)]
        )
        # As configured: x ahead (the floor does not tell yaw), z up.
        self._level = rotation_from_rpy(mounting.roll, mounting.pitch, 0.0) @ BODY_FROM_OPTICAL
        scaled = camera.depth_disparity * (self._level @ rays.reshape(3, -1))
        self._rays = np.ascontiguousarray(scaled.T, dtype=np.float32)
        side = tuning.tile_px
        across = -(-camera.width // side)
        self._tile = (v // side * across + u // side).reshape(-1)
        per_row = 2 * tuning.rows * camera.depth_disparity / camera.fy
        self._slope = (per_row * self._level[:, 1]).astype(np.float32)
        height = max(mounting.height, tuning.least_height)
        self._configured = np.array([[0.0, 0.0, -1.0 / height]], dtype=np.float32)
        block_px = max(block_px, BLOCK_PX)
        self._beside = np.ones((block_px, block_px), np.uint8)
        reach = np.abs(rays[:2]).max(axis=(1, 2))
        offset = tuning.offset_px * block_px / BLOCK_PX
        optical = np.diag([tuning.across_px / reach[0], tuning.down_px / reach[1], offset])
        root = self._level @ optical / camera.depth_disparity
        self._systematic: Float = root @ root.T

    def __call__(self, disparities: Sequence[Float32]) -> Floor:
        """The floor in one view or several of the same mounting.

        Args:
            disparities: [px], float32, each of shape (height, width), NaN where there is none.

        Raises:
            FloorError: There is not enough floor in view.
        """
        frames = len(disparities)
        views = np.stack(disparities).reshape(frames, -1)
        views -= np.float32(self.camera.disparity_offset_px + _ROUNDED_PX)
        pixels = self._straight(views)
        if len(pixels) < self._least_pixels * frames:
            raise FloorError("hardly any surface in view has a disparity")
        plane = self._search(views, pixels)
        if plane is None:
            raise FloorError("nothing in view looks like a floor")
        plane, pixels = self._refine(plane, views, pixels)
        part = len(pixels) / views.size
        if len(pixels) < self._least_pixels * frames:
            raise FloorError(
                f"only {part:.1%} of a view looks like floor; "
                f"wanted: {self._least_pixels / views.shape[1]:.1%}"
            )
        if not self._plausible(plane[np.newaxis])[0]:
            raise FloorError("no floor is near where the configured mounting has it")
        height, pitch, roll, covariance = self._measure(plane, self._covariance(plane, pixels))
        floor = Floor(height, pitch, roll, covariance, part, frames)
        tuning = self._tuning
        if (
            floor.sigma_tilt > tuning.worst_angle * max(1.0, part / tuning.large_part)
            or floor.sigma[0] > tuning.worst_height * height
        ):
            raise FloorError(
                "what is in view of the floor says too little: height "
                f"+-{floor.sigma[0]:.2f} m, tilt +-{math.degrees(floor.sigma_tilt):.1f} deg"
            )
        return floor

    def _straight(self, views: Float32) -> _FloorPixels:
        """The pixels about which disparity grows evenly downwards: not at an edge or a corner."""
        tuning, rows = self._tuning, self._tuning.rows
        shape = (len(views), self.camera.height, self.camera.width)
        above, below = np.full((2, *shape), np.nan, dtype=np.float32)
        above[:, rows:] = views.reshape(shape)[:, :-rows]
        below[:, :-rows] = views.reshape(shape)[:, rows:]
        bent = np.abs((above + below).reshape(views.shape) - 2.0 * views)
        straight = (bent < tuning.straight_px) & (views >= tuning.least_disparity_px)
        frame, pixel = np.nonzero(straight)
        slope = (below - above).reshape(views.shape)[frame, pixel]
        return _FloorPixels(frame, pixel, self._rays[pixel], views[frame, pixel], slope)

    def _search(self, views: Float32, pixels: _FloorPixels) -> Float | None:
        """The plane with the highest score (MSAC: Torr & Zisserman 2000); None if there is none."""
        tuning, tolerance = self._tuning, self._tuning.tolerances_px[0]
        rng = np.random.default_rng(len(pixels))
        triple = rng.integers(len(pixels), size=(3, tuning.hypotheses))
        a, b, c = (pixels.rays[index] for index in triple)
        # The plane through three pixels: the rows of the inverse are cross products.
        bc, ca, ab = np.cross(b, c), np.cross(c, a), np.cross(a, b)
        da, db, dc = (pixels.disparity[index][:, np.newaxis] for index in triple)
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            planes = (da * bc + db * ca + dc * ab) / np.einsum("ij,ij->i", a, bc)[:, np.newaxis]
        planes = np.concatenate([self._configured, planes])
        planes = planes[self._plausible(planes)]
        for count in (tuning.coarse, tuning.fine):
            step = max(1, len(pixels) // count)
            some = pixels.select(slice(None, None, step))
            off = some.disparity - planes @ some.rays.T
            on = np.maximum(0.0, 1.0 - np.square(off * np.float32(1.0 / tolerance)))
            on *= self._slope_fits(some.slope, (planes @ self._slope)[:, np.newaxis])
            score = step * on.sum(axis=1)
            # Nothing is under a floor; a pixel without a disparity says nothing.
            step = max(1, views.size // count)
            index = np.arange(step // 2, views.size, step)
            rays = self._rays[index % views.shape[1]]
            off = views.reshape(-1)[index] - planes @ rays.T
            score -= step * np.count_nonzero(off < -tuning.below_px, axis=1)
            planes = planes[np.argsort(-score)[: tuning.best]]
        return planes[0].astype(np.float64) if len(planes) else None

    def _refine(
        self, plane: Float, views: Float32, pixels: _FloorPixels
    ) -> tuple[Float, _FloorPixels]:
        """Least squares of the pixels on the plane, with ever less tolerance; and which they are.

        Most of what is not floor is a little above it, so the mean would be, too.
        """
        shape = (len(views), self.camera.height, self.camera.width)
        found = pixels.select(slice(0))
        for tolerance in self._tuning.tolerances_px:
            above = views - self._rays @ plane.astype(np.float32) > self._tuning.tolerances_px[0]
            beside = above.reshape(shape).astype(np.uint8)
            for view in beside:
                cv2.dilate(cv2.erode(view, _SPECKLE), self._beside, dst=view)
            free = pixels.select(beside.reshape(views.shape)[pixels.frame, pixels.pixel] == 0)
            for _ in range(3):
                off = free.disparity - free.rays @ plane.astype(np.float32)
                on = np.abs(off) < tolerance
                on &= self._slope_fits(free.slope, float(self._slope @ plane))
                found = free.select(on)
                if len(found) < self._least_pixels:
                    return plane, found
                rays = found.rays.astype(np.float64)
                plane = np.linalg.pinv(rays.T @ rays) @ (rays.T @ found.disparity)
        return plane, found

    def _slope_fits(self, slope: Float32, wanted: NDArray[np.floating] | float) -> Bool:
        tolerance = self._tuning.slope_px + self._tuning.slope_share * np.abs(wanted)
        fits: Bool = np.abs(slope - wanted) < tolerance
        return fits

    def _plausible(self, planes: NDArray[np.floating]) -> Bool:
        """Which planes, shape (n, 3), are within the limits of the mounting."""
        tuning, (x, y, z) = self._tuning, planes.T
        with np.errstate(invalid="ignore", over="ignore"):
            inverse = np.sqrt(x * x + y * y + z * z)
            good: Bool = (
                (inverse >= 1.0 / tuning.greatest_height)
                & (inverse <= 1.0 / tuning.least_height)
                & (np.abs(x) <= -z * math.tan(tuning.max_pitch_change))
                & (np.abs(y) <= -z * math.tan(tuning.max_roll_change))
            )
        return good

    def _covariance(self, plane: Float, pixels: _FloorPixels) -> Float:
        """Of the plane, shape (3, 3): from its residuals, and of what all pixels have in common.

        Residuals are alike within a part of the image and within a view: they count as one for
        each (cluster-robust; Cameron, Gelbach & Miller 2011).
        """
        rays = pixels.rays.astype(np.float64)
        inverse = np.linalg.pinv(rays.T @ rays)
        pull = rays * (pixels.disparity - rays @ plane)[:, np.newaxis]
        total = self._systematic.copy()
        for cluster in (self._tile[pixels.pixel], pixels.frame):
            sums = np.stack([np.bincount(cluster, part) for part in pull.T])
            count = np.count_nonzero(np.bincount(cluster))
            if count > 1:
                total += inverse @ (sums @ sums.T) @ inverse * (count / (count - 1))
        return total

    def _measure(self, plane: Float, covariance: Float) -> tuple[float, float, float, Float]:
        """Height, pitch and roll of a plane, and their covariance, to first order."""
        values = self._mounting_of(plane)
        step = 1e-6 * float(np.linalg.norm(plane))
        jacobian = np.stack(
            [
                (self._mounting_of(plane + step * axis) - self._mounting_of(plane - step * axis))
                / (2 * step)
                for axis in np.eye(3)
            ],
            axis=1,
        )
        height, pitch, roll = (float(value) for value in values)
        return height, pitch, roll, jacobian @ covariance @ jacobian.T

    def _mounting_of(self, plane: Float) -> Float:
        """Height, pitch and roll: of the two solutions, the one nearer to the configuration."""
        inverse = float(np.linalg.norm(plane))
        # `down` in the head's own axes; there it is (sin pitch, -cos pitch sin roll, ...).
        x, y, z = BODY_FROM_OPTICAL @ self._level.T @ plane / inverse
        level = math.hypot(y, z)
        configured = self.camera.mounting
        ways = (
            (math.atan2(x, level), math.atan2(-y, -z)),
            (math.atan2(x, -level), math.atan2(y, z)),
        )
        pitch, roll = min(
            ways,
            key=lambda way: (
                abs(wrap_angle(way[0] - configured.pitch))
                + abs(wrap_angle(way[1] - configured.roll))
            ),
        )
        return np.array([1.0 / inverse, pitch, roll])


class FloorWatch:
    """Whether a head still has its configured mounting, by the floor that it sees.

    It looks at one view per period, and judges by the median of several looks, so that passing
    objects do not count.

    Args:
        camera: The head.
        config: By how much it may have moved.
        block_px: The largest block that disparities are matched with [px].
        tuning: Constants.

    Attributes:
        camera: The head.
        config: By how much it may have moved.
        block_px: The largest block that disparities are matched with [px].
        floor: Median of the last looks; None: too few of them saw the floor.
        moved: Whether the head sits somewhere else. Once it does, that holds until it is seen to
            sit right again.
        why_not: Why the last look did not see the floor; empty if it did.
    """

    def __init__(
        self,
        camera: StereoCamera,
        config: cfg.Floor,
        *,
        block_px: int = BLOCK_PX,
        tuning: FloorWatchTuning = _WATCH_TUNING,
    ) -> None:
        self.camera = camera
        self.config = config
        self.block_px = block_px
        self.floor: Floor | None = None
        self.moved = False
        self.why_not = "not looked at yet"
        self._tuning = tuning
        least_part = tuning.finder.least_part * (2 if block_px > BLOCK_PX else 1)
        finder = dataclasses.replace(tuning.finder, least_part=least_part)
        self._find = FloorFinder(camera, block_px=block_px, tuning=finder)
        self._looks: deque[tuple[int, Floor]] = deque(maxlen=tuning.looks)
        self._looked_ns: int | None = None

    def step(self, disparity: Float32, stamp_ns: int) -> None:
        """Takes a view; most of them are not looked at.

        Args:
            disparity: [px], float32, shape (height, width), NaN where there is none.
            stamp_ns: Its stamp [ns]; when stamps jump back everything begins again.
        """
        if self._looked_ns is not None:
            since_s = (stamp_ns - self._looked_ns) / 1e9
            if since_s < 0:
                self._looks.clear()
            elif since_s < self._tuning.period_s:
                return
        self._looked_ns = stamp_ns
        try:
            found = self._find([disparity])
        except FloorError as err:
            self.why_not = str(err)
        else:
            self.why_not = ""
            self._looks.append((stamp_ns, found))
        while self._looks and stamp_ns - self._looks[0][0] > self._tuning.kept_s * 1e9:
            self._looks.popleft()
        self._judge()

    def _judge(self) -> None:
        if len(self._looks) < self._tuning.looks:
            self.floor = None
            return
        looks = [floor for _, floor in self._looks]
        height, pitch, roll = np.median([(f.height, f.pitch, f.roll) for f in looks], axis=0)
        # No surer than one look: what matching errs by in this view is in all of them.
        sigma = np.median([f.sigma for f in looks], axis=0)
        self.floor = Floor(
            float(height),
            float(pitch),
            float(roll),
            np.diag(sigma**2),
            part=float(np.mean([f.part for f in looks])),
            frames=len(looks),
        )
        configured = self.camera.mounting
        turned = math.acos(min(1.0, float(_down(self.floor) @ _down(configured))))
        # To clear takes more than not to warn.
        sigmas = 1.0 if self.moved else 2.0
        self.moved = bool(
            turned > self.config.max_angle + sigmas * self.floor.sigma_tilt
            or abs(height - configured.height) > self.config.max_height + sigmas * sigma[0]
        )


def watch_for(
    camera: StereoCamera, config: cfg.RobotConfig, before: FloorWatch | None
) -> FloorWatch | None:
    """The watch of a head as it is configured: a new one where head or parameters have changed.

    Args:
        camera: The head.
        config: The robot's configuration.
        before: The watch so far.

    Returns:
        None: the floor is not watched.
    """
    if not config.floor.watch:
        return None
    block_px = config.disparity.largest_block_px
    wanted = camera, config.floor, block_px
    if before is not None and (before.camera, before.config, before.block_px) == wanted:
        return before
    return FloorWatch(camera, config.floor, block_px=block_px)


def _down(mounting: Floor | cfg.Mounting) -> Float:
    """Straight down in the head's own axes."""
    down: Float = -rotation_from_rpy(mounting.roll, mounting.pitch, 0.0)[2]
    return down

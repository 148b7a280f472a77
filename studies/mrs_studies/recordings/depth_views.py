"""One picture with depth as what a robot's stereo head sees from its place."""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from mrs_people_loc.arrays import Float, Float32
from mrs_people_loc.config import Mounting
from mrs_people_loc.errors import BagError, FloorError
from mrs_people_loc.health.floor import FloorFinder, FloorTuning
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.disparity import SUBPIXELS
from mrs_people_loc.sensing.images import Gray
from mrs_studies.recordings.right_view import fill_depth, render_right

#: The head: size of its images, focal length [px], focal length times baseline [px m].
WIDTH, HEIGHT, FOCAL_PX, FOCAL_BASELINE = 160, 120, 142.0, 10.5
#: How a head may be mounted: a view that was taken from lower or higher, or that is pitched or
#: rolled by more, is left out.
_FLOOR = FloorTuning(
    max_pitch_change=math.radians(50),
    max_roll_change=math.radians(20),
    least_height=0.3,
    greatest_height=2.5,
)
#: Likewise one of which a smaller part has a depth.
_LEAST_DEPTH = 0.4
#: Depths beyond are none [m].
_FARTHEST_M = 15.0


@dataclass(frozen=True)
class DepthCamera:
    """A camera whose pictures have depth.

    Attributes:
        fx: Focal length [px].
        fy: Focal length [px].
        cx: Principal point [px].
        cy: Principal point [px].
        unit_m: Depth of 1 in its depth pictures [m].
        rotated: Whether their bits are rotated to the left by three, as in SUN RGB-D.
    """

    fx: float
    fy: float
    cx: float
    cy: float
    unit_m: float = 0.001
    rotated: bool = False

    def read(self, colour: Path, depth: Path) -> tuple[Gray, Float]:
        """A picture in grey, and its depth [m], NaN where there is none.

        Raises:
            BagError: A picture cannot be read, or they differ in size.
        """
        grey: Any = cv2.imread(str(colour), cv2.IMREAD_GRAYSCALE)
        values: Any = cv2.imread(str(depth), cv2.IMREAD_UNCHANGED)
        for path, image in ((colour, grey), (depth, values)):
            if image is None:
                raise BagError(f"{path} cannot be read as a picture")
        if values.dtype != np.uint16 or values.shape != grey.shape:
            raise BagError(
                f"{depth} is {values.dtype} of shape {values.shape}; wanted: uint16 of {grey.shape}"
            )
        if self.rotated:
            values = values >> 3 | values << 13
        metres = values * self.unit_m
        return grey, np.where((metres > 0) & (metres < _FARTHEST_M), metres, np.nan)


@dataclass(frozen=True)
class StereoView:
    """What a head sees from its place, without noise.

    Attributes:
        camera: The head, with its mounting over the floor.
        left: Left image, shape (`HEIGHT`, `WIDTH`).
        right: Right image, likewise.
    """

    camera: StereoCamera
    left: Float
    right: Float

    def images(self, rng: np.random.Generator, noise_grey: float = 1.5) -> tuple[Gray, Gray]:
        """Both images with noise of a standard deviation [grey levels]."""
        left, right = (
            np.clip(np.rint(view + rng.normal(0.0, noise_grey, view.shape)), 0, 255)
            for view in (self.left, self.right)
        )
        return left.astype(np.uint8), right.astype(np.uint8)


def stereo_view(grey: Gray, depth: Float, camera: DepthCamera) -> StereoView:
    """What a head sees that stands where a picture with depth was taken.

    The middle of the picture is cut out and reduced such that its focal length is `FOCAL_PX`, or
    more if the picture is too narrow for that. The right view is the left one warped by the depth.

    Args:
        grey: The picture.
        depth: Depth of each pixel [m], NaN where there is none.
        camera: The camera.

    Raises:
        FloorError: There is not enough floor or depth in the picture, or it was taken in a way in
            which no robot's head is mounted.
    """
    share = np.isfinite(depth).mean()
    if share < _LEAST_DEPTH:
        raise FloorError(f"only {share:.0%} has a depth; wanted: {_LEAST_DEPTH:.0%}")
    rows, columns = grey.shape
    whole = slice(0, rows), slice(0, columns)
    mounting = _mounting(_head(camera, whole, (WIDTH, WIDTH * rows // columns)), depth)
    scale = min(camera.fx / FOCAL_PX, columns / WIDTH, rows / HEIGHT)
    wide, tall = round(scale * WIDTH), round(scale * HEIGHT)
    left, top = (columns - wide) // 2, (rows - tall) // 2
    part = slice(top, top + tall), slice(left, left + wide)
    right = render_right(grey[part], fill_depth(depth[part]), FOCAL_BASELINE * wide / WIDTH)
    views = [
        cv2.resize(view, (WIDTH, HEIGHT), interpolation=cv2.INTER_AREA).astype(np.float64)
        for view in (grey[part], right)
    ]
    head = dataclasses.replace(_head(camera, part, (WIDTH, HEIGHT)), mounting=mounting)
    return StereoView(head, *views)


def _head(camera: DepthCamera, part: tuple[slice, slice], size: tuple[int, int]) -> StereoCamera:
    """The head whose images of a size are a part of a camera's pictures."""
    (top, bottom), (left, right) = ((side.start, side.stop) for side in part)
    sx, sy = size[0] / (right - left), size[1] / (bottom - top)
    return StereoCamera(
        *size,
        fx=camera.fx * sx,
        fy=camera.fy * sy,
        cx=(camera.cx - left + 0.5) * sx - 0.5,
        cy=(camera.cy - top + 0.5) * sy - 0.5,
        baseline=FOCAL_BASELINE / (camera.fx * sx),
    )


def _mounting(head: StereoCamera, depth: Float) -> Mounting:
    """The mounting of a head, by the floor in the depth that it sees.

    Raises:
        FloorError: There is not enough floor in view, or no robot's head is mounted so.
    """
    size = head.width, head.height
    small = cv2.resize(depth, size, interpolation=cv2.INTER_NEAREST)
    # As of matching, which rounds up to the next step.
    disparity: Float32 = (head.depth_disparity / small + 0.5 / SUBPIXELS).astype(np.float32)
    floor = FloorFinder(head, tuning=_FLOOR)([disparity])
    return Mounting(height=floor.height, pitch=floor.pitch, roll=floor.roll)

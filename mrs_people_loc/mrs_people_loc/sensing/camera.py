"""Cameras: calibration as CameraInfo holds it, the stereo head, and its mounting on the robot."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.config import Mounting
from mrs_people_loc.errors import CameraError
from mrs_people_loc.geometry import BODY_FROM_OPTICAL, rotation_from_rpy

#: Distortion models by their names in CameraInfo, and how many coefficients each may have.
DISTORTION_MODELS = {
    "plumb_bob": (4, 5),
    "rational_polynomial": (8, 12, 14),
    "equidistant": (4,),
    "fisheye": (4,),
}
#: Images are at most this wide and high [px].
_MAX_SIDE = 8192
#: No number of a calibration is larger, whatever its unit; float32 has to hold their products.
_MAX_ENTRY = 1e6
#: The least focal length [px]; that of the smallest image of a fisheye lens is far above.
_MIN_FOCAL = 1e-2
#: Two cameras of a rectified pair may differ by this much in focal length (relative).
_FOCAL_TOLERANCE = 1e-3
#: ... and in the row (column for the vertical pair) of the principal point [px].
_ROW_TOLERANCE_PX = 0.5
#: A shorter baseline than this [m] is none: P lacks it.
_LEAST_BASELINE = 1e-4


@dataclass(frozen=True)
class CameraModel:
    """Calibration of one camera, with the meaning of sensor_msgs/CameraInfo.

    Attributes:
        width: Image width [px].
        height: Image height [px].
        k: Intrinsic matrix of the raw image [px], shape (3, 3).
        d: Distortion coefficients of the raw image.
        r: Rotation from the raw to the rectified camera, shape (3, 3).
        p: Projection of the rectified image [px]; P[0, 3] = -fx * baseline, shape (3, 4).
        distortion_model: Key of `DISTORTION_MODELS`; empty where there is no distortion.
    """

    width: int
    height: int
    k: Float
    d: tuple[float, ...]
    r: Float
    p: Float
    distortion_model: str = "plumb_bob"

    def __post_init__(self) -> None:
        """Checks sizes and values.

        Raises:
            CameraError: Naming the field, its value and what is allowed.
        """
        if not (0 < self.width <= _MAX_SIDE and 0 < self.height <= _MAX_SIDE):
            raise CameraError(
                f"image size is {self.width}x{self.height}; "
                f"allowed: more than 0x0, up to {_MAX_SIDE}x{_MAX_SIDE}"
            )
        for name, shape in (("k", (3, 3)), ("r", (3, 3)), ("p", (3, 4))):
            value = np.asarray(getattr(self, name), dtype=np.float64)
            if value.shape != shape:
                raise CameraError(f"{name} has shape {value.shape}; wanted: {shape}")
            if not np.isfinite(value).all():
                raise CameraError(f"{name} holds NaN or infinite values")
            if name != "r" and np.abs(value).max() > _MAX_ENTRY:
                raise CameraError(
                    f"{name} holds {np.abs(value).max():g}; allowed: numbers up to {_MAX_ENTRY:g}"
                )
            object.__setattr__(self, name, value)
        if not all(np.isfinite(self.d)):
            raise CameraError("d holds NaN or infinite values")
        if self.p[0, 0] < _MIN_FOCAL or self.p[1, 1] < _MIN_FOCAL:
            raise CameraError(
                f"focal length in p is {self.p[0, 0]:g}, {self.p[1, 1]:g} px; allowed: at least "
                f"{_MIN_FOCAL:g} (is the camera calibrated?)"
            )

    def check_raw(self) -> None:
        """Checks what is needed to rectify raw images.

        Raises:
            CameraError: The distortion model is unknown, or k, r or d do not fit it.
        """
        if self.k[0, 0] <= 0 or self.k[1, 1] <= 0:
            raise CameraError(f"focal length in k is {self.k[0, 0]:g} px; allowed: more than 0")
        r = self.r
        if (
            np.abs(r).max() > 1.0 + 1e-3
            or not np.allclose(r @ r.T, np.eye(3), atol=1e-3)
            or np.linalg.det(r) < 0
        ):
            raise CameraError(f"r is no rotation (orthonormal, determinant 1): {r.tolist()}")
        if not self.d:
            return
        counts = DISTORTION_MODELS.get(self.distortion_model)
        if counts is None:
            raise CameraError(
                f"distortion_model is {self.distortion_model!r}; "
                f"allowed: {', '.join(DISTORTION_MODELS)}"
            )
        if len(self.d) not in counts:
            raise CameraError(
                f"d has {len(self.d)} coefficients; {self.distortion_model} takes "
                + " or ".join(map(str, counts))
            )

    def scaled_to_fit(self, width: int, height: int) -> CameraModel:
        """The model of this camera's images scaled down to fit width x height [px].

        Pixel centres are at whole numbers, so scaling by s maps u to (u + 0.5) s - 0.5.
        Images that fit already are not scaled up.
        """
        scale = min(width / self.width, height / self.height)
        if scale >= 1.0:
            return self
        new_width, new_height = round(self.width * scale), round(self.height * scale)
        sx, sy = new_width / self.width, new_height / self.height
        resize = np.array([[sx, 0.0, 0.5 * sx - 0.5], [0.0, sy, 0.5 * sy - 0.5], [0.0, 0.0, 1.0]])
        return dataclasses.replace(
            self, width=new_width, height=new_height, k=resize @ self.k, p=resize @ self.p
        )


def robot_from_optical(mounting: Mounting) -> tuple[Float, Float]:
    """Rotation (3, 3) and translation (3,) [m] from the left optical to the robot frame."""
    rotation = rotation_from_rpy(mounting.roll, mounting.pitch, mounting.yaw) @ BODY_FROM_OPTICAL
    return rotation, np.array([mounting.forward, mounting.left, mounting.height])


@dataclass(frozen=True)
class StereoCamera:
    """A rectified binocular or trinocular head on a robot.

    Attributes:
        width: Image width [px].
        height: Image height [px].
        fx: Focal length along x [px].
        fy: Focal length along y [px].
        cx: Principal point of the left camera [px].
        cy: Principal point of the left camera [px].
        baseline: Distance from the left to the right camera, along x [m].
        disparity_offset_px: Disparity of a point at infinity (left minus right principal point).
        vertical_baseline: How far `top` is above the left camera [m]; negative: below; 0: none.
        vertical_offset_px: As `disparity_offset_px`, for the vertical pair.
        mounting: Pose of the left camera on the robot.
    """

    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    baseline: float
    disparity_offset_px: float = 0.0
    vertical_baseline: float = 0.0
    vertical_offset_px: float = 0.0
    mounting: Mounting = dataclasses.field(default_factory=Mounting)

    @classmethod
    def from_models(
        cls,
        left: CameraModel,
        right: CameraModel,
        top: CameraModel | None = None,
        mounting: Mounting | None = None,
    ) -> StereoCamera:
        """Builds the head from the P matrices of its cameras (image_pipeline's convention).

        `right.p[0, 3]` is Tx = -fx * baseline; `top.p[1, 3]` is Ty = fy * height of `top` above
        `left`.

        Raises:
            CameraError: The cameras do not fit together, or a baseline is zero or reversed.
        """
        for name, other in (("right", right), ("top", top)):
            if other is not None:
                _check_same_images(left, other, name)
        vertical_baseline, vertical_offset_px = _vertical_pair(left, top) if top else (0.0, 0.0)
        return cls(
            width=left.width,
            height=left.height,
            fx=float(left.p[0, 0]),
            fy=float(left.p[1, 1]),
            cx=float(left.p[0, 2]),
            cy=float(left.p[1, 2]),
            baseline=_baseline(left, right),
            disparity_offset_px=float(left.p[0, 2] - right.p[0, 2]),
            vertical_baseline=vertical_baseline,
            vertical_offset_px=vertical_offset_px,
            mounting=mounting or Mounting(),
        )

    @property
    def depth_disparity(self) -> float:
        """Depth times disparity, fx * baseline [px m]: Z = depth_disparity / (d - offset)."""
        return self.fx * self.baseline

    @property
    def robot_from_optical(self) -> tuple[Float, Float]:
        """Rotation (3, 3) and translation (3,) [m] from the left optical to the robot frame."""
        return robot_from_optical(self.mounting)

    def disparity_of(self, depth: float) -> float:
        """Disparity of the horizontal pair at a depth along the optical axis [m], in px."""
        return self.depth_disparity / depth + self.disparity_offset_px


def _check_same_images(left: CameraModel, other: CameraModel, name: str) -> None:
    """Checks that a camera's images have the size and the focal length of the left one's.

    Raises:
        CameraError: They have not.
    """
    if (other.width, other.height) != (left.width, left.height):
        raise CameraError(
            f"{name} camera_info is {other.width}x{other.height}; "
            f"wanted as left: {left.width}x{left.height}"
        )
    for axis in (0, 1):
        got, want = other.p[axis, axis], left.p[axis, axis]
        if abs(got - want) > _FOCAL_TOLERANCE * want:
            raise CameraError(
                f"{name} camera_info has focal length {got:g} px; wanted as left: {want:g}"
                " (rectified images share one focal length)"
            )


def _baseline(left: CameraModel, right: CameraModel) -> float:
    """Baseline of the horizontal pair [m].

    Raises:
        CameraError: The rows differ, or the baseline is zero or reversed.
    """
    if abs(right.p[1, 2] - left.p[1, 2]) > _ROW_TOLERANCE_PX:
        raise CameraError(
            f"right camera_info has cy = {right.p[1, 2]:g} px; wanted as left: "
            f"{left.p[1, 2]:g} (rows of rectified images correspond)"
        )
    tx = float(right.p[0, 3] - left.p[0, 3])
    baseline = -tx / float(left.p[0, 0])
    if abs(baseline) < _LEAST_BASELINE:
        raise CameraError(
            "baseline is 0: P[3] of the right camera_info is missing; wanted: -fx * baseline"
        )
    if baseline < 0:
        raise CameraError(
            f"baseline is {baseline:g} m: P[3] of the right camera_info is {tx:g}; wanted: "
            "-fx * baseline, negative (are left and right swapped?)"
        )
    return baseline


def _vertical_pair(left: CameraModel, top: CameraModel) -> tuple[float, float]:
    """How far `top` is above the left camera [m], and the disparity of a point at infinity [px].

    Raises:
        CameraError: The columns differ, or the baseline is zero.
    """
    if abs(top.p[0, 2] - left.p[0, 2]) > _ROW_TOLERANCE_PX:
        raise CameraError(
            f"top camera_info has cx = {top.p[0, 2]:g} px; wanted as left: "
            f"{left.p[0, 2]:g} (columns of the vertical pair correspond)"
        )
    above = float(top.p[1, 3] - left.p[1, 3]) / float(left.p[1, 1])
    if abs(above) < _LEAST_BASELINE:
        raise CameraError(
            "vertical baseline is 0: P[7] of the top camera_info is missing; "
            "wanted: fy * height of top above left"
        )
    offset = float(top.p[1, 2] - left.p[1, 2])
    # Disparity of the vertical pair grows downwards in `top` when `top` is above.
    return above, offset if above > 0 else -offset

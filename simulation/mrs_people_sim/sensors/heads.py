"""Stereo heads: the ray of every pixel, and what a sensor makes of the light."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Float, Float32
from mrs_people_loc.config import Mounting, load_yaml
from mrs_people_loc.errors import ConfigError
from mrs_people_loc.sensing.camera import CameraModel, StereoCamera
from mrs_people_loc.sensing.images import Gray
from mrs_people_sim.scene import Imaging, StereoHead


def mounting(head: StereoHead) -> Mounting:
    """The head's place on the robot, as the robot's parameters hold it."""
    return Mounting(
        height=head.height,
        forward=head.forward,
        left=head.left,
        pitch=head.pitch,
        roll=head.roll,
        yaw=head.yaw,
    )


def camera_models(head: StereoHead) -> dict[str, CameraModel]:
    """Calibration of `left`, `right` and, with three cameras, `top`.

    Raises:
        ConfigError: A calibration file cannot be used.
        CameraError: The cameras do not fit together.
    """
    if head.calibration:
        if len(head.calibration) not in (2, 3):
            raise ConfigError(
                f"calibration names {len(head.calibration)} files; wanted: left, right (and top)"
            )
        names = ("left", "right", "top")
        models = {
            name: read_calibration(Path(file))
            for name, file in zip(names, head.calibration, strict=False)
        }
    else:
        models = {"left": _model(head, 0.0, 0.0)}
        models["right"] = _model(head, -head.focal * head.baseline, 0.0)
        if head.top:
            models["top"] = _model(head, 0.0, head.focal * head.top)
    StereoCamera.from_models(models["left"], models["right"], models.get("top"))
    return models


def _model(head: StereoHead, tx: float, ty: float) -> CameraModel:
    cx = (head.width - 1) / 2 if head.cx < 0 else head.cx
    cy = (head.height_px - 1) / 2 if head.cy < 0 else head.cy
    k = np.array([[head.focal, 0.0, cx], [0.0, head.focal, cy], [0.0, 0.0, 1.0]])
    p = np.concatenate([k, [[tx], [ty], [0.0]]], axis=1)
    d = head.distortion or (0.0,) * 5
    return CameraModel(head.width, head.height_px, k, d, np.eye(3), p)


def read_calibration(path: Path) -> CameraModel:
    """A calibration file as ROS's camera_calibration writes it.

    Raises:
        ConfigError: It cannot be read or a value is missing.
        CameraError: A value cannot be used.
    """
    document = load_yaml(path)
    try:
        return CameraModel(
            width=int(document["image_width"]),
            height=int(document["image_height"]),
            k=np.array(document["camera_matrix"]["data"], dtype=np.float64).reshape(3, 3),
            d=tuple(float(v) for v in document["distortion_coefficients"]["data"]),
            r=np.array(document["rectification_matrix"]["data"], dtype=np.float64).reshape(3, 3),
            p=np.array(document["projection_matrix"]["data"], dtype=np.float64).reshape(3, 4),
            distortion_model=str(document.get("distortion_model", "plumb_bob")),
        )
    except (KeyError, TypeError, ValueError) as err:
        raise ConfigError(f"{path}: not a camera calibration: {err!r}") from err


def is_raw(head: StereoHead, models: dict[str, CameraModel]) -> bool:
    """Whether the head gives raw images, to be rectified by the robot."""
    if not head.calibration:
        return bool(head.distortion) and any(head.distortion)
    return any(any(m.d) or not np.allclose(m.r, np.eye(3)) for m in models.values())


def sample_offsets(count: int) -> Float:
    """Places of the rays in a pixel, -0.5 to 0.5, shape (count, 2).

    Each has a column and a row of its own (a Latin square), so an upright edge moves through the
    grey levels in `count` steps. They begin with the first instant of the exposure and end with
    the last, so neighbours in time lie apart.
    """
    i = np.arange(count)
    step = next((s for s in (3, 5, 7, 2) if np.gcd(s, count) == 1 and s < count), 1)
    return np.stack(
        [(i + 0.5) / count - 0.5, ((i * step + step // 2) % count + 0.5) / count - 0.5], 1
    )


@dataclass(frozen=True)
class Camera:
    """One camera of a head, with its small faults.

    Attributes:
        name: left, right or top.
        model: What its camera_info says.
        centre: Lens in the left camera's optical frame [m], shape (3,).
        rays: Directions in the left camera's optical frame, depth 1, for each sample of a pixel,
            shape (samples, height * width, 3).
        pixel_angle: Size of a sample's share of a pixel at depth 1.
        gain: Relative to the head's other cameras.
        offset: Added grey levels.
        shade: Share of light that the lens lets through, shape (height, width).
    """

    name: str
    model: CameraModel
    centre: Float
    rays: Float32
    pixel_angle: float
    gain: float
    offset: float
    shade: Float32


def make_camera(
    name: str, model: CameraModel, raw: bool, imaging: Imaging, rng: np.random.Generator
) -> Camera:
    """A camera with gain, offset and orientation drawn at random."""
    p = model.p
    centre = -np.linalg.inv(p[:, :3]) @ p[:, 3]
    v, u = np.meshgrid(
        np.arange(model.height, dtype=np.float64), np.arange(model.width, dtype=np.float64),
        indexing="ij",
    )  # fmt: skip
    pixels = np.stack([u.ravel(), v.ravel()], axis=1)
    error = rng.normal(0.0, imaging.calibration_error / p[0, 0], 3)
    if name == "left":
        # The reference: its error would be one of the mounting.
        error[:] = 0.0
    turn, _ = cv2.Rodrigues(error)
    gain = float(1.0 + rng.normal(0.0, imaging.gain_difference))
    offset = float(rng.normal(0.0, imaging.brightness_difference))
    rays = []
    for du, dv in sample_offsets(imaging.samples):
        at = pixels + (du, dv)
        if raw:
            flat = _undistort(at, model)
            direction = np.concatenate([flat, np.ones((len(flat), 1))], axis=1) @ model.r.T
        else:
            direction = np.stack(
                [
                    (at[:, 0] - p[0, 2]) / p[0, 0],
                    (at[:, 1] - p[1, 2]) / p[1, 1],
                    np.ones(len(at)),
                ],
                axis=1,
            )
        direction = direction @ turn.T
        rays.append(direction / direction[:, 2:])
    radius = np.hypot(u - p[0, 2], v - p[1, 2]) / np.hypot(model.width / 2, model.height / 2)
    return Camera(
        name,
        model,
        centre,
        np.asarray(rays, dtype=np.float32),
        float(1.0 / p[0, 0] / np.sqrt(imaging.samples)),
        gain,
        offset,
        (1.0 - imaging.vignetting * radius**2).astype(np.float32),
    )


def _undistort(pixels: NDArray, model: CameraModel) -> NDArray:
    """Directions x / z, y / z of raw pixels, shape (n, 2); inverts the distortion by iteration."""
    wanted = (pixels - model.k[:2, 2]) / [model.k[0, 0], model.k[1, 1]]
    wanted[:, 0] -= model.k[0, 1] / model.k[0, 0] * wanted[:, 1]
    d, eye, zero = np.array(model.d), np.eye(3), np.zeros(3)
    fish = model.distortion_model in ("equidistant", "fisheye")
    found = wanted.copy()
    for _ in range(60):
        if fish:
            bent = cv2.fisheye.distortPoints(found[:, None], eye, d)[:, 0]
        else:
            ahead = np.concatenate([found, np.ones((len(found), 1))], axis=1)
            bent = cv2.projectPoints(ahead, zero, zero, eye, d)[0][:, 0]
        error = wanted - bent
        found += error
        if float(np.abs(error).max()) < 1e-9:
            break
    return found


def expose(
    light: Float32, camera: Camera, exposure: float, imaging: Imaging, rng: np.random.Generator
) -> Gray:
    """Grey levels of an image.

    Args:
        light: Mean light of each pixel, shape (height, width).
        camera: Gain, offset and shade of the camera.
        exposure: Grey levels per light, the same for all cameras of a head.
        imaging: Noise, blur and gamma.
        rng: Source of the noise.
    """
    image: NDArray = light * camera.shade
    if imaging.blur > 0:
        image = cv2.GaussianBlur(image, (0, 0), imaging.blur, borderType=cv2.BORDER_REPLICATE)
    grey = np.maximum(image, 0.0) * (exposure * camera.gain)
    if imaging.gamma != 1.0:
        grey = 255.0 * (grey / 255.0) ** imaging.gamma
    grey = (grey + camera.offset).astype(np.float32)
    sigma = np.sqrt(imaging.noise**2 + imaging.shot_noise**2 * np.clip(grey, 0.0, 255.0))
    grey += sigma * rng.standard_normal(grey.shape, dtype=np.float32)
    return np.clip(np.rint(grey), 0, 255).astype(np.uint8)

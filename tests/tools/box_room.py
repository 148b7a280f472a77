"""Pictures with depth of a room made of boxes."""

from __future__ import annotations

import cv2
import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.config import Mounting
from mrs_people_loc.sensing.camera import robot_from_optical
from mrs_people_loc.sensing.images import Gray
from mrs_studies.recordings.depth_views import DepthCamera

CAMERA = DepthCamera(525, 525, 319.5, 239.5)
HEAD = Mounting(height=1.1, pitch=0.1)
#: Boxes: lower and upper corner [m], and how bright they are.
Box = tuple[tuple[float, float, float], tuple[float, float, float], float]
BOX: tuple[Box, ...] = (((2.0, -1.4, 0.0), (2.6, -0.6, 0.5), 60),)


def person(x: float, y: float) -> tuple[Box, ...]:
    """Somebody in dark clothes who stands there: legs, trunk, arms and a head."""

    def part(depth: float, left: float, right: float, low: float, high: float, grey: float) -> Box:
        return (x - depth, y + left, low), (x + depth, y + right, high), grey

    return (
        part(0.09, -0.17, -0.02, 0.0, 0.85, 40),
        part(0.09, 0.02, 0.17, 0.0, 0.85, 40),
        part(0.12, -0.2, 0.2, 0.85, 1.46, 60),
        part(0.07, -0.29, -0.21, 0.8, 1.42, 60),
        part(0.07, 0.21, 0.29, 0.8, 1.42, 60),
        part(0.06, -0.06, 0.06, 1.46, 1.54, 190),
        part(0.1, -0.085, 0.085, 1.52, 1.76, 190),
    )


def picture(
    boxes: tuple[Box, ...] = (),
    *,
    mounting: Mounting = HEAD,
    camera: DepthCamera = CAMERA,
    size: tuple[int, int] = (640, 480),
) -> tuple[Gray, Float]:
    """A floor, a wall 5 m ahead, and boxes: the picture, and its depth [m]."""
    rotation, lens = robot_from_optical(mounting)
    columns, rows = np.meshgrid(np.arange(size[0]), np.arange(size[1]))
    optical = np.stack(
        [(columns - camera.cx) / camera.fx, (rows - camera.cy) / camera.fy, np.ones(rows.shape)],
        axis=-1,
    )
    rays = optical @ rotation.T
    noise = np.random.default_rng(0).normal(0, 1, size[::-1])
    texture = 200 * np.asarray(cv2.GaussianBlur(noise, (0, 0), 4))
    with np.errstate(divide="ignore", invalid="ignore"):
        depth = np.where(rays[..., 2] < 0, -lens[2] / rays[..., 2], np.inf)
        wall = np.where(rays[..., 0] > 0, 5 / rays[..., 0], np.inf)
        grey = np.where(wall < depth, 140.0, 100.0)
        depth = np.minimum(depth, wall)
        for low, high, bright in boxes:
            first, last = ((np.array(corner) - lens) / rays for corner in (low, high))
            enter, leave = np.minimum(first, last).max(-1), np.maximum(first, last).min(-1)
            hit = (enter < leave) & (enter > 0) & (enter < depth)
            depth, grey = np.where(hit, enter, depth), np.where(hit, bright, grey)
    return np.clip(grey + texture, 0, 255).astype(np.uint8), depth

"""Converts PCL's RGB-D frame of five people to stereo pairs."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.errors import ConfigError
from mrs_people_loc.sensing.camera import CameraModel
from mrs_people_sim.robot_writer import RobotWriter
from mrs_studies.recordings.frames import EPOCH_NS, reduced, scaled
from mrs_studies.recordings.pcd import read_rgbd
from mrs_studies.recordings.right_view import fill_depth, render_right
from mrs_tools.bags.writer import BagWriter

#: Camera of PCL's `five_people.pcd`: focal length and principal point [px] (exact for its points).
PCL_FOCAL_PX, PCL_CX_PX, PCL_CY_PX = 525.0, 319.5, 239.5
#: The floor's normal (upwards) in its optical frame.
PCL_FLOOR_NORMAL = (0.002, -0.9973, -0.0737)
#: Torsos (x, z) in its optical frame [m], read from its depth: surfaces, not the bodies' axes.
PCL_TORSOS_M = ((-0.90, 1.97), (-0.55, 2.30), (0.03, 2.75), (0.46, 2.50), (0.77, 1.80))


def convert_pcl(
    file: Path,
    out: Path,
    *,
    robot: str = "robot_a",
    repeat: int = 10,
    rate_hz: float = 5.0,
    baseline_m: float = 0.12,
    reduce: int = 1,
    noise_grey: float = 2.0,
) -> int:
    """Writes PCL's RGB-D frame of five people as a bag of rectified stereo pairs.

    Left is the frame's grey image, right is the left one as a camera `baseline_m` to the right
    would see it (see `render_right`), pixels without a depth filled by `fill_depth`. The pair is
    repeated; each repetition has sensor noise of its own in both images.

    The robot stands at the origin of `map`, under the camera, which looks along x. Nobody
    measured where the people are: `/ground_truth/people_poses` holds the torsos as they were read
    from the depth (`torsos_in_map`), i.e. the surface that the camera sees, some 0.1 m in front
    of the body's axis.

    Args:
        file: The organised PCD file, with x, y, z and rgba.
        out: The bag: a folder, or one file if it ends in `.mcap`.
        robot: The robot's name.
        repeat: Number of pairs.
        rate_hz: Pairs per second.
        baseline_m: Distance between the cameras [m].
        reduce: Images are scaled down by 1, 2, 4, ... (by area).
        noise_grey: Standard deviation of the noise [grey levels].

    Returns:
        Number of stereo pairs written.

    Raises:
        BagError: The file cannot be read, is no such frame, or `out` exists.
        ConfigError: `robot` or a number is not allowed.
    """
    for name, value, low in (
        ("repeat", repeat, 1),
        ("rate", rate_hz, 1e-3),
        ("baseline", baseline_m, 1e-3),
        ("noise", noise_grey, 0.0),
    ):
        if not (math.isfinite(value) and value >= low):
            raise ConfigError(f"{name} is {value}; allowed: at least {low:g}")
    image, depth = read_rgbd(file)
    left, right = _pcl_cameras(image.shape, baseline_m, reduce)
    right_image = render_right(image, fill_depth(depth), PCL_FOCAL_PX * baseline_m)
    views = [scaled(view, left).astype(np.float64) for view in (image, right_image)]
    truth = torsos_in_map()
    rng = np.random.default_rng(0)
    period_ns = 1e9 / rate_hz
    with BagWriter(out) as writer:
        bag = RobotWriter(writer, robot)
        bag.odometry_at_origin(EPOCH_NS - round(period_ns))
        for index in range(repeat):
            ns = EPOCH_NS + round(index * period_ns)
            noisy = [
                np.clip(np.rint(v + rng.normal(0.0, noise_grey, v.shape)), 0, 255).astype(np.uint8)
                for v in views
            ]
            bag.odometry_at_origin(ns)
            bag.camera("left", "image_rect", noisy[0], left, ns)
            bag.camera("right", "image_rect", noisy[1], right, ns)
            bag.ground_truth(truth, ns)
        bag.odometry_at_origin(EPOCH_NS + round(repeat * period_ns))
    return repeat


def _pcl_cameras(
    shape: tuple[int, ...], baseline_m: float, reduce: int
) -> tuple[CameraModel, CameraModel]:
    k = np.array([[PCL_FOCAL_PX, 0.0, PCL_CX_PX], [0.0, PCL_FOCAL_PX, PCL_CY_PX], [0.0, 0.0, 1.0]])
    left = CameraModel(
        width=shape[1],
        height=shape[0],
        k=k,
        d=(0.0,) * 5,
        r=np.eye(3),
        p=np.column_stack([k, np.zeros(3)]),
    )
    p_right = left.p.copy()
    p_right[0, 3] = -PCL_FOCAL_PX * baseline_m
    right = dataclasses.replace(left, p=p_right)
    return reduced(left, reduce), reduced(right, reduce)


def pcl_pitch() -> float:
    """How far the camera of PCL's frame looks down [rad].

    The floor's normal has a component against the optical axis: ahead, the axis sinks.
    """
    normal = np.array(PCL_FLOOR_NORMAL)
    return math.asin(-normal[2] / float(np.linalg.norm(normal)))


def torsos_in_map() -> Float:
    """The torsos of PCL's frame on the floor, for a robot at the origin of `map`.

    They are given as (x, z) of the optical frame; at the height of the optical axis, which is
    that of a torso, z along the axis is z * cos(pitch) along the floor.

    Returns:
        x and y [m], shape (5, 2), from left to right in the image.
    """
    torsos = np.array(PCL_TORSOS_M)
    return np.column_stack([torsos[:, 1] * math.cos(pcl_pitch()), -torsos[:, 0]])

"""Converts OAK-D stereo videos with their calibration."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.errors import BagError, CameraError
from mrs_people_loc.sensing.camera import CameraModel
from mrs_people_loc.sensing.images import Gray
from mrs_people_sim.robot_writer import RobotWriter
from mrs_ros.closing import Closing
from mrs_studies.recordings.frames import EPOCH_NS, reduced, scaled
from mrs_tools.bags.writer import BagWriter

#: Centimetres in OAK's calib.json.
_CM = 0.01


def convert_oak(
    folder: Path,
    out: Path,
    *,
    robot: str = "robot_a",
    frames: slice = slice(None),
    reduce: int = 2,
) -> int:
    """Writes an OAK-D recording (left.mp4, right.mp4, calib.json) as a bag of raw images.

    The images stay as they were taken; `camera_info` holds what rectifies them. The robot stands
    at the origin of `map`, under the left camera; frame i has the stamp that the videos' rate
    gives it, also where frames are left out.

    Args:
        folder: Where the three files lie.
        out: The bag: a folder, or one file if it ends in `.mcap`.
        robot: The robot's name.
        frames: Which frames to take.
        reduce: Images are scaled down by 1, 2, 4, ... (by area).

    Returns:
        Number of stereo pairs written.

    Raises:
        BagError: A file cannot be read, the videos differ, no frame is left, or `out` exists.
        CameraError: calib.json is not the calibration of this stereo pair.
        ConfigError: `robot`, `frames` or `reduce` is not allowed.
    """
    left, right = read_oak_calibration(folder / "calib.json", reduce)
    count = 0
    with _Videos(folder / "left.mp4", folder / "right.mp4") as videos:
        period_ns = 1e9 / videos.rate_hz
        for video, model in zip(videos.sizes, (left, right), strict=True):
            calibrated = (model.width * reduce, model.height * reduce)
            if video != calibrated:
                raise BagError(
                    f"{folder}: the images are {video[0]}x{video[1]}; calib.json is of "
                    f"{calibrated[0]}x{calibrated[1]}"
                )
        wanted = _indices(frames, len(videos))
        if not wanted:
            raise BagError(f"{folder}: no frame is left of the {len(videos)} in the videos")
        with BagWriter(out) as writer:
            bag = RobotWriter(writer, robot)
            bag.odometry_at_origin(EPOCH_NS + round((wanted.start - 1) * period_ns))
            for index, left_image, right_image in videos.read(wanted):
                ns = EPOCH_NS + round(index * period_ns)
                bag.odometry_at_origin(ns)
                bag.camera("left", "image_raw", scaled(left_image, left), left, ns)
                bag.camera("right", "image_raw", scaled(right_image, right), right, ns)
                count += 1
            bag.odometry_at_origin(EPOCH_NS + round((wanted[-1] + 1) * period_ns))
    return count


def read_oak_calibration(path: Path, reduce: int = 1) -> tuple[CameraModel, CameraModel]:
    """Reads the stereo pair of OAK's calib.json, with the rectification of `cv2.stereoRectify`.

    Distances in the file are centimetres. Distortion is OpenCV's rational model with 14
    coefficients. The rectified images are zoomed so that every pixel comes from the raw ones
    (alpha = 0).

    Args:
        path: The file.
        reduce: The models are of images that are so many times smaller.

    Returns:
        The left and the right camera; P[3] of the right one is -f * baseline [px m].

    Raises:
        BagError: The file cannot be read.
        CameraError: It holds no calibrated pair, or its left camera is not at the left.
        ConfigError: `reduce` does not divide the images' size.
    """
    try:
        document = json.loads(path.read_text(encoding="utf-8"))
    except FileNotFoundError as err:
        raise BagError(f"{path}: there is no such file") from err
    except (OSError, ValueError, RecursionError) as err:  # RecursionError: lists in lists in lists
        raise BagError(f"{path} cannot be read: {err}") from err
    try:
        sockets = document["stereoRectificationData"]
        cameras = dict(document["cameraData"])
        left, right = cameras[sockets["leftCameraSocket"]], cameras[sockets["rightCameraSocket"]]
        k1, d1, size = _oak_intrinsics(left)
        k2, d2, right_size = _oak_intrinsics(right)
        extrinsics = left["extrinsics"]
        rotation = np.array(extrinsics["rotationMatrix"], dtype=np.float64).reshape(3, 3)
        translation = np.array([[extrinsics["translation"][axis] * _CM] for axis in "xyz"])
        to_socket = extrinsics["toCameraSocket"]
    except (KeyError, TypeError, ValueError, OverflowError) as err:
        raise CameraError(f"{path} is not an OAK calibration: {err!r}") from err
    if to_socket != sockets["rightCameraSocket"] or size != right_size:
        raise CameraError(f"{path}: the left camera's extrinsics do not lead to the right camera")
    # A point moves towards -x from the left camera's frame to the right one's.
    if translation[0, 0] >= 0:
        raise CameraError(
            f"{path}: the right camera is {-translation[0, 0]:g} m to the right of the left one; "
            "allowed: more than 0 (are the sockets swapped?)"
        )
    try:
        r1, r2, p1, p2, *_ = cv2.stereoRectify(
            k1, d1, k2, d2, size, rotation, translation, flags=cv2.CALIB_ZERO_DISPARITY, alpha=0
        )
    except cv2.error as err:
        raise CameraError(f"{path}: the pair cannot be rectified: {err.err}") from err
    models = []
    for k, d, r, p in ((k1, d1, r1, p1), (k2, d2, r2, p2)):
        model = CameraModel(
            width=size[0],
            height=size[1],
            k=k,
            d=tuple(map(float, d)),
            r=np.asarray(r, dtype=np.float64),
            p=np.asarray(p, dtype=np.float64),
            distortion_model="rational_polynomial",
        )
        models.append(reduced(model, reduce))
    return models[0], models[1]


def _oak_intrinsics(camera: Mapping[str, Any]) -> tuple[Float, Float, tuple[int, int]]:
    k = np.array(camera["intrinsicMatrix"], dtype=np.float64).reshape(3, 3)
    d = np.array(camera["distortionCoeff"], dtype=np.float64).reshape(14)
    width, height = int(camera["width"]), int(camera["height"])
    # Checks all of it, before OpenCV computes with it.
    CameraModel(width, height, k, tuple(d), np.eye(3), np.column_stack([k, np.zeros(3)]))
    return k, d, (width, height)


class _Videos(Closing):
    """The two videos of a stereo pair, read in step."""

    def __init__(self, left: Path, right: Path) -> None:
        self._paths = (left, right)
        self._captures = [cv2.VideoCapture(str(path)) for path in self._paths]
        for path, capture in zip(self._paths, self._captures, strict=True):
            if not capture.isOpened():
                raise BagError(f"{path} cannot be read as a video")
        counts = [int(c.get(cv2.CAP_PROP_FRAME_COUNT)) for c in self._captures]
        rates = [c.get(cv2.CAP_PROP_FPS) for c in self._captures]
        if counts[0] != counts[1] or rates[0] != rates[1] or not rates[0] > 0:
            raise BagError(
                f"{left} and {right} are no stereo pair: {counts[0]} and {counts[1]} frames "
                f"at {rates[0]:g} and {rates[1]:g} Hz"
            )
        self._count, self.rate_hz = counts[0], rates[0]
        sides = (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
        #: Width and height of the images [px], left and right.
        self.sizes = [tuple(int(c.get(side)) for side in sides) for c in self._captures]

    def __len__(self) -> int:
        return self._count

    def close(self) -> None:
        for capture in self._captures:
            capture.release()

    def read(self, wanted: range) -> Iterator[tuple[int, Gray, Gray]]:
        """Yields index, left and right image; decodes one by one, for seeking is not exact."""
        for index in range(wanted[-1] + 1):
            if not all(capture.grab() for capture in self._captures):
                raise BagError(f"{self._paths[0].parent}: the videos end before frame {index}")
            if index in wanted:
                images = []
                for capture in self._captures:
                    _, image = capture.retrieve()
                    gray = image if image.ndim == 2 else cv2.cvtColor(image, cv2.COLOR_BGR2GRAY)
                    images.append(gray.astype(np.uint8))
                yield index, images[0], images[1]


def _indices(frames: slice, count: int) -> range:
    return range(count)[frames]

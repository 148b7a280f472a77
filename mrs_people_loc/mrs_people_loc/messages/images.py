"""Images and their calibration."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.errors import CameraError, ImageError
from mrs_people_loc.messages.stamps import Message
from mrs_people_loc.sensing.camera import CameraModel

if TYPE_CHECKING:
    from mrs_people_loc.sensing.images import Gray

#: Image encodings that are read: channels, and the name of OpenCV's conversion to grey. Those that
#: name no colours are OpenCV's own, whose order is blue, green, red.
ENCODINGS = {
    "mono8": (1, ""),
    "bgr8": (3, "COLOR_BGR2GRAY"),
    "rgb8": (3, "COLOR_RGB2GRAY"),
    "bgra8": (4, "COLOR_BGRA2GRAY"),
    "rgba8": (4, "COLOR_RGBA2GRAY"),
    "8UC1": (1, ""),
    "8UC3": (3, "COLOR_BGR2GRAY"),
}


def read_camera_info(message: Message) -> CameraModel:
    """Reads sensor_msgs/CameraInfo.

    Raises:
        CameraError: A value cannot be used.
    """
    binning = (int(message.binning_x), int(message.binning_y))
    if binning not in ((0, 0), (1, 1)):
        raise CameraError(f"binning is {binning[0]}x{binning[1]}; allowed: none")
    roi = message.roi
    if int(roi.width) not in (0, int(message.width)) or int(roi.height) not in (
        0,
        int(message.height),
    ):
        raise CameraError(f"roi is {roi.width}x{roi.height}; allowed: none or the full image")
    return CameraModel(
        width=int(message.width),
        height=int(message.height),
        k=_matrix(message, "k", (3, 3)),
        d=tuple(float(value) for value in message.d),
        r=_matrix(message, "r", (3, 3)),
        p=_matrix(message, "p", (3, 4)),
        distortion_model=str(message.distortion_model),
    )


def _matrix(message: Message, name: str, shape: tuple[int, int]) -> Float:
    values = np.array(getattr(message, name), dtype=np.float64)
    if values.size != shape[0] * shape[1]:
        raise CameraError(f"{name} has {values.size} values; wanted: {shape[0] * shape[1]}")
    return values.reshape(shape)


def read_image(message: Message) -> Gray:
    """Reads sensor_msgs/Image as grey, uint8, shape (height, width).

    Raises:
        ImageError: The encoding is not one of `ENCODINGS`, or sizes and data do not fit.
    """
    height, width, step = int(message.height), int(message.width), int(message.step)
    if message.encoding not in ENCODINGS:
        raise ImageError(f"encoding is {message.encoding!r}; allowed: {', '.join(ENCODINGS)}")
    channels, conversion = ENCODINGS[message.encoding]
    if height == 0 or width == 0:
        raise ImageError(f"image is {width}x{height}; wanted: more than 0x0")
    if step < width * channels:
        raise ImageError(
            f"step is {step} bytes; wanted for {message.encoding} at width {width}: "
            f"at least {width * channels}"
        )
    data = np.frombuffer(message.data, dtype=np.uint8)
    if data.size != step * height:
        raise ImageError(f"data has {data.size} bytes; wanted: step * height = {step * height}")
    rows = data.reshape(height, step)[:, : width * channels]
    if not conversion:
        return np.ascontiguousarray(rows)
    import cv2  # here: a planner does without it, and is there sooner

    return cv2.cvtColor(rows.reshape(height, width, channels), getattr(cv2, conversion))  # type: ignore[return-value]

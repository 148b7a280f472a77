"""Images of a head: rectified, scaled to the working size, and paired by their stamps."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Generic, TypeVar

import cv2
import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.clocks import Order, StampOrder
from mrs_people_loc.errors import CameraError, ImageError
from mrs_people_loc.sensing.camera import CameraModel

Gray = NDArray[np.uint8]

_T = TypeVar("_T")
#: Largest image that is rectified here: what rectifies it takes six bytes per pixel.
_MAX_RAW_PX = 4096 * 4096

#: The time between images is the median of so many of their camera [frames].
_PERIODS = 9


@dataclass(frozen=True)
class StereoImages:
    """One rectified view of a head, all of one size.

    Attributes:
        stamp_ns: Time of the left image [ns].
        left: Left image, uint8, shape (height, width).
        right: Right image, the same.
        top: Image of the third camera, or None.
    """

    stamp_ns: int
    left: Gray
    right: Gray
    top: Gray | None = None

    def __post_init__(self) -> None:
        """Checks types and sizes.

        Raises:
            ImageError: An image is not uint8 grey, or their sizes differ.
        """
        for name in ("left", "right", "top"):
            image = getattr(self, name)
            if image is None and name == "top":
                continue
            if image.dtype != np.uint8 or image.ndim != 2:
                raise ImageError(
                    f"{name} image is {image.dtype} of shape {image.shape}; "
                    "wanted: uint8 of shape (height, width)"
                )
            if image.shape != self.left.shape:
                raise ImageError(
                    f"{name} image is {image.shape[1]}x{image.shape[0]}; "
                    f"wanted as left: {self.left.shape[1]}x{self.left.shape[0]}"
                )


class ImagePreparer:
    """Brings one camera's images to rectified grey images of the working size.

    Raw images are rectified at their own resolution and then scaled by area, so no detail folds
    into the small image.

    Args:
        model: Calibration of the images that come in.
        rectified: Whether the images are rectified already.
        width: Working width [px]; larger images are scaled down to fit.
        height: Working height [px].

    Raises:
        CameraError: The images are raw and the model cannot rectify them.
    """

    def __init__(self, model: CameraModel, *, rectified: bool, width: int, height: int) -> None:
        self.model = model
        self.output = model.scaled_to_fit(width, height)
        self._maps = None if rectified else _rectification_maps(model)

    def check_size(self, image: Gray) -> None:
        """Checks that an image has the model's size.

        Raises:
            ImageError: It has not.
        """
        if image.shape != (self.model.height, self.model.width):
            raise ImageError(
                f"image is {image.shape[1]}x{image.shape[0]}; wanted as in camera_info: "
                f"{self.model.width}x{self.model.height}"
            )

    def __call__(self, image: Gray) -> Gray:
        """Prepares one image.

        Args:
            image: Grey image, uint8, of the size in the model.

        Raises:
            ImageError: The image's size differs from the model's.
        """
        self.check_size(image)
        if self._maps is not None:
            image = cv2.remap(image, *self._maps, cv2.INTER_LINEAR)  # type: ignore[assignment]
        if image.shape != (self.output.height, self.output.width):
            size = (self.output.width, self.output.height)
            image = cv2.resize(image, size, interpolation=cv2.INTER_AREA)  # type: ignore[assignment]
        return image


def _rectification_maps(model: CameraModel) -> tuple[NDArray[np.int16], NDArray[np.uint16]]:
    model.check_raw()
    size = (model.width, model.height)
    if model.width * model.height > _MAX_RAW_PX:
        raise CameraError(
            f"raw images are {model.width}x{model.height}; allowed, where they are rectified here: "
            f"up to {_MAX_RAW_PX} pixels. Let the driver scale or rectify them"
        )
    new_k = model.p[:, :3]
    d = np.array(model.d or (0.0,) * 4)
    fisheye = model.distortion_model in ("equidistant", "fisheye")
    undistort = cv2.fisheye.initUndistortRectifyMap if fisheye else cv2.initUndistortRectifyMap
    try:
        maps = undistort(model.k, d, model.r, new_k, size, cv2.CV_16SC2)
    except cv2.error as err:
        raise CameraError(f"OpenCV cannot rectify with this camera_info: {err}") from err
    return maps  # type: ignore[return-value]


@dataclass
class Pairer(Generic[_T]):
    """Finds the images of different cameras that belong together, by their stamps.

    Each camera has a bounded queue. A set is complete when every camera has an image within
    `max_difference_ns` of the first camera's; of several, the nearest. Images older than a set
    that was found can pair no more and are dropped.

    Attributes:
        cameras: Names; the first one gives the set's stamp.
        max_difference_ns: Greatest difference of stamps in a set [ns].
        queue_size: Images that wait, per camera.
        unpaired: Images that were dropped without a pair, so far.
        smallest_difference_ns: Smallest difference that was seen for an image that never paired
            since this was last reset; None if no image of the other camera was there.
        resets: How often stamps jumped back and went on from there, so far.
    """

    cameras: tuple[str, ...]
    max_difference_ns: int = 0
    queue_size: int = 8
    unpaired: int = 0
    resets: int = 0
    smallest_difference_ns: int | None = None
    _queues: dict[str, deque[tuple[int, _T]]] = field(default_factory=dict)
    _orders: dict[str, StampOrder] = field(default_factory=dict)
    _periods: dict[str, deque[int]] = field(default_factory=dict)

    def __post_init__(self) -> None:
        """Makes the queues."""
        self._queues = {camera: deque() for camera in self.cameras}
        self._orders = {camera: StampOrder() for camera in self.cameras}
        self._periods = {camera: deque(maxlen=_PERIODS) for camera in self.cameras}

    def reset(self) -> None:
        """Forgets what waits; the counts stay."""
        for queue in self._queues.values():
            queue.clear()
        for order in self._orders.values():
            order.reset()
        self.smallest_difference_ns = None

    def add(self, camera: str, stamp_ns: int, item: _T) -> Mapping[str, tuple[int, _T]] | None:
        """Takes an image and returns the set it completes, or None.

        Args:
            camera: Its name.
            stamp_ns: Its stamp [ns].
            item: The image, in any form.

        Returns:
            Stamp and item by camera.

        Raises:
            ImageError: The stamp is not newer than that of the camera's last image.
        """
        newest_ns = self._orders[camera].newest_ns
        order = self._orders[camera].take(stamp_ns)
        if order is Order.LATE:
            raise ImageError(f"stamp is {stamp_ns} ns; wanted: newer than {newest_ns} ns")
        if order is Order.RESTART:
            self.reset()
            self._orders[camera].take(stamp_ns)
            self.resets += 1
        elif newest_ns is not None:
            self._periods[camera].append(stamp_ns - newest_ns)
        queue = self._queues[camera]
        queue.append((stamp_ns, item))
        if len(queue) > self.queue_size:
            self._drop(camera)
        return self._match(stamp_ns)

    def why_unpaired(self) -> str:
        """Why images find no pair, in words: what was seen, what is allowed, and what to do."""
        nearest_ns = self.smallest_difference_ns
        allowed = f"allowed by images.max_stamp_difference: {self.max_difference_ns / 1e9:g} s"
        if nearest_ns is None:
            return (
                "smallest difference of stamps seen: no image of the other camera that can be "
                f"used; {allowed}"
            )
        text = f"smallest difference of stamps seen: {nearest_ns / 1e9:.4f} s; {allowed}"
        periods = [sorted(p)[len(p) // 2] for p in self._periods.values() if p]
        if nearest_ns <= self.max_difference_ns or not periods:
            return text
        # Two cameras that run by themselves at one rate are never farther apart than that.
        half_ns = max(periods) / 2
        if nearest_ns <= 1.1 * half_ns:
            enough = math.ceil(max(half_ns, nearest_ns) / 1e6) / 1e3
            return (
                f"{text}; trigger the cameras together, or, where nothing moves fast, set "
                f"images.max_stamp_difference: {enough:g} (half of the time between images)"
            )
        return (
            f"{text}; that is more than half of the {max(periods) / 1e9:.4f} s between images: the "
            "cameras' stamps are of different clocks, or one of them is late by a constant"
        )

    def _match(self, stamp_ns: int) -> Mapping[str, tuple[int, _T]] | None:
        first = self.cameras[0]
        candidates = [q for q in self._queues[first] if self._near(q[0], stamp_ns)]
        best: dict[str, tuple[int, _T]] | None = None
        best_difference = -1
        for reference in candidates:
            found = {first: reference}
            for other in self.cameras[1:]:
                near = [q for q in self._queues[other] if self._near(q[0], reference[0])]
                if not near:
                    break
                found[other] = min(near, key=lambda q: abs(q[0] - reference[0]))
            else:
                difference = max(abs(s - reference[0]) for s, _ in found.values())
                if best is None or difference < best_difference:
                    best, best_difference = found, difference
        if best is None:
            return None
        for name, (stamp, _) in best.items():
            queue = self._queues[name]
            while queue[0][0] < stamp:
                self._drop(name)
            queue.popleft()
        return best

    def _near(self, one_ns: int, other_ns: int) -> bool:
        return abs(one_ns - other_ns) <= self.max_difference_ns

    def _drop(self, camera: str) -> None:
        stamp, _ = self._queues[camera].popleft()
        self.unpaired += 1
        for other in self.cameras:
            if other != camera:
                for other_stamp, _ in self._queues[other]:
                    difference = abs(stamp - other_stamp)
                    if (
                        self.smallest_difference_ns is None
                        or difference < self.smallest_difference_ns
                    ):
                        self.smallest_difference_ns = difference

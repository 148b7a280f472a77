"""A robot's head as it comes in: calibration and images as messages, stages of each view out."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrs_people_loc import messages, timing
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.errors import CameraError, ImageError, UncalibratedError, WaitedError
from mrs_people_loc.robot import RobotPipeline, Stages
from mrs_people_loc.sensing.camera import CameraModel, StereoCamera
from mrs_people_loc.sensing.images import Gray, ImagePreparer, Pairer, StereoImages


@dataclass(frozen=True)
class View:
    """One view of a head.

    Attributes:
        header: Header of the left image's message.
        images: The rectified images.
        stages: Everything that was made of them.
        prepare_ms: What rectifying and scaling took [ms].
    """

    header: Any
    images: StereoImages
    stages: Stages
    prepare_ms: float


@dataclass(frozen=True)
class _Received:
    header: Any
    encoding: str
    image: Gray


class Head:
    """Takes a head's messages and runs the robot's pipeline on every complete view.

    The calibration comes with every image; it is read again only when it changes. It may come a
    moment after the first images: the newest set of images waits for it.

    Args:
        robot: The robot's name.
        config: Its configuration.
        make: Makes the pipeline of robot, camera and configuration.

    Attributes:
        cameras: Names of its cameras: left, right and, if configured, top.
        pipeline: The pipeline; None until the calibration of all cameras is there and fits.
        pairer: Finds the images that belong together.
    """

    def __init__(
        self,
        robot: str,
        config: RobotConfig,
        make: Callable[[str, StereoCamera, RobotConfig], Any] = RobotPipeline,
    ) -> None:
        self.cameras = ("left", "right", "top") if config.images.top else ("left", "right")
        self.pipeline: Any = None
        self._robot = robot
        self._make = make
        self._config = config
        self.pairer = self._new_pairer()
        self._keys: dict[str, Any] = {}
        self._models: dict[str, CameraModel] = {}
        self._preparers: dict[str, ImagePreparer] = {}
        self._waiting: Mapping[str, tuple[int, _Received]] | None = None
        self._why_not = ""

    def configure(self, config: RobotConfig) -> None:
        """Takes another configuration, from the next view on.

        Raises:
            CameraError: It does not fit the cameras, and the old one does; that one stays.
        """
        if len(self._models) == len(self.cameras):
            try:
                self._preparers, self.pipeline = self._build(config)
            except CameraError as err:
                if self.pipeline is not None:
                    raise
                self._why_not = str(err)
        images_changed, self._config = config.images != self._config.images, config
        if images_changed:
            self.pairer = self._new_pairer()

    def reset(self) -> None:
        """Forgets the images that wait."""
        self.pairer.reset()
        self._waiting = None

    def take_camera_info(self, camera: str, message: Any) -> View | None:
        """Takes a sensor_msgs/CameraInfo and returns the view that waited for it, if one did.

        Raises:
            CameraError: It cannot be used, or does not fit the other cameras.
            WaitedError: It can, and an image that waited does not fit it.
        """
        roi = message.roi
        key = (
            message.width,
            message.height,
            message.distortion_model,
            *(np.asarray(m).tobytes() for m in (message.k, message.d, message.r, message.p)),
            (message.binning_x, message.binning_y, roi.width, roi.height),
        )
        if self._keys.get(camera) == key:
            return None
        self._keys[camera] = key
        self._models.pop(camera, None)
        self._preparers, self.pipeline = {}, None
        try:
            self._models[camera] = messages.read_camera_info(message)
            if len(self._models) < len(self.cameras):
                return None
            self._preparers, self.pipeline = self._build(self._config)
        except CameraError as err:
            self._why_not = str(err)
            raise
        waited, self._waiting = self._waiting, None
        if waited is None:
            return None
        for camera in self.cameras:
            try:
                self._check(camera, waited)
            except ImageError as err:
                raise WaitedError(camera, str(err)) from err
        return self._process(waited)

    def take_image(self, camera: str, message: Any) -> View | None:
        """Takes a sensor_msgs/Image and returns the view that it completes, or None.

        Raises:
            ImageError: It cannot be used, or does not fit its calibration or the other images.
            UncalibratedError: It is of no use while there is no calibration.
            StampError: Its stamp is 0.
        """
        stamp_ns = messages.read_stamp(message)
        image = messages.read_image(message)
        if camera in self._preparers:
            self._preparers[camera].check_size(image)
        received = _Received(message.header, message.encoding, image)
        found = self.pairer.add(camera, stamp_ns, received)
        if found is None:
            return None
        if self.pipeline is not None:
            return self._process(found)
        waited, self._waiting = self._waiting, found
        if waited is not None:
            missing = ", ".join(c for c in self.cameras if c not in self._keys)
            why = f"no camera_info of {missing}" if missing else self._why_not
            raise UncalibratedError(f"images are not used: {why}")
        return None

    def _process(self, found: Mapping[str, tuple[int, _Received]]) -> View:
        stamp_ns, left = found["left"]
        for camera in found:
            self._check(camera, found)
        began_ns = timing.now_ns()
        prepared = {c: self._preparers[c](received.image) for c, (_, received) in found.items()}
        images = StereoImages(stamp_ns, **prepared)
        prepare_ms = (timing.now_ns() - began_ns) / 1e6
        return View(left.header, images, self.pipeline.stages(images), prepare_ms)

    def _check(self, camera: str, found: Mapping[str, tuple[int, _Received]]) -> None:
        _, left = found["left"]
        _, received = found[camera]
        if received.encoding != left.encoding:
            raise ImageError(
                f"encoding of the {camera} image is {received.encoding!r}; "
                f"wanted as left: {left.encoding!r}"
            )
        self._preparers[camera].check_size(received.image)

    def _build(self, config: RobotConfig) -> tuple[dict[str, ImagePreparer], Any]:
        preparers = {
            camera: ImagePreparer(
                self._models[camera],
                rectified=config.images.rectified,
                width=config.images.working_width,
                height=config.images.working_height,
            )
            for camera in self.cameras
        }
        outputs = {camera: preparer.output for camera, preparer in preparers.items()}
        camera = StereoCamera.from_models(
            outputs["left"], outputs["right"], outputs.get("top"), config.mounting
        )
        return preparers, self._make(self._robot, camera, config)

    def _new_pairer(self) -> Pairer[_Received]:
        images = self._config.images
        return Pairer(self.cameras, round(images.max_stamp_difference * 1e9), images.queue_size)

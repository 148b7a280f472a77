"""One robot: from its images to its scan, by the paper's method (section 5) or the default one."""

from __future__ import annotations

from mrs_people_loc.bodies.finder import BODY_TUNING, BodyTuning
from mrs_people_loc.bodies.scanner import BodyScanner, BodyStages
from mrs_people_loc.cells.scanner import CellScanner, CellStages
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.scan import Scan
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.disparity import StereoMatcher
from mrs_people_loc.sensing.images import StereoImages
from mrs_people_loc.timing import StageTimes

#: All intermediate results of one view, of the paper's method or of the default one.
Stages = CellStages | BodyStages


class RobotPipeline:
    """Makes scans of a robot's rectified images.

    Args:
        robot: The robot's name.
        camera: Its head, with the mounting.
        config: Its configuration.
        tuning: Constants of the default method.

    Attributes:
        matcher: Makes its disparities.

    Raises:
        CameraError: Camera and configuration do not fit together.
    """

    def __init__(
        self,
        robot: str,
        camera: StereoCamera,
        config: RobotConfig,
        tuning: BodyTuning = BODY_TUNING,
    ) -> None:
        self.robot = robot
        self.camera = camera
        self.config = config
        self.matcher = StereoMatcher(camera, config.disparity)
        self._scan: CellScanner | BodyScanner
        if config.bodies.search:
            self._scan = BodyScanner(robot, camera, config, tuning)
        else:
            self._scan = CellScanner(robot, camera, config)

    def step(self, images: StereoImages) -> Scan:
        """The scan of one view.

        Raises:
            ImageError: The images do not fit the camera.
        """
        return self.stages(images).scan

    def stages(self, images: StereoImages) -> Stages:
        """The scan of one view, and all intermediate results.

        Raises:
            ImageError: The images do not fit the camera.
        """
        times = StageTimes()
        disparity = self.matcher(images)
        times.mark("disparity")
        return self._scan(disparity, images, times)

"""One robot: from images to its scan, stage by stage as in the paper's section 5."""

from __future__ import annotations

from mrs_people_loc.bodies.scanner import BodyScanner, BodyStages
from mrs_people_loc.cells.scanner import CellScanner, CellStages
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.scan import Scan
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.disparity import StereoMatcher
from mrs_people_loc.sensing.images import StereoImages
from mrs_people_loc.timing import StageTimes

#: Everything that one view went through, by the paper's method or by the default one.
Stages = CellStages | BodyStages


class RobotPipeline:
    """Makes scans of a robot's rectified images.

    Args:
        robot: The robot's name.
        camera: Its head, with the mounting.
        config: Its configuration.

    Attributes:
        matcher: Makes its disparities.

    Raises:
        CameraError: Camera and configuration do not fit together.
    """

    def __init__(self, robot: str, camera: StereoCamera, config: RobotConfig) -> None:
        self.robot = robot
        self.camera = camera
        self.config = config
        self.matcher = StereoMatcher(camera, config.disparity)
        scanner = BodyScanner if config.bodies.search else CellScanner
        self._scan: BodyScanner | CellScanner = scanner(robot, camera, config)

    def step(self, images: StereoImages) -> Scan:
        """The scan of one view.

        Raises:
            ImageError: The images do not fit the camera.
        """
        return self.stages(images).scan

    def stages(self, images: StereoImages) -> Stages:
        """The scan of one view, and everything on the way to it.

        Raises:
            ImageError: The images do not fit the camera.
        """
        times = StageTimes()
        disparity = self.matcher(images)
        times.mark("disparity")
        return self._scan(disparity, images, times)

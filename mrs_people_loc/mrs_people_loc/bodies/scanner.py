"""The default scanner: from a disparity image to the cells of the bodies in it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

from mrs_people_loc.arrays import Float32
from mrs_people_loc.bodies.finder import (
    BODY_TUNING,
    Bodies,
    BodyFinder,
    BodyTuning,
    cells_of,
    points_of,
)
from mrs_people_loc.bodies.search import HIGHEST, LOWEST
from mrs_people_loc.cells.filters import discriminate_zones
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.scan import Scan, ScanStages
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.cloud import CloudMaker
from mrs_people_loc.sensing.images import StereoImages
from mrs_people_loc.timing import StageTimes


@dataclass(frozen=True)
class BodyStages(ScanStages):
    """Results of the default scanner; the points, for display, are made on first access.

    Attributes:
        bodies: The bodies.
        make_cloud: Makes points of disparities.
    """

    bodies: Bodies
    make_cloud: CloudMaker

    @cached_property
    def cloud(self) -> Float32:
        """All points in base_link [m], shape (n, 3)."""
        return self.make_cloud(self.disparity)

    @cached_property
    def cropped(self) -> Float32:
        """Those at the heights where bodies are searched for, shape (n, 3)."""
        return discriminate_zones(self.cloud, low=LOWEST, high=HIGHEST)

    @cached_property
    def foreground(self) -> Float32:
        """The samples of the bodies, which become cells, moved to their axes, shape (n, 3)."""
        return points_of(self.bodies)


class BodyScanner:
    """Makes scans of the bodies in views.

    Args:
        robot: The robot's name.
        camera: Its head.
        config: Parameters.
        tuning: Its constants.

    Raises:
        CameraError: Camera and configuration do not fit together, or the head does not see bodies
            upright.
    """

    def __init__(
        self,
        robot: str,
        camera: StereoCamera,
        config: RobotConfig,
        tuning: BodyTuning = BODY_TUNING,
    ) -> None:
        self._robot = robot
        self._make_cloud = CloudMaker(
            camera, min_range=config.disparity.min_range, max_range=config.disparity.max_range
        )
        self._find = BodyFinder(
            camera, config.bodies, min_range=config.disparity.min_range, tuning=tuning
        )

    def __call__(self, disparity: Float32, images: StereoImages, times: StageTimes) -> BodyStages:
        """The scan of one view; arguments as those of `CellScanner`."""
        bodies = self._find(disparity, images, times)
        scan = Scan(self._robot, images.stamp_ns, cells_of(bodies))
        times.mark("cells")
        return BodyStages(disparity, scan, times.ms, bodies, self._make_cloud)

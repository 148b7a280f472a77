"""One robot: from images to its scan, stage by stage as in the paper's section 5."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.bodies import finder as bodies
from mrs_people_loc.bodies import search
from mrs_people_loc.cells import filters
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.scan import Cells, Scan
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.cloud import CloudMaker
from mrs_people_loc.sensing.disparity import StereoMatcher
from mrs_people_loc.sensing.images import StereoImages
from mrs_people_loc.timing import StageTimes

Float32 = NDArray[np.float32]


@dataclass(frozen=True)
class Stages:
    """Everything that one view went through.

    Attributes:
        disparity: [px], float32, shape (height, width), NaN where there is none.
        cloud: All points in base_link [m] (RAW), shape (n, 3).
        zones: Those between knees and shoulders (V), or at the heights where bodies are sought,
            shape (n, 3).
        noise: Those in windows with many points (H), or the samples of the bodies, moved to their
            axes, shape (n, 3).
        scan: The cells (W).
        times_ms: What each stage took, by name [ms].
    """

    disparity: Float32
    cloud: Float32
    zones: Float32
    noise: Float32
    scan: Scan
    times_ms: dict[str, float] = field(default_factory=dict)


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
        self._make_cloud = CloudMaker(
            camera, min_range=config.disparity.min_range, max_range=config.disparity.max_range
        )
        self._find_bodies: bodies.BodyFinder | None = None
        if config.bodies.search:
            self._find_bodies = bodies.BodyFinder(
                camera, config.bodies, min_range=config.disparity.min_range
            )

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
        cloud = self._make_cloud(disparity)
        times.mark("cloud")
        if self._find_bodies is None:
            zones, noise, cells = filter_cloud(cloud, self.config, times)
        else:
            zones = filters.discriminate_zones(cloud, low=search.LOWEST, high=search.HIGHEST)
            times.mark("zones")
            found = self._find_bodies(disparity, images, times)
            noise, cells = bodies.points_of(found), bodies.cells_of(found)
            times.mark("cells")
        scan = Scan(self.robot, images.stamp_ns, cells)
        return Stages(disparity, cloud, zones, noise, scan, times.ms)


def filter_cloud(
    cloud: Float32, config: RobotConfig, times: StageTimes
) -> tuple[Float32, Float32, Cells]:
    """The paper's zones, noise windows and cells of a cloud (eqs. 1-5).

    Args:
        cloud: Points, z the height over the floor [m], shape (n, 3).
        config: Parameters.
        times: Marked after each stage.

    Returns:
        V and H, shape (m, 3) each, and W with its tops.
    """
    zones = filters.discriminate_zones(cloud, low=config.zones.low, high=config.zones.high)
    times.mark("zones")
    noise = filters.reduce_noise(
        zones, window=config.noise.window, min_points=config.noise.min_points
    )
    times.mark("noise")
    cells = filters.quantize(noise, cell=config.quantization.cell)
    times.mark("cells")
    top = filters.measure_tops(
        cells,
        noise,
        cloud,
        zone_high=config.zones.high,
        window=config.noise.window,
        support=config.quantization.top_support,
        gap=config.quantization.top_gap,
    )
    cells = Cells(cells.x, cells.y, cells.z, cells.z_min, top, cells.count)
    times.mark("tops")
    return zones, noise, cells

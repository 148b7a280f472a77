"""The paper's scanner: from a disparity image to the cells of a scan (section 5, eqs. 1-5)."""

from __future__ import annotations

from dataclasses import dataclass

from mrs_people_loc.arrays import Float32
from mrs_people_loc.cells import filters
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.scan import Cells, Scan, ScanStages
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.cloud import CloudMaker
from mrs_people_loc.sensing.images import StereoImages
from mrs_people_loc.timing import StageTimes


@dataclass(frozen=True)
class CellStages(ScanStages):
    """What the paper's scanner makes of a view.

    Attributes:
        cloud: All points in base_link [m] (RAW), shape (n, 3).
        cropped: Those between knees and shoulders (V), shape (n, 3).
        foreground: Those in windows with many points, which become cells (H), shape (n, 3).
    """

    cloud: Float32
    cropped: Float32
    foreground: Float32


class CellScanner:
    """Makes the cells of scans as the paper does.

    Args:
        robot: The robot's name.
        camera: Its head.
        config: Parameters.

    Raises:
        CameraError: Camera and configuration do not fit together.
    """

    def __init__(self, robot: str, camera: StereoCamera, config: RobotConfig) -> None:
        self._robot, self._config = robot, config
        self._make_cloud = CloudMaker(
            camera, min_range=config.disparity.min_range, max_range=config.disparity.max_range
        )

    def __call__(self, disparity: Float32, images: StereoImages, times: StageTimes) -> CellStages:
        """The scan of one view.

        Args:
            disparity: [px], float32, shape (height, width), NaN where there is none.
            images: The images that it was made of.
            times: Marked after each stage.
        """
        cloud = self._make_cloud(disparity)
        times.mark("cloud")
        cropped, foreground, cells = filter_cloud(cloud, self._config, times)
        scan = Scan(self._robot, images.stamp_ns, cells)
        return CellStages(disparity, scan, times.ms, cloud, cropped, foreground)


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
    cropped = filters.discriminate_zones(cloud, low=config.zones.low, high=config.zones.high)
    times.mark("zones")
    foreground = filters.reduce_noise(
        cropped, window=config.noise.window, min_points=config.noise.min_points
    )
    times.mark("noise")
    cells = filters.quantize(foreground, cell=config.quantization.cell)
    times.mark("cells")
    top = filters.measure_tops(
        cells,
        foreground,
        cloud,
        zone_high=config.zones.high,
        window=config.noise.window,
        support=config.quantization.top_support,
        gap=config.quantization.top_gap,
    )
    cells = Cells(cells.x, cells.y, cells.z, cells.z_min, top, cells.count)
    times.mark("tops")
    return cropped, foreground, cells

"""Localization of one robot: what it senses in, and its `Localizer`."""

from __future__ import annotations

import numpy as np

from mrs_people_loc.arrays import Float, Float32
from mrs_people_loc.clocks import RateLimit
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.localization.localizer import Localizer
from mrs_people_loc.localization.odometry import motion
from mrs_people_loc.localization.shared import TeamPose
from mrs_people_loc.localization.walls import SeenWalls, Walls
from mrs_people_loc.localization.walls.known import read_walls
from mrs_people_loc.localization.walls.laser import unskewed, walls_of_laser
from mrs_people_loc.localization.walls.people_in_view import people_in
from mrs_people_loc.localization.walls.ranges import LaserScan, SonarRange
from mrs_people_loc.localization.walls.sonar import SonarWalls
from mrs_people_loc.localization.walls.stereo import StereoWalls
from mrs_people_loc.scan import Scan
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.team.poses import Pose

#: Where a sensor is in base_link: x, y [m], yaw [rad].
Mounting = tuple[float, float, float]
#: The people of a view are left out of laser scans for so long [ns].
_PEOPLE_FOR_NS = 500_000_000
_NO_PEOPLE: Float = np.empty((0, 2))


def may_localize(config: RobotConfig) -> bool:
    """Whether poses of `pose.source` may be dead reckoning, depending on their frame."""
    return config.localization.run != "never" and config.pose.source in ("odom", "pose_in")


def localizes(config: RobotConfig, frame_id: str) -> bool:
    """Whether poses of `pose.source` in a frame are dead reckoning, to be corrected.

    Args:
        config: The robot's configuration.
        frame_id: Frame of a pose, without a leading slash.
    """
    pose, localization = config.pose, config.localization
    starts = bool(localization.start or pose.map_from_odom)
    apart = pose.source == "odom" and frame_id != pose.map_frame and starts
    return (localization.run == "always" or apart) and may_localize(config)


class RobotLocalization:
    """Finds walls in what a robot senses, and gives them and its odometry to its `Localizer`.

    Args:
        robot: The robot's name.
        config: Its configuration.

    Attributes:
        localizer: The estimate; None: there was no odometry yet.
        began_ns: Stamp of the first odometry [ns].

    Raises:
        ConfigError: The file of known walls cannot be read.
    """

    def __init__(self, robot: str, config: RobotConfig) -> None:
        self._robot, self._config = robot, config
        self._known = read_walls(config.walls.file) if config.walls.file else None
        self._stereo: StereoWalls | None = None
        self._rate = RateLimit()
        self.begin_anew()

    def begin_anew(self) -> None:
        """Forgets where the robot is; the next odometry is the start."""
        self.localizer: Localizer | None = None
        self.began_ns = self._newest_ns = 0
        self._sonar = SonarWalls()
        self._people = 0, _NO_PEOPLE
        self._rate.begin_anew()

    def configure(self, config: RobotConfig) -> None:
        """Takes another configuration, from the next measurement on; the start stays."""
        self._config = config
        if self.localizer is not None:
            self.localizer.configure(config.localization)

    def add_known(self, walls: Walls) -> None:
        """Takes further known walls, in the map."""
        self._known = walls if self._known is None else Walls.concatenate([self._known, walls])
        if self.localizer is not None:
            self.localizer.take_known(self._known)

    def take_odometry(self, pose: Pose) -> Pose:
        """base_link in the map, from its pose in the odometry's frame.

        Raises:
            PoseError: The stamp is not newer than the last one.
        """
        config = self._config
        if self.localizer is None:
            self.localizer = Localizer(self._robot, config.localization, self._known)
            self.began_ns = pose.stamp_ns
        x, y, yaw = config.pose.map_from_odom or (0.0, 0.0, 0.0)
        placed = self.localizer.take_odometry(Pose(pose.stamp_ns, x, y, yaw) @ pose)
        self._newest_ns = pose.stamp_ns
        return placed

    def share(self) -> TeamPose | None:
        """What the team is to hear now; None: nothing yet, by `localization.share_rate`."""
        rate_hz = self._config.localization.share_rate
        if self.localizer is None or not self._rate.lets_through(self._newest_ns, rate_hz):
            return None
        return self.localizer.share()

    def take_view(self, scan: Scan, disparity: Float32, camera: StereoCamera) -> None:
        """Finds walls in a view of the head.

        Args:
            scan: What the robot made of it.
            disparity: The view's [px], shape (height, width).
            camera: The head.
        """
        people = people_in(scan)
        self._people = scan.stamp_ns, people
        if self.localizer is None or not self._config.walls.stereo:
            return
        if self._stereo is None or self._stereo.camera is not camera:
            self._stereo = StereoWalls(camera)
        self._take(self._stereo.step(disparity, scan.stamp_ns, people))

    def take_laser(self, scan: LaserScan, mounting: Mounting) -> None:
        """Finds walls in a scan of a laser scanner, beside the people of the last view.

        Raises:
            PoseError: The scan takes time, and there is no odometry near its beginning or end.
        """
        if self.localizer is None:
            return
        stamp_ns, people = self._people
        if abs(scan.stamp_ns - stamp_ns) > _PEOPLE_FOR_NS:
            people = _NO_PEOPLE
        ranges, angles = scan.ranges, scan.angles
        if scan.sweep_s:
            end_ns = scan.stamp_ns + round(1e9 * abs(scan.sweep_s))
            at = self.localizer.odometry_at
            moved_by, _ = motion(at(scan.stamp_ns), at(end_ns))
            ranges, angles = unskewed(scan, moved_by, mounting)
        walls = walls_of_laser(
            ranges,
            angles,
            sigma=self._config.walls.laser_sigma,
            max_range=scan.max_range,
            mounting=mounting,
            people=people,
        )
        self._take(SeenWalls(scan.stamp_ns, walls))

    def take_range(self, measured: SonarRange, mounting: Mounting) -> None:
        """Finds walls in the ranges of sonars.

        Raises:
            PoseError: There is no odometry near that time.
        """
        if self.localizer is None:
            return
        odometry = self.localizer.odometry_at(measured.stamp_ns)
        seen = self._sonar.take(measured, mounting, odometry)
        if seen is not None:
            self._take(seen)

    def _take(self, seen: SeenWalls) -> None:
        if self.localizer is not None and len(seen.walls):
            self.localizer.take_walls(seen)

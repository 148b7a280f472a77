"""The walls in what a robot senses: views of its head, laser scans, ranges of sonars."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from mrs_people_loc.arrays import Float, Float32
from mrs_people_loc.clocks import RateLimit
from mrs_people_loc.config import WallSensors
from mrs_people_loc.localization.odometry import Odometry, motion
from mrs_people_loc.localization.walls import NOBODY, SeenWalls
from mrs_people_loc.localization.walls.laser import unskewed, walls_of_laser
from mrs_people_loc.localization.walls.people_in_view import people_in
from mrs_people_loc.localization.walls.ranges import LaserScan, SonarRange
from mrs_people_loc.localization.walls.sonar import SonarWalls
from mrs_people_loc.localization.walls.stereo import StereoWalls
from mrs_people_loc.scan import Scan
from mrs_people_loc.sensing.camera import StereoCamera

#: Where a sensor is in base_link: x, y [m], yaw [rad].
Mounting = tuple[float, float, float]


@dataclass(frozen=True)
class WallFinderTuning:
    """Constants of `WallFinder`, chosen by hand.

    Attributes:
        people_ns: The people of a view are where no wall is for so long [ns].
        laser_hz: Walls are looked for in so many scans of a laser scanner a second [Hz]: more tell
            hardly more, and each costs all robots of the team.
    """

    people_ns: int = 500_000_000
    laser_hz: float = 4.0


_TUNING = WallFinderTuning()


#: Where team-mates are (`NOBODY`) at a time [ns].
MatesAt = Callable[[int], Float]


class WallFinder:
    """Finds walls in what a robot senses; where the robot was then, its odometry says.

    Args:
        config: Parameters; may be replaced at any time.
    """

    def __init__(self, config: WallSensors) -> None:
        self.config = config
        self._stereo: StereoWalls | None = None
        self.clear()

    def clear(self) -> None:
        """Forgets the last echoes and people."""
        self._sonar = SonarWalls()
        self._laser = RateLimit()
        self._people = 0, NOBODY

    def take_people(self, scan: Scan) -> None:
        """Remembers the people of a view, to find no walls in them."""
        self._people = scan.stamp_ns, people_in(scan)

    def _bodies(self, stamp_ns: int, mates_at: MatesAt) -> Float:
        """Who may look like a wall at a time: team-mates, and the people of the last view."""
        (seen_ns, people), mates = self._people, mates_at(stamp_ns)
        return mates if abs(stamp_ns - seen_ns) > _TUNING.people_ns else np.vstack([people, mates])

    def in_view(
        self, disparity: Float32, stamp_ns: int, camera: StereoCamera, mates_at: MatesAt
    ) -> SeenWalls | None:
        """The walls in the view whose people were taken last; None: they are not looked for.

        Args:
            disparity: The view's [px], shape (height, width).
            stamp_ns: Its stamp [ns].
            camera: The head.
            mates_at: Where team-mates are (`NOBODY`) at a time [ns]; likewise below.
        """
        if not self.config.stereo:
            return None
        if self._stereo is None or self._stereo.camera is not camera:
            self._stereo = StereoWalls(camera)
        return self._stereo.step(disparity, stamp_ns, self._bodies(stamp_ns, mates_at))

    def in_laser(
        self,
        scan: LaserScan,
        mounting: Mounting,
        odometry_at: Callable[[int], Odometry],
        mates_at: MatesAt,
    ) -> SeenWalls | None:
        """The walls in a scan of a laser scanner; None: it is too early after the last one.

        Raises:
            PoseError: The scan takes time, and there is no odometry near its beginning or end.
        """
        if not self._laser.lets_through(scan.stamp_ns, _TUNING.laser_hz):
            return None
        ranges, angles = np.where(scan.ranges < 0.0, np.nan, scan.ranges), scan.angles
        if scan.sweep_s:
            end_ns = scan.stamp_ns + round(1e9 * abs(scan.sweep_s))
            moved_by, _ = motion(odometry_at(scan.stamp_ns), odometry_at(end_ns))
            ranges, angles = unskewed(replace(scan, ranges=ranges), moved_by, mounting)
        walls = walls_of_laser(
            ranges,
            angles,
            sigma=self.config.laser_sigma,
            max_range=scan.max_range,
            mounting=mounting,
            bodies=self._bodies(scan.stamp_ns, mates_at),
        )
        return SeenWalls(scan.stamp_ns, walls)

    def in_range(
        self,
        measured: SonarRange,
        mounting: Mounting,
        odometry_at: Callable[[int], Odometry],
        mates_at: MatesAt,
    ) -> SeenWalls | None:
        """The walls in the ranges of sonars so far, now and then.

        Raises:
            PoseError: There is no odometry near that time.
        """
        bodies = self._bodies(measured.stamp_ns, mates_at) if measured.is_echo else NOBODY
        return self._sonar.take(measured, mounting, odometry_at(measured.stamp_ns), bodies)

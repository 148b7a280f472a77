"""Topics of the robots' sonars and laser scanners: `<robot>/sonar_0`, ..., and `<robot>/scan`.

Their mountings are on `/tf_static`, as frames of the same names in `<robot>/base_link`.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.geometry import quaternion_from_yaw
from mrs_people_sim.models.meshes import Mesh
from mrs_people_sim.motion import Place
from mrs_people_sim.scene import Laser, Scene, Sonar
from mrs_people_sim.sensors.range_sensors import (
    laser_angles,
    laser_ranges,
    outline_at,
    people_circles,
    sonar_ranges,
)

#: Sonars fire so often [Hz].
SONAR_RATE = 10.0
#: A robot to the sensors of others: a circle about its axis of this radius [m].
_ROBOT_RADIUS = 0.22
#: sensor_msgs/Range's number for sound.
_ULTRASOUND = 0


class Surroundings(Protocol):
    """What range sensors are in: a `World`, or the one of `live_world`."""

    scene: Scene
    names: list[str]

    @property
    def room(self) -> Mesh:
        """The room and its furniture, in the map."""

    def person_places(self, time: float) -> list[Place]:
        """Where the people are at a time [s]."""

    def robot_place(self, name: str, time: float) -> Place:
        """Where a robot's base_link is at a time [s]."""

    def stamp_ns(self, time: float) -> int:
        """The stamp of a time [ns]."""


@dataclass
class RangeTopics:
    """What the sonars and laser scanners of a scene measure.

    Args:
        world: What they are in.
        make: Makes a message from its type name and fields.
        header: Makes a std_msgs/Header of a frame and a stamp [ns].
    """

    world: Surroundings
    make: Callable[..., Any]
    header: Callable[[str, int], Any]
    _outlines: dict[float, NDArray] = field(default_factory=dict)

    def events(self, last: float) -> Iterator[tuple[float, str, str]]:
        """Time [s], robot and kind (`sonars` or `laser`) of each measurement, in no order.

        Args:
            last: Until this time [s].
        """
        scene = self.world.scene
        for name in scene.sonars:
            for k in range(math.floor(last * SONAR_RATE) + 1):
                yield k / SONAR_RATE, name, "sonars"
        for name, laser in scene.lasers.items():
            for k in range(math.floor(last * laser.rate) + 1):
                yield k / laser.rate, name, "laser"

    def measured(self, time: float, robot: str, kind: str) -> Iterator[tuple[str, Any]]:
        """Topic and message of each sensor of an event."""
        world, scene = self.world, self.world.scene
        place = world.robot_place(robot, time)
        pose = (place.x, place.y, place.yaw)
        rng = np.random.default_rng(
            [scene.seed, 15, world.names.index(robot), kind == "laser", round(time * 1e6)]
        )
        circles, ns = self._circles(robot, time), world.stamp_ns(time)
        if kind == "laser":
            laser = scene.lasers[robot]
            ranges = laser_ranges(self._outline(laser.height), circles, pose, laser, rng)
            yield f"/{robot}/scan", self._scan(robot, laser, ranges, ns)
            return
        sonars = scene.sonars[robot]
        # Sonars at different heights see different outlines, but they fire together.
        for height in sorted({sonar.height for sonar in sonars}):
            chosen = [k for k, sonar in enumerate(sonars) if sonar.height == height]
            some = [sonars[k] for k in chosen]
            ranges = sonar_ranges(self._outline(height), circles, pose, some, rng)
            for k, sonar, one in zip(chosen, some, ranges, strict=True):
                message = self._range(f"{robot}/sonar_{k}", sonar, float(one), ns)
                yield f"/{robot}/sonar_{k}", message

    def mountings(self) -> Any:
        """Where all sensors are: tf2_msgs/TFMessage for `/tf_static`."""
        scene, transforms = self.world.scene, []
        for robot, sonars in scene.sonars.items():
            for k, sonar in enumerate(sonars):
                transforms.append(self._mounting(robot, f"{robot}/sonar_{k}", sonar))
        for robot, laser in scene.lasers.items():
            transforms.append(self._mounting(robot, f"{robot}/laser", laser))
        return self.make("tf2_msgs/msg/TFMessage", transforms=transforms)

    # ------------------------------------------------------------------------------ inside

    def _outline(self, height: float) -> NDArray:
        if height not in self._outlines:
            self._outlines[height] = outline_at(self.world.room, height)
        return self._outlines[height]

    def _circles(self, robot: str, time: float) -> NDArray:
        people = [(p.x, p.y, p.yaw) for p in self.world.person_places(time)]
        others = [self.world.robot_place(name, time) for name in self.world.names if name != robot]
        robots = [(place.x, place.y, _ROBOT_RADIUS) for place in others]
        return np.concatenate(
            [
                people_circles(np.array(people).reshape(-1, 3)),
                np.array(robots).reshape(-1, 3),
            ]
        )

    def _range(self, frame: str, sonar: Sonar, measured: float, ns: int) -> Any:
        return self.make(
            "sensor_msgs/msg/Range",
            header=self.header(frame, ns),
            radiation_type=_ULTRASOUND,
            field_of_view=sonar.field_of_view,
            min_range=sonar.min_range,
            max_range=sonar.max_range,
            range=measured,
            variance=0.0,
        )

    def _scan(self, robot: str, laser: Laser, ranges: NDArray, ns: int) -> Any:
        angles = laser_angles(laser)
        return self.make(
            "sensor_msgs/msg/LaserScan",
            header=self.header(f"{robot}/laser", ns),
            angle_min=float(angles[0]),
            angle_max=float(angles[-1]),
            angle_increment=laser.field_of_view / laser.rays,
            time_increment=0.0,
            scan_time=1.0 / laser.rate,
            range_min=laser.min_range,
            range_max=laser.max_range,
            ranges=ranges.astype(np.float32),
            intensities=np.empty(0, dtype=np.float32),
        )

    def _mounting(self, robot: str, frame: str, sensor: Sonar | Laser) -> Any:
        qx, qy, qz, qw = quaternion_from_yaw(sensor.yaw)
        return self.make(
            "geometry_msgs/msg/TransformStamped",
            header=self.header(f"{robot}/base_link", self.world.stamp_ns(0.0)),
            child_frame_id=frame,
            transform=self.make(
                "geometry_msgs/msg/Transform",
                translation=self.make(
                    "geometry_msgs/msg/Vector3", x=sensor.x, y=sensor.y, z=sensor.height
                ),
                rotation=self.make("geometry_msgs/msg/Quaternion", x=qx, y=qy, z=qz, w=qw),
            ),
        )

"""Height, pitch and roll of a stereo head, measured by the floor that it sees.

The floor does not determine `forward`, `left` and `yaw`: they stay as they are configured.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from mrs_people_loc.arrays import Float32
from mrs_people_loc.config import Disparity, Mounting, RobotConfig, load_team
from mrs_people_loc.errors import BagError, ConfigError, FloorError, PeopleLocError
from mrs_people_loc.head import Head
from mrs_people_loc.health.floor import Floor, FloorFinder
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.disparity import StereoMatcher
from mrs_people_loc.sensing.images import StereoImages
from mrs_tools.bags.offline import BagRun
from mrs_tools.bags.reader import BagReader

#: So many views are kept, at least, of those that were seen: evenly over all of them.
_VIEWS = 40
#: Publishers that are there have been discovered after this time [s].
_DISCOVERY_S = 5.0
#: The floor is known well with standard deviations below these: angles [rad], height over itself.
_WELL_ANGLE, _WELL_HEIGHT = math.radians(1.2), 0.03


class _Matcher:
    """In place of a robot's pipeline: disparities, and nothing of them.

    Matching is the default one, whatever the robot runs: smaller blocks mix less of what stands on
    the floor with it, and no other settings that were tried gave surer floors.
    """

    def __init__(self, _robot: str, camera: StereoCamera, config: RobotConfig) -> None:
        self.camera = camera
        own = config.disparity
        matching = Disparity(min_range=own.min_range, max_range=own.max_range)
        self._match = StereoMatcher(camera, matching)

    def stages(self, images: StereoImages) -> Float32:
        return self._match(images)


class Calibration:
    """Measures one head: takes its messages, then the floor in the views they make.

    Args:
        robot: The robot's name.
        config: Its configuration.

    Attributes:
        config: Its configuration.
        came: Whether any message has come.
        views: How many views there were.
        dropped: What was wrong with the last message that could not be used; empty if none was.
        handlers: What takes the messages, by topic.
    """

    def __init__(self, robot: str, config: RobotConfig) -> None:
        self.config = config
        self.came = False
        self.views = 0
        self.dropped = ""
        self.handlers: dict[str, Callable[[Any], None]] = {}
        self._robot = robot
        self._head = Head(robot, config, _Matcher)
        self._kept: list[Float32] = []
        self._every = 1
        image = "image_rect" if config.images.rectified else "image_raw"
        for camera in self._head.cameras:
            base = f"/{robot}/{camera}"
            self.handlers[f"{base}/camera_info"] = self._taking(self._head.take_camera_info, camera)
            self.handlers[f"{base}/{image}"] = self._taking(self._head.take_image, camera)

    def _taking(self, take: Callable[[str, Any], Any], camera: str) -> Callable[[Any], None]:
        def handle(message: Any) -> None:
            self.came = True
            try:
                view = take(camera, message)
            except PeopleLocError as err:
                self.dropped = f"{camera}: {err}"
                return
            if view is not None:
                self._keep(view.stages)

        return handle

    def _keep(self, disparity: Float32) -> None:
        if self.views % self._every == 0:
            self._kept.append(disparity)
            if len(self._kept) >= 2 * _VIEWS:
                self._kept = self._kept[::2]
                self._every *= 2
        self.views += 1

    def floor(self) -> Floor:
        """The floor in all views.

        Raises:
            FloorError: There are no views, or not enough floor in them.
        """
        if not self._kept:
            why = f"; last trouble: {self.dropped}" if self.dropped else ""
            raise FloorError(
                f"{self._robot}: no view, i.e. no pair of images with camera_info, on "
                f"{', '.join(self.handlers)}{why}"
            )
        try:
            return FloorFinder(self._head.pipeline.camera)(self._kept)
        except FloorError as err:
            raise FloorError(f"{self._robot}: {err}") from err


def snippet(robot: str, mounting: Mounting, floor: Floor) -> str:
    """The measured mounting as a section of a parameter file.

    Args:
        robot: The robot's name.
        mounting: What is configured; `forward`, `left` and `yaw` stay.
        floor: What was measured.
    """
    kept = {name: getattr(mounting, name) for name in ("forward", "left", "yaw")}
    values = {"height": floor.height, "pitch": floor.pitch, "roll": floor.roll}
    values |= {name: value for name, value in kept.items() if value}
    inside = ", ".join(f"{name}: {_plain(value)}" for name, value in values.items())
    height, pitch, roll = floor.sigma
    return (
        f"/{robot}/robot_node:\n"
        f"  ros__parameters:\n"
        f"    # +- {height:.3f} m, {pitch:.3f} and {roll:.3f} rad; floor in {floor.frames} "
        f"view{'s' * (floor.frames != 1)}, {floor.part:.0%} of their pixels\n"
        f"    mounting: {{{inside}}}\n"
    )


def _plain(value: float) -> str:
    return f"{value:.3f}".replace("-0.000", "0.000")


def how_sure(floor: Floor) -> str:
    """How certain the measurement is, in words."""
    height, pitch, roll = floor.sigma
    text = (
        f"+- {height:.2f} m, {math.degrees(pitch):.1f} and {math.degrees(roll):.1f} deg "
        f"(one standard deviation); {floor.frames} view{'s' * (floor.frames != 1)}, "
        f"{floor.part:.0%} of their pixels on the floor"
    )
    if floor.sigma_tilt > _WELL_ANGLE or height > _WELL_HEIGHT * floor.height:
        text += "; that is rough: more floor in view, and other places, make it surer"
    return text


def from_bag(
    path: Path, configs: Sequence[Path], robots: Sequence[str], *, beside: bool = True
) -> dict[str, Calibration]:
    """The heads of a bag, by robot, with all their views.

    Args:
        path: The bag.
        configs: Parameter files, later ones win.
        robots: Names; empty: every robot that has images.
        beside: Whether the bag's own parameter file is read, after the others.

    Raises:
        BagError: The bag cannot be read, or lacks a robot's images.
        ConfigError: A parameter file is wrong.
    """
    run = BagRun(path, configs, beside=beside)
    made = {name: Calibration(name, config) for name, config in run.team.robots.items()}
    with BagReader(path) as bag:
        made = {
            name: one for name, one in made.items() if any(t in bag.topics for t in one.handlers)
        }
        if missing := [name for name in robots if name not in made]:
            raise BagError(
                f"{path}: has no images of {', '.join(missing)}; it has those of: "
                f"{', '.join(made) or 'nobody'}"
            )
        made = {name: one for name, one in made.items() if name in robots or not robots}
        if not made:
            raise BagError(f"{path}: has no images")
        handlers = {topic: take for one in made.values() for topic, take in one.handlers.items()}
        for topic, _, message in bag.decoded([t for t in handlers if t in bag.topics]):
            handlers[topic](message)
    return made


def head_of(robot: str, configs: Sequence[Path]) -> Calibration:
    """The head of a robot of a team, with no views yet.

    Raises:
        ConfigError: A parameter file is wrong, or knows no such robot.
    """
    team = load_team(*configs, robots=(robot,))
    if robot not in team.robots:
        raise ConfigError(f"{robot} is not in the team: {', '.join(team.robots)}")
    return Calibration(robot, team.robots[robot])


def live(made: Calibration, duration_s: float) -> Calibration:
    """Gives a head that is running its views of some seconds.

    Raises:
        PeopleLocError: Nobody publishes its images.
    """
    from sensor_msgs.msg import CameraInfo, Image

    from mrs_ros.qos import STREAM
    from mrs_tools.signals import stop_on_signals
    from mrs_tools.tool_node import node, spinning

    with (
        stop_on_signals() as stop,
        node("mrs_calibrate") as listener,
        spinning(listener) as executor,
    ):
        for topic, handle in made.handlers.items():
            kind = CameraInfo if topic.endswith("/camera_info") else Image
            listener.create_subscription(kind, topic, handle, STREAM)
        begin = time.monotonic()
        while not stop.is_set() and (passed := time.monotonic() - begin) < duration_s:
            executor.spin_once(timeout_sec=0.1)
            if made.came or passed <= _DISCOVERY_S:
                continue
            if not any(map(listener.count_publishers, made.handlers)):
                raise PeopleLocError(
                    f"nobody publishes {', '.join(made.handlers)}: is the head running, in "
                    "this ROS_DOMAIN_ID, under this name?"
                )
    return made

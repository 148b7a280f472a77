"""The robots of a bag: which topics they have, and what their messages become."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import Any

from mrs_people_loc import head, messages
from mrs_people_loc.config import PLANNER_NODE, ROBOT_NODE, RobotConfig, load_yaml, overridden
from mrs_people_loc.errors import ConfigError, GridError, PoseError
from mrs_people_loc.localization.robot_localization import (
    RobotLocalization,
    localizes,
    may_localize,
)
from mrs_people_loc.robot import Stages
from mrs_people_loc.scan import Scan
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import StereoImages
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_loc.team.poses import Pose, static_pose
from mrs_tools.bags.reader import BagReader
from mrs_tools.bags.team_localization import range_handlers

MAP_TOPIC = "/map"
GRID_TYPE = "nav_msgs/msg/OccupancyGrid"
_IMAGE = "sensor_msgs/msg/Image"
_POINTS = "sensor_msgs/msg/PointCloud2"
_POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
_ODOMETRY = "nav_msgs/msg/Odometry"
#: Where a robot's pose may be, and as what.
_POSE_TOPICS = {"odom": _ODOMETRY, "pose_in": _POSE, "pose": _POSE}


def read_grid(bag: BagReader, map_frame: str) -> OccupancyGrid | None:
    """What a bag's `/map` says of walls and furniture; None: it has none, or none of any use."""
    if MAP_TOPIC not in bag.topics or bag.topics[MAP_TOPIC].type != GRID_TYPE:
        return None
    for _, _, message in bag.decoded([MAP_TOPIC]):
        with suppress(GridError):
            return messages.read_occupancy_grid(message, map_frame)
    return None


@dataclass(frozen=True)
class RobotView:
    """One view of a robot's head, and what the robot made of it.

    Attributes:
        robot: The robot's name.
        camera: Its head.
        images: The prepared images.
        stages: What its pipeline made of them.
        times_ms: What each stage took, preparing the images (`prepare`) included [ms].
    """

    robot: str
    camera: StereoCamera
    images: StereoImages
    stages: Stages
    times_ms: Mapping[str, float]


@dataclass(frozen=True)
class BagRobot:
    """What a bag holds of one robot.

    Attributes:
        name: Its name: its namespace without the leading slash.
        images: By kind (`image_rect`, `image_raw`), the cameras that have them.
        points: Whether there are recorded scans.
        poses: Which of the topics `odom`, `pose_in` and `pose` there are.
    """

    name: str
    images: Mapping[str, tuple[str, ...]]
    points: bool
    poses: tuple[str, ...]


def robots_of(bag: BagReader) -> dict[str, BagRobot]:
    """The robots of a bag, by name: namespaces with a pair of images, or `points` and poses."""
    types = {name: topic.type for name, topic in bag.topics.items() if topic.count}
    namespaces = {
        name.removesuffix(end)
        for name in types
        for end in ("/left/image_rect", "/left/image_raw", "/points")
        if name.endswith(end) and name != end
    }
    robots = {}
    for space in sorted(namespaces):
        images = {}
        for kind in ("image_rect", "image_raw"):
            cameras = tuple(
                c for c in ("left", "right", "top") if types.get(f"{space}/{c}/{kind}") == _IMAGE
            )
            if cameras[:2] == ("left", "right"):
                images[kind] = cameras
        poses = tuple(
            name for name, kind in _POSE_TOPICS.items() if types.get(f"{space}/{name}") == kind
        )
        points = types.get(f"{space}/points") == _POINTS and bool(poses)
        if images or points:
            robots[space.lstrip("/")] = BagRobot(space.lstrip("/"), images, points, poses)
    return robots


def file_beside(bag: Path) -> Path | None:
    """The parameter file that belongs to a bag: `scene.yaml` beside `scene` or `scene.mcap`.

    `mrs simulate` writes it: the mounting of each head, where odometry begins. A file of that name
    that is something else does not count.
    """
    bag = Path(os.path.abspath(bag))
    file = bag.with_name(f"{bag.stem if bag.suffix == '.mcap' else bag.name}.yaml")
    try:
        document = load_yaml(file)
    except ConfigError:
        return None
    keys = [str(key) for key in document] if isinstance(document, Mapping) else []
    return file if any(key.endswith((ROBOT_NODE, PLANNER_NODE)) for key in keys) else None


def own_file(bag: Path, configs: Sequence[str | Path]) -> Path | None:
    """The parameter file beside a bag, unless it is one of those that are named anyway.

    Args:
        bag: The bag.
        configs: The files that are named.
    """
    own = file_beside(bag)
    named = [Path(file).resolve() for file in configs]
    return None if own is None or own.resolve() in named else own


def overridden_beside(bag: Path, configs: Sequence[str | Path]) -> str:
    """Which parameters of files do not hold, since the file beside the bag sets them, too.

    Args:
        bag: The bag.
        configs: Parameter files, later ones win.

    Returns:
        A sentence; empty where nothing is overridden.

    Raises:
        PeopleLocError: The bag cannot be read, or a file is wrong.
    """
    own = own_file(bag, configs)
    if own is None or not configs:
        return ""
    with BagReader(bag) as reader:
        names = overridden(configs, own, list(robots_of(reader)))
    return (
        f"{own.name} beside the bag goes before {', '.join(Path(file).name for file in configs)} "
        f"for {', '.join(names)}; --no-own-config ignores it"
        if names
        else ""
    )


class FrameError(PoseError):
    """Poses in a frame that nothing places in the map: every other one will be, too."""


@dataclass
class Source:
    """A robot of the team, fed with its messages. Handlers by topic are in `handlers`.

    Attributes:
        has: What the bag holds of it.
        config: Its configuration.
        localize: Whether its odometry is corrected, if it is dead reckoning.
        views: Views so far.
        scans: Scans so far.
        poses: Poses so far.
        stands: Whether its pose is a parameter, at any time.
        localization: Places its poses in the map.
        localizes: Whether it corrects some of them.
    """

    has: BagRobot
    config: RobotConfig
    make: Callable[[str, StereoCamera, RobotConfig], Any]
    localize: bool = False
    handlers: dict[str, Callable[[Any], Scan | Pose | RobotView | None]] = field(
        default_factory=dict
    )
    scans: int = 0
    poses: int = 0

    def __post_init__(self) -> None:
        name, config = self.has.name, self.config
        if self.has.images:
            kind = "image_rect" if config.images.rectified else "image_raw"
            self.head = head.Head(name, config, self.make)
            for camera in self.head.cameras:
                base = f"/{name}/{camera}"
                self.handlers[f"{base}/camera_info"] = partial(self._on_info, camera)
                self.handlers[f"{base}/{kind}"] = partial(self._on_image, camera)
        else:
            self.handlers[f"/{name}/points"] = self._on_points
        self.stands = bool(self.has.images) and config.pose.source == "static"
        if self.stands:
            static_pose(config.pose, 0)
        else:
            self.handlers[f"/{name}/{self._pose_topic()}"] = self._on_pose
        if not self.localize or self._pose_topic() != config.pose.source:
            never = replace(config.localization, run="never")
            config = self.config = replace(config, localization=never)
        self.localization = RobotLocalization(name, config)
        self.localizes = may_localize(config)
        if self.localizes:
            self.handlers.update(range_handlers(name, self.localization, config.walls))

    def _pose_topic(self) -> str:
        has = self.has.poses
        if not self.has.images and "pose" in has:
            return "pose"
        return next((name for name in (self.config.pose.source, *has) if name in has), "odom")

    # ---- images ----

    def _on_info(self, camera: str, message: Any) -> RobotView | None:
        return self._view(self.head.take_camera_info(camera, message))

    def _on_image(self, camera: str, message: Any) -> RobotView | None:
        return self._view(self.head.take_image(camera, message))

    def _view(self, view: head.View | None) -> RobotView | None:
        if view is None:
            return None
        times = {"prepare": view.prepare_ms, **view.stages.times_ms}
        camera = self.head.pipeline.camera
        return RobotView(self.has.name, camera, view.images, view.stages, times)

    def _on_points(self, message: Any) -> Scan:
        return messages.read_scan(message, self.has.name)

    # ---- pose ----

    def _on_pose(self, message: Any) -> Pose | None:
        pose = messages.read_pose(message, f"{self.has.name}/base_link")
        frame_id = message.header.frame_id
        config, recorded = self.config.pose, self._pose_topic() == "pose"
        came_in = frame_id.lstrip("/")
        placed = came_in == config.map_frame or localizes(self.config, came_in)
        if not placed and (recorded or not config.map_from_odom):
            remedy = ", or pose.map_from_odom (x, y, yaw of that frame in the map) in a --config"
            raise FrameError(
                f"frame_id is {frame_id!r}; wanted: {config.map_frame!r}"
                + ("" if recorded else remedy)
            )
        return pose if recorded else self.localization.place(pose, frame_id)

    def why_no_scan(self) -> str:
        """Why there was no scan, as far as it is known."""
        if self.has.images and self.head.pairer.unpaired:
            return f"images found no pair; {self.head.pairer.why_unpaired()}"
        return "it has no camera_info" if self.has.images else "no message on points can be used"

    def no_pose(self) -> str:
        """Why there was no pose."""
        return f"there is nothing on {', '.join(_POSE_TOPICS)}"

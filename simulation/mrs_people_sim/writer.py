"""From frames to messages: bags, and the parameter file of the simulated team."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from rosbags.interfaces import (
    Qos,
    QosDurability,
    QosHistory,
    QosLiveliness,
    QosReliability,
    QosTime,
)

from mrs_people_loc.geometry import quaternion_from_yaw
from mrs_people_sim.models.rooms import floor_plan
from mrs_people_sim.motion import Place
from mrs_people_sim.robot_writer import RobotWriter
from mrs_people_sim.scene import Scene
from mrs_people_sim.sensors.odometry import PoseSample
from mrs_people_sim.sensors.range_topics import RangeTopics
from mrs_people_sim.views.stage import Stage
from mrs_people_sim.views.world import RenderedFrame, World
from mrs_tools.bags.message_types import default_typestore
from mrs_tools.bags.truth import true_pose_topic
from mrs_tools.bags.writer import BagWriter

PEOPLE_TOPIC = "/ground_truth/people_poses"
VISIBLE_TOPIC = "/ground_truth/visible"
PERCENT_TOPIC = "/ground_truth/visible_percent"
GROUP_TOPIC = "/ground_truth/group"
MAP_TOPIC = "/map"
TF_TOPIC = "/tf_static"
#: As map_server offers it: late subscribers get the last one, too.
_MAP_QOS = Qos(
    history=QosHistory.KEEP_LAST,
    depth=1,
    reliability=QosReliability.RELIABLE,
    durability=QosDurability.TRANSIENT_LOCAL,
    deadline=QosTime(0, 0),
    lifespan=QosTime(0, 0),
    liveliness=QosLiveliness.AUTOMATIC,
    liveliness_lease_duration=QosTime(0, 0),
    avoid_ros_namespace_conventions=False,
)


class Messages:
    """Makes messages from the types of some message store.

    Args:
        make: Makes a message from its type name and fields; rosbags' classes if None.
    """

    def __init__(self, make: Callable[..., Any] | None = None) -> None:
        types = default_typestore().types
        self.make = make or (lambda kind, **fields: types[kind](**fields))

    def header(self, frame: str, ns: int) -> Any:
        """std_msgs/Header."""
        stamp = self.make("builtin_interfaces/msg/Time", sec=ns // 10**9, nanosec=ns % 10**9)
        return self.make("std_msgs/msg/Header", stamp=stamp, frame_id=frame)

    def pose(self, x: float, y: float, yaw: float) -> Any:
        """geometry_msgs/Pose on the floor; the position is NaN for somebody who is not there."""
        qx, qy, qz, qw = quaternion_from_yaw(yaw if math.isfinite(yaw) else 0.0)
        z = 0.0 if math.isfinite(x) else math.nan
        return self.make(
            "geometry_msgs/msg/Pose",
            position=self.make("geometry_msgs/msg/Point", x=x, y=y, z=z),
            orientation=self.make("geometry_msgs/msg/Quaternion", x=qx, y=qy, z=qz, w=qw),
        )

    def people(self, places: Sequence[Place], ns: int) -> Any:
        """Where the people are at a time [ns]."""
        return self.make(
            "geometry_msgs/msg/PoseArray",
            header=self.header("map", ns),
            poses=[self.pose(p.x, p.y, p.yaw) for p in places],
        )

    def visible(self, pixels: NDArray) -> Any:
        """How many pixels of each person are seen (`World.seen_pixels`).

        std_msgs/Int32MultiArray; one dimension, labelled `people_pixels`.
        """
        return self._of_people("people_pixels", np.rint(pixels).astype(np.int32))

    def percent(self, shares: NDArray) -> Any:
        """How much of each person is seen (`World.seen_shares`), in percent.

        std_msgs/Int32MultiArray; one dimension, labelled `people_percent`.
        """
        return self._of_people("people_percent", np.rint(100.0 * shares).astype(np.int32))

    def groups(self, numbers: NDArray) -> Any:
        """Which group each person belongs to (`World.groups`).

        std_msgs/Int32MultiArray; one dimension, labelled `people_groups`.
        """
        return self._of_people("people_groups", numbers.astype(np.int32))

    def _of_people(self, label: str, data: NDArray) -> Any:
        dimension = self.make(
            "std_msgs/msg/MultiArrayDimension", label=label, size=len(data), stride=len(data)
        )
        layout = self.make("std_msgs/msg/MultiArrayLayout", dim=[dimension], data_offset=0)
        return self.make("std_msgs/msg/Int32MultiArray", layout=layout, data=data)

    def true_pose(self, place: Place, ns: int) -> Any:
        """Where a robot is at a time [ns], as PoseStamped."""
        return self.make(
            "geometry_msgs/msg/PoseStamped",
            header=self.header("map", ns),
            pose=self.pose(place.x, place.y, place.yaw),
        )

    def floor_plan(self, scene: Scene, ns: int) -> Any:
        """The room's walls and furniture, as nav_msgs/OccupancyGrid of a time [ns]."""
        plan = floor_plan(scene.room, scene.furniture)
        info = self.make(
            "nav_msgs/msg/MapMetaData",
            map_load_time=self.header("map", ns).stamp,
            resolution=plan.resolution,
            width=plan.data.shape[1],
            height=plan.data.shape[0],
            origin=self.pose(plan.x, plan.y, plan.yaw),
        )
        return self.make(
            "nav_msgs/msg/OccupancyGrid",
            header=self.header("map", ns),
            info=info,
            data=plan.data.reshape(-1),
        )

    def odometry(self, robot: str, frame: str, sample: PoseSample, ns: int) -> Any:
        """nav_msgs/Odometry."""
        covariance = np.zeros((6, 6))
        covariance[np.ix_((0, 1, 5), (0, 1, 5))] = sample.covariance
        vector = "geometry_msgs/msg/Vector3"
        twist = self.make(
            "geometry_msgs/msg/Twist",
            linear=self.make(vector, x=sample.velocity, y=sample.sideways, z=0.0),
            angular=self.make(vector, x=0.0, y=0.0, z=sample.turn_rate),
        )
        return self.make(
            "nav_msgs/msg/Odometry",
            header=self.header("map" if frame == "map" else f"{robot}/{frame}", ns),
            child_frame_id=f"{robot}/base_link",
            pose=self.make(
                "geometry_msgs/msg/PoseWithCovariance",
                pose=self.pose(sample.x, sample.y, sample.yaw),
                covariance=covariance.reshape(-1),
            ),
            twist=self.make(
                "geometry_msgs/msg/TwistWithCovariance",
                twist=twist,
                covariance=np.diag([1e-4, 1e-6, 1e-6, 1e-6, 1e-6, 1e-4]).reshape(-1),
            ),
        )


def write_bag(out: Path, world: World, frames: Iterator[list[RenderedFrame]]) -> None:
    """Writes a bag.

    Args:
        out: A folder, or `NAME.mcap`.
        world: What was rendered.
        frames: For each frame what the robots saw, in order.

    Raises:
        BagError: It exists already or cannot be written.
    """
    messages = Messages()
    with BagWriter(out) as bag:
        bag.add_topic(MAP_TOPIC, "nav_msgs/msg/OccupancyGrid", [_MAP_QOS])
        begin = world.stamp_ns(0.0)
        bag.write(MAP_TOPIC, begin, messages.floor_plan(world.scene, begin))
        recordings = {name: RobotWriter(bag, name) for name in world.names}
        pending = _events(bag, world, messages)

        def events_until(ns: float) -> None:
            while pending and pending[-1][0] <= ns:
                pending.pop()[-1]()

        for index, seen in enumerate(frames):
            for frame in sorted(seen, key=lambda f: f.stamp_ns):
                events_until(frame.stamp_ns)
                topic = "image_raw" if world.stage.raw[frame.robot] else "image_rect"
                for camera in world.cameras[frame.robot]:
                    recordings[frame.robot].camera(
                        camera.name, topic, frame.images[camera.name], camera.model, frame.stamp_ns
                    )
            ns = world.stamp_ns(world.truth_time(index))
            events_until(ns)
            time = world.truth_time(index)
            bag.write(PEOPLE_TOPIC, ns, messages.people(world.person_places(time), ns))
            bag.write(VISIBLE_TOPIC, ns, messages.visible(world.seen_pixels(seen)))
            bag.write(PERCENT_TOPIC, ns, messages.percent(world.seen_shares(seen)))
            if world.has_group:
                bag.write(GROUP_TOPIC, ns, messages.groups(world.groups(time)))
        events_until(math.inf)


def _events(
    bag: BagWriter, world: World, messages: Messages
) -> list[tuple[int, str, Callable[[], None]]]:
    """Odometry and ranges: stamp [ns], robot, and what writes them; the first one last."""

    def odometry(name: str, frame: str, sample: PoseSample, ns: int) -> None:
        bag.write(f"/{name}/odom", ns, messages.odometry(name, frame, sample, ns))
        place = world.robot_place(name, sample.time)
        bag.write(true_pose_topic(name), ns, messages.true_pose(place, ns))

    def ranges(time: float, name: str, kind: str, ns: int) -> None:
        for topic, message in sensors.measured(time, name, kind):
            bag.write(topic, ns, message)

    events: list[tuple[int, str, Callable[[], None]]] = []
    for name, belief in world.beliefs.items():
        for sample in belief.samples:
            ns = world.stamp_ns(sample.time)
            events.append((ns, name, partial(odometry, name, belief.frame, sample, ns)))
    if world.scene.sonars or world.scene.lasers:
        sensors = RangeTopics(world, messages.make, messages.header)
        bag.add_topic(TF_TOPIC, "tf2_msgs/msg/TFMessage", [_MAP_QOS])
        bag.write(TF_TOPIC, world.stamp_ns(0.0), sensors.mountings())
        for time, name, kind in sensors.events(world.truth_time(world.scene.timing.frames - 1)):
            ns = world.stamp_ns(time)
            events.append((ns, name, partial(ranges, time, name, kind, ns)))
    return sorted(events, key=lambda event: event[:2], reverse=True)


def team_parameters(
    stage: Stage, starts: Mapping[str, tuple[float, float, float] | None]
) -> dict[str, Any]:
    """Parameters of a simulated team, as a ROS 2 parameter file holds them: what differs.

    Args:
        stage: The scene.
        starts: By robot, where the frame of its odometry is in the map (`Belief.map_from_odom`).
    """
    document: dict[str, Any] = {}
    for name, place in starts.items():
        mounting = stage.stereo[name].mounting.to_mapping()
        mounting = {
            key: round(value, 6) for key, value in mounting.items() if value or key == "height"
        }
        parameters: dict[str, Any] = {"mounting": mounting}
        images: dict[str, Any] = {}
        if stage.raw[name]:
            images["rectified"] = False
        if len(stage.cameras[name]) == 3:
            images["top"] = True
        if images:
            parameters["images"] = images
        if place is not None:
            parameters["pose"] = {"map_from_odom": [round(v, 6) for v in place]}
        walls = _wall_sensors(stage.scene, name)
        if walls:
            parameters["walls"] = walls
            odometry = stage.scene.odometry
            sigmas = [odometry.sigma, odometry.sigma, odometry.sigma_yaw]
            parameters["localization"] = {"start_sigmas": sigmas}
        document[f"/{name}/robot_node"] = {"ros__parameters": parameters}
    document["/**/planner_node"] = {"ros__parameters": {"robots": list(starts)}}
    return document


def _wall_sensors(scene: Scene, name: str) -> dict[str, Any]:
    """Parameters of a robot's sonars and laser scanner; none if it has none."""
    parameters: dict[str, Any] = {}
    sonars = scene.sonars.get(name, ())
    if sonars:
        parameters["sonars"] = [f"sonar_{k}" for k in range(len(sonars))]
        parameters["sonar_mountings"] = [v for s in sonars for v in (s.x, s.y, s.yaw)]
    laser = scene.lasers.get(name)
    if laser is not None:
        parameters |= {"laser": True, "laser_mounting": [laser.x, laser.y, laser.yaw]}
    return parameters


def write_team(path: Path, world: World) -> None:
    """Writes `team_parameters` as a file for the nodes and `--config`."""
    starts = {name: belief.map_from_odom for name, belief in world.beliefs.items()}
    text = yaml.safe_dump(
        team_parameters(world.stage, starts), sort_keys=False, default_flow_style=None
    )
    path.write_text(
        f"# The team of the simulated scene {world.scene.name}, seed {world.scene.seed}: what "
        f"differs from default.yaml.\n{text}",
        encoding="utf-8",
    )

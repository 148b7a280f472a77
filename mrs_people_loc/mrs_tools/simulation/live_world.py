"""A guided tour in real time, on ROS: bases that obey `cmd_vel`, odometry, images and the truth.

One process moves people and robots by the clock of this machine, whatever else there is to do;
others render what the heads see at the instants that the first one gives them. Where rendering is
too slow, images are left out and counted: the world never waits for them.
"""

from __future__ import annotations

import array
import contextlib
import math
import os
import signal
import time
from collections.abc import Sequence
from dataclasses import dataclass
from multiprocessing import get_context
from multiprocessing.connection import Connection
from multiprocessing.process import BaseProcess
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.guiding.guidance import Role
from mrs_people_loc.sensing.images import Gray
from mrs_tools.bags.robot_poses import true_pose_topic
from mrs_tools.bags.robot_writer import camera_info, image_message
from mrs_tools.simulation.guided import STEP_S, GuidedWorld
from mrs_tools.simulation.models.meshes import Mesh
from mrs_tools.simulation.motion import Place
from mrs_tools.simulation.scene import Scene
from mrs_tools.simulation.sensors.range_topics import SONAR_RATE, RangeTopics
from mrs_tools.simulation.views.live_view import LiveView
from mrs_tools.simulation.views.stage import Stage
from mrs_tools.simulation.writer import (
    GROUP_TOPIC,
    MAP_TOPIC,
    PEOPLE_TOPIC,
    VISIBLE_TOPIC,
    Messages,
)
from mrs_tools.tool_node import message_class, node

#: Rate of the images, and of the truth about people [Hz].
IMAGE_RATE, _TRUTH_RATE = 5.0, 10.0
#: How long a process gets to end after it was told to [s].
_GRACE_S = 3.0


@dataclass(frozen=True)
class Progress:
    """How a live world goes on.

    Attributes:
        time: Since the start [s].
        rendered: Images of robots that were rendered.
        dropped: Images of robots that were left out because rendering was too slow.
        behind_s: Longest time that the world itself was late [s].
        bumps: How often a robot has run into something (`GuidedWorld.bumps`).
        world_cpu_s: Processor time of the process that moves people and robots [s].
        cameras_cpu_s: Processor time of those that render [s].
    """

    time: float = 0.0
    rendered: int = 0
    dropped: int = 0
    behind_s: float = 0.0
    bumps: int = 0
    world_cpu_s: float = 0.0
    cameras_cpu_s: float = 0.0


class LiveWorld:
    """The processes of a world that lives; use it as a context manager, which ends them.

    Args:
        scene: The scene (`guided.guided_scene`).
        ranges: Whether sonars and laser scanners measure.
    """

    def __init__(self, scene: Scene, *, ranges: bool) -> None:
        context = get_context("spawn")
        self._progress = Progress()
        self._pipe, others = context.Pipe()
        self._process: BaseProcess = context.Process(
            target=_run_world, args=(scene, ranges, others), name="world"
        )
        self._process.start()
        others.close()

    def __enter__(self) -> LiveWorld:
        """Returns the world."""
        return self

    def __exit__(self, *_: object) -> None:
        """Ends the processes."""
        self._pipe.close()
        self._process.join(_GRACE_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()

    @property
    def progress(self) -> Progress:
        """How it was at last; about twice a second."""
        with contextlib.suppress(EOFError, OSError):
            while self._pipe.poll():
                self._progress = self._pipe.recv()
        return self._progress

    @property
    def exit_code(self) -> int | None:
        """Of that process; None: it goes on."""
        return self._process.exitcode


def make_message(kind: str, **fields: Any) -> Any:
    """A message of an installed type; its sequences of numbers may be NumPy arrays."""
    found = message_class(kind)
    types = found.get_fields_and_field_types()
    return found(
        **{
            name: array.array(value.dtype.char, value.tobytes())
            if isinstance(value, np.ndarray) and types[name].startswith("sequence")
            else value
            for name, value in fields.items()
        }
    )


# ---------------------------------------------------------------------------------------- world


def _run_world(scene: Scene, ranges: bool, pipe: Connection) -> None:
    """The process that moves people and robots, until the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal's; the parent closes the pipe
    with node("mrs_world") as ros, _Cameras(scene) as cameras:
        _World(scene, ranges, ros, cameras).run(pipe)


class _World:
    """People, robots and their sensors in real time.

    Attributes:
        scene: The scene.
        names: Of the robots.
    """

    def __init__(self, scene: Scene, ranges: bool, ros: Any, cameras: _Cameras) -> None:
        self.scene, self.names = scene, list(scene.robots)
        self._world, self._cameras, self._ros = GuidedWorld(scene), cameras, ros
        self._messages = Messages(make_message)
        self._stage = Stage(scene) if ranges else None
        self._sensors = RangeTopics(self, make_message, self._messages.header) if ranges else None
        self._start_ns, self._behind_s = 0, 0.0
        self._publishers: dict[str, Any] = {}
        self._open()

    # ---- what range sensors are in

    @property
    def room(self) -> Mesh:
        """The room and its furniture, in the map."""
        assert self._stage is not None
        return self._stage.room

    def person_places(self, time: float) -> list[Place]:
        """Where the people are now."""
        return self._world.people

    def robot_place(self, name: str, time: float) -> Place:
        """Where a robot is now."""
        wheels = self._world.wheels[name]
        x, y, yaw = map(float, wheels.pose)
        return Place(x, y, yaw, wheels.speed, 0.0)

    def stamp_ns(self, time: float) -> int:
        """The stamp of a time of the world [ns]."""
        return self._start_ns + round(time * 1e9)

    # ---- topics

    def _open(self) -> None:
        """Opens the topics; where range sensors are is in the team's parameter file."""
        from geometry_msgs.msg import PoseArray, PoseStamped, Twist
        from mrs_people_msgs.msg import GuideStatus
        from nav_msgs.msg import OccupancyGrid, Odometry
        from sensor_msgs.msg import LaserScan, Range
        from std_msgs.msg import Int32MultiArray

        from mrs_ros.qos import MAP, POSES

        for name in self.names:
            self._offer(f"/{name}/odom", Odometry, POSES)
            self._offer(true_pose_topic(name), PoseStamped, POSES)
            if self._sensors is not None:
                for k in range(len(self.scene.sonars.get(name, ()))):
                    self._offer(f"/{name}/sonar_{k}", Range, POSES)
                if name in self.scene.lasers:
                    self._offer(f"/{name}/scan", LaserScan, POSES)
        self._offer(PEOPLE_TOPIC, PoseArray, POSES)
        self._offer(GROUP_TOPIC, Int32MultiArray, POSES)
        self._offer(VISIBLE_TOPIC, Int32MultiArray, POSES)
        self._offer(MAP_TOPIC, OccupancyGrid, MAP)
        self._commands = {
            name: self._ros.create_subscription(Twist, f"/{name}/cmd_vel", _unused, 10)
            for name in self.names
        }
        self._status = self._ros.create_subscription(GuideStatus, "/guide_status", _unused, 10)

    def _offer(self, topic: str, kind: Any, qos: Any) -> None:
        self._publishers[topic] = self._ros.create_publisher(kind, topic, qos)

    def _publish(self, topic: str, message: Any) -> None:
        self._publishers[topic].publish(message)

    # ---- running

    def run(self, pipe: Connection) -> None:
        """Lives until the pipe is closed."""
        self._start_ns, start = time.time_ns(), time.monotonic()
        self._publish(MAP_TOPIC, self._messages.floor_plan(self.scene, self._start_ns))
        step = 0
        while not _is_closed(pipe):
            late = time.monotonic() - start - step * STEP_S
            if late < 0.0:
                time.sleep(min(-late, STEP_S))
                continue
            self._behind_s = max(self._behind_s, late)
            self._obey()
            self._world.step(STEP_S)
            step += 1
            self._tell(step)
            if _is_due(step, 2.0):
                pipe.send(self._so_far())

    def _so_far(self) -> Progress:
        cameras, world = self._cameras, self._world
        return Progress(
            world.time, cameras.rendered, cameras.dropped, self._behind_s, world.bumps,
            time.process_time(), cameras.cpu_s,
        )  # fmt: skip

    def _obey(self) -> None:
        """Takes the commands and the leader that have come since the last step."""
        for name, subscription in self._commands.items():
            for command in _taken(subscription):
                self._world.wheels[name].command(command.linear.x, command.angular.z)
        for status in _taken(self._status):
            for post in status.posts:
                if post.role == Role.LEADER and not post.fault:
                    self._world.leader = post.robot

    def _tell(self, step: int) -> None:
        """Publishes what is due after a step."""
        now, ns = self._world.time, self.stamp_ns(step * STEP_S)
        places = {name: self.robot_place(name, now) for name in self.names}
        for name, wheels in self._world.wheels.items():
            sample = wheels.odometry()
            odometry = self._messages.odometry(name, wheels.frame, sample, ns)
            self._publish(f"/{name}/odom", odometry)
            self._publish(true_pose_topic(name), self._messages.true_pose(places[name], ns))
        people = self._world.people
        for pixels in self._cameras.seen():
            self._publish(VISIBLE_TOPIC, self._messages.visible(pixels))
        if _is_due(step, IMAGE_RATE):
            self._cameras.show(ns, people, places)
        if _is_due(step, _TRUTH_RATE):
            self._publish(PEOPLE_TOPIC, self._messages.people(people, ns))
            self._publish(GROUP_TOPIC, self._messages.groups(self._world.groups))
        self._measure(step)

    def _measure(self, step: int) -> None:
        if self._sensors is None:
            return
        due = [(name, "sonars") for name in self.scene.sonars if _is_due(step, SONAR_RATE)]
        due += [(n, "laser") for n, laser in self.scene.lasers.items() if _is_due(step, laser.rate)]
        for name, kind in due:
            for topic, message in self._sensors.measured(step * STEP_S, name, kind):
                self._publish(topic, message)


def _unused(_: Any) -> None:
    """Messages are taken from the subscriptions: an executor costs more than they do."""


def _taken(subscription: Any) -> list[Any]:
    """The messages that have come on a subscription."""
    found, handle = [], subscription.handle
    with handle:
        while (taken := handle.take_message(subscription.msg_type, False)) is not None:
            found.append(taken[0])
    return found


def _is_due(step: int, rate: float) -> bool:
    """Whether something of a rate [Hz], at most that of steps, happens after a step."""
    every = max(1.0, 1.0 / (rate * STEP_S))
    return math.floor(step / every) > math.floor((step - 1) / every)


def _is_closed(pipe: Connection) -> bool:
    """Whether the other end of a pipe, which sends nothing, is closed."""
    try:
        while pipe.poll():
            pipe.recv()
    except (EOFError, OSError):
        return True
    return False


# -------------------------------------------------------------------------------------- cameras


@dataclass(frozen=True)
class _Instant:
    """Where everybody is at a time [ns]."""

    ns: int
    people: Sequence[Place]
    robots: dict[str, Place]


class _Cameras:
    """The processes that render; use it as a context manager, which ends them.

    Each has some of the robots, so that all processors share the work on an instant.

    Attributes:
        rendered: Images of robots that were rendered.
        dropped: Images of robots that were left out, as their process was busy.
    """

    def __init__(self, scene: Scene) -> None:
        self.rendered = self.dropped = 0
        names, count = list(scene.robots), min(len(scene.robots), os.cpu_count() or 1)
        self._renderers = [_Renderer(scene, names[k::count]) for k in range(count)]
        for renderer in self._renderers:
            renderer.wait()
        #: By stamp: how many processes work on the instant, and pixels of each person so far.
        self._underway: dict[int, tuple[int, NDArray]] = {}

    def __enter__(self) -> _Cameras:
        return self

    def __exit__(self, *_: object) -> None:
        for renderer in self._renderers:
            renderer.end()

    @property
    def cpu_s(self) -> float:
        """Processor time of all of them [s]."""
        return sum(renderer.cpu_s for renderer in self._renderers)

    def show(self, ns: int, people: Sequence[Place], robots: dict[str, Place]) -> None:
        """Lets all render an instant but those that are still busy with another one."""
        ready = [renderer for renderer in self._renderers if renderer.is_ready]
        for renderer in ready:
            renderer.show(_Instant(ns, people, robots))
        self._underway[ns] = len(ready), np.zeros(len(people))
        self.dropped += sum(len(r.robots) for r in self._renderers if r not in ready)

    def seen(self) -> list[NDArray]:
        """For each instant that was rendered since the last time: pixels of each person."""
        for renderer in self._renderers:
            for ns, pixels in renderer.results():
                count, before = self._underway[ns]
                self._underway[ns] = count - 1, np.maximum(before, pixels)
                self.rendered += len(renderer.robots)
        done = [ns for ns, (count, _) in self._underway.items() if not count]
        return [self._underway.pop(ns)[1] for ns in done]


class _Renderer:
    """A process that renders what some robots see.

    Attributes:
        robots: Their names.
        is_ready: Whether it has nothing to do.
        cpu_s: Its processor time [s].
    """

    def __init__(self, scene: Scene, robots: Sequence[str]) -> None:
        context = get_context("spawn")
        self.robots, self.is_ready, self.cpu_s = robots, False, 0.0
        self._pipe, others = context.Pipe()
        self._process: BaseProcess = context.Process(
            target=_run_cameras, args=(scene, robots, others), name=f"cameras of {robots}"
        )
        self._process.start()
        others.close()

    def wait(self) -> None:
        """Waits until it has built everything."""
        self._pipe.recv()
        self.is_ready = True

    def show(self, instant: _Instant) -> None:
        """Lets it render an instant."""
        self.is_ready = False
        self._pipe.send(instant)

    def results(self) -> list[tuple[int, NDArray]]:
        """Stamps of what was rendered since the last time, and pixels of each person."""
        found = []
        while self._pipe.poll():
            ns, pixels, self.cpu_s = self._pipe.recv()
            found.append((ns, pixels))
            self.is_ready = True
        return found

    def end(self) -> None:
        """Ends it."""
        self._pipe.close()
        self._process.join(_GRACE_S)
        if self._process.is_alive():
            self._process.kill()
            self._process.join()


def _run_cameras(scene: Scene, robots: Sequence[str], pipe: Connection) -> None:
    """The process that renders what some robots see, until the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    stage = Stage(scene)
    view = LiveView(stage, scene.people, scene.seed)
    with node("mrs_cameras") as ros:
        heads = {name: _Head(ros, stage, name) for name in robots}
        with contextlib.suppress(EOFError, OSError):
            pipe.send(None)
            while True:
                instant: _Instant = pipe.recv()
                view.move(instant.people, instant.robots)
                best = np.zeros(len(instant.people))
                for name, head in heads.items():
                    images, pixels = view.look(name)
                    head.publish(images, instant.ns)
                    place = instant.robots[name]
                    seen = stage.seen_pixels(name, place, instant.people, pixels)
                    best = np.maximum(best, seen)
                pipe.send((instant.ns, best, time.process_time()))


class _Head:
    """The topics of a robot's cameras."""

    def __init__(self, ros: Any, stage: Stage, robot: str) -> None:
        from sensor_msgs.msg import CameraInfo, Image

        from mrs_ros.qos import STREAM

        images = "image_raw" if stage.raw[robot] else "image_rect"
        self._robot = robot
        self._cameras = {
            camera.name: (
                ros.create_publisher(Image, f"/{robot}/{camera.name}/{images}", STREAM),
                ros.create_publisher(CameraInfo, f"/{robot}/{camera.name}/camera_info", STREAM),
                camera.model,
            )
            for camera in stage.cameras[robot]
        }

    def publish(self, images: dict[str, Gray], ns: int) -> None:
        """Sends images of a time [ns]."""
        make = make_message
        messages = Messages(make)
        for name, (send_image, send_info, model) in self._cameras.items():
            header = messages.header(f"{self._robot}/{name}_camera_optical", ns)
            send_info.publish(camera_info(make, header, model))
            send_image.publish(image_message(make, header, images[name]))

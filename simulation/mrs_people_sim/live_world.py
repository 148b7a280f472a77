"""A guided tour on ROS: bases that obey `cmd_vel`, odometry, images and the truth.

One process moves people and robots, and publishes `/clock`; others render what the heads see at the
instants that the first one gives them. Time goes on in real time, but stands still while rendering,
or the team, is behind: on a busy machine everything is the same, only slower.
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

from mrs_people_loc.config import PEOPLE_TOPICS
from mrs_people_loc.guiding.guidance import Role
from mrs_people_loc.sensing.images import Gray
from mrs_people_sim.guided import STEP_S, GuidedWorld
from mrs_people_sim.models.meshes import Mesh
from mrs_people_sim.motion import Place
from mrs_people_sim.robot_writer import camera_info, image_message
from mrs_people_sim.scene import Scene
from mrs_people_sim.sensors.range_topics import SONAR_RATE, RangeTopics
from mrs_people_sim.views.live_view import LiveView
from mrs_people_sim.views.stage import Stage
from mrs_people_sim.writer import (
    GROUP_TOPIC,
    MAP_TOPIC,
    PEOPLE_TOPIC,
    VISIBLE_TOPIC,
    Messages,
)
from mrs_ros.closing import Closing
from mrs_tools.bags.truth import true_pose_topic
from mrs_tools.tool_node import message_class, node

#: Rate of the images, and of the truth about people [Hz].
IMAGE_RATE, _TRUTH_RATE = 5.0, 10.0
#: `/clock` is published so often, and it is looked so often whether time may go on again [s].
_TICK_S, _HELD_S = 0.01, 0.002
#: A step that is late is made up for by this much; what is more is lost to real time [s].
_LATE_S = 0.1
#: Time stands while the team's last people are so old [s of the world], unless it has said nothing
#: for so long [s]: its planner may have ended.
_TEAM_S, _SILENT_S = 0.45, 3.0
#: A world that is slower than this share of real time is told to be slow.
_SLOW = 0.9
#: How long a process gets to end after it was told to [s].
_GRACE_S = 3.0


@dataclass(frozen=True)
class Progress:
    """How a live world goes on.

    Attributes:
        time: Time of the world since the start [s].
        real_s: Real time since the start [s].
        rendering_s: For so long of that the world has stood still until images were rendered [s].
        bumps: How often a robot has run into something (`GuidedWorld.bumps`).
        world_cpu_s: Processor time of the process that moves people and robots [s].
        cameras_cpu_s: Processor time of those that render [s].
    """

    time: float = 0.0
    real_s: float = 0.0
    rendering_s: float = 0.0
    bumps: int = 0
    world_cpu_s: float = 0.0
    cameras_cpu_s: float = 0.0

    def pace(self, before: Progress | None = None) -> str:
        """How fast it goes since another moment, in words, such as "rendering 0.4 of real time".

        Args:
            before: That moment; None: the start.
        """
        before = before or Progress()
        real_s = max(self.real_s - before.real_s, 1e-3)
        share = (self.time - before.time) / real_s
        rendering_s = self.rendering_s - before.rendering_s
        what = "rendering" if rendering_s > 0.5 * (1.0 - share) * real_s else "simulation"
        return f"{what} {share:.1f} of real time" if share < _SLOW else ""


class LiveWorld(Closing):
    """The processes of a world that lives; use it as a context manager, which ends them.

    Args:
        scene: The scene (`guided.guided_scene`).
    """

    def __init__(self, scene: Scene) -> None:
        context = get_context("spawn")
        self._progress = Progress()
        self._pipe, others = context.Pipe()
        self._process: BaseProcess = context.Process(
            target=_run_world, args=(scene, others), name="world"
        )
        self._process.start()
        others.close()

    def close(self) -> None:
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


def _run_world(scene: Scene, pipe: Connection) -> None:
    """The process that moves people and robots, until the pipe is closed."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # the terminal's; the parent closes the pipe
    with node("mrs_world") as ros, _Cameras(scene) as cameras:
        _World(scene, ros, cameras).run(pipe)


class _World:
    """People, robots and their sensors.

    Attributes:
        scene: The scene.
        names: Of the robots.
    """

    def __init__(self, scene: Scene, ros: Any, cameras: _Cameras) -> None:
        self.scene, self.names = scene, list(scene.robots)
        self._world, self._cameras, self._ros = GuidedWorld(scene), cameras, ros
        self._messages = Messages(make_message)
        self._stage = Stage(scene)
        self._sensors = RangeTopics(self, make_message, self._messages.header)
        self._start_ns, self._began_s, self._rendering_s = 0, 0.0, 0.0
        self._people_s, self._heard_s = 0.0, -_SILENT_S
        self._publishers: dict[str, Any] = {}
        self._open()

    # ---- what range sensors are in

    @property
    def room(self) -> Mesh:
        """The room and its furniture, in the map."""
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
        from mrs_people_msgs.msg import GuideStatus, People
        from nav_msgs.msg import OccupancyGrid, Odometry
        from rosgraph_msgs.msg import Clock
        from sensor_msgs.msg import LaserScan, Range
        from std_msgs.msg import Int32MultiArray

        from mrs_ros.qos import MAP, POSES

        for name in self.names:
            self._offer(f"/{name}/odom", Odometry, POSES)
            self._offer(true_pose_topic(name), PoseStamped, POSES)
            for k in range(len(self.scene.sonars.get(name, ()))):
                self._offer(f"/{name}/sonar_{k}", Range, POSES)
            if name in self.scene.lasers:
                self._offer(f"/{name}/scan", LaserScan, POSES)
        self._offer(PEOPLE_TOPIC, PoseArray, POSES)
        self._offer(GROUP_TOPIC, Int32MultiArray, POSES)
        self._offer(VISIBLE_TOPIC, Int32MultiArray, POSES)
        self._offer(MAP_TOPIC, OccupancyGrid, MAP)
        self._offer("/clock", Clock, 10)
        self._clock = Clock()
        self._commands = {
            name: self._ros.create_subscription(Twist, f"/{name}/cmd_vel", _unused, 10)
            for name in self.names
        }
        self._status = self._ros.create_subscription(GuideStatus, "/guide_status", _unused, 10)
        self._found = self._ros.create_subscription(People, f"/{PEOPLE_TOPICS[0]}", _unused, 10)

    def _offer(self, topic: str, kind: Any, qos: Any) -> None:
        self._publishers[topic] = self._ros.create_publisher(kind, topic, qos)

    def _publish(self, topic: str, message: Any) -> None:
        self._publishers[topic].publish(message)

    # ---- running

    def run(self, pipe: Connection) -> None:
        """Lives until the pipe is closed."""
        self._start_ns, self._began_s = time.time_ns(), time.monotonic()
        self._publish(MAP_TOPIC, self._messages.floor_plan(self.scene, self._start_ns))
        step, due_s, told_s = 0, self._began_s, 0.0
        while not _is_closed(pipe):
            now_s = time.monotonic()
            if now_s - told_s > 0.5:
                told_s = now_s
                with contextlib.suppress(OSError):  # it has just been closed
                    pipe.send(self._so_far())
            early_s = due_s - now_s
            if early_s > 0.0:
                self._tick(step * STEP_S + max(0.0, STEP_S - early_s))
                time.sleep(min(early_s, _TICK_S))
                continue
            held = self._held(step + 1)
            if held:
                time.sleep(_HELD_S)
                if held == "rendering":
                    self._rendering_s += time.monotonic() - now_s
                due_s = time.monotonic()
                continue
            step += 1
            due_s = max(due_s + STEP_S, now_s - _LATE_S)
            self._tick(step * STEP_S)
            self._obey()
            self._world.step(STEP_S)
            self._tell(step)

    def _tick(self, time_s: float) -> None:
        """Publishes the time of the world on `/clock`."""
        seconds, nanoseconds = divmod(self.stamp_ns(time_s), 10**9)
        self._clock.clock.sec, self._clock.clock.nanosec = seconds, nanoseconds
        self._publish("/clock", self._clock)

    def _held(self, step: int) -> str:
        """What a step must wait for; empty: nothing."""
        for pixels in self._cameras.seen():
            self._publish(VISIBLE_TOPIC, self._messages.visible(pixels))
        if _is_due(step, IMAGE_RATE) and not self._cameras.are_ready:
            return "rendering"
        for people in _taken(self._found):
            stamp_ns = people.header.stamp.sec * 10**9 + people.header.stamp.nanosec
            self._people_s, self._heard_s = (stamp_ns - self._start_ns) / 1e9, time.monotonic()
        speaks = time.monotonic() - self._heard_s < _SILENT_S
        return "team" if speaks and step * STEP_S - self._people_s > _TEAM_S else ""

    def _so_far(self) -> Progress:
        cameras, world = self._cameras, self._world
        return Progress(
            world.time, time.monotonic() - self._began_s, self._rendering_s, world.bumps,
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
        if _is_due(step, IMAGE_RATE):
            self._cameras.show(ns, people, places)
        if _is_due(step, _TRUTH_RATE):
            self._publish(PEOPLE_TOPIC, self._messages.people(people, ns))
            self._publish(GROUP_TOPIC, self._messages.groups(self._world.groups))
        self._measure(step)

    def _measure(self, step: int) -> None:
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


class _Cameras(Closing):
    """The processes that render; use it as a context manager, which ends them.

    Each has some of the robots, so that all processors share the work on an instant.
    """

    def __init__(self, scene: Scene) -> None:
        names, count = list(scene.robots), min(len(scene.robots), os.cpu_count() or 1)
        self._renderers = [_Renderer(scene, names[k::count]) for k in range(count)]
        for renderer in self._renderers:
            renderer.wait()
        #: By stamp: how many processes work on the instant, and pixels of each person so far.
        self._underway: dict[int, tuple[int, NDArray]] = {}

    def close(self) -> None:
        for renderer in self._renderers:
            renderer.end()

    @property
    def cpu_s(self) -> float:
        """Processor time of all of them [s]."""
        return sum(renderer.cpu_s for renderer in self._renderers)

    @property
    def are_ready(self) -> bool:
        """Whether they have rendered the last instant, as far as `seen` has looked."""
        return all(renderer.is_ready for renderer in self._renderers)

    def show(self, ns: int, people: Sequence[Place], robots: dict[str, Place]) -> None:
        """Lets all render an instant; they must be ready."""
        for renderer in self._renderers:
            renderer.show(_Instant(ns, people, robots))
        self._underway[ns] = len(self._renderers), np.zeros(len(people))

    def seen(self) -> list[NDArray]:
        """For each instant that was rendered since the last time: pixels of each person."""
        for renderer in self._renderers:
            for ns, pixels in renderer.results():
                count, before = self._underway[ns]
                self._underway[ns] = count - 1, np.maximum(before, pixels)
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
        """Ends it, at once: it has nothing to tidy, and DDS may hang when it does."""
        self._pipe.close()
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

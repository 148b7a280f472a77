"""The live part of `mrs bench`: real processes, real DDS, images with the stamps of now.

A bag's images and odometry are sent to one robot_node per robot and the planner, at the rates of a
real team; what is measured is how old an image is when the people in it arrive, and what each
process takes of the processor.
"""

from __future__ import annotations

import heapq
import itertools
import math
import os
import re
import struct
import tempfile
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mrs_people_loc.config import PLANNER_NODE, Team, load_team
from mrs_people_loc.errors import BagError, PeopleLocError
from mrs_people_loc.messages import stamp_ns_of
from mrs_people_sim.domain import refuse_other_publishers
from mrs_ros.processes import NodeProcess, RunningTeam, team_processes
from mrs_tools.bags.offline import BagRun
from mrs_tools.bags.reader import BagReader
from mrs_tools.tool_node import message_class, node, wait_for_discovery, working

FRAME_HZ = 30.0
POSE_HZ = 100.0
#: The processes get this long to start and find each other [s].
_START_S = 60.0
#: After a change of what is sent, this long is not measured [s].
_SETTLE_S = 2.0
#: Robots send their poses this far apart, so that they do not come all at once [s].
_POSE_SHIFT_S = 0.003
#: What a node measures besides its stages: publishing, after them.
_AFTER = "publish"


# ---------------------------------------------------------------------------------- what is sent


@dataclass(frozen=True)
class Recorded:
    """One robot's messages as bytes, to be sent again and again.

    Attributes:
        types: ROS type of each topic.
        frames: Each one a message per topic, images and calibration.
        pose: Topic and message.
        offset_s: How long after the first robot's image this one's comes [s].
        image_bytes: Bytes of the images of one frame.
    """

    types: Mapping[str, str]
    frames: Sequence[Mapping[str, bytes]]
    pose: tuple[str, bytes]
    offset_s: float
    image_bytes: float


def read_recorded(path: Path, team: Team) -> dict[str, Recorded]:
    """What the robots of a team are sent, by robot.

    Raises:
        BagError: The bag lacks images or odometry of a robot.
    """
    recorded, first_ns = {}, {}
    with BagReader(path) as bag:
        for robot, config in team.robots.items():
            cameras = ("left", "right", "top") if config.images.top else ("left", "right")
            kind = "image_rect" if config.images.rectified else "image_raw"
            images = [f"/{robot}/{camera}/{kind}" for camera in cameras]
            topics = [*(f"/{robot}/{camera}/camera_info" for camera in cameras), *images]
            pose_topic = f"/{robot}/{config.pose.source}"
            missing = [topic for topic in (*topics, pose_topic) if topic not in bag.topics]
            if missing:
                raise BagError(f"{path}: has no {', '.join(missing)}")
            frames: defaultdict[int, dict[str, bytes]] = defaultdict(dict)
            for raw in bag.messages(topics):
                frames[stamp_ns_of(bag.decode(raw).header.stamp)][raw.topic] = raw.data
            whole = [
                {topic: frames[stamp][topic] for topic in topics}
                for stamp in sorted(frames)
                if len(frames[stamp]) == len(topics)
            ]
            if not whole:
                raise BagError(f"{path}: {robot} has no frame with images of all its cameras")
            first_ns[robot] = min(s for s in frames if len(frames[s]) == len(topics))
            pose = next(iter(bag.messages([pose_topic])))
            recorded[robot] = Recorded(
                types={topic: bag.topics[topic].type for topic in (*topics, pose_topic)},
                frames=whole,
                pose=(pose_topic, pose.data),
                offset_s=0.0,
                image_bytes=float(np.mean([sum(len(f[t]) for t in images) for f in whole])),
            )
    earliest = min(first_ns.values())
    return {
        robot: Recorded(**{**vars(one), "offset_s": (first_ns[robot] - earliest) * 1e-9})
        for robot, one in recorded.items()
    }


def stamped(message: bytes, stamp_ns: int) -> bytes:
    """A message that begins with a header, with another stamp.

    In CDR the stamp follows the encapsulation's four bytes: seconds and nanoseconds.

    Args:
        message: In CDR, little-endian.
        stamp_ns: The stamp [ns].

    Raises:
        BagError: The bytes are big-endian.
    """
    if message[:2] != b"\x00\x01":
        raise BagError("a message is not in little-endian CDR, as every recorder here writes it")
    return message[:4] + struct.pack("<iI", *divmod(stamp_ns, 10**9)) + message[12:]


class Feeder(threading.Thread):
    """Sends poses, and when it is told to, frames, each at its time.

    Args:
        node: The ROS node to publish with.
        recorded: What to send, by robot.
        frame_hz: Frames per second and robot.
        pose_hz: Poses per second and robot.
        on_frame: Told of each frame: its robot and its stamp [ns].

    Attributes:
        frames_on: Set: frames are sent, too.
        frames: Frames sent so far, by robot.
        poses: Poses sent so far, by robot.
        late_s: By how much the latest message missed its time [s].
        error: What ended it before its time.
    """

    def __init__(
        self,
        node: Any,
        recorded: Mapping[str, Recorded],
        frame_hz: float,
        pose_hz: float,
        on_frame: Callable[[str, int], None] = lambda robot, stamp_ns: None,
    ) -> None:
        from rclpy.qos import QoSProfile, qos_profile_sensor_data

        super().__init__(name="feeder", daemon=True)
        self._recorded = recorded
        self.frame_hz, self.pose_hz, self._on_frame = frame_hz, pose_hz, on_frame
        self._stop_event = threading.Event()
        self.frames_on = threading.Event()
        self.frames = dict.fromkeys(recorded, 0)
        self.poses = dict.fromkeys(recorded, 0)
        self.late_s = 0.0
        self.error: Exception | None = None
        self.publishers = {
            topic: node.create_publisher(
                message_class(kind),
                topic,
                QoSProfile(depth=10) if topic == one.pose[0] else qos_profile_sensor_data,
            )
            for one in recorded.values()
            for topic, kind in one.types.items()
        }

    def run(self) -> None:
        """Sends until it is stopped."""
        try:
            began = time.monotonic()
            for due_s, robot, is_frame in self._schedule():
                wait_s = began + due_s - time.monotonic()
                if self._stop_event.wait(max(0.0, wait_s)):
                    return
                if is_frame and not self.frames_on.is_set():
                    continue
                self.late_s = max(self.late_s, -wait_s)
                self._send(robot, is_frame)
        except Exception as err:
            self.error = err

    def stop(self) -> None:
        """Ends it."""
        self._stop_event.set()
        self.join()
        if self.error is not None:
            raise self.error

    def _schedule(self) -> Iterator[tuple[float, str, bool]]:
        def every(period_s: float, start_s: float, robot: str, is_frame: bool) -> Iterator[Any]:
            return ((start_s + n * period_s, robot, is_frame) for n in itertools.count())

        return heapq.merge(
            *(every(1 / self.frame_hz, r.offset_s, name, True)
              for name, r in self._recorded.items()),
            *(every(1 / self.pose_hz, i * _POSE_SHIFT_S, name, False)
              for i, name in enumerate(self._recorded)),
        )  # fmt: skip

    def _send(self, robot: str, is_frame: bool) -> None:
        one, now_ns = self._recorded[robot], time.time_ns()
        if is_frame:
            self._on_frame(robot, now_ns)
            for topic, data in one.frames[self.frames[robot] % len(one.frames)].items():
                self.publishers[topic].publish(stamped(data, now_ns))
            self.frames[robot] += 1
        else:
            topic, data = one.pose
            self.publishers[topic].publish(stamped(data, now_ns))
            self.poses[robot] += 1


# ------------------------------------------------------------------------------ what is measured


@dataclass(frozen=True)
class Usage:
    """What a process took so far: processor time [ms], and pages that had to be mapped."""

    cpu_ms: float
    page_faults: int

    @classmethod
    def of(cls, pid: int) -> Usage:
        """Reads /proc."""
        text = Path("/proc", str(pid), "stat").read_text(encoding="ascii")
        values = text.rpartition(")")[2].split()  # from the third field on
        ticks = int(values[11]) + int(values[12])  # in the user's and the system's name
        return cls(ticks * 1000.0 / os.sysconf("SC_CLK_TCK"), int(values[7]))

    def __sub__(self, other: Usage) -> Usage:
        """What was taken between."""
        return Usage(self.cpu_ms - other.cpu_ms, self.page_faults - other.page_faults)


def _busy_ms() -> float:
    """Processor time that the machine has spent on anything so far, all cores [ms]."""
    values = Path("/proc/stat").read_text(encoding="ascii").split("\n", 1)[0].split()[1:8]
    user, nice, system, _idle, _iowait, irq, softirq = map(int, values)
    return (user + nice + system + irq + softirq) * 1000.0 / os.sysconf("SC_CLK_TCK")


@dataclass
class Heard:
    """What the team sends.

    Attributes:
        ages_ms: By `newest` and `oldest`, how old that scan's image is when the people arrive.
        scans: Scans used, by robot.
        intervals: Number of intervals.
        stages_ms: By node and stage, how long it took, by diagnostics.
    """

    ages_ms: dict[str, list[float]] = field(default_factory=lambda: {"newest": [], "oldest": []})
    scans: defaultdict[str, int] = field(default_factory=lambda: defaultdict(int))
    intervals: int = 0
    stages_ms: defaultdict[str, defaultdict[str, list[float]]] = field(
        default_factory=lambda: defaultdict(lambda: defaultdict(list))
    )

    def on_people(self, message: Any) -> None:
        """Takes a message on `tracked_people`."""
        now_ns = time.time_ns()
        stamps = [stamp_ns_of(scan.stamp) for scan in message.scans]
        self.intervals += 1
        self.ages_ms["newest"].append((now_ns - max(stamps)) / 1e6)
        self.ages_ms["oldest"].append((now_ns - min(stamps)) / 1e6)
        for scan in message.scans:
            self.scans[scan.robot] += 1

    def on_diagnostics(self, message: Any) -> None:
        """Takes a message on `/diagnostics`."""
        for status in message.status:
            node, _, what = status.name.partition(": ")
            if what in ("scan", "intervals"):
                for entry in status.values:
                    if entry.key.endswith("_ms") and re.fullmatch(r"[\d.]+", entry.value):
                        self.stages_ms[node][entry.key.removesuffix("_ms")].append(
                            float(entry.value)
                        )


def measure_live(
    bag: Path,
    files: Sequence[Path],
    seconds: float,
    on_step: Callable[[str], None] = lambda _: None,
    *,
    frame_hz: float = FRAME_HZ,
    pose_hz: float = POSE_HZ,
) -> dict[str, Any]:
    """Runs a team's processes on a bag's images and measures them.

    Args:
        bag: Where the images and the odometry come from.
        files: Parameter files of the team.
        seconds: How long to measure [s].
        on_step: Told what is done now.
        frame_hz: Frames per second and robot.
        pose_hz: Poses per second and robot.

    Returns:
        The figures; see `mrs bench --json`.

    Raises:
        PeopleLocError: The bag or a file cannot be used, or the processes do not work.
    """
    team = load_team(*files)
    recorded = read_recorded(bag, team)
    sizes = sizes_on_the_wire(bag, files)
    topic = f"/{team.planner.people_topic}"
    with listening(topic) as (made, listener):
        feeder = Feeder(made, recorded, frame_hz, pose_hz)
        own = dict.fromkeys(feeder.publishers, made.get_fully_qualified_name())
        wait_for_discovery(made)
        refuse_other_publishers(made, {topic: "", **own})
        with (
            tempfile.TemporaryFile("w+") as log,
            RunningTeam(team_processes(files), log=log) as running,
            working(made),
        ):
            on_step("starting " + ", ".join(n.label for n in running.processes))
            _wait_until_ready(made, topic, running, feeder, log)
            refuse_other_publishers(made, {topic: f"/{PLANNER_NODE}", **own})
            measured = _measure(running, feeder, listener, seconds, on_step)
            check_alive("while it was measured", running, log)
    return _figures(recorded, sizes, measured)


@dataclass
class _Listener:
    """What takes the team's messages: the `heard` of now."""

    heard: Heard = field(default_factory=Heard)


@contextmanager
def listening(topic: str) -> Iterator[tuple[Any, _Listener]]:
    """A ROS node that hears the team while it works.

    Args:
        topic: The planner's mrs_people_msgs/People.

    Yields:
        The node, and what takes the messages.
    """
    from diagnostic_msgs.msg import DiagnosticArray
    from mrs_people_msgs.msg import People

    with node("mrs_bench") as made:
        listener = _Listener()
        made.create_subscription(People, topic, lambda m: listener.heard.on_people(m), 10)
        made.create_subscription(
            DiagnosticArray, "/diagnostics", lambda m: listener.heard.on_diagnostics(m), 10
        )
        yield made, listener


@dataclass(frozen=True)
class _Measured:
    """What a team used and sent.

    Attributes:
        before: With poses only.
        during: With images, too.
        heard: What it sent meanwhile.
        frame_hz: Frames per second and robot.
        pose_hz: Poses per second and robot.
        late_s: By how much a message missed its time at most [s].
    """

    before: _Span
    during: _Span
    heard: Heard
    frame_hz: float
    pose_hz: float
    late_s: float


def _measure(
    running: RunningTeam,
    feeder: Feeder,
    listener: _Listener,
    seconds: float,
    on_step: Callable[[str], None],
) -> _Measured:
    """Measures a team that is ready: first with poses only, then with images, too."""
    feeder.start()
    part_s = max(2.0, seconds / 4)
    on_step(f"poses only, {part_s:g} s")
    time.sleep(_SETTLE_S)
    before = _Span(running, feeder, part_s)
    hz = f"images at {feeder.frame_hz:g} Hz, poses at {feeder.pose_hz:g} Hz"
    on_step(f"{hz}, {seconds:g} s")
    feeder.frames_on.set()
    time.sleep(_SETTLE_S)
    listener.heard = heard = Heard()
    feeder.late_s = 0.0
    during = _Span(running, feeder, seconds)
    listener.heard = Heard()
    feeder.stop()
    return _Measured(before, during, heard, feeder.frame_hz, feeder.pose_hz, feeder.late_s)


def check_alive(when: str, running: RunningTeam, log: Any) -> None:
    """Raises PeopleLocError with the processes' log if one of them has ended."""
    if running.ended():
        log.seek(0)
        names = ", ".join(f"{n.label} (exit code {c})" for n, c in running.ended().items())
        raise PeopleLocError(f"ended {when}: {names}\n{log.read()}")


def _wait_until_ready(
    node: Any, topic: str, running: RunningTeam, feeder: Feeder, log: Any
) -> None:
    """Until every process listens to what it should."""
    deadline = time.monotonic() + _START_S
    robots = [n.namespace for n in running.processes if n.namespace]
    while True:
        check_alive("at the start", running, log)
        deaf = [t for t, p in feeder.publishers.items() if not p.get_subscription_count()]
        deaf += [f"/{r}/points" for r in robots if not node.count_subscribers(f"/{r}/points")]
        if not deaf and node.count_publishers(topic):
            return
        if time.monotonic() > deadline:
            what = ", ".join(deaf) or topic
            raise PeopleLocError(f"not ready after {_START_S:.0f} s: {what}")
        time.sleep(0.1)


class _Span:
    """Waits some time; what each process took in it, and what was sent.

    Attributes:
        seconds: How long it was [s].
        others_cores: Processor time that other programs took meanwhile, in cores.
        used: By process.
        frames: Frames sent, by robot.
        poses: Poses sent, by robot.
    """

    def __init__(self, running: RunningTeam, feeder: Feeder, seconds: float) -> None:
        def usage() -> dict[NodeProcess, Usage]:
            return {n: Usage.of(process.pid) for n, process in running.processes.items()}

        frames, poses = dict(feeder.frames), dict(feeder.poses)
        began, at_first = time.monotonic(), usage()
        own, busy = Usage.of(os.getpid()), _busy_ms()
        time.sleep(seconds)
        at_last, self.seconds = usage(), time.monotonic() - began
        self.used = {n: at_last[n] - at_first[n] for n in at_first}
        ours = (Usage.of(os.getpid()) - own).cpu_ms + sum(u.cpu_ms for u in self.used.values())
        self.others_cores = max(0.0, (_busy_ms() - busy - ours) / self.seconds / 1e3)
        self.frames = {r: feeder.frames[r] - n for r, n in frames.items()}
        self.poses = {r: feeder.poses[r] - n for r, n in poses.items()}


def sizes_on_the_wire(bag: Path, files: Sequence[Path]) -> dict[str, tuple[float, float]]:
    """Bytes of a message on `points` (mean) and on `pose`, serialized, by robot."""
    from rclpy.serialization import serialize_message

    from mrs_ros import convert

    points: defaultdict[str, list[int]] = defaultdict(list)
    poses: dict[str, int] = {}
    for interval in BagRun(bag, files).intervals():
        for scan in interval.scans:
            frame = f"{scan.robot}/base_link"
            points[scan.robot].append(len(serialize_message(convert.points(scan, frame))))
            pose = convert.pose_stamped(interval.people.poses[scan.robot], "map")
            poses[scan.robot] = len(serialize_message(pose))
    return {robot: (float(np.mean(sizes)), poses[robot]) for robot, sizes in points.items()}


def _figures(
    recorded: Mapping[str, Recorded],
    sizes: Mapping[str, tuple[float, float]],
    measured: _Measured,
) -> dict[str, Any]:
    heard, during = measured.heard, measured.during
    return {
        "seconds": during.seconds,
        "others_cores": during.others_cores,
        "frame_hz": measured.frame_hz,
        "pose_hz": measured.pose_hz,
        "intervals": heard.intervals,
        "sent_late_ms": measured.late_s * 1e3,
        "latency_ms": {
            which: {
                "median": float(np.median(ages)) if ages else math.nan,
                "p99": float(np.percentile(ages, 99)) if ages else math.nan,
            }
            for which, ages in heard.ages_ms.items()
        },
        "robots": {
            process.namespace: _robot_figures(
                process, measured, recorded[process.namespace], *sizes[process.namespace]
            )
            for process in during.used
            if process.namespace
        },
        "planner": next(
            (
                _planner_figures(process, measured)
                for process in during.used
                if not process.namespace
            ),
            {},
        ),
    }


def _shares(process: NodeProcess, measured: _Measured) -> dict[str, float]:
    """What a process takes of a processor [%], with images and without."""
    before, during = measured.before, measured.during
    return {
        "cpu_percent": during.used[process].cpu_ms / during.seconds / 10.0,
        "cpu_percent_poses_only": before.used[process].cpu_ms / before.seconds / 10.0,
    }


def _for_images_ms(process: NodeProcess, measured: _Measured) -> float:
    """Processor time of a process beyond what it takes with poses only [ms]."""
    before, during = measured.before, measured.during
    idle_ms = before.used[process].cpu_ms * during.seconds / before.seconds
    return during.used[process].cpu_ms - idle_ms


def _planner_figures(process: NodeProcess, measured: _Measured) -> dict[str, Any]:
    intervals = max(1, measured.heard.intervals)
    return {
        **_shares(process, measured),
        "cpu_ms_per_interval": _for_images_ms(process, measured) / intervals,
        "step_ms": _sum_of_medians(measured.heard.stages_ms["/planner_node"]),
        "page_faults_per_interval": measured.during.used[process].page_faults / intervals,
    }


def _robot_figures(
    process: NodeProcess,
    measured: _Measured,
    recorded: Recorded,
    points_bytes: float,
    pose_bytes: float,
) -> dict[str, Any]:
    before, during, heard = measured.before, measured.during, measured.heard
    robot = process.namespace
    frames = max(1, during.frames[robot])
    pipeline_ms = _sum_of_medians(heard.stages_ms[f"/{robot}/robot_node"])
    per_frame = _for_images_ms(process, measured) / frames
    return {
        "cameras": sum("camera_info" in topic for topic in recorded.types),
        **_shares(process, measured),
        "cpu_ms_per_frame": per_frame,
        "pipeline_ms": pipeline_ms,
        "around_pipeline_ms": per_frame - pipeline_ms,
        "cpu_ms_per_pose": before.used[process].cpu_ms / max(1, before.poses[robot]),
        "page_faults_per_frame": during.used[process].page_faults / frames,
        "frames": frames,
        "scans_used": heard.scans[robot],
        "points_bytes": points_bytes,
        "pose_bytes": pose_bytes,
        "points_bytes_per_s": points_bytes * measured.frame_hz,
        "pose_bytes_per_s": pose_bytes * measured.pose_hz,
        "images_bytes_per_s": recorded.image_bytes * measured.frame_hz,
    }


def _sum_of_medians(stages: Mapping[str, Sequence[float]]) -> float:
    """How long the stages of a node take, by its diagnostics; NaN if there are none."""
    of_stages = [np.median(ms) for stage, ms in stages.items() if stage != _AFTER]
    return float(sum(of_stages)) if of_stages else math.nan

"""A team on hosts: a robot with a real robot_node and camera, two that are played, a planner."""

from __future__ import annotations

import contextlib
import itertools
import json
import math
import pickle
import subprocess
import sys
import threading
import time
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from rclpy.serialization import serialize_message

from mrs_ros import convert
from mrs_tools.bags.offline import BagRun
from network.hosts import Hosts

ROOT = Path(__file__).resolve().parents[2]
#: The first one sees with a robot_node; of the others scans and poses are played.
ROBOTS = ("robot_a", "robot_b", "robot_c")
REAL, PLAYED = ROBOTS[0], ROBOTS[1:]
PLANNER = "planner"
TEAM_FILE, BAG = (
    ROOT / "config" / "team.yaml",
    ROOT / "bags" / "paper_formation",
)
#: Frames and poses per second of each robot: low, for this machine runs all hosts.
FRAME_HZ, POSE_HZ = 5.0, 20.0
#: What a condition is waited for, at most [s].
DEADLINE_S = 100.0

T = TypeVar("T")


@dataclass(frozen=True)
class Heard:
    """One `people` message.

    Attributes:
        at: When it arrived [s], monotonic.
        robots: Whose scans were used.
        age_ms: Age of the newest of them.
        seen_by: For each person the robots that saw it.
    """

    at: float
    robots: frozenset[str]
    age_ms: float
    seen_by: list[list[str]]

    @property
    def seers(self) -> set[str]:
        """Robots that saw somebody."""
        return {robot for robots in self.seen_by for robot in robots}


class TeamOnHosts:
    """A team of real nodes, each robot on its host.

    Args:
        hosts: Named as `ROBOTS` and `PLANNER`.
        folder: For logs.

    Attributes:
        heard: What the planner said.
        nodes: The process of each robot and the planner.
        env: By host, what is added to the environment of what is started there.
    """

    def __init__(self, hosts: Hosts, folder: Path) -> None:
        self.hosts = hosts
        self.heard: list[Heard] = []
        self.nodes: dict[str, subprocess.Popen[Any]] = {}
        self._folder = folder
        self.env: dict[str, dict[str, str]] = {}
        self._numbers = itertools.count()

    # ---- processes ----

    def start(self, host: str, *command: str, **how: Any) -> subprocess.Popen[Any]:
        """Starts a process on a host; its log lands in the folder."""
        log = self._folder / f"{next(self._numbers)}-{host}.log"
        env = {
            "ROS_LOG_DIR": str(self._folder / "ros"),
            "PYTHONUNBUFFERED": "1",
            **self.env.get(host, {}),
        }
        with log.open("wb") as out:
            how = {"stdout": out, "stderr": out, **how}
            return self.hosts.popen(host, command, env, **how)

    def start_robot(self) -> None:
        """Starts the real robot's node."""
        params = ["--ros-args", "-r", f"__ns:=/{REAL}", "--params-file", str(TEAM_FILE)]
        command = (sys.executable, "-m", "robot_node", *params)
        self.nodes[REAL] = self.start(REAL, *command)

    def start_camera(self) -> None:
        """Starts the real robot's camera and base."""
        self._run_script(REAL, "camera.py", BAG, TEAM_FILE, REAL, FRAME_HZ, POSE_HZ)

    def play(self, robot: str) -> None:
        """Starts a played robot."""
        file = self._folder / "scans"
        if not file.exists():
            file.write_bytes(pickle.dumps(record_scans()))
        self.nodes[robot] = self._run_script(robot, "player.py", file, robot, FRAME_HZ, POSE_HZ)

    def _run_script(self, host: str, name: str, *args: object, **how: Any) -> subprocess.Popen[Any]:
        script = Path(__file__).with_name(name)
        return self.start(host, sys.executable, str(script), *map(str, args), **how)

    def start_planner(self, *, known: bool = True) -> None:
        """Starts the planner on its host; it knows the robots, or is to discover them."""
        params = ["--ros-args", "--params-file", str(TEAM_FILE)] if known else []
        command = (sys.executable, "-m", "planner_node", *params)
        self.nodes[PLANNER] = self.start(PLANNER, *command)

    def listen(self, host: str = PLANNER) -> None:
        """Begins to hear the planner on a host."""
        process = self._run_script(host, "listener.py", stdout=subprocess.PIPE, text=True)
        threading.Thread(target=self._read, args=(process.stdout,), daemon=True).start()

    def _read(self, lines: Any) -> None:
        with lines:
            for line in lines:
                reported = json.loads(line)
                self.heard.append(
                    Heard(
                        reported["at"],
                        frozenset(reported["robots"]),
                        reported["age_ms"],
                        reported["seen_by"],
                    )
                )

    def start_all(self, *, known: bool = True) -> None:
        """Starts everything, and waits until the team works; see `start_planner`."""
        self.listen()
        self.start_planner(known=known)
        self.start_robot()
        self.start_camera()
        for robot in PLAYED:
            self.play(robot)
        self.full_rate()

    # ---- waiting ----

    def until(self, condition: Callable[[], T], what: str, deadline: float = DEADLINE_S) -> T:
        """Waits until a condition holds, and returns its value."""
        end = time.monotonic() + deadline
        while not (value := condition()):
            if time.monotonic() > end:
                raise AssertionError(f"waited {deadline:g} s in vain: {what}\n{self.report()}")
            time.sleep(0.01)
        return value

    def report(self) -> str:
        """The last things heard, and the ends of all logs."""
        lines = list(map(str, self.heard[-3:]))
        for log in sorted(self._folder.glob("*.log")):
            lines += [f"{log.name}:", *log.read_text(errors="replace").splitlines()[-8:]]
        return "\n".join(lines)

    def since(self, moment: float) -> list[Heard]:
        """What was heard from a moment on."""
        return [message for message in self.heard if message.at >= moment]

    def first(self, moment: float, wanted: Callable[[Heard], bool], what: str) -> Heard:
        """The first message from a moment on that is as wanted; waits for it."""
        found: Heard | None = self.until(
            lambda: next(filter(wanted, self.since(moment)), None), what
        )
        assert found is not None
        return found

    def back(self, robot: str, moment: float) -> float:
        """How long after a moment people that a robot sees are there [s]; waits for it."""
        heard = self.first(moment, lambda m: robot in m.seers, f"{robot} does not come back")
        return heard.at - moment

    def until_seers(self, robots: set[str], what: str) -> None:
        """Waits until these robots and no others see people, as `all_back` not in one interval."""

        def seers() -> set[str]:
            recent = self.since(time.monotonic() - 0.5)
            return {robot for heard in recent for robot in heard.seers}

        self.until(lambda: seers() == robots, what)

    def all_back(self, robots: Iterable[str], moment: float) -> float:
        """How long after a moment each of some robots has had people that it sees there [s].

        Not in one interval: cameras that run by themselves may lie so that each closes without one.
        """
        return max(self.back(robot, moment) for robot in robots)

    def full_rate(self, seconds: float = 2.0) -> None:
        """Waits for a span in which nearly every scan of every robot was used."""
        self.until(
            lambda: Span.of(self, seconds).robot_hz >= 0.8 * FRAME_HZ,
            "the full rate does not come back",
        )


@dataclass(frozen=True)
class Span:
    """What was heard in a span of time.

    Attributes:
        hz: Intervals a second.
        robot_hz: Of the robot that is in the fewest, those a second.
        full_hz: Of all robots, those a second.
        robots: Robots in an interval, on average.
        people: People in an interval, on average.
        age_ms: Age of the newest scan, median and 95 %.
        gap_s: The longest time without an interval.
    """

    hz: float
    robot_hz: float
    full_hz: float
    robots: float
    people: float
    age_ms: tuple[float, float]
    gap_s: float

    def __str__(self) -> str:
        """A line of a table."""
        median, high = self.age_ms
        return (
            f"{self.hz:4.1f} Hz, {self.full_hz:4.1f} Hz with all robots, {self.robots:.2f} robots, "
            f"{self.people:.2f} people, age {median:.0f} ms (95 %: {high:.0f} ms), "
            f"longest gap {self.gap_s:.2f} s"
        )

    @classmethod
    def of(cls, team: TeamOnHosts, seconds: float) -> Span:
        """The last seconds."""
        now = time.monotonic()
        heard = team.since(now - seconds)
        times = [now - seconds, *(m.at for m in heard), now]
        ages = [m.age_ms for m in heard] or [math.nan]
        return cls(
            hz=len(heard) / seconds,
            robot_hz=min(sum(robot in m.robots for m in heard) for robot in ROBOTS) / seconds,
            full_hz=sum(m.robots == set(ROBOTS) for m in heard) / seconds,
            robots=float(np.mean([len(m.robots) for m in heard] or [0])),
            people=float(np.mean([len(m.seen_by) for m in heard] or [0])),
            age_ms=(float(np.percentile(ages, 50)), float(np.percentile(ages, 95))),
            gap_s=float(np.max(np.diff(times))),
        )


def record_scans() -> dict[str, tuple[list[bytes], bytes]]:
    """By robot what it sends, serialized: its scans in the bag, and a pose."""
    scans: defaultdict[str, list[bytes]] = defaultdict(list)
    poses: dict[str, bytes] = {}
    for interval in BagRun(BAG, [TEAM_FILE]).intervals():
        for scan in interval.scans:
            message = convert.points(scan, f"{scan.robot}/base_link")
            scans[scan.robot].append(serialize_message(message))
        for robot, pose in interval.people.poses.items():
            poses[robot] = serialize_message(convert.pose_stamped(pose, "map"))
    return {robot: (scans[robot], poses[robot]) for robot in ROBOTS}


@contextlib.contextmanager
def team_on_hosts(folder: Path) -> Iterator[TeamOnHosts]:
    """Three hosts for robots and one for the planner, with nothing on them yet."""
    with Hosts(*ROBOTS, PLANNER) as hosts:
        yield TeamOnHosts(hosts, folder)

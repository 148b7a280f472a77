"""Nodes of a team that are killed at random, and how the others fare."""

from __future__ import annotations

import os
import random
import signal
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from mrs_people_msgs.msg import People
from rclpy.qos import qos_profile_sensor_data
from sensor_msgs.msg import PointCloud2

from mrs_ros.network import environment
from mrs_ros.processes import NodeProcess, team_processes
from mrs_tools.tool_node import node as rclpy_node
from mrs_tools.tool_node import working
from ros.harness import exit_code

#: Who is not back after so long is lost [s]; and so long others are watched after a kill [s].
LOST_S, WATCHED_S = 30.0, 2.5
DRIVER = Path(__file__).with_name("driver.py")


@dataclass(frozen=True)
class Kill:
    """One kill.

    Attributes:
        victim: Who was killed.
        back_s: From the new start to its first scan or, of the planner, to the first people with
            all robots [s]; None: it is lost.
        held_s: By other robot, the longest time without a scan of it, from the kill on [s].
    """

    victim: str
    back_s: float | None
    held_s: Mapping[str, float]


@dataclass
class Kills:
    """What came of all kills.

    Attributes:
        kills: One after another.
        load: How many processes wanted to run, at each of them: the machine may be busy.
        mapped: By process, files of Fast DDS in shared memory that it had mapped before the kills.
    """

    kills: list[Kill] = field(default_factory=list)
    load: list[float] = field(default_factory=list)
    mapped: dict[str, set[str]] = field(default_factory=dict)

    @property
    def held_s(self) -> list[float]:
        """How long each robot that was not killed gave nothing, of each kill."""
        return [seconds for kill in self.kills for seconds in kill.held_s.values()]

    @property
    def lost(self) -> list[Kill]:
        """Those after which the victim did not come back."""
        return [kill for kill in self.kills if kill.back_s is None]

    def table(self) -> str:
        """For people."""
        lines = [
            f"{len(self.kills)} kills, {len(self.lost)} after which the victim was not back; load "
            f"of the machine: median {np.median(self.load):.1f}, at most {max(self.load):.1f}"
        ]
        for who in sorted({kill.victim for kill in self.kills}):
            back = [k.back_s for k in self.kills if k.victim == who and k.back_s is not None]
            lines.append(f"  {who} was back after {_spread(back)}, of {len(back)}")
        lines.append(f"  the others' longest time without a scan: {_spread(self.held_s)}")
        for bound in (0.5, 1.0, 2.0):
            over = sum(seconds > bound for seconds in self.held_s)
            lines.append(f"    over {bound:g} s: {over} of {len(self.held_s)}")
        return "\n".join(lines)


def _spread(seconds: Sequence[float]) -> str:
    if not seconds:
        return "never"
    values = [f"{share} % {np.percentile(seconds, share):.2f} s" for share in (50, 90, 99)]
    return f"{', '.join(values)}, at most {max(seconds):.2f} s"


class Watched:
    """Hears the scans of every robot, and who is in the people."""

    def __init__(self, node: Any, robots: Sequence[str]) -> None:
        self.node, self.robots = node, robots
        #: By robot, when its scans came [s, monotonic].
        self.scans: dict[str, list[float]] = {robot: [] for robot in robots}
        #: When people came, and whose scans they were made of.
        self.people: list[tuple[float, set[str]]] = []
        for robot in robots:
            node.create_subscription(
                PointCloud2, f"/{robot}/points", self._hearer(robot), qos_profile_sensor_data
            )
        node.create_subscription(People, "tracked_people", self._on_people, 100)

    def _hearer(self, robot: str) -> Any:
        return lambda _: self.scans[robot].append(time.monotonic())

    def _on_people(self, message: Any) -> None:
        self.people.append((time.monotonic(), {scan.robot for scan in message.scans}))

    def is_back(self, victim: str, since: float) -> bool:
        """Whether a robot has sent scans since then, or the planner people with all robots."""
        if victim in self.scans:
            return bool(self.scans[victim]) and self.scans[victim][-1] > since
        return any(when > since and who >= set(self.robots) for when, who in self.people[-50:])

    def held_s(self, robot: str, since: float) -> float:
        """The longest time without a scan of a robot, from then until now."""
        came = [when for when in self.scans[robot] if when > since]
        return float(np.diff([since, *came, time.monotonic()]).max())


@contextmanager
def driver(
    bag: Path, team: Path, log: Path, *, hz: float, times: int = 1, robots: Sequence[str] = ()
) -> Iterator[subprocess.Popen[bytes]]:
    """Runs the process that sends the images."""
    command = [sys.executable, str(DRIVER), str(bag), str(team), str(hz), "20", str(times), *robots]
    with log.open("w") as out:
        process = subprocess.Popen(command, env=environment(), stdout=out, stderr=out)
    try:
        yield process
        assert process.poll() is None, log.read_text()
    finally:
        process.terminate()
        exit_code(process, "driver", log)


@contextmanager
def watching(robots: Sequence[str]) -> Iterator[Watched]:
    """A node that watches, in a thread of its own."""
    with rclpy_node("watches") as made:
        watched = Watched(made, robots)
        with working(made):
            yield watched


class Victims:
    """The processes of a team, each of which may be killed; use it as a context manager."""

    def __init__(self, nodes: Sequence[NodeProcess], log: Path, env: Mapping[str, str]) -> None:
        self.nodes = {node.label: node for node in nodes}
        self._log = log.open("w")
        self._env = {**environment(), **env}
        self.processes = {label: self._started(label) for label in self.nodes}

    def _started(self, label: str) -> subprocess.Popen[bytes]:
        command = self.nodes[label].command()
        return subprocess.Popen(command, env=self._env, stdout=self._log, stderr=self._log)

    def kill(self, label: str) -> None:
        self.processes[label].send_signal(signal.SIGKILL)
        self.processes[label].wait()

    def start(self, label: str) -> None:
        self.processes[label] = self._started(label)

    def __enter__(self) -> Victims:
        return self

    def __exit__(self, *_: object) -> None:
        for process in self.processes.values():
            process.send_signal(signal.SIGINT)
        for label, process in self.processes.items():
            exit_code(process, label, Path(self._log.name))
        self._log.close()


def kill_at_random(
    bag: Path,
    files: Sequence[Path],
    folder: Path,
    *,
    count: int,
    seed: int,
    env: Mapping[str, str] | None = None,
) -> Kills:
    """Kills and starts nodes again, one after another; the environment says on which domain.

    Args:
        bag: What the robots see.
        files: Parameter files of the team; the last names its robots.
        folder: For logs.
        count: How many kills; fewer if somebody is lost.
        seed: Of the choice of who is killed, and when.
        env: Added to the environment of the nodes, not of the driver.
    """
    chance, result = random.Random(seed), Kills()
    nodes = team_processes(files)
    robots = [node.namespace for node in nodes if node.namespace]
    with (
        driver(bag, files[-1], folder / "driver.log", hz=5.0) as sender,
        watching(robots) as watched,
        Victims(nodes, folder / "nodes.log", env or {}) as victims,
    ):
        started = time.monotonic()
        while not watched.is_back("planner", started):
            assert time.monotonic() - started < 120.0, (folder / "nodes.log").read_text()
            time.sleep(0.1)
        result.mapped = {"driver": maps_of(sender)}
        result.mapped |= {label: maps_of(one) for label, one in victims.processes.items()}
        for _ in range(count):
            time.sleep(chance.uniform(0.2, 1.5))
            victim = chance.choice(sorted(victims.nodes))
            killed = time.monotonic()
            victims.kill(victim)
            victims.start(victim)
            back = None
            while back is None and time.monotonic() - killed < LOST_S:
                time.sleep(0.02)
                if watched.is_back(victim, killed + 0.05):
                    back = time.monotonic() - killed
            time.sleep(max(0.0, killed + WATCHED_S - time.monotonic()))
            others = [robot for robot in robots if robot != victim]
            held_s = {robot: watched.held_s(robot, killed) for robot in others}
            result.kills.append(Kill(victim, back, held_s))
            result.load.append(os.getloadavg()[0])
            if result.lost:
                break
    return result


def maps_of(process: subprocess.Popen[bytes]) -> set[str]:
    """Files of Fast DDS in shared memory that a process has mapped."""
    lines = Path("/proc", str(process.pid), "maps").read_text().splitlines()
    return {line.split()[-1] for line in lines if "/dev/shm/fastrtps" in line}

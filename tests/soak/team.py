"""A team under load, and what its processes take meanwhile."""

from __future__ import annotations

import os
import resource
import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from diagnostic_msgs.msg import DiagnosticArray
from mrs_people_msgs.msg import People

from mrs_people_loc.messages import stamp_ns_of
from mrs_ros.processes import NodeProcess, RunningTeam
from mrs_studies.bench.live import Feeder, Recorded, Usage
from mrs_tools.tool_node import node as rclpy_node
from mrs_tools.tool_node import working

#: Processes get this long to start and to find each other [s].
START_S = 120.0
#: Memory is looked at this often, and what is under way may take so long to arrive [s].
_EVERY_S, _ARRIVE_S = 1.0, 3.0
_PAGE_KB = resource.getpagesize() // 1024


class Interval(NamedTuple):
    """What came of one interval: robots and stamps [ns] of its scans, and ages at the arrival."""

    scans: list[tuple[str, int]]
    people: int
    oldest_ms: float
    newest_ms: float

    @property
    def begin_ns(self) -> int:
        return min(stamp for _, stamp in self.scans)


@dataclass
class Load:
    """What was sent to a team, what it said, and what it took.

    Attributes:
        seconds: How long it lasted [s].
        sent: Frames or scans sent: robot and stamp [ns].
        intervals: What was made of them.
        memory_kb: Resident memory of each process, each second.
        cores: What each process took of the processor, and this one to send and to hear.
        late_s: By how much the latest message was sent after its time [s].
        dropped: By robot and reason, scans that the planner says it dropped, warm-up included.
    """

    seconds: float = 0.0
    sent: list[tuple[str, int]] = field(default_factory=list)
    intervals: list[Interval] = field(default_factory=list)
    memory_kb: dict[str, list[int]] = field(default_factory=dict)
    cores: dict[str, float] = field(default_factory=dict)
    late_s: float = 0.0
    dropped: dict[str, dict[str, int]] = field(default_factory=dict)

    def on_frame(self, robot: str, stamp_ns: int) -> None:
        self.sent.append((robot, stamp_ns))

    def on_people(self, message: Any) -> None:
        now_ns = time.time_ns()
        scans = [(scan.robot, stamp_ns_of(scan.stamp)) for scan in message.scans]
        ages_ms = [(now_ns - stamp_ns) / 1e6 for _, stamp_ns in scans]
        self.intervals.append(Interval(scans, len(message.persons), max(ages_ms), min(ages_ms)))

    def on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            node, _, robot = status.name.partition(": robot ")
            if robot and node == "/planner_node":
                self.dropped[robot] = {
                    entry.key.removeprefix("dropped."): int(entry.value)
                    for entry in status.values
                    if entry.key.startswith("dropped.")
                }

    def cut(self, begin_ns: int) -> None:
        """Forgets what was sent before a time, and the last interval, which ended by itself."""
        kept = [interval for interval in self.intervals if interval.begin_ns >= begin_ns]
        assert len(kept) > 1, "no people"
        first_ns, last_ns = kept[0].begin_ns, kept[-1].begin_ns
        self.intervals = kept[:-1]
        self.sent = [frame for frame in self.sent if first_ns <= frame[1] < last_ns]

    # ---- what is held ----

    @property
    def robots(self) -> set[str]:
        return {robot for robot, _ in self.sent}

    @property
    def lost(self) -> set[tuple[str, int]]:
        """What was sent and went into no people."""
        return set(self.sent).difference(*(interval.scans for interval in self.intervals))

    @property
    def partial(self) -> int:
        """Intervals that lack a robot."""
        everybody = len(self.robots)
        return sum(len(interval.scans) < everybody for interval in self.intervals)

    def growth_kb(self, process: str) -> float:
        """Resident memory: mean of the last third, less that of the first."""
        first, last = _thirds(self.memory_kb[process])
        return float(np.mean(last) - np.mean(first))

    def course(self, process: str) -> str:
        """The same, and means of the six sixths, for people."""
        sixths = np.array_split(self.memory_kb[process], 6)
        means = " ".join(f"{np.mean(kb) / 1024:.2f}" for kb in sixths)
        return f"last third less first {self.growth_kb(process):+5.0f} kB: {means} MB"

    def ages_ms(self, which: str) -> list[float]:
        """How old the oldest or the newest scan of an interval was when its people arrived."""
        return [getattr(interval, f"{which}_ms") for interval in self.intervals]

    def latency_ms(self, which: str) -> tuple[float, float]:
        """Medians of the first third and of the last."""
        first, last = _thirds(self.ages_ms(which))
        return float(np.median(first)), float(np.median(last))

    def table(self, title: str) -> str:
        """For people."""
        lines = [
            title,
            f"  {self.seconds:.0f} s; sent {len(self.sent)} by {len(self.robots)} robots, lost "
            f"{len(self.lost)}; the latest was sent {self.late_s * 1e3:.0f} ms late",
            f"  intervals: {len(self.intervals)}, of these {self.partial} without a robot or more; "
            f"people found: median {np.median([i.people for i in self.intervals]):g}",
        ]
        for which in ("oldest", "newest"):
            ages = self.ages_ms(which)
            first, last = self.latency_ms(which)
            lines.append(
                f"  age of the {which} scan when its people arrive: median {first:.1f} ms in the "
                f"first third, {last:.1f} ms in the last; p99 {np.percentile(ages, 99):.1f} ms"
            )
        for name, cores in self.cores.items():
            line = f"  {name:<10}{cores:6.2f} cores"
            if name in self.memory_kb:
                line += f", {self.course(name)}"
            lines.append(line)
        reasons: Counter[str] = Counter()
        for of_robot in self.dropped.values():
            reasons.update(of_robot)
        if reasons:
            reported = ", ".join(f"{count} {reason}" for reason, count in reasons.items())
            lines.append(f"  dropped, as the planner says, from its start on: {reported}")
        return "\n".join([*lines, f"  {'all':<10}{sum(self.cores.values()):6.2f} cores"])


def _thirds(values: Sequence[Any]) -> tuple[Sequence[Any], Sequence[Any]]:
    third = len(values) // 3
    assert third, f"{len(values)} values are too few to compare"
    return values[:third], values[-third:]


def run(
    processes: Sequence[NodeProcess],
    recorded: Mapping[str, Recorded],
    log: Path,
    *,
    hz: float,
    pose_hz: float,
    seconds: float,
    warm_up_s: float,
) -> Load:
    """Feeds a team for some time; the environment says on which domain.

    Args:
        processes: What to start.
        recorded: What to send, by robot.
        log: Takes what they print.
        hz: Frames or scans a second and robot.
        pose_hz: Poses a second and robot.
        seconds: How long it is measured [s].
        warm_up_s: After so long [s].
    """
    load = Load()
    with (
        rclpy_node("soak") as node,
        working(node),
        log.open("w+") as out,
        RunningTeam(processes, log=out) as running,
    ):
        node.create_subscription(People, "tracked_people", load.on_people, 100)
        node.create_subscription(DiagnosticArray, "/diagnostics", load.on_diagnostics, 100)
        feeder = Feeder(node, recorded, hz, pose_hz, load.on_frame)
        _until_all_listen(node, feeder, running, log)
        feeder.frames_on.set()
        feeder.start()
        time.sleep(warm_up_s)
        begin_ns, feeder.late_s = time.time_ns(), 0.0
        pids = {node.label: process.pid for node, process in running.processes.items()}
        load.memory_kb = {name: [] for name in pids}
        measured = {**pids, "this test": os.getpid()}
        before, began = {n: Usage.of(pid) for n, pid in measured.items()}, time.monotonic()
        while time.monotonic() - began < seconds and not running.ended():
            time.sleep(_EVERY_S)
            for name, pid in pids.items():
                load.memory_kb[name].append(resident_kb(pid))
        assert not running.ended(), f"{running.ended()}\n{log.read_text()}"
        load.seconds, load.late_s = time.monotonic() - began, feeder.late_s
        load.cores = {
            name: (Usage.of(pid) - before[name]).cpu_ms / 1e3 / load.seconds
            for name, pid in measured.items()
        }
        feeder.frames_on.clear()
        time.sleep(_ARRIVE_S)
        feeder.stop()
    load.cut(begin_ns)
    return load


def _until_all_listen(node: Any, feeder: Feeder, running: RunningTeam, log: Path) -> None:
    end = time.monotonic() + START_S
    while True:
        deaf = [t for t, p in feeder.publishers.items() if not p.get_subscription_count()]
        scans = [f"/{process.namespace}/points" for process in running.processes]
        deaf += [t for t in scans if t != "//points" and not node.count_subscribers(t)]
        if not deaf and node.count_publishers("tracked_people"):
            return
        assert not running.ended(), f"{running.ended()}\n{log.read_text()}"
        assert time.monotonic() < end, f"nobody listens to {deaf}\n{log.read_text()}"
        time.sleep(0.1)


def resident_kb(pid: int) -> int:
    """Resident memory of a process [kB]."""
    pages = int(Path("/proc", str(pid), "statm").read_text(encoding="ascii").split()[1])
    return pages * _PAGE_KB

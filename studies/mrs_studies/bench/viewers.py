"""What viewers of the page cost a team: a real planner and a real `mrs view` over DDS.

Four robots' scans of ten people (`scenes`) are sent at 30 Hz, first without `mrs view`, then with
it and as many viewers as asked for, who take every state.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np

from mrs_people_loc import timing
from mrs_people_loc.config import PLANNER_NODE, load_team
from mrs_people_loc.errors import PeopleLocError
from mrs_people_sim.domain import refuse_other_publishers
from mrs_ros import convert
from mrs_ros.processes import NodeProcess, RunningTeam
from mrs_studies.bench.live import Feeder, Heard, Recorded, Usage, check_alive, listening
from mrs_studies.bench.scenes import PEOPLE, ROBOTS, drawn_scans
from mrs_tools.tool_node import wait_for_discovery, working

#: Viewers, one measurement each; 0: no `mrs view` runs.
COUNTS = (0, 1, 10)
RATE_HZ = 30.0
#: Scans of each robot, sent in turn, which differ in their noise.
_SCANS = 10
#: Processes, and viewers, get this long to start [s], and are not measured for this long after it.
_START_S, _SETTLE_S = 30.0, 3.0
_ENCODED = 200


def measure_viewers(
    config: Path,
    seconds: float,
    counts: Sequence[int] = COUNTS,
    on_step: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Measures a planner with and without viewers.

    Args:
        config: Parameter file of the planner; bodies are sought by its robots.
        seconds: How long each measurement takes [s].
        counts: Viewers of each.
        on_step: Told what is done now.

    Raises:
        PeopleLocError: The processes do not work.
    """
    team = load_team(config, robots=tuple(ROBOTS))
    topic = f"/{team.planner.people_topic}"
    planner = NodeProcess(PLANNER_NODE, "", (str(config.resolve()),), sim_time=False)
    with listening(topic) as (node, listener):
        feeder = Feeder(node, _recorded(team), RATE_HZ, RATE_HZ)
        wait_for_discovery(node)
        own = dict.fromkeys(feeder.publishers, node.get_fully_qualified_name())
        refuse_other_publishers(node, {topic: "", **own})
        with (
            tempfile.TemporaryFile("w+") as log,
            RunningTeam([planner], log=log) as running,
            working(node),
        ):
            feeder.frames_on.set()
            feeder.start()
            rows = []
            try:
                for count in counts:
                    on_step(f"{count} viewers, {seconds:g} s")
                    with _viewing(count) as (server, viewers):
                        _wait_for_people(listener)
                        time.sleep(_SETTLE_S)
                        pids = [running.processes[planner].pid, *([server.pid] if server else [])]
                        rows.append(_measure(pids, viewers, listener, seconds))
                    check_alive("while viewers were measured", running, log)
            finally:
                feeder.stop()
    last = viewers[-1].last if viewers else ""
    return {
        "configuration": config.name,
        "robots": len(ROBOTS),
        "people": len(PEOPLE),
        "seconds": seconds,
        "rate_hz": RATE_HZ,
        "rows": rows,
        **_encoding(last),
    }


def _recorded(team: Any) -> dict[str, Recorded]:
    """What the robots send: their scans as bytes, and a pose."""
    from rclpy.serialization import serialize_message

    config = next(iter(team.robots.values()))
    scenes = [drawn_scans(config, seed) for seed in range(_SCANS)]
    recorded = {}
    for index, robot in enumerate(ROBOTS):
        points, pose = f"/{robot}/points", f"/{robot}/pose"
        scans = [convert.points(scans[index], f"{robot}/base_link") for scans, _ in scenes]
        stamped = convert.pose_stamped(scenes[0][1][robot], "map")
        recorded[robot] = Recorded(
            types={
                points: "sensor_msgs/msg/PointCloud2",
                pose: "geometry_msgs/msg/PoseWithCovarianceStamped",
            },
            frames=[{points: serialize_message(scan)} for scan in scans],
            pose=(pose, serialize_message(stamped)),
            offset_s=0.002 * index,
            image_bytes=0.0,
        )
    return recorded


class _Viewer(threading.Thread):
    """Some viewers in one thread.

    Attributes:
        count: How many they are.
        states: How many states they were sent, together.
        size: How many bytes, together.
        last: The last state.
    """

    def __init__(self, url: str, count: int) -> None:
        super().__init__(name="viewers", daemon=True)
        self.states = self.size = 0
        self.last = ""
        self._url, self.count = url, count
        self._end = threading.Event()
        self.start()

    def run(self) -> None:
        """Takes what comes."""
        asyncio.run(self._look())

    def stop(self) -> None:
        """Ends it."""
        self._end.set()
        self.join()

    async def _look(self) -> None:
        import aiohttp

        async with aiohttp.ClientSession() as session:
            tasks = [asyncio.create_task(self._take(session)) for _ in range(self.count)]
            while not self._end.is_set():
                await asyncio.sleep(0.1)
            for task in tasks:
                task.cancel()
            await asyncio.gather(*tasks, return_exceptions=True)

    async def _take(self, session: Any) -> None:
        async with session.ws_connect(f"{self._url}live", max_msg_size=0) as socket:
            async for message in socket:
                if message.data.startswith('{"type":"state"'):
                    self.states += 1
                    self.size += len(message.data)
                    self.last = message.data


@contextmanager
def _viewing(count: int) -> Iterator[tuple[subprocess.Popen[str] | None, list[_Viewer]]]:
    """`mrs view` and its viewers; nothing for none."""
    if not count:
        yield None, []
        return
    command = [sys.executable, "-m", "mrs_tools", "view", "--port", "0", "--rate", f"{RATE_HZ:g}"]
    # Wide enough for the address to stay on its line.
    env = {**os.environ, "COLUMNS": "200", "PYTHONUNBUFFERED": "1"}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=env) as server:
        viewer = None
        try:
            assert server.stdout is not None
            found = re.search(r"http://\S+", server.stdout.readline())
            if found is None:
                raise PeopleLocError("mrs view did not start")
            viewer = _Viewer(found.group(), count)
            yield server, [viewer]
        finally:
            if viewer is not None:
                viewer.stop()
            server.terminate()


def _wait_for_people(listener: Any) -> None:
    before, end = listener.heard.intervals, time.monotonic() + _START_S
    while listener.heard.intervals == before:
        if time.monotonic() > end:
            raise PeopleLocError(f"the planner sends no people within {_START_S:g} s")
        time.sleep(0.05)


def _measure(
    pids: Sequence[int], viewers: Sequence[_Viewer], listener: Any, seconds: float
) -> dict[str, Any]:
    """Processor time and latency, for a while; the first process is the planner."""

    def counted() -> tuple[int, int]:
        return sum(one.states for one in viewers), sum(one.size for one in viewers)

    listener.heard = heard = Heard()
    used, (states, size), began = [Usage.of(pid) for pid in pids], counted(), time.monotonic()
    time.sleep(seconds)
    took_s = time.monotonic() - began
    shares = [
        (Usage.of(pid) - at_first).cpu_ms / took_s / 10.0
        for pid, at_first in zip(pids, used, strict=True)
    ]
    now_states, now_size = counted()
    listener.heard = Heard()
    ages, count = heard.ages_ms["newest"], sum(one.count for one in viewers)
    steps = heard.stages_ms[f"/{PLANNER_NODE}"].values()
    return {
        "viewers": count,
        "planner_cpu_percent": shares[0],
        "planner_step_ms": float(sum(np.median(ms) for ms in steps)) if steps else None,
        "age_ms": {
            "median": float(np.median(ages)) if ages else None,
            "p99": float(np.percentile(ages, 99)) if ages else None,
        },
        "intervals_per_s": heard.intervals / took_s,
        "view_cpu_percent": shares[1] if count else None,
        "states_per_s": (now_states - states) / took_s / count if count else None,
        "bytes_per_s": (now_size - size) / took_s / count if count else None,
    }


def _encoding(text: str) -> dict[str, Any]:
    """What a state's JSON takes [ms], and its size; the state is one that a viewer got."""
    from mrs_tools.view.protocol import encode

    if not text:
        return {"state_bytes": None, "encode_ms": None}
    state, times = json.loads(text), []
    for _ in range(_ENCODED):
        began = timing.now_ns()
        encode(state)
        times.append((timing.now_ns() - began) / 1e6)
    return {"state_bytes": len(text), "encode_ms": float(np.median(times))}

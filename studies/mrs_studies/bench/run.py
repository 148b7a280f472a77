"""The benchmark: compares results with the oracle, then times them.

    report = run_bench(bag, configs=[paper, default])
    report["targets"]                       # each figure that has a target, and whether it is met

Nine parts: one robot's view, stage by stage (`robot`); one interval of the planner (`planner`);
what it costs as the team grows (`growth`); following people (`tracking`); where the robots are
(`walls`, `localization`); guiding people (`guiding`); real processes over DDS (`live`), and a
planner with viewers of the page (`viewers`).
Nothing of the people's stages is timed that differs from the repository's oracle:
`tests/oracle/comparison` says what is compared, and how closely.

How it is timed: on one core (OpenCV's threads are off), stages as the pipeline times them itself,
but by the processor time that they take, so that other work on the machine does not count. It does
slow things down, though: configurations take turns every few views, so that it slows them alike.
Compare within one run. In the live part time is what passes.
"""

from __future__ import annotations

import math
import os
import platform
import tempfile
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import yaml

from mrs_people_loc import timing
from mrs_people_loc.config import ROBOT_NODE, PlannerConfig, RobotConfig
from mrs_people_loc.errors import BagError, PeopleLocError
from mrs_people_loc.planner import Planner
from mrs_people_sim.common import one_thread
from mrs_people_sim.domain import private_domain
from mrs_studies.bench.growth import LARGEST, time_growth
from mrs_studies.bench.guiding import time_guiding
from mrs_studies.bench.localization import time_localization
from mrs_studies.bench.oracle import Oracle, find
from mrs_studies.bench.planner import time_planner
from mrs_studies.bench.robot import heads_of, time_robot
from mrs_studies.bench.targets import targets
from mrs_studies.bench.tracking import time_tracking
from mrs_studies.bench.walls import time_walls
from mrs_tools.bags.offline import BagRun, Interval
from mrs_tools.bags.reader import BagReader
from mrs_tools.bags.sources import RobotView, robots_of

#: Of the intervals of the bag, each one of so many is compared with the oracle.
_CHECKED = 5


class BenchError(PeopleLocError):
    """The benchmark cannot be run."""


def run_bench(
    bag: Path,
    configs: Sequence[Path],
    *,
    frames: int = 600,
    robots: int = LARGEST,
    live_files: Sequence[Path] | None = None,
    seconds: float = 10.0,
    on_step: Callable[[str], None] = lambda _: None,
    on_domain: Callable[[str], None] = lambda _: None,
) -> dict[str, Any]:
    """Compares results with the oracle, then times them.

    Args:
        bag: A bag with images and odometry of at least one robot.
        configs: Parameter files to compare; targets are for the first one of each method.
        frames: Views, and intervals, to time for each configuration.
        robots: The largest team to time the planner with.
        live_files: Parameter files of the team whose processes are started; None: no live part.
        seconds: How long the live part measures [s].
        on_step: Told what is done now.
        on_domain: Told which ROS domain the live part is in.

    Returns:
        The report, as `mrs bench --json` writes it.

    Raises:
        DiffersError: A result differs from the oracle; nothing is timed then.
        PeopleLocError: The bag or a file cannot be used.
    """
    named = {path.name: path for path in configs}
    if len(named) < len(configs):
        names = ", ".join(path.name for path in configs)
        raise BenchError(f"two configurations have one name: {names}")
    oracle = find()
    with one_thread(), timing.processor_time():
        runs = _read(bag, configs, on_step)
        checked = _compare(oracle, runs, on_step)
        on_step(f"timing {frames} views of each head")
        heads = {name: heads_of(_views(run), run.robots) for name, run in runs.items()}
        robot = time_robot(heads, frames)
        on_step("drawing 4 robots and 10 people")
        planner = time_planner(named, frames, oracle, on_step)
        growth = time_growth(named, robots, oracle, on_step=on_step)
        tracking = time_tracking(frames, oracle, on_step)
        on_step("finding walls")
        walls = time_walls(frames)
        localization = time_localization(on_step)
        guiding = time_guiding(on_step)
    live, viewers = None, None
    if live_files:
        live, viewers = _live(bag, live_files, configs, seconds, on_step, on_domain)
    report = {
        "machine": machine(),
        "bag": str(bag),
        "equal_to_reference": checked,
        "robot": robot,
        "planner": planner,
        "growth": growth,
        "tracking": tracking,
        "walls": walls,
        "localization": localization,
        "guiding": guiding,
        "live": live,
        "viewers": viewers,
    }
    return {**report, "targets": [target.report() for target in targets(report)]}


def _live(
    bag: Path,
    files: Sequence[Path],
    configs: Sequence[Path],
    seconds: float,
    on_step: Callable[[str], None],
    on_domain: Callable[[str], None],
) -> tuple[dict[str, Any], dict[str, Any] | None]:
    """Measures real processes, in a ROS domain of their own: a team, and a planner with viewers.

    Viewers are of the last configuration; without aiohttp there are none.
    """
    from mrs_studies.bench.live import measure_live

    with private_domain() as where:
        on_domain(where)
        live = measure_live(bag, files, seconds, on_step)
        viewers = None
        if find_spec("aiohttp") is not None:
            from mrs_studies.bench.viewers import measure_viewers

            viewers = measure_viewers(configs[-1], seconds, on_step=on_step)
    return {"configuration": " + ".join(path.name for path in files), **live}, viewers


def machine() -> dict[str, Any]:
    """What the figures were measured on."""
    cpus = [
        line.partition(":")[2].strip()
        for line in _lines(Path("/proc/cpuinfo"))
        if line.startswith("model name")
    ]
    return {
        "processor": cpus[0] if cpus else platform.machine(),
        "cores": os.cpu_count(),
        "load_average": os.getloadavg()[0],
        "python": platform.python_version(),
        "numpy": np.__version__,
        "opencv": cv2.__version__,
    }


def _lines(path: Path) -> list[str]:
    try:
        return path.read_text(encoding="utf-8").splitlines()
    except OSError:
        return []


def _top_cameras(bag: Path, folder: Path) -> list[Path]:
    """A parameter file that turns on the top cameras that a bag has, in any configuration."""
    with BagReader(bag) as reader:
        robots = robots_of(reader).values()
    have = [robot.name for robot in robots if any("top" in c for c in robot.images.values())]
    sections = {
        f"/{name}/{ROBOT_NODE}": {"ros__parameters": {"images": {"top": True}}} for name in have
    }
    file = folder / "top_cameras.yaml"
    file.write_text(yaml.safe_dump(sections), encoding="utf-8")
    return [file] if have else []


@dataclass(frozen=True)
class _Run:
    """A bag with one configuration."""

    intervals: Sequence[Interval]
    robots: Mapping[str, RobotConfig]
    planner: PlannerConfig


def _views(run: _Run) -> list[RobotView]:
    return [view for interval in run.intervals for view in interval.views.values()]


def _read(bag: Path, configs: Sequence[Path], on_step: Callable[[str], None]) -> dict[str, _Run]:
    """Runs a bag with each configuration, by name."""
    runs = {}
    with tempfile.TemporaryDirectory() as folder:
        top = _top_cameras(bag, Path(folder))
        for path in configs:
            on_step(f"running {path.name}")
            # The oracle has no memory.
            run = BagRun(bag, [path, *top], planner=lambda c: Planner(c.memoryless()))
            team = run.team
            runs[path.name] = _Run(list(run.intervals()), team.robots, team.planner)
            if not _views(runs[path.name]):
                raise BagError(f"{bag}: no interval has images that can be used")
    return runs


def _compare(
    oracle: Oracle, runs: Mapping[str, _Run], on_step: Callable[[str], None]
) -> dict[str, int]:
    """Compares some intervals and their views with the oracle; how many of what these were."""
    checked = dict.fromkeys(("views", "cells", "intervals", "clusters", "people"), 0)
    for name, run in runs.items():
        on_step(f"comparing {name} with the oracle")
        for interval in run.intervals[::_CHECKED]:
            for robot, view in interval.views.items():
                oracle.check_view(view.images, view.stages, view.camera, run.robots[robot])
                checked["views"] += 1
                checked["cells"] += len(view.stages.scan.cells)
            oracle.check_people(interval.scans, interval.people, run.planner)
            checked["intervals"] += 1
            checked["clusters"] += len(interval.people.clusters)
            checked["people"] += len(interval.people.persons)
    return checked


def finite(value: Any) -> Any:
    """A report for JSON: what is undefined becomes null."""
    if isinstance(value, Mapping):
        return {key: finite(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value

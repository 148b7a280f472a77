"""`mrs bench`: is it fast enough? Proves that the results are right, then times them.

    report = run_bench(bag, configs=[paper, default])
    report["targets"]                       # each figure that has a target, and whether it is met

Four parts: one robot's view, stage by stage; one interval of the planner; what it costs as the team
grows (`bench_growth`); and real processes over DDS (`bench_live`). Nothing is timed that differs
from the plain loops in `bench_reference` (the paper's method, bit for bit) and `bench_bodies` (what
can be said simply of the default one).

How it is timed: on one core (OpenCV's threads are off), stages as the pipeline times them itself,
but by the processor time that they take, so that other work on the machine does not count. It does
slow things down, though: configurations take turns every few views, so that it slows them alike.
Compare within one run. In the live part time is what passes.
"""

from __future__ import annotations

import json
import math
import os
import platform
import tempfile
from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import typer
import yaml
from rich import box
from rich.console import Console
from rich.table import Table
from rich.text import Text

from mrs_people_loc import timing
from mrs_people_loc.config import ROBOT_NODE, RobotConfig, load_team
from mrs_people_loc.errors import BagError, PeopleLocError
from mrs_people_loc.planner import Planner
from mrs_people_loc.robot import RobotPipeline
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.disparity import make_stereo_bm
from mrs_people_loc.sensing.images import StereoImages
from mrs_ros.network import given_domain
from mrs_tools.bags.offline import BagRun
from mrs_tools.bags.rosbag import BagReader
from mrs_tools.bags.sources import RobotView as View
from mrs_tools.bags.sources import robots_of
from mrs_tools.bench import reference as bench_reference
from mrs_tools.bench.growth import LARGEST, growth_of, time_growth
from mrs_tools.bench.scenes import INTERVAL_NS, PEOPLE, ROBOTS, drawn_scans
from mrs_tools.bench.tracking import time_tracking
from mrs_tools.domain import private_domain
from mrs_tools.installing import default_file

#: Of the intervals of the bag, each one of so many is compared with the reference.
_CHECKED = 5
#: Configurations take turns after so many views or intervals, and the first ones do not count.
_BLOCK, _WARM_UP = 25, 3
#: More of the machine than this is too busy for the live part.
_BUSY = 0.15
#: A head's two cameras of three.
_PAIR_OF_THREE = "pair of three"
#: What the tracker may take, by number of people [ms].
_TRACKER_MS = {10: 0.5, 200: 10.0}
#: Intervals of the drawn scene, each with noise of its own.
_DRAWN = 10


class BenchError(PeopleLocError):
    """The benchmark cannot be run."""


# ---------------------------------------------------------------------------------------- figures


@dataclass(frozen=True)
class Target:
    """A figure that has a target.

    Attributes:
        name: What it is.
        configuration: What it was measured with.
        value: The figure.
        limit: The target.
        unit: Of both.
        at_least: Whether the figure should be over the target, not under it.
    """

    name: str
    configuration: str
    value: float
    limit: float
    unit: str
    at_least: bool = False

    @property
    def reached(self) -> bool:
        """Whether the figure is on the right side."""
        return self.value >= self.limit if self.at_least else self.value <= self.limit

    def report(self) -> dict[str, Any]:
        """For the JSON."""
        return {**vars(self), "reached": self.reached}


@dataclass
class Samples:
    """Times by stage [ms]."""

    ms: defaultdict[str, list[float]] = field(default_factory=lambda: defaultdict(list))

    def add(self, times: Mapping[str, float]) -> None:
        """Takes one run."""
        for stage, ms in times.items():
            self.ms[stage].append(ms)

    def median(self, stage: str) -> float:
        """Median of a stage [ms]."""
        return float(np.median(self.ms[stage]))

    def report(self) -> dict[str, Any]:
        """Median and 99th percentile of each stage [ms]."""
        return {
            stage: {"median": float(np.median(ms)), "p99": float(np.percentile(ms, 99))}
            for stage, ms in self.ms.items()
        }


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
    """Proves the results, then times them.

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
        DiffersError: A result differs from the reference; nothing is timed then.
        PeopleLocError: The bag or a file cannot be used.
    """
    names = [path.name for path in configs]
    if len(set(names)) < len(names):
        raise BenchError(f"two configurations have one name: {', '.join(names)}")
    with one_thread(), timing.processor_time(), tempfile.TemporaryDirectory() as folder:
        top = _top_cameras(bag, Path(folder))
        # The references know one interval at a time.
        runs = {
            path.name: BagRun(bag, [path, *top], planner=lambda c: Planner(c.memoryless()))
            for path in configs
        }
        views, checked = _read_and_check(runs, on_step)
        heads = {name: heads_of(views[name], run.team.robots) for name, run in runs.items()}
        on_step(f"timing {frames} views of each head")
        robot = time_robot(heads, frames)
        on_step("drawing 4 robots and 10 people")
        named = {path.name: path for path in configs}
        planner = time_planner(named, frames, on_step)
        growth = time_growth(named, robots, on_step=on_step)
        tracking = time_tracking(frames, on_step)
    live = None
    if live_files is not None:
        from mrs_tools.bench.live import measure_live

        with private_domain() as where:
            on_domain(where)
            live = measure_live(bag, live_files, seconds, on_step)
        live = {"configuration": " + ".join(path.name for path in live_files), **live}
    report = {
        "machine": machine(),
        "bag": str(bag),
        "equal_to_reference": checked,
        "robot": robot,
        "planner": planner,
        "growth": growth,
        "tracking": tracking,
        "live": live,
    }
    return {**report, "targets": [target.report() for target in targets(report)]}


def targets(report: Mapping[str, Any]) -> list[Target]:
    """The figures of a report that have a target: of each method's first configuration."""
    first: dict[bool, str] = {}
    for name, planner in report["planner"].items():
        first.setdefault(planner["of_bodies"], name)
    found = []
    for of_bodies, name in first.items():
        kinds = report["robot"].get(name, {})
        found += _targets_of_bodies(name, kinds) if of_bodies else _targets_of_cells(name, kinds)
        planner = report["planner"][name]
        where = f"{name}, {planner['robots']} robots, {planner['people']} people"
        took, limit = planner["stages_ms"]["whole"]["median"], 3.0 if of_bodies else 2.0
        found.append(Target("planner", where, took, limit, "ms"))
        for floor, rows in report["growth"].get(name, {}).items():
            ratio = growth_of(rows)
            if ratio is not None:
                what = f"planner per robot, {rows[-1]['robots']} robots : 4 robots"
                found.append(Target(what, f"{name}, {floor}", ratio, 1.0, ""))
    for row in report["tracking"]:
        if row["people"] in _TRACKER_MS:
            where, limit = f"{row['people']} people", _TRACKER_MS[row["people"]]
            found.append(Target("tracker, one interval", where, row["tracker_ms"], limit, "ms"))
    live = report["live"]
    if live is not None:
        latency = live["latency_ms"]["newest"]["p99"]
        found.append(Target("image to people, p99", live["configuration"], latency, 50.0, "ms"))
    return found


def _targets_of_cells(name: str, kinds: Mapping[str, Any]) -> list[Target]:
    binocular, where = kinds.get("binocular"), f"{name}, binocular"
    if binocular is None:
        return []
    ratio, rate = binocular["rest_to_stereo_bm"], binocular["frames_per_s"]
    return [
        Target("all but StereoBM : StereoBM", where, ratio, 1.0, ""),
        Target("whole pipeline, one core", where, rate, 500.0, "frames/s", True),
    ]


def _targets_of_bodies(name: str, kinds: Mapping[str, Any]) -> list[Target]:
    # The pair of the head that leads sees everybody; the others see what is not hidden.
    kind = _PAIR_OF_THREE if _PAIR_OF_THREE in kinds else "binocular"
    if kind not in kinds:
        return []
    took = kinds[kind]["stages_ms"]["whole"]["median"]
    seen = kinds[kind]["bodies"]
    return [Target("whole frame, one core", f"{name}, {kind}, {seen:g} bodies", took, 10.0, "ms")]


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


@contextmanager
def one_thread() -> Any:
    """OpenCV works on one core."""
    before = cv2.getNumThreads()
    cv2.setNumThreads(1)
    try:
        yield
    finally:
        cv2.setNumThreads(before)


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


def _read_and_check(
    runs: Mapping[str, BagRun], on_step: Callable[[str], None]
) -> tuple[dict[str, list[View]], dict[str, int]]:
    """All views of a bag by configuration; some of them are compared with the reference."""
    views: dict[str, list[View]] = {}
    checked = dict.fromkeys(("views", "cells", "intervals", "clusters", "people"), 0)
    for name, run in runs.items():
        on_step(f"comparing {name} with the reference")
        views[name] = []
        for index, interval in enumerate(run.intervals()):
            views[name] += interval.views.values()
            if index % _CHECKED:
                continue
            for robot, view in interval.views.items():
                bench_reference.check_view(
                    view.images, view.stages, view.camera, run.team.robots[robot]
                )
                checked["views"] += 1
                checked["cells"] += len(view.stages.scan.cells)
            bench_reference.check_people(interval.scans, interval.people, run.team.planner)
            checked["intervals"] += 1
            checked["clusters"] += len(interval.people.clusters)
            checked["people"] += len(interval.people.persons)
        if not views[name]:
            raise BagError(f"{run.path}: no interval has images that can be used")
    return views, checked


# ------------------------------------------------------------------------------------------ robot


@dataclass(frozen=True)
class Head:
    """One robot's pipeline, and what to run it on."""

    pipeline: RobotPipeline
    images: Sequence[StereoImages]


def heads_of(views: Iterable[View], robots: Mapping[str, RobotConfig]) -> dict[str, list[Head]]:
    """The heads of a bag's views, by kind: `binocular`, `trinocular`, `pair of three`.

    The last is a trinocular head without its third camera: in the paper's formation it leads, and
    is the only one that sees everybody.
    """
    images: defaultdict[str, list[StereoImages]] = defaultdict(list)
    cameras: dict[str, StereoCamera] = {}
    for view in views:
        images[view.robot].append(view.images)
        cameras[view.robot] = view.camera
    heads: dict[str, list[Head]] = {}
    for robot, camera in cameras.items():
        kind = "trinocular" if camera.vertical_baseline else "binocular"
        pipeline = RobotPipeline(robot, camera, robots[robot])
        heads.setdefault(kind, []).append(Head(pipeline, images[robot]))
        if camera.vertical_baseline:
            pair = replace(camera, vertical_baseline=0.0, vertical_offset_px=0.0)
            pipeline = RobotPipeline(robot, pair, robots[robot])
            heads.setdefault(_PAIR_OF_THREE, []).append(Head(pipeline, images[robot]))
    return heads


def time_robot(
    heads: Mapping[str, Mapping[str, Sequence[Head]]], frames: int
) -> dict[str, dict[str, Any]]:
    """Times the robots' pipelines.

    Args:
        heads: By configuration and kind, the heads to run.
        frames: Views to time for each configuration and kind.

    Returns:
        By configuration and kind: stages [ms], the ratio of everything but StereoBM to StereoBM,
        frames per second, and how many bodies a scan has (0 where none are sought).
    """
    samples: defaultdict[tuple[str, str], Samples] = defaultdict(Samples)
    seen: defaultdict[tuple[str, str], list[int]] = defaultdict(list)
    for block, turns in enumerate(_blocks(frames)):
        for name, kinds in heads.items():
            for kind, of_kind in kinds.items():
                sample, head = samples[name, kind], of_kind[block % len(of_kind)]
                for turn, counts in turns:
                    images = head.images[turn % len(head.images)]
                    times, bodies = _time_view(head.pipeline, images)
                    if counts:
                        sample.add(times)
                        seen[name, kind].append(bodies)
                bare = sample.ms["StereoBM on the bare pair"]
                bare += _time_bare_pair(head.pipeline, images, len(turns))
    result: dict[str, dict[str, Any]] = {}
    for (name, kind), sample in sorted(samples.items(), key=lambda item: item[0][1]):
        pipelines = [head.pipeline for head in heads[name][kind]]
        camera = pipelines[0].camera
        result.setdefault(name, {})[kind] = {
            "robots": [pipeline.robot for pipeline in pipelines],
            "image": f"{camera.width}x{camera.height}",
            "searched_px": list(pipelines[0].matcher.searched_px),
            "frames": len(sample.ms["whole"]),
            "stages_ms": sample.report(),
            "rest_to_stereo_bm": sample.median("all but StereoBM") / sample.median("StereoBM"),
            "frames_per_s": 1000.0 / float(np.mean(sample.ms["whole"])),
            "bodies": float(np.median(seen[name, kind])),
        }
    return result


def _blocks(count: int) -> Iterator[list[tuple[int, bool]]]:
    """Turns from 0 in blocks: one head has the caches for itself, as in its own process.

    Yields:
        Turns, and whether each one counts; the first ones of a block warm up.
    """
    for begin in range(0, count, _BLOCK):
        turns = range(begin, min(begin + _BLOCK, count))
        yield [(turn, False) for turn in turns[:_WARM_UP]] + [(turn, True) for turn in turns]


def _time_view(pipeline: RobotPipeline, images: StereoImages) -> tuple[dict[str, float], int]:
    """What each stage of a view takes [ms], and how many bodies its scan has."""
    began = timing.now_ns()
    stages = pipeline.stages(images)
    whole = (timing.now_ns() - began) / 1e6
    stereo_bm = pipeline.matcher.stereo_bm_ms
    after = {stage: ms for stage, ms in stages.times_ms.items() if stage != "disparity"}
    times = {
        "StereoBM": stereo_bm,
        "disparity around it": stages.times_ms["disparity"] - stereo_bm,
        **after,
        "all but StereoBM": whole - stereo_bm,
        "whole": whole,
    }
    return times, int(stages.scan.cells.body.max(initial=0))


def _time_bare_pair(pipeline: RobotPipeline, images: StereoImages, count: int) -> list[float]:
    """What StereoBM takes on a pair without the padding, for comparison [ms]."""
    bm = make_stereo_bm(pipeline.config.disparity, pipeline.matcher.searched_px[0])
    times = []
    for _ in range(count):
        began = timing.now_ns()
        bm.compute(images.left, images.right)
        times.append((timing.now_ns() - began) / 1e6)
    return times


# ---------------------------------------------------------------------------------------- planner


def time_planner(
    configs: Mapping[str, Path], frames: int, on_step: Callable[[str], None] = lambda _: None
) -> dict[str, dict[str, Any]]:
    """Times the planner on the drawn scene, which is compared with the reference first.

    Args:
        configs: Parameter files by name.
        frames: Intervals to time for each.
        on_step: Told what is done now.

    Returns:
        By configuration: stages [ms], and what there is in the scene.

    Raises:
        DiffersError: A result differs from the reference.
    """
    planners, scenes, found = {}, {}, {}
    for name, path in configs.items():
        team = load_team(path, robots=tuple(ROBOTS))
        planners[name] = Planner(team.planner)
        config = next(iter(team.robots.values()))
        scenes[name] = [drawn_scans(config, seed) for seed in range(_DRAWN)]
        scans, poses = scenes[name][0]
        people = Planner(team.planner.memoryless()).step(scans, poses, 0)
        bench_reference.check_people(scans, people, team.planner)
        found[name] = people
    on_step(f"timing {frames} intervals")
    samples = {name: Samples() for name in configs}
    now_ns = 0
    for turns in _blocks(frames):
        for name, planner in planners.items():
            for turn, counts in turns:
                scans, poses = scenes[name][turn % _DRAWN]
                now_ns += INTERVAL_NS
                began = timing.now_ns()
                people = planner.step(scans, poses, now_ns)
                whole = (timing.now_ns() - began) / 1e6
                if counts:
                    samples[name].add({**people.times_ms, "whole": whole})
    return {
        name: {
            "of_bodies": bool(found[name].fused.cells.body.any()),
            "robots": len(ROBOTS),
            "people": len(PEOPLE),
            "people_found": len(found[name].persons),
            "cells": len(found[name].fused),
            "clusters": len(found[name].clusters),
            "intervals": len(sample.ms["whole"]),
            "stages_ms": sample.report(),
        }
        for name, sample in samples.items()
    }


# ------------------------------------------------------------------------------------------ tables


def show(report: Mapping[str, Any], console: Console) -> None:
    """Prints a report as tables."""
    m, checked = report["machine"], report["equal_to_reference"]
    console.print(
        f"{m['processor']}, {m['cores']} cores (load {m['load_average']:.1f}), "
        f"Python {m['python']}, NumPy {m['numpy']}, OpenCV {m['opencv']}; bag {report['bag']}",
        soft_wrap=True,
    )
    console.print(
        "equal to the reference: "
        + ", ".join(f"{count} {what}" for what, count in checked.items()),
        style="green",
        soft_wrap=True,
    )
    for table in _robot_tables(report["robot"]):
        console.print(table)
    console.print(_planner_table(report["planner"]))
    for table in _growth_tables(report["growth"]):
        console.print(table)
    console.print(_tracking_table(report["tracking"]))
    if report["live"] is not None:
        for table in _live_tables(report["live"]):
            console.print(table)
        others = report["live"]["others_cores"]
        text = f"other programs took {others:.1f} of {m['cores']} cores meanwhile"
        if others > _BUSY * m["cores"]:
            text += ": a starved team is late, and what it did not do cost nothing"
        console.print(text, style="yellow" if others > _BUSY * m["cores"] else None, soft_wrap=True)
    console.print(_target_table(report["targets"]))


def _table(title: str, first: str, *others: str) -> Table:
    # Text: a unit such as [ms] would be taken for markup.
    table = Table(title=Text(title), title_justify="left", box=box.SIMPLE_HEAD, show_edge=False)
    table.add_column(Text(first))
    for column in others:
        table.add_column(column, justify="right", no_wrap=True)
    return table


def _robot_tables(robot: Mapping[str, Mapping[str, Any]]) -> Iterator[Table]:
    """A table for each kind of head, the configurations side by side."""
    for kind in dict.fromkeys(kind for kinds in robot.values() for kind in kinds):
        columns = {name: kinds[kind] for name, kinds in robot.items() if kind in kinds}
        title = f"\nrobot, one view of a head ({kind}) on one core: median / p99 [ms]"
        table = _table(title, "stage", *columns)
        for stage in _stages_of(columns.values()):
            cells = [_times(figures["stages_ms"].get(stage)) for figures in columns.values()]
            table.add_row(stage, *cells, style="bold" if stage in ("StereoBM", "whole") else None)
        table.add_section()
        rows: dict[str, Callable[[Mapping[str, Any]], str]] = {
            "all but StereoBM : StereoBM": lambda f: f"{f['rest_to_stereo_bm']:.2f}",
            "frames/s": lambda f: f"{f['frames_per_s']:.0f}",
            "bodies in a scan": lambda f: f"{f['bodies']:g}" if f["bodies"] else "-",
            "disparities searched [px]": lambda f: ", ".join(map(str, f["searched_px"])),
        }
        for row, text in rows.items():
            table.add_row(Text(row), *(text(figures) for figures in columns.values()))
        yield table


def _planner_table(planner: Mapping[str, Mapping[str, Any]]) -> Table:
    first = next(iter(planner.values()))
    title = (
        f"\nplanner, one interval of {first['robots']} robots and {first['people']} people "
        "(a drawn room by the robots' own filters, or made bodies): median / p99 [ms]"
    )
    table = _table(title, "stage", *planner)
    for stage in _stages_of(planner.values()):
        cells = [_times(figures["stages_ms"].get(stage)) for figures in planner.values()]
        table.add_row(stage, *cells, style="bold" if stage == "whole" else None)
    table.add_section()
    for row, key in (("cells", "cells"), ("clusters", "clusters"), ("people", "people_found")):
        table.add_row(row, *(str(figures[key]) for figures in planner.values()))
    return table


def _tracking_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    table = _table("\nfollowing people, one interval: median [ms]", "people", "tracker", "groups")
    for row in rows:
        table.add_row(str(row["people"]), f"{row['tracker_ms']:.2f}", f"{row['groups_ms']:.2f}")
    return table


def _growth_tables(
    growth: Mapping[str, Mapping[str, Sequence[Mapping[str, Any]]]],
) -> Iterator[Table]:
    """A table for each floor, the configurations side by side."""
    for floor in dict.fromkeys(floor for floors in growth.values() for floor in floors):
        columns = {name: floors[floor] for name, floors in growth.items()}
        title = (
            f"\nplanner, one interval as the team grows, {floor}: ten people and 56 m^2 for every "
            "four robots: median, and per robot [ms]"
        )
        heads = [f"{name}{of}" for name in columns for of in (": cells", "", ", per robot")]
        table = _table(title, "robots", "people", *heads)
        for rows in zip(*columns.values(), strict=True):
            figures = [
                text
                for row in rows
                for text in (
                    str(row["cells"]), f"{row['ms']:.2f}", f"{row['ms_per_robot']:.3f}"
                )
            ]  # fmt: skip
            table.add_row(str(rows[0]["robots"]), str(rows[0]["people"]), *figures)
        yield table


def _live_tables(live: Mapping[str, Any]) -> Iterator[Table]:
    title = (
        f"\nover DDS with {live['configuration']}: {len(live['robots'])} robot_node and "
        f"planner_node, images at {live['frame_hz']:g} Hz, poses at {live['pose_hz']:g} Hz, "
        f"{live['seconds']:.0f} s"
    )
    table = _table(title, "age of an image when its people arrive [ms]", "median", "p99")
    for which, ages in live["latency_ms"].items():
        table.add_row(
            f"{which} image of the interval", f"{ages['median']:.1f}", f"{ages['p99']:.1f}"
        )
    yield table
    robots = live["robots"]
    table = _table("", "robot_node", *robots)
    rows: list[tuple[str, Callable[[Mapping[str, Any]], str]]] = [
        ("cameras", lambda r: str(r["cameras"])),
        ("processor, images and poses", lambda r: f"{r['cpu_percent']:.0f} %"),
        ("processor, poses alone", lambda r: f"{r['cpu_percent_poses_only']:.0f} %"),
        ("processor per frame [ms]", lambda r: f"{r['cpu_ms_per_frame']:.2f}"),
        ("  the pipeline (its own clock)", lambda r: f"{r['pipeline_ms']:.2f}"),
        ("  around it: rclpy, messages", lambda r: f"{r['around_pipeline_ms']:.2f}"),
        ("processor per pose [ms]", lambda r: f"{r['cpu_ms_per_pose']:.2f}"),
        ("frames sent / scans used", lambda r: f"{r['frames']} / {r['scans_used']}"),
        ("points [kB/s]", lambda r: f"{r['points_bytes_per_s'] / 1e3:.0f}"),
        ("pose [kB/s]", lambda r: f"{r['pose_bytes_per_s'] / 1e3:.0f}"),
        ("its images would be [kB/s]", lambda r: f"{r['images_bytes_per_s'] / 1e3:.0f}"),
        ("that is times as much", lambda r: f"{_saving(r):.1f}"),
    ]
    for row, text in rows:
        table.add_row(Text(row), *(text(figures) for figures in robots.values()))
    yield table
    planner = live["planner"]
    table = _table("", "planner_node", "")
    table.add_row("processor, images and poses", f"{planner['cpu_percent']:.0f} %")
    table.add_row("processor, poses alone", f"{planner['cpu_percent_poses_only']:.0f} %")
    table.add_row(Text("processor per interval [ms]"), f"{planner['cpu_ms_per_interval']:.2f}")
    table.add_row("  the planner (its own clock)", f"{planner['step_ms']:.2f}")
    table.add_row("intervals", str(live["intervals"]))
    yield table


def _saving(robot: Mapping[str, float]) -> float:
    """How many times the bytes of its images a robot's scans and poses would fit into."""
    sent = robot["points_bytes_per_s"] + robot["pose_bytes_per_s"]
    return robot["images_bytes_per_s"] / sent


def _target_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    table = _table("\ntargets", "figure", "measured", "target", "")
    table.add_column("configuration")
    for row in rows:
        sign = ">=" if row["at_least"] else "<="
        table.add_row(
            row["name"],
            f"{row['value']:.4g} {row['unit']}",
            f"{sign} {row['limit']:g} {row['unit']}",
            "[green]reached[/]" if row["reached"] else "[red]missed[/]",
            row["configuration"],
        )
    return table


def _stages_of(columns: Iterable[Mapping[str, Any]]) -> list[str]:
    """The stages of all columns, each behind the one that it follows where it was first seen."""
    stages: list[str] = []
    for figures in columns:
        place = 0
        for stage in figures["stages_ms"]:
            if stage not in stages:
                stages.insert(place, stage)
            place = stages.index(stage) + 1
    return stages


def _times(times: Mapping[str, float] | None) -> str:
    return "-" if times is None else f"{times['median']:.3f} / {times['p99']:.3f}"


# ----------------------------------------------------------------------------------------- command


def command(
    bag: Annotated[
        Path | None, typer.Argument(help="A bag with images. Default: bags/paper_formation.")
    ] = None,
    config: Annotated[
        list[Path] | None,
        typer.Option(
            "--config",
            "-c",
            help="Parameter file to measure with; several are compared, the targets are for the "
            "first of each method. Default: config/paper.yaml and config/default.yaml.",
        ),
    ] = None,
    team: Annotated[
        list[Path] | None,
        typer.Option(
            "--team",
            "-t",
            help="Parameter file of the bag's team, for the live part: on top of the first "
            "--config. Default: config/team.yaml.",
        ),
    ] = None,
    frames: Annotated[
        int, typer.Option(min=1, help="Views, and intervals, to time of each kind.")
    ] = 600,
    robots: Annotated[
        int, typer.Option(min=1, help="The largest team to time the planner with.")
    ] = LARGEST,
    live: Annotated[
        bool, typer.Option("--live/--no-live", help="Measure real processes over DDS, too.")
    ] = True,
    seconds: Annotated[
        float, typer.Option(min=1.0, help="How long the live part measures [s].")
    ] = 10.0,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the figures to this file, too.")
    ] = None,
) -> None:
    """Prove that the results are right, then measure the speed.

    Every figure names its configuration. A target that is missed is a measurement, not an error;
    results that differ from the reference are one (exit code 1), and nothing is timed then.
    """  # fmt: skip
    if live:
        given_domain()
    bag = bag or default_file("bags", "paper_formation")
    configs = config or [default_file("config", f"{name}.yaml") for name in ("paper", "default")]
    files = [configs[0], *(team or [default_file("config", "team.yaml")])] if live else None
    progress = Console(stderr=True, soft_wrap=True, highlight=False)
    with progress.status("") as status:
        report = run_bench(
            bag,
            configs,
            frames=frames,
            robots=robots,
            live_files=files,
            seconds=seconds,
            on_step=lambda text: status.update(f"{text} ..."),
            on_domain=progress.print,
        )
    show(report, Console(highlight=False))
    if json_file is not None:
        write_json(report, json_file)


def write_json(report: Mapping[str, Any], path: Path) -> None:
    """Writes a report; what is undefined becomes null.

    Raises:
        BenchError: The file cannot be written.
    """
    try:
        path.write_text(json.dumps(_finite(report), indent=2, allow_nan=False) + "\n", "utf-8")
    except OSError as err:
        raise BenchError(f"{path}: cannot be written ({err.strerror or err})") from err


def _finite(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {key: _finite(inner) for key, inner in value.items()}
    if isinstance(value, (list, tuple)):
        return [_finite(inner) for inner in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value

"""A report of `mrs bench` as tables."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table
from rich.text import Text

from mrs_people_sim.common import number
from mrs_tools.common import make_table

#: More of the machine than this is too busy for the live part.
_BUSY = 0.15


def show(report: Mapping[str, Any], console: Console) -> None:
    """Prints a report as tables."""
    m, checked = report["machine"], report["equal_to_reference"]
    console.print(
        f"{m['processor']}, {m['cores']} cores (load {m['load_average']:.1f}), "
        f"Python {m['python']}, NumPy {m['numpy']}, OpenCV {m['opencv']}; bag {report['bag']}",
        soft_wrap=True,
    )
    counts = ", ".join(f"{count} {what}" for what, count in checked.items())
    console.print(f"equal to the oracle: {counts}", style="green", soft_wrap=True)
    for table in _robot_tables(report["robot"]):
        console.print(table)
    console.print(_planner_table(report["planner"]))
    for table in _growth_tables(report["growth"]):
        console.print(table)
    console.print(_tracking_table(report["tracking"]))
    console.print(_wall_table(report["walls"]))
    console.print(_localization_table(report["localization"]))
    console.print(_guiding_table(report["guiding"]))
    if report["live"] is not None:
        for table in _live_tables(report["live"]):
            console.print(table)
        others = report["live"]["others_cores"]
        text = f"other programs took {others:.1f} of {m['cores']} cores meanwhile"
        if others > _BUSY * m["cores"]:
            text += ": a starved team is late, and what it did not do cost nothing"
        console.print(text, style="yellow" if others > _BUSY * m["cores"] else None, soft_wrap=True)
    if report["viewers"] is not None:
        console.print(_viewer_table(report["viewers"]))
    console.print(_target_table(report["targets"]))


def _robot_tables(robot: Mapping[str, Mapping[str, Any]]) -> Iterator[Table]:
    """A table for each kind of head, the configurations side by side."""
    for kind in dict.fromkeys(kind for kinds in robot.values() for kind in kinds):
        columns = {name: kinds[kind] for name, kinds in robot.items() if kind in kinds}
        title = f"\nrobot, one view of a head ({kind}) on one core: median / p99 [ms]"
        table = make_table(title, "stage", *columns)
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
    table = make_table(title, "stage", *planner)
    for stage in _stages_of(planner.values()):
        cells = [_times(figures["stages_ms"].get(stage)) for figures in planner.values()]
        table.add_row(stage, *cells, style="bold" if stage == "whole" else None)
    table.add_section()
    for row, key in (("cells", "cells"), ("clusters", "clusters"), ("people", "people_found")):
        table.add_row(row, *(str(figures[key]) for figures in planner.values()))
    return table


def _tracking_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    table = make_table(
        "\nfollowing people, one interval: median [ms]", "people", "tracker", "groups"
    )
    for row in rows:
        table.add_row(str(row["people"]), f"{row['tracker_ms']:.2f}", f"{row['groups_ms']:.2f}")
    return table


def _wall_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    table = make_table("\nwalls of one view or scan: median / p99 [ms]", "sensor", "walls", "")
    for row in rows:
        table.add_row(row["sensor"], f"{row['found']:.1f}", _times(row))
    return table


def _localization_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    title = "\nwhere the robots are, one robot's part: mean [ms]"
    columns = {
        "own odometry": "odometry_ms",
        "walls of a frame": "walls_ms",
        "shared pose": "shared_ms",
        "at most": "shared_most_ms",
        "all, frame to frame": "frame_ms",
        "p99": "frame_p99_ms",
    }
    table = make_table(title, "robots", *columns)
    for row in rows:
        table.add_row(str(row["robots"]), *(f"{row[key]:.3f}" for key in columns.values()))
    return table


def _guiding_table(row: Mapping[str, Any]) -> Table:
    title = "\nguiding people: median [ms]"
    columns = {
        "step of the guide": "guide_ms",
        "paths of all robots": "paths_ms",
        "step of one drive": "drive_ms",
    }
    table = make_table(title, "robots", "people", *columns)
    figures = (f"{row[key]:.2f}" for key in columns.values())
    table.add_row(str(row["robots"]), str(row["people"]), *figures)
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
        figures_of = ("cells", "whole", "per robot")
        heads = [f"{Path(name).stem}\n{figure}" for name in columns for figure in figures_of]
        table = make_table(title, "robots", "people", *heads)
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
    table = make_table(title, "age of an image when its people arrive [ms]", "median", "p99")
    for which, ages in live["latency_ms"].items():
        table.add_row(
            f"{which} image of the interval", f"{ages['median']:.1f}", f"{ages['p99']:.1f}"
        )
    yield table
    robots = live["robots"]
    table = make_table("", "robot_node", *robots)
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
    table = make_table("", "planner_node", "")
    table.add_row("processor, images and poses", f"{planner['cpu_percent']:.0f} %")
    table.add_row("processor, poses alone", f"{planner['cpu_percent_poses_only']:.0f} %")
    table.add_row(Text("processor per interval [ms]"), f"{planner['cpu_ms_per_interval']:.2f}")
    table.add_row("  the planner (its own clock)", f"{planner['step_ms']:.2f}")
    table.add_row("intervals", str(live["intervals"]))
    yield table


def _viewer_table(figures: Mapping[str, Any]) -> Table:
    title = (
        f"\nmrs view with {figures['configuration']}: {figures['robots']} robots and "
        f"{figures['people']} people over DDS at {figures['rate_hz']:g} Hz; a state is "
        f"{number(figures['state_bytes'], 1e-3, 1)} kB, and encoded in "
        f"{number(figures['encode_ms'], 1.0, 2)} ms"
    )
    table = make_table(title, "viewers", *(str(row["viewers"]) for row in figures["rows"]))
    rows: dict[str, Callable[[Mapping[str, Any]], str]] = {
        "planner, of a core [%]": lambda r: number(r["planner_cpu_percent"], 1.0, 1),
        "planner, one interval (its own clock) [ms]": lambda r: number(
            r["planner_step_ms"], 1.0, 2
        ),
        "age of the newest scan when its people arrive: median [ms]": lambda r: number(
            r["age_ms"]["median"], 1.0, 1
        ),
        "... p99 [ms]": lambda r: number(r["age_ms"]["p99"], 1.0, 1),
        "mrs view, of a core [%]": lambda r: number(r["view_cpu_percent"], 1.0, 1),
        "states per second and viewer": lambda r: number(r["states_per_s"], 1.0, 1),
        "kB/s and viewer": lambda r: number(r["bytes_per_s"], 1e-3, 0),
    }
    for row, text in rows.items():
        table.add_row(Text(row), *(text(one) for one in figures["rows"]))
    return table


def _saving(robot: Mapping[str, float]) -> float:
    """How many times the bytes of its images a robot's scans and poses would fit into."""
    sent = robot["points_bytes_per_s"] + robot["pose_bytes_per_s"]
    return robot["images_bytes_per_s"] / sent


def _target_table(rows: Sequence[Mapping[str, Any]]) -> Table:
    table = make_table("\ntargets", "figure", "measured", "target", "")
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

"""Scores as tables of the terminal."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from mrs_people_sim.common import number
from mrs_people_sim.evaluation.results import Result
from mrs_people_sim.scoring.detections import MODA_DISTANCE
from mrs_tools.common import make_table
from mrs_tools.plain import plain

if TYPE_CHECKING:
    from rich.console import Console


def show(results: Mapping[str, Result], console: Console) -> None:
    """Prints the figures as tables."""
    from rich.text import Text

    rows = dict(results)
    if len(results) > 1:
        rows["total"] = Result.pooled(list(results.values()))
    reports = {name: result.report() for name, result in rows.items()}
    last = reports[next(reversed(reports))]
    console.print(_people_table(reports))
    console.print(_detections_table(reports))
    if any(of["true"] for of in last["people"]["by_visibility"].values()):
        console.print(_visibility_table(reports))
    if any(len(result.ghosts.followed_s) for result in rows.values()):
        console.print(_hidden_table(reports))
    if any(result.tracks.tracks for result in rows.values()):
        console.print(_tracks_table(reports))
    if any(result.stragglers.observed_s for result in rows.values()):
        console.print(_stragglers_table(reports))
    of_poses = {name: report for name, report in reports.items() if "poses" in report}
    if len(of_poses) < len(reports):
        of_poses.pop("total", None)  # would be of other bags than the tables above
    if of_poses:
        console.print(_poses_table(of_poses))
        console.print(_people_of_poses_table(of_poses))
    of_tours = {name: report["tour"] for name, report in reports.items() if "tour" in report}
    if of_tours:
        console.print(tours_table(of_tours))
        console.print(robots_of_tours_table(of_tours))
    if last["stages"]:
        console.print(_stages_table(last["stages"]))
    if last["timing_ms"]:
        console.print(_timing_table(last["timing_ms"]))
    for name, result in results.items():
        for note in result.notes:
            console.print(Text(plain(f"{name}: {note}")), style="yellow")


def _table(title: str, heads: str) -> Any:
    """A table whose columns have these heads, separated by `|`."""
    table = make_table(title, *heads.split("|"), padding=(0, 0))
    table.columns[0].min_width = 8
    return table


def _add(table: Any, name: str, *cells: str) -> None:
    """Adds the row of a bag or a robot; that of all together is bold."""
    from rich.text import Text

    table.add_row(Text(plain(name)), *cells, style="bold" if name == "total" else None)


def _people_table(reports: Mapping[str, Mapping[str, Any]]) -> Any:
    table = _table(
        "people (errors in cm; in 95%: truth is in the 95 % ellipse)",
        "bag|frames|true|found|recall|prec.|mean|p95|max|in 95%|centre",
    )
    for name, report in reports.items():
        people, error = report["people"], report["people"]["error_m"]
        _add(
            table,
            name,
            *(str(n) for n in (report["frames"], people["true"], people["matched"])),
            *(number(people[key], 1, 3) for key in ("recall", "precision")),
            *(number(error[key], 100, 1) for key in ("mean", "p95", "max")),
            number(people["coverage_95"], 1, 3),
            number(report["group"]["centre_error_m"]["mean"], 100, 1),
        )
    return table


def _detections_table(reports: Mapping[str, Mapping[str, Any]]) -> Any:
    table = _table(
        f"detections (MODA, MODP at {MODA_DISTANCE:.2f} m; clean: frames without a false person)",
        "bag|MODA|MODP|frames|clean",
    )
    for name, report in reports.items():
        people = report["people"]
        _add(
            table,
            name,
            *(number(people[key], 1, 3) for key in ("moda", "modp")),
            *(str(n) for n in (report["frames"], people["frames_without_false"])),
        )
    return table


def _visibility_table(reports: Mapping[str, Mapping[str, Any]]) -> Any:
    table = _table(
        "recall by how much of a person is visible",
        "bag|< 0.50|recall|< 0.75|recall|more|recall",
    )
    for name, report in reports.items():
        parts = report["people"]["by_visibility"].values()
        cells = [(str(of["true"]), number(of["recall"], 1, 3)) for of in parts]
        _add(table, name, *(cell for pair in cells for cell in pair))
    return table


def _hidden_table(reports: Mapping[str, Mapping[str, Any]]) -> Any:
    table = _table(
        "hidden people (error in cm; ghosts of who left the view: in view, in all, in s)",
        "bag|true|hidden|found|recall|prec.|mean|left|view|p95|all|p95",
    )
    for name, report in reports.items():
        people, ghosts = report["people_hidden"], report["people"]["ghost_s"]
        _add(
            table,
            name,
            *(str(people[key]) for key in ("true", "estimates", "matched")),
            *(number(people[key], 1, 3) for key in ("recall", "precision")),
            number(people["error_m"]["mean"], 100, 1),
            str(ghosts["times"]),
            *(number(ghosts[key], 1, 2) for key in ("median", "p95")),
            *(number(people["ghost_s"][key], 1, 2) for key in ("median", "p95")),
        )
    return table


def _tracks_table(reports: Mapping[str, Mapping[str, Any]]) -> Any:
    table = _table(
        "tracks (switches; per person and minute; MOTP, GOSPA in cm; velocity in cm/s)",
        "bag|MOTA|IDF1|switches|/min|frag.|MOTP|GOSPA|v mean|p95",
    )
    for name, report in reports.items():
        tracks, velocity = report["tracks"], report["tracks"]["velocity_error_mps"]
        _add(
            table,
            name,
            *(number(tracks[key], 1, 3) for key in ("mota", "idf1")),
            number(tracks["id_switches"], 1, 0),
            number(tracks["switches_per_person_minute"], 1, 2),
            number(tracks["fragments"], 1, 0),
            *(number(tracks[key], 100, 1) for key in ("motp_m", "gospa")),
            *(number(velocity[key], 100, 1) for key in ("mean", "p95")),
        )
    return table


def _stragglers_table(reports: Mapping[str, Mapping[str, Any]]) -> Any:
    table = _table(
        "stragglers (delay of flags in s; false flags)",
        "bag|true|flagged|in 1 s|delay|max|unseen|false|minutes",
    )
    for name, report in reports.items():
        found = report["stragglers"]
        _add(
            table,
            name,
            *(number(found[key], 1, 0) for key in ("true", "flagged")),
            number(found["within_1_s"], 1, 3),
            *(number(found["delay_s"][key], 1, 2) for key in ("mean", "max")),
            *(number(found[key], 1, 0) for key in ("unseen", "false")),
            number(found["minutes"], 1, 1),
        )
    return table


def _poses_table(reports: Mapping[str, Mapping[str, Any]]) -> Any:
    table = _table(
        "robots' poses (medians and 95 % of errors, in cm and degrees; mean NEES)",
        "bag|relative|p95|NEES|heading|p95|along|across|NEES|bounds",
    )
    for name, report in reports.items():
        rows = {name: report["poses"], "  odometry alone": report["poses"]["odometry"]}
        for label, scores in rows.items():
            if scores is None:
                continue
            relative, nees = scores["relative"], scores["nees"]
            bounds = f"{number(nees['low'], 1, 1)}-{number(nees['high'], 1, 1)}"
            _add(
                table,
                label,
                *(number(relative["position_m"][key], 100, 1) for key in ("median", "p95")),
                number(relative["nees"]["mean"], 1, 1),
                *(number(relative["heading_deg"][key], 1, 2) for key in ("median", "p95")),
                *(number(scores[key]["median"], 100, 1) for key in ("along_m", "across_m")),
                number(nees["mean"], 1, 1),
                "-" if nees["mean"] is None else bounds,
            )
    return table


def _people_of_poses_table(reports: Mapping[str, Mapping[str, Any]]) -> Any:
    table = _table(
        "people by the poses that they are placed with (errors in cm)",
        "bag|found|recall|prec.|mean|p95",
    )
    for name, report in reports.items():
        rows = {
            name: report["people"],
            "  in the team's frame": report["poses"]["people_in_team_frame"],
            "  with exact poses": report["poses"]["people_with_exact_poses"],
        }
        for label, people in rows.items():
            if people is None:
                continue
            _add(
                table,
                label,
                str(people["matched"]),
                *(number(people[key], 1, 3) for key in ("recall", "precision")),
                *(number(people["error_m"][key], 100, 1) for key in ("mean", "p95")),
            )
    return table


def tours_table(reports: Mapping[str, Mapping[str, Any]]) -> Any:
    """People of guided tours (`TourScores.report`), a row per report."""
    table = _table(
        "guided tours (s, m; share of the time that people are seen; stragglers)",
        "tours|finished|time|way|people|lost|seen|least|detected|back|alone",
    )
    for name, tour in reports.items():
        seen, stragglers = tour["seen"], tour["stragglers"]
        back = "-" if stragglers["back"] is None else round(stragglers["back"] * stragglers["true"])
        _add(
            table,
            name,
            f"{tour['finished']} of {tour['tours']}",
            *(number(tour[key], 1, 1) for key in ("time_s", "way_m")),
            *(str(tour[key]) for key in ("people", "lost")),
            *(number(seen[key], 1, 3) for key in ("mean", "min", "detected")),
            f"{back} of {stragglers['true']}" if stragglers["true"] else "-",
            number(stragglers["alone_s"], 1, 1),
        )
    return table


def robots_of_tours_table(reports: Mapping[str, Mapping[str, Any]]) -> Any:
    """Robots of guided tours, likewise."""
    table = _table(
        "robots of tours (m; s nearer to people than 0.5 m, than 0.45 m by own motion)",
        "tours|least|contacts|< 0.5|own|way|post|p95",
    )
    for name, tour in reports.items():
        _add(
            table,
            name,
            number(tour["distance_m"], 1, 2),
            str(tour["contacts"]),
            number(tour["within_0_50_m_s"], 1, 1),
            number(tour["within_0_45_m_by_own_motion_s"], 1, 1),
            number(tour["path_m"], 1, 1),
            *(number(tour["formation_m"][key], 1, 2) for key in ("median", "p95")),
        )
    return table


def _stages_table(stages: Mapping[str, Mapping[str, float | None]]) -> Any:
    table = _table(
        "stages: means per view, the share kept of the stage before, and what all of them remove",
        "robot|valid pixels|raw|cropped|foreground|cells|removed",
    )
    for robot, means in stages.items():
        _add(
            table,
            robot,
            f"{number(means['valid_pixels'], 100, 0)} %",
            number(means["raw"], 1, 0),
            *(
                f"{number(means[s], 1, 0)} {number(means[f'{s}_kept'], 100, 1):>5} %"
                for s in ("cropped", "foreground", "cells")
            ),
            number(means["removed"], 1, 0),
        )
    return table


def _timing_table(timing: Mapping[str, Mapping[str, float | None]]) -> Any:
    table = _table(
        "time [ms]",
        "stage|median|p99",
    )
    for stage, times in timing.items():
        whole = stage in ("robot", "planner")
        table.add_row(
            f"whole {stage}" if whole else stage,
            *(number(times[which], 1, 2) for which in ("median", "p99")),
            style="bold" if whole else None,
        )
    return table

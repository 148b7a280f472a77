"""What `mrs experiment` says: the paper's figures beside ours, and why they differ.

A reason is a line made of measured figures (`causes` in the report). It is there only where a
figure differs from the paper's.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mrs_people_sim.common import number
from mrs_people_sim.paper import (
    PAPER_CLUSTERS,
    PAPER_ERROR_M,
    PAPER_KEPT,
    PAPER_REMOVED,
    PAPER_SEEN,
)
from mrs_tools.common import make_table

if TYPE_CHECKING:
    from rich.console import Console


def reasons(report: Mapping[str, Any]) -> list[dict[str, str]]:
    """Why figures differ from the paper's: one line each, of what was measured.

    Args:
        report: The report.

    Returns:
        `figure` and `why`, for the figures that do differ.
    """
    parts = (
        _zones, _removed, _zones_of_one, _noise, _cells, _clusters, _error, _rear_robots,
        _architecture,
    )  # fmt: skip
    return [{"figure": figure, "why": why} for part in parts for figure, why in part(report)]


#: A figure that is measured, and why it differs from the paper's; none where it does not.
_Reasons = Iterator[tuple[str, str]]


def _kept(report: Mapping[str, Any], stage: str, scene: str = "formation") -> float:
    """What a stage keeps of the one before."""
    return float(report["retention"][scene]["all"][stage])


def _zones(report: Mapping[str, Any]) -> _Reasons:
    kept, cause = _kept(report, "zones"), report["causes"]["zones"]["formation"]
    if abs(kept - PAPER_KEPT["zones"]) > 0.03:
        yield (
            "zones",
            "People fill the views: the points within 40 cm of one are "
            f"{_percent(cause['where'].get('person', 0.0) * kept)} of the "
            "raw ones. Counting pixels beyond the working range as raw, too, the zone keeps "
            f"{_percent(cause['of_all_pixels'])}; what the paper's raw set held is not printed.",
        )


def _removed(report: Mapping[str, Any]) -> _Reasons:
    for robot, least in PAPER_REMOVED.items():
        points = report["points"]["formation"][robot]
        if points["removed"] < least:
            yield (
                f"points removed of {robot}",
                f"Of its {points['ranged']:.0f} pixels with a disparity {points['raw']:.0f} are in "
                f"the working range and count as raw. Counting them all, "
                f"{points['ranged'] - points['cells']:.0f} are removed (paper: over {least}).",
            )


def _zones_of_one(report: Mapping[str, Any]) -> _Reasons:
    kept = _kept(report, "zones", "single_person")
    where = report["causes"]["zones"]["single_person"]["where"]
    if abs(kept - PAPER_KEPT["zones"]) > 0.03:
        yield (
            "zones, one person",
            f"{_percent(where.get('wall', 0.0))} of what it keeps is at walls within the working "
            f"range; the points at the person are {_percent(where.get('person', 0.0) * kept)} of "
            "the raw ones.",
        )


def _noise(report: Mapping[str, Any]) -> _Reasons:
    if abs(_kept(report, "noise") - PAPER_KEPT["noise"]) > 0.03:
        bands = ", ".join(
            f"{band['from_m']:.0f}-{band['to_m']:.0f} m {_percent(band['kept'])}"
            for band in report["causes"]["noise"]
            if band["kept"] is not None
        )
        yield (
            "noise",
            f"A fixed threshold keeps less with distance from the robot: {bands}. The paper says "
            "that its figure depends on the cell size, too.",
        )


def _cells(report: Mapping[str, Any]) -> _Reasons:
    if abs(_kept(report, "cells") - PAPER_KEPT["cells"]) > 0.01:
        cells = report["cells"]
        size = np.interp(-PAPER_KEPT["cells"], -np.array(cells["formation"]), cells["cell_m"])
        yield (
            "cells",
            f"The paper's cell size is not printed: 7 % is what cells of {100 * size:.1f} cm keep, "
            "interpolated between those of the table.",
        )


def _clusters(report: Mapping[str, Any]) -> _Reasons:
    fragments, false = report["clusters"]["too_small"], report["clusters"]["false_person"]
    if fragments["mean"] - PAPER_CLUSTERS["too_small"] > 0.5:
        yield (
            "fragments",
            f"{_percent(fragments['one_window'])} of them have fewer points than two noise windows "
            f"must have (median {fragments['median_points']:.0f}): single windows that pass the "
            f"threshold. They are {_where(fragments)}.",
        )
    if false["mean"] > 0.0:
        yield (
            "false people",
            f"Clusters with the size of a person, {_where(false)}; median "
            f"{false['median_points']:.0f} points (people: "
            f"{report['clusters']['person']['median_points']:.0f}).",
        )


def _error(report: Mapping[str, Any]) -> _Reasons:
    people, cause = report["people"]["formation"], report["causes"]["error"]
    error = people["error_m"]["mean"]
    if error is not None and error > PAPER_ERROR_M and cause["along_m"] is not None:
        side = "before" if cause["along_m"] < 0 else "behind"
        yield (
            "mean error",
            f"It is a distance; per axis it is {100 * people['error_per_axis_m']:.1f} cm (which of "
            f"the two the paper means is not said). One robot alone puts people "
            f"{100 * abs(cause['along_m']):.1f} cm {side} their axis, "
            f"and {100 * cause['beside_m']:.1f} cm to a side.",
        )


def _rear_robots(report: Mapping[str, Any]) -> _Reasons:
    alone = [r for r in report["robots"] if len(r["robots"]) == 1 and r["robots"][0] in PAPER_SEEN]
    cause = report["causes"]["distance_of_rear_robots"]
    missed = sum((Counter(row["missed_as"]) for row in alone), Counter())
    if missed:
        became = ", ".join(f"{n} {_WORDS.get(kind, kind)}" for kind, n in missed.most_common())
        yield (
            "rear robots",
            f"They have {_mean(alone, 'in_view'):.1f} people in view (paper: 4), but find "
            f"{_mean(alone, 'found'):.1f}. What the others became: {became}. People are "
            f"{cause['from_m']:.1f} to {cause['to_m']:.1f} m from them, where the noise windows "
            "keep little (see noise).",
        )


def _architecture(report: Mapping[str, Any]) -> _Reasons:
    ours, theirs, scaled = report["architecture"].values()
    if theirs["false"] <= ours["false"]:
        frames = report["draws"] * report["frames"]
        counts = [round(way["false"] * frames) for way in (theirs, ours)]
        yield (
            "claim",
            f"Sharing raw clouds gives no more false people here ({counts[0]} against {counts[1]} "
            f"in {frames} frames); clusters: {theirs['clusters']:.1f} against "
            f"{ours['clusters']:.1f}. Poses are exact and the room has one piece of furniture; "
            "others were not tried.",
        )
    if theirs["recall"] < ours["recall"]:
        large = [way["missed_as"].get("too_large", 0) for way in (theirs, scaled)]
        yield (
            "recall of sharing first",
            f"Points of several robots add up in a noise window: the same threshold keeps "
            f"{_percent(theirs['noise_kept'])} of them instead of {_percent(ours['noise_kept'])}, "
            f"and {large[0]} people become part of clusters that are too large. With the "
            f"threshold times the number of robots ({_percent(scaled['noise_kept'])}) these are "
            f"{large[1]}.",
        )


_WORDS = {
    "nothing": "no cell left",
    "too_small": "too small",
    "too_low": "too low",
    "too_large": "too large (joined with what is near)",
    "displaced": "over 40 cm off",
}


def _percent(part: float) -> str:
    return f"{100 * part:.0f} %"


def _where(kind: Mapping[str, Any]) -> str:
    total = sum(kind["where"].values())
    names = {"other": "in the open", "wall": "at walls", "person": "at people"}
    parts = sorted(kind["where"].items(), key=lambda item: -item[1])
    return ", ".join(
        f"{_percent(n / total)} {names.get(place, f'at {place}')}" for place, n in parts
    )


def _mean(rows: Sequence[Mapping[str, Any]], key: str) -> float:
    return float(np.mean([row[key] for row in rows]))


def show(report: Mapping[str, Any], console: Console) -> None:
    """Prints the report as tables, and the reasons."""
    console.print(
        f"{report['config']}, {report['draws']} draws of each scene, {report['frames']} frames of "
        f"each; paper's figures beside ours\n",
        markup=False,
    )
    tables = (
        _stages_table,
        _points_table,
        _cells_table,
        _clusters_table,
        _robots_table,
        _ways_table,
        _trials_table,
        _poses_table,
    )
    for table in tables:
        console.print(table(report))
        console.print()
    console.print("why figures differ from the paper's", style="italic")
    for reason in report["reasons"]:
        console.print(f"- {reason['figure']}: {reason['why']}", markup=False)


def _stages_table(report: Mapping[str, Any]) -> Any:
    formation, single = report["retention"]["formation"], report["retention"]["single_person"]
    robots = [robot for robot in formation if robot != "all"]
    table = make_table(
        "kept of the stage before [%]", "stage", "paper", "ours", *robots, "one person at 2 m"
    )
    for stage, paper in PAPER_KEPT.items():
        ours = [formation["all"], *(formation[robot] for robot in robots), single["all"]]
        table.add_row(stage, f"{100 * paper:.0f}", *(f"{100 * kept[stage]:.1f}" for kept in ours))
    return table


def _points_table(report: Mapping[str, Any]) -> Any:
    table = make_table(
        "points of a view: pixels with a disparity, those in the working range, what stages leave",
        "robot",
        "ranged",
        "raw",
        *PAPER_KEPT,
        "removed of raw",
        "paper",
    )
    for scene, robots in report["points"].items():
        for robot, points in robots.items():
            paper = PAPER_REMOVED.get(robot) if scene == "formation" else None
            table.add_row(
                robot if scene == "formation" else "one person at 2 m",
                *(f"{count:.0f}" for count in points.values()),
                "-" if paper is None else f"over {paper}",
            )
    return table


def _cells_table(report: Mapping[str, Any]) -> Any:
    cells = report["cells"]
    sizes = [f"{100 * size:.0f} cm" for size in cells["cell_m"]]
    table = make_table(
        "kept by the last stage [%] against its cell size; paper: 7",
        "scene",
        *sizes,
    )
    for scene in report["retention"]:
        table.add_row(scene.replace("_", " "), *(f"{100 * kept:.1f}" for kept in cells[scene]))
    return table


def _clusters_table(report: Mapping[str, Any]) -> Any:
    table = make_table("clusters per interval, formation", "kind", "paper", "ours", "least", "most")
    words = {
        "person": "people",
        "false_person": "false people",
        "too_low": "furniture, too low",
        "too_small": "fragment, too small",
        "too_large": "too large",
        "all": "all",
    }
    for kind, count in report["clusters"].items():
        paper = PAPER_CLUSTERS.get(kind, sum(PAPER_CLUSTERS.values()))
        least_most = (str(count[key]) for key in ("min", "max"))
        table.add_row(words[kind], str(paper), f"{count['mean']:.1f}", *least_most)
    for scene, people in report["people"].items():
        table.add_row(
            f"mean error in cm, {scene.replace('_', ' ')}",
            f"{100 * PAPER_ERROR_M:.0f}" if scene == "formation" else "-",
            number(people["error_m"]["mean"], 100, 1),
        )
    return table


def _robots_table(report: Mapping[str, Any]) -> Any:
    table = make_table(
        "people of the formation (5) with every subset of the robots, per interval",
        "robots",
        "paper sees",
        "in view",
        "found",
        "recall",
        "false",
        "error [cm]",
    )
    everybody = len(report["robots"][-1]["robots"])
    for row in report["robots"]:
        robots = row["robots"]
        paper = PAPER_SEEN.get(robots[0]) if len(robots) == 1 else None
        if len(robots) == everybody:
            paper = PAPER_CLUSTERS["person"]
        table.add_row(
            " ".join(robots),
            "-" if paper is None else str(paper),
            *(f"{row[key]:.2f}" for key in ("in_view", "found", "recall", "false")),
            number(row["error_m"]["mean"], 100, 1),
        )
    return table


def _ways_table(report: Mapping[str, Any]) -> Any:
    ways = report["architecture"]
    rate = next(iter(ways.values()))["rate_hz"]
    table = make_table(
        f"who filters; all robots at {rate:g} Hz (paper: fewer false positives if robots do)",
        "way",
        "recall",
        "false",
        "clusters",
        "error [cm]",
        "kB/s",
        "planner [ms]",
    )
    for name, way in ways.items():
        table.add_row(
            name.replace("_then_", ", then ").replace("_scaled", ", th_n x robots"),
            *(f"{way[key]:.2f}" for key in ("recall", "false")),
            f"{way['clusters']:.1f}",
            number(way["error_m"]["mean"], 100, 1),
            f"{way['bytes_per_s'] / 1e3:.1f}",
            f"{way['planner_ms']['median']:.2f}",
        )
    return table


def _trials_table(report: Mapping[str, Any]) -> Any:
    table = make_table(
        "the formation with other values where the paper leaves a choice; shares in %",
        "trial",
        "pixels ranged",
        *PAPER_KEPT,
        "clusters",
        "recall",
        "false",
        "error [cm]",
    )
    for row in report["trials"]:
        table.add_row(
            row["trial"],
            *(f"{100 * row[key]:.1f}" for key in ("ranged", *PAPER_KEPT)),
            f"{row['clusters']:.1f}",
            *(f"{row[key]:.2f}" for key in ("recall", "false")),
            number(row["error_m"]["mean"], 100, 1),
        )
    return table


def _poses_table(report: Mapping[str, Any]) -> Any:
    rows = report["poses"]
    table = make_table(
        f"the formation with poses that are wrong, by {' and by '.join(rows[0]['methods'])}",
        "standard deviations",
        *["recall", "precision", "error [cm]"] * len(rows[0]["methods"]),
    )
    for row in rows:
        table.add_row(
            f"{100 * row['position_m']:.0f} cm, {row['heading_deg']:g} degrees",
            *(
                text
                for scores in row["methods"].values()
                for text in (
                    *("-" if scores[k] is None else f"{scores[k]:.2f}" for k in _SCORES),
                    number(scores["error_m"], 100, 1),
                )
            ),
        )
    return table


_SCORES = ("recall", "precision")

"""How well a team knows where it is, as Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mrs_people_sim.common import number
from mrs_studies.experiment.localization import RIGHT_M, SETTLED_M, Case
from mrs_studies.experiment.suite_report import table

#: The heading of what `mrs localization --out` replaces.
HEADING = "## Results"


def markdown(cases: Sequence[Case], reports: Sequence[Mapping[str, Any]]) -> str:
    """The results as tables.

    Args:
        cases: What was run.
        reports: `CaseScores.report` of each.
    """
    rows = list(zip((case.name for case in cases), reports, strict=True))
    lines = [
        HEADING,
        "",
        "### Poses",
        "",
        "Median and 95 % of the errors' magnitudes, in cm and degrees: of robots to each other, in "
        "the team's own frame, and in the map; relative also after the first "
        f"{SETTLED_M:.0f} m.",
        "",
        *_poses(rows),
        "",
        "### Odometry alone",
        "",
        *_odometry(rows),
        "",
        "### People",
        "",
        "Recall, precision and mean error in cm, in the team's own frame.",
        "",
        *_people(rows),
        "",
        "### What was noticed",
        "",
        f"Right again: no robot is more than {100 * RIGHT_M:.0f} cm from where it should be to "
        "another, for 2 s.",
        "",
        *_noticed(rows),
    ]
    return "\n".join(lines) + "\n"


_Rows = Sequence[tuple[str, Mapping[str, Any]]]


def _pair(errors: Mapping[str, float | None], factor: float, digits: int) -> str:
    return " / ".join(number(errors[key], factor, digits) for key in ("median", "p95"))


def _position_heading(errors: Mapping[str, Any]) -> tuple[str, str]:
    return _pair(errors["position_m"], 100, 1), _pair(errors["heading_deg"], 1, 2)


def _poses(rows: _Rows) -> list[str]:
    head = (
        "tour",
        "tours",
        "relative",
        "heading",
        f"relative after {SETTLED_M:.0f} m",
        "in the team",
        "heading",
        "along",
        "across",
        "in 3 sigma",
        "NEES",
    )
    lines = []
    for name, report in rows:
        poses = report["localized"]
        nees = poses["nees"]
        bounds = " to ".join(number(nees[key], 1, 2) for key in ("low", "high"))
        lines.append(
            [
                name,
                str(poses["runs"]),
                *_position_heading(poses["relative"]),
                _pair(report["settled"]["relative"]["position_m"], 100, 1),
                *_position_heading(poses["in_team"]),
                *(_pair(poses[key], 100, 1) for key in ("along_m", "across_m")),
                number(poses["along_in_3_sigma"], 1, 3),
                f"{number(nees['mean'], 1, 2)} ({bounds})",
            ]
        )
    return table(head, lines)


def _odometry(rows: _Rows) -> list[str]:
    lines = [
        [
            name,
            _pair(poses["relative"]["position_m"], 100, 0),
            _pair(poses["relative"]["heading_deg"], 1, 1),
            *(_pair(poses[key], 100, 0) for key in ("along_m", "across_m")),
        ]
        for name, poses in ((name, report["odometry"]) for name, report in rows)
    ]
    return table(("tour", "relative", "heading", "along", "across"), lines)


def _people(rows: _Rows) -> list[str]:
    lines = [
        [name, *(_scores(report["people"][way]) for way in ("exact", "localized", "odometry"))]
        for name, report in rows
    ]
    return table(("tour", "exact poses", "estimated poses", "odometry alone"), lines)


def _scores(people: Mapping[str, Any]) -> str:
    found = " / ".join(number(people[key], 1, 3) for key in ("recall", "precision"))
    return f"{found} / {number(people['error_m']['mean'], 100, 1)}"


def _noticed(rows: _Rows) -> list[str]:
    lines = []
    for name, report in rows:
        tours = report["localized"]["runs"]
        named = [
            f"{what} ({len(times)} of {tours}, after {np.median(times):.0f} s)"
            for what, times in sorted(report["named_s"].items())
        ]
        again = ["never" if s is None else f"{s:.1f} s" for s in report["right_again_s"]]
        if named or again:
            lines.append([name, ", ".join(named) or "-", ", ".join(again) or "-"])
    return table(("tour", "named", "right again after"), lines)

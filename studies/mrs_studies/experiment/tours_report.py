"""How well a team guides groups, as Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from mrs_people_sim.common import number
from mrs_studies.experiment.suite_report import table
from mrs_studies.experiment.tours import FORMED_M, WAITS_M, Case

#: The heading of what `mrs guiding --out` replaces.
HEADING = "## Results"

#: Events of every tour.
_USUAL = ("the tour", "sets off", "everybody is at", "goes on from", "goes on after")

_Report = Mapping[str, Any]
_Rows = Sequence[tuple[str, _Report]]


def markdown(cases: Sequence[Case], reports: Sequence[_Report]) -> str:
    """The results as tables.

    Args:
        cases: What was run.
        reports: `CaseScores.report` of each.
    """
    rows = list(zip((case.name for case in cases), reports, strict=True))
    lines = [
        HEADING,
        "",
        "### Tours",
        "",
        *table(
            ("tour", "finished", "time [s]", "people lost", "seen", "least seen", "detected",
             "stragglers", "fetched", "waited for", "behind [s]", "alone [s]", "spread [m]"),
            [_tour(name, report) for name, report in rows],
        ),
        "",
        "Seen: found by `tracked_people` within 0.5 m; detected: without those who are only "
        "predicted. Waited for: nobody fetched them, but the group stayed within "
        f"{WAITS_M:g} m. Spread: of the people about their middle, a root mean square.",
        "",
        "### Robots",
        "",
        *table(
            ("tour", "off the post [m]", "nearest person [m]", "within 0.50 m [s]",
             "within 0.45 m by own motion [s]", "longest [s]", "path [m]", "contacts",
             "by own motion", "bumps", "stand-offs [s]", "changes of leader"),
            [_robots(name, report) for name, report in rows],
        ),
        "",
        "Stand-offs: robots, added up, that had not got on for 3 s beside a person, although their "
        "posts were elsewhere.",
    ]  # fmt: skip
    failures = [_failure(name, report) for name, report in rows if _has_failures(report)]
    if failures:
        lines += [
            "",
            "### Failures",
            "",
            "Seconds after a robot was killed until the others have posts without it; until all "
            f"but the successor of a leader are within {FORMED_M:g} m of these, and until all are: "
            "a successor has to pass the group first. Seconds after the planner was gone until all "
            "robots stand. Median and worst.",
            "",
            *table(
                ("tour", "tours", "new posts", "others there", "all there", "standing"), failures
            ),
        ]
    met = [_bystanders(name, report) for name, report in rows if _has_met(report)]
    if met:
        lines += ["", "### Bystanders", "", *table(("tour", "nearest bystander [m]"), met)]
    lines += [
        "",
        "### Events",
        "",
        "What the guide said, how often in all tours of a row.",
        "",
        *table(("tour", "events"), [_events(name, report) for name, report in rows]),
    ]
    return "\n".join(lines) + "\n"


def _has_met(report: _Report) -> bool:
    return report["tour"]["bystander_m"] is not None


def _bystanders(name: str, report: _Report) -> list[str]:
    return [name, number(report["tour"]["bystander_m"], 1, 2)]


def _events(name: str, report: _Report) -> list[str]:
    """What happened besides what happens on every tour."""
    told = {event: count for event, count in report["events"].items() if not _is_usual(event)}
    return [name, "; ".join(f"{event}: {count}" for event, count in told.items()) or "-"]


def _is_usual(event: str) -> bool:
    return event.startswith(_USUAL)


def _tour(name: str, report: _Report) -> list[str]:
    tour, stragglers = report["tour"], report["stragglers"]
    return [
        name,
        f"{tour['finished']} of {tour['tours']}",
        number(tour["time_s"], 1, 0),
        f"{tour['lost']} of {tour['people']}",
        number(tour["seen"]["mean"], 1, 3),
        number(tour["seen"]["min"], 1, 2),
        number(tour["seen"]["detected"], 1, 3),
        *(str(stragglers[key]) for key in ("stopped", "fetched", "waited_for")),
        number(tour["stragglers"]["behind_s"], 1, 0),
        number(tour["stragglers"]["alone_s"], 1, 0),
        number(tour["spread_m"], 1, 2),
    ]


def _robots(name: str, report: _Report) -> list[str]:
    tour = report["tour"]
    off = tour["formation_m"]
    return [
        name,
        f"{number(off['median'], 1, 2)} / {number(off['p95'], 1, 2)}",
        number(tour["distance_m"], 1, 2),
        number(tour["within_0_50_m_s"], 1, 1),
        number(tour["within_0_45_m_by_own_motion_s"], 1, 1),
        number(tour["longest_by_own_motion_s"], 1, 1),
        number(tour["path_m"], 1, 0),
        str(tour["contacts"]),
        str(tour["contacts_by_own_motion"]),
        str(report["bumps"]),
        number(tour["stood_off_s"], 1, 0),
        str(tour["leaders"]),
    ]


def _has_failures(report: _Report) -> bool:
    return bool(report["reposted_s"] or report["stood_s"])


def _failure(name: str, report: _Report) -> list[str]:
    return [
        name,
        str(report["tour"]["tours"]),
        *(_seconds(report[key]) for key in ("reposted_s", "others_s", "formed_s")),
        _seconds(report["stood_s"], digits=2),
    ]


def _seconds(values: Sequence[float | None], digits: int = 1) -> str:
    """Median and worst of times; `never` where one has no end."""
    if not values:
        return "-"
    known = [value for value in values if value is not None]
    worst = "never" if len(known) < len(values) else f"{max(known):.{digits}f}"
    return f"{np.median(known):.{digits}f} / {worst}" if known else worst

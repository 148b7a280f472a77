"""Results of the suite as Markdown."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from mrs_people_sim.common import number
from mrs_studies.experiment.suite_steps import GROUP, KINDS, SHORT, Row

_HEAD = ("recall", "precision", "mean [cm]", "p95 [cm]", "in 95 %")
_TRACKS_HEAD = ("MOTA", "IDF1", "velocity [m/s]", "switches", "per person and minute")


def _figures(people: Mapping[str, Any]) -> list[str]:
    error = people["error_m"]
    return [
        number(people["recall"], 1, 3),
        number(people["precision"], 1, 3),
        number(error["mean"], 100, 1),
        number(error["p95"], 100, 1),
        number(people["coverage_95"], 1, 3),
    ]


def _track_figures(tracks: Mapping[str, Any]) -> list[str]:
    return [
        number(tracks["mota"], 1, 3),
        number(tracks["idf1"], 1, 3),
        number(tracks["velocity_error_mps"]["mean"], 1, 2),
        number(tracks["id_switches"], 1, 0),
        number(tracks["switches_per_person_minute"], 1, 2),
    ]


def _stragglers(found: Mapping[str, Any]) -> str:
    """A sentence on the stragglers; "" if there are no groups in the truth."""
    if found["minutes"] is None:
        return ""
    in_time = round((found["within_1_s"] or 0.0) * found["true"])
    delay = found["delay_s"]
    took = "" if not found["flagged"] else (
        f", after {number(delay['mean'], 1, 2)} s on average and {number(delay['max'], 1, 2)} s "
        "at most"
    )  # fmt: skip
    minutes = number(found["minutes"], 1, 1)
    return (
        f"Stragglers of the walking groups: {found['flagged']} of {found['true']} flagged, "
        f"{in_time} of them within 1 s of crossing the limit{took}; "
        f"{found['false']} false flags in {minutes} minutes."
    )


def markdown(rows: Sequence[Row], half: str) -> str:
    """The results as tables in Markdown.

    Args:
        rows: The steps, that of `paper.yaml` first and that of `default.yaml` last.
        half: Name of the half of the suite.
    """
    first, last = rows[0], rows[-1]
    there = {first.kinds[name] for name in first.results}
    kinds = [kind for kind in KINDS if kind in SHORT or kind in there]
    lines = [
        f"## Results on the {half} half",
        "",
        *_people_of_kinds(first, last, kinds),
        "",
        "## Half-hidden people",
        "",
        "With default.yaml; recall by how much of a person the view shows that shows most of them.",
        "",
        *_by_visibility(last, kinds),
        "",
        "## Tracks",
        "",
        "With default.yaml; velocity, and the groups' centre, are mean errors.",
        "",
        *_tracks_of_kinds(last, kinds),
    ]
    if sentence := _stragglers(last.stragglers(GROUP)):
        lines += ["", sentence]
    if len(rows) > 2:
        lines += [
            "",
            "## What each step gives",
            "",
            "Each step keeps those above it. Without the walking groups.",
            "",
            *table(("step", *_HEAD), [[row.name, *_figures(row.report())] for row in rows]),
        ]
    lines += [
        "",
        "## Scene by scene",
        "",
        "With default.yaml; in brackets with paper.yaml.",
        "",
        *_scenes(first, last),
    ]
    return "\n".join(lines) + "\n"


def _people_of_kinds(first: Row, last: Row, kinds: Sequence[str]) -> list[str]:
    """People with paper.yaml and default.yaml, over all short scenes and over each kind."""
    return table(
        ("", "people", *_HEAD),
        [
            [f"{file}{label}", str(report["true"]), *_figures(report)]
            for row, file in ((first, "paper.yaml"), (last, "default.yaml"))
            for label, chosen in (("", ()), *((f", {kind}", (kind,)) for kind in kinds))
            for report in (row.report(*chosen),)
        ],
    )


def _by_visibility(last: Row, kinds: Sequence[str]) -> list[str]:
    """Recall by how much of people is visible, over all short scenes and over each kind."""
    lines = []
    for label, chosen in (("standing and walking", ()), *((k, (k,)) for k in kinds)):
        parts = last.report(*chosen)["by_visibility"].values()
        cells = [(str(part["true"]), number(part["recall"], 1, 3)) for part in parts]
        lines.append([label, *(cell for pair in cells for cell in pair)])
    return table(("", "< 50 %", "recall", "< 75 %", "recall", "more", "recall"), lines)


def _tracks_of_kinds(last: Row, kinds: Sequence[str]) -> list[str]:
    return table(
        ("", *_TRACKS_HEAD, "centre [cm]"),
        [
            [label, *_track_figures(last.tracks(*chosen)), number(last.centre(*chosen), 100, 1)]
            for label, chosen in (("standing and walking", ()), *((k, (k,)) for k in kinds))
        ],
    )


def _scenes(first: Row, last: Row) -> list[str]:
    """Each scene with default.yaml, and in brackets with paper.yaml."""
    lines = []
    for name, result in last.results.items():
        people, before = (one.report()["people"] for one in (result, first.results[name]))
        both = zip(_figures(people), _figures(before), strict=True)
        figures = [f"{new} ({old})" for new, old in both]
        tracks = _track_figures(result.tracks.report())[:-1]
        lines.append([name, str(people["true"]), *figures, *tracks])
    return table(("scene", "people", *_HEAD, *_TRACKS_HEAD[:-1]), lines)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    """Lines of a table in Markdown; all columns but the first are numbers."""
    bar = "|---" + "|---:" * (len(head) - 1) + "|"
    return [f"| {' | '.join(head)} |", bar, *(f"| {' | '.join(row)} |" for row in rows)]

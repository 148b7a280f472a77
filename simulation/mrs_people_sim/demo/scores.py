"""Prints the scores and events of a team that was replayed."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from mrs_people_loc.errors import PeopleLocError
from mrs_people_sim.estimates import read_estimate
from mrs_people_sim.figures.plots import TopView
from mrs_people_sim.scoring.positions import MATCH_DISTANCE, Frame, score, summary
from mrs_people_sim.scoring.tracks import score_tracks
from mrs_tools.bags.records import Estimate, Truth
from mrs_tools.bags.truth import TRUTH_TOPIC
from mrs_tools.common import make_table
from mrs_tools.plain import plain

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table

#: If more than this share of the frames has no result, the machine is reported to be too slow.
_FEW = 0.05


def print_scores(people: list[Any], truth: Truth, console: Console) -> None:
    """Prints how many people were found and followed, and how far off.

    Args:
        people: The `tracked_people` messages, by stamp.
        truth: What is true.
        console: Where to.

    Raises:
        PeopleLocError: Nobody was found.
    """
    if not len(truth):
        console.print(f"the bag has no {TRUTH_TOPIC}: nothing to compare with")
        return
    estimates = [read_estimate(message) for message in people]
    frames = score(truth, estimates)
    console.print(_people_table(frames, estimates))
    report = summary(frames)["people"]
    if not report["matched"]:
        raise PeopleLocError(f"none of {report['true']} people was found")
    console.print(
        f"found {report['matched']} of {report['true']} people in {len(frames)} frames of the "
        f"ground truth, {report['estimates'] - report['matched']} false;\nmean error "
        f"{100 * report['error_m']['mean']:.1f} cm (a match is within {MATCH_DISTANCE:.2f} m)"
    )
    late = sum(frame.estimate is None for frame in frames)
    if late > _FEW * len(frames):
        console.print(
            f"the machine was too busy for {late} frames; --rate 0.5 gives it more time",
            style="yellow",
        )
    tracks = score_tracks(truth, frames, estimates).report()
    if tracks["id_switches"] is not None:
        speed = tracks["velocity_error_mps"]["mean"]
        console.print(
            f"followed: {tracks['id_switches']} id switches, MOTA {tracks['mota']:.3f}, "
            f"IDF1 {tracks['idf1']:.3f}"
            + ("" if speed is None else f";\nmean error of velocity {speed:.2f} m/s")
        )


def _people_table(frames: Sequence[Frame], estimates: Sequence[Estimate]) -> Table:
    """Each true person with the ids that they had, how often they were found and how far off."""
    errors: defaultdict[int, list[float]] = defaultdict(list)
    ids: defaultdict[int, list[int]] = defaultdict(list)
    expected: Counter[int] = Counter()
    for frame in frames:
        expected.update(np.flatnonzero(frame.required).tolist())
        for (found, which), distance in zip(frame.pairs, frame.errors, strict=True):
            assert frame.estimate is not None
            errors[int(which)].append(float(distance))
            one = int(estimates[frame.estimate].ids[found])
            if one and one not in ids[int(which)]:
                ids[int(which)].append(one)
    columns = ("person", "id", "found / expected", "mean error", "max error")
    table = make_table("against the ground truth", *columns)
    for index, count in sorted(expected.items()):
        own = errors[index]
        mean = f"{100 * np.mean(own):.1f} cm" if own else "-"
        most = f"{100 * max(own):.1f} cm" if own else "-"
        names = ", ".join(map(str, ids[index])) or "-"
        table.add_row(str(index + 1), names, f"{len(own)} / {count}", mean, most)
    return table


def print_events(views: Sequence[TopView], console: Console) -> None:
    """Prints what has happened to the groups."""
    for view in views:
        at_s = (view.stamp_ns - views[0].stamp_ns) / 1e9
        for event in view.events:
            console.print(f"after {at_s:4.1f} s: {plain(event)}", markup=False)

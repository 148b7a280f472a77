"""Scores of people over several recordings, also with a subset of the robots."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.planner import People, Planner
from mrs_people_sim.scoring.positions import MATCH_DISTANCE, Frame, ratio, summary
from mrs_studies.experiment.cluster_kinds import kinds_in, places_of
from mrs_studies.experiment.recording import Recording


def subsets(names: Sequence[str]) -> list[tuple[str, ...]]:
    """All subsets but the empty one, small ones first."""
    return [s for n in range(1, len(names) + 1) for s in itertools.combinations(names, n)]


def people_of(recording: Recording, robots: Sequence[str]) -> list[People]:
    """What the planner finds with the scans of some of the robots."""
    planner, found = Planner(recording.team.planner.memoryless()), []
    for interval in recording.intervals:
        scans = [scan for scan in interval.scans if scan.robot in robots]
        if scans:
            time_ns = max(scan.stamp_ns for scan in scans)
            found.append(planner.step(scans, interval.people.poses, time_ns))
    return found


@dataclass
class Tally:
    """Scores of several recordings.

    Attributes:
        frames: All frames.
        offsets: Found minus true positions [m], each of shape (2,).
        in_view: People who were in view, summed over the frames.
        found_in_view: Those of them who were found.
        missed_as: What the others became, see `remains_of`.
        false_at: Where people were found who are none, see `places_of`.
    """

    frames: list[Frame] = field(default_factory=list)
    offsets: list[Float] = field(default_factory=list)
    in_view: int = 0
    found_in_view: int = 0
    missed_as: Counter[str] = field(default_factory=Counter)
    false_at: Counter[str] = field(default_factory=Counter)

    def add(self, recording: Recording, people: Sequence[People], robots: Sequence[str]) -> None:
        """Takes what was found in a recording, with some of the robots."""
        for index, frame in enumerate(recording.score(people)):
            self.frames.append(frame)
            seen = recording.in_view(robots, index) & frame.required
            self.in_view += int(seen.sum())
            self.found_in_view += int(seen[frame.pairs[:, 1]].sum())
            if frame.estimate is None:
                continue
            found = people[frame.estimate]
            at = np.array([person.position for person in found.persons]).reshape(-1, 2)
            self.offsets += [*(at[frame.pairs[:, 0]] - frame.true[frame.pairs[:, 1]])]
            self.false_at.update(
                places_of(at[frame.false], frame.true, recording.draw.scene).tolist()
            )
            missed = [j for j in frame.missed if seen[j]]
            self.missed_as.update(remains_of(found, frame, missed, recording.team.planner))

    def report(self) -> dict[str, Any]:
        """Means per frame, and errors [m]."""
        scores, count = summary(self.frames)["people"], len(self.frames)
        axes = np.abs(np.array(self.offsets).reshape(-1, 2))
        return {
            "in_view": self.in_view / count,
            "found": scores["matched"] / count,
            "recall": scores["recall"],
            "recall_in_view": ratio(self.found_in_view, self.in_view),
            "false": (scores["estimates"] - scores["matched"]) / count,
            "precision": scores["precision"],
            "error_m": scores["error_m"],
            "error_per_axis_m": float(axes.mean()) if len(axes) else None,
            "missed_as": dict(sorted(self.missed_as.items())),
            "false_at": dict(sorted(self.false_at.items())),
        }


def remains_of(
    found: People, frame: Frame, missed: Sequence[int], config: PlannerConfig
) -> Iterator[str]:
    """What people who were not found became.

    That is the kind of the cluster with most of the points within `MATCH_DISTANCE`; `nothing`:
    there are none; `displaced`: it is human-sized, but too far off or somebody else.
    """
    kinds = kinds_in(found, frame, config)
    for j in missed:
        near = np.linalg.norm(found.fused.xy - frame.true[j], axis=1) <= MATCH_DISTANCE
        if not near.any():
            yield "nothing"
            continue
        points = np.bincount(found.clusters.label[near], found.fused.cells.count[near])
        kind = kinds[int(points.argmax())]
        yield "displaced" if "person" in kind else kind


def recall_of_subsets(recordings: Sequence[Recording]) -> list[dict[str, Any]]:
    """Who is found with every subset of the robots, against all people."""
    names = sorted(recordings[0].team.robots)
    rows = []
    for robots in subsets(names):
        tally = Tally()
        for recording in recordings:
            tally.add(recording, people_of(recording, robots), robots)
        rows.append({"robots": [*robots], **tally.report()})
    return rows


def team_tally(recordings: Sequence[Recording]) -> dict[str, Any]:
    """The report of a `Tally` over recordings, with all robots."""
    tally = Tally()
    for recording in recordings:
        people = [interval.people for interval in recording.intervals]
        tally.add(recording, people, sorted(recording.team.robots))
    return tally.report()

"""What the stages keep of the points."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Sequence

import numpy as np

from mrs_people_loc.cells import filters
from mrs_people_sim.evaluation.results import Result
from mrs_people_sim.paper import PAPER_STAGES
from mrs_studies.experiment.recording import Recording


def retention(recordings: Sequence[Recording]) -> dict[str, dict[str, float]]:
    """What each stage keeps of the one before: of all robots together, and of each."""
    pooled = Result.pooled([recording.result for recording in recordings])
    pooled.counts["all"] = [row for rows in list(pooled.counts.values()) for row in rows]
    return {
        robot: {stage: means[f"{left}_kept"] for stage, left in PAPER_STAGES.items()}
        for robot, means in pooled.report()["stages"].items()
    }


def points_of(recordings: Sequence[Recording]) -> dict[str, dict[str, float]]:
    """By robot, of a view: pixels with a disparity, points that stages leave, what they remove."""
    pooled = Result.pooled([recording.result for recording in recordings])
    pixels: defaultdict[str, list[int]] = defaultdict(list)
    for recording in recordings:
        for view, _ in recording.views():
            pixels[view.robot].append(int(np.isfinite(view.stages.disparity).sum()))
    return {
        robot: {
            "ranged": float(np.mean(pixels[robot])),
            "raw": means["raw"],
            **{stage: means[left] for stage, left in PAPER_STAGES.items()},
            "removed": means["removed"],
        }
        for robot, means in pooled.report()["stages"].items()
    }


def retention_of_cells(recordings: Sequence[Recording], sizes: Sequence[float]) -> list[float]:
    """What the last stage keeps with cells of some sizes [m]."""
    clouds = [view.stages.foreground for recording in recordings for view, _ in recording.views()]
    points = sum(map(len, clouds))
    return [
        sum(len(filters.quantize(cloud, cell=size)) for cloud in clouds) / points for size in sizes
    ]

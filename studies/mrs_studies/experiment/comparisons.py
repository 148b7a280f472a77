"""Other architectures, parameters and poses on the same recordings."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from mrs_people_loc import timing
from mrs_people_loc.arrays import Float
from mrs_people_loc.geometry import wrap_angle
from mrs_people_loc.planner import People, Planner
from mrs_people_loc.team.poses import Pose
from mrs_people_sim.common import write_text
from mrs_people_sim.scoring.positions import Frame, percentile, ratio, summary
from mrs_studies.experiment.draws import Draw
from mrs_studies.experiment.recording import Recording
from mrs_studies.experiment.stages import retention
from mrs_studies.experiment.tally import Tally, team_tally
from mrs_studies.experiment.ways import WAYS, size_on_wire

#: Where the paper leaves a choice: parameters of the robots, by what they are called here.
TRIALS: Mapping[str, Mapping[str, Any]] = {
    "as printed": {},
    "th_n 15": {"noise": {"min_points": 15}},
    "edge mask 11 px": {
        "disparity": {"pre_filter": "normalized_response", "pre_filter_size_px": 11}
    },
}
#: Standard deviations of a robot's position on each axis [m] and of its heading [degrees].
POSE_ERRORS = ((0.0, 0.0), (0.05, 1.0), (0.10, 2.0), (0.20, 4.0), (0.30, 6.0))
#: The planner's work is timed so many times; the best counts: what else the machine does slows it.
_REPEATS = 5
#: Wrong poses are drawn so many times for each recording.
_POSE_DRAWS = 5


def compare_architectures(recordings: Sequence[Recording]) -> dict[str, dict[str, Any]]:
    """Filter, then share against share, then filter, on the same images."""
    reports = {}
    rate = recordings[0].draw.scene.timing.rate
    for name, make in WAYS.items():
        tally, sizes, times_ms, clusters = Tally(), [], [], []
        before = after = 0
        for recording in recordings:
            way, found = make(recording.team), []
            for interval in recording.intervals:
                sent = {robot: way.send(view) for robot, view in interval.views.items()}
                sizes.append(sum(map(size_on_wire, sent.values())))
                best_ms = math.inf
                for _ in range(_REPEATS):
                    begin_ns = timing.now_ns()
                    people = way.plan(sent, interval.people.poses, interval.people.stamp_ns)
                    best_ms = min(best_ms, (timing.now_ns() - begin_ns) / 1e6)
                times_ms.append(best_ms)
                found.append(people)
                clusters.append(len(people.clusters))
            before, after = before + way.zones, after + way.noise
            tally.add(recording, found, sorted(recording.team.robots))
        reports[name] = {
            **{key: value for key, value in tally.report().items() if "in_view" not in key},
            "clusters": float(np.mean(clusters)),
            "noise_kept": ratio(after, before),
            "bytes_per_frame": float(np.mean(sizes)),
            "rate_hz": rate,
            "bytes_per_s": float(np.mean(sizes)) * rate,
            "planner_ms": {"median": percentile(times_ms, 50), "p99": percentile(times_ms, 99)},
        }
    return reports


def try_values(draws: Sequence[Draw], config: Path, folder: Path) -> list[dict[str, Any]]:
    """Runs draws with each of `TRIALS`.

    Args:
        draws: Of the formation.
        config: The method.
        folder: Where a parameter file of each trial goes.

    Returns:
        Of each trial its name (`trial`), the share of pixels with a disparity (`ranged`), what the
        stages keep, clusters per interval, and how people are found.
    """
    rows = []
    for name, parameters in TRIALS.items():
        file = folder / f"{name.replace(' ', '_')}.yaml"
        text = {"/**/robot_node": {"ros__parameters": dict(parameters)}}
        write_text(file, json.dumps(text) + "\n")  # JSON is YAML
        recordings = [Recording.of(one, config, file) for one in draws]
        valid = [row[0] for r in recordings for views in r.result.counts.values() for row in views]
        clusters = [len(i.people.clusters) for r in recordings for i in r.intervals]
        rows.append(
            {
                "trial": name,
                "ranged": float(np.mean(valid)),
                **retention(recordings)["all"],
                "clusters": float(np.mean(clusters)),
                **team_tally(recordings),
            }
        )
    return rows


def misplaced(pose: Pose, error: Float, sigmas: Float) -> Pose:
    """A pose that is wrong, with the covariance of what it is wrong by.

    Args:
        pose: The true one.
        error: By how much, x, y, yaw [m, m, rad], shape (3,).
        sigmas: Standard deviations of that, shape (3,).
    """
    x, y, yaw = error.tolist()
    return dataclasses.replace(
        pose,
        x=pose.x + x,
        y=pose.y + y,
        yaw=wrap_angle(pose.yaw + yaw),
        covariance=pose.covariance + np.diag(sigmas**2),
    )


def compare_poses(methods: Mapping[str, Sequence[Recording]]) -> list[dict[str, Any]]:
    """People with wrong poses: each robot's is wrong by the same all through a recording.

    Errors are normal and the planner is told their covariance. They are drawn `_POSE_DRAWS` times
    for each recording, the same for all methods, and grow from row to row in one direction.

    Args:
        methods: By the name of a method what it made of the same draws.

    Returns:
        For each of `POSE_ERRORS` the standard deviations `position_m` and `heading_deg`, and by
        method the recall, precision and mean error [m].
    """
    rows = []
    for position_m, heading_deg in POSE_ERRORS:
        sigmas = np.array([position_m, position_m, math.radians(heading_deg)])
        row: dict[str, Any] = {"position_m": position_m, "heading_deg": heading_deg, "methods": {}}
        for name, recordings in methods.items():
            frames: list[Frame] = []
            for recording in recordings:
                rng = np.random.default_rng(recording.draw.scene.seed)
                for _ in range(_POSE_DRAWS):
                    errors = {
                        robot: sigmas * rng.standard_normal(3)
                        for robot in sorted(recording.team.robots)
                    }
                    frames += recording.score(_with_poses(recording, errors, sigmas))
            scores = summary(frames)["people"]
            row["methods"][name] = {
                "recall": scores["recall"],
                "precision": scores["precision"],
                "error_m": scores["error_m"]["mean"],
            }
        rows.append(row)
    return rows


def _with_poses(recording: Recording, errors: Mapping[str, Float], sigmas: Float) -> list[People]:
    planner = Planner(recording.team.planner.memoryless())
    return [
        planner.step(
            interval.scans,
            {
                robot: misplaced(pose, errors[robot], sigmas)
                for robot, pose in interval.people.poses.items()
            },
            interval.people.stamp_ns,
        )
        for interval in recording.intervals
    ]

"""Measurements that explain differences from the paper's figures."""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Sequence
from typing import Any

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.team.fusion import map_from_robot
from mrs_people_sim.scoring.positions import ratio
from mrs_studies.experiment.cluster_kinds import places_of
from mrs_studies.experiment.recording import Recording
from mrs_studies.experiment.tally import people_of

#: Bands of the distance from a robot [m].
BANDS = (1.0, 2.0, 3.0, 4.0, 5.0)


def zone_causes(recordings: Sequence[Recording]) -> dict[str, Any]:
    """Where the points between knees and shoulders are, and what else was ranged.

    Returns:
        `low`, `high`: shares of the raw points under and over the zone; `where`: shares of the
        points in it by `places_of`; `of_all_pixels`: what the zone keeps if every pixel with a
        disparity counts as raw, also beyond the working range.
    """
    low = high = raw = zones = pixels = 0
    where: Counter[str] = Counter()
    for recording in recordings:
        people = recording.truth.positions[0]
        for view, pose in recording.views():
            stages, limits = view.stages, recording.team.robots[view.robot].zones
            height = stages.cloud[:, 2]
            low += int((height < np.float32(limits.low)).sum())
            high += int((height > np.float32(limits.high)).sum())
            raw, zones = raw + len(height), zones + len(stages.cropped)
            pixels += int(np.isfinite(stages.disparity).sum())
            xy = map_from_robot(stages.cropped[:, :2].astype(np.float64), pose)
            where.update(places_of(xy, people, recording.draw.scene).tolist())
    return {
        "low": low / raw,
        "high": high / raw,
        "of_all_pixels": zones / pixels,
        "where": {place: count / zones for place, count in sorted(where.items())},
    }


def noise_causes(recordings: Sequence[Recording]) -> list[dict[str, Any]]:
    """What the noise windows keep of points in bands of the distance from their robot."""
    edges = np.array(BANDS)
    before, after = np.zeros((2, len(edges) - 1))
    for recording in recordings:
        for view, _ in recording.views():
            for counts, points in ((before, view.stages.cropped), (after, view.stages.foreground)):
                counts += np.histogram(np.hypot(points[:, 0], points[:, 1]), edges)[0]
    return [
        {"from_m": begin, "to_m": end, "points": int(n), "kept": ratio(float(m), float(n))}
        for (begin, end), n, m in zip(itertools.pairwise(BANDS), before, after, strict=True)
    ]


def along_sight(offset: Float, sight: Float) -> tuple[float, float]:
    """An offset [m], shape (2,), along a line of sight and to its left."""
    x, y = sight / np.linalg.norm(sight)
    return float(offset @ (x, y)), float(offset @ (-y, x))


def error_causes(recordings: Sequence[Recording]) -> dict[str, float | None]:
    """Where one robot alone puts people: behind (+) or before (-) their axis, and beside it [m].

    None if it finds nobody.
    """
    along: list[float] = []
    beside: list[float] = []
    for recording in recordings:
        for robot in recording.team.robots:
            people = people_of(recording, [robot])
            for frame in recording.score(people):
                if frame.estimate is None:
                    continue
                found = people[frame.estimate]
                pose = found.poses[robot]
                for i, j in frame.pairs:
                    offset = found.persons[i].position - frame.true[j]
                    one, other = along_sight(offset, frame.true[j] - (pose.x, pose.y))
                    along.append(one)
                    beside.append(abs(other))
    return {
        "along_m": ratio(sum(along), len(along)),
        "beside_m": ratio(sum(beside), len(beside)),
    }


def distances(recordings: Sequence[Recording], robots: Sequence[str]) -> dict[str, float]:
    """From robots to the people in their view: least and greatest [m]."""
    away: list[float] = []
    for recording in recordings:
        scene, people = recording.draw.scene, recording.truth.positions[0]
        for name in robots:
            place = (scene.robots[name].x, scene.robots[name].y)
            seen = recording.in_view([name], 0)
            away += np.linalg.norm(people[seen] - place, axis=1).tolist()
    return {"from_m": min(away), "to_m": max(away)}

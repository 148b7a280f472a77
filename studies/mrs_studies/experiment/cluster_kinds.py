"""Clusters by kind, and what stands where they are."""

from __future__ import annotations

from collections import Counter, defaultdict
from collections.abc import Sequence
from typing import Any

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.clusters import Clusters
from mrs_people_loc.config import Human, PlannerConfig
from mrs_people_loc.planner import People
from mrs_people_sim.models.rooms import footprint
from mrs_people_sim.paper import PAPER_CLUSTERS
from mrs_people_sim.scene import Scene
from mrs_people_sim.scoring.positions import MATCH_DISTANCE, Frame, ratio
from mrs_studies.experiment.recording import Recording

#: Points this near belong to a wall or to a piece of furniture [m].
_BESIDE = 0.4


def kinds_of(
    clusters: Clusters, human: Human, people: Sequence[int], true: Sequence[int]
) -> list[str]:
    """What each cluster is, by the size test: a key of `PAPER_CLUSTERS`.

    A cluster that fails in several ways is too small before it is too low: a fragment of noise is
    often both, furniture has many points.

    Args:
        clusters: The clusters.
        human: The limits.
        people: Labels of those that pass the test.
        true: Labels of those of them that are people.
    """
    kinds = []
    for label in range(len(clusters)):
        if label in people:
            kinds.append("person" if label in true else "false_person")
        elif clusters.points[label] < human.min_points or clusters.width[label] < human.min_width:
            kinds.append("too_small")
        elif clusters.height[label] < human.min_height:
            kinds.append("too_low")
        else:
            kinds.append("too_large")
    return kinds


def places_of(xy: Float, people: Float, scene: Scene) -> np.ndarray:
    """What stands nearest to where points are: person, furniture, wall or other.

    Args:
        xy: Points in the map [m], shape (n, 2).
        people: Where the people are [m], shape (m, 2).
        scene: The scene.

    Returns:
        Names, shape (n,).
    """

    def near(places: Float, reach: float | Float) -> np.ndarray:
        away = np.linalg.norm(xy[:, np.newaxis] - places[np.newaxis], axis=2)
        return (away <= reach).any(axis=1)

    pieces = np.array([footprint(piece) for piece in scene.furniture]).reshape(-1, 3)
    to_wall = np.minimum(xy, (scene.room.length, scene.room.width) - xy).min(axis=1)
    return np.select(
        [near(people, MATCH_DISTANCE), near(pieces[:, :2], pieces[:, 2]), to_wall <= _BESIDE],
        ["person", "furniture", "wall"],
        "other",
    )


def count_clusters(recordings: Sequence[Recording]) -> dict[str, Any]:
    """Clusters per interval by kind.

    Returns:
        By kind (`all`: all of them) `mean`, `min` and `max` per interval; `where` they are, in
        all; the median of their points; and how many have points of one noise window only, that
        is less than twice its threshold.
    """
    rows: list[Counter[str]] = []
    where: defaultdict[str, Counter[str]] = defaultdict(Counter)
    points: defaultdict[str, list[int]] = defaultdict(list)
    least = max(c.noise.min_points for r in recordings for c in r.team.robots.values())
    for recording in recordings:
        for frame in recording.result.frames:
            if frame.estimate is None:
                continue
            people = recording.intervals[frame.estimate].people
            kinds = kinds_in(people, frame, recording.team.planner)
            rows.append(Counter(kinds))
            places = places_of(people.clusters.centroid, frame.true, recording.draw.scene)
            for kind, place, count in zip(kinds, places, people.clusters.points, strict=True):
                where[kind][str(place)] += 1
                points[kind].append(int(count))
    names = [*PAPER_CLUSTERS]
    numbers = {kind: [row[kind] for row in rows] for kind in names}
    numbers["all"] = [sum(row.values()) for row in rows]
    return {
        kind: {
            "mean": float(np.mean(counts)),
            "min": min(counts),
            "max": max(counts),
            "where": dict(sorted(where[kind].items())),
            "median_points": float(np.median(points[kind])) if points[kind] else None,
            "one_window": ratio(sum(n < 2 * least for n in points[kind]), len(points[kind])),
        }
        for kind, counts in numbers.items()
    }


def kinds_in(people: People, frame: Frame, config: PlannerConfig) -> list[str]:
    """The kind of each cluster of an interval, see `kinds_of`."""
    labels = [person.label for person in people.persons]
    true = [labels[index] for index in (*frame.pairs[:, 0], *frame.ignored)]
    return kinds_of(people.clusters, config.human, labels, true)

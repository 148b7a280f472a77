"""The paper's detector: clusters of cells that have the size of a human (sections 5.5 and 6.4)."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Bool, Int
from mrs_people_loc.cells.clustering import cluster
from mrs_people_loc.cells.human import is_human, locate
from mrs_people_loc.cells.splitting import SPLITTING_TUNING, SplittingTuning, split
from mrs_people_loc.clusters import Clusters, measure
from mrs_people_loc.people import Detections, Expected
from mrs_people_loc.team.fusion import ShortTermMap
from mrs_people_loc.team.masking import Known
from mrs_people_loc.team.poses import Pose


def detect(
    fused: ShortTermMap,
    known: Known,
    poses: Mapping[str, Pose],
    expected: Expected,
    config: cfg.PlannerConfig,
    tuning: SplittingTuning = SPLITTING_TUNING,
) -> Detections:
    """People among the cells of a map that belong to no body.

    The paper's three steps are clusters, their measures, and those that are human-sized, each at
    its centre of gravity. What is known to be no person is left out before. Clusters that are wider
    than a person are split. Where several people are expected in one cluster, each gets a part of
    it, and an expected person needs fewer points.

    Args:
        fused: The map.
        known: Which of its cells belong to no body, and which of these are of robots or walls.
        poses: By robot, the pose that its cells were placed with.
        expected: Where people are expected.
        config: Parameters.
        tuning: Constants of splitting.

    Returns:
        Clusters of all cells that belong to no body; those of robots and walls come last.
    """
    if not len(known.plain):
        return Detections.nothing(fused)
    label, count, too_wide = _segment(fused, known, poses, expected, config, tuning)
    clusters = measure(fused, label, known.plain)

    human, certain = _are_people(clusters, expected, config)
    human[count:] = False
    persons = tuple(
        person if certain[person.label] else dataclasses.replace(person, score=0.0)
        for person in locate(fused, clusters, human, poses)
    )
    return Detections(known.plain, clusters, persons, too_wide)


def _segment(
    fused: ShortTermMap,
    known: Known,
    poses: Mapping[str, Pose],
    expected: Expected,
    config: cfg.PlannerConfig,
    tuning: SplittingTuning,
) -> tuple[Int, int, int]:
    """Clusters of the cells that belong to no body, those of several people split.

    Returns:
        label: Of each of these cells; clusters of robots and walls come last, shape (p,).
        count: Clusters that are not of robots and walls.
        too_wide: How many of them are too wide for one person but stay whole.
    """
    xy, distance = fused.xy[known.plain], config.clustering.distance
    possible = known.plain[~known.cells]
    pieces = cluster(xy[~known.cells], distance=distance)
    pieces, too_wide = split(
        fused,
        possible,
        pieces,
        poses,
        config.splitting,
        config.human,
        expected=expected.xy,
        cell_range_sigma=config.masking.cell_range_sigma,
        tuning=tuning,
    )
    count = int(pieces.max(initial=-1)) + 1
    label = np.empty(len(known.plain), dtype=np.intp)
    label[~known.cells] = pieces
    label[known.cells] = count + cluster(xy[known.cells], distance=distance)
    return label, count, too_wide


def _are_people(
    clusters: Clusters, expected: Expected, config: cfg.PlannerConfig
) -> tuple[Bool, Bool]:
    """Which clusters are people, and which of them also are without being expected."""
    certain = is_human(clusters, config.human)
    if not len(expected.xy):
        return certain.copy(), certain
    tracking = config.tracking
    fewer = round(config.human.min_points * tracking.expected_points)
    weak = is_human(clusters, dataclasses.replace(config.human, min_points=max(1, fewer)))
    near = expected.near(
        clusters.centroid, clusters.scatter, gate=tracking.gate, reach=tracking.max_distance
    )
    return certain | (weak & (near >= 0)), certain

"""The default detector: bodies of all robots are joined; likely ones are people."""

from __future__ import annotations

import dataclasses

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.bodies.joining import JOINING_TUNING, JoiningTuning, are_people, join
from mrs_people_loc.bodies.places import PlaceMemory
from mrs_people_loc.clusters import measure
from mrs_people_loc.people import Detections, Expected, persons_of
from mrs_people_loc.team.fusion import BodiesOnMap, ShortTermMap
from mrs_people_loc.team.masking import Known, Walls


def detect(
    fused: ShortTermMap,
    bodies: BodiesOnMap,
    known: Known,
    walls: Walls | None,
    expected: Expected,
    config: cfg.PlannerConfig,
    tuning: JoiningTuning = JOINING_TUNING,
    *,
    places: PlaceMemory | None = None,
    time_ns: int = 0,
) -> Detections:
    """People among the bodies of a map.

    Args:
        fused: The map.
        bodies: Its bodies.
        known: Which of them are robots of the team.
        walls: Walls and furniture, where there is a map of them.
        expected: Where people are expected: there, less evidence is enough.
        config: Parameters.
        tuning: Its constants.
        places: What earlier intervals saw; None: nothing is remembered.
        time_ns: Time of the interval [ns].

    Returns:
        Clusters of the bodies' cells. Those of robots, and of bodies that did not take part, come
        last.
    """
    if not len(bodies.xy):
        return Detections.nothing(fused)
    tracking = config.tracking
    joined = join(bodies, ~known.bodies, config.joining, tuning)
    if walls is not None:
        log_odds = walls.log_odds(joined.xy, joined.covariance, config.masking)
        joined = dataclasses.replace(joined, score=joined.score + log_odds)
    if places is not None:
        lost = places.step(joined, bodies, expected, time_ns, tracking.static_score)
        joined = dataclasses.replace(joined, score=joined.score - lost)
    gate, reach = tracking.gate, tracking.max_distance
    near = expected.near(joined.xy, joined.covariance, gate=gate, reach=reach)
    prior = np.where(near >= 0, tracking.expected_score, 0.0)
    likely = dataclasses.replace(joined, score=joined.score + prior)
    people = are_people(likely, bodies, config.joining, expected=near)

    cells = np.flatnonzero(bodies.of_cell >= 0)
    left_out = joined.of_body < 0
    label = np.where(left_out, len(joined) + np.cumsum(left_out) - 1, joined.of_body)
    clusters = measure(fused, label[bodies.of_cell[cells]], cells)
    found = np.flatnonzero(people)
    persons = persons_of(
        fused, clusters, found, joined.xy[found], joined.covariance[found], joined.score[found]
    )
    return Detections(cells, clusters, persons)

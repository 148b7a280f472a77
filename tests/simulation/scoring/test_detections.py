"""MODA and MODP that were worked out by hand."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mrs_people_sim.scoring.detections import DetectionScores, score_detections
from mrs_tools.bags.records import Estimate, Truth

STEP_NS = 200_000_000
Places = list[tuple[float, float]]


def estimates(*rows: Places) -> list[Estimate]:
    return [
        Estimate(
            stamp_ns=index * STEP_NS,
            positions=np.array(row, dtype=float).reshape(-1, 2),
            covariances=np.tile(0.01 * np.eye(2), (len(row), 1, 1)),
        )
        for index, row in enumerate(rows)
    ]


def truth(*rows: Places, visible: list[list[bool]] | None = None) -> Truth:
    return Truth.build(
        [index * STEP_NS for index in range(len(rows))],
        [np.array(row, dtype=float).reshape(-1, 2) for row in rows],
        None if visible is None else [np.array(row, dtype=bool) for row in visible],
    )


def test_moda_and_modp_match_hand_computed_values() -> None:
    there = truth([(0, 0), (3, 0)], [(0, 0), (3, 0)])
    # Frame 0: pairs at 0.45 m and 0.1 m, one false. Frame 1: a pair at 0.2 m, one missed.
    found = estimates([(0.45, 0), (3, 0.1), (6, 0)], [(0, 0.2)])
    report = score_detections(there, found).report()
    assert report["moda"] == pytest.approx(1 - (1 + 1) / 4)
    assert report["modp"] == pytest.approx((0.1 + 0.8 + 0.6) / 3)


def test_pair_beyond_half_a_metre_is_missed_and_false() -> None:
    there = truth([(0, 0)])
    assert score_detections(there, estimates([(0.49, 0)])).report()["moda"] == 1.0
    assert score_detections(there, estimates([(0.51, 0)])).report() == {"moda": -1.0, "modp": None}


def test_optional_people_count_neither_way() -> None:
    there = truth([(0, 0), (3, 0)], visible=[[True, False]])
    for more in ([], [(3.0, 0.4)]):
        scores = score_detections(there, estimates([(0, 0.05), *more]))
        assert scores.report() == {"moda": 1.0, "modp": pytest.approx(0.9)}
    beside = estimates([(0, 0.05), (3.0, 0.6)])
    assert score_detections(there, beside).report()["moda"] == 0.0
    tolerant = dataclasses.replace(there, ignore_within=0.7)
    assert score_detections(tolerant, beside).report()["moda"] == 1.0


def test_nobody_to_find_leaves_both_undefined() -> None:
    empty = truth([], [])
    assert score_detections(empty, estimates([], [])).report() == {"moda": None, "modp": None}
    scores = score_detections(empty, estimates([(1, 1)], []))
    assert scores.report() == {"moda": None, "modp": None}
    assert scores.false == 1


def test_scores_of_recordings_are_added_before_they_are_divided() -> None:
    one = DetectionScores(true=3, false=1, overlaps=np.array([0.5, 0.7]))
    other = DetectionScores(true=1, false=0, overlaps=np.array([0.9]))
    assert (one + other).report() == {
        "moda": pytest.approx(1 - (1 + 1) / 4),
        "modp": pytest.approx(0.7),
    }

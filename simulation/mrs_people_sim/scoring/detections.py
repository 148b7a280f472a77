"""MODA and MODP: scores of people in single frames, without identities.

Source: Kasturi et al., "Framework for performance evaluation of face, text, and vehicle detection
and tracking in video", IEEE Transactions on Pattern Analysis and Machine Intelligence 31(2), 2009;
on the ground plane with a limit of 0.50 m: Chavdarova et al., "WILDTRACK: a multi-camera HD dataset
for dense unscripted pedestrian detection", CVPR 2018.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_sim.scoring.positions import nothing, ratio, score, sums_of
from mrs_tools.bags.records import Estimate, Truth

#: WILDTRACK's limit for a match [m].
MODA_DISTANCE = 0.50


@dataclass(frozen=True)
class DetectionScores:
    """What MODA and MODP are made of; scores of several recordings are added.

    Attributes:
        true: People who are required, summed over the frames.
        false: Estimates that match nobody, likewise.
        overlaps: Of each pair, 1 - distance / `MODA_DISTANCE`, shape (k,).
    """

    true: int = 0
    false: int = 0
    overlaps: Float = field(default_factory=nothing)

    def __add__(self, other: DetectionScores) -> DetectionScores:
        return DetectionScores(**sums_of(self, other))

    def report(self) -> dict[str, float | None]:
        """`moda` and `modp`; None where nobody is required, or nobody was found."""
        found = len(self.overlaps)
        return {
            "moda": ratio(found - self.false, self.true),
            "modp": ratio(float(self.overlaps.sum()), found),
        }


def score_detections(truth: Truth, estimates: Sequence[Estimate]) -> DetectionScores:
    """Compares estimates with the truth by the rules of `positions`, with WILDTRACK's limit.

    Args:
        truth: The truth.
        estimates: What was found, in any order.
    """
    frames = score(truth, estimates, distance=MODA_DISTANCE)
    errors = np.concatenate([nothing(), *(frame.errors for frame in frames)])
    return DetectionScores(
        true=sum(int(frame.required.sum()) for frame in frames),
        false=sum(len(frame.false) for frame in frames),
        overlaps=1.0 - errors / MODA_DISTANCE,
    )

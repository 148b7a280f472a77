"""Scoring what was found against the ground truth."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from mrs_people_loc.geometry import Float

Int = NDArray[np.intp]

#: A found and a true person match when they are within this distance [m].
MATCH_DISTANCE = 0.40


def match(found: Float, true: Float, *, distance: float = MATCH_DISTANCE) -> tuple[Int, Int, Float]:
    """Pairs found with true positions, one to one, as many as possible, then as near as possible.

    Args:
        found: Positions [m], shape (n, 2).
        true: Positions [m], shape (m, 2); NaN for somebody who is not there.
        distance: Pairs are no farther apart than this [m], inclusive.

    Returns:
        Indices of the pairs in `found` and in `true`, and their distances [m], each of shape (k,).
    """
    away = np.linalg.norm(found[:, np.newaxis] - true[np.newaxis], axis=2)
    possible = away <= distance  # NaN compares false
    # A pair that is impossible costs more than any set of possible ones.
    cost = np.where(possible, away, distance * (1.0 + min(away.shape, default=0)))
    rows, columns = linear_sum_assignment(cost)
    kept = possible[rows, columns]
    rows, columns = rows[kept], columns[kept]
    return rows, columns, away[rows, columns]

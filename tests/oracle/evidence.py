"""What a patch says, as numbers, and what the fitted model makes of them."""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

import numpy as np
from numpy.typing import NDArray

from oracle.arrays import Float
from oracle.numbers import (
    ACROSS,
    BANDS,
    BODY_ROWS,
    HEIGHTS,
    KNOTS,
    LARGEST_VOTE_SIGMA_PX,
    MOMENT,
    SHARES,
    SIGMA_ACROSS_M,
    SIGMA_M,
    SIGMA_PX,
    SILHOUETTE,
    SLICES,
    STEEPEST,
    STRIPES,
    UPPER_M,
    WIDE,
)

#: Borders of bands and stripes lie so much lower: samples are float32 [m].
_MARGIN_M = 1e-4


def _between(values: Iterable[Any], low: float, high: float) -> list[int]:
    return [k for k, x in enumerate(values) if low - _MARGIN_M <= float(x) < high - _MARGIN_M]


@dataclass(frozen=True)
class Numbers:
    """What one patch says; fields as in `Evidence`, each a row of it."""

    even: list[float]
    odd: list[float]
    depth: list[float]


def evidence_of(
    difference: Float,
    inside: NDArray[np.bool_],
    tolerance: float,
    inverse_range: float,
    extent: float,
    contrast: Float,
    shift: float,
    sigma: float,
    scale: float,
    focal: float,
) -> Numbers:
    """Reads one patch.

    Args:
        difference: Disparity seen less that of the patch [px], NaN: unknown, shape (heights,
            across), as `inside` and `contrast`.
        inside: Which samples are in the image.
        tolerance: Difference within which a sample is of the body [px].
        inverse_range: Of the patch [px].
        extent: Upright extent that the search saw [m].
        contrast: Of the vote.
        shift: Of the vote [px].
        sigma: Of the vote [px].
        scale: Inverse range times range [px m].
        focal: Focal length [px].
    """
    same, behind, front, depth, outside = (np.zeros(difference.shape) for _ in range(5))
    for at in np.ndindex(difference.shape):
        outside[at] = not inside[at]
        if not math.isfinite(difference[at]):
            continue
        relative = float(difference[at]) / tolerance
        same[at] = min(max(2.0 - abs(relative), 0.0), 1.0)
        behind[at] = min(max(-1.0 - relative, 0.0), 1.0)
        front[at] = min(max(relative - 1.0, 0.0), 1.0)
        depth[at] = min(max(relative, -2.0), 2.0)
    even, odd = [], []
    for part in (same, behind, front, depth, contrast, outside):
        left, right = _shares(part, 1), _shares(part, -1)
        order = [(band, stripe) for band in BANDS for stripe in STRIPES]
        odd += [left[at] - right[at] for at in order]
        if part is outside:
            continue
        even += [0.5 * (left[at] + right[at]) for at in order]
        even += [min(left[at], right[at]) for at in order if at[1] in STRIPES[2:]]
    fit = _fit(difference, tolerance)
    away = scale / inverse_range
    metres = away / inverse_range  # that a pixel of disparity is worth
    even += [away, 1.0 / away, extent, tolerance * metres]
    even += [fit.deviation * metres, min(abs(fit.slope) * metres, STEEPEST)]
    even.append(math.log(math.sqrt(SIGMA_PX**2 + (SIGMA_M / metres) ** 2)))
    even.append(math.log(math.sqrt(SIGMA_ACROSS_M**2 + (away / focal) ** 2)))
    even += [max(away - knot, 0.0) for knot in KNOTS]
    odd = [*_centroids(same), fit.slope * metres, *odd]
    seen = [*fit.spread, fit.mean, fit.upper, shift, min(sigma, LARGEST_VOTE_SIGMA_PX)]
    worth = math.sqrt(inverse_range / away)  # of the pixels that a metre of depth is worth
    depths = [*seen, *(x / worth for x in seen), *(x * worth for x in seen)]
    return Numbers(even, odd, [*depths, worth, worth**2, 1.0 / worth])


def _shares(part: Float, side: int) -> dict[Any, float]:
    """Mean over each band and stripe, of one side: 1 left, -1 right."""
    return {
        (band, stripe): float(
            np.mean(part[np.ix_(_between(HEIGHTS, *band), _between(side * ACROSS, *stripe))])
        )
        for band in BANDS
        for stripe in STRIPES
    }


def _centroids(same: Float) -> list[float]:
    """How far to the left the middle of each slice of a body is [m]."""
    result = []
    for part in SLICES:
        weights = [
            (float(same[row, column]), float(ACROSS[column]))
            for row in _between(HEIGHTS, *part)
            for column in SILHOUETTE
        ]
        result.append(sum(w * x for w, x in weights) / max(sum(w for w, _ in weights), 1e-3))
    return result


@dataclass(frozen=True)
class _Fit:
    """Of the samples that are of a body: quantiles, mean and median above, and the slope across."""

    spread: list[float]
    upper: float
    mean: float
    deviation: float
    slope: float


def _fit(difference: Float, tolerance: float) -> _Fit:
    samples = [
        (float(difference[row, column]), float(ACROSS[column]), row)
        for row in BODY_ROWS
        for column in SILHOUETTE
        if abs(difference[row, column]) < WIDE * tolerance  # not so for NaN
    ]
    values, count = [d for d, _, _ in samples], max(len(samples), 1)
    mean = sum(values) / count
    middle = sum(x for _, x, _ in samples) / count
    moment = sum(x * x for _, x, _ in samples) / count - middle**2
    # Regression of the disparity on the place across.
    slope = (sum(d * x for d, x, _ in samples) / count - mean * middle) / (moment + MOMENT)
    above = [d for d, _, row in samples if HEIGHTS[row] >= UPPER_M - _MARGIN_M]
    return _Fit(
        spread=[_quantile(values, share) for share in SHARES],
        upper=_quantile(above, 0.5),
        mean=mean,
        deviation=math.sqrt(max(sum(d * d for d in values) / count - mean**2, 0.0)),
        slope=slope,
    )


def _quantile(values: Sequence[float], share: float) -> float:
    return float(np.quantile(values, share)) if values else 0.0


# ------------------------------------------------------------------------------------- the model


@functools.cache
def model() -> dict[str, dict[str, Any]]:
    """The numbers of the fitted model, by part and name."""
    file = resources.files("mrs_people_loc.bodies").joinpath("body_model.json")
    parts: dict[str, dict[str, Any]] = json.loads(file.read_text("utf-8"))
    # Beside the numbers there is what they were fitted to.
    return {
        name: {k: np.array(v) for k, v in part.items()}
        for name, part in parts.items()
        if name != "fitted_to"
    }


def fitted(part: str, evidence: Sequence[float] | Float) -> float:
    """What a part of the model says of one patch: linear, but `human`, which has a hidden layer."""
    numbers = model()[part]
    scaled = [
        min(max((x - mean) / scale, -4.0), 4.0)
        for x, mean, scale in zip(evidence, numbers["mean"], numbers["scale"], strict=True)
    ]
    if part != "human":
        return float(np.dot(scaled, numbers["weights"]) + numbers["offset"])
    hidden = [
        math.tanh(float(np.dot(scaled, weights)) + float(bias))
        for weights, bias in zip(numbers["hidden"].T, numbers["bias"], strict=True)
    ]
    return float(np.dot(hidden, numbers["output"]) + numbers["offset"])

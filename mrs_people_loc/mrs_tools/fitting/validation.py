"""Cross-validation of the body model."""

from __future__ import annotations

import numpy as np

from mrs_tools.fitting.examples import Examples
from mrs_tools.fitting.regression import fit
from mrs_tools.scoring.positions import CHI2_95

_FOLDS = 5


def cross_validate(examples: Examples) -> dict[str, float]:
    """Figures of models that have not seen the bags that they judge."""
    count = len(examples)
    score, across, depth = np.zeros(count), np.zeros(count), np.zeros(count)
    inside = np.zeros(count, dtype=bool)
    for fold in range(_FOLDS):
        held = examples.bag % _FOLDS == fold
        if not held.any():
            continue
        model, part = fit(examples.select(~held)), examples.select(held)
        score[held] = model.human(part.even)
        across[held] = part.across - model.across(part.odd)
        depth[held] = part.more_px - model.depth(part.depth)
        squares = (across[held] / np.exp(model.across_log_sigma(part.even))) ** 2
        squares += (depth[held] / np.exp(model.depth_log_sigma(part.even))) ** 2
        inside[held] = squares < CHI2_95
    person, clear = examples.person, examples.clear
    order = np.flatnonzero(clear)[np.argsort(-score[clear], kind="stable")]
    hits = np.cumsum(person[order])
    precision = hits / np.arange(1, len(order) + 1)
    at = np.searchsorted(hits, 0.95 * hits[-1])
    loss = np.logaddexp(0.0, score[clear]) - person[clear] * score[clear]
    return {
        "examples": float(count),
        "people": float(person.sum()),
        "log loss": float(loss.mean()),
        "precision at recall 0.95": float(precision[at]),
        "error across, mean [cm]": float(100 * np.abs(across[person]).mean()),
        "error along, mean [px]": float(np.abs(depth[person]).mean()),
        "in the 95 % ellipse": float(inside[person].mean()),
    }

"""Fits how the appearance of bodies, and the human test, count.

The weights of the combination are fitted to scores of models that have not seen the bags that they
judge; the networks are trained beforehand (`train_network.py`). Renderings overrate the human
test, which was fitted to them: where real rooms are given, they count a fifth of all.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.optimize import minimize

from mrs_people_loc.arrays import Bool, Float
from mrs_people_loc.bodies.appearance import RULED_OUT, AppearanceModel, Scores
from mrs_studies.fitting.regression import rounded

#: Share of the real examples in the fit of the combination. More of it finds fewer people of the
#: suite, less of it takes more furniture of a room that the fit has not seen for people.
_REAL = 0.2


def fit_combination(scores: Scores, person: Bool, weight: Float) -> Float:
    """Weights of `Scores.columns`, none below 0, and a constant: log-odds of a person.

    Args:
        scores: Of people and of other things.
        person: Which are people, shape (n,).
        weight: Of the examples, shape (n,).

    Returns:
        Shape (4,).
    """
    looked = scores.human >= RULED_OUT  # of the others the human test alone judges
    columns = np.column_stack([scores.columns, np.ones(len(scores))])[looked]
    target, weight = person[looked].astype(np.float64), weight[looked] / weight[looked].sum()

    def loss(p: Float) -> tuple[float, Float]:
        z = columns @ p
        error = weight * (0.5 * (1.0 + np.tanh(0.5 * z)) - target)
        cost = np.sum(weight * (np.logaddexp(0.0, z) - target * z)) + 0.5e-4 * np.sum(p**2)
        return float(cost), columns.T @ error + 1e-4 * p

    bounds: Sequence[tuple[float | None, None]] = [(0.0, None)] * 3 + [(None, None)]
    start = np.array([0.3, 0.3, 0.3, 0.0])
    found = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds)
    return rounded(np.asarray(found.x))


def shared_weights(real: Bool) -> Float:
    """Weights by which real examples together count as `_REAL` says, shape (n,)."""
    weight = np.ones(len(real))
    for chosen, share in ((real, _REAL), (~real, 1.0 - _REAL)):
        weight[chosen] = share * len(real) / max(int(chosen.sum()), 1)
    return weight


def appearance_model(weights: Float) -> AppearanceModel:
    """The fitted numbers as the model."""
    return AppearanceModel(*(float(value) for value in weights))

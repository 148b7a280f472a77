"""Fits how the appearance of bodies, and the human test, count.

The classifier of gradients is fitted to renderings, whose images are partly made worse. The weights
of the combination are fitted to scores of models that have not seen the bags that they judge.
Renderings overrate the human test, which was fitted to them: where labelled recordings of real
rooms are given, they count more than all renderings together.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.optimize import minimize

from mrs_people_loc.arrays import Bool, Float, StructOfArrays
from mrs_people_loc.bodies.appearance import (
    FITTED_WINDOW,
    HUMAN_LIMITS,
    RULED_OUT,
    AppearanceModel,
    block_score,
)
from mrs_people_loc.bodies.gradients import BINS, BLOCK, CELL, Histograms
from mrs_tools.fitting.examples import Looks
from mrs_tools.fitting.regression import fit_logistic, rounded

#: What large weights of gradients cost.
_COST = 300.0
#: Share of the real examples in the fit of the combination. More of it finds fewer people of the
#: suite, less of it takes more furniture of a room that the fit has not seen for people.
_REAL = 0.6
#: Columns and rows of blocks of the fitted window.
_RIGHT, _DOWN = (n // CELL - 1 for n in (FITTED_WINDOW.columns, FITTED_WINDOW.rows))


@dataclass(frozen=True)
class Scores(StructOfArrays):
    """What the parts of the combination say of candidates; arrays of shape (n,).

    Attributes:
        human: Log-odds by the human test.
        detector: Score of the people detector.
        fitted: Score of the fitted classifier.
    """

    human: Float
    detector: Float
    fitted: Float

    @property
    def columns(self) -> Float:
        """What the weights of the combination multiply, shape (n, 4)."""
        low, high = HUMAN_LIMITS
        above = np.maximum(self.human - high, 0.0)
        return np.column_stack([np.clip(self.human, low, high), above, self.detector, self.fitted])


def mirrored(values: Any) -> Any:
    """Histograms of mirrored windows, shape (n, blocks, `BLOCK`)."""
    cells = values.reshape(-1, _RIGHT, _DOWN, 2, 2, BINS)
    # Columns of blocks, columns of cells and orientations in the opposite order.
    return cells[:, ::-1, :, ::-1, :, ::-1].reshape(values.shape)


def fit_gradients(looks: Looks, person: Bool) -> tuple[Float, Float]:
    """The classifier of gradients: weights, shape (blocks, `BLOCK`), and middles, (blocks,).

    People and other things count alike, and so do left and right.
    """
    values = 0.5 * (looks.fitted + mirrored(looks.fitted))
    inside = looks.fitted_inside[:, :, np.newaxis]
    mean = (values * inside).sum(axis=0) / np.maximum(inside.sum(axis=0), 1)
    share = np.maximum(looks.fitted_inside.mean(axis=1), 0.05)
    values = (values - mean) * inside / np.sqrt(share)[:, np.newaxis, np.newaxis]
    scale = np.sqrt((values**2).mean(axis=0)) + 0.02
    columns = (values / scale).reshape(len(values), -1).astype(np.float32)
    people = max(int(person.sum()), 1)
    weight = np.where(person, 0.5 / people, 0.5 / max(len(person) - people, 1)) * len(person)
    found = fit_logistic(columns, person.astype(np.float64), weight=weight, cost=_COST)
    weights = found[:-1].reshape(scale.shape) / scale
    weights = rounded(0.5 * (weights + mirrored(weights[np.newaxis])[0]))
    return weights, rounded((weights * mean).sum(axis=1) - found[-1] / len(weights))


def detector_middles(looks: Looks, person: Bool) -> Float:
    """By block, the middle between what people and other things have there, shape (blocks,)."""
    means = []
    for chosen in (person, ~person):
        inside = looks.detector_inside[chosen]
        means.append((looks.detector[chosen] * inside).sum(axis=0) / np.maximum(inside.sum(0), 1))
    return rounded(0.5 * (means[0] + means[1]))


def gradient_score(looks: Looks, weights: Float, middles: Float) -> Float:
    """Score of the fitted classifier, shape (n,)."""
    return block_score(Histograms(looks.fitted, looks.fitted_inside), weights, middles)


def detector_score(looks: Looks, middles: Float) -> Float:
    """Score of the people detector, shape (n,)."""
    share = np.maximum(looks.detector_inside.mean(axis=1), 0.05)
    blocks = (looks.detector - middles) * looks.detector_inside
    return np.asarray(blocks.sum(axis=1) / np.sqrt(share), dtype=np.float64)


def fit_combination(scores: Scores, person: Bool, weight: Float) -> Float:
    """Weights of `Scores.columns`, none below 0, and a constant: log-odds of a person.

    Args:
        scores: Of people and of other things.
        person: Which are people, shape (n,).
        weight: Of the examples, shape (n,).

    Returns:
        Shape (5,).
    """
    looked = scores.human >= RULED_OUT  # of the others the human test alone judges
    columns = np.column_stack([scores.columns, np.ones(len(scores))])[looked]
    target, weight = person[looked].astype(np.float64), weight[looked] / weight[looked].sum()

    def loss(p: Float) -> tuple[float, Float]:
        z = columns @ p
        error = weight * (0.5 * (1.0 + np.tanh(0.5 * z)) - target)
        cost = np.sum(weight * (np.logaddexp(0.0, z) - target * z)) + 0.5e-4 * np.sum(p**2)
        return float(cost), columns.T @ error + 1e-4 * p

    bounds: Sequence[tuple[float | None, None]] = [(0.0, None)] * 4 + [(None, None)]
    start = np.array([0.3, 0.3, 1.0, 1.0, 0.0])
    found = minimize(loss, start, jac=True, method="L-BFGS-B", bounds=bounds)
    return rounded(np.asarray(found.x))


def shared_weights(real: Bool) -> Float:
    """Weights by which real examples together count as `_REAL` says, shape (n,)."""
    weight = np.ones(len(real))
    for chosen, share in ((real, _REAL), (~real, 1.0 - _REAL)):
        weight[chosen] = share * len(real) / max(int(chosen.sum()), 1)
    return weight


def combined(scores: Scores, weights: Float) -> Float:
    """Log-odds of a person, shape (n,).

    Args:
        scores: What the parts say.
        weights: As of `fit_combination`.
    """
    result = scores.columns @ weights[:-1] + weights[-1]
    return np.where(scores.human >= RULED_OUT, result, scores.human)


def appearance_model(
    weights: Float, detector: Float, gradients: tuple[Float, Float]
) -> AppearanceModel:
    """The fitted numbers as the model."""
    human, above, of_detector, fitted, offset = (float(value) for value in weights)
    return AppearanceModel(
        human=human,
        above=above,
        detector=of_detector,
        fitted=fitted,
        offset=offset,
        detector_middle=detector,
        fitted_middle=gradients[1],
        fitted_weights=gradients[0].reshape(-1, BLOCK),
    )

"""Fits the body model to examples."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.optimize import minimize

from mrs_people_loc.arrays import Float
from mrs_people_loc.bodies.model import BodyModel, Layered, Linear, Scaled, fitted
from mrs_people_loc.errors import PeopleLocError
from mrs_tools.fitting.examples import Examples

#: Width of the hidden layer, and what large weights cost.
_HIDDEN, _HIDDEN_COST, _LINEAR_COST = 16, 40.0, 30.0


def fit(examples: Examples) -> BodyModel:
    """Fits the model.

    Raises:
        PeopleLocError: There are too few examples of either kind.
    """
    people = examples.select(examples.person)
    clear = examples.select(examples.clear)
    others = int(len(clear) - clear.person.sum())
    if len(people) < 100 or others < 100:
        raise PeopleLocError(
            f"{len(people)} examples of people and {others} of other things; wanted: 100 of each"
        )
    human = _fit_layered(clear.even, clear.person.astype(np.float64))
    across = _fit_linear(people.odd, people.across, width=0.05, odd=True)
    depth = _fit_linear(people.depth, people.more_px, width=0.1)
    return BodyModel(
        human=human,
        across=across,
        depth=depth,
        across_log_sigma=_fit_log_sigma(people.even, people.across - across(people.odd), 0.005),
        depth_log_sigma=_fit_log_sigma(people.even, people.more_px - depth(people.depth), 0.01),
        appearance=fitted().appearance,
    )


def _scaled(values: Float, *, odd: bool = False) -> Scaled:
    mean = np.zeros(values.shape[1]) if odd else values.mean(axis=0)
    scale = np.sqrt(np.mean((values - mean) ** 2, axis=0)) + 0.02
    return Scaled(_rounded(mean), _rounded(scale))


def _fit_linear(values: Float, target: Float, *, width: float, odd: bool = False) -> Linear:
    """Huber's regression by reweighting, with a ridge; residuals above `width` count linearly."""
    scaled = _scaled(values, odd=odd)
    x = np.column_stack([scaled(values), np.full(len(values), 0.0 if odd else 1.0)])
    ridge = np.diag([_LINEAR_COST] * values.shape[1] + [1e-6])
    weight = np.ones(len(x))
    for _ in range(20):
        weighted = x * weight[:, np.newaxis]
        solution = np.linalg.solve(weighted.T @ x + ridge, weighted.T @ target)
        weight = np.minimum(1.0, width / np.maximum(np.abs(x @ solution - target), 1e-9))
    return Linear(scaled, _rounded(solution[:-1]), float(_rounded(solution[-1:])[0]))


def _fit_log_sigma(values: Float, residual: Float, floor: float) -> Linear:
    """Log of the residuals' size, raised so that 95 % of them are within 1.96 sigma."""
    model = _fit_linear(values, np.log(np.abs(residual) + floor), width=1.0)
    ratios = np.abs(residual) / np.exp(model(values))
    raised = model.offset + math.log(float(np.percentile(ratios, 95)) / 1.96)
    return Linear(model.scaled, model.weights, raised)


def _fit_layered(values: Float, target: Float) -> Layered:
    """Logistic loss over a hidden layer of tanh, with a ridge, by L-BFGS from a fixed start."""
    scaled = _scaled(values)
    x = scaled(values)
    inputs, width = x.shape[1], _HIDDEN
    rng = np.random.default_rng(0)
    start = np.concatenate(
        [
            rng.normal(0.0, 1.0 / math.sqrt(inputs), inputs * width),
            np.zeros(width),
            rng.normal(0.0, 0.3, width),
            [0.0],
        ]
    )

    def unpack(p: Float) -> tuple[Float, Float, Float, float]:
        cut = inputs * width
        return p[:cut].reshape(inputs, width), p[cut : cut + width], p[cut + width : -1], p[-1]

    def loss(p: Float) -> tuple[float, Float]:
        hidden, bias, output, offset = unpack(p)
        layer = np.tanh(x @ hidden + bias)
        z = layer @ output + offset
        cost = 0.5 * _HIDDEN_COST * (np.sum(hidden**2) + np.sum(output**2))
        error = 1.0 / (1.0 + np.exp(-z)) - target
        back = np.outer(error, output) * (1.0 - layer**2)
        gradient = [
            (x.T @ back + _HIDDEN_COST * hidden).ravel(),
            back.sum(axis=0),
            layer.T @ error + _HIDDEN_COST * output,
            [error.sum()],
        ]
        return float(np.sum(np.logaddexp(0.0, z) - target * z) + cost), np.concatenate(gradient)

    found: Any = minimize(loss, start, jac=True, method="L-BFGS-B", options={"maxiter": 250})
    hidden, bias, output, offset = unpack(_rounded(found.x))
    return Layered(scaled, hidden, bias, output, float(offset))


def _rounded(values: Float) -> Float:
    """Five digits are plenty, and keep the file small."""
    return np.array([float(f"{value:.5g}") for value in values])

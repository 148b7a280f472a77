"""Regressions on columns of evidence: linear, of quantiles, logistic, and with a hidden layer."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from scipy.optimize import minimize

from mrs_people_loc.arrays import Float
from mrs_people_loc.bodies.model import Layered, Linear, Scaled

#: Networks that are averaged, width of the hidden layer of each, and what large weights cost.
_MEMBERS = 4
_HIDDEN, _HIDDEN_COST, _LINEAR_COST = 16, 40.0, 30.0
#: How much more the mean residual of a group of examples counts than their scatter.
_UNBIASED = 30.0
#: Scaled columns are cut at 4; this share of the examples is within, at each end.
_UNCUT = 0.001
#: Rounding of the corner of the loss of quantiles.
_CORNER = 0.02


def fit_scaled(values: Float, *, odd: bool = False, uncut: bool = False) -> Scaled:
    """Means and sizes of columns.

    Args:
        values: Shape (n, width).
        odd: Means are 0.
        uncut: Columns with rare large values get a larger scale, so that those are not cut.
    """
    mean = np.zeros(values.shape[1]) if odd else values.mean(axis=0)
    size = np.sqrt(np.mean((values - mean) ** 2, axis=0))
    if uncut:
        low, high = np.quantile(values - mean, (_UNCUT, 1.0 - _UNCUT), axis=0)
        size = np.maximum(size, np.maximum(high, -low) / 4.0)
    return Scaled(rounded(mean), rounded(size + 0.02))


def fit_linear(
    values: Float,
    target: Float,
    *,
    size: Float,
    weight: Float,
    odd: bool = False,
    uncut: bool = False,
    groups: Float | None = None,
) -> Linear:
    """Huber's regression by reweighting, with a ridge.

    Args:
        values: Shape (n, width).
        target: Shape (n,).
        size: Usual size of the residuals, shape (n,); larger ones count linearly.
        weight: Of the examples, shape (n,), mean 1.
        odd: There is no constant.
        uncut: As of `fit_scaled`.
        groups: How far each example is of each of some groups, shape (n, groups): in none shall
            the mean residual differ from 0, at the cost of larger ones.
    """
    scaled = fit_scaled(values, odd=odd, uncut=uncut)
    x = np.column_stack([scaled(values), np.full(len(values), 0.0 if odd else 1.0)])
    ridge = np.diag([_LINEAR_COST] * values.shape[1] + [1e-6])
    least = weight / size**2
    least /= least.mean()
    robust = least
    for _ in range(20):
        weighted = x * robust[:, np.newaxis]
        normal, right_side = weighted.T @ x + ridge, weighted.T @ target
        if groups is not None:
            members = groups * robust[:, np.newaxis]
            members *= np.sqrt(_UNBIASED / np.maximum(members.sum(axis=0), 1e-9))
            means = members.T @ x
            normal += means.T @ means
            right_side += means.T @ (members.T @ target)
        solution = np.linalg.solve(normal, right_side)
        robust = least * np.minimum(1.0, size / np.maximum(np.abs(x @ solution - target), 1e-9))
    return Linear(scaled, rounded(solution[:-1]), float(rounded(solution[-1:])[0]))


def fit_quantile(values: Float, target: Float, share: float, *, weight: Float) -> Float:
    """Weights of columns whose sum is above the target for a share of the examples.

    The loss of quantile regression (Koenker & Bassett 1978), its corner rounded. Of examples in
    which a column is 1, and 0 in others, that share is right in each of the two groups.

    Args:
        values: Shape (n, width), among them a constant.
        target: Shape (n,).
        share: From 0 to 1.
        weight: Of the examples, shape (n,), mean 1.

    Returns:
        Shape (width,).
    """

    def loss(p: Float) -> tuple[float, Float]:
        over = (target - values @ p) / _CORNER
        cost = _CORNER * (np.logaddexp(0.0, over) - (1.0 - share) * over)
        slope = _logistic(over) - (1.0 - share)
        return float((weight * cost).mean()), -(weight * slope) @ values / len(target)

    start = np.zeros(values.shape[1])
    found: Any = minimize(loss, start, jac=True, method="L-BFGS-B", options={"maxiter": 500})
    return np.asarray(found.x)


def fit_layered(values: Float, target: Float) -> Layered:
    """The mean of some networks, each fitted from its own start, as one network.

    One alone depends on its start: on furniture of kinds that are not among the examples, the
    log-odds of two of them differ by 0.7 (standard deviation).

    Args:
        values: Shape (n, width).
        target: 0 or 1, shape (n,).
    """
    scaled = fit_scaled(values)
    members = [_fit_hidden(scaled(values), target, seed) for seed in range(_MEMBERS)]
    hidden, bias, output, offset = zip(*members, strict=True)
    return Layered(
        scaled,
        hidden=rounded(np.hstack(hidden)),
        bias=rounded(np.concatenate(bias)),
        output=rounded(np.concatenate(output) / _MEMBERS),
        offset=float(rounded(np.mean(offset))),
    )


def _fit_hidden(x: Float, target: Float, seed: int) -> tuple[Float, Float, Float, float]:
    """Logistic loss over a hidden layer of tanh, with a ridge, by L-BFGS.

    Args:
        x: Shape (n, width).
        target: Shape (n,).
        seed: Of the weights that it starts from.

    Returns:
        As the last four of `Layered`.
    """
    inputs, width = x.shape[1], _HIDDEN
    rng = np.random.default_rng(seed)
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
        error = _logistic(z) - target
        back = np.outer(error, output) * (1.0 - layer**2)
        gradient = [
            (x.T @ back + _HIDDEN_COST * hidden).ravel(),
            back.sum(axis=0),
            layer.T @ error + _HIDDEN_COST * output,
            [error.sum()],
        ]
        return float(np.sum(np.logaddexp(0.0, z) - target * z) + cost), np.concatenate(gradient)

    found: Any = minimize(loss, start, jac=True, method="L-BFGS-B", options={"maxiter": 250})
    return unpack(found.x)


def _logistic(z: Any) -> Any:
    return 0.5 * (1.0 + np.tanh(0.5 * z))


def rounded(values: Float) -> Float:
    """Five digits are plenty, and keep the file small."""
    return np.array([float(f"{value:.5g}") for value in np.ravel(values)]).reshape(np.shape(values))

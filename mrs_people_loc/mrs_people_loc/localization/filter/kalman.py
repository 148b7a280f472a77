"""Kalman updates: the algebra that all observations share."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Float, Int
from mrs_people_loc.localization.filter.team_state import Source, TeamState, changed

#: Residual and Jacobian of the prediction, given the part of the state that is concerned.
Model = Callable[[Float], tuple[Float, Float]]


@dataclass(frozen=True)
class UpdateTuning:
    """Constants of the iterated update, chosen by hand.

    Attributes:
        iterate_from: A correction that turns something by more is linearized again [rad] ...
        iterations: ... so often at most,
        done: or until a further one changes this share of `iterate_from`.
        weights: Weights of a claim that are tried, from 0 to ...
        largest_weight: ... this.
    """

    iterate_from: float = 0.03
    iterations: int = 3
    done: float = 1e-3
    weights: int = 20
    largest_weight: float = 0.95


_TUNING = UpdateTuning()
#: Quantiles of chi-square with 1, 2 and 3 degrees of freedom, as `chdtri` has them.
_QUANTILES = {0.999: (10.827566170662733, 13.815510557964274, 16.26623619623813)}


def gates_of(share: float) -> dict[int, float]:
    """Squared Mahalanobis length that a share of observations does not exceed, by dimension.

    SciPy's quantiles take as long to load as all else of the localization: that of the default
    share is written down.
    """
    if share in _QUANTILES:
        return dict(enumerate(_QUANTILES[share], start=1))
    from scipy.special import chdtri

    return {m: float(chdtri(m, 1.0 - share)) for m in (1, 2, 3)}


def corrected(
    state: TeamState, columns: Int, model: Model, noise: Float
) -> tuple[TeamState, float]:
    """The state after an observation: iterated Kalman update (Bell & Cathey 1993).

    The correction is applied, and the covariance carried over to the corrected mean, by
    `TeamState.stepped`.

    Args:
        state: Before.
        columns: Indices of the part of the state that it concerns, the pose of a robot first,
            shape (k,).
        model: Residual, shape (m,), and Jacobian, shape (m, k), at that part.
        noise: Covariance of the observation, shape (m, m).

    Returns:
        The state, and the squared Mahalanobis length of the residual before.
    """
    residual, jacobian = model(state.mean[columns])
    rows = state.covariance[:, columns]
    across, gain, squared = _gain(rows, columns, jacobian, noise, residual)
    step = gain @ residual
    everything = np.arange(len(step))
    mean, carried = state.stepped(step, columns[:3])
    for _ in range(_TUNING.iterations):
        if np.abs(step[columns]).max() < _TUNING.iterate_from:
            break
        residual, jacobian = model(mean[columns])
        jacobian = jacobian @ carried[columns]
        across, gain, _ = _gain(state.covariance, everything, jacobian, noise, residual)
        again = gain @ (residual + jacobian @ step)
        done = np.abs(again - step).max() < _TUNING.done * _TUNING.iterate_from
        step = again
        mean, carried = state.stepped(step, columns[:3])
        if done:
            break
    covariance = carried @ (state.covariance - gain @ across.T) @ carried.T
    covariance = 0.5 * (covariance + covariance.T)
    return changed(state, mean=mean, covariance=covariance), squared


def _gain(
    rows: Float, columns: Int, jacobian: Float, noise: Float, residual: Float
) -> tuple[Float, Float, float]:
    """Covariance of state and prediction, the gain, and the residual's squared length."""
    across = rows @ jacobian.T
    inverse = np.linalg.inv(jacobian @ across[columns] + noise)
    return across, across @ inverse, float(residual @ inverse @ residual)


def wrapped(residual: Float) -> Float:
    """A residual whose last element is an angle, that angle in [-pi, pi]."""
    residual[-1] = math.remainder(residual[-1], 2.0 * math.pi)
    return residual


def share_of_claim(own: Float, claimed: Float, others: int = 3) -> float:
    """Weight of a claim in covariance intersection that leaves the least joint uncertainty.

    Maximizes the determinant of (1 - w) P^-1 + w H' R^-1 H over the claimed pose and `others` more
    dimensions of the state, about which the claim says nothing.

    Args:
        own: Covariance of the pose in the state, shape (3, 3).
        claimed: As claimed, shape (3, 3).
        others: Number of those dimensions.

    Returns:
        From 0 to 0.95.
    """
    ratios = np.abs(np.linalg.eigvals(np.linalg.solve(claimed, own)))
    weights = np.linspace(0.0, _TUNING.largest_weight, _TUNING.weights)
    odds = weights / (1.0 - weights)
    gains = np.log1p(ratios[:, np.newaxis] * odds).sum(axis=0)
    return float(weights[np.argmax(gains + (3 + others) * np.log1p(-weights))])


def noted(
    state: TeamState,
    robot: str,
    kind: str,
    accepted: bool,
    squared: float,
    freedom: int,
    stamp_ns: int,
) -> TeamState:
    """The state with one more observation in `sources`."""
    before = state.sources.get((robot, kind), Source())
    now = before.noted(accepted, squared, freedom, stamp_ns)
    return changed(state, sources={**state.sources, (robot, kind): now})

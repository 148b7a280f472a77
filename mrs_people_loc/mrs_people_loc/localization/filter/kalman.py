"""Kalman updates: the algebra that all observations share."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Float, Int
from mrs_people_loc.localization.filter.team_state import Source, TeamState, Trust, changed

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
        noise_gain: The logarithm of the odometry's noise changes by this, times how much an
            observation's normalized square is beyond what is expected ...
        surprise: ... where it counts as at most this ...
        margin: ... times this, so that chance alone does not add noise.
        most_noise: The modelled variances of odometry are multiplied by this, at most.
    """

    iterate_from: float = 0.03
    iterations: int = 3
    done: float = 1e-3
    weights: int = 20
    largest_weight: float = 0.95
    noise_gain: float = 0.04
    surprise: float = 5.0
    margin: float = 1.3
    most_noise: float = 50.0


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


@dataclass(frozen=True)
class Residual:
    """How an observation differs from its prediction.

    Attributes:
        squared: Squared Mahalanobis length.
        freedom: Its degrees of freedom.
        expected: What the normalized square is on average where the model is right.
    """

    squared: float
    freedom: int
    expected: float = 1.0


def corrected(
    state: TeamState, columns: Int, model: Model, noise: Float, inflated: float = 1.0
) -> tuple[TeamState, Residual]:
    """The state after an observation: iterated Kalman update (Bell & Cathey 1993).

    The correction is applied, and the covariance carried over to the corrected mean, by
    `TeamState.stepped`.

    Args:
        state: Before.
        columns: Indices of the part of the state that it concerns, the pose of a robot first,
            shape (k,).
        model: Residual, shape (m,), and Jacobian, shape (m, k), at that part.
        noise: Covariance of the observation, shape (m, m) ...
        inflated: ... which is so many times what single observations differ by.

    Returns:
        The state, and the residual before.
    """
    residual, jacobian = model(state.mean[columns])
    rows = state.covariance[:, columns]
    across, gain, found = _gain(rows, columns, jacobian, noise, residual, inflated)
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
    return changed(state, mean=mean, covariance=covariance), found


def _gain(
    rows: Float,
    columns: Int,
    jacobian: Float,
    noise: Float,
    residual: Float,
    inflated: float = 1.0,
) -> tuple[Float, Float, Residual]:
    """Covariance of state and prediction, the gain, and the residual."""
    across, freedom = rows @ jacobian.T, len(residual)
    inverse = np.linalg.inv(jacobian @ across[columns] + noise)
    squared, share = float(residual @ inverse @ residual), float((inverse * noise).sum()) / freedom
    expected = 1.0 - (1.0 - 1.0 / inflated) * share
    return across, across @ inverse, Residual(squared, freedom, expected)


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


#: What is seen of people and of robots, by whose errors odometry is judged also where they do not
#: fit: walls that do not may be others.
_SIGHTS = ("relative", "sighting", "standing people")


def _wheels_noted(state: TeamState, robot: str, accepted: bool, found: Residual) -> TeamState:
    """The state after the noise of a robot's odometry was adapted to what an observation says.

    Innovations that are larger than the filter expects come of wheels that are worse than their
    model, or than a base states: the noise grows until innovations are as large as expected, as in
    covariance matching (Mehra 1972, "Approaches to adaptive filtering"), and what it should have
    been since an observation fitted last is added.
    """
    trust = state.trust.get(robot, Trust())
    beyond = min(found.squared / found.freedom, _TUNING.surprise)
    beyond -= _TUNING.margin * found.expected
    noise = min(max(trust.noise * math.exp(_TUNING.noise_gain * beyond), 1.0), _TUNING.most_noise)
    now = state.odometry[robot]
    if not accepted and trust.reached is not None and noise > trust.noise:
        position = now.position_variance - trust.reached.position_variance
        heading = now.heading_variance - trust.reached.heading_variance
        aside = heading * ((now.x - trust.reached.x) ** 2 + (now.y - trust.reached.y) ** 2) / 3.0
        more = (noise - trust.noise) * np.array([position + aside, position + aside, heading])
        x, y, yaw = np.sqrt(np.maximum(more, 0.0)).tolist()
        state = state.widened(robot, (x, y, yaw))
    trust = changed(trust, noise=noise, reached=now if accepted else trust.reached)
    return changed(state, trust={**state.trust, robot: trust})


def noted(
    state: TeamState,
    robot: str,
    kind: str,
    accepted: bool,
    found: Residual,
    stamp_ns: int,
) -> TeamState:
    """The state with one more observation in `sources`, and what it tells of the odometry."""
    if kind in _SIGHTS or (accepted and kind != "claim"):
        state = _wheels_noted(state, robot, accepted, found)
    before = state.sources.get((robot, kind), Source())
    now = before.noted(accepted, found.squared, found.freedom, stamp_ns)
    return changed(state, sources={**state.sources, (robot, kind): now})

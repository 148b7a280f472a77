"""What the robots believe about their poses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.geometry import rotation_2d, wrap_angle
from mrs_tools.simulation.motion import LEAD_S, Track
from mrs_tools.simulation.scene import Odometry

#: Stated for an exact pose, so that no covariance is singular [m], [rad].
_EXACT_SIGMA, _EXACT_SIGMA_YAW = 1e-3, 1e-3


@dataclass(frozen=True)
class PoseSample:
    """One odometry message.

    Attributes:
        time: Since the first frame [s].
        x: In the message's frame [m].
        y: In the message's frame [m].
        yaw: In the message's frame [rad].
        covariance: Of x, y [m] and yaw [rad], shape (3, 3).
        velocity: Ahead [m/s].
        turn_rate: To the left [rad/s].
        sideways: To the left [m/s]; 0 for what drives only ahead and back.
    """

    time: float
    x: float
    y: float
    yaw: float
    covariance: NDArray
    velocity: float
    turn_rate: float
    sideways: float = 0.0


@dataclass(frozen=True)
class Belief:
    """What a robot says about its way.

    Attributes:
        frame: `map`, or `odom` for the robot's own frame.
        map_from_odom: x, y [m] and yaw [rad] of that frame in the map; None in `map`.
        samples: The messages, by time.
    """

    frame: str
    map_from_odom: tuple[float, float, float] | None
    samples: list[PoseSample]


def believe(track: Track, settings: Odometry, duration: float, rng: np.random.Generator) -> Belief:
    """Turns a true track into odometry with the errors of a mode (see `scene.Odometry`)."""
    step = 1.0 / settings.rate
    count = math.ceil((duration + 0.8 * LEAD_S) / step)
    # A little before the first image; not in step with the images.
    at = -0.019 - step * math.floor(0.1 / step) + step * np.arange(count)
    places = [track.at(float(t)) for t in at]
    truth = np.array([[p.x, p.y, p.yaw] for p in places])
    if settings.mode == "drift":
        return _drifting(at, truth, settings, rng, track.free)
    believed, covariance = truth, np.diag([_EXACT_SIGMA**2] * 2 + [_EXACT_SIGMA_YAW**2])
    if settings.mode == "localized":
        sigmas = np.array([settings.sigma, settings.sigma, settings.sigma_yaw])
        believed = truth + sigmas * _wandering(at, settings.period, rng)
        covariance = np.diag(np.maximum(sigmas, 1e-4) ** 2)
    return Belief("map", None, _samples(at, believed, [covariance] * count, track.free))


def _wandering(at: NDArray, period: float, rng: np.random.Generator) -> NDArray:
    """Three errors of unit variance that change within a period, shape (n, 3)."""
    amplitude = rng.normal(size=(2, 6, 3)) / math.sqrt(6.0)
    frequency = rng.uniform(0.1, 1.0, (6, 3)) / period
    phase = 2 * np.pi * at[:, None, None] * frequency
    return (amplitude[0] * np.cos(phase) + amplitude[1] * np.sin(phase)).sum(axis=1)


def _drifting(
    at: NDArray, truth: NDArray, settings: Odometry, rng: np.random.Generator, free: bool
) -> Belief:
    """Integrates the true motions with errors; the covariance is integrated along."""
    count = len(at)
    believed = np.zeros((count, 3))
    covariances = [
        np.diag([max(settings.sigma, 1e-4) ** 2] * 2 + [max(settings.sigma_yaw, 1e-4) ** 2])
    ]
    for k in range(1, count):
        ahead = rotation_2d(-truth[k - 1, 2]) @ (truth[k, :2] - truth[k - 1, :2])
        turned = wrap_angle(truth[k, 2] - truth[k - 1, 2])
        way = float(np.linalg.norm(ahead)) + 0.2 * abs(turned)
        sigma, sigma_yaw = settings.drift * math.sqrt(way), settings.drift_yaw * math.sqrt(way)
        moved = ahead + rng.normal(0.0, 1.0, 2) * sigma
        turn = rotation_2d(believed[k - 1, 2])
        step = turn @ moved
        believed[k, :2] = believed[k - 1, :2] + step
        believed[k, 2] = believed[k - 1, 2] + turned + rng.normal() * sigma_yaw
        jacobian = np.eye(3)
        jacobian[:2, 2] = (-step[1], step[0])
        noise = np.diag([sigma**2, sigma**2, sigma_yaw**2])
        covariances.append(jacobian @ covariances[-1] @ jacobian.T + noise)
    # Where it starts is known with the error of the start.
    start = truth[0] + rng.normal(size=3) * [settings.sigma, settings.sigma, settings.sigma_yaw]
    map_from_odom = (float(start[0]), float(start[1]), wrap_angle(float(start[2])))
    return Belief("odom", map_from_odom, _samples(at, believed, covariances, free))


def _samples(
    at: NDArray, believed: NDArray, covariances: list[NDArray], free: bool
) -> list[PoseSample]:
    rates = np.gradient(believed, at, axis=0)
    speeds = rates[:, 0] * np.cos(believed[:, 2]) + rates[:, 1] * np.sin(believed[:, 2])
    aside = rates[:, 1] * np.cos(believed[:, 2]) - rates[:, 0] * np.sin(believed[:, 2])
    return [
        PoseSample(
            float(at[k]),
            float(believed[k, 0]), float(believed[k, 1]), wrap_angle(float(believed[k, 2])),
            covariances[k], float(speeds[k]), float(rates[k, 2]), float(aside[k]) if free else 0.0,
        )
        for k in range(len(at))
    ]  # fmt: skip

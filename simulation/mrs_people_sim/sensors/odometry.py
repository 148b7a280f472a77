"""What the robots believe about their poses."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.geometry import wrap_angle
from mrs_people_sim.motion import LEAD_S, STEP_S, Track
from mrs_people_sim.scene import Odometry, Robot

#: Stated for an exact pose of x, y [m] and yaw [rad], so that no covariance is singular.
EXACT_SIGMAS = (1e-3, 1e-3, 1e-3)


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


def believe(
    track: Track,
    settings: Odometry,
    duration: float,
    rng: np.random.Generator,
    robot: Robot = Robot(),  # noqa: B008
) -> Belief:
    """Turns a true track into odometry with the errors of a mode (see `scene.Odometry`).

    Args:
        track: Where the robot is.
        settings: The errors.
        duration: Length of the scene [s].
        rng: Source of randomness.
        robot: Says when its wheels slip, and when it is carried.
    """
    step = 1.0 / settings.rate
    count = math.ceil((duration + 0.8 * LEAD_S) / step)
    # A little before the first image; not in step with the images.
    at = -0.019 - step * math.floor(0.1 / step) + step * np.arange(count)
    places = [track.at(float(t)) for t in at]
    truth = np.array([[p.x, p.y, p.yaw] for p in places])
    if settings.mode == "drift":
        return _drifting(at, truth, settings, rng, robot, track.free)
    believed, covariance = truth, np.diag(np.square(EXACT_SIGMAS))
    if settings.mode == "localized":
        sigmas = np.array([settings.sigma, settings.sigma, settings.sigma_yaw])
        believed = truth + sigmas * Wandering(settings.period, rng).at(at)
        covariance = np.diag(np.maximum(sigmas, 1e-4) ** 2)
    return Belief("map", None, _samples(at, believed, [covariance] * count, track.free))


class Wandering:
    """Three errors of unit variance that change within a period.

    Args:
        period: In which they change [s].
        rng: Source of randomness.
    """

    def __init__(self, period: float, rng: np.random.Generator) -> None:
        self._amplitude = rng.normal(size=(2, 6, 3)) / math.sqrt(6.0)
        self._frequency = rng.uniform(0.1, 1.0, (6, 3)) / period

    def at(self, times: NDArray) -> NDArray:
        """The errors at times [s], shape (n, 3)."""
        phase = 2 * np.pi * np.asarray(times)[:, None, None] * self._frequency
        of_cos, of_sin = self._amplitude
        return (of_cos * np.cos(phase) + of_sin * np.sin(phase)).sum(axis=1)


def _drifting(
    at: NDArray,
    truth: NDArray,
    settings: Odometry,
    rng: np.random.Generator,
    robot: Robot,
    free: bool,
) -> Belief:
    """Integrates the motions that the wheels see, with errors; the covariance along with them."""
    steps = seen_steps(at, truth, robot, rng)
    sigmas = step_sigmas(steps, settings)
    believed = dead_reckoned(steps + sigmas * rng.normal(size=steps.shape))
    start_sigmas = [settings.sigma, settings.sigma, settings.sigma_yaw]
    covariances = [np.diag(np.maximum(start_sigmas, 1e-4) ** 2)]
    for (dx, dy), sigma in zip(np.diff(believed[:, :2], axis=0), sigmas, strict=True):
        jacobian = np.eye(3)
        jacobian[:2, 2] = (-dy, dx)
        covariances.append(jacobian @ covariances[-1] @ jacobian.T + np.diag(sigma**2))
    # Where it starts is known with the error of the start.
    start = truth[0] + rng.normal(size=3) * start_sigmas
    map_from_odom = (float(start[0]), float(start[1]), wrap_angle(float(start[2])))
    return Belief("odom", map_from_odom, _samples(at, believed, covariances, free))


def seen_steps(at: NDArray, truth: NDArray, robot: Robot, rng: np.random.Generator) -> NDArray:
    """Motions from each time to the next, in the robot's frame at the first, as wheels see them.

    Args:
        at: Times [s], shape (n,).
        truth: True x, y [m] and yaw [rad] then, shape (n, 3).
        robot: Says how its wheels err, when they slip, and when it is carried.
        rng: Source of randomness.

    Returns:
        Ahead, left [m] and turned to the left [rad], shape (n - 1, 3).
    """
    cos, sin = np.cos(truth[:-1, 2]), np.sin(truth[:-1, 2])
    dx, dy, turned = np.diff(truth, axis=0).T
    turned = (turned + np.pi) % (2 * np.pi) - np.pi
    steps = np.stack([cos * dx + sin * dy, cos * dy - sin * dx, turned], axis=1)
    if robot.carried:
        time = robot.carried[0]
        jumps = np.flatnonzero((at[1:] > time) & (at[:-1] < time + STEP_S))
        steps[jumps] = steps[max(jumps.min(initial=1) - 1, 0)]
    steps = by_wheels(steps, robot, rng)
    if robot.slip:
        time, *error = robot.slip
        steps[(at[:-1] < time) & (time <= at[1:])] += error
    if robot.frozen:
        hangs = np.flatnonzero([is_frozen(robot, float(time)) for time in at[1:]])
        later = hangs[-1:] + 1
        if robot.catches_up and (later < len(steps)).all():
            steps[later] = dead_reckoned(steps[[*hangs, *later]])[-1]
        steps[hangs] = 0.0
    return steps


def by_wheels(steps: NDArray, robot: Robot, rng: np.random.Generator) -> NDArray:
    """Motions as wheels with systematic errors, on a floor with bumps, see them, shape (n, 3)."""
    seen = steps.copy()
    if robot.wheels:
        longer, per_metre, per_radian = robot.wheels
        seen[:, :2] /= 1.0 + longer
        seen[:, 2] = (steps[:, 2] - per_metre * seen[:, 0]) / (1.0 + per_radian)
    if robot.bumps:
        every, *sigmas = robot.bumps
        bumped = rng.random(len(steps)) * every < np.hypot(steps[:, 0], steps[:, 1])
        seen += bumped[:, None] * rng.normal(size=steps.shape) * np.array(sigmas)[[0, 0, 1]]
    return seen


def is_frozen(robot: Robot, time: float) -> bool:
    """Whether its odometry hangs at a time [s]."""
    return bool(robot.frozen) and robot.frozen[0] < time <= sum(robot.frozen)


def step_sigmas(steps: NDArray, settings: Odometry) -> NDArray:
    """Standard deviations of what odometry makes of motions [m, m, rad], shape (n, 3)."""
    way = np.hypot(steps[:, 0], steps[:, 1]) + 0.2 * np.abs(steps[:, 2])
    return np.sqrt(way)[:, None] * [settings.drift, settings.drift, settings.drift_yaw]


def dead_reckoned(steps: NDArray) -> NDArray:
    """Poses after motions in the robot's frame, from x = y = yaw = 0 on, shape (n + 1, 3)."""
    yaw = np.concatenate([[0.0], np.cumsum(steps[:, 2])])
    cos, sin = np.cos(yaw[:-1]), np.sin(yaw[:-1])
    x = np.cumsum(cos * steps[:, 0] - sin * steps[:, 1])
    y = np.cumsum(sin * steps[:, 0] + cos * steps[:, 1])
    return np.stack([np.append(0.0, x), np.append(0.0, y), yaw], axis=1)


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

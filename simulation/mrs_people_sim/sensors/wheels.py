"""A base with two driven wheels that obeys velocity commands, and its odometry."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.geometry import wrap_angle
from mrs_people_sim.scene import Odometry, Robot
from mrs_people_sim.sensors.odometry import (
    EXACT_SIGMAS,
    PoseSample,
    Wandering,
    by_wheels,
    is_frozen,
    step_sigmas,
)


@dataclass(frozen=True)
class WheelLimits:
    """What a base can do.

    Attributes:
        speed: Highest speed, ahead and backwards [m/s].
        turn: Highest rate of turn [rad/s].
        acceleration: Highest change of the speed [m/s^2].
        turn_acceleration: Highest change of the rate of turn [rad/s^2].
        timeout: The base stops if no command has come for this long [s], as most drivers do.
    """

    speed: float = 1.0
    turn: float = 2.0
    acceleration: float = 2.0
    turn_acceleration: float = 4.0
    timeout: float = 0.5


LIMITS = WheelLimits()


class Wheels:
    """A differential drive: a unicycle with limits.

    Args:
        start: True x, y [m] and yaw [rad] in the map.
        settings: The errors of its odometry.
        rng: Source of randomness.
        robot: Says how its odometry errs beyond that; it is neither carried, nor do wheels slip.
        limits: What it can do.

    Attributes:
        pose: True x, y [m] and yaw [rad], shape (3,).
        speed: Ahead [m/s].
        turn_rate: To the left [rad/s].
        frame: Of its odometry: `map`, or `odom` for a frame of its own (mode `drift`).
        map_from_odom: x, y [m] and yaw [rad] of that frame in the map, as far as it is known; None
            in `map`.
        time: Since the start [s].
    """

    def __init__(
        self,
        start: tuple[float, float, float],
        settings: Odometry,
        rng: np.random.Generator,
        robot: Robot = Robot(),  # noqa: B008
        limits: WheelLimits = LIMITS,
    ) -> None:
        self.pose: Float = np.array(start, dtype=np.float64)
        self.speed = self.turn_rate = self.time = 0.0
        self._settings, self._rng, self._robot, self._limits = settings, rng, robot, limits
        self._command, self._commanded = (0.0, 0.0), -math.inf
        sigmas = np.array([settings.sigma, settings.sigma, settings.sigma_yaw])
        self._wandering = Wandering(settings.period, rng)
        self.frame = "map"
        self.map_from_odom: tuple[float, float, float] | None = None
        self._believed = self._said = np.zeros(3)
        self._covariance = np.diag(np.maximum(sigmas, 1e-4) ** 2)
        if settings.mode == "drift":
            x, y, yaw = self.pose + sigmas * rng.normal(size=3)
            self.frame = "odom"
            self.map_from_odom = float(x), float(y), wrap_angle(float(yaw))

    @property
    def velocity(self) -> Float:
        """In the map [m/s], shape (2,)."""
        yaw = float(self.pose[2])
        return self.speed * np.array([math.cos(yaw), math.sin(yaw)])

    def command(self, speed: float, turn_rate: float) -> None:
        """Takes a command; one that is not finite is to stop.

        Args:
            speed: Ahead [m/s].
            turn_rate: To the left [rad/s].
        """
        if not (math.isfinite(speed) and math.isfinite(turn_rate)):
            speed = turn_rate = 0.0
        self._command, self._commanded = (speed, turn_rate), self.time

    def step(self, dt: float) -> None:
        """Drives on.

        Args:
            dt: For so long [s].
        """
        limits = self._limits
        late = self.time - self._commanded > limits.timeout - 1e-9
        speed, turn = (0.0, 0.0) if late else self._command
        speed = min(max(speed, -limits.speed), limits.speed)
        turn = min(max(turn, -limits.turn), limits.turn)
        before = self.speed, self.turn_rate
        self.speed = _approached(self.speed, speed, limits.acceleration * dt)
        self.turn_rate = _approached(self.turn_rate, turn, limits.turn_acceleration * dt)
        ahead = 0.5 * (before[0] + self.speed) * dt
        turned = 0.5 * (before[1] + self.turn_rate) * dt
        self.pose = _moved(self.pose, (ahead, 0.0, turned))
        self.time += dt
        frozen = is_frozen(self._robot, self.time)
        if self._settings.mode == "drift" and (self._robot.catches_up or not frozen):
            self._dead_reckon(np.array([ahead, 0.0, turned]))
        if not frozen:
            self._said = self._believed

    def _dead_reckon(self, step: Float) -> None:
        """Integrates a motion with errors, and their covariance."""
        step = by_wheels(step[None], self._robot, self._rng)[0]
        sigmas = step_sigmas(step[None], self._settings)[0]
        before = self._believed
        self._believed = _moved(before, step + sigmas * self._rng.normal(size=3))
        dx, dy = self._believed[:2] - before[:2]
        jacobian = np.eye(3)
        jacobian[:2, 2] = (-dy, dx)
        self._covariance = jacobian @ self._covariance @ jacobian.T + np.diag(sigmas**2)

    def block(self, xy: Float) -> None:
        """The base is held by what it has run into; its wheels have turned all the same.

        Args:
            xy: Where it stands [m], shape (2,).
        """
        self.pose = np.array([xy[0], xy[1], self.pose[2]])
        self.speed = 0.0

    def odometry(self) -> PoseSample:
        """What it says now about its pose, in `frame`."""
        settings, believed = self._settings, self.pose
        covariance = np.diag(np.square(EXACT_SIGMAS))
        if settings.mode == "localized":
            sigmas = np.array([settings.sigma, settings.sigma, settings.sigma_yaw])
            believed = believed + sigmas * self._wandering.at(np.array([self.time]))[0]
            covariance = np.diag(np.maximum(sigmas, 1e-4) ** 2)
        elif settings.mode == "drift":
            believed, covariance = self._said, self._covariance
        x, y, yaw = map(float, believed)
        return PoseSample(self.time, x, y, wrap_angle(yaw), covariance, self.speed, self.turn_rate)


def _approached(value: float, wanted: float, most: float) -> float:
    """The value, brought nearer to another by so much at most."""
    return value + min(max(wanted - value, -most), most)


def _moved(pose: Float, step: Float | tuple[float, float, float]) -> Float:
    """A pose after a motion ahead, to the left [m] and turned to the left [rad]; by its chord."""
    ahead, left, turned = step
    middle = float(pose[2]) + 0.5 * turned
    cos, sin = math.cos(middle), math.sin(middle)
    return np.array(
        [
            pose[0] + cos * ahead - sin * left,
            pose[1] + sin * ahead + cos * left,
            wrap_angle(float(pose[2]) + turned),
        ]
    )

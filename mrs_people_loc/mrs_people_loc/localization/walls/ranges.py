"""What range sensors measure, as their messages say it."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.errors import RangeError


@dataclass(frozen=True)
class RangeLimits:
    """What messages of range sensors may say: beyond what any of these sensors does.

    Attributes:
        longest: Range of a sonar [m].
        rays: Of a scan.
        sweep_s: Duration of a scan [s].
        turn: Angle of a scan: a full turn, and what float32 makes of it [rad].
    """

    longest: float = 100.0
    rays: int = 100_000
    sweep_s: float = 2.0
    turn: float = 2.0 * math.pi + 0.01


_LIMITS = RangeLimits()


@dataclass(frozen=True)
class SonarRange:
    """One range of a sonar (sensor_msgs/Range).

    Attributes:
        stamp_ns: Time [ns].
        frame_id: The sensor's frame; its x axis is the axis of the cone.
        field_of_view: The whole cone [rad].
        min_range: Nearest range that it measures [m].
        max_range: Farthest [m].
        range: To the nearest thing in the cone [m]; not finite, or not between the two: nothing.
        variance: Of the range [m^2]; 0: unknown.

    Raises:
        RangeError: Naming what cannot be used, what it is and what is wanted.
    """

    stamp_ns: int
    frame_id: str
    field_of_view: float
    min_range: float
    max_range: float
    range: float
    variance: float = 0.0

    def __post_init__(self) -> None:
        """Checks all values."""
        if not 0.0 < self.field_of_view <= math.pi:  # NaN compares false
            raise RangeError(
                f"field_of_view is {self.field_of_view} rad; allowed: more than 0, at most pi"
            )
        if not 0.0 <= self.min_range < self.max_range <= _LIMITS.longest:
            raise RangeError(
                f"min_range is {self.min_range} m and max_range {self.max_range} m; wanted: "
                f"0 <= min_range < max_range <= {_LIMITS.longest:g} (they are equal where a sensor "
                "says near or far only, which is of no use here)"
            )

        if not 0.0 <= self.variance < math.inf:
            raise RangeError(
                f"variance is {self.variance} m^2; wanted: at least 0 (unknown), finite"
            )

    @property
    def is_echo(self) -> bool:
        """Whether something was measured."""
        return self.min_range <= self.range <= self.max_range


@dataclass(frozen=True)
class LaserScan:
    """One scan of a laser scanner (sensor_msgs/LaserScan).

    Attributes:
        stamp_ns: Time of the first ray [ns].
        frame_id: The scanner's frame; its plane is x, y.
        max_range: Farthest range that it measures [m].
        angles: Directions of the rays, from x to the left [rad], ascending, shape (n,).
        ranges: [m], shape (n,); NaN where nothing was measured, inf where nothing was hit, -inf
            where something is too near to be measured (REP 117).
        sweep_s: Time from the ray of the first angle to that of the last one [s]; negative: the
            last one was the first in time. 0: all at once, or not known.
        min_range: Nearest range that it measures [m].

    Raises:
        RangeError: Naming what cannot be used, what it is and what is wanted.
    """

    stamp_ns: int
    frame_id: str
    max_range: float
    angles: Float
    ranges: Float
    sweep_s: float = 0.0
    min_range: float = 0.0

    def __post_init__(self) -> None:
        """Checks all values."""
        if not 0.0 < self.max_range < math.inf:  # NaN compares false
            raise RangeError(f"max_range is {self.max_range} m; wanted: more than 0, finite")
        if not 0 < len(self.ranges) <= _LIMITS.rays:
            raise RangeError(f"scan has {len(self.ranges)} ranges; allowed: 1 to {_LIMITS.rays}")
        if self.angles.shape != self.ranges.shape or self.ranges.ndim != 1:
            raise RangeError(
                f"angles have shape {self.angles.shape} and ranges {self.ranges.shape}; wanted: "
                "both (n,)"
            )
        if not abs(self.sweep_s) <= _LIMITS.sweep_s:
            raise RangeError(
                f"scan takes {self.sweep_s} s (time_increment times its rays); allowed: up to "
                f"{_LIMITS.sweep_s:g} s"
            )
        if not np.isfinite(self.angles).all() or (np.diff(self.angles) <= 0).any():
            raise RangeError("angles are no ascending, finite ones [rad]")
        if self.angles[-1] - self.angles[0] > _LIMITS.turn:
            raise RangeError(
                f"scan covers {self.angles[-1] - self.angles[0]:.2f} rad; allowed: a full turn"
            )

"""Range sensors: sonars and laser scanners."""

from __future__ import annotations

import math

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.errors import RangeError
from mrs_people_loc.localization.walls.ranges import LaserScan, SonarRange
from mrs_people_loc.messages.stamps import Message, read_stamp


def read_range(message: Message) -> SonarRange:
    """Reads sensor_msgs/Range.

    Raises:
        RangeError: A limit of the sensor cannot be used.
        StampError: Its stamp is 0.
    """
    return SonarRange(
        stamp_ns=read_stamp(message),
        frame_id=str(message.header.frame_id).lstrip("/"),
        field_of_view=float(message.field_of_view),
        min_range=float(message.min_range),
        max_range=float(message.max_range),
        range=float(message.range),
        variance=float(getattr(message, "variance", 0.0)),  # not before Iron
    )


def read_laser_scan(message: Message) -> LaserScan:
    """Reads sensor_msgs/LaserScan, with its rays from right to left.

    Raises:
        RangeError: A limit, an angle or the number of ranges cannot be used.
        StampError: Its stamp is 0.
    """
    first, step = float(message.angle_min), float(message.angle_increment)
    low, high = float(message.range_min), float(message.range_max)
    if not (math.isfinite(first) and math.isfinite(step) and step != 0.0):
        raise RangeError(
            f"angle_min is {first} and angle_increment {step} rad; wanted: finite, and a step that "
            "is not 0"
        )
    if not low >= 0.0:  # NaN compares false
        raise RangeError(f"range_min is {low} m; wanted: at least 0")
    with np.errstate(over="ignore", invalid="ignore"):  # any bits may come as float32
        ranges = np.array(message.ranges, dtype=np.float64)
        measured = (ranges >= low) & (ranges <= high)
        angles: Float = first + step * np.arange(len(ranges), dtype=np.float64)
    forward = 1 if step > 0 else -1
    order = slice(None, None, forward)
    return LaserScan(
        stamp_ns=read_stamp(message),
        frame_id=str(message.header.frame_id).lstrip("/"),
        max_range=high,
        angles=angles[order],
        ranges=np.where(measured | np.isinf(ranges), ranges, np.nan)[order],  # REP 117
        sweep_s=forward * float(message.time_increment) * max(len(ranges) - 1, 0),
        min_range=low,
    )

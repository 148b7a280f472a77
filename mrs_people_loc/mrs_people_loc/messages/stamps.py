"""Stamps of messages."""

from __future__ import annotations

from typing import Any

from mrs_people_loc.errors import StampError

#: A message of rclpy's, or of rosbags' classes.
Message = Any


def stamp_ns_of(stamp: Message) -> int:
    """Time of a builtin_interfaces/Time [ns]."""
    return int(stamp.sec) * 1_000_000_000 + int(stamp.nanosec)


def read_stamp(message: Message) -> int:
    """Time of a message of a sensor [ns].

    Raises:
        StampError: It is 0: its sender sets none.
    """
    stamp_ns = stamp_ns_of(message.header.stamp)
    if stamp_ns == 0:
        raise StampError(
            "stamp is 0: its sender sets none, and without stamps images find no pair and scans no "
            "pose; let the driver set them (or, with use_sim_time, start /clock before it)"
        )
    return stamp_ns

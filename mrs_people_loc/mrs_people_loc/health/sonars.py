"""Sonars that send, and measure nothing."""

from __future__ import annotations

from dataclasses import dataclass

from mrs_people_loc.localization.walls.ranges import SonarRange

#: A sonar that says the same for so long [s] ...
_SECONDS = 20.0
#: ... and on so much way [m] is dead.
_WAY = 3.0


@dataclass(frozen=True)
class SameReading:
    """What a sonar says all the time.

    Attributes:
        value: The range [m]; None: no echo, whatever number stands for that.
        seconds: Since when [s].
        way: What the robot has driven since [m].
    """

    value: float | None
    seconds: float
    way: float


class SonarWatch:
    """Which sonars of a robot say the same all the time while it drives."""

    def __init__(self) -> None:
        # By topic: the reading, and stamp [ns] and way [m] since when it is the same and now.
        self._since: dict[str, tuple[float | None, int, float]] = {}
        self._now: dict[str, tuple[int, float]] = {}

    def take(self, topic: str, measured: SonarRange, way: float) -> None:
        """Takes a reading.

        Args:
            topic: Of the sonar.
            measured: What it says.
            way: What the robot has driven so far [m].
        """
        has_echo = measured.is_echo and measured.range < measured.max_range
        value = measured.range if has_echo else None
        before = self._since.get(topic)
        if before is None or before[0] != value or measured.stamp_ns < before[1] or way < before[2]:
            self._since[topic] = value, measured.stamp_ns, way
        self._now[topic] = measured.stamp_ns, way

    def dead(self) -> dict[str, SameReading]:
        """Those that say the same for too long, by topic."""
        found = {}
        for topic, (value, since_ns, way) in sorted(self._since.items()):
            now_ns, now_way = self._now[topic]
            same = SameReading(value, (now_ns - since_ns) / 1e9, now_way - way)
            if same.seconds >= _SECONDS and same.way >= _WAY:
                found[topic] = same
        return found

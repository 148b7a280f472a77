"""How fast the leader goes: slower as the group stretches, or as its robots fall behind."""

from __future__ import annotations

from dataclasses import dataclass

from mrs_people_loc import config as cfg


@dataclass(frozen=True)
class PaceTuning:
    """Constants of the leader's pace; chosen.

    Attributes:
        more_gap: The leader waits where the group is farther behind than `pace.lead` by this [m].
        stands_s: A group that stands for so long [s] without a straggler is as near and as close
            as it comes: ...
        relaxes: ... the limits of gap and stretch grow by this [m/s], ...
        most: ... by no more than this in all [m], ...
        goes_on: ... until the leader may go at this share of its speed,
        recovers: ... and shrink to those of the parameters by this while it goes [m/s].
        off: The leader slows down while the other robots are farther than the first from their
            posts, on the average, and is slowest from the second on [m]: nobody would see those in
            the middle of a large group.
        slowest: This share of its speed.
        caught_up_s: It does so for no longer than this, until they are there again [s].
        starts: The leader sets off at this share of its speed at least, and stands below it.
        acceleration: Highest increase of the speed [m/s^2].
        deceleration: Highest decrease [m/s^2].
    """

    more_gap: float = 1.6
    stands_s: float = 3.0
    relaxes: float = 1.0
    most: float = 3.0
    goes_on: float = 0.5
    recovers: float = 0.05
    off: tuple[float, float] = (0.7, 1.5)
    slowest: float = 0.15
    caught_up_s: float = 20.0
    starts: float = 0.15
    acceleration: float = 0.4
    deceleration: float = 1.0


PACE_TUNING = PaceTuning()


class PaceControl:
    """The leader's speed.

    Args:
        tuning: Constants.

    Attributes:
        speed: Now [m/s].
        in_vain_s: For how long the leader has waited though the limits cannot grow any more [s].
    """

    def __init__(self, tuning: PaceTuning = PACE_TUNING) -> None:
        self.tuning = tuning
        self.speed = self.in_vain_s = 0.0
        self._stood_s = 0.0
        self._relaxed, self._relaxes = 0.0, False
        self._off_s = 0.0

    def stand(self) -> float:
        """The leader stands from now on, whatever the group does: 0 m/s."""
        self.speed = self._stood_s = self.in_vain_s = 0.0
        return self.speed

    def step(
        self,
        config: cfg.Pace,
        *,
        highest: float,
        gap: float,
        stretch: float,
        dt_s: float,
        off: float = 0.0,
    ) -> float:
        """The speed for an interval.

        Args:
            config: Parameters.
            highest: Speed that the tour allows [m/s].
            gap: How far the leader is ahead of the foremost person along the way [m].
            stretch: Length of the group along the way [m].
            dt_s: Time since the last interval [s].
            off: How far the other robots are from their posts, on the average [m].

        Returns:
            [m/s].
        """
        tuning = self.tuning
        highest *= self._together(off, dt_s)
        if self._relaxes or self._stood_s > tuning.stands_s:
            self._relaxed = min(self._relaxed + tuning.relaxes * dt_s, tuning.most)
        elif self.speed > 0.0:
            self._relaxed = max(self._relaxed - tuning.recovers * dt_s, 0.0)
        share = falls(stretch - self._relaxed, config.stretch, config.max_stretch)
        share *= falls(gap - self._relaxed, config.lead, config.lead + tuning.more_gap)
        self._relaxes = self._stood_s > tuning.stands_s or (
            self._relaxes and share < tuning.goes_on
        )
        wanted = highest * share if share >= tuning.starts else 0.0
        low = self.speed - tuning.deceleration * dt_s
        high = max(self.speed, tuning.starts * highest) + tuning.acceleration * dt_s
        self.speed = min(max(wanted, low, 0.0), high)
        self._stood_s = self._stood_s + dt_s if self.speed == 0.0 else 0.0
        waits = self.speed == 0.0 and self._relaxed >= tuning.most
        self.in_vain_s = self.in_vain_s + dt_s if waits else 0.0
        return self.speed

    def _together(self, off: float, dt_s: float) -> float:
        """Share of the speed at which the other robots catch up."""
        tuning = self.tuning
        part = falls(off, *tuning.off)
        self._off_s = self._off_s + dt_s if part < 1.0 else 0.0
        return 1.0 if self._off_s > tuning.caught_up_s else max(part, tuning.slowest)


def falls(value: float, full: float, none: float) -> float:
    """1 up to `full`, 0 from `none` on, a smooth fall between them."""
    if value <= full:
        return 1.0
    if value >= none:
        return 0.0
    part = (value - full) / (none - full)
    return 1.0 - part * part * (3.0 - 2.0 * part)

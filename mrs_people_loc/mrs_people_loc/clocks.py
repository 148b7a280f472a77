"""Clocks: the order of stamps, and the offset of a sender's clock from the receiver's."""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass, field
from enum import Enum

#: A stamp that jumps back by more than this may be a new beginning (a bag that loops) [ns].
RESET_NS = 1_000_000_000
#: So many in succession make it one; fewer are messages that come late.
BELIEVED = 3


class Order(Enum):
    """How a stamp follows those before it."""

    NEWER = "newer"
    LATE = "late"
    RESTART = "restart"


@dataclass
class StampOrder:
    """Whether the stamps of a stream go forward.

    One message that comes late, however late, changes nothing. Where several in succession are
    older than the newest by more than `RESET_NS`, and go forward among themselves, time has jumped
    back: the stream begins again.

    Attributes:
        newest_ns: The newest stamp [ns]; None before the first.
        resets: How often time jumped back, so far.
    """

    newest_ns: int | None = None
    resets: int = 0
    _back: int = 0
    _last_back_ns: int = 0

    def take(self, stamp_ns: int) -> Order:
        """Takes a stamp [ns]; LATE ones (also the repeated) are not remembered."""
        if self.newest_ns is None or stamp_ns > self.newest_ns:
            self.newest_ns, self._back = stamp_ns, 0
            return Order.NEWER
        if self.newest_ns - stamp_ns <= RESET_NS:
            return Order.LATE
        self._back = self._back + 1 if self._back and stamp_ns > self._last_back_ns else 1
        self._last_back_ns = stamp_ns
        if self._back < BELIEVED:
            return Order.LATE
        self.newest_ns, self._back = stamp_ns, 0
        self.resets += 1
        return Order.RESTART

    def reset(self) -> None:
        """Forgets the newest stamp."""
        self.newest_ns, self._back = None, 0


@dataclass
class Standstill:
    """For how long a clock, such as that of a simulation, stands still."""

    _value: float = math.nan
    _since_s: float = 0.0

    def lasts_s(self, value: float, steady_s: float) -> float:
        """How long it has been so [s].

        Args:
            value: Of the clock.
            steady_s: Of a clock that goes on [s].
        """
        if value != self._value:
            self._value, self._since_s = value, steady_s
        return steady_s - self._since_s


class RateLimit:
    """Lets messages through at most at a rate, by their stamps."""

    def __init__(self) -> None:
        self._due_ns: int | None = None

    def lets_through(self, stamp_ns: int, rate_hz: float) -> bool:
        """Whether a message goes through.

        A tenth of the period is allowed for jitter, so 100 Hz stay 100 Hz; the next one is due a
        period after this one was, so that the rate holds in the long run. Where stamps jump back by
        more than a period, it begins again.

        Args:
            stamp_ns: Its stamp [ns].
            rate_hz: The rate [Hz].
        """
        period_ns, due_ns = round(1e9 / rate_hz), self._due_ns
        if due_ns is None or due_ns - stamp_ns > 2 * period_ns:
            due_ns = stamp_ns
        if due_ns - stamp_ns > period_ns // 10:
            return False
        self._due_ns = period_ns + (stamp_ns if stamp_ns - due_ns >= period_ns else due_ns)
        return True

    def reset(self) -> None:
        """Lets the next one through, whatever its stamp."""
        self._due_ns = None


@dataclass
class ClockOffset:
    """Offset of a sender's clock from the receiver's, estimated from stamps and arrivals.

    `stamp - arrival` is the offset less the delay. Delays vary and are never negative, so over a
    while the greatest one is the offset less the least delay. One stamp may be wrong, so the second
    greatest of some spans of time counts.

    Attributes:
        heard_ns: When the last message arrived [ns]; None before the first.
    """

    heard_ns: int | None = None
    _greatest: deque[tuple[int, int]] = field(default_factory=deque)  # span, its greatest [ns]
    _first_ns: int = 0

    #: The spans, and how many of them count.
    _SPAN_NS, _SPANS = 500_000_000, 20
    #: A clock is behind only after a sender was heard for so long: delays may be long at the
    #: beginning [ns].
    _SETTLE_NS = 2_000_000_000

    def add(self, stamp_ns: int, now_ns: int, *, restarted: bool = False) -> None:
        """Takes a message with this stamp that arrives now [ns]; if restarted, as the first one."""
        if restarted:
            self.reset()
        self.heard_ns = now_ns
        offset_ns, span = stamp_ns - now_ns, now_ns // self._SPAN_NS
        if self._greatest and self._greatest[-1][0] > span:
            self._greatest.clear()  # the receiver's clock was set back
        self._end(span)
        if not self._greatest:
            self._first_ns = now_ns
        if self._greatest and self._greatest[-1][0] == span:
            self._greatest[-1] = span, max(offset_ns, self._greatest[-1][1])
        else:
            self._greatest.append((span, offset_ns))

    def at(self, now_ns: int) -> int | None:
        """What the sender's clock is ahead by [ns]; None where nothing came for a while."""
        self._end(now_ns // self._SPAN_NS)
        return sorted(offset for _, offset in self._greatest)[-2:][0] if self._greatest else None

    def is_settled(self, now_ns: int) -> bool:
        """Whether the sender has been heard for long enough to find that its clock is behind."""
        return bool(self._greatest) and now_ns - self._first_ns >= self._SETTLE_NS

    def reset(self) -> None:
        """Forgets what arrived."""
        self._greatest.clear()

    def _end(self, span: int) -> None:
        while self._greatest and self._greatest[0][0] <= span - self._SPANS:
            self._greatest.popleft()


def right_offset(offsets_ns: Iterable[int]) -> int:
    """What the right clock is ahead of the receiver's by [ns]: that of the nearest one.

    So the receiver decides among several, and in a recording that is played later, where all are
    off alike, all are right.

    Args:
        offsets_ns: What the senders' clocks are ahead of the receiver's by [ns].
    """
    return min(offsets_ns, key=abs, default=0)

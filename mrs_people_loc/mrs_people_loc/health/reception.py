"""Which messages of an input were used, and which of the others their sender is to blame for."""

from __future__ import annotations

from collections import Counter

from mrs_people_loc.clocks import BELIEVED, RESET_NS, Order, StampOrder
from mrs_people_loc.errors import OutdatedError
from mrs_people_loc.health.findings import SILENCE_S


class Reception:
    """Counts the messages of an input.

    Where stamps jump back, the first messages after it are refused until the jump is believed;
    after a jump of `/clock`, those that were on their way. They are counted (`jumped_back`,
    `OutdatedError`), but not as faults of their sender.

    Attributes:
        received: Messages so far.
        dropped: Messages that were not used so far, by reason.
        refused: Those of them that their sender is to blame for.
        refused_in_a_row: Those since the last message that was used.
        taken: Whether any message was used.
        last_error: Why the last one was refused.
        last_kind: Class of that error.
    """

    def __init__(self) -> None:
        self.received = 0
        self.dropped: Counter[str] = Counter()
        self.refused = 0
        self.refused_in_a_row = 0
        self.taken = False
        self.last_error = ""
        self.last_kind = ""
        self._order = StampOrder()
        self._held: list[tuple[str, str]] = []  # refused, perhaps because of a jump: kind and text
        self._outdated_since: float | None = None

    def receive(self, stamp_ns: int) -> Order:
        """Counts a message; call `accept` or `refuse` with the order that this returns.

        Args:
            stamp_ns: Its stamp [ns]; 0: it has none.

        Returns:
            As `StampOrder`; LATE only where it may be the first after a jump.
        """
        self.received += 1
        if not stamp_ns:
            return Order.NEWER
        newest_ns = self._order.newest_ns
        order = self._order.take(stamp_ns)
        near = newest_ns is not None and newest_ns - stamp_ns <= RESET_NS
        return Order.NEWER if order is Order.LATE and near else order

    def accept(self, order: Order) -> None:
        """Counts the message as used."""
        if order is Order.RESTART:
            self._count_as_jump()
        self._outdated_since = None
        if order is not Order.LATE:
            self._count_as_refused()
        self.taken, self.refused_in_a_row = True, 0

    def refuse(self, kind: str, text: str, *, now_s: float, order: Order = Order.NEWER) -> None:
        """Counts the message as dropped.

        Args:
            kind: Class of the error.
            text: What the error says.
            now_s: When [s], on a clock that never jumps.
            order: What `receive` returned.
        """
        if order is Order.RESTART:
            self._count_as_jump()
        self.dropped[kind] += 1
        if kind == OutdatedError.__name__:
            self._outdated_since = now_s if self._outdated_since is None else self._outdated_since
            if now_s - self._outdated_since <= SILENCE_S:
                return
        elif order is Order.LATE and len(self._held) < BELIEVED - 1:
            self._held.append((kind, text))
            return
        self._held.append((kind, text))
        self._count_as_refused()

    def _count_as_jump(self) -> None:
        """Counts the held messages as part of a jump of the stamps."""
        for kind, _ in self._held:
            self.dropped[kind] -= 1
        self.dropped = +self.dropped
        if self._held:
            self.dropped["jumped_back"] += len(self._held)
        self._held.clear()

    def _count_as_refused(self) -> None:
        """Counts the held messages as refused."""
        if self._held:
            self.last_kind, self.last_error = self._held[-1]
        self.refused += len(self._held)
        self.refused_in_a_row += len(self._held)
        self._held.clear()

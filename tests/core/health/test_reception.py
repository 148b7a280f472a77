"""Which of an input's messages are used, and which refusals are their sender's fault."""

from __future__ import annotations

import pytest

from mrs_people_loc.clocks import Order, StampOrder
from mrs_people_loc.health.reception import Reception

SECOND = 1_000_000_000


def take(reception: Reception, *seconds: float, error: str = "", now_s: float = 0.0) -> None:
    for second in seconds:
        order = reception.receive(round(second * SECOND))
        if error:
            reception.refuse(error, f"refused at {second:g}", now_s=now_s, order=order)
        else:
            reception.accept(order)


def test_used_messages_are_counted() -> None:
    reception = Reception()
    assert not reception.taken
    take(reception, 1.0, 1.2)
    assert reception.taken
    assert (reception.received, reception.refused, dict(reception.dropped)) == (2, 0, {})


def test_refusals_are_counted_until_one_is_used() -> None:
    reception = Reception()
    take(reception, 1.0, 1.2, error="ScanError")
    assert (reception.refused, reception.refused_in_a_row) == (2, 2)
    assert (reception.last_kind, reception.last_error) == ("ScanError", "refused at 1.2")
    take(reception, 1.4)
    assert (reception.refused, reception.refused_in_a_row) == (2, 0)


def test_refusals_before_a_jump_back_is_believed_are_part_of_the_jump() -> None:
    reception, order = Reception(), StampOrder()
    for second in (10.0, 10.2, 1.0, 1.2, 1.4, 1.6):
        error = "" if order.take(round(second * SECOND)) is not Order.LATE else "ScanError"
        take(reception, second, error=error)
    assert (reception.received, reception.refused) == (6, 0)
    assert dict(reception.dropped) == {"jumped_back": 2}


def test_single_late_message_is_refused_once_the_next_is_used() -> None:
    reception = Reception()
    take(reception, 10.0)
    take(reception, 5.0, error="ScanError")
    assert reception.refused == 0  # it may be the first after a jump
    take(reception, 10.2)
    assert (reception.refused, dict(reception.dropped)) == (1, {"ScanError": 1})


@pytest.mark.parametrize(("now_s", "refused"), [(2.0, 0), (2.1, 1)])
def test_outdated_messages_are_a_fault_after_two_seconds(now_s: float, refused: int) -> None:
    reception = Reception()
    take(reception, 1.0, error="OutdatedError", now_s=0.0)
    take(reception, 1.2, error="OutdatedError", now_s=now_s)
    assert reception.refused == refused
    assert dict(reception.dropped) == {"OutdatedError": 2}


def test_messages_without_a_stamp_have_no_order() -> None:
    reception = Reception()
    take(reception, 10.0)
    assert reception.receive(0) is Order.NEWER

import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.clocks import (
    ClockOffset,
    Order,
    RateLimit,
    StampOrder,
    Standstill,
    right_offset,
)

MS = 1_000_000
SECOND = 1000 * MS
stamps = st.integers(0, 20 * SECOND)


def orders(*given_ms: int) -> list[str]:
    order = StampOrder()
    return [order.take(stamp * MS).value for stamp in given_ms]


def test_ordered_stamps_are_accepted():
    assert orders(0, 1, 5000) == ["newer"] * 3


def test_repeated_and_late_stamps_are_refused():
    assert orders(5000, 5000, 4999, 4000, 5001) == ["newer", "late", "late", "late", "newer"]


def test_one_or_two_very_late_stamps_change_nothing():
    assert orders(5000, 1000, 5001, 1000, 1001, 5002) == [
        "newer", "late", "newer", "late", "late", "newer",
    ]  # fmt: skip


def test_three_consecutive_early_stamps_reset_the_clock():
    assert orders(5000, 1000, 1001, 1002, 1003) == ["newer", "late", "late", "restart", "newer"]
    assert orders(5000, 1000, 1000, 1000, 1000) == ["newer", *["late"] * 4]
    assert orders(5000, 1000, 1001, 900, 901, 902) == ["newer", *["late"] * 4, "restart"]


def test_after_a_reset_any_stamp_is_accepted():
    order = StampOrder()
    order.take(5 * SECOND)
    order.reset()
    assert (order.newest_ns, order.resets) == (None, 0)
    assert order.take(0) is Order.NEWER


@given(st.lists(stamps, max_size=40))
def test_accepted_stamps_increase_between_resets(given_ns):
    order, taken, resets = StampOrder(), [], 0
    for stamp in given_ns:
        was = order.take(stamp)
        if was is Order.RESTART:
            taken, resets = [], resets + 1
        if was is not Order.LATE:
            taken.append(stamp)
            assert order.newest_ns == stamp
    assert taken == sorted(set(taken))
    assert order.resets == resets


def offset_of(*arrivals_ms: tuple[int, int], now_ms: int | None = None) -> float | None:
    """The offset [ms] after messages that arrive at a time with an offset."""
    clock = ClockOffset()
    for at, offset in arrivals_ms:
        clock.add((at + offset) * MS, at * MS)
    now = arrivals_ms[-1][0] if now_ms is None else now_ms
    found = clock.at(now * MS)
    return None if found is None else found / MS


def test_offset_excludes_the_minimum_delay():
    assert offset_of((0, -30)) == -30
    assert offset_of((0, -30), (100, -10), (200, -400)) == -10
    # Of two spans of half a second the lesser one, and so on: the greatest of all but one.
    assert offset_of((0, -30), (600, -10)) == -30
    assert offset_of((0, -30), (600, -10), (1200, -200)) == -30
    assert offset_of((0, 4990), (600, 4980), (1200, 4700)) == 4980


def test_single_wrong_stamp_does_not_change_the_offset():
    assert offset_of((0, -30), (600, -20), (1200, 900), (1800, -10)) == -10


def test_offset_covers_the_last_ten_seconds():
    arrivals = ((0, -10), (600, -10), (5000, -50), (9000, -40))
    assert offset_of(*arrivals) == -10
    assert offset_of(*arrivals, now_ms=10_600) == -50  # (0, ...) and (600, ...) are over
    assert offset_of(*arrivals, now_ms=19_000) is None
    assert ClockOffset().at(0) is None


def test_a_sender_is_settled_after_two_seconds():
    clock = ClockOffset()
    assert not clock.is_settled(0)
    clock.add(0, 700 * MS)
    assert not clock.is_settled(2699 * MS)
    assert clock.is_settled(2700 * MS)
    clock.reset()
    assert not clock.is_settled(2700 * MS)
    clock.add(0, 3000 * MS)
    assert not clock.is_settled(3000 * MS)
    # Silence for ten seconds, and it begins again.
    clock.add(0, 20_000 * MS)
    assert not clock.is_settled(20_000 * MS)


def test_clock_set_back_on_the_receiver_resets_the_offset():
    assert offset_of((9000, 0), (9600, 0), (1000, 10)) == 10


@given(st.lists(st.tuples(st.integers(0, 3000), st.integers(-5000, 5000)), max_size=50))
def test_offset_equals_a_plain_search(steps):
    clock, spans, now = ClockOffset(), {}, 0
    for wait, offset in steps:
        now += wait
        clock.add((now + offset) * MS, now * MS)
        spans[now // 500] = max(offset, spans.get(now // 500, offset))
        greatest = sorted(o for span, o in spans.items() if span > now // 500 - 20)
        assert clock.at(now * MS) == greatest[-2:][0] * MS


@pytest.mark.parametrize(
    ("offsets", "right"),
    [([], 0), ([700], 700), ([-10, 190], -10), ([5000, -20], -20), ([5000, 5010, -4000], -4000)],
)
def test_reference_clock_is_that_nearest_to_the_listeners(offsets, right):
    assert right_offset(offsets) == right


def test_rate_limit_begins_anew_where_stamps_jump_back():
    limit = RateLimit()
    stamps = [0, 5, 10, 15, 20, 1000, 3, 8, 13]  # [ms], at 100 Hz
    passed = [stamp for stamp in stamps if limit.lets_through(stamp * 1_000_000, 100.0)]
    assert passed == [0, 10, 20, 1000, 3, 13]


def test_standstill_lasts_until_the_clock_goes_on() -> None:
    clock = Standstill()
    assert [clock.lasts_s(5.0, t) for t in (1.0, 1.5, 3.0)] == [0.0, 0.5, 2.0]
    assert [clock.lasts_s(5.1, t) for t in (3.0, 3.5)] == [0.0, 0.5]

"""What the soak tests hold fails when it should: on loads that are made up."""

import re

import pytest

from soak.team import Interval, Load
from soak.test_load import check

ROBOTS = [f"robot_{k}" for k in range(8)]
PERIOD_NS = 100_000_000


def made(count: int = 3000) -> Load:
    """A sound run: `count` intervals after three of the warm-up, the last of them cut short."""
    load = Load(seconds=count / 10)
    for k in range(count + 3):
        scans = [(robot, k * PERIOD_NS + n * 4_000_000) for n, robot in enumerate(ROBOTS)]
        for scan in scans:
            load.on_frame(*scan)
        load.intervals.append(Interval(scans, 12, 60.0, 30.0))
    load.cut(3 * PERIOD_NS)
    load.memory_kb = {"planner": [100_000] * 300, "robot_0": [120_000] * 300}
    load.cores = {"planner": 0.3, "robot_0": 0.1, "this test": 0.1}
    return load


def test_sound_run_passes():
    load = made()
    assert len(load.intervals) == 2999
    assert len(load.sent) == 8 * 2999
    assert not load.lost
    check(load, long=True)
    assert "lost 0" in load.table("made up")


def test_losses_are_counted():
    load = made()
    missing = [load.intervals.pop(1000 - k) for k in range(5)]
    assert load.lost == {scan for interval in missing for scan in interval.scans}
    check(load, long=False)
    with pytest.raises(AssertionError, match="40 of 23992 went into no people"):
        check(load, long=True)


def test_intervals_without_a_robot_are_counted():
    load = made()
    for k in range(100, 130):
        load.intervals[2 * k : 2 * k + 1] = [
            load.intervals[2 * k]._replace(scans=load.intervals[2 * k].scans[:4]),
            load.intervals[2 * k]._replace(scans=load.intervals[2 * k].scans[4:]),
        ]
    assert not load.lost
    assert load.partial > 24
    with pytest.raises(AssertionError, match="partial"):
        check(load, long=True)


@pytest.mark.parametrize(("kb_per_s", "holds"), [(0, True), (15, True), (25, False)])
def test_growing_memory_is_detected(kb_per_s, holds):
    load = made()
    load.memory_kb["planner"] = [100_000 + kb_per_s * second for second in range(300)]
    assert load.growth_kb("planner") == 200 * kb_per_s
    if holds:
        check(load, long=True)
    else:
        with pytest.raises(AssertionError, match=re.escape("'planner': 5000")):
            check(load, long=True)


def test_growing_latency_is_detected():
    load = made()
    load.intervals = [
        interval._replace(oldest_ms=60.0 + k * 0.05) for k, interval in enumerate(load.intervals)
    ]
    check(load, long=False)
    with pytest.raises(AssertionError, match="oldest"):
        check(load, long=True)

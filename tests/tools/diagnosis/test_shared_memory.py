"""Shared memory that dead processes left behind."""

from __future__ import annotations

import fcntl
from contextlib import ExitStack

import pytest

from mrs_tools.diagnosis.diagnose import diagnose
from mrs_tools.diagnosis.facts import WARN, Facts
from mrs_tools.diagnosis.shared_memory import Memory, left_behind, memory

DEAD, ALIVE = "fastrtps_0123456789abcdef", "fastrtps_fedcba9876543210"
FILES = {
    DEAD: 549408,
    f"{DEAD}_el": 0,
    ALIVE: 549408,
    f"{ALIVE}_el": 0,
    "fastrtps_port7411": 52000,
    "fastrtps_port7411_el": 0,
    "fastrtps_port7400": 52000,
    "fastrtps_port7400_sl": 0,
    "sem.fastrtps_port7411_mutex": 32,
    "lttng-ust-wait-6": 4096,
    "somebody_else_el": 0,
}
LOCKED = frozenset({f"{ALIVE}_el", "fastrtps_port7400_sl"})


def of_memory(seen: Memory):
    """What the doctor says of it."""
    facts = Facts(0, [], memory=seen)
    return [check for check in diagnose(facts) if check.subject == "/dev/shm"]


def test_segments_of_dead_processes_are_found():
    seen = Memory(FILES, LOCKED, size=24_000_000_000, free=24_000_000_000)
    assert left_behind(seen) == {DEAD: 549408, "fastrtps_port7411": 52000}
    assert of_memory(seen) == []  # of 24 GB


@pytest.mark.parametrize(("size", "free"), [(5_000_000, 4_000_000), (64_000_000, 3_000_000)])
def test_shared_memory_full_of_dead_segments_is_reported(size, free):
    (check,) = of_memory(Memory(FILES, LOCKED, size, free))
    assert (check.subject, check.level) == ("/dev/shm", WARN)
    assert "2 segments and ports of processes that are dead: 1 of" in check.text
    assert f"{free / 1e6:.0f} MB are free" in check.text
    assert check.advice.startswith("fastdds shm clean")


def test_shared_memory_full_of_live_segments_is_not_cleaned():
    everybody = frozenset(name for name in FILES if name.endswith(("_el", "_sl")))
    assert of_memory(Memory(FILES, everybody, size=64_000_000, free=0)) == []


def test_process_that_holds_a_lock_is_alive(tmp_path):
    for name, size in FILES.items():
        (tmp_path / name).write_bytes(bytes(size))
    with ExitStack() as held:
        for name in LOCKED:
            how = fcntl.LOCK_EX if name.endswith("_el") else fcntl.LOCK_SH
            fcntl.flock(held.enter_context((tmp_path / name).open()), how)
        seen = memory(tmp_path)
    assert seen is not None
    assert (seen.files, seen.locked) == (FILES, LOCKED)
    assert 0 < seen.free <= seen.size
    assert memory(tmp_path / "nowhere") is None

"""`nine_of_ten`, by which tests hold what takes time."""

from __future__ import annotations

import subprocess
import sys
import time

import pytest

import machine
from machine import Used, nine_of_ten

BURN = "import time\nwhile time.process_time() < 0.3: pass"


@pytest.fixture
def others(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    """What others use during each try; nothing where it ends."""
    shares: list[float] = []
    monkeypatch.setattr(Used, "by_others", lambda self: shares.pop(0) if shares else 0.0)
    monkeypatch.setattr(machine, "_quiet_moment_comes", lambda: True)
    monkeypatch.delenv("CI", raising=False)
    return shares


def test_one_slow_try_of_ten_passes(others: list[float]) -> None:
    reported: list[str] = []
    times = iter([0.5, 9.0, *[1.0] * 8])
    nine_of_ten(lambda: next(times), 1.0, "it", show=reported.append)
    assert reported[0].startswith("it: 0.50, 1.00, ")
    assert "9.00 s; others had 0% of" in reported[0]


def test_two_slow_tries_of_ten_fail(others: list[float]) -> None:
    times = iter([9.0, 9.0, *[1.0] * 8])
    with pytest.raises(AssertionError, match="it: 2 of 10 took longer than the promised 1 s"):
        nine_of_ten(lambda: next(times), 1.0, "it")


def test_one_slow_try_of_three_fails(others: list[float]) -> None:
    times = iter([1.0, 9.0, 1.0])
    with pytest.raises(AssertionError, match="promised"):
        nine_of_ten(lambda: next(times), 1.0, "it", tries=3)


def test_try_counts_by_the_load_of_others(others: list[float]) -> None:
    """A fast try may not count, and a slow one may."""
    others += [0.9, 0.0, 0.5]
    times = iter([9.0, 1.0, 0.1, 2.0])
    with pytest.raises(AssertionError, match="it: 1 of 2 took longer"):
        nine_of_ten(lambda: next(times), 1.0, "it", tries=2)


@pytest.mark.parametrize("ci", [False, True])
def test_busy_machine_is_reported_as_not_measured(
    others: list[float], monkeypatch: pytest.MonkeyPatch, ci: bool
) -> None:
    if ci:
        monkeypatch.setenv("CI", "true")
    others += [0.9] * 5
    reported: list[str] = []
    with pytest.raises(pytest.skip.Exception, match="is too busy: .*; it: 0 of 10 tries counted"):
        nine_of_ten(lambda: 9.0, 1.0, "it", show=reported.append)
    assert reported[1].startswith("NOT MEASURED: this machine is too busy")


def test_already_failed_limit_fails_on_a_busy_machine(others: list[float]) -> None:
    others += [0.0, 0.0, 0.9, 0.9, 0.9, 0.9, 0.9]
    with pytest.raises(AssertionError, match="it: 2 of 2 took longer"):
        nine_of_ten(lambda: 9.0, 1.0, "it")


def test_permanently_busy_machine_is_not_waited_for(
    others: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(machine, "_quiet_moment_comes", lambda: False)
    others += [0.0, 0.9]
    times = iter([0.1, 0.1])
    with pytest.raises(pytest.skip.Exception, match="1 of 10 tries counted"):
        nine_of_ten(lambda: next(times), 1.0, "it")


def test_children_of_the_test_are_its_own_load() -> None:
    before = Used.now()
    with subprocess.Popen([sys.executable, "-c", BURN]):
        pass
    after_it = Used.now()
    running = subprocess.Popen([sys.executable, "-c", f"{BURN}\ninput()"], stdin=subprocess.PIPE)
    try:
        while Used.now().ours - after_it.ours < 0.25:
            assert running.poll() is None
    finally:
        running.communicate(b"\n")
    assert 0.25 < after_it.ours - before.ours < 5.0
    assert after_it.all - before.all > 0.2


def test_orphaned_children_remain_the_tests_own_load() -> None:
    child = f"import sys\n{BURN}\nsys.stdin.read()"
    run = f"subprocess.run([sys.executable, '-c', {child!r}])"
    code = f"import subprocess, sys; {run}"
    start = Used.now()
    parent = subprocess.Popen([sys.executable, "-c", code], stdin=subprocess.PIPE)
    try:
        while (before := Used.now()).ours - start.ours < 0.3:
            assert parent.poll() is None
            time.sleep(0.02)
        parent.kill()
        parent.wait()
        assert Used.now(before.pids).ours - Used.now().ours > 0.1
    finally:
        parent.communicate()  # its child ends with what it reads

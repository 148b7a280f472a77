"""How long a team may take to start."""

from __future__ import annotations

import pytest

from mrs_people_loc.errors import PeopleLocError
from mrs_people_sim import start_limit
from mrs_people_sim.start_limit import StartLimit
from mrs_tools.diagnosis.load import Load


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> list[float]:
    now = [100.0]
    monkeypatch.setattr(start_limit.time, "monotonic", lambda: now[0])
    return now


def test_limit_is_longer_on_a_busy_machine_and_names_the_cause(
    clock: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Load, "now", lambda: Load(11.0, 2))
    limit = StartLimit()
    for _ in range(329):  # 330 s at 2 / 11 are 60 s
        clock[0] += 1.0
        limit.check({"robot_b", "robot_a"})
    clock[0] += 3.0
    wanted = r"332 s: robot_a, robot_b \(rendering 0.4 of real time, load 11 on 2 cores\)"
    with pytest.raises(PeopleLocError, match=f"not ready after {wanted}"):
        limit.check({"robot_b", "robot_a"}, "rendering 0.4 of real time")


def test_limit_begins_again_when_something_goes_on(
    clock: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Load, "now", lambda: Load(0.1, 2))
    limit = StartLimit()
    limit.check({"robot_a", "robot_b"})
    clock[0] += 59.0
    limit.check({"robot_a", "robot_b"})
    clock[0] += 0.5
    limit.check({"robot_b"})
    clock[0] += 59.0
    limit.check({"robot_b"})
    clock[0] += 2.0
    with pytest.raises(PeopleLocError, match=r"ready after 120 s: robot_b \(load 0 on 2 cores\)"):
        limit.check({"robot_b"})


def test_robot_that_comes_and_goes_is_no_progress(
    clock: list[float], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(Load, "now", lambda: Load(0.1, 2))
    limit = StartLimit()
    for second in range(66):  # 60 s since robot_a was ready for the first time
        clock[0] += 1.0
        limit.check({"robot_a", "robot_b"} if second % 10 < 5 else {"robot_b"})
    clock[0] += 1.0
    with pytest.raises(PeopleLocError, match="not ready after 67 s: robot_a, robot_b"):
        limit.check({"robot_a", "robot_b"})

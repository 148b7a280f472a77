"""What `mrs doctor` says of images that are lost on their way, and of shared memory."""

from __future__ import annotations

import fcntl
from contextlib import ExitStack

import pytest

from mrs_tools import shared_memory
from mrs_tools.commands.doctor import ERROR, OK, WARN, Facts, diagnose
from mrs_tools.shared_memory import Memory, left_behind, lost_images, memory

ROBOT = "/robot_a/robot_node"
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


def of_images(reports):
    """What the doctor says is wrong with a robot."""
    checks = diagnose(Facts(0, [ROBOT], reports, states={ROBOT: "active"}))
    return [check for check in checks if check.subject.startswith(f"{ROBOT}: ")]


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


def report(**rates: float | None):
    """What a robot says of its inputs: topics and rates [Hz], `__` for the slash."""
    entries = {"state": (OK, "active", {})}
    for name, rate in rates.items():
        entries[name.replace("__", "/")] = (OK, "ok", {"rate_hz": f"{rate:.1f}"})
    return {ROBOT: entries}


@pytest.mark.parametrize("image", ["image_rect", "image_raw"])
@pytest.mark.parametrize("rate", [0.0, 2.2, 3.4])
def test_images_missing_while_camera_info_arrives_are_reported(image, rate):
    rates = {"left__camera_info": 5.0, f"left__{image}": rate}
    rates |= {"right__camera_info": 5.0, f"right__{image}": 5.0}
    (check,) = of_images(report(**rates))
    assert (check.subject, check.level) == (f"{ROBOT}: images", ERROR)
    assert check.text.endswith(f": left ({rate:.1f} a second, camera_info 5.0)")
    assert "docs/network.md" in check.advice


@pytest.mark.parametrize(
    "rates",
    [
        {"left__camera_info": 5.0, "left__image_rect": 4.6},
        {"left__camera_info": 0.0, "left__image_rect": 0.0},  # the camera is off
        {"left__camera_info": 0.0, "left__image_rect": 5.0},
        {"left__image_rect": 0.0},
        {},
    ],
)
def test_other_findings_are_not_attributed_to_shared_memory(rates):
    assert lost_images(report(**rates)[ROBOT]) == ""


@pytest.mark.parametrize(
    ("room", "said"), [(212992, "(on this one it is 212992)"), (16777216, None), (None, None)]
)
def test_too_small_socket_buffer_is_named(room, said, tmp_path, monkeypatch):
    monkeypatch.setattr(shared_memory, "ROOM", tmp_path / "rmem_max")
    if room is not None:
        shared_memory.ROOM.write_text(f"{room}\n")
    (check,) = of_images(report(left__camera_info=5.0, left__image_rect=0.0))
    assert "net.core.rmem_max=16777216" in check.advice
    assert ("on this one" in check.advice) == (said is not None)
    assert said is None or said in check.advice


def test_consequences_of_lost_images_are_listed_under_them():
    reports = report(left__camera_info=5.0, left__image_rect=0.0)
    no_data = {"rate_hz": "0.0", "code": "no_data"}
    reports[ROBOT]["left/image_rect"] = (ERROR, "no data on /robot_a/left/image_rect", no_data)
    reports[ROBOT]["scan"] = ("waiting", "no scan yet", {"code": "no_scan"})
    (check,) = of_images(reports)
    assert check.subject == f"{ROBOT}: images"
    assert [one.subject for one in check.follows] == [f"{ROBOT}: left/image_rect", f"{ROBOT}: scan"]


@pytest.mark.parametrize("code", ["other_images", "no_publisher", "wrong_type", "wrong_qos"])
def test_images_missing_for_another_reason_are_not_reported_lost(code):
    reports = report(left__camera_info=5.0, left__image_rect=0.0)
    values = {"rate_hz": "0.0", "code": code}
    reports[ROBOT]["left/image_rect"] = (ERROR, "the reason", values)
    (check,) = of_images(reports)
    assert (check.subject, check.text) == (f"{ROBOT}: left/image_rect", "the reason")


def test_rate_that_is_not_a_number_is_ignored():
    reports = report(left__camera_info=5.0, left__image_rect=0.0)
    reports[ROBOT]["left/camera_info"] = (OK, "ok", {"rate_hz": "many"})
    assert lost_images(reports[ROBOT]) == ""

"""Images that are lost on their way, as a robot's report shows it."""

from __future__ import annotations

import pytest

from mrs_tools.diagnosis import lost_images as lost
from mrs_tools.diagnosis.diagnose import diagnose
from mrs_tools.diagnosis.facts import ERROR, OK, Facts
from mrs_tools.diagnosis.lost_images import lost_images

ROBOT = "/robot_a/robot_node"


def of_images(reports):
    """What the doctor says is wrong with a robot."""
    checks = diagnose(Facts(0, [ROBOT], reports, states={ROBOT: "active"}))
    return [check for check in checks if check.subject.startswith(f"{ROBOT}: ")]


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
    ("room", "reported"), [(212992, "(on this one it is 212992)"), (16777216, None), (None, None)]
)
def test_too_small_socket_buffer_is_named(room, reported, tmp_path, monkeypatch):
    monkeypatch.setattr(lost, "ROOM", tmp_path / "rmem_max")
    if room is not None:
        lost.ROOM.write_text(f"{room}\n")
    (check,) = of_images(report(left__camera_info=5.0, left__image_rect=0.0))
    assert "net.core.rmem_max=16777216" in check.advice
    assert ("on this one" in check.advice) == (reported is not None)
    assert reported is None or reported in check.advice


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

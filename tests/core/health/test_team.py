"""What is wrong with a robot as the planner receives it, from plain figures."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mrs_people_loc.health.agreement import Misplaced
from mrs_people_loc.health.findings import ERROR, OK, STALE, WARN, Code, Finding
from mrs_people_loc.health.team import MemberState, of_intervals, of_member, of_people
from mrs_people_loc.team.poses import Pose

SECOND = 1_000_000_000
HERE = Pose(10 * SECOND, 1.0, 2.0, 0.0)
WELL = MemberState(
    "robot_a",
    "/robot_a/points",
    scan_hz=9.9,
    pose_hz=50.0,
    poses_held=40,
    dropped={"superseded": 1},
    age_s=0.0504,
    silent_s=0.05,
    clock_offset_ns=-12_000_000,
    max_clock_offset_s=0.2,
    remedy="; use_sim_time",
    pose=HERE,
    apart_m=3.0,
    expected_hz=10.0,
)


def verdict(finding: Finding) -> tuple:
    return finding.level, finding.code, finding.message


def test_robot_without_errors_is_ok():
    assert of_member(WELL) == Finding(
        "robot robot_a",
        values={
            "scan_hz": "9.9",
            "pose_hz": "50.0",
            "poses_held": 40,
            "stamp_resets": 0,
            "pose_jumps": 0,
            "dropped.superseded": 1,
            "clock_offset_s": "-0.012",
            "age_s": "0.050",
        },
    )


#: In order: where several hold, the first one is the finding.
CHANGES: list[tuple[dict[str, Any], bytes, Code, str]] = [
    (
        {"points_publishers": 2},
        ERROR,
        Code.TWO_PUBLISHERS,
        "2 publishers on /robot_a/points: two robots share a name, rename one; "
        "or one was killed in the last 20 s",
    ),
    ({"age_s": None}, STALE, Code.NO_SCAN, "no scan used yet"),
    ({"poses_held": 0}, ERROR, Code.NO_POSE, "scans but no pose on robot_a/pose"),
    (
        {"clock_astray_ns": 1_500_000_000},
        ERROR,
        Code.CLOCK_ASTRAY,
        "its clock is 1.500 s ahead of the others': its scans are left out; allowed by "
        "interval.max_clock_offset: 0.2 s; synchronize the clocks (chrony or NTP on every machine)",
    ),
    ({"silent_s": 5.1}, WARN, Code.SCAN_SILENT, "no scan for 5.1 s"),
    (
        {"clock_offset_ns": -300_000_000},
        WARN,
        Code.STAMPS_OFF,
        "stamps are 0.300 s behind this machine's clock; allowed by interval.max_clock_offset: "
        "0.2 s; use_sim_time",
    ),
    (
        {"quarantined": "it says that it is lost"},
        WARN,
        Code.QUARANTINED,
        "robot_a is in quarantine, its scans find no people: it says that it is lost; they are "
        "used again when its pose has fitted for half a second",
    ),
    (
        {"left_out_lately": frozenset({"no_pose", "too_old"}), "dropped": {"no_pose": 4}},
        WARN,
        Code.LEFT_OUT_NO_POSE,
        "4 scans left out: no pose near their stamps",
    ),
    (
        {"left_out_lately": frozenset({"too_old"}), "dropped": {"too_old": 2}},
        WARN,
        Code.LEFT_OUT_TOO_OLD,
        "2 scans left out: older than the newest by more than interval.max_scan_age",
    ),
    (
        {"apart_m": 1234.0},
        WARN,
        Code.STRANGE_POSE,
        "its pose is (1.00, 2.00) m, 1.2 km from the nearest other robot: is it in map, the frame "
        "of the others?",
    ),
    (
        {"last_jump": (HERE, Pose(12 * SECOND, 5.0, 2.0, 0.0)), "pose_jumps": 3},
        WARN,
        Code.STRANGE_POSE,
        "its pose jumped from (1.00, 2.00) m to (5.00, 2.00) m in 2.00 s (3 jumps so far): its "
        "localization was lost or put right, or something else publishes its pose, too",
    ),
    (
        {"doubted_by": ("robot_b",)},
        WARN,
        Code.DOUBTED,
        "its pose does not fit what robot_b can tell; its scans are used, as it takes two, and "
        "most of the team, to leave a robot out: check whose pose is wrong",
    ),
    (
        {"misplaced": Misplaced(np.array([0.5, -0.25]), np.radians(12.0), 0.1, 0.9)},
        WARN,
        Code.MISPLACED,
        "its people are not where the others see them (10% agree); moved by (0.50, -0.25) m in map "
        "and turned by 12 degrees 90% would: check its pose (localization, pose.map_from_odom) and "
        "the mounting of its head",
    ),
    ({"scan_hz": 4.9}, WARN, Code.SLOW, "4.9 scans per second; expected: 10.0"),
]


@pytest.mark.parametrize(("changes", "level", "code", "text"), CHANGES)
def test_robot_with_errors_is_reported(changes, level, code, text):
    assert verdict(of_member(replace(WELL, **changes))) == (level, code, text)


@pytest.mark.parametrize("first", range(len(CHANGES) - 1))
def test_causes_of_unused_scans_precede_their_quality(first):
    changes, level, code, _ = CHANGES[first]
    for later, *_ in CHANGES[first + 1 :]:
        both = replace(WELL, **{**later, **changes})
        assert verdict(of_member(both))[:2] == (level, code)


@pytest.mark.parametrize(
    "changes",
    [
        {"silent_s": 5.0},
        {"clock_offset_ns": 200_000_000},
        {"clock_offset_ns": None},
        {"left_out_lately": frozenset({"superseded"})},
        {"apart_m": 1000.0},
        {"apart_m": None},
        {"pose": None, "apart_m": None},
        {"scan_hz": 5.0},
        {"scan_hz": 0.0},  # it is silent, which is a finding of its own
        {"scan_hz": 0.4, "expected_hz": 1.0},
    ],
)
def test_limits_are_allowed(changes):
    assert of_member(replace(WELL, **changes)).level == OK


def test_clock_that_is_behind_may_be_late_messages():
    text = of_member(replace(WELL, clock_astray_ns=-500_000_000)).message
    assert text.startswith("its clock is 0.500 s behind the others'")
    assert text.endswith("or see what keeps its messages back so long")


def test_unknown_figures_are_omitted():
    values = of_member(replace(WELL, age_s=None, clock_offset_ns=None)).values
    assert not {"age_s", "clock_offset_s"} & set(values)


def test_several_planners_are_reported():
    topic = "/tracked_people"
    one = [("/planner", "People")]
    assert of_people(topic, "People", []) == of_people(topic, "People", one) == Finding("people")
    two = of_people(topic, "People", [("/b/planner", "People"), ("/a/planner", "People")])
    assert (two.level, two.code) == (ERROR, Code.TWO_PUBLISHERS)
    assert two.message.startswith(
        "2 publishers on /tracked_people: /a/planner, /b/planner; another"
    )


def test_other_type_on_the_topic_of_people_is_no_second_planner():
    found = of_people("/people", "People", [("/planner", "People"), ("/sfm", "Agents")])
    assert (found.level, found.code) == (WARN, Code.WRONG_TYPE)
    assert found.message == "/people is People here, but /sfm publishes Agents: remap one of them"


def test_intervals():
    figures = {"people": 3}
    assert of_intervals(["robot_a"], 7, figures) == Finding(
        "intervals", values={"intervals": 7, "people": 3}
    )
    nobody = of_intervals([], 7, figures)
    assert (nobody.level, nobody.code, nobody.values) == (STALE, Code.NO_ROBOT, {"intervals": 0})
    none = of_intervals(["robot_a"], 0, {})
    assert verdict(none) == (STALE, Code.NO_INTERVAL, "no interval yet")

"""What is wrong with a robot's localization, from plain figures."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from mrs_people_loc.health.findings import OK, WARN, Code
from mrs_people_loc.health.localization import (
    LocalizationHealth,
    RefusalWatch,
    of_localization,
)
from mrs_people_loc.health.sonars import SameReading
from mrs_people_loc.localization.filter.team_state import Misfit, Source, Trust
from mrs_people_loc.localization.localizer import LocalizationState
from mrs_people_loc.localization.walls import Walls
from mrs_people_loc.team.poses import Pose

SECOND = 1_000_000_000
NOW_NS = 1000 * SECOND
NO_WALLS = Walls(
    np.zeros(0), np.zeros(0), np.zeros((0, 2, 2)), np.zeros((0, 2)), np.zeros((0, 2), bool)
)
POSE = Pose(NOW_NS, 1.0, 2.0, 0.5, np.diag([0.04, 0.09, 0.0004]))
WELL = LocalizationState(
    stamp_ns=NOW_NS,
    poses={"robot_b": POSE, "robot_a": POSE},
    sources={
        ("robot_a", "known walls"): Source(7, 2, 1.25, NOW_NS - 500_000_000),
        ("robot_b", "absolute"): Source(3, 90, 9.0, NOW_NS),
    },
    trust={"robot_a": Trust(times_lost=1, noise=2.25)},
    wheels=np.array([0.031, -0.0012, 0.01]),
    wheel_sigmas=np.array([0.002, 0.0003, 0.004]),
    way=40.0,
    doubted={},
    misfits={},
    walls=NO_WALLS,
    known=(),
    clocks={},
    late=4,
    resets=1,
    jumps=0,
)
CARRIED = {"robot_a": Trust(lost=True, lost_ns=NOW_NS, times_lost=1)}


def of(changes: dict[str, Any] | None = None, **health: Any) -> Any:
    given = {"began_ns": NOW_NS - 100 * SECOND, "now_ns": NOW_NS} | health
    return of_localization(LocalizationHealth("robot_a", replace(WELL, **changes or {}), **given))


def test_figures_are_those_of_the_robot_itself():
    finding = of()
    assert (finding.name, finding.level, finding.code) == ("localization", OK, None)
    assert dict(finding.values) == {
        "sigma_x": "0.200", "sigma_y": "0.300", "sigma_yaw": "0.0200",
        "known_walls.accepted": 7, "known_walls.refused": 2, "known_walls.innovation": "1.25",
        "known_walls.age_s": "0.5",
        "team": "robot_a, robot_b", "walls": 0, "times_lost": 1, "late": 4, "resets": 1,
        "odometry_jumps": 0, "odometry_noise": "1.50",
        "wheel_scale": "0.03100", "wheel_scale.sigma": "0.00200",
        "wheel_turn_per_metre": "-0.00120", "wheel_turn_per_metre.sigma": "0.00030",
        "wheel_turn_per_radian": "0.01000", "wheel_turn_per_radian.sigma": "0.00400",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("changes", "code", "text"),
    [
        (
            {"trust": {"robot_a": Trust(lost=True, lost_ns=NOW_NS, times_lost=1)}},
            Code.CARRIED,
            "it was carried or its wheels",
        ),
        ({"doubted": {"robot_b": -1.02}}, Code.MATE_DOUBTED, r"robot_b \(off by 1.02 m\)"),
        (
            {"misfits": {3: Misfit(9, -1.0), 1: Misfit(5, 0.9)}},
            Code.MAP_MISFIT,
            r"wall 1 \(off by 0.90 m\), wall 3 \(off by 1.00 m\)",
        ),
        ({"clocks": {"robot_b": -1.5}}, Code.MATE_CLOCK, r"robot_b \(-1.5 s\)"),
        (
            {"sources": {("robot_a", "walls"): Source(7, 2, 1.0, NOW_NS - 31 * SECOND)}},
            Code.NOT_CORRECTED,
            "nothing has corrected the pose for 31 s",
        ),
        (
            {"trust": {"robot_a": Trust(noise=9.0)}},
            Code.ODOMETRY_NOISY,
            "3.0 times less certain than its covariances",
        ),
    ],
)
def test_problems_have_their_codes(changes, code, text):
    finding = of(changes)
    assert (finding.level, finding.code) == (WARN, code)
    assert finding.values["problems"] == str(code)
    with pytest.raises(AssertionError, match=text):
        raise AssertionError(finding.message)


def test_refused_kinds_are_named():
    finding = of(refused=frozenset({"known walls"}))
    assert finding.code == Code.CORRECTIONS_REFUSED
    assert finding.message.endswith("known walls (1.2 sigma, 2 so far)")


def test_dead_sonars_are_named():
    dead = {"/a/sonar/left": SameReading(None, 25.0, 4.2), "/a/sonar/x": SameReading(1.5, 30.0, 5)}
    finding = of(dead_sonars=dead)
    assert (finding.level, finding.code) == (WARN, Code.SONAR_DEAD)
    assert finding.message.endswith(
        "/a/sonar/left (no echo for 25 s and 4.2 m), /a/sonar/x (1.500 m for 30 s and 5.0 m)"
    )


def test_first_problem_is_the_most_serious_and_all_are_told():
    changes = {
        "trust": {"robot_a": Trust(lost=True, lost_ns=NOW_NS, times_lost=1)},
        "misfits": {0: Misfit(5, 1.0)},
    }
    finding = of(changes)
    assert finding.code == Code.CARRIED
    assert finding.values["problems"] == "carried, map_misfit"
    assert "carried" in finding.message
    assert "wall 0" in finding.message


def test_robot_that_has_just_begun_need_not_be_corrected_yet():
    assert of({"sources": {}}, began_ns=NOW_NS - 29 * SECOND).level == OK
    assert of({"sources": {}}, began_ns=NOW_NS - 31 * SECOND).code == Code.NOT_CORRECTED


def test_clocks_are_compared_only_while_there_is_odometry():
    assert of({"clocks": {"robot_b": 1.5}}, now_ns=NOW_NS + SECOND).level == OK


def test_observations_are_refused_after_three_in_a_row_and_for_ten_seconds():
    watch, now = RefusalWatch(), NOW_NS
    watch.update({"walls": Source(5, 2)}, now)  # two of them, among accepted ones
    assert not watch.refused(now)
    watch.update({"walls": Source(5, 3), "absolute": Source(0, 2)}, now + SECOND)
    assert watch.refused(now + SECOND) == {"walls"}
    watch.update({"walls": Source(6, 3), "absolute": Source(0, 3)}, now + 2 * SECOND)
    assert watch.refused(now + 2 * SECOND) == {"absolute"}
    assert watch.refused(now + 11 * SECOND) == {"absolute"}
    assert not watch.refused(now + 12 * SECOND)


def test_carried_robot_is_reported_for_ten_seconds():
    found = []
    for seconds in (9, 11):
        trust = Trust(times_lost=1, lost_ns=NOW_NS - seconds * SECOND)
        found.append(of({"trust": {"robot_a": trust}}))
    assert [finding.code for finding in found] == [Code.CARRIED, None]
    assert "they fit again" in found[0].message

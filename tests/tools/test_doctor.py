"""`mrs doctor`: what it makes of what it sees (a real team: tests/ros/test_doctor.py)."""

from __future__ import annotations

import pytest

from mrs_tools.doctor import ERROR, OK, STALE, WARN, Check, Facts, advice_for, diagnose, figures

ROBOT, PLANNER = "/robot_a/robot_node", "/planner_node"
WELL = {"state": (OK, "active", {"cpu_percent": "12"})}


def facts(**changes) -> Facts:
    given = {
        "domain": 7,
        "nodes": [PLANNER, ROBOT],
        "reports": {PLANNER: WELL, ROBOT: WELL},
        "sim_time": {PLANNER: False, ROBOT: False},
    }
    return Facts(**{**given, **changes})


def trouble(given: Facts) -> list[Check]:
    return [check for check in diagnose(given) if check.level != OK]


def test_all_is_well():
    assert trouble(facts()) == []
    assert [check.subject for check in diagnose(facts())] == [PLANNER, ROBOT]


def test_nobody_there():
    (check,) = diagnose(facts(nodes=[], reports={}, sim_time={}))
    assert (check.level, check.text) == (ERROR, "no robot_node and no planner_node in ROS domain 7")
    assert "ROS_DOMAIN_ID" in check.advice


@pytest.mark.parametrize(
    ("nodes", "wanted"), [([PLANNER], "no robot_node"), ([ROBOT], "no planner_node")]
)
def test_a_part_is_missing(nodes, wanted):
    (check,) = trouble(facts(nodes=nodes, reports=dict.fromkeys(nodes, WELL)))
    assert (check.level, check.text) == (ERROR, f"{wanted} in ROS domain 7")


@pytest.mark.parametrize(("name", "advice"), [(ROBOT, "rename one"), (PLANNER, "end one")])
def test_two_of_one_name(name, advice):
    (check,) = trouble(facts(nodes=[PLANNER, ROBOT, name]))
    assert (check.subject, check.level, check.text) == (name, ERROR, "2 nodes have this name")
    assert advice in check.advice


def test_a_node_that_says_nothing():
    (check,) = trouble(facts(reports={PLANNER: WELL}))
    assert (check.subject, check.level) == (ROBOT, ERROR)
    assert "reports nothing" in check.text


def test_what_nodes_report_is_passed_on_with_advice():
    text = "no data on /robot_a/odom for 7 s; publishers: 0"
    report = {**WELL, "odom": (ERROR, text, {}), "pairs": (WARN, "3 images found no pair; ...", {})}
    odom, pairs = trouble(facts(reports={PLANNER: WELL, ROBOT: report}))
    assert (odom.subject, odom.level, odom.text) == (f"{ROBOT}: odom", ERROR, text)
    assert odom.advice.startswith("start what publishes it")
    assert (pairs.level, "max_stamp_difference" in pairs.advice) == (WARN, True)


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("no data on /a/points for 5 s; publishers: 0", "start what"),
        ("no data on /a/points for 5 s; publishers: 1", "firewall"),
        ("no data on /a/x for 5 s; publishers: 1; incompatible QoS: RELIABILITY", "offer"),
        ("no data on /a/x for 5 s; publishers: 1; published as A, wanted: B", "remap one"),
        ("2 scans left out: no pose near their stamps", "poses"),
        ("2 scans left out: older than the newest by more than interval.max_scan_age", "late"),
        ("5 dropped; last: width is 0", "sender"),
        ("no usable pose on odom yet", "map_from_odom"),
        ("3.0 scans per second; expected: 15.0", "too slow"),
        ("inactive: hears and sends nothing until activated", "lifecycle"),
        ("its clock is 3 s ahead of the others': ... synchronize the clocks", ""),
    ],
)
def test_advice(text, wanted):
    advice = advice_for(text)
    assert wanted in advice
    assert bool(advice) == bool(wanted)


def test_clocks_of_recordings():
    sim = {PLANNER: True, ROBOT: False}
    clock, mixed = trouble(facts(sim_time=sim))
    assert (clock.subject, clock.level) == ("/clock", ERROR)
    assert mixed.text == f"is true for {PLANNER} and false for {ROBOT}"
    assert trouble(facts(sim_time={PLANNER: True, ROBOT: True}, has_clock=True)) == []
    assert trouble(facts(sim_time={PLANNER: True, ROBOT: None}, has_clock=True)) == []


def test_ends_that_do_not_meet():
    (check,) = trouble(facts(mismatches=[("/people", "a publishes it and b subscribes: X, Y")]))
    assert (check.subject, check.level) == ("/people", ERROR)


def test_figures_of_robots():
    planner = {
        "robot robot_a": (OK, "ok", {"scan_hz": "9.8", "age_s": "0.05", "clock_offset_s": "-0.01"}),
        "robot robot_b": (STALE, "no scan used yet", {"scan_hz": "0.0"}),
    }
    robot = {**WELL, "scan": (OK, "ok", {"disparity_ms": "2.5", "publish_ms": "0.5"})}
    assert figures(facts(reports={PLANNER: planner, ROBOT: robot})) == [
        ["robot_a", "9.8", "0.05", "-0.01", "12", "3.0"],
        ["robot_b", "0.0", "-", "-", "-", "-"],
    ]


def test_figures_that_are_no_numbers_are_left_out():
    """Everybody may publish on /diagnostics."""
    robot = {**WELL, "scan": (OK, "ok", {"disparity_ms": "2.5", "publish_ms": "soon"})}
    planner = {"robot robot_a": (OK, "ok", {})}
    assert figures(facts(reports={PLANNER: planner, ROBOT: robot}))[0][-1] == "2.5"

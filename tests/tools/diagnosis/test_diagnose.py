"""The diagnosis of a team from facts (of a real team: tests/ros/test_doctor.py)."""

from __future__ import annotations

from random import Random

import pytest

from mrs_people_loc.health.findings import Code
from mrs_tools.diagnosis.diagnose import Check, diagnose
from mrs_tools.diagnosis.facts import ERROR, OK, STALE, WARN, Endpoint, Facts, figures
from mrs_tools.diagnosis.load import Load

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


def test_healthy_team_has_no_findings():
    assert trouble(facts()) == []
    assert [check.subject for check in diagnose(facts())] == [PLANNER, ROBOT]


def test_mounting_that_cannot_be_checked_yet_is_named():
    unknown = (OK, "not enough floor in view to tell: too few views so far", {})
    _, robot = diagnose(facts(reports={PLANNER: WELL, ROBOT: {**WELL, "mounting": unknown}}))
    assert robot.level == OK
    assert robot.text == f"2 findings, all well; mounting: {unknown[1]}"


def test_missing_team_is_an_error():
    (check,) = diagnose(facts(nodes=[], reports={}, sim_time={}))
    assert (check.level, check.text) == (ERROR, "no robot_node and no planner_node in ROS domain 7")
    assert "ROS_DOMAIN_ID" in check.advice


@pytest.mark.parametrize(
    ("nodes", "wanted"), [([PLANNER], "no robot_node"), ([ROBOT], "no planner_node")]
)
def test_missing_node_is_an_error(nodes, wanted):
    (check,) = trouble(facts(nodes=nodes, reports=dict.fromkeys(nodes, WELL)))
    assert (check.level, check.text) == (ERROR, f"{wanted} in ROS domain 7")


@pytest.mark.parametrize(("name", "advice"), [(ROBOT, "rename it"), (PLANNER, "end one")])
def test_two_nodes_of_one_name_are_an_error(name, advice):
    (check,) = trouble(facts(nodes=[PLANNER, ROBOT, name]))
    assert (check.subject, check.level, check.text) == (name, ERROR, "2 nodes have this name")
    assert advice in check.advice


def test_silent_node_is_reported():
    (check,) = trouble(facts(reports={PLANNER: WELL}))
    assert (check.subject, check.level) == (ROBOT, ERROR)
    assert "reports nothing" in check.text


# --- what nodes report ----------------------------------------------------------------------------


def entry(level, code, text="text") -> tuple:
    return (level, text, {"code": str(code), "figure": "1"})


def printed(robot=None, planner=None, **changes) -> list[Check]:
    """What is made of the reports of a robot and of its planner."""
    reports = {ROBOT: {**WELL, **(robot or {})}, PLANNER: {**WELL, **(planner or {})}}
    return trouble(facts(**{"reports": reports, **changes}))


def test_load_of_the_machine_comes_before_the_cameras():
    late = {"left/image_rect": entry(ERROR, Code.NO_DATA, "no data for 4 s")}
    busy, camera = printed(late, load=Load(11.2, 2))
    assert (busy.subject, busy.level) == ("this machine", WARN)
    assert busy.text.startswith("load 11 on 2 cores: ")
    assert camera.advice.startswith("if it runs on this machine, lower its load first; it is ann")
    # As much as four nodes on two processors are; and a camera that nobody publishes.
    (camera,) = printed(late, load=Load(3.9, 2))
    assert "load" not in camera.advice
    (camera,) = printed({"left/image_rect": entry(ERROR, Code.NO_PUBLISHER)}, load=Load(11.2, 2))
    assert "load" not in camera.advice


def subjects(checks) -> list[str]:
    return [check.subject for check in checks]


def test_reports_of_nodes_are_shown_with_advice():
    text = "no data on /robot_a/odom for 7 s; publishers: 0"
    odom, pairs = printed({"odom": entry(ERROR, Code.NO_PUBLISHER, text), "pairs": (WARN, "3", {})})
    assert (odom.subject, odom.level, odom.text) == (f"{ROBOT}: odom", ERROR, text)
    assert odom.advice.startswith("start what publishes it")
    assert (pairs.level, pairs.advice) == (WARN, "")  # of a node that gives no codes


@pytest.mark.parametrize(
    ("code", "wanted"),
    [
        (Code.NO_PUBLISHER, "start what"),
        (Code.NO_DATA, "firewall"),
        (Code.WRONG_QOS, "offer"),
        (Code.WRONG_TYPE, "remap one"),
        (Code.LEFT_OUT_NO_POSE, "poses"),
        (Code.LEFT_OUT_TOO_OLD, "late"),
        (Code.ALL_REFUSED, "sender"),
        (Code.SOME_REFUSED, "sender"),
        (Code.OUTDATED, "follow /clock"),
        (Code.NO_POSE, "map_from_odom"),
        (Code.NO_PAIR, "docs/cameras.md"),
        (Code.SLOW, "too slow"),
        (Code.CARRIED, "pose_in"),
        (Code.MATE_DOUBTED, "localization.start"),
        (Code.MAP_MISFIT, "walls.file"),
        (Code.MATE_CLOCK, "synchronize"),
        (Code.CORRECTIONS_REFUSED, "mounting"),
        (Code.NOT_CORRECTED, "sensors of walls"),
        (Code.ODOMETRY_NOISY, "encoders"),
        (Code.SONAR_DEAD, "cable"),
        (Code.NO_MAP, "map_server"),
        (Code.TOUR_HALTED, "by itself"),
        (Code.PEOPLE_LOST, "pace.patience"),
        (Code.TAKES_NO_PART, "takes part again"),
        (Code.DRIVEN_BY_OTHERS, "joystick"),
        (Code.CLOCK_ASTRAY, ""),  # it says itself what to do
        (Code.NO_STAMPS, ""),
        (Code.OTHER_IMAGES, ""),
        (Code.TWO_PUBLISHERS, ""),
    ],
)
def test_advice_depends_on_the_code_and_not_on_the_text(code, wanted):
    (check,) = printed({"left/image_rect": entry(ERROR, code)})
    assert wanted in check.advice
    assert bool(check.advice) == bool(wanted)


# --- causes, and what follows from them -----------------------------------------------------------

PLANNER_HEARS_NO_SCAN = {
    "intervals": entry(STALE, Code.NO_INTERVAL),
    "robot_a/points": entry(ERROR, Code.NO_DATA),
    "robot robot_a": entry(STALE, Code.NO_SCAN),
}
ROBOT_HAS_NO_SCAN = {
    "pairs": entry(ERROR, Code.NO_PAIR),
    "head": entry(STALE, Code.NO_VIEW),
    "scan": entry(STALE, Code.NO_SCAN),
}


@pytest.mark.parametrize(
    ("subject", "code"),
    [
        ("left/image_rect", Code.ALL_REFUSED),
        ("right/image_rect", Code.NO_STAMPS),
        ("left/image_rect", Code.OTHER_IMAGES),
        ("right/camera_info", Code.ALL_REFUSED),
        ("left/image_rect", Code.NO_DATA),
    ],
)
def test_consequences_of_unused_images_are_listed_under_them(subject, code):
    """They are not listed first: a planner without data, and advice on networks."""
    (check,) = printed({**ROBOT_HAS_NO_SCAN, subject: entry(ERROR, code)}, PLANNER_HEARS_NO_SCAN)
    assert (check.subject, check.level) == (f"{ROBOT}: {subject}", ERROR)
    assert set(subjects(check.follows)) == {
        *(f"{ROBOT}: {each}" for each in ROBOT_HAS_NO_SCAN),
        *(f"{PLANNER}: {each}" for each in PLANNER_HEARS_NO_SCAN),
    }


def test_network_without_data_is_a_separate_error():
    """The robot sends scans; the missing data of the planner has no cause there."""
    (points,) = printed(planner=PLANNER_HEARS_NO_SCAN)
    assert (points.subject, points.level) == (f"{PLANNER}: robot_a/points", ERROR)
    assert "firewall" in points.advice
    assert len(points.follows) == 2


def test_findings_of_two_robots_are_separate():
    robot_b = "/robot_b/robot_node"
    reports = {
        ROBOT: {**WELL, "left/image_rect": entry(ERROR, Code.ALL_REFUSED)},
        robot_b: WELL,
        PLANNER: {**WELL, "robot_b/points": entry(ERROR, Code.NO_DATA)},
    }
    checks = trouble(facts(nodes=[PLANNER, ROBOT, robot_b], reports=reports))
    assert subjects(checks) == [f"{ROBOT}: left/image_rect", f"{PLANNER}: robot_b/points"]
    assert not any(check.follows for check in checks)


def test_missing_pose_follows_from_odometry_and_not_from_images():
    robot = {
        "left/image_rect": entry(ERROR, Code.ALL_REFUSED),
        "odom": entry(ERROR, Code.NO_PUBLISHER),
        "pose": entry(ERROR, Code.NO_POSE),
    }
    planner = {"robot_a/pose": entry(ERROR, Code.NO_DATA)}
    images, odom = printed(robot, planner)
    assert (images.subject, images.follows) == (f"{ROBOT}: left/image_rect", ())
    assert subjects(odom.follows) == [f"{ROBOT}: pose", f"{PLANNER}: robot_a/pose"]


def test_images_without_calibration_follow_from_camera_info():
    robot = {
        "right/camera_info": entry(ERROR, Code.NO_PUBLISHER),
        "right/image_rect": entry(ERROR, Code.NO_CALIBRATION),
    }
    (check,) = printed(robot)
    assert check.subject == f"{ROBOT}: right/camera_info"
    assert subjects(check.follows) == [f"{ROBOT}: right/image_rect"]


def test_completely_silent_camera_is_one_finding():
    silent = dict.fromkeys(("left/camera_info", "left/image_rect"), entry(ERROR, Code.NO_DATA))
    (check,) = printed(silent)
    assert check.subject == f"{ROBOT}: left/image_rect"
    assert subjects(check.follows) == [f"{ROBOT}: left/camera_info"]
    other = {**silent, "right/camera_info": entry(ERROR, Code.NO_DATA)}
    assert len(printed(other)) == 2
    assert len(printed({**silent, "left/image_rect": entry(ERROR, Code.ALL_REFUSED)})) == 2


def test_missing_robot_is_one_finding():
    planner = {
        "robot_c/points": entry(ERROR, Code.NO_PUBLISHER),
        "robot_c/pose": entry(ERROR, Code.NO_PUBLISHER),
        "robot robot_c": entry(STALE, Code.NO_SCAN),
    }
    (check,) = printed(planner=planner)
    assert check.subject == f"{PLANNER}: robot_c/points"
    assert check.advice.startswith("there is no /robot_c/robot_node: start it")
    assert len(check.follows) == 2


def test_halted_tour_follows_from_the_planner_that_finds_nobody():
    guide = "/guide_node"
    reports = {
        PLANNER: {**WELL, "intervals": entry(ERROR, Code.NO_INTERVAL)},
        ROBOT: WELL,
        guide: {
            **WELL,
            "tracked_people": entry(ERROR, Code.NO_DATA),
            "tour": entry(ERROR, Code.TOUR_HALTED),
        },
    }
    (check,) = trouble(facts(nodes=[PLANNER, ROBOT, guide], reports=reports))
    assert check.subject == f"{PLANNER}: intervals"
    assert subjects(check.follows) == [f"{guide}: tracked_people", f"{guide}: tour"]


def test_guide_that_hears_nobody_follows_from_missing_images():
    guide = "/guide_node"
    reports = {
        PLANNER: {**WELL, "intervals": entry(STALE, Code.NO_INTERVAL)},
        ROBOT: {**WELL, "left/image_rect": entry(ERROR, Code.NO_PUBLISHER)},
        guide: {**WELL, "tracked_people": entry(ERROR, Code.NO_DATA)},
    }
    (check,) = trouble(facts(nodes=[PLANNER, ROBOT, guide], reports=reports))
    assert check.subject == f"{ROBOT}: left/image_rect"
    assert f"{guide}: tracked_people" in subjects(check.follows)


def test_missing_odometry_is_advised_where_poses_are_explained():
    (check,) = printed({"odom": entry(ERROR, Code.NO_PUBLISHER)})
    assert "docs/robots.md#poses" in check.advice


def test_missing_robot_is_named_by_the_guide_that_lacks_its_pose():
    guide = "/guide_node"
    reports = {
        PLANNER: WELL,
        ROBOT: WELL,
        guide: {**WELL, "robot_c/pose": entry(ERROR, Code.NO_PUBLISHER)},
    }
    (check,) = trouble(facts(nodes=[PLANNER, ROBOT, guide], reports=reports))
    assert "there is no /robot_c/robot_node" in check.advice


def test_missing_poses_do_not_follow_from_scans_with_another_cause():
    """Images are refused, so there are no scans; missing poses have another cause."""
    robot = {"left/image_rect": entry(ERROR, Code.ALL_REFUSED)}
    planner = {
        "robot_a/points": entry(ERROR, Code.NO_DATA),
        "robot_a/pose": entry(ERROR, Code.NO_DATA),
    }
    assert subjects(printed(robot, planner)) == [
        f"{ROBOT}: left/image_rect",
        f"{PLANNER}: robot_a/pose",
    ]


def test_no_finding_is_lost_for_any_report():
    """Any node may publish on /diagnostics: also findings that follow from each other."""
    random = Random(1)
    names = ["left/camera_info", "left/image_rect", "right/image_rect", "odom", "pose", "scan"]
    names += ["pairs", "head", "intervals", "robot robot_a", "robot_a/points", "robot_a/pose"]
    for _ in range(200):
        levels, codes = (random.choices(of, k=12) for of in ([ERROR, STALE, WARN], list(Code)))
        bad = {name: entry(*how) for name, *how in zip(names, levels, codes, strict=True)}
        checks = printed(bad, bad)
        said = [check for one in checks for check in (one, *one.follows)]
        assert len({check.subject for check in said}) == len(said) == 2 * len(names)
        assert all(one.level == ERROR for one in checks if one.follows)


def test_errors_are_never_listed_under_lesser_findings():
    checks = printed({"scan": entry(STALE, Code.NO_SCAN)}, PLANNER_HEARS_NO_SCAN)
    assert [(check.subject, check.level) for check in checks] == [
        (f"{ROBOT}: scan", STALE),
        (f"{PLANNER}: robot_a/points", ERROR),
    ]


# --- the life cycle -------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("state", "advice"),
    [
        (
            "unconfigured",
            f"ros2 lifecycle set {ROBOT} configure && ros2 lifecycle set {ROBOT} activate",
        ),
        ("inactive", f"ros2 lifecycle set {ROBOT} activate"),
        ("finalized", "start it again"),
    ],
)
@pytest.mark.parametrize("reported", [True, False])
def test_inactive_node_is_not_reported_as_hanging(state, advice, reported):
    reports = {PLANNER: {**WELL, **PLANNER_HEARS_NO_SCAN}}
    if reported:  # before it was stopped
        reports[ROBOT] = {"odom": entry(ERROR, Code.NO_PUBLISHER)}
    states = {PLANNER: "active", ROBOT: state}
    (check,) = trouble(facts(reports=reports, states=states))
    assert (check.subject, check.level) == (ROBOT, ERROR)
    assert check.text.startswith(f"is {state}: ")
    assert advice in check.advice
    assert "hang" not in check.text + check.advice
    assert len(check.follows) == len(PLANNER_HEARS_NO_SCAN)


def test_report_of_a_silent_node_says_whether_it_answers():
    for state, text in [("active", "/diagnostics"), (None, ", and does not answer")]:
        (check,) = trouble(facts(reports={PLANNER: WELL}, states={PLANNER: "active", ROBOT: state}))
        assert check.text.endswith(text)
        assert "it hangs" in check.advice


# --- who should not be there ----------------------------------------------------------------------


def test_robot_without_a_namespace_is_reported():
    lone = "/robot_node"
    planner = {"intervals": entry(STALE, Code.NO_ROBOT)}
    reports = {PLANNER: {**WELL, **planner}, lone: WELL}
    (check,) = trouble(facts(nodes=[PLANNER, lone], reports=reports))
    assert (check.subject, check.level) == (lone, ERROR)
    assert "without a namespace" in check.text
    assert "__ns:=/robot_a" in check.advice
    assert subjects(check.follows) == [f"{PLANNER}: intervals"]


def test_second_planner_of_any_name_is_reported():
    (check,) = trouble(facts(people_from={"/tracked_people": ["/planner_node", "/planner_two"]}))
    assert (check.subject, check.level) == ("/tracked_people", ERROR)
    assert check.text == "2 nodes publish it: /planner_node, /planner_two"
    (said_once,) = printed(
        planner={"people": (ERROR, "2 publishers on /tracked_people", {})},
        people_from={"/tracked_people": ["/planner_node", "/planner_two"]},
    )
    assert said_once == check
    other = "/team/planner_node"
    (check,) = trouble(
        facts(
            nodes=[PLANNER, ROBOT, other],
            reports={PLANNER: WELL, ROBOT: WELL, other: WELL},
            people_from={"/tracked_people": [PLANNER], "/team/tracked_people": [other]},
            shared_robots={"/team/robot_a/points": [PLANNER, other], "/robot_b/points": [PLANNER]},
        )
    )
    assert (check.subject, check.level) == ("planners", WARN)
    assert f"{PLANNER} and {other} all listen to /team/robot_a/points" == check.text


def test_two_planners_of_one_name_are_reported_once():
    names = {"/tracked_people": [PLANNER, PLANNER]}
    (check,) = trouble(facts(nodes=[PLANNER, PLANNER, ROBOT], people_from=names))
    assert check.text == "2 nodes have this name"


def test_second_mrs_people_is_named_without_a_warning():
    given = facts(viewers=["/mrs_people_1", "/mrs_people_2"])
    assert trouble(given) == []
    assert diagnose(given)[-1].text == "2 run: /mrs_people_1, /mrs_people_2"


# --- time, and the rest ---------------------------------------------------------------------------


def test_mixed_use_sim_time_is_an_error():
    sim = {PLANNER: True, ROBOT: False}
    clock, mixed = trouble(facts(sim_time=sim))
    assert (clock.subject, clock.level) == ("/clock", ERROR)
    assert mixed.text == f"is true for {PLANNER} and false for {ROBOT}"
    assert trouble(facts(sim_time={PLANNER: True, ROBOT: True}, has_clock=True)) == []
    assert trouble(facts(sim_time={PLANNER: True, ROBOT: None}, has_clock=True)) == []


def test_incompatible_endpoints_are_an_error():
    what = "a publishes it and b subscribes with incompatible QoS: DURABILITY"
    (check,) = trouble(facts(mismatches=[("/tracked_people", what)]))
    assert (check.subject, check.level) == ("/tracked_people", ERROR)


OURS, SOCIAL = "mrs_people_msgs/msg/People", "people_msgs/msg/People"


@pytest.mark.parametrize(
    ("topic", "other", "publishes", "level", "advice"),
    [
        ("/people", SOCIAL, False, ERROR, "people_msgs/People on people"),
        ("/tracked_people", SOCIAL, True, WARN, "people_msgs/People on people"),
        ("/tracked_people", "std_msgs/msg/String", False, ERROR, "remap one of them"),
    ],
)
def test_two_types_on_one_topic_are_named(topic, other, publishes, level, advice):
    """An error where somebody gets nothing; two publishers alone take nothing from anybody."""
    ends = [Endpoint(OURS, PLANNER, True), Endpoint(other, "/nav2", publishes)]
    (check,) = trouble(facts(types={topic: ends}))
    assert (check.subject, check.level) == (topic, level)
    does = "publishes" if publishes else "subscribes"
    assert f"2 types, which never connect: {OURS} ({PLANNER} publishes); " in check.text
    assert f"{other} (/nav2 {does})" in check.text
    assert advice in check.advice


def test_figures_of_robots_are_listed():
    planner = {
        "robot robot_a": (OK, "ok", {"scan_hz": "9.8", "age_s": "0.05", "clock_offset_s": "-0.01"}),
        "robot robot_b": (STALE, "no scan used yet", {"scan_hz": "0.0"}),
    }
    robot = {**WELL, "scan": (OK, "ok", {"disparity_ms": "2.5", "publish_ms": "0.5"})}
    assert figures(facts(reports={PLANNER: planner, ROBOT: robot})) == [
        ["robot_a", "9.8", "0.05", "-0.01", "12", "3.0"],
        ["robot_b", "0.0", "-", "-", "-", "-"],
    ]


def test_figures_that_are_not_numbers_are_omitted():
    """Any node may publish on /diagnostics."""
    robot = {**WELL, "scan": (OK, "ok", {"disparity_ms": "2.5", "publish_ms": "soon"})}
    planner = {"robot robot_a": (OK, "ok", {})}
    assert figures(facts(reports={PLANNER: planner, ROBOT: robot}))[0][-1] == "2.5"


def test_hanging_robot_is_not_reported_missing():
    """The planner knows its publisher; the doctor, just started, does not discover its node."""
    silent = {
        "robot_a/points": entry(ERROR, Code.NO_DATA),
        "robot_a/pose": entry(ERROR, Code.NO_DATA),
    }
    (check,) = trouble(facts(nodes=[PLANNER], reports={PLANNER: {**WELL, **silent}}))
    assert check.subject == f"{PLANNER}: robot_a/points"
    assert check.advice.startswith("/robot_a/robot_node does not answer: it hangs")
    assert subjects(check.follows) == [f"{PLANNER}: robot_a/pose"]


def test_findings_that_wait_for_the_clock_follow_from_it():
    waits = {"robot robot_a": entry("waiting", Code.NO_CLOCK)}
    (check,) = printed(planner=waits, sim_time={ROBOT: True, PLANNER: True})
    assert (check.subject, check.level) == ("/clock", ERROR)
    assert subjects(check.follows) == [f"{PLANNER}: robot robot_a"]

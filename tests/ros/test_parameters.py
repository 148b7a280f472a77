"""Parameters: bad ones prevent the start and name the reason; at run time they are refused."""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Iterator, Mapping
from typing import Any

import numpy as np
import pytest
from rcl_interfaces.msg import ParameterType

from mrs_people_loc.config import PlannerConfig, RobotConfig, Section
from mrs_people_loc.scan import BODY_DTYPE, CELL_DTYPE
from ros.forked_starts import Start, ends_of
from ros.harness import NodeProcess, Peer, Team, holds
from ros.planner_peer import PlannerPeer
from ros.recording import DEFAULTS, Recording, stages_of, stamp_of
from ros.robot_peer import RobotPeer

# --- bad from the start ---------------------------------------------------------------------------

FILES = {
    "misspelt.yaml": "/**/planner_node:\n  ros__parameters:\n    interval: {max_wiat: 0.2}\n",
    "nested.yaml": "/robot_a/robot_node:\n  ros__parameters:\n    mounting: {height: tall}\n",
    "no.yaml": "robots: [\n",
}


def _p(*params: str) -> list[str]:
    return ["--ros-args", *(word for param in params for word in ("-p", param))]


def _file(name: str) -> list[str]:
    return ["--ros-args", "-r", "__ns:=/robot_a", "--params-file", name]


#: By what is wrong: executable, arguments, and what is to be said of it.
BAD_STARTS: dict[str, tuple[str, list[str], list[str]]] = {
    "misspelt": (
        "robot_node", _p("zones.lo:=0.3"),
        [r"unknown parameter zones\.lo; did you mean zones\.low\?"],
    ),
    "unknown": ("robot_node", _p("colour:=red"), ["unknown parameter colour; "]),
    "of the other node": (
        "robot_node", _p("clustering.distance:=0.2"), [r"unknown parameter clustering\.distance"]
    ),
    "section as a value": ("robot_node", _p("zones:=0.3"), ["unknown parameter zones; did you"]),
    "text for a number": (
        "robot_node", _p("zones.low:=abc"),
        [r"zones\.low is 'abc'; allowed: a number from -1 to 10"],
    ),
    "bool for a number": (
        "robot_node", _p("mounting.height:=true"), [r"mounting\.height is True; allowed: a number"]
    ),
    "number for a bool": (
        "robot_node", _p("images.top:=1"), [r"images\.top is 1; allowed: true or false"]
    ),
    "too small": (
        "robot_node", _p("mounting.height:=-0.1"),
        [r"mounting\.height is -0\.1; allowed: a number from 0 to 20"],
    ),
    "too large": (
        "robot_node", _p("images.queue_size:=101"),
        [r"images\.queue_size is 101; allowed: a whole number from 1 to 100"],
    ),
    "NaN": ("robot_node", _p("mounting.pitch:=.nan"), [r"mounting\.pitch is nan; allowed: a "]),
    "infinite": ("robot_node", _p("pose.max_rate:=.inf"), [r"pose\.max_rate is inf; allowed: "]),
    "no whole number": (
        "robot_node", _p("noise.min_points:=2.5"),
        [r"noise\.min_points is 2\.5; allowed: a whole number"],
    ),
    "even": (
        "robot_node", _p("disparity.block_size_px:=14"),
        [r"disparity\.block_size_px is 14; allowed: an odd whole number from 5 to 51"],
    ),
    "no such choice": (
        "robot_node", _p("pose.source:=vicon"),
        [r"pose\.source is 'vicon'; allowed: one of odom, pose_in, static, tf"],
    ),
    "static without a place": (
        "robot_node", _p("pose.source:=static"),
        [r"pose\.source is static but pose\.static is empty; allowed: x, y \[m\] and yaw"],
    ),
    "negative sigmas": (
        "robot_node", _p("pose.sigmas:=[0.1, -0.1, 0.0]"),
        [r"pose\.sigmas is \[0\.1, -0\.1, 0\.0\]; allowed: numbers of at least 0"],
    ),
    "TF that is there already": (
        "robot_node", _p("pose.source:=tf", "pose.publish_tf:=always"),
        [r"pose\.publish_tf is always; allowed where pose\.source is tf: auto, never"],
    ),
    "list too short": (
        "robot_node", _p("pose.map_from_odom:=[1.0, 2.0]"),
        [r"pose\.map_from_odom is .*; allowed: a list of numbers of length 3"],
    ),
    "list with NaN": (
        "robot_node", _p("pose.map_from_odom:=[1.0, .nan, 0.0]"),
        [r"pose\.map_from_odom is .*nan.*; allowed: a list of numbers"],
    ),
    "known walls that are not there": (
        "robot_node", _p("walls.file:=nowhere.yaml"), [r"nowhere\.yaml"]
    ),
    "sensor without a mounting": (
        "robot_node", _p("walls.laser:=true"),
        [r"walls\.laser_mounting is empty; needs tf2_ros, .*; allowed here: x, y, yaw"],
    ),
    "zones in the wrong order": (
        "robot_node", _p("zones.low:=1.5"),
        [r"zones\.low is 1\.5; allowed: less than zones\.high, 1\.4"],
    ),
    "ranges in the wrong order": (
        "robot_node", _p("disparity.max_range:=0.5"),
        [r"disparity\.min_range is 0\.7; allowed: less than disparity\.max_range, 0\.5"],
    ),
    "autostart is no bool": (
        "robot_node", _p("autostart:=maybe"), ["autostart is 'maybe'; allowed: true or false"]
    ),
    "use_sim_time is no bool": ("robot_node", _p("use_sim_time:=3"), ["'use_sim_time'.*'BOOL'"]),
    "bad value in a file": ("robot_node", _file("nested.yaml"), [r"mounting\.height is 'tall'"]),
    "no such file": ("robot_node", _file("nowhere.yaml"), [r"nowhere\.yaml"]),
    "no YAML": ("robot_node", _file("no.yaml"), [r"no\.yaml"]),
    "argument that is none": (
        "robot_node", ["--verbose"], ["unknown argument --verbose; parameters go after --ros-args"]
    ),
    "ROS argument that is none": ("robot_node", ["--ros-args", "-r", "nonsense"], ["nonsense"]),
    "misspelt in a file": (
        "planner_node", _file("misspelt.yaml"),
        [r"unknown parameter interval\.max_wiat; did you mean interval\.max_wait\?"],
    ),
    "robot named twice": (
        "planner_node", _p("robots:=[robot_a, robot_b, robot_a]"),
        ["robots names robot_a more than once; allowed: each robot once"],
    ),
    "robot with a slash": (
        "planner_node", _p("robots:=[/robot_a]"),
        ["robots has '/robot_a'; allowed: ROS namespaces without a leading slash"],
    ),
    "robot of no name": (
        "planner_node", _p("robots:=['']"), ["robots is .*; allowed: a list of texts"]
    ),
    "robot with a blank": ("planner_node", _p("robots:=['robot a']"), ["robots has 'robot a'"]),
    "robots are no list": (
        "planner_node", _p("robots:=robot_a"), ["robots is 'robot_a'; allowed: a list of texts"]
    ),
    "negative time": (
        "planner_node", _p("interval.max_wait:=-0.1"),
        [r"interval\.max_wait is -0\.1; allowed: a number from 0 to 5"],
    ),
    "heights in the wrong order": (
        "planner_node", _p("human.min_height:=2.5"),
        [r"human\.min_height is 2\.5; allowed: at most human\.max_height, 2\.2"],
    ),
    "unknown way to drive": (
        "guide_node", _p("drive:=wheels"), [r"drive is 'wheels'; allowed: one of cmd_vel, nav2"]
    ),
    "leader of no tour": (
        "guide_node", _p("robots:=[robot_a]", "leader:=robot_b"),
        ["leader has 'robot_b'; allowed: those of `robots`, robot_a"],
    ),
}  # fmt: skip
#: Where TF's packages are missing, as on the machines that these tests are made for.
NO_TF = {
    "tf2_ros": (
        "robot_node", _p("pose.source:=tf"),
        ["pose.source is tf; needs tf2_ros, which is not installed: sudo apt install "
         "ros-jazzy-tf2-ros; allowed here: odom, pose_in, static"],
    ),
}  # fmt: skip
BAD_STARTS |= {
    f"no {package}": start
    for package, start in NO_TF.items()
    if importlib.util.find_spec(package) is None
}


HELP: dict[str, tuple[str, list[str]]] = {
    "robot_node --help": ("robot_node", ["--help"]),
    "planner_node -h": ("planner_node", ["-h"]),
    "guide_node --help": ("guide_node", ["--help"]),
    "planner_node --help and ROS": ("planner_node", ["--help", "--ros-args", "-p", "robots:=[a]"]),
}


@pytest.fixture(scope="module")
def bad_start(team: Team) -> NodeProcess:
    """The first of them as a process that nobody forked, to hold the two against each other."""
    return team.start("robot_node", params={"zones.lo": "0.3"})


@pytest.fixture(scope="module")
def robot_process(bad_start: NodeProcess, team: Team) -> NodeProcess:
    """Whole numbers for those that need not be: `1` is taken for `1.0`."""
    params = {"mounting.height": "1", "zones.high": "1.5", "pose.map_from_odom": "[1, 2, 0]"}
    return team.start("robot_node", namespace="/robot_a", params=params)


@pytest.fixture(scope="module")
def planner_process(robot_process: NodeProcess, team: Team) -> NodeProcess:
    """One whose people are those of each interval: what a parameter changes shows at once."""
    params = {"robots": "[robot_a]", "tracking.enabled": "false"}
    return team.start("planner_node", params=params)


@pytest.fixture(scope="module")
def ends(
    planner_process: NodeProcess, tmp_path_factory: pytest.TempPathFactory
) -> Mapping[str, tuple[int, str]]:
    """Exit code and output of each of these starts (while the nodes below start, too)."""
    folder = tmp_path_factory.mktemp("params")
    for name, text in FILES.items():
        (folder / name).write_text(text)
    starts = [Start(*start[:2]) for start in (*BAD_STARTS.values(), *HELP.values())]
    return dict(zip([*BAD_STARTS, *HELP], ends_of(starts, folder), strict=True))


@pytest.mark.parametrize("case", BAD_STARTS)
def test_bad_parameters_stop_the_start(ends: Mapping[str, tuple[int, str]], case: str) -> None:
    code, output = ends[case]
    assert code == 2, output
    assert holds(output, BAD_STARTS[case][2]), output
    assert "Traceback" not in output


@pytest.mark.parametrize("case", HELP)
def test_help_is_printed_with_exit_code_0(ends: Mapping[str, tuple[int, str]], case: str) -> None:
    code, output = ends[case]
    assert code == 0
    assert output.startswith(f"usage: {HELP[case][0]} [--ros-args ")
    assert "config/default.yaml" in output


# --- at run time ----------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def robot(robot_process: NodeProcess, peer: Peer, recording: Recording) -> RobotPeer:
    return RobotPeer(peer, robot_process, recording)


@pytest.fixture(scope="module")
def planner(robot: RobotPeer, planner_process: NodeProcess, peer: Peer) -> PlannerPeer:
    made = PlannerPeer(peer, planner_process)
    peer.until_active(robot.node, made.node)
    robot.warm_up()
    return made


CONFIG = RobotConfig.from_mapping(
    {"zones.high": 1.5, "pose.map_from_odom": [1.0, 2.0, 0.0]}, base=DEFAULTS
)


@pytest.fixture
def papers(robot: RobotPeer) -> Iterator[RobotConfig]:
    """The robot runs the paper's zones, noise windows and cells, and seeks no bodies."""
    robot.peer.must_set(robot.node, bodies__search=False)
    yield RobotConfig.from_mapping({"bodies.search": False}, base=CONFIG)
    robot.peer.must_set(robot.node, bodies__search=True)


def test_forked_and_plain_starts_end_alike(
    ends: Mapping[str, tuple[int, str]], bad_start: NodeProcess
) -> None:
    def reported(text: str) -> str:
        return text.partition("]: ")[2]

    assert bad_start.exit_code() == ends["misspelt"][0] == 2
    assert reported(bad_start.log) == reported(ends["misspelt"][1]) != ""


def test_whole_numbers_are_accepted_for_float_parameters(
    robot: RobotPeer, planner: PlannerPeer
) -> None:
    robot.check(CONFIG)
    got = robot.peer.get(robot.node, "mounting.height", "zones.high", "pose.map_from_odom")
    assert got[:2] == [1.0, 1.5]
    assert isinstance(got[0], float)
    assert list(got[2]) == [1.0, 2.0, 0.0]
    # ... and at run time, too.
    robot.peer.must_set(robot.node, mounting__height=2)
    assert robot.peer.get(robot.node, "mounting.height") == [2.0]
    robot.check(RobotConfig.from_mapping({"mounting.height": 2.0}, base=CONFIG))
    robot.peer.must_set(robot.node, mounting__height=1.0)


@pytest.mark.parametrize("config_type", [RobotConfig, PlannerConfig])
def test_every_parameter_is_described(
    robot: RobotPeer, planner: PlannerPeer, config_type: type[Section]
) -> None:
    node = robot.node if config_type is RobotConfig else planner.node
    described = robot.peer.describe(node)
    types = {
        "bool": ParameterType.PARAMETER_BOOL,
        "int": ParameterType.PARAMETER_INTEGER,
        "float": ParameterType.PARAMETER_DOUBLE,
        "str": ParameterType.PARAMETER_STRING,
        "floats": ParameterType.PARAMETER_DOUBLE_ARRAY,
        "strs": ParameterType.PARAMETER_STRING_ARRAY,
    }
    for definition in config_type.parameters():
        descriptor = described.pop(definition.name)
        assert descriptor.description.startswith(definition.doc)
        assert descriptor.description.endswith("(taken when configured)") != definition.live
        assert descriptor.additional_constraints == definition.allowed()
        assert descriptor.type == types[definition.kind]
        ranges = [*descriptor.floating_point_range, *descriptor.integer_range]
        if definition.low is not None and definition.high is not None:
            (limits,) = ranges
            assert (limits.from_value, limits.to_value) == (definition.low, definition.high)
        else:
            assert ranges == []
    # What is left is rclpy's and the node's own.
    assert set(described) <= {"autostart", "use_sim_time", "start_type_description_service"}
    assert "autostart" in described


def test_live_parameter_takes_effect_on_the_next_scan(
    robot: RobotPeer, planner: PlannerPeer, papers: RobotConfig
) -> None:
    view = robot.view()
    before = stages_of(view, papers).scan.cells.to_records()
    robot.peer.must_set(robot.node, zones__low=0.6, noise__min_points=5, quantization__cell=0.1)
    changed = RobotConfig.from_mapping(
        {"zones.low": 0.6, "noise.min_points": 5, "quantization.cell": 0.1}, base=papers
    )
    after = robot.check(changed, view)
    assert after["z_min"].min() >= np.float32(0.6)
    assert before["z_min"].min() < 0.5
    robot.peer.must_set(robot.node, zones__low=0.2, noise__min_points=20, quantization__cell=0.05)
    robot.check(papers)


def test_body_search_is_switched_from_the_next_scan_on(
    robot: RobotPeer, planner: PlannerPeer
) -> None:
    assert robot.check(CONFIG).dtype == BODY_DTYPE
    robot.peer.must_set(robot.node, bodies__search=False)
    assert robot.check(_with({"bodies.search": False})).dtype == CELL_DTYPE
    robot.peer.must_set(robot.node, bodies__search=True)
    assert robot.check(CONFIG).dtype == BODY_DTYPE


@pytest.mark.parametrize(
    "params",
    [
        {"bodies__max_count": 1, "bodies__min_score": -20.0},
        {"bodies__max_range": 2.0, "bodies__min_score": -20.0},
        {"bodies__min_extent": 1.5, "bodies__min_score": -20.0},
        {"bodies__min_score": 20.0},
        {"bodies__axis": False},
        {"bodies__axis": False, "bodies__vote": False},
        {"bodies__human_test": False},
        {"disparity__fill_block_size_px": 0},
    ],
    ids=str,
)
def test_live_parameters_of_bodies_take_effect(
    robot: RobotPeer, planner: PlannerPeer, params: dict[str, Any]
) -> None:
    known = {p.name: p.default for p in RobotConfig.parameters()}
    names = {name: name.replace("__", ".") for name in params}
    view = robot.view()
    before = robot.check(CONFIG, view)
    robot.peer.must_set(robot.node, **params)
    view = robot.view()
    after = robot.check(_with({names[name]: value for name, value in params.items()}), view)
    assert after.tobytes() != before.tobytes()
    robot.peer.must_set(robot.node, **{name: known[names[name]] for name in params})
    np.testing.assert_array_equal(robot.check(CONFIG), before)


def _with(changes: Mapping[str, Any]) -> RobotConfig:
    return RobotConfig.from_mapping(changes, base=CONFIG)


def test_body_search_and_a_steeply_tilted_head_exclude_each_other(
    robot: RobotPeer, planner: PlannerPeer
) -> None:
    """The mounting is refused while bodies are searched for, and the search with that mounting."""

    def narrow() -> Any:
        view = robot.view()
        for _, info in view.values():
            for index in (0, 3, 5):
                info.p[index] *= 3.0
        return view

    # Far enough that the search range fits this camera.
    robot.peer.must_set(robot.node, disparity__min_range=2.0)
    robot.check(_with({"disparity.min_range": 2.0}), narrow())
    result = robot.peer.set_together(robot.node, mounting__pitch=1.5)
    assert not result.successful
    assert "bodies.search is true but the head looks steeply down" in result.reason
    assert "mounting.pitch = 1.5 rad" in result.reason
    assert robot.peer.get(robot.node, "mounting.pitch") == [0.0]
    robot.check(_with({"disparity.min_range": 2.0}), narrow())

    robot.peer.must_set(robot.node, mounting__pitch=1.5, bodies__search=False)
    down = {"disparity.min_range": 2.0, "mounting.pitch": 1.5, "bodies.search": False}
    robot.check(_with(down), narrow())
    result = robot.peer.set_together(robot.node, bodies__search=True)
    assert not result.successful
    assert "wanted: bodies.search false" in result.reason
    assert robot.peer.get(robot.node, "bodies.search") == [False]
    robot.check(_with(down), narrow())
    robot.peer.must_set(
        robot.node, mounting__pitch=0.0, bodies__search=True, disparity__min_range=0.7
    )
    robot.check(CONFIG)


def test_related_parameters_are_set_together(
    robot: RobotPeer, planner: PlannerPeer, papers: RobotConfig
) -> None:
    """One by one this would pass through a forbidden state: low over high."""
    low, high = robot.peer.set(robot.node, zones__low=1.6, zones__high=1.9)
    assert not low.successful
    assert "zones.low is 1.6; allowed: less than zones.high, 1.5" in low.reason
    assert high.successful
    robot.peer.must_set(robot.node, zones__low=1.6, zones__high=1.9)
    changed = {"zones.low": 1.6, "zones.high": 1.9}
    robot.check(RobotConfig.from_mapping(changed, base=papers))
    robot.peer.must_set(robot.node, zones__low=0.2, zones__high=1.5)
    robot.check(papers)


REFUSED: dict[str, tuple[dict[str, Any], str]] = {
    "too large": ({"zones__low": 11.0}, r"zones\.low out of range.*Max: 10\.0, value: 11\.0"),
    "NaN": ({"zones__low": math.nan}, r"zones\.low out of range.*value: nan"),
    "NaN in a list": ({"pose__map_from_odom": [0.0, math.nan, 0.0]}, r"map_from_odom is .*nan"),
    "text": ({"zones__low": "low"}, r"zones\.low is 'low'; allowed: a number"),
    "bool": ({"noise__min_points": True}, r"noise\.min_points is True; allowed: a whole number"),
    "fraction": ({"noise__min_points": 2.5}, r"noise\.min_points is 2\.5; allowed: a whole number"),
    "relation": ({"zones__low": 1.5}, r"zones\.low is 1\.5; allowed: less than zones\.high, 1\.5"),
    "bodies, relation": (
        {"bodies__vote": False},
        r"bodies\.axis is true but bodies\.vote is false; allowed: both true",
    ),
    "bodies, fraction": (
        {"bodies__max_count": 2.5},
        r"bodies\.max_count is 2\.5; allowed: a whole number from 1 to 100",
    ),
    "bodies, no bool": ({"bodies__search": 1}, r"bodies\.search is 1; allowed: true or false"),
    "even block": (
        {"disparity__fill_block_size_px": 10},
        r"fill_block_size_px is 10; allowed: 0 or an odd whole number from 5 to 51",
    ),
    "choice": (
        {"disparity__pre_filter": "sobel"},
        r"pre_filter is 'sobel'; allowed: one of xsobel",
    ),
    "list": ({"pose__map_from_odom": [1.0]}, r"pose\.map_from_odom is .*of length 3"),
    "deleted": ({"zones__low": None}, r"zones\.low"),
    "deleted list": ({"pose__map_from_odom": None}, r"pose\.map_from_odom"),
    "not live": (
        {"images__top": True},
        r"images\.top is set while the node runs; "
        r"allowed: in the lifecycle state unconfigured \(deactivate, clean up first\)",
    ),
    "not live, with one that is": (
        {"zones__low": 0.4, "pose__source": "pose_in"},
        r"pose\.source is set while the node runs",
    ),
    "taken at the start": ({"autostart": False}, "autostart"),
}


@pytest.mark.parametrize("case", REFUSED)
def test_refused_change_has_a_reason_and_no_effect(
    robot: RobotPeer, planner: PlannerPeer, case: str
) -> None:
    params, reason = REFUSED[case]
    names = [name.replace("__", ".") for name in params]
    before = robot.peer.get(robot.node, *names)
    result = robot.peer.set_together(robot.node, **params)
    assert not result.successful
    assert holds(result.reason, [reason]), result.reason
    assert repr(robot.peer.get(robot.node, *names)) == repr(before)
    robot.check(CONFIG)


def test_unknown_parameter_is_refused(robot: RobotPeer, planner: PlannerPeer) -> None:
    (result,) = robot.peer.set(robot.node, zones__lo=0.3)
    assert not result.successful
    assert "undeclared parameter" in result.reason  # rclpy's words
    assert "zones.lo" not in robot.peer.describe(robot.node)
    robot.check(CONFIG)


def test_parameter_that_does_not_fit_the_camera_is_refused(
    robot: RobotPeer, planner: PlannerPeer
) -> None:
    """It is allowed for other cameras, but not with this baseline."""

    def wide() -> Any:
        view = robot.view()
        view["right"][1].p[3] *= 2.0
        return view

    robot.check(CONFIG, wide())
    (result,) = robot.peer.set(robot.node, disparity__min_range=0.1)
    assert not result.successful
    assert result.reason.startswith("disparity.min_range = 0.1 m asks for 224 px of disparity")
    assert robot.peer.get(robot.node, "disparity.min_range") == [0.7]
    robot.check(CONFIG, wide())
    robot.check(CONFIG)


def test_setting_a_parameter_to_its_value_is_no_change(
    robot: RobotPeer, planner: PlannerPeer, papers: RobotConfig
) -> None:
    """Tools that set all parameters of a file at once rely on this."""
    robot.peer.must_set(robot.node, images__top=False, pose__source="odom", zones__low=0.3)
    robot.check(RobotConfig.from_mapping({"zones.low": 0.3}, base=papers))
    robot.peer.must_set(robot.node, zones__low=0.2)


def test_live_parameters_of_the_planner_take_effect(robot: RobotPeer, planner: PlannerPeer) -> None:
    for params, reason in (
        ({"robots": ["robot_b"]}, "robots is set while the node runs"),
        ({"map_frame": "world"}, "map_frame is set while the node runs"),
        ({"human__min_width": 1.4}, r"human\.min_width is 1\.4; allowed: at most human\.max_width"),
        ({"interval__robot_timeout": 0.0}, r"robot_timeout out of range Min: 0\.1.*value: 0\.0"),
        ({"joining__gate": 0.0}, r"joining\.gate out of range Min: 0\.1.*value: 0\.0"),
        ({"joining__line_of_sight": 1.0}, r"joining\.line_of_sight is 1\.0; allowed: true or fa"),
    ):
        before = planner.peer.get(planner.node, *(n.replace("__", ".") for n in params))
        result = planner.peer.set_together(planner.node, **params)
        assert not result.successful
        assert holds(result.reason, [reason]), result.reason
        after = planner.peer.get(planner.node, *(n.replace("__", ".") for n in params))
        assert after == before


def test_parameters_of_the_joining_take_effect(robot: RobotPeer, planner: PlannerPeer) -> None:
    peer = robot.peer
    peer.must_set(planner.node, joining__min_score=-20.0)  # whatever the fitted model says
    peer.until(lambda: _people(robot, planner, CONFIG) > 1, lambda: planner.process.log)
    peer.must_set(planner.node, joining__min_score=50.0)
    assert _people(robot, planner, CONFIG) == 0
    peer.must_set(planner.node, joining__min_score=-20.0, joining__apart=2.0)
    assert _people(robot, planner, CONFIG) > 0
    found = [person.pose.pose.position for person in planner.people[-1].persons]
    away = [math.dist((a.x, a.y), (b.x, b.y)) for a in found for b in found if a is not b]
    assert min(away, default=2.0) >= 2.0
    peer.must_set(planner.node, joining__min_score=0.0, joining__apart=0.42)


def test_parameters_of_the_size_of_people_take_effect(
    robot: RobotPeer, planner: PlannerPeer, papers: RobotConfig
) -> None:
    """Without the search for bodies."""
    peer = robot.peer
    peer.until(lambda: _people(robot, planner, papers) > 0, lambda: planner.process.log)
    peer.must_set(planner.node, human__min_points=1_000_000)
    assert _people(robot, planner, papers) == 0
    peer.must_set(planner.node, human__min_points=150)
    peer.until(lambda: _people(robot, planner, papers) > 0, lambda: planner.process.log)


def _people(robot: RobotPeer, planner: PlannerPeer, config: RobotConfig) -> int:
    """Sends a view until the planner answers, and says how many people it has found."""
    sent: set[int] = set()

    def answer() -> Any:
        view = robot.view()
        sent.add(stamp_of(view["left"][0]))
        robot.send_pose(robot.odometry(stamp_of(view["left"][0])))
        robot.check(config, view)
        robot.peer.spin(0.2)
        return next((reported for reported in planner.people if stamp_of(reported) in sent), None)

    return len(robot.peer.until(answer, lambda: planner.process.log).persons)

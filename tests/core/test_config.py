import dataclasses
import math

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from mrs_people_loc import config as cfg
from mrs_people_loc.config import (
    Parameter,
    PlannerConfig,
    RobotConfig,
    Section,
    load_team,
    robots_named,
)
from mrs_people_loc.errors import ConfigError, PeopleLocError

NAN, INF = math.nan, math.inf

ROBOT = {parameter.name: parameter for parameter in RobotConfig.parameters()}
PLANNER = {parameter.name: parameter for parameter in PlannerConfig.parameters()}
PARAMETERS = ROBOT | PLANNER


def config_of(name: str, value: object) -> Section:
    """The robot's or the planner's configuration with one value changed."""
    return (RobotConfig if name in ROBOT else PlannerConfig).from_mapping({name: value})


def value_of(config: Section, name: str) -> object:
    value: object = config
    for part in name.split("."):
        value = getattr(value, part)
    return value


# ---------------------------------------------------------------------------- defaults ----


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("images.working_width", 160),
        ("images.working_height", 120),
        ("mounting.height", 1.0),
        ("disparity.block_size_px", 7),
        ("disparity.fill_block_size_px", 11),
        ("disparity.pre_filter_size_px", 11),
        ("disparity.min_range", 0.7),
        ("disparity.max_range", 5.0),
        ("zones.low", 0.20),
        ("zones.high", 1.40),
        ("noise.window", 0.10),
        ("noise.min_points", 20),
        ("quantization.cell", 0.05),
        ("bodies.search", True),
        ("clustering.distance", 0.15),
        ("human.circle_sigmas", 3.0),
        ("pose.max_rate", 100.0),
        ("interval.max_wait", 0.1),
        ("interval.max_scan_age", 0.25),
        ("robots", ()),
    ],
)
def test_defaults_are_valid(name, value):
    assert PARAMETERS[name].default == value
    assert value_of((RobotConfig if name in ROBOT else PlannerConfig)(), name) == value


def test_papers_file_has_the_papers_constants(paper):
    config = paper()
    assert not config.bodies.search
    assert (config.images.working_width, config.images.working_height) == (160, 120)  # Table 1
    assert config.mounting.height == 1.0
    disparity = config.disparity
    assert (disparity.block_size_px, disparity.fill_block_size_px) == (15, 0)
    assert disparity.pre_filter_size_px == 11
    assert (disparity.min_range, disparity.max_range) == (1.0, 5.0)
    assert (config.zones.low, config.zones.high) == (0.20, 1.40)
    assert (config.noise.window, config.noise.min_points) == (0.10, 20)


@pytest.mark.parametrize("name", PARAMETERS)
def test_every_parameter_is_completely_defined(name):
    parameter = PARAMETERS[name]
    assert parameter.name == name
    assert parameter.doc
    assert parameter.check(parameter.default) == parameter.default
    assert type(parameter.check(parameter.default)) is type(parameter.default)
    if parameter.kind in ("int", "float"):
        assert parameter.low is not None
        assert parameter.high is not None


def test_configuration_is_immutable():
    with pytest.raises(dataclasses.FrozenInstanceError):
        RobotConfig().zones.low = 0.3  # type: ignore[misc]


# ------------------------------------------------------------------------------ values ----

RELATED = {  # a value at its limit needs its partner out of the way
    "disparity.min_range": {"disparity.max_range": 100.0},
    "disparity.max_range": {"disparity.min_range": 0.1},
    "zones.low": {"zones.high": 10.0},
    "zones.high": {"zones.low": -1.0},
    "human.min_height": {"human.max_height": 10.0},
    "human.max_height": {"human.min_height": 0.0},
    "human.min_width": {"human.max_width": 10.0},
    "human.max_width": {"human.min_width": 0.0},
}
NUMBERS = [name for name, p in PARAMETERS.items() if p.kind in ("int", "float")]


@pytest.mark.parametrize("name", NUMBERS)
def test_limits_are_inclusive(name):
    parameter = PARAMETERS[name]
    assert parameter.low is not None
    assert parameter.high is not None
    kind = {"int": int, "float": float}[parameter.kind]
    for limit, outwards in ((kind(parameter.low), -1), (kind(parameter.high), 1)):
        assert parameter.check(limit) == limit
        beyond = limit + outwards * (2 if kind is int else 1e-9)  # two: from odd to odd
        with pytest.raises(ConfigError, match=f"^{name} is .*; allowed: .* from .* to "):
            parameter.check(beyond)
        # zones.low = 10 leaves no room above, zones.high = -1 none below.
        if name in ("zones.low", "zones.high") and outwards == (1 if name == "zones.low" else -1):
            continue
        section = RobotConfig if name in ROBOT else PlannerConfig
        config = section.from_mapping({name: limit} | RELATED.get(name, {}))
        assert value_of(config, name) == limit


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("zones.low", NAN, "a number from -1 to 10"),
        ("zones.low", INF, "a number from -1 to 10"),
        ("zones.low", -INF, "a number from -1 to 10"),
        ("zones.low", None, "a number from -1 to 10"),
        ("zones.low", "0.2", "a number from -1 to 10"),
        ("zones.low", True, "a number from -1 to 10"),
        ("zones.low", [0.2], "a number from -1 to 10"),
        ("zones.low", 10**400, "a number from -1 to 10"),
        ("noise.min_points", 1.5, "a whole number from 1 to 100000"),
        ("noise.min_points", NAN, "a whole number from 1 to 100000"),
        ("noise.min_points", True, "a whole number"),
        ("noise.min_points", "20", "a whole number"),
        ("noise.min_points", -(10**400), "a whole number"),
        ("disparity.block_size_px", 14, "an odd whole number from 5 to 51"),
        ("disparity.block_size_px", 14.0, "an odd whole number"),
        ("disparity.pre_filter", "laplace", "one of xsobel, normalized_response"),
        ("disparity.pre_filter", None, "one of xsobel"),
        ("disparity.pre_filter", ["xsobel"], "one of xsobel"),
        ("images.top", 1, "true or false"),
        ("images.top", "true", "true or false"),
        ("images.top", None, "true or false"),
        ("pose.map_frame", 3, "a text"),
        ("pose.map_from_odom", [1.0, 2.0], "a list of numbers of length 3"),
        ("pose.map_from_odom", [1.0, 2.0, 3.0, 4.0], "a list of numbers of length 3"),
        ("pose.map_from_odom", [1.0, 2.0, NAN], "a list of numbers"),
        ("pose.map_from_odom", [1.0, 2.0, "3"], "a list of numbers"),
        ("pose.map_from_odom", [1.0, 2.0, True], "a list of numbers"),
        ("pose.map_from_odom", "123", "a list of numbers"),
        ("pose.map_from_odom", b"123", "a list of numbers"),
        ("pose.map_from_odom", 1.0, "a list of numbers"),
        ("robots", "robot_a", "a list of texts"),
        ("robots", ["robot_a", ""], "a list of texts"),
        ("robots", ["robot_a", 1], "a list of texts"),
        ("robots", None, "a list of texts"),
    ],
)
def test_a_bad_value_is_refused(name, value, allowed):
    with pytest.raises(ConfigError) as error:
        config_of(name, value)
    assert str(error.value).startswith(f"{name} is {value!r}; allowed: {allowed}")


@pytest.mark.parametrize(
    ("name", "given", "value"),
    [
        ("noise.min_points", 20.0, 20),
        ("zones.low", 0, 0.0),
        ("zones.low", 1, 1.0),
        ("pose.map_from_odom", [1, 2.5, 3], (1.0, 2.5, 3.0)),
        ("pose.map_from_odom", [], ()),
        ("robots", ["robot_a", "robot_b"], ("robot_a", "robot_b")),
        ("robots", ["fleet/robot_a"], ("fleet/robot_a",)),
        ("images.top", True, True),
    ],
)
def test_values_are_converted_to_the_type_of_the_field(name, given, value):
    got = value_of(config_of(name, given), name)
    assert got == value
    assert type(got) is type(value)
    if isinstance(value, tuple):
        assert [type(item) for item in got] == [type(item) for item in value]  # type: ignore[attr-defined]


def test_allowed_values_without_limits_are_stated():
    assert Parameter("x", "float", 1.0, "").allowed() == "a number"
    assert Parameter("x", "int", 1, "", low=2).allowed() == "a whole number of at least 2"
    assert Parameter("x", "int", 1, "").check(10**30) == 10**30


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"zones.low": 1.4}, "zones.low is 1.4; allowed: less than zones.high, 1.4"),
        (
            {"zones.low": 1.5, "zones.high": 1.2},
            "zones.low is 1.5; allowed: less than zones.high, ",
        ),
        (
            {"disparity.min_range": 5.0},
            "disparity.min_range is 5; allowed: less than disparity.max_range, 5",
        ),
        ({"disparity.max_range": 0.5}, "disparity.min_range is 0.7; allowed: less than"),
        *(
            (
                {"disparity.fill_block_size_px": px},
                f"disparity.fill_block_size_px is {px}; allowed: 0 or an odd whole number from 5",
            )
            for px in (1, 3, 4, 10)
        ),
        ({"bodies.vote": False}, "bodies.axis is true but bodies.vote is false; allowed: both"),
        ({"human.min_height": 2.3}, "human.min_height is 2.3; allowed: at most human.max_height"),
        ({"human.max_width": 0.1}, "human.min_width is 0.2; allowed: at most human.max_width, 0.1"),
        (
            {"pose.source": "tf", "pose.publish_tf": "always"},
            r"pose\.publish_tf is always; allowed where pose\.source is tf: auto, never",
        ),
        (
            {"pose.sigmas": [0.1, -0.1, 0.0]},
            r"pose\.sigmas is \[0\.1, -0\.1, 0\.0\]; allowed: .* 0",
        ),
        ({"robots": ["a", "b", "a"]}, "robots names a more than once; allowed: each robot once"),
        ({"robots": ["/robot_a"]}, "robots has '/robot_a'; allowed: ROS namespaces without a lead"),
        ({"robots": ["robot a"]}, "robots has 'robot a'"),
        ({"robots": ["robot_a/"]}, "robots has 'robot_a/'"),
        ({"robots": ["1"]}, "robots has '1'"),
    ],
)
def test_inconsistent_values_are_refused(values, message):
    section = RobotConfig if set(values) <= set(ROBOT) else PlannerConfig
    with pytest.raises(ConfigError, match=message):
        section.from_mapping(values)


@pytest.mark.parametrize(
    "values",
    [
        {"disparity.fill_block_size_px": 0},
        {"disparity.fill_block_size_px": 5},
        {"disparity.fill_block_size_px": 51},
        {"bodies.vote": False, "bodies.axis": False},
        {"bodies.axis": False},
    ],
    ids=str,
)
def test_consistent_values_are_accepted(values):
    config = RobotConfig.from_mapping(values)
    assert {name: value_of(config, name) for name in values} == values


def test_limits_that_meet_are_allowed_for_people():
    PlannerConfig.from_mapping({"human.min_height": 2.2, "human.max_width": 0.2})


def test_section_validates_its_values():
    with pytest.raises(ConfigError, match="Zones: low is nan; allowed: a number from -1 to 10"):
        cfg.Zones(low=NAN)
    assert type(cfg.Noise(min_points=20.0).min_points) is int


# ------------------------------------------------------------------------------- names ----


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"zones.hihg": 1.0}, "unknown parameter zones.hihg; did you mean zones.high?"),
        ({"zones": {"lwo": 1.0}}, "unknown parameter zones.lwo; did you mean zones.low?"),
        ({"zones": 1.0}, "unknown parameter zones; did you mean zones.low?"),
        ({"noise.windw": 0.1}, "did you mean noise.window?"),
        ({"zones.low.m": 1.0}, "unknown parameter zones.low.m; did you mean zones.low?"),
        ({"qqq": 1.0}, "unknown parameter qqq; known: images.rectified, images.top, "),
        ({1: 1.0}, "unknown parameter 1; known: "),
        ({None: 1.0}, "unknown parameter None; "),
    ],
)
def test_an_unknown_name_is_refused(values, message):
    with pytest.raises(ConfigError) as error:
        RobotConfig.from_mapping(values)
    assert message in str(error.value)


def test_nested_and_dotted_names_are_equivalent():
    nested = RobotConfig.from_mapping({"zones": {"low": 0.3}, "noise": {"min_points": 5}})
    assert nested == RobotConfig.from_mapping({"zones.low": 0.3, "noise.min_points": 5})
    assert nested.zones == cfg.Zones(low=0.3, high=1.4)
    assert nested.noise == cfg.Noise(min_points=5)
    assert nested.disparity == cfg.Disparity()


def test_unnamed_values_are_kept():
    base = RobotConfig.from_mapping({"zones.low": 0.3, "mounting.height": 2.0})
    changed = RobotConfig.from_mapping({"zones.high": 1.2}, base)
    assert changed.zones == cfg.Zones(low=0.3, high=1.2)
    assert changed.mounting.height == 2.0
    assert base.zones.high == 1.4
    assert RobotConfig.from_mapping({}, base) == base
    assert RobotConfig.from_mapping({"zones": {}}) == RobotConfig()


@pytest.mark.parametrize(
    "config",
    [
        RobotConfig(),
        PlannerConfig(),
        RobotConfig.from_mapping({"pose.map_from_odom": [1, 2, 3], "images.top": True}),
        PlannerConfig.from_mapping({"robots": ["robot_b", "robot_a"]}),
    ],
)
def test_mapping_round_trip_also_through_yaml(config):
    mapping = config.to_mapping()
    assert type(config).from_mapping(mapping) == config
    assert type(config).from_mapping(yaml.safe_load(yaml.safe_dump(mapping))) == config


plain = st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5)
values = plain | st.lists(plain, max_size=3)
names = st.sampled_from([*PARAMETERS, *{name.split(".")[0] for name in PARAMETERS}]) | plain


@given(st.recursive(st.dictionaries(names, values, max_size=4), lambda inner: st.dictionaries(
    names, inner | values, max_size=3
)))  # fmt: skip
def test_any_mapping_is_accepted_or_refused(mapping):
    for section in (RobotConfig, PlannerConfig):
        try:
            section.from_mapping(mapping)
        except PeopleLocError as err:
            assert type(err) is ConfigError  # noqa: PT017


# ------------------------------------------------------------------------------- files ----

TEAM = """
/**/robot_node:            # every robot
  ros__parameters:
    use_sim_time: true
    zones: {low: 0.30, high: 1.30}
    noise.min_points: 15
/robot_a/robot_node:       # one robot; later sections win
  ros__parameters:
    zones: {low: 0.25}
    images: {top: true}
/**/planner_node:
  ros__parameters:
    robots: [robot_a, robot_b]
    human: {min_points: 99}
"""


@pytest.fixture(scope="session")
def file_with(tmp_path_factory):
    folder = tmp_path_factory.mktemp("config")

    def write(content: str | bytes, name: str = "team.yaml"):
        path = folder / name
        path.write_bytes(content.encode() if isinstance(content, str) else content)
        return path

    return write


def test_team_file_gives_each_robots_configuration(file_with):
    team = load_team(file_with(TEAM))
    assert team.planner == PlannerConfig.from_mapping(
        {"robots": ["robot_a", "robot_b"], "human.min_points": 99}
    )
    every = {"zones": {"low": 0.30, "high": 1.30}, "noise.min_points": 15}
    assert dict(team.robots) == {
        "robot_a": RobotConfig.from_mapping(every | {"zones.low": 0.25, "images.top": True}),
        "robot_b": RobotConfig.from_mapping(every),
    }


def test_later_sections_win(file_with):
    first_one, then_all = TEAM.index("/robot_a"), TEAM.index("/**/planner")
    turned = TEAM[first_one:then_all] + TEAM[:first_one] + TEAM[then_all:]
    robot = load_team(file_with(turned)).robots["robot_a"]
    assert robot.zones == cfg.Zones(low=0.30, high=1.30)
    assert robot.images.top


def test_later_files_win(file_with):
    one = file_with(TEAM, "one.yaml")
    other = file_with(
        "/**/robot_node: {ros__parameters: {zones: {low: 0.1}}}\n"
        "/**/planner_node: {ros__parameters: {robots: [robot_c, robot_a]}}",
        "other.yaml",
    )
    team = load_team(one, other)
    assert team.planner.robots == ("robot_c", "robot_a")
    assert team.planner.human.min_points == 99
    assert team.robots["robot_a"].zones == cfg.Zones(low=0.1, high=1.3)
    team = load_team(other, one)
    assert team.planner.robots == ("robot_a", "robot_b")
    assert team.robots["robot_a"].zones == cfg.Zones(low=0.25, high=1.3)


ONE_FOR_ALL = "/**/robot_node: {ros__parameters: {zones: {low: 0.1}}}"


def test_unnamed_robots_get_the_common_sections(file_with):
    path = file_with(ONE_FOR_ALL)
    assert dict(load_team(path).robots) == {}
    team = load_team(path, robots=("robot_x", "fleet/robot_y"))
    assert team.robots["robot_x"].zones.low == 0.1
    assert team.robots["fleet/robot_y"].zones.low == 0.1
    assert team.planner.robots == ()
    assert list(load_team(file_with(TEAM), robots=("robot_x",)).robots) == ["robot_a", "robot_b"]


def test_values_given_by_the_caller_yield_to_the_file(file_with):
    unless_said = {"robot_a": {"images.top": False, "mounting.height": 1.5}}
    robots = load_team(file_with(TEAM), unless_said=unless_said).robots
    assert robots["robot_a"].images.top  # the file says so
    assert robots["robot_a"].mounting.height == 1.5
    assert robots["robot_b"].mounting.height == 1.0


def test_robots_named_in_files_are_listed(file_with):
    assert robots_named(file_with(TEAM)) == ("robot_a", "robot_b")
    assert robots_named(file_with(ONE_FOR_ALL)) == ()
    own = (
        "/robot_b/robot_node: {ros__parameters: {}}\n"
        "/fleet/robot_a/robot_node: {ros__parameters: {}}"
    )
    assert robots_named(file_with(own), file_with(ONE_FOR_ALL, "all.yaml")) == (
        "robot_b",
        "fleet/robot_a",
    )


@pytest.mark.parametrize(
    ("key", "robots"),
    [
        ("/**/robot_node", {"robot_a", "fleet/robot_b"}),
        ("/**", {"robot_a", "fleet/robot_b"}),
        ("/*/robot_node", {"robot_a"}),
        ("/robot_a/robot_node", {"robot_a"}),
        ("robot_a/robot_node", {"robot_a"}),
        ("/fleet/**/robot_node", {"fleet/robot_b"}),
        ("/fleet/*/robot_node", {"fleet/robot_b"}),
        ("/*/robot_b/robot_node", {"fleet/robot_b"}),
        ("/robot_node", set()),
    ],
)
def test_section_patterns_select_robots(file_with, key, robots):
    own = "use_sim_time: true" if key == "/**" else "zones: {low: 0.1}"
    path = file_with(f"'{key}': {{ros__parameters: {{{own}}}}}")
    if key == "/robot_node":
        with pytest.raises(ConfigError, match="section /robot_node is of a robot that is not in t"):
            load_team(path, robots=("robot_a", "fleet/robot_b"))
        return
    team = load_team(path, robots=("robot_a", "fleet/robot_b"))
    if key != "/**":
        assert {name for name, config in team.robots.items() if config.zones.low == 0.1} == robots


@pytest.mark.parametrize(
    ("content", "message"),
    [
        ("", "is not a ROS 2 parameter file"),
        ("[1, 2]", "is not a ROS 2 parameter file"),
        ("text", "is not a ROS 2 parameter file"),
        ("/**: {}", r"section /\*\* must hold `ros__parameters:` and only that"),
        ("/**: [ros__parameters]", "must hold `ros__parameters:` and only that"),
        ("/**: {ros__parameters: {}, more: 1}", "must hold `ros__parameters:` and only that"),
        ("/**/robot_node: {ros__parameters: }", "ros__parameters must be a mapping"),
        ("/**/robot_node: {ros__parameters: [1]}", "ros__parameters must be a mapping"),
        ("a: {b", "cannot be read as a YAML file"),
        ("\t- a", "cannot be read as a YAML file"),
        (b"a: \xff\xfe", "cannot be read as a YAML file"),
        # What PyYAML does not translate into its own error.
        ("a: 2001-13-45", "cannot be read as a YAML file"),
        ("a: !!int x", "cannot be read as a YAML file"),
        ("a: !!int ''", "cannot be read as a YAML file"),
        ("a: !!bool x", "cannot be read as a YAML file"),
        ("a: !!timestamp x", "cannot be read as a YAML file"),
        ("[" * 1000, "cannot be read as a YAML file"),
        ("a: " + "9" * 5000, "cannot be read as a YAML file"),
        ("/**/robot_node: {ros__parameters: &a {zones: *a}}", r"read as a YAML file: .*alias, \*a"),
        (
            "/**/robot_node: {ros__parameters: {zones: &a [*a]}}",
            r"found an alias, \*a; wanted: none",
        ),
        (
            "/**/robot_node: {ros__parameters: {noise: {window: 1.0e+400}}}",
            "noise.window is inf; al",
        ),
        (
            "/**/robot_node: {ros__parameters: {noise.window: " + "9" * 400 + "}}",
            "noise.window is 9+; allowed",
        ),
        (
            "/**/robot_node: {ros__parameters: {zones: {hihg: 1}}}",
            r"section /\*\*/robot_node: unknown parameter zones.hihg; did you mean zones.high",
        ),
        (
            "/r/robot_node: {ros__parameters: {zones: {low: 9.0}}}",
            "section /r/robot_node: zones.low is 9; allowed: less than zones.high",
        ),
        (
            "/**/planner_node: {ros__parameters: {zones: {low: 0.2}}}",
            r"section /\*\*/planner_node: unknown parameter zones.low",
        ),
        (
            "/**/planner_node: {ros__parameters: {robots: [a, a]}}",
            "robots names a more than once",
        ),
        ("/**: {ros__parameters: {zones: {low: 0.2}}}", "unknown parameter zones.low"),
        ("/robot_a/robto_node: {ros__parameters: {}}", "section /robot_a/robto_node names no node"),
        ("/my_planner_node: {ros__parameters: {a: 1}}", "section /my_planner_node names no node"),
        ("/r/my_robot_node: {ros__parameters: {a: 1}}", "section /r/my_robot_node names no node"),
        ("/robot_*/robot_node: {ros__parameters: {}}", r"section /robot_\*/robot_node names no no"),
    ],
)
def test_a_bad_file_is_refused(file_with, content, message):
    path = file_with(content)
    with pytest.raises(ConfigError, match=message) as error:
        load_team(path)
    assert str(error.value).startswith(f"{path}: ") or "/**: {ros" in str(content)


def test_sections_of_other_nodes_are_ignored(file_with):
    """An ordinary ROS 2 parameter file with the nodes of a whole machine."""
    others = """
/camera_driver: {ros__parameters: {fps: 30, zones: {low: wrong}}}
/robot_a/planner_server: {ros__parameters: {robots: 3}}
/robot_a: {ekf_node: {ros__parameters: {two_d_mode: true}}}
something: {else: [1, 2]}
/**: {ros__parameters: {use_sim_time: true}}
"""
    assert load_team(file_with(TEAM + others)) == load_team(file_with(TEAM, "ours.yaml"))
    assert robots_named(file_with(TEAM + others)) == ("robot_a", "robot_b")


def test_namespace_may_contain_nested_nodes(file_with):
    """As in ROS 2; our nodes are checked there, too."""
    inside = "fleet: {robot_a: {robot_node: {ros__parameters: {zones: {low: %s}}}}}"
    path = file_with(inside % 0.1)
    assert robots_named(path) == ("fleet/robot_a",)
    assert load_team(path, robots=("fleet/robot_a",)).robots["fleet/robot_a"].zones.low == 0.1
    with pytest.raises(ConfigError, match="section /fleet/robot_a/robot_node: zones.low is 'x'"):
        load_team(file_with(inside % "x"))
    misspelt = "fleet: {robot_nod: {ros__parameters: {}}}"
    with pytest.raises(ConfigError, match=r"/fleet/robot_nod names .* did you mean \.\.\./robot_n"):
        load_team(file_with(misspelt))
    forgotten = "/robot_a/robot_node: {ros_parameters: {zones: {low: 0.1}}}"
    with pytest.raises(ConfigError, match="must hold `ros__parameters:` and only that"):
        load_team(file_with(forgotten))


def test_home_folder_is_expanded(file_with, monkeypatch):
    path = file_with(TEAM)
    monkeypatch.setenv("HOME", str(path.parent))
    assert load_team(f"~/{path.name}") == load_team(path)
    with pytest.raises(ConfigError, match=f"{path.parent}/none.yaml: cannot be read"):
        robots_named("~/none.yaml")


def test_a_robot_that_is_not_in_the_team_is_refused(file_with):
    path = file_with(TEAM.replace("/robot_a/", "/robot_x/"))
    message = "section /robot_x/robot_node is of a robot that is not in the team: robot_a, robot_b"
    with pytest.raises(ConfigError, match=message):
        load_team(path)


def test_relations_are_checked_across_sections(file_with):
    content = (
        "/**/robot_node: {ros__parameters: {zones: {high: 0.9}}}\n"
        "/robot_a/robot_node: {ros__parameters: {zones: {low: 1.0}}}\n"
        "/**/planner_node: {ros__parameters: {robots: [robot_a]}}"
    )
    with pytest.raises(ConfigError, match=r"zones\.low is 1; allowed: less than zones\.high, 0.9"):
        load_team(file_with(content))


def test_static_poses_may_follow_in_later_sections(file_with):
    """A section for all robots, and the pose of each in its own."""
    path = file_with("""
/**/robot_node: {ros__parameters: {pose: {source: static}}}
/robot_a/robot_node: {ros__parameters: {pose: {static: [1, 2, 0.5]}}}
""")
    team = load_team(path, robots=("robot_a",))
    assert team.robots["robot_a"].pose.static == (1.0, 2.0, 0.5)


def test_missing_file_is_refused(file_with):
    folder = file_with("").parent
    for path in (folder / "none.yaml", folder, str(folder / "none.yaml"), "a\0b"):
        with pytest.raises(ConfigError, match="cannot be read as a YAML file"):
            load_team(path)


@pytest.mark.parametrize(
    "line", ["a{0}: &a{0} [*a{1}, *a{1}]", "a{0}: &a{0} {{x: *a{1}, y: *a{1}}}",
             "a{0}: &a{0} {{<<: [*a{1}, *a{1}]}}"]
)  # fmt: skip
def test_yaml_alias_bombs_are_refused(file_with, line):
    bomb = ["a0: &a0 {x: 1}", *(line.format(i, i - 1) for i in range(1, 60))]
    path = file_with("/**/robot_node:\n  ros__parameters:\n    " + "\n    ".join(bomb))
    with pytest.raises(ConfigError, match=r"found an alias, \*a0; wanted: none"):
        load_team(path)


node_keys = st.sampled_from(["/**", "/*", "/**/robot_node", "/r/robot_node", "/**/planner_node"])
bodies = st.dictionaries(
    st.just("ros__parameters"),
    st.dictionaries(names, st.dictionaries(names, values, max_size=2) | values, max_size=3) | plain,
)
documents = (
    st.dictionaries(node_keys | plain, bodies | plain, max_size=3).map(yaml.safe_dump)
    | st.text(st.sampled_from("/*_:{}[]&!%-?|>'\"#, \n\tarobtnde019.~"), max_size=40)
    | st.text(max_size=20)
    | st.binary(max_size=20)
)


@given(documents, st.sampled_from([(), ("r",), ("r", "r/s")]))
@settings(max_examples=200)
def test_any_file_is_accepted_or_refused(file_with, content, robots):
    path = file_with(content, "any.yaml")
    for read in (lambda: load_team(path, robots=robots), lambda: robots_named(path)):
        try:
            read()
        except PeopleLocError as err:
            assert type(err) is ConfigError  # noqa: PT017

import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st

from core.config.strategies import names, plain, values
from mrs_people_loc import config as cfg
from mrs_people_loc.config import (
    GuideConfig,
    PlannerConfig,
    RobotConfig,
    load_team,
    overridden,
    robots_named,
)
from mrs_people_loc.errors import ConfigError, PeopleLocError

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
/**/guide_node:
  ros__parameters:
    pace: {speed: 0.4}
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
    assert team.guide == GuideConfig.from_mapping({"pace.speed": 0.4})
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
    defaults = {"robot_a": {"images.top": False, "mounting.height": 1.5}}
    robots = load_team(file_with(TEAM), defaults=defaults).robots
    assert robots["robot_a"].images.top  # the file says so
    assert robots["robot_a"].mounting.height == 1.5
    assert robots["robot_b"].mounting.height == 1.0


def test_overridden_parameters_are_named(file_with):
    """The height of robot_b is the same in both files, and only the first one sets the roll."""
    own = file_with(
        "/robot_a/robot_node: {ros__parameters: {mounting: {height: 1.5, pitch: 0.1}}}\n"
        "/**/planner_node: {ros__parameters: {robots: [robot_a, robot_b]}}\n",
        "own.yaml",
    )
    given = file_with(
        "/**/robot_node: {ros__parameters: {mounting: {height: 1.2, pitch: 0.1, roll: 0.2}}}\n"
        "/**/planner_node: {ros__parameters: {robots: [robot_a]}}\n",
        "given.yaml",
    )
    assert overridden([given], own, ["robot_a", "robot_b"]) == ("robots", "mounting.height")
    assert overridden([given], own, ["robot_b"]) == ("robots",)
    assert overridden([own], own, ["robot_a", "robot_b"]) == ()


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
        ("a: {b", r"cannot be read as a YAML file(.|\n)*\.yaml\", line 1"),
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
        (
            "/**/guide_node: {ros__parameters: {pace: {sped: 1.0}}}",
            r"section /\*\*/guide_node: unknown parameter pace.sped; did you mean pace.speed\?",
        ),
        ("/guid_node: {ros__parameters: {a: 1}}", "did you mean .../guide_node"),
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
    with pytest.raises(ConfigError, match=f"{path.parent}/none.yaml: there is no such file"):
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
    for path in (folder / "none.yaml", str(folder / "none.yaml")):
        with pytest.raises(ConfigError, match=r"none\.yaml: there is no such file"):
            load_team(path)
    for path in (folder, "a\0b"):
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


@pytest.mark.slow
@given(documents, st.sampled_from([(), ("r",), ("r", "r/s")]))
@settings(max_examples=200)
def test_any_file_is_accepted_or_refused(file_with, content, robots):
    path = file_with(content, "any.yaml")
    for read in (lambda: load_team(path, robots=robots), lambda: robots_named(path)):
        try:
            read()
        except PeopleLocError as err:
            assert type(err) is ConfigError  # noqa: PT017

import dataclasses
import math
from pathlib import Path

import pytest
import yaml
from hypothesis import given
from hypothesis import strategies as st

from core.config.strategies import PARAMETERS, names, values
from mrs_people_loc import config as cfg
from mrs_people_loc.config import (
    GuideConfig,
    Parameter,
    PlannerConfig,
    RobotConfig,
    Section,
)
from mrs_people_loc.errors import ConfigError, PeopleLocError

NAN, INF = math.nan, math.inf

ROBOT = {parameter.name: parameter for parameter in RobotConfig.parameters()}
PLANNER = {parameter.name: parameter for parameter in PlannerConfig.parameters()}
GUIDE = {parameter.name: parameter for parameter in GuideConfig.parameters()}


def section_of(*names: str) -> type[Section]:
    """The configuration that has all of these."""
    known = ((RobotConfig, ROBOT), (PlannerConfig, PLANNER), (GuideConfig, GUIDE))
    return next(section for section, parameters in known if set(names) <= set(parameters))


def config_of(name: str, value: object) -> Section:
    """The configuration with one value changed."""
    return section_of(name).from_mapping({name: value})


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
    assert value_of(section_of(name)(), name) == value


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

RELATED: dict[str, dict[str, float]] = {  # a value at its limit needs its partner out of the way
    "disparity.min_range": {"disparity.max_range": 100.0},
    "disparity.max_range": {"disparity.min_range": 0.1},
    "disparity.left_right_difference_px": {"disparity.pre_filter_cap": 31},
    "zones.low": {"zones.high": 10.0},
    "zones.high": {"zones.low": -1.0},
    "human.min_height": {"human.max_height": 10.0},
    "human.max_height": {"human.min_height": 0.0},
    "human.min_width": {"human.max_width": 10.0},
    "human.max_width": {"human.min_width": 0.0},
    "pace.stretch": {"pace.max_stretch": 30.0},
    "pace.max_stretch": {"pace.stretch": 1.0},
    "formation.nearest": {"formation.reach": 20.0},
    "formation.reach": {"formation.nearest": 0.1},
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
        config = section_of(name).from_mapping({name: limit} | RELATED.get(name, {}))
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
        (
            {"walls.sonars": ["a", "b"], "walls.sonar_mountings": [0.0] * 5},
            "walls.sonar_mountings has 5 numbers; allowed for 2 sonars: none, or 6",
        ),
        ({"walls.sonars": ["sonar 1"]}, "walls.sonars has 'sonar 1'; allowed: names of ROS topics"),
        ({"walls.sonars": ["a", "b", "a"]}, "walls.sonars has 'a'; allowed: .*, each once"),
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
        (
            {"pace.stretch": 7.0},
            "pace.stretch is 7; allowed: at most pace.max_stretch, 6",
        ),
        (
            {"formation.reach": 1.0},
            "formation.nearest is 1; allowed: less than formation.reach, 1",
        ),
        ({"leader": "c", "robots": ["a", "b"]}, "leader has 'c'; allowed: those of `robots`, a, b"),
        ({"looks_back": ["a", "a"]}, "looks_back names a more than once"),
    ],
)
def test_inconsistent_values_are_refused(values, message):
    with pytest.raises(ConfigError, match=message):
        section_of(*values).from_mapping(values)


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


@given(st.recursive(st.dictionaries(names, values, max_size=4), lambda inner: st.dictionaries(
    names, inner | values, max_size=3
)))  # fmt: skip
def test_any_mapping_is_accepted_or_refused(mapping):
    for section in (RobotConfig, PlannerConfig, GuideConfig):
        try:
            section.from_mapping(mapping)
        except PeopleLocError as err:
            assert type(err) is ConfigError  # noqa: PT017


# --------------------------------------------------------------------- config/default.yaml ----


def test_default_yaml_has_each_parameter_with_its_description():
    path = Path(__file__).resolve().parents[3] / "config" / "default.yaml"
    lines = path.read_text().splitlines()
    listed = {}

    def read(node, prefix, section):
        for key, value in section.value:
            if isinstance(value, yaml.MappingNode):
                read(node, f"{prefix}{key.value}.", value)
            else:
                after = lines[value.end_mark.line][value.end_mark.column :]
                listed[node, prefix + key.value] = after.partition("# ")[2]

    document = yaml.compose(path.read_text())
    assert isinstance(document, yaml.MappingNode)
    for node, body in document.value:
        read(node.value, "", body.value[0][1])  # ros__parameters
    wanted = {
        (f"/**/{name}", parameter.name): parameter.doc
        for name, known in (
            ("robot_node", ROBOT),
            ("planner_node", PLANNER),
            ("guide_node", GUIDE),
        )
        for parameter in known.values()
    }
    assert listed == wanted

"""Parameter files: one ROS 2 parameter file describes a team.

For example::

    /**/robot_node:            # every robot
      ros__parameters:
        zones: {low: 0.20, high: 1.40}
    /robot_a/robot_node:       # one robot; later sections win
      ros__parameters:
        mounting: {height: 1.10}
    /**/planner_node:
      ros__parameters:
        robots: [robot_a, robot_b]
    /**/guide_node:
      ros__parameters:
        pace: {speed: 0.5}

Sections of other nodes, such as a camera's driver, are left alone; but a name that is nearly that
of one of ours (`/robot_a/robto_node`) is an error.
"""

from __future__ import annotations

import difflib
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from mrs_people_loc.config.guide import GuideConfig
from mrs_people_loc.config.parameters import Section, Value, flatten
from mrs_people_loc.config.planner import PlannerConfig
from mrs_people_loc.config.robot import RobotConfig
from mrs_people_loc.errors import ConfigError

ROBOT_NODE = "robot_node"
PLANNER_NODE = "planner_node"
GUIDE_NODE = "guide_node"
_CONFIG_TYPES: dict[str, type[Section]] = {
    ROBOT_NODE: RobotConfig,
    PLANNER_NODE: PlannerConfig,
    GUIDE_NODE: GuideConfig,
}
#: Names of our nodes in a file; a wildcard stands for one name (*) or for any number of them (**).
_NODE_KEY = re.compile(rf"(/(\w+|\*\*?))*/({'|'.join(_CONFIG_TYPES)}|\*\*?)")
#: A node whose name is as like one of ours as that is taken for a misspelling of it.
_NEARLY_OURS = 0.85
#: What PyYAML raises besides its own errors (for `!!int x`), and reading for bad UTF-8.
_YAML_SLIPS = (ValueError, LookupError, AttributeError, RecursionError)
#: Parameters that nodes have besides those of their configuration.
NODE_PARAMETERS = frozenset({"use_sim_time", "autostart", "start_type_description_service"})


@dataclass(frozen=True)
class Team:
    """A team, as parameter files describe it.

    Attributes:
        planner: The planner's configuration.
        robots: Configuration of each robot of the team, by name.
        guide: The guide's configuration.
    """

    planner: PlannerConfig
    robots: Mapping[str, RobotConfig]
    guide: GuideConfig = field(default_factory=GuideConfig)


def robots_named(*paths: str | Path) -> tuple[str, ...]:
    """The robots that parameter files name: in the planner's list, or by sections of their own.

    Args:
        paths: YAML files; later ones win.

    Raises:
        ConfigError: As `load_team`.
    """
    sections = [section for path in paths for section in _read_sections(path)]
    listed = PlannerConfig.from_mapping(_merge(sections, f"/{PLANNER_NODE}")).robots
    own = (key.removesuffix(ROBOT_NODE).strip("/") for _, key, _ in sections if ROBOT_NODE in key)
    return listed or tuple(dict.fromkeys(name for name in own if name and "*" not in name))


def load_team(
    *paths: str | Path,
    robots: tuple[str, ...] = (),
    defaults: Mapping[str, Mapping[str, Value]] | None = None,
) -> Team:
    """Reads parameter files (see the module's docstring) as the nodes would.

    Args:
        paths: YAML files; later ones win.
        robots: Names of the robots, where the files do not name them.
        defaults: By robot, parameters by dotted name that hold instead of the defaults where
            the files do not set them.

    Raises:
        ConfigError: A file cannot be read, is not a parameter file, or holds a bad value.
    """
    sections = [section for path in paths for section in _read_sections(path)]
    names = PlannerConfig.from_mapping(_merge(sections, f"/{PLANNER_NODE}")).robots or robots
    for path, key, _ in sections:
        # Also what applies to no robot of the team is looked at.
        robot = key.strip("/").removesuffix(ROBOT_NODE).strip("/")
        if key.endswith(ROBOT_NODE) and "*" not in robot and names and robot not in names:
            raise ConfigError(
                f"{path}: section {key} is of a robot that is not in the team: {', '.join(names)}"
            )
    return Team(
        planner=PlannerConfig.from_mapping(_merge(sections, f"/{PLANNER_NODE}")),
        robots={
            name: RobotConfig.from_mapping(
                {**(defaults or {}).get(name, {}), **_merge(sections, f"/{name}/{ROBOT_NODE}")}
            )
            for name in names
        },
        guide=GuideConfig.from_mapping(_merge(sections, f"/{GUIDE_NODE}")),
    )


def overridden(
    earlier: Sequence[str | Path], last: str | Path, robots: Sequence[str]
) -> tuple[str, ...]:
    """Parameters that files set and a later file changes, for the planner or any of the robots.

    Args:
        earlier: YAML files; later ones win.
        last: The file that goes before them.
        robots: Names of the robots.

    Returns:
        Dotted names, in the order of `earlier`, each once.

    Raises:
        ConfigError: A file cannot be read or is not a parameter file.
    """
    before = [section for path in earlier for section in _read_sections(path)]
    after = _read_sections(last)
    found = []
    for node in (f"/{PLANNER_NODE}", *(f"/{robot}/{ROBOT_NODE}" for robot in robots)):
        new = _merge(after, node)
        old = _merge(before, node)
        found += [name for name, value in old.items() if new.get(name, value) != value]
    return tuple(dict.fromkeys(found))


def has_parameters(path: str | Path) -> bool:
    """Whether a YAML file has parameters of our nodes; a scene or a tour has none.

    Raises:
        ConfigError: It cannot be read, or holds a bad value.
    """
    return bool(_read_sections(path))


class _Loader(yaml.SafeLoader):
    """YAML without aliases, which ROS 2 refuses in parameter files, too.

    A few lines of them can stand for more than any memory holds.
    """

    def compose_node(self, parent: Any, index: Any) -> Any:
        """The next node, unless it is an alias."""
        if self.check_event(yaml.AliasEvent):
            event = self.peek_event()  # type: ignore[no-untyped-call]
            raise yaml.composer.ComposerError(
                None, None, f"found an alias, *{event.anchor}; wanted: none", event.start_mark
            )
        return super().compose_node(parent, index)


def load_yaml(path: Path) -> Any:
    """What a YAML file holds.

    Raises:
        ConfigError: It cannot be read, or has aliases.
    """
    try:
        with path.open(encoding="utf-8") as stream:  # whose name PyYAML gives with a line's number
            return yaml.load(stream, _Loader)
    except FileNotFoundError as err:
        raise ConfigError(f"{path}: there is no such file") from err
    except (OSError, yaml.YAMLError, *_YAML_SLIPS) as err:
        raise ConfigError(f"{path}: cannot be read as a YAML file: {err}") from err


def _read_sections(path: str | Path) -> list[tuple[Path, str, dict[str, Any]]]:
    """Sections of a file that are ours: file, key with a leading slash, flat parameters; checked.

    `~` in the path is the home folder: shells leave it in `team:=~/team.yaml`.
    """
    path = Path(os.path.expanduser(path))
    document = load_yaml(path)
    if not isinstance(document, Mapping):
        raise ConfigError(f"{path}: is not a ROS 2 parameter file (a mapping of node names)")
    sections = []
    for key, body in _sections(document):
        node = key.rpartition("/")[2]
        config_type = _CONFIG_TYPES.get(node)
        if not _NODE_KEY.fullmatch(key):
            alike = difflib.get_close_matches(node, _CONFIG_TYPES, 1, _NEARLY_OURS)
            if not alike:
                continue  # of another node
            raise ConfigError(
                f"{path}: section {key} names no node of ours; did you mean .../{alike[0]}? "
                "(sections of other nodes are left alone, if their names are less like ours)"
            )
        if not isinstance(body, Mapping) or set(body) != {"ros__parameters"}:
            raise ConfigError(f"{path}: section {key} must hold `ros__parameters:` and only that")
        values = body["ros__parameters"]
        if not isinstance(values, Mapping):
            raise ConfigError(f"{path}: section {key}: ros__parameters must be a mapping")
        flat = {k: v for k, v in flatten(values).items() if k not in NODE_PARAMETERS}
        if config_type is not None:
            try:
                config_type.from_mapping(flat)
            except ConfigError as err:
                raise ConfigError(f"{path}: section {key}: {err}") from err
        sections.append((path, key, flat))
    return sections


def _sections(document: Mapping[Any, Any], above: str = "") -> Iterator[tuple[str, Any]]:
    """Keys and bodies of a parameter file; as in ROS 2, namespaces may hold what is in them."""
    for name, body in document.items():
        key = f"{above}/{str(name).lstrip('/')}"
        node = key.rpartition("/")[2]
        ours = difflib.get_close_matches(node, _CONFIG_TYPES, 1, _NEARLY_OURS)
        inside = isinstance(body, Mapping) and body and "ros__parameters" not in body
        if inside and not ours and all(isinstance(one, Mapping) for one in body.values()):
            yield from _sections(body, key)
        else:
            yield key, body


def _merge(sections: list[tuple[Path, str, dict[str, Any]]], node: str) -> dict[str, Any]:
    """Joins the sections that match a node's full name, later ones over earlier, as rcl does."""
    merged: dict[str, Any] = {}
    for _, key, values in sections:
        pattern = re.escape(key).replace(r"/\*\*", r"(/\w+)*").replace(r"/\*", r"/\w+")
        if re.fullmatch(pattern, node):
            merged.update(values)
    return merged

"""What the launch files share: their arguments, and the nodes that these start."""

from __future__ import annotations

import difflib
import os
import sys
from pathlib import Path
from typing import Any

from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from mrs_people_loc.errors import ConfigError
from mrs_ros.discovery import discovery_environment
from mrs_ros.network import given_domain
from mrs_ros.shipped import shipped_file

#: Arguments of `ros2 launch` itself.
_OF_LAUNCH = ("launch-prefix", "launch-prefix-filter", "sigterm_timeout", "sigkill_timeout")


def arguments() -> list[DeclareLaunchArgument]:
    """The team's file, how the nodes start, the time, and the network."""
    example = shipped_file("config", "team.yaml") or "team.yaml of mrs_people_config"
    return [
        DeclareLaunchArgument(
            "team",
            default_value="",
            description=f"required; parameter file of the team; an example to copy: {example}",
        ),
        DeclareLaunchArgument(
            "autostart",
            default_value="",
            choices=["", "true", "false"],
            description="false: the nodes wait to be configured and activated; true: they do so "
            "themselves; not given: as the team's file says, or else true",
        ),
        DeclareLaunchArgument(
            "use_sim_time",
            default_value="",
            choices=["", "true", "false"],
            description="true: take the time from /clock; not given: as the team's file says, or "
            "else false",
        ),
        DeclareLaunchArgument(
            "discovery_server",
            default_value="",
            description="HOST[:PORT]: find each other by the discovery server there",
        ),
        DeclareLaunchArgument(
            "peers",
            default_value="",
            description="HOST,...: look for nodes on these hosts, too; by unicast",
        ),
    ]


def team_file(context: Any, *, further: tuple[str, ...] = ()) -> str:
    """The team's file that was given; `~` in it is the home folder.

    Args:
        context: The launch's context.
        further: Names of arguments of the launch file besides `arguments`.

    Raises:
        ConfigError: An argument was given that the launch file does not have, or ROS_DOMAIN_ID is
            no domain.
    """
    given_domain()
    known = [*further, *(argument.name for argument in arguments())]
    given = [text.partition(":=")[0] for text in context.argv] if _is_ours(context) else []
    for name in given:
        if name not in known and name not in _OF_LAUNCH:
            alike = difflib.get_close_matches(name, known, 1)
            hint = f"did you mean {alike[0]}?" if alike else f"allowed: {', '.join(known)}"
            raise ConfigError(f"unknown launch argument {name}; {hint}")
    return os.path.expanduser(required(context, "team", "FILE"))


def _is_ours(context: Any) -> bool:
    """Whether `ros2 launch` was called with this file, and not with one that includes it.

    The arguments on the command line would be those of the including file.
    """
    own = Path(context.locals.current_launch_file_path)
    words = zip(sys.argv, sys.argv[1:], strict=False)
    return any(
        (word == own.name and before == own.parents[1].name)
        or (Path(word).exists() and own.samefile(word))
        for before, word in words
    )


def required(context: Any, name: str, what: str) -> str:
    """The value of an argument that has no default: launch itself would name no misspelt ones.

    Raises:
        ConfigError: It was not given.
    """
    if given := value(context, name):
        return given
    (about,) = [str(one.description) for one in arguments() if one.name == name] or [""]
    raise ConfigError(f"missing required argument {name}:={what}; {about}".rstrip("; "))


def value(context: Any, name: str) -> str:
    """The value of an argument in a launch's context."""
    return str(LaunchConfiguration(name).perform(context))


def node(
    context: Any, package: str, namespace: str, files: list[Any], executable: str = "", **how: Any
) -> Node:
    """A node, with the given arguments.

    Args:
        context: The launch's context.
        package: `robot_node` or `planner_node`.
        namespace: Its namespace.
        files: Its parameter files.
        executable: In the package; empty: the one of its name.
        how: Further arguments of launch_ros' Node.

    Raises:
        ConfigError: Both `discovery_server` and `peers` are given, or one of them is no host.
    """
    given = {name: value(context, name) for name in ("autostart", "use_sim_time")}
    parameters = {name: text == "true" for name, text in given.items() if text}
    return Node(
        package=package,
        executable=executable or package,
        namespace=namespace,
        parameters=[*files, *([parameters] if parameters else [])],
        additional_env=discovery_environment(
            value(context, "discovery_server"), value(context, "peers")
        ),
        output="screen",
        **how,
    )

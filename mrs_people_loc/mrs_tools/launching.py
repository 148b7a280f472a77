"""What the launch files have in common: their arguments, and what becomes of them."""

from __future__ import annotations

from typing import Any

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from mrs_tools.network import discovery_environment


def arguments() -> list[DeclareLaunchArgument]:
    """The team's file, the time, and the network."""
    example = get_package_share_directory("mrs_people_loc") + "/config/team.yaml"
    return [
        DeclareLaunchArgument(
            "team", default_value=example, description="parameter file of the team"
        ),
        DeclareLaunchArgument(
            "use_sim_time",
            default_value="false",
            choices=["true", "false"],
            description="true: take the time from /clock; false: as the team's file says",
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


def value(context: Any, name: str) -> str:
    """What was given for an argument, in a launch's context."""
    return str(LaunchConfiguration(name).perform(context))


def node(context: Any, package: str, namespace: str, files: list[Any]) -> Node:
    """One of our nodes, as the arguments say.

    Args:
        context: The launch's context.
        package: `robot_node` or `planner_node`, which is the executable's name, too.
        namespace: Its namespace.
        files: Its parameter files.

    Raises:
        ConfigError: Both `discovery_server` and `peers` are given, or one of them is no host.
    """
    simulated = value(context, "use_sim_time").lower() == "true"
    return Node(
        package=package,
        executable=package,
        namespace=namespace,
        parameters=[*files, *([{"use_sim_time": True}] if simulated else [])],
        additional_env=discovery_environment(
            value(context, "discovery_server"), value(context, "peers")
        ),
        output="screen",
    )

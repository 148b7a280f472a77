"""Starts one robot: ros2 launch robot_node robot.launch.py robot:=NAME team:=FILE."""

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from mrs_people_loc.config import load_team, robots_named
from mrs_people_loc.errors import ConfigError
from mrs_tools.network import discovery_environment


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    robot = LaunchConfiguration("robot").perform(context).strip("/")
    team = LaunchConfiguration("team").perform(context)
    # Left to itself, launch warns of a file that is not there and starts the node without it.
    robots = load_team(team, robots=(*robots_named(team), robot)).robots
    if robot not in robots:
        raise ConfigError(f"{robot} is no robot of {team}, which names {', '.join(robots)}")
    sim_time = LaunchConfiguration("use_sim_time").perform(context).lower() == "true"
    env = discovery_environment(
        LaunchConfiguration("discovery_server").perform(context),
        LaunchConfiguration("peers").perform(context),
    )
    return [
        Node(
            package="robot_node",
            executable="robot_node",
            namespace=robot,
            parameters=[team, *([{"use_sim_time": True}] if sim_time else [])],
            additional_env=env,
            output="screen",
        )
    ]


def generate_launch_description() -> LaunchDescription:
    example = get_package_share_directory("mrs_people_loc") + "/config/team.yaml"
    return LaunchDescription(
        [
            DeclareLaunchArgument("robot", description="the robot's name: its namespace"),
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
            OpaqueFunction(function=start),
        ]
    )

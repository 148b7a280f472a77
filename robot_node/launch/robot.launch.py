"""Starts one robot: ros2 launch robot_node robot.launch.py robot:=NAME team:=FILE."""

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from mrs_people_loc.config import load_team, robots_named
from mrs_people_loc.errors import ConfigError


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    robot = LaunchConfiguration("robot").perform(context).strip("/")
    team = LaunchConfiguration("team").perform(context)
    # Left to itself, launch warns of a file that is not there and starts the node without it.
    robots = load_team(team, robots=(*robots_named(team), robot)).robots
    if robot not in robots:
        raise ConfigError(f"{robot} is no robot of {team}, which names {', '.join(robots)}")
    sim_time = LaunchConfiguration("use_sim_time").perform(context).lower() == "true"
    return [
        Node(
            package="robot_node",
            executable="robot_node",
            namespace=robot,
            parameters=[team, *([{"use_sim_time": True}] if sim_time else [])],
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
            OpaqueFunction(function=start),
        ]
    )

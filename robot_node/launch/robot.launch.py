"""Starts one robot: ros2 launch robot_node robot.launch.py robot:=NAME team:=FILE."""

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchDescription


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
                description="take the time from /clock",
            ),
            Node(
                package="robot_node",
                executable="robot_node",
                namespace=LaunchConfiguration("robot"),
                parameters=[
                    LaunchConfiguration("team"),
                    {"use_sim_time": LaunchConfiguration("use_sim_time")},
                ],
                output="screen",
            ),
        ]
    )

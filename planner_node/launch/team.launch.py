"""Starts every robot of a team and the planner: ros2 launch planner_node team.launch.py team:=FILE.

The same processes as `mrs up FILE`. With a computer on each robot, start there
`ros2 launch robot_node robot.launch.py robot:=NAME team:=FILE`, and the planner on its own with
`ros2 run planner_node planner_node --ros-args --params-file FILE`.
"""

from ament_index_python.packages import get_package_share_directory
from launch.actions import DeclareLaunchArgument, OpaqueFunction
from launch.substitutions import LaunchConfiguration
from launch_ros.actions import Node

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from mrs_tools.network import discovery_environment
from mrs_tools.team import team_processes


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    team = LaunchConfiguration("team").perform(context)
    sim_time = LaunchConfiguration("use_sim_time").perform(context).lower() == "true"
    env = discovery_environment(
        LaunchConfiguration("discovery_server").perform(context),
        LaunchConfiguration("peers").perform(context),
    )
    return [
        Node(
            package=process.package,
            executable=process.package,
            namespace=process.namespace,
            parameters=[*process.files, *([{"use_sim_time": True}] if sim_time else [])],
            additional_env=env,
            output="screen",
        )
        for process in team_processes([team], sim_time=sim_time)
    ]


def generate_launch_description() -> LaunchDescription:
    example = get_package_share_directory("mrs_people_loc") + "/config/team.yaml"
    return LaunchDescription(
        [
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

"""Starts every robot of a team and the planner: ros2 launch planner_node team.launch.py team:=FILE.

The same processes as `mrs up FILE`; with `guide:=true` guide_node, too, as `mrs up FILE --guide`.
With a computer on each robot, start there `ros2 launch robot_node robot.launch.py robot:=NAME
team:=FILE`, and the planner on its own with `ros2 run planner_node planner_node --ros-args
--params-file FILE`; likewise `ros2 run planner_node guide_node`.
"""

from launch.actions import DeclareLaunchArgument, OpaqueFunction

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from mrs_ros.launch_files import arguments, node, team_file, value
from mrs_ros.processes import team_processes


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    file = team_file(context, further=("guide",))
    return [
        node(context, one.package, one.namespace, list(one.files), one.executable)
        for one in team_processes([file], guide=value(context, "guide") == "true")
    ]


def generate_launch_description() -> LaunchDescription:
    guide = DeclareLaunchArgument(
        "guide",
        default_value="false",
        choices=["true", "false"],
        description="true: start guide_node, too, which guides groups along tours",
    )
    return LaunchDescription([*arguments(), guide, OpaqueFunction(function=start)])

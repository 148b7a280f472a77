"""Starts every robot of a team and the planner: ros2 launch planner_node team.launch.py team:=FILE.

The same processes as `mrs up FILE`. With a computer on each robot, start there
`ros2 launch robot_node robot.launch.py robot:=NAME team:=FILE`, and the planner on its own with
`ros2 run planner_node planner_node --ros-args --params-file FILE`.
"""

from launch.actions import OpaqueFunction

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from mrs_ros.launch_files import arguments, node, team_file
from mrs_ros.processes import team_processes


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    return [
        node(context, process.package, process.namespace, list(process.files))
        for process in team_processes([team_file(context)])
    ]


def generate_launch_description() -> LaunchDescription:
    return LaunchDescription([*arguments(), OpaqueFunction(function=start)])

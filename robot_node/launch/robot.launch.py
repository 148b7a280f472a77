"""Starts one robot: ros2 launch robot_node robot.launch.py robot:=NAME team:=FILE."""

from launch.actions import DeclareLaunchArgument, OpaqueFunction

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from mrs_people_loc.config import load_team, robots_named
from mrs_people_loc.errors import ConfigError
from mrs_ros.launch_files import arguments, node, required, team_file


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    team = team_file(context, further=("robot",))
    robot = required(context, "robot", "NAME").strip("/")
    # Left to itself, launch warns of a file that is not there and starts the node without it.
    robots = load_team(team, robots=(*robots_named(team), robot)).robots
    if robot not in robots:
        raise ConfigError(f"{robot} is no robot of {team}, which names {', '.join(robots)}")
    return [node(context, "robot_node", robot, [team])]


def generate_launch_description() -> LaunchDescription:
    robot = DeclareLaunchArgument(
        "robot", default_value="", description="required: the robot's name, its namespace"
    )
    return LaunchDescription([robot, *arguments(), OpaqueFunction(function=start)])

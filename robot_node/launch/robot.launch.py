"""Starts one robot: ros2 launch robot_node robot.launch.py robot:=NAME team:=FILE."""

from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from launch.actions import DeclareLaunchArgument, OpaqueFunction

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from mrs_people_loc.config import load_team, robots_named
from mrs_people_loc.errors import ConfigError
from mrs_ros.launch_files import arguments, node, required, team_file
from mrs_ros.shipped import shipped_file


def start(context: LaunchContext) -> list[LaunchDescriptionEntity]:
    team = team_file(context, further=("robot",))
    robot = required(context, "robot", "NAME").strip("/")
    # Left to itself, launch warns of a file that is not there and starts the node without it.
    robots = load_team(team, robots=(*robots_named(team), robot)).robots
    if robot not in robots:
        raise ConfigError(f"{robot} is no robot of {team}, which names {', '.join(robots)}")
    nav2 = nav2_monitor(context, robot)
    own = [team, {"collision_monitor.enabled": False}] if nav2 else [team]
    return [node(context, "robot_node", robot, own), *nav2]


def nav2_monitor(context: LaunchContext, robot: str) -> list[LaunchDescriptionEntity]:
    """Nav2's Collision Monitor, where it is installed, in place of robot_node's."""
    try:
        get_package_prefix("nav2_collision_monitor")
    except PackageNotFoundError:
        return []
    file = shipped_file("config", "nav2", "collision_monitor.yaml")
    frames = {"base_frame_id": f"{robot}/base_link", "odom_frame_id": f"{robot}/odom"}
    manager = "lifecycle_manager"
    return [
        node(context, "nav2_collision_monitor", robot, [file, frames], "collision_monitor"),
        node(
            context, f"nav2_{manager}", robot, [file], manager, name=f"{manager}_collision_monitor"
        ),
    ]


def generate_launch_description() -> LaunchDescription:
    robot = DeclareLaunchArgument(
        "robot", default_value="", description="required: the robot's name, its namespace"
    )
    return LaunchDescription([robot, *arguments(), OpaqueFunction(function=start)])

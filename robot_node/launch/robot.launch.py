"""Starts one robot: ros2 launch robot_node robot.launch.py robot:=NAME team:=FILE."""

from ament_index_python.packages import PackageNotFoundError, get_package_prefix
from launch.actions import DeclareLaunchArgument, LogInfo, OpaqueFunction

from launch import LaunchContext, LaunchDescription, LaunchDescriptionEntity
from mrs_people_loc.config import CollisionMonitoring, load_team, robots_named
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
    nav2 = nav2_monitor(context, robot, robots[robot].collision_monitor)
    own = [team, {"collision_monitor.enabled": False}] if nav2 else [team]
    return [node(context, "robot_node", robot, own), *nav2]


def nav2_monitor(
    context: LaunchContext, robot: str, config: CollisionMonitoring
) -> list[LaunchDescriptionEntity]:
    """Nav2's Collision Monitor, where it is installed, in place of robot_node's."""
    try:
        get_package_prefix("nav2_collision_monitor")
    except PackageNotFoundError:
        return []
    file = shipped_file("config", "nav2", "collision_monitor.yaml")
    own = {
        "base_frame_id": f"{robot}/base_link",
        "odom_frame_id": f"{robot}/odom",
        "enable_stamped_cmd_vel": config.stamped,
        "Approach.radius": config.radius + config.stop_distance,
        "Approach.time_before_collision": config.time_before_collision,
    }
    manager = "lifecycle_manager"
    return [
        LogInfo(msg=f"{robot}: Nav2's collision monitor takes the place of robot_node's"),
        node(context, "nav2_collision_monitor", robot, [file, own], "collision_monitor"),
        node(
            context, f"nav2_{manager}", robot, [file], manager, name=f"{manager}_collision_monitor"
        ),
    ]


def generate_launch_description() -> LaunchDescription:
    robot = DeclareLaunchArgument(
        "robot", default_value="", description="required: the robot's name, its namespace"
    )
    return LaunchDescription([robot, *arguments(), OpaqueFunction(function=start)])

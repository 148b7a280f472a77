"""A process that sends guide_node what is too large, too old or too new, see `KINDS`."""

from __future__ import annotations

import array
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import rclpy
from geometry_msgs.msg import PoseWithCovarianceStamped
from mrs_people_msgs.action import GuideTour
from mrs_people_msgs.msg import People
from nav_msgs.msg import OccupancyGrid, Path
from rclpy.action import ActionClient
from rclpy.qos import QoSProfile

from mrs_ros.qos import MAP, POSES
from ros.guide_peer import goal_of, path_of, people_of
from ros.planner_peer import pose_of

#: For so long, so often [s].
LASTS_S, PERIOD_S = 0.8, 0.1
FEW = QoSProfile(depth=10)
WAY = [(0.1 * k, 0.0) for k in range(9000)]
LONG = "x" * 30_000_000
KINDS = (
    "many people",
    "too many people",
    "people of the future",
    "long path",
    "large map",
    "too large map",
    "map with a long frame",
    "long string",
    "goals",
    "long goals",
)


def people(count: int, ahead_s: float = 0.0) -> People:
    """People in a crowd round the group, of now."""
    rng = np.random.default_rng(count)
    places = rng.uniform((-8.0, -4.0), (0.0, 4.0), (count, 2))
    now_ns = time.time_ns() + round(ahead_s * 1e9)
    return people_of(now_ns, places, np.zeros((count, 2)), ["robot_a", "robot_b"])


def map_of(size: int, frame_id: str = "map") -> OccupancyGrid:
    """A free map, with one wall beside the tour, another one each time."""
    grid = OccupancyGrid()
    grid.header.frame_id = frame_id
    grid.info.resolution = 0.05
    grid.info.width = grid.info.height = size
    grid.info.origin.position.x = grid.info.origin.position.y = -0.5 * size * 0.05
    grid.info.origin.orientation.w = 1.0
    data = np.zeros((size, size), np.int8)
    data[size // 2 + 100 + time.time_ns() % 50] = 100
    grid.data = array.array("b", data.tobytes())
    return grid


def goals(node: Any, kind: str) -> tuple[Callable[[], object], Callable[[], object]]:
    """What sends goals, and whether somebody hears them."""
    client = ActionClient(node, GuideTour, "guide_tour")
    count, points = (50, 2) if kind == "goals" else (1, 10_000)
    goal = goal_of(*((3.0 * k / points, 0.0) for k in range(points)))

    def send() -> None:
        for _ in range(count):
            client.send_goal_async(goal)

    return send, client.server_is_ready


def messages(node: Any, kind: str) -> tuple[Callable[[], object], Callable[[], object]]:
    """What sends messages, and whether somebody hears them."""
    made: dict[str, tuple[Any, str, QoSProfile, Callable[[], Any]]] = {
        "many people": (People, "tracked_people", FEW, lambda: people(400)),
        "too many people": (People, "tracked_people", FEW, lambda: people(4000)),
        "people of the future": (People, "tracked_people", FEW, lambda: people(3, ahead_s=5.0)),
        "long path": (Path, "tour_path", FEW, lambda: path_of(*WAY)),
        "large map": (OccupancyGrid, "map", MAP, lambda: map_of(4000)),
        "too large map": (OccupancyGrid, "map", MAP, lambda: map_of(6000)),
        "map with a long frame": (OccupancyGrid, "map", MAP, lambda: map_of(400, LONG)),
        "long string": (
            PoseWithCovarianceStamped,
            "robot_a/pose",
            POSES,
            lambda: pose_of(time.time_ns(), 0.0, 0.0, 0.0, frame_id="x" * 3_000_000),
        ),
    }
    message_type, topic, qos, make = made[kind]
    publisher = node.create_publisher(message_type, topic, qos)
    return lambda: publisher.publish(make()), publisher.get_subscription_count


def main(kind: str) -> None:
    """Sends one kind for some seconds after each line of input, and says then that it is done."""
    rclpy.init()
    node = rclpy.create_node("hostile")
    send, ready = (goals if "goals" in kind else messages)(node, kind)
    while not ready():
        rclpy.spin_once(node, timeout_sec=0.05)
    for _ in sys.stdin:
        end_s = time.monotonic() + LASTS_S
        while time.monotonic() < end_s:
            send()
            rclpy.spin_once(node, timeout_sec=PERIOD_S)
        print("done", flush=True)
    node.destroy_node()
    rclpy.shutdown()


if __name__ == "__main__":
    main(sys.argv[1])

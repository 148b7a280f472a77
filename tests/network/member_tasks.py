"""What runs on the hosts of `test_members_only.py`: python member_tasks.py TASK ARGUMENT...

Each prints lines of JSON as it goes, and ends at SIGTERM.
"""

from __future__ import annotations

import dataclasses
import json
import signal
import socket
import ssl
import sys
import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

#: Takes whatever certificate it is shown.
CONTEXT = ssl.create_default_context()
CONTEXT.check_hostname, CONTEXT.verify_mode = False, ssl.CERT_NONE
ROOT = Path(__file__).resolve().parents[2]
BAG = ROOT / "bags" / "paper_formation"
TEAM = ROOT / "config" / "team.yaml"


def say(**what: object) -> None:
    print(json.dumps(what), flush=True)


def feed(robot: str, frame_hz: str) -> None:
    """A robot's cameras and base: a bag's images and odometry, with the stamps of now."""
    import rclpy

    from mrs_people_loc.config import load_team
    from mrs_studies.bench.live import Feeder, read_recorded

    team = load_team(TEAM)
    one = dataclasses.replace(team, robots={robot: team.robots[robot]})
    rclpy.init()
    node = rclpy.create_node(f"base_of_{robot}")
    feeder = Feeder(node, read_recorded(BAG, one), float(frame_hz), 20.0)
    feeder.frames_on.set()
    say(ready=True)
    feeder.run()


def listen() -> None:
    """What the planner says: whom it used, how many people, how old the newest image was."""
    import rclpy
    from mrs_people_msgs.msg import People

    from mrs_people_loc.messages import stamp_ns_of

    rclpy.init()
    node = rclpy.create_node("listener")

    def heard(message: Any) -> None:
        stamps = {scan.robot: stamp_ns_of(scan.stamp) for scan in message.scans}
        age_ms = (time.time_ns() - max(stamps.values())) / 1e6
        say(robots=sorted(stamps), people=len(message.persons), age_ms=age_ms, at=time.time())

    node.create_subscription(People, "tracked_people", heard, 10)
    rclpy.spin(node)


def spy(name: str) -> None:
    """Hears what it can of a team, and says that it is a robot of that name."""
    import rclpy
    from diagnostic_msgs.msg import DiagnosticArray
    from geometry_msgs.msg import PoseWithCovarianceStamped
    from mrs_people_msgs.msg import People
    from rclpy.qos import qos_profile_sensor_data
    from sensor_msgs.msg import PointCloud2

    from mrs_people_loc.scan import Cells, Scan
    from mrs_people_loc.team.poses import Pose
    from mrs_ros import convert

    rclpy.init()
    node = rclpy.create_node(f"spy_{name}")
    heard: Counter[str] = Counter()

    def hear(topic: str, message: Any) -> None:
        heard[topic] += 1

    for kind, topic in (
        (People, "tracked_people"),
        (PointCloud2, "robot_a/points"),
        (PoseWithCovarianceStamped, "robot_a/pose"),
        (DiagnosticArray, "/diagnostics"),
    ):
        node.create_subscription(kind, topic, partial(hear, topic), qos_profile_sensor_data)
    points = node.create_publisher(PointCloud2, f"{name}/points", qos_profile_sensor_data)
    pose = node.create_publisher(PoseWithCovarianceStamped, f"{name}/pose", qos_profile_sensor_data)

    def send() -> None:
        now_ns = node.get_clock().now().nanoseconds
        pose.publish(convert.pose_stamped(Pose(now_ns, 0.0, 0.0, 0.0), "map"))
        points.publish(convert.points(Scan(name, now_ns, Cells.empty()), f"{name}/base_link"))

    def report() -> None:
        nodes = sorted(set(node.get_node_names()) - {node.get_name()})
        listeners = points.get_subscription_count()
        say(heard=dict(heard), nodes=nodes, listeners=listeners, at=time.time())

    node.create_timer(0.1, send)
    node.create_timer(0.5, report)
    rclpy.spin(node)


def sniff() -> None:
    """Every kind of packet that passes the interface, when it is first seen."""
    tap = socket.socket(socket.AF_PACKET, socket.SOCK_RAW, socket.ntohs(3))
    tap.bind(("eth0", 0))
    seen = set()
    say(ready=True)
    while True:
        data = tap.recv(65536)
        if data[12:14] != b"\x08\x00":
            continue  # no IPv4: ARP, and IPv6's neighbours
        source, target = socket.inet_ntoa(data[26:30]), socket.inet_ntoa(data[30:34])
        at = 14 + 4 * (data[14] & 15)
        protocol, ports = data[23], sorted((data[at : at + 2], data[at + 2 : at + 4]))
        plain = any(word in data for word in (b"RTPS", b"RTCP", b"robot_", b"people"))
        numbers = [int.from_bytes(p, "big") for p in ports] if protocol in (6, 17) else []
        kind = (source, target, protocol, min(numbers, default=0), plain)
        if kind not in seen:
            seen.add(kind)
            say(source=source, target=target, protocol=protocol, ports=numbers, plain=plain)


def knock(*addresses: str) -> None:
    """Says to the tunnel's port what Fast DDS' TCP transport and a TLS client would say."""
    for address in addresses:
        for how in ("RTPS over TCP", "TLS"):
            got = 0
            try:
                with socket.create_connection((address, 5101), timeout=5.0) as link:
                    if how == "TLS":
                        with CONTEXT.wrap_socket(link) as secured:
                            got += len(secured.recv(65536))
                    link.sendall(b"RTCP" + bytes(40) + b"RTPS" + bytes(100))
                    got += len(link.recv(65536))
            except OSError as err:
                say(address=address, how=how, got=got, end=type(err).__name__)
            else:
                say(address=address, how=how, got=got, end="closed")
    say(done=True)
    signal.pause()


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, signal.SIG_DFL)
    tasks: dict[str, Callable[..., None]] = {
        "feed": feed, "listen": listen, "spy": spy, "sniff": sniff, "knock": knock,
    }  # fmt: skip
    tasks[sys.argv[1]](*sys.argv[2:])

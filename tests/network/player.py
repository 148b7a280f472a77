"""Run on a host: a robot that costs next to nothing, its scans and poses from a file.

usage: player.py FILE ROBOT FRAMES_PER_SECOND POSES_PER_SECOND

The file is what `team.record_scans` writes.
"""

import itertools
import pickle
import struct
import sys
import time
from pathlib import Path

from geometry_msgs.msg import PoseWithCovarianceStamped
from rclpy.qos import QoSProfile, ReliabilityPolicy, qos_profile_sensor_data
from sensor_msgs.msg import PointCloud2

from mrs_ros.network import use_shipped_profile
from mrs_tools.signals import stop_on_signals
from mrs_tools.tool_node import node


def stamped(message: bytes) -> bytes:
    """A serialized message with the stamp of now: its header comes first."""
    return message[:4] + struct.pack("<iI", *divmod(time.time_ns(), 10**9)) + message[12:]


def main() -> None:
    file, robot, frame_hz, pose_hz = sys.argv[1:]
    scans, pose = pickle.loads(Path(file).read_bytes())[robot]
    every = max(1, round(float(pose_hz) / float(frame_hz)))
    use_shipped_profile()
    with stop_on_signals() as stop, node("player") as made:
        # As robot_node offers them.
        pose_qos = QoSProfile(depth=100, reliability=ReliabilityPolicy.BEST_EFFORT)
        poses = made.create_publisher(PoseWithCovarianceStamped, f"/{robot}/pose", pose_qos)
        points = made.create_publisher(PointCloud2, f"/{robot}/points", qos_profile_sensor_data)
        began = time.monotonic()
        for n in itertools.count():
            if n % every == 0:
                points.publish(stamped(scans[n // every % len(scans)]))
            poses.publish(stamped(pose))
            if stop.wait(max(0.0, began + n / float(pose_hz) - time.monotonic())):
                return


if __name__ == "__main__":
    main()

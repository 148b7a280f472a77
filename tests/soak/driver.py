"""Sends a team's images and odometry as drivers do: it knows nothing of our profile.

usage: driver.py BAG TEAM.yaml FRAMES_PER_SECOND POSES_PER_SECOND TIMES_AS_LARGE [ROBOT...]
"""

from __future__ import annotations

import dataclasses
import sys
import threading
from pathlib import Path

import cv2
import numpy as np
import rclpy
from rclpy.serialization import deserialize_message, serialize_message
from sensor_msgs.msg import CameraInfo, Image

from mrs_people_loc.config import load_team
from mrs_studies.bench.live import Feeder, Recorded, read_recorded
from mrs_tools.signals import stop_on_signals


def enlarged(one: Recorded, times: int) -> Recorded:
    """The same views with so many times the pixels each way."""
    frames = [
        {t: _enlarged(one.types[t], data, times) for t, data in f.items()} for f in one.frames
    ]
    return dataclasses.replace(one, frames=frames)


def _enlarged(kind: str, data: bytes, times: int) -> bytes:
    if kind.endswith("CameraInfo"):
        info = deserialize_message(data, CameraInfo)
        info.width, info.height = info.width * times, info.height * times
        for matrix, in_pixels in ((info.k, (0, 2, 4, 5)), (info.p, (0, 2, 3, 5, 6, 7))):
            for index in in_pixels:
                matrix[index] *= times
        return serialize_message(info)
    image = deserialize_message(data, Image)
    pixels = np.frombuffer(bytes(image.data), np.uint8).reshape(image.height, image.step)
    large = cv2.resize(pixels, None, fx=times, fy=times, interpolation=cv2.INTER_CUBIC)
    image.height, image.width = large.shape
    image.step, image.data = image.width, large.tobytes()
    return serialize_message(image)


def main() -> None:
    bag, team, frame_hz, pose_hz, times, *robots = sys.argv[1:]
    recorded = read_recorded(Path(bag), load_team(team))
    sent = {
        r: enlarged(one, int(times)) for r, one in recorded.items() if r in (robots or recorded)
    }
    with stop_on_signals() as stop:
        rclpy.init(args=[], signal_handler_options=rclpy.SignalHandlerOptions.NO)
        node = rclpy.create_node("driver")
        feeder = Feeder(node, sent, float(frame_hz), float(pose_hz))
        feeder.frames_on.set()
        feeder.start()
        threading.Event.wait(stop)
        feeder.stop()
        rclpy.shutdown()


if __name__ == "__main__":
    main()

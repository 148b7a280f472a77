"""Run on a host: the camera and the base of one robot, from a bag, with stamps of now.

usage: camera.py BAG TEAM.yaml ROBOT FRAMES_PER_SECOND POSES_PER_SECOND
"""

import sys
import threading
from pathlib import Path

from mrs_people_loc.config import load_team
from mrs_studies.bench.live import Feeder, read_recorded
from mrs_tools.signals import stop_on_signals
from mrs_tools.tool_node import node


def main() -> None:
    bag, team, robot, frame_hz, pose_hz = sys.argv[1:]
    recorded = read_recorded(Path(bag), load_team(team))[robot]
    with stop_on_signals() as stop, node("camera") as made:
        feeder = Feeder(made, {robot: recorded}, float(frame_hz), float(pose_hz))
        feeder.frames_on.set()
        feeder.start()
        threading.Event.wait(stop)
        feeder.stop()


if __name__ == "__main__":
    main()

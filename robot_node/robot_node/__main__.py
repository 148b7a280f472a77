"""Entry point of `robot_node`."""

import signal
import sys

USAGE = """
usage: robot_node [--ros-args -r __ns:=/ROBOT --params-file TEAM.yaml -p NAME:=VALUE ...]

One robot of a team: stereo images in, occupied cells (`points`) and `pose` out. The namespace is
the robot's name. Parameters: see config/default.yaml, or `ros2 param describe`.
"""


def main() -> None:
    """Starts the node; the exit code is 0 after Ctrl-C or SIGTERM, 2 for bad configuration."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C while the libraries load: no traceback
    from mrs_ros.running import run
    from robot_node.node import RobotNode

    sys.exit(run(RobotNode, USAGE))


if __name__ == "__main__":
    main()

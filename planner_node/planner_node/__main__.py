"""Entry point of `planner_node`."""

import signal
import sys

USAGE = """
usage: planner_node [--ros-args --params-file TEAM.yaml -p NAME:=VALUE ...]

The planner of a team: every robot's `points` and `pose` in, `tracked_people` on the common map out.
The parameter `robots` names the robots; left empty, they are discovered as they appear. Parameters:
see config/default.yaml, or `ros2 param describe`.
"""


def main() -> None:
    """Starts the node; the exit code is 0 after Ctrl-C or SIGTERM, 2 for bad configuration."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C while the libraries load: no traceback
    from mrs_ros.running import run
    from planner_node.node import PlannerNode

    sys.exit(run(PlannerNode, USAGE))


if __name__ == "__main__":
    main()

"""Entry point of `guide_node`."""

import signal
import sys

USAGE = """
usage: guide_node [--ros-args --params-file TEAM.yaml -p NAME:=VALUE ...]

Guides a group along a tour: `tracked_people`, `map` and every robot's `pose` in, `cmd_vel` or the
goals of Nav2 of every robot out. A tour is started by the action `guide_tour` (`mrs tour
TOUR.yaml`) or by a path on `tour_path`. Parameters: see config/default.yaml, or `ros2 param
describe`.
"""


def main() -> None:
    """Starts the node; the exit code is 0 after Ctrl-C or SIGTERM, 2 for bad configuration."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C while the libraries load: no traceback
    from mrs_ros.running import run
    from planner_node.guide_node.node import GuideNode

    sys.exit(run(GuideNode, USAGE))


if __name__ == "__main__":
    main()

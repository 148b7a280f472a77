"""Entry point of `guide_node`."""

from __future__ import annotations

import ctypes
import gc
import signal
import sys
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from planner_node.guide_node.node import GuideNode

USAGE = """
usage: guide_node [--ros-args --params-file TEAM.yaml -p NAME:=VALUE ...]

Guides a group along a tour: `tracked_people`, `map` and every robot's `pose` in, `cmd_vel` or the
goals of Nav2 of every robot out. A tour is started by the action `guide_tour` (`mrs tour
TOUR.yaml`) or by a path on `tour_path`. Parameters: see config/default.yaml, or `ros2 param
describe`.
"""


#: The thread of velocities waits no longer than this for a step [s]; Python's own is 5 ms.
_SWITCH_S = 0.1e-3
#: Parameters of mallopt(3) and their values: no mapping of its own for a large message, and only
#: what is free beyond so much goes back to the system [bytes].
_KEEP_MEMORY = {-4: 0, -1: 512_000_000}  # M_MMAP_MAX, M_TRIM_THRESHOLD
#: Memory that is there from the beginning: for the maps that are kept, and beside them for messages
#: that are too large [bytes].
_AT_HAND = 256_000_000


def main() -> None:
    """Starts the node; the exit code is 0 after Ctrl-C or SIGTERM, 2 for bad configuration."""
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # Ctrl-C while the libraries load: no traceback
    from mrs_ros.running import run

    sys.exit(run(_made, USAGE))


def _made() -> GuideNode:
    """The node; from now on garbage is collected between messages, see `GuideNode.observe`.

    Otherwise the collector goes through all objects in the midst of a large message, and no thread
    goes on meanwhile; nor does one while rclpy takes a message, which for a map of 16 MB is several
    times faster in pages of memory that the process has already.
    """
    from planner_node.guide_node.node import GuideNode

    node = GuideNode()
    gc.collect()
    gc.freeze()
    gc.disable()
    sys.setswitchinterval(_SWITCH_S)
    mallopt = getattr(ctypes.CDLL(None), "mallopt", None)  # of glibc
    if mallopt is not None:
        for parameter, value in _KEEP_MEMORY.items():
            mallopt(parameter, value)
    _ = b"\1" * _AT_HAND
    return node


if __name__ == "__main__":
    main()

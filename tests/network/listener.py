"""Run on a host: says as lines of JSON what the planner says.

Times are of the monotonic clock, which all namespaces of a machine share.
"""

from __future__ import annotations

import json
import sys
import time
from typing import Any

from mrs_people_loc.messages import stamp_ns_of
from mrs_tools.signals import stop_on_signals
from mrs_tools.tool_node import node


def say(**what: Any) -> None:
    sys.stdout.write(json.dumps({"at": time.monotonic(), **what}) + "\n")
    sys.stdout.flush()


def on_people(message: Any) -> None:
    now_ns = time.time_ns()
    say(
        robots=[scan.robot for scan in message.scans],
        age_ms=(now_ns - stamp_ns_of(message.header.stamp)) / 1e6,
        seen_by=[list(person.robots) for person in message.persons],
    )


def main() -> None:
    from mrs_people_msgs.msg import People
    from rclpy.executors import SingleThreadedExecutor

    with stop_on_signals() as stop, node("listener") as made:
        made.create_subscription(People, "tracked_people", on_people, 10)
        executor = SingleThreadedExecutor(context=made.context)
        executor.add_node(made)
        while not stop.is_set():
            executor.spin_once(timeout_sec=0.2)


if __name__ == "__main__":
    main()

"""Client of the action `guide_tour`: asks for a tour and follows it."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from mrs_people_loc.errors import PeopleLocError
from mrs_people_loc.guiding.tour import Tour
from mrs_ros import convert

if TYPE_CHECKING:
    from rclpy.node import Node

#: guide_node is waited for, and its answers, for so long [s].
_THERE_S = 10.0
#: ... and its result after a request to cancel [s].
_CANCELLED_S = 5.0


def guide(
    node: Node,
    tour: Tour,
    *,
    spin: Callable[[], object],
    stop: threading.Event,
    show: Callable[[Any], None],
) -> Any:
    """Has a group guided along a tour, until it has ended.

    Args:
        node: The ROS node to ask with.
        tour: The tour.
        spin: Called again and again; lets the node work for a moment.
        stop: Cancels the tour when it is set.
        show: Takes each mrs_people_msgs/GuideStatus.

    Returns:
        The mrs_people_msgs/GuideTour_Result; None: `stop` was set before there was a tour.

    Raises:
        PeopleLocError: There is no guide_node, it refuses the tour, or it has ended.
    """
    from mrs_people_msgs.action import GuideTour
    from rclpy.action import ActionClient

    client = ActionClient(node, GuideTour, "guide_tour")
    name = node.resolve_service_name("guide_tour")
    try:
        if not _wait(client.server_is_ready, _THERE_S, spin, stop):
            if stop.is_set():
                return None
            raise PeopleLocError(
                f"nobody serves the action {name}; start guide_node: mrs up TEAM.yaml --guide"
            )
        asked = client.send_goal_async(
            convert.tour_goal(tour), feedback_callback=lambda message: show(message.feedback.status)
        )
        _wait(asked.done, _THERE_S, spin)
        if not asked.done():
            raise PeopleLocError(
                f"the action {name} does not answer; if the tour begins all the same, cancel it: "
                "ros2 topic pub --once tour_path nav_msgs/msg/Path"
            )
        if not asked.result().accepted:
            raise PeopleLocError(
                "guide_node takes no tour: it is not active, or others ask too often"
            )
        return _follow(client, asked.result(), spin, stop)
    finally:
        client.destroy()


def _follow(client: Any, goal: Any, spin: Callable[[], object], stop: threading.Event) -> Any:
    """The result of a goal that was accepted."""
    result, cancelled_s = goal.get_result_async(), None
    while not result.done():
        spin()
        if not client.server_is_ready() and not result.done():
            raise PeopleLocError("guide_node has ended; see that the robots stand")
        if stop.is_set() and cancelled_s is None:
            goal.cancel_goal_async()
            cancelled_s = time.monotonic()
        if cancelled_s is not None and time.monotonic() - cancelled_s > _CANCELLED_S:
            raise PeopleLocError("guide_node does not answer; stop the robots yourself")
    return result.result().result


def _wait(
    condition: Callable[[], bool],
    seconds: float,
    spin: Callable[[], object],
    stop: threading.Event | None = None,
) -> bool:
    """Waits for a condition; whether it holds."""
    end = time.monotonic() + seconds
    while not condition() and time.monotonic() < end and not (stop and stop.is_set()):
        spin()
    return condition()

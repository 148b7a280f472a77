"""Client of guide_node: asks for a tour and follows it; stops the robots, and releases them."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import partial
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
#: Who attends a tour says so this often [s].
_ATTENDED_S = 0.2


def guide(
    node: Node,
    tour: Tour,
    *,
    spin: Callable[[], object],
    stop: threading.Event,
    show: Callable[[Any], None],
    attended: bool = False,
) -> Any:
    """Has a group guided along a tour, until it has ended.

    Args:
        node: The ROS node to ask with.
        tour: The tour.
        spin: Called again and again; lets the node work for a moment.
        stop: Cancels the tour when it is set.
        show: Takes each mrs_people_msgs/GuideStatus.
        attended: Whether the tour ends where this client does.

    Returns:
        The mrs_people_msgs/GuideTour_Result; None: `stop` was set before there was a tour.

    Raises:
        PeopleLocError: There is no guide_node, it refuses the tour, or it has ended.
    """
    from mrs_people_msgs.action import GuideTour
    from rclpy.action import ActionClient
    from std_msgs.msg import Empty

    if attended:
        publisher = node.create_publisher(Empty, "attended", 1)
        spin = partial(_attend, spin, lambda: publisher.publish(Empty()), [0.0])
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
            convert.tour_goal(tour, attended=attended),
            feedback_callback=lambda message: show(message.feedback.status),
        )
        _wait(asked.done, _THERE_S, spin)
        if not asked.done():
            raise PeopleLocError(
                f"the action {name} does not answer; if the tour begins all the same, cancel it: "
                "ros2 topic pub --once tour_path nav_msgs/msg/Path"
            )
        if not asked.result().accepted:
            raise PeopleLocError(
                "guide_node takes no tour: it is not active, others ask too often, or the tour has "
                "too many points or stops"
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


def _attend(spin: Callable[[], object], say: Callable[[], object], last_s: list[float]) -> None:
    """Lets the node work for a moment, and says that the client is there."""
    spin()
    now_s = time.monotonic()
    if now_s - last_s[0] >= _ATTENDED_S:
        last_s[0] = now_s
        say()


def ask_guide(node: Node, name: str, *, spin: Callable[[], object]) -> str:
    """Calls a service of guide_node: `stop` or `release`.

    Args:
        node: The ROS node to ask with.
        name: Of the service.
        spin: As for `guide`.

    Returns:
        What has come of it, in words.

    Raises:
        PeopleLocError: There is no guide_node, or it answers that it has not.
    """
    from std_srvs.srv import Trigger

    client, full = node.create_client(Trigger, name), node.resolve_service_name(name)
    if not _wait(client.service_is_ready, _THERE_S, spin):
        raise PeopleLocError(f"nobody serves {full}: there is no guide_node; stop robots yourself")
    asked = client.call_async(Trigger.Request())
    if not _wait(asked.done, _THERE_S, spin):
        raise PeopleLocError(f"{full} does not answer; see that the robots stand")
    answer = asked.result()
    if not answer.success:
        raise PeopleLocError(answer.message)
    return str(answer.message)

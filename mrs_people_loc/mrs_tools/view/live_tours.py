"""Starts and cancels tours of a running team for viewers."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from functools import partial
from typing import TYPE_CHECKING, Any

from mrs_people_loc.errors import PeopleLocError
from mrs_people_loc.guiding.tour import Tour
from mrs_tools.live.tour_client import ask_guide, guide
from mrs_tools.plain import plain
from mrs_tools.tool_node import node, spinning
from mrs_tools.view.protocol import CommandError, Event, Publish

if TYPE_CHECKING:
    from rclpy.context import Context

#: The guide gets this long to begin a tour, to end it, and to be found [s].
_BEGIN_S, _END_S, _FIND_S = 25.0, 7.0, 3.0


class LiveTours:
    """The tour that was started here, if any.

    Args:
        namespace: Namespace of guide_node.
        context: The ROS context to use.
        publish: Takes what ends a tour out of order, as an event.
        now_s: Says the ROS time [s].
    """

    def __init__(
        self, namespace: str, context: Context, publish: Publish, now_s: Callable[[], float]
    ) -> None:
        self._namespace, self._context = namespace, context
        self._publish, self._now_s = publish, now_s
        self._thread: threading.Thread | None = None
        self._stop = threading.Event()
        self._begun = threading.Event()
        self._how = ""
        self._lock = threading.Lock()

    def start(self, tour: Tour) -> str:
        """Starts a tour, and waits until it has begun.

        Raises:
            CommandError: It does not begin, or another one that was started here goes on.
        """
        with self._lock:
            if self._thread is not None and self._thread.is_alive():
                raise CommandError("a tour goes on; cancel it first")
            self._stop, self._begun = threading.Event(), threading.Event()
            self._thread = threading.Thread(target=self._guide, args=[tour], name="view tour")
            self._thread.start()
        end_s = time.monotonic() + _BEGIN_S
        while time.monotonic() < end_s and self._thread.is_alive():
            if self._begun.wait(0.1):
                return f"{tour.name} has begun"
        if self._thread.is_alive():
            raise CommandError("guide_node has accepted the tour, but says nothing of it")
        raise CommandError(self._how)

    def cancel(self) -> str:
        """Cancels the tour, whoever has started it.

        Raises:
            CommandError: There is no guide_node.
        """
        if self._thread is not None and self._thread.is_alive():
            self._stop.set()
            self._thread.join(_END_S)
            if self._thread.is_alive():
                raise CommandError("guide_node does not answer; stop the robots yourself")
            return self._how
        from nav_msgs.msg import Path
        from rclpy.duration import Duration

        with node("mrs_view_cancel", self._context, namespace=self._namespace) as made:
            publisher = made.create_publisher(Path, "tour_path", 1)
            end_s = time.monotonic() + _FIND_S
            while not publisher.get_subscription_count():
                if time.monotonic() > end_s:
                    raise CommandError("there is no guide_node, so no tour to cancel")
                time.sleep(0.05)
            publisher.publish(Path())
            publisher.wait_for_all_acked(Duration(seconds=_FIND_S))
        return "guide_node is asked to cancel its tour"

    def release(self) -> str:
        """Releases robots that were stopped.

        Raises:
            CommandError: There is no guide_node, or they are not stopped.
        """
        try:
            with (
                node("mrs_view_release", self._context, namespace=self._namespace) as made,
                spinning(made) as executor,
            ):
                return ask_guide(made, "release", spin=partial(executor.spin_once, timeout_sec=0.1))
        except PeopleLocError as err:
            raise CommandError(str(err)) from err

    def close(self) -> None:
        """Cancels the tour that was started here."""
        self._stop.set()
        if self._thread is not None:
            self._thread.join()

    def _guide(self, tour: Tour) -> None:
        """Follows a tour until it has ended."""

        def show(_status: Any) -> None:
            self._begun.set()

        try:
            with (
                node("mrs_view_tour", self._context, namespace=self._namespace) as made,
                spinning(made) as executor,
            ):
                result = guide(
                    made,
                    tour,
                    spin=lambda: executor.spin_once(timeout_sec=0.1),
                    stop=self._stop,
                    show=show,
                )
            self._how = plain(result.message) if result is not None else "cancelled"
        except PeopleLocError as err:
            self._how = str(err)
            if self._begun.is_set():  # else the answer tells; ends in order are told by guide_node
                text = f"tour {plain(tour.name)}: {self._how}"
                self._publish(Event(type="event", t=round(self._now_s(), 3), text=text))

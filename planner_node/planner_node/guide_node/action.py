"""The action `guide_tour`."""

from __future__ import annotations

import contextlib
import time
from collections import deque
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any

from mrs_people_msgs.action import GuideTour
from mrs_people_msgs.msg import GuideStatus
from rclpy.action import ActionServer, CancelResponse

from mrs_people_loc.errors import PeopleLocError
from mrs_people_loc.guiding.tour import LIMITS
from mrs_ros.managed_node import ManagedNode

#: Of the goals that come within a second so many are answered with a reason; the rest are rejected.
_ANSWERED, _FLOOD_S = 5, 1.0
#: Results are kept for clients that ask late [s].
_KEPT_S = 10


@dataclass(frozen=True)
class End:
    """How a tour ended.

    Attributes:
        finished: Whether the group is at its end.
        message: How, in words.
        lost: Ids of those without whom it went on.
    """

    finished: bool
    message: str
    lost: Sequence[int] = ()


class _Server(ActionServer):
    """Rejects goals as they are taken, and takes some that are executed without a coroutine.

    rclpy takes all goals that have come before it asks whether they are accepted, and keeps them
    and a task of each until then.

    Args:
        node: The guide's node.
        rejects: Says of a goal whether it is rejected.
        execute: Gives the result of a goal, at its end.
        how: Further arguments of `ActionServer`.
    """

    def __init__(
        self, node: ManagedNode, rejects: Callable[[Any], bool], execute: Any, **how: Any
    ) -> None:
        self._rejects = rejects
        super().__init__(node, GuideTour, "guide_tour", execute, **how)

    def take_data(self) -> Any:
        """Takes what has come."""
        data = super().take_data()
        if "goal" in data and self._rejects(data["goal"][1].goal):
            header, _ = data.pop("goal")
            with contextlib.suppress(RuntimeError):  # the client may be gone
                answer = GuideTour.Impl.SendGoalService.Response(accepted=False)
                self._handle.send_goal_response(header, answer)
        return data

    def notify_execute(self, goal_handle: Any, execute_callback: Any) -> None:
        """Called by `execute` of a goal, which then is in the state EXECUTING."""
        if execute_callback is not None:
            super().notify_execute(goal_handle, execute_callback)


class TourAction:
    """The server of the action, which has one goal at a time.

    Args:
        node: The guide's node.
        begin: Begins the tour of a goal, or raises `PeopleLocError`.
        cancel: Ends the tour under way.
    """

    def __init__(
        self, node: ManagedNode, begin: Callable[[Any], None], cancel: Callable[[], None]
    ) -> None:
        self._node = node
        self._begin = begin
        self._cancel = cancel
        self._handle: Any = None
        self._end: End | None = None
        self._asked_s: deque[float] = deque(maxlen=_ANSWERED)
        self._server = _Server(
            node,
            self._rejects,
            self._execute,
            handle_accepted_callback=self._on_accepted,
            cancel_callback=self._on_cancel,
            result_timeout=_KEPT_S,
        )

    def destroy(self) -> None:
        """Ends the server."""
        self._server.destroy()

    @property
    def is_busy(self) -> bool:
        """Whether a goal has no result yet."""
        return self._handle is not None

    def tell(self, status: GuideStatus) -> None:
        """Tells the client how the tour goes on."""
        if self._handle is not None:
            self._handle.publish_feedback(GuideTour.Feedback(status=status))

    def end(self, end: End) -> None:
        """Gives the goal its result; a tour that no goal asked for has none."""
        if self._handle is not None and self._end is None:
            self._end = end
            self._server.notify_execute(self._handle, self._execute)

    def _rejects(self, goal: Any) -> bool:
        # A rejection has no message, so that what is wrong with a goal is in its result; but that
        # costs more than a flood of goals may.
        asked_s, now_s = self._asked_s, time.monotonic()
        is_flood = len(asked_s) == asked_s.maxlen and now_s - asked_s[0] < _FLOOD_S
        is_long = len(goal.path.poses) > LIMITS.points or len(goal.stops) > LIMITS.stops
        rejected = is_flood or is_long or not self._node.is_active
        if not rejected:
            asked_s.append(now_s)
        return rejected

    def _on_accepted(self, handle: Any) -> None:
        try:
            self._begin(handle.request)
        except PeopleLocError as err:
            self._node.get_logger().warning(f"tour refused: {err}")
            handle.execute(partial(self._refuse, str(err)))
        else:
            self._handle, self._end = handle, None
            handle.execute()

    def _on_cancel(self, handle: Any) -> CancelResponse:
        if self._handle is not None and handle == self._handle:
            self._cancel()
        return CancelResponse.ACCEPT

    def _refuse(self, message: str, handle: Any) -> Any:
        handle.abort()
        return GuideTour.Result(message=message)

    # Called when the tour has ended: while a coroutine waits here, the executor has it resumed
    # without a pause.
    def _execute(self, handle: Any) -> Any:
        end = self._end or End(False, "")
        self._handle = self._end = None
        if end.finished:
            handle.succeed()
        elif handle.is_cancel_requested:
            handle.canceled()
        else:
            handle.abort()
        return GuideTour.Result(finished=end.finished, message=end.message, lost=list(end.lost))

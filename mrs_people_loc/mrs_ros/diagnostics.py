"""Inputs that count what arrives and what is dropped, and `/diagnostics` at 1 Hz."""

from __future__ import annotations

import contextlib
import math
import resource
import time
from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
from rclpy.clock import Clock
from rclpy.clock_type import ClockType
from rclpy.event_handler import SubscriptionEventCallbacks
from rclpy.node import Node
from rclpy.qos import QoSPolicyKind, QoSProfile
from rclpy.serialization import deserialize_message

from mrs_people_loc.clocks import Order
from mrs_people_loc.errors import PeopleLocError, SizeError
from mrs_people_loc.health.findings import ERROR, SILENCE_S, Code, Finding
from mrs_people_loc.health.inputs import InputState, of_input
from mrs_people_loc.health.reception import Reception
from mrs_people_loc.messages import stamp_ns_of
from mrs_ros.network import node_of

#: The same problem is logged at most this often [s].
LOG_PERIOD_S = 5.0
#: Codes of inputs that deliver nothing, and of the pose that is missing with them.
_WAITING = (Code.NO_PUBLISHER, Code.NO_DATA, Code.NO_POSE)
#: What fell silent together has all been found so many reports after the first of it.
_FOUND_AFTER = math.ceil(SILENCE_S)
#: Drops are a warning for this long [s].
RECENT_S = 10.0
#: The rate of an input is that over this time [s].
_RATE_S = 5.0


class Throttle:
    """Lets something of each kind through at most once in a while.

    rclpy's own throttle goes by the line of code: there, one topic's problem would keep another's
    out of the log.

    Args:
        period_s: How long a kind is kept back after it was let through [s].
    """

    def __init__(self, period_s: float) -> None:
        self._period_s = period_s
        self._last_s: dict[str, float] = {}

    def lets_through(self, kind: str) -> bool:
        """Whether one of this kind goes through now."""
        now_s = time.monotonic()
        last_s = self._last_s.get(kind)
        if last_s is not None and now_s - last_s < self._period_s:
            return False
        self._last_s[kind] = now_s
        return True


class Growth:
    """Whether a count has grown within the last `RECENT_S`."""

    def __init__(self) -> None:
        self._count = 0
        self._grown_s: float | None = None

    def update(self, count: int) -> None:
        """Takes the count as it is now."""
        if count > self._count:
            self._grown_s = time.monotonic()
        self._count = count

    @property
    def lately(self) -> bool:
        """Whether it has grown."""
        return self._grown_s is not None and time.monotonic() - self._grown_s < RECENT_S


class Input:
    """A subscription that knows what should arrive on it.

    Messages go to `callback`. A `PeopleLocError` that it raises is counted and logged, its message
    dropped, and the node goes on.

    Args:
        node: The node.
        message_type: Type of the messages.
        topic: Relative name.
        callback: Takes a message.
        qos: Quality of service that is asked for.
        once: One usable message is enough: silence after it is no fault.
        any_number: Any number of nodes may publish it, also none: the order of stamps, and silence,
            mean nothing.
        most_bytes: Larger messages are refused unread; 0: none is too large.

    Attributes:
        any_number: As above.
        reception: Counts its messages.
        instead: Relative name of a topic that may be published in place of this one, and what to do
            then.
    """

    def __init__(
        self,
        node: Node,
        message_type: type,
        topic: str,
        callback: Callable[[Any], None],
        qos: QoSProfile,
        *,
        once: bool = False,
        any_number: bool = False,
        most_bytes: int = 0,
    ) -> None:
        self.topic = topic
        self._most_bytes = most_bytes
        self._once = once
        self.any_number = any_number
        self.reception = Reception()
        self.instead: tuple[str, str] | None = None
        self._node = node
        self._callback = callback
        self._message_type = message_type
        self._incompatible = ""
        self._losses = Growth()
        self._log = Throttle(LOG_PERIOD_S)
        self._since = time.monotonic()
        self._arrivals: deque[float] = deque(maxlen=1000)
        self.subscription = node.create_subscription(
            message_type,
            topic,
            self._take_bytes if most_bytes else self._take,
            qos,
            raw=bool(most_bytes),
            event_callbacks=SubscriptionEventCallbacks(incompatible_qos=self._on_incompatible),
        )

    def destroy(self) -> None:
        """Ends the subscription."""
        self._node.destroy_subscription(self.subscription)

    @property
    def rate_hz(self) -> float:
        """Messages per second over the last few seconds."""
        now, recent = time.monotonic(), self._arrivals
        while len(recent) > 1 and now - recent[0] >= _RATE_S:
            recent.popleft()
        return (len(recent) - 1) / (now - recent[0]) if len(recent) > 1 else 0.0

    @property
    def silent_s(self) -> float:
        """Since when nothing came [s]."""
        return time.monotonic() - (self._arrivals[-1] if self._arrivals else self._since)

    @property
    def publishers(self) -> int:
        """Number of publishers of this topic, as far as is known here."""
        return int(self._node.count_publishers(self.subscription.topic_name))

    def finding(self) -> Finding:
        """What is wrong with this input."""
        return of_input(self._state())

    def _state(self) -> InputState:
        node, name, reception = self._node, self.subscription.topic_name, self.reception
        instead = None
        if self.instead is not None:
            other, remedy = self.instead
            other = node.resolve_topic_name(other)
            instead = (other, remedy) if node.count_publishers(other) else None
        silent_s = self.silent_s
        # Their names cost more to ask for than their number, and matter where something is wrong.
        asked = silent_s > SILENCE_S or self.publishers > 1
        publishers = node.get_publishers_info_by_topic(name) if asked else []
        return InputState(
            name=self.topic,
            topic=name,
            kind=type_name(self._message_type),
            silent_s=silent_s,
            rate_hz=self.rate_hz,
            received=reception.received,
            dropped=reception.dropped,
            refused=reception.refused,
            refused_in_a_row=reception.refused_in_a_row,
            refused_lately=self._losses.lately,
            last_error=reception.last_error,
            last_kind=reception.last_kind,
            publishers=[(node_of(p), p.topic_type) for p in publishers],
            incompatible=self._incompatible,
            once=self._once,
            any_number=self.any_number,
            taken=reception.taken,
            instead=instead,
        )

    def refuse(self, error: PeopleLocError) -> None:
        """Counts and logs a message that the callback took, and that turned out to be unusable."""
        self._refuse(error, Order.NEWER)

    def _take_bytes(self, data: bytes) -> None:
        if len(data) > self._most_bytes:
            self._arrivals.append(time.monotonic())
            text = f"message has {len(data)} bytes; allowed: {self._most_bytes}"
            self._refuse(SizeError(text), self.reception.receive(0))
        else:
            self._take(deserialize_message(data, self._message_type))

    def _take(self, message: Any) -> None:
        self._arrivals.append(time.monotonic())
        unordered = self._once or self.any_number
        order = self.reception.receive(0 if unordered else stamp_ns_of(message.header.stamp))
        try:
            self._callback(message)
        except PeopleLocError as err:
            self._refuse(err, order)
        else:
            self.reception.accept(order)
            self._losses.update(self.reception.refused)

    def _refuse(self, error: PeopleLocError, order: Order) -> None:
        reception, kind = self.reception, type(error).__name__
        reception.refuse(kind, str(error), now_s=time.monotonic(), order=order)
        self._losses.update(reception.refused)
        if self._log.lets_through(kind):
            self._node.get_logger().warning(
                f"{self.subscription.topic_name}: {error} "
                f"[dropped: {sum(reception.dropped.values())}]"
            )

    def _on_incompatible(self, event: Any) -> None:
        self._incompatible = QoSPolicyKind(event.last_policy_kind).name
        self._node.get_logger().warning(
            f"{self.subscription.topic_name}: a publisher offers incompatible QoS: "
            f"{self._incompatible}; its messages do not arrive"
        )


def type_name(message_type: Any) -> str:
    """As ROS names the type of a message class: std_msgs/msg/String."""
    package, kind, _ = message_type.__module__.split(".", 2)
    return f"{package}/{kind}/{message_type.__name__}"


class Reporter:
    """Publishes findings on `/diagnostics` once a second.

    Args:
        node: The node.
        hardware_id: The robot's name, or the planner's.
        collect: Gives the findings.
    """

    def __init__(self, node: Node, hardware_id: str, collect: Callable[[], list[Finding]]) -> None:
        self._node = node
        self._hardware_id = hardware_id
        self._collect = collect
        self._log = Throttle(2 * LOG_PERIOD_S)
        self._waiting: set[str] = set()
        self._reports_waiting = 0
        self._publisher = node.create_publisher(DiagnosticArray, "/diagnostics", 10)
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._timer = node.create_timer(1.0, self.report, clock=steady)

    def destroy(self) -> None:
        """Ends reporting."""
        self._node.destroy_timer(self._timer)
        self._node.destroy_publisher(self._publisher)

    def report(self) -> None:
        """Publishes now; new errors are logged, too."""
        message = DiagnosticArray()
        message.header.stamp = self._node.get_clock().now().to_msg()
        findings = self._collect()
        for finding in findings:
            values = dict(finding.values)
            if finding.code is not None:
                values["code"] = finding.code
            message.status.append(
                DiagnosticStatus(
                    level=finding.level,
                    name=f"{self._node.get_fully_qualified_name()}: {finding.name}",
                    message=finding.message,
                    hardware_id=self._hardware_id,
                    values=[KeyValue(key=key, value=str(value)) for key, value in values.items()],
                )
            )
            waits = finding.code in _WAITING
            if finding.level == ERROR and not waits and self._log.lets_through(finding.name):
                self._node.get_logger().warning(finding.message)
        self._log_waiting({finding.name: finding for finding in findings})
        self._publisher.publish(message)

    def _log_waiting(self, findings: Mapping[str, Finding]) -> None:
        """Logs what waits for data when there is more of it than before, all in one line."""
        waiting = {name: one.message for name, one in findings.items() if one.code in _WAITING}
        self._waiting &= waiting.keys()
        self._reports_waiting = self._reports_waiting + 1 if waiting else 0
        if self._reports_waiting <= _FOUND_AFTER:
            return
        if waiting.keys() - self._waiting and self._log.lets_through("waiting"):
            self._node.get_logger().warning("; ".join(waiting.values()))
            self._waiting = {*waiting}


def recording_hint(node: Node) -> str:
    """Advice on stamps far from the clock, which a recording may cause."""
    if node.get_parameter("use_sim_time").value:
        return ""
    return "; for a recording use `mrs replay --clock` and the parameter use_sim_time:=true"


class ProcessUse:
    """Processor time and memory of this process."""

    def __init__(self) -> None:
        self._last = time.monotonic(), time.process_time()
        self._share = 0.0

    def update(self) -> None:
        """Measures the share of one processor since the last call."""
        now, before = (time.monotonic(), time.process_time()), self._last
        self._last = now
        self._share = (now[1] - before[1]) / max(now[0] - before[0], 1e-3)

    def values(self) -> dict[str, object]:
        """That share, and resident memory."""
        values: dict[str, object] = {"cpu_percent": f"{100.0 * self._share:.0f}"}
        with contextlib.suppress(OSError):  # only Linux has it
            pages = int(Path("/proc/self/statm").read_text().split()[1])
            values["memory_mb"] = f"{pages * resource.getpagesize() / 1e6:.0f}"
        return values

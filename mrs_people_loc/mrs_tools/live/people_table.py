"""People, groups, events and robots of a running team as tables of the terminal."""

from __future__ import annotations

import math
import time
from collections import Counter, deque
from typing import TYPE_CHECKING, Any

from mrs_people_loc.arrays import Float
from mrs_people_loc.config import PEOPLE_TOPICS
from mrs_people_loc.errors import PeopleLocError
from mrs_people_loc.geometry import yaw_from_quaternion
from mrs_people_loc.messages import read_people, stamp_ns_of
from mrs_people_loc.people import Group as PeopleGroup
from mrs_people_loc.people import Person
from mrs_tools.bags.message_types import PEOPLE_TYPE
from mrs_tools.common import make_table
from mrs_tools.diagnosis.diagnose import causes_in
from mrs_tools.diagnosis.facts import ERROR, LEVELS, STALE, WARN
from mrs_tools.plain import plain

if TYPE_CHECKING:
    from rclpy.node import Node
    from rich.console import RenderableType

#: Rates are taken over this long [s].
_SPAN_S = 5.0
#: So many events are shown, the latest, and so many troubles, the worst.
_EVENTS, _TROUBLES = 5, 4
#: A report on /diagnostics holds for so long [s].
_REPORT_S = 3.0
#: Levels of troubles, the worst first; stale is what waits.
_LEVELS = {ERROR: "error", WARN: "warning", STALE: "stale"}
#: Who says what `mrs people` itself finds.
_OWN = "people"


class _Rate:
    """Events per second over the last few seconds."""

    def __init__(self) -> None:
        self._times: deque[float] = deque(maxlen=1000)

    def add(self) -> None:
        self._times.append(time.monotonic())

    @property
    def silent_s(self) -> float:
        return time.monotonic() - self._times[-1] if self._times else math.inf

    def text(self) -> str:
        now = time.monotonic()
        recent = [t for t in self._times if now - t < _SPAN_S]
        return f"{(len(recent) - 1) / (recent[-1] - recent[0]):.1f}" if len(recent) > 1 else "-"


class LivePeople:
    """Listens to a team and draws it as a table.

    Args:
        node: The ROS node to listen with.

    Attributes:
        message: The last message of people; None before the first.
        troubles_shown: Whether it shows what nodes complain of.
    """

    def __init__(self, node: Node) -> None:
        from diagnostic_msgs.msg import DiagnosticArray
        from mrs_people_msgs.msg import People
        from rclpy.clock import Clock
        from rclpy.clock_type import ClockType
        from std_msgs.msg import String

        self._node = node
        self.message: Any = None
        self.troubles_shown = True
        self._people: tuple[tuple[Person, ...], tuple[PeopleGroup, ...]] = (), ()
        self._events: deque[tuple[float, str]] = deque(maxlen=_EVENTS)
        #: When the last message came, by ROS time [ns] and by the steady clock [s].
        self._came = 0, 0.0
        self._rate = _Rate()
        self._robots: dict[str, _Rate] = {}
        self._scans: dict[str, Any] = {}
        self._reports: dict[str, tuple[float, str, str, dict[str, str]]] = {}
        self._type = People
        self._hear(PEOPLE_TOPICS[0])
        steady = Clock(clock_type=ClockType.STEADY_TIME)
        self._looking = node.create_timer(1.0, self._look_for_old_name, clock=steady)
        node.create_subscription(String, "events", self._on_event, 10)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)

    def _hear(self, topic: str) -> None:
        self._node.create_subscription(self._type, topic, self._on_people, 10)

    def _look_for_old_name(self) -> None:
        """Subscribes to the old name, too, where a planner uses it (`people_topic`).

        Not before: elsewhere people_msgs/People is on it.
        """
        topic = self._node.resolve_topic_name(PEOPLE_TOPICS[1])
        publishers = self._node.get_publishers_info_by_topic(topic)
        if any(publisher.topic_type == PEOPLE_TYPE for publisher in publishers):
            self._looking.cancel()
            self._hear(topic)

    def _on_people(self, message: Any) -> None:
        try:
            self._people = read_people(message, message.header.frame_id.lstrip("/"))
        except PeopleLocError as err:  # somebody else's: it is no reason to end
            refused = f"a message is refused: {err}"
            self._reports[f"{_OWN}: node"] = (time.monotonic(), WARN, refused, {})
            return
        self.message = message
        self._came = self._node.get_clock().now().nanoseconds, time.monotonic()
        self._rate.add()
        for scan in message.scans:
            self._robots.setdefault(scan.robot, _Rate()).add()
            self._scans[scan.robot] = scan

    def _on_event(self, message: Any) -> None:
        self._events.append((time.monotonic(), message.data))

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            values = {plain(entry.key): plain(entry.value) for entry in status.values}
            level = LEVELS.get(bytes(status.level), ERROR)
            entry = time.monotonic(), level, plain(status.message), values
            self._reports[plain(status.name)] = entry

    def age_s(self, stamp: Any) -> float:
        """Age of a stamp [s]: by ROS time until the last message, and by the steady clock since.

        So it goes on where `/clock` ends.
        """
        came_ns, came_s = self._came
        return (came_ns - stamp_ns_of(stamp)) / 1e9 + time.monotonic() - came_s

    def __rich__(self) -> RenderableType:
        """The tables as they are now."""
        from rich.console import Group
        from rich.text import Text

        if self.message is None:
            wait = Text("waiting for people ... (is the planner running?)")
            return Group(wait, *self._health_lines())
        return Group(
            self._people_table(),
            self._group_table(),
            self._robot_table(),
            *self._event_lines(),
            *self._health_lines(),
        )

    def _people_table(self) -> RenderableType:
        from rich.text import Text  # names from outside are no markup

        persons, _ = self._people
        hidden = sum(person.seen_at is not None for person in persons)
        title = f"{len(persons) - hidden} people, {self._rate.text()} Hz"
        if hidden:
            title += f", and {hidden} hidden"
        if self._rate.silent_s > 2.0:
            title += f", silent for {self._rate.silent_s:.0f} s"
        columns = ("id", "x [m]", "y [m]", "speed [m/s]", "height [m]", "age [s]")
        table = make_table(title, *map(_head, columns))
        table.add_column("seen by")
        for index, person in enumerate(persons):
            x, y = person.position
            table.add_row(
                str(person.id or f"({index + 1})"),
                f"{x:.2f}",
                f"{y:.2f}",
                _speed(person.velocity),
                f"{person.height:.2f}",
                f"{person.age_s:.0f}",
                Text(self._seen_by(person)),
                style="dim" if person.coasting else None,
            )
        return table

    def _seen_by(self, person: Person) -> str:
        if not person.coasting:
            return plain(", ".join(person.robots))
        if person.seen_at is None:
            return "nobody (coasting)"
        unseen_s = (stamp_ns_of(self.message.header.stamp) - person.stamp_ns) / 1e9
        x, y = person.seen_at
        return f"nobody for {unseen_s:.1f} s, last at {x:.1f}, {y:.1f}"

    def _group_table(self) -> RenderableType:
        columns = ("id", "people", "x [m]", "y [m]", "speed [m/s]", "radius [m]")
        table = make_table("groups", *map(_head, columns))
        table.add_column("stragglers")
        for group in self._people[1]:
            x, y = group.centre
            away = ", ".join(f"{one} ({away_s:.0f} s)" for one, away_s in group.stragglers.items())
            table.add_row(
                str(group.id or "-"),
                str(group.size),
                f"{x:.2f}",
                f"{y:.2f}",
                _speed(group.velocity),
                f"{group.radius:.2f}",
                f"[bold red]{away}[/]" if away else "",
            )
        return table

    def _event_lines(self) -> list[RenderableType]:
        from rich.text import Text

        now = time.monotonic()
        return [Text(f"{now - when:4.0f} s ago: {plain(event)}") for when, event in self._events]

    def _robot_table(self) -> RenderableType:
        from rich.text import Text

        columns = ("robot", "scans/s", "age [ms]", "x [m]", "y [m]", "yaw [deg]")
        table = make_table("robots", *columns)
        for robot in sorted(self._scans):
            scan = self._scans[robot]
            at, q = scan.pose.pose.position, scan.pose.pose.orientation
            table.add_row(
                Text(plain(robot)),
                self._robots[robot].text(),
                f"{self.age_s(scan.stamp) * 1e3:.0f}",
                f"{at.x:.2f}",
                f"{at.y:.2f}",
                f"{math.degrees(yaw_from_quaternion(q.x, q.y, q.z, q.w)):.0f}",
            )
        return table

    def _health_lines(self) -> list[RenderableType]:
        """How the team is: one line that sums up, and one for each of the worst troubles."""
        from rich.text import Text

        if not self.troubles_shown:
            return []
        now = time.monotonic()
        recent = {n: entry for n, (when, *entry) in self._reports.items() if now - when < _REPORT_S}
        reports: dict[str, dict[str, Any]] = {}
        for name, entry in recent.items():
            node, _, subject = name.partition(": ")
            reports.setdefault(node, {})[subject] = entry
        causes = causes_in(reports)
        causes.sort(key=lambda check: list(_LEVELS).index(check.level))
        counts = Counter(check.level for check in causes)
        summary = ", ".join(
            f"{counts[level]} {name}{'s' if counts[level] > 1 and level != STALE else ''}"
            for level, name in _LEVELS.items()
            if counts[level]
        )
        nodes = len(reports.keys() - {_OWN})
        heard = f"{nodes} nodes report" if nodes else "no node reports on /diagnostics"
        fine = "ok" if nodes else "unknown"
        style = "yellow" if causes or not nodes else "green"
        lines = [Text(f"health: {summary or fine} ({heard})", style=style)]
        for check in causes[:_TROUBLES]:
            more = f" (and {len(check.follows)} that follow from it)" if check.follows else ""
            style = "red" if check.level == ERROR else "yellow"
            lines.append(Text(f"  {check.subject}: {check.text}{more}", style=style))
        if len(causes) > _TROUBLES:
            lines.append(Text(f"  and {len(causes) - _TROUBLES} more; what to do: mrs doctor"))
        return list(lines)


def _head(column: str) -> str:
    """The unit below the name, which keeps the column narrow."""
    return column.replace(" [", "\n[")


def _speed(velocity: Float | None) -> str:
    return "-" if velocity is None else f"{math.hypot(*velocity):.2f}"


def follow_clock(node: Node) -> None:
    """Lets a node take its time from /clock while somebody publishes that."""
    from rclpy.clock import Clock
    from rclpy.clock_type import ClockType
    from rclpy.parameter import Parameter

    def look() -> None:
        simulated = node.count_publishers("/clock") > 0
        if simulated != node.get_parameter("use_sim_time").value:
            node.set_parameters([Parameter("use_sim_time", value=simulated)])

    node.create_timer(0.5, look, clock=Clock(clock_type=ClockType.STEADY_TIME))

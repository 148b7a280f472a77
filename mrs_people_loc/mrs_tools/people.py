"""`mrs people`: the people, robots, rates and ages of a running team, live in the terminal."""

from __future__ import annotations

import math
import time
from collections import deque
from contextlib import nullcontext
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mrs_people_loc.geometry import yaw_from_quaternion
from mrs_people_loc.messages import stamp_ns_of

if TYPE_CHECKING:
    from rclpy.node import Node
    from rich.console import RenderableType

#: Rates are taken over this long [s].
_SPAN_S = 5.0


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
        message: The last `people` message; None before the first.
    """

    def __init__(self, node: Node) -> None:
        from diagnostic_msgs.msg import DiagnosticArray
        from mrs_people_msgs.msg import People

        self._node = node
        self.message: Any = None
        self._rate = _Rate()
        self._robots: dict[str, _Rate] = {}
        self._scans: dict[str, Any] = {}
        self._troubles: dict[str, tuple[float, str]] = {}
        node.create_subscription(People, "people", self._on_people, 10)
        node.create_subscription(DiagnosticArray, "/diagnostics", self._on_diagnostics, 10)

    def _on_people(self, message: Any) -> None:
        self.message = message
        self._rate.add()
        for scan in message.scans:
            self._robots.setdefault(scan.robot, _Rate()).add()
            self._scans[scan.robot] = scan

    def _on_diagnostics(self, message: Any) -> None:
        for status in message.status:
            if status.level == b"\x00":
                self._troubles.pop(status.name, None)
            else:
                self._troubles[status.name] = (time.monotonic(), status.message)

    def age_s(self, stamp: Any) -> float:
        """Age of a stamp by ROS time [s]."""
        return (self._node.get_clock().now().nanoseconds - stamp_ns_of(stamp)) / 1e9

    def __rich__(self) -> RenderableType:
        """The tables as they are now."""
        from rich.console import Group
        from rich.text import Text

        if self.message is None:
            wait = Text("waiting for people ... (is the planner running?)")
            return Group(wait, *self._trouble_lines())
        return Group(self._people_table(), self._robot_table(), *self._trouble_lines())

    def _people_table(self) -> RenderableType:
        from rich.table import Table

        message = self.message
        title = f"{len(message.persons)} people, {self._rate.text()} Hz"
        if self._rate.silent_s > 2.0:
            title += f", silent for {self._rate.silent_s:.0f} s"
        table = Table(title=title, title_justify="left")
        for column in ("id", r"x \[m]", r"y \[m]", r"height \[m]", r"sigma \[m]"):
            table.add_column(column, justify="right")
        table.add_column("seen by")
        for index, person in enumerate(message.persons):
            at = person.pose.pose.position
            table.add_row(
                str(person.id or f"({index + 1})"),
                f"{at.x:.2f}",
                f"{at.y:.2f}",
                f"{person.height:.2f}",
                f"{person.sigma:.2f}",
                ", ".join(person.robots) + (" (coasting)" if person.coasting else ""),
            )
        for group in message.groups:
            at = group.centre.pose.position
            radius = f"all within {group.radius:.2f} m"
            table.add_section()
            table.add_row("group", f"{at.x:.2f}", f"{at.y:.2f}", "", "", radius)
        return table

    def _robot_table(self) -> RenderableType:
        from rich.table import Table

        table = Table(title="robots", title_justify="left")
        table.add_column("robot")
        for column in ("scans/s", r"age \[ms]", r"x \[m]", r"y \[m]", r"yaw \[deg]"):
            table.add_column(column, justify="right")
        for robot in sorted(self._scans):
            scan = self._scans[robot]
            at, q = scan.pose.pose.position, scan.pose.pose.orientation
            table.add_row(
                robot,
                self._robots[robot].text(),
                f"{self.age_s(scan.stamp) * 1e3:.0f}",
                f"{at.x:.2f}",
                f"{at.y:.2f}",
                f"{math.degrees(yaw_from_quaternion(q.x, q.y, q.z, q.w)):.0f}",
            )
        return table

    def _trouble_lines(self) -> list[RenderableType]:
        from rich.text import Text

        now = time.monotonic()
        return [
            Text(f"{name}: {text}", style="yellow")
            for name, (when, text) in sorted(self._troubles.items())
            if now - when < 3.0
        ]


def command(
    sim_time: Annotated[
        bool, typer.Option("--sim-time", help="Ages by /clock (mrs replay --clock).")
    ] = False,
    namespace: Annotated[
        str, typer.Option("--namespace", "-n", help="Namespace of the planner.")
    ] = "",
    duration: Annotated[
        float, typer.Option("--duration", min=0.0, help="End after so long [s]; 0: at Ctrl-C.")
    ] = 0.0,
) -> None:
    """Show people, robots, rates and ages of a running team, live in the terminal.

    Where the output is no terminal, the table is printed once at the end.
    """
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.parameter import Parameter
    from rich.console import Console
    from rich.live import Live

    from mrs_tools.cli import stop_on_signals
    from mrs_tools.replay import node

    console = Console()
    simulated = Parameter("use_sim_time", value=sim_time)
    with node("mrs_people", namespace=namespace, parameter_overrides=[simulated]) as made:
        executor = SingleThreadedExecutor(context=made.context)
        executor.add_node(made)
        try:
            live = LivePeople(made)
            end = time.monotonic() + duration if duration else math.inf
            screen = (
                Live(live, console=console, refresh_per_second=5)
                if console.is_terminal
                else nullcontext()
            )
            with stop_on_signals() as stop, screen:
                while not stop.is_set() and time.monotonic() < end:
                    executor.spin_once(timeout_sec=0.1)
            if not console.is_terminal:
                console.print(live)
        finally:
            executor.shutdown()

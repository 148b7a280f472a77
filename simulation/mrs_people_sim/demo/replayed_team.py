"""Runs a recorded team through its real processes."""

from __future__ import annotations

import math
import tempfile
import threading
import time
from collections.abc import Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from mrs_people_loc.config import PLANNER_NODE, ROBOT_NODE, load_team
from mrs_people_loc.errors import PeopleLocError
from mrs_people_loc.messages import stamp_ns_of
from mrs_people_sim.demo.steps import OnProgress, step
from mrs_people_sim.domain import other_publishers_error, refuse_other_publishers
from mrs_people_sim.start_limit import StartLimit
from mrs_ros.processes import RunningTeam, team_processes
from mrs_tools.bags.replayer import Progress, Replayer
from mrs_tools.live.people_table import LivePeople
from mrs_tools.plain import plain
from mrs_tools.signals import Stop, stop_on_signals
from mrs_tools.tool_node import node, spinning, wait_for_discovery

if TYPE_CHECKING:
    from rclpy.executors import Executor
    from rclpy.node import Node
    from rich.console import Console

#: What nodes lack is no trouble until people have come for so long, or none for so long [s].
_SETTLE_S, _SILENT_S = 3.0, 15.0
#: What is still under way after the bag's end gets this long [s].
_TAIL_S = 1.5
#: Every node may publish these, and none of ours listens to them.
_EVERYBODYS = {"/rosout", "/parameter_events", "/diagnostics"}


class Listener:
    """Keeps what the team says.

    Args:
        node: The ROS node to listen with.
        topic: The planner's mrs_people_msgs/People.

    Attributes:
        people: The messages on `topic`.
        events: The `events`, with the ROS time at which they came [ns].
        maps: The `short_term_map` messages, by stamp [ns].
    """

    def __init__(self, node: Node, topic: str) -> None:
        from mrs_people_msgs.msg import People
        from sensor_msgs.msg import PointCloud2
        from std_msgs.msg import String

        self._node = node
        self.people: list[Any] = []
        self.events: list[tuple[int, str]] = []
        self.maps: dict[int, Any] = {}
        node.create_subscription(People, topic, self.people.append, 100)
        node.create_subscription(String, "events", self._on_event, 100)
        node.create_subscription(PointCloud2, "short_term_map", self._on_map, 100)

    def _on_event(self, message: Any) -> None:
        self.events.append((self._node.get_clock().now().nanoseconds, message.data))

    def _on_map(self, message: Any) -> None:
        self.maps[stamp_ns_of(message.header.stamp)] = message


def run_team(
    bag: Path,
    files: list[Path],
    rate: float,
    console: Console,
    watching: AbstractContextManager[object],
) -> Listener:
    """Runs a team on a bag and returns what it published.

    Args:
        bag: The bag.
        files: Parameter files of the team.
        rate: Seconds of bag time per second.
        console: Where the team is shown.
        watching: Entered once the team is there, and left before it ends.

    Raises:
        PeopleLocError: A process ends by itself or is not ready in time, or somebody else
            publishes the team's topics.
        typer.Exit: A signal stopped it.
    """
    from rclpy.parameter import Parameter

    nodes = team_processes(files, sim_time=True)
    topic = f"/{load_team(*files).planner.people_topic}"
    simulated = [Parameter("use_sim_time", value=True)]
    with node("mrs_demo", parameter_overrides=simulated) as made, spinning(made) as executor:
        listener, live = Listener(made, topic), LivePeople(made)
        live.troubles_shown = False
        with (
            tempfile.TemporaryFile("w+") as log,
            stop_on_signals() as stop,
            Replayer(bag, rate=rate, clock=True) as player,
            ExitStack() as stack,
        ):
            robots = [n.namespace for n in nodes if n.namespace]
            domain = _Domain(made, player, robots, topic)
            with step(console, f"starting {', '.join(n.label for n in nodes)}"):
                # Before four nodes begin to publish in a domain that others use.
                wait_for_discovery(made)
                domain.refuse_other_publishers(started=False)
                team = stack.enter_context(RunningTeam(nodes, log=log))
                _wait_for_team(made, topic, team, log, stop)
                stack.enter_context(watching)
                player.wait_for_subscribers(stop=stop)
                domain.refuse_other_publishers()
            with step(console, f"replaying {plain(bag.name)}", below=live) as on_progress:
                alive = _replay(player, team, live, executor, stop, on_progress)
            if not alive:
                raise _ended(team, log)
            if stop.is_set():
                raise typer.Exit(stop.exit_code)
            domain.refuse_other_publishers()  # those that came meanwhile
    return listener


def _replay(
    player: Replayer,
    team: RunningTeam,
    live: LivePeople,
    executor: Executor,
    stop: Stop,
    on_progress: OnProgress,
) -> bool:
    """Plays the bag, and listens until what is under way after its end has come.

    Returns:
        Whether all processes of the team have lasted.
    """

    def report(now: Progress) -> None:
        on_progress(max(0.0, now.position_s) / now.duration_s)

    with ThreadPoolExecutor(1) as threads:
        playing = threads.submit(player.play, stop=stop, on_progress=report)
        end, settled_s = math.inf, time.monotonic() + _SILENT_S
        while time.monotonic() < end and not stop.is_set() and not team.ended():
            executor.spin_once(timeout_sec=0.05)
            if live.message is not None:
                settled_s = min(settled_s, time.monotonic() + _SETTLE_S)
            live.troubles_shown = time.monotonic() > settled_s
            if playing.done():
                live.troubles_shown = False  # silence is none any more
                end = min(end, time.monotonic() + _TAIL_S)
        if team.ended():
            stop.set()
            return False
        playing.result()
    return True


class _Domain:
    """Looks for others that publish the topics of the bag or of the team.

    Args:
        node: The node that looks.
        player: The replay of the bag.
        robots: Namespaces of the robots.
        topic: The planner's mrs_people_msgs/People.
    """

    def __init__(self, node: Node, player: Replayer, robots: Sequence[str], topic: str) -> None:
        self._node, self._player = node, player
        self._outputs = {f"/{robot}/points": f"/{robot}/{ROBOT_NODE}" for robot in robots}
        self._outputs[topic] = f"/{PLANNER_NODE}"

    def refuse_other_publishers(self, *, started: bool = True) -> None:
        """Makes sure that there are none.

        Args:
            started: Whether the team's own nodes publish already.

        Raises:
            PeopleLocError: There are.
        """
        ours = {self._node.get_fully_qualified_name(), *self._outputs.values()}
        _refuse_publishers_of_the_bag(self._player, ours)
        own = self._outputs if started else dict.fromkeys(self._outputs, "")
        refuse_other_publishers(self._node, own)


def _refuse_publishers_of_the_bag(player: Replayer, ours: Collection[str]) -> None:
    """Makes sure that the team hears the bag: a replay leaves to others what they publish, too.

    Args:
        player: The replay.
        ours: Full names of our own nodes; a bag may hold what they say.

    Raises:
        PeopleLocError: Somebody else publishes a topic of the bag, or the clock.
    """
    taken = {
        topic: others
        for topic, names in player.taken.items()
        if topic not in _EVERYBODYS and (others := [name for name in names if name not in ours])
    }
    if taken:
        raise other_publishers_error(taken)


def _wait_for_team(
    node: Node, topic: str, team: RunningTeam, log: Any, stop: threading.Event
) -> None:
    """Waits until every process listens to what it should."""
    limit = StartLimit()
    robots = [n.namespace for n in team.processes if n.namespace]
    while not stop.is_set():
        if team.ended():
            raise _ended(team, log)
        deaf = [r for r in robots if not node.count_subscribers(f"/{r}/left/camera_info")]
        unheard = [r for r in robots if not node.count_subscribers(f"/{r}/points")]
        silent = [] if node.count_publishers(topic) else ["planner"]
        if not deaf and not unheard and not silent:
            return
        limit.check({*deaf, *unheard, *silent})
        stop.wait(0.1)


def _ended(team: RunningTeam, log: Any) -> PeopleLocError:
    """What to say of processes that ended by themselves, with what all of them printed."""
    names = ", ".join(f"{n.label} (exit code {c})" for n, c in team.ended().items())
    log.seek(0)
    return PeopleLocError(f"ended by itself: {names}\n{log.read()}")

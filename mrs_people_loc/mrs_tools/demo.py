"""`mrs demo`: a recorded team, replayed through its real processes, and scored."""

from __future__ import annotations

import math
import os
import tempfile
import threading
import time
from collections import Counter, defaultdict
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from mrs_people_loc import messages
from mrs_people_loc.camera import CameraModel, StereoCamera
from mrs_people_loc.config import Team, load_team
from mrs_people_loc.errors import BagError, PeopleLocError
from mrs_people_loc.evaluation import MATCH_DISTANCE, Truth, score, summary
from mrs_people_loc.geometry import Float
from mrs_people_loc.messages import stamp_ns_of
from mrs_tools.bags import BagReader
from mrs_tools.offline import TRUTH_TOPIC, read_estimate, read_truth
from mrs_tools.people import LivePeople
from mrs_tools.plots import TopView, draw_top_view, seen_floor
from mrs_tools.replay import Replayer
from mrs_tools.team import RunningTeam, team_processes

if TYPE_CHECKING:
    from rclpy.node import Node
    from rich.console import Console

#: The nodes get this long to start [s].
_START_S = 60.0
#: What is still under way after the bag's end gets this long [s].
_TAIL_S = 1.5


def default_file(*parts: str) -> Path:
    """A file of the source tree: below this folder, or where this package was installed from."""
    for root in (Path.cwd(), Path(__file__).resolve().parents[2]):
        if root.joinpath(*parts).exists():
            return root.joinpath(*parts)
    return Path(*parts)


class Listener:
    """Keeps what the team says.

    Args:
        node: The ROS node to listen with.

    Attributes:
        people: The `people` messages.
        maps: The `short_term_map` messages, by stamp [ns].
    """

    def __init__(self, node: Node) -> None:
        from mrs_people_msgs.msg import People
        from sensor_msgs.msg import PointCloud2

        self.people: list[Any] = []
        self.maps: dict[int, Any] = {}
        node.create_subscription(People, "people", self.people.append, 100)
        node.create_subscription(PointCloud2, "short_term_map", self._on_map, 100)

    def _on_map(self, message: Any) -> None:
        self.maps[stamp_ns_of(message.header.stamp)] = message


def command(
    bag: Annotated[
        Path | None, typer.Argument(help="A bag of a team. Default: bags/paper_formation.")
    ] = None,
    team: Annotated[
        list[Path] | None,
        typer.Option("--team", "-t", help="Parameter file of its team. Default: config/team.yaml."),
    ] = None,
    rate: Annotated[float, typer.Option(min=0.01, help="Times as fast as recorded.")] = 1.0,
    out: Annotated[Path, typer.Option("--out", "-o", help="The picture.")] = Path("demo.png"),
) -> None:
    """Replay a recorded team through its real processes and compare with the truth.

    Starts one robot_node per robot and the planner, replays the bag to them over DDS, shows the
    people live, then prints who was found and how far off, and draws the last interval.
    """
    from rich.console import Console

    # A recorded team must not speak to robots on the network, nor hear them.
    os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    console = Console(highlight=False, soft_wrap=True)
    bag = bag or default_file("bags", "paper_formation")
    files = team or [default_file("config", "team.yaml")]
    config = load_team(*files)
    truth, views = _read_bag(bag, config)
    listener = _run(bag, files, rate, console)
    complete = [m for m in listener.people if len(m.scans) == len(config.robots)]
    if not complete:
        raise PeopleLocError(
            f"{len(listener.people)} intervals, none of them with scans of all robots: "
            "is the machine too slow? Try --rate 0.5"
        )
    _score(listener.people, truth, console)
    last = max(complete, key=lambda m: stamp_ns_of(m.header.stamp))
    draw_top_view(_top_view(last, listener, truth, views, config), out)
    console.print(f"picture: {out}")


def _run(bag: Path, files: list[Path], rate: float, console: Console) -> Listener:
    """Runs the team on the bag and returns what it said."""
    import rclpy
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.parameter import Parameter
    from rclpy.signals import SignalHandlerOptions
    from rich.live import Live

    from mrs_tools.cli import stop_on_signals

    nodes = team_processes(files, sim_time=True)
    context = Context()
    rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
    node = rclpy.create_node(
        "mrs_demo", context=context, parameter_overrides=[Parameter("use_sim_time", value=True)]
    )
    executor = SingleThreadedExecutor(context=context)
    executor.add_node(node)
    listener, live = Listener(node), LivePeople(node)
    try:
        with (
            tempfile.TemporaryFile("w+") as log,
            stop_on_signals() as stop,
            Replayer(bag, rate=rate, clock=True) as player,
            RunningTeam(nodes, log=log) as team,
        ):
            console.print(f"starting {', '.join(n.label for n in nodes)} ...")
            _wait_for_team(node, team, log, stop)
            player.wait_for_subscribers(stop=stop)
            console.print(f"replaying {bag}")
            with ThreadPoolExecutor(1) as threads:
                playing = threads.submit(player.play, stop=stop)
                with Live(live, console=console, refresh_per_second=5):
                    end = math.inf
                    while time.monotonic() < end and not stop.is_set() and not team.ended():
                        executor.spin_once(timeout_sec=0.05)
                        if playing.done():
                            end = min(end, time.monotonic() + _TAIL_S)
                if team.ended():
                    stop.set()
                    raise _ended(team, log)
                playing.result()
            console.print()
            if stop.is_set():
                raise typer.Exit(stop.exit_code)
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown(context=context)
    return listener


def _wait_for_team(node: Node, team: RunningTeam, log: Any, stop: threading.Event) -> None:
    """Waits until every process listens to what it should."""
    deadline = time.monotonic() + _START_S
    robots = [n.namespace for n in team.processes if n.namespace]
    while not stop.is_set():
        if team.ended():
            raise _ended(team, log)
        deaf = [r for r in robots if not node.count_subscribers(f"/{r}/left/camera_info")]
        unheard = [r for r in robots if not node.count_subscribers(f"/{r}/points")]
        if not deaf and not unheard and node.count_publishers("people"):
            return
        if time.monotonic() > deadline:
            waiting = ", ".join(sorted({*deaf, *unheard}) or ["planner"])
            raise PeopleLocError(f"not ready after {_START_S:.0f} s: {waiting}")
        stop.wait(0.1)


def _ended(team: RunningTeam, log: Any) -> PeopleLocError:
    """What to say of processes that ended by themselves, with what all of them printed."""
    names = ", ".join(f"{n.label} (exit code {c})" for n, c in team.ended().items())
    log.seek(0)
    return PeopleLocError(f"ended by itself: {names}\n{log.read()}")


def _read_bag(path: Path, config: Team) -> tuple[Truth, dict[str, Float]]:
    """Ground truth, and what each robot's camera sees of the floor."""
    infos: dict[str, CameraModel] = {}
    with BagReader(path) as bag:
        wanted = [t for t in bag.topics if t.endswith(("left/camera_info", "right/camera_info"))]
        missing = [r for r in config.robots if f"/{r}/left/camera_info" not in wanted]
        if missing:
            raise BagError(
                f"{path}: has no camera_info of {', '.join(missing)}; "
                f"topics: {', '.join(bag.topics)}"
            )
        for topic, _, message in bag.decoded(wanted):
            if topic not in infos:
                infos[topic] = messages.read_camera_info(message)
        truth = read_truth(bag)
    views = {}
    for robot, settings in config.robots.items():
        left, right = (infos[f"/{robot}/{camera}/camera_info"] for camera in ("left", "right"))
        camera = StereoCamera.from_models(left, right, mounting=settings.mounting)
        reach = settings.disparity
        views[robot] = seen_floor(camera, reach.min_range, reach.max_range)
    return truth, views


def _score(people: list[Any], truth: Truth, console: Console) -> None:
    """Prints found and expected people, and each one's error."""
    from rich.table import Table

    if not len(truth):
        console.print(f"the bag has no {TRUTH_TOPIC}: nothing to compare with")
        return
    frames = score(truth, [read_estimate(message) for message in people])
    errors: defaultdict[int, list[float]] = defaultdict(list)
    expected: Counter[int] = Counter()
    for frame in frames:
        expected.update(np.flatnonzero(frame.required).tolist())
        for which, distance in zip(frame.pairs[:, 1], frame.errors, strict=True):
            errors[int(which)].append(float(distance))
    table = Table(title="against the ground truth", title_justify="left")
    for column in ("person", r"true x, y \[m]", "found / expected", "mean error", "max error"):
        table.add_column(column, justify="right")
    for index, count in sorted(expected.items()):
        own = errors[index]
        x, y = truth.positions[-1][index]
        mean = f"{100 * np.mean(own):.1f} cm" if own else "-"
        most = f"{100 * max(own):.1f} cm" if own else "-"
        table.add_row(str(index + 1), f"{x:.2f}, {y:.2f}", f"{len(own)} / {count}", mean, most)
    console.print(table)
    report = summary(frames)["people"]
    if not report["matched"]:
        raise PeopleLocError(f"none of {report['true']} people was found")
    mean = f"{100 * report['error_m']['mean']:.1f} cm" if report["matched"] else "-"
    console.print(
        f"found {report['matched']} of {report['true']} people in {len(frames)} frames of the "
        f"ground truth, {report['found'] - report['matched']} false; mean error {mean} "
        f"(a match is within {MATCH_DISTANCE:.2f} m)"
    )


def _top_view(
    message: Any,
    listener: Listener,
    truth: Truth,
    views: dict[str, Float],
    config: Team,
) -> TopView:
    stamp_ns = stamp_ns_of(message.header.stamp)
    cells = listener.maps.get(stamp_ns)
    if cells is None:
        raise PeopleLocError("the planner's short_term_map of the last interval did not arrive")
    names = [f.name for f in cells.fields]
    # Our own topic: every field has four bytes, floats first, whole numbers after them.
    kinds = {7: "<f4", 6: "<u4", 5: "<i4"}
    layout = np.dtype([(f.name, kinds[f.datatype]) for f in cells.fields])
    records = np.frombuffer(cells.data, layout)
    assert {"x", "y", "robot", "cluster", "person"} <= set(names)
    sigmas = config.planner.human.circle_sigmas
    people = read_estimate(message)
    true, visible = truth.at(stamp_ns)
    return TopView(
        title=f"{len(people.positions)} people found by {len(message.scans)} robots",
        xy=np.stack([records["x"], records["y"]], axis=1).astype(np.float64),
        robot=records["robot"],
        cluster=records["cluster"],
        person=records["person"],
        robots=messages.read_people_scans(message),
        views=views,
        people=people.positions,
        radii=[sigmas * p.sigma for p in message.persons],
        truth=true,
        visible=visible,
        circle_sigmas=sigmas,
    )

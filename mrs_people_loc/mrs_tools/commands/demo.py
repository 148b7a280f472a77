"""`mrs demo`: a recorded team, replayed through its real processes, and scored."""

from __future__ import annotations

import dataclasses
import math
import tempfile
import threading
import time
from bisect import bisect_right
from collections import Counter, defaultdict
from collections.abc import Collection, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from mrs_people_loc import messages
from mrs_people_loc.config import PLANNER_NODE, ROBOT_NODE, Team, load_team
from mrs_people_loc.errors import BagError, PeopleLocError
from mrs_people_loc.geometry import Float
from mrs_people_loc.messages import stamp_ns_of
from mrs_people_loc.sensing.camera import CameraModel, StereoCamera
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_ros.processes import RunningTeam, team_processes
from mrs_tools.bags.offline import (
    TRUTH_TOPIC,
    file_beside,
    read_estimate,
    read_grid,
    read_people,
    read_truth,
)
from mrs_tools.bags.rosbag import BagReader
from mrs_tools.commands.people import LivePeople
from mrs_tools.commands.replay import Replayer
from mrs_tools.domain import meet_others, private_domain, refuse_others, somebody_else
from mrs_tools.figures.animation import animate, said, with_trails
from mrs_tools.figures.plots import TopView, draw_top_view, seen_floor
from mrs_tools.installing import default_file
from mrs_tools.plain import plain
from mrs_tools.scoring.positions import MATCH_DISTANCE, Truth, score, summary
from mrs_tools.scoring.tracks import score_tracks

if TYPE_CHECKING:
    from rclpy.node import Node
    from rich.console import Console

#: The nodes get this long to start [s].
_START_S = 60.0
#: What is still under way after the bag's end gets this long [s].
_TAIL_S = 1.5
#: A machine that is too slow for this share of the frames is said to be.
_FEW = 0.05
#: Every node may publish these, and none of ours listens to them.
_EVERYBODYS = {"/rosout", "/parameter_events", "/diagnostics"}
#: What is drawn of the cells, of which there may be none.
_NO_CELLS = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("robot", "<u4"), ("cluster", "<i4"), ("person", "<i4")]
)


class Listener:
    """Keeps what the team says.

    Args:
        node: The ROS node to listen with.

    Attributes:
        people: The `people` messages.
        events: The `events`, with the ROS time at which they came [ns].
        maps: The `short_term_map` messages, by stamp [ns].
    """

    def __init__(self, node: Node) -> None:
        from mrs_people_msgs.msg import People
        from sensor_msgs.msg import PointCloud2
        from std_msgs.msg import String

        self._node = node
        self.people: list[Any] = []
        self.events: list[tuple[int, str]] = []
        self.maps: dict[int, Any] = {}
        node.create_subscription(People, "people", self.people.append, 100)
        node.create_subscription(String, "events", self._on_event, 100)
        node.create_subscription(PointCloud2, "short_term_map", self._on_map, 100)

    def _on_event(self, message: Any) -> None:
        self.events.append((self._node.get_clock().now().nanoseconds, message.data))

    def _on_map(self, message: Any) -> None:
        self.maps[stamp_ns_of(message.header.stamp)] = message


def command(
    bag: Annotated[
        Path | None, typer.Argument(help="A bag of a team. Default: bags/walking_group.")
    ] = None,
    team: Annotated[
        list[Path] | None,
        typer.Option(
            "--team",
            "-t",
            help="Parameter file of its team. Default: the one beside the bag; without one, "
            "config/team.yaml.",
        ),
    ] = None,
    rate: Annotated[float, typer.Option(min=0.01, help="Times as fast as recorded.")] = 1.0,
    out: Annotated[
        Path, typer.Option("--out", "-o", help="The picture; the animation goes beside it.")
    ] = Path("demo.png"),
) -> None:
    """Replay a recorded team through its real processes and compare with the truth.

    Starts one robot_node per robot and the planner, replays the bag to them over DDS, shows the
    people live, then prints who was found and followed, how far off, and what happened to the
    group. Draws one interval as a PNG and all of them as a GIF.
    """
    from rich.console import Console

    console = Console(highlight=False, soft_wrap=True)
    check_pictures(out)
    bag = bag or default_file("bags", "walking_group")
    beside = file_beside(bag)
    files = team or [beside or default_file("config", "team.yaml")]
    config = load_team(*files)
    recorded = _read_bag(bag, config)
    with private_domain() as where:
        console.print(where)
        listener = _run(bag, files, rate, console)
    people = sorted(listener.people, key=_stamp_of)
    if not any(len(message.scans) == len(config.robots) for message in people):
        raise PeopleLocError(
            f"{len(people)} intervals, none of them with scans of all robots: "
            "is the machine too slow? Try --rate 0.5"
        )
    views = _views(people, listener, recorded, config)
    _score(people, recorded.truth, console)
    _tell(views, console)
    _draw(views, len(config.robots), out, console)


def check_pictures(path: Path) -> None:
    """Checks that a picture, and an animation beside it, can be written.

    Raises:
        PeopleLocError: They cannot.
    """
    from matplotlib.backend_bases import FigureCanvasBase

    kinds = sorted(set(FigureCanvasBase.get_supported_filetypes()) - {"gif"})
    if path.suffix.lower().lstrip(".") not in kinds:
        raise PeopleLocError(f"--out {path}: wanted: a name that ends in .{', .'.join(kinds)}")
    for file in (path, path.with_suffix(".gif")):
        if file.is_dir():
            raise PeopleLocError(f"--out {path}: {file} is a folder; wanted: a file")
        if not file.parent.is_dir():
            raise PeopleLocError(f"--out {path}: {file}: there is no folder {file.parent}")
        new = not file.exists()
        try:
            file.open("ab").close()
            if new:
                file.unlink()
        except OSError as err:
            why = err.strerror or err
            raise PeopleLocError(f"--out {path}: {file}: cannot be written ({why})") from err


def _stamp_of(message: Any) -> int:
    return stamp_ns_of(message.header.stamp)


def _run(bag: Path, files: list[Path], rate: float, console: Console) -> Listener:
    """Runs the team on the bag and returns what it said."""
    import rclpy
    from rclpy.context import Context
    from rclpy.executors import SingleThreadedExecutor
    from rclpy.parameter import Parameter
    from rclpy.signals import SignalHandlerOptions
    from rich.live import Live

    from mrs_ros.network import use_shipped_profile
    from mrs_tools.cli import stop_on_signals

    nodes = team_processes(files, sim_time=True)
    robots = [n.namespace for n in nodes if n.namespace]
    outputs = {f"/{robot}/points": f"/{robot}/{ROBOT_NODE}" for robot in robots}
    outputs["/people"] = f"/{PLANNER_NODE}"
    ours = {"/mrs_demo", *outputs.values()}
    use_shipped_profile()
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
            ExitStack() as stack,
        ):
            # Before four nodes begin to speak in somebody's domain.
            meet_others(node)
            _refuse_takers(player, ours)
            refuse_others(node, dict.fromkeys(outputs, ""))
            team = stack.enter_context(RunningTeam(nodes, log=log))
            console.print(f"starting {', '.join(n.label for n in nodes)} ...")
            _wait_for_team(node, team, log, stop)
            player.wait_for_subscribers(stop=stop)
            _refuse_takers(player, ours)
            refuse_others(node, outputs)
            console.print(f"replaying {bag}")
            with ThreadPoolExecutor(1) as threads:
                playing = threads.submit(player.play, stop=stop)
                with Live(live, console=console, refresh_per_second=5):
                    end = math.inf
                    while time.monotonic() < end and not stop.is_set() and not team.ended():
                        executor.spin_once(timeout_sec=0.05)
                        if playing.done():
                            live.troubles_shown = False  # silence is none any more
                            end = min(end, time.monotonic() + _TAIL_S)
                if team.ended():
                    stop.set()
                    raise _ended(team, log)
                playing.result()
            console.print()
            if stop.is_set():
                raise typer.Exit(stop.exit_code)
            _refuse_takers(player, ours)  # who came meanwhile
            refuse_others(node, outputs)
    finally:
        executor.shutdown()
        node.destroy_node()
        rclpy.shutdown(context=context)
    return listener


def _refuse_takers(player: Replayer, ours: Collection[str]) -> None:
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
        raise somebody_else(taken)


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


@dataclass(frozen=True)
class _Recorded:
    """What a bag itself tells.

    Attributes:
        truth: The ground truth.
        grid: Walls and furniture; None: it says nothing of them.
        borders: By robot, what its camera sees of the floor, in its base_link [m].
    """

    truth: Truth
    grid: OccupancyGrid | None
    borders: dict[str, Float]


def _read_bag(path: Path, config: Team) -> _Recorded:
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
        truth, grid = read_truth(bag), read_grid(bag, config.planner.map_frame)
    borders = {}
    for robot, settings in config.robots.items():
        left, right = (infos[f"/{robot}/{camera}/camera_info"] for camera in ("left", "right"))
        camera = StereoCamera.from_models(left, right, mounting=settings.mounting)
        reach = settings.disparity
        borders[robot] = seen_floor(camera, reach.min_range, reach.max_range)
    return _Recorded(truth, grid, borders)


def _score(people: list[Any], truth: Truth, console: Console) -> None:
    """Prints found and expected people, and each one's error."""
    from rich.table import Table

    if not len(truth):
        console.print(f"the bag has no {TRUTH_TOPIC}: nothing to compare with")
        return
    estimates = [read_estimate(message) for message in people]
    frames = score(truth, estimates)
    errors: defaultdict[int, list[float]] = defaultdict(list)
    ids: defaultdict[int, list[int]] = defaultdict(list)
    expected: Counter[int] = Counter()
    for frame in frames:
        expected.update(np.flatnonzero(frame.required).tolist())
        for (found, which), distance in zip(frame.pairs, frame.errors, strict=True):
            assert frame.estimate is not None
            errors[int(which)].append(float(distance))
            who = int(estimates[frame.estimate].ids[found])
            if who and who not in ids[int(which)]:
                ids[int(which)].append(who)
    table = Table(title="against the ground truth", title_justify="left")
    for column in ("person", "id", "found / expected", "mean error", "max error"):
        table.add_column(column, justify="right")
    for index, count in sorted(expected.items()):
        own = errors[index]
        mean = f"{100 * np.mean(own):.1f} cm" if own else "-"
        most = f"{100 * max(own):.1f} cm" if own else "-"
        names = ", ".join(map(str, ids[index])) or "-"
        table.add_row(str(index + 1), names, f"{len(own)} / {count}", mean, most)
    console.print(table)
    report = summary(frames)["people"]
    if not report["matched"]:
        raise PeopleLocError(f"none of {report['true']} people was found")
    console.print(
        f"found {report['matched']} of {report['true']} people in {len(frames)} frames of the "
        f"ground truth, {report['estimates'] - report['matched']} false; mean error "
        f"{100 * report['error_m']['mean']:.1f} cm (a match is within {MATCH_DISTANCE:.2f} m)"
    )
    late = sum(frame.estimate is None for frame in frames)
    if late > _FEW * len(frames):
        console.print(
            f"the machine was too busy for {late} frames; --rate 0.5 gives it more time",
            style="yellow",
        )
    tracks = score_tracks(truth, frames, estimates).report()
    if tracks["id_switches"] is not None:
        speed = tracks["velocity_error_mps"]["mean"]
        console.print(
            f"followed: {tracks['id_switches']} id switches, MOTA {tracks['mota']:.3f}, "
            f"IDF1 {tracks['idf1']:.3f}"
            + ("" if speed is None else f"; mean error of velocity {speed:.2f} m/s")
        )


def _tell(views: Sequence[TopView], console: Console) -> None:
    """Prints what has happened to the groups."""
    for view in views:
        at_s = (view.stamp_ns - views[0].stamp_ns) / 1e9
        for event in view.events:
            console.print(f"after {at_s:4.1f} s: {plain(event)}", markup=False)


def _draw(views: Sequence[TopView], robots: int, out: Path, console: Console) -> None:
    """Draws one interval and all of them.

    The one has all robots, and as many people as there were. Of several it is the last; if
    somebody fell behind, the one where he was farthest from his group.
    """
    whole = [view for view in with_trails(views) if len(view.robots) == robots]
    most = max(len(view.people) for view in whole)
    whole = [view for view in whole if len(view.people) == most]
    shown = max(reversed(whole), key=_farthest_behind)
    at_s = (shown.stamp_ns - views[0].stamp_ns) / 1e9
    draw_top_view(dataclasses.replace(shown, title=f"after {at_s:.1f} s: {said(shown)}"), out)
    console.print(f"picture: {out}")
    film = out.with_suffix(".gif")
    with console.status("drawing the animation"):
        animate(views, film)
    console.print(f"animation: {film}")


def _farthest_behind(view: TopView) -> float:
    """How far stragglers are from the centres of their groups [m]; 0: there is none."""
    places = {person.id: person.position for person in view.people}
    return max(
        (
            float(np.hypot(*(places[who] - group.centre)))
            for group in view.groups
            for who in group.stragglers
            if who in places
        ),
        default=0.0,
    )


def _views(
    people: Sequence[Any], listener: Listener, recorded: _Recorded, config: Team
) -> list[TopView]:
    """The map of each interval; each event is that of the last interval before it was heard."""
    stamps_ns = [_stamp_of(message) for message in people]
    events: defaultdict[int, list[str]] = defaultdict(list)
    for heard_ns, event in listener.events:
        events[max(0, bisect_right(stamps_ns, heard_ns) - 1)].append(event)
    return [
        _top_view(message, listener.maps.get(stamp_ns), recorded, config, events[index])
        for index, (stamp_ns, message) in enumerate(zip(stamps_ns, people, strict=True))
    ]


def _top_view(
    message: Any,
    cells: Any,
    recorded: _Recorded,
    config: Team,
    events: Sequence[str],
) -> TopView:
    if cells is None:
        records = np.empty(0, _NO_CELLS)
    else:
        # Our own topic: every field has four bytes, floats first, whole numbers after them.
        kinds = {7: "<f4", 6: "<u4", 5: "<i4"}
        layout = np.dtype([(f.name, kinds[f.datatype]) for f in cells.fields])
        records = np.frombuffer(cells.data, layout)
    stamp_ns = _stamp_of(message)
    people, groups = read_people(message)
    true, visible = recorded.truth.at(stamp_ns)
    return TopView(
        title="",
        stamp_ns=stamp_ns,
        xy=np.stack([records["x"], records["y"]], axis=1).astype(np.float64),
        robot=records["robot"],
        cluster=records["cluster"],
        person=records["person"],
        robots=messages.read_people_scans(message),
        views=recorded.borders,
        people=people,
        groups=groups,
        truth=true,
        circle_sigmas=config.planner.human.circle_sigmas,
        visible=visible,
        events=events,
        grid=recorded.grid,
    )

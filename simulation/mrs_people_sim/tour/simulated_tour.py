"""Runs a simulated tour: the live world, the real processes of the team, and the client."""

from __future__ import annotations

import dataclasses
import os
import tempfile
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import AbstractContextManager, ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO, TYPE_CHECKING, Any

import yaml

from mrs_people_loc.config import GUIDE_NODE, PEOPLE_TOPICS, PLANNER_NODE
from mrs_people_loc.errors import PeopleLocError
from mrs_people_loc.guiding.guidance import GOES_ON, HALTS
from mrs_people_sim.guided import GuidedWorld
from mrs_people_sim.live_world import LiveWorld, Progress
from mrs_people_sim.scene import Scene
from mrs_people_sim.start_limit import StartLimit
from mrs_people_sim.tour.trouble import Kill
from mrs_people_sim.views.stage import Stage
from mrs_people_sim.writer import team_parameters
from mrs_ros.processes import NodeProcess, RunningTeam, team_processes
from mrs_tools.bags.recorder import Recorder
from mrs_tools.diagnosis.load import Load
from mrs_tools.live.tour_client import guide
from mrs_tools.live.tour_view import TourView
from mrs_tools.plain import plain
from mrs_tools.tool_node import node, spinning

if TYPE_CHECKING:
    from rclpy.executors import Executor
    from rclpy.node import Node
    from rich.console import Console

#: The recording goes on for so long after the tour [s].
_AFTER_S = 1.0
#: That it goes slower than real time is told every so often [s].
_TELL_S = 10.0
#: What a recording has, and what it has with images, too.
_TOPICS = (
    "/tracked_people", "/events", "/guide_status", "/map", "/diagnostics", "/team_poses",
    "/relative_poses", "/ground_truth/*", "/*/odom", "/*/pose", "/*/points", "/*/cmd_vel",
)  # fmt: skip
_IMAGES = "/*/image_*", "/*/camera_info", "/*/sonar_*", "/*/scan"


@dataclass(frozen=True)
class Plan:
    """What is simulated.

    Attributes:
        scene: The scene (`guided.guided_scene`).
        poses: Where the team takes its poses from, one of `light.guided_tour.POSES`.
        kills: Which processes are killed.
        duration_s: The tour is cancelled after so long [s].
        images: Whether images are recorded, too.
    """

    scene: Scene
    poses: str
    kills: Sequence[Kill] = ()
    duration_s: float = float("inf")
    images: bool = False


def run_tour(
    plan: Plan,
    bag: Path,
    stop: threading.Event,
    console: Console,
    watching: AbstractContextManager[object],
) -> Any:
    """Simulates a tour and records it.

    Args:
        plan: What is simulated.
        bag: Where to.
        stop: Cancels the tour when it is set.
        console: Where the tour is shown.
        watching: Entered when the team starts, and left before it ends.

    Returns:
        The mrs_people_msgs/GuideTour_Result; None: it was stopped before the tour began.

    Raises:
        PeopleLocError: A process ends by itself, the team is not ready in time, guide_node refuses
            the tour, or the bag cannot be written.
    """
    from rclpy.parameter import Parameter

    mode = "exact" if plan.poses == "exact" else "drift"
    odometry = dataclasses.replace(plan.scene.odometry, mode=mode)
    plan = dataclasses.replace(plan, scene=dataclasses.replace(plan.scene, odometry=odometry))
    with ExitStack() as stack:
        folder = Path(stack.enter_context(tempfile.TemporaryDirectory()))
        log = stack.enter_context((folder / "log").open("w+"))
        team_file = folder / "team.yaml"
        team_file.write_text(yaml.safe_dump(team_of(plan)), encoding="utf-8")
        world = stack.enter_context(LiveWorld(plan.scene))
        nodes = team_processes([team_file], sim_time=True, guide=True)
        team = stack.enter_context(RunningTeam(nodes, log=log))
        console.print(f"starting the world, {', '.join(one.label for one in nodes)} ...")
        simulated = [Parameter("use_sim_time", value=True)]
        ros = stack.enter_context(node("mrs_tour", parameter_overrides=simulated))
        stack.enter_context(watching)
        executor = stack.enter_context(spinning(ros))
        run = _Run(plan, world, team, ros, executor, log, console)
        run.wait_for_team(stop)
        if stop.is_set():
            return None
        recorder = stack.enter_context(_recording(bag, plan.images))
        run.wait_for_recorder(recorder, stop)
        return run.tour(stop)


def team_of(plan: Plan) -> dict[str, Any]:
    """Parameters of the simulated team, as a ROS 2 parameter file holds them."""
    world = GuidedWorld(plan.scene)
    starts = {name: wheels.map_from_odom for name, wheels in world.wheels.items()}
    document = team_parameters(Stage(plan.scene), starts)
    for name in world.names:
        parameters = document[f"/{name}/robot_node"]["ros__parameters"]
        if plan.poses == "odometry":
            parameters["localization"] = {"run": "never"}
        elif plan.poses == "localized":
            parameters.setdefault("walls", {})["occupancy_grid"] = True
    # A team that guides has a map.
    planner = document[f"/**/{PLANNER_NODE}"]["ros__parameters"]
    planner["masking"] = {"occupancy_grid": True}
    guide_parameters: dict[str, Any] = {"robots": world.names}
    if world.looks_back:
        guide_parameters["looks_back"] = list(world.looks_back)
    document[f"/**/{GUIDE_NODE}"] = {"ros__parameters": guide_parameters}
    return document


@contextmanager
def _recording(bag: Path, images: bool) -> Iterator[Recorder]:
    """Records into a bag, at the time of the world, in a thread, while the context lasts."""
    stop = threading.Event()
    with (
        Recorder(bag, [*_TOPICS, *(_IMAGES if images else ())], simulated=True) as recorder,
        ThreadPoolExecutor(1) as threads,
    ):
        running = threads.submit(recorder.run, stop=stop)
        try:
            yield recorder
            time.sleep(_AFTER_S)
        finally:
            stop.set()
            running.result()


class _Run:
    """A tour under way."""

    def __init__(
        self,
        plan: Plan,
        world: LiveWorld,
        team: RunningTeam,
        ros: Node,
        executor: Executor,
        log: IO[str],
        console: Console,
    ) -> None:
        from mrs_people_msgs.msg import People
        from std_msgs.msg import String

        from mrs_ros.qos import STREAM

        self._plan, self._world, self._team = plan, world, team
        self._ros, self._executor, self._log, self._console = ros, executor, log, console
        self._killed: set[NodeProcess] = set()
        self._began_ns: int | None = None
        self._told_s, self._told = 0.0, Progress()
        self._robots_in_use: set[str] = set()
        ros.create_subscription(People, PEOPLE_TOPICS[0], self._on_people, STREAM)
        ros.create_subscription(String, "events", self._on_event, 100)

    def now_ns(self) -> int:
        """Time of the world [ns]."""
        return int(self._ros.get_clock().now().nanoseconds)

    def wait_for_team(self, stop: threading.Event) -> None:
        """Waits until the planner uses scans of all robots, and the guide is there."""
        limit = StartLimit()
        while not stop.is_set() and (waiting := self._missing()):
            self._spin(stop)
            slow = self._world.progress.pace()
            try:
                limit.check(waiting, *([slow] if slow else []))
            except PeopleLocError as err:
                raise PeopleLocError(f"{err}\n{self._printed()}") from err

    def wait_for_recorder(self, recorder: Recorder, stop: threading.Event) -> None:
        """Waits until the recording has people."""
        limit = StartLimit()
        while not stop.is_set() and not recorder.counts.get(f"/{PEOPLE_TOPICS[0]}"):
            self._spin(stop)
            limit.check({"the recording"})

    def tour(self, stop: threading.Event) -> Any:
        """Guides; see `run_tour`."""
        tour = GuidedWorld(self._plan.scene).tour
        self._began_ns, before = self.now_ns(), self._cpu_s()
        began_s, progress = time.monotonic(), self._world.progress
        with TourView(self._console, tour) as view:
            result = guide(
                self._ros, tour, spin=lambda: self._spin(stop), stop=stop, show=view.show
            )
        self._report_load(before, time.monotonic() - began_s)
        slow = self._world.progress.pace(progress)
        self._console.print(f"{slow}, {Load.now()}" if slow else "in real time")
        return result

    def _cpu_s(self) -> dict[str, float]:
        """Processor time of each process [s]."""
        progress = self._world.progress
        team = {one.label: _cpu_s(process.pid) for one, process in self._team.processes.items()}
        world = {"world": progress.world_cpu_s, "cameras": progress.cameras_cpu_s}
        return {**team, **world, "recording": time.process_time()}

    def _report_load(self, before: Mapping[str, float], lasted_s: float) -> None:
        """Says how many processors were used.

        Args:
            before: `_cpu_s` at the beginning.
            lasted_s: Real time since then [s].
        """
        used = {
            name: (cpu_s - before[name]) / lasted_s
            for name, cpu_s in self._cpu_s().items()
            if cpu_s > before[name]  # not started again meanwhile
        }
        parts = ", ".join(f"{name} {share:.2f}" for name, share in used.items())
        self._console.print(f"processors used: {sum(used.values()):.2f} ({parts})")

    def _missing(self) -> set[str]:
        there = self._ros.count_publishers("/guide_status")
        return set(self._plan.scene.robots) - self._robots_in_use | (set() if there else {"guide"})

    def _on_people(self, message: Any) -> None:
        self._robots_in_use = {scan.robot for scan in message.scans}

    def _on_event(self, message: Any) -> None:
        event = plain(message.data)
        if not event.startswith(HALTS) and event != GOES_ON:  # the view shows these as states
            self._say(event)

    def _say(self, text: str) -> None:
        from rich.text import Text

        self._console.print(Text(f"{self._time_s():6.1f} s  {text}"))

    def _time_s(self) -> float:
        """Since the tour began, by the time of the world [s]."""
        return 0.0 if self._began_ns is None else (self.now_ns() - self._began_ns) / 1e9

    def _spin(self, stop: threading.Event) -> None:
        """Lets the node work for a moment, and looks after the processes."""
        self._executor.spin_once(timeout_sec=0.1)
        if self._world.exit_code is not None:
            raise PeopleLocError("the simulated world has ended by itself")
        ended = self._team.ended().keys() - self._killed
        if ended:
            names = ", ".join(sorted(one.label for one in ended))
            raise PeopleLocError(f"{names} ended by itself\n{self._printed()}")
        if self._began_ns is None:
            return
        for kill in self._plan.kills:
            self._make(kill)
        if self._time_s() > self._plan.duration_s:
            stop.set()
        self._tell_slowness()

    def _make(self, kill: Kill) -> None:
        """Kills a process, or starts it again, when it is time to."""
        (process,) = (one for one in self._team.processes if one.label == kill.who)
        now_s, is_back = self._time_s(), kill.back_s is not None and self._time_s() >= kill.back_s
        if process in self._killed and is_back:
            self._killed.remove(process)
            self._team.start(process)
            self._say(f"{kill.who} is started again")
        elif process not in self._killed and now_s >= kill.at_s and not is_back:
            self._killed.add(process)
            self._team.processes[process].kill()
            self._say(f"{kill.who} is killed")

    def _tell_slowness(self) -> None:
        """Says so where this is slower than real time."""
        now_s = time.monotonic()
        if now_s < self._told_s + _TELL_S:
            return
        progress, before = self._world.progress, self._told
        self._told_s, self._told = now_s, progress
        if before.time and (slow := progress.pace(before)):
            self._say(f"{slow}: {Load.now()}")

    def _printed(self) -> str:
        """What the processes of the team printed, its end."""
        self._log.seek(0)
        return "".join(self._log.readlines()[-20:])


def _cpu_s(pid: int) -> float:
    """Processor time of a process [s]; 0 if it has ended."""
    try:
        fields = Path(f"/proc/{pid}/stat").read_text("ascii").rpartition(")")[2].split()
    except OSError:
        return 0.0
    return (int(fields[11]) + int(fields[12])) / os.sysconf("SC_CLK_TCK")

"""`mrs tour`: a group is guided along a tour."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from mrs_people_loc.errors import PeopleLocError
from mrs_tools.plain import plain

if TYPE_CHECKING:
    from rich.console import Console


#: Options of each kind of tour that the other one does not have, by their parameters.
_LIVE = ("namespace",)
_SIMULATED = ("scene", "seed", "poses", "kill", "record", "images", "duration")


def command(
    context: typer.Context,
    file: Annotated[
        Path | None, typer.Argument(metavar="[TOUR.yaml]", help="The way and its stops.")
    ] = None,
    namespace: Annotated[
        str, typer.Option("--namespace", "-n", help="Namespace of guide_node.")
    ] = "",
    simulate: Annotated[
        bool,
        typer.Option(
            "--simulate",
            help="Simulate a scene with its own tour: people who follow, robots with wheels and "
            "rendered heads, and the team's real processes.",
        ),
    ] = False,
    scene: Annotated[
        str, typer.Option(help="With --simulate: a scene file, or the name of one of ours.")
    ] = "guided_corridor",
    seed: Annotated[
        int, typer.Option(help="With --simulate: seed of all random numbers.", min=0)
    ] = 1,
    poses: Annotated[
        str,
        typer.Option(
            help="With --simulate: robots' poses are exact, localized (odometry corrected by "
            "walls, people and the team) or odometry."
        ),
    ] = "exact",
    kill: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME@T[-T2]",
            help="With --simulate: kill a robot's node, planner or guide T seconds after the "
            "tour's beginning, and start it again at T2.",
        ),
    ] = None,
    record: Annotated[
        Path | None, typer.Option(help="With --simulate: keep the recording, a new bag.")
    ] = None,
    images: Annotated[
        bool, typer.Option("--images", help="With --record: with the images, too.")
    ] = False,
    duration: Annotated[
        float, typer.Option(help="With --simulate: cancel the tour after this time [s].", min=1.0)
    ] = 600.0,
) -> None:
    """Guide a group along a tour, by a running guide_node; Ctrl-C cancels the tour.

    Shows how the tour goes on. Exit code 0 if the group has been guided to the end. With --simulate
    everything runs on this machine in real time, and scores are printed at the end.
    """
    if simulate == (file is not None):
        raise typer.BadParameter("give either TOUR.yaml or --simulate")
    given = [name for name in (_LIVE if simulate else _SIMULATED) if _is_given(context, name)]
    if given:
        options = ", ".join(f"--{name}" for name in given)
        applies = "does not apply with" if simulate else "applies only with"
        raise typer.BadParameter(f"{options}: {applies} --simulate")
    if file is not None:
        _guide(file, namespace)
        return
    _simulate(scene, seed, poses, kill or [], record, images, duration)


def _is_given(context: typer.Context, name: str) -> bool:
    source = context.get_parameter_source(name)
    return source is not None and source.name == "COMMANDLINE"


def _guide(file: Path, namespace: str) -> None:
    """Asks guide_node for a tour, and shows it."""
    from rclpy.executors import SingleThreadedExecutor
    from rich.console import Console

    from mrs_people_loc.guiding.tour import read_tour
    from mrs_tools.live.tour_client import guide
    from mrs_tools.live.tour_view import TourView
    from mrs_tools.signals import stop_on_signals
    from mrs_tools.tool_node import node

    tour, console = read_tour(file), Console(stderr=True, soft_wrap=True, highlight=False)
    with node("mrs_tour", namespace=namespace) as made:
        executor = SingleThreadedExecutor(context=made.context)
        executor.add_node(made)
        try:
            with stop_on_signals() as stop, TourView(console, tour) as view:
                result = guide(
                    made,
                    tour,
                    spin=lambda: executor.spin_once(timeout_sec=0.1),
                    stop=stop,
                    show=view.show,
                )
        finally:
            executor.shutdown()
    _report(result, stop.exit_code, console)


def _report(result: Any, exit_code: int, console: Console) -> None:
    """Prints how a tour has ended."""
    from rich.text import Text

    if result is None or (exit_code and not result.finished):
        console.print("cancelled")
        raise typer.Exit(exit_code)
    if not result.finished:
        raise PeopleLocError(plain(result.message))
    console.print(Text(f"finished: {plain(result.message)}", style="green"))
    if result.lost:
        console.print(f"without people {', '.join(map(str, result.lost))}")


def _simulate(
    scene: str,
    seed: int,
    poses: str,
    kills: list[str],
    record: Path | None,
    images: bool,
    duration: float,
) -> None:
    """Simulates a tour, and prints its scores."""
    import tempfile

    import embreex  # noqa: F401  # where it is missing, this says so, and how to get it
    from rich.console import Console

    from mrs_tools.domain import private_domain
    from mrs_tools.evaluation.results import evaluate_bag
    from mrs_tools.evaluation.tables import robots_of_tours_table, tours_table
    from mrs_tools.signals import stop_on_signals
    from mrs_tools.simulation.guided import guided_scene
    from mrs_tools.simulation.light.guided_tour import POSES
    from mrs_tools.tour.simulated_tour import Plan, run_tour
    from mrs_tools.tour.trouble import read_kill

    if poses not in POSES:
        raise typer.BadParameter(f"--poses is {poses!r}; allowed: {', '.join(POSES)}")
    what = guided_scene(_scene_file(scene), seed)
    names = [*what.robots, "planner", "guide"]
    plan = Plan(what, poses, [read_kill(text, names) for text in kills], duration, images)
    console = Console(soft_wrap=True, highlight=False)
    with tempfile.TemporaryDirectory() as folder:
        bag = record or Path(folder, "tour.mcap")
        with private_domain() as where, stop_on_signals() as stop:
            console.print(where)
            result = run_tour(plan, bag, stop, console)
        report = evaluate_bag(bag, recorded=True).report().get("tour")
    if report is not None:
        console.print(tours_table({what.name: report}))
        console.print(robots_of_tours_table({what.name: report}))
    if stop.is_set() and not stop.exit_code and not (result and result.finished):
        raise PeopleLocError(f"cancelled: the {duration:g} s asked for (--duration) are over")
    _report(result, stop.exit_code, console)


def _scene_file(scene: str) -> Path:
    """A scene's file, by its path or by the name of one of ours."""
    from mrs_tools.installing import default_file

    if scene.endswith(".yaml"):
        return Path(scene)
    folder = default_file("scenes")
    path = folder / f"{scene}.yaml"
    if not path.exists():
        ours = ", ".join(sorted(one.stem for one in folder.glob("guided_*.yaml")))
        raise typer.BadParameter(f"--scene is {scene!r}; allowed: a file NAME.yaml, or {ours}")
    return path

"""`mrs simulate`: bags of what the stereo heads of a moving team would see.

    mrs simulate scenes/paper_formation.yaml OUT      one scene
    mrs simulate --suite train OUT_DIR                half of the published suite
    mrs simulate --walks train OUT_DIR                half of its walking groups
    mrs simulate scenes/tour.yaml --live --rate 0.5   published over ROS

Beside each bag `NAME` lies `NAME.yaml`: parameters of the team (mountings, third cameras, where
its odometry starts), for the nodes and for `mrs evaluate --config`.
"""

from __future__ import annotations

import dataclasses
import os
import tempfile
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from mrs_people_loc.config import load_yaml
from mrs_people_loc.errors import ConfigError
from mrs_ros.network import given_domain
from mrs_tools.installing import default_file
from mrs_tools.simulation.layouts import expand
from mrs_tools.simulation.scene import Scene, load_scene, read_scene

if TYPE_CHECKING:
    from mrs_tools.simulation.world import Frame, World

#: Where the published suite is, below the repository or where the package's data was installed.
_SCENES = "scenes"


def simulate(scene: Scene, out: Path, *, jobs: int = 1, on_frame: Any = None) -> World:
    """Renders a scene into a bag, and writes its team's parameters beside it.

    Args:
        scene: The scene, its layout not yet expanded.
        out: A folder, or `NAME.mcap`.
        jobs: Processes.
        on_frame: Called after each frame, without arguments.

    Returns:
        The world.

    Raises:
        BagError: The bag exists already or cannot be written.
        ConfigError: The scene cannot be rendered.
    """
    from mrs_tools.simulation.world import World
    from mrs_tools.simulation.writer import write_bag, write_team

    scene = expand(scene)
    if not scene.robots:
        raise ConfigError(f"{scene.name}: there is no robot in the scene")
    world = World(scene)
    out.parent.mkdir(parents=True, exist_ok=True)
    write_bag(out, world, _counted(render_frames(world, jobs), on_frame))
    write_team(team_file(out), world)
    return world


def team_file(bag: Path) -> Path:
    """The team's parameter file beside a bag."""
    return bag.with_name(f"{bag.name.removesuffix('.mcap')}.yaml")


def render_frames(world: World, jobs: int = 1) -> Iterator[list[Frame]]:
    """What all robots see, frame by frame, rendered by so many processes."""
    indices = range(world.scene.timing.frames)
    if jobs <= 1:
        for index in indices:
            yield [world.render(name, index) for name in world.names]
        return
    with ProcessPoolExecutor(
        jobs, get_context("spawn"), initializer=_start_worker, initargs=(world.scene,)
    ) as pool:
        todo = [(name, index) for index in indices for name in world.names]
        results = pool.map(_render, todo)
        for _ in indices:
            yield [next(results) for _ in world.names]


_world: World | None = None


def _start_worker(scene: Scene) -> None:
    from mrs_tools.simulation.world import World

    global _world
    _world = World(scene)


def _render(job: tuple[str, int]) -> Frame:
    assert _world is not None
    return _world.render(*job)


def _counted(frames: Iterator[list[Frame]], on_frame: Any) -> Iterator[list[Frame]]:
    for frame in frames:
        yield frame
        if on_frame is not None:
            on_frame()


# ------------------------------------------------------------------------------- suite ----


def suite_scenes(file: Path, half: str, *, tracks: Path | None = None) -> list[Scene]:
    """Scenes of one half of a suite.

    Args:
        file: A YAML list of scenes, each with `half: train` or `half: test`; recorded tracks are
            where they say, relative to it.
        half: train, test or all.
        tracks: The folder of recorded tracks (`zara01/obsmat.txt`, ...), instead.

    Raises:
        ConfigError: The file or a scene cannot be used, or the half is empty.
    """
    if half not in ("train", "test", "all"):
        raise ConfigError(f"suite is {half!r}; allowed: train, test, all")
    document = load_yaml(file)
    if not isinstance(document, list):
        raise ConfigError(f"{file}: is not a suite (a list of scenes)")
    scenes = []
    for number, item in enumerate(document):
        scene = read_scene(item, f"{file}, scene {number + 1}")
        if item.get("half") not in ("train", "test"):
            raise ConfigError(f"{file}: scene {scene.name} has no `half: train` or `half: test`")
        if scene.tracks:
            path = Path(scene.tracks)
            path = tracks / path.parent.name / path.name if tracks else file.parent / path
            scene = dataclasses.replace(scene, tracks=str(path))
        if half in ("all", item["half"]):
            scenes.append(scene)
    if not scenes:
        raise ConfigError(f"{file}: no scene of the half {half}")
    return scenes


def variants(scenes: list[Scene], count: int) -> list[Scene]:
    """More scenes of the same kinds, for fitting: `count` of each.

    Each has a seed, furniture and clutter of its own; heads, walls, floor, light, faults of the
    cameras and odometry are those of other scenes of the list, drawn at random. Two frames each.
    From the `_NARROW`th on rooms are narrower, where everybody fits in, so that walls are near.
    """
    result = []
    for number in range(1, count + 1):
        rng = np.random.default_rng([number, 77])
        rooms, imagings, odometries, heads = (rng.permutation(len(scenes)) for _ in range(4))
        for k, scene in enumerate(scenes):
            look = scenes[rooms[k]].room
            room = dataclasses.replace(scene.room, **{name: getattr(look, name) for name in _LOOKS})
            layout = dataclasses.replace(
                scene.layout,
                heads=scenes[heads[k]].layout.heads,
                furniture=int(rng.integers(0, 14)),
                clutter=int(rng.integers(0, 10)),
            )
            variant = dataclasses.replace(
                scene,
                name=f"{scene.name}_{number:02d}",
                seed=scene.seed + 10_000 * number,
                timing=dataclasses.replace(scene.timing, frames=2),
                room=room,
                layout=layout,
                imaging=scenes[imagings[k]].imaging,
                odometry=scenes[odometries[k]].odometry,
            )
            if number >= _NARROW:
                variant = _narrowed(variant, rng)
            result.append(variant)
    return result


#: From this one on variants are in narrower rooms.
_NARROW = 21


def _narrowed(scene: Scene, rng: np.random.Generator) -> Scene:
    """The scene in a narrower room, with less furniture; as it is if people or robots stick out."""
    length, width = rng.uniform(0.65, 0.9), rng.uniform(0.5, 0.8)
    room = dataclasses.replace(
        scene.room, length=scene.room.length * length, width=scene.room.width * width
    )
    layout = dataclasses.replace(scene.layout, furniture=scene.layout.furniture // 3)
    narrow = dataclasses.replace(scene, room=room, layout=layout)
    expanded = expand(narrow)
    places = [(person.x, person.y) for person in expanded.people]
    places += [(robot.x, robot.y) for robot in expanded.robots.values()]
    fits = all(0.3 < x < room.length - 0.3 and 0.3 < y < room.width - 0.3 for x, y in places)
    return narrow if fits else scene


#: What a variant takes from another scene's room.
_LOOKS = ("walls", "floor", "contrast", "wall_shade", "floor_shade", "posters", "lamps", "ambient")


def with_tracks(scenes: list[Scene]) -> tuple[list[Scene], list[str]]:
    """The scenes that can be rendered here, and why others cannot: their tracks are missing."""
    there = [scene for scene in scenes if not scene.tracks or Path(scene.tracks).is_file()]
    missing = [
        f"{scene.name} is left out: no recording {scene.tracks} (--tracks: where the UCY set is)"
        for scene in scenes
        if scene not in there
    ]
    return there, missing


def suite_file(name: str = "suite.yaml") -> Path:
    """A file of the published suite: `suite.yaml`, or `walks.yaml` for its walking groups.

    Raises:
        ConfigError: It is neither below this folder, nor in the source tree, nor installed.
    """
    return default_file(_SCENES, name)


def simulate_suite(
    scenes: list[Scene], folder: Path, *, jobs: int = 1, on_scene: Any = None
) -> list[Path]:
    """Renders scenes into a folder, several at a time; a bag that is there already stays.

    Args:
        scenes: The scenes.
        folder: Where the bags go, each under its scene's name.
        jobs: Processes, each with a scene of its own.
        on_scene: Called with the scene's name after each.

    Returns:
        The bags.

    Raises:
        BagError: A bag cannot be written.
        ConfigError: A scene cannot be rendered.
    """
    folder.mkdir(parents=True, exist_ok=True)
    bags = [folder / scene.name for scene in scenes]
    todo = [(s, bag) for s, bag in zip(scenes, bags, strict=True) if not bag.exists()]
    # The longest first, so that no process is left alone with one at the end.
    todo.sort(
        key=lambda job: -job[0].timing.frames * max(1, job[0].layout.robots, len(job[0].robots))
    )
    if jobs <= 1:
        for job in todo:
            on_scene and on_scene(_simulate_job(job))
        return bags
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        for name in pool.map(_simulate_job, todo):
            on_scene and on_scene(name)
    return bags


def _simulate_job(job: tuple[Scene, Path]) -> str:
    scene, bag = job
    simulate(scene, bag)
    return scene.name


# ------------------------------------------------------------------------ command line ----


def command(
    scene: Annotated[
        Path, typer.Argument(help="Scene file; with --suite: the folder for the bags.")
    ],
    out: Annotated[Path | None, typer.Argument(help="The new bag: a folder, or NAME.mcap.")] = None,
    seed: Annotated[int | None, typer.Option(help="Instead of the scene's.", min=0)] = None,
    frames: Annotated[int | None, typer.Option(help="Instead of the scene's.", min=1)] = None,
    tracks: Annotated[
        Path | None,
        typer.Option(
            help="Recorded pedestrians (obsmat.txt) who walk there, too; with --walks: the folder "
            "of the UCY set."
        ),
    ] = None,
    jobs: Annotated[
        int, typer.Option("--jobs", "-j", help="Processes; 0: one per core.", min=0)
    ] = 0,
    suite: Annotated[
        str, typer.Option(help="Render a half of the published suite: train, test or all.")
    ] = "",
    walks: Annotated[
        str, typer.Option(help="Render a half of the suite's walking groups: train, test or all.")
    ] = "",
    more: Annotated[
        int,
        typer.Option(
            "--variants",
            help="With --suite: not its scenes but so many variants of each, of two frames, to fit "
            "the body model to.",
            min=0,
        ),
    ] = 0,
    live: Annotated[
        bool, typer.Option("--live", help="Publish over ROS when it is rendered.")
    ] = False,
    rate: Annotated[
        float, typer.Option(help="With --live: times as fast as in the scene.", min=0.01)
    ] = 1.0,
    loop: Annotated[
        bool, typer.Option("--loop", help="With --live: begin again at the end, until Ctrl-C.")
    ] = False,
) -> None:
    """Draw what the stereo heads of a team would see, with ground truth.

    Writes a bag and, beside it under the same name, the team's parameter file (.yaml) for the
    nodes and `mrs evaluate --config`. The same scene and seed give the same images. With --live
    the scene is rendered first, then published with its time on /clock (use_sim_time); a bag is
    kept only if OUT is given, too.
    """
    jobs = jobs or os.cpu_count() or 1
    if suite or walks:
        if out is not None:
            raise typer.BadParameter(f"--{'suite' if suite else 'walks'} takes one folder, OUT_DIR")
        if suite and walks:
            raise typer.BadParameter("--suite and --walks are rendered one after the other")
        if more and walks:
            raise typer.BadParameter("--variants goes with --suite")
        if suite:
            scenes = suite_scenes(suite_file(), suite)
        else:
            found = suite_scenes(suite_file("walks.yaml"), walks, tracks=tracks)
            scenes, missing = with_tracks(found)
            for line in missing:
                typer.echo(line, err=True)
        scenes = [_shortened(s, frames) for s in (variants(scenes, more) if more else scenes)]
        with _progress("scenes", len(scenes)) as advance:
            bags = simulate_suite(scenes, scene, jobs=jobs, on_scene=lambda _: advance())
        typer.echo(f"{scene}: {len(bags)} bags")
        return
    if more:
        raise typer.BadParameter("--variants goes with --suite")
    if out is None and not live:
        raise typer.BadParameter("give OUT, the new bag, or --live")
    if live:
        given_domain()
    what = _shortened(load_scene(scene, seed=seed), frames)
    if tracks is not None:
        what = dataclasses.replace(what, tracks=str(tracks))
    with tempfile.TemporaryDirectory() as folder:
        bag = out or Path(folder, what.name)
        with _progress("frames", what.timing.frames) as advance:
            world = simulate(what, bag, jobs=jobs, on_frame=advance)
        people, robots = len(world.people), len(world.names)
        said = (
            f"{what.timing.frames} frame{'s' * (what.timing.frames != 1)} of {robots} "
            f"robot{'s' * (robots != 1)} and {people} {'person' if people == 1 else 'people'}"
        )
        typer.echo(f"{out}: {said}; team: {team_file(out)}" if out else said)
        if live:
            from mrs_tools.commands import replay

            replay.command(bag, rate=rate, loop=loop, clock=True, topics=None, wait=5.0)


def _shortened(scene: Scene, frames: int | None) -> Scene:
    """The scene with so many frames, where a number is given."""
    if frames is None:
        return scene
    return dataclasses.replace(scene, timing=dataclasses.replace(scene.timing, frames=frames))


@contextmanager
def _progress(label: str, total: int) -> Iterator[Any]:
    """A bar on the terminal; yields what moves it on by one."""
    from rich.console import Console
    from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn
    from rich.progress import TimeRemainingColumn as Remaining

    console = Console(stderr=True)
    columns = (TextColumn(label), BarColumn(), MofNCompleteColumn(), Remaining())
    with Progress(*columns, console=console, disable=not console.is_terminal) as bar:
        task = bar.add_task(label, total=total)
        yield lambda: bar.advance(task)

"""`mrs simulate`: bags of what the stereo heads of a moving team would see.

    mrs simulate mrs_people_loc/scenes/paper_formation.yaml OUT      one scene
    mrs simulate --suite train OUT_DIR                half of the published suite
    mrs simulate --walks train OUT_DIR                half of its walking groups
    mrs simulate mrs_people_loc/scenes/tour.yaml --live --rate 0.5   published over ROS

Beside each bag `NAME` lies `NAME.yaml`: parameters of the team (mountings, third cameras, where
its odometry starts), for the nodes and for `mrs evaluate --config`.
"""

from __future__ import annotations

import dataclasses
import tempfile
from pathlib import Path
from typing import Annotated

import typer

from mrs_ros.network import given_domain
from mrs_tools.bags.playing import play_bag
from mrs_tools.common import counting_bar, process_count
from mrs_tools.options import Jobs
from mrs_tools.simulation.render_scene import simulate, team_file
from mrs_tools.simulation.scene import Scene, load_scene
from mrs_tools.simulation.suite_scenes import (
    drawn_from,
    shortened,
    simulate_suite,
    suite_file,
    suite_scenes,
    variants,
    with_tracks,
)


def command(
    scene: Annotated[
        Path, typer.Argument(help="Scene file; with --suite: the folder for the bags.")
    ],
    out: Annotated[Path | None, typer.Argument(help="The new bag: a folder, or NAME.mcap.")] = None,
    seed: Annotated[int | None, typer.Option(help="Seed in place of the scene's.", min=0)] = None,
    frames: Annotated[
        int | None, typer.Option(help="Number of frames in place of the scene's.", min=1)
    ] = None,
    tracks: Annotated[
        Path | None,
        typer.Option(
            help="Recorded pedestrians (obsmat.txt) who walk there, too; with --walks: the folder "
            "of the UCY set."
        ),
    ] = None,
    assets: Annotated[
        Path | None,
        typer.Option(
            help="Folder with meshes and assets.yaml (docs/assets.md): people, and furniture where "
            "there is some of like size, are drawn from it."
        ),
    ] = None,
    jobs: Jobs = 0,
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
            help="With --suite: instead of its scenes this many variants of each, of two frames, "
            "for fitting the body model.",
            min=0,
        ),
    ] = 0,
    live: Annotated[
        bool, typer.Option("--live", help="Publish over ROS once the scene is rendered.")
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
    if suite or walks:
        if out is not None:
            raise typer.BadParameter(f"--{'suite' if suite else 'walks'} takes one folder, OUT_DIR")
        if suite and walks:
            raise typer.BadParameter("--suite and --walks are rendered one after the other")
        if more and walks:
            raise typer.BadParameter("--variants goes with --suite")
        scenes = _suite(suite, more) if suite else _walks(walks, tracks)
        scenes = drawn_from(scenes, assets)
        _render_all([shortened(one, frames) for one in scenes], scene, process_count(jobs))
        return
    if more:
        raise typer.BadParameter("--variants goes with --suite")
    if out is None and not live:
        raise typer.BadParameter("give OUT, the new bag, or --live")
    if live:
        given_domain()
    what = shortened(load_scene(scene, seed=seed), frames)
    (what,) = drawn_from([what], assets)
    if tracks is not None:
        what = dataclasses.replace(what, tracks=str(tracks))
    with tempfile.TemporaryDirectory() as folder:
        bag = out or Path(folder, what.name)
        summary = _render(what, bag, process_count(jobs))
        typer.echo(f"{out}: {summary}; team: {team_file(out)}" if out else summary)
        if live and (code := play_bag(bag, rate=rate, loop=loop, clock=True)):
            raise typer.Exit(code)


def _suite(half: str, more: int) -> list[Scene]:
    scenes = suite_scenes(suite_file(), half)
    return variants(scenes, more) if more else scenes


def _walks(half: str, tracks: Path | None) -> list[Scene]:
    scenes, missing = with_tracks(suite_scenes(suite_file("walks.yaml"), half, tracks=tracks))
    for line in missing:
        typer.echo(line, err=True)
    return scenes


def _render_all(scenes: list[Scene], folder: Path, jobs: int) -> None:
    with counting_bar("scenes", len(scenes)) as advance:
        bags = simulate_suite(scenes, folder, jobs=jobs, on_scene=lambda _: advance())
    typer.echo(f"{folder}: {len(bags)} bags")


def _render(scene: Scene, bag: Path, jobs: int) -> str:
    """Renders a scene and says what is in it."""
    frames = scene.timing.frames
    with counting_bar("frames", frames) as advance:
        world = simulate(scene, bag, jobs=jobs, on_frame=advance)
    people, robots = len(world.people), len(world.names)
    return (
        f"{frames} frame{'s' * (frames != 1)} of {robots} "
        f"robot{'s' * (robots != 1)} and {people} {'person' if people == 1 else 'people'}"
    )

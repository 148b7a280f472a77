"""`mrs simulate`: a bag of what the stereo heads of a moving team would see.

    mrs simulate config/scenes/paper_formation.yaml OUT
    mrs replay OUT --clock                    # publishes it over ROS

Beside the bag `NAME` lies `NAME.yaml`: parameters of the team (mountings, third cameras, where
its odometry starts), for the nodes and for `mrs evaluate --config`.
"""

from __future__ import annotations

import dataclasses
from pathlib import Path
from typing import Annotated

import typer

from mrs_people_sim.common import counting_bar, process_count
from mrs_people_sim.options import Jobs
from mrs_people_sim.render_scene import simulate, team_file
from mrs_people_sim.scene import load_scene


def command(
    scene: Annotated[Path, typer.Argument(metavar="SCENE", help="Scene file.")],
    out: Annotated[
        Path, typer.Argument(metavar="OUT", help="The new bag: a folder, or NAME.mcap.")
    ],
    seed: Annotated[int | None, typer.Option(help="Seed in place of the scene's.", min=0)] = None,
    frames: Annotated[
        int | None, typer.Option(help="Number of frames in place of the scene's.", min=1)
    ] = None,
    tracks: Annotated[
        Path | None, typer.Option(help="Recorded pedestrians (obsmat.txt) who walk there, too.")
    ] = None,
    jobs: Jobs = 0,
) -> None:
    """Draw what the stereo heads of a team would see, with ground truth.

    Writes a bag and, beside it under the same name, the team's parameter file (.yaml) for the
    nodes and `mrs evaluate --config`. The same scene and seed give the same images. `mrs replay
    OUT --clock` publishes the bag.
    """
    what = load_scene(scene, seed=seed)
    if frames is not None:
        what = dataclasses.replace(what, timing=dataclasses.replace(what.timing, frames=frames))
    if tracks is not None:
        what = dataclasses.replace(what, tracks=str(tracks))
    count = what.timing.frames
    with counting_bar("frames", count) as advance:
        world = simulate(what, out, jobs=process_count(jobs), on_frame=advance)
    people, robots = len(world.people), len(world.names)
    typer.echo(
        f"{out}: {count} frame{'s' * (count != 1)} of {robots} robot{'s' * (robots != 1)} and "
        f"{people} {'person' if people == 1 else 'people'}; team: {team_file(out)}"
    )

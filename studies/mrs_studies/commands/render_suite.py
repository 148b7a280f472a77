"""`mrs render-suite`: bags of the published suite, of its walking groups, or of variants for a fit.

    mrs render-suite train .suite/train
    mrs render-suite train .suite/more --variants 12
    mrs render-suite test OUT_DIR --walks

A bag that is there already is not rendered again.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mrs_people_sim.common import counting_bar, process_count
from mrs_people_sim.options import Jobs
from mrs_studies.options import Tracks
from mrs_studies.suite_scenes import (
    simulate_suite,
    suite_file,
    suite_scenes,
    variants,
    with_tracks,
)


def command(
    half: Annotated[str, typer.Argument(help="train, test or all.")],
    folder: Annotated[Path, typer.Argument(help="Where the bags go.")],
    walks: Annotated[
        bool, typer.Option("--walks", help="Render the walking groups instead of the scenes.")
    ] = False,
    tracks: Tracks = None,
    more: Annotated[
        int,
        typer.Option(
            "--variants",
            help="Instead of the scenes this many variants of each, of two frames, for fitting the "
            "body model.",
            min=0,
        ),
    ] = 0,
    jobs: Jobs = 0,
) -> None:
    """Render a half of the published suite: a bag and a parameter file for each scene."""
    if more and walks:
        raise typer.BadParameter("there are variants of the scenes only, not of --walks")
    file = suite_file("walks.yaml" if walks else "suite.yaml")
    scenes, missing = with_tracks(suite_scenes(file, half, tracks=tracks))
    for line in missing:
        typer.echo(line, err=True)
    if more:
        scenes = variants(scenes, more)
    with counting_bar("scenes", len(scenes)) as advance:
        bags = simulate_suite(
            scenes, folder, jobs=process_count(jobs), on_scene=lambda _: advance()
        )
    typer.echo(f"{folder}: {len(bags)} bags")

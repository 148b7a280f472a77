"""`mrs suite`: the published suite, rendered, run and scored; what each step of the method gives.

    mrs suite FOLDER                      the test half with paper.yaml and default.yaml
    mrs suite FOLDER --steps              and every step from the one to the other
    mrs suite FOLDER --steps --out docs/suite.md

Bags that are in the folder already are not rendered again. Recorded walks are left out where the
recordings are not there (--tracks).
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mrs_tools.common import process_count, progress_bar, replace_from
from mrs_tools.experiment.suite_report import markdown
from mrs_tools.experiment.suite_steps import run_suite
from mrs_tools.installing import default_file
from mrs_tools.options import Jobs
from mrs_tools.simulation.suite_scenes import drawn_from, suite_file, suite_scenes, with_tracks


def command(
    folder: Annotated[Path, typer.Argument(help="Where the rendered bags are or go.")],
    half: Annotated[str, typer.Option(help="train, test or all.")] = "test",
    tracks: Annotated[
        Path | None, typer.Option(help="The folder of the UCY set, for the recorded walks.")
    ] = None,
    assets: Annotated[
        Path | None,
        typer.Option(help="Folder with meshes and assets.yaml (docs/assets.md) to draw from."),
    ] = None,
    every_step: Annotated[
        bool, typer.Option("--steps", help="Score every step from the paper's method to ours.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(help="Replace what follows the first table's heading in this file."),
    ] = None,
    jobs: Jobs = 0,
) -> None:
    """Render the published suite, run it with the paper's method and ours, and score both."""
    scenes = suite_scenes(suite_file(), half)
    walks, missing = with_tracks(suite_scenes(suite_file("walks.yaml"), half, tracks=tracks))
    for line in missing:
        typer.echo(line, err=True)
    with progress_bar() as progress:
        task = progress.add_task("", total=1.0)
        rows = run_suite(
            drawn_from([*scenes, *walks], assets),
            folder,
            paper=default_file("config", "paper.yaml"),
            every_step=every_step,
            jobs=process_count(jobs),
            on_progress=lambda what, share: progress.update(
                task, description=what, completed=share
            ),
        )
    text = markdown(rows, half)
    typer.echo(text, nl=False)
    if out is not None:
        replace_from(out, "## Results on", text)

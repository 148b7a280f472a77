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

from mrs_people_sim.common import process_count, progress_bar, replace_from
from mrs_people_sim.options import Jobs
from mrs_studies.experiment.suite_report import markdown
from mrs_studies.experiment.suite_steps import run_suite
from mrs_studies.options import Tracks
from mrs_studies.suite_scenes import suite_file, suite_scenes, with_tracks
from mrs_tools.installing import default_file


def command(
    folder: Annotated[Path, typer.Argument(help="Where the rendered bags are or go.")],
    half: Annotated[str, typer.Option(help="train, test or all.")] = "test",
    tracks: Tracks = None,
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
            [*scenes, *walks],
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

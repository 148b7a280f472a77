"""`mrs experiment`: the paper's section 6, simulated and measured, its figures beside ours."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import Annotated

import typer

from mrs_people_sim.common import process_count, progress_bar, write_json
from mrs_people_sim.options import JsonFile
from mrs_studies.experiment.paper_experiment import SCENES, run_experiment
from mrs_studies.experiment.report import show
from mrs_tools.installing import default_file


def command(
    seed: Annotated[
        int | None, typer.Option(help="Seed of the first draw. Default: the scenes' own.", min=0)
    ] = None,
    draws: Annotated[int, typer.Option(help="Recordings of each scene.", min=1)] = 20,
    frames: Annotated[int, typer.Option(help="Frames of each recording.", min=1)] = 2,
    json_file: JsonFile = None,
    out: Annotated[Path | None, typer.Option("--out", help="Keep the bags in this folder.")] = None,
    jobs: Annotated[
        int, typer.Option("--jobs", "-j", help="Processes that simulate; 0: one per core.", min=0)
    ] = 0,
) -> None:
    """Simulate the paper's experiment, and print its figures beside ours.

    Five people, three robots and a table, and one person 2 m before a robot, with the method as
    printed (config/paper.yaml); where poses are wrong, with config/default.yaml, too. People,
    clothes and textures differ from draw to draw. All figures but the planner's time follow from
    the seed.
    """
    import sys

    from rich.console import Console

    with tempfile.TemporaryDirectory() as folder, progress_bar() as progress:
        task = progress.add_task("", total=1.0)
        report = run_experiment(
            {name: default_file("config", "scenes", file) for name, file in SCENES.items()},
            default_file("config", "paper.yaml"),
            default_file("config", "default.yaml"),
            out or Path(folder),
            seed=seed,
            draws=draws,
            frames=frames,
            jobs=process_count(jobs),
            on_step=lambda part, what: progress.update(task, completed=part, description=what),
        )
    # Without a terminal Rich would take 80 columns.
    show(report, Console(highlight=False, width=None if sys.stdout.isatty() else 100))
    if json_file is not None:
        write_json(json_file, report)

"""`mrs localization`: how well a team knows where it is on tours of 100 m.

mrs localization                                  the table of docs/localization_results.md
mrs localization --seeds 2 --only hall            cases whose name contains a word
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mrs_tools.common import process_count, progress_bar, replace_from, write_json
from mrs_tools.experiment.localization import CASES, run_cases
from mrs_tools.experiment.localization_report import HEADING, markdown


def command(
    seeds: Annotated[
        int,
        typer.Option(help="Tours of each kind.", min=1),
    ] = 10,
    only: Annotated[str, typer.Option(help="Only tours whose name contains this.")] = "",
    out: Annotated[
        Path | None,
        typer.Option(help="Replace what follows the tables' heading in this file."),
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the figures into this file.")
    ] = None,
    jobs: Annotated[
        int, typer.Option("--jobs", "-j", help="Processes; 0: one per core.", min=0)
    ] = 0,
) -> None:
    """Simulate tours of 100 m, and print how well the robots know where they are.

    Corridors, a hall and a loop with five people and three robots, without rendering: what robots
    see of walls and people has the errors of real scans. Beside them tours on which something goes
    wrong, odometry alone, and the people that follow from the poses.
    """
    cases = [case for case in CASES if only in case.name]
    if not cases:
        names = ", ".join(case.name for case in CASES)
        raise typer.BadParameter(f"--only is {only!r}; allowed: a part of a name of {names}")
    reports = []
    with progress_bar() as progress:
        task = progress.add_task(cases[0].name, total=len(cases))
        for scores in run_cases(cases, seeds, jobs=process_count(jobs)):
            reports.append(scores.report())
            following = cases[min(len(reports), len(cases) - 1)].name
            progress.update(task, completed=len(reports), description=following)
    text = markdown(cases, reports)
    typer.echo(text, nl=False)
    if json_file is not None:
        named = zip((case.name for case in cases), reports, strict=True)
        write_json(json_file, dict(named))
    if out is not None:
        replace_from(out, HEADING, text)

"""`mrs real`: recordings of real rooms, run and scored against their hand labels.

mrs real FOLDER                               every labelled recording in FOLDER
mrs real FOLDER --out docs/real_rooms.md      and the tables into the documentation
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mrs_people_sim.common import progress_bar, replace_from, write_json
from mrs_people_sim.options import JsonFile
from mrs_studies import LABELS
from mrs_studies.experiment.real_rooms import as_json, find_recordings, markdown, run_recordings
from mrs_tools.installing import default_file
from mrs_tools.plain import plain


def command(
    folder: Annotated[Path, typer.Argument(help="Bags, with the parameter file of each.")],
    labels: Annotated[
        Path | None,
        typer.Option(
            help="Label files of bags that have none beside them.", show_default="studies/labels"
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(help="Replace all from the heading `## Results` on in this file."),
    ] = None,
    json_file: JsonFile = None,
) -> None:
    """Run recordings of real rooms with the default and the paper's method, and score both.

    Recordings that have no labels, or are not in the folder, are named. JSON: by recording the
    figures with people followed and interval by interval, and which of the two the table has.
    """
    found, left_out = find_recordings(folder, labels or LABELS)
    for line in left_out:
        typer.echo(plain(line), err=True)
    with progress_bar() as progress:
        task = progress.add_task("", total=1.0)
        scores = run_recordings(
            found,
            paper=default_file("config", "paper.yaml"),
            on_progress=lambda what, share: progress.update(
                task, description=what, completed=share
            ),
        )
    text = markdown(scores)
    typer.echo(text, nl=False)
    if json_file is not None:
        write_json(json_file, {**as_json(scores), "left_out": left_out})
    if out is not None:
        replace_from(out, "## Results", text)

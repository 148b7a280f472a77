"""`mrs rooms`: rooms in which nobody is, and the people who are found there all the same.

mrs rooms FOLDER                              every room whose pictures are in FOLDER
mrs rooms FOLDER --only fitting               those that may be fitted to
mrs rooms FOLDER --out docs/rooms.md          and the tables into the documentation
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mrs_people_sim.common import progress_bar, replace_from, write_json
from mrs_people_sim.options import JsonFile
from mrs_studies.experiment.empty_rooms import as_json, markdown, run_rooms
from mrs_studies.options import TablesFile
from mrs_studies.recordings.empty_rooms import ROOMS, Half
from mrs_tools.plain import plain


def command(
    folder: Annotated[Path, typer.Argument(help="Checkouts of the sources (docs/rooms.md).")],
    only: Annotated[Half | None, typer.Option(help="Only the rooms of this half.")] = None,
    out: TablesFile = None,
    json_file: JsonFile = None,
) -> None:
    """Run views of rooms without people with the default method, and count who is found.

    Each view is what a robot's head sees that stands in the room for 10 s. Rooms that are not in
    the folder, and views that show no floor, are named. JSON: by room, by half, and of all.
    """
    rooms = [room for room in ROOMS if only is None or room.half == only.value]
    with progress_bar() as progress:
        task = progress.add_task("", total=1.0)
        counts, left_out = run_rooms(
            rooms,
            folder,
            on_progress=lambda what, share: progress.update(
                task, description=what, completed=share
            ),
        )
    for line in left_out:
        typer.echo(plain(line), err=True)
    text = markdown(counts)
    typer.echo(text, nl=False)
    if json_file is not None:
        write_json(json_file, {**as_json(counts), "left_out": left_out})
    if out is not None:
        replace_from(out, "## Results", text)

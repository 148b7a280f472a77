"""Options that several of the studies' commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

#: Which of several cases are run.
Only = Annotated[str, typer.Option(help="Only tours whose name contains this.")]

#: The scene in which they are run.
SceneFile = Annotated[
    str,
    typer.Option(help="A scene file, or one of ours by its name, in place of the usual tours."),
]

#: Which tours are run.
Seed = Annotated[int, typer.Option(help="Seed of the first tour; the others' follow.", min=0)]

#: A document whose tables are replaced.
TablesFile = Annotated[
    Path | None, typer.Option(help="Replace what follows the tables' heading in this file.")
]

#: Recorded pedestrians.
Tracks = Annotated[
    Path | None, typer.Option(help="The folder of the UCY set, for the recorded walks.")
]

"""Options that several of the studies' commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

#: Which of several cases are run.
Only = Annotated[str, typer.Option(help="Only tours whose name contains this.")]

#: A document whose tables are replaced.
TablesFile = Annotated[
    Path | None, typer.Option(help="Replace what follows the tables' heading in this file.")
]

#: Recorded pedestrians.
Tracks = Annotated[
    Path | None, typer.Option(help="The folder of the UCY set, for the recorded walks.")
]

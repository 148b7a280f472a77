"""Options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

#: Whether a bag's own parameter file is read.
OwnConfig = Annotated[
    bool,
    typer.Option(
        "--own-config/--no-own-config",
        help="Read BAG.yaml, the parameter file beside the bag. It overrides --config.",
    ),
]

#: Which of several cases are run.
Only = Annotated[str, typer.Option(help="Only tours whose name contains this.")]

#: A document whose tables are written anew.
TablesFile = Annotated[
    Path | None, typer.Option(help="Replace what follows the tables' heading in this file.")
]

#: Where figures go.
JsonFile = Annotated[
    Path | None, typer.Option("--json", help="Write the results to this file, as JSON.")
]

#: Processes; `common.process_count` has how many 0 is.
Jobs = Annotated[int, typer.Option("--jobs", "-j", help="Processes; 0: one per core.", min=0)]

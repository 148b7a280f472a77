"""Options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

#: Where figures go.
JsonFile = Annotated[
    Path | None, typer.Option("--json", help="Write the results to this file, as JSON.")
]

#: Processes; `common.process_count` has how many 0 is.
Jobs = Annotated[int, typer.Option("--jobs", "-j", help="Processes; 0: one per core.", min=0)]

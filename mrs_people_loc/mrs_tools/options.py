"""Options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

#: Parameter files.
Configs = Annotated[
    list[Path] | None,
    typer.Option("--config", "-c", help="Parameter file of the team; later ones win."),
]

#: Whether a bag's own parameter file is read.
OwnConfig = Annotated[
    bool,
    typer.Option(
        "--own-config/--no-own-config",
        help="Read BAG.yaml, the parameter file beside the bag. It overrides --config.",
    ),
]

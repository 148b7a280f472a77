"""Options that several commands have."""

from __future__ import annotations

from typing import Annotated

import typer

#: Whether a bag's own parameter file is read.
OwnConfig = Annotated[
    bool,
    typer.Option(
        "--own-config/--no-own-config",
        help="Read a parameter file of the bag's name that lies beside it, after the others.",
    ),
]

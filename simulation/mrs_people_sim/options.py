"""Options that several commands have."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mrs_tools.installing import default_file

#: Where figures go.
JsonFile = Annotated[
    Path | None, typer.Option("--json", help="Write the results to this file, as JSON.")
]

#: Processes; `common.process_count` has how many 0 is.
Jobs = Annotated[int, typer.Option("--jobs", "-j", help="Processes; 0: one per core.", min=0)]


def scene_file(scene: str, ours: str) -> Path:
    """A scene's file, by its path or by the name of one of ours.

    Args:
        scene: What `--scene` says.
        ours: Pattern of the files in `config/scenes` that are meant.

    Raises:
        typer.BadParameter: There is none.
    """
    folder = default_file("config", "scenes")
    path = Path(scene) if scene.endswith(".yaml") else folder / f"{scene}.yaml"
    if not path.is_file():
        names = ", ".join(sorted(one.stem for one in folder.glob(ours)))
        raise typer.BadParameter(f"--scene is {scene!r}; allowed: a file NAME.yaml, or {names}")
    return path

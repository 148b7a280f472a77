"""Writing figures, and checks before they are made."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from mrs_people_loc.errors import PeopleLocError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def save(figures: Mapping[str, Figure], folder: Path) -> list[Path]:
    """Writes figures as PNG files.

    Raises:
        PeopleLocError: The folder cannot be written.
    """
    files = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, figure in figures.items():
            files.append(folder / f"{name}.png")
            figure.savefig(files[-1])
    except OSError as err:
        raise PeopleLocError(f"{folder}: cannot be written ({err.strerror or err})") from err
    return files


def check_pictures(path: Path, *, gif: bool) -> None:
    """Checks that a picture, and an animation beside it, can be written.

    Args:
        path: The picture.
        gif: Whether there is an animation.

    Raises:
        PeopleLocError: They cannot.
    """
    from matplotlib.backend_bases import FigureCanvasBase

    kinds = sorted(set(FigureCanvasBase.get_supported_filetypes()) - {"gif"})
    if path.suffix.lower().lstrip(".") not in kinds:
        raise PeopleLocError(f"--out {path}: wanted: a name that ends in .{', .'.join(kinds)}")
    for file in (path, path.with_suffix(".gif")) if gif else (path,):
        if file.is_dir():
            raise PeopleLocError(f"--out {path}: {file} is a folder; wanted: a file")
        if not file.parent.is_dir():
            raise PeopleLocError(f"--out {path}: {file}: there is no folder {file.parent}")
        new = not file.exists()
        try:
            file.open("ab").close()
            if new:
                file.unlink()
        except OSError as err:
            why = err.strerror or err
            raise PeopleLocError(f"--out {path}: {file}: cannot be written ({why})") from err

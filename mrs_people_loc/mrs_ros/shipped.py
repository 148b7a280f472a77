"""Files that come with the project: those of the data packages `config/` and `bags/`."""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

#: Folder in the repository -> ament package that it is.
PACKAGES = {"config": "mrs_people_config", "bags": "mrs_people_bags"}


def shipped_file(folder: str, *parts: str) -> Path | None:
    """A file or folder of a data package: of the source tree of this module, or installed.

    The current directory does not matter.

    Args:
        folder: `config` or `bags`.
        parts: The path below it.

    Returns:
        Where it is; None: it is nowhere.
    """
    found = (root.joinpath(*parts) for root in _roots(folder))
    return next((path for path in found if path.exists()), None)


def _roots(folder: str) -> Iterator[Path]:
    source = Path(__file__).resolve().parents[2] / folder
    if (source / "package.xml").is_file():
        yield source
    with suppress(ImportError, LookupError, OSError):  # no ROS, or none is sourced
        from ament_index_python.packages import get_package_share_directory

        yield Path(get_package_share_directory(PACKAGES[folder]))
    yield Path(sys.prefix, "share", PACKAGES[folder])  # another ROS may be sourced

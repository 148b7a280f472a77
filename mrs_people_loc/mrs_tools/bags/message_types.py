"""Types of messages without ROS: those of Jazzy, our own, and what a bag defines."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from rosbags.interfaces import Nodetype
from rosbags.typesys import Stores, get_types_from_msg, get_typestore
from rosbags.typesys.store import Typestore

from mrs_people_loc.errors import BagError

PEOPLE_TYPE = "mrs_people_msgs/msg/People"
STATUS_TYPE = "mrs_people_msgs/msg/GuideStatus"
OUR_MESSAGES = tuple(
    f"mrs_people_msgs/msg/{n}"
    for n in (
        "People",
        "Person",
        "HiddenPerson",
        "Group",
        "RobotScan",
        "TeamPose",
        "Wall",
        "RelativePose",
        "RelativePoses",
        "StandingPerson",
        "GuideStatus",
        "RobotPost",
    )
)
#: Parts of a message, each element of its fixed arrays counted, but for arrays of numbers.
MAX_PARTS = 10_000


@lru_cache(maxsize=1)
def default_typestore() -> Typestore:
    """Every standard message of ROS 2 Jazzy and, where they are installed, our own."""
    store = get_typestore(Stores.ROS2_JAZZY)
    if _definition_file(OUR_MESSAGES[0]):
        require_types(store, OUR_MESSAGES)
    return store


def require_types(store: Typestore, types: Iterable[str]) -> None:
    """Add types that a store lacks, and all they are made of, from the installed packages.

    Args:
        store: The store to add to.
        types: Type names such as `mrs_people_msgs/msg/People`.

    Raises:
        BagError: A definition is not installed or cannot be read.
    """
    wanted = list(types)
    while wanted:
        name = wanted.pop()
        if name in store.fielddefs:
            continue
        file = _definition_file(name)
        if file is None:
            raise BagError(
                f"message type {name} is unknown: install its package, or source the workspace "
                "that has it"
            )
        try:
            found = get_types_from_msg(file.read_text(encoding="utf-8"), name)
            store.register(found)
        except Exception as err:
            raise BagError(f"{file}: not a message definition ({reason(err)})") from err
        for _, fields in found.values():
            for _, (kind, value) in fields:
                element: Any = value[0] if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE) else None
                kind, value = element or (kind, value)
                if kind == Nodetype.NAME:
                    wanted.append(str(value))


def _definition_file(name: str) -> Path | None:
    """Where ROS installed the definition of a type, if it did."""
    package, _, message = name.partition("/msg/")
    for prefix in [*os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep), sys.prefix]:
        file = Path(prefix, "share", package, "msg", f"{message}.msg")
        if prefix and message and file.is_file():
            return file
    return None


def check_definitions(types: Mapping[str, Any]) -> None:
    """Raise if a type has more parts than any message: each of them becomes code or objects.

    Args:
        types: Constants and fields by type name, as `rosbags.typesys` parses them.

    Raises:
        BagError: A type has more than `MAX_PARTS`, or is a part of itself; names the type.
    """
    known: dict[str, int] = {}
    for name in types:
        _parts(name, types, known)


def _parts(name: str, types: Mapping[str, Any], known: dict[str, int]) -> int:
    if name not in types:
        return 1  # one of the standard types
    if name in known:
        return known[name]
    known[name] = MAX_PARTS + 1  # as long as it is not known: if it is met again, it has no end
    total = 0
    for _, (kind, value) in types[name][1]:
        length = 1
        if kind in (Nodetype.ARRAY, Nodetype.SEQUENCE):
            (element, size), is_array = value, kind == Nodetype.ARRAY
            kind, value = element
            is_number = kind == Nodetype.BASE and value[0] != "string"
            length = size if is_array and not is_number else 1
        total += length * (_parts(value, types, known) if kind == Nodetype.NAME else 1)
    if total > MAX_PARTS:
        raise BagError(
            f"message type {name} has {total} parts, or is a part of itself; allowed: {MAX_PARTS}"
        )
    known[name] = total
    return total


def reason(err: BaseException) -> str:
    """What an error of another library says, on one line."""
    text = " ".join(str(err).split()).rstrip(".")
    if len(text) < 10:
        text = f"{type(err).__name__} {text}".strip()
    return text if len(text) <= 150 else f"{text[:150]}..."

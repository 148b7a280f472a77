"""Makes a bag of what a recorder left that was killed.

`BagWriter` puts a bag under its name when it is complete. Until then the messages lie in
`<name>.part`, in an mcap file without its index: what was written before the last `flush` is whole,
and what comes after it may be cut anywhere.
"""

from __future__ import annotations

import os
import shutil
import struct
from pathlib import Path
from typing import BinaryIO, NamedTuple

from rosbags.interfaces import ConnectionExtRosbag2
from rosbags.rosbag2.storage_mcap import McapReader

from mrs_people_loc.errors import BagError
from mrs_tools.bags.writer import BagWriter, lock, part_of

_MAGIC_BYTES = 8
_DATA_END = 0x0F


class Recovered(NamedTuple):
    """What was recovered."""

    counts: dict[str, int]
    """Messages, by topic."""
    lost_bytes: int
    """What was cut off at the end: part of a last second."""


def recover(path: Path) -> Recovered:
    """Make the bag of a recording that was not ended.

    Args:
        path: The name that the bag was to have.

    Raises:
        BagError: There is no such recording, it is still being written, nothing of it is left, or
            the bag exists or cannot be written; then what there was is as it was.
    """
    path = path.with_suffix("") if path.suffix == ".part" else path
    part = part_of(path)
    if not part.is_dir():
        raise BagError(f"{path}: there is nothing to recover, no {part}")
    # Aside, since the bag is written in its place.
    aside = path.with_name(path.name + ".killed")
    held = lock(part)
    try:
        if aside.exists():
            raise BagError(
                f"{aside}: is left of a recovery that was killed. Rename it to a name of its own, "
                "NAME.part, and recover NAME"
            )
        files = sorted(part.glob("*/*.mcap"))
        if not files:
            raise BagError(f"{part}: nothing was written yet. Remove it")
        part.rename(aside)
        try:
            recovered = _copy(aside / files[0].relative_to(part), path)
        except BaseException as err:
            shutil.rmtree(part, ignore_errors=True)  # of the new bag
            aside.rename(part)
            if isinstance(err.__cause__, OSError):
                why = err.__cause__.strerror or err.__cause__
                raise BagError(f"{path}: cannot be recovered ({why}); {part} is as it was") from err
            raise
        shutil.rmtree(aside)
    except OSError as err:
        raise BagError(f"{path}: cannot be recovered ({err.strerror or err})") from err
    finally:
        os.close(held)
    return recovered


def _copy(file: Path, path: Path) -> Recovered:
    """Write all whole messages of an mcap file without an index to a bag."""
    source, size = McapReader(file), file.stat().st_size
    with file.open("rb") as source.bio:
        source.data_start, source.data_end = _extent(source.bio, size)
        if source.data_start == source.data_end:
            raise BagError(f"{file.parents[1]}: no message was written yet. Remove it")
        try:
            source.meta_scan()
            with BagWriter(path) as out:
                for c in source.connections:
                    assert isinstance(c.ext, ConnectionExtRosbag2)
                    out.add_topic(c.topic, c.msgtype, c.ext.offered_qos_profiles)
                for c, time_ns, data in source.messages_scan(source.connections):
                    out.write_raw(c.topic, time_ns, data)
        except BagError:
            raise
        except Exception as err:  # the library lets errors of many kinds through
            raise BagError(f"{file}: damaged ({err}). Try `mcap recover`") from err
    return Recovered(out.counts, size - source.data_end)


def _extent(file: BinaryIO, size: int) -> tuple[int, int]:
    """Where whole records begin, after the header, and where they end [bytes]."""
    start = end = 0
    at = _MAGIC_BYTES
    while True:
        file.seek(at)
        head = file.read(9)
        opcode, length = struct.unpack("<BQ", head) if len(head) == 9 else (0, 0)
        at += 9 + length
        if opcode in (0, _DATA_END) or at > size:
            return start, end
        start, end = start or at, at

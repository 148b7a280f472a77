"""Shared memory of Fast DDS that killed processes left behind: docs/network.md, Shared memory."""

from __future__ import annotations

import fcntl
import os
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

MEMORY = Path("/dev/shm")
#: What to do about shared memory that is full of what they left behind.
CLEAN = (
    "fastdds shm clean (it leaves alone what runs); start what is killed so often with "
    "FASTDDS_BUILTIN_TRANSPORTS=UDPv4: docs/network.md, Shared memory"
)
#: A lock file of Fast DDS beside a segment or a port; locked while its process lives.
_LOCK = re.compile(r"(fastrtps_(?:port\d+|[0-9a-z]{16}))_[es]l")
#: It is reported where more than this share of the shared memory is left behind, or less is free.
_MUCH = 0.1


@dataclass(frozen=True)
class Memory:
    """What is in shared memory.

    Attributes:
        files: Size of each file there [bytes].
        locked: Lock files whose process lives.
        size: Of all of it [bytes].
        free: Of that [bytes].
    """

    files: Mapping[str, int]
    locked: frozenset[str]
    size: int
    free: int


def memory(folder: Path = MEMORY) -> Memory | None:
    """Looks at the shared memory of this machine, or container; None where there is none."""
    try:
        names, whole = os.listdir(folder), os.statvfs(folder)
    except OSError:
        return None
    files = {}
    for name in names:
        with suppress(OSError):  # it was deleted meanwhile
            files[name] = (folder / name).stat().st_size
    locked = frozenset(name for name in files if _LOCK.fullmatch(name) and _locked(folder / name))
    return Memory(files, locked, whole.f_blocks * whole.f_frsize, whole.f_bavail * whole.f_frsize)


def _locked(file: Path) -> bool:
    """Whether a process holds it; as `fastdds shm clean` asks."""
    with suppress(OSError), file.open("rb") as lock:
        try:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
        return False
    return True  # another user's, or deleted: not known to be dead


def left_behind(seen: Memory) -> Mapping[str, int]:
    """Segments and ports of processes that are dead, and their sizes [bytes]."""
    locks = {name: found[1] for name in seen.files if (found := _LOCK.fullmatch(name))}
    alive = {locks.get(name) for name in seen.locked}
    return {name: seen.files.get(name, 0) for name in sorted({*locks.values()} - alive)}


def trouble(seen: Memory) -> str:
    """How much of it dead processes hold, a sentence; empty where it is not much."""
    dead = left_behind(seen)
    taken = sum(dead.values())
    if not dead or (taken < _MUCH * seen.size and seen.free >= _MUCH * seen.size):
        return ""
    return (
        f"holds {len(dead)} segments and ports of processes that are dead: {taken / 1e6:.0f} of "
        f"{seen.size / 1e6:.0f} MB; {seen.free / 1e6:.0f} MB are free"
    )

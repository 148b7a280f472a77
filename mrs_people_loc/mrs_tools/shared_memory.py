"""What `mrs doctor` makes of images that are lost on their way, and of shared memory.

docs/network.md, Shared memory, has the background.
"""

from __future__ import annotations

import fcntl
import os
import re
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path

from mrs_people_loc.health.findings import Code

MEMORY = Path("/dev/shm")
#: The most that the kernel keeps for a socket until it is read [bytes].
ROOM = Path("/proc/sys/net/core/rmem_max")
#: What the shipped profile asks for [bytes].
WANTED_ROOM = 16777216

#: What to do about shared memory that is full of what the dead left behind.
CLEAN = (
    "fastdds shm clean (it leaves alone what runs); start what is killed so often with "
    "FASTDDS_BUILTIN_TRANSPORTS=UDPv4: docs/network.md, Shared memory"
)
#: A lock file of Fast DDS beside a segment or a port; locked while its process lives.
_LOCK = re.compile(r"(fastrtps_(?:port\d+|[0-9a-z]{16}))_[es]l")
#: Less than this share of the images beside a camera's calibration is a loss.
_LOSS = 0.7
#: From this share of the shared memory on it is worth a word, left behind or free.
_MUCH = 0.1

Report = Mapping[str, tuple[str, str, Mapping[str, str]]]


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
        with suppress(OSError):  # it is gone again
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
    return True  # another user's, or gone: not known to be dead


def left_behind(seen: Memory) -> Mapping[str, int]:
    """Segments and ports of processes that are dead, and their sizes [bytes]."""
    locks = {name: found[1] for name in seen.files if (found := _LOCK.fullmatch(name))}
    alive = {locks.get(name) for name in seen.locked}
    return {name: seen.files.get(name, 0) for name in sorted({*locks.values()} - alive)}


def trouble(seen: Memory) -> str:
    """What the dead take of the shared memory, a sentence; empty where it is not much."""
    dead = left_behind(seen)
    taken = sum(dead.values())
    if not dead or (taken < _MUCH * seen.size and seen.free >= _MUCH * seen.size):
        return ""
    return (
        f"holds {len(dead)} segments and ports of processes that are dead: {taken / 1e6:.0f} of "
        f"{seen.size / 1e6:.0f} MB; {seen.free / 1e6:.0f} MB are free"
    )


def lost_images(report: Report) -> str:
    """What a robot's report says of cameras whose images are missing, or most of them.

    Only while their camera_info comes, and where the robot knows no other reason.

    Args:
        report: Of a robot's node: by subject its level, text and values.

    Returns:
        A sentence; empty where none is missing.
    """
    lost = []
    for subject, (_, _, values) in report.items():
        camera, _, topic = subject.rpartition("/")
        images, beside = _rate(report, subject), _rate(report, f"{camera}/camera_info")
        unexplained = values.get("code", Code.NO_DATA.value) == Code.NO_DATA.value
        missing = topic.startswith("image_") and beside >= 1.0 and images < _LOSS * beside
        if missing and unexplained:
            lost.append(f"{camera} ({images:.1f} a second, camera_info {beside:.1f})")
    return f"images are missing while their camera_info comes: {', '.join(lost)}" if lost else ""


def _rate(report: Report, subject: str) -> float:
    values = report[subject][2] if subject in report else {}
    try:
        return float(values.get("rate_hz", 0.0))
    except ValueError:
        return 0.0


def advice_on_lost_images() -> str:
    """What to do about them, on this machine."""
    room = None
    with suppress(OSError, ValueError):
        room = int(ROOM.read_text())
    small = room is not None and room < WANTED_ROOM
    where = f" (on this one it is {room})" if small else ""
    return (
        "if `ros2 topic hz` finds them, they are lost on their way. Large ones need room: "
        f"sudo sysctl -w net.core.rmem_max={WANTED_ROOM} on the robot's computer{where}, and start "
        "the node again. With a Fast DDS profile or transports of your own it may be shared "
        "memory: start their driver again. docs/network.md, Shared memory"
    )

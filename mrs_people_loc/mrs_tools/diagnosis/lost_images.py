"""Images that are lost between a camera's driver and the robot's node: docs/network.md."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path

from mrs_people_loc.health.findings import Code
from mrs_tools.diagnosis.facts import Report, number

#: The most that the kernel keeps for a socket until it is read [bytes].
ROOM = Path("/proc/sys/net/core/rmem_max")
#: What the shipped profile asks for [bytes].
WANTED_ROOM = 16777216
#: Less than this share of the images beside a camera's calibration is a loss.
_LOSS = 0.7


def lost_images(report: Report) -> str:
    """Cameras of a robot whose images are missing, or most of them.

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
    return number(values.get("rate_hz", "")) or 0.0


def advice() -> str:
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

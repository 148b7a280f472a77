"""What nodes publish on `/diagnostics`: per subject a level, a code and a sentence.

People read the sentences, which may change; tools go by the codes (the value `code` of an entry on
`/diagnostics`), which do not. The modules of this package have the findings by subject:

| module | findings about |
|---|---|
| `inputs` | one subscribed topic |
| `robot` | pairing, head, mounting, scan and pose of a robot, by its own node |
| `localization` | the localization of a robot, by its own node |
| `team` | the intervals, and each robot as the planner receives it |
| `guide` | a guided tour and its robots |
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from enum import Enum

#: Levels, as diagnostic_msgs/DiagnosticStatus numbers them.
OK, WARN, ERROR, STALE = (bytes([level]) for level in range(4))

#: A topic that is silent for longer is reported [s].
SILENCE_S = 2.0
#: Stamps that are this far from the clock on arrival are reported [s].
OLD_STAMP_S = 5.0


class Code(str, Enum):
    """What is wrong, for tools."""

    # of a node
    INACTIVE = "inactive"
    NO_CLOCK = "no_clock"
    # of one input
    NO_PUBLISHER = "no_publisher"
    NO_DATA = "no_data"
    WRONG_TYPE = "wrong_type"
    WRONG_QOS = "wrong_qos"
    OTHER_IMAGES = "other_images"
    TWO_PUBLISHERS = "two_publishers"
    ALL_REFUSED = "all_refused"
    SOME_REFUSED = "some_refused"
    NO_STAMPS = "no_stamps"
    STAMPS_AHEAD = "stamps_ahead"
    NO_CALIBRATION = "no_calibration"
    OUTDATED = "outdated"
    # of a robot
    NO_PAIR = "no_pair"
    SOME_UNPAIRED = "some_unpaired"
    NO_VIEW = "no_view"
    BLIND = "blind"
    HEAD_MOVED = "head_moved"
    NO_SCAN = "no_scan"
    SCAN_SILENT = "scan_silent"
    STAMPS_OFF = "stamps_off"
    NO_POSE = "no_pose"
    OBSTRUCTED = "obstructed"
    DRIVES_BLIND = "drives_blind"
    MONITOR_FAILS = "monitor_fails"
    # of a robot's localization
    CARRIED = "carried"
    MATE_DOUBTED = "mate_doubted"
    MAP_MISFIT = "map_misfit"
    MATE_CLOCK = "mate_clock"
    CORRECTIONS_REFUSED = "corrections_refused"
    NOT_CORRECTED = "not_corrected"
    ODOMETRY_HANGS = "odometry_hangs"
    ODOMETRY_NOISY = "odometry_noisy"
    SONAR_DEAD = "sonar_dead"
    # of a robot, as the planner receives it
    CLOCK_ASTRAY = "clock_astray"
    LEFT_OUT_NO_POSE = "left_out_no_pose"
    LEFT_OUT_TOO_OLD = "left_out_too_old"
    QUARANTINED = "quarantined"
    DOUBTED = "doubted"
    STRANGE_POSE = "strange_pose"
    MISPLACED = "misplaced"
    SLOW = "slow"
    # of the planner
    NO_ROBOT = "no_robot"
    NO_INTERVAL = "no_interval"
    # of the guide
    NO_MAP = "no_map"
    TOUR_HALTED = "tour_halted"
    TOUR_STOPPED = "tour_stopped"
    PEOPLE_LOST = "people_lost"
    TAKES_NO_PART = "takes_no_part"
    DRIVEN_BY_OTHERS = "driven_by_others"
    NO_MONITOR = "no_monitor"

    def __str__(self) -> str:
        """As it is on the wire."""
        return self.value


@dataclass(frozen=True)
class Finding:
    """What was found about one subject.

    Attributes:
        name: The subject.
        level: OK, WARN, ERROR or STALE.
        message: What is wrong, and what to do.
        values: Figures by name.
        code: What is wrong, for tools; None exactly where the level is OK.

    Raises:
        ValueError: A finding that is OK has a code, or one that is not has none.
    """

    name: str
    level: bytes = OK
    message: str = "ok"
    values: Mapping[str, object] = field(default_factory=dict)
    code: Code | None = None

    def __post_init__(self) -> None:
        if (self.level == OK) != (self.code is None):
            raise ValueError(f"finding {self.name}: level {self.level!r} with code {self.code}")


def of_state(*, active: bool, values: Mapping[str, object]) -> Finding:
    """Whether a node works.

    Args:
        active: Whether it is in the lifecycle state active.
        values: What its process uses.
    """
    if active:
        return Finding("state", OK, "active", values)
    text = "inactive: receives and sends nothing until activated"
    return Finding("state", STALE, text, code=Code.INACTIVE)


def without_clock(found: Iterable[Finding]) -> list[Finding]:
    """Findings of a node without a time: it cannot tell whether a stamp is early or late."""
    return [
        replace(one, level=STALE, message="waits for /clock", code=Code.NO_CLOCK)
        if one.code in (Code.STAMPS_OFF, Code.CLOCK_ASTRAY)
        else one
        for one in found
    ]

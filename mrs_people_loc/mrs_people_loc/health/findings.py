"""What is said of a node's inputs on `/diagnostics`: level, code and words, from plain figures.

People read the words, which may change; tools go by the codes (the value `code` of an entry on
`/diagnostics`), which do not.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

#: Levels, as diagnostic_msgs/DiagnosticStatus numbers them.
OK, WARN, ERROR, STALE = (bytes([level]) for level in range(4))

#: A topic that is silent for longer is reported [s].
SILENCE_S = 2.0
#: Stamps that are this far from the clock on arrival are reported [s].
OLD_STAMP_S = 5.0
#: So many messages that are refused, and none between them that is not, are all of them.
_ALL = 3


class Code(str, Enum):
    """What a finding says, for tools."""

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
    # of a robot, as the planner sees it
    CLOCK_ASTRAY = "clock_astray"
    LEFT_OUT_NO_POSE = "left_out_no_pose"
    LEFT_OUT_TOO_OLD = "left_out_too_old"
    STRANGE_POSE = "strange_pose"
    MISPLACED = "misplaced"
    SLOW = "slow"
    # of the planner
    NO_ROBOT = "no_robot"
    NO_INTERVAL = "no_interval"

    def __str__(self) -> str:
        """As it is on the wire."""
        return self.value


#: Refusals that are told apart, by the class of their error.
_REFUSALS = {
    "StampError": Code.NO_STAMPS,
    "UncalibratedError": Code.NO_CALIBRATION,
    "OutdatedError": Code.OUTDATED,
}


@dataclass(frozen=True)
class Stream:
    """What is known of one input.

    Attributes:
        topic: Full name.
        kind: Type that is wanted, as `sensor_msgs/msg/Image`.
        silent_s: Since when nothing came [s].
        refused: Messages that could not be used, so far.
        refused_in_a_row: Of these, those since the last one that could.
        refused_lately: Whether any was, within the last seconds.
        last_error: Why the last one was.
        last_kind: Class of that error.
        publishers: Full node name and type of each that publishes the topic; a single one that is
            heard may be left out.
        incompatible: The policy of QoS in which a publisher does not fit; empty: none.
        once: One message that can be used is enough.
        taken: Whether there was one.
        instead: Another topic that is published, and what to do to have that one used.
    """

    topic: str
    kind: str
    silent_s: float
    refused: int = 0
    refused_in_a_row: int = 0
    refused_lately: bool = False
    last_error: str = ""
    last_kind: str = ""
    publishers: Sequence[tuple[str, str]] = ()
    incompatible: str = ""
    once: bool = False
    taken: bool = False
    instead: tuple[str, str] | None = None


def of_stream(stream: Stream) -> tuple[bytes, Code | None, str]:
    """How an input is: level, code (None: all is well) and words.

    What keeps data away goes before what is wrong with those that come.
    """
    if stream.once and not stream.taken and stream.refused:
        text = f"none of {stream.refused} can be used; last: {stream.last_error}"
        return ERROR, _REFUSALS.get(stream.last_kind, Code.ALL_REFUSED), text
    if stream.silent_s > SILENCE_S and not (stream.once and stream.taken):
        return ERROR, *_silence(stream)
    sources = sorted(name for name, kind in stream.publishers if kind == stream.kind)
    if len(sources) > 1:
        text = (
            f"{len(sources)} publishers on {stream.topic}: {', '.join(sources)}; one is wanted, "
            "for what they send is taken for one source's: end or remap the others; or one was "
            "killed some seconds ago"
        )
        return ERROR, Code.TWO_PUBLISHERS, text
    if stream.refused_in_a_row >= _ALL:
        text = f"all of the last {stream.refused_in_a_row} refused; last: {stream.last_error}"
        return ERROR, _REFUSALS.get(stream.last_kind, Code.ALL_REFUSED), text
    if stream.refused_lately:
        text = f"{stream.refused} dropped; last: {stream.last_error}"
        return WARN, Code.SOME_REFUSED, text
    return OK, None, "ok"


def _silence(stream: Stream) -> tuple[Code, str]:
    count = len(stream.publishers)
    text = f"no data on {stream.topic} for {stream.silent_s:.0f} s; publishers: {count}"
    code = Code.NO_DATA if count else Code.NO_PUBLISHER
    if stream.incompatible:
        code, text = Code.WRONG_QOS, f"{text}; incompatible QoS: {stream.incompatible}"
    others = sorted({kind for _, kind in stream.publishers} - {stream.kind})
    if others:
        code = Code.WRONG_TYPE
        text += f"; published as {', '.join(others)}, wanted: {stream.kind}"
    if stream.instead is not None and not count:
        topic, remedy = stream.instead
        code, text = Code.OTHER_IMAGES, f"{text}; {topic} is published: {remedy}"
    return code, text


def of_scans(silent_s: float, ahead_s: float, remedy: str = "") -> tuple[bytes, Code | None, str]:
    """How a robot's scans are: level, code (None: all is well) and words.

    A stream that has stopped is silent; how old its last message has become since says nothing of
    clocks. So the stamp is compared with the clock when the scan is made.

    Args:
        silent_s: Since when there was none [s].
        ahead_s: What the last one's stamp was ahead of the clock by, then [s].
        remedy: What to do about stamps of another time.
    """
    if silent_s > SILENCE_S:
        return STALE, Code.SCAN_SILENT, f"no scan for {silent_s:.0f} s"
    if abs(ahead_s) > OLD_STAMP_S:
        where = "ahead of" if ahead_s > 0 else "behind"
        text = f"stamps are {abs(ahead_s):.1f} s {where} this machine's clock{remedy}"
        return WARN, Code.STAMPS_OFF, text
    return OK, None, "ok"

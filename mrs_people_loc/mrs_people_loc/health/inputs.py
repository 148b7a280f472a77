"""Findings about one subscribed topic."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from mrs_people_loc.health.findings import ERROR, OK, SILENCE_S, WARN, Code, Finding

#: So many refused messages in succession are reported as all of them.
_ALL = 3
#: Codes of refusals that are told apart, by the class of their error.
_REFUSALS = {
    "StampError": Code.NO_STAMPS,
    "AheadError": Code.STAMPS_AHEAD,
    "UncalibratedError": Code.NO_CALIBRATION,
    "OutdatedError": Code.OUTDATED,
}


@dataclass(frozen=True)
class InputState:
    """What is known of one input.

    Attributes:
        name: Relative name of the topic: the subject of the finding.
        topic: Full name.
        kind: Type that is wanted, as `sensor_msgs/msg/Image`.
        silent_s: Time since the last message [s].
        rate_hz: Messages per second.
        received: Messages so far.
        dropped: Messages that were not used so far, by reason.
        refused: Those of them that their sender is to blame for.
        refused_in_a_row: Those since the last message that could be used.
        refused_lately: Whether any was, within the last seconds.
        last_error: Why the last one was.
        last_kind: Class of that error.
        publishers: Full node name and type of each that publishes the topic; a single one of
            the wanted type may be left out.
        incompatible: The policy of QoS in which a publisher does not fit; empty: none.
        once: One message that can be used is enough.
        any_number: Any number of nodes may publish it, also none; silence is no fault.
        taken: Whether there was one.
        instead: Another topic that is published, and what to do to have that one used.
    """

    name: str
    topic: str
    kind: str
    silent_s: float
    rate_hz: float = 0.0
    received: int = 0
    dropped: Mapping[str, int] = field(default_factory=dict)
    refused: int = 0
    refused_in_a_row: int = 0
    refused_lately: bool = False
    last_error: str = ""
    last_kind: str = ""
    publishers: Sequence[tuple[str, str]] = ()
    incompatible: str = ""
    once: bool = False
    any_number: bool = False
    taken: bool = False
    instead: tuple[str, str] | None = None


def of_input(state: InputState) -> Finding:
    """What is wrong with an input; what keeps data away goes before what is wrong with the data."""
    level, code, text = _judge(state)
    values = {
        "rate_hz": f"{state.rate_hz:.1f}",
        "silent_s": f"{state.silent_s:.1f}",
        "received": state.received,
        "dropped": sum(state.dropped.values()),
        **{f"dropped.{reason}": count for reason, count in state.dropped.items()},
    }
    return Finding(state.name, level, text, values, code)


def _judge(state: InputState) -> tuple[bytes, Code | None, str]:
    refusal = _REFUSALS.get(state.last_kind, Code.ALL_REFUSED)
    if state.once and not state.taken and state.refused:
        text = f"none of {state.refused} can be used; last: {state.last_error}"
        return ERROR, refusal, text
    if state.silent_s > SILENCE_S and not (state.once and state.taken):
        code, text = _silence(state)
        if not state.any_number or code in (Code.WRONG_QOS, Code.WRONG_TYPE):
            return ERROR, code, text
    sources = sorted(name for name, kind in state.publishers if kind == state.kind)
    if len(sources) > 1 and not state.any_number:
        text = (
            f"{len(sources)} publishers on {state.topic}: {', '.join(sources)}; one is wanted, "
            "since all messages are taken for one source's: end or remap the others; or one was "
            "killed in the last 20 s"
        )
        return ERROR, Code.TWO_PUBLISHERS, text
    if state.refused_in_a_row >= _ALL:
        text = f"all of the last {state.refused_in_a_row} refused; last: {state.last_error}"
        return ERROR, refusal, text
    if state.refused_lately:
        return WARN, Code.SOME_REFUSED, f"{state.refused} dropped; last: {state.last_error}"
    return OK, None, "ok"


def _silence(state: InputState) -> tuple[Code, str]:
    count = len(state.publishers)
    text = f"no data on {state.topic} for {state.silent_s:.0f} s; publishers: {count}"
    code = Code.NO_DATA if count else Code.NO_PUBLISHER
    if state.incompatible:
        code, text = Code.WRONG_QOS, f"{text}; incompatible QoS: {state.incompatible}"
    others = sorted({kind for _, kind in state.publishers} - {state.kind})
    if others:
        code = Code.WRONG_TYPE
        text += f"; published as {', '.join(others)}, wanted: {state.kind}"
    if state.instead is not None and not count:
        topic, remedy = state.instead
        code, text = Code.OTHER_IMAGES, f"{text}; {topic} is published: {remedy}"
    return code, text

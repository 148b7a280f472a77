"""States of a tour: the table of what the guide finds in an interval, and what that makes of it."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum

from mrs_people_loc.guiding.guidance import HALTS, State

_GATHERING, _LEADING, _WAITING = State.GATHERING, State.LEADING, State.WAITING
_AT_STOP, _HALTED = State.AT_STOP, State.HALTED
_FINISHED, _CANCELLED, _STOPPED = State.FINISHED, State.CANCELLED, State.STOPPED
#: States of a tour that has not ended.
RUNNING = (_GATHERING, _LEADING, _WAITING, _AT_STOP, _HALTED, _STOPPED)
#: States that others interrupt: from the others of a tour it goes on in the last one of these.
PHASES = (_GATHERING, _LEADING, _AT_STOP)


@dataclass(frozen=True)
class Transition:
    """What a cue makes of a tour; the texts hold words in braces.

    Attributes:
        phase: In which it is found; None: in any.
        state: The next one.
        reason: Why, where that is not obvious.
        event: What is told once; empty: nothing.
        walks: Whether the pace is that of the group; else the leader stands.
    """

    phase: State | None
    state: State
    reason: str = ""
    event: str = ""
    walks: bool = False


_AWAY = "waits for the group: it is {away:.1f} m from the way; allowed: {allowed:g} m"
_MOST = "goes on after {after:g} s: the group is {away:.1f} m from {where}"
_NOT_COMING = "the group has not come along for {patience:g} s"


class Cue(Enum):
    """What the guide finds in an interval, and what that makes of the tour."""

    BEGINS = Transition(_GATHERING, _GATHERING, "waits for people", "the {tour} begins")
    NOBODY_SEEN = Transition(_GATHERING, _GATHERING, "waits for people: none is seen")
    GROUP_AWAY = Transition(_GATHERING, _GATHERING, _AWAY)
    GROUP_SEEN = Transition(_GATHERING, _GATHERING, "sees {people}")
    GROUP_SETTLED = Transition(_GATHERING, _LEADING, "", "sets off with {people}")

    OVERTAKES = Transition(_LEADING, _WAITING, "waits until {leader} is in front")
    LETS_PASS = Transition(_LEADING, _WAITING, "lets somebody pass")
    SOMEBODY_BEHIND = Transition(_LEADING, _WAITING, "{waits}")
    # The leader is on its way.
    FOLLOWS = Transition(_LEADING, _LEADING, walks=True)
    STRETCHED = Transition(_LEADING, _WAITING, "waits until the group has closed up", walks=True)
    FAR_BEHIND = Transition(_LEADING, _WAITING, "waits for the group", walks=True)
    NOT_COMING = Transition(_LEADING, _CANCELLED, _NOT_COMING, _NOT_COMING)
    # It is at a stop, or at the end.
    SOME_ON_THEIR_WAY = Transition(_LEADING, _WAITING, "waits until everybody is at {where}")
    ALL_THERE = Transition(_LEADING, _AT_STOP, "", "everybody is at {where}")
    MOST_THERE = Transition(_LEADING, _AT_STOP, "", _MOST)

    AT_END = Transition(_AT_STOP, _FINISHED, "the group is at the end", "the {tour} is finished")
    STAYS = Transition(_AT_STOP, _AT_STOP)
    STAYS_FOR_SOMEBODY = Transition(_AT_STOP, _AT_STOP, "{waits}")
    STAYED = Transition(_AT_STOP, _LEADING, "", "goes on from {where}")

    NOBODY_LEFT = Transition(None, _CANCELLED, "nobody of the group is left")
    HALTS = Transition(None, _HALTED, "{why}", f"{HALTS}{{why}}")
    STILL_HALTED = Transition(None, _HALTED, "{why}")
    STOPPED = Transition(None, _STOPPED, "{why}", "{why}")
    CANCELLED = Transition(None, _CANCELLED, "{why}")

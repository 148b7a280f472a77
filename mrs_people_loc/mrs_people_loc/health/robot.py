"""Findings of a robot about itself: its pairs of images, head, mounting, scan and pose."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from mrs_people_loc.guiding.collision_monitor import Action, Verdict
from mrs_people_loc.health.findings import (
    ERROR,
    OK,
    OLD_STAMP_S,
    SILENCE_S,
    STALE,
    WARN,
    Code,
    Finding,
)

#: What the collision monitor does, in words.
_LIMITS = {
    Action.STOPS: (Code.OBSTRUCTED, "the robot stands: "),
    Action.FAILS: (Code.MONITOR_FAILS, "the robot stands: "),
    Action.CRAWLS: (Code.DRIVES_BLIND, "the robot crawls: "),
}


@dataclass(frozen=True)
class PairingState:
    """How images were paired.

    Attributes:
        unpaired: Images that found no pair, so far.
        unpaired_lately: Whether any did not, within the last seconds.
        why_unpaired: Why, a sentence.
        stamp_resets: How often stamps jumped back, so far.
        frames: Pairs that were worked on, so far.
    """

    unpaired: int
    unpaired_lately: bool
    why_unpaired: str
    stamp_resets: int
    frames: int


def of_pairing(state: PairingState) -> Finding:
    """Whether images find their pairs."""
    values = {"unpaired": state.unpaired, "stamp_resets": state.stamp_resets}
    text = f"{state.unpaired} images found no pair; {state.why_unpaired}"
    if state.unpaired and not state.frames:
        return Finding("pairs", ERROR, text, values, Code.NO_PAIR)
    if state.unpaired and state.unpaired_lately:
        return Finding("pairs", WARN, text, values, Code.SOME_UNPAIRED)
    return Finding("pairs", values=values)


def of_head(blind: str, figures: Mapping[str, float]) -> Finding:
    """Whether the head sees anything.

    Args:
        blind: Why it does not, a sentence; empty: it does.
        figures: What that was judged by (`SightWatch.values`); empty before the first view.
    """
    if not figures:
        return Finding("head", STALE, "no view yet", code=Code.NO_VIEW)
    values = {name: f"{value:.2f}" for name, value in figures.items()}
    if blind:
        text = f"the head is blind: {blind}; check lens caps, light and exposure"
        return Finding("head", WARN, text, values, Code.BLIND)
    return Finding("head", values=values)


@dataclass(frozen=True)
class MountingState:
    """Where the head sits.

    Attributes:
        robot: The robot's name.
        configured: The configured mounting, in words.
        measured: The mounting by the floor, in words; empty: not enough floor in view.
        floor_part: Part of the view that is floor; None with `measured`.
        moved: Whether the two differ by more than they may.
        why_not: Why there is nothing measured; empty: too few views so far.
    """

    robot: str
    configured: str
    measured: str = ""
    floor_part: float | None = None
    moved: bool = False
    why_not: str = ""


def of_mounting(state: MountingState | None, *, watched: bool = True) -> Finding:
    """Whether the head sits where it is configured to.

    Args:
        state: The configured and the measured mounting; None before the first view.
        watched: Whether it is compared at all.
    """
    if state is None:
        why = "no view" if watched else "not watched: floor.watch is false"
        return Finding("mounting", OK, why)
    values: dict[str, object] = {"configured": state.configured}
    if state.measured:
        values |= {"by_the_floor": state.measured, "floor_part": f"{state.floor_part:.2f}"}
    if state.moved:
        text = (
            f"the head has moved: by the floor {state.measured or 'where it was last seen'}; "
            f"configured: {state.configured}; run `mrs calibrate --robot {state.robot}`"
        )
        return Finding("mounting", WARN, text, values, Code.HEAD_MOVED)
    if not state.measured:
        text = f"not enough floor in view to tell: {state.why_not or 'too few views so far'}"
        return Finding("mounting", OK, text, values)
    return Finding("mounting", values=values)


@dataclass(frozen=True)
class ScanState:
    """The last scan.

    Attributes:
        frames: Scans so far.
        silent_s: Time since then [s].
        ahead_s: What its stamp was ahead of the clock by when it was made [s].
        remedy: Advice on stamps far from the clock, appended to the sentence.
        figures: Counts and times of its stages, by name.
    """

    frames: int
    silent_s: float = 0.0
    ahead_s: float = 0.0
    remedy: str = ""
    figures: Mapping[str, object] = field(default_factory=dict)


def of_scan(state: ScanState) -> Finding:
    """Whether scans are made, with stamps of now.

    The stamp is compared with the clock when a scan is made: how old the last one has become since
    then tells nothing about clocks.
    """
    values = {"frames": state.frames, **state.figures}
    if not state.figures:
        return Finding("scan", STALE, "no scan yet", values, Code.NO_SCAN)
    if state.silent_s > SILENCE_S:
        text = f"no scan for {state.silent_s:.0f} s"
        return Finding("scan", STALE, text, values, Code.SCAN_SILENT)
    if abs(state.ahead_s) > OLD_STAMP_S:
        where = "ahead of" if state.ahead_s > 0 else "behind"
        text = f"stamps are {abs(state.ahead_s):.1f} s {where} this machine's clock{state.remedy}"
        return Finding("scan", WARN, text, values, Code.STAMPS_OFF)
    return Finding("scan", values=values)


@dataclass(frozen=True)
class PoseState:
    """The robot's pose.

    Attributes:
        source: Where it comes from (`pose.source`).
        error: Why that gives none now; empty: it does.
        silent_s: Time since TF had something new [s]; 0 for other sources.
        frames: The frames that TF is asked for, as "map -> base_link".
        pose: x, y [m] and yaw [rad] of the last one; None: none yet.
    """

    source: str
    error: str = ""
    silent_s: float = 0.0
    frames: str = ""
    pose: tuple[float, float, float] | None = None


def of_pose(state: PoseState) -> Finding:
    """Whether the robot knows where it is."""
    if state.error:
        return Finding("pose", ERROR, state.error, code=Code.NO_POSE)
    if state.silent_s > SILENCE_S:
        text = f"TF has nothing new of {state.frames} for {state.silent_s:.0f} s"
        return Finding("pose", ERROR, text, code=Code.NO_POSE)
    if state.pose is None:
        text = f"no usable pose on {state.source} yet"
        return Finding("pose", ERROR, text, code=Code.NO_POSE)
    x, y, yaw = state.pose
    return Finding("pose", values={"x": f"{x:.3f}", "y": f"{y:.3f}", "yaw": f"{yaw:.3f}"})


def of_monitor(verdict: Verdict | None) -> Finding:
    """What the collision monitor does with the robot's commands.

    Args:
        verdict: The last one; None: there are no commands.
    """
    if verdict is None:
        return Finding("collision_monitor", OK, "no commands")
    values = {"action": verdict.action.value, "speed": f"{verdict.velocity[0]:.2f}"}
    code, text = _LIMITS.get(verdict.action, (None, "slows down: "))
    if code is None:
        message = text + verdict.reason if verdict.reason else "ok"
        return Finding("collision_monitor", OK, message, values)
    return Finding("collision_monitor", WARN, text + verdict.reason, values, code)

"""Findings of the planner: on `tracked_people`, the intervals, and each robot as received."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

from mrs_people_loc.health.agreement import Misplaced
from mrs_people_loc.health.findings import ERROR, OK, OLD_STAMP_S, STALE, WARN, Code, Finding
from mrs_people_loc.team.intervals import offset_text
from mrs_people_loc.team.poses import Pose

#: A robot that delivers less than this share of the scans expected of it is reported, where more
#: than `_RATE_HZ` are.
_LEAST_RATE, _RATE_HZ = 0.5, 1.0
#: Robots of one team that are farther apart [m] are not where their poses say.
_FAR_APART_M = 1000.0
#: Reasons for which scans are left out: the code, and why.
LEFT_OUT = {
    "no_pose": (Code.LEFT_OUT_NO_POSE, "no pose near their stamps"),
    "too_old": (
        Code.LEFT_OUT_TOO_OLD,
        "older than the newest by more than interval.max_scan_age",
    ),
}


def of_people(topic: str, kind: str, publishers: Sequence[tuple[str, str]]) -> Finding:
    """Whether this planner is the only one, and what it publishes the topic's only type.

    Args:
        topic: Full name of `tracked_people`.
        kind: Its type.
        publishers: Full names of the nodes that publish it, and the type that each does; a single
            one may be left out.
    """
    others = [f"{name} publishes {of}" for name, of in sorted(publishers) if of != kind]
    if others:
        text = f"{topic} is {kind} here, but {', '.join(others)}: remap one of them"
        return Finding("people", WARN, text, {}, Code.WRONG_TYPE)
    if len(publishers) < 2:
        return Finding("people")
    names = sorted(name for name, _ in publishers)
    text = (
        f"{len(publishers)} publishers on {topic}: {', '.join(names)}; another "
        "planner, or a replay of one, is at work in this ROS domain: end it, or give it "
        "a namespace or a ROS_DOMAIN_ID of its own; or one was killed in the last 20 s"
    )
    return Finding("people", ERROR, text, {}, Code.TWO_PUBLISHERS)


def of_intervals(robots: Sequence[str], intervals: int, figures: Mapping[str, object]) -> Finding:
    """Whether there are intervals.

    Args:
        robots: The robots that are known.
        intervals: Intervals so far.
        figures: Counts and times of the last one, by name; empty before the first.
    """
    values = {"intervals": intervals, **figures}
    if not robots:
        text = "no robot yet: no namespace publishes both `points` and `pose`"
        return Finding("intervals", STALE, text, {"intervals": 0}, Code.NO_ROBOT)
    if not figures:
        return Finding("intervals", STALE, "no interval yet", {"intervals": 0}, Code.NO_INTERVAL)
    return Finding("intervals", values=values)


@dataclass(frozen=True)
class MemberState:
    """A robot as the planner receives it.

    Attributes:
        robot: Its name.
        points_topic: Full name of its topic `points`.
        points_publishers: How many publish that.
        scan_hz: Scans per second.
        pose_hz: Poses per second.
        poses_held: Poses that its scans can be placed with.
        stamp_resets: How often its stamps jumped back, so far.
        dropped: Scans that were not used so far, by reason.
        left_out_lately: The reasons, of `LEFT_OUT`, for which any was within the last seconds.
        age_s: Age of the last scan that was used [s]; None: none yet.
        silent_s: Time since the last scan arrived [s].
        clock_offset_ns: What its clock is ahead of the planner's by [ns]; None: not known.
        clock_astray_ns: What it is ahead of the others' by [ns]; None: no more than is allowed.
        max_clock_offset_s: What is allowed [s].
        remedy: Advice on stamps far from the clock, appended to the sentence.
        pose: Its newest pose; None: none.
        apart_m: How far that is from the nearest other robot [m]; None: there is no other.
        pose_jumps: How often it jumped, so far.
        last_jump: From where to where it did last; None: not within the last seconds.
        misplaced: How it would have to be moved; None: its people are where the others see them.
        quarantined: Why it is in quarantine; empty: it is not.
        doubted_by: Robots that doubt its pose.
        expected_hz: Scans per second that are expected of it.
        map_frame: The common frame.
    """

    robot: str
    points_topic: str
    points_publishers: int = 1
    scan_hz: float = 0.0
    pose_hz: float = 0.0
    poses_held: int = 0
    stamp_resets: int = 0
    dropped: Mapping[str, int] = field(default_factory=dict)
    left_out_lately: frozenset[str] = frozenset()
    age_s: float | None = None
    silent_s: float = 0.0
    clock_offset_ns: int | None = None
    clock_astray_ns: int | None = None
    max_clock_offset_s: float = math.inf
    remedy: str = ""
    pose: Pose | None = None
    apart_m: float | None = None
    pose_jumps: int = 0
    last_jump: tuple[Pose, Pose] | None = None
    misplaced: Misplaced | None = None
    quarantined: str = ""
    doubted_by: tuple[str, ...] = ()
    expected_hz: float = 0.0
    map_frame: str = "map"


def of_member(state: MemberState) -> Finding:
    """What is wrong with a robot; what keeps its scans out goes before what makes them worse."""
    level, code, text = (
        _reception(state) or _clock(state) or _losses(state) or _place(state) or _rate(state)
    ) or (OK, None, "ok")
    return Finding(f"robot {state.robot}", level, text, _member_values(state), code)


#: What one check finds: level, code and sentence; None: nothing is wrong.
_Verdict = tuple[bytes, Code, str] | None


def _reception(state: MemberState) -> _Verdict:
    """Whether scans and poses of one robot arrive at all."""
    if state.points_publishers > 1:
        text = (
            f"{state.points_publishers} publishers on {state.points_topic}: two robots share a "
            "name, rename one; or one was killed in the last 20 s"
        )
        return ERROR, Code.TWO_PUBLISHERS, text
    if state.age_s is None:
        return STALE, Code.NO_SCAN, "no scan used yet"
    if not state.poses_held:
        return ERROR, Code.NO_POSE, f"scans but no pose on {state.robot}/pose"
    return None


def _clock(state: MemberState) -> _Verdict:
    """Whether its clock agrees with the others', and with this machine's.

    How old its last scan has become since it came tells nothing about its clock.
    """
    allowed = f"allowed by interval.max_clock_offset: {state.max_clock_offset_s:g} s"
    astray_ns, offset_ns = state.clock_astray_ns, state.clock_offset_ns
    if astray_ns is not None:
        text = (
            f"its clock is {offset_text(astray_ns)} the others': its scans are left out; "
            f"{allowed}; synchronize the clocks (chrony or NTP on every machine)"
        )
        if astray_ns < 0:
            text += ", or see what keeps its messages back so long"
        return ERROR, Code.CLOCK_ASTRAY, text
    if state.silent_s > OLD_STAMP_S:
        return WARN, Code.SCAN_SILENT, f"no scan for {state.silent_s:.1f} s"
    if offset_ns is not None and abs(offset_ns) > state.max_clock_offset_s * 1e9:
        text = f"stamps are {offset_text(offset_ns)} this machine's clock; {allowed}{state.remedy}"
        return WARN, Code.STAMPS_OFF, text
    return None


def _losses(state: MemberState) -> _Verdict:
    """Whether its scans are left out, or some were lately."""
    if state.quarantined:
        text = (
            f"{state.robot} is in quarantine, its scans find no people: {state.quarantined}; they "
            "are used again when its pose has fitted for half a second"
        )
        return WARN, Code.QUARANTINED, text
    for reason, (code, why) in LEFT_OUT.items():
        if reason in state.left_out_lately:
            return WARN, code, f"{state.dropped[reason]} scans left out: {why}"
    return None


def _place(state: MemberState) -> _Verdict:
    """Whether it is where its pose says."""
    pose = state.pose
    if pose is not None and state.apart_m is not None and state.apart_m > _FAR_APART_M:
        text = (
            f"its pose is ({pose.x:.2f}, {pose.y:.2f}) m, {state.apart_m / 1e3:.1f} km from the "
            f"nearest other robot: is it in {state.map_frame}, the frame of the others?"
        )
        return WARN, Code.STRANGE_POSE, text
    if state.last_jump is not None:
        one, other = state.last_jump
        text = (
            f"its pose jumped from ({one.x:.2f}, {one.y:.2f}) m to ({other.x:.2f}, {other.y:.2f}) "
            f"m in {(other.stamp_ns - one.stamp_ns) / 1e9:.2f} s ({state.pose_jumps} jumps so far):"
            " its localization was lost or put right, or something else publishes its pose, too"
        )
        return WARN, Code.STRANGE_POSE, text
    if state.doubted_by:
        text = (
            f"its pose does not fit what {', '.join(state.doubted_by)} can tell; its scans are "
            "used, as it takes two, and most of the team, to leave a robot out: check whose pose "
            "is wrong"
        )
        return WARN, Code.DOUBTED, text
    if state.misplaced is not None:
        (x, y), turn = state.misplaced.move, math.degrees(state.misplaced.turn)
        text = (
            f"its people are not where the others see them ({state.misplaced.agreed:.0%} agree); "
            f"moved by ({x:.2f}, {y:.2f}) m in {state.map_frame} and turned by {turn:.0f} degrees "
            f"{state.misplaced.would_agree:.0%} would: check its pose (localization, "
            "pose.map_from_odom) and the mounting of its head"
        )
        return WARN, Code.MISPLACED, text
    return None


def _rate(state: MemberState) -> _Verdict:
    """Whether it delivers as many scans as are expected."""
    if state.expected_hz > _RATE_HZ and 0 < state.scan_hz < _LEAST_RATE * state.expected_hz:
        text = f"{state.scan_hz:.1f} scans per second; expected: {state.expected_hz:.1f}"
        return WARN, Code.SLOW, text
    return None


def _member_values(state: MemberState) -> dict[str, object]:
    values: dict[str, object] = {
        "scan_hz": f"{state.scan_hz:.1f}",
        "pose_hz": f"{state.pose_hz:.1f}",
        "poses_held": state.poses_held,
        "stamp_resets": state.stamp_resets,
        "pose_jumps": state.pose_jumps,
        **{f"dropped.{reason}": count for reason, count in state.dropped.items()},
    }
    if state.clock_offset_ns is not None:
        values["clock_offset_s"] = f"{state.clock_offset_ns / 1e9:.3f}"
    if state.age_s is not None:
        values["age_s"] = f"{state.age_s:.3f}"
    return values

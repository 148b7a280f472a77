"""Finding of a robot about its localization: what corrects its pose, and what does not fit."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np

from mrs_people_loc.health.findings import WARN, Code, Finding
from mrs_people_loc.health.sonars import SameReading
from mrs_people_loc.localization.filter.team_state import Source
from mrs_people_loc.localization.localizer import LocalizationState

#: A pose that nothing has corrected for so long is reported [s] ...
UNCORRECTED_S = 30.0
#: ... where its position's standard deviation is larger [m].
UNSURE_M = 0.15
#: Odometry with errors that are so many times those that are stated is reported.
NOISY = 3.0
#: Observations of a kind are reported after so many in a row that were refused ...
_REFUSED = 3
#: ... until none was for so long [ns].
_REFUSED_FOR_NS = 10_000_000_000
#: A robot that was carried is reported for so long, also when its pose is right again [ns].
_CARRIED_FOR_NS = 10_000_000_000
#: Systematic errors of wheels, in the order of `Wheels`.
_WHEELS = ("scale", "turn_per_metre", "turn_per_radian")
#: Odometry that is older tells nothing about the time now [ns].
_ODOMETRY_FOR_NS = 500_000_000


class RefusalWatch:
    """Which kinds of a robot's observations are refused again and again."""

    def __init__(self) -> None:
        self._last: dict[str, Source] = {}
        self._in_a_row: dict[str, int] = {}
        self._refused_ns: dict[str, int] = {}

    def update(self, own: Mapping[str, Source], now_ns: int) -> None:
        """Takes how observations fit, by kind; about once a second."""
        for kind, source in own.items():
            before = self._last.get(kind, Source())
            new = source.refused - before.refused
            if new:
                self._refused_ns[kind] = now_ns
            kept = self._in_a_row.get(kind, 0) if source.accepted == before.accepted else 0
            self._in_a_row[kind] = kept + new
            self._last[kind] = source

    def refused(self, now_ns: int) -> frozenset[str]:
        """The kinds that are refused at a time [ns]."""
        return frozenset(
            kind
            for kind, count in self._in_a_row.items()
            if count >= _REFUSED and now_ns - self._refused_ns[kind] < _REFUSED_FOR_NS
        )


def own_sources(robot: str, state: LocalizationState) -> dict[str, Source]:
    """How a robot's own observations fit, by kind."""
    found = sorted(state.sources.items())
    return {kind: source for (name, kind), source in found if name == robot}


@dataclass(frozen=True)
class LocalizationHealth:
    """How the localization of a robot goes.

    Attributes:
        robot: The robot's name in its team.
        state: What it knows.
        began_ns: When it began [ns].
        now_ns: The time, by the same clock as the stamps of odometry [ns].
        refused: Kinds of its observations that are refused again and again.
        dead_sonars: Its sonars that say the same all the time, by topic.
    """

    robot: str
    state: LocalizationState
    began_ns: int
    now_ns: int
    refused: frozenset[str] = frozenset()
    dead_sonars: Mapping[str, SameReading] = field(default_factory=dict)

    @property
    def own(self) -> dict[str, Source]:
        """How the robot's own observations fit, by kind."""
        return own_sources(self.robot, self.state)


def of_localization(health: LocalizationHealth) -> Finding:
    """How it goes: the most serious problem first, all of them in the sentence."""
    problems = list(_problems(health))
    values = _values(health)
    if not problems:
        return Finding("localization", values=values)
    values["problems"] = ", ".join(str(code) for code, _ in problems)
    text = "; ".join(text for _, text in problems)
    return Finding("localization", WARN, text, values, problems[0][0])


def _problems(health: LocalizationHealth) -> Iterator[tuple[Code, str]]:
    state, own = health.state, health.state.trust.get(health.robot)
    if own is not None and own.times_lost and state.stamp_ns - own.lost_ns < _CARRIED_FOR_NS:
        yield (
            Code.CARRIED,
            "what the robot sees did not fit where it was: it was carried or its wheels slipped; "
            + ("its pose is uncertain until observations fit" if own.lost else "they fit again"),
        )
    if state.hung_ns and state.stamp_ns - state.hung_ns < _CARRIED_FOR_NS:
        yield (
            Code.ODOMETRY_HANGS,
            "the odometry said the same from one moment to the next, while the robot drove: its "
            "driver hangs, or the robot was stopped hard; the pose is as unsure as if it drove on",
        )
    if state.doubted:
        yield (
            Code.MATE_DOUBTED,
            f"{_with_offsets(state.doubted)}: where they say they are does not fit what is seen; "
            "they are not used",
        )
    if state.misfits:
        offsets = {f"wall {k}": one.offset for k, one in sorted(state.misfits.items())}
        yield (
            Code.MAP_MISFIT,
            f"known walls are not where the map says: {_with_offsets(offsets)}; they are not used",
        )
    # Without odometry of its own the robot has no time to compare others' with.
    if state.clocks and health.now_ns - state.stamp_ns < _ODOMETRY_FOR_NS:
        clocks = ", ".join(f"{name} ({s:+.1f} s)" for name, s in sorted(state.clocks.items()))
        yield Code.MATE_CLOCK, f"clocks of team-mates differ: {clocks}; they are not used"
    refused = ", ".join(
        f"{kind} ({source.innovation:.1f} sigma, {source.refused} so far)"
        for kind, source in health.own.items()
        if kind in health.refused
    )
    if refused:
        yield Code.CORRECTIONS_REFUSED, f"observations do not fit and are refused: {refused}"
    corrected = [source.stamp_ns for source in health.own.values()]
    age_s = (state.stamp_ns - max([health.began_ns, *corrected])) / 1e9
    if age_s > UNCORRECTED_S and _is_unsure(state, health.robot):
        yield (
            Code.NOT_CORRECTED,
            f"nothing has corrected the pose for {age_s:.0f} s: no wall in sight, no absolute "
            "pose, no team-mate that sees the same; it is dead reckoning",
        )
    noise = _odometry_noise(health)
    if noise >= NOISY:
        yield (
            Code.ODOMETRY_NOISY,
            f"the odometry is {noise:.1f} times less certain than its covariances and "
            "localization.*_noise say",
        )
    if health.dead_sonars:
        dead = ", ".join(
            f"{topic} ({_reading(same)} for {same.seconds:.0f} s and {same.way:.1f} m)"
            for topic, same in health.dead_sonars.items()
        )
        yield Code.SONAR_DEAD, f"sonars say the same all the time while the robot drives: {dead}"


def _reading(same: SameReading) -> str:
    return "no echo" if same.value is None else f"{same.value:.3f} m"


def _odometry_noise(health: LocalizationHealth) -> float:
    """What standard deviations of the odometry are multiplied by."""
    own = health.state.trust.get(health.robot)
    return 1.0 if own is None else math.sqrt(own.noise)


def _is_unsure(state: LocalizationState, robot: str) -> bool:
    """Whether a robot's place is less sure than `UNSURE_M`: one that stands stays as sure."""
    pose = state.poses.get(robot)
    return pose is not None and float(np.linalg.eigvalsh(pose.covariance[:2, :2])[-1]) > UNSURE_M**2


def _with_offsets(offsets: Mapping[str, float]) -> str:
    return ", ".join(f"{name} (off by {abs(m):.2f} m)" for name, m in offsets.items())


def _values(health: LocalizationHealth) -> dict[str, object]:
    state, values = health.state, dict[str, object]()
    pose = state.poses.get(health.robot)
    if pose is not None:
        x, y, yaw = np.sqrt(np.diag(pose.covariance))
        values |= {"sigma_x": f"{x:.3f}", "sigma_y": f"{y:.3f}", "sigma_yaw": f"{yaw:.4f}"}
    for kind, source in health.own.items():
        key = kind.replace(" ", "_")
        values[f"{key}.accepted"] = source.accepted
        values[f"{key}.refused"] = source.refused
        values[f"{key}.innovation"] = f"{source.innovation:.2f}"
        if source.stamp_ns:
            values[f"{key}.age_s"] = f"{(state.stamp_ns - source.stamp_ns) / 1e9:.1f}"
    own = state.trust.get(health.robot)
    values |= {
        "team": ", ".join(sorted(state.poses)),
        "walls": len(state.walls),
        "times_lost": 0 if own is None else own.times_lost,
        "late": state.late,
        "resets": state.resets,
        "odometry_jumps": state.jumps,
        "odometry_noise": f"{_odometry_noise(health):.2f}",
    }
    for name, error, sigma in zip(_WHEELS, state.wheels, state.wheel_sigmas, strict=True):
        values |= {f"wheel_{name}": f"{error:.5f}", f"wheel_{name}.sigma": f"{sigma:.5f}"}
    return values

"""Which figures of a report have a target."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from mrs_studies.bench.growth import growth_of
from mrs_studies.bench.robot import PAIR_OF_THREE

#: What the tracker may take, by number of people [ms].
_TRACKER_MS = {10: 0.5, 200: 10.0}
#: What finding the walls of a view or a scan may take [ms].
_WALLS_MS = 1.0
#: What a step of the guide, at 5 Hz, and of one robot's drive, at 20 Hz, may take [ms].
_GUIDE_MS, _DRIVE_MS = 10.0, 2.0


@dataclass(frozen=True)
class Target:
    """A figure that has a target.

    Attributes:
        name: What it is.
        configuration: What it was measured with.
        value: The figure.
        limit: The target.
        unit: Of both.
        at_least: Whether the figure should be over the target, not under it.
    """

    name: str
    configuration: str
    value: float
    limit: float
    unit: str
    at_least: bool = False

    @property
    def reached(self) -> bool:
        """Whether the figure is on the right side."""
        return self.value >= self.limit if self.at_least else self.value <= self.limit

    def report(self) -> dict[str, Any]:
        """For the JSON."""
        return {**vars(self), "reached": self.reached}


def targets(report: Mapping[str, Any]) -> list[Target]:
    """The figures of a report that have a target: of each method's first configuration."""
    first: dict[bool, str] = {}
    for name, planner in report["planner"].items():
        first.setdefault(planner["of_bodies"], name)
    found = []
    for of_bodies, name in first.items():
        kinds = report["robot"].get(name, {})
        found += _targets_of_bodies(name, kinds) if of_bodies else _targets_of_cells(name, kinds)
        planner = report["planner"][name]
        where = f"{name}, {planner['robots']} robots, {planner['people']} people"
        took, limit = planner["stages_ms"]["whole"]["median"], 3.0 if of_bodies else 2.0
        found.append(Target("planner", where, took, limit, "ms"))
        for floor, rows in report["growth"].get(name, {}).items():
            ratio = growth_of(rows)
            if ratio is not None:
                what = f"planner per robot, {rows[-1]['robots']} robots : 4 robots"
                found.append(Target(what, f"{name}, {floor}", ratio, 1.0, ""))
    for row in report["tracking"]:
        if row["people"] in _TRACKER_MS:
            where, limit = f"{row['people']} people", _TRACKER_MS[row["people"]]
            found.append(Target("tracker, one interval", where, row["tracker_ms"], limit, "ms"))
    for row in report["walls"]:
        found.append(Target("walls", row["sensor"], row["median"], _WALLS_MS, "ms"))
    for row in report["localization"]:
        where = f"{row['robots']} robots"
        found.append(Target("shared pose, one robot", where, row["shared_ms"], 0.2, "ms"))
        found.append(Target("walls of a frame", where, row["walls_ms"], 1.0, "ms"))
        found.append(Target("whole filter, frame to frame", where, row["frame_ms"], 1.0, "ms"))
    guiding = report["guiding"]
    where = f"{guiding['robots']} robots, {guiding['people']} people"
    found.append(Target("guide, one step", where, guiding["guide_ms"], _GUIDE_MS, "ms"))
    found.append(Target("drive, one step of a robot", where, guiding["drive_ms"], _DRIVE_MS, "ms"))
    live = report["live"]
    if live is not None:
        latency = live["latency_ms"]["newest"]["p99"]
        found.append(Target("image to people, p99", live["configuration"], latency, 50.0, "ms"))
    return found


def _targets_of_cells(name: str, kinds: Mapping[str, Any]) -> list[Target]:
    binocular, where = kinds.get("binocular"), f"{name}, binocular"
    if binocular is None:
        return []
    ratio, rate = binocular["rest_to_stereo_bm"], binocular["frames_per_s"]
    return [
        Target("all but StereoBM : StereoBM", where, ratio, 1.0, ""),
        Target("whole pipeline, one core", where, rate, 500.0, "frames/s", True),
    ]


def _targets_of_bodies(name: str, kinds: Mapping[str, Any]) -> list[Target]:
    # The pair of the head that leads sees everybody; the others see what is not hidden.
    kind = PAIR_OF_THREE if PAIR_OF_THREE in kinds else "binocular"
    if kind not in kinds:
        return []
    took = kinds[kind]["stages_ms"]["whole"]["median"]
    seen = kinds[kind]["bodies"]
    return [Target(f"default frame, {seen:g} bodies", f"{name}, {kind}", took, 8.0, "ms")]

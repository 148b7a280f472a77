"""Rooms in which nobody is: people who are found there all the same."""

from __future__ import annotations

import statistics
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mrs_people_loc.config import load_team
from mrs_people_loc.errors import BagError, FloorError
from mrs_people_loc.planner import Planner
from mrs_people_loc.robot import RobotPipeline
from mrs_people_loc.sensing.images import StereoImages
from mrs_people_loc.team.poses import Pose
from mrs_people_sim.common import number, one_thread
from mrs_studies.experiment.suite_report import table
from mrs_studies.recordings.depth_views import StereoView
from mrs_studies.recordings.empty_rooms import HALVES, Room
from mrs_studies.recordings.frames import EPOCH_NS

#: A robot stands at each view for so many pairs, at this rate.
FRAMES, RATE_HZ = 50, 5.0
#: Ranges that are told apart end here [m].
RANGES_M = (2.0, 3.5, 5.0)
_ROBOT = "robot_a"
_HEAD = (
    "views",
    "left out",
    "minutes",
    "false people",
    "per minute",
    "per frame",
    "per single frame",
    "up to 2 m",
    "up to 3.5 m",
    "up to 5 m",
    "farther",
)


@dataclass(frozen=True)
class Count:
    """False people of some views.

    Attributes:
        views: Number of views.
        frames: Frames of all of them.
        present: How many people all frames have.
        single: Likewise where each frame is looked at by itself.
        ranges: Of each false person, a new id among the people in view, how far they were first
            seen [m].
        left_out: By view that cannot be used, why.
    """

    views: int = 0
    frames: int = 0
    present: int = 0
    single: int = 0
    ranges: tuple[float, ...] = ()
    left_out: Mapping[str, str] = field(default_factory=dict)

    @classmethod
    def pooled(cls, counts: Iterable[Count]) -> Count:
        """Several as one."""
        total = cls()
        for one in counts:
            total = cls(
                total.views + one.views,
                total.frames + one.frames,
                total.present + one.present,
                total.single + one.single,
                (*total.ranges, *one.ranges),
                {**total.left_out, **one.left_out},
            )
        return total

    @property
    def minutes(self) -> float:
        """How long one head looked [min]."""
        return self.frames / RATE_HZ / 60.0

    def per_frame(self, people: int) -> float | None:
        """So many people of all frames, per frame; None: there are none."""
        return people / self.frames if self.frames else None

    @property
    def per_minute(self) -> float | None:
        """False people per minute of one head; None: it saw nothing."""
        return len(self.ranges) / self.minutes if self.frames else None

    def by_range(self) -> list[int]:
        """False people up to each of `RANGES_M`, and farther away."""
        bins = np.searchsorted(RANGES_M, self.ranges)
        return np.bincount(bins, minlength=len(RANGES_M) + 1).tolist()

    def report(self) -> dict[str, Any]:
        """The figures."""
        return {
            "views": self.views,
            "left_out": dict(self.left_out),
            "minutes": self.minutes,
            "false_people": len(self.ranges),
            "false_people_per_minute": self.per_minute,
            "false_people_per_frame": self.per_frame(self.present),
            "false_people_per_single_frame": self.per_frame(self.single),
            "false_people_up_to_m": {
                str(limit): count
                for limit, count in zip([*RANGES_M, None], self.by_range(), strict=True)
            },
        }


def count_false(view: StereoView, *, seed: int = 0) -> Count:
    """The people who are found in a view while a robot stands there.

    Args:
        view: What its head sees.
        seed: Of the noise, which each image has of its own.
    """
    team = load_team(robots=(_ROBOT,))
    robot = RobotPipeline(_ROBOT, view.camera, team.robots[_ROBOT])
    planner, forgetful = Planner(team.planner), Planner(team.planner.memoryless())
    rng = np.random.default_rng(seed)
    ranges: dict[int, float] = {}
    present = single = 0
    for index in range(FRAMES):
        ns = EPOCH_NS + round(index * 1e9 / RATE_HZ)
        scan = robot.step(StereoImages(ns, *view.images(rng)))
        poses = {_ROBOT: Pose(ns, 0.0, 0.0, 0.0)}
        persons = planner.step([scan], poses, ns).persons
        single += len(forgetful.step([scan], poses, ns).persons)
        for person in persons:
            ranges.setdefault(person.id, float(np.hypot(*person.position)))
        present += len(persons)
    return Count(1, FRAMES, present, single, tuple(ranges.values()))


def run_rooms(
    rooms: Sequence[Room],
    folder: Path,
    *,
    on_progress: Callable[[str, float], None] = lambda what, share: None,
) -> tuple[dict[Room, Count], list[str]]:
    """Runs rooms with the default method.

    Args:
        rooms: The rooms.
        folder: Holds the checkouts of their sources.
        on_progress: Called with what is done and the share of it, 0 to 1.

    Returns:
        By room what was found, and a line for each room or view that is left out.

    Raises:
        BagError: None of them is there, or a picture cannot be read.
    """
    counts, lines = {}, []
    with one_thread():
        for index, room in enumerate(rooms):
            try:
                room.source.within(folder)
            except BagError as err:
                lines.append(f"{room.name}: {err}")
                continue
            views = []
            for seed, (name, view) in enumerate(room.views(folder)):
                on_progress(name, (index + seed / len(room.numbers)) / len(rooms))
                if isinstance(view, FloorError):
                    lines.append(f"{name}: left out, {view}")
                    views.append(Count(left_out={name: str(view)}))
                else:
                    views.append(count_false(view, seed=seed))
            counts[room] = Count.pooled(views)
    if not counts:
        raise BagError("; ".join([f"{folder} has none of the rooms", *lines]))
    return counts, lines


def as_json(counts: Mapping[Room, Count]) -> dict[str, Any]:
    """The figures: by room, by half, of all."""
    rooms = {
        room.name: {"half": room.half, "data_set": room.data_set, **count.report()}
        for room, count in counts.items()
    }
    halves = {label: {**one.report(), "median_room": _median(some)}
              for label, some in _groups(counts)[:-1] for one in (Count.pooled(some),)}  # fmt: skip
    everything = Count.pooled(counts.values()).report()
    total = {**everything, "median_room": _median(list(counts.values()))}
    return {"rooms": rooms, "halves": halves, "total": total}


def markdown(counts: Mapping[Room, Count]) -> str:
    """The figures as tables in Markdown."""
    sets = dict.fromkeys(room.data_set for room in counts)
    by_set = {
        name: Count.pooled(count for room, count in counts.items() if room.data_set == name)
        for name in sets
    }
    medians = [f"{label} {number(_median(some), 1, 1)}" for label, some in _groups(counts)]
    lines = [
        "## Results",
        "",
        "False people per minute in the median room: " + ", ".join(medians) + ".",
        "",
        *table(
            ("room", "half", *_HEAD),
            [
                *([room.name, room.half, *_figures(one)] for room, one in counts.items()),
                *(
                    [f"**{label}**", "", *_figures(Count.pooled(some))]
                    for label, some in _groups(counts)
                ),
            ],
        ),
        "",
        "By data set:",
        "",
        *table(("data set", *_HEAD), [[name, *_figures(one)] for name, one in by_set.items()]),
    ]
    return "\n".join(lines) + "\n"


def _groups(counts: Mapping[Room, Count]) -> list[tuple[str, list[Count]]]:
    """The halves of which there are rooms, and all."""
    halves = [(half, [c for room, c in counts.items() if room.half == half]) for half in HALVES]
    return [*(pair for pair in halves if pair[1]), ("all", list(counts.values()))]


def _median(counts: Sequence[Count]) -> float | None:
    """False people per minute in the median room that has a view; None: none has."""
    rates = [one.per_minute for one in counts if one.per_minute is not None]
    return statistics.median(rates) if rates else None


def _figures(one: Count) -> list[str]:
    return [
        str(one.views),
        str(len(one.left_out)),
        number(one.minutes, 1, 2),
        str(len(one.ranges)),
        number(one.per_minute, 1, 1),
        *(number(one.per_frame(people), 1, 2) for people in (one.present, one.single)),
        *map(str, one.by_range()),
    ]

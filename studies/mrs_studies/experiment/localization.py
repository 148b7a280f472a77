"""How well a team knows where it is: tours of 100 m, what goes wrong on them, and odometry alone.

Tours without rendering (`simulation.light.team`), with the localizers and the planner of the nodes.
All figures depend on the seeds alone.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np

from mrs_people_sim.light.team import LightTeam, TeamRun, Trouble
from mrs_people_sim.scene import Robot, load_scene
from mrs_people_sim.scoring.poses import (
    PoseScores,
    PoseTrack,
    in_true_frame,
    relative_errors,
    score_poses,
)
from mrs_people_sim.scoring.positions import Frame, score, summary
from mrs_people_sim.tours import tour_of
from mrs_studies.experiment.repeats import added_up
from mrs_tools.installing import default_file

#: A team is right again when no robot is farther from where it should be to another than this [m].
RIGHT_M = 0.25
#: ... for so long [s].
_FOR_S = 2.0
#: Wheels are known after so much of the way [m].
SETTLED_M = 20.0


@dataclass(frozen=True)
class Case:
    """A tour that is repeated with several seeds.

    Attributes:
        name: What the table calls it.
        scene: Its scene file, in `config/scenes` unless its path is absolute.
        trouble: What goes wrong.
        robots: By robot, what differs from the scene, as in `scene.Robot`.
        people: How many walk with them; 0: as many as in the scene.
        wheels: Whether the robots have the wheels of `WHEELS`, one after the other, and `BUMPS`.
        event_s: When something happens that the team has to recover from [s]; None: nothing does.
    """

    name: str
    scene: str
    trouble: Trouble = field(default_factory=Trouble)
    robots: Mapping[str, Mapping[str, Any]] = field(default_factory=dict)
    people: int = 0
    wheels: bool = False
    event_s: float | None = None


#: Systematic errors of wheels, see `scene.Robot.wheels`.
WHEELS = ((0.03, 0.0015, 0.01), (-0.01, -0.002, -0.01), (0.015, 0.001, 0.01))
#: One threshold in ten metres: 1 cm, 1 degree.
BUMPS = (10.0, 0.01, np.radians(1.0))
_L, _HALL = "tour_l_corridor.yaml", "tour_hall.yaml"


def _fault(name: str, at_s: float, **robot: Any) -> Case:
    """Something happens to `robot_b` in the corridor."""
    return Case(f"robot_b {name} at {at_s:.0f} s", _L, robots={"robot_b": robot}, event_s=at_s)


CASES = (
    Case("L corridor", _L),
    Case("straight corridor, walls known", "tour_straight_corridor.yaml", Trouble(known=True)),
    Case("hall, no wall in range", _HALL),
    Case("loop", "tour_loop.yaml"),
    Case("L corridor, walls known", _L, Trouble(known=True)),
    _fault("carried 0.5 m", 60.0, carried=(60.0, 0.0, 0.5, 0.0)),
    _fault("carried 1.5 m and 52 degrees", 60.0, carried=(60.0, -1.5, 0.0, np.radians(52.0))),
    *(_fault(f"turned {angle} degrees", 60.0, carried=(60.0, 0.0, 0.0, np.radians(angle)))
      for angle in (25, 40)),
    *(_fault(f"frozen for {lasts} s", 60.0, frozen=(60.0, float(lasts))) for lasts in (1, 3, 5)),
    _fault("frozen for 5 s and jumping", 60.0, frozen=(60.0, 5.0), catches_up=True),
    Case("robot_b restarted 40 m from its start", _L, Trouble(restarted=("robot_b", 48.0)),
         event_s=48.0),
    Case("L corridor, wheels", _L, wheels=True),
    Case("L corridor, wheels, one person", _L, wheels=True, people=1),
    Case("hall, wheels", _HALL, wheels=True),
    *(Case(f"niches, wheels, sonars at 5 Hz{more}", "tour_niches.yaml",
           Trouble(known=bool(more), sonars=5.0), wheels=True) for more in ("", ", walls known")),
    Case("parallel walls, wheels, laser", "tour_parallel.yaml", wheels=True),
    Case("slanted walls, wheels", "tour_slanted.yaml", wheels=True),
    Case("sonars dead", _L, Trouble(sonars=0.0)),
    Case("map wrong by 1 m", _L, Trouble(known=True, map_off=1.0)),
    Case("robot_b says it is 1 m off", _L, Trouble(lies="robot_b")),
    Case("robot_b says it is 1 m off from 60 s on", _L, Trouble(lies="robot_b", lies_from=60.0),
         event_s=60.0),
    Case("20 % of messages lost", _L, Trouble(lost=0.2)),
    Case("robot_c cut off from 50 to 80 s", _L, Trouble(cut_off=("robot_c", 50.0, 80.0)),
         event_s=80.0),
    Case("start known to 1 m, 15 degrees", _L, Trouble(start=(1.0, 1.0, np.radians(15.0))),
         event_s=0.0),
)  # fmt: skip


@dataclass(frozen=True)
class CaseScores:
    """Scores of a case; those of several seeds are added.

    Attributes:
        localized: Of the poses of the localizers.
        odometry: Of odometry alone.
        people: People with exact poses, in the team's frame with those of the localizers and with
            odometry alone.
        named: What was said to be wrong, and how long after the event, or the start [s].
        right_s: For each seed, how long after the event the team was right again [s]; NaN: never.
        settled: As `localized`, once the team has driven `SETTLED_M`.
    """

    localized: PoseScores = field(default_factory=PoseScores)
    odometry: PoseScores = field(default_factory=PoseScores)
    people: Mapping[str, tuple[Frame, ...]] = field(default_factory=dict)
    named: Mapping[str, tuple[float, ...]] = field(default_factory=dict)
    right_s: tuple[float, ...] = ()
    settled: PoseScores = field(default_factory=PoseScores)

    def __add__(self, other: CaseScores) -> CaseScores:
        def joined(one: Mapping[str, tuple], two: Mapping[str, tuple]) -> dict[str, tuple]:
            return {key: one.get(key, ()) + two.get(key, ()) for key in {**one, **two}}

        return CaseScores(
            self.localized + other.localized,
            self.odometry + other.odometry,
            joined(self.people, other.people),
            joined(self.named, other.named),
            self.right_s + other.right_s,
            self.settled + other.settled,
        )

    def report(self) -> dict[str, Any]:
        """The figures, as the JSON of the command has them."""
        return {
            "localized": self.localized.report(),
            "odometry": self.odometry.report(),
            "people": {way: summary(frames)["people"] for way, frames in self.people.items()},
            "named_s": {what: [*times] for what, times in self.named.items()},
            "settled": {"relative": self.settled.report()["relative"]},
            "right_again_s": [None if np.isnan(s) else s for s in self.right_s],
        }


def cases_in(scene: Path) -> tuple[Case, ...]:
    """Cases in a scene of one's own: its odometry, or wheels that err, walls unknown or known."""
    return tuple(
        Case(", ".join([scene.stem, *wheels, *known]), str(scene.resolve()),
             Trouble(known=bool(known)), wheels=bool(wheels))
        for wheels in ([], ["wheels"]) for known in ([], ["walls known"])
    )  # fmt: skip


def run_cases(
    cases: Sequence[Case], seeds: int, *, first: int = 1, jobs: int = 1
) -> Iterator[CaseScores]:
    """Runs cases.

    Args:
        cases: The cases.
        seeds: Seeds of each.
        first: The first of them.
        jobs: Processes.

    Yields:
        The scores of each case, in their order.
    """
    yield from added_up(run_case, cases, [seeds] * len(cases), CaseScores(), first=first, jobs=jobs)


def run_case(case: Case, seed: int) -> CaseScores:
    """Runs a case with one seed."""
    scene = load_scene(default_file("config", "scenes") / case.scene)
    layout = dataclasses.replace(scene.layout, people=case.people or scene.layout.people)
    scene = dataclasses.replace(scene, layout=layout, robots=_changed(scene.robots, case))
    tour = tour_of(scene, seed)
    run = LightTeam(tour, case.trouble, seed).run()
    since = case.event_s or 0.0
    placed = {
        "exact": run.people["exact"],
        "localized": in_true_frame(run.people["localized"], run.true, run.used),
        "odometry": in_true_frame(run.people["odometry"], run.true, run.odometry),
    }
    return CaseScores(
        score_poses(run.true, run.localized) or PoseScores(),
        score_poses(run.true, run.odometry) or PoseScores(),
        {way: tuple(score(run.truth, people)) for way, people in placed.items()},
        {what: (at - since,) for what, at in run.named.items()},
        () if case.event_s is None else (_right_after(run, case.event_s),),
        score_poses(run.true, _settled(run)) or PoseScores(),
    )


def _settled(run: TeamRun) -> dict[str, PoseTrack]:
    """The localizers' poses once the first robot has driven `SETTLED_M`."""
    first = next(iter(run.true.values()))
    way = np.hypot(*np.diff(first.poses[:, :2], axis=0).T).cumsum()
    later = first.stamps_ns[1:][way >= SETTLED_M]
    return {
        name: track.select(track.stamps_ns >= later.min(initial=track.stamps_ns[-1]))
        for name, track in run.localized.items()
    }


def _changed(robots: Mapping[str, Robot], case: Case) -> dict[str, Robot]:
    """The robots of a scene as a case has them."""
    changed = {}
    for (name, robot), wheels in zip(robots.items(), cycle(WHEELS)):
        of_all = {"wheels": wheels, "bumps": BUMPS} if case.wheels else {}
        changed[name] = dataclasses.replace(robot, **{**of_all, **case.robots.get(name, {})})
    return changed


def _right_after(run: TeamRun, event_s: float) -> float:
    """How long after an event no robot is wrong to another by more than `RIGHT_M` [s]."""
    stamps, worst = _worst(run.true, run.localized)
    seconds = (stamps - run.start_ns) / 1e9 - event_s
    wrong = worst > RIGHT_M
    for k in np.flatnonzero((seconds >= 0.0) & ~wrong):
        if not wrong[(seconds >= seconds[k]) & (seconds < seconds[k] + _FOR_S)].any():
            return float(seconds[k])
    return float("nan")


def _worst(
    true: Mapping[str, PoseTrack], localized: Mapping[str, PoseTrack]
) -> tuple[np.ndarray, np.ndarray]:
    """Stamps [ns], and the largest relative error of any two robots then [m], each (n,)."""
    stamps = next(iter(localized.values())).stamps_ns
    pairs = relative_errors(true, localized, stamps)
    sizes = np.hypot(pairs[..., 0], pairs[..., 1])
    return stamps, np.nanmax(sizes, axis=0)

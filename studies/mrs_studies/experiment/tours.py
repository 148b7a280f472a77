"""How well a team guides groups: tours of 60 m, and what goes wrong on them.

Tours in a closed loop without rendering (`simulation.light.guided_tour`), with the code of the
nodes. All figures depend on the seeds alone.
"""

from __future__ import annotations

import dataclasses
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mrs_people_loc.guiding.guidance import Guidance, Role
from mrs_people_sim.guided import guided_scene
from mrs_people_sim.light.guided_tour import OFF_M, POSES, LightTour, TourRun, Trouble
from mrs_people_sim.scoring.positions import sums_of
from mrs_people_sim.scoring.tours import TourScores, leaders_way, off_post, score_tour
from mrs_studies.experiment.repeats import added_up
from mrs_tools.installing import default_file

#: A group that stays within this distance of a straggler waits for them [m].
WAITS_M = 8.0
#: Robots are in formation while all are within this distance of their posts [m].
FORMED_M = 1.0
#: A robot stands below this speed [m/s].
_STANDS = 0.01
#: When the planner ends [s]: right after it has published, when the guide misses it last.
_PLANNER_ENDS_S = 60.16
#: Fewest and most people; each seed has another number.
_PEOPLE = 5, 10


@dataclass(frozen=True)
class Case:
    """A tour that is repeated with several seeds.

    Attributes:
        name: What the table calls it.
        scene: Its scene file, in `config/scenes` unless its path is absolute.
        poses: Where the team takes its poses from, one of `light.guided_tour.POSES`.
        trouble: What goes wrong.
        robots: How many guide; None: they and the people are as in the scene.
        leavers: How many people leave for good; None: as in the scene.
        ignored: Whether the scene's bystanders walk as if there were no robots.
        heads_alone: Whether robots have neither sonars nor laser scanners.
        main: Whether it is repeated with all seeds, or with `FEW` at most.
    """

    name: str
    scene: str
    poses: str = "exact"
    trouble: Trouble = field(default_factory=Trouble)
    robots: int | None = 3
    leavers: int | None = 0
    ignored: bool = False
    heads_alone: bool = False
    main: bool = False


_CORRIDOR = "guided_corridor.yaml"
_SCENES = {
    "corridor": _CORRIDOR,
    "hall": "guided_hall.yaml",
    "doors": "guided_doors.yaml",
    "loop": "guided_loop.yaml",
}
CASES = (
    *(Case(name, scene, main=True) for name, scene in _SCENES.items()),
    *(
        Case(f"{name}, {poses} poses", scene, poses)
        for poses in ("localized", "odometry")
        for name, scene in _SCENES.items()
    ),
    *(Case(f"hall, {count} robots", _SCENES["hall"], robots=count) for count in (2, 4)),
    Case("corridor, heads alone", _CORRIDOR, heads_alone=True),
    Case("hall, one person leaves for good", _SCENES["hall"], leavers=1),
    Case("hall, two people leave for good", _SCENES["hall"], leavers=2),
    Case("corridor, robot_a (leader) killed at 60 s", _CORRIDOR,
         trouble=Trouble(killed=("robot_a", 60.0))),
    Case("corridor, robot_b killed at 60 s", _CORRIDOR, trouble=Trouble(killed=("robot_b", 60.0))),
    Case("corridor, robot_c gone from 60 to 90 s", _CORRIDOR,
         trouble=Trouble(killed=("robot_c", 60.0), back=90.0)),
    Case("corridor, no planner from 60 to 65 s", _CORRIDOR,
         trouble=Trouble(planner_gone=(_PLANNER_ENDS_S, 65.0))),
    Case(f"corridor, pose of robot_b {OFF_M:g} m off from 60 s on", _CORRIDOR, "localized",
         Trouble(misplaced=("robot_b", 60.0))),
    Case("corridor, robot_b delivers no scans from 60 s on", _CORRIDOR,
         trouble=Trouble(silent=("robot_b", 60.0))),
    Case("corridor, robot_b blind from 60 s on", _CORRIDOR,
         trouble=Trouble(blind=("robot_b", 60.0))),
    Case("narrow, 12 people, 4 robots", "guided_narrow.yaml", "localized",
         robots=None, leavers=None),
    Case("bystanders", "guided_bystanders.yaml", "localized"),
    Case("bystanders who ignore robots", "guided_bystanders.yaml", "localized", ignored=True),
    Case("narrow, somebody comes against 12 people, 4 robots", "guided_narrow_against.yaml",
         "localized", robots=None, leavers=None),
)  # fmt: skip
#: Cases that are not `main` have so many seeds at most.
FEW = 3


@dataclass(frozen=True)
class CaseScores:
    """Scores of a case; those of several seeds are added.

    Attributes:
        tour: Of the tours.
        stragglers: How many people stopped on the way.
        fetched: How many of them a robot made go on.
        waited_for: How many others the group waited for: it stayed within `WAITS_M`.
        bumps: How often a robot ran into something.
        reposted_s: Of each robot that was killed: when the others had posts without it [s] after
            it; NaN: never.
        others_s: ... when all but the successor of a leader were there [s],
        formed_s: ... and when all were [s].
        stood_s: Of each time without a planner: how long it took until all stood [s]; NaN: never.
        events: How often the guide said what, by its words without numbers and names.
    """

    tour: TourScores = field(default_factory=TourScores)
    stragglers: int = 0
    fetched: int = 0
    waited_for: int = 0
    bumps: int = 0
    reposted_s: tuple[float, ...] = ()
    others_s: tuple[float, ...] = ()
    formed_s: tuple[float, ...] = ()
    stood_s: tuple[float, ...] = ()
    events: Counter[str] = field(default_factory=Counter)

    def __add__(self, other: CaseScores) -> CaseScores:
        return CaseScores(**sums_of(self, other))

    def report(self) -> dict[str, Any]:
        """The figures, as the JSON of the command has them."""
        return {
            "tour": self.tour.report(),
            "stragglers": {
                "stopped": self.stragglers,
                "fetched": self.fetched,
                "waited_for": self.waited_for,
            },
            "bumps": self.bumps,
            **{
                name: [None if np.isnan(s) else s for s in getattr(self, name)]
                for name in ("reposted_s", "others_s", "formed_s", "stood_s")
            },
            "events": dict(sorted(self.events.items())),
        }


def cases_in(scene: Path) -> tuple[Case, ...]:
    """Cases in a scene of one's own, with all kinds of poses."""
    return tuple(
        Case(f"{scene.stem}, {poses} poses", str(scene.resolve()), poses,
             robots=None, leavers=None, main=True)
        for poses in POSES
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
    counts = [seeds if case.main else min(seeds, FEW) for case in cases]
    yield from added_up(run_case, cases, counts, CaseScores(), first=first, jobs=jobs)


def run_case(case: Case, seed: int) -> CaseScores:
    """Runs a case with one seed."""
    least, most = _PEOPLE
    people = None if case.robots is None else least + (seed - 1) % (most - least + 1)
    path = default_file("config", "scenes") / case.scene
    scene = guided_scene(path, seed, people=people, robots=case.robots)
    if case.leavers is not None:
        followers = dataclasses.replace(scene.followers, leavers=case.leavers)
        scene = dataclasses.replace(scene, followers=followers)
    if case.heads_alone:
        scene = dataclasses.replace(scene, sonars={}, lasers={})
    if case.ignored:
        others = (dataclasses.replace(one, ignores=True) for one in scene.bystanders)
        scene = dataclasses.replace(scene, bystanders=tuple(others))
    run = LightTour(scene, case.poses, case.trouble).run()
    stays = run.world.crowd.stragglers.stays
    fetched = sum(stay.fetched for stay in stays)
    waited_for = sum(not s.fetched and _is_near(run, s.person, s.begin_s, s.end_s) for s in stays)
    return CaseScores(
        score_tour(run.record), len(stays), fetched, waited_for, run.world.bumps,
        *_after_killed(run, case.trouble), _stood(run, case.trouble), _events(run),
    )  # fmt: skip


def _events(run: TourRun) -> Counter[str]:
    """What the guide said, without numbers and names."""
    said = (event for status in run.record.statuses for event in status.events)
    return Counter(re.sub(r"\b(robot_\w|\d[\d.]*)(, (robot_\w|\d+))*", "_", one) for one in said)


def _is_near(run: TourRun, person: int, begin_s: float, end_s: float) -> bool:
    """Whether the middle of the group stays within `WAITS_M` of somebody."""
    truth = run.record.truth
    seconds = (truth.stamps_ns - run.start_ns) / 1e9
    xy = truth.positions[(seconds >= begin_s) & (seconds <= end_s)]
    middle = np.median(np.delete(xy, person, axis=1), axis=1)
    return bool((np.linalg.norm(middle - xy[:, person], axis=1) <= WAITS_M).all())


def _after_killed(
    run: TourRun, trouble: Trouble
) -> tuple[tuple[float, ...], tuple[float, ...], tuple[float, ...]]:
    """When, after a robot was killed, the others have posts, and when they are there [s].

    Returns:
        When they have them; when all but a leader's successor are there; when all are. Each empty
        where nobody was killed; NaN: never.
    """
    if trouble.killed is None:
        return (), (), ()
    killed, at_s = trouble.killed
    reposted = others = formed = float("nan")
    led = False
    for status in run.record.statuses:
        after_s = (status.stamp_ns - run.start_ns) / 1e9 - at_s
        if killed in status.posts:
            led = status.posts[killed].role == Role.LEADER
        elif after_s >= 0.0 and status.posts:
            off = _off_posts(run, status)
            rest = [off[n] for n, p in status.posts.items() if not (led and p.role == Role.LEADER)]
            reposted = after_s if np.isnan(reposted) else reposted
            if np.isnan(others) and max(rest, default=0.0) <= FORMED_M:
                others = after_s
            if max(off.values()) <= FORMED_M:
                formed = after_s
                break
    return (reposted,), (others,), (formed,)


def _off_posts(run: TourRun, status: Guidance) -> dict[str, float]:
    """Distances of robots from where they should be [m]."""
    stamp, way = np.array([status.stamp_ns]), leaders_way(run.record.statuses)
    return {
        name: off_post(status, name, run.record.robots[name].at(stamp)[0, :2], way)
        for name in status.posts
    }


def _stood(run: TourRun, trouble: Trouble) -> tuple[float, ...]:
    """How long after the planner was gone all robots stood [s]; NaN: never."""
    if trouble.planner_gone is None:
        return ()
    begin_s, end_s = trouble.planner_gone
    times, speeds = run.speeds[:, 0], run.speeds[:, 1:].max(axis=1)
    while_gone = (times >= begin_s) & (times < end_s)
    moving = times[while_gone & (speeds > _STANDS)]
    if len(moving) and moving[-1] >= times[while_gone][-1]:
        return (float("nan"),)
    return (float(moving[-1]) - begin_s if len(moving) else 0.0,)

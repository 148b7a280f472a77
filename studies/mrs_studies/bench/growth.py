"""What the planner costs as the team grows: part of `mrs bench`.

Teams from 1 robot to hundreds, simulated (`scenes`): for every four robots there are ten more
people and another 8 x 7 m of floor. Two floors: rooms that lie apart, and one without walls.

Before they are timed, teams of up to eight robots are compared with the oracle, which takes every
pair of bodies and of cells; and on the floor of rooms, however large, the people must be those that
each room has by itself, to the last bit.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from mrs_people_loc import timing
from mrs_people_loc.config import PlannerConfig, RobotConfig, load_team
from mrs_people_loc.people import Person
from mrs_people_loc.planner import People, Planner
from mrs_studies.bench.differs import same
from mrs_studies.bench.oracle import Oracle
from mrs_studies.bench.scenes import INTERVAL_NS, ROBOTS, Scene, in_rooms, on_one_floor, people_of

#: Robots of the largest team.
LARGEST = 256
#: Where the per-robot cost of larger teams is compared with: a whole room.
_ROOM = len(ROBOTS)
#: Teams up to this are compared with the oracle, whose cost is that of all pairs.
_COMPARED = 8
#: Scenes of each size, and rooms that differ, each with noise of its own.
_NOISES = 4
#: Each size gets so many intervals, and the small ones so many more in a round that they are long.
_ROUNDS, _PER_ROUND = 12, 16

_FLOORS: Mapping[str, Callable[[RobotConfig, int, int], Scene]] = {
    "rooms apart": partial(in_rooms, noises=_NOISES),
    "one floor": on_one_floor,
}


def time_growth(
    configs: Mapping[str, Path],
    largest: int,
    oracle: Oracle,
    *,
    rounds: int = _ROUNDS,
    on_step: Callable[[str], None] = lambda _: None,
) -> dict[str, dict[str, list[dict[str, Any]]]]:
    """Times the planner with 1, 2, 4, ... robots.

    Args:
        configs: Parameter files by name.
        largest: The largest team.
        oracle: What the small teams are compared with before.
        rounds: Each size is run so often, at least; sizes take turns, so that what else the machine
            does slows them alike.
        on_step: Told what is done now.

    Returns:
        By configuration and floor, for each size: how many robots, people, cells and people found
        there are, and the median [ms] of an interval.

    Raises:
        DiffersError: A result differs from what it should be; nothing is timed then.
    """
    sizes = [2**k for k in range(largest.bit_length()) if 2**k <= largest]
    result: dict[str, dict[str, list[dict[str, Any]]]] = {}
    for name, path in configs.items():
        team = load_team(path, robots=("robot",))
        alone, config = Planner(team.planner.memoryless()), team.robots["robot"]
        for floor, draw in _FLOORS.items():
            on_step(f"drawing {name}, {floor}, up to {sizes[-1]} robots")
            scenes = {n: [draw(config, n, noise) for noise in range(_NOISES)] for n in sizes}
            found = {n: alone.step(*scenes[n][0], 0) for n in sizes}
            for n, people in found.items():
                _check(floor, scenes[n][0], people, team.planner, oracle)
            on_step(f"timing {name}, {floor}, up to {sizes[-1]} robots")
            took = _time({n: Planner(team.planner) for n in sizes}, scenes, rounds)
            result.setdefault(name, {})[floor] = [
                {
                    "robots": n,
                    "people": people_of(n),
                    "people_found": len(found[n].persons),
                    "cells": len(found[n].fused),
                    "ms": took[n],
                    "ms_per_robot": took[n] / n,
                }
                for n in sizes
            ]
    return result


def growth_of(rows: Sequence[Mapping[str, Any]]) -> float | None:
    """What a robot of the largest team costs, in what one of a single room costs; None: no such."""
    per_robot = {row["robots"]: row["ms_per_robot"] for row in rows}
    largest = max(per_robot)
    return per_robot[largest] / per_robot[_ROOM] if largest > _ROOM else None


def _time(
    planners: Mapping[int, Planner], scenes: Mapping[int, Sequence[Scene]], rounds: int
) -> dict[int, float]:
    """Median of an interval by number of robots [ms]."""
    took: dict[int, list[float]] = {n: [] for n in scenes}
    time_ns = 0
    for turn in range(rounds):
        for n, drawn in scenes.items():
            for again in range(max(1, _PER_ROUND // n)):
                scans, poses = drawn[(turn + again) % len(drawn)]
                time_ns += INTERVAL_NS
                began = timing.now_ns()
                planners[n].step(scans, poses, time_ns)
                took[n].append((timing.now_ns() - began) / 1e6)
    return {n: float(np.median(ms)) for n, ms in took.items()}


def _check(floor: str, scene: Scene, people: People, config: PlannerConfig, oracle: Oracle) -> None:
    scans, poses = scene
    if len(scans) <= _COMPARED:
        oracle.check_people(scans, people, config)
    if floor != "rooms apart":
        return
    alone: list[Person] = []
    for first in range(0, len(scans), _ROOM):
        of_room = scans[first : first + _ROOM]
        own = {scan.robot: poses[scan.robot] for scan in of_room}
        alone += Planner(config.memoryless()).step(of_room, own, 0).persons
    name = f"{len(scans)} robots in {floor}"
    same(f"{name}: number of people", len(people.persons), len(alone))
    together, alone = (
        sorted(persons, key=lambda person: tuple(person.position))
        for persons in (people.persons, alone)
    )
    for field in ("position", "covariance", "height", "sigma", "robots"):
        got, wanted = (
            np.array([" ".join(p.robots) if field == "robots" else getattr(p, field) for p in of])
            for of in (together, alone)
        )
        same(f"{name}: {field} of people", got, wanted)

"""What following people costs, with many of them; tracks are compared with the oracle first."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mrs_people_loc import timing
from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.following.groups import Groups
from mrs_people_loc.following.tracks import Tracker
from mrs_people_loc.people import Person
from mrs_studies.bench.oracle import Oracle
from mrs_studies.bench.scenes import INTERVAL_NS

#: How many people, and how many intervals are run before the clock is looked at.
SIZES = (10, 50, 200)
_BEFORE = 20
#: What is found of them is off by this [m], and so it says.
_SIGMA = 0.04


def time_tracking(
    intervals: int,
    oracle: Oracle,
    on_step: Callable[[str], None] = lambda _: None,
) -> list[dict[str, Any]]:
    """Times the tracker and the groups with people who walk to and fro.

    Args:
        intervals: So many are timed for each number of people.
        oracle: What the filters are compared with before.
        on_step: Told what is done now.

    Returns:
        For each number of people: the medians [ms].

    Raises:
        DiffersError: A track is not where the oracle has it; nothing is timed then.
    """
    rows = []
    for count in SIZES:
        on_step(f"following {count} people")
        # The oracle has no gate.
        config = PlannerConfig.from_mapping({"tracking.gate": 20.0})
        tracker, groups = Tracker(config.tracking), Groups(config.groups)
        told: list[Sequence[Person]] = []
        took: dict[str, list[float]] = {"tracker": [], "groups": []}
        times_ns = [step * INTERVAL_NS for step in range(_BEFORE + intervals)]
        for step, now_ns in enumerate(times_ns):
            found = found_people(count, step)
            began = timing.now_ns()
            people = tracker.step(found, now_ns)
            between = timing.now_ns()
            groups.step(people, now_ns)
            ended = timing.now_ns()
            if step < _BEFORE:
                told.append(found)
                if len(told) == _BEFORE:
                    oracle.check_tracks(told, people, times_ns[:_BEFORE], config)
                continue
            took["tracker"].append((between - began) / 1e6)
            took["groups"].append((ended - between) / 1e6)
        medians = {f"{stage}_ms": float(np.median(ms)) for stage, ms in took.items()}
        rows.append({"people": count, "intervals": intervals, **medians})
    return rows


def found_people(count: int, step: int) -> list[Person]:
    """People on a grid of 2 m, who walk to and fro, each in their own way and never near others."""
    rng = np.random.default_rng([count, step])
    side = int(np.ceil(np.sqrt(count)))
    people = []
    for number in range(count):
        phase = number + step / 10.0
        middle = np.array([2.0 * (number % side), 2.0 * (number // side)])
        place = middle + 0.5 * np.array([np.sin(phase), np.cos(0.7 * phase)])
        people.append(
            Person(
                position=place + rng.normal(0.0, _SIGMA, 2), covariance=_SIGMA**2 * np.eye(2),
                height=1.7, sigma=0.1, robots=("robot_a",), label=number, score=4.0,
                stamp_ns=step * INTERVAL_NS,
            )
        )  # fmt: skip
    return people

"""What following people costs, with many of them; the filter is compared with plain loops first."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from mrs_people_loc import timing
from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.following.groups import Groups
from mrs_people_loc.following.tracks import Tracker
from mrs_people_loc.people import Person
from mrs_tools.bench.differs import near, same
from mrs_tools.bench.scenes import INTERVAL_NS

#: How many people, and how many intervals are run before the clock is looked at.
SIZES = (10, 50, 200)
_BEFORE = 20
#: What is found of them is off by this [m], and so it says.
_SIGMA = 0.04


def time_tracking(
    intervals: int, on_step: Callable[[str], None] = lambda _: None
) -> list[dict[str, Any]]:
    """Times the tracker and the groups with people who walk to and fro.

    Args:
        intervals: So many are timed for each number of people.
        on_step: Told what is done now.

    Returns:
        For each number of people: the medians [ms].

    Raises:
        DiffersError: A track is not where plain loops have it; nothing is timed then.
    """
    rows = []
    for count in SIZES:
        on_step(f"following {count} people")
        # The plain loops have no gate.
        config = PlannerConfig.from_mapping({"tracking.gate": 20.0})
        tracker, groups = Tracker(config.tracking), Groups(config.groups)
        told: list[Sequence[Person]] = []
        took: dict[str, list[float]] = {"tracker": [], "groups": []}
        for step in range(_BEFORE + intervals):
            now_ns, found = step * INTERVAL_NS, _found(count, step)
            began = timing.now_ns()
            people = tracker.step(found, now_ns)
            between = timing.now_ns()
            groups.step(people, now_ns)
            ended = timing.now_ns()
            if step < _BEFORE:
                told.append(found)
                if len(told) == _BEFORE:
                    _check(told, people, config)
                continue
            took["tracker"].append((between - began) / 1e6)
            took["groups"].append((ended - between) / 1e6)
        medians = {f"{stage}_ms": float(np.median(ms)) for stage, ms in took.items()}
        rows.append({"people": count, "intervals": intervals, **medians})
    return rows


def _found(count: int, step: int) -> list[Person]:
    """People on a grid of 2 m, who walk to and fro, each his own way, and never near each other."""
    rng = np.random.default_rng([count, step])
    side = int(np.ceil(np.sqrt(count)))
    people = []
    for who in range(count):
        phase = who + step / 10.0
        middle = np.array([2.0 * (who % side), 2.0 * (who // side)])
        place = middle + 0.5 * np.array([np.sin(phase), np.cos(0.7 * phase)])
        people.append(
            Person(
                position=place + rng.normal(0.0, _SIGMA, 2), covariance=_SIGMA**2 * np.eye(2),
                height=1.7, sigma=0.1, robots=("robot_a",), label=who, score=4.0,
                stamp_ns=step * INTERVAL_NS,
            )
        )  # fmt: skip
    return people


def _check(
    told: Sequence[Sequence[Person]], people: Sequence[Person], config: PlannerConfig
) -> None:
    """The last step against a filter of each person, one matrix at a time."""
    t, q = INTERVAL_NS / 1e9, config.tracking.acceleration**2
    move = np.eye(4)
    move[0, 2] = move[1, 3] = t
    noise = np.kron(q * np.array([[t**3 / 3, t**2 / 2], [t**2 / 2, t]]), np.eye(2))
    look, unknown = np.eye(2, 4), config.tracking.any_velocity**2
    same("number of people who are followed", len(people), len(told[0]))
    for who, person in enumerate(sorted(people, key=lambda one: one.label)):
        for step, found in enumerate(told):
            at, unsure = found[who].position, found[who].covariance
            if step == 0:
                x = np.concatenate([at, np.zeros(2)])
                p = np.diag([0.0, 0.0, unknown, unknown])
                p[:2, :2] = unsure
                continue
            x, p = move @ x, move @ p @ move.T + noise
            gain = p @ look.T @ np.linalg.inv(look @ p @ look.T + unsure)
            x, p = x + gain @ (at - look @ x), (np.eye(4) - gain @ look) @ p
        near(f"place of person {who}", person.position, x[:2])
        velocity = person.velocity if person.velocity is not None else np.full(2, np.nan)
        near(f"velocity of person {who}", velocity, x[2:])

"""Views of people made by hand, for pictures of them."""

from __future__ import annotations

from typing import Any

import numpy as np

from mrs_people_loc.people import Group, Person
from mrs_people_loc.team.poses import Pose
from mrs_people_sim.figures.plots import TopView

SECOND = 1_000_000_000


def person(who: int, x: float, y: float, **more: Any) -> Person:
    return Person(
        position=np.array([x, y]),
        covariance=0.01 * np.eye(2),
        height=1.7,
        sigma=0.1,
        robots=("robot_a",),
        label=-1,
        **{"id": who, "velocity": np.array([1.0, 0.0]), **more},
    )


def group_of(*people: Person, **more: Any) -> Group:
    return Group(
        centre=np.mean([p.position for p in people], axis=0),
        covariance=0.01 * np.eye(2),
        radius=1.0,
        rms_spread=1.0,
        size=len(people),
        members=tuple(p.id for p in people),
        **{"id": 1, "velocity": np.array([1.0, 0.0]), **more},
    )


def view(at_s: float, *people: Person, **more: Any) -> TopView:
    nobody = np.empty(0, dtype=int)
    poses = {"robot_a": Pose(0, at_s, 0.0, 0.0), "robot_b": Pose(0, 9.0, 3.0, 3.1)}
    return TopView(
        **{
            "title": "",
            "stamp_ns": round(at_s * SECOND),
            "xy": np.empty((0, 2)),
            "robot": nobody,
            "cluster": nobody,
            "person": nobody,
            "robots": poses,
            "views": {},
            "people": people,
            "groups": [],
            "truth": np.empty((0, 2)),
            **more,
        }
    )


def walk() -> list[TopView]:
    """Two people walk; the second one has fallen behind from 2 s on."""
    views = []
    for at_s in np.arange(0.0, 4.01, 0.2):
        one, two = person(1, 2.0 + at_s, 1.0), person(2, 2.0 + at_s / 4, 2.0)
        late = at_s >= 1.99
        group = group_of(one, stragglers={2: at_s}) if late else group_of(one, two)
        events = ["person 2 has fallen behind"] if abs(at_s - 2.0) < 0.01 else []
        views.append(view(at_s, one, two, groups=[group], events=events))
    return views

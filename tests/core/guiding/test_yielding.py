"""How the leader makes way for people who are not of the group."""

from __future__ import annotations

import numpy as np
import pytest

from core.guiding.walking_group import World
from mrs_people_loc.guiding.guidance import State
from mrs_people_loc.guiding.way import Way
from mrs_people_loc.guiding.yielding import yielding
from mrs_people_loc.people import Person

WAY = Way(np.array([[0.0, 0.0], [30.0, 0.0]]), rounding=0.0)


def person(x: float, y: float, *velocity: float, number: int = 9) -> Person:
    moving = np.array(velocity) if velocity else None
    return Person(np.array([x, y]), 0.01 * np.eye(2), 1.7, 0.1, (), 1, id=number, velocity=moving)


@pytest.mark.parametrize(
    ("who", "share", "is_right"),
    [
        (person(8.0, 0.2, -1.0, 0.0), 0.6, True),  # comes, 3 m away
        (person(6.4, 0.2, -1.0, 0.0), 0.0, True),
        (person(7.0, 2.0, 0.0, -1.0), 0.2, True),  # crosses
        (person(7.0, 2.0, 0.0, 1.0), 1.0, False),
        (person(8.0, 0.0), 0.6, False),  # stands
        (person(6.0, 0.0), 0.5, False),
        (person(7.0, 0.0, 0.8, 0.0), 1.0, False),  # walks along
        (person(10.0, 0.0, -1.0, 0.0), 1.0, False),
        (person(3.0, 0.0, 1.0, 0.0), 1.0, False),
    ],
)
def test_who_is_in_the_way_slows_the_leader_down(who, share, is_right) -> None:
    found = yielding([who], WAY, 5.0)
    assert found.share == pytest.approx(share)
    assert (found.right > 0.0) == is_right


def test_leader_stands_and_stays_leader_while_somebody_passes_and_goes_on() -> None:
    world = World()
    world.run(8.0)
    assert world.last().state == State.LEADING
    (x, y) = world.robots["robot_a"]
    comes = person(x + 1.2, y + 0.3, -0.3, 0.0, number=77)
    world.warp = lambda people: [*people, comes]
    world.run(12.0)
    assert world.last().state == State.WAITING
    assert world.last().reason == "lets somebody pass"
    assert "robot_a" not in world.last().faults
    assert world.last().posts["robot_a"].xy[1] == pytest.approx(y - 0.5, abs=0.1)
    world.warp = lambda people: people
    world.run(6.0)
    assert world.last().state == State.LEADING
    assert world.robots["robot_a"][0] > x + 0.8
    assert world.last().posts["robot_a"].xy[1] == pytest.approx(0.0, abs=0.05)

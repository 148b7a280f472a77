"""What is wrong with a tour, from plain figures."""

from __future__ import annotations

import numpy as np
import pytest

from mrs_people_loc.guiding.guidance import Guidance, Post, Role, State
from mrs_people_loc.health.findings import ERROR, OK, WARN, Code
from mrs_people_loc.health.guide import of_tour, of_tour_robots, of_walls

LEADING = Guidance(
    7, State.LEADING, stop="Foyer", way_m=3.25, length_m=60.0, people=(1, 2, 3), stragglers=(2,)
)


@pytest.mark.parametrize(
    ("guidance", "level", "code", "message"),
    [
        (Guidance(0, State.IDLE), OK, None, "no tour"),
        (LEADING, OK, None, "leads"),
        (
            Guidance(7, State.WAITING, "waits for person 2"),
            OK,
            None,
            "waits for person 2",
        ),
        (
            Guidance(7, State.HALTED, "people are 0.6 s old"),
            ERROR,
            Code.TOUR_HALTED,
            "the robots stand: people are 0.6 s old",
        ),
        (
            Guidance(7, State.LEADING, lost=(4, 9)),
            WARN,
            Code.PEOPLE_LOST,
            "the tour goes on without people who fell behind, by their ids: 4, 9; leads",
        ),
    ],
)
def test_state_of_the_tour_tells_the_level(guidance, level, code, message):
    finding = of_tour("hall", guidance)
    assert (finding.name, finding.level, finding.code) == ("tour", level, code)
    assert finding.message == message


def test_figures_of_the_tour():
    assert dict(of_tour("hall", LEADING).values) == {
        "state": "leading", "tour": "hall", "way_m": "3.2", "length_m": "60.0", "stop": "Foyer",
        "people": 3, "stragglers": 1, "lost": 0, "avoided": "",
    }  # fmt: skip


def test_robot_that_takes_no_part_is_reported():
    post = Post(Role.REAR, np.zeros(2), 0.0, 0.6)
    guidance = Guidance(
        7, State.LEADING, posts={"robot_c": post}, faults={"robot_a": "pose is 3.0 s old"}
    )
    first, second = of_tour_robots(guidance, {"robot_c": 0.456})
    assert (first.name, first.level, first.code) == ("robot robot_a", WARN, Code.TAKES_NO_PART)
    assert first.message == "takes no part in the tour: pose is 3.0 s old"
    assert (second.name, second.level) == ("robot robot_c", OK)
    assert dict(second.values) == {"role": "rear", "distance_m": "0.46"}


def test_missing_map_is_a_warning() -> None:
    found = of_walls("/tour/map", is_known=False)
    assert (found.name, found.level, found.code) == ("walls", WARN, Code.NO_MAP)
    assert "/tour/map" in found.message
    assert of_walls("/tour/map", is_known=True).level == OK

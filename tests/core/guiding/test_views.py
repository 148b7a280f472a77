"""Who is seen from where, by shares that are worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest

from mrs_people_loc.config import Formation
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.views import TeamView, detection_rates
from mrs_people_loc.team.masking import OccupancyGrid

ORIGIN = np.zeros((1, 2))
FORMATION = Formation()


def rates(people, *, gaze=0.0, space=None):
    space = space or FreeSpace.unbounded()
    return detection_rates(ORIGIN, np.array([gaze]), np.array(people, float), FORMATION, space)[0]


def test_reach_and_field_of_view():
    far, aside = FORMATION.reach + 0.3, 0.5 * FORMATION.view
    people = [(2.0, 0.0), (far, 0.0), (-2.0, 0.0)]
    assert [rates([one])[0] for one in people] == pytest.approx([0.9, 0.0, 0.0])
    at_border = (2.5 * math.cos(aside), 2.5 * math.sin(aside))
    assert rates([at_border]) == pytest.approx([0.45])  # half of its body is in view
    assert rates([(2.0, 0.0)], gaze=math.pi) == pytest.approx([0.0])


def test_walls_hide():
    cells = np.zeros((40, 60), np.int8)
    cells[:, 30] = 100  # at x from 1.0 to 1.1 m
    space = FreeSpace(OccupancyGrid(0.1, -2.0, -2.0, 0.0, cells))
    assert rates([(2.5, 0.0)], space=space) == pytest.approx([0.0])


def test_what_a_team_sees():
    # One from each side of a person; each by itself sees them at a rate of 0.9.
    places, gaze = np.array([[-2.0, 0.0], [2.0, 0.0]]), np.array([0.0, math.pi])
    person = np.zeros((1, 2))
    view = TeamView(places, gaze, person, FORMATION, FreeSpace.unbounded(), side=math.radians(60.0))
    seen, second = view.of(np.array([[0, 1]]))
    assert seen == pytest.approx(np.array([[0.99]]))
    assert second == pytest.approx(np.array([[0.81]]))
    seen, second = view.of(np.array([[0], [1]]))
    assert seen == pytest.approx(np.array([[0.9], [0.9]]))
    assert second == pytest.approx(np.zeros((2, 1)))
    nobody, _ = view.of(np.empty((1, 0), dtype=np.intp))
    assert nobody == pytest.approx(np.zeros((1, 1)))

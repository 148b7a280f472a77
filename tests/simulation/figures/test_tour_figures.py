"""The picture of a guided tour."""

from __future__ import annotations

import numpy as np
import pytest

pytest.importorskip("matplotlib", reason="pictures need matplotlib")

from mrs_people_loc.guiding.guidance import Guidance, State
from mrs_people_sim.figures.tour_figures import draw_tour
from mrs_people_sim.scoring.poses import PoseTrack
from mrs_people_sim.scoring.tours import TourRecord
from mrs_tools.bags.records import Truth

S = 1_000_000_000


def test_ways_and_stops_are_drawn_where_they_were():
    stamps = np.arange(0, 10 * S + 1, S // 2)
    x = stamps / S
    people = np.stack([np.stack([x, 0 * x], 1), np.stack([x, 0 * x + 1], 1)], axis=1)
    truth = Truth(stamps, people, np.ones(people.shape[:2], dtype=bool))
    robot = PoseTrack(stamps, np.stack([x + 2, 0 * x, 0 * x], 1), np.zeros((len(x), 3, 3)))
    statuses = [
        Guidance(t * S, State.AT_STOP if 4 <= t <= 6 else State.LEADING, stop="Foyer")
        for t in range(11)
    ]
    (axes,) = draw_tour(TourRecord(statuses, truth, {"robot_a": robot}, [])).axes
    ways = {line.get_label(): line for line in axes.lines}
    for name, first, last in (("robot_a", 2.0, 11.8), ("people", 0.0, 9.8)):
        drawn = np.asarray(ways[name].get_xdata())
        assert (drawn[0], drawn[-1]) == pytest.approx((first, last))
    assert [text.get_text() for text in axes.texts] == ["Foyer"]
    stars = [line for line in axes.lines if line.get_marker() == "*"]
    assert np.ravel([line.get_data() for line in stars]) == pytest.approx([5.0, 0.5])

"""How unsure poses widen distances and slow robots down."""

from __future__ import annotations

import numpy as np
import pytest

from mrs_people_loc.config import GuideConfig
from mrs_people_loc.guiding.margins import sigma_of, widened
from mrs_people_loc.team.poses import Pose

CONFIG = GuideConfig()


def test_sigma_is_that_of_the_worst_direction() -> None:
    turn = np.array([[0.6, -0.8], [0.8, 0.6]])
    covariance = np.zeros((3, 3))
    covariance[:2, :2] = turn @ np.diag([0.2**2, 0.05**2]) @ turn.T
    assert sigma_of(Pose(0, 0.0, 0.0, 0.0, covariance)) == pytest.approx(0.2)
    assert sigma_of(Pose(0, 0.0, 0.0, 0.0)) == 0.0


@pytest.mark.parametrize(
    ("sigma", "margin", "share"),
    [(0.0, 0.0, 1.0), (0.05, 0.1, 1.0), (0.1, 0.2, 1.0), (0.2, 0.25, 0.75), (5.0, 0.25, 0.5)],
)
def test_distances_grow_and_speed_falls_with_sigma(sigma, margin, share) -> None:
    safety, base = CONFIG.safety, CONFIG.base
    wide = widened(CONFIG, sigma, 1.0)
    grown = wide.safety
    assert grown.person_distance - safety.person_distance == pytest.approx(margin)
    assert grown.robot_distance - safety.robot_distance == pytest.approx(margin)
    assert grown.wall_distance - safety.wall_distance == pytest.approx(margin)
    assert wide.base.max_speed == pytest.approx(share * base.max_speed)
    assert wide.base.max_reverse == pytest.approx(share * base.max_reverse)


def test_walls_are_kept_clear_of_no_farther_than_the_way_has_room() -> None:
    grown = widened(CONFIG, 0.1, 0.04).safety
    assert grown.wall_distance == pytest.approx(CONFIG.safety.wall_distance + 0.04)
    assert widened(CONFIG, 0.1, 0.0).safety.wall_distance == CONFIG.safety.wall_distance

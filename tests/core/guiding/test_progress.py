"""A robot that drives by itself, and does not go to its goal."""

from __future__ import annotations

import pytest

from mrs_people_loc.guiding.progress import Progress, ProgressTuning
from mrs_people_loc.team.poses import Pose

S = 1_000_000_000
HERE = Pose(0, 1.0, 2.0, 0.0)
GOAL = Pose(0, 4.0, 2.0, 0.0)


def at(x: float, y: float = 2.0) -> Pose:
    return Pose(0, x, y, 0.0)


def test_robot_that_stands_far_from_its_goal_is_stuck_after_five_seconds_and_every_five() -> None:
    progress = Progress(HERE, 100 * S)
    times = [tenth for tenth in range(1001, 1160) if progress.is_stuck(GOAL, HERE, tenth * S // 10)]
    assert times == [1051, 1102, 1153]


def test_robot_is_not_stuck_at_the_limit_itself() -> None:
    progress = Progress(HERE, 0)
    assert not progress.is_stuck(GOAL, HERE, 5 * S)
    assert progress.is_stuck(GOAL, HERE, 5 * S + 1)


@pytest.mark.parametrize(("step", "stuck"), [(0.11, False), (0.09, True)])
def test_robot_that_moves_is_not_stuck(step: float, stuck: bool) -> None:
    """It is looked at by where it was when it moved last, not by where it began."""
    progress = Progress(HERE, 0)
    moved = at(1.0 + step)
    assert not progress.is_stuck(GOAL, moved, 4 * S)
    assert progress.is_stuck(GOAL, moved, 8 * S) == stuck
    assert progress.is_stuck(GOAL, moved, 9 * S + 1) != stuck


@pytest.mark.parametrize(("away", "stuck"), [(0.59, False), (0.61, True)])
def test_robot_may_stand_near_its_goal(away: float, stuck: bool) -> None:
    progress = Progress(HERE, 0)
    assert progress.is_stuck(at(1.0, 2.0 + away), HERE, 6 * S) == stuck


def test_robot_whose_goal_moves_away_gets_time_to_follow() -> None:
    progress = Progress(HERE, 0)
    assert not progress.is_stuck(HERE, HERE, 60 * S)
    assert not progress.is_stuck(GOAL, HERE, 65 * S)
    assert progress.is_stuck(GOAL, HERE, 65 * S + 1)


def test_limits_are_those_of_the_tuning() -> None:
    progress = Progress(HERE, 0, ProgressTuning(near=4.0, moved=0.5, stuck_s=1.0))
    assert not progress.is_stuck(GOAL, HERE, 2 * S)
    assert progress.is_stuck(at(6.0), at(1.4), 3 * S + 1)

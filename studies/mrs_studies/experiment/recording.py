"""A simulated recording that went through the pipeline."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mrs_people_loc.config import Team
from mrs_people_loc.planner import People, Planner
from mrs_people_loc.team.poses import Pose
from mrs_people_sim.estimates import estimate_of
from mrs_people_sim.evaluation.results import Result, evaluate_bag
from mrs_people_sim.scoring.positions import Frame, score
from mrs_studies.experiment.draws import Draw
from mrs_tools.bags.offline import BagRun, Interval
from mrs_tools.bags.records import Truth
from mrs_tools.bags.sources import RobotView


@dataclass
class Recording:
    """A draw that went through the pipeline.

    Attributes:
        draw: The draw.
        team: Configuration of its team.
        truth: Ground truth.
        intervals: What the pipeline made of it.
        result: How that was scored.
    """

    draw: Draw
    team: Team
    truth: Truth
    intervals: list[Interval]
    result: Result

    @classmethod
    def of(cls, one: Draw, *configs: Path) -> Recording:
        """Runs a draw with a configuration: files of which later ones win."""
        intervals: list[Interval] = []
        # The paper looks at each interval by itself.
        run = BagRun(one.bag, configs, planner=lambda c: Planner(c.memoryless()))
        result = evaluate_bag(run, on_interval=intervals.append)
        assert result.truth is not None
        return cls(one, run.team, result.truth, intervals, result)

    def views(self) -> Iterator[tuple[RobotView, Pose]]:
        """Each view that an interval used, and the robot's pose."""
        for interval in self.intervals:
            for robot, view in interval.views.items():
                yield view, interval.people.poses[robot]

    def score(self, people: Sequence[People]) -> list[Frame]:
        """How the people of some intervals meet the truth."""
        return score(self.truth, [estimate_of(one) for one in people])

    def in_view(self, robots: Sequence[str], frame: int) -> np.ndarray:
        """Whom a robot sees: with as many pixels as a person must have points, shape (people,)."""
        least = self.team.planner.human.min_points
        return np.any([self.draw.pixels[robot][frame] >= least for robot in robots], axis=0)

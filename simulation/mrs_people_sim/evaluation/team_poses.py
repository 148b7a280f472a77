"""What a team's poses cost: their own errors, and those of the people that follow from them."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.planner import People, Planner
from mrs_people_loc.scan import Scan
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_loc.team.poses import Pose
from mrs_people_sim.estimates import estimate_of
from mrs_people_sim.evaluation.robot_poses import placed_at_start
from mrs_people_sim.scoring.poses import PoseScores, PoseTrack, in_true_frame, score_poses
from mrs_people_sim.scoring.positions import Frame, score, summary
from mrs_tools.bags.records import Estimate, Truth


@dataclass(frozen=True)
class TeamScores:
    """Scores of a team's poses; those of several recordings are added.

    Attributes:
        poses: Of the poses that people were placed with.
        odometry: Of odometry alone, from where the first of these poses was.
        in_team: People in the frame of the team, `scoring.poses.in_true_frame`.
        exact: People found with exact poses.
    """

    poses: PoseScores = field(default_factory=PoseScores)
    odometry: PoseScores = field(default_factory=PoseScores)
    in_team: tuple[Frame, ...] = ()
    exact: tuple[Frame, ...] = ()

    def __bool__(self) -> bool:
        """Whether there is anything."""
        return self.poses.runs > 0

    def __add__(self, other: TeamScores) -> TeamScores:
        return TeamScores(
            self.poses + other.poses,
            self.odometry + other.odometry,
            self.in_team + other.in_team,
            self.exact + other.exact,
        )

    def report(self) -> dict[str, Any]:
        """The figures, as the JSON of `mrs evaluate` has them."""
        return {
            **self.poses.report(),
            "odometry": self.odometry.report() if self.odometry.runs else None,
            "people_in_team_frame": summary(self.in_team)["people"],
            "people_with_exact_poses": summary(self.exact)["people"] if self.exact else None,
        }


def score_team(
    true: Mapping[str, PoseTrack],
    estimated: Mapping[str, PoseTrack],
    odometry: Mapping[str, PoseTrack],
    truth: Truth,
    people: Sequence[Estimate],
    exact: Sequence[Estimate] | None,
) -> TeamScores:
    """Scores a team.

    Args:
        true: By robot, its true poses in the map.
        estimated: By robot, the poses that the people were placed with.
        odometry: By robot, its odometry, in a frame of its own.
        truth: Where the people are.
        people: What was found.
        exact: What was found with exact poses; None: that is not known.
    """
    poses = score_poses(true, estimated)
    if poses is None:
        return TeamScores()
    alone = {
        name: placed_at_start(track, estimated[name])
        for name, track in odometry.items()
        if name in estimated
    }
    by_odometry = score_poses(true, {n: track for n, track in alone.items() if track is not None})
    return TeamScores(
        poses,
        by_odometry or PoseScores(),
        tuple(score(truth, in_true_frame(people, true, estimated))),
        tuple(score(truth, exact)) if exact is not None else (),
    )


class PlannerBesideExact:
    """Makes a planner that does each interval with exact poses, too, with another planner.

    Args:
        true: By robot, its true poses.

    Attributes:
        estimates: The people with exact poses, so far.
    """

    def __init__(self, true: Mapping[str, PoseTrack]) -> None:
        self.estimates: list[Estimate] = []
        self._true = true
        self._used: dict[str, dict[int, Pose]] = {}

    def __call__(self, config: PlannerConfig) -> PlannerBesideExact:
        """Begins a run."""
        self.estimates.clear()
        self._used.clear()
        self._planner, self._other = Planner(config), Planner(config)
        return self

    def take_grid(self, grid: OccupancyGrid | None) -> None:
        """As `Planner.take_grid`."""
        self._planner.take_grid(grid)
        self._other.take_grid(grid)

    def step(self, scans: Sequence[Scan], poses: Mapping[str, Pose], time_ns: int) -> People:
        """As `Planner.step`."""
        exact = {name: self._exact(name, pose) for name, pose in poses.items()}
        self.estimates.append(estimate_of(self._other.step(scans, exact, time_ns)))
        people = self._planner.step(scans, poses, time_ns)
        self.take_poses(people.poses)
        return people

    def take_poses(self, poses: Mapping[str, Pose]) -> None:
        """Takes poses of scans, also those of robots in quarantine."""
        for name, pose in poses.items():
            self._used.setdefault(name, {})[pose.stamp_ns] = pose

    def used(self) -> dict[str, PoseTrack]:
        """By robot, the poses of its scans."""
        return {name: PoseTrack.build(poses.values()) for name, poses in self._used.items()}

    def _exact(self, name: str, pose: Pose) -> Pose:
        """The true pose at a pose's stamp; the pose itself where that is not known."""
        if name not in self._true:
            return pose
        (found,) = self._true[name].at(np.array([pose.stamp_ns]))
        if not np.isfinite(found).all():
            return pose
        x, y, yaw = map(float, found)
        return dataclasses.replace(pose, x=x, y=y, yaw=yaw, covariance=np.zeros((3, 3)))

"""Robots that only know where they are to each other by the people whom they see."""

import math
from dataclasses import dataclass, field

import numpy as np
import pytest

from core.localization.tours import Record, Tour, World, hall
from mrs_people_loc.config import Localization
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.localization.people.relative_poses import RelativePoses
from mrs_people_loc.localization.people.seen_people import SeenPeople

pytestmark = pytest.mark.slow

#: Standard deviations along and across the line of sight [m], and the share that lasts.
ALONG, ACROSS, LASTING, LASTS_S = 0.1, 0.04, 0.35, 4.0
#: What a robot sees: so far [m], and so far to each side [rad].
REACH, SIDE = 6.0, 0.7


@dataclass
class PeopleTour(Tour):
    """Three robots follow five people; nothing else is seen."""

    robots: tuple = (("a", 0.0, 0.0), ("b", 0.6, 1.3), ("c", 0.6, -1.3))
    #: Ahead of the first robot and to its left [m].
    people: np.ndarray = field(
        default_factory=lambda: np.array(
            [(2.0, -0.8), (2.4, 0.7), (3.2, -0.2), (3.7, 1.2), (3.5, -1.4)]
        )
    )
    met_every: int = 2

    def __post_init__(self):
        self.relative, self.bias = RelativePoses(), {}

    def _meet(self, stamp_ns, robots, rng):
        t = (stamp_ns - 1_000_000_000) / 1e9
        sway = 0.15 * np.sin(1.3 * t + 2.1 * np.arange(len(self.people)))
        where = np.array(
            [
                self.world.place(self.speed * t + ahead + s, left + s)[:2]
                for (ahead, left), s in zip(self.people, sway, strict=True)
            ]
        )
        seen = {robot.name: self._seen(robot, where, stamp_ns, rng) for robot in robots}
        poses = {robot.name: robot.localizer.pose_at(stamp_ns) for robot in robots}
        for met in self.relative.step(seen, poses):
            for robot in robots:
                robot.localizer.take_relative(met)

    def _seen(self, robot, where, stamp_ns, rng):
        here = (where - robot.truth[:2]) @ rotation_2d(robot.truth[2])
        bias = self.bias.setdefault(robot.name, rng.normal(size=here.shape))
        kept = math.exp(-self.met_every / self.rate / LASTS_S)
        bias += (kept - 1.0) * bias + math.sqrt(1.0 - kept**2) * rng.normal(size=here.shape)
        sight = here / np.hypot(*here.T)[:, np.newaxis]
        axes = np.stack([sight, np.stack([-sight[:, 1], sight[:, 0]], 1)], axis=2)
        root = axes * (ALONG, ACROSS)
        white = rng.normal(size=here.shape)
        error = math.sqrt(LASTING) * bias + math.sqrt(1.0 - LASTING) * white
        near = np.hypot(*here.T) < REACH
        near &= np.abs(np.arctan2(here[:, 1], here[:, 0])) < SIDE
        places = here + np.einsum("nij,nj->ni", root, error)
        return SeenPeople(stamp_ns, places[near], (root @ root.transpose(0, 2, 1))[near])


def relative_errors(record: Record, begin=0.0):
    """Position [m] and heading [degrees] of the others in the frame of the first, all times."""
    errors = record.relative()[int(begin * len(record.truth)) :].reshape(-1, 3)
    turns = np.abs(np.arctan2(np.sin(errors[:, 2]), np.cos(errors[:, 2])))
    return np.hypot(*errors[:, :2].T), np.degrees(turns)


def test_people_hold_a_team_together_in_a_hall():
    """100 m without walls: 10 cm and 2 degrees, where odometry alone is off by a metre and more."""
    records = [PeopleTour(hall(), seed=seed).run() for seed in range(2)]
    position, turn = np.concatenate([relative_errors(record) for record in records], axis=1)
    assert np.median(position) < 0.10
    assert np.percentile(position, 95) < 0.20
    assert np.median(turn) < 1.0
    assert np.percentile(turn, 95) < 3.0
    drifted = [np.hypot(*record.relative(record.odometry)[-1, :, :2].T) for record in records]
    assert np.median(drifted) > 1.0
    # Means of two correlated tours; expected: 3.
    assert np.mean([record.nees().mean() for record in records]) < 6.0


def test_team_that_starts_with_rough_poses_is_aligned():
    """1 m and 15 degrees per robot: after seconds they know where they are to each other."""
    straight = World(np.array([(0.0, 0.0), (40.0, 0.0)]), np.zeros((0, 4)))
    rough = (1.0, 1.0, math.radians(15.0))
    config = Localization(start_sigmas=rough)
    for seed in range(6):
        tour = PeopleTour(straight, seed=seed, start=rough, duration=12.0, config=config)
        position, turn = relative_errors(tour.run(), begin=0.8)
        assert np.percentile(position, 95) < 0.3
        assert np.percentile(turn, 95) < 5.0

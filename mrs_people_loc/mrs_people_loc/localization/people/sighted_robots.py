"""Where robots see each other: a body where a team-mate is believed to be is evidence of that.

A robot that sees a team-mate measures its place, and nothing of its heading. Who it is, is told by
where the robots are believed to be: a sighting counts only where one body and one team-mate are
each other's only explanation.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.geometry import margins, rotation_2d, squared_mahalanobis, wrap_angle
from mrs_people_loc.localization.people.seen_people import SeenPeople
from mrs_people_loc.localization.shared import YAW_UNKNOWN, RelativePose
from mrs_people_loc.team.poses import Pose


@dataclass(frozen=True)
class SightedRobotsTuning:
    """Constants, chosen by hand.

    Attributes:
        gate: Squared Mahalanobis length of the difference between where a body and a team-mate
            are, at most: that of 99.9 % of the right ones.
        apart: What else may explain it is worse by this, at least: -2 times the log likelihood.
        mistaken: Standard deviations of what relative poses may be wrong by beside what they say:
            place [m] and heading [rad].
        farthest: A team-mate is not recognized if it is believed to be within more than this: the
            largest standard deviation of its place [m].
        outline: Standard deviation of the middle of a robot's visible outline [m].
        speed: What a team-mate drives in a second [m/s].
        lasting: Share of a sighting's variance that lasts ...
        lasting_s: ... for so long [s], as for people (`RelativePosesTuning`).
    """

    gate: float = 13.8
    apart: float = 6.0
    mistaken: tuple[float, float] = (0.2, 0.05)
    farthest: float = 1.5
    outline: float = 0.05
    speed: float = 0.6
    lasting: float = 0.7
    lasting_s: float = 4.0


_TUNING = SightedRobotsTuning()


@dataclass
class SightedRobots:
    """Recognizes team-mates among what robots see.

    Attributes:
        tuning: Constants.
    """

    tuning: SightedRobotsTuning = _TUNING
    _last_ns: dict[tuple[str, str], int] = field(default_factory=dict)

    def step(
        self, seen: Mapping[str, SeenPeople], poses: Mapping[str, Pose]
    ) -> tuple[RelativePose, ...]:
        """The team-mates that robots see in an interval; their headings are unknown.

        Args:
            seen: By robot, what it sees.
            poses: By robot, its pose in the map, with its covariance relative to the team.
        """
        found = []
        for robot, what in seen.items():
            mates = [name for name in poses if name != robot]
            if not mates or not len(what.others):
                continue
            places, covariances = self._predicted(poses[robot], [poses[name] for name in mates])
            offset = what.others[:, np.newaxis] - places
            own = what.others_covariance + self.tuning.outline**2 * np.eye(2)
            total = own[:, np.newaxis] + covariances
            squared = squared_mahalanobis(offset.reshape(-1, 2), total.reshape(-1, 2, 2))
            squared = squared.reshape(offset.shape[:2])
            surprise = squared + np.log(np.linalg.det(total))
            for k, j in self._recognized(squared, surprise, covariances):
                factor = self._factor(robot, mates[j], what.stamp_ns)
                covariance = np.diag([0.0, 0.0, YAW_UNKNOWN])
                covariance[:2, :2] = factor * own[k]
                yaw = wrap_angle(poses[mates[j]].yaw - poses[robot].yaw)
                place = np.array([*what.others[k], yaw])
                at_ns = what.stamp_ns
                found.append(RelativePose(robot, at_ns, mates[j], at_ns, place, covariance, factor))
        return tuple(found)

    def _predicted(self, pose: Pose, mates: list[Pose]) -> tuple[Float, Float]:
        """Where team-mates are in a robot's base_link, shapes (m, 2) and (m, 2, 2)."""
        rotation = rotation_2d(pose.yaw)
        xy = np.array([(mate.x - pose.x, mate.y - pose.y) for mate in mates]) @ rotation
        late = np.array([(mate.stamp_ns - pose.stamp_ns) / 1e9 for mate in mates])
        lever = np.zeros((len(mates), 2, 3))
        lever[:, :, :2] = -np.eye(2)
        lever[:, 0, 2], lever[:, 1, 2] = xy[:, 1], -xy[:, 0]
        own = np.eye(3)
        own[:2, :2] = rotation
        of_mates = np.array([rotation.T @ mate.covariance[:2, :2] @ rotation for mate in mates])
        place, heading = np.square(self.tuning.mistaken)
        of_robot = own.T @ pose.covariance @ own + np.diag([0.0, 0.0, heading])
        covariance = of_mates + place * np.eye(2) + lever @ of_robot @ lever.transpose(0, 2, 1)
        walked = (self.tuning.speed * late) ** 2
        return xy, covariance + walked[:, np.newaxis, np.newaxis] * np.eye(2)

    def _recognized(
        self, squared: Float, surprise: Float, covariances: Float
    ) -> list[tuple[int, int]]:
        """Bodies and team-mates that nothing else explains.

        Args:
            squared: Squared Mahalanobis lengths, shape (n, m).
            surprise: -2 times their log likelihoods, likewise.
            covariances: Of where team-mates are, shape (m, 2, 2).
        """
        largest = np.linalg.eigvalsh(covariances)[:, -1]
        right = (squared < self.tuning.gate) & (largest < self.tuning.farthest**2)
        pairs = np.argwhere(right & (margins(surprise) > self.tuning.apart))
        return [(k, j) for k, j in pairs.tolist()]

    def _factor(self, robot: str, mate: str, stamp_ns: int) -> float:
        """What a sighting's variance is multiplied by, as its error lasts (`relative_poses`)."""
        tuning, pair = self.tuning, (robot, mate)
        last_ns, self._last_ns[pair] = self._last_ns.get(pair), stamp_ns
        if last_ns is None or last_ns >= stamp_ns:
            return 1.0
        since_s = (stamp_ns - last_ns) / 1e9
        return 1.0 + tuning.lasting * 2.0 * tuning.lasting_s / since_s

"""How sure a team is about its shape, beside how sure it is about where it is as a whole."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Float


@dataclass(frozen=True)
class StateTuning:
    """Constants of a team's state.

    Attributes:
        lever: An error of the heading counts as much as one of the position at this distance [m]:
            about as far as people are from the robots that see them.
        least_turn: A correction that turns no robot by more turns no covariance [rad]: rounding.
    """

    lever: float = 2.5
    least_turn: float = 1e-5


STATE_TUNING = StateTuning()


def covariance_in_team(places: Float, covariance: Float, index: int) -> Float:
    """Covariance of one robot's pose relative to its team.

    It is what remains when the estimated poses of the team are moved and turned together to the
    true ones by least squares (Umeyama 1991, to first order): errors that all robots share, as
    those of a team that has seen nothing known for long, are not in it. Residuals are smaller than
    the errors, and not independent; with the factor k / (k - 1) the sum of two robots' covariances
    is that of their difference where their errors are independent. For a robot alone it is zero.

    Args:
        places: x, y [m], yaw [rad] of each robot, shape (k, 3).
        covariance: Of all of them, shape (3 k, 3 k).
        index: Which robot.

    Returns:
        Of its x, y, yaw, shape (3, 3).
    """
    count = len(places)
    offset = places[:, :2] - places[:, :2].mean(axis=0)
    rigid = np.zeros((count, 3, 3))
    rigid[:] = np.eye(3)
    rigid[:, 0, 2], rigid[:, 1, 2] = -offset[:, 1], offset[:, 0]
    stacked = rigid.reshape(-1, 3)
    weight = np.array([1.0, 1.0, STATE_TUNING.lever**2])
    # About the middle of the team the normal equations are diagonal.
    normal = np.array([count, count, (offset * offset).sum() + count * weight[2]])
    residual = (-rigid[index] / normal) @ stacked.T
    residual *= np.concatenate([weight] * count)
    residual[:, 3 * index : 3 * index + 3] += np.eye(3)
    made = residual @ covariance @ residual.T * (count / max(count - 1, 1))
    return np.asarray(0.5 * (made + made.T))

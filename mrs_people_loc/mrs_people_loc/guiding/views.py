"""Who would be seen from where: reach and field of view of a head, people and walls that hide."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Bool, Float, Int
from mrs_people_loc.geometry import wrap_angles
from mrs_people_loc.team.occlusion import hidden_by_people, hidden_by_robots
from mrs_people_loc.team.poses import Pose, places_of

if TYPE_CHECKING:
    from mrs_people_loc.guiding.free_space import FreeSpace

#: Detection rate of one head where everything is in view. Below 1: a second view always helps.
_BEST = 0.9
#: The rate falls over this range at the ends of the reach [m] and of the field of view [rad].
_EDGE, _SIDE = 0.4, 0.1
#: A place that is seen with this probability is in view.
_IN_VIEW = 0.4


def detection_rates(
    places: Float,
    gaze: Float,
    people: Float,
    formation: cfg.Formation,
    space: FreeSpace,
) -> Float:
    """How likely each person is detected from each place, shape (k, n).

    Args:
        places: Of robots [m], shape (k, 2).
        gaze: Where their heads look [rad], shape (k,).
        people: [m], shape (n, 2).
        formation: Reach and field of view.
        space: Its walls hide.
    """
    away = people - places[:, np.newaxis]
    distance = np.hypot(away[..., 0], away[..., 1])
    aside = np.abs(wrap_angles(np.arctan2(away[..., 1], away[..., 0]) - gaze[:, np.newaxis]))
    rates = (
        np.clip((formation.reach - distance) / _EDGE + 0.5, 0.0, 1.0)
        * np.clip((distance - formation.nearest) / _EDGE + 1.0, 0.0, 1.0)
        * np.clip((0.5 * formation.view - aside) / _SIDE + 0.5, 0.0, 1.0)
    )
    # A body that is half hidden now may be in view or hidden in a moment.
    rates *= 1.0 - hidden_by_people(places, people)
    rates *= space.is_visible(places[:, np.newaxis], people[np.newaxis])
    return np.asarray(_BEST * rates)


def are_in_view(
    xy: Float,
    people: Float,
    robots: Mapping[str, Pose],
    config: cfg.GuideConfig,
    space: FreeSpace,
) -> Bool:
    """Which places robots see, past people and walls, shape (n,).

    Args:
        xy: The places [m], shape (n, 2).
        people: Those who hide them [m], shape (m, 2).
        robots: Poses by name.
        config: Reach and field of view; whose head looks back.
        space: Its walls hide.
    """
    if not robots:
        return np.zeros(len(xy), dtype=bool)
    places = places_of(robots.values())
    back = [math.pi * (name in config.looks_back) for name in robots]
    gaze = np.array([pose.yaw for pose in robots.values()]) + back
    rates = detection_rates(places, gaze, np.concatenate([xy, people]), config.formation, space)
    return np.asarray(rates[:, : len(xy)].max(axis=0) >= _IN_VIEW)


class TeamView:
    """What teams of robots at some of several places see.

    Args:
        places: Of robots [m], shape (k, 2).
        gaze: Where their heads look [rad], shape (k,).
        people: [m], shape (n, 2).
        formation: Reach and field of view.
        space: Its walls hide.
        side: Two lines of sight are from different sides from this angle between them on [rad].
    """

    def __init__(
        self, places: Float, gaze: Float, people: Float, formation: cfg.Formation,
        space: FreeSpace, side: float,
    ) -> None:  # fmt: skip
        self._rates = detection_rates(places, gaze, people, formation, space)
        self._shown = 1.0 - hidden_by_robots(places, people)
        away = people - places[:, np.newaxis]
        bearing = np.arctan2(away[..., 1], away[..., 0])
        between = np.abs(wrap_angles(bearing[:, np.newaxis] - bearing))
        self._sides = np.minimum(between / side, 1.0)

    def of(self, teams: Int) -> tuple[Float, Float]:
        """How likely each person is seen, and is seen from a second side.

        Args:
            teams: Indices of places, shape (c, r).

        Returns:
            Two of shape (c, n).
        """
        robots = list(teams.T)
        rates = [
            self._rates[one] * np.prod([self._shown[one, other] for other in robots], axis=0)
            for one in robots
        ]
        missed = np.ones((len(teams), self._rates.shape[1]))
        for rate in rates:
            missed *= 1.0 - rate
        second = np.zeros_like(missed)
        for a, b in itertools.combinations(range(len(robots)), 2):
            both = rates[a] * rates[b] * self._sides[robots[a], robots[b]]
            np.maximum(second, both, out=second)
        return 1.0 - missed, second

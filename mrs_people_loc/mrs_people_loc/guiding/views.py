"""Who would be seen from where: reach and field of view of a head, people and walls that hide."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Bool, Float, Int
from mrs_people_loc.geometry import wrap_angles
from mrs_people_loc.team.occlusion import hidden_by_people, hidden_by_robots
from mrs_people_loc.team.poses import Pose, places_of

if TYPE_CHECKING:
    from mrs_people_loc.guiding.free_space import FreeSpace


@dataclass(frozen=True)
class ViewTuning:
    """What a head sees; chosen.

    Attributes:
        best: Detection rate where everything is in view. Below 1: a second view always helps.
        edge: The rate falls over this range at the ends of the reach [m]: nearer than
            `nearest`, and around `reach`, ...
        side: ... and around the sides of the field of view [rad].
        in_view: A place that is seen with this probability is in view.
    """

    best: float = 0.9
    edge: float = 0.4
    side: float = 0.1
    in_view: float = 0.4


VIEW_TUNING = ViewTuning()


def detection_rates(
    places: Float,
    gaze: Float,
    people: Float,
    formation: cfg.Formation,
    space: FreeSpace,
    tuning: ViewTuning = VIEW_TUNING,
) -> Float:
    """How likely each person is detected from each place, shape (k, n).

    Args:
        places: Of robots [m], shape (k, 2).
        gaze: Where their heads look [rad], shape (k,).
        people: [m], shape (n, 2).
        formation: Reach and field of view.
        space: Its walls hide.
        tuning: Constants.
    """
    away = people - places[:, np.newaxis]
    distance = np.hypot(away[..., 0], away[..., 1])
    aside = np.abs(wrap_angles(np.arctan2(away[..., 1], away[..., 0]) - gaze[:, np.newaxis]))
    rates = (
        np.clip((formation.reach - distance) / tuning.edge + 0.5, 0.0, 1.0)
        * np.clip((distance - formation.nearest) / tuning.edge + 1.0, 0.0, 1.0)
        * np.clip((0.5 * formation.view - aside) / tuning.side + 0.5, 0.0, 1.0)
    )
    # A body that is half hidden now may be in view or hidden in a moment.
    rates *= 1.0 - hidden_by_people(places, people)
    rates *= space.is_visible(places[:, np.newaxis], people[np.newaxis])
    return np.asarray(tuning.best * rates)


def are_in_view(
    xy: Float,
    people: Float,
    robots: Mapping[str, Pose],
    config: cfg.GuideConfig,
    space: FreeSpace,
    tuning: ViewTuning = VIEW_TUNING,
) -> Bool:
    """Which places robots see, past people and walls, shape (n,).

    Args:
        xy: The places [m], shape (n, 2).
        people: Those who hide them [m], shape (m, 2).
        robots: Poses by name.
        config: Reach and field of view; whose head looks back.
        space: Its walls hide.
        tuning: Constants.
    """
    if not robots:
        return np.zeros(len(xy), dtype=bool)
    places = places_of(robots.values())
    back = [math.pi * (name in config.looks_back) for name in robots]
    gaze = np.array([pose.yaw for pose in robots.values()]) + back
    everybody = np.concatenate([xy, people])
    rates = detection_rates(places, gaze, everybody, config.formation, space, tuning)
    return np.asarray(rates[:, : len(xy)].max(axis=0) >= tuning.in_view)


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

"""Who would be seen from where: reach and field of view of a head, people and walls that hide."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from typing import TYPE_CHECKING

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Bool, Float, Int
from mrs_people_loc.team.poses import Pose

if TYPE_CHECKING:
    from mrs_people_loc.guiding.free_space import FreeSpace

#: People and robots as discs on the floor [m].
PERSON_RADIUS, ROBOT_RADIUS = 0.25, 0.20
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
    aside = np.abs(_wrapped(np.arctan2(away[..., 1], away[..., 0]) - gaze[:, np.newaxis]))
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
    places = np.array([(pose.x, pose.y) for pose in robots.values()])
    back = [math.pi * (name in config.looks_back) for name in robots]
    gaze = np.array([pose.yaw for pose in robots.values()]) + back
    rates = detection_rates(places, gaze, np.concatenate([xy, people]), config.formation, space)
    return np.asarray(rates[:, : len(xy)].max(axis=0) >= _IN_VIEW)


def hidden_by_people(places: Float, people: Float) -> Float:
    """Share of each person's width that the others hide from each place, shape (k, n).

    Discs of one size: who is nearer looks wider, so each of them hides from one edge on.
    """
    if not len(people):
        return np.zeros((len(places), 0))
    left, right = _cover(places, people, people, PERSON_RADIUS)
    hidden = left.max(axis=-1) + right.max(axis=-1)
    return np.asarray(np.minimum(hidden, 1.0))


def hidden_by_robots(places: Float, people: Float) -> Float:
    """Share of each person's width that a robot at one place hides from another, shape (k, k, n).

    Args:
        places: Of robots [m]; the first index of the result is who looks, shape (k, 2).
        people: [m], shape (n, 2).
    """
    left, right = _cover(places, people, places, ROBOT_RADIUS)
    return np.asarray(np.minimum(left + right, 1.0).transpose(0, 2, 1))


def _cover(places: Float, people: Float, discs: Float, radius: float) -> tuple[Float, Float]:
    """Share of people's width, from the left edge on and from the right, that discs cover.

    Returns:
        Two of shape (k, n, m).
    """
    away = people - places[:, np.newaxis]
    distance = np.maximum(np.hypot(away[..., 0], away[..., 1]), PERSON_RADIUS)
    off = discs - places[:, np.newaxis]
    between = np.hypot(off[..., 0], off[..., 1])
    half = np.arcsin(PERSON_RADIUS / distance)[..., np.newaxis]
    half_disc = np.arcsin(np.clip(radius / np.maximum(between, 1e-9), 0.0, 1.0))[:, np.newaxis]
    bearing = np.arctan2(away[..., 1], away[..., 0])
    turn = _wrapped(np.arctan2(off[..., 1], off[..., 0])[:, np.newaxis] - bearing[..., np.newaxis])
    # A disc is in front if it is nearer; at the place itself it is the robot that looks.
    before = (between[:, np.newaxis] < distance[..., np.newaxis] - 1e-6) & (
        between[:, np.newaxis] > 1e-6
    )
    covered = np.minimum(half_disc + half - np.abs(turn), 2.0 * half_disc) / (2.0 * half)
    share = np.where(before, np.clip(covered, 0.0, 1.0), 0.0)
    return np.where(turn >= 0.0, share, 0.0), np.where(turn < 0.0, share, 0.0)


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
        between = np.abs(_wrapped(bearing[:, np.newaxis] - bearing))
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


def _wrapped(angle: Float) -> Float:
    return np.asarray((angle + np.pi) % (2.0 * np.pi) - np.pi)

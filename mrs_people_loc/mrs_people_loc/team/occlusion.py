"""Who hides whom: people and robots as discs on the floor."""

from __future__ import annotations

import numpy as np

from mrs_people_loc.arrays import Float, Int
from mrs_people_loc.geometry import wrap_angles

#: People and robots as discs on the floor [m].
PERSON_RADIUS, ROBOT_RADIUS = 0.25, 0.20


def hidden_by_people(
    places: Float, people: Float, others: Float | None = None, own: Int | None = None
) -> Float:
    """Share of each person's width that others hide from each place.

    Discs of one size: who is nearer looks wider, so each of them hides from one edge on.

    Args:
        places: Where somebody looks from [m], shape (k, 2).
        people: At whom [m], shape (n, 2).
        others: Everybody, these people among them [m], shape (m, 2); None: nobody else is there.
        own: Where people are looked for in several places: which of the others each is, shape
            (n,). Nobody hides themselves.

    Returns:
        Shape (k, n).
    """
    others = people if others is None else others
    left, right = _cover(places, people, others, PERSON_RADIUS)
    if own is not None:
        for side in (left, right):
            side[:, np.arange(len(people)), own] = 0.0
    hidden = left.max(axis=-1, initial=0.0) + right.max(axis=-1, initial=0.0)
    return np.asarray(np.minimum(hidden, 1.0))


def hidden_by_robots(places: Float, people: Float, robots: Float | None = None) -> Float:
    """Share of each person's width that each robot hides from each place.

    Args:
        places: Where somebody looks from [m], shape (k, 2).
        people: At whom [m], shape (n, 2).
        robots: The robots [m], shape (m, 2); one that looks hides nobody from itself. None: those
            at these places.

    Returns:
        Shape (k, m, n).
    """
    robots = places if robots is None else robots
    left, right = _cover(places, people, robots, ROBOT_RADIUS)
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
    turn = wrap_angles(
        np.arctan2(off[..., 1], off[..., 0])[:, np.newaxis] - bearing[..., np.newaxis]
    )
    # A disc is in front if it is nearer; at the place itself it is the robot that looks.
    before = (between[:, np.newaxis] < distance[..., np.newaxis] - 1e-6) & (
        between[:, np.newaxis] > 1e-6
    )
    covered = np.minimum(half_disc + half - np.abs(turn), 2.0 * half_disc) / (2.0 * half)
    share = np.where(before, np.clip(covered, 0.0, 1.0), 0.0)
    return np.where(turn >= 0.0, share, 0.0), np.where(turn < 0.0, share, 0.0)

"""Places of a view at which a network is asked whether a person stands there."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Bool, Float
from mrs_people_loc.bodies.network import WINDOW_ACROSS, WINDOW_HEIGHTS
from mrs_studies.training.pictures import PERSON, UNKNOWN
from mrs_studies.training.views import HEIGHT, WIDTH

#: Places of a view: at most so many as the picture tells of, and so many beside people, at a wrong
#: range of people and anywhere.
TOLD, BESIDE, WRONG, ANYWHERE = 6, 2, 1, 3
COUNT = TOLD + BESIDE + WRONG + ANYWHERE
#: Stereo gives places with errors: of the axis [m], and of the size, relative.
_ACROSS_ERROR, _SIZE_ERROR = 0.08, 0.1
#: Beside somebody [m]; where nobody else is within this, of a size that differs by less.
_ASIDE, _APART, _ALIKE = (0.5, 1.3), 0.45, 1.6
#: Sizes of people at a wrong range, as shares of the true one, smaller and larger.
_TOO_SMALL, _TOO_LARGE = (0.35, 0.6), (1.7, 2.6)
#: Sizes of places anywhere [px of a metre], and heights of the lens over the floor [m].
_SIZES, _LENS = (18.0, 180.0), (0.6, 1.4)
#: The middle of a window: within this of the axis, and between these heights [m]. A person is seen
#: from this share of samples of people on, nobody is there with so many of them at most, and with
#: so many that are unknown.
_MIDDLE, _BODY = 0.2, (0.2, 1.7)
_SEEN, _NOBODY, _LEAST_KNOWN = 0.15, 0.05, 0.6
#: So many samples of the middle are in the view, at least.
_LEAST_INSIDE = 4

_OF_BODY: Bool = np.abs(WINDOW_HEIGHTS - sum(_BODY) / 2) < (_BODY[1] - _BODY[0]) / 2
_OF_MIDDLE: Bool = np.abs(WINDOW_ACROSS) < _MIDDLE


def asked(told: Float, label: NDArray[np.uint8], rng: np.random.Generator) -> Float:
    """Places with answers, shape (`COUNT`, 5).

    Args:
        told: Of the view, as of `Picture`.
        label: Of the view.
        rng: Draws the places.

    Returns:
        Column and row of the foot [px], pixels of a metre, 1 for a person and 0 for none, and
        whether the answer is known, 1 or 0.
    """
    people = told[told[:, 3] > 0.5]
    some = [_with_errors(told[rng.permutation(len(told))[:TOLD]], rng)]
    wrong = np.empty((0, 4))
    if len(people):
        some.append(_beside(people[rng.integers(len(people), size=BESIDE)], rng))
        wrong = _at_wrong_range(people[rng.integers(len(people), size=WRONG)], rng)
    some += [_anywhere(COUNT - len(wrong) - sum(map(len, some)), rng), wrong]
    places = np.concatenate(some)
    person, unknown, inside = _shown(places, label)
    empty = (person <= _NOBODY) & (unknown < 1.0 - _LEAST_KNOWN) & ~_near(places, people)
    empty[: len(some[0])] = empty[COUNT - len(wrong) :] = True  # nobody, whatever is seen
    known = np.where(places[:, 3] > 0.5, person >= _SEEN, empty) & (inside >= _LEAST_INSIDE)
    return np.column_stack([places, known])


def _with_errors(places: Float, rng: np.random.Generator) -> Float:
    """Places as stereo would have them."""
    u, v, size, person = places.T
    share = np.exp(rng.normal(0.0, _SIZE_ERROR, len(places)))
    u = u + size * rng.normal(0.0, _ACROSS_ERROR, len(places))
    v = v + size * (share - 1.0) * rng.uniform(*_LENS, len(places))
    return np.column_stack([u, v, share * size, person])


def _beside(people: Float, rng: np.random.Generator) -> Float:
    """Places beside people."""
    u, v, size, person = people.T
    sign = rng.choice((-1.0, 1.0), len(people))
    return np.column_stack([u + sign * size * rng.uniform(*_ASIDE, len(u)), v, size, 0 * person])


def _at_wrong_range(people: Float, rng: np.random.Generator) -> Float:
    """Places well before or behind people."""
    u, v, size, person = people.T
    larger = rng.random(len(u)) < 0.5
    share = np.where(larger, rng.uniform(*_TOO_LARGE, len(u)), rng.uniform(*_TOO_SMALL, len(u)))
    v = v + size * (share - 1.0) * rng.uniform(*_LENS, len(u))
    return np.column_stack([u, v, share * size, 0 * person])


def _anywhere(count: int, rng: np.random.Generator) -> Float:
    low, high = map(math.log, _SIZES)
    size = np.exp(rng.uniform(low, high, count))
    v = HEIGHT / 2 + rng.normal(0.0, 10.0, count) + size * rng.uniform(*_LENS, count)
    return np.column_stack([rng.uniform(0, WIDTH, count), v, size, np.zeros(count)])


def _near(places: Float, people: Float) -> Bool:
    """Which places are near somebody."""
    u, size = places[:, np.newaxis, 0], places[:, np.newaxis, 2]
    near = np.abs(u - people[:, 0]) < _APART * np.minimum(size, people[:, 2])
    alike = np.abs(np.log(size / people[:, 2])) < math.log(_ALIKE)
    return np.asarray((near & alike).any(axis=1))


def _shown(places: Float, label: NDArray[np.uint8]) -> tuple[Any, Any, Any]:
    """Shares of people and of what is unknown in the middles of windows; samples in the view."""
    heights, across = WINDOW_HEIGHTS[_OF_BODY], WINDOW_ACROSS[_OF_MIDDLE]
    foot_u, foot_v, size = (places[:, k, np.newaxis, np.newaxis] for k in range(3))
    u, v = np.broadcast_arrays(foot_u - size * across, foot_v - size * heights[:, np.newaxis])
    inside = (u > -0.5) & (u < WIDTH - 0.5) & (v > -0.5) & (v < HEIGHT - 0.5)
    column, row = (part.round().astype(int) for part in (u, v))
    seen = label[np.clip(row, 0, HEIGHT - 1), np.clip(column, 0, WIDTH - 1)]
    count = inside.sum(axis=(1, 2))
    person, unknown = (
        (inside & (seen == kind)).sum(axis=(1, 2)) / np.maximum(count, 1)
        for kind in (PERSON, UNKNOWN)
    )
    return person, unknown, count

"""Fits the body model to examples.

Offsets to the axis are regressions whose residuals count in proportion to what they usually are: a
part in pixels of disparity, from matching, and a part in metres, from the shape of bodies. All
ranges count alike, and at no true range may the mean differ from the truth: the least squares alone
would draw far bodies to where most are, at 2 m. Standard deviations and the combination of the
scores are fitted to predictions for bags that the predicting model has not seen.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from mrs_people_loc.anthropometry import AXIS_ERROR
from mrs_people_loc.arrays import Bool, Float
from mrs_people_loc.bodies.appearance import Scores
from mrs_people_loc.bodies.model import RANGES, BodyModel, Layered, Linear
from mrs_people_loc.errors import PeopleLocError
from mrs_people_loc.precision import BODY_SIGMA_PX
from mrs_people_sim.scoring.positions import CHI2_95
from mrs_studies.fitting.appearance_fit import (
    appearance_model,
    fit_combination,
    shared_weights,
)
from mrs_studies.fitting.examples import Examples
from mrs_studies.fitting.regression import fit_layered, fit_linear, fit_quantile, rounded

FOLDS = 5
#: Added to the log-odds of a person: candidates are mostly things, and a person who is missed costs
#: more than a thing that is taken for one, which the planner's places and tracks may still remove.
IN_FAVOUR = 0.9
#: Width of the bins of range in which examples count alike [m], and how much one may count.
_BIN, _MOST = 0.5, 4.0
#: Knots of the groups that are fitted without bias: ranges [m], log2 of pixels for a metre.
_RANGE_KNOTS, _WORTH_KNOTS = np.arange(1.0, 5.6, 0.5), np.arange(-2.5, 4.1, 0.5)
#: Residuals below this share of their usual size are as good as none.
_FLOOR = 0.05


@dataclass(frozen=True)
class Parts:
    """The model without the combination of its scores.

    Attributes:
        human: The human test.
        offsets: Offsets to the axis and their standard deviations, by their names in `BodyModel`.
    """

    human: Layered
    offsets: Mapping[str, Linear]

    @classmethod
    def fit(cls, examples: Examples) -> Parts:
        """Fits the parts."""
        clear = examples.select(examples.clear)
        return cls(
            human=fit_layered(clear.even, clear.person.astype(np.float64)),
            offsets=fit_offsets(examples.select(examples.person)),
        )

    def scores(self, examples: Examples) -> Scores:
        """What the parts of the combination say of examples."""
        return Scores(self.human(examples.even), examples.network)

    def model(self, weights: Float) -> BodyModel:
        """The model with the weights of the combination."""
        return BodyModel(human=self.human, **self.offsets, appearance=appearance_model(weights))


def held_out(examples: Examples) -> list[tuple[Bool, Parts]]:
    """By fifth of the bags, its examples, and parts fitted to the others."""
    return [(held, Parts.fit(examples.select(~held))) for held in folds(examples.bag)]


def held_out_scores(examples: Examples, parts: Sequence[tuple[Bool, Parts]]) -> Scores:
    """What parts say that have not seen the bags that they judge.

    Args:
        examples: The examples.
        parts: As of `held_out`.
    """
    human = np.zeros(len(examples))
    for held, mine in parts:
        human[held] = mine.human(examples.even[held])
    return Scores(human, examples.network)


def combination(
    examples: Examples, scores: Scores, real: Examples | None = None, parts: Parts | None = None
) -> Float:
    """Weights of the combination, `IN_FAVOUR` included.

    Args:
        examples: Of renderings.
        scores: Theirs, of parts that have not seen their bags.
        real: Of real rooms.
        parts: Judge the real ones.
    """
    scores, person = scores.select(examples.decided), examples.person[examples.decided]
    known = np.zeros(len(scores), dtype=bool)
    if real is not None and parts is not None:
        decided = real.select(real.decided)
        scores = Scores.joined([scores, parts.scores(decided)])
        person = np.concatenate([person, decided.person])
        known = np.arange(len(scores)) >= len(known)
    weights = fit_combination(scores, person, shared_weights(known))
    weights[-1] += IN_FAVOUR
    return weights


def check_enough(examples: Examples) -> None:
    """Checks that there is something to fit to.

    Raises:
        PeopleLocError: There are too few examples of either kind, or they are of one bag.
    """
    people = int(examples.person.sum())
    others = int(examples.clear.sum()) - people
    if people < 100 or others < 100:
        raise PeopleLocError(
            f"{people} examples of people and {others} of other things; wanted: 100 of each"
        )
    if len(folds(examples.bag)) < 2:
        raise PeopleLocError("all examples are of one bag; wanted: several bags")


def fit_offsets(people: Examples) -> dict[str, Linear]:
    """Offsets to the axis and their standard deviations, fitted to examples of people."""
    weight = range_weights(people)
    across, depth = _fit_axis(people, weight)
    error_across, error_depth = np.zeros(len(people)), np.zeros(len(people))
    for held in folds(people.bag):
        part = people.select(held)
        mine = _fit_axis(people.select(~held), weight[~held])
        error_across[held] = part.across - mine[0](part.odd)
        error_depth[held] = part.more_px - mine[1](part.depth)
    sigmas, squares = [], np.zeros(len(people))
    for error, size in (
        (error_across, np.full(len(people), AXIS_ERROR)),
        (error_depth, usual_px(people)),
    ):
        model, predicted = _fit_log_sigma(people, error, size, weight)
        sigmas.append(model)
        squares += (error / np.exp(predicted)) ** 2
    larger = 0.5 * math.log(_weighted_quantile(squares, 0.95, weight) / CHI2_95)
    sigmas = [dataclasses.replace(one, offset=one.offset + larger) for one in sigmas]
    return {
        "across": across,
        "depth": depth,
        "across_log_sigma": sigmas[0],
        "depth_log_sigma": sigmas[1],
    }


def usual_px(people: Examples) -> Float:
    """What inverse ranges usually err by [px], shape (n,)."""
    pixels_per_metre = people.inverse_range**2 / people.scale
    return np.hypot(BODY_SIGMA_PX, AXIS_ERROR * pixels_per_metre)


def true_range(people: Examples) -> Float:
    """From the lens to the axis [m], shape (n,)."""
    return people.scale / (people.inverse_range + people.more_px)


def range_weights(people: Examples) -> Float:
    """Weights by which all ranges count alike, as far as there are examples; mean 1."""
    number = (true_range(people) / _BIN).astype(np.intp)
    count = np.bincount(number)[number]
    weight = np.minimum(count.mean() / count, _MOST)
    return np.asarray(weight / weight.mean())


def folds(bag: Any) -> list[Bool]:
    """Which examples are of each fifth of the bags; fifths without any are left out."""
    return [held for fold in range(FOLDS) if (held := bag % FOLDS == fold).any()]


def _fit_axis(people: Examples, weight: Float) -> tuple[Linear, Linear]:
    size = AXIS_ERROR * np.ones(len(people))
    across = fit_linear(people.odd, people.across, size=size, weight=weight, odd=True)
    size = usual_px(people)
    depth = fit_linear(
        people.depth, people.more_px, size=size, weight=weight, uncut=True, groups=_groups(people)
    )
    return across, depth


def _groups(people: Examples) -> Float:
    """Membership in groups of like range, and of like pixels for a metre of depth."""
    far = true_range(people)
    worth = np.log2(people.scale / far**2)
    return np.column_stack([_hats(far, _RANGE_KNOTS), _hats(worth, _WORTH_KNOTS)])


def _hats(values: Float, knots: Float) -> Float:
    """Shares of the knots that a value lies between, shape (n, knots)."""
    return np.column_stack([np.interp(values, knots, row) for row in np.eye(len(knots))])


def _fit_log_sigma(
    people: Examples, error: Float, size: Float, weight: Float
) -> tuple[Linear, Float]:
    """Log of the errors' size, raised by range and head so that 95 % are within 1.96 sigma.

    Returns:
        The model, and what models say that have not seen the bags that they judge, shape (n,).
    """
    ones = np.ones(len(people))
    log = np.log(np.abs(error) + _FLOOR * size)
    model = fit_linear(people.even, log, size=ones, weight=weight)
    unseen = np.zeros(len(people))
    for held in folds(people.bag):
        mine = fit_linear(people.even[~held], log[~held], size=ones[~held], weight=weight[~held])
        unseen[held] = mine(people.even[held])
    columns = np.column_stack([model.scaled(people.even)[:, RANGES], ones])
    raised = fit_quantile(columns, log - math.log(1.96) - unseen, 0.95, weight=weight)
    weights = model.weights.copy()
    weights[RANGES] += raised[:-1]
    final = Linear(model.scaled, rounded(weights), model.offset + float(raised[-1]))
    return final, unseen + columns @ raised


def _weighted_quantile(values: Float, share: float, weight: Float) -> float:
    order = np.argsort(values)
    total = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(total, share * total[-1])])

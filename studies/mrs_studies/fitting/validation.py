"""Cross-validation of the body model."""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Bool, Float, StructOfArrays
from mrs_people_loc.bodies.appearance import Scores
from mrs_people_sim.scoring.positions import CHI2_95
from mrs_studies.fitting.body_fit import Parts, combination, held_out, held_out_scores, true_range
from mrs_studies.fitting.examples import Examples

#: Bins of the true range [m], and of focal length times baseline of heads [px m].
_RANGES = (0.0, 1.5, 2.5, 3.5, 20.0)
_HEADS = (0.0, 7.5, 12.0, 20.0, 1000.0)
#: Fewer examples than this are no row of the table.
_FEW = 20


@dataclass(frozen=True)
class Judged(StructOfArrays):
    """What a model says of candidates, and by how much it is wrong; arrays of shape (n,).

    Attributes:
        human: Log-odds of a person by the human test.
        score: Likewise with the appearance.
        across: Error across the line of sight [m].
        along: Error along it [m], positive: too far.
        sigma_across: Standard deviation [m].
        sigma_along: Likewise.
    """

    human: Float
    score: Float
    across: Float
    along: Float
    sigma_across: Float
    sigma_along: Float

    @classmethod
    def of_parts(cls, parts: Parts, weights: Float, examples: Examples) -> Judged:
        """Applies parts, and weights of their combination, to examples."""
        scale, inverse, offsets = examples.scale, examples.inverse_range, parts.offsets
        found = scale / np.maximum(inverse + offsets["depth"](examples.depth), 0.5 * inverse)
        scores = parts.scores(examples)
        return cls(
            human=scores.human,
            score=scores.combined(weights),
            across=offsets["across"](examples.odd) - examples.across,
            along=found - true_range(examples),
            sigma_across=np.exp(offsets["across_log_sigma"](examples.even)),
            sigma_along=found**2 / scale * np.exp(offsets["depth_log_sigma"](examples.even)),
        )

    @property
    def inside(self) -> Bool:
        """Whether the truth is in the 95 % ellipse, shape (n,)."""
        square = (self.across / self.sigma_across) ** 2 + (self.along / self.sigma_along) ** 2
        return square < CHI2_95


def cross_validate(examples: Examples) -> tuple[Judged, Scores]:
    """What models say that have not seen the bags that they judge, and the scores behind it."""
    count = len(examples)
    parts = held_out(examples)
    scores = held_out_scores(examples, parts)
    result = Judged(*(np.zeros(count) for _ in dataclasses.fields(Judged)))
    for held, mine in parts:
        weights = combination(examples.select(~held), scores.select(~held))
        part = Judged.of_parts(mine, weights, examples.select(held))
        for name, values in vars(part).items():
            getattr(result, name)[held] = values
    return result, scores


def real_rooms(
    examples: Examples, scores: Scores, real: Examples, rooms: Sequence[str], parts: Parts
) -> list[str]:
    """Lines of figures of real rooms, each judged by weights that have not seen that room.

    Args:
        examples: Of renderings.
        scores: Theirs, as of `cross_validate`.
        real: Of the real rooms.
        rooms: Room of each recording, by the number of its bag.
        parts: Fitted to the renderings.
    """
    room = np.array(rooms)[real.bag]
    lines = ["room, left out        people  others  found  false (log-odds above 0.5)"]
    for name in sorted(set(rooms)):
        weights = combination(examples, scores, real.select(room != name), parts)
        part = real.select((room == name) & real.clear)
        found = parts.scores(part).combined(weights) > 0.5
        person = part.person
        lines.append(
            f"{name:21s} {person.sum():6d}  {(~person).sum():6d}  {(found & person).sum():5d}  "
            f"{(found & ~person).sum():5d}"
        )
    return lines


def figures(examples: Examples, judged: Judged) -> dict[str, float]:
    """Figures of all examples together."""
    person, clear, score = examples.person, examples.clear, judged.score
    order = np.flatnonzero(clear)[np.argsort(-score[clear], kind="stable")]
    hits = np.cumsum(person[order])
    precision = hits / np.arange(1, len(order) + 1)
    at = np.searchsorted(hits, 0.95 * hits[-1])
    return {
        "examples": float(len(examples)),
        "people": float(person.sum()),
        "log loss": _log_loss(score[clear], person[clear]),
        "log loss of the human test": _log_loss(judged.human[clear], person[clear]),
        "precision at recall 0.95": float(precision[at]),
        "error across, mean [cm]": float(100 * np.abs(judged.across[person]).mean()),
        "error along, mean [cm]": float(100 * np.abs(judged.along[person]).mean()),
        "in the 95 % ellipse": float(judged.inside[person].mean()),
    }


def _log_loss(score: Float, person: Bool) -> float:
    return float(np.mean(np.logaddexp(0.0, score) - person * score))


def table(examples: Examples, judged: Judged) -> list[str]:
    """Lines of a table of errors by head and range, people only.

    Behind the mean is its standard error, as far as bags differ.
    """
    lines = [
        "px m   range [m]  people  along: mean        sd  stated [cm]  across: sd  stated  in 95 %"
    ]
    far = true_range(examples)
    for low, high in itertools.pairwise(_HEADS):
        head = examples.person & (examples.scale >= low) & (examples.scale < high)
        for near, end in itertools.pairwise(_RANGES):
            chosen = head & (far >= near) & (far < end)
            if chosen.sum() < _FEW:
                continue
            part = judged.select(chosen)
            apart = part.along - part.along.mean()
            error = np.linalg.norm(np.bincount(examples.bag[chosen], apart)) / chosen.sum()
            stated = [
                100 * np.sqrt(np.mean(sigma**2)) for sigma in (part.sigma_along, part.sigma_across)
            ]
            lines.append(
                f"{examples.scale[chosen].mean():4.1f}   {near:3.1f}-{min(end, 9.0):3.1f}    "
                f"{chosen.sum():6d}  "
                f"{100 * part.along.mean():+11.1f} +- {100 * error:3.1f} "
                f"{100 * part.along.std():4.1f} "
                f"{stated[0]:12.1f}  {100 * part.across.std():10.1f} {stated[1]:7.1f}  "
                f"{part.inside.mean():7.3f}"
            )
    return lines

"""Cross-validation of the body model."""

from __future__ import annotations

import dataclasses
import itertools
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Bool, Float, StructOfArrays
from mrs_people_loc.bodies.model import BodyModel
from mrs_tools.fitting.body_fit import FOLDS, fit, true_range
from mrs_tools.fitting.examples import Examples
from mrs_tools.scoring.positions import CHI2_95

#: Bins of the true range [m], and of focal length times baseline of heads [px m].
_RANGES = (0.0, 1.5, 2.0, 3.0, 4.0, 5.0, 20.0)
_HEADS = (0.0, 7.5, 12.0, 20.0, 1000.0)
#: Fewer examples than this are no row of the table.
_FEW = 20


@dataclass(frozen=True)
class Judged(StructOfArrays):
    """What a model says of candidates, and by how much it is wrong; arrays of shape (n,).

    Attributes:
        score: Log-odds of a person.
        across: Error across the line of sight [m].
        along: Error along it [m], positive: too far.
        sigma_across: Standard deviation [m].
        sigma_along: Likewise.
    """

    score: Float
    across: Float
    along: Float
    sigma_across: Float
    sigma_along: Float

    @classmethod
    def of_model(cls, model: BodyModel, examples: Examples) -> Judged:
        """Applies a model to examples."""
        scale, inverse = examples.scale, examples.inverse_range
        found = scale / np.maximum(inverse + model.depth(examples.depth), 0.5 * inverse)
        return cls(
            score=model.human(examples.even),
            across=model.across(examples.odd) - examples.across,
            along=found - true_range(examples),
            sigma_across=np.exp(model.across_log_sigma(examples.even)),
            sigma_along=found**2 / scale * np.exp(model.depth_log_sigma(examples.even)),
        )

    @property
    def inside(self) -> Bool:
        """Whether the truth is in the 95 % ellipse, shape (n,)."""
        square = (self.across / self.sigma_across) ** 2 + (self.along / self.sigma_along) ** 2
        return square < CHI2_95


def cross_validate(examples: Examples) -> Judged:
    """What models say that have not seen the bags that they judge."""
    count = len(examples)
    result = Judged(*(np.zeros(count) for _ in dataclasses.fields(Judged)))
    for fold in range(FOLDS):
        held = examples.bag % FOLDS == fold
        if not held.any():
            continue
        part = Judged.of_model(fit(examples.select(~held)), examples.select(held))
        for name, values in vars(part).items():
            getattr(result, name)[held] = values
    return result


def figures(examples: Examples, judged: Judged) -> dict[str, float]:
    """Figures of all examples together."""
    person, clear, score = examples.person, examples.clear, judged.score
    order = np.flatnonzero(clear)[np.argsort(-score[clear], kind="stable")]
    hits = np.cumsum(person[order])
    precision = hits / np.arange(1, len(order) + 1)
    at = np.searchsorted(hits, 0.95 * hits[-1])
    loss = np.logaddexp(0.0, score[clear]) - person[clear] * score[clear]
    return {
        "examples": float(len(examples)),
        "people": float(person.sum()),
        "log loss": float(loss.mean()),
        "precision at recall 0.95": float(precision[at]),
        "error across, mean [cm]": float(100 * np.abs(judged.across[person]).mean()),
        "error along, mean [cm]": float(100 * np.abs(judged.along[person]).mean()),
        "in the 95 % ellipse": float(judged.inside[person].mean()),
    }


def table(examples: Examples, judged: Judged) -> list[str]:
    """Lines of a table of errors by head and range, people only."""
    lines = ["px m   range [m]  people  along: mean  sd  stated [cm]  across: sd  stated  in 95 %"]
    far = true_range(examples)
    for low, high in itertools.pairwise(_HEADS):
        head = examples.person & (examples.scale >= low) & (examples.scale < high)
        for near, end in itertools.pairwise(_RANGES):
            chosen = head & (far >= near) & (far < end)
            if chosen.sum() < _FEW:
                continue
            part = judged.select(chosen)
            stated = [
                100 * np.sqrt(np.mean(sigma**2)) for sigma in (part.sigma_along, part.sigma_across)
            ]
            lines.append(
                f"{examples.scale[chosen].mean():4.1f}   {near:3.1f}-{min(end, 9.0):3.1f}    "
                f"{chosen.sum():6d}  "
                f"{100 * part.along.mean():+11.1f} {100 * part.along.std():4.1f} "
                f"{stated[0]:12.1f}  {100 * part.across.std():10.1f} {stated[1]:7.1f}  "
                f"{part.inside.mean():7.3f}"
            )
    return lines

"""The model: from a patch to the log-odds of a person, the place of the axis and its uncertainty.

The evidence is the share of a patch's samples that lie at the body's depth, behind it and in front
of it, by height and distance from its middle: a person has free space beside and above, a wall goes
on. A small fitted model turns it into a log-odds and into the offset from the surface that was seen
to the body's axis. `mrs fit` fits it; its numbers are in `body_model.json`.
"""

from __future__ import annotations

import functools
import json
from collections.abc import Mapping
from dataclasses import dataclass
from importlib import resources
from typing import Any, NamedTuple

import numpy as np

from mrs_people_loc.anthropometry import AXIS_ERROR
from mrs_people_loc.arrays import Bool, Float, Float32
from mrs_people_loc.bodies.appearance import AppearanceModel
from mrs_people_loc.bodies.patches import (
    ACROSS,
    BANDS,
    BODY_HEIGHTS,
    HEIGHTS,
    SILHOUETTE,
    SLICES,
    STRIPES,
    Patches,
    in_rows,
    quantiles,
)
from mrs_people_loc.bodies.votes import Vote
from mrs_people_loc.errors import ConfigError
from mrs_people_loc.precision import BODY_SIGMA_PX

#: Quantiles of the disparities of a body.
_SHARES = (0.1, 0.25, 0.5, 0.75, 0.9)
#: Ranges from which on something may depend on the range in another way [m].
_KNOTS = (2.0, 3.0, 4.0)


def _between(values: Float32, low: float, high: float) -> Bool:
    return (values >= np.float32(low - 1e-4)) & (values < np.float32(high - 1e-4))


def _means(chosen: list[Bool]) -> Float32:
    """Weights that average the chosen samples, a row for each choice."""
    rows = np.array(chosen, dtype=np.float32)
    return np.asarray(rows / rows.sum(axis=1, keepdims=True))


_OF_BANDS = _means([_between(HEIGHTS, *band) for band in BANDS])
_OF_STRIPES = _means(  # first those to the right, then those to the left
    [_between(side * ACROSS, *stripe) for side in (-1, 1) for stripe in STRIPES]
)
_OF_SLICES = np.array([_between(HEIGHTS, *part) for part in SLICES], dtype=np.float32)
#: Of each sample of a body, row by row: whether it is in the upper part; its distance to the left
#: to the powers 0, 1 and 2.
_UPPER = np.repeat(_between(HEIGHTS[BODY_HEIGHTS], 1.0, 9.0), len(ACROSS[SILHOUETTE]))
_MOMENTS = np.tile(
    np.vander(ACROSS[SILHOUETTE].astype(np.float64), 3, increasing=True),
    (len(HEIGHTS[BODY_HEIGHTS]), 1),
)


@dataclass(frozen=True)
class Evidence:
    """Input of the model, one row for each patch.

    Attributes:
        even: Unchanged when left and right are swapped, shape (n, `EVEN`).
        odd: Changes its sign then, shape (n, `ODD`).
        depth: Of the body's disparity [px], shape (n, `DEPTH`).
    """

    even: Float
    odd: Float
    depth: Float


def gather_evidence(
    patches: Patches, extent: Float, vote: Vote, *, depth_disparity: float, focal: float
) -> Evidence:
    """Evidence of patches.

    Matching errs in pixels, bodies have sizes in metres: each column has the unit of its cause, and
    how many pixels of disparity a metre of depth makes at the body puts both in proportion. So one
    fitted model serves heads of any focal length and baseline.

    Args:
        patches: Patches, centred on bodies.
        extent: Vertical extent that the search saw [m], shape (n,).
        vote: Their disparities, voted.
        depth_disparity: Focal length times baseline [px m].
        focal: Focal length [px].
    """
    even, odd, same = _shares(patches, vote)
    surface = _surface(patches)
    inverse = patches.inverse_range
    ranges = depth_disparity / inverse
    metres = ranges / inverse  # per pixel of disparity
    slope = surface.slope * metres
    of_place = [
        ranges,
        1.0 / ranges,
        extent,
        patches.tolerance * metres,
        surface.deviation * metres,
        np.minimum(np.abs(slope), 3.0),
        np.log(np.hypot(BODY_SIGMA_PX, AXIS_ERROR / metres)),
        np.log(np.hypot(AXIS_ERROR, ranges / focal)),
        *(np.maximum(ranges - knot, 0.0) for knot in _KNOTS),
    ]
    depth = np.column_stack([*surface.middles, vote.shift, np.minimum(vote.sigma, 0.5)])
    worth = 1.0 / np.sqrt(metres)[:, np.newaxis]
    return Evidence(
        even=np.column_stack([even, *of_place]).astype(np.float64),
        odd=np.column_stack([_centroids(same), slope, odd]).astype(np.float64),
        depth=np.hstack(
            [depth, depth / worth, depth * worth, worth, worth * worth, 1.0 / worth]
        ).astype(np.float64),
    )


def _shares(patches: Patches, vote: Vote) -> tuple[Float32, Float32, Float32]:
    """Shares of the samples in each class, by band and stripe.

    Returns:
        Even and odd columns of the evidence, and how far each sample is of the body, from 0 to 1,
        shape (n, heights, across).
    """
    relative = patches.difference / patches.tolerance.astype(np.float32)[:, np.newaxis, np.newaxis]
    known = np.isfinite(relative)
    relative[~known] = 0.0
    parts = np.empty((6, *relative.shape), dtype=np.float32)
    same, behind, front, depth, contrast, outside = parts
    # How far a sample belongs to a class, with soft borders: -1 ... 1 tolerances are the body.
    np.clip(2.0 - np.abs(relative), 0.0, 1.0, out=same)
    same *= known
    np.clip(-1.0 - relative, 0.0, 1.0, out=behind)
    np.clip(relative - 1.0, 0.0, 1.0, out=front)
    np.clip(relative, -2.0, 2.0, out=depth)
    contrast[:] = vote.contrast
    outside[:] = ~patches.inside
    right, left = np.split(_OF_BANDS @ parts @ _OF_STRIPES.T, 2, axis=-1)
    least = np.minimum(left, right)[:-1, ..., 2:]
    return _columns(0.5 * (left + right)[:-1], least), _columns(left - right), same


def _columns(*shares: Float32) -> Float32:
    """Shares of shapes (parts, n, bands, stripes) as columns, part by part, shape (n, columns)."""
    columns = [each.reshape(*each.shape[:2], each.shape[2] * each.shape[3]) for each in shares]
    return np.asarray(in_rows(np.concatenate(columns, axis=2).swapaxes(0, 1)))


def _centroids(same: Float32) -> Float:
    """How far to the left the body is in each slice of height [m], shape (n, slices)."""
    across = ACROSS[SILHOUETTE].astype(np.float64)
    weights = (_OF_SLICES @ same[..., SILHOUETTE]).astype(np.float64)
    return np.asarray(weights @ across / np.maximum(weights.sum(axis=2), 1e-3))


class _Surface(NamedTuple):
    """Disparities of the bodies in patches, against the patches' own [px].

    Attributes:
        middles: Quantiles, mean, and median of the upper part: shapes (n, 5), (n,) and (n,).
        deviation: Standard deviation, shape (n,).
        slope: To the left [px/m], shape (n,): an oblique wall has one, a body has not.
    """

    middles: tuple[Float, Float, Float]
    deviation: Float
    slope: Float


def _surface(patches: Patches) -> _Surface:
    """Measures the surfaces of the bodies, sample by sample of their silhouettes."""
    inner = in_rows(patches.difference[:, BODY_HEIGHTS, SILHOUETTE])
    with np.errstate(invalid="ignore"):
        body = np.abs(inner) < 1.5 * patches.tolerance[:, np.newaxis]
    both = np.concatenate([body, body & _UPPER])
    spread, upper = np.split(quantiles(np.concatenate([inner, inner]), both, _SHARES), 2)
    values = np.where(body, inner, 0.0).astype(np.float64)
    number, columns, squares = (body.astype(np.float64) @ _MOMENTS).T
    number = np.maximum(number, 1.0)
    total, of_columns, _ = (values @ _MOMENTS).T
    mean, middle = total / number, columns / number
    moment = squares / number - middle**2
    variance = np.einsum("ij,ij->i", values, values) / number - mean**2
    return _Surface(
        middles=(spread, mean, upper[:, _SHARES.index(0.5)]),
        deviation=np.sqrt(np.maximum(variance, 0.0)),
        slope=(of_columns / number - mean * middle) / (moment + 1e-3),  # least squares
    )


#: Widths of the evidence.
EVEN = 5 * len(BANDS) * (len(STRIPES) + 2) + 8 + len(_KNOTS)
#: Columns of even evidence that say how far away a body is, and how well a head measures there.
RANGES = slice(EVEN - 2 - len(_KNOTS), EVEN)
ODD = len(SLICES) + 1 + 6 * len(BANDS) * len(STRIPES)
DEPTH = 3 * 10


@dataclass(frozen=True)
class Scaled:
    """Evidence brought to a common scale: (x - mean) / scale, cut at 4."""

    mean: Float
    scale: Float

    def __call__(self, values: Float) -> Float:
        """The scaled evidence, in the shape of the values, (n, width)."""
        return np.clip((values - self.mean) / self.scale, -4.0, 4.0)


@dataclass(frozen=True)
class Linear:
    """weights . scaled evidence + offset."""

    scaled: Scaled
    weights: Float
    offset: float

    def __call__(self, values: Float) -> Float:
        """One number per row of evidence, shape (n,)."""
        result: Float = self.scaled(values) @ self.weights + self.offset
        return result


@dataclass(frozen=True)
class Layered:
    """A network of one hidden layer: output . tanh(hidden . scaled evidence + bias) + offset."""

    scaled: Scaled
    hidden: Float
    bias: Float
    output: Float
    offset: float

    def __call__(self, values: Float) -> Float:
        """One number per row of evidence, shape (n,)."""
        result: Float = np.tanh(self.scaled(values) @ self.hidden + self.bias) @ self.output
        return result + self.offset


@dataclass(frozen=True)
class BodyModel:
    """The fitted model.

    Attributes:
        human: From even evidence, log-odds of being a person.
        across: From odd evidence, how far to the left of the patch's middle the axis is [m].
        depth: From depth evidence, how much more inverse range the axis has [px].
        across_log_sigma: From even evidence, log of the standard deviation of `across` [m].
        depth_log_sigma: From even evidence, log of the standard deviation of `depth` [px].
        appearance: How the human test and the appearance are combined.
    """

    human: Layered
    across: Linear
    depth: Linear
    across_log_sigma: Linear
    depth_log_sigma: Linear
    appearance: AppearanceModel

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> BodyModel:
        """Reads the model as `to_mapping` gives it; other keys, such as `fitted_to`, do not count.

        Raises:
            ConfigError: Something is missing, not finite, or does not fit the evidence.
        """
        widths = {
            "human": EVEN,
            "across": ODD,
            "depth": DEPTH,
            "across_log_sigma": EVEN,
            "depth_log_sigma": EVEN,
        }
        parts: dict[str, Any] = {}
        for name, width in widths.items():
            try:
                part: dict[str, Any] = {
                    key: np.array(v, dtype=np.float64) for key, v in values[name].items()
                }
                scaled = Scaled(part.pop("mean"), part.pop("scale"))
                offset = float(part.pop("offset"))
                kind: type[Any] = Layered if name == "human" else Linear
                parts[name] = kind(scaled=scaled, offset=offset, **part)
            except (KeyError, TypeError, ValueError, AttributeError) as err:
                raise ConfigError(f"body model: {name} cannot be read ({err!r})") from err
            arrays = [scaled.mean, scaled.scale, offset, *part.values()]
            if not all(np.isfinite(array).all() for array in arrays):
                raise ConfigError(f"body model: {name} holds NaN or infinite values")
            if scaled.mean.shape != (width,) or scaled.scale.shape != (width,):
                raise ConfigError(
                    f"body model: {name} takes {scaled.mean.size} numbers; wanted: {width}"
                )
            if not (scaled.scale > 0).all():
                raise ConfigError(f"body model: {name} has a scale of 0 or less; wanted: more")
            shapes: dict[str, tuple[int, ...]] = {"weights": (width,)}
            if name == "human":
                layer = part["bias"].size
                shapes = {"hidden": (width, layer), "bias": (layer,), "output": (layer,)}
            for key, shape in shapes.items():
                if part[key].shape != shape:
                    raise ConfigError(
                        f"body model: {name} has {key} of shape {part[key].shape}; wanted: {shape}"
                    )
        try:
            appearance = values["appearance"]
        except KeyError as err:
            raise ConfigError(f"body model: appearance cannot be read ({err!r})") from err
        return cls(**parts, appearance=AppearanceModel.from_mapping(appearance))

    def to_mapping(self) -> dict[str, Any]:
        """The model as plain lists and numbers."""
        result: dict[str, Any] = {}
        for name in ("human", "across", "depth", "across_log_sigma", "depth_log_sigma"):
            part = vars(getattr(self, name)).copy()
            part.update(vars(part.pop("scaled")))
            result[name] = {
                key: np.asarray(value, dtype=np.float64).tolist() for key, value in part.items()
            }
        return {**result, "appearance": self.appearance.to_mapping()}


@functools.cache
def fitted() -> BodyModel:
    """The model that comes with this package (`mrs fit`)."""
    text = resources.files("mrs_people_loc.bodies").joinpath("body_model.json").read_text("utf-8")
    return BodyModel.from_mapping(json.loads(text))

"""What a patch says of the body in it: is it human, where is its axis, how sure is that.

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
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.bodies.patches import (
    ACROSS,
    BODY_HEIGHTS,
    HEIGHTS,
    SILHOUETTE,
    Patches,
    in_rows,
    quantiles,
)
from mrs_people_loc.bodies.votes import Vote
from mrs_people_loc.errors import ConfigError

Float32 = NDArray[np.float32]
Float = NDArray[np.float64]

#: Bands of height over the floor [m]: legs, thighs, belly, chest, shoulders, head, above.
_BANDS = ((0.1, 0.5), (0.5, 0.9), (0.9, 1.25), (1.25, 1.5), (1.5, 1.75), (1.75, 2.0), (2.0, 2.4))
#: Stripes by distance from the middle [m]: trunk, arms, beside the body.
_STRIPES = ((0.0, 0.14), (0.14, 0.28), (0.34, 0.49), (0.49, 0.71))
#: Slices of height whose centroids are compared [m].
_SLICES = tuple((low, low + 0.35) for low in (0.3, 0.6, 0.9, 1.2, 1.4, 1.6))
_SHARES = (0.1, 0.25, 0.5, 0.75, 0.9)


def _between(values: Float32, low: float, high: float) -> NDArray[np.bool_]:
    return (values >= np.float32(low - 1e-4)) & (values < np.float32(high - 1e-4))


def _means(chosen: list[NDArray[np.bool_]]) -> Float32:
    """Weights that average the chosen samples, a row for each choice."""
    rows = np.array(chosen, dtype=np.float32)
    return np.asarray(rows / rows.sum(axis=1, keepdims=True))


_OF_BANDS = _means([_between(HEIGHTS, *band) for band in _BANDS])
_OF_STRIPES = _means(  # first those to the right, then those to the left
    [_between(side * ACROSS, *stripe) for side in (-1, 1) for stripe in _STRIPES]
)
_OF_SLICES = np.array([_between(HEIGHTS, *part) for part in _SLICES], dtype=np.float32)
_UPPER = _between(HEIGHTS[BODY_HEIGHTS], 1.0, 9.0)


@dataclass(frozen=True)
class Evidence:
    """What patches say, as numbers for the model; each row is one patch.

    Attributes:
        even: Not changed when left and right are swapped, shape (n, `EVEN`).
        odd: Changes its sign then, shape (n, `ODD`).
        depth: Of the body's disparity [px], shape (n, `DEPTH`).
    """

    even: Float
    odd: Float
    depth: Float


def gather_evidence(
    patches: Patches, extent: Float, vote: Vote, *, depth_disparity: float
) -> Evidence:
    """Reads patches.

    Args:
        patches: Patches, centred on bodies.
        extent: Metres of vertical extent that the search saw [m], shape (n,).
        vote: What their pixels say together.
        depth_disparity: Focal length times baseline [px m].
    """
    relative = patches.difference / patches.tolerance.astype(np.float32)[:, np.newaxis, np.newaxis]
    known = np.isfinite(relative)
    relative[~known] = 0.0
    # How far a sample belongs to a class, with soft borders: -1 ... 1 tolerances are the body.
    same = np.clip(2.0 - np.abs(relative), 0.0, 1.0) * known
    behind = np.clip(-1.0 - relative, 0.0, 1.0)
    front = np.clip(relative - 1.0, 0.0, 1.0)
    even, odd = [], []
    depth = np.clip(relative, -2.0, 2.0)
    for part in (same, behind, front, depth, vote.contrast, (~patches.inside).astype(np.float32)):
        shares = _OF_BANDS @ part @ _OF_STRIPES.T
        left, right = shares[..., len(_STRIPES) :], shares[..., : len(_STRIPES)]
        odd.append(in_rows(left - right))
        if len(odd) <= 5:
            even.append(in_rows(0.5 * (left + right)))
            even.append(in_rows(np.minimum(left, right)[..., 2:]))

    inner = patches.difference[:, BODY_HEIGHTS, SILHOUETTE]
    with np.errstate(invalid="ignore"):
        body = np.abs(inner) < 1.5 * patches.tolerance[:, np.newaxis, np.newaxis]
    flat, chosen = in_rows(inner), in_rows(body)
    spread = quantiles(flat, chosen, _SHARES)
    upper = quantiles(in_rows(inner[:, _UPPER]), in_rows(body[:, _UPPER]), (0.5,))
    number = np.maximum(chosen.sum(axis=1), 1)
    values = np.where(body, inner, 0.0)
    mean = values.sum(axis=(1, 2)) / number
    across = ACROSS[SILHOUETTE].astype(np.float64)
    columns, of_columns = body.sum(axis=1), values.sum(axis=1)
    middle = columns @ across / number
    # Least-squares slope of the disparity across the body: an oblique wall has one, a body has not.
    moment = columns @ across**2 / number - middle**2
    slope = (of_columns @ across / number - mean * middle) / (moment + 1e-3)

    inverse = patches.inverse_range
    ranges = depth_disparity / inverse
    metres = ranges / inverse  # that a pixel of disparity is worth
    of_centroids = (_OF_SLICES @ same[..., SILHOUETTE]).astype(np.float64)
    centroids = of_centroids @ across / np.maximum(of_centroids.sum(axis=2), 1e-3)
    deviation = np.sqrt(np.maximum((values**2).sum(axis=(1, 2)) / number - mean**2, 0.0))
    scalars = [
        ranges,
        1.0 / ranges,
        extent,
        patches.tolerance * metres,
        deviation * metres,
        np.minimum(np.abs(slope) * metres, 3.0),
    ]
    direct = np.column_stack(
        [spread, mean, upper, vote.shift, np.minimum(vote.sigma, 0.5), inverse]
    )
    return Evidence(
        even=np.column_stack([*even, *scalars]).astype(np.float64),
        odd=np.column_stack([centroids, slope * metres, *odd]).astype(np.float64),
        depth=np.column_stack(
            [
                direct,
                direct[:, :-1] * (3.0 / inverse)[:, np.newaxis],
                direct * (inverse / 5.0)[:, np.newaxis],
                1.0 / inverse,
            ]
        ),
    )


#: Widths of the evidence.
EVEN = 5 * len(_BANDS) * (len(_STRIPES) + 2) + 6
ODD = len(_SLICES) + 1 + 6 * len(_BANDS) * len(_STRIPES)
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
    """

    human: Layered
    across: Linear
    depth: Linear
    across_log_sigma: Linear
    depth_log_sigma: Linear

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> BodyModel:
        """Reads the model as `to_mapping` gives it.

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
        return cls(**parts)

    def to_mapping(self) -> dict[str, Any]:
        """The model as plain lists and numbers."""
        result: dict[str, Any] = {}
        for name in ("human", "across", "depth", "across_log_sigma", "depth_log_sigma"):
            part = vars(getattr(self, name)).copy()
            part.update(vars(part.pop("scaled")))
            result[name] = {
                key: np.asarray(value, dtype=np.float64).tolist() for key, value in part.items()
            }
        return result


@functools.cache
def fitted() -> BodyModel:
    """The model that comes with this package (`mrs fit`)."""
    text = resources.files("mrs_people_loc.bodies").joinpath("body_model.json").read_text("utf-8")
    return BodyModel.from_mapping(json.loads(text))

"""Appearance: how a body's image speaks for a person, beside its shape in the disparities.

OpenCV's people detector, a linear classifier on histograms of oriented gradients (its 3781 numbers
are in `people_detector.npy`; see NOTICE), judges block by block, so that what is outside the image
says nothing. A small network is trained on simulated rooms (`network`). A logistic model combines
both with the human test.
"""

from __future__ import annotations

import functools
import io
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from importlib import resources
from typing import Any

import numpy as np

from mrs_people_loc.arrays import Bool, Float, Float32, StructOfArrays
from mrs_people_loc.bodies.gradients import BLOCK, CELL, GradientSampler, Histograms, Window
from mrs_people_loc.bodies.network import PersonNetwork
from mrs_people_loc.errors import ConfigError
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import Gray

#: The window of OpenCV's people detector, 64 x 128, whose people are 96 samples tall: those of
#: 1.75 m.
DETECTOR_WINDOW = Window(
    low=-16 * 1.75 / 96, high=112 * 1.75 / 96, width=64 * 1.75 / 96, rows=128, columns=64
)
#: What its windows cover that are one cell to either side: the axis is 5 to 10 cm behind the head
#: of somebody who walks, and as uncertain as that.
DETECTOR_VIEW = replace(
    DETECTOR_WINDOW, width=(64 + 2 * CELL) * 1.75 / 96, columns=DETECTOR_WINDOW.columns + 2 * CELL
)
DETECTOR_WINDOWS = (DETECTOR_VIEW.columns - DETECTOR_WINDOW.columns) // CELL + 1
#: The human test says much less than the lower one of people behind desks and in doorways, and
#: hardly ever more than the upper one of anything but people [log-odds].
HUMAN_LIMITS = (-2.0, 4.0)
#: What has less by the human test is not looked at; its log-odds remain.
RULED_OUT = -8.0
#: Fewer blocks in the image than this share of them count as this share.
_LEAST_SHARE = 0.05


@dataclass(frozen=True)
class AppearanceModel:
    """Numbers of the combination, fitted.

    Log-odds of a person are a weighted sum of the log-odds of the human test, the score of the
    people detector and the log-odds of the network, plus a constant.

    Attributes:
        human: Weight of the human test within `HUMAN_LIMITS`; less counts as the lower limit.
        above: Weight of what exceeds the upper limit.
        detector: Weight of OpenCV's people detector.
        network: Weight of the network.
        offset: Constant [log-odds].
        detector_middle: By block of `DETECTOR_WINDOW`, the middle between what people and other
            things have there.
    """

    human: float
    above: float
    detector: float
    network: float
    offset: float
    detector_middle: Float

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> AppearanceModel:
        """Reads the model as `to_mapping` gives it.

        Raises:
            ConfigError: Something is missing, not finite, or does not fit the windows.
        """
        shapes = {"detector_middle": (DETECTOR_WINDOW.blocks,)}
        parts: dict[str, Any] = {}
        for name in [field.name for field in fields(cls)]:
            try:
                part = np.array(values[name], dtype=np.float64)
            except (KeyError, TypeError, ValueError) as err:
                raise ConfigError(f"body model: appearance cannot be read ({err!r})") from err
            if not np.isfinite(part).all():
                raise ConfigError("body model: appearance holds NaN or infinite values")
            if part.shape != (shape := shapes.get(name, ())):
                raise ConfigError(
                    f"body model: appearance has {name} of shape {part.shape}; wanted: {shape}"
                )
            parts[name] = part if shape else float(part)
        return cls(**parts)

    @property
    def weights(self) -> Float:
        """As `Scores.combined` takes them, shape (5,)."""
        return np.array([self.human, self.above, self.detector, self.network, self.offset])

    def to_mapping(self) -> dict[str, Any]:
        """The model as plain lists and numbers."""
        return {name: np.asarray(value).tolist() for name, value in vars(self).items()}


@dataclass(frozen=True)
class Looks(StructOfArrays):
    """Appearance of places, a struct of arrays of one length (n,).

    Attributes:
        detector: What the people detector says of each block of each of its windows, float32,
            shape (n, windows, blocks).
        inside: Blocks whose middle is in the image, likewise.
        network: Log-odds by the network, shape (n,).
    """

    detector: Float32
    inside: Bool
    network: Float


@dataclass(frozen=True)
class Scores(StructOfArrays):
    """What is combined; arrays of shape (n,).

    Attributes:
        human: Log-odds by the human test.
        detector: Score of the people detector.
        network: Log-odds by the network.
    """

    human: Float
    detector: Float
    network: Float

    @property
    def columns(self) -> Float:
        """What the weights of the combination multiply, shape (n, 4)."""
        low, high = HUMAN_LIMITS
        above = np.maximum(self.human - high, 0.0)
        return np.column_stack([np.clip(self.human, low, high), above, self.detector, self.network])

    def combined(self, weights: Float) -> Float:
        """Log-odds of a person, shape (n,); what the human test rules out keeps its own.

        Args:
            weights: Of the columns, then a constant, shape (5,).
        """
        result = self.columns @ weights[:-1] + weights[-1]
        return np.where(self.human >= RULED_OUT, result, self.human)


class Appearance:
    """Scores places in the images of one head by their appearance.

    Args:
        camera: The head.

    Raises:
        ConfigError: The network cannot be read.
    """

    def __init__(self, camera: StereoCamera) -> None:
        self._detector = GradientSampler(camera, DETECTOR_VIEW)
        self._network = PersonNetwork(camera)

    def __call__(
        self, model: AppearanceModel, left: Gray, bearing: Float, ranges: Float, human: Float
    ) -> Float:
        """Log-odds of a person, shape (n,).

        Args:
            model: Numbers of the combination.
            left: Left image, uint8, shape (height, width).
            bearing: Of the bodies' axes, from the lens [rad], shape (n,).
            ranges: Likewise, horizontal [m].
            human: Log-odds by the human test, shape (n,).
        """
        look = human >= RULED_OUT
        looks = self.looks(left, bearing[look], ranges[look])
        detector = detector_score(looks, model.detector_middle)
        result = human.copy()
        result[look] = Scores(human[look], detector, looks.network).combined(model.weights)
        return result

    def looks(self, left: Gray, bearing: Float, ranges: Float) -> Looks:
        """What the combination is made of; arguments as those of a call."""
        at = left, bearing, ranges
        return Looks(*detector_blocks(self._detector(*at)), self._network(*at))


def detector_blocks(histograms: Histograms) -> tuple[Float32, Bool]:
    """The first two of `Looks`.

    Args:
        histograms: Histograms of n windows of `DETECTOR_VIEW`.
    """
    weights = detector_weights()[:-1].reshape(-1, BLOCK)
    column = DETECTOR_WINDOW.rows // CELL - 1
    windows = [slice(k * column, k * column + len(weights)) for k in range(DETECTOR_WINDOWS)]
    scores = [np.einsum("nbk,bk->nb", histograms.values[:, k], weights) for k in windows]
    return np.stack(scores, axis=1), np.stack([histograms.inside[:, k] for k in windows], axis=1)


def block_score(detector: Float32, inside: Bool, middle: Float) -> Float:
    """Sum over the blocks in the image, over the square root of their share, shape (...).

    Args:
        detector: Scores of blocks, shape (..., blocks).
        inside: Blocks in the image, likewise.
        middle: What each block must exceed to speak for a person, shape (blocks,).
    """
    share = np.maximum(inside.mean(axis=-1), _LEAST_SHARE)
    return np.asarray(((detector - middle) * inside).sum(axis=-1) / np.sqrt(share))


def detector_score(looks: Looks, middle: Float) -> Float:
    """Score of the people detector in the best of its windows, shape (n,).

    Args:
        looks: Appearance of n places.
        middle: As of `block_score`.
    """
    return np.asarray(block_score(looks.detector, looks.inside, middle).max(axis=1))


@functools.cache
def detector_weights() -> Float32:
    """The numbers of OpenCV's people detector, shape (3781,): by block and bin, then a constant."""
    data = resources.files("mrs_people_loc.bodies").joinpath("people_detector.npy").read_bytes()
    return np.asarray(np.load(io.BytesIO(data)), dtype=np.float32)

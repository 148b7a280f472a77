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

from mrs_people_loc.arrays import Float, Float32
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
#: The human test says much less than the lower one of people behind desks and in doorways, and
#: hardly ever more than the upper one of anything but people [log-odds].
HUMAN_LIMITS = (-2.0, 4.0)
#: What has less by the human test is not looked at; its log-odds remain.
RULED_OUT = -6.0
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

    def to_mapping(self) -> dict[str, Any]:
        """The model as plain lists and numbers."""
        return {name: np.asarray(value).tolist() for name, value in vars(self).items()}


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
        at = left, bearing[look], ranges[look]
        detector = detector_score(self._detector(*at), model.detector_middle)
        low, high = HUMAN_LIMITS
        result = human.copy()
        result[look] = (
            model.human * np.clip(human[look], low, high)
            + model.above * np.maximum(human[look] - high, 0.0)
            + model.detector * detector
            + model.network * self._network(*at)
            + model.offset
        )
        return result


def block_score(histograms: Histograms, weights: Any, middle: Float) -> Float:
    """Sum over the blocks in the image, over the square root of their share, shape (n,).

    Args:
        histograms: Histograms of n windows.
        weights: Shape (blocks, `BLOCK`).
        middle: What each block must exceed to speak for a person, shape (blocks,).
    """
    blocks = np.einsum("nbk,bk->nb", histograms.values, weights.astype(np.float32)) - middle
    share = np.maximum(histograms.inside.mean(axis=1), _LEAST_SHARE)
    return np.asarray((blocks * histograms.inside).sum(axis=1) / np.sqrt(share))


def detector_score(histograms: Histograms, middle: Float) -> Float:
    """Score of the people detector in the best of its windows, shape (n,).

    Args:
        histograms: Histograms of n windows of `DETECTOR_VIEW`.
        middle: As of `block_score`.
    """
    weights = detector_weights()[:-1].reshape(-1, BLOCK)
    column = DETECTOR_WINDOW.rows // CELL - 1
    windows = [slice(first, first + len(weights)) for first in (0, column, 2 * column)]
    parts = (Histograms(histograms.values[:, k], histograms.inside[:, k]) for k in windows)
    scores = [block_score(part, weights, middle) for part in parts]
    return np.asarray(np.max(scores, axis=0))


@functools.cache
def detector_weights() -> Float32:
    """The numbers of OpenCV's people detector, shape (3781,): by block and bin, then a constant."""
    data = resources.files("mrs_people_loc.bodies").joinpath("people_detector.npy").read_bytes()
    return np.asarray(np.load(io.BytesIO(data)), dtype=np.float32)

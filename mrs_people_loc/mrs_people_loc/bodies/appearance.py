"""Appearance: how a body's image speaks for a person, beside its shape in the disparities.

A network sees where people are in the whole image (`person_map`), another one judges an upright
window at each body (`network`). A logistic model combines both with the human test.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from mrs_people_loc.arrays import Float, StructOfArrays
from mrs_people_loc.bodies.network import PersonNetwork
from mrs_people_loc.bodies.patches import Patches
from mrs_people_loc.bodies.person_map import PersonMap
from mrs_people_loc.errors import ConfigError
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import Gray

#: The human test says much less than the lower one of people behind desks and in doorways, and
#: hardly ever more than the upper one of anything but people [log-odds].
HUMAN_LIMITS = (-2.0, 4.0)
#: What the human test gives more than its upper limit has the shape of a person, and what an image
#: shows counts the less: from these log-odds on, nothing.
SURE_SHAPE = 6.0
#: What has less by the human test is nobody, whatever it looks like; its log-odds remain.
RULED_OUT = -8.0


@dataclass(frozen=True)
class AppearanceModel:
    """Numbers of the combination, fitted.

    Log-odds of a person are a weighted sum of the log-odds of the human test and of both networks,
    plus a constant. What the image's network says for a person does not count: its map is too
    coarse to tell a person from what is beside them.

    Attributes:
        human: Weight of the human test within `HUMAN_LIMITS`; less counts as the lower limit.
        above: Weight of what exceeds the upper limit.
        window: Weight of the network that sees a window.
        image: Weight of the network that sees the image.
        offset: Constant [log-odds].
    """

    human: float
    above: float
    window: float
    image: float
    offset: float

    @classmethod
    def from_mapping(cls, values: Mapping[str, Any]) -> AppearanceModel:
        """Reads the model as `to_mapping` gives it.

        Raises:
            ConfigError: Something is missing, not a number or not finite.
        """
        try:
            found = {field.name: float(values[field.name]) for field in fields(cls)}
        except (KeyError, TypeError, ValueError) as err:
            raise ConfigError(f"body model: appearance cannot be read ({err!r})") from err
        if not all(map(math.isfinite, found.values())):
            raise ConfigError("body model: appearance holds NaN or infinite values")
        return cls(**found)

    @property
    def weights(self) -> Float:
        """As `Scores.combined` takes them, shape (5,)."""
        return np.array([self.human, self.above, self.window, self.image, self.offset])

    def to_mapping(self) -> dict[str, Any]:
        """The model as plain numbers."""
        return dict(vars(self))


@dataclass(frozen=True)
class Looks(StructOfArrays):
    """Appearance of places, a struct of arrays of one length (n,).

    Attributes:
        window: Log-odds by the network that sees a window.
        image: By the network that sees the image.
    """

    window: Float
    image: Float


@dataclass(frozen=True)
class Scores(StructOfArrays):
    """What is combined, a struct of arrays of one length (n,).

    Attributes:
        human: Log-odds by the human test.
        looks: Appearance.
    """

    human: Float
    looks: Looks

    @property
    def columns(self) -> Float:
        """What the weights of the combination multiply, shape (n, 4)."""
        low, high = HUMAN_LIMITS
        above, looks = np.maximum(self.human - high, 0.0), self.looks
        human, nobody = np.clip(self.human, low, high), np.minimum(looks.image, 0.0)
        nobody *= np.clip((SURE_SHAPE - self.human) / (SURE_SHAPE - high), 0.0, 1.0)
        return np.column_stack([human, above, looks.window, nobody])

    def combined(self, weights: Float) -> Float:
        """Log-odds of a person, shape (n,); what the human test rules out keeps its own.

        Args:
            weights: Of the columns, then a constant, shape (5,).
        """
        result = self.columns @ weights[:-1] + weights[-1]
        return np.where(self.human >= RULED_OUT, result, self.human)


class Appearance:
    """Sees bodies in the images of one head.

    Args:
        camera: The head.

    Raises:
        ConfigError: A network cannot be read.
    """

    def __init__(self, camera: StereoCamera) -> None:
        self._map, self._network = PersonMap(camera), PersonNetwork(camera)

    def __call__(self, left: Gray, bearing: Float, ranges: Float, patches: Patches) -> Looks:
        """What bodies look like.

        Args:
            left: Left image, uint8, shape (height, width).
            bearing: Of the bodies' axes, from the lens [rad], shape (n,).
            ranges: Likewise, horizontal [m].
            patches: Of the bodies.
        """
        return Looks(self._network(left, bearing, ranges), self._map(left, patches))

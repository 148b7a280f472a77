"""Appearance: how a body's image speaks for a person, beside its shape in the disparities.

A network sees people in the left image (`network`). A logistic model combines its log-odds at a
body with those of the human test.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from mrs_people_loc.arrays import Float, StructOfArrays
from mrs_people_loc.errors import ConfigError

#: The human test says much less than the lower one of people behind desks and in doorways, and
#: hardly ever more than the upper one of anything but people [log-odds].
HUMAN_LIMITS = (-3.0, 4.0)
#: What the human test gives more than its upper limit has the shape of a person, and what the
#: network says against them counts the less: from these log-odds on, nothing.
SURE_SHAPE = 5.0
#: What has less by the human test is nobody, whatever it looks like; its log-odds remain.
RULED_OUT = -8.0


@dataclass(frozen=True)
class AppearanceModel:
    """Numbers of the combination, fitted.

    Log-odds of a person are a weighted sum of the log-odds of the human test and of the network,
    plus a constant.

    Attributes:
        human: Weight of the human test within `HUMAN_LIMITS`; less counts as the lower limit.
        above: Weight of what exceeds the upper limit.
        network: Weight of the network.
        offset: Constant [log-odds].
    """

    human: float
    above: float
    network: float
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
        """As `Scores.combined` takes them, shape (4,)."""
        return np.array([self.human, self.above, self.network, self.offset])

    def to_mapping(self) -> dict[str, Any]:
        """The model as plain numbers."""
        return dict(vars(self))


@dataclass(frozen=True)
class Scores(StructOfArrays):
    """What is combined, a struct of arrays of one length (n,).

    Attributes:
        human: Log-odds by the human test.
        network: By the network.
    """

    human: Float
    network: Float

    @property
    def columns(self) -> Float:
        """What the weights of the combination multiply, shape (n, 3)."""
        low, high = HUMAN_LIMITS
        human, above = np.clip(self.human, low, high), np.maximum(self.human - high, 0.0)
        doubt = np.clip((SURE_SHAPE - self.human) / (SURE_SHAPE - high), 0.0, 1.0)
        network = np.where(self.network < 0.0, doubt * self.network, self.network)
        return np.column_stack([human, above, network])

    def combined(self, weights: Float) -> Float:
        """Log-odds of a person, shape (n,); what the human test rules out keeps its own.

        Args:
            weights: Of the columns, then a constant, shape (4,).
        """
        result = self.columns @ weights[:-1] + weights[-1]
        return np.where(self.human >= RULED_OUT, result, self.human)

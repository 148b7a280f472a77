"""What the converters share: stamps, choice of frames, size of images."""

from __future__ import annotations

import cv2
import numpy as np

from mrs_people_loc.errors import ConfigError
from mrs_people_loc.sensing.camera import CameraModel
from mrs_people_loc.sensing.images import Gray

#: Stamp of a recording's first frame [ns]: an arbitrary, fixed moment.
EPOCH_NS = 1_700_000_000_000_000_000


def reduced(model: CameraModel, reduce: int) -> CameraModel:
    """The model of images that are `reduce` times smaller.

    Raises:
        ConfigError: `reduce` does not divide the size of the images.
    """
    if reduce < 1 or model.width % reduce or model.height % reduce:
        raise ConfigError(
            f"reduce is {reduce}; allowed: a divisor of {model.width} and {model.height}"
        )
    return model.scaled_to_fit(model.width // reduce, model.height // reduce)


def scaled(image: Gray, model: CameraModel) -> Gray:
    """The image scaled down by area to the size of a model."""
    size = (model.width, model.height)
    if image.shape == size[::-1]:
        return image
    return cv2.resize(image, size, interpolation=cv2.INTER_AREA).astype(np.uint8)


def parse_frames(text: str) -> slice:
    """Reads `START:STOP:STEP`, each of which may be missing, or one frame's number.

    Raises:
        ConfigError: It is none of these, a number is negative, or the step is 0.
    """
    try:
        numbers = [int(part) if part.strip() else None for part in text.split(":")]
    except ValueError:
        numbers = [-1]
    good = 1 <= len(numbers) <= 3 and all(n is None or n >= 0 for n in numbers)
    if not good or numbers == [None] or numbers[2:] == [0]:
        raise ConfigError(f"frames is {text!r}; allowed: START:STOP:STEP, such as 0:627:3")
    if len(numbers) == 1:
        assert numbers[0] is not None
        return slice(numbers[0], numbers[0] + 1)
    return slice(*numbers)

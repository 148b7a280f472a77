"""Whether a stereo head still sees: a covered lens, darkness, a camera that stands still."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Float32
from mrs_people_loc.sensing.images import Gray, StereoImages


@dataclass(frozen=True)
class SightTuning:
    """Constants of `SightWatch`, chosen by hand.

    Attributes:
        black: An image is black below this mean [grey levels of 255],
        white: white above this mean [grey levels],
        flat: and flat below this standard deviation [grey levels].
        still: An image stands still that is bit for bit the one before, so often in a row.
    """

    black: float = 10.0
    white: float = 245.0
    flat: float = 3.0
    still: int = 3


_TUNING = SightTuning()


class SightWatch:
    """Says that a head is blind, and which of its cameras it is.

    Args:
        config: When it is.
        tuning: Constants.

    Attributes:
        config: When it is.
        trouble: What is wrong, in words; empty as long as the head sees.
        values: Share of valid pixels, and mean and deviation of each image [grey levels].
    """

    def __init__(self, config: cfg.Sight, *, tuning: SightTuning = _TUNING) -> None:
        self.config = config
        self._tuning = tuning
        self.trouble = ""
        self.values: dict[str, float] = {}
        self._in_a_row = 0
        self._before: dict[str, Gray] = {}
        self._still: dict[str, int] = {}

    def step(self, images: StereoImages, disparity: Float32) -> None:
        """Takes a view.

        Args:
            images: Its images.
            disparity: [px], float32, NaN where there is none.
        """
        now = self._look(images, disparity)
        self._in_a_row = self._in_a_row + 1 if bool(now) != bool(self.trouble) else 0
        if self._in_a_row >= self.config.frames:
            self._in_a_row = 0
            self.trouble = now
        elif now and self.trouble:
            self.trouble = now

    def _look(self, images: StereoImages, disparity: Float32) -> str:
        """What is wrong with one view."""
        cameras = {"left": images.left, "right": images.right, "top": images.top}
        valid = np.count_nonzero(disparity == disparity) / disparity.size
        self.values = {"valid_pixels": valid}
        wrong = []
        for camera, image in cameras.items():
            if image is None:
                continue
            mean, deviation = (float(value[0, 0]) for value in cv2.meanStdDev(image))
            self.values |= {f"{camera}_mean": mean, f"{camera}_deviation": deviation}
            if mean < self._tuning.black:
                wrong.append(f"{camera} image is black (mean {mean:.0f} of 255)")
            elif mean > self._tuning.white:
                wrong.append(f"{camera} image is white (mean {mean:.0f} of 255)")
            elif deviation < self._tuning.flat:
                wrong.append(f"{camera} image is flat (all of it about {mean:.0f} of 255)")
            same = camera in self._before and np.array_equal(self._before[camera], image)
            self._still[camera] = self._still.get(camera, 0) + 1 if same else 0
            self._before[camera] = image
        still = [camera for camera, count in self._still.items() if count >= self._tuning.still]
        # Where all stand still it is a recording that does.
        if len(still) < len(self._still):
            wrong += [f"{camera} image stands still" for camera in still]
        if not wrong and valid < self.config.min_valid:
            wrong.append(
                f"only {valid:.0%} of the pixels have a disparity (sight.min_valid: "
                f"{self.config.min_valid:.0%}) although no image is dark or flat"
            )
        return "; ".join(wrong)

"""All errors of the project: one root, one class per kind of input that can be wrong."""

from __future__ import annotations


class PeopleLocError(Exception):
    """Root of every error that this project raises on purpose."""


class ConfigError(PeopleLocError):
    """A configuration value is unknown, of the wrong type or out of its range."""


class CameraError(PeopleLocError):
    """Camera calibration that cannot be used."""


class ImageError(PeopleLocError):
    """An image that cannot be used, or does not fit its calibration or its pair."""


class UncalibratedError(ImageError):
    """Images that are of no use while there is no calibration that fits."""


class WaitedError(ImageError):
    """Images that waited for their calibration, and do not fit it.

    Attributes:
        camera: Whose image it is.
    """

    def __init__(self, camera: str, text: str) -> None:
        super().__init__(text)
        self.camera = camera


class StampError(PeopleLocError):
    """A message whose stamp is 0: its sender sets none."""


class AheadError(PeopleLocError):
    """A message whose stamp is ahead of the clock: its sender's clock is."""


class SizeError(PeopleLocError):
    """A message that is too large to be read in time."""


class ScanError(PeopleLocError):
    """A scan (`points`) that cannot be used."""


class PoseError(PeopleLocError):
    """A pose that cannot be used, or none at the time that was asked for."""


class GridError(PeopleLocError):
    """An occupancy grid that cannot be used."""


class RangeError(PeopleLocError):
    """A range of a sonar or a laser scan that cannot be used."""


class PeopleError(PeopleLocError):
    """A message of people that cannot be used."""


class TourError(PeopleLocError):
    """A tour that cannot be guided."""


class BagError(PeopleLocError):
    """A recording that cannot be read or written."""


class OutdatedError(PeopleLocError):
    """A message of before the time jumped back."""


class FloorError(PeopleLocError):
    """There is not enough floor in view to measure a mounting."""


class KeysError(PeopleLocError):
    """Keys of a team that cannot be made, found or revoked."""

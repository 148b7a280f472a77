"""Flat walls as lines on the ground plane."""

from __future__ import annotations

from dataclasses import dataclass

from mrs_people_loc.arrays import Bool, Float, StructOfArrays


@dataclass(frozen=True)
class Walls(StructOfArrays):
    """Flat vertical walls in one frame, as lines in normal form.

    A point (x, y) is on a wall's line where x cos(bearing) + y sin(bearing) = distance. The foot of
    the perpendicular from the frame's origin is `distance` away in the direction `bearing`.

    Attributes:
        distance: From the origin to the line [m], at least 0, shape (n,).
        bearing: Direction of the perpendicular foot [rad], in (-pi, pi], shape (n,).
        covariance: Of distance and bearing [m, rad], shape (n, 2, 2).
        extent: Where the part of the line that is known begins and ends [m], measured from the foot
            in the direction bearing + pi/2, shape (n, 2), ascending.
        is_end: Whether the wall itself, and not only its view, ends there, shape (n, 2).
    """

    distance: Float
    bearing: Float
    covariance: Float
    extent: Float
    is_end: Bool

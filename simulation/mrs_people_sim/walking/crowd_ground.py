"""Where people can walk: distances to walls and furniture, and the trail of who leads them."""

from __future__ import annotations

import cv2
import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_sim.walking.walks import unit


class Clearance:
    """Distances to walls and furniture.

    Args:
        grid: Where they are; what is not free is one.
    """

    def __init__(self, grid: OccupancyGrid) -> None:
        solid = (grid.data != 0).astype(np.uint8)
        inside = cv2.distanceTransform(solid, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        outside = cv2.distanceTransform(1 - solid, cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        signed = (outside - inside - np.where(solid, -0.5, 0.5)) * grid.resolution
        slopes = np.gradient(signed.astype(np.float64), grid.resolution)
        self._field = np.stack([signed, slopes[1], slopes[0]], axis=-1)
        self._origin = np.array([grid.x, grid.y])
        self._resolution = grid.resolution

    def at(self, xy: Float) -> tuple[Float, Float]:
        """Distances, negative inside, and unit vectors away from what is nearest.

        Args:
            xy: Places [m], shape (n, 2).

        Returns:
            Shapes (n,) [m] and (n, 2).
        """
        rows, columns = self._field.shape[:2]
        at = (xy - self._origin) / self._resolution - 0.5
        at = np.clip(at, 0.0, [columns - 1.001, rows - 1.001])
        low = at.astype(int)
        (x, y), (p, q) = low.T, (at - low).T[..., None]
        field = self._field
        found = (1 - q) * ((1 - p) * field[y, x] + p * field[y, x + 1]) + q * (
            (1 - p) * field[y + 1, x] + p * field[y + 1, x + 1]
        )
        return found[:, 0], unit(found[:, 1:])


class Trail:
    """Where the leader has been.

    Args:
        xy: Where it is first [m], shape (2,).
    """

    #: Distance of its points, and how far back a leader that returns, or another one, is
    #: recognized [m].
    _GRAIN, _BACK, _TAKEN = 0.1, 4.0, 15.0
    #: It returns where it is so near to its trail [m], and by less than this share of the way along
    #: it: nobody walks to the tip of a fold and back.
    _BESIDE, _FOLD = 0.5, 0.5

    def __init__(self, xy: Float) -> None:
        self._points = np.asarray(xy, dtype=np.float64)[None]

    @property
    def length(self) -> float:
        """How far the leader has come [m]."""
        return self._GRAIN * (len(self._points) - 1)

    def take_over(self, xy: Float) -> None:
        """Another robot leads from there on: from the place of the trail that is nearest to it."""
        recent = self._points[-round(self._TAKEN / self._GRAIN) :]
        later = len(recent) - 1 - int(np.linalg.norm(recent - xy, axis=1).argmin())
        self._points = self._points[: len(self._points) - later]
        self.extend(xy)

    def extend(self, xy: Float) -> None:
        """The leader is there; where it comes back, the trail becomes shorter again."""
        away = float(np.linalg.norm(xy - self._points[-1]))
        if away < self._GRAIN:
            return
        recent = self._points[-round(self._BACK / self._GRAIN) :]
        back = np.linalg.norm(recent - xy, axis=1)
        later = np.arange(len(recent) - 1, -1, -1)
        back[back > np.minimum(self._FOLD * (self._GRAIN * later + away), self._BESIDE)] = np.inf
        nearest = len(recent) - 1 - int(back[::-1].argmin())
        if np.isfinite(back[nearest]):
            self._points = self._points[: len(self._points) - later[nearest]]
            away = float(back[nearest])
        count = int(away / self._GRAIN)
        ahead = (xy - self._points[-1]) / max(away, self._GRAIN)
        more = self._points[-1] + self._GRAIN * np.arange(1, count + 1)[:, None] * ahead
        self._points = np.concatenate([self._points, more])

    def at(self, way: Float) -> tuple[Float, Float]:
        """Places at lengths of the trail [m], and its directions there, each (n, 2)."""
        last = len(self._points) - 1
        row = np.clip(way / self._GRAIN, 0.0, last)
        low = np.minimum(row.astype(int), max(last - 1, 0))
        part, high = (row - low)[:, None], np.minimum(low + 1, last)
        places = self._points[low] * (1 - part) + self._points[high] * part
        behind = self._points[np.maximum(low - 4, 0)]
        return places, unit(self._points[np.minimum(high + 4, last)] - behind)

    def nearest(self, xy: Float, around: Float, reach: float = 1.5) -> Float:
        """Lengths of the trail nearest to places [m], shape (n,).

        Args:
            xy: Places [m], shape (n, 2).
            around: Looked for only near these lengths [m], shape (n,),
            reach: ... no farther than this [m].
        """
        steps = np.arange(-round(reach / self._GRAIN), round(reach / self._GRAIN) + 1)
        rows = np.rint(around / self._GRAIN).astype(int)[:, None] + steps
        rows = np.clip(rows, 0, len(self._points) - 1)
        away = ((self._points[rows] - xy[:, None]) ** 2).sum(axis=2)
        found: Float = self._GRAIN * rows[np.arange(len(rows)), away.argmin(axis=1)]
        return found

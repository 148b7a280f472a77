"""People who are meshes of the user's assets."""

from __future__ import annotations

import dataclasses
import math

import numpy as np

from mrs_tools.simulation.models.meshes import Mesh
from mrs_tools.simulation.motion import Place

#: Height of the hips over stature, and over how much of it legs bend there.
_HIP, _BEND = 0.49, 0.06
#: Legs cross where more than this share of the surface below the knees reaches closer to the middle
#: than `_APART` of stature.
_CROSSED, _APART = 0.1, 0.015


class MeshBody:
    """One person, drawn as a mesh.

    The person's place is the mean of the middles of head and trunk. A person who walks swings their
    legs from the hips, unless the legs cross in the mesh; arms stay as they are.

    Args:
        mesh: As `Shape` has it, its textures in the atlas.
        height: How tall the person is; 0: as the mesh [m].
    """

    def __init__(self, mesh: Mesh, height: float = 0.0) -> None:
        own = float(mesh.vertices[:, 2].max())
        self.height = height or own
        self._mesh = dataclasses.replace(
            mesh, vertices=mesh.vertices * np.float32(self.height / own)
        )
        self._swings = not _legs_cross(self._mesh)

    def mesh(self, place: Place, time: float, *, talking: bool = False) -> Mesh:
        """The body at a place, in the map; see `HumanBody.mesh`."""
        speed = abs(place.speed)
        pace = min(1.0, speed / 0.5)
        walks = self._swings and pace > 0.02
        body = self._walking(place.way, speed, pace) if walks else self._mesh
        return body.placed(place.x, place.y, place.yaw)

    def stride(self, speed: float) -> float:
        """Way from one step of a foot to its next [m], at a speed [m/s]; see `HumanBody.stride`."""
        return (0.55 + 0.48 * min(abs(speed), 2.0)) * self.height / 1.7

    def _walking(self, way: float, speed: float, pace: float) -> Mesh:
        """The mesh with one leg ahead and one behind, its lowest point on the floor.

        The stride is that of `HumanBody`; half of it is between the feet when both are down.
        """
        h = self.height
        stride = self.stride(speed)
        swing = pace * math.asin(min(0.9, 0.25 * stride / (_HIP * h)))
        swing *= math.sin(2 * math.pi * way / stride)
        x, y, z = self._mesh.vertices.T
        below = np.clip((_HIP * h - z) / (_BEND * h), 0.0, 1.0)
        side = np.clip(y / (_APART * h), -1.0, 1.0)
        angle = (swing * side * below).astype(np.float32)
        hip = np.float32(_HIP * h)
        c, s = np.cos(angle), np.sin(angle)

        def turned(ahead: np.ndarray, up: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            return c * ahead - s * up, c * up + s * ahead

        ahead, up = turned(x, z - hip)
        up += hip
        nx, ny, nz = self._mesh.normals.T
        nx, nz = turned(nx, nz)
        return dataclasses.replace(
            self._mesh,
            vertices=np.stack([ahead, y, up - up.min()], axis=1),
            normals=np.stack([nx, ny, nz], axis=1),
        )


def _legs_cross(mesh: Mesh) -> bool:
    corners = mesh.vertices[mesh.triangles]
    height = mesh.vertices[:, 2].max()
    a, b, c = corners.transpose(1, 0, 2)
    areas = np.linalg.norm(np.cross(b - a, c - a), axis=1) * (corners[..., 2].max(1) < 0.5 * height)
    left, right = corners[..., 1].min(axis=1), corners[..., 1].max(axis=1)
    near = (left < _APART * height) & (right > -_APART * height)
    return bool(areas @ near > _CROSSED * areas.sum())

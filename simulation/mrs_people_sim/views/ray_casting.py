"""Ray casting with Embree, and shading of what the rays hit."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Float32
from mrs_people_sim.models.meshes import Int32, Mesh
from mrs_people_sim.models.textures import Atlas

#: Owner of a ray that hits nothing.
NOTHING = -9


@dataclass(frozen=True)
class Light:
    """Light of a room: lamps and what comes from everywhere.

    Attributes:
        lamps: Positions [m], shape (k, 3).
        power: Light of each at 1 m, shape (k,).
        ambient: Light from everywhere.
    """

    lamps: NDArray
    power: NDArray
    ambient: float


@dataclass(frozen=True)
class Surface:
    """What rays hit.

    Attributes:
        normal: Normals of any length, float32, shape (n, 3).
        uv: Texture coordinates [m], float32, shape (n, 2).
        material: Indices of materials, int32, shape (n,).
    """

    normal: Float32
    uv: Float32
    material: Int32


class Solid:
    """A mesh, ready to be hit by rays.

    Args:
        mesh: Its triangles.
    """

    def __init__(self, mesh: Mesh) -> None:
        from embreex.mesh_construction import TriangleMesh
        from embreex.rtcore_scene import EmbreeScene

        self.mesh = mesh
        self._scene = EmbreeScene()
        self._keep = TriangleMesh(self._scene, mesh.vertices, mesh.triangles)

    def cast(self, origins: Float32, directions: Float32) -> tuple[Int32, Float32, dict]:
        """Finds what rays hit first.

        Args:
            origins: Where from [m], shape (n, 3).
            directions: Where to; their length is the unit of distance, shape (n, 3).

        Returns:
            Triangle hit, -1 for none, shape (n,); distance in lengths of the direction, shape
            (n,); and barycentric coordinates u, v.
        """
        hits = self._scene.run(
            np.ascontiguousarray(origins), np.ascontiguousarray(directions), output=1
        )
        return hits["primID"], hits["tfar"], hits

    def surface(self, triangle: Int32, u: Float32, v: Float32) -> Surface:
        """The surface at barycentric coordinates of triangles, each of shape (n,)."""
        mesh = self.mesh
        first, second, third = mesh.triangles[triangle].T
        rest = (np.float32(1.0) - u - v)[:, None]
        u, v = u[:, None], v[:, None]
        normal = rest * mesh.normals[first] + u * mesh.normals[second] + v * mesh.normals[third]
        uv = rest * mesh.uv[first] + u * mesh.uv[second] + v * mesh.uv[third]
        return Surface(normal, uv, mesh.material[triangle])


class Caster:
    """All that is there, ready to be looked at.

    Args:
        mesh: All there is.
        atlas: Its textures.
        light: What lights it.
    """

    def __init__(self, mesh: Mesh, atlas: Atlas, light: Light) -> None:
        self._solid, self._atlas, self._light = Solid(mesh), atlas, light

    def look(
        self, origin: NDArray, directions: Float32, pixel_angle: float
    ) -> tuple[Float32, Int32, Float32]:
        """Light, owner and depth that rays from one point see.

        Args:
            origin: The lens [m], shape (3,).
            directions: Directions whose length is 1 along the optical axis, shape (n, 3).
            pixel_angle: Width that a ray stands for, at depth 1.

        Returns:
            Light, float32; owner of what is seen, int32; depth along the optical axis [m],
            float32; each of shape (n,).
        """
        # Around the lens the coordinates are small, and so are float32's errors.
        origins = np.broadcast_to(np.asarray(origin, dtype=np.float32), directions.shape)
        triangle, depth, hits = self._solid.cast(origins, directions)
        seen = triangle >= 0
        light = np.zeros(len(directions), dtype=np.float32)
        owner = np.full(len(directions), NOTHING, dtype=np.int32)
        owner[seen] = self._solid.mesh.owner[triangle[seen]]
        surface = self._solid.surface(triangle[seen], hits["u"][seen], hits["v"][seen])
        light[seen] = shade(
            surface, self._atlas, self._light, origins[seen], directions[seen], depth[seen],
            pixel_angle,
        )  # fmt: skip
        return light, owner, np.where(seen, depth, np.inf).astype(np.float32)


def shade(
    surface: Surface,
    atlas: Atlas,
    light: Light,
    origins: Float32,
    directions: Float32,
    depth: Float32,
    pixel_angle: float,
) -> Float32:
    """Light that rays see of the surfaces that they hit, shape (n,).

    Args:
        surface: What they hit.
        atlas: Its textures.
        light: What lights it.
        origins: Where the rays come from [m], shape (n, 3) or (3,).
        directions: Where to; length 1 along the optical axis, shape (n, 3).
        depth: Depth of what they hit [m], shape (n,).
        pixel_angle: Width that a ray stands for, at depth 1.
    """
    normal = surface.normal
    normal /= np.maximum(np.sqrt(_dot(normal, normal)), np.float32(1e-6))[:, None]
    length = np.sqrt(_dot(directions, directions))
    cosine = -_dot(normal, directions) / length
    # Surfaces have two sides; the one that is looked at is lit.
    normal *= np.copysign(np.float32(1.0), cosine)[:, None]
    slant = np.sqrt(np.maximum(np.abs(cosine), np.float32(0.1)))
    footprint = (depth * length * np.float32(pixel_angle) / slant).astype(np.float32)
    albedo = atlas.sample(surface.material, surface.uv, footprint)
    place = origins + depth[:, None] * directions
    # More comes from above than from below.
    irradiance = np.float32(light.ambient) * (np.float32(0.8) + np.float32(0.2) * normal[:, 2])
    for lamp, power in zip(light.lamps, light.power, strict=True):
        to_lamp = lamp.astype(np.float32) - place
        square = _dot(to_lamp, to_lamp)
        facing = np.maximum(_dot(to_lamp, normal), np.float32(0.0))
        irradiance += np.float32(power) * facing / (np.sqrt(square) * (1 + square))
    return albedo * irradiance


def _dot(a: Float32, b: Float32) -> Float32:
    """Scalar products of the rows of two arrays, shape (n,)."""
    return a[:, 0] * b[:, 0] + a[:, 1] * b[:, 1] + a[:, 2] * b[:, 2]

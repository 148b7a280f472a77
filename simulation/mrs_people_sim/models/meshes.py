"""Triangle meshes with texture coordinates, and the few solids everything is built from."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mrs_people_loc.arrays import Float32

Int32 = NDArray[np.int32]


@dataclass(frozen=True)
class Mesh:
    """Triangles of one material, or of several.

    Attributes:
        vertices: Positions [m], float32, shape (n, 3).
        normals: Unit normals for shading, outward, float32, shape (n, 3).
        uv: Texture coordinates [m on the surface], float32, shape (n, 2).
        triangles: Indices of vertices, int32, shape (m, 3).
        material: Index of a material per triangle, int32, shape (m,).
        owner: Who a triangle belongs to, int32, shape (m,); see `world.py`.
    """

    vertices: Float32
    normals: Float32
    uv: Float32
    triangles: Int32
    material: Int32
    owner: Int32

    def placed(self, x: float, y: float, yaw: float, z: float = 0.0) -> Mesh:
        """The mesh turned about z, then moved [m, rad]."""
        c, s = np.cos(yaw), np.sin(yaw)
        turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]], dtype=np.float32)
        move = np.array([x, y, z], dtype=np.float32)
        return Mesh(
            self.vertices @ turn.T + move,
            self.normals @ turn.T,
            self.uv,
            self.triangles,
            self.material,
            self.owner,
        )

    def owned_by(self, owner: int) -> Mesh:
        """The same mesh, all of it belonging to `owner`."""
        marks = np.full(len(self.triangles), owner, dtype=np.int32)
        return Mesh(self.vertices, self.normals, self.uv, self.triangles, self.material, marks)


def make(
    vertices: ArrayLike,
    normals: ArrayLike,
    uv: ArrayLike,
    triangles: ArrayLike,
    material: int,
    owner: int = -1,
) -> Mesh:
    """A mesh of one material, in the types that `Mesh` wants."""
    corners = np.asarray(triangles, dtype=np.int32)
    return Mesh(
        np.asarray(vertices, dtype=np.float32),
        np.asarray(normals, dtype=np.float32),
        np.asarray(uv, dtype=np.float32),
        corners,
        np.full(len(corners), material, dtype=np.int32),
        np.full(len(corners), owner, dtype=np.int32),
    )


def merge(meshes: Iterable[Mesh]) -> Mesh:
    """All triangles of several meshes as one."""
    parts = list(meshes)
    if not parts:
        none = np.empty((0, 3), dtype=np.float32)
        return Mesh(
            none,
            none,
            none[:, :2],
            none.astype(np.int32),
            np.empty(0, np.int32),
            np.empty(0, np.int32),
        )
    offsets = np.cumsum([0] + [len(p.vertices) for p in parts[:-1]])
    return Mesh(
        np.concatenate([p.vertices for p in parts]),
        np.concatenate([p.normals for p in parts]),
        np.concatenate([p.uv for p in parts]),
        np.concatenate([p.triangles + np.int32(o) for p, o in zip(parts, offsets, strict=True)]),
        np.concatenate([p.material for p in parts]),
        np.concatenate([p.owner for p in parts]),
    )


def quad(
    corner: NDArray,
    along: NDArray,
    up: NDArray,
    material: int,
    *,
    uv_origin: tuple[float, float] = (0.0, 0.0),
) -> Mesh:
    """A rectangle from one corner along two edges; it faces to `along` x `up`.

    Texture coordinates are metres from the corner: u along, v upwards.
    """
    corner, along, up = (np.asarray(a, dtype=np.float64) for a in (corner, along, up))
    width, height = np.linalg.norm(along), np.linalg.norm(up)
    normal = np.cross(along, up) / (width * height)
    vertices = [corner, corner + along, corner + along + up, corner + up]
    u, v = uv_origin
    uv = np.array([u, v]) + np.array([(0, 0), (width, 0), (width, height), (0, height)])
    return make(vertices, [normal] * 4, uv, [(0, 1, 2), (0, 2, 3)], material)


def box(
    centre: tuple[float, float, float],
    size: Sequence[float],
    material: int,
    *,
    yaw: float = 0.0,
) -> Mesh:
    """A block, by its centre and edge lengths along x, y, z [m]."""
    c = np.asarray(centre, dtype=np.float64)
    dx, dy, dz = np.diag(size)
    low = -0.5 * (dx + dy + dz)
    faces = [
        quad(low, dx, dz, material),  # -y
        quad(low + dx + dy, -dx, dz, material),  # +y
        quad(low + dy, -dy, dz, material),  # -x
        quad(low + dx, dy, dz, material),  # +x
        quad(low + dz, dx, dy, material),  # top
        quad(low + dy, dx, -dy, material),  # bottom
    ]
    return merge(faces).placed(c[0], c[1], yaw, c[2])


def loft(
    centres: NDArray,
    side: NDArray,
    front: NDArray,
    side_radius: NDArray,
    front_radius: NDArray,
    material: int,
    *,
    segments: int = 14,
    power: float = 2.0,
    bumps: NDArray | None = None,
    round_ends: tuple[float, float] = (0.0, 0.0),
) -> Mesh:
    """A closed surface through rings of superellipses, such as a limb or a torso.

    Texture coordinates: u runs around the ring from its back (negative `front`), left-handed about
    the direction of growing ring index when seen from its end; v along the line of centres.

    Args:
        centres: Ring centres [m], shape (m, 3).
        side: Unit vectors of the rings' first axis, shape (m, 3) or (3,).
        front: Unit vectors of the rings' second axis, shape (m, 3) or (3,).
        side_radius: Half widths along `side` [m], shape (m,).
        front_radius: Half widths along `front` [m], shape (m,).
        material: Material index.
        segments: Corners of a ring.
        power: 2 for ellipses, more for boxier rings.
        bumps: Relative change of the radii, shape (m, segments).
        round_ends: How far the first and the last end bulge out [m].
    """
    centres = np.asarray(centres, dtype=np.float64)
    m = len(centres)
    side = np.broadcast_to(side, (m, 3))
    front = np.broadcast_to(front, (m, 3))
    bumps = np.zeros((m, segments)) if bumps is None else bumps
    # Further rings close both ends.
    tangent = _unit(_slope(centres))
    first = centres[0] - tangent[0] * round_ends[0] * _BULGE
    last = centres[-1] + tangent[-1] * round_ends[1] * _BULGE[::-1]
    rows = np.concatenate([[0, 0], np.arange(m), [m - 1, m - 1]])
    scale = np.concatenate([_SHRINK, np.ones(m), _SHRINK[::-1]])[:, None]
    centres = np.concatenate([first, centres, last])
    side, front, bumps = side[rows], front[rows], bumps[rows]
    a = side_radius[rows][:, None] * scale
    b = front_radius[rows][:, None] * scale
    angle, cos, sin = _ring(segments, power)
    swell = 1.0 + np.concatenate([bumps, bumps[:, :1]], axis=1)
    points = (
        centres[:, None]
        + (b * swell * cos)[..., None] * front[:, None]
        + (a * swell * sin)[..., None] * side[:, None]
    )
    normals = _grid_normals(points, centres)
    normals[0], normals[-1] = -tangent[0], tangent[-1]
    steps = centres[1:] - centres[:-1]
    length = np.concatenate([[0.0], np.cumsum(np.sqrt(np.einsum("ij,ij->i", steps, steps)))])
    radius = float(np.mean(side_radius) + np.mean(front_radius)) / 2.0
    u = np.broadcast_to(angle * radius, points.shape[:2])
    v = np.broadcast_to(length[:, None], points.shape[:2])
    rings, corners = points.shape[:2]
    return make(
        points.reshape(-1, 3),
        normals.reshape(-1, 3),
        np.stack([u.ravel(), v.ravel()], axis=1),
        _grid_triangles(rings, corners),
        material,
    )


def _grid_normals(points: NDArray, centres: NDArray) -> NDArray:
    """Normals of a grid of rings that point outward, shape (rings, corners, 3).

    The first and the last corner of a ring are one: the seam, between its neighbours.

    Args:
        points: Corners, shape (rings, corners, 3).
        centres: Of the rings, shape (rings, 3).
    """
    around = np.empty_like(points)
    around[:, 1:-1] = points[:, 2:] - points[:, :-2]
    around[:, 0] = around[:, -1] = points[:, 1] - points[:, -2]
    normals = _unit(_cross(around, _slope(points)))
    outward = np.einsum("ijk,ijk->ij", normals, points - centres[:, None])
    normals *= np.copysign(1.0, outward)[..., None]
    return normals


#: Radii of the rings that close an end, and how far out they are; over those of the end.
_SHRINK = np.array([0.05, 0.75])
_BULGE = np.sqrt(1.0 - _SHRINK**2)[:, None]


@lru_cache(maxsize=64)
def _ring(segments: int, power: float) -> tuple[NDArray, NDArray, NDArray]:
    """Angles of a ring's corners from its front, and the ring's superellipse."""
    angle = np.linspace(-np.pi, np.pi, segments + 1)
    cos, sin = np.cos(angle), np.sin(angle)
    if power != 2.0:
        cos = np.sign(cos) * np.abs(cos) ** (2.0 / power)
        sin = np.sign(sin) * np.abs(sin) ** (2.0 / power)
    return angle, cos, sin


@lru_cache(maxsize=256)
def _grid_triangles(rings: int, corners: int) -> Int32:
    i, j = np.meshgrid(np.arange(rings - 1), np.arange(corners - 1), indexing="ij")
    p = (i * corners + j).ravel()
    triangles = np.concatenate(
        [
            np.stack([p, p + 1, p + corners + 1], axis=1),
            np.stack([p, p + corners + 1, p + corners], axis=1),
        ]
    )
    return triangles.astype(np.int32)


def _slope(values: NDArray) -> NDArray:
    """Differences of neighbours along the first axis, one-sided at its ends."""
    slope = np.empty_like(values)
    slope[1:-1] = values[2:] - values[:-2]
    slope[0], slope[-1] = values[1] - values[0], values[-1] - values[-2]
    return slope


def _unit(vectors: NDArray) -> NDArray:
    norm = np.sqrt(np.einsum("...k,...k->...", vectors, vectors))
    return vectors / np.maximum(norm, 1e-9)[..., None]


def _cross(a: NDArray, b: NDArray) -> NDArray:
    """np.cross without its overhead."""
    out = np.empty_like(a)
    out[..., 0] = a[..., 1] * b[..., 2] - a[..., 2] * b[..., 1]
    out[..., 1] = a[..., 2] * b[..., 0] - a[..., 0] * b[..., 2]
    out[..., 2] = a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0]
    return out


def cylinder(
    base: tuple[float, float, float],
    height: float,
    radius: float,
    material: int,
    *,
    top_radius: float | None = None,
    segments: int = 20,
) -> Mesh:
    """An upright cylinder or cone from its base's centre [m]."""
    z = np.array([0.0, 0.5, 1.0]) * height
    centres = np.asarray(base, dtype=np.float64) + np.stack([0 * z, 0 * z, z], axis=1)
    radii = np.interp(z, [0.0, height], [radius, radius if top_radius is None else top_radius])
    side, front = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
    return loft(centres, side, front, radii, radii, material, segments=segments)


def ellipsoid(
    centre: NDArray, axes: NDArray, radii: tuple[float, float, float], material: int
) -> Mesh:
    """An ellipsoid.

    Args:
        centre: Its centre [m], shape (3,).
        axes: Unit vectors of its axes as rows: front, side, long, shape (3, 3).
        radii: Half lengths along them [m].
        material: Material index.
    """
    s = np.cos(np.linspace(np.pi * 0.93, np.pi * 0.07, 7))
    width = np.sqrt(1.0 - s**2)
    centres = np.asarray(centre) + s[:, None] * radii[2] * axes[2]
    return loft(
        centres,
        axes[1],
        axes[0],
        radii[1] * width,
        radii[0] * width,
        material,
        segments=12,
        round_ends=(radii[2] * 0.02, radii[2] * 0.02),
    )


def curve(points: NDArray, count: int) -> NDArray:
    """Points along a smooth curve through `points` (Catmull-Rom), evenly in parameter.

    Args:
        points: Shape (k, 3), k >= 2.
        count: How many points are wanted.

    Returns:
        Shape (count, 3); the first and the last are the curve's ends.
    """
    p = np.asarray(points, dtype=np.float64)
    p = np.concatenate([[2 * p[0] - p[1]], p, [2 * p[-1] - p[-2]]])
    t = np.linspace(0.0, len(p) - 3, count)
    i = np.minimum(t.astype(int), len(p) - 4)
    t = (t - i)[:, None]
    a, b, c, d = p[i], p[i + 1], p[i + 2], p[i + 3]
    return b + 0.5 * t * (c - a + t * (2 * a - 5 * b + 4 * c - d + t * (3 * (b - c) + d - a)))


def tube(
    points: NDArray,
    radii: NDArray,
    front: NDArray,
    material: int,
    *,
    rings: int = 12,
    segments: int = 12,
    bumps: NDArray | None = None,
    round_ends: tuple[float, float] = (0.02, 0.02),
) -> Mesh:
    """A limb along a smooth curve.

    Args:
        points: The curve's points [m], shape (k, 3).
        radii: Radius at evenly spaced places of the curve [m], shape (j,).
        front: Roughly where the limb's front looks, shape (3,).
        material: Material index.
        rings: Number of rings.
        segments: Corners of a ring.
        bumps: Relative change of the radii, shape (rings, segments).
        round_ends: How far the ends bulge out [m].
    """
    centres = curve(points, rings)
    radius = np.interp(np.linspace(0, 1, rings), np.linspace(0, 1, len(radii)), radii)
    tangent = _unit(_slope(centres))
    ahead = _unit(front - tangent * (tangent @ front)[:, None])
    side = _cross(tangent, ahead)
    return loft(
        centres,
        side,
        ahead,
        radius,
        radius,
        material,
        segments=segments,
        bumps=bumps,
        round_ends=round_ends,
    )

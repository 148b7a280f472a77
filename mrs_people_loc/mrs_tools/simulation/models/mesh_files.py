"""Reads textured meshes: COLLADA through pycollada, glTF, OBJ, PLY and STL through trimesh."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlparse

import cv2
import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Float32
from mrs_people_loc.errors import ConfigError
from mrs_tools.simulation.models.meshes import Int32

#: Files that can be read, by the axis that is up in them unless they say otherwise.
UP = {".dae": "z", ".glb": "y", ".gltf": "y", ".obj": "y", ".ply": "z", ".stl": "z"}

_LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)
#: Where a triangle's opacity is sampled, barycentric.
_INSIDE = np.array([[1, 1, 1], [4, 1, 1], [1, 4, 1], [1, 1, 4]]) / [[3], [6], [6], [6]]
#: sRGB colour of parts that have none, in a file that has colours.
_BARE = np.array([0.73, 0.73, 0.73])
#: Longest side of an image that is kept [px].
_LONGEST_PX = 1024
#: Triangles that are more transparent than this are left out: gaps between strands of hair.
_LEAST_OPACITY = 0.4


@dataclass(frozen=True)
class Part:
    """Triangles of one material.

    Attributes:
        vertices: Positions [m], z up, shape (n, 3).
        normals: Unit normals, shape (n, 3).
        triangles: Indices of vertices, shape (m, 3).
        uv: Texture coordinates, 0..1 over the image, v upwards, shape (n, 2).
        image: Reflectance, float32, shape (h, w), its first row at v = 1; or None.
        shade: Reflectance of the vertices without an image, shape (n,).
    """

    vertices: Float32
    normals: Float32
    triangles: Int32
    uv: Float32
    image: Float32 | None
    shade: Float32


def read_parts(path: Path, up: str = "") -> list[Part]:
    """The parts of a mesh file, in metres, z up.

    Args:
        path: The file.
        up: The axis that is up in it, y or z; empty: as the file states, or by its format.

    Raises:
        ConfigError: It cannot be read, or has neither textures nor colours.
        ImportError: trimesh or pycollada is not installed.
    """
    if path.suffix.lower() not in UP:
        raise ConfigError(f"{path}: is no mesh that can be read; allowed: {', '.join(UP)}")
    import collada  # noqa: F401
    import trimesh  # noqa: F401

    read = _collada if path.suffix.lower() == ".dae" else _other
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # of both libraries, about their own code and the file
            parts, stated = read(path)
    except ConfigError:
        raise
    except Exception as err:  # both libraries raise whatever their parsers do
        raise ConfigError(f"{path}: cannot be read as a mesh ({err!r})") from err
    parts = [part for part in parts if len(part.triangles)]
    if not parts:
        raise ConfigError(f"{path}: has no triangles")
    if not all(np.isfinite(part.vertices).all() and np.isfinite(part.uv).all() for part in parts):
        raise ConfigError(f"{path}: has coordinates that are not finite")
    if (up or stated or UP[path.suffix.lower()]) == "y":
        return [_turned_up(part) for part in parts]
    return parts


def _turned_up(part: Part) -> Part:
    vertices, normals = (np.stack([a[:, 0], -a[:, 2], a[:, 1]], axis=1)
                         for a in (part.vertices, part.normals))  # fmt: skip
    return Part(vertices, normals, part.triangles, part.uv, part.image, part.shade)


# ----------------------------------------------------------------------------- COLLADA ----


def _collada(path: Path) -> tuple[list[Part], str]:
    import collada

    document = collada.Collada(str(path), ignore=[collada.common.DaeError])
    unit = float(document.assetInfo.unitmeter or 1.0)
    axis = {collada.asset.UP_AXIS.Y_UP: "y", collada.asset.UP_AXIS.Z_UP: "z"}
    images: dict[str, Picture] = {}
    coloured, parts = False, []
    for primitive, material in _primitives(document):
        index = [primitive.vertex_index]
        if primitive.normal is not None:
            index.append(primitive.normal_index)
        if primitive.texcoordset:
            index.append(primitive.texcoord_indexset[0])
        corners = np.stack([i.ravel() for i in index], axis=1)
        rows, triangles = np.unique(corners, axis=0, return_inverse=True)
        vertices = primitive.vertex[rows[:, 0]] * unit
        triangles = triangles.reshape(-1, 3)
        normals = primitive.normal[rows[:, 1]] if primitive.normal is not None else None
        uv = primitive.texcoordset[0][rows[:, -1]] if primitive.texcoordset else None
        coloured |= material is not None
        diffuse = getattr(getattr(material, "effect", None), "diffuse", None)
        image, colour = None, _BARE
        if isinstance(diffuse, collada.material.Map):
            name = diffuse.sampler.surface.image.path
            if name not in images:
                images[name] = _picture(_read_image(_texture_file(path, name)))
            image = images[name]
        elif diffuse is not None:
            colour = diffuse[:3]
        shade = np.full(len(vertices), _shade(colour))
        parts.append(_part(vertices, normals, triangles, uv, image, shade))
    if parts and not coloured:
        raise ConfigError(f"{path}: has neither textures nor colours")
    return parts, axis.get(document.assetInfo.upaxis, "")


def _primitives(document: Any) -> Iterator[tuple[Any, Any]]:
    """Sets of triangles in the scene, and the material of each (None: it has none)."""
    import collada

    for kind in ("geometry", "controller"):
        for bound in document.scene.objects(kind):
            targets = {node.target.id: node.target for node in bound.materialnodebysymbol.values()}
            for primitive in bound.primitives():
                material = primitive.material
                # Some exporters name the material of the instance only.
                if material is None and len(targets) == 1:
                    material = next(iter(targets.values()))
                if hasattr(primitive, "triangleset"):
                    primitive = primitive.triangleset()
                if isinstance(primitive, collada.triangleset.BoundTriangleSet) and len(primitive):
                    yield primitive, material


def _texture_file(mesh: Path, name: str) -> Path:
    """A texture that a mesh names, relative to the mesh.

    Raises:
        ConfigError: There is none.
    """
    path = mesh.parent / unquote(urlparse(name).path).replace("\\", "/")
    if not path.is_file():
        raise ConfigError(f"{mesh}: its texture {name} is missing")
    return path


def _read_image(path: Path) -> NDArray:
    image = cv2.imread(str(path), cv2.IMREAD_UNCHANGED)
    if image is None:
        raise ConfigError(f"{path}: cannot be read as an image")
    if image.dtype != np.uint8:
        image = (image / 257).astype(np.uint8)
    if image.ndim == 2:
        return np.repeat(image[..., None], 3, axis=2)
    return image[..., [2, 1, 0, 3][: image.shape[2]]]


# ----------------------------------------------------------------------- other formats ----


def _other(path: Path) -> tuple[list[Part], str]:
    import trimesh

    missing = []

    class Resolver(trimesh.resolvers.FilePathResolver):
        def get(self, name: str) -> bytes:
            try:
                data: bytes = super().get(name)
            except Exception:
                missing.append(name)  # the library goes on without
                raise
            return data

    scene = trimesh.load_scene(path, process=False, resolver=Resolver(str(path)))
    if missing:
        raise ConfigError(f"{path}: its file {missing[0]} is missing")
    meshes: list[Any] = [mesh for mesh in scene.dump() if isinstance(mesh, trimesh.Trimesh)]
    if meshes and not any(mesh.visual.defined for mesh in meshes):
        raise ConfigError(f"{path}: has neither textures nor colours")
    return [_trimesh_part(mesh) for mesh in meshes], ""


def _trimesh_part(mesh: Any) -> Part:
    visual = mesh.visual
    uv, image, colours = None, None, _BARE
    if visual.defined and visual.kind == "texture":
        material, uv = visual.material, visual.uv
        picture = getattr(material, "baseColorTexture", None) or getattr(material, "image", None)
        if picture is not None and uv is not None:
            image = _picture(np.asarray(picture.convert("RGBA")))
        colours = material.main_color[:3] / 255
    elif visual.defined:
        colours = visual.vertex_colors[:, :3] / 255
    shade = np.broadcast_to(_shade(colours), len(mesh.vertices))
    return _part(mesh.vertices, mesh.vertex_normals, mesh.faces, uv, image, shade)


# ------------------------------------------------------------------------------- parts ----


#: An image's reflectance and, where it has one, its opacity 0..255, each of shape (h, w).
Picture = tuple[Float32, NDArray | None]


def _picture(image: NDArray) -> Picture:
    """Reflectance and opacity of an image: uint8 RGB or RGBA, shape (h, w, 3 or 4)."""
    shrink = max(image.shape[:2]) / _LONGEST_PX
    if shrink > 1.0:
        h, w = (max(1, round(side / shrink)) for side in image.shape[:2])
        image = cv2.resize(image, (w, h), interpolation=cv2.INTER_AREA)
    return _LINEAR[image[..., :3]] @ _LUMINANCE, image[..., 3] if image.shape[2] == 4 else None


def _part(
    vertices: NDArray,
    normals: NDArray | None,
    triangles: NDArray,
    uv: NDArray | None,
    picture: Picture | None,
    shade: NDArray,
) -> Part:
    """A part without its transparent triangles; see `Part`.

    Args:
        vertices: Shape (n, 3).
        normals: Shape (n, 3); None: those of the triangles.
        triangles: Shape (m, 3).
        uv: Shape (n, 2), or None.
        picture: Its image, or None.
        shade: Shape (n,).
    """
    if uv is None:
        uv, picture = np.zeros((len(vertices), 2)), None
    grey, alpha = picture or (None, None)
    if alpha is not None:
        triangles = triangles[_opacity(alpha, uv, triangles) >= _LEAST_OPACITY]
    if normals is None:
        normals = _normals(vertices, triangles)
    used, triangles = np.unique(triangles, return_inverse=True)
    normals = normals[used] / np.maximum(np.linalg.norm(normals[used], axis=1), 1e-9)[:, None]
    return Part(
        np.asarray(vertices[used], dtype=np.float32),
        normals.astype(np.float32),
        triangles.reshape(-1, 3).astype(np.int32),
        np.asarray(uv[used], dtype=np.float32),
        grey,
        np.asarray(shade[used], dtype=np.float32),
    )


def _opacity(alpha: NDArray, uv: NDArray, triangles: NDArray) -> NDArray:
    """Mean opacity of triangles, 0..1, shape (m,)."""
    at = np.einsum("sk,mkc->msc", _INSIDE, uv[triangles])
    h, w = alpha.shape
    column = np.floor(at[..., 0] % 1.0 * w).astype(int) % w
    row = np.floor((1.0 - at[..., 1] % 1.0) * h).astype(int) % h
    opacity: NDArray = alpha[row, column].mean(axis=1) / 255
    return opacity


def _normals(vertices: NDArray, triangles: NDArray) -> NDArray:
    """Normals of vertices: the mean of their triangles', weighted by area."""
    a, b, c = (vertices[triangles[:, k]] for k in range(3))
    own = np.cross(b - a, c - a)
    normals = np.zeros_like(vertices, dtype=np.float64)
    for k in range(3):
        np.add.at(normals, triangles[:, k], own)
    return normals


def _shade(colour: NDArray | tuple[float, ...]) -> NDArray:
    """Reflectance of sRGB colours 0..1, shape (..., 3)."""
    shade: NDArray = _linear(np.asarray(colour, dtype=np.float32)) @ _LUMINANCE
    return shade


def _linear(colour: NDArray) -> Float32:
    """Reflectance of sRGB values 0..1 (IEC 61966-2-1)."""
    return np.where(colour <= 0.04045, colour / 12.92, ((colour + 0.055) / 1.055) ** 2.4).astype(
        np.float32
    )


#: Reflectance by 8-bit sRGB value.
_LINEAR = _linear(np.arange(256, dtype=np.float32) / 255)

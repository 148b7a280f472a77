"""Meshes of people and furniture in a folder of the user's, listed in its `assets.yaml`.

::

    people:
      - {origin: github.com/their/name, licence: MIT, files: [name/people/*.glb]}
    furniture:
      - {origin: our own, licence: CC0-1.0, files: [chair.obj, table.obj], up: z}

They are optional: nothing of this repository needs them. See docs/assets.md.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.config import Section, load_yaml
from mrs_people_loc.errors import ConfigError
from mrs_tools.simulation.models.mesh_files import Part, read_parts
from mrs_tools.simulation.models.meshes import Mesh, merge
from mrs_tools.simulation.models.rooms import SIZES
from mrs_tools.simulation.models.textures import Atlas, Texture
from mrs_tools.simulation.scene import Furniture, Person, Scene

#: The list of a folder's assets.
LIST = "assets.yaml"
#: Allowed height of a person, and length of the longest edge of furniture [m].
PERSON_HEIGHT, FURNITURE_SIZE = (1.2, 2.2), (0.2, 6.0)
#: Furniture is replaced by meshes whose width and depth, and height, are so much of its own.
_LIKE_FLOOR, _LIKE_HEIGHT = (0.4, 1.2), (0.6, 1.4)
#: How much taller than their mesh people are, at random.
_TALLER = (0.95, 1.05)
#: Longest side of a texture that is kept [px].
_LONGEST_PX = 512
#: Most triangles of a mesh: a person who walks is drawn anew at each instant.
_MOST_TRIANGLES = 300_000


def _field(default: Any, doc: str, **limits: Any) -> Any:
    kind = "strs" if isinstance(default, tuple) else type(default).__name__
    return dataclasses.field(default=default, metadata={"kind": kind, "doc": doc, **limits})


@dataclass(frozen=True)
class Source(Section):
    """Files of one origin: an item of `assets.yaml`."""

    origin: str = _field("", "where they are from")
    licence: str = _field("", "their licence, as SPDX writes it")
    files: tuple[str, ...] = _field((), "meshes below the folder, or patterns (*, **)")
    up: str = _field("", "axis that is up in them; empty: as they say", choices=("", "y", "z"))
    scale: float = _field(1.0, "times the size that they give", low=1e-6, high=1e6)
    yaw: float = _field(
        0.0, "turned to the left so that its front looks along x [rad]", low=-6.2832, high=6.2832
    )


@dataclass(frozen=True)
class Shape:
    """Geometry and textures of an asset.

    Attributes:
        mesh: On the floor, its front along x, in the middle (furniture: of its edges, people: of
            head and trunk); the material of a triangle is the number of a texture.
        textures: Its textures.
        size: Edge lengths along x, y, z [m].
    """

    mesh: Mesh
    textures: tuple[Texture, ...]
    size: tuple[float, float, float]

    def drawn_from(self, atlas: Atlas) -> Mesh:
        """The mesh, with its textures in an atlas."""
        numbers = np.array([atlas.add(texture) for texture in self.textures], dtype=np.int32)
        return dataclasses.replace(self.mesh, material=numbers[self.mesh.material])


class Assets:
    """The assets of a folder.

    Args:
        folder: Where `assets.yaml` is.

    Attributes:
        folder: The same.
        people: Sources of people, by file.
        furniture: Sources of furniture, by file.

    Raises:
        ConfigError: The folder, its list or a file that the list names cannot be used.
    """

    def __init__(self, folder: Path) -> None:
        if not folder.is_dir():
            raise ConfigError(f"{folder}: is not a folder with assets ({LIST} and meshes)")
        document = load_yaml(folder / LIST)
        if not isinstance(document, dict) or set(document) - {"people", "furniture"}:
            raise ConfigError(f"{folder / LIST}: wanted: a mapping with people and furniture")
        self.folder = folder
        self.people = _listed(folder, "people", document.get("people"))
        self.furniture = _listed(folder, "furniture", document.get("furniture"))
        if not self.people and not self.furniture:
            raise ConfigError(f"{folder / LIST}: names neither people nor furniture")
        self._shapes: dict[str, Shape] = {}

    def _require(self, file: str, kind: dict[str, Source], name: str) -> None:
        if file not in kind:
            raise ConfigError(f"{self.folder}: {LIST} names no mesh {file!r} of {name}")

    def source(self, file: str) -> Source:
        """Where a file of the list is from."""
        return self.people.get(file) or self.furniture[file]

    def shape(self, file: str) -> Shape:
        """Geometry and textures of an asset; each file is read once.

        Raises:
            ConfigError: It is not there, cannot be read, or its size is absurd.
        """
        if file not in self._shapes:
            source = self.source(file)
            if file in self.people:
                self._shapes[file] = _person(self.folder / file, source)
            else:
                self._shapes[file] = _furniture(self.folder / file, source)
        return self._shapes[file]

    def draw_person(self, person: Person, rng: np.random.Generator) -> Person:
        """The person as a mesh of about its own height, unless they have a mesh or a height."""
        if person.mesh:
            self._require(person.mesh, self.people, "people")
        elif self.people:
            file = str(rng.choice(list(self.people)))
            height = self.shape(file).size[2] * float(rng.uniform(*_TALLER))
            person = dataclasses.replace(person, mesh=file, height=person.height or height)
        return person

    def draw_furniture(self, piece: Furniture, rng: np.random.Generator) -> Furniture:
        """The piece as a mesh of like size, or as it is; its size becomes that of the mesh."""
        if piece.mesh:
            self._require(piece.mesh, self.furniture, "furniture")
        else:
            like = [file for file in self.furniture if _alike(piece, self.shape(file).size)]
            piece = dataclasses.replace(piece, mesh=str(rng.choice([*like, ""])))
        if not piece.mesh:
            return piece
        return dataclasses.replace(piece, size=self.shape(piece.mesh).size)


@lru_cache(maxsize=2)
def load_assets(folder: str) -> Assets:
    """The assets of a folder; read once per process.

    Raises:
        ConfigError: See `Assets`.
    """
    return Assets(Path(folder))


def with_assets(scene: Scene) -> Scene:
    """The scene, its layout expanded, with meshes of its folder of assets instead of ours.

    Which ones is drawn from the scene's seed. People and furniture that name a mesh keep it.

    Raises:
        ConfigError: An asset cannot be used.
    """
    if not scene.assets:
        meshes = [one.mesh for one in scene.people] + [piece.mesh for piece in scene.furniture]
        if any(meshes):
            raise ConfigError(
                f"{scene.name}: mesh {max(meshes)!r} needs a folder of assets (--assets)"
            )
        return scene
    assets = load_assets(scene.assets)
    rng = np.random.default_rng([scene.seed, 12])
    people = tuple(assets.draw_person(person, rng) for person in scene.people)
    furniture = tuple(assets.draw_furniture(piece, rng) for piece in scene.furniture)
    return dataclasses.replace(scene, people=people, furniture=furniture)


def _listed(folder: Path, kind: str, items: object) -> dict[str, Source]:
    """The files that a part of the list names."""
    where = f"{folder / LIST}: {kind}"
    if items is None:
        return {}
    if not isinstance(items, list):
        raise ConfigError(f"{where} is {items!r}; wanted: a list")
    found = {}
    for number, item in enumerate(items):
        if not isinstance(item, dict):
            raise ConfigError(f"{where}[{number}] is {item!r}; wanted: a mapping")
        try:
            source = Source.from_mapping(item)
        except ConfigError as err:
            raise ConfigError(f"{where}[{number}]: {err}") from err
        for key in ("origin", "licence", "files"):
            if not getattr(source, key):
                raise ConfigError(f"{where}[{number}] has no {key}")
        for pattern in source.files:
            if Path(pattern).is_absolute() or ".." in Path(pattern).parts:
                raise ConfigError(f"{where}[{number}]: {pattern} is not below the folder")
            files = sorted(path for path in folder.glob(pattern) if path.is_file())
            if not files:
                raise ConfigError(f"{where}[{number}]: there is no file {pattern}")
            found.update({path.relative_to(folder).as_posix(): source for path in files})
    return found


def _alike(piece: Furniture, size: tuple[float, float, float]) -> bool:
    def within(share: float, limits: tuple[float, float]) -> bool:
        return limits[0] <= share <= limits[1]

    wanted = piece.size or SIZES[piece.kind]
    return (
        within(size[0] / wanted[0], _LIKE_FLOOR)
        and within(size[1] / wanted[1], _LIKE_FLOOR)
        and within(size[2] / wanted[2], _LIKE_HEIGHT)
    )


# ------------------------------------------------------------------------------ shapes ----


def _person(path: Path, source: Source) -> Shape:
    mesh, textures = _upright(path, source)
    height = float(np.ptp(mesh.vertices[:, 2]))
    _check_size(path, height, "tall", PERSON_HEIGHT)
    if not source.yaw:
        mesh = mesh.placed(0.0, 0.0, -_facing(mesh))
    x, y = _axis(mesh)
    return _shape(mesh.placed(-x, -y, 0.0), textures)


def _furniture(path: Path, source: Source) -> Shape:
    mesh, textures = _upright(path, source)
    _check_size(path, float(np.ptp(mesh.vertices, axis=0).max()), "long", FURNITURE_SIZE)
    wide, deep, _ = np.ptp(mesh.vertices, axis=0)
    if wide > deep and not source.yaw:  # ours are broader than deep
        mesh = mesh.placed(0.0, 0.0, math.pi / 2)
    x, y, _ = 0.5 * (mesh.vertices.min(axis=0) + mesh.vertices.max(axis=0))
    return _shape(mesh.placed(-float(x), -float(y), 0.0), textures)


def _shape(mesh: Mesh, textures: list[Texture]) -> Shape:
    dx, dy, dz = (round(float(edge), 4) for edge in np.ptp(mesh.vertices, axis=0))
    return Shape(mesh, tuple(textures), (dx, dy, dz))


def _check_size(path: Path, size: float, what: str, allowed: tuple[float, float]) -> None:
    if not allowed[0] <= size <= allowed[1]:
        raise ConfigError(
            f"{path}: is {size:.3g} m {what}; allowed: {allowed[0]:g} to {allowed[1]:g} m "
            f"(`scale` and `up` in {LIST})"
        )


def _upright(path: Path, source: Source) -> tuple[Mesh, list[Texture]]:
    """The mesh of a file, in metres, its lowest point on the floor, and its textures."""
    parts = read_parts(path, source.up)
    count = sum(len(part.triangles) for part in parts)
    if count > _MOST_TRIANGLES:
        raise ConfigError(f"{path}: has {count} triangles; allowed: {_MOST_TRIANGLES}")
    images = {id(part.image): part.image for part in parts if part.image is not None}
    numbers = {key: number for number, key in enumerate(images, 1)}
    textures = [_RAMP]
    for key, image in images.items():
        tile = _tile([part for part in parts if id(part.image) == key]) * source.scale
        textures.append(_texture(image, tile))
    meshes = []
    for part in parts:
        material = numbers.get(id(part.image), 0)
        uv = part.uv if material else np.stack([part.shade, part.shade], axis=1)
        meshes.append(
            Mesh(
                part.vertices * np.float32(source.scale),
                part.normals,
                uv * np.float32(textures[material].size[0]),
                part.triangles,
                np.full(len(part.triangles), material, dtype=np.int32),
                np.full(len(part.triangles), -1, dtype=np.int32),
            )
        )
    mesh = merge(meshes)
    return mesh.placed(0.0, 0.0, source.yaw, -float(mesh.vertices[:, 2].min())), textures


#: Surfaces without an image: their reflectance is the texture coordinate on this ramp. It is two
#: rows high, so that the atlas keeps no coarser, averaged copies of it.
_RAMP = Texture(np.tile((np.arange(256, dtype=np.float32) + 0.5) / 256, (2, 1)), (1.0, 1.0))


def _tile(parts: list[Part]) -> float:
    """Edge of a square of the surface that a whole image covers, in the mean [m]."""
    solid = flat = 0.0
    for part in parts:
        a, b, c = (part.vertices[part.triangles[:, k]] for k in range(3))
        solid += float(np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
        (ux, uy), (vx, vy) = (
            (part.uv[part.triangles[:, k]] - part.uv[part.triangles[:, 0]]).T for k in (1, 2)
        )
        flat += float(np.abs(ux * vy - uy * vx).sum())
    return math.sqrt(max(solid, 1e-6) / max(flat, 1e-6))


def _texture(image: NDArray, tile: float) -> Texture:
    """An image as a texture: its sides powers of two, its first row at v = 0."""
    sides = [min(_LONGEST_PX, 2 ** max(2, round(math.log2(side)))) for side in image.shape]
    small = cv2.resize(image, (sides[1], sides[0]), interpolation=cv2.INTER_AREA)
    return Texture(np.ascontiguousarray(np.clip(small[::-1], 0.01, 0.98)), (tile, tile))


def _areas(mesh: Mesh) -> tuple[NDArray, NDArray]:
    """Middles of the triangles [m], shape (m, 3), and their areas, shape (m,)."""
    a, b, c = (mesh.vertices[mesh.triangles[:, k]].astype(np.float64) for k in range(3))
    return (a + b + c) / 3, 0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1)


def _middle(middles: NDArray, areas: NDArray, chosen: NDArray) -> NDArray:
    weight = areas * chosen
    middle: NDArray = weight @ middles[:, :2] / max(float(weight.sum()), 1e-12)
    return middle


def _facing(mesh: Mesh) -> float:
    """Where a person faces, by their feet: toes are ahead of ankles [rad, a multiple of pi/2]."""
    middles, areas = _areas(mesh)
    height = middles[:, 2] / float(mesh.vertices[:, 2].max())
    toes = _middle(middles, areas, height < 0.035) - _middle(
        middles, areas, (height > 0.06) & (height < 0.12)
    )
    return round(math.atan2(toes[1], toes[0]) / (math.pi / 2)) * math.pi / 2


def _axis(mesh: Mesh) -> NDArray:
    """Axis of a person who faces x: the mean of the middles of head and trunk, x, y [m]."""
    middles, areas = _areas(mesh)
    height = middles[:, 2] / float(mesh.vertices[:, 2].max())
    head = _middle(middles, areas, height > 0.88)
    # Arms are farther to the sides than the head.
    near = (np.abs(middles[:, :2] - head) < (0.3, 0.2)).all(axis=1)
    return 0.5 * (head + _middle(middles, areas, near & (height > 0.55) & (height < 0.8)))

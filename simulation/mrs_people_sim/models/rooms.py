"""Rooms: floor, walls, what hangs on them, furniture and clutter."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_sim.models import interiors, textures
from mrs_people_sim.models.meshes import Mesh, box, cylinder, ellipsoid, make, merge, quad
from mrs_people_sim.models.textures import Atlas
from mrs_people_sim.scene import Furniture, Room

Rng = np.random.Generator

#: Usual edge lengths x, y, z of furniture [m].
SIZES = {
    "table": (0.8, 1.4, 0.74),
    "table_on_edge": (0.2, 1.0, 1.0),
    "chair": (0.46, 0.46, 0.88),
    "desk": (0.8, 1.6, 0.73),
    "shelf": (0.35, 1.0, 1.9),
    "cabinet": (0.5, 0.9, 1.2),
    "pillar": (0.4, 0.4, 2.8),
    "plant": (0.6, 0.6, 1.5),
    "partition": (0.06, 1.6, 1.6),
    "bin": (0.3, 0.3, 0.6),
    "boxes": (0.5, 0.5, 0.9),
    "coat_stand": (0.5, 0.5, 1.75),
    "sign": (0.35, 0.8, 1.9),
    "sofa": (0.85, 1.7, 0.8),
    "lamp": (0.35, 0.35, 1.6),
    "board": (0.5, 1.2, 1.8),
    "block": (0.5, 0.5, 0.5),
    "wall": (0.2, 3.0, 2.8),
    **interiors.SIZES,
}

_WALLS: dict[str, Callable[..., textures.Texture]] = {
    "plaster": textures.plaster,
    "wallpaper": textures.wallpaper,
    "brick": textures.brick,
    "concrete": textures.concrete,
    "wood": textures.wood,
    "plain": textures.plain,
    "speckle": textures.speckle,
}
_FLOORS: dict[str, Callable[..., textures.Texture]] = {
    "carpet": textures.carpet,
    "planks": textures.planks,
    "tiles": textures.tiles,
    "concrete": textures.concrete,
    "plain": textures.plain,
    "speckle": textures.speckle,
}


def room_mesh(room: Room, rng: Rng, atlas: Atlas) -> Mesh:
    """Floor, ceiling, walls, skirting, doors and posters of a room."""
    length, width, height = room.length, room.width, room.height
    x, y, z = np.diag([length, width, height])
    floor = atlas.add(_FLOORS[room.floor](rng, room.floor_shade, room.contrast))
    wall = atlas.add(_WALLS[room.walls](rng, room.wall_shade, room.contrast))
    other = atlas.add(_WALLS[room.walls](rng, min(0.9, room.wall_shade * 1.1), room.contrast))
    ceiling = atlas.add(textures.tiles(rng, 0.75, 0.6 * room.contrast, 0.6))
    skirting = atlas.add(textures.wood(rng, float(rng.choice([0.2, 0.7])), room.contrast))
    parts = [
        quad(0 * x, x, y, floor),
        quad(y + z, x, -y, ceiling),
        # Walls face inwards.
        quad(x, -x, z, wall, uv_origin=(0.3, 0.0)),
        quad(y, x, z, wall, uv_origin=(0.7, 0.0)),
        quad(0 * x, y, z, other, uv_origin=(0.1, 0.0)),
        quad(x + y, -y, z, other, uv_origin=(0.5, 0.0)),
    ]
    for middle, size in (
        ((length / 2, 0.01, 0.04), (length, 0.02, 0.08)),
        ((length / 2, width - 0.01, 0.04), (length, 0.02, 0.08)),
        ((0.01, width / 2, 0.04), (0.02, width, 0.08)),
        ((length - 0.01, width / 2, 0.04), (0.02, width, 0.08)),
    ):
        parts.append(box(middle, size, skirting))
    taken: list[tuple[int, float, float]] = []
    for _ in range(room.doors):
        place = _free_place(rng, room, 0.95, taken)
        if place is not None:
            leaf = atlas.add(textures.door(rng, 0.95, 2.08))
            parts.append(_on_wall(room, place, 0.0, (0.95, min(2.08, height)), leaf))
    for _ in range(room.posters):
        wide, tall = rng.uniform(0.4, 1.3), rng.uniform(0.4, 1.2)
        place = _free_place(rng, room, wide, taken)
        if place is None:
            continue
        # Most hang at eye level; some stand on the floor.
        low = rng.uniform(0.7, 1.5) if rng.random() < 0.85 else rng.uniform(0.0, 0.4)
        tall = min(tall, height - low - 0.05)
        if rng.random() < 0.2:
            glass = textures.plain(rng, 0.95, 1.0)  # a window, brighter than all else
            sheet = textures.Texture(np.clip(glass.image, 0.9, 0.98), (wide, tall))
        else:
            sheet = textures.poster(rng, wide, tall)
        parts.append(_on_wall(room, place, low, (wide, tall), atlas.add(sheet)))
    return merge(parts)


def _free_place(
    rng: Rng, room: Room, wide: float, taken: list[tuple[int, float, float]]
) -> tuple[int, float] | None:
    """A wall (0..3) and where on it something so wide has room [m]."""
    for _ in range(20):
        wall = int(rng.choice(4, p=_wall_shares(room)))
        extent = room.length if wall < 2 else room.width
        if extent < wide + 0.6:
            continue
        at = float(rng.uniform(0.3, extent - wide - 0.3))
        if all(w != wall or at + wide < low or at > high for w, low, high in taken):
            taken.append((wall, at, at + wide))
            return wall, at
    return None


def _wall_shares(room: Room) -> NDArray:
    extents = np.array([room.length, room.length, room.width, room.width])
    return extents / extents.sum()


def _on_wall(
    room: Room, place: tuple[int, float], low: float, size: tuple[float, float], material: int
) -> Mesh:
    """A thin board on a wall."""
    wall, at = place
    middle = at + size[0] / 2
    x, y, yaw = {
        0: (middle, 0.0, 0.0),
        1: (room.length - middle, room.width, math.pi),
        2: (0.0, room.width - middle, -math.pi / 2),
        3: (room.length, middle, math.pi / 2),
    }[wall]
    board = quad(
        np.array([size[0] / 2, 0.015, low]), np.array([-size[0], 0.0, 0.0]),
        np.array([0.0, 0.0, size[1]]), material,
    )  # fmt: skip
    return board.placed(x, y, yaw)


# --------------------------------------------------------------------------- furniture ----


def furniture_mesh(piece: Furniture, rng: Rng, atlas: Atlas, contrast: float) -> Mesh:
    """A piece of furniture where it stands."""
    size = piece.size or SIZES[piece.kind]
    if piece.kind in interiors.MAKERS:
        draw = interiors.Materials(rng, atlas, contrast)
        parts = interiors.MAKERS[piece.kind](dataclasses.replace(piece, size=size), draw)
    else:
        parts = _MAKERS[piece.kind](size, rng, atlas, contrast)
    return merge(parts).placed(piece.x, piece.y, piece.yaw, piece.z)


def footprint(piece: Furniture) -> tuple[float, float, float]:
    """Centre and radius of the circle that walkers keep clear of [m]."""
    dx, dy, _ = piece.size or SIZES[piece.kind]
    return piece.x, piece.y, 0.5 * math.hypot(dx, dy) * 0.85


#: Of the floor plan: side of a cell, and how thick its walls are [m].
_PLAN_CELL, _PLAN_WALL = 0.05, 0.15


def floor_plan(room: Room, furniture: Sequence[Furniture]) -> OccupancyGrid:
    """What an operator's map of the room shows: walls, and what furniture covers of the floor."""
    columns, rows = (
        math.ceil(round((extent + 2 * _PLAN_WALL) / _PLAN_CELL, 6))
        for extent in (room.length, room.width)
    )
    x = (np.arange(columns) + 0.5) * _PLAN_CELL - _PLAN_WALL
    y = ((np.arange(rows) + 0.5) * _PLAN_CELL - _PLAN_WALL)[:, np.newaxis]
    occupied = (x < 0) | (x > room.length) | (y < 0) | (y > room.width)
    for piece in furniture:
        dx, dy, _ = piece.size or SIZES[piece.kind]
        cos, sin = math.cos(piece.yaw), math.sin(piece.yaw)
        along = np.abs((x - piece.x) * cos + (y - piece.y) * sin)
        across = np.abs((y - piece.y) * cos - (x - piece.x) * sin)
        # Thin things are a cell wide.
        half = np.maximum([dx / 2, dy / 2], _PLAN_CELL / 2)
        occupied |= (along <= half[0]) & (across <= half[1])
    data = np.where(occupied, 100, 0).astype(np.int8)
    return OccupancyGrid(_PLAN_CELL, -_PLAN_WALL, -_PLAN_WALL, 0.0, data)


Size = tuple[float, ...]


def _surface(rng: Rng, atlas: Atlas, contrast: float) -> int:
    if rng.random() < 0.6:
        return atlas.add(textures.wood(rng, float(rng.uniform(0.2, 0.7)), contrast))
    return atlas.add(textures.plain(rng, float(rng.uniform(0.15, 0.85)), contrast))


def _metal(rng: Rng, atlas: Atlas) -> int:
    return atlas.add(textures.plain(rng, float(rng.choice([0.08, 0.3, 0.6]))))


def _legs(size: Size, height: float, thick: float, material: int) -> list[Mesh]:
    dx, dy = size[0] / 2 - thick, size[1] / 2 - thick
    return [
        box((sx * dx, sy * dy, height / 2), (thick, thick, height), material)
        for sx in (-1, 1)
        for sy in (-1, 1)
    ]


def _things_on(
    size: Size, z: float, rng: Rng, atlas: Atlas, contrast: float, count: int
) -> list[Mesh]:
    """Clutter on a surface: books, boxes, cups."""
    parts = []
    for _ in range(count):
        at = (rng.uniform(-0.4, 0.4) * size[0], rng.uniform(-0.42, 0.42) * size[1])
        shade = float(rng.uniform(0.05, 0.9))
        if rng.random() < 0.4:
            cup = atlas.add(textures.plain(rng, shade, contrast))
            parts.append(cylinder((*at, z), float(rng.uniform(0.08, 0.3)), 0.04, cup, segments=10))
        else:
            edges = rng.uniform([0.1, 0.1, 0.03], [0.3, 0.35, 0.3])
            print_ = atlas.add(textures.poster(rng, 0.3, 0.3))
            parts.append(
                box((*at, z + edges[2] / 2), tuple(edges), print_, yaw=float(rng.uniform(-1, 1)))
            )
    return parts


def _table(size: Size, rng: Rng, atlas: Atlas, contrast: float) -> list[Mesh]:
    top, legs = _surface(rng, atlas, contrast), _metal(rng, atlas)
    return [
        box((0, 0, size[2] - 0.02), (size[0], size[1], 0.04), top),
        *_legs(size, size[2] - 0.04, 0.05, legs),
        *_things_on(size, size[2], rng, atlas, contrast, int(rng.integers(0, 5))),
    ]


def _table_on_edge(size: Size, rng: Rng, atlas: Atlas, contrast: float) -> list[Mesh]:
    top = atlas.add(textures.wood(rng, 0.5, 1.5 * contrast))
    legs = _metal(rng, atlas)
    parts = [box((0.4 * size[0], 0, size[2] / 2), (0.2 * size[0], size[1], size[2]), top)]
    for y in (-0.42, 0.42):
        for z in (0.08, 0.92):
            parts.append(
                box((-0.1 * size[0], y * size[1], z * size[2]), (0.8 * size[0], 0.04, 0.04), legs)
            )
    return parts


def _chair(size: Size, rng: Rng, atlas: Atlas, contrast: float) -> list[Mesh]:
    seat = atlas.add(textures.fabric(rng, "knit", float(rng.uniform(0.08, 0.6)), contrast))
    legs = _metal(rng, atlas)
    high = 0.46
    back = size[2] - high - 0.12
    parts = [
        box((0, 0, high), (size[0], size[1], 0.06), seat),
        box((-size[0] / 2 + 0.03, 0, size[2] - back / 2), (0.05, size[1] * 0.95, back), seat),
        box((-size[0] / 2 + 0.03, 0, high + 0.1), (0.03, 0.06, 0.2), legs),
    ]
    if rng.random() < 0.5:
        parts += _legs(size, high, 0.03, legs)
    else:
        parts += [
            cylinder((0, 0, 0.08), high - 0.08, 0.03, legs, segments=8),
            *(
                box((0.14 * math.cos(a), 0.14 * math.sin(a), 0.06), (0.28, 0.05, 0.05), legs, yaw=a)
                for a in np.arange(5) * 2 * math.pi / 5
            ),
        ]
    return parts


def _desk(size: Size, rng: Rng, atlas: Atlas, contrast: float) -> list[Mesh]:
    parts = _table(size, rng, atlas, contrast)
    dark = atlas.add(textures.plain(rng, 0.05))
    for k in range(int(rng.integers(1, 3))):
        y = float(rng.uniform(-0.15, 0.15)) + (0.4 - 0.8 * k) * size[1] / 2
        wide, tall = float(rng.uniform(0.45, 0.65)), float(rng.uniform(0.28, 0.38))
        z = size[2] + 0.14 + tall / 2
        picture = atlas.add(textures.screen(rng, wide, tall))
        x = -0.15 * size[0]
        parts += [
            box((x, y, z), (0.04, wide + 0.03, tall + 0.03), dark),
            quad(
                np.array([x + 0.022, y - wide / 2, z - tall / 2]), np.array([0.0, wide, 0.0]),
                np.array([0.0, 0.0, tall]), picture,
            ),
            box((x - 0.02, y, size[2] + 0.1), (0.03, 0.06, 0.2), dark),
            box((x, y, size[2] + 0.01), (0.18, 0.24, 0.02), dark),
        ]  # fmt: skip
    front = _surface(rng, atlas, contrast)
    parts.append(
        box((-size[0] / 2 + 0.02, 0, size[2] * 0.6), (0.02, size[1], size[2] * 0.7), front)
    )
    if rng.random() < 0.7:
        parts.append(
            box(
                (0.0, size[1] / 2 - 0.22, size[2] * 0.42),
                (size[0] * 0.9, 0.4, size[2] * 0.84),
                front,
            )
        )
    return parts


def _shelf(size: Size, rng: Rng, atlas: Atlas, contrast: float) -> list[Mesh]:
    board = _surface(rng, atlas, contrast)
    dx, dy, dz = size
    parts = [box((0, s * (dy / 2 - 0.01), dz / 2), (dx, 0.02, dz), board) for s in (-1, 1)]
    parts.append(box((-dx / 2 + 0.01, 0, dz / 2), (0.02, dy, dz), board))
    levels = max(2, round(dz / 0.36))
    for k in range(levels + 1):
        z = 0.02 + k * (dz - 0.04) / levels
        parts.append(box((0, 0, z), (dx, dy, 0.025), board))
        if k < levels and rng.random() < 0.85:
            row = atlas.add(textures.books(rng, 0.42, contrast))
            wide = dy * float(rng.uniform(0.4, 0.95))
            tall = float(rng.uniform(0.2, 0.28))
            shift = float(rng.uniform(-1, 1)) * (dy - 0.05 - wide) / 2
            parts.append(box((0.02, shift, z + 0.0125 + tall / 2), (dx * 0.7, wide, tall), row))
    parts += [p.placed(0, 0, 0, 0) for p in _things_on(size, dz, rng, atlas, contrast, 2)]
    return parts


def _cabinet(size: Size, rng: Rng, atlas: Atlas, contrast: float) -> list[Mesh]:
    body = _surface(rng, atlas, contrast)
    front = atlas.add(textures.door(rng, size[1], size[2]))
    dx, dy, dz = size
    return [
        box((0, 0, dz / 2), size, body),
        quad(
            np.array([dx / 2 + 0.005, -dy / 2, 0.0]), np.array([0.0, dy, 0.0]),
            np.array([0.0, 0.0, dz]), front,
        ),
        *_things_on(size, dz, rng, atlas, contrast, int(rng.integers(0, 4))),
    ]  # fmt: skip


def _pillar(size: Size, rng: Rng, atlas: Atlas, contrast: float) -> list[Mesh]:
    skin = atlas.add(textures.concrete(rng, float(rng.uniform(0.3, 0.8)), contrast))
    if rng.random() < 0.5:
        return [cylinder((0, 0, 0), size[2], size[0] / 2, skin)]
    return [box((0, 0, size[2] / 2), size, skin)]


def _plant(size: Size, rng: Rng, atlas: Atlas, contrast: float) -> list[Mesh]:
    green = atlas.add(textures.leaves(rng, float(rng.uniform(0.12, 0.35)), contrast))
    pot = atlas.add(textures.plain(rng, float(rng.uniform(0.2, 0.8)), contrast))
    high = 0.22 * size[2]
    parts = [
        cylinder((0, 0, 0), high, 0.25 * size[0], pot, top_radius=0.32 * size[0]),
        cylinder((0, 0, high), 0.5 * size[2], 0.02, green, segments=8),
    ]
    # Leaves: two-sided diamonds that point outwards.
    count = int(60 * size[2])
    base = np.stack(
        [
            rng.uniform(-0.15, 0.15, count) * size[0],
            rng.uniform(-0.15, 0.15, count) * size[1],
            rng.uniform(high, 0.8 * size[2], count),
        ],
        axis=1,
    )
    angle, rise = rng.uniform(0, 2 * math.pi, count), rng.uniform(-0.3, 1.2, count)
    ahead = np.stack(
        [np.cos(angle) * np.cos(rise), np.sin(angle) * np.cos(rise), np.sin(rise)], axis=1
    )
    across = np.cross(ahead, rng.normal(0, 0.4, (count, 3)) + [0, 0, 1.0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    long = rng.uniform(0.25, 0.5, (count, 1)) * size[0]
    wide = long * 0.22
    vertices = np.stack(
        [
            base,
            base + 0.5 * long * ahead + wide * across,
            base + long * ahead - [0, 0, 0.03],
            base + 0.5 * long * ahead - wide * across,
        ],
        axis=1,
    ).reshape(-1, 3)
    normals = np.repeat(np.cross(ahead, across), 4, axis=0)
    uv = rng.uniform(0, 0.5, (count, 1, 2)) + np.array(
        [[0, 0], [0.08, 0.04], [0.16, 0.0], [0.08, -0.04]]
    )
    corner = 4 * np.arange(count)[:, None]
    triangles = np.concatenate([corner + [0, 1, 2], corner + [0, 2, 3]])
    parts.append(make(vertices, normals, uv.reshape(-1, 2), triangles, green))
    return parts


def _partition(size: Size, rng: Rng, atlas: Atlas, contrast: float) -> list[Mesh]:
    cloth = atlas.add(textures.carpet(rng, float(rng.uniform(0.2, 0.7)), contrast))
    parts = [box((0, 0, size[2] / 2), size, cloth)]
    if rng.random() < 0.6:
        sheet = atlas.add(textures.poster(rng, 0.6, 0.4))
        parts.append(box((0, 0.1 * size[1], 0.75 * size[2]), (size[0] + 0.01, 0.6, 0.4), sheet))
    return parts


def _bin(size: Size, rng: Rng, atlas: Atlas, contrast: float) -> list[Mesh]:
    shade = atlas.add(textures.plain(rng, float(rng.uniform(0.05, 0.6)), contrast))
    return [cylinder((0, 0, 0), size[2], 0.4 * size[0], shade, top_radius=0.5 * size[0])]


def _boxes(size: Size, rng: Rng, atlas: Atlas, contrast: float) -> list[Mesh]:
    parts, z = [], 0.0
    while z < size[2] - 0.1:
        tall = float(rng.uniform(0.2, 0.45))
        card = atlas.add(textures.poster(rng, 0.6, 0.5))
        plain = atlas.add(textures.carpet(rng, 0.45, 0.7 * contrast))
        wide = (size[0] * float(rng.uniform(0.6, 1)), size[1] * float(rng.uniform(0.6, 1)), tall)
        parts.append(
            box(
                (float(rng.uniform(-0.04, 0.04)), float(rng.uniform(-0.04, 0.04)), z + tall / 2),
                wide,
                card if rng.random() < 0.5 else plain,
                yaw=float(rng.uniform(-0.3, 0.3)),
            )
        )
        z += tall
    return parts


def _coat_stand(size: Size, rng: Rng, atlas: Atlas, contrast: float) -> list[Mesh]:
    """As tall as a person and clothed like one."""
    pole = _metal(rng, atlas)
    parts = [
        cylinder((0, 0, 0), size[2], 0.02, pole, segments=8),
        cylinder((0, 0, 0), 0.03, 0.5 * size[0], pole),
    ]
    for k in range(int(rng.integers(1, 4))):
        cloth = atlas.add(textures.fabric(rng, "plain", float(rng.uniform(0.05, 0.5)), contrast))
        angle = k * 2.1 + float(rng.uniform(0, 1))
        middle = np.array([0.12 * math.cos(angle), 0.12 * math.sin(angle), size[2] - 0.55])
        axes = np.array(
            [
                [math.cos(angle), math.sin(angle), 0],
                [-math.sin(angle), math.cos(angle), 0],
                [0, 0, 1],
            ]
        )
        parts.append(ellipsoid(middle, axes, (0.10, 0.2, 0.5), cloth))
    return parts


def _sign(size: Size, rng: Rng, atlas: Atlas, contrast: float) -> list[Mesh]:
    """A roll-up banner."""
    sheet = atlas.add(textures.poster(rng, size[1], size[2]))
    foot = _metal(rng, atlas)
    return [
        box((0, 0, size[2] / 2), (0.02, size[1], size[2]), sheet),
        box((0, 0, 0.03), (size[0], size[1], 0.06), foot),
    ]


def _sofa(size: Size, rng: Rng, atlas: Atlas, contrast: float) -> list[Mesh]:
    cloth = atlas.add(textures.fabric(rng, "knit", float(rng.uniform(0.1, 0.6)), contrast))
    dx, dy, dz = size
    return [
        box((0, 0, 0.22), (dx, dy, 0.44), cloth),
        box((-dx / 2 + 0.11, 0, dz / 2), (0.22, dy, dz), cloth),
        *(box((0, s * (dy / 2 - 0.1), 0.31), (dx, 0.2, 0.62), cloth) for s in (-1, 1)),
    ]


def _lamp(size: Size, rng: Rng, atlas: Atlas, contrast: float) -> list[Mesh]:
    pole, shade = _metal(rng, atlas), atlas.add(textures.plain(rng, 0.9, contrast))
    return [
        cylinder((0, 0, 0), 0.03, 0.14, pole),
        cylinder((0, 0, 0), size[2] - 0.2, 0.012, pole, segments=8),
        cylinder((0, 0, size[2] - 0.3), 0.3, size[0] / 2, shade, top_radius=0.3 * size[0]),
    ]


def _board(size: Size, rng: Rng, atlas: Atlas, contrast: float) -> list[Mesh]:
    """A flip chart or white board on feet."""
    sheet, frame = atlas.add(textures.poster(rng, size[1], 1.0)), _metal(rng, atlas)
    parts = [box((0, 0, size[2] - 0.5), (0.03, size[1], 1.0), sheet)]
    for s in (-1, 1):
        parts.append(
            box((0, s * size[1] * 0.45, size[2] / 2 - 0.25), (0.03, 0.03, size[2] - 0.5), frame)
        )
        parts.append(box((0, s * size[1] * 0.45, 0.02), (size[0], 0.04, 0.04), frame))
    return parts


def _block(size: Size, rng: Rng, atlas: Atlas, contrast: float) -> list[Mesh]:
    """A box in the strongest texture."""
    return [box((0, 0, size[2] / 2), size, atlas.add(textures.speckle(rng, 0.5, contrast)))]


def _wall(size: Size, rng: Rng, atlas: Atlas, contrast: float) -> list[Mesh]:
    """A part of the building, such as what makes a corridor turn."""
    make_wall = (textures.plaster, textures.concrete, textures.brick)[int(rng.integers(3))]
    surface = atlas.add(make_wall(rng, float(rng.uniform(0.4, 0.7)), contrast))
    parts = [box((0, 0, size[2] / 2), size, surface)]
    for _ in range(round((size[0] + size[1]) / 4)):
        # Posters on its sides, as on those of the room.
        wide, tall = float(rng.uniform(0.4, 1.2)), float(rng.uniform(0.4, 1.1))
        low, sheet = float(rng.uniform(0.7, 1.4)), atlas.add(textures.poster(rng, wide, tall))
        side = int(rng.choice(4, p=np.array([size[1], size[0]] * 2) / (2 * (size[0] + size[1]))))
        depth, extent = (size[0], size[1]) if side % 2 == 0 else (size[1], size[0])
        if extent < wide + 0.4:
            continue
        at = float(rng.uniform(0.2, extent - wide - 0.2)) - extent / 2
        corner = np.array([depth / 2 + 0.012, at, low])
        poster = quad(corner, np.array([0.0, wide, 0.0]), np.array([0.0, 0.0, tall]), sheet)
        parts.append(poster.placed(0.0, 0.0, side * math.pi / 2))
    return parts


_MAKERS: dict[str, Callable[[Size, Rng, Atlas, float], list[Mesh]]] = {
    "table": _table,
    "table_on_edge": _table_on_edge,
    "chair": _chair,
    "desk": _desk,
    "shelf": _shelf,
    "cabinet": _cabinet,
    "pillar": _pillar,
    "plant": _plant,
    "partition": _partition,
    "bin": _bin,
    "boxes": _boxes,
    "coat_stand": _coat_stand,
    "sign": _sign,
    "sofa": _sofa,
    "lamp": _lamp,
    "board": _board,
    "block": _block,
    "wall": _wall,
}

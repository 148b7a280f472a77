"""Furniture of lived-in rooms that detectors take for people: doors, chairs, curtains, ...

Each piece stands on z = 0 with its middle at x = y = 0 and its front along x, as in `rooms.py`.
Sizes are usual ones of homes and offices (E. Neufert, Architects' Data).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mrs_people_sim.models import textures
from mrs_people_sim.models.meshes import (
    Mesh,
    box,
    cylinder,
    ellipsoid,
    loft,
    make,
    merge,
    quad,
    tube,
)
from mrs_people_sim.models.textures import Atlas
from mrs_people_sim.scene import Furniture

Parts = list[Mesh]

#: Usual edge lengths x, y, z [m]; those of a door are without its leaf, which may stand open.
SIZES = {
    "door": (0.16, 0.98, 2.10),
    "doorway": (0.14, 2.2, 2.8),
    "corner": (1.2, 1.2, 2.8),
    "pier": (0.35, 0.5, 2.8),
    "wardrobe": (0.6, 1.0, 2.0),
    "rack": (0.4, 0.9, 1.8),
    "office_chair": (0.62, 0.62, 1.15),
    "workplace": (0.8, 1.6, 0.73),
    "covered_table": (0.75, 1.2, 0.75),
    "curtain": (0.2, 1.2, 2.3),
    "coat_on_stand": (0.45, 0.45, 1.75),
    "coat_hooks": (0.2, 1.0, 1.75),
    "ladder": (0.95, 0.5, 1.7),
    "whiteboard": (0.55, 1.5, 1.9),
    "radiator": (0.11, 1.2, 0.75),
    "window": (0.12, 1.2, 1.3),
    "water_cooler": (0.33, 0.33, 1.35),
}
#: Kinds that hang on a wall, and how high over the floor [m].
HANGING = {"window": 0.9}
#: Kinds whose back is a wall.
WALLED = frozenset(
    ("door", "pier", "wardrobe", "curtain", "coat_hooks", "radiator", "window")
)  # fmt: skip
#: Kinds that are as tall as the room.
FULL_HEIGHT = frozenset(("doorway", "corner", "pier"))

#: Clear width and height of a door, and width of its frame [m].
_LEAF, _LEAF_HEIGHT, _FRAME = 0.86, 2.02, 0.06
#: Width of the opening in the wall that a frame fills [m].
OPENING = _LEAF + 2 * _FRAME


@dataclass(frozen=True)
class Materials:
    """Draws surfaces at random and puts them into the atlas.

    Attributes:
        rng: Source of randomness.
        atlas: Where the textures go.
        contrast: Of the room's textures.
    """

    rng: np.random.Generator
    atlas: Atlas
    contrast: float

    def between(self, low: float, high: float) -> float:
        """A number of that range."""
        return float(self.rng.uniform(low, high))

    def chance(self, share: float) -> bool:
        """True so often."""
        return bool(self.rng.random() < share)

    def plain(self, low: float = 0.05, high: float = 0.85) -> int:
        """Paint or plastic of a reflectance in that range."""
        shade = self.between(low, high)
        return self.atlas.add(textures.plain(self.rng, shade, self.contrast))

    def metal(self) -> int:
        """Black, grey or bright metal."""
        shade = float(self.rng.choice([0.05, 0.3, 0.65]))
        return self.atlas.add(textures.plain(self.rng, shade))

    def board(self) -> int:
        """Wood, paint or speckled laminate."""
        make_surface = (textures.wood, textures.wood, textures.plain, textures.concrete)[
            int(self.rng.integers(4))
        ]
        shade = self.between(0.12, 0.85)
        return self.atlas.add(make_surface(self.rng, shade, self.contrast * self.between(0.4, 1.6)))

    def wall(self) -> int:
        """Plaster, concrete, brick or wallpaper."""
        make_surface = (
            textures.plaster, textures.plaster, textures.concrete, textures.brick,
            textures.wallpaper,
        )[int(self.rng.integers(5))]  # fmt: skip
        return self.atlas.add(make_surface(self.rng, self.between(0.3, 0.8), self.contrast))

    def cloth(self) -> int:
        """Cloth of any pattern."""
        kind = str(
            self.rng.choice(
                ["plain", "knit", "stripes", "checks", "print", "denim"],
                p=[0.4, 0.2, 0.12, 0.1, 0.1, 0.08],
            )
        )
        shade = float(self.rng.choice([self.between(0.04, 0.12), self.between(0.12, 0.75)]))
        return self.atlas.add(textures.fabric(self.rng, kind, shade, self.contrast))

    def sheet(self, width: float, height: float) -> int:
        """A printed sheet."""
        return self.atlas.add(textures.poster(self.rng, width, height))


def beam(start: ArrayLike, end: ArrayLike, wide: float, deep: float, material: int) -> Mesh:
    """A straight bar between two points, `wide` along y (or x, where it runs along y) [m]."""
    start, end = np.asarray(start, dtype=np.float64), np.asarray(end, dtype=np.float64)
    along = end - start
    ahead = along / np.linalg.norm(along)
    aside = np.array([0.0, 1.0, 0.0]) if abs(ahead[1]) < 0.9 else np.array([1.0, 0.0, 0.0])
    across = aside - ahead * (aside @ ahead)
    across *= wide / np.linalg.norm(across)
    up = np.cross(ahead, across / wide) * deep
    low = start - 0.5 * (across + up)
    return merge(
        [
            quad(low, along, up, material),
            quad(low + across + along, -along, up, material),
            quad(low + along, across, up, material),
            quad(low + across, -across, up, material),
            quad(low + up, along, across, material),
            quad(low + across, along, -across, material),
        ]
    )


def sheet_mesh(points: NDArray, material: int) -> Mesh:
    """A sheet of cloth through a grid of points.

    Args:
        points: Shape (rows, columns, 3); texture coordinates follow its lengths.
        material: Material index.
    """
    rows, columns = points.shape[:2]
    down, along = np.gradient(points, axis=0), np.gradient(points, axis=1)
    normals = np.cross(along, down)
    normals /= np.maximum(np.linalg.norm(normals, axis=2, keepdims=True), 1e-9)
    u = np.cumsum(np.linalg.norm(along, axis=2), axis=1)
    v = np.cumsum(np.linalg.norm(down, axis=2), axis=0)
    first = (np.arange(rows - 1)[:, np.newaxis] * columns + np.arange(columns - 1)).ravel()
    triangles = np.concatenate(
        [
            np.stack([first, first + 1, first + columns + 1], axis=1),
            np.stack([first, first + columns + 1, first + columns], axis=1),
        ]
    )
    uv = np.stack([u, v], axis=2)
    return make(
        points.reshape(-1, 3), normals.reshape(-1, 3), uv.reshape(-1, 2), triangles, material
    )


# --------------------------------------------------------------------------- the building ----


def _frame_and_leaf(x: float, depth: float, open_rad: float, draw: Materials) -> Parts:
    """A door's frame around y = 0 and its leaf, hinged at one jamb in the plane `x`."""
    frame = draw.board()
    leaf = draw.atlas.add(textures.door(draw.rng, _LEAF, _LEAF_HEIGHT))
    edge = draw.plain(0.2, 0.8)
    half, side = _LEAF / 2, 1.0 if draw.chance(0.5) else -1.0
    parts = [
        *(
            box((0.0, s * (half + _FRAME / 2), (_LEAF_HEIGHT + _FRAME) / 2),
                (depth, _FRAME, _LEAF_HEIGHT + _FRAME), frame)
            for s in (-1, 1)
        ),
        box((0.0, 0.0, _LEAF_HEIGHT + _FRAME / 2), (depth, _LEAF, _FRAME), frame),
    ]  # fmt: skip
    # The leaf in its own frame: from the hinge along y, its front along x.
    panel = [
        box((0.0, -side * half, _LEAF_HEIGHT / 2), (0.04, _LEAF, _LEAF_HEIGHT), edge),
        *(
            quad(
                np.array([s * 0.021, -side * half - s * half, 0.0]),
                np.array([0.0, s * _LEAF, 0.0]), np.array([0.0, 0.0, _LEAF_HEIGHT]), leaf,
            )
            for s in (-1, 1)
        ),
        box((0.05, -side * (_LEAF - 0.07), 1.05), (0.06, 0.12, 0.02), draw.metal()),
    ]  # fmt: skip
    return [*parts, merge(panel).placed(x, side * half, side * open_rad)]


def _door(piece: Furniture, draw: Materials) -> Parts:
    """A door in the wall behind it; through an open one another room is seen, as a picture."""
    dx = piece.size[0]
    parts = _frame_and_leaf(dx / 2 - 0.03, dx, piece.open, draw)
    if piece.open > 0.0:
        beyond = draw.atlas.add(textures.beyond(draw.rng, _LEAF, _LEAF_HEIGHT))
        parts.append(
            quad(
                np.array([-dx / 2 + 0.01, -_LEAF / 2, 0.0]), np.array([0.0, _LEAF, 0.0]),
                np.array([0.0, 0.0, _LEAF_HEIGHT]), beyond,
            )
        )  # fmt: skip
    return parts


def _doorway(piece: Furniture, draw: Materials) -> Parts:
    """A wall across the room with a door's opening in its middle."""
    dx, dy, dz = piece.size
    skin = draw.wall()
    gap = OPENING / 2
    wide = dy / 2 - gap
    parts = [
        *(
            box((0.0, s * (gap + wide / 2), dz / 2), (dx - 0.03, wide, dz), skin)
            for s in (-1, 1)
            if wide > 0.01
        ),
        *_frame_and_leaf(dx / 2 - 0.03, dx, piece.open, draw),
    ]
    over = dz - _LEAF_HEIGHT - _FRAME
    if over > 0.0:
        parts.append(box((0.0, 0.0, dz - over / 2), (dx - 0.03, 2 * gap, over), skin))
    return parts


def _corner(piece: Furniture, draw: Materials) -> Parts:
    """Two walls that meet at the left of the back; skirting of another shade."""
    dx, dy, dz = piece.size
    thick, one, other, skirting = 0.14, draw.wall(), draw.wall(), draw.plain(0.1, 0.9)
    return [
        box((-dx / 2 + thick / 2, 0.0, dz / 2), (thick, dy, dz), one),
        box((thick / 2, dy / 2 - thick / 2, dz / 2), (dx - thick, thick, dz), other),
        box((-dx / 2 + thick + 0.006, -thick / 2, 0.05), (0.012, dy - thick, 0.1), skirting),
        box((thick / 2, dy / 2 - thick - 0.006, 0.05), (dx - thick, 0.012, 0.1), skirting),
    ]


def _pier(piece: Furniture, draw: Materials) -> Parts:
    """A part of the wall that stands out, such as a chimney."""
    dx, dy, dz = piece.size
    parts = [box((0.0, 0.0, dz / 2), (dx, dy, dz), draw.wall())]
    if draw.chance(0.5):
        parts.append(box((0.0, 0.0, 0.05), (dx + 0.02, dy + 0.02, 0.1), draw.plain(0.1, 0.9)))
    if draw.chance(0.3):
        # Edges are protected by a rail.
        rail = draw.metal()
        parts += [box((dx / 2, s * dy / 2, 0.7), (0.05, 0.05, 1.4), rail) for s in (-1, 1)]
    return parts


def _window(piece: Furniture, draw: Materials) -> Parts:
    """A window with its frame and sill; blinds, bars or daylight alone."""
    dx, dy, dz = piece.size
    frame, sill = draw.plain(0.1, 0.9), draw.board()
    pane = draw.atlas.add(textures.blinds(draw.rng, draw.contrast))
    back = -dx / 2
    parts = [
        quad(np.array([back + 0.03, -dy / 2, 0.0]), np.array([0.0, dy, 0.0]),
             np.array([0.0, 0.0, dz]), pane),
        *(box((back + 0.03, s * (dy / 2 - 0.03), dz / 2), (0.06, 0.06, dz), frame)
          for s in (-1, 1)),
        *(box((back + 0.03, 0.0, z), (0.06, dy, 0.06), frame) for z in (0.05, dz - 0.03)),
        box((0.0, 0.0, 0.015), (dx, dy + 0.1, 0.03), sill),
    ]  # fmt: skip
    if draw.chance(0.6):
        parts.append(box((back + 0.035, 0.0, dz / 2), (0.06, 0.07, dz), frame))
    if draw.chance(0.4):
        parts += _things_on((0.1, dy), 0.03, draw, int(draw.rng.integers(1, 4)))
    return parts


def _radiator(piece: Furniture, draw: Materials) -> Parts:
    """Ribs or plates over their pipes."""
    dx, dy, dz = piece.size
    paint, low = draw.plain(0.5, 0.9), 0.12
    parts = [
        box((-0.02, s * (dy / 2 - 0.08), low / 2), (0.025, 0.025, low), paint) for s in (-1, 1)
    ]
    ribs = max(4, round(dy / float(draw.rng.choice([0.05, 0.09]))))
    for y in (np.arange(ribs) + 0.5) / ribs * dy - dy / 2:
        parts.append(box((0.0, float(y), (low + dz) / 2), (dx, 0.6 * dy / ribs, dz - low), paint))
    parts.append(box((0.0, 0.0, (low + dz) / 2), (0.4 * dx, dy, 0.9 * (dz - low)), paint))
    return parts


# -------------------------------------------------------------------------------- storage ----


def _things_on(area: tuple[float, float], z: float, draw: Materials, count: int) -> Parts:
    """Boxes, stacks, bottles and lamps within an area around the middle [m], at the height z."""
    parts: Parts = []
    for _ in range(count):
        x, y = draw.between(-0.4, 0.4) * area[0], draw.between(-0.45, 0.45) * area[1]
        kind = str(draw.rng.choice(["box", "stack", "bottle", "cup", "plant"]))
        if kind == "bottle":
            tall, skin = draw.between(0.2, 0.34), draw.plain()
            parts += [
                cylinder((x, y, z), 0.7 * tall, 0.04, skin, segments=10),
                cylinder((x, y, z + 0.7 * tall), 0.3 * tall, 0.035, skin, top_radius=0.014,
                         segments=10),
            ]  # fmt: skip
        elif kind == "cup":
            parts.append(cylinder((x, y, z), draw.between(0.08, 0.12), 0.04, draw.plain(),
                                  segments=10))  # fmt: skip
        elif kind == "stack":
            level = z
            for _ in range(int(draw.rng.integers(2, 6))):
                tall = draw.between(0.015, 0.06)
                edges = (draw.between(0.16, 0.22), draw.between(0.22, 0.3), tall)
                parts.append(box((x, y, level + tall / 2), edges, draw.plain(),
                                 yaw=draw.between(-0.3, 0.3)))  # fmt: skip
                level += tall
        elif kind == "plant":
            parts += [
                cylinder((x, y, z), 0.13, 0.05, draw.plain(), top_radius=0.07, segments=10),
                ellipsoid(np.array([x, y, z + 0.24]), np.eye(3), (0.11, 0.11, 0.15),
                          draw.atlas.add(textures.leaves(draw.rng, 0.2, draw.contrast))),
            ]  # fmt: skip
        else:
            edges = (draw.between(0.1, 0.25), draw.between(0.12, 0.35), draw.between(0.06, 0.35))
            skin = draw.sheet(0.3, 0.3) if draw.chance(0.5) else draw.plain()
            parts.append(box((x, y, z + edges[2] / 2), edges, skin, yaw=draw.between(-0.5, 0.5)))
    return parts


def _wardrobe(piece: Furniture, draw: Materials) -> Parts:
    """A cupboard with plinth, cornice, two doors with a gap between them, and handles."""
    dx, dy, dz = piece.size
    body, front, dark, metal = draw.board(), draw.board(), draw.plain(0.03, 0.06), draw.metal()
    low, half = 0.08, dy / 2
    leaf = half - 0.02
    parts = [
        box((-0.01, 0.0, (low + dz) / 2), (dx - 0.02, dy, dz - low), body),
        box((-0.03, 0.0, low / 2), (dx - 0.06, dy - 0.06, low), dark),
        box((dx / 2 - 0.012, 0.0, (low + dz) / 2), (0.01, dy - 0.02, dz - low - 0.04), dark),
        *(box((dx / 2, s * (leaf / 2 + 0.006), (low + dz) / 2), (0.02, leaf, dz - low - 0.06),
              front) for s in (-1, 1)),
        *(box((dx / 2 + 0.02, s * 0.05, 0.55 * dz), (0.02, 0.015, 0.16), metal) for s in (-1, 1)),
    ]  # fmt: skip
    if draw.chance(0.5):
        parts.append(box((0.01, 0.0, dz - 0.02), (dx + 0.04, dy + 0.05, 0.04), body))
    if draw.chance(0.5):
        parts += _things_on((dx, dy), dz, draw, int(draw.rng.integers(1, 4)))
    return parts


def _rack(piece: Furniture, draw: Materials) -> Parts:
    """Open shelves on four posts, through which the wall is seen, with things on them."""
    dx, dy, dz = piece.size
    post, shelf = draw.metal(), draw.board()
    parts = [
        box((sx * (dx / 2 - 0.02), sy * (dy / 2 - 0.02), dz / 2), (0.035, 0.035, dz), post)
        for sx in (-1, 1)
        for sy in (-1, 1)
    ]
    levels = int(draw.rng.integers(3, 6))
    for z in np.linspace(0.12, dz - 0.05, levels):
        parts.append(box((0.0, 0.0, float(z)), (dx, dy, 0.025), shelf))
        parts += _things_on((dx, dy), float(z) + 0.0125, draw, int(draw.rng.integers(0, 5)))
    return parts


# ------------------------------------------------------------------------ chairs and desks ----


def _office_chair(piece: Furniture, draw: Materials) -> Parts:
    """A swivel chair with a high back, often with arms, sometimes with a jacket over the back."""
    dx, _, dz = piece.size
    cloth, plastic = draw.cloth(), draw.metal()
    seat, wide = 0.48, draw.between(0.44, 0.52)
    turned = draw.between(-math.pi, math.pi)
    star = [
        beam((0.0, 0.0, 0.09), (0.45 * dx * math.cos(a), 0.45 * dx * math.sin(a), 0.06), 0.05, 0.04,
             plastic)
        for a in turned + np.arange(5) * 0.4 * math.pi
    ]  # fmt: skip
    castors = [
        cylinder((0.45 * dx * math.cos(a), 0.45 * dx * math.sin(a), 0.0), 0.06, 0.025, plastic,
                 segments=8)
        for a in turned + np.arange(5) * 0.4 * math.pi
    ]  # fmt: skip
    # The back: straight or narrower on top, bent about z and tilted back.
    z = np.linspace(seat + 0.08, dz, 7)
    narrow = draw.between(0.55, 1.0)
    half = 0.5 * wide * np.interp(z, [z[0], z[0] + 0.25, dz], [0.9, 1.0, narrow])
    back = np.stack([-0.22 - 0.12 * (z - z[0]), 0 * z, z], axis=1)
    side, front = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
    parts = [
        *star, *castors,
        cylinder((0.0, 0.0, 0.08), seat - 0.1, 0.03, plastic, segments=8),
        box((0.02, 0.0, seat), (0.48, wide, 0.08), cloth),
        beam((-0.2, 0.0, seat - 0.02), (-0.24, 0.0, seat + 0.2), 0.07, 0.02, plastic),
        loft(back, side, front, half, np.full(7, 0.035), cloth, segments=16, power=4.0,
             round_ends=(0.01, 0.02)),
    ]  # fmt: skip
    if draw.chance(0.6):
        for s in (-1, 1):
            y = s * (wide / 2 + 0.03)
            parts += [
                box((-0.02, y, seat + 0.1), (0.03, 0.03, 0.2), plastic),
                box((0.02, y, seat + 0.21), (0.26, 0.06, 0.03), plastic),
            ]
    if draw.chance(0.3):
        top = np.array([-0.22 - 0.12 * (dz - z[0]), 0.0, dz])
        parts.append(_hung_coat(top, 0.0, dz - 0.35, draw, width=0.5 * wide + 0.02, depth=0.07))
    return parts


def _monitor(x: float, y: float, z: float, yaw: float, draw: Materials) -> Mesh:
    """A monitor on its foot, which stands at the height z."""
    wide, tall = draw.between(0.42, 0.68), draw.between(0.27, 0.40)
    shell, picture = draw.plain(0.03, 0.25), draw.atlas.add(textures.screen(draw.rng, wide, tall))
    middle = draw.between(0.10, 0.18) + tall / 2
    return merge(
        [
            box((0.0, 0.0, middle), (0.045, wide + 0.03, tall + 0.03), shell),
            quad(np.array([0.024, -wide / 2, middle - tall / 2]), np.array([0.0, wide, 0.0]),
                 np.array([0.0, 0.0, tall]), picture),
            box((-0.04, 0.0, middle / 2), (0.03, 0.07, middle), shell),
            box((0.0, 0.0, 0.01), (0.2, 0.26, 0.02), shell),
        ]
    ).placed(x, y, yaw, z)  # fmt: skip


def _workplace(piece: Furniture, draw: Materials) -> Parts:
    """A desk with monitors that look to either side, a computer, a lamp, bottles and stacks."""
    dx, dy, dz = piece.size
    top, leg = draw.board(), draw.metal()
    parts = [
        box((0.0, 0.0, dz - 0.015), (dx, dy, 0.03), top),
        *(box((sx * (dx / 2 - 0.05), sy * (dy / 2 - 0.05), dz / 2), (0.05, 0.05, dz), leg)
          for sx in (-1, 1) for sy in (-1, 1)),
    ]  # fmt: skip
    places = draw.rng.permutation(np.linspace(-0.36, 0.36, 4)) * dy
    for k in range(int(draw.rng.integers(1, 4))):
        yaw = draw.between(-0.5, 0.5) + (math.pi if draw.chance(0.5) else 0.0)
        parts.append(_monitor(draw.between(-0.2, 0.1) * dx, float(places[k]), dz, yaw, draw))
    shell, y = draw.plain(0.04, 0.7), float(places[3])
    if draw.chance(0.6):
        # A tower on the desk, or under it.
        z = dz if draw.chance(0.6) else 0.02
        parts.append(box((0.0, y, z + 0.22), (0.45, 0.19, 0.44), shell))
    elif draw.chance(0.6):
        parts += [
            cylinder((0.1, y, dz), 0.025, 0.1, leg, segments=12),
            beam((0.1, y, dz + 0.02), (-0.05, y, dz + 0.38), 0.02, 0.02, leg),
            beam((-0.05, y, dz + 0.38), (0.15, y + 0.05, dz + 0.5), 0.02, 0.02, leg),
            cylinder((0.17, y + 0.05, dz + 0.42), 0.1, 0.09, shell, top_radius=0.03, segments=12),
        ]
    parts.append(box((0.22 * dx, 0.0, dz + 0.012), (0.15, 0.44, 0.024), draw.plain(0.03, 0.8)))
    parts += _things_on((dx, dy), dz, draw, int(draw.rng.integers(2, 8)))
    if draw.chance(0.5):
        parts.append(box((-dx / 2 + 0.03, 0.0, 0.45), (0.02, dy - 0.1, 0.5), draw.board()))
    return parts


def _covered_table(piece: Furniture, draw: Materials) -> Parts:
    """A blanket over a table: it hangs in folds to an uneven hem; something may be under it."""
    dx, dy, dz = piece.size
    cloth = draw.cloth()
    parts = [_blanket((dx, dy), dz, draw.between(0.02, 0.4) * dz, cloth, draw)]
    if draw.chance(0.6):
        size = (draw.between(0.4, 0.7) * dx, draw.between(0.25, 0.5) * dy)
        lump = _blanket(size, draw.between(0.15, 0.5), 0.0, cloth, draw)
        parts.append(lump.placed(0.0, draw.between(-0.2, 0.2) * dy, draw.between(-0.3, 0.3), dz))
    leg = draw.metal()
    parts += [
        box((sx * (dx / 2 - 0.12), sy * (dy / 2 - 0.14), dz / 2), (0.05, 0.05, dz - 0.02), leg)
        for sx in (-1, 1)
        for sy in (-1, 1)
    ]
    return parts


def _blanket(
    size: tuple[float, float], top: float, hem: float, cloth: int, draw: Materials
) -> Mesh:
    """A cloth over a block of that size x, y and height, which hangs down to the height `hem`."""
    columns, rows = 72, 8
    angle = np.linspace(0.0, 2 * math.pi, columns + 1)
    cos, sin = np.cos(angle), np.sin(angle)
    # A rectangle with round corners: a superellipse.
    ring = (
        np.stack(
            [
                np.sign(cos) * np.abs(cos) ** 0.3 * size[0],
                np.sign(sin) * np.abs(sin) ** 0.3 * size[1],
            ],
            axis=1,
        )
        / 2.0
    )
    folds = sum(
        draw.between(0.2, 1.0) * np.sin(k * angle + draw.between(0.0, 6.3)) for k in (5, 9, 14)
    )
    uneven = sum(draw.between(-1, 1) * np.sin(k * angle + draw.between(0, 6.3)) for k in (1, 2, 3))
    down = np.linspace(0.0, 1.0, rows)[:, np.newaxis]
    low = np.clip(hem + 0.12 * (top - hem) * uneven, 0.0, 0.9 * top)
    grow = 1.0 + down * (0.05 + 0.035 * folds) * min(1.0, (top - hem) / 0.5)
    points = np.empty((rows + 2, columns + 1, 3))
    points[2:, :, :2] = ring * grow[..., np.newaxis]
    points[2:, :, 2] = top - down * (top - low)
    points[:2, :, :2] = ring * np.array([0.0, 0.5])[:, np.newaxis, np.newaxis]
    points[:2, :, 2] = top
    return sheet_mesh(points, cloth)


# ---------------------------------------------------------------------- cloth that hangs ----


def _curtain(piece: Furniture, draw: Materials) -> Parts:
    """A curtain in folds below its rail, spread or drawn aside."""
    dx, dy, dz = piece.size
    columns = max(24, round(dy / 0.02))
    y = np.linspace(-dy / 2, dy / 2, columns)
    z = np.linspace(dz - 0.03, draw.between(0.01, 0.12), 8)[:, np.newaxis]
    wave, phase = draw.between(0.10, 0.22), draw.between(0.0, 6.3)
    deep = 0.48 * dx * draw.between(0.4, 1.0)
    fold = np.sin(2 * np.pi * y / wave + phase) + 0.4 * np.sin(5.3 * y / wave + 2 * phase)
    # It is gathered on top, and often tied together at the height of a hand.
    tied = np.ones((8, 1))
    if draw.chance(0.35):
        tied = 1.0 - draw.between(0.2, 0.5) * np.exp(-(((z - 1.05) / 0.35) ** 2))
    points = np.stack(
        [
            np.broadcast_to(deep * fold / 1.4 * (0.5 + 0.5 * (1 - z / dz)), (8, columns)),
            y * tied + 0 * z,
            np.broadcast_to(z, (8, columns)),
        ],
        axis=2,
    )
    rail = beam((0.0, -dy / 2 - 0.05, dz - 0.015), (0.0, dy / 2 + 0.05, dz - 0.015), 0.03, 0.03,
                draw.metal())  # fmt: skip
    return [sheet_mesh(points, draw.cloth()), rail]


def _hung_coat(
    hook: NDArray, yaw: float, hem: float, draw: Materials, *, width: float, depth: float
) -> Mesh:
    """A coat or jacket that hangs from a hook [m] down to the height `hem`, facing `yaw`."""
    cloth, top = draw.cloth(), float(hook[2])
    side = np.array([-math.sin(yaw), math.cos(yaw), 0.0])
    front = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    t = np.array([0.0, 0.06, 0.14, 0.35, 0.6, 0.85, 1.0])
    z = top - t * (top - hem)
    wide = width * np.array([0.25, 0.75, 1.0, 0.92, 0.88, 1.0, 1.05])
    thick = depth * np.array([0.5, 0.9, 1.0, 1.0, 0.95, 1.05, 1.1])
    centres = np.array([hook[0], hook[1], 0.0]) + z[:, np.newaxis] * [0.0, 0.0, 1.0]
    bumps = 0.08 * np.clip(draw.rng.normal(0.0, 1.0, (7, 16)), -1.5, 1.5)
    parts = [loft(centres, side, front, wide, thick, cloth, segments=16, power=2.4, bumps=bumps)]
    for s in (-1.0, 1.0):
        shoulder = centres[2] + s * 0.92 * width * side
        cuff = shoulder + 0.06 * s * side + np.array([0.0, 0.0, -0.55 * (top - hem) - 0.1])
        points = np.array([shoulder, 0.5 * (shoulder + cuff) + 0.02 * s * side, cuff])
        if hem < cuff[2]:
            parts.append(tube(points, np.array([0.07, 0.06, 0.05]), front, cloth, rings=6))
    return merge(parts)


def _coat_on_stand(piece: Furniture, draw: Materials) -> Parts:
    """A stand with one coat on a hanger, as broad as a person's; a hat may be on top."""
    dx, _, dz = piece.size
    metal = draw.metal()
    hook = np.array([0.0, 0.0, dz - 0.12])
    coat = _hung_coat(
        hook, draw.between(-math.pi, math.pi), dz - draw.between(0.85, 1.25), draw,
        width=dx * draw.between(0.4, 0.5), depth=draw.between(0.08, 0.12),
    )  # fmt: skip
    parts = [
        cylinder((0.0, 0.0, 0.0), dz - 0.02, 0.018, metal, segments=8),
        cylinder((0.0, 0.0, 0.0), 0.025, dx / 2, metal),
        coat,
    ]
    if draw.chance(0.4):
        axes, cloth = np.eye(3), draw.cloth()
        parts += [
            ellipsoid(np.array([0.0, 0.0, dz - 0.02]), axes, (0.15, 0.15, 0.02), cloth),
            ellipsoid(np.array([0.0, 0.0, dz]), axes, (0.09, 0.09, 0.1), cloth),
        ]
    return parts


def _coat_hooks(piece: Furniture, draw: Materials) -> Parts:
    """Coats on hooks along a wall."""
    dx, dy, dz = piece.size
    parts = [box((-dx / 2 + 0.015, 0.0, dz - 0.06), (0.03, dy, 0.12), draw.board())]
    count = int(draw.rng.integers(1, 4))
    for y in draw.rng.permutation(np.linspace(-1.0, 1.0, 4))[:count] * (dy / 2 - 0.22):
        hook = np.array([-dx / 2 + 0.1, float(y), dz - 0.05])
        parts.append(
            _hung_coat(hook, 0.0, dz - draw.between(0.7, 1.2), draw,
                       width=draw.between(0.1, 0.18), depth=draw.between(0.06, 0.1))
        )  # fmt: skip
    # A bench or a box for shoes below reaches the floor.
    parts.append(box((-dx / 2 + 0.1, 0.0, 0.2), (0.2, 0.8 * dy, 0.4), draw.board()))
    return parts


# ------------------------------------------------------------------------- what stands about ----


def _ladder(piece: Furniture, draw: Materials) -> Parts:
    """A step ladder, or one that leans against the wall behind it."""
    dx, dy, dz = piece.size
    metal = draw.metal()
    leans = draw.chance(0.3)
    foot, head = dx / 2, -dx / 2 + 0.03 if leans else 0.0
    parts: Parts = []
    for s in (-1, 1):
        low, high = (foot, s * (dy / 2 - 0.02), 0.0), (head, s * (0.4 * dy - 0.02), dz)
        parts.append(beam(low, high, 0.03, 0.07, metal))
        if not leans:
            behind = (-dx / 2, s * (dy / 2 - 0.02), 0.0)
            parts.append(beam(behind, (-0.03, high[1], dz - 0.08), 0.025, 0.04, metal))
    for z in np.arange(0.25, dz - 0.05, 0.25):
        x = foot + (head - foot) * z / dz
        half = dy / 2 - 0.03 - 0.1 * dy * z / dz
        deep = 0.035 if leans else 0.09
        parts.append(box((float(x), 0.0, float(z)), (deep, 2 * float(half), 0.03), metal))
    if not leans:
        parts.append(box((0.0, 0.0, dz), (0.25, 0.8 * dy, 0.03), draw.plain()))
        parts.append(box((-0.28 * dx, 0.0, 0.5 * dz), (0.02, 0.85 * dy, 0.03), metal))
    return parts


def _whiteboard(piece: Furniture, draw: Materials) -> Parts:
    """A board on two posts, or on one in the middle, with feet; written on or empty."""
    dx, dy, dz = piece.size
    tall = draw.between(0.85, 1.1)
    frame, foot = draw.metal(), draw.metal()
    sheet = draw.atlas.add(textures.writing(draw.rng, dy, tall))
    middle = dz - tall / 2
    parts = [
        box((0.0, 0.0, middle), (0.025, dy, tall), draw.plain(0.4, 0.9)),
        *(
            quad(np.array([s * 0.014, -s * (dy / 2 - 0.02), dz - tall + 0.02]),
                 np.array([0.0, s * (dy - 0.04), 0.0]), np.array([0.0, 0.0, tall - 0.04]), sheet)
            for s in (-1, 1)
        ),
        *(box((0.0, 0.0, z), (0.035, dy + 0.02, 0.03), frame) for z in (dz - tall, dz)),
        box((0.05, 0.0, dz - tall), (0.08, 0.5 * dy, 0.02), frame),
    ]  # fmt: skip
    for y in (0.0,) if draw.chance(0.25) else (-0.46 * dy, 0.46 * dy):
        parts += [
            box((-0.03, y, (dz - 0.05) / 2), (0.04, 0.06, dz - 0.05), foot),
            box((0.0, y, 0.05), (dx, 0.06, 0.04), foot),
            *(cylinder((s * (dx / 2 - 0.03), y, 0.0), 0.05, 0.025, foot, segments=8)
              for s in (-1, 1)),
        ]  # fmt: skip
    return parts


def _water_cooler(piece: Furniture, draw: Materials) -> Parts:
    """A cabinet as broad as a trunk with a bottle on it."""
    dx, dy, dz = piece.size
    body, high = draw.plain(0.3, 0.9), dz - 0.4
    bottle, dark = draw.plain(0.3, 0.7), draw.plain(0.03, 0.08)
    return [
        box((0.0, 0.0, high / 2), (dx, dy, high), body),
        box((dx / 2, 0.0, high - 0.22), (0.02, 0.7 * dy, 0.22), dark),
        cylinder((0.0, 0.0, high), 0.06, 0.05, bottle, top_radius=0.13, segments=14),
        cylinder((0.0, 0.0, high + 0.06), 0.34, 0.135, bottle, segments=14),
    ]


MAKERS: dict[str, Callable[[Furniture, Materials], Parts]] = {
    "door": _door,
    "doorway": _doorway,
    "corner": _corner,
    "pier": _pier,
    "wardrobe": _wardrobe,
    "rack": _rack,
    "office_chair": _office_chair,
    "workplace": _workplace,
    "covered_table": _covered_table,
    "curtain": _curtain,
    "coat_on_stand": _coat_on_stand,
    "coat_hooks": _coat_hooks,
    "ladder": _ladder,
    "whiteboard": _whiteboard,
    "radiator": _radiator,
    "window": _window,
    "water_cooler": _water_cooler,
}

"""The robots as solid bodies: a drive, a mast or column, a head with lenses."""

from __future__ import annotations

import numpy as np

from mrs_people_sim.models import textures
from mrs_people_sim.models.meshes import Mesh, box, cylinder, merge
from mrs_people_sim.models.textures import Atlas
from mrs_people_sim.scene import Robot, StereoHead


def robot_mesh(robot: Robot, head: StereoHead, rng: np.random.Generator, atlas: Atlas) -> Mesh:
    """A robot in its base_link, to be placed; nothing for the body `none`.

    Args:
        robot: Says which body it has.
        head: Where its head is.
        rng: Source of randomness.
        atlas: Where the textures go.
    """
    if robot.body == "none":
        return merge([])
    shell = atlas.add(textures.plain(rng, float(rng.uniform(0.1, 0.8)), 3.0))
    metal = atlas.add(textures.plain(rng, 0.55))
    dark = atlas.add(textures.plain(rng, 0.05))
    panel = atlas.add(textures.screen(rng, 0.3, 0.2))
    x, y, z = head.forward, head.left, head.height
    wide = head.baseline + 0.08
    parts = [
        cylinder((0, 0, 0.05), 0.22, 0.24, shell),
        cylinder((0, 0, 0.0), 0.06, 0.20, dark),
        box((0.0, 0.0, 0.33), (0.30, 0.26, 0.12), dark),
    ]
    if robot.body == "column":
        top = max(0.6, z - 0.10)
        parts += [
            cylinder((0, 0, 0.27), top - 0.27, 0.17, shell, top_radius=0.13),
            box((0.15, 0.0, 0.62 * top), (0.02, 0.3, 0.2), panel),
        ]
    else:
        parts += [
            cylinder((0, 0, 0.27), max(0.2, z - 0.3), 0.03, metal),
            box((0.02, 0.0, 0.55), (0.22, 0.24, 0.16), shell),
            box((x / 2, y / 2, z - 0.06), (abs(x) + 0.05, abs(y) + 0.05, 0.03), metal),
        ]
    # The lenses look out of the front of the head; `left` is the reference.
    parts.append(box((x - 0.04, y - head.baseline / 2, z), (0.07, wide, 0.06), dark, yaw=head.yaw))
    if head.top:
        parts.append(box((x - 0.04, y, z + head.top / 2), (0.07, 0.06, abs(head.top) + 0.06), dark))
    return merge(parts)

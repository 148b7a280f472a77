"""Sonars and laser scanners: ranges in a plane, from outlines of what stands at their height.

Everything solid is line segments in the map, x0, y0, x1, y1 [m], shape (n, 4); people and other
robots are circles x, y, radius [m], shape (m, 3).

A sonar's echo comes from where a surface is perpendicular to the sound, and from edges; a smooth
wall that is turned away reflects the sound elsewhere (regions of constant depth: Leonard and
Durrant-Whyte, Directed Sonar Sensing for Mobile Robot Navigation, 1992).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.geometry import rotation_2d
from mrs_people_sim.models.meshes import Mesh
from mrs_people_sim.scene import Laser, Sonar

Rng = np.random.Generator

#: What stands this much nearer on the way to a point hides it [m].
_HIDES = 1e-6
#: A person at the height of hips: circles across, where [m], of this radius [m].
_HIPS, _HIP_RADIUS = (-0.1, 0.0, 0.1), 0.13
#: Pieces of an outline whose direction differs by less are one [rad], if they touch [m].
_STRAIGHT, _TOUCH = 1e-4, 1e-4


def sonar_ranges(
    segments: NDArray,
    circles: NDArray,
    pose: Sequence[float],
    sonars: Sequence[Sonar],
    rng: Rng,
) -> NDArray:
    """What a robot's sonars measure when they fire together, as in sensor_msgs/Range.

    Args:
        segments: Outlines in the map [m], shape (n, 4).
        circles: People and other robots in the map [m], shape (m, 3).
        pose: x, y [m] and yaw [rad] of the robot's base_link in the map.
        sonars: Where they are and what they can.
        rng: Source of randomness.

    Returns:
        Ranges [m], inf where there is no echo, -inf where it is nearer than `min_range`, shape
        (sonars,).
    """
    if not sonars:
        return np.empty(0)
    ranges = np.full(len(sonars), np.inf)
    echoes = _echoes(segments, circles, pose, sonars)
    for k, (sonar, (chance, distance)) in enumerate(zip(sonars, echoes, strict=True)):
        heard = rng.random(len(chance)) < chance
        nearest = float(distance[heard].min(initial=np.inf))
        if nearest > sonar.max_range or rng.random() < sonar.dropout:
            nearest = np.inf
        if len(sonars) > 1 and rng.random() < sonar.cross_talk:
            # The sound of another sonar comes first.
            nearest = rng.uniform(0.0, min(nearest, sonar.max_range))
        if nearest < np.inf:
            nearest += rng.normal() * math.hypot(sonar.least_noise, sonar.noise * nearest)
        ranges[k] = -np.inf if nearest < sonar.min_range else nearest
    return ranges


def _echoes(
    segments: NDArray, circles: NDArray, pose: Sequence[float], sonars: Sequence[Sonar]
) -> list[tuple[NDArray, NDArray]]:
    """Points that may send an echo back: by sonar, their chances and distances [m], in no order."""
    origins, axes = zip(*(_in_map(pose, one.x, one.y, one.yaw) for one in sonars), strict=True)
    origin, axis = np.array(origins)[:, None], np.array(axes)[:, None]
    start, end = segments[:, :2], segments[:, 2:]
    way = end - start
    length = np.maximum((way**2).sum(axis=1), 1e-12)
    along = ((origin - start) * way).sum(axis=2) / length
    feet = start + along[:, :, None] * way
    middle = circles[:, :2] - origin
    away = np.hypot(middle[:, :, 0], middle[:, :, 1])
    surface = origin + middle * (1.0 - circles[:, 2] / np.maximum(away, 1e-9))[:, :, None]
    ends = np.broadcast_to(np.concatenate([start, end]), (len(sonars), 2 * len(start), 2))
    offset = np.concatenate([feet, ends, surface], axis=1) - origin
    distance = np.hypot(offset[:, :, 0], offset[:, :, 1])
    off_axis = np.abs(_wrapped(np.arctan2(offset[:, :, 1], offset[:, :, 0]) - axis))
    inside = away < circles[:, 2]  # the sonar touches somebody
    distance[:, 3 * len(start) :][inside] = 0.0
    off_axis[:, 3 * len(start) :][inside] = 0.0
    exists = np.ones(distance.shape, dtype=bool)
    exists[:, : len(start)] = (along > 0) & (along < 1)
    of_kind = np.array([(1.0, one.edge_echo, one.cloth_echo) for one in sonars])
    chance = np.repeat(of_kind, [len(way), 2 * len(way), len(circles)], axis=1)
    # Full in the cone, none beyond the limit, and in between for the side lobes.
    limits = [(one.field_of_view / 2, one.specular_limit, one.max_range) for one in sonars]
    cone, limit, most = np.array(limits).T[:, :, None]
    chance *= np.clip((limit - off_axis) / np.maximum(limit - cone, 1e-9), 0.0, 1.0)
    chance *= (off_axis <= np.maximum(limit, 0.0)) & (distance <= most) & exists
    which, _ = audible = np.nonzero(chance)
    unit = offset[audible] / np.maximum(distance[audible], 1e-9)[:, None]
    clear = cast(origin[which, 0], unit, segments, circles) >= distance[audible] - _HIDES
    chance[audible] *= clear
    return [
        (p[there], away[there]) for p, away, there in zip(chance, distance, exists, strict=True)
    ]


def laser_ranges(
    segments: NDArray, circles: NDArray, pose: Sequence[float], laser: Laser, rng: Rng
) -> NDArray:
    """What a robot's laser scanner measures, as in sensor_msgs/LaserScan.

    Args:
        segments: Outlines in the map [m], shape (n, 4).
        circles: People and other robots in the map [m], shape (m, 3).
        pose: x, y [m] and yaw [rad] of the robot's base_link in the map.
        laser: Where it is and what it can.
        rng: Source of randomness.

    Returns:
        Ranges [m] at `laser_angles`, inf where nothing comes back, -inf where it is nearer than
        `min_range`, shape (laser.rays,).
    """
    origin, axis = _in_map(pose, laser.x, laser.y, laser.yaw)
    angles = axis + laser_angles(laser)
    ranges = cast(origin, np.stack([np.cos(angles), np.sin(angles)], axis=1), segments, circles)
    ranges += rng.normal(0.0, 1.0, len(ranges)) * laser.noise
    ranges[(ranges > laser.max_range) | (rng.random(len(ranges)) < laser.dropout)] = np.inf
    ranges[ranges < laser.min_range] = -np.inf
    return ranges


def laser_angles(laser: Laser) -> NDArray:
    """Directions of the rays from the scanner's x axis [rad], ascending, shape (laser.rays,)."""
    turn = laser.field_of_view / laser.rays  # a full turn has no ray twice
    return (np.arange(laser.rays) + 0.5) * turn - laser.field_of_view / 2


def people_circles(places: NDArray) -> NDArray:
    """Outlines of people as circles.

    Args:
        places: x, y [m] and yaw [rad] in the map; NaN for who is not there, shape (m, 3).

    Returns:
        Three side by side for each who is there, x, y, radius [m], shape (3 m', 3).
    """
    x, y, yaw = places[np.isfinite(places).all(axis=1)].T
    across = np.stack([-np.sin(yaw), np.cos(yaw)], axis=1)
    centres = np.stack([x, y], axis=1)[:, None] + np.array(_HIPS)[:, None] * across[:, None]
    centres = centres.reshape(-1, 2)
    return np.column_stack([centres, np.full(len(centres), _HIP_RADIUS)])


def outline_at(mesh: Mesh, height: float) -> NDArray:
    """What a horizontal plane cuts of a mesh: segments x0, y0, x1, y1 [m], shape (n, 4).

    Pieces of one straight line that touch are one segment, so that their joints are no edges.

    Args:
        mesh: In the map.
        height: Of the plane over the floor [m].
    """
    corners = mesh.vertices[mesh.triangles].astype(np.float64)  # (m, 3, 3)
    above = corners[:, :, 2] > height
    corners = corners[above.any(axis=1) & ~above.all(axis=1)]
    ends = np.roll(corners, -1, axis=1)
    rise = ends[:, :, 2] - corners[:, :, 2]
    crossed = (corners[:, :, 2] > height) != (ends[:, :, 2] > height)  # two of three edges
    share = (height - corners[:, :, 2]) / np.where(crossed, rise, 1.0)
    points = corners[:, :, :2] + share[:, :, None] * (ends - corners)[:, :, :2]
    return _joined(points[crossed].reshape(-1, 4))


def _joined(segments: NDArray) -> NDArray:
    """The same without joints within a straight line."""
    way = segments[:, 2:] - segments[:, :2]
    length = np.hypot(way[:, 0], way[:, 1])
    segments, way, length = (a[length > _TOUCH] for a in (segments, way, length))
    if not len(segments):
        return segments
    # Lines in normal form, with the angle of the line in [0, pi).
    angle = np.arctan2(way[:, 1], way[:, 0]) % math.pi
    angle[angle > math.pi - _STRAIGHT / 2] = 0.0
    unit = np.stack([np.cos(angle), np.sin(angle)], axis=1)
    offset = segments[:, 1] * unit[:, 0] - segments[:, 0] * unit[:, 1]
    low, high = np.sort(np.einsum("nkj,nj->nk", segments.reshape(-1, 2, 2), unit), axis=1).T
    line = np.round(angle / _STRAIGHT) * 1e6 + np.round(offset / _TOUCH / 10)
    order = np.lexsort((low, line))
    joined: list[NDArray] = []
    reach = -np.inf
    last = None
    for k in order:
        if last is not None and line[k] == line[last] and low[k] <= reach + _TOUCH:
            reach = max(reach, high[k])
        else:
            last, reach = k, high[k]
            joined.append(np.empty(4))
            begin = low[k]
        normal = np.array([-unit[last, 1], unit[last, 0]]) * offset[last]
        joined[-1][:2], joined[-1][2:] = normal + begin * unit[last], normal + reach * unit[last]
    return np.array(joined)


def cast(origin: NDArray, directions: NDArray, segments: NDArray, circles: NDArray) -> NDArray:
    """Distance to the first thing on each ray, inf for none [m].

    Args:
        origin: Of the rays [m], shape (2,) or (r, 2).
        directions: Unit vectors, shape (r, 2).
        segments: Shape (n, 4).
        circles: Shape (m, 3).

    Returns:
        Shape (r,).
    """
    nearest = np.full(len(directions), np.inf)
    origin = np.atleast_2d(origin)[:, None]
    dx, dy = directions[:, :1], directions[:, 1:]
    if len(segments):
        way = segments[:, 2:] - segments[:, :2]
        x, y = np.moveaxis(segments[:, :2] - origin, 2, 0)
        across = dx * way[:, 1] - dy * way[:, 0]
        with np.errstate(divide="ignore", invalid="ignore"):
            at = (x * way[:, 1] - y * way[:, 0]) / across
            share = (x * dy - y * dx) / across
        hit = (at >= 0) & (share >= 0) & (share <= 1)  # parallel ones compare false or miss
        nearest = np.where(hit, at, np.inf).min(axis=1)
    if len(circles):
        x, y = np.moveaxis(circles[:, :2] - origin, 2, 0)
        ahead = dx * x + dy * y
        rest = x**2 + y**2 - circles[:, 2] ** 2
        depth = ahead**2 - rest
        first = ahead - np.sqrt(np.maximum(depth, 0.0))
        at = np.where(rest <= 0, 0.0, np.where((depth >= 0) & (ahead > 0), first, np.inf))
        nearest = np.minimum(nearest, at.min(axis=1))
    return nearest


def _in_map(pose: Sequence[float], x: float, y: float, yaw: float) -> tuple[NDArray, float]:
    """Place [m] and direction [rad] of a sensor of a robot in the map."""
    return np.asarray(pose[:2]) + rotation_2d(pose[2]) @ (x, y), pose[2] + yaw


def _wrapped(angle: NDArray) -> NDArray:
    return (angle + math.pi) % (2 * math.pi) - math.pi

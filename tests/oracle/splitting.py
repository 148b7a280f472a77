"""Clusters that are wider than a person, cut into as few parts as are no wider than one."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.config import Human, Splitting
from mrs_people_loc.team.fusion import ShortTermMap
from mrs_people_loc.team.poses import Pose
from oracle.arrays import Float
from oracle.numbers import MOST_PARTS, ROUNDS


@dataclass(frozen=True)
class _Cell:
    """A cell as it was seen.

    Attributes:
        xy: Its place [m].
        sight: Direction from the robot that saw it.
        smear: Variance of its range [m^2].
        points: Its points, one at least.
        weight: What they cover.
        top: Its top [m].
    """

    xy: Float
    sight: Float
    smear: float
    points: float
    weight: float
    top: float


def _seen(fused: ShortTermMap, i: int, poses: Mapping[str, Pose], range_sigma: float) -> _Cell:
    pose, xy = poses[fused.robots[fused.robot[i]]], fused.xy[i]
    dx, dy = float(xy[0]) - pose.x, float(xy[1]) - pose.y
    angle, squared = math.atan2(dy, dx), max(dx * dx + dy * dy, 1e-6)
    points = max(float(fused.cells.count[i]), 1.0)
    sight = np.array([math.cos(angle), math.sin(angle)])
    smear = (range_sigma * squared) ** 2
    return _Cell(xy, sight, smear, points, points * squared, float(fused.cells.top[i]))


def _centre(cells: Sequence[_Cell]) -> Float:
    return np.asarray(sum(c.weight * c.xy for c in cells) / sum(c.weight for c in cells))


def _spread(cells: Sequence[_Cell]) -> float:
    """Standard deviation along the sight or across it, whichever is larger [m]."""
    centre, total = _centre(cells), sum(c.weight for c in cells)
    along, across = 0.0, 0.0
    for c in cells:
        dx, dy = c.xy - centre
        along += c.weight * ((dx * c.sight[0] + dy * c.sight[1]) ** 2 - c.smear)
        across += c.weight * (dx * c.sight[1] - dy * c.sight[0]) ** 2
    return math.sqrt(max(along / total, across / total, 0.0))


def _is_person(cells: Sequence[_Cell], config: Human, *, people: int = 1) -> bool:
    tall = max(c.top for c in cells)
    enough = sum(c.points for c in cells) >= people * config.min_points
    return enough and config.min_height <= tall <= config.max_height


def split_of(
    fused: ShortTermMap,
    cells: Sequence[int],
    label: Sequence[int],
    poses: Mapping[str, Pose],
    config: Splitting,
    human: Human,
    range_sigma: float,
) -> tuple[list[int], int]:
    """Splits clusters; nobody is expected anywhere.

    Args:
        fused: The map.
        cells: Which of its cells were clustered.
        label: Their clusters.
        poses: By robot, where its cells were seen from.
        config: Parameters.
        human: Of these, the height and the points of a person.
        range_sigma: Standard deviation of a cell's range, per square of it [1/m].

    Returns:
        New labels, and how many clusters are too wide but stay whole.
    """
    if config.max_width <= 0:
        return list(label), 0
    # An even surface of a width has this standard deviation.
    limit = config.max_width / math.sqrt(12.0)
    seen = [_seen(fused, i, poses, range_sigma) for i in cells]
    labels, whole = list(label), 0
    for number in range(max(label, default=-1) + 1):
        mine = [k for k, of in enumerate(label) if of == number]
        inside = [seen[k] for k in mine]
        spread = _spread(inside)
        if not (spread > limit and _is_person(inside, human, people=2)):
            continue
        parts = _parts(inside, limit, max(2, int(spread / limit)), human)
        if parts is None:
            whole += 1
            continue
        fresh = max(labels) + 1
        for k, part in zip(mine, parts, strict=True):
            if part:
                labels[k] = fresh + part - 1
    return labels, whole


def _parts(cells: Sequence[_Cell], limit: float, first: int, human: Human) -> list[int] | None:
    """Part of each cell; None if the parts would not all be people, or too many."""
    most = min(MOST_PARTS, int(sum(c.points for c in cells) / human.min_points))
    for count in range(first, most + 1):
        parts = _begin(cells, count)
        if len(set(parts)) < count:
            continue
        for _ in range(ROUNDS):
            centres = [
                _centre([c for c, of in zip(cells, parts, strict=True) if of == part])
                for part in range(count)
            ]
            nearest = [
                min(range(count), key=lambda part, c=c: math.dist(c.xy, centres[part]))  # type: ignore[misc]
                for c in cells
            ]
            if nearest == parts:
                break
            parts = nearest
            if len(set(parts)) < count:
                return None
        groups = [
            [c for c, of in zip(cells, parts, strict=True) if of == part] for part in range(count)
        ]
        if all(_spread(group) <= limit for group in groups):
            return parts if all(_is_person(group, human) for group in groups) else None
    return None


def _begin(cells: Sequence[_Cell], count: int) -> list[int]:
    """Parts of equal weight along the long axis."""
    centre, total = _centre(cells), sum(c.weight for c in cells)
    scatter = sum(c.weight * np.outer(c.xy - centre, c.xy - centre) for c in cells)
    _, axes = np.linalg.eigh(scatter)
    order = sorted(range(len(cells)), key=lambda k: float((cells[k].xy - centre) @ axes[:, -1]))
    parts, before = [0] * len(cells), 0.0
    for k in order:
        share = (before + 0.5 * cells[k].weight) / total
        parts[k] = min(int(share * count), count - 1)
        before += cells[k].weight
    return parts

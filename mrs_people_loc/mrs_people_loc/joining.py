"""Joining: the bodies that several robots found, put together on the common map.

Each body is a place with a covariance that is long along the line of sight, so two robots that look
from different sides correct each other's ranges. Nearest first, in standard deviations, bodies of
different robots become one; what each robot says for and against a person there adds up.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc import config as cfg
from mrs_people_loc.fusion import ShortTermMap
from mrs_people_loc.geometry import Float
from mrs_people_loc.poses import Pose, pose_effect

Int = NDArray[np.intp]
Bool = NDArray[np.bool_]

#: No standard deviation is taken for smaller [m].
_LEAST_SIGMA = 0.01
#: ... and none for larger [m]: what a message says of its uncertainty may be anything.
_LARGEST_SIGMA = 100.0
#: A covariance with anything larger says nothing [m^2].
_USABLE = 1e12
#: A robot is looked for no farther along the line of sight than this [m].
_ROBOT_REACH = 0.8
#: One robot says no more against a person than this.
_LEAST_SCORE = -2.0


@dataclass(frozen=True)
class BodiesOnMap:
    """Bodies in the common frame, a struct of arrays of one length (n,).

    Attributes:
        of_cell: Body of each cell of the map; -1: of none, shape (cells,).
        robot: Which robot of the map saw it.
        xy: Its place [m], shape (n, 2).
        covariance: Of its place, the pose's part included [m^2], shape (n, 2, 2).
        score: Log-odds that it is a person.
    """

    of_cell: Int
    robot: Int
    xy: Float
    covariance: Float
    score: Float

    def __len__(self) -> int:
        """Number of bodies."""
        return len(self.robot)


def place_bodies(
    fused: ShortTermMap, poses: Mapping[str, Pose], *, line_of_sight: bool
) -> BodiesOnMap:
    """The bodies whose cells are on a map: each is where its cells' centre of gravity is.

    Args:
        fused: The map.
        poses: By robot, the pose that its cells were placed with.
        line_of_sight: Whether covariances are long along the line of sight; if not, they are round,
            of the same area.
    """
    cells = fused.cells
    of_cell = np.full(len(fused), -1, dtype=np.intp)
    mine = np.flatnonzero(cells.body)
    if not len(mine):
        places = np.empty((0, 2)), np.empty((0, 2, 2))
        return BodiesOnMap(of_cell, np.empty(0, np.intp), *places, np.empty(0))
    key = fused.robot[mine].astype(np.int64) << 32 | cells.body[mine].astype(np.int64)
    _, first, number = np.unique(key, return_index=True, return_inverse=True)
    of_cell[mine] = number
    count = len(first)
    weight = np.maximum(cells.count[mine].astype(np.float64), 1.0)
    total = np.bincount(number, weight, minlength=count)
    xy = np.stack(
        [np.bincount(number, weight * fused.xy[mine, k], minlength=count) / total for k in (0, 1)],
        axis=1,
    )
    first = mine[first]
    robot = fused.robot[first]
    along, across = (
        np.clip(sigma[first].astype(np.float64), _LEAST_SIGMA, _LARGEST_SIGMA) ** 2
        for sigma in (cells.sigma_range, cells.sigma_across)
    )
    if not line_of_sight:
        along = across = np.sqrt(along * across)
    robots = [poses[name] for name in fused.robots]
    origin = np.array([(pose.x, pose.y) for pose in robots]).reshape(-1, 2)
    sight = _units(xy - origin[robot])
    outer = sight[:, :, np.newaxis] * sight[:, np.newaxis]
    covariance = across[:, np.newaxis, np.newaxis] * (np.eye(2) - outer)
    covariance += along[:, np.newaxis, np.newaxis] * outer
    for index, pose in enumerate(robots):
        of_robot = robot == index
        covariance[of_robot] += pose_effect(pose, xy[of_robot])
    covariance = _bounded(covariance)
    return BodiesOnMap(of_cell, robot, xy, covariance, cells.score[first].astype(np.float64))


def _bounded(covariance: Float) -> Float:
    """Covariances with standard deviations between a least and a largest one, whatever came in."""
    largest = _LARGEST_SIGMA**2
    usable: Any = (np.abs(covariance) < _USABLE).all(axis=(1, 2))  # NaN compares false
    covariance = np.where(usable[:, np.newaxis, np.newaxis], covariance, largest * np.eye(2))
    values, vectors = np.linalg.eigh(covariance)
    values = np.clip(values, _LEAST_SIGMA**2, largest)
    return np.asarray((vectors * values[:, np.newaxis]) @ vectors.transpose(0, 2, 1))


def _units(vectors: Float) -> Float:
    """Vectors of length 1 in the same directions; (1, 0) where there is none, shape (n, 2)."""
    length = np.hypot(vectors[:, 0], vectors[:, 1])[:, np.newaxis]
    ahead = np.zeros_like(vectors)
    ahead[:, 0] = 1.0
    return np.where(length > 1e-9, vectors / np.maximum(length, 1e-9), ahead)


def are_robots(
    bodies: BodiesOnMap, fused: ShortTermMap, poses: Mapping[str, Pose], *, radius: float
) -> Bool:
    """Which bodies are other robots of the team, shape (n,).

    A robot is where its pose says; seen from another one it looks like a person. What is within its
    radius across the line of sight, and along it within the radius or 2.5 sigma (but no more than
    `_ROBOT_REACH`), is the robot.

    Args:
        bodies: The bodies.
        fused: Their map.
        poses: By robot, its pose in the common frame; also of those without cells.
        radius: Of a robot [m]; 0: robots are not told from people.
    """
    if not len(bodies):
        return np.empty(0, dtype=bool)
    known = list(poses)
    place = np.array([(poses[name].x, poses[name].y) for name in known]).reshape(-1, 2)
    index = {name: k for k, name in enumerate(known)}
    own = np.array([index[name] for name in fused.robots], dtype=np.intp)[bodies.robot]
    sight = _units(bodies.xy - place[own])
    offset = place - bodies.xy[:, np.newaxis]
    along = np.abs(np.einsum("nrk,nk->nr", offset, sight))
    across = np.abs(offset[..., 0] * sight[:, 1:] - offset[..., 1] * sight[:, :1])
    sigma = np.sqrt(np.einsum("nj,njk,nk->n", sight, bodies.covariance, sight))
    reach = np.maximum(radius, np.minimum(2.5 * sigma, _ROBOT_REACH))[:, np.newaxis]
    there = (across < radius) & (along < reach)
    there[np.arange(len(bodies)), own] = False
    return np.asarray(there.any(axis=1))


@dataclass(frozen=True)
class Joined:
    """What the bodies of all robots are together, a struct of arrays of one length (m,).

    Attributes:
        of_body: Which of them each body belongs to; -1: to none, it is a robot, shape (n,).
        xy: Place [m], shape (m, 2).
        covariance: Of the place [m^2], shape (m, 2, 2).
        score: Log-odds of being a person.
    """

    of_body: Int
    xy: Float
    covariance: Float
    score: Float

    def __len__(self) -> int:
        """How many they are."""
        return len(self.xy)


def join(bodies: BodiesOnMap, used: Bool, config: cfg.Joining) -> Joined:
    """Joins bodies of different robots that are near each other, nearest first.

    Args:
        bodies: The bodies.
        used: Which of them take part, shape (n,).
        config: Parameters.
    """
    index = np.flatnonzero(used)
    if not len(index):
        none = np.full(len(bodies), -1, dtype=np.intp)
        return Joined(none, np.empty((0, 2)), np.empty((0, 2, 2)), np.empty(0))
    groups = [
        _Group([int(i)], {int(bodies.robot[i])}, *_information(bodies.covariance[i], bodies.xy[i]))
        for i in index
    ]
    of = list(groups)
    xy, covariance = bodies.xy[index], bodies.covariance[index]
    offset = xy[:, np.newaxis] - xy
    total = covariance[:, np.newaxis] + covariance
    squared = _squared(offset, total)
    apart = bodies.robot[index][:, np.newaxis] != bodies.robot[index]
    near = np.hypot(offset[..., 0], offset[..., 1]) < config.max_distance
    one, other = np.nonzero(np.triu(apart & near & (squared < config.gate**2), 1))
    for k in np.argsort(squared[one, other], kind="stable"):
        a, b = of[one[k]], of[other[k]]
        if a is b or a.robots & b.robots:
            continue
        # Where one of them has grown already, it is its place that counts.
        if len(a.members) + len(b.members) > 2 and not a.is_near(b, config):
            continue
        a.take(b)
        for member in b.members:
            of[int(np.searchsorted(index, member))] = a
    unique = list({id(group): group for group in of}.values())
    of_body = np.full(len(bodies), -1, dtype=np.intp)
    for number, group in enumerate(unique):
        of_body[group.members] = number
    places = [group.place() for group in unique]
    scores = np.maximum(bodies.score, _LEAST_SCORE)
    return Joined(
        of_body=of_body,
        xy=np.array([place for place, _ in places]).reshape(-1, 2),
        covariance=np.array([matrix for _, matrix in places]).reshape(-1, 2, 2),
        score=np.array([scores[group.members].sum() for group in unique]),
    )


def _squared(offset: Float, covariance: Float) -> Float:
    """Squared Mahalanobis lengths; offset of shape (..., 2), covariance of shape (..., 2, 2)."""
    xx, xy, yy = covariance[..., 0, 0], covariance[..., 0, 1], covariance[..., 1, 1]
    x, y = offset[..., 0], offset[..., 1]
    return np.asarray((yy * x * x - 2.0 * xy * x * y + xx * y * y) / (xx * yy - xy * xy))


def _information(covariance: Float, xy: Float) -> tuple[float, float, float, float, float]:
    """Information matrix (xx, xy, yy) and vector (x, y) of a place."""
    xx, xy_, yy = float(covariance[0, 0]), float(covariance[0, 1]), float(covariance[1, 1])
    determinant = xx * yy - xy_ * xy_
    a, b, c = yy / determinant, -xy_ / determinant, xx / determinant
    x, y = float(xy[0]), float(xy[1])
    return a, b, c, a * x + b * y, b * x + c * y


@dataclass(eq=False)
class _Group:
    """Bodies that are one: who they are, and their information added."""

    members: list[int]
    robots: set[int]
    xx: float
    xy: float
    yy: float
    x: float
    y: float

    def place(self) -> tuple[tuple[float, float], list[list[float]]]:
        """Place and covariance."""
        determinant = self.xx * self.yy - self.xy * self.xy
        a, b, c = self.yy / determinant, -self.xy / determinant, self.xx / determinant
        return (a * self.x + b * self.y, b * self.x + c * self.y), [[a, b], [b, c]]

    def is_near(self, other: _Group, config: cfg.Joining) -> bool:
        """Whether the two may be one, where they are by now."""
        (x, y), mine = self.place()
        (other_x, other_y), theirs = other.place()
        offset = np.array([x - other_x, y - other_y])
        squared = _squared(offset, np.array(mine) + theirs)
        return bool(squared < config.gate**2) and float(np.hypot(*offset)) < config.max_distance

    def take(self, other: _Group) -> None:
        """Joins the other to this one."""
        self.members += other.members
        self.robots |= other.robots
        self.xx += other.xx
        self.xy += other.xy
        self.yy += other.yy
        self.x += other.x
        self.y += other.y


def are_people(joined: Joined, bodies: BodiesOnMap, config: cfg.Joining) -> Bool:
    """Which are people, shape (m,): likely enough, and not what a likelier one already is.

    Two people are never closer than `apart`. Besides, what is left over of robots that did not see
    a likelier person near it, at a distance that their range may be wrong by, is that person:
    ranges err by more than their sigma now and then.

    Args:
        joined: The joined bodies.
        bodies: What they were joined of.
        config: Parameters.
    """
    if not len(joined):
        return np.empty(0, dtype=bool)
    robots = np.zeros((len(joined), int(bodies.robot.max(initial=-1)) + 1), dtype=bool)
    member = joined.of_body >= 0
    robots[joined.of_body[member], bodies.robot[member]] = True
    offset = joined.xy[:, np.newaxis] - joined.xy
    away = np.hypot(offset[..., 0], offset[..., 1])
    squared = _squared(offset, joined.covariance[:, np.newaxis] + joined.covariance)
    strangers = ~(robots.astype(np.intp) @ robots.T.astype(np.intp) > 0)
    fragment = strangers & (squared < config.fragment_gate**2) & (away < config.fragment_distance)
    taken = (away < config.apart) | fragment
    people = np.zeros(len(joined), dtype=bool)
    for i in np.argsort(-joined.score, kind="stable"):
        if joined.score[i] < config.min_score:
            break
        people[i] = not taken[i, people].any()
    return people

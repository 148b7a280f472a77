"""Plain loops of the default method: what can be said simply of the search for bodies.

The histogram of the search, the samples of the patches, the cells of bodies and their joining are
computed here from their definitions and compared with the core's within rounding. What a fitted
model says is not repeated; it is taken from the core.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.bodies import search
from mrs_people_loc.bodies.finder import BodyFinder
from mrs_people_loc.bodies.patches import ACROSS, HEIGHTS, Patches
from mrs_people_loc.config import Joining, RobotConfig
from mrs_people_loc.robot import Stages
from mrs_people_loc.scan import Cells
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import StereoImages
from mrs_people_loc.team.fusion import ShortTermMap
from mrs_people_loc.team.poses import Pose
from mrs_people_loc.timing import StageTimes
from mrs_tools.bench.differs import near, same

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]
XY = tuple[float, float]

#: What float32 leaves of metres and pixels.
_TOLERANCE = 1e-4
#: ... and of a pixel in the hundreds after some sums.
_TOLERANCE_PX = 1e-3
#: Bins of the histogram [px], and rays that see people from above: as the search has them.
_STEP_PX, _LEAST_LEVEL = 0.25, 0.35
#: As the joining has them [m], [log-odds], [sigmas].
_LEAST_SIGMA, _LEAST_SCORE = 0.01, -2.0
#: As the masking has them [m], [log-odds], [sigmas], [1/m].
_ROBOT_SIGMAS, _REACH_ALONG, _REACH_ACROSS, _CLEARLY_A_PERSON = 2.5, 0.8, 0.4, 5.0
_CELL_SIGMA_RANGE, _CELL_SIGMA_ACROSS = 0.25 / 10.5, 0.03


# ------------------------------------------------------------------------------------ the search


def _rays(camera: StereoCamera) -> list[list[tuple[float, float, float]]]:
    """Ray of each pixel per metre of depth in base_link's axes, by row and column."""
    rotation, _ = camera.robot_from_optical
    rays = []
    for v in range(camera.height):
        y = (v - camera.cy) / camera.fy
        row = []
        for u in range(camera.width):
            x = (u - camera.cx) / camera.fx
            ahead, left, up = (float(r[0] * x + r[1] * y + r[2]) for r in rotation)
            row.append((ahead, left, up))
        rays.append(row)
    return rays


def _slopes(values: Sequence[float], i: int) -> float:
    """Derivative by central differences, one-sided at the ends."""
    before, after = max(i - 1, 0), min(i + 1, len(values) - 1)
    return (values[after] - values[before]) / (after - before)


def histogram_of(
    disparity: Float32, camera: StereoCamera, *, min_range: float, max_range: float
) -> Float:
    """Metres of vertical extent by inverse range and bearing, as `BodySearch.histogram`."""
    rays = _rays(camera)
    ahead, left, _ = rays[camera.height // 2][camera.width // 2]
    middle = math.atan2(left, ahead)
    turns = [
        [math.remainder(math.atan2(y, x) - middle, 2.0 * math.pi) for x, y, _ in row]
        for row in rays
    ]
    slopes = [[z / max(math.hypot(x, y), 1e-6) for x, y, z in row] for row in rays]
    levels = [[math.hypot(x, y) for x, y, _ in row] for row in rays]
    size = range(camera.height), range(camera.width)
    usable = [turns[v][u] for v in size[0] for u in size[1] if levels[v][u] > _LEAST_LEVEL]
    first, step = min(usable), 1.0 / camera.fx
    columns = int((max(usable) - first) / step) + 1
    least = camera.depth_disparity / max_range
    rows = max(1, math.ceil((camera.depth_disparity / min_range - least) / _STEP_PX))
    _, lens = camera.robot_from_optical
    low, high = (np.float32(z - float(lens[2])) for z in (search.LOWEST, search.HIGHEST))
    result = np.zeros((rows, columns))
    for v in size[0]:
        for u in size[1]:
            value = disparity[v, u]
            if not value > camera.disparity_offset_px or levels[v][u] <= _LEAST_LEVEL:
                continue
            # Which bin it is in is a matter of float32, as in the core.
            inverse = (value - np.float32(camera.disparity_offset_px)) / np.float32(levels[v][u])
            away = np.float32(camera.depth_disparity) / inverse
            row = (inverse - np.float32(least)) * np.float32(1.0 / _STEP_PX)
            if not (low < np.float32(slopes[v][u]) * away < high and 0 <= row < rows):
                continue
            column = min(max(int((turns[v][u] - first) / step), 0), columns - 1)
            in_column = [[line[u] for line in of] for of in (turns, slopes)]
            area = abs(
                _slopes(turns[v], u) * _slopes(in_column[1], v)
                - _slopes(in_column[0], v) * _slopes(slopes[v], u)
            )
            result[int(row), column] += float(away) * area / step
    return result


# ----------------------------------------------------------------------------------- the patches


def check_patches(name: str, got: Patches, disparity: Float32, camera: StereoCamera) -> None:
    """Compares each sample of patches: where it is in the image, and what is seen there.

    Raises:
        DiffersError: Naming what differs.
    """
    rotation, lens = camera.robot_from_optical
    inside = np.zeros(got.u.shape, dtype=bool)
    u, v, expected, difference = (np.full(got.u.shape, np.nan) for _ in range(4))
    sure = np.zeros(got.u.shape, dtype=bool)
    for patch, row, column in np.ndindex(got.u.shape):
        bearing = float(got.bearing[patch])
        away = camera.depth_disparity / float(got.inverse_range[patch])
        across = float(ACROSS[column])
        from_lens = (
            away * math.cos(bearing) - across * math.sin(bearing),
            away * math.sin(bearing) + across * math.cos(bearing),
            float(HEIGHTS[row]) - float(lens[2]),
        )
        x, y, z = (sum(float(rotation[k, a]) * from_lens[k] for k in range(3)) for a in range(3))
        if z < 0.2:  # beside or behind the lens: nothing that could be seen
            continue
        at = patch, row, column
        u[at], v[at] = camera.fx * x / z + camera.cx, camera.fy * y / z + camera.cy
        expected[at] = camera.depth_disparity / z
        inside[at] = -0.5 < u[at] < camera.width - 0.5 and -0.5 < v[at] < camera.height - 0.5
        # Between two pixels, and at the border of the image, rounding decides.
        sure[at] = all(abs(math.remainder(c - 0.5, 1.0)) > _TOLERANCE_PX for c in (u[at], v[at]))
        if inside[at]:
            seen = float(disparity[math.floor(v[at] + 0.5), math.floor(u[at] + 0.5)])
            difference[at] = seen - expected[at] - camera.disparity_offset_px
    same(f"{name}: patches.inside", got.inside[sure], inside[sure])
    for field, wanted in (("u", u), ("v", v), ("expected", expected)):
        values = getattr(got, field)[inside]
        near(f"{name}: patches.{field}", values, wanted[inside], _TOLERANCE_PX)
    both = sure & inside
    known = ~np.isnan(difference[both])
    same(f"{name}: patches.difference, where known", np.isfinite(got.difference[both]), known)
    near(
        f"{name}: patches.difference",
        got.difference[both][known],
        difference[both][known],
        _TOLERANCE_PX,
    )


# ------------------------------------------------------------------------------------- the bodies


def places_of(cells: Cells) -> dict[int, XY]:
    """By body, the centre of gravity of its cells."""
    sums: dict[int, list[float]] = {}
    fields = (cells.body, cells.x, cells.y, cells.count)
    for body, x, y, count in zip(*(field.tolist() for field in fields), strict=True):
        if body:
            of_body = sums.setdefault(body, [0.0, 0.0, 0.0])
            for k, value in enumerate((count * x, count * y, count)):
                of_body[k] += value
    return {body: (x / total, y / total) for body, (x, y, total) in sums.items()}


def check_view(
    name: str, images: StereoImages, stages: Stages, camera: StereoCamera, config: RobotConfig
) -> None:
    """Compares a view's stages after the cloud with the reference.

    Raises:
        DiffersError: Naming the first stage and field that differ.
    """
    low, high = np.float32(search.LOWEST), np.float32(search.HIGHEST)
    zones = [point for point in stages.cloud if low <= point[2] <= high]
    same(f"{name}: zones", stages.zones, np.reshape(zones, (-1, 3)).astype(np.float32))
    near_m, far_m = config.disparity.min_range, config.bodies.max_range
    core = search.BodySearch(camera, min_range=near_m, max_range=far_m)
    got = core.histogram(stages.disparity)
    wanted = histogram_of(stages.disparity, camera, min_range=near_m, max_range=far_m)
    near(f"{name}: histogram", got, wanted, _TOLERANCE)

    find = BodyFinder(camera, config.bodies, min_range=config.disparity.min_range)
    view = find.look(stages.disparity, images, StageTimes())
    check_patches(name, view.patches, stages.disparity, camera)
    found = find.judge(view)
    cells = stages.scan.cells
    places = places_of(cells)
    same(f"{name}: bodies", sorted(places), list(range(1, len(found) + 1)))
    for field in ("x", "y"):
        values = [place["xy".index(field)] for _, place in sorted(places.items())]
        near(f"{name}: cells of bodies, {field}", values, getattr(found, field), _TOLERANCE)
    index = cells.body.astype(np.intp) - 1
    for field in ("score", "sigma_range", "sigma_across", "top"):
        values = getattr(found, field)[index]
        near(f"{name}: cells.{field}", getattr(cells, field), values, _TOLERANCE)


# ------------------------------------------------------------------------------------ the joining


@dataclass(frozen=True)
class Seen:
    """A body on the map, as one robot sees it.

    Attributes:
        robot: That robot.
        cells: Its cells on the map.
        xy: Its place [m].
        covariance: Of the place [m^2].
        score: Log-odds that it is a person.
    """

    robot: str
    cells: tuple[int, ...]
    xy: Float
    covariance: Float
    score: float


@dataclass(frozen=True)
class JoinedBody:
    """What bodies are together.

    Attributes:
        cells: Their cells on the map.
        xy: Place [m].
        covariance: Of the place [m^2].
        is_person: Whether it is one.
    """

    cells: tuple[int, ...]
    xy: Float
    covariance: Float
    is_person: bool


def covariance_seen(pose: Pose, xy: Float, along: float, across: float) -> Float:
    """Covariance of a place that was seen from a pose, of variances along and across the sight."""
    angle = math.atan2(xy[1] - pose.y, xy[0] - pose.x)
    turn = np.array([[math.cos(angle), -math.sin(angle)], [math.sin(angle), math.cos(angle)]])
    lever = np.array([[1.0, 0.0, pose.y - xy[1]], [0.0, 1.0, xy[0] - pose.x]])
    return turn @ np.diag([along, across]) @ turn.T + lever @ pose.covariance @ lever.T


def bodies_seen(fused: ShortTermMap, poses: Mapping[str, Pose], config: Joining) -> list[Seen]:
    """The bodies on a map, by robot and number."""
    cells_of: dict[tuple[int, int], list[int]] = {}
    for i in range(len(fused)):
        if fused.cells.body[i]:
            key = int(fused.robot[i]), int(fused.cells.body[i])
            cells_of.setdefault(key, []).append(i)
    seen = []
    for (robot, _), inside in sorted(cells_of.items()):
        pose, first = poses[fused.robots[robot]], inside[0]
        weights = [max(float(fused.cells.count[i]), 1.0) for i in inside]
        xy = sum(w * fused.xy[i] for w, i in zip(weights, inside, strict=True)) / sum(weights)
        along, across = (
            max(float(sigma[first]), _LEAST_SIGMA) ** 2
            for sigma in (fused.cells.sigma_range, fused.cells.sigma_across)
        )
        if not config.line_of_sight:
            along = across = math.sqrt(along * across)
        covariance = covariance_seen(pose, xy, along, across)
        score = float(fused.cells.score[first])
        seen.append(Seen(fused.robots[robot], tuple(inside), np.array(xy), covariance, score))
    return seen


def is_robot(
    robot: str, xy: Float, covariance: Float, poses: Mapping[str, Pose], radius: float, score: float
) -> bool:
    """Whether what a robot saw somewhere is another robot of the team."""
    own = poses[robot]
    sight = xy - (own.x, own.y)
    sight = sight / math.hypot(*sight)
    for name, pose in poses.items():
        offset = xy - (pose.x, pose.y)
        total = covariance + pose.covariance[:2, :2]
        there = name != robot and radius > 0
        for axis, most in ((sight, _REACH_ALONG), (np.array([-sight[1], sight[0]]), _REACH_ACROSS)):
            reach = max(radius, min(_ROBOT_SIGMAS * math.sqrt(axis @ total @ axis), most))
            there = there and bool(abs(axis @ offset) < reach)
        if there and (math.hypot(*offset) < radius or score < _CLEARLY_A_PERSON):
            return True
    return False


def is_cell_of_robot(robot: str, xy: Float, poses: Mapping[str, Pose], radius: float) -> bool:
    """Whether a plain cell that a robot saw is another robot of the team."""
    own = poses[robot]
    x, y = xy[0] - own.x, xy[1] - own.y
    along = _CELL_SIGMA_RANGE * (x * x + y * y)
    covariance = covariance_seen(own, np.array(xy), along**2, _CELL_SIGMA_ACROSS**2)
    return is_robot(robot, np.array(xy), covariance, poses, radius, -math.inf)


def _fused(bodies: Sequence[Seen]) -> tuple[Float, Float]:
    """Place and covariance of bodies that are one: their information added."""
    information = sum(np.linalg.inv(body.covariance) for body in bodies)
    covariance = np.linalg.inv(information)
    return covariance @ sum(np.linalg.solve(b.covariance, b.xy) for b in bodies), covariance


def joined_of(
    fused: ShortTermMap,
    poses: Mapping[str, Pose],
    placed: Mapping[str, Pose],
    config: Joining,
    radius: float,
) -> tuple[list[JoinedBody], list[tuple[int, ...]]]:
    """Joins the bodies of a map, nearest first.

    Args:
        fused: The map.
        poses: The robots' poses.
        placed: Likewise, as unsure as what was placed with them.
        config: Parameters.
        radius: Of a robot [m].

    Returns:
        What they are, numbered by their first bodies, and the cells of those that are robots.
    """
    seen = bodies_seen(fused, placed, config)
    robots = [
        body
        for body in seen
        if is_robot(body.robot, body.xy, body.covariance, poses, radius, body.score)
    ]
    alone = [body for body in seen if not any(body is robot for robot in robots)]

    def distance(one: Sequence[Seen], other: Sequence[Seen]) -> float | None:
        """Squared, in sigmas; None where they cannot be one."""
        if {body.robot for body in one} & {body.robot for body in other}:
            return None
        (a, of_a), (b, of_b) = _fused(one), _fused(other)
        squared = float((a - b) @ np.linalg.solve(of_a + of_b, a - b))
        close = math.dist(a, b) < config.max_distance and squared < config.gate**2
        return squared if close else None

    pairs = []
    for i, one in enumerate(alone):
        for j in range(i + 1, len(alone)):
            squared = distance([one], [alone[j]])
            if squared is not None:
                pairs.append((squared, i, j))
    group_of = {i: [i] for i in range(len(alone))}
    for _, i, j in sorted(pairs):
        a, b = group_of[i], group_of[j]
        if a is not b and distance([alone[k] for k in a], [alone[k] for k in b]) is not None:
            a += b
            for k in b:
                group_of[k] = a
    groups = [sorted(group) for i, group in group_of.items() if i == min(group)]
    scores = [sum(max(alone[k].score, _LEAST_SCORE) for k in group) for group in groups]
    places = [_fused([alone[k] for k in group]) for group in groups]

    def is_same(one: int, other: int) -> bool:
        (a, of_a), (b, of_b) = places[one], places[other]
        away, offset = math.dist(a, b), a - b
        if away < config.apart:
            return True
        if {alone[k].robot for k in groups[one]} & {alone[k].robot for k in groups[other]}:
            return False
        squared = float(offset @ np.linalg.solve(of_a + of_b, offset))
        return squared < config.fragment_gate**2 and away < config.fragment_distance

    people: list[int] = []
    for index in sorted(range(len(groups)), key=lambda index: -scores[index]):
        if scores[index] >= config.min_score and not any(is_same(index, p) for p in people):
            people.append(index)
    joined = [
        JoinedBody(
            cells=tuple(cell for k in group for cell in alone[k].cells),
            xy=places[index][0],
            covariance=places[index][1],
            is_person=index in people,
        )
        for index, group in enumerate(groups)
    ]
    return joined, [robot.cells for robot in robots]

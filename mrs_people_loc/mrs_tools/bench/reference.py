"""The method as plain loops, straight from the equations: slow, and easy to check by eye.

`mrs bench` times nothing that differs from this, and tests compare with it, too. It takes types and
configuration from the core, and StereoBM from OpenCV, but no computation.

    check_view(images, stages, camera, config)
    check_people(scans, people, config)
"""

from __future__ import annotations

import math
from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.cells.splitting import split
from mrs_people_loc.clusters import Clusters
from mrs_people_loc.config import Disparity, Human, PlannerConfig, RobotConfig
from mrs_people_loc.people import Group, Person
from mrs_people_loc.planner import People
from mrs_people_loc.robot import Stages
from mrs_people_loc.scan import CELL_DTYPE, Cells, Scan
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.disparity import make_stereo_bm
from mrs_people_loc.sensing.images import Gray, StereoImages
from mrs_people_loc.team.poses import Pose
from mrs_tools.bench import bodies as bench_bodies
from mrs_tools.bench.differs import TOLERANCE, near, same

Float32 = NDArray[np.float32]
Point = tuple[np.float32, np.float32, np.float32]
XY = tuple[float, float]

#: float32 has 24 bits: 5 m to half a micrometre, and some roundings on the way.
_CLOUD_TOLERANCE_M = 1e-5
#: Inverting matrices loses some digits.
_JOINED_TOLERANCE = 1e-6
#: What float32 does to two cell centres that are exactly the distance apart [m].
_ROUNDING_M = 1e-5
#: Part of the pixels that StereoBM may match otherwise when it does not repeat itself.
_NOT_REPEATED = 0.005
_COLUMN_BIN_M = 0.05
_COLUMN_BINS = 60


# ------------------------------------------------------------------------------- images to points


def disparity_of(images: StereoImages, camera: StereoCamera, config: Disparity) -> Float32:
    """Disparity of the left image [px], NaN where there is none, shape (height, width)."""
    horizontal = _match(images.left, images.right, camera.disparity_of(config.min_range), config)
    if not camera.vertical_baseline:
        return horizontal
    assert images.top is not None
    # A camera above becomes one to the right when the images are turned clockwise.
    turns = -1 if camera.vertical_baseline > 0 else 1
    pair = [np.ascontiguousarray(np.rot90(image, turns)) for image in (images.left, images.top)]
    focal_baseline = abs(camera.vertical_baseline) * camera.fy
    greatest = focal_baseline / config.min_range + camera.vertical_offset_px
    vertical = np.rot90(_match(pair[0], pair[1], greatest, config), -turns)
    ratio = np.float32(camera.depth_disparity / focal_baseline)
    result = np.full_like(horizontal, np.nan)
    for row, column in np.ndindex(horizontal.shape):
        one = horizontal[row, column]
        other = (vertical[row, column] - np.float32(camera.vertical_offset_px)) * ratio
        other += np.float32(camera.disparity_offset_px)
        if math.isnan(one) or math.isnan(other):
            result[row, column] = other if math.isnan(one) else one
        elif abs(one - other) <= np.float32(config.trinocular_difference_px):
            result[row, column] = (one + other) * np.float32(0.5)
    return result


def _match(left: Gray, right: Gray, greatest_px: float, config: Disparity) -> Float32:
    """StereoBM on images that are padded by what it leaves out; where it has a value inside."""
    searched = 16 * max(1, math.ceil((greatest_px + 1.0) / 16))
    blocks = [config.block_size_px, config.fill_block_size_px]
    half = max(blocks) // 2
    margin = ((half, half), (searched + half, half))
    padded = [np.pad(image, margin, mode="edge") for image in (left, right)]
    passes = [
        make_stereo_bm(replace(config, block_size_px=block), searched).compute(*padded)
        for block in blocks
        if block
    ]
    result = np.full(left.shape, np.nan, dtype=np.float32)
    for row, column in np.ndindex(left.shape):
        for fixed in passes:
            value = int(fixed[row + half, column + searched + half])
            if 0 <= value <= 16 * column:
                result[row, column] = value / 16
                break
    return result


def is_repeatable(config: Disparity) -> bool:
    """Whether StereoBM gives the same for the same images.

    OpenCV's does not where the cap is over 31 and matches are checked both ways and for uniqueness
    (seen with 5.0.0 and small blocks): a few pixels differ from call to call.
    """
    return (
        config.pre_filter_cap <= 31
        or config.uniqueness_ratio == 0
        or config.left_right_difference_px < 0
    )


def cloud_of(disparity: Float32, camera: StereoCamera, config: Disparity) -> list[list[float]]:
    """RAW: the points of all pixels within the working range, in the order of the pixels [m]."""
    rotation, translation = camera.robot_from_optical
    near = np.float32(camera.depth_disparity / config.min_range)
    far = np.float32(camera.depth_disparity / config.max_range)
    points = []
    for (row, column), value in np.ndenumerate(disparity):
        d = value - np.float32(camera.disparity_offset_px)
        if far <= d <= near:  # not so for NaN
            depth = camera.depth_disparity / float(d)
            optical = (
                depth * (column - camera.cx) / camera.fx,
                depth * (row - camera.cy) / camera.fy,
                depth,
            )
            points.append(
                [
                    sum(float(rotation[axis, k]) * optical[k] for k in range(3))
                    + float(translation[axis])
                    for axis in range(3)
                ]
            )
    return points


# -------------------------------------------------------------------------------- points to cells


@dataclass(frozen=True)
class Cell:
    """One occupied cell; fields as in `Cells`."""

    x: np.float32
    y: np.float32
    z: np.float32
    z_min: np.float32
    top: np.float32
    count: int


def zones_of(cloud: Float32, config: RobotConfig) -> list[Point]:
    """Eq. 1."""
    low, high = np.float32(config.zones.low), np.float32(config.zones.high)
    return [(x, y, z) for x, y, z in cloud if low <= z <= high]


def noise_of(points: Sequence[Point], config: RobotConfig) -> list[Point]:
    """Eqs. 2-3, in the order of the points."""
    held = _tiled(points, config.noise.window)
    return [
        p
        for p in points
        if len(held[_tile(p[0], p[1], config.noise.window)]) >= config.noise.min_points
    ]


def cells_of(cloud: Float32, config: RobotConfig) -> list[Cell]:
    """Eqs. 1-5, and the top of each cell's column."""
    kept = noise_of(zones_of(cloud, config), config)
    side = config.quantization.cell
    cells = []
    for (i, j), points in sorted(_tiled(kept, side).items()):
        heights = [z for _, _, z in points]
        x, y = np.float32((i + 0.5) * side), np.float32((j + 0.5) * side)
        cells.append(Cell(x, y, max(heights), min(heights), max(heights), len(points)))
    high = np.float32(config.zones.high)
    above = _tiled([(x, y, z) for x, y, z in cloud if z > high], config.noise.window)
    in_zone = _tiled(kept, config.noise.window)
    cells_in = defaultdict(list)
    for cell in cells:
        cells_in[_tile(cell.x, cell.y, config.noise.window)].append(cell)
    topped = {}
    for column, inside in cells_in.items():
        highest = max(c.z for c in inside)
        heights = [z for _, _, z in in_zone.get(column, [])]
        top = _top_of(highest, heights, [z for _, _, z in above.get(column, [])], config)
        topped.update({c: replace(c, top=c.z if top is None else top) for c in inside})
    return [topped[c] for c in cells]


def _top_of(
    highest: np.float32,
    zone: Sequence[np.float32],
    above: Sequence[np.float32],
    config: RobotConfig,
) -> np.float32 | None:
    """Top of a column of the noise window: up from the zone until a gap; None: not supported.

    Args:
        highest: Highest z of its cells.
        zone: Heights of its points in the zone.
        above: Heights of its points above the zone.
        config: The robot's configuration.
    """
    high = np.float32(config.zones.high)
    gap, support = config.quantization.top_gap, config.quantization.top_support
    passed: list[np.float32] = []
    if highest >= np.float32(config.zones.high - gap):
        last = 0  # the zone; the bins above it count from 1
        for z in sorted(above):
            now = int((z - high) / np.float32(_COLUMN_BIN_M)) + 1
            if now > _COLUMN_BINS or now - last > round(gap / _COLUMN_BIN_M) + 1:
                break
            passed.append(z)
            last = now
    for heights in (passed, sorted(zone)):
        if len(heights) >= support:
            # To the millimetre below, also for heights below the floor.
            return np.float32((int(heights[-support] * np.float32(1000.0))) / np.float32(1000.0))
    return None


def _tile(x: np.float32, y: np.float32, side: float) -> tuple[int, int]:
    return math.floor(x / np.float32(side)), math.floor(y / np.float32(side))


def _tiled(points: Sequence[Point], side: float) -> dict[tuple[int, int], list[Point]]:
    """The points of each occupied tile of the ground plane."""
    tiles: defaultdict[tuple[int, int], list[Point]] = defaultdict(list)
    for point in points:
        tiles[_tile(point[0], point[1], side)].append(point)
    return tiles


# ------------------------------------------------------------------------------- cells to people


def fused_of(scans: Sequence[Scan], poses: Mapping[str, Pose]) -> list[XY]:
    """Eq. 6: every cell turned by its robot's heading and moved by its position."""
    places = []
    for scan in sorted(scans, key=lambda s: s.robot):
        pose = poses[scan.robot]
        cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
        for x, y in zip(scan.cells.x.tolist(), scan.cells.y.tolist(), strict=True):
            places.append((cos * x - sin * y + pose.x, sin * x + cos * y + pose.y))
    return places


def clusters_of(places: Sequence[XY], distance: float) -> list[int]:
    """Eqs. 8-10: a label for each point, numbered by their least points (x, then y)."""
    label = list(range(len(places)))

    def root(i: int) -> int:
        while label[i] != i:
            i = label[i]
        return i

    reach = (distance + _ROUNDING_M) ** 2
    for i, (x, y) in enumerate(places):
        for j in range(i):
            dx, dy = x - places[j][0], y - places[j][1]
            if dx * dx + dy * dy <= reach:
                label[root(i)] = root(j)
    number: dict[int, int] = {}
    for i in sorted(range(len(places)), key=lambda i: places[i]):
        number.setdefault(root(i), len(number))
    return [number[root(i)] for i in range(len(places))]


@dataclass(frozen=True)
class Body:
    """Measures of one cluster; fields as in `Clusters`."""

    centroid: XY
    scatter: NDArray[np.float64]
    sigma: float
    width: float
    depth: float
    height: float
    bottom: float
    cells: int
    points: int
    robots: tuple[str, ...]
    has_axis: bool
    """Whether one direction is the longest; width and depth mean nothing where all are equal."""


def bodies_of(
    places: Sequence[XY], label: Sequence[int], cells: Cells, robots: Sequence[str]
) -> list[Body]:
    """Measures each cluster.

    Args:
        places: Of the cells in the common frame.
        label: Cluster of each cell.
        cells: The cells.
        robots: Which robot each cell comes from.
    """
    bodies = []
    for cluster in range(max(label, default=-1) + 1):
        inside = [i for i, of in enumerate(label) if of == cluster]
        n = len(inside)
        cx, cy = (sum(places[i][axis] for i in inside) / n for axis in (0, 1))
        offsets = [(places[i][0] - cx, places[i][1] - cy) for i in inside]
        xx, xy, yy = (sum(o[a] * o[b] for o in offsets) / n for a, b in ((0, 0), (0, 1), (1, 1)))
        distances = [math.hypot(*o) for o in offsets]
        mean = sum(distances) / n
        angle = 0.5 * math.atan2(2.0 * xy, xx - yy)
        cos, sin = math.cos(angle), math.sin(angle)
        along = [cos * dx + sin * dy for dx, dy in offsets]
        across = [cos * dy - sin * dx for dx, dy in offsets]
        bodies.append(
            Body(
                centroid=(cx, cy),
                scatter=np.array([[xx, xy], [xy, yy]]),
                sigma=math.sqrt(sum((d - mean) ** 2 for d in distances) / n),
                width=max(along) - min(along),
                depth=max(across) - min(across),
                height=max(float(cells.top[i]) for i in inside),
                bottom=min(float(cells.z_min[i]) for i in inside),
                cells=n,
                points=sum(int(cells.count[i]) for i in inside),
                robots=tuple(sorted({robots[i] for i in inside})),
                has_axis=math.hypot(2.0 * xy, xx - yy) > 1e-9,
            )
        )
    return bodies


def is_human(body: Body, config: Human) -> bool:
    """Whether a cluster has the size of a human (section 6.4)."""
    return (
        config.min_height <= body.height <= config.max_height
        and config.min_width <= body.width <= config.max_width
        and body.depth <= config.max_depth
        and body.points >= config.min_points
    )


def person_of(body: Body, label: int, poses: Mapping[str, Pose]) -> Person:
    """Position: centre of gravity. Covariance: of the cells, and of the poses that placed them."""
    of_poses = np.zeros((2, 2))
    for name in body.robots:
        pose = poses[name]
        lever = np.array(
            [[1.0, 0.0, pose.y - body.centroid[1]], [0.0, 1.0, body.centroid[0] - pose.x]]
        )
        of_poses += lever @ pose.covariance @ lever.T
    seen = len(body.robots)
    return Person(
        position=np.array(body.centroid),
        covariance=(body.scatter + of_poses / seen) / seen,
        height=body.height,
        sigma=body.sigma,
        robots=body.robots,
        label=label,
    )


def group_of(persons: Sequence[Person]) -> Group | None:
    """All people together; None if there are none."""
    if not persons:
        return None
    n = len(persons)
    centre = sum(p.position for p in persons) / n
    away = [math.hypot(*(p.position - centre)) for p in persons]
    return Group(
        centre=np.asarray(centre),
        covariance=np.asarray(sum(p.covariance for p in persons) / n**2),
        radius=max(away),
        rms_spread=math.sqrt(sum(d * d for d in away) / n),
        size=n,
    )


# -------------------------------------------------------------------------------------- comparing


def check_view(
    images: StereoImages, stages: Stages, camera: StereoCamera, config: RobotConfig
) -> None:
    """Compares a view's stages with the reference, each computed from the core's one before.

    Raises:
        DiffersError: Naming the first stage and field that differ.
    """
    name = f"{stages.scan.robot} at {stages.scan.stamp_ns} ns"
    _check_disparity(name, stages.disparity, images, camera, config.disparity)
    cloud = cloud_of(stages.disparity, camera, config.disparity)
    near(f"{name}: cloud", stages.cloud, np.reshape(cloud, (-1, 3)), _CLOUD_TOLERANCE_M)
    if config.bodies.search:
        bench_bodies.check_view(name, images, stages, camera, config)
        return
    zones = zones_of(stages.cloud, config)
    same(f"{name}: zones", stages.zones, np.reshape(zones, (-1, 3)))
    same(f"{name}: noise", stages.noise, np.reshape(noise_of(zones, config), (-1, 3)))
    check_cells(name, stages.scan.cells, cells_of(stages.cloud, config))


def _check_disparity(
    name: str, got: Float32, images: StereoImages, camera: StereoCamera, config: Disparity
) -> None:
    wanted = disparity_of(images, camera, config)
    if not is_repeatable(config) and got.shape == wanted.shape:
        differ = (got != wanted) & ~(np.isnan(got) & np.isnan(wanted))
        if differ.mean() <= _NOT_REPEATED:
            return
    same(f"{name}: disparity", got, wanted)


def check_cells(name: str, got: Cells, wanted: Sequence[Cell]) -> None:
    """Compares all fields of cells, bit for bit.

    Raises:
        DiffersError: Naming the field that differs.
    """
    for field in CELL_DTYPE.names or ():
        values = np.array([getattr(c, field) for c in wanted], dtype=CELL_DTYPE[field])
        same(f"{name}: cells.{field}", getattr(got, field), values)


def placed_of(scans: Sequence[Scan], people: People, config: PlannerConfig) -> dict[str, Pose]:
    """The poses, less sure by what people walk between a scan and the interval."""
    placed = {}
    for scan in scans:
        pose = people.poses[scan.robot]
        walked = config.interval.walking_speed * (people.stamp_ns - scan.stamp_ns) / 1e9
        covariance = pose.covariance.copy()
        covariance[0, 0] += walked**2
        covariance[1, 1] += walked**2
        placed[scan.robot] = replace(pose, covariance=covariance)
    return placed


def check_people(scans: Sequence[Scan], people: People, config: PlannerConfig) -> None:
    """Compares an interval's clusters, people and group with the reference.

    Args:
        scans: What went in, with the poses in `people`.
        people: What came out.
        config: The planner's configuration.

    Raises:
        DiffersError: Naming what differs.
    """
    name, clusters = f"interval at {people.stamp_ns} ns", people.clusters
    tolerance = _JOINED_TOLERANCE if people.fused.cells.body.any() else TOLERANCE
    placed = placed_of(scans, people, config)
    places = fused_of(scans, people.poses)
    near(f"{name}: map", people.fused.xy, np.reshape(places, (-1, 2)))
    # From here on with the core's own map: a rounding must not change who is near whom.
    places = [(x, y) for x, y in people.fused.xy.tolist()]
    fused = people.fused
    radius = config.masking.robot_radius
    plain: list[int] = []
    masked: list[int] = []
    for i in range(len(fused)):
        if not fused.cells.body[i]:
            robot = fused.robots[fused.robot[i]]
            of_robot = bench_bodies.is_cell_of_robot(robot, fused.xy[i], people.poses, radius)
            (masked if of_robot else plain).append(i)
    of_plain = clusters_of([places[i] for i in plain], config.clustering.distance)
    # The core's own: there is no reference for which parts a wide cluster is split into.
    split_ones, _ = split(
        fused,
        np.array(plain, dtype=np.intp),
        np.array(of_plain, dtype=np.intp),
        people.poses,
        config.splitting,
        config.human,
    )
    of_plain = [int(of) for of in split_ones]
    label = [-1] * len(fused)
    for i, of in zip(plain, of_plain, strict=True):
        label[i] = of
    # Then other cells of robots, then what bodies are together, then those that are robots.
    first = max(of_plain, default=-1) + 1
    of_masked = clusters_of([places[i] for i in masked], config.clustering.distance)
    for i, of in zip(masked, of_masked, strict=True):
        label[i] = first + of
    joined, of_robots = bench_bodies.joined_of(fused, people.poses, placed, config.joining, radius)
    of_bodies = first + max(of_masked, default=-1) + 1
    for number, inside in enumerate([*(body.cells for body in joined), *of_robots], of_bodies):
        for i in inside:
            label[i] = number
    same(f"{name}: clusters", clusters.label, np.array(label, dtype=np.intp))
    robots = [fused.robots[i] for i in fused.robot]
    bodies = bodies_of(places, label, fused.cells, robots)
    _check_bodies(name, clusters, bodies, fused.robots)
    wanted = [
        person_of(body, index, placed)
        for index, body in enumerate(bodies[:first])
        if is_human(body, config.human)
    ]
    wanted += [
        replace(
            person_of(bodies[index], index, placed),
            position=one.xy,
            covariance=one.covariance,
        )
        for index, one in enumerate(joined, of_bodies)
        for of_cells in [person_of(bodies[index], index, placed)]
        if one.is_person
    ]
    same(f"{name}: number of people", len(people.persons), len(wanted))
    for index, (got, want) in enumerate(zip(people.persons, wanted, strict=True)):
        who = f"{name}: person {index}"
        for field in ("position", "covariance", "height", "sigma"):
            near(f"{who}: {field}", getattr(got, field), getattr(want, field), tolerance)
        for field in ("robots", "label"):
            same(f"{who}: {field}", getattr(got, field), getattr(want, field))
    group = group_of(wanted)
    if group is None or people.group is None:
        same(f"{name}: group", people.group, group)
        return
    for field in ("centre", "covariance", "radius", "rms_spread", "size"):
        got, want = (getattr(of, field) for of in (people.group, group))
        near(f"{name}: group: {field}", got, want, tolerance)


def _check_bodies(
    name: str, clusters: Clusters, bodies: Sequence[Body], robots: Sequence[str]
) -> None:
    same(f"{name}: number of clusters", len(clusters), len(bodies))
    for field in ("centroid", "scatter", "sigma", "height", "bottom", "cells", "points"):
        values = np.array([getattr(b, field) for b in bodies])
        near(f"{name}: clusters.{field}", getattr(clusters, field), values)
    sided = [i for i, body in enumerate(bodies) if body.has_axis]
    for field in ("width", "depth"):
        values = np.array([getattr(bodies[i], field) for i in sided])
        near(f"{name}: clusters.{field}", getattr(clusters, field)[sided], values, 1e-6)
    seen = np.array([[robot in b.robots for robot in robots] for b in bodies])
    same(f"{name}: clusters.seen_by", clusters.seen_by, seen.reshape(len(bodies), -1))

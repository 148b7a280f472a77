"""What the packages and the oracle are compared on, besides recordings."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.config import Mounting, RobotConfig, load_team
from mrs_people_loc.robot import RobotPipeline, Stages
from mrs_people_loc.scan import Cells, Scan
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import StereoImages
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_loc.team.poses import Pose

ROOT = Path(__file__).resolve().parents[2]
PAPER = ROOT / "config" / "paper.yaml"
DEFAULT = ROOT / "config" / "default.yaml"
TEAM = ROOT / "config" / "team.yaml"
BAG = ROOT / "bags" / "paper_formation"
#: The paper's method, and the default one.
CELLS = load_team(PAPER, robots=("robot_a",)).robots["robot_a"]
BODIES = RobotConfig()

#: Scans of one interval, and the robots' poses by name.
Scene = tuple[list[Scan], dict[str, Pose]]


def random_cloud(seed: int, count: int = 3000) -> NDArray[np.float32]:
    """Pillars of points, gaps in them, noise around, and heights on the borders of the zone."""
    rng = np.random.default_rng(seed)
    place = rng.uniform((0.5, -2.0), (5.0, 2.0), (12, 2))[rng.integers(0, 12, count)]
    xy = place + rng.normal(0.0, 0.06, (count, 2))
    z = rng.choice([0.05, 0.1]) * rng.integers(-4, 50, count) + rng.normal(0.0, 0.02, count)
    z[:40] = rng.choice([0.2, 1.4, 1.45, 4.4], 40)
    return np.asfortranarray(np.column_stack([xy, z]).astype(np.float32))


def random_view(
    base: RobotConfig, *, vertical: float = 0.0, offset: float = 0.0, **changes: object
) -> tuple[StereoImages, Stages, StereoCamera, RobotConfig]:
    """A view of noise that is shifted, through a head that looks down, aside and obliquely."""
    rng = np.random.default_rng(7)
    scene = rng.integers(0, 256, (100, 140), dtype=np.uint8)
    camera = StereoCamera(
        width=100, height=70, fx=90.0, fy=95.0, cx=50.3, cy=33.1, baseline=0.1,
        disparity_offset_px=offset, vertical_baseline=vertical, vertical_offset_px=-0.6 * offset,
        mounting=Mounting(height=1.2, forward=0.1, left=-0.2, pitch=0.2, roll=-0.1, yaw=0.4),
    )  # fmt: skip
    images = StereoImages(
        5, *(np.ascontiguousarray(scene[v : v + 70, u : u + 100])
             for u, v in ((10, 10), (16, 10), (10, 4 if vertical > 0 else 16))),
    )  # fmt: skip
    config = RobotConfig.from_mapping(
        {
            "noise.min_points": 2, "zones.low": 0.0, "bodies.min_score": -20.0,
            "bodies.min_extent": 0.05, "disparity.min_range": 0.7, **changes,
        },
        base=base,
    )  # fmt: skip
    return images, RobotPipeline("r", camera, config).stages(images), camera, config


def random_scans(seed: int) -> Scene:
    """Scans of up to three robots with cells anywhere."""
    rng = np.random.default_rng(seed)
    scans, poses = [], {}
    for robot in ("b", "a", "c")[: 1 + seed % 3]:
        n = int(rng.integers(0, 120))
        xy = (rng.integers(0, 60, (n, 2)) + 0.5) * 0.05
        z, z_min, top = rng.uniform(0.2, 1.4, n), np.full(n, 0.2), rng.uniform(1.0, 1.9, n)
        x, y, z, z_min, top = (v.astype(np.float32) for v in (*xy.T, z, z_min, top))
        count = rng.integers(1, 99, n, dtype=np.uint32)
        scans.append(Scan(robot, 0, Cells(x, y, z, z_min, top, count)))
        root, place = rng.normal(0.0, 0.05, (3, 3)), rng.uniform(-3, 3, 3)
        poses[robot] = Pose(0, place[0], place[1], place[2], root @ root.T)
    return scans, poses


def with_bodies(scan: Scan, rng: np.random.Generator) -> Scan:
    """The scan with most of its cells being those of bodies."""
    n = len(scan.cells)
    of_body = rng.uniform((-4.0, 0.01, 0.01), (6.0, 0.4, 0.2), (9, 3)).astype(np.float32)
    body = rng.integers(0, 9, n, dtype=np.uint32)
    score, sigma_range, sigma_across = of_body[body].T.copy()
    cells = dataclasses.replace(
        scan.cells, body=body, score=score, sigma_range=sigma_range, sigma_across=sigma_across
    )
    return dataclasses.replace(scan, cells=cells)


def _patch(x: float, y: float, width: float) -> list[tuple[float, float]]:
    """Cells of 5 cm of somebody as wide as this along y, 0.2 m deep, on the map."""
    return [
        (x + dx, y + dy)
        for dx in np.arange(-0.075, 0.1, 0.05)
        for dy in np.arange(0.025 - width / 2, width / 2, 0.05)
    ]


def _scan(robot: str, stamp_ms: int, pose: Pose, things: Sequence[tuple[float, ...]]) -> Scan:
    """Things on the map as (x, y, width, score), as one robot sends them; score NaN: no body."""
    rows = []
    for number, (x, y, width, score) in enumerate(things, 1):
        for place in _patch(x, y, width):
            body = 0 if np.isnan(score) else number
            rows.append((*place, body, 0.0 if np.isnan(score) else score))
    x, y, body, score = np.array(rows).T
    cos, sin = np.cos(pose.yaw), np.sin(pose.yaw)
    dx, dy = x - pose.x, y - pose.y
    one = np.ones(len(x), dtype=np.float32)
    cells = Cells(
        x=(cos * dx + sin * dy).astype(np.float32), y=(cos * dy - sin * dx).astype(np.float32),
        z=1.4 * one, z_min=0.2 * one, top=1.7 * one, count=np.full(len(x), 20, dtype=np.uint32),
        body=body.astype(np.uint32), score=score.astype(np.float32), sigma_range=0.15 * one,
        sigma_across=0.04 * one,
    )  # fmt: skip
    return Scan(robot, stamp_ms * 1_000_000, cells)


def mixed_team() -> tuple[Scene, OccupancyGrid]:
    """A team with both methods in one room, in which each stage of the planner has work.

    Robots a and b send cells, c and d bodies. There are: two people shoulder to shoulder, one whom
    both kinds of robots see, one whom c and d see where their errors let them, a fragment beside,
    robots that others see, and a wall.
    """
    nan, sure = np.nan, np.diag([0.02**2, 0.02**2, 0.01**2])
    poses = {
        "a": Pose(0, 0.0, 0.0, 0.1, sure), "b": Pose(0, 4.0, 3.0, -2.4, sure),
        "c": Pose(0, 0.0, 3.0, -0.7, sure), "d": Pose(0, 4.0, 0.0, 2.4, sure),
    }  # fmt: skip
    things = {
        "a": [(2.0, 0.3, 1.0, nan), (4.0, 3.0, 0.3, nan), (2.0, 2.0, 0.5, nan),
              (4.95, 1.5, 0.5, nan)],
        "b": [(2.05, 2.0, 0.5, nan)],
        "c": [(2.0, 2.05, 0.4, 3.0), (3.0, 1.5, 0.4, 2.0), (4.0, 0.1, 0.3, 1.0),
              (4.9, 1.0, 0.4, 1.0), (1.0, 1.0, 0.4, 5.0)],
        "d": [(2.0, 1.95, 0.4, 1.0), (3.1, 1.6, 0.4, 1.5), (3.4, 1.2, 0.4, 0.9),
              (1.05, 1.35, 0.4, 4.0)],
    }  # fmt: skip
    stamps_ms = {"a": 3, "b": 0, "c": 7, "d": 5}
    scans = [_scan(name, stamps_ms[name], poses[name], things[name]) for name in poses]
    data = np.zeros((50, 60), dtype=np.int8)
    data[:, 51] = 100
    data[:, 52:] = -1
    return (scans, poses), OccupancyGrid(0.1, -0.1, -0.5, 0.0, data)


def furnished_room(seed: int, steps: int = 60) -> tuple[list[Scene], list[int]]:
    """Two robots, one of which drives and is gone for a while, in a room with furniture.

    There are: furniture that looks doubtful from most sides, a person who stands, one who walks up
    to a piece of furniture, stays, and leaves, and one who walks past. Times pause and go back.

    Returns:
        Scans and poses of each interval, and their times [ns].
    """
    rng = np.random.default_rng(seed)
    scenes, times_ns, now_ms = [], [], 0
    for step in range(steps):
        now_ms += -150 if step == 21 else 2_500 if step == 40 else int(rng.integers(60, 160))
        walker = (3.0, 4.0 - 0.12 * min(step, 20) + 0.15 * max(step - 45, 0))
        places = [
            (2.0, -1.0, 0.4), (3.0, 1.5, 0.8), (4.0, -0.5, -0.5), (2.5, 0.3, 2.0),
            (*walker, 3.5), (5.0, 3.0 - 0.1 * step, 3.0),
        ]  # fmt: skip
        poses = {"a": Pose(0, 0.02 * step, 0.0, 0.0), "b": Pose(0, 0.0, 2.0, -0.1)}
        scans = []
        for name in list(poses)[: 1 if 25 < step < 35 else 2]:
            noisy = [
                (*rng.normal((x, y), 0.06), 0.3, rng.normal(score, 0.7)) for x, y, score in places
            ]
            seen = [body for body in noisy if rng.random() < 0.85] or noisy
            scans.append(_scan(name, now_ms, poses[name], seen))
        scenes.append((scans, poses))
        times_ns.append(now_ms * 1_000_000)
    return scenes, times_ns

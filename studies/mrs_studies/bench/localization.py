"""What it costs a robot to know where its team is: robots in a corridor, with walls and poses."""

from __future__ import annotations

import gc
import math
from collections.abc import Callable
from typing import Any

import numpy as np

from mrs_people_loc import timing
from mrs_people_loc.config import Localization
from mrs_people_loc.localization.localizer import Localizer
from mrs_people_loc.localization.shared import TeamPose
from mrs_people_loc.localization.walls import SeenWalls, Walls
from mrs_people_loc.team.poses import Pose

#: Numbers of robots; poses and frames per second; seconds that are timed, and before.
SIZES, _POSES_HZ, _FRAMES_HZ, _SECONDS, _BEFORE_S = (3, 8), 100, 10, 6, 2
_SHARED_HZ = round(Localization().share_rate)
_HALF_WIDTH, _SPEED = 1.25, 0.7
_SIGMAS = np.array([0.02, 0.01])


def time_localization(on_step: Callable[[str], None] = lambda _: None) -> list[dict[str, Any]]:
    """Times one robot of a team that drives along a corridor.

    Every message counts with what has to be computed again because of it.

    Args:
        on_step: Told what is done now.

    Returns:
        For each number of robots: the means of a shared pose (`shared_ms`), of the walls of a
        frame (`walls_ms`) and of the own odometry (`odometry_ms`), the most that one shared pose
        took (`shared_most_ms`), and all of these together from one frame to the next (`frame_ms`,
        `frame_p99_ms`).
    """
    rows = []
    # A full garbage collection takes 50 ms where a bag is in memory, in one of 60 frames.
    gc.collect()
    gc.freeze()
    try:
        for count in SIZES:
            on_step(f"localizing {count} robots")
            took = _drive(count)
            means = {f"{what}_ms": float(np.mean(ms)) for what, ms in took.items()}
            most, p99 = max(took["shared"]), float(np.percentile(took["frame"], 99))
            rows.append({"robots": count, **means, "shared_most_ms": most, "frame_p99_ms": p99})
    finally:
        gc.unfreeze()
    return rows


def _drive(count: int) -> dict[str, list[float]]:
    """Times of the first robot's odometry, walls, messages heard, and all of a frame [ms]."""
    rng = np.random.default_rng(count)
    team = [Localizer(f"robot_{k}", Localization()) for k in range(count)]
    took: dict[str, list[float]] = {"odometry": [], "walls": [], "shared": []}
    told: list[TeamPose] = []
    for step in range((_BEFORE_S + _SECONDS) * _POSES_HZ):
        stamp_ns = 1_000_000_000 + step * 1_000_000_000 // _POSES_HZ
        if step == _BEFORE_S * _POSES_HZ:
            took = {what: [] for what in took}
        for k, one in enumerate(team):
            pose = Pose(stamp_ns, _SPEED * step / _POSES_HZ - 1.5 * (k // 2), 0.5 - k % 2, 0.0)
            first = took if k == 0 else {"odometry": [], "walls": []}
            _timed(first["odometry"], one.take_odometry, pose)
            if (step + k) % (_POSES_HZ // _FRAMES_HZ) == 0:
                seen = SeenWalls(stamp_ns, _sides(pose, rng))
                _timed(first["walls"], _seen, one, seen)
        for message in told:
            _timed(took["shared"], team[0].take_teammate, message)
        # What the others send now arrives with the next step.
        shares = step % (_POSES_HZ // _SHARED_HZ) == 0
        told = [one.share() for one in team[1:]] if shares else []
    # Of each kind, the same number falls on every frame.
    parts = [np.reshape(ms, (_SECONDS * _FRAMES_HZ, -1)).sum(axis=1) for ms in took.values()]
    return {**took, "frame": np.sum(parts, axis=0).tolist()}


def _timed(times: list[float], call: Callable[..., object], *values: object) -> None:
    began = timing.now_ns()
    call(*values)
    times.append((timing.now_ns() - began) / 1e6)


def _seen(one: Localizer, seen: SeenWalls) -> None:
    one.take_walls(seen)
    one.pose_at(seen.stamp_ns)


def _sides(pose: Pose, rng: np.random.Generator) -> Walls:
    """Both walls of the corridor, 1 to 4 m ahead."""
    errors = rng.normal(size=(2, 2)) * _SIGMAS
    sides = np.array([1.0, -1.0])
    ahead = np.array([-4.0, -1.0])
    return Walls(
        distance=_HALF_WIDTH - sides * pose.y + errors[:, 0],
        bearing=sides * math.pi / 2 + errors[:, 1],
        covariance=np.tile(np.diag(_SIGMAS**2), (2, 1, 1)),
        extent=np.array([ahead, -ahead[::-1]]),
        is_end=np.zeros((2, 2), dtype=bool),
    )

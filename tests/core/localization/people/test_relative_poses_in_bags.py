"""Relative poses by people in rendered images, where robots are elsewhere than they say."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from mrs_people_loc.geometry import rotation_2d, wrap_angle
from mrs_people_loc.localization.people.relative_poses import RelativePoses
from mrs_people_loc.localization.people.seen_people import people_by_robot
from mrs_people_loc.localization.shared import YAW_UNKNOWN, RelativePose
from mrs_people_loc.planner import Planner
from mrs_people_loc.team.fusion import fuse
from mrs_people_loc.team.poses import Pose

pytest.importorskip("rosbags.interfaces", reason="reading bags needs rosbags")

from mrs_tools.bags.offline import BagRun

BAGS = Path(__file__).resolve().parents[4] / "bags"


@pytest.fixture(scope="module", params=["paper_formation", "walking_group"])
def bag(request):
    """The intervals of a bag, whose poses are exact, and the planner's configuration."""
    run = BagRun(BAGS / request.param)
    return list(run.intervals()), run.team.planner


def moved(pose: Pose, first: Pose, by, sigmas) -> Pose:
    """A pose whose whole way is turned about its first place, and moved."""
    x, y = rotation_2d(by[2]) @ (pose.x - first.x, pose.y - first.y)
    return Pose(
        pose.stamp_ns, first.x + x + by[0], first.y + y + by[1], pose.yaw + by[2],
        np.diag(np.square(sigmas)),
    )  # fmt: skip


def displaced(intervals, by, sigmas):
    """By interval, the poses that robots say that they have; `by` robot x, y, yaw."""
    first: dict[str, Pose] = {}
    for interval in intervals:
        poses = interval.people.poses
        for name, pose in poses.items():
            first.setdefault(name, pose)
        yield {name: moved(pose, first[name], by[name], sigmas) for name, pose in poses.items()}


def relative(one: Pose, other: Pose):
    x, y = rotation_2d(-one.yaw) @ (other.x - one.x, other.y - one.y)
    return np.array([x, y, wrap_angle(other.yaw - one.yaw)])


def measure(bag, by, sigmas):
    """All measurements, and what they are wrong by: x, y, yaw, shape (n, 3)."""
    intervals, config = bag
    relatives, true, measured, errors = RelativePoses(), {}, [], []
    for interval, poses in zip(intervals, displaced(intervals, by, sigmas), strict=True):
        true.update(
            ((name, scan.stamp_ns), interval.people.poses[name])
            for scan in interval.scans
            for name in [scan.robot]
        )
        seen = people_by_robot(fuse(interval.scans, poses), poses, config)
        for one in relatives.step(seen, poses):
            if not isinstance(one, RelativePose) or one.covariance[2, 2] >= YAW_UNKNOWN:
                continue
            measured.append(one)
            wanted = relative(true[one.robot, one.stamp_ns], true[one.other, one.other_stamp_ns])
            error = one.pose - wanted
            errors.append([*error[:2], wrap_angle(error[2])])
    return measured, np.array(errors).reshape(-1, 3)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("position", "turn", "told", "least"),
    [(0.0, 0.0, 0.05, 6), (0.3, 5.0, 0.0, 4), (0.3, 5.0, 0.3, 4), (1.0, 15.0, 1.0, 1)],
)
def test_recovers_relative_poses(bag, show, position, turn, told, least):
    """Every robot is displaced; told: standard deviation of the position that its pose has [m]."""
    measured, errors = [], np.empty((0, 3))
    sigmas = (told, told, told * math.radians(15.0))
    for seed in range(4):
        random = np.random.default_rng(seed)
        by = {}
        for name in ("robot_a", "robot_b", "robot_c"):
            angle, sign = random.uniform(-math.pi, math.pi), random.choice([-1.0, 1.0])
            by[name] = np.array(
                [position * math.cos(angle), position * math.sin(angle), sign * math.radians(turn)]
            )
        found, wrong_by = measure(bag, by, sigmas)
        measured += found
        errors = np.concatenate([errors, wrong_by])
    away, turned = np.hypot(*errors[:, :2].T), np.degrees(np.abs(errors[:, 2]))
    covariances = np.array([one.covariance for one in measured])
    nees = np.einsum("ni,nij,nj->n", errors, np.linalg.inv(covariances), errors)
    show(
        f"{position} m, {turn} degrees, told {told} m: {len(away)} measured, median and 95 %: "
        f"{np.median(away):.3f} {np.percentile(away, 95):.3f} m, "
        f"{np.median(turned):.1f} {np.percentile(turned, 95):.1f} degrees, "
        f"NEES {nees.mean():.2f}, at most {nees.max():.1f}"
    )
    assert len(away) >= least
    assert np.median(away) < 0.13
    assert np.percentile(away, 95) < 0.35
    assert np.percentile(turned, 95) < 6.0
    assert nees.mean() < 4.5


def test_people_are_seen_once_after_alignment():
    """robot_c is 1 m and 15 degrees off, and says that it may be: it sees people of its own."""
    run = BagRun(BAGS / "paper_formation", tracking=False)
    intervals, config = list(run.intervals()), run.team.planner
    off = dict.fromkeys(("robot_a", "robot_b", "robot_c"), np.zeros(3))
    off["robot_c"] = np.array([0.6, -0.8, math.radians(15.0)])
    planner, relatives = Planner(config), RelativePoses()
    aligned: Pose | None = None
    before, after = [], []
    for interval, poses in zip(
        intervals, displaced(intervals, off, (0.02, 0.02, 0.01)), strict=True
    ):
        rough = np.diag(np.square([1.0, 1.0, math.radians(15.0)]))
        poses["robot_c"] = dataclasses.replace(poses["robot_c"], covariance=rough)
        for one in relatives.step(
            people_by_robot(fuse(interval.scans, poses), poses, config), poses
        ):
            if not isinstance(one, RelativePose) or one.covariance[2, 2] >= YAW_UNKNOWN:
                continue
            if one.other == "robot_c":
                aligned = poses[one.robot] @ Pose(one.other_stamp_ns, *one.pose.tolist())
        counts = before if aligned is None else after
        placed = {**poses, "robot_c": aligned or off_and_sure(poses["robot_c"])}
        counts.append(len(planner.step(interval.scans, placed, interval.people.stamp_ns).persons))
    placed_right = np.mean([len(interval.people.persons) for interval in intervals])
    assert placed_right == pytest.approx(5, abs=0.3)
    assert np.mean(before) > 6.5
    assert np.mean(after) == pytest.approx(placed_right, abs=0.2)


def off_and_sure(pose: Pose) -> Pose:
    """A pose as if it were exact: with its covariance all that it sees would join with anything."""
    return dataclasses.replace(pose, covariance=np.zeros((3, 3)))

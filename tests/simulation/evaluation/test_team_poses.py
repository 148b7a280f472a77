"""Scores of robots' poses in bags, with figures that were worked out by hand."""

from __future__ import annotations

import io
from pathlib import Path

import numpy as np
import pytest

from mrs_people_loc.errors import BagError

pytest.importorskip("rosbags.interfaces", reason="writing bags needs rosbags")

from rich.console import Console

from mrs_people_sim.evaluation.results import evaluate_bag
from mrs_people_sim.evaluation.robot_poses import placed_at_start, read_true_poses
from mrs_people_sim.evaluation.tables import show
from mrs_people_sim.scoring.poses import PoseTrack
from mrs_tools.bags.reader import BagReader
from mrs_tools.bags.writer import BagWriter
from tools.made_bag import Bag

CELL = 0.05


def true_pose(bag: Bag, robot: str, ms: float, x: float, y: float, yaw: float = 0.0) -> None:
    header = bag.header(ms, "map")
    message = bag.make("geometry_msgs/msg/PoseStamped", header=header, pose=bag.pose(x, y, yaw))
    bag.write(f"/ground_truth/{robot}/pose", ms, message)


def odometry(bag: Bag, robot: str, ms: float, x: float, y: float, yaw: float = 0.0) -> None:
    message = bag.make(
        "nav_msgs/msg/Odometry",
        header=bag.header(ms, f"{robot}/odom"),
        child_frame_id=f"{robot}/base_link",
        pose=bag.uncertain(x, y, yaw),
        twist=bag.twist(0.0, 0.0),
    )
    bag.write(f"/{robot}/odom", ms, message)


def track(*rows: tuple[float, float, float, float]) -> PoseTrack:
    stamps = np.array([round(row[0] * 1e9) for row in rows], dtype=np.int64)
    poses = np.array([row[1:] for row in rows], dtype=float)
    return PoseTrack(stamps, poses, np.zeros((len(rows), 3, 3)))


@pytest.fixture
def bag(tmp_path: Path) -> Path:
    """A robot drives along x at 1 m/s and believes that it is 0.2 m to the left; a person stands.

    Its odometry begins elsewhere and is 1 % too long.
    """
    with BagWriter(tmp_path / "bag") as writer:
        made = Bag(writer)
        for ms in range(0, 3001, 200):
            x = ms / 1000
            true_pose(made, "robot_a", ms, x, 0.0)
            made.pose_topic("robot_a", ms, x, 0.2)
            odometry(made, "robot_a", ms, 5.0, -1.01 * x, -np.pi / 2)
            made.truth(ms, (6.0, 0.0))
            made.points("robot_a", ms, (6.0 - x, 0.0))
    return tmp_path / "bag"


def test_poses_are_scored_where_the_bag_has_true_ones(bag):
    paper = Path(__file__).resolve().parents[3] / "config" / "paper.yaml"
    report = evaluate_bag(bag, [paper]).report()
    poses = report["poses"]
    assert poses["across_m"]["max"] == pytest.approx(0.2)
    assert poses["along_m"]["max"] == pytest.approx(0.0, abs=1e-9)
    assert poses["runs"] == 1
    # Variances of 1e-4 m^2: 0.2 m are 20 standard deviations.
    assert poses["nees"]["mean"] == pytest.approx(400.0)
    assert poses["odometry"]["along_m"]["max"] == pytest.approx(0.03)
    assert poses["odometry"]["across_m"]["max"] == pytest.approx(0.2)
    # The person is seen 0.2 m off, too, but not with the exact pose or after a move of the team.
    assert report["people"]["error_m"]["mean"] == pytest.approx(0.2, abs=1e-6)
    assert poses["people_in_team_frame"]["error_m"]["mean"] == pytest.approx(0.0, abs=1e-6)
    assert poses["people_with_exact_poses"]["error_m"]["mean"] == pytest.approx(0.0, abs=1e-6)
    assert poses["people_with_exact_poses"]["recall"] == 1.0


@pytest.mark.parametrize("localize", [False, True])
def test_scans_without_poses_are_placed_by_odometry(tmp_path, localize):
    with BagWriter(tmp_path / "bag") as writer:
        made = Bag(writer)
        for ms in range(0, 3001, 200):
            x = ms / 1000
            true_pose(made, "robot_a", ms, x, 0.0)
            odometry(made, "robot_a", ms, x, 0.0)
            made.truth(ms, (6.0, 0.3))
            made.points("robot_a", ms, (5.0 - x, 0.0))
    beside = (
        "robot_a/robot_node: {ros__parameters: {pose: {map_from_odom: [1.0, 0.3, 0.0]}, "
        "localization: {start_sigmas: [1.0, 1.0, 0.1]}}}"
    )
    (tmp_path / "bag.yaml").write_text(beside, encoding="utf-8")
    paper = Path(__file__).resolve().parents[3] / "config" / "paper.yaml"
    report = evaluate_bag(tmp_path / "bag", [paper], localize=localize).report()
    assert report["poses"]["along_m"]["median"] == pytest.approx(1.0)
    assert report["poses"]["across_m"]["median"] == pytest.approx(0.3)
    assert report["people"]["error_m"]["mean"] == pytest.approx(0.0, abs=1e-6)
    # The messages say 0.1 m.
    nees = report["poses"]["nees"]["mean"]
    assert 0.5 < nees < 1.1 if localize else nees == pytest.approx(109.0)


def test_tables_of_poses_are_only_of_bags_that_have_them(bag, tmp_path):
    with BagWriter(tmp_path / "other") as writer:
        made = Bag(writer)
        for ms in (0, 100, 200):
            made.truth(ms, (1.0, 0.0))
            made.people(ms, (1.0, 0.0))
    results = {"with": evaluate_bag(bag), "without": evaluate_bag(tmp_path / "other")}
    assert "poses" not in results["without"].report()
    console = Console(width=120, file=io.StringIO())
    show(results, console)
    assert isinstance(console.file, io.StringIO)
    text = console.file.getvalue().partition("robots' poses")[2].partition("time [ms]")[0]
    assert "with" in text
    assert "without" not in text
    assert "total" not in text


def test_recorded_people_are_scored_with_the_poses_that_were_sent(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        made = Bag(writer)
        for ms in range(0, 2001, 100):
            true_pose(made, "robot_a", ms, 1.0, 1.0)
            made.pose_topic("robot_a", ms, 1.0, 1.0, 0.1)
            made.truth(ms, (3.0, 1.0))
            made.people(ms, (3.0, 1.0))
    poses = evaluate_bag(tmp_path / "bag", recorded=True).report()["poses"]
    assert poses["heading_deg"]["median"] == pytest.approx(np.degrees(0.1))
    assert poses["people_with_exact_poses"] is None
    assert poses["odometry"] is None


def test_a_true_pose_of_another_type_is_refused(tmp_path):
    with BagWriter(tmp_path / "bag") as writer:
        made = Bag(writer)
        made.truth(0, (1.0, 1.0))
        made.pose_topic("ground_truth/robot_a", 0, 1.0, 1.0)
    with BagReader(tmp_path / "bag") as reader, pytest.raises(BagError, match="PoseStamped"):
        read_true_poses(reader, ["robot_a"])


def test_odometry_begins_at_the_first_estimated_pose():
    # Ahead in the odometry's frame is y; in the map it is -x.
    alone = track((0, 3.0, 4.0, np.pi / 2), (1, 3.0, 5.0, np.pi / 2), (2, 3.0, 6.0, np.pi))
    placed = placed_at_start(alone, track((1, 7.0, 7.0, np.pi)))
    assert placed is not None
    assert placed.stamps_ns.tolist() == [10**9, 2 * 10**9]
    np.testing.assert_allclose(
        placed.poses, [[7.0, 7.0, np.pi], [6.0, 7.0, 1.5 * np.pi]], atol=1e-12
    )


@pytest.mark.parametrize("estimated", [track(), track((5, 0.0, 0.0, 0.0))])
def test_odometry_without_a_common_time_is_not_placed(estimated):
    assert placed_at_start(track((0, 0.0, 0.0, 0.0), (1, 1.0, 0.0, 0.0)), estimated) is None

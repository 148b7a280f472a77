"""Localization of the robots of a bag."""

from __future__ import annotations

from pathlib import Path

import pytest

pytest.importorskip("rosbags.interfaces", reason="writing bags needs rosbags")
pytest.importorskip("embreex", reason="the simulator needs embreex")

from mrs_people_loc.config import RobotConfig
from mrs_people_loc.localization.robot_localization import RobotLocalization
from mrs_people_loc.team.quarantine import Quarantine
from mrs_people_sim.evaluation.results import evaluate_bag
from mrs_people_sim.render_scene import simulate
from mrs_people_sim.scene import read_scene
from mrs_tools.bags.offline import BagRun
from mrs_tools.bags.team_localization import range_handlers

pytestmark = pytest.mark.slow

#: Two robots drive side by side through a corridor, with odometry that drifts quickly.
SCENE = {
    "seed": 5,
    "timing": {"frames": 16, "rate": 4.0},
    "room": {"length": 9.0, "width": 3.2},
    "people": [{"path": [2.5, 1.6, 7.0, 1.6], "speed": 0.7}],
    "robots": {
        "robot_a": {"path": [1.0, 1.0, 6.0, 1.0], "speed": 0.7},
        "robot_b": {"path": [1.0, 2.2, 6.0, 2.2], "speed": 0.7},
    },
    "sonars": [
        {"x": x, "y": side * 0.2, "yaw": side * 1.5708} for side in (-1, 1) for x in (-0.15, 0.15)
    ],
    "odometry": {"mode": "drift", "sigma": 0.005, "sigma_yaw": 0.002, "drift": 0.08,
                 "drift_yaw": 0.04},
}  # fmt: skip


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("localization") / "bag"
    simulate(read_scene(SCENE, "scene"), out)
    return out


def test_robots_know_better_than_their_odometry_where_they_are(bag):
    poses = evaluate_bag(bag, localize=True).report()["poses"]
    across = poses["across_m"]["median"]
    assert across < 0.7 * poses["odometry"]["across_m"]["median"]
    assert poses["nees"]["mean"] < poses["nees"]["high"]


def test_without_the_option_poses_are_those_of_the_odometry(bag):
    poses = evaluate_bag(bag).report()["poses"]
    assert poses["across_m"]["median"] == pytest.approx(
        poses["odometry"]["across_m"]["median"], abs=0.005
    )


def test_a_run_begins_anew_each_time(bag):
    run = BagRun(bag, localize=True)
    one, other = (
        [interval.people.poses["robot_a"].y for interval in run.intervals()] for _ in range(2)
    )
    assert one == other


def test_robot_in_quarantine_is_left_out(bag, monkeypatch):
    monkeypatch.setattr(Quarantine, "at", lambda self, now_ns: {"robot_b": "it is lost"})
    intervals = list(BagRun(bag, localize=True).intervals())
    assert len(intervals) > 10
    assert {robot for one in intervals for robot in one.people.poses} == {"robot_a"}
    assert {scan.robot for one in intervals for scan in one.scans} == {"robot_a"}
    assert {one.people.quarantined for one in intervals} == {("robot_b",)}


def test_topics_of_range_sensors_follow_the_configuration():
    config = RobotConfig.from_mapping(
        {"walls": {"sonars": ["left", "/other/right"], "sonar_mountings": [0.0] * 6,
                   "laser": True, "laser_mounting": [0.1, 0.0, 0.0]}}
    )  # fmt: skip
    assert sorted(topics(config)) == ["/other/right", "/robot_a/left", "/robot_a/scan"]
    without = RobotConfig.from_mapping({"walls": {"sonars": ["left"], "laser": True}})
    assert not topics(without)


def topics(config: RobotConfig) -> list[str]:
    return [*range_handlers("robot_a", RobotLocalization("robot_a", config), config.walls)]

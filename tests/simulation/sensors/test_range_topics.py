"""Bags with sonars, a laser scanner and slipping wheels."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rosbags.interfaces", reason="writing bags needs rosbags")
pytest.importorskip("embreex", reason="the simulator needs embreex")

from mrs_people_loc.messages import read_laser_scan, read_range
from mrs_people_sim.scene import read_scene
from mrs_people_sim.views.world import World
from mrs_people_sim.writer import write_bag
from mrs_tools.bags.reader import BagReader

SCENE = {
    "timing": {"frames": 11, "rate": 10.0, "start": 100.0},
    "room": {"length": 8.0, "width": 4.0, "posters": 0, "doors": 0},
    "people": [{"x": 4.0, "y": 1.0}],
    "robots": {
        "robot_a": {"x": 2.0, "y": 1.0, "laser": {"rays": 4, "field_of_view": 6.2832, "noise": 0.0,
                                                   "dropout": 0.0, "rate": 5.0}},
        "robot_b": {"x": 6.0, "y": 2.0},
    },
    "sonars": [
        {"y": 0.2, "yaw": math.pi / 2, "noise": 0.0, "least_noise": 0.0, "dropout": 0.0,
         "cross_talk": 0.0},
        {"x": -0.1, "yaw": math.pi, "height": 0.3, "max_range": 1.0, "cross_talk": 0.0},
    ],
}  # fmt: skip


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A bag without images: what comes without rendering."""
    out = tmp_path_factory.mktemp("ranges") / "bag"
    write_bag(out, World(read_scene(SCENE, "scene")), iter([]))
    return out


def test_sonars_measure_the_walls(bag):
    with BagReader(bag) as reader:
        left = [read_range(m) for _, _, m in reader.decoded(["/robot_a/sonar_0"])]
        behind = [read_range(m) for _, _, m in reader.decoded(["/robot_a/sonar_1"])]
    assert [one.stamp_ns for one in left] == [round((100 + 0.1 * k) * 1e9) for k in range(11)]
    assert left[0].frame_id == "robot_a/sonar_0"
    # From y = 1.2 to the skirting before the wall at y = 4 or to the wall.
    assert left[0].range == pytest.approx(2.8, abs=0.03)
    # The wall behind is farther than it reaches.
    assert all(math.isinf(one.range) for one in behind)


def test_a_laser_measures_walls_and_people(bag):
    with BagReader(bag) as reader:
        scans = [read_laser_scan(m) for _, _, m in reader.decoded(["/robot_a/scan"])]
        assert "/robot_b/scan" not in reader.topics
    assert len(scans) == 6
    # Rays at -135, -45, 45 and 135 degrees from (2, 1): the floor's corners are walls.
    expected = [math.sqrt(2.0), math.sqrt(2.0), 3.0 * math.sqrt(2.0), 2.0 * math.sqrt(2.0)]
    np.testing.assert_allclose(scans[0].ranges, expected, atol=0.05)


def test_mountings_are_on_tf_static(bag):
    with BagReader(bag) as reader:
        ((_, _, message),) = reader.decoded(["/tf_static"])
    frames = {t.child_frame_id: t for t in message.transforms}
    assert sorted(frames) == [
        "robot_a/laser", "robot_a/sonar_0", "robot_a/sonar_1", "robot_b/sonar_0", "robot_b/sonar_1"
    ]  # fmt: skip
    behind = frames["robot_b/sonar_1"]
    assert behind.header.frame_id == "robot_b/base_link"
    assert behind.transform.translation.x == pytest.approx(-0.1)
    assert behind.transform.translation.z == pytest.approx(0.3)
    assert abs(behind.transform.rotation.z) == pytest.approx(1.0)


def test_a_scene_without_such_sensors_has_no_such_topics(tmp_path):
    plain = {key: value for key, value in SCENE.items() if key not in ("sonars", "robots")}
    scene = read_scene({**plain, "robots": {"robot_a": {"x": 2.0, "y": 1.0}}}, "scene")
    write_bag(tmp_path / "bag", World(scene), iter([]))
    with BagReader(tmp_path / "bag") as reader:
        assert sorted(reader.topics) == ["/ground_truth/robot_a/pose", "/map", "/robot_a/odom"]

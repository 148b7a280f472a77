"""Files for RViz and Foxglove use what these have, with topics and types that are published.

Neither is among the wheels; on a file that names what it does not know RViz shows an error at that
display only, and Foxglove shows an empty panel.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
import rclpy
import yaml
from mrs_people_msgs.msg import Group, People
from rclpy.qos import ReliabilityPolicy
from visualization_msgs.msg import MarkerArray

from mrs_people_loc import messages
from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.guiding.guidance import Guidance, Post, Role, State
from mrs_people_loc.guiding.tour import tour_from
from mrs_people_loc.planner import Planner
from mrs_people_loc.team.poses import Pose
from mrs_ros import convert
from mrs_ros.markers import markers, tour_markers
from mrs_tools.bags.reader import BagReader
from planner_node.guide_node.node import GuideNode
from planner_node.node import PlannerNode
from robot_node.node import RobotNode
from ros.harness import ROOT
from ros.planner_peer import cloud_of, person_cells

#: Displays of rviz_default_plugins (Jazzy) and the messages they draw.
DRAWN = {
    "Grid": None,
    "MarkerArray": "visualization_msgs/msg/MarkerArray",
    "PointCloud2": "sensor_msgs/msg/PointCloud2",
    "PointStamped": "geometry_msgs/msg/PointStamped",
    "PoseArray": "geometry_msgs/msg/PoseArray",
}
OTHERS = {
    *(f"rviz_default_plugins/{tool}" for tool in ("Interact", "MoveCamera", "Select")),
    *(f"rviz_default_plugins/{tool}" for tool in ("FocusCamera", "Measure")),
    *(f"rviz_default_plugins/{view}" for view in ("Orbit", "TopDownOrtho")),
    *(f"rviz_common/{panel}" for panel in ("Displays", "Views")),
}


@pytest.fixture(params=sorted(ROOT.glob("config/*.rviz")), ids=lambda path: path.name)
def config(request: pytest.FixtureRequest) -> Any:
    return yaml.safe_load(request.param.read_text())


@pytest.fixture
def published(domain: int) -> Iterator[dict[str, tuple[str, bool]]]:
    """The topics of the planner, a robot and the guide: type, and whether it is reliable."""
    rclpy.init(args=["node", "--ros-args", "-p", "autostart:=false", "-r", "robot_node:__ns:=/r"])
    nodes = [PlannerNode(), RobotNode(), GuideNode()]
    try:
        topics = {}
        for node in nodes:
            node.trigger_configure()
            for publisher in node.publishers:
                kind: Any = publisher.msg_type
                name = "/".join((*kind.__module__.split(".")[:2], kind.__name__))
                reliable = publisher.qos_profile.reliability is ReliabilityPolicy.RELIABLE
                topics[publisher.topic_name] = (name, reliable)
        yield topics
    finally:
        for node in nodes:
            node.destroy_node()
        rclpy.shutdown()


def displays(config: Any, kind: str = "") -> list[Any]:
    found = config["Visualization Manager"]["Displays"]
    return [d for d in found if d["Class"].endswith(f"/{kind}" if kind else "")]


def test_displays_use_published_topics_and_types(
    config: Any, published: dict[str, tuple[str, bool]]
) -> None:
    for display in displays(config):
        package, _, kind = display["Class"].partition("/")
        assert package == "rviz_default_plugins"
        assert display["Enabled"] == display["Value"], display["Name"]
        if DRAWN[kind] is None:
            continue
        type_name, reliable = published[display["Topic"]["Value"]]
        assert type_name == DRAWN[kind]
        assert display["Topic"]["Reliability Policy"] == "Best Effort" or reliable
        assert display["Topic"]["Durability Policy"] == "Volatile"


def test_every_class_exists_in_rviz(config: Any) -> None:
    def classes(part: Any) -> Iterator[str]:
        if isinstance(part, dict):
            if part.get("Class"):
                yield part["Class"]
            for value in part.values():
                yield from classes(value)
        elif isinstance(part, list):
            for item in part:
                yield from classes(item)

    assert set(classes(config)) <= OTHERS | {f"rviz_default_plugins/{kind}" for kind in DRAWN}


def test_fixed_frame_is_the_common_one(config: Any) -> None:
    frame = config["Visualization Manager"]["Global Options"]["Fixed Frame"]
    assert frame == PlannerConfig().map_frame


def test_channels_and_namespaces_are_published(config: Any) -> None:
    cloud = cloud_of(person_cells(2.0, 0.0), "robot_a/base_link", 10**9)
    scan = messages.read_scan(cloud, "robot_a", "robot_a/base_link")
    pose = Pose(10**9, 0, 0, 0, np.diag([1e-4, 1e-4, 1e-4]))
    result = Planner(PlannerConfig()).step([scan], {"robot_a": pose}, 10**9)
    assert len(result.persons) == 1
    trails = {result.persons[0].id: [(1.8, 0.0), (2.0, 0.0)]}  # from the second interval on

    fields = {field.name for field in convert.short_term_map(result, "map").fields}
    for display in displays(config, "PointCloud2"):
        assert display["Channel Name"] in fields
    tour = tour_from([(0, 0), (4, 0)], [("Foyer", (2, 0), 0.0)])
    post = Post(Role.LEADER, np.array([1.0, 0.0]), 0.0, 0.5)
    guidance = Guidance(10**9, State.LEADING, posts={"robot_a": post})
    of_displays = {
        "People": markers(result, "map", 3.0, trails),
        "Tour": tour_markers(tour, guidance, "map"),
        "Walls": MarkerArray(),  # namespaces of the robots' own names
    }
    for display in displays(config, "MarkerArray"):
        drawn = {m.ns for m in of_displays[display["Name"]].markers if m.action == m.ADD}
        assert display["Namespaces"] == dict.fromkeys(drawn, True)


@pytest.mark.parametrize("turn", [0.0, 0.6, -1.2])
def test_ellipse_of_a_robot_has_the_axes_of_its_covariance(turn: float) -> None:
    """0.2 m along the direction of the turn, 0.1 m across: three sigmas on both sides."""
    c, s = math.cos(turn), math.sin(turn)
    rotation = np.array([[c, -s], [s, c]])
    covariance = np.zeros((3, 3))
    covariance[:2, :2] = rotation @ np.diag([0.04, 0.01]) @ rotation.T
    scan = messages.read_scan(
        cloud_of(person_cells(2.0, 0.0), "robot_a/base_link", 10**9), "robot_a"
    )
    poses = {"robot_a": Pose(10**9, 1.0, 2.0, 0.3, covariance)}
    result = Planner(PlannerConfig()).step([scan], poses, 10**9)
    (ellipse,) = (m for m in markers(result, "map", 3.0).markers if m.ns == "robot ellipses")
    assert (ellipse.pose.position.x, ellipse.pose.position.y) == (1.0, 2.0)
    assert ellipse.scale.x == pytest.approx(1.2)
    assert ellipse.scale.y == pytest.approx(0.6)
    q = ellipse.pose.orientation
    drawn = 2.0 * math.atan2(q.z, q.w)
    assert math.sin(drawn - turn) == pytest.approx(0.0, abs=1e-9)  # either way along


def test_exact_pose_has_no_ellipse() -> None:
    scan = messages.read_scan(
        cloud_of(person_cells(2.0, 0.0), "robot_a/base_link", 10**9), "robot_a"
    )
    result = Planner(PlannerConfig()).step([scan], {"robot_a": Pose(10**9, 0, 0, 0)}, 10**9)
    assert "robot ellipses" not in {m.ns for m in markers(result, "map", 3.0).markers}


#: What Foxglove's and Lichtblick's panels show.
SHOWN = {
    "3D": {
        "geometry_msgs/msg/PointStamped",
        "geometry_msgs/msg/PoseArray",
        "geometry_msgs/msg/PoseWithCovarianceStamped",
        "nav_msgs/msg/OccupancyGrid",
        "sensor_msgs/msg/PointCloud2",
        "visualization_msgs/msg/MarkerArray",
    },
    "Image": {"sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"},
    "DiagnosticSummary": {"diagnostic_msgs/msg/DiagnosticArray"},
    "RawMessages": {"std_msgs/msg/String"},
    "Plot": {"mrs_people_msgs/msg/People"},
}


def paths_of(kind: str, panel: dict[str, Any]) -> list[str]:
    """Topics of a panel; of a plot and a table, with the field that it takes."""
    if kind == "3D":
        return [*panel["topics"]]
    if kind == "Image":
        return [panel["imageMode"]["imageTopic"], panel["imageMode"]["calibrationTopic"]]
    if kind == "Plot":
        return [path["value"] for path in panel["paths"]]
    return [panel["topicToRender" if kind == "DiagnosticSummary" else "topicPath"]]


def panels_of(layout: Any) -> list[str]:
    if isinstance(layout, str):
        return [layout]
    assert layout.keys() == {"first", "second", "direction", "splitPercentage"}
    assert layout["direction"] in ("row", "column")
    assert 0 < layout["splitPercentage"] < 100
    return panels_of(layout["first"]) + panels_of(layout["second"])


def test_foxglove_layout_shows_published_topics(published: dict[str, tuple[str, bool]]) -> None:
    layout = json.loads((ROOT / "config/foxglove_layout.json").read_text())
    panels = layout["configById"]
    assert sorted(panels_of(layout["layout"])) == sorted(panels)
    types = {topic.replace("/r/", "/robot_a/", 1): kind for topic, (kind, _) in published.items()}
    types["/diagnostics"] = "diagnostic_msgs/msg/DiagnosticArray"  # once the node is active
    with BagReader(ROOT / "bags" / "walking_group") as bag:
        types |= {topic.name: topic.type for topic in bag.topics.values()}
    for name, panel in panels.items():
        kind = name.partition("!")[0]
        for path in paths_of(kind, panel):
            topic, *fields = path.split(".")
            of_one = topic.replace("/robot_b/", "/robot_a/").replace("/robot_c/", "/robot_a/")
            assert types[of_one] in SHOWN[kind], path
            if kind == "Plot":
                value: Any = People(groups=[Group()])
                for field in fields:
                    value = getattr(value, field.removesuffix("[0]"))
                    value = value[0] if field.endswith("[0]") else value
                assert isinstance(value, int | float)

"""config/nav2: what Nav2 (Jazzy) can load. Nav2 itself is not among the wheels."""

from __future__ import annotations

import xml.etree.ElementTree as ET

import yaml

from mrs_people_loc.config import CollisionMonitoring
from planner_node.guide_node.bases import Velocities
from ros.harness import ROOT

FOLDER = ROOT / "config" / "nav2"
#: Nodes of nav2_behavior_tree and BehaviorTree.CPP 4, with their ports, as Jazzy has them.
NODES = {
    "RecoveryNode": {"number_of_retries"},
    "PipelineSequence": set(),
    "Sequence": set(),
    "RateController": {"hz"},
    "GoalUpdater": {"input_goal", "output_goal"},
    "ComputePathToPose": {"goal", "path", "planner_id"},
    "KeepRunningUntilFailure": set(),
    "FollowPath": {"path", "controller_id"},
    "ClearEntireCostmap": {"service_name"},
    "Wait": {"wait_duration"},
}
DECORATORS = {"RateController", "GoalUpdater", "KeepRunningUntilFailure"}


def test_tree_is_of_known_nodes_and_ports() -> None:
    root = ET.parse(FOLDER / "guide_robot.xml").getroot()
    assert root.attrib["BTCPP_format"] == "4"
    (tree,) = root
    assert (tree.tag, tree.get("ID")) == ("BehaviorTree", root.attrib["main_tree_to_execute"])
    assert len(tree) == 1
    for node in tree[0].iter():
        assert set(node.attrib) - {"name"} == NODES[node.tag], node.tag
        assert len(node) == 1 or node.tag not in DECORATORS
    (recovery,) = tree.iter("RecoveryNode")
    assert len(recovery) == 2
    # The goal that the navigator got goes in; what is planned to is the updated one.
    (updater,) = tree.iter("GoalUpdater")
    (planner,) = updater
    assert updater.get("input_goal") == "{goal}"
    assert planner.get("goal") == updater.get("output_goal") != "{goal}"
    (follower,) = tree.iter("FollowPath")
    assert follower.get("path") == planner.get("path")


def test_parameters_name_the_installed_tree() -> None:
    parameters = yaml.safe_load((FOLDER / "guide_robot.yaml").read_text())
    path = parameters["/**/bt_navigator"]["ros__parameters"]["default_nav_to_pose_bt_xml"]
    package, _, name = path.removeprefix("$(find-pkg-share ").partition(")/")
    assert (package, (ROOT / "config" / name).resolve()) == (
        "mrs_people_config",
        FOLDER / "guide_robot.xml",
    )


def test_collision_monitor_stands_between_guide_and_base_and_hears_what_robot_node_sees() -> None:
    parameters = yaml.safe_load((FOLDER / "collision_monitor.yaml").read_text())
    monitor = parameters["/**/collision_monitor"]["ros__parameters"]
    assert Velocities.topics == (monitor["cmd_vel_out_topic"], monitor["cmd_vel_in_topic"])
    ours = CollisionMonitoring()
    assert monitor["source_timeout"] == ours.source_timeout
    topics = {monitor[name]["topic"] for name in monitor["observation_sources"]}
    assert topics == {"scan", "obstacles"}
    (manager,) = (name for name in parameters if "lifecycle_manager" in name)
    assert parameters[manager]["ros__parameters"]["node_names"] == ["collision_monitor"]

"""ROS domains: what the environment names, and one that nobody else uses."""

from __future__ import annotations

import os
import socket
from types import SimpleNamespace
from typing import Any

import pytest

from mrs_people_loc.errors import ConfigError, PeopleLocError
from mrs_people_sim import domain
from mrs_ros.network import given_domain


@pytest.mark.parametrize(("text", "number"), [("", None), ("0", 0), ("42", 42), ("232", 232)])
def test_domain_of_the_environment_is_used(monkeypatch, text, number):
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    assert given_domain() == number


@pytest.mark.parametrize("text", ["abc", "-1", "1.0", " 7", "233", "9" * 30, "٣"])
def test_invalid_domain_is_refused(monkeypatch, text):
    monkeypatch.setenv("ROS_DOMAIN_ID", text)
    with pytest.raises(ConfigError, match=r"^ROS_DOMAIN_ID is '.*'; allowed: a whole number"):
        given_domain()


def test_two_processes_never_get_the_same_domain():
    with domain.own_domain() as one, domain.own_domain() as other:
        assert one != other


def test_foreign_lock_folder_is_reported(monkeypatch, tmp_path):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    (tmp_path / f"mrs_people_loc-domains-{os.getuid()}").write_text("somebody else's")
    wanted = r"domains-\d+: cannot be used \(.*; remove it, or set"
    with pytest.raises(ConfigError, match=wanted), domain.own_domain():
        pass


@pytest.mark.parametrize("participant", [0, 3, 10, 50])
def test_domain_in_use_is_not_taken(participant):
    with domain.own_domain() as one:
        pass
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("", 7410 + 250 * one + 2 * participant))
        with domain.own_domain() as other:
            assert other != one


def test_private_domain_is_set_in_the_environment_temporarily(monkeypatch):
    monkeypatch.delenv("ROS_DOMAIN_ID", raising=False)
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE", raising=False)
    with domain.private_domain() as words:
        number = os.environ["ROS_DOMAIN_ID"]
        assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "LOCALHOST"
        assert words.startswith(f"in ROS domain {number}, which nobody else uses")
    assert "ROS_DOMAIN_ID" not in os.environ


def test_given_domain_is_used(monkeypatch):
    monkeypatch.setenv("ROS_DOMAIN_ID", "0")
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET")
    with domain.private_domain() as words:
        assert words == "in ROS domain 0, as ROS_DOMAIN_ID says"
        assert os.environ["ROS_AUTOMATIC_DISCOVERY_RANGE"] == "SUBNET"
    assert os.environ["ROS_DOMAIN_ID"] == "0"


def test_other_publishers_are_named():
    def publisher(namespace: str, name: str) -> Any:
        return SimpleNamespace(node_namespace=namespace, node_name=name)

    heard = {
        "/clock": [publisher("/", "play")],
        "/tracked_people": [publisher("/", "planner_node")],
    }
    node: Any = SimpleNamespace(get_publishers_info_by_topic=lambda topic: heard.get(topic, []))
    own = {"/tracked_people": "/planner_node", "/clock": "/play", "/robot_a/points": ""}
    domain.refuse_other_publishers(node, own)
    heard["/tracked_people"].append(publisher("/site", "planner_node"))
    message = r"/tracked_people has 1 other publisher: /site/planner_node\. End the others"
    with pytest.raises(PeopleLocError, match=message):
        domain.refuse_other_publishers(node, own)
    message = "/tracked_people has 2 other publishers: /planner_node, /site/planner_node"
    with pytest.raises(PeopleLocError, match=message):
        domain.refuse_other_publishers(node, {**own, "/tracked_people": ""})

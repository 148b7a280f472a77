"""How a team's nodes are told to find each other, and the Fast DDS profile that they use."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from typer.testing import CliRunner

from mrs_people_loc.errors import ConfigError
from mrs_tools import cli
from mrs_tools.network import discovery_environment
from mrs_tools.team import NodeProcess, RunningTeam

ROOT = Path(__file__).parents[2]
TEAM = ROOT / "config" / "team.yaml"


@pytest.fixture(autouse=True)
def _no_range(monkeypatch):
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE", raising=False)


def test_nothing_is_said_where_nothing_is_asked_for():
    assert discovery_environment() == {}


@pytest.mark.parametrize(
    ("server", "address"),
    [
        ("127.0.0.1", "127.0.0.1:11811"),
        ("127.0.0.1:12000", "127.0.0.1:12000"),
        ("localhost", "localhost:11811"),
    ],
)
def test_a_discovery_server(server, address):
    assert discovery_environment(server=server) == {
        "ROS_DISCOVERY_SERVER": address,
        "ROS_SUPER_CLIENT": "TRUE",
    }


def test_peers():
    wanted = {"ROS_STATIC_PEERS": "127.0.0.1;localhost"}
    assert discovery_environment(peers="127.0.0.1, localhost") == wanted


@pytest.mark.parametrize(
    ("how", "message"),
    [
        ({"server": "localhost:99"}, "port is '99'; wanted: HOST or HOST:PORT, PORT from 1025"),
        ({"server": "localhost:70000"}, "port is '70000'"),
        ({"server": "localhost:"}, "port is ''"),
        ({"server": "fe80::1"}, "port is ':1'"),
        ({"server": ":11811"}, "host ''; wanted: a name or an IPv4 address"),
        ({"server": "11811"}, "host '11811'; wanted: a name or an IPv4 address"),
        ({"server": "no.such.invalid"}, "host 'no.such.invalid' has no IPv4 address"),
        ({"peers": "localhost,"}, "host ''; wanted"),
        ({"peers": "localhost;127.0.0.1"}, "host 'localhost;127.0.0.1' has no IPv4 address"),
        ({"peers": "a" * 70}, "has no IPv4 address"),
        ({"server": "localhost", "peers": "localhost"}, "wanted: one of them, or neither"),
    ],
)
def test_wrong_values(how, message):
    with pytest.raises(ConfigError) as caught:
        discovery_environment(**how)
    assert message in str(caught.value)


@pytest.mark.parametrize("range_", ["OFF", "SYSTEM_DEFAULT"])
def test_peers_that_ros_would_not_look_at(monkeypatch, range_):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", range_)
    with pytest.raises(ConfigError, match=f"SUBNET or LOCALHOST; it is {range_}"):
        discovery_environment(peers="localhost")


@pytest.mark.parametrize("option", ["--discovery-server", "--peers"])
def test_up_refuses_a_wrong_host(option):
    result = CliRunner().invoke(cli.app, ["up", str(TEAM), option, "no.such.invalid"])
    assert result.exit_code == 1
    assert "host 'no.such.invalid' has no IPv4 address" in result.output


def test_up_tells_its_nodes(monkeypatch):
    from mrs_tools import up

    told = []

    class Team(RunningTeam):
        def __init__(self, nodes, log=None, env=None):
            told.append(env)
            super().__init__([], log, env)

    monkeypatch.setattr(up, "RunningTeam", Team)
    monkeypatch.setattr("threading.Event.wait", lambda self, timeout=None: True)
    result = CliRunner().invoke(cli.app, ["up", str(TEAM), "--discovery-server", "localhost:12000"])
    assert result.exit_code == 0, result.output
    assert told == [{"ROS_DISCOVERY_SERVER": "localhost:12000", "ROS_SUPER_CLIENT": "TRUE"}]


def test_nodes_of_a_team_get_the_environment(tmp_path):
    class Node(NodeProcess):
        def command(self):
            return [sys.executable, "-c", "import os; print(os.environ['ROS_STATIC_PEERS'])"]

    with (tmp_path / "log").open("w+") as log:
        with RunningTeam([Node("x", "", (), False)], log, {"ROS_STATIC_PEERS": "a;b"}) as team:
            for process in team.processes.values():
                process.wait(30)
        assert (tmp_path / "log").read_text() == "a;b\n"


def test_discovery_server_needs_the_program(monkeypatch):
    monkeypatch.setattr("shutil.which", lambda name, path: None)
    result = CliRunner().invoke(cli.app, ["discovery-server"])
    assert result.exit_code == 1
    assert "fast-discovery-server is not installed: source your ROS 2" in result.output


# --- the profile ----------------------------------------------------------------------------------


@pytest.mark.skipif(importlib.util.find_spec("rclpy") is None, reason="needs ROS")
@pytest.mark.parametrize("own", [None, "/my/own.xml", ""])
def test_nodes_use_the_shipped_profile_unless_the_user_has_one(own):
    name = "FASTRTPS_DEFAULT_PROFILES_FILE"
    code = (
        "import os; from mrs_ros.network import use_shipped_profile; use_shipped_profile(); "
        f"print(os.environ['{name}'])"
    )
    env = {k: v for k, v in os.environ.items() if k not in (name, "AMENT_PREFIX_PATH")}
    if own is not None:
        env[name] = own
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    if own is not None:
        assert done.stdout == f"{own}\n"
    else:
        used = Path(done.stdout.strip())
        assert used.read_bytes() == (ROOT / "config" / "fastdds" / "team.xml").read_bytes()


def test_the_profile_says_little():
    """Lease and announcements only: everything else stays with ROS and the user."""
    space = "{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}"
    root = ET.parse(ROOT / "config" / "fastdds" / "team.xml").getroot()
    (config,) = root.iter(f"{space}discovery_config")
    seconds = {part.tag.removeprefix(space): int(part[0].text or "") for part in config}
    assert seconds == {"leaseAnnouncement": 1, "leaseDuration": 10}
    (participant,) = root.iter(f"{space}participant")
    assert participant.get("is_default_profile") == "true"

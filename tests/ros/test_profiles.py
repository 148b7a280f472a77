"""The options by which a team's nodes find each other, and their Fast DDS profile."""

from __future__ import annotations

import importlib.util
import json
import os
import subprocess
import sys
import threading
import time
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
from typer.testing import CliRunner

from mrs_people_loc.errors import ConfigError
from mrs_ros.discovery import discovery_environment
from mrs_ros.network import uninterrupted
from mrs_ros.processes import NodeProcess, RunningTeam
from mrs_tools import cli

ROOT = Path(__file__).parents[2]
TEAM = ROOT / "config" / "team.yaml"


@pytest.fixture(autouse=True)
def _no_range(monkeypatch):
    monkeypatch.delenv("ROS_AUTOMATIC_DISCOVERY_RANGE", raising=False)


def test_environment_is_empty_without_options():
    assert discovery_environment() == {}


@pytest.mark.parametrize(
    ("server", "address"),
    [
        ("127.0.0.1", "127.0.0.1:11811"),
        ("127.0.0.1:12000", "127.0.0.1:12000"),
        ("localhost", "localhost:11811"),
    ],
)
def test_discovery_server_is_set_in_the_environment(server, address):
    assert discovery_environment(server=server) == {
        "ROS_DISCOVERY_SERVER": address,
        "ROS_SUPER_CLIENT": "TRUE",
    }


def test_peers_are_set_in_the_environment():
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
def test_wrong_values_are_refused(how, message):
    with pytest.raises(ConfigError) as caught:
        discovery_environment(**how)
    assert message in str(caught.value)


@pytest.mark.parametrize("range_", ["OFF", "SYSTEM_DEFAULT"])
def test_peers_that_ros_would_ignore_are_refused(monkeypatch, range_):
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", range_)
    with pytest.raises(ConfigError, match=f"SUBNET or LOCALHOST; it is {range_}"):
        discovery_environment(peers="localhost")


@pytest.mark.parametrize("option", ["--discovery-server", "--peers"])
def test_up_refuses_a_wrong_host(option):
    result = CliRunner().invoke(cli.app, ["up", str(TEAM), option, "no.such.invalid"])
    assert result.exit_code == 1
    assert "host 'no.such.invalid' has no IPv4 address" in result.output


def test_up_passes_the_network_options_to_its_nodes(monkeypatch):
    from mrs_tools.commands import up

    printed = []

    class Team(RunningTeam):
        def __init__(self, nodes, log=None, env=None):
            printed.append(env)
            super().__init__([], log, env)

    monkeypatch.setattr(up, "RunningTeam", Team)
    monkeypatch.setattr("threading.Event.wait", lambda self, timeout=None: True)
    result = CliRunner().invoke(cli.app, ["up", str(TEAM), "--discovery-server", "localhost:12000"])
    assert result.exit_code == 0, result.output
    assert printed == [{"ROS_DISCOVERY_SERVER": "localhost:12000", "ROS_SUPER_CLIENT": "TRUE"}]


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


# --- the profiles ---------------------------------------------------------------------------------

FAST_DDS = ROOT / "config" / "fastdds"
PROFILE, TRANSPORTS, RANGE = (
    "FASTRTPS_DEFAULT_PROFILES_FILE",
    "FASTDDS_BUILTIN_TRANSPORTS",
    "ROS_AUTOMATIC_DISCOVERY_RANGE",
)
needs_ros = pytest.mark.skipif(importlib.util.find_spec("rclpy") is None, reason="needs ROS")


def environment_after(
    *calls: str, **reported: str
) -> tuple[dict[str, str], dict[str, str], list[str]]:
    """What a process has in its environment that uses the profile.

    Returns:
        Its environment, the one that it hands on, and what each call said.
    """
    names = (PROFILE, "FASTDDS_DEFAULT_PROFILES_FILE", TRANSPORTS, RANGE, "ROS_STATIC_PEERS")
    env = {name: value for name, value in os.environ.items() if name not in names}
    env.pop("AMENT_PREFIX_PATH", None)
    code = (
        "import json, os; from mrs_ros.network import environment, use_shipped_profile; "
        f"said = [use_shipped_profile() for _ in range({len(calls) or 1})]; "
        "print(json.dumps([dict(os.environ), environment(), said]))"
    )
    done = subprocess.run(
        [sys.executable, "-c", code], env={**env, **reported}, capture_output=True, text=True
    )
    assert done.returncode == 0, done.stderr
    has, hands_on, words = json.loads(done.stdout)
    return has, hands_on, words


@needs_ros
@pytest.mark.parametrize(
    ("reported", "file", "range_"),
    [
        ({}, "team.xml", None),
        ({TRANSPORTS: "UDPv4"}, "team.xml", None),
        ({RANGE: "SUBNET"}, "team.xml", "SUBNET"),
        ({RANGE: "LOCALHOST"}, "localhost.xml", "SYSTEM_DEFAULT"),
        # ROS 2 looks at peers with LOCALHOST only, and localhost.xml does not know them.
        ({RANGE: "LOCALHOST", "ROS_STATIC_PEERS": "a;b"}, "team.xml", "LOCALHOST"),
    ],
)
def test_nodes_use_the_shipped_profile(reported, file, range_):
    has, hands_on, words = environment_after("once", "twice", **reported)
    assert Path(has[PROFILE]).read_bytes() == (FAST_DDS / file).read_bytes()
    assert (has[TRANSPORTS], has.get(RANGE)) == ("UDPv4", range_)
    assert words == ["", ""]
    # What it starts decides for itself, by what the user said.
    assert {name: hands_on[name] for name in (PROFILE, TRANSPORTS, RANGE) if name in hands_on} == {
        name: value for name, value in reported.items() if name != "ROS_STATIC_PEERS"
    }


@needs_ros
@pytest.mark.parametrize(
    "reported",
    [
        {PROFILE: "/my/own.xml"},
        {PROFILE: ""},
        {"FASTDDS_DEFAULT_PROFILES_FILE": "/my/own.xml"},
        {TRANSPORTS: "SHM", RANGE: "LOCALHOST"},
    ],
)
def test_users_profile_or_transports_take_precedence(reported):
    has, _, (words,) = environment_after(**reported)
    assert {name: has[name] for name in reported} == reported
    assert {PROFILE, TRANSPORTS, RANGE} & set(has) == {PROFILE, TRANSPORTS, RANGE} & set(reported)
    name, value = next(iter(reported.items()))
    assert words.startswith(f"{name}={value} goes before our Fast DDS profile: docs/network.md")


@needs_ros
def test_process_that_inherits_the_shipped_profile_logs_nothing():
    has, _, _ = environment_after(**{RANGE: "LOCALHOST"})
    given = {name: has[name] for name in (PROFILE, TRANSPORTS, RANGE)}
    assert environment_after(**given)[::2] == (environment_after(**given)[0], [""])
    assert environment_after(**given)[0][PROFILE] == given[PROFILE]


@needs_ros
def test_other_middleware_is_left_alone():
    code = (
        "import os, rclpy.utilities as u; "
        "u.get_rmw_implementation_identifier = lambda: 'rmw_cyclonedds_cpp'; "
        "from mrs_ros.network import use_shipped_profile; before = dict(os.environ); "
        "use_shipped_profile(); print(sorted(set(os.environ.items()) - set(before.items())))"
    )
    env = {**os.environ, RANGE: "LOCALHOST", "AMENT_PREFIX_PATH": sys.prefix}
    done = subprocess.run([sys.executable, "-c", code], env=env, capture_output=True, text=True)
    assert done.stdout == "[]\n", done.stderr


@pytest.mark.parametrize("file", ["team.xml", "localhost.xml"])
def test_profiles_set_discovery_times_and_udp_buffers(file):
    """Everything else is left to ROS and the user."""
    space = "{http://www.eprosima.com/XMLSchemas/fastRTPS_Profiles}"
    root = ET.parse(FAST_DDS / file).getroot()
    (config,) = root.iter(f"{space}discovery_config")
    seconds = {part.tag.removeprefix(space): int(part[0].text or "") for part in config}
    local = file == "localhost.xml"
    # In a network, the lease is that of nodes without the profile: Fast DDS's default.
    assert seconds == {"leaseAnnouncement": 1, "leaseDuration": 10 if local else 20}
    (participant,) = root.iter(f"{space}participant")
    assert participant.get("is_default_profile") == "true"
    (room,) = root.iter(space + ("receiveBufferSize" if local else "listenSocketBufferSize"))
    assert room.text == "16777216"
    # Nobody is told to send by shared memory, and by default none is made.
    locators = [kind.tag for where in root.iter(f"{space}locator") for kind in where]
    assert set(locators) == {f"{space}udpv4"}
    assert [kind.text for kind in root.iter(f"{space}type")] == (["UDPv4"] if local else [])
    assert [one.text for one in root.iter(f"{space}useBuiltinTransports")] == ["false"] * local


class Policies(threading.Thread):
    """A thread of one policy, and what it and one that it starts have while it is uninterrupted."""

    def __init__(self, before: int) -> None:
        super().__init__()
        self.before = before
        self.own: list[int] = []
        self.others: list[int] = []

    def run(self) -> None:
        os.sched_setscheduler(0, self.before, os.sched_param(0))
        try:
            with uninterrupted():
                pass
            with uninterrupted():  # of the next node of this thread
                self._note(self.own)
                other = threading.Thread(target=self._note, args=(self.others,))
                other.start()
                other.join()
                raise RuntimeError
        except RuntimeError:
            self._note(self.own)

    @staticmethod
    def _note(policies: list[int]) -> None:
        policies.append(os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK)

    def done(self) -> tuple[list[int], list[int]]:
        self.start()
        self.join()
        return self.own, self.others


def _may_run_first() -> bool:
    return Policies(os.SCHED_OTHER).done()[0][0] == os.SCHED_RR


@pytest.mark.skipif(not _may_run_first(), reason="needs a user who may have real-time priority")
def test_thread_that_makes_a_participant_is_not_interrupted():
    usual = os.SCHED_OTHER
    assert Policies(usual).done() == ([os.SCHED_RR, usual], [usual])


def test_chosen_policy_is_left_alone():
    assert Policies(os.SCHED_BATCH).done() == ([os.SCHED_BATCH] * 2, [os.SCHED_BATCH])


def test_who_may_not_have_priority_rests_before_a_participant_is_made(monkeypatch):
    set_policy, rests = os.sched_setscheduler, []

    def refused(pid: int, policy: int, param: os.sched_param) -> None:
        if policy & ~os.SCHED_RESET_ON_FORK == os.SCHED_RR:
            raise PermissionError
        set_policy(pid, policy, param)

    monkeypatch.setattr(os, "sched_setscheduler", refused)
    monkeypatch.setattr(time, "sleep", rests.append)
    assert Policies(os.SCHED_OTHER).done() == ([os.SCHED_OTHER] * 2, [os.SCHED_OTHER])
    assert len(rests) == 2

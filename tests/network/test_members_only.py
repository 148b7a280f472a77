"""The members-only option, on hosts in network namespaces: a team in its tunnel, and outsiders.

The planner and two robots are real nodes on three hosts, connected by what `mrs keys` makes. On a
fourth host are outsiders, all with the same spy, which hears whatever it can and says that it is a
robot: on plain multicast, on plain unicast (also to the tunnel's own addresses), and through the
tunnel with no certificate, one of another team, and one that is revoked. On a fifth host the same
spy has a good certificate and gets through, until it is revoked.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import statistics
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from mrs_tools.security.team_keys import TeamKeys
from mrs_tools.security.tunnel import RECHECK_S
from network import hosts as network
from network.hosts import Hosts

TASKS = Path(__file__).with_name("member_tasks.py")
CONFIG = Path(__file__).resolve().parents[2] / "config"
#: The paper's method takes little of the processor, which this machine has to share.
TEAM, PAPER = CONFIG / "team.yaml", CONFIG / "paper.yaml"
#: What is late because this machine is busy is used all the same [s].
PATIENCE_S = 5.0
DEADLINE_S = 90.0
FRAME_HZ = 5.0
ROBOTS = ("robot_a", "robot_b")
#: Intervals over which the team is compared and outsiders are to hear nothing.
MANY = 20
#: What a spy hears, where it does.
HEARABLE = {"tracked_people", "robot_a/points", "robot_a/pose", "/diagnostics"}
OUTSIDERS = ("no_certificate", "foreign", "revoked")
#: What the tunnel checks again so often is checked more often here [s].
OFTEN_S = 4

pytestmark = [pytest.mark.slow, pytest.mark.timeout(400)]


def until(condition: Callable[[], Any], what: Callable[[], str]) -> Any:
    """Waits for a condition and returns its value."""
    end = time.monotonic() + DEADLINE_S
    while not (value := condition()):
        assert time.monotonic() < end, f"waited {DEADLINE_S:g} s in vain: {what()}"
        time.sleep(0.05)
    return value


class Task:
    """A process on a host that prints lines of JSON."""

    def __init__(self, hosts: Hosts, host: str, command: list[str], log: Path, **env: str) -> None:
        self.log = log
        with log.open("wb") as out:
            self.process = hosts.popen(host, command, env=env, stdout=out, stderr=subprocess.STDOUT)

    @property
    def text(self) -> str:
        return self.log.read_text(errors="replace")

    @property
    def lines(self) -> list[dict[str, Any]]:
        whole = (line for line in self.text.splitlines(keepends=True) if line.endswith("}\n"))
        return [json.loads(line) for line in whole if line.startswith("{")]

    def says(self, what: re.Pattern[str]) -> bool:
        return what.search(self.text) is not None


@dataclass
class World:
    """The hosts, and what runs there."""

    hosts: Hosts
    folder: Path
    tasks: dict[str, Task] = field(default_factory=dict)
    inner: list[str] = field(default_factory=list)

    def start(self, name: str, host: str, *command: str, **env: str) -> Task:
        """Starts a process on a host, which shares its memory with this host's only."""
        memory = self.folder / f"shm-{host}"
        memory.mkdir(exist_ok=True)
        own = f'mount --bind {memory} /dev/shm && exec "$@"'
        whole = ["unshare", "--mount", "sh", "-c", own, "sh", *command]
        self.tasks[name] = Task(self.hosts, host, whole, self.folder / f"{name}.log", **env)
        return self.tasks[name]

    def task(self, name: str, host: str, *what: str, inside: bool = True, **env: str) -> Task:
        """Starts one of `member_tasks.py`."""
        return self.run(name, host, sys.executable, str(TASKS), *what, inside=inside, **env)

    def run(self, name: str, host: str, *command: str, inside: bool = True, **env: str) -> Task:
        """Starts a command, in the host's tunnel or beside it."""
        how = [str(self.folder / host / "team"), "run"] if inside else []
        return self.start(name, host, *how, *command, **env)

    def tunnel(self, folder: Path, host: str) -> Task:
        """Opens the tunnel of a folder that `mrs keys` made."""
        # All hosts here see the same names of namespaces; and it has to be there before:
        # what `ip netns add` does within `ip netns exec` is seen nowhere else.
        inner = f"{network._PREFIX}{os.getpid()}-{folder.name}-tunnel"
        subprocess.run(["ip", "netns", "add", inner], check=True)
        self.inner.append(inner)
        edit(folder / "team", "netns=mrs\n", f"netns={inner}\n")
        return self.start(f"vpn-{folder.name}", host, "sh", str(folder / "team"), "up")

    def end(self, *names: str) -> None:
        """Ends what must still run."""
        ending = [self.tasks.pop(name) for name in names]
        for task in ending:
            assert task.process.poll() is None, task.text
            task.process.terminate()
        for task in ending:
            task.process.wait(DEADLINE_S)

    def close(self) -> None:
        for task in self.tasks.values():
            task.process.kill()
            task.process.wait()
        for inner in self.inner:
            network._remove(inner)

    def logs(self) -> str:
        return "\n".join(f"--- {name}\n{task.text[-1500:]}" for name, task in self.tasks.items())


def edit(path: Path, old: str, new: str) -> None:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new))


@dataclass
class Seen:
    """What came of it."""

    rates: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    outsiders: dict[str, list[dict[str, Any]]] = field(default_factory=dict)
    refusals: str = ""
    knocks: list[dict[str, Any]] = field(default_factory=list)
    impostor: str = ""
    robots_while_spied: set[str] = field(default_factory=set)
    robots_after_revoking: set[str] = field(default_factory=set)
    member_heard: set[str] = field(default_factory=set)
    copy_came_back: int = -1
    cut_after_s: float = 0.0
    heard_after_cut: int = -1
    packets: list[dict[str, Any]] = field(default_factory=list)
    sockets: dict[str, list[str]] = field(default_factory=dict)
    plain_spies: dict[str, list[dict[str, Any]]] = field(default_factory=dict)


def start_team(world: World, *, inside: bool) -> Task:
    """The planner, two robots and what they see; waits until they find people."""
    how = "tunnel" if inside else "plain"
    planner = [sys.executable, "-m", "planner_node", "--ros-args", "--params-file", str(PAPER)]
    for name in ("max_scan_age", "max_pose_age", "max_clock_offset"):
        planner += ["-p", f"interval.{name}:={PATIENCE_S}"]
    world.run(f"{how}-planner", "planner", *planner, inside=inside)
    listener = world.task(f"{how}-listener", "planner", "listen", inside=inside)
    for robot in ROBOTS:
        node = [sys.executable, "-m", "robot_node", "--ros-args", "-r", f"__ns:=/{robot}"]
        for file in (TEAM, PAPER):
            node += ["--params-file", str(file)]
        world.run(f"{how}-{robot}", robot, *node, inside=inside)
        world.task(f"{how}-feed-{robot}", robot, "feed", robot, str(FRAME_HZ), inside=inside)
    until(lambda: any(map(complete, listener.lines[-3:])), world.logs)
    return listener


def complete(line: dict[str, Any]) -> bool:
    return set(ROBOTS) <= set(line["robots"]) and line["people"] > 0


def used(lines: list[dict[str, Any]]) -> set[str]:
    """Robots whose scans the planner used."""
    return {robot for line in lines for robot in line["robots"]}


def people(listener: Task, world: World) -> list[dict[str, Any]]:
    """The next so many intervals."""
    first = len(listener.lines)
    until(lambda: len(listener.lines) >= first + MANY, world.logs)
    return listener.lines[first:]


def figures(lines: list[dict[str, Any]]) -> tuple[float, float, float]:
    """Intervals per second, and the median and 95 % age of the newest image in them [ms]."""
    ages = sorted(line["age_ms"] for line in lines)
    rate = (len(lines) - 1) / (lines[-1]["at"] - lines[0]["at"])
    return rate, statistics.median(ages), ages[int(0.95 * len(ages))]


def start_spies(world: World, keys: Path) -> list[str]:
    """All outsiders' spies; their names."""
    hosts = world.hosts
    others = [hosts.addresses[name] for name in ("planner", *ROBOTS)]
    # The tunnel's addresses, as if they were to be had on the switch.
    tunnel = {f"10.99.0.{n}": via for n, via in enumerate(others, 1)}
    for address, via in tunnel.items():
        hosts.run("spy", "ip", "route", "replace", address, "via", via)
    peers = ";".join((*others, *tunnel))
    world.task("spy-multicast", "spy", "spy", "robot_x", inside=False)
    world.task("spy-unicast", "spy", "spy", "robot_x", inside=False, ROS_STATIC_PEERS=peers)
    names = ["spy-multicast", "spy-unicast"]
    for kind in OUTSIDERS if keys.exists() else ():
        world.tunnel(keys / kind, "spy")
        world.start(
            f"spy-{kind}", "spy", str(keys / kind / "team"), "run",
            sys.executable, str(TASKS), "spy", "robot_x",
        )  # fmt: skip
        names.append(f"spy-{kind}")
    return names


def make_keys(folder: Path, address: str) -> TeamKeys:
    """The team's keys, and the outsiders', which are as near to them as can be."""
    keys = TeamKeys.create(folder / "keys", address)
    for name in (*ROBOTS, "laptop", "revoked", "no_certificate"):
        keys.make(name)
    keys.revoke("revoked")
    nothing = keys.folder / "no_certificate"
    edit(nothing / "tunnel.conf", "cert cert.pem\nkey key.pem\n", "auth-user-pass password\n")
    (nothing / "password").write_text("robot_a\nrobot_a\n")
    # Of a team of the same names. It takes our planner for its own, so that only ours can refuse.
    foreign = TeamKeys.create(folder / "others", address).make("foreign")
    shutil.copy(keys.folder / "robot_a" / "ca.pem", foreign)
    shutil.move(foreign, keys.folder / "foreign")
    edit(
        keys.folder / "planner" / "tunnel.conf",
        f"reneg-sec {RECHECK_S}\n",
        f"reneg-sec {OFTEN_S}\n",
    )
    for host in ("planner", *ROBOTS, "laptop"):
        shutil.move(keys.folder / host, folder / host)
    return keys


@pytest.fixture(scope="module")
def world(tmp_path_factory: pytest.TempPathFactory) -> Iterator[World]:
    """Hosts with nothing on them."""
    missing = [name for name in ("openvpn", "openssl", "unshare") if shutil.which(name) is None]
    missing += [] if Path("/dev/net/tun").exists() else ["/dev/net/tun"]
    if missing and os.environ.get("CI"):
        pytest.fail(f"in CI this must run; missing: {', '.join(missing)}")
    if missing:
        pytest.skip(f"no {', '.join(missing)} here")
    with Hosts("planner", *ROBOTS, "spy", "laptop") as hosts:
        made = World(hosts, tmp_path_factory.mktemp("members"))
        try:
            yield made
        finally:
            made.close()


@pytest.fixture(scope="module")
def seen(world: World) -> Seen:
    """Everything, once."""
    return scenario(world)


def scenario(world: World) -> Seen:
    result, hosts, folder = Seen(), world.hosts, world.folder
    keys = make_keys(folder, hosts.addresses["planner"])
    team = ("planner", *ROBOTS)
    for host in team:
        world.task(f"sniff-{host}", host, "sniff", inside=False)
    for host in team:
        until(partial(getattr, world.tasks[f"sniff-{host}"], "lines"), world.logs)
        world.tunnel(folder / host, host)

    # The team works, and outsiders try.
    spies = start_spies(world, keys.folder)
    members = [hosts.addresses[host] for host in team]
    knock = world.task("knock", "spy", "knock", *members, inside=False)
    listener = start_team(world, inside=True)
    until(lambda: all(len(world.tasks[spy].lines) > 2 for spy in spies), world.logs)
    for kind in OUTSIDERS:
        refused = re.compile("(connection-reset.*){2}", re.DOTALL)
        until(partial(world.tasks[f"vpn-{kind}"].says, refused), world.logs)
    until(partial(knock.says, re.compile('"done"')), world.logs)
    result.knocks = knock.lines[:-1]
    people(listener, world)
    result.robots_while_spied = used(listener.lines)
    for spy in spies:
        result.outsiders[spy] = world.tasks[spy].lines
    result.refusals = world.tasks["vpn-planner"].text
    for host in team:
        result.sockets[host] = hosts.run(host, "ss", "-Hlntu").splitlines()
    world.end("knock", *spies)

    # The same spy as a member, until it is one no more.
    shutil.copytree(folder / "laptop", folder / "copy")
    world.tunnel(folder / "laptop", "laptop")
    member = world.task("member", "laptop", "spy", "robot_x")
    until(lambda: member.lines and len(member.lines[-1]["heard"]) == len(HEARABLE), world.logs)
    until(lambda: used(listener.lines[-20:]) == {*ROBOTS, "robot_x"}, world.logs)
    result.member_heard = set(member.lines[-1]["heard"])
    # Somebody else comes with a copy of its folder.
    copy, log = world.tunnel(folder / "copy", "spy"), world.tasks["vpn-planner"]
    connects = re.compile(r"(10\.77\.0\.\d+):\d+ \[laptop\] Peer Connection Initiated")
    both = {hosts.addresses["laptop"], hosts.addresses["spy"]}
    until(lambda: min(map(connects.findall(log.text).count, both)) >= 3, world.logs)
    shutil.copy(keys.revoke("laptop"), folder / "planner")
    revoked = time.time()
    refused = re.compile(r"(10\.77\.0\.\d+):\d+ VERIFY ERROR: .*certificate revoked: CN=laptop")
    until(lambda: both <= set(refused.findall(log.text)), world.logs)
    connected = copy.text.count("Initialization Sequence Completed")
    result.cut_after_s = time.time() - revoked
    until(lambda: all("robot_x" not in x["robots"] for x in listener.lines[-3:]), world.logs)
    reports = len(member.lines)
    until(lambda: len(member.lines) > reports + 1, world.logs)
    before = sum(member.lines[-1]["heard"].values())
    lines = people(listener, world)
    result.rates["tunnel"] = figures(lines)
    result.robots_after_revoking = used(lines)
    until(lambda: any(map(complete, listener.lines[-3:])), world.logs)
    result.copy_came_back = copy.text.count("Initialization Sequence Completed") - connected
    result.heard_after_cut = sum(member.lines[-1]["heard"].values()) - before
    for host in team:
        result.packets += world.tasks[f"sniff-{host}"].lines[1:]

    # A robot of the team that says it is the planner.
    for name in ("impostor", "victim"):
        keys.make(name)
    impostor, victim = keys.folder / "impostor", keys.folder / "victim"
    shutil.copy(folder / "planner" / "tunnel.conf", impostor)
    shutil.copy(folder / "planner" / "crl.pem", impostor)
    edit(victim / "tunnel.conf", hosts.addresses["planner"], hosts.addresses["spy"])
    world.tunnel(impostor, "spy")
    task = world.tunnel(victim, "laptop")
    until(lambda: "VERIFY" in task.text, world.logs)
    result.impostor = task.text

    # The same team without a tunnel: for comparison, and there the plain spies do hear it.
    world.end(*world.tasks)
    listener = start_team(world, inside=False)
    result.rates["plain UDP"] = figures(people(listener, world))
    for spy in start_spies(world, folder / "nowhere"):
        until(partial(world.tasks[spy].says, re.compile('"heard".*"tracked_people"')), world.logs)
        result.plain_spies[spy] = world.tasks[spy].lines
    return result


def test_members_work_as_a_team_in_the_tunnel(
    seen: Seen, capsys: pytest.CaptureFixture[str]
) -> None:
    with capsys.disabled():
        print(f"\n{'':<12}{'people/s':>10}{'age, median':>14}{'95 %':>8}   [ms]")
        for how, (rate, median, most) in seen.rates.items():
            print(f"{how:<12}{rate:>10.1f}{median:>14.1f}{most:>8.1f}")
        print(f"who was revoked was cut off after {seen.cut_after_s:.1f} s")
    assert set(seen.rates) == {"tunnel", "plain UDP"}


def test_outsiders_receive_nothing(seen: Seen) -> None:
    assert len(seen.outsiders) == 5
    for spy, lines in seen.outsiders.items():
        assert len(lines) > 2, spy
        assert lines[-1]["heard"] == {}, spy
        # They see each other on their host, where they share a network, and nobody else.
        assert set(lines[-1]["nodes"]) <= {"spy_robot_x"}, spy


def test_messages_of_outsiders_do_not_arrive(seen: Seen) -> None:
    assert seen.robots_while_spied == set(ROBOTS)
    assert all(line["listeners"] == 0 for lines in seen.outsiders.values() for line in lines)


def test_tunnel_does_not_answer_plain_tcp_and_tls(seen: Seen) -> None:
    assert len(seen.knocks) == 6
    assert all(knock["got"] == 0 for knock in seen.knocks)


def test_outsiders_are_refused_for_their_certificates(seen: Seen) -> None:
    assert "error=certificate revoked: CN=revoked" in seen.refusals
    assert "CN=foreign" in seen.refusals
    assert "peer did not return a certificate" in seen.refusals


def test_member_is_admitted_until_revoked(seen: Seen) -> None:
    assert seen.member_heard == HEARABLE
    assert seen.robots_after_revoking == set(ROBOTS)
    assert seen.heard_after_cut == 0


def test_copied_keys_are_refused_when_the_original_is_revoked(seen: Seen) -> None:
    """Before that the two evicted each other at least three times."""
    assert seen.copy_came_back == 0


def test_robots_key_is_not_accepted_as_the_planners(seen: Seen) -> None:
    assert "error=unsuitable certificate purpose: CN=impostor" in seen.impostor
    assert "Initialization Sequence Completed" not in seen.impostor


def test_outsiders_do_receive_an_unprotected_team(seen: Seen) -> None:
    """This shows that they would have received the protected team, too."""
    assert set(seen.plain_spies) == {"spy-multicast", "spy-unicast"}
    assert all(lines[-1]["listeners"] for lines in seen.plain_spies.values())


def test_members_send_only_tls(seen: Seen) -> None:
    members = {f"10.77.0.{n}" for n in (1, 2, 3)}
    # (1: ICMP, which tells spies that nobody is there.)
    sent = [p for p in seen.packets if p["source"] in members]
    assert {(p["protocol"], min(p["ports"])) for p in sent if p["protocol"] != 1} == {(6, 5101)}
    assert not any(p["plain"] for p in sent if p["protocol"] != 1)


def test_members_have_one_open_port_in_all(seen: Seen) -> None:
    """On the hosts' own network."""
    assert [line.split()[4] for line in seen.sockets["planner"]] == ["0.0.0.0:5101"]
    assert seen.sockets["robot_a"] == seen.sockets["robot_b"] == []


@pytest.mark.soak
@pytest.mark.timeout(900)
def test_members_recover_after_outages(world: World, capsys: pytest.CaptureFixture[str]) -> None:
    """Prints how long it takes until both robots are used again, with no node restarted."""
    world.end(*world.tasks)
    shutil.rmtree(world.folder / "keys", ignore_errors=True)
    keys = TeamKeys.create(world.folder / "keys", world.hosts.addresses["planner"])
    for host in ("planner", *ROBOTS):
        shutil.rmtree(world.folder / host, ignore_errors=True)
        shutil.move(keys.folder / "planner" if host == "planner" else keys.make(host), world.folder)
        world.tunnel(world.folder / host, host)
    listener = start_team(world, inside=True)

    def back(what: str) -> None:
        began, first = time.monotonic(), len(listener.lines)
        until(lambda: any(map(complete, listener.lines[first:])), world.logs)
        with capsys.disabled():
            print(f"\nback after {what}: {time.monotonic() - began:.1f} s", end="")

    addresses = world.folder / "planner" / "addresses"
    until(lambda: all(robot in addresses.read_text() for robot in ROBOTS), world.logs)

    def gone(robot: str) -> bool:
        return len(listener.lines) > 5 and robot not in used(listener.lines[-5:])

    for seconds in (3, 30):
        world.hosts.link("robot_a", up=False)
        until(partial(gone, "robot_a"), world.logs)
        time.sleep(seconds)
        world.hosts.link("robot_a", up=True)
        back(f"a cable was pulled for {seconds} s")
    for host in ("robot_a", "planner"):
        world.tasks.pop(f"vpn-{host}").process.kill()
        if host == "robot_a":
            until(partial(gone, "robot_a"), world.logs)
        script = str(world.folder / host / "team")
        world.start(f"vpn-{host}-again", host, "sh", script, "up")
        back(f"the tunnel of {host} was killed and started again")

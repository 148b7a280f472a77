"""Cables are pulled, packets are lost, processes are killed; three robots and a planner, each on
its host. What is measured is printed; what is held is that people come and the full rate returns.
"""

from __future__ import annotations

import itertools
import subprocess
import sys
import time
from collections import deque
from collections.abc import Callable, Iterator

import pytest

from network.team import FRAME_HZ, PLANNER, PLAYED, REAL, ROBOTS, Span, TeamOnHosts, team_on_hosts

pytestmark = pytest.mark.timeout(300)  # 5 s each where nothing else runs
Show = Callable[[str], None]
FAR, OTHERS = REAL, set(PLAYED)


#: Prints the times at which a host announces a participant, by multicast, as RTPS has it.
ANNOUNCEMENTS = """
import socket, sys, time
own, other = sys.argv[1:]
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
s.bind(("239.255.0.1", 7400))
group = socket.inet_aton("239.255.0.1") + socket.inet_aton(own)
s.setsockopt(socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP, group)
while True:
    if s.recvfrom(65536)[1][0] == other:
        print(time.monotonic(), flush=True)
"""


@pytest.fixture(scope="module")
def team(tmp_path_factory: pytest.TempPathFactory) -> Iterator[TeamOnHosts]:
    with team_on_hosts(tmp_path_factory.mktemp("team")) as made:
        made.start_all()
        yield made


def back_after(team: TeamOnHosts, outage_s: float) -> float:
    """Takes a robot's link down; returns how long after `link up` its people are there [s]."""

    def others_go_on() -> bool:
        heard = team.since(time.monotonic() - 1.0)
        return any(m.seen_by for m in heard) and not any(FAR in m.robots for m in heard)

    team.hosts.link(FAR, up=False)
    time.sleep(outage_s)
    team.until(others_go_on, "the others do not go on, finding people")
    moment = time.monotonic()
    team.hosts.link(FAR, up=True)
    took = team.back(FAR, moment)
    team.full_rate()
    return took


def test_images_stay_on_their_robot(team: TeamOnHosts, show: Show) -> None:
    """What leaves a robot's host against the images that its node gets."""
    before, began = team.hosts.bytes_sent(FAR), time.monotonic()
    time.sleep(3.0)
    rate = (team.hosts.bytes_sent(FAR) - before) / (time.monotonic() - began)
    images = 3 * 160 * 120 * FRAME_HZ
    show(f"{FAR} sends {rate / 1e3:.1f} kB/s at {FRAME_HZ:g} Hz; its images: {images / 1e3:.0f}")
    assert 0 < rate < 0.5 * images


def test_nodes_announce_themselves_as_the_profile_says(team: TeamOnHosts) -> None:
    """By themselves the planner and the listener on its host do at most 4 times in 5 s."""
    addresses = [team.hosts.addresses[PLAYED[0]], team.hosts.addresses[PLANNER]]
    command = [sys.executable, "-c", ANNOUNCEMENTS, *addresses]
    process = team.hosts.popen(PLAYED[0], command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    times: deque[float] = deque(maxlen=6)
    for line in itertools.islice(process.stdout, 40):
        times.append(float(line))
        if len(times) == 6 and times[-1] - times[0] <= 5.0:
            break
    else:
        pytest.fail(f"the planner announces itself only at {times}")
    process.terminate()
    process.communicate()


def test_a_link_goes_down(team: TeamOnHosts, show: Show) -> None:
    show(f"link down for 3 s: people are back {back_after(team, 3.0):.2f} s after link up")


@pytest.mark.soak
@pytest.mark.parametrize("outage_s", [3, 30, 120])
def test_a_link_goes_down_for_long(team: TeamOnHosts, show: Show, outage_s: float) -> None:
    took = back_after(team, outage_s)
    show(f"link down for {outage_s:g} s: people are back {took:.2f} s after link up")


def under_loss(
    team: TeamOnHosts, show: Show, probability: float, seconds: float, least_hz: float
) -> None:
    """Loses that share of all packets between hosts; every robot must take part so often."""
    for host in (*ROBOTS, PLANNER):
        team.hosts.loss(host, probability)
    time.sleep(seconds + 0.5)
    show(f"{probability:4.0%} of packets lost: {Span.of(team, seconds)}")
    team.until(lambda: Span.of(team, seconds).robot_hz > least_hz, "robots are hardly heard")
    for host in (*ROBOTS, PLANNER):
        team.hosts.loss(host, 0.0)
    team.full_rate()


@pytest.mark.parametrize(
    "seconds", [6.0, pytest.param(60.0, marks=[pytest.mark.soak, pytest.mark.timeout(600)])]
)
def test_packets_are_lost(team: TeamOnHosts, show: Show, seconds: float) -> None:
    team.full_rate()
    show(f"{'none lost':>20s}: {Span.of(team, 2.0)}")
    under_loss(team, show, 0.05, seconds, 0.5 * FRAME_HZ)
    under_loss(team, show, 0.20, seconds, 0.1 * FRAME_HZ)


def test_planner_is_cut_off_for_3_s(team: TeamOnHosts, show: Show) -> None:
    team.hosts.partition(PLANNER)
    time.sleep(3.0)
    team.until(lambda: not team.since(time.monotonic() - 1.0), "it still hears robots")
    mended = time.monotonic()
    team.hosts.partition()
    took = team.all_back(ROBOTS, mended)
    show(f"planner cut off for 3 s: people are back after {took:.2f} s")
    team.full_rate()


def test_a_robot_is_killed_and_started_again(team: TeamOnHosts, show: Show) -> None:
    team.nodes[FAR].kill()
    team.nodes[FAR].wait()
    team.until_seers(OTHERS, "the others do not go on")
    moment = time.monotonic()
    team.start_robot()
    up = team.on_network(FAR)
    took = team.back(FAR, moment)
    show(
        f"robot_node killed: its people are back {took:.2f} s after its start, "
        f"{moment + took - up:.2f} s after it was on the network"
    )
    team.full_rate()


def test_planner_is_killed_and_started_again(team: TeamOnHosts, show: Show) -> None:
    team.nodes[PLANNER].kill()
    team.nodes[PLANNER].wait()
    moment = time.monotonic()
    team.start_planner()
    up = team.on_network(PLANNER)
    took = team.all_back(ROBOTS, moment)
    show(
        f"planner_node killed: people of all robots {took:.2f} s after its start, "
        f"{moment + took - up:.2f} s after it was on the network"
    )
    team.full_rate()

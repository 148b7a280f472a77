"""Three robots and a planner on four hosts without multicast between them."""

from __future__ import annotations

import itertools
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

from mrs_ros.discovery import discovery_environment
from mrs_tools.bags.reader import BagReader
from network.team import PLANNER, PLAYED, REAL, ROBOTS, TeamOnHosts, team_on_hosts

pytestmark = [pytest.mark.slow, pytest.mark.timeout(300)]  # 20 s each where nothing else runs
Show = Callable[[str], None]
FAR, NEAR = PLAYED


@pytest.fixture
def team(tmp_path: Path) -> Iterator[TeamOnHosts]:
    with team_on_hosts(tmp_path) as made:
        made.hosts.no_multicast()
        yield made


def test_team_meets_through_a_discovery_server(
    team: TeamOnHosts, show: Show, tmp_path: Path
) -> None:
    """The server is on the planner's host; the planner has no list of robots."""
    env = discovery_environment(server=team.hosts.addresses[PLANNER])
    team.env = dict.fromkeys([*ROBOTS, PLANNER], env)

    def serve() -> subprocess.Popen[bytes]:
        return team.start(PLANNER, sys.executable, "-m", "mrs_tools", "discovery-server")

    server = serve()
    team.start_all(known=False)

    # Tools see all topics of the team, on any host.
    numbers = itertools.count()

    def recorded() -> set[str]:
        """In a second and a half, which may be too short for a machine that is busy."""
        bag = tmp_path / f"{next(numbers)}.mcap"
        record = [sys.executable, "-m", "mrs_tools", "record", str(bag), "--duration", "1.5"]
        team.start(FAR, *record, "/*/points", "/tracked_people", "/diagnostics").wait(60)
        if not bag.exists():
            return set()
        with BagReader(bag) as reader:
            return set(reader.topics)

    wanted = {"/tracked_people", *(f"/{robot}/points" for robot in ROBOTS)}
    team.until(lambda: recorded() >= wanted, f"not all of {wanted} are recorded")

    # Without the server those who know each other go on. The next one knows nobody, and learns.
    server.terminate()
    assert server.wait(20) == 0
    moment = time.monotonic()
    team.all_back(ROBOTS, moment + 1.0)
    server = serve()
    team.full_rate()
    team.nodes[NEAR].kill()
    team.nodes[NEAR].wait()
    moment = time.monotonic()
    team.first(moment, lambda m: NEAR not in m.robots, "a killed robot goes on")
    moment = time.monotonic()
    team.play(NEAR)
    took = team.back(NEAR, moment)
    show(f"discovery server started again: a robot is there {took:.2f} s after its start")
    team.full_rate()


def test_peers_meet_without_multicast(team: TeamOnHosts, show: Show) -> None:
    """Each robot has the planner as a peer; the planner has none."""
    env = discovery_environment(peers=team.hosts.addresses[PLANNER])
    team.env = {REAL: env, NEAR: env}  # not FAR, which therefore finds nobody
    team.listen()
    team.start_planner(known=False)
    for robot in PLAYED:
        team.play(robot)
    team.start_robot()
    team.start_camera()
    team.until_seers({REAL, NEAR}, "the robots do not find the planner")

    team.hosts.link(NEAR, up=False)
    team.first(time.monotonic(), lambda m: m.seers == {REAL}, "the other does not go on")
    time.sleep(21.0)  # the lease: they forget each other
    moment = time.monotonic()
    team.hosts.link(NEAR, up=True)
    took = team.back(NEAR, moment)
    show(f"peers, link down for 21 s: people are back {took:.2f} s after link up")
    assert not any(FAR in message.robots for message in team.heard)

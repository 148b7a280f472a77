"""What others send guide_node delays no command, whatever it is; a long step does not, either."""

from __future__ import annotations

import os
import select
import subprocess
import sys
from collections.abc import Callable, Iterator
from itertools import pairwise
from pathlib import Path

import pytest
from mrs_people_msgs.msg import GuideStatus

from machine import nine_of_ten
from ros.guide_peer import GuideWorld, goal_of
from ros.harness import NodeProcess, Peer, Team
from ros.hostile_peer import KINDS

pytestmark = pytest.mark.slow

PLACES = {"robot_a": (0.0, 0.0, 0.0), "robot_b": (-3.5, 0.0, 0.0)}
PEOPLE = [(-1.5, 0.0), (-1.5, 0.6)]
#: Commands go out at 33 Hz; no more than this between two of them, as promised [s].
GAP_S = 0.1
ENVIRONMENT = {"PYTHONPATH": str(Path(__file__).parents[1])}
PARAMS = {"looks_back": "[robot_a]", "base.stamped": "true"}


@pytest.fixture(scope="module")
def guide(team: Team) -> NodeProcess:
    return team.start("guide_node", params=PARAMS)


@pytest.fixture
def world(peer: Peer, guide: NodeProcess) -> Iterator[GuideWorld]:
    made = GuideWorld(peer, "/", PLACES, PEOPLE, stamped=True)
    peer.until_active("/guide_node")
    yield made
    made.close()


def _gaps_s(world: GuideWorld, robot: str = "robot_a") -> list[float]:
    sent = [one.sent_ns for one in world.commands if one.robot == robot]
    return [(later - before) / 1e9 for before, later in pairwise(sent)]


@pytest.mark.alone
@pytest.mark.parametrize("kind", KINDS)
def test_no_message_delays_the_commands(
    world: GuideWorld, guide: NodeProcess, show: Callable[[str], None], kind: str
) -> None:
    world.start(goal_of((0.0, 0.0), (30.0, 0.0)))
    world.peer.until(lambda: len(world.commands) > 40, lambda: guide.log)

    command = [sys.executable, Path(__file__).with_name("hostile_peer.py"), kind]
    pipe = subprocess.PIPE
    with subprocess.Popen(
        command, env=ENVIRONMENT | os.environ, stdin=pipe, stdout=pipe
    ) as hostile:
        go, told = hostile.stdin, hostile.stdout
        assert go is not None
        assert told is not None

        def longest_s() -> float:
            world.commands.clear()
            go.write(b"\n")
            go.flush()
            world.peer.until(lambda: select.select([told], [], [], 0.0)[0], lambda: guide.log)
            assert told.readline() == b"done\n"
            assert guide.alive, guide.log
            assert world.statuses[-1].state not in (GuideStatus.CANCELLED, GuideStatus.FINISHED)
            return max(_gaps_s(world))

        nine_of_ten(longest_s, GAP_S, f"{kind}: longest pause of commands", tries=3, show=show)
        go.close()
    assert hostile.returncode == 0

"""How soon people are found again after a process was killed, as docs/network.md promises."""

from __future__ import annotations

import copy
import time
from collections.abc import Callable, Iterator

import pytest
from mrs_people_msgs.msg import People

from machine import FEW_OR_TEN, nine_of_ten
from ros.harness import Peer, Team
from ros.life import ROBOTS, Life, kill
from ros.recording import Recording

pytestmark = [pytest.mark.alone, pytest.mark.timeout(400)]
#: From the new start of a process, that is before it has loaded anything; this planner has to
#: discover its robots [s].
ROBOT_S, PLANNER_S = 2.0, 2.0


@pytest.fixture(scope="module")
def life(team: Team, domain: int, recording: Recording) -> Iterator[Life]:
    """All of them at work."""
    peer = Peer(domain)
    planner = team.start("planner_node")
    own = copy.deepcopy(recording)  # its stamps are changed
    made = Life(peer, team, own, planner, peer.hear(People, "/tracked_people"))
    for robot in ROBOTS:
        made.start(robot)
    made.until_seen_by(*ROBOTS)
    yield made
    peer.close()


@FEW_OR_TEN
def test_killed_robot_is_used_again_in_time(
    life: Life, show: Callable[[str], None], tries: int
) -> None:
    def back() -> float:
        kill(life.robots["robot_b"])
        began = time.monotonic()
        life.start("robot_b")
        life.until_seen_by(*ROBOTS)
        return time.monotonic() - began

    what = "robot_node killed: its people after its new start"
    nine_of_ten(back, ROBOT_S, what, tries=tries, show=show)


@FEW_OR_TEN
def test_killed_planner_publishes_again_in_time(
    life: Life, show: Callable[[str], None], tries: int
) -> None:
    def back() -> float:
        kill(life.planner)
        began = time.monotonic()
        life.planner = life.team.start("planner_node")
        life.until_seen_by(*ROBOTS)
        return time.monotonic() - began

    what = "planner_node killed: people of all robots after its new start"
    nine_of_ten(back, PLANNER_S, what, tries=tries, show=show)

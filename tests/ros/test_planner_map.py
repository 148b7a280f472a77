"""planner_node masks walls of a map that was published before it started."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest
from nav_msgs.msg import OccupancyGrid
from rclpy.qos import DurabilityPolicy, QoSProfile

from ros.harness import ERROR, OK, WARN, Peer, Team, holds
from ros.planner_peer import PlannerPeer, PlayedRobot, places, robots_in
from ros.recording import stamp_of

pytestmark = pytest.mark.slow

NAMES = ["robot_a", "robot_b"]
PLACES = [(3.0, 3.5, -math.pi / 2), (1.0, 1.0, 0.0)]
#: In the wall along x, which the scans take for somebody; in the open; where robot_b stands.
WALL, SOMEBODY, ROBOT_B = (3.0, -0.05), (4.0, 1.0), (1.0, 1.0)
LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)


def room(frame_id: str = "map") -> OccupancyGrid:
    """A room of 6 x 4 m with its corner at the origin, in walls of 0.1 m, as map_server has it."""
    data = np.zeros((42, 62), dtype=np.int8)
    data[[0, -1]] = 100
    data[:, [0, -1]] = 100
    message = OccupancyGrid(data=data.reshape(-1).tolist())
    message.header.frame_id = frame_id
    message.info.resolution, message.info.width, message.info.height = 0.1, 62, 42
    message.info.origin.position.x = message.info.origin.position.y = -0.1
    return message


@pytest.fixture(scope="module")
def planner(team: Team, peer: Peer) -> PlannerPeer:
    params = {
        "robots": f"[{','.join(NAMES)}]",
        "interval.max_wait": "5.0",
        "interval.robot_timeout": "60.0",
        "masking.occupancy_grid": "true",
    }
    process = team.start("planner_node", namespace="/team", params=params)
    made = PlannerPeer(peer, process, "/team/")
    peer.until_active(made.node)
    return made


@pytest.fixture(scope="module")
def robots(peer: Peer) -> list[PlayedRobot]:
    return [
        PlayedRobot(peer, f"team/{name}", place) for name, place in zip(NAMES, PLACES, strict=True)
    ]


def _people(planner: PlannerPeer, robots: list[PlayedRobot]) -> list[tuple[float, float]]:
    """Who is found where robot_a sees something person-sized at all three places."""
    sent: list[int] = []

    def found() -> list[Any]:
        # Again until it arrives: what is sent right after two have met may get lost.
        sent.append(planner.now())
        robots[0].send(sent[-1], WALL, SOMEBODY, ROBOT_B)
        robots[1].send(sent[-1])
        planner.peer.spin(0.3)
        return [m for m in planner.people if stamp_of(m) in sent and robots_in(m) == NAMES]

    return places(planner.peer.until(found, lambda: planner.process.log)[-1])


def test_missing_map_is_reported_and_masks_nothing(
    planner: PlannerPeer, robots: list[PlayedRobot]
) -> None:
    text = r"no data on /team/map for \d+ s; publishers: 0"
    finding = planner.until_finding("map", lambda f: holds(f.message, [text]), text)
    assert finding.level == ERROR
    # Robots are where their poses say.
    assert _people(planner, robots) == [WALL, SOMEBODY]


def test_unusable_map_stays_an_error_and_masks_nothing(planner: PlannerPeer) -> None:
    """It is latched and arrives once: it is reported until there is another."""
    planner.peer.publisher(OccupancyGrid, "/team/map", LATCHED).publish(room("odom"))
    text = "none of 1 can be used; last: frame_id is 'odom'; wanted: 'map'"
    planner.until_finding("map", lambda f: f.level == ERROR and f.message == text, text)


def test_latched_map_masks_the_wall(planner: PlannerPeer, robots: list[PlayedRobot]) -> None:
    peer = planner.peer
    assert peer.change_state(planner.node, "deactivate")
    publisher = peer.publisher(OccupancyGrid, "/team/map", LATCHED)
    publisher.publish(room())  # nobody listens now
    assert peer.change_state(planner.node, "activate")
    finding = planner.until_finding("map", lambda f: f.level == OK, "the map has come")
    assert _people(planner, robots) == [SOMEBODY]
    # One map is enough: silence after it is no fault.
    silent = planner.until_finding(
        "map", lambda f: float(f.values["silent_s"]) > 6.0, "silence after the map"
    )
    assert silent.level == finding.level == OK


def test_unusable_map_is_reported_and_the_last_one_kept(
    planner: PlannerPeer, robots: list[PlayedRobot]
) -> None:
    planner.peer.publisher(OccupancyGrid, "/team/map", LATCHED).publish(room("odom"))
    text = "1 dropped; last: frame_id is 'odom'; wanted: 'map'"
    finding = planner.until_finding("map", lambda f: holds(f.message, [text]), text)
    assert finding.level == WARN
    assert _people(planner, robots) == [SOMEBODY]
    # Another margin: the same map, looked at again.
    planner.peer.must_set(planner.node, masking__occupied_from=100)
    assert _people(planner, robots) == [SOMEBODY]


def test_later_planner_receives_the_latched_map(
    planner: PlannerPeer, robots: list[PlayedRobot], team: Team
) -> None:
    planner.peer.publisher(OccupancyGrid, "/team/map", LATCHED).publish(room())
    planner.process.stop()
    process = team.start(
        "planner_node",
        namespace="/team",
        params={
            "robots": f"[{','.join(NAMES)}]",
            "interval.max_wait": "5.0",
            "interval.robot_timeout": "60.0",
            "masking.occupancy_grid": "true",
        },
    )
    planner.peer.until_active(planner.node)
    later = PlannerPeer(planner.peer, process, "/team/")
    later.until_finding("map", lambda f: f.level == OK, "the map has come")
    assert _people(later, robots) == [SOMEBODY]

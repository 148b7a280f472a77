"""`mrs view` of a team over DDS (its server: tests/tools/view)."""

from __future__ import annotations

import time
from collections.abc import Iterator
from typing import Any

import numpy as np
import pytest
from geometry_msgs.msg import PoseWithCovarianceStamped
from mrs_people_msgs.msg import People
from sensor_msgs.msg import CameraInfo, Image, PointCloud2
from std_msgs.msg import Header
from stereo_msgs.msg import DisparityImage

pytest.importorskip("aiohttp", reason="the server needs aiohttp")

from mrs_people_loc.config import Disparity
from mrs_people_loc.guiding.tour import tour_from
from mrs_people_loc.scan import Cells, Scan
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_ros import convert
from mrs_ros.qos import STREAM
from mrs_tools.view import live
from mrs_tools.view.live import LiveSource
from ros.guide_peer import GuideWorld
from ros.harness import Peer, Team
from ros.planner_peer import PlayedRobot, pose_of
from tools.view.serving import Looker, served

pytestmark = pytest.mark.slow

PLACES = {"robot_a": (0.0, 0.0, 0.0), "robot_b": (-3.5, 0.0, 0.0)}
PEOPLE = [(-1.2, 0.0), (-1.1, 0.4)]  # near enough to stand
TOUR = tour_from([(0.0, 0.0), (3.0, 0.0)], name="hall")


@pytest.fixture(scope="module")
def world(peer: Peer, team: Team) -> Iterator[GuideWorld]:
    """Two robots and two people, and a guide; nobody plans."""
    team.start("guide_node", params={"safety.people_timeout": "3.0", "safety.pose_timeout": "3.0"})
    made = GuideWorld(peer, "/", PLACES, PEOPLE)
    peer.publisher(PointCloud2, "/robot_a/points", STREAM)
    yield made
    made.close()


@pytest.fixture(scope="module")
def url(domain: int) -> Iterator[str]:
    with served(LiveSource(control=True, tours={"hall": TOUR})) as address:
        yield address


@pytest.fixture
def looker(url: str) -> Iterator[Looker]:
    made = Looker(url)
    yield made
    made.leave()


def test_people_and_robots_are_shown_as_they_are_published(
    world: GuideWorld, looker: Looker
) -> None:
    world.peer.until(lambda: looker.last("state").get("people"), "no people are shown")
    state = looker.last("state")
    shown = [(p["x"], p["y"]) for p in state["people"]]
    np.testing.assert_allclose(shown, PEOPLE, atol=1e-3)
    assert abs(state["age"]) < 3.0
    assert [robot["name"] for robot in state["robots"]] == ["robot_a", "robot_b"]


def test_people_of_a_simulation_whose_clock_has_ended_are_as_old_as_they_came(peer: Peer) -> None:
    people = peer.publisher(People, "/simulated/tracked_people", 10)
    message = People(header=Header(stamp=convert.time(5_000_000_000), frame_id="map"))
    with served(LiveSource("simulated")) as address:
        looker = Looker(address)

        def come() -> bool:
            people.publish(message)
            peer.spin(0.05)
            return looker.last("state").get("t") == 5.0

        peer.until(come, lambda: looker.last("state"))
        assert 0.0 <= looker.last("state")["age"] < 3.0
        looker.leave()


def test_robots_that_have_left_are_forgotten(peer: Peer, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live, "_FORGET_S", 1.5)
    robot = PlayedRobot(peer, "leaving/robot_z", (1.0, 2.0, 0.0))
    robot.announce()
    with served(LiveSource("leaving")) as address:
        looker = Looker(address)

        def shown() -> list[str]:
            return [one["name"] for one in looker.last("state").get("robots", [])]

        def comes() -> bool:
            peer.publisher(PoseWithCovarianceStamped, "/leaving/robot_z/pose").publish(
                pose_of(time.time_ns(), *robot.place)
            )
            peer.spin(0.05)
            return shown() == ["robot_z"]

        for _ in range(2):  # it may come again
            robot.announce()
            peer.until(comes, lambda: looker.last("state"))
            for topic in ("points", "pose"):
                peer.silence(f"/leaving/robot_z/{topic}")
            peer.until(lambda: not shown(), lambda: looker.last("state"))
        looker.leave()


def test_team_that_starts_is_not_said_to_lack_anything(world: GuideWorld) -> None:
    """Nobody plans, which is an error of a team that runs."""
    with served(LiveSource(starting=True)) as address:
        looker = Looker(address)
        world.peer.until(lambda: looker.last("state").get("people"), "no people are shown")
        world.peer.until(
            lambda: looker.last("health").get("level") == "error", "it is well all the time"
        )
        levels = [message["level"] for message in looker.got if message["type"] == "health"]
        assert levels[0] == "waiting"
        looker.leave()


def test_images_are_subscribed_to_only_while_somebody_looks(
    world: GuideWorld, looker: Looker
) -> None:
    peer = world.peer
    kinds = {"left/image_rect": Image, "debug/disparity": DisparityImage}
    publishers = {
        topic: peer.publisher(kind, f"/robot_a/{topic}", STREAM) for topic, kind in kinds.items()
    }
    info = peer.publisher(CameraInfo, "/robot_a/left/camera_info", STREAM)

    def listeners() -> list[int]:
        return [publisher.get_subscription_count() for publisher in publishers.values()]

    # The robot is discovered: looking at it would be possible.
    peer.until(lambda: looker.last("state").get("robots"), "no robots are shown")
    assert listeners() == [0, 0]
    looker.send(type="look", robots=["robot_a"])
    peer.until(lambda: min(*listeners(), info.get_subscription_count()), "nobody subscribes")

    def send() -> Any:
        header = Header(stamp=convert.time(time.time_ns()), frame_id="left")
        k, p = np.array([50.0, 0, 32, 0, 50, 24, 0, 0, 1]), np.zeros(12)
        p[[0, 2, 5, 6, 10]] = 50.0, 32.0, 50.0, 24.0, 1.0
        info.publish(CameraInfo(header=header, width=64, height=48, k=k, p=p, r=np.eye(3).ravel()))
        image = Image(header=header, width=64, height=48, step=64, encoding="mono8")
        image.data = bytes(64 * 48)
        publishers["left/image_rect"].publish(image)
        camera = StereoCamera(64, 48, 50.0, 50.0, 32.0, 24.0, 0.1)
        disparity = np.full((48, 64), 2.0, np.float32)
        made = convert.disparity(header, disparity, camera, Disparity())
        publishers["debug/disparity"].publish(made)
        scan = Scan("robot_a", time.time_ns(), Cells.empty())
        points = convert.points(scan, "robot_a/base_link")
        points.header.stamp = header.stamp
        peer.publisher(PointCloud2, "/robot_a/points", STREAM).publish(points)
        peer.spin(0.05)
        shown = looker.last("image")
        return shown.get("image") and shown.get("disparity") and not shown.get("note")

    peer.until(send, lambda: f"no image: {looker.last('image')}")
    assert abs(looker.last("image")["age"]) < 3.0
    looker.leave()
    peer.until(lambda: listeners() == [0, 0], lambda: f"subscribed to: {listeners()}")


def test_tour_is_started_and_cancelled_from_the_page(world: GuideWorld, looker: Looker) -> None:
    peer = world.peer
    peer.until_active("/guide_node")

    def answer(**command: Any) -> dict[str, Any]:
        before = len(looker.got)
        looker.send(**command)
        peer.until(
            lambda: any(m["type"] == "answer" for m in looker.got[before:]), f"no answer: {command}"
        )
        return looker.last("answer")

    begun: dict[str, Any] = {}

    def begins() -> bool:
        begun.update(answer(type="tour", start="hall"))  # refused while the guide has no poses
        return bool(begun["ok"])

    peer.until(begins, lambda: begun)
    assert begun["text"] == "hall has begun"
    again = answer(type="tour", start="hall")
    assert (again["ok"], again["text"]) == (False, "a tour goes on; cancel it first")
    peer.until(lambda: looker.last("state").get("tour"), "no tour is shown")
    assert looker.last("state")["tour"]["name"] == "hall"
    assert answer(type="stop")["text"] == "guide_node is told to stop the robots"
    peer.until(
        lambda: looker.last("state")["tour"]["state"] == "stopped",
        lambda: looker.last("state")["tour"],
    )
    assert "stopped by /mrs_view_" in looker.last("state")["tour"]["message"]
    assert answer(type="release")["text"] == "released"
    assert (answer(type="release")["ok"], looker.last("answer")["text"]) == (
        False, "the robots are not stopped",
    )  # fmt: skip
    assert answer(type="tour", cancel=True)["ok"]
    peer.until(
        lambda: looker.last("state")["tour"]["state"] == "cancelled",
        lambda: looker.last("state")["tour"],
    )
    ended = "the tour hall has ended: cancelled"
    peer.until(
        lambda: ended in [m["text"] for m in looker.got if m["type"] == "event"],
        lambda: looker.last("event"),
    )


def test_page_says_when_the_planner_is_gone(world: GuideWorld, team: Team, looker: Looker) -> None:
    def is_missed() -> bool:
        findings = looker.last("health").get("findings", [])
        return any("no planner_node" in finding["text"] for finding in findings)

    world.peer.until(is_missed, "the planner is not missed")
    planner = team.start("planner_node")
    world.peer.until(lambda: not is_missed(), lambda: f"missed all the same: {planner.log}")
    planner.stop()
    world.peer.until(is_missed, "the planner is not missed again")
    assert looker.last("health")["level"] == "error"

"""People in messages of other packages: what is in them, and over DDS from a planner_node."""

from __future__ import annotations

import contextlib
import json
import math
import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from ament_index_python.packages import get_package_share_directory
from geometry_msgs.msg import Vector3
from nav_msgs.msg import OccupancyGrid
from rclpy.qos import DurabilityPolicy, QoSProfile
from std_msgs.msg import Bool, Float32, Header

from mrs_people_loc.people import Group, Person
from planner_node.others import detections, hri, social
from planner_node.others.frames import person_frames
from ros.harness import Peer, Team
from ros.interfaces import INSTALLED, interfaces
from ros.planner_peer import PATIENT, PlannerPeer, PlayedRobot

pytestmark = pytest.mark.slow

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
HEADER = Header(frame_id="map")
COVARIANCE = np.array([[0.04, 0.01], [0.01, 0.09]])
WALKS = Person(
    np.array([1.0, -2.0]), COVARIANCE, 1.8, 0.1, ("robot_a",), -1, id=3,
    velocity=np.array([0.5, 0.25]), velocity_covariance=np.eye(2),
)  # fmt: skip
#: Predicted, and nothing is known of the velocity.
HIDDEN = Person(np.array([4.0, 0.0]), COVARIANCE, math.nan, 0.1, (), -1, id=12, coasting=True)
#: As of a planner that does not track.
NAMELESS = Person(np.array([0.0, 7.0]), COVARIANCE, 1.6, 0.1, ("robot_a",), 0)
#: Hashes (REP 2016) of the packages' own files: people_msgs 1.3.0, hri_msgs 2.0.0, vision_msgs
#: 4.1.1.
HASHES = {
    "people_msgs/People": "9ea98a5e58f833a9532957bca23a6b8006a12885d5a16c8ca41dd901d10c33b6",
    "hri_msgs/IdsList": "7e0812d1ac945c98fd3e393568d581ad0ab567f37b24eff633eab778c1bfe62d",
    "hri_msgs/Group": "8a5322be10347f118545806061283201525b8f572bfe6131b4b45b70c56f2935",
    "vision_msgs/Detection3DArray": (
        "793f5eab9595ac1c0da07873cc859db42eae51f0ee76056db8562515d830e018"
    ),
}

#: Knows nothing of ours: writes what is on `people`, a line each.
STRANGER = """
import json, rclpy
from people_msgs.msg import People
rclpy.init()
node = rclpy.create_node("social_layer")
def say(message):
    people = [[p.position.x, p.position.y, p.velocity.x, p.velocity.y] for p in message.people]
    print(json.dumps([message.header.frame_id, people]), flush=True)
node.create_subscription(People, "people", say, 10)
rclpy.spin(node)
"""


# Before `packages`, which makes them all available.
def test_old_name_leaves_none_for_people_msgs(peer: Peer, team: Team) -> None:
    process = team.start("planner_node", namespace="/old", params={"people_topic": "people"})
    peer.until_active(process.name)
    assert peer.published_by(process.name)["/old/people"] == ["mrs_people_msgs/msg/People"]
    assert process.log.count("people_topic is people, so people_msgs/People is not published") == 1
    absent = [name for name in ("vision_msgs", "hri_msgs") if name not in INSTALLED]
    lines = [line for line in process.log.splitlines() if "not installed" in line]
    assert [line.partition("published: ")[2] for line in lines] == [", ".join(absent)][
        : len(absent)
    ]


@pytest.fixture(scope="module")
def packages(tmp_path_factory: pytest.TempPathFactory, domain: int) -> Iterator[None]:
    """The packages can be imported, by the planner, too."""
    with interfaces(tmp_path_factory, "people_msgs", "hri_msgs", "vision_msgs"):
        yield


@pytest.mark.usefixtures("packages")
class TestMessages:
    def test_definitions_are_those_of_the_packages(self) -> None:
        from hri_msgs.msg import Group as GroupMessage
        from hri_msgs.msg import IdsList
        from people_msgs.msg import People as SocialPeople
        from vision_msgs.msg import Detection3DArray

        types = (SocialPeople, IdsList, GroupMessage, Detection3DArray)
        assert dict(map(hash_of, types)) == HASHES

    def test_people_msgs_have_no_nan(self) -> None:
        import people_msgs.msg

        made = social.people(HEADER, [WALKS, HIDDEN, NAMELESS], people_msgs.msg)
        assert made.header == HEADER
        assert [(p.name, p.reliability) for p in made.people] == [("p3", 1), ("p12", 0.5), ("", 1)]
        first, hidden, _ = made.people
        assert (first.position.x, first.position.y, first.position.z) == (1.0, -2.0, 0.0)
        assert (first.velocity.x, first.velocity.y, first.velocity.z) == (0.5, 0.25, 0.0)
        assert (hidden.velocity.x, hidden.velocity.y, hidden.velocity.z) == (0.0, 0.0, 0.0)
        assert social.people(HEADER, [], people_msgs.msg).people == []

    def test_detections_are_boxes_on_the_floor(self) -> None:
        import vision_msgs.msg

        made = detections.detections(HEADER, [WALKS, HIDDEN, NAMELESS], vision_msgs.msg)
        assert [one.id for one in made.detections] == ["p3", "p12", ""]
        first, hidden, _ = made.detections
        assert made.header == first.header == HEADER
        centre = first.bbox.center.position
        assert (centre.x, centre.y, centre.z) == (1.0, -2.0, 0.9)
        assert first.bbox.size == Vector3(x=0.51, y=0.51, z=1.8)
        assert hidden.bbox.size.z == 2.0 * hidden.bbox.center.position.z == 1.95
        (result,) = first.results
        assert (result.hypothesis.class_id, result.hypothesis.score) == ("person", 1.0)
        assert hidden.results[0].hypothesis.score == 0.5
        at = result.pose.pose.position
        assert (at.x, at.y, at.z) == (1.0, -2.0, 0.0)
        np.testing.assert_array_equal(
            np.reshape(result.pose.covariance, (6, 6))[:2, :2], COVARIANCE
        )

    def test_group_lists_its_members(self) -> None:
        import hri_msgs.msg

        group = Group(np.zeros(2), np.eye(2), 1.0, 1.0, 2, members=(3, 12), id=1)
        made = hri.group_message(HEADER, group, hri_msgs.msg)
        assert (made.header, made.group_id, made.members) == (HEADER, "g1", ["p3", "p12"])


def hash_of(kind: type) -> tuple[str, str]:
    """A message and the hash of its definition, as the generator wrote it into the package."""
    package = kind.__module__.partition(".")[0]
    path = Path(get_package_share_directory(package), "msg", f"{kind.__name__}.json")
    types = json.loads(path.read_text(encoding="utf-8"))["type_hashes"]
    hashes = {one["type_name"]: one["hash_string"] for one in types}
    return f"{package}/{kind.__name__}", hashes[f"{package}/msg/{kind.__name__}"][7:]


def test_frames_are_at_the_head_of_people_with_an_id() -> None:
    made = person_frames(HEADER, [WALKS, HIDDEN, NAMELESS])
    assert [one.child_frame_id for one in made] == ["person_p3", "person_p12"]
    assert [one.header for one in made] == [HEADER, HEADER]
    at = [one.transform.translation for one in made]
    assert [(p.x, p.y, p.z) for p in at] == [(1.0, -2.0, 1.8), (4.0, 0.0, 0.0)]
    assert made[0].transform.rotation.w == 1.0


def test_packages_that_know_only_their_own_messages_get_people(
    packages: None, peer: Peer, team: Team
) -> None:
    """Two people come, and go with the robot that saw them: nobody is there then."""
    from hri_msgs.msg import IdsList
    from vision_msgs.msg import Detection3DArray

    params = PATIENT | {"outputs.people_costmap": "true", "interval.robot_timeout": "2.0"}
    planner = PlannerPeer(peer, team.start("planner_node", params=params))
    peer.until_active(planner.node)
    with stranger() as people:
        tracked = peer.hear(IdsList, "/humans/persons/tracked")
        boxes = peer.hear(Detection3DArray, "/people_detections")
        grids = peer.hear(OccupancyGrid, "/people_costmap", LATCHED)
        peer.publisher(OccupancyGrid, "/map", LATCHED).publish(hall())
        robot = PlayedRobot(peer, "robot_a", (0.0, 0.0, 0.0))
        robot.announce()

        def two_are_known() -> bool:
            robot.send(planner.now(), (2.0, 0.0), (3.0, 1.0))
            peer.spin(0.05)
            return bool(
                people and len(people[-1][1]) == 2 and tracked and len(tracked[-1].ids) == 2
            )

        peer.until(two_are_known, lambda: (people[-1:], tracked[-1:], planner.process.log))
        ids = tracked[-1].ids
        anonymous = peer.hear(Bool, f"/humans/persons/{ids[0]}/anonymous", LATCHED)
        sure = peer.hear(Float32, f"/humans/persons/{ids[0]}/location_confidence")

        def all_is_said() -> bool:
            robot.send(planner.now(), (2.0, 0.0), (3.0, 1.0))
            peer.spin(0.05)
            return bool(anonymous and sure and grids and max(grids[-1].data) == 100)

        peer.until(all_is_said, lambda: (anonymous, sure, len(grids), planner.process.log))
        frame, found = people[-1]
        assert frame == "map"
        assert sorted(np.round(found, 1).tolist())[0][:2] == [2.0, 0.0]
        numbers = {person.id for person in planner.people[-1].persons}
        assert {f"p{number}" for number in numbers} == set(ids)
        assert (anonymous[0].data, sure[-1].data) == (True, 1.0)
        assert boxes[-1].header.stamp in [one.header.stamp for one in tracked]
        assert len(boxes[-1].detections) == 2
        assert grids[-1].info == hall().info
        # The robot falls silent.
        peer.until(lambda: people[-1][1] == [] and tracked[-1].ids == [], lambda: people[-1])
        peer.until(lambda: max(grids[-1].data) == -1, "people_costmap without people")
        topic = f"/humans/persons/{ids[0]}/anonymous"
        peer.until(
            lambda: topic not in peer.published_by(planner.node), "no topics of who has left"
        )
    planner.process.stop()


@contextlib.contextmanager
def stranger() -> Iterator[list[Any]]:
    """Runs `STRANGER`; what it writes, line by line."""
    heard: list[Any] = []
    command = [sys.executable, "-c", STRANGER]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:

        def read() -> None:
            assert process.stdout is not None
            for line in process.stdout:
                heard.append(json.loads(line))

        reading = threading.Thread(target=read)
        reading.start()
        try:
            yield heard
        finally:
            process.kill()
            reading.join()


def hall() -> OccupancyGrid:
    """A free floor of 6 x 6 m in cells of 12.5 cm."""
    message = OccupancyGrid(data=[0] * 48 * 48)
    message.header.frame_id = "map"
    message.info.resolution, message.info.width, message.info.height = 0.125, 48, 48
    message.info.origin.position.x, message.info.origin.position.y = -1.0, -3.0
    return message

"""`mrs evaluate` on bags of guided tours."""

from __future__ import annotations

import json

import pytest

from mrs_people_loc.errors import BagError

pytest.importorskip("rosbags.interfaces", reason="writing bags needs rosbags")
pytest.importorskip("typer", reason="the mrs command needs typer")

from rosbags.typesys import Stores, get_typestore
from typer.testing import CliRunner

from mrs_people_loc.guiding.guidance import Role, State
from mrs_people_sim.evaluation.guided_tours import read_statuses
from mrs_people_sim.evaluation.results import evaluate_bag
from mrs_tools.bags.message_types import require_types
from mrs_tools.bags.reader import BagReader
from mrs_tools.bags.writer import BagWriter
from mrs_tools.cli import app
from tools.made_bag import START_NS, Bag


@pytest.fixture(autouse=True)
def our_messages() -> None:
    try:
        require_types(get_typestore(Stores.ROS2_JAZZY), ["mrs_people_msgs/msg/GuideStatus"])
    except BagError:
        pytest.skip("mrs_people_msgs is not installed")


def guided(bag: Bag) -> None:
    """Two people walk for 4 s at 1 m/s; the robot is 2 m ahead and 0.5 m beside its post.

    The second person is found half of the time.
    """
    for k in range(21):
        ms, x = 200 * k, 0.2 * k
        bag.truth(ms, (x, 0), (x, 1))
        bag.people(ms, (x, 0), *([(x, 1.1)] if k % 2 == 0 else []))
        bag.true_pose("robot_a", ms, x + 2, 0.5)
        bag.guide_status(
            ms, State.FINISHED if k == 20 else State.LEADING, way=x, posts={"robot_a": (x + 2, 0)},
            faults=["robot_b"],
        )  # fmt: skip


@pytest.fixture
def bag(tmp_path):
    path = tmp_path / "hall.mcap"
    with BagWriter(path) as writer:
        guided(Bag(writer))
    return path


def test_what_the_guide_said_is_read(bag):
    with BagReader(bag) as reader:
        first, *_, last = read_statuses(reader)
    assert (first.stamp_ns, first.state, last.state) == (START_NS, State.LEADING, State.FINISHED)
    assert last.way_m == pytest.approx(4.0)
    assert first.posts.keys() == {"robot_a"}
    assert first.posts["robot_a"].role is Role.REAR
    assert first.posts["robot_a"].xy.tolist() == [2.0, 0.0]
    assert first.faults == {"robot_b": "no pose"}


def test_a_tour_is_scored(bag, tmp_path):
    file = tmp_path / "figures.json"
    arguments = ["evaluate", str(bag), "--json", str(file)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    tour = json.loads(file.read_text())["tour"]
    assert (tour["tours"], tour["finished"], tour["people"], tour["lost"]) == (1, 1, 2, 0)
    assert tour["time_s"] == pytest.approx(4.0)
    mean = pytest.approx((1 + 11 / 21) / 2)
    assert tour["seen"] == {"mean": mean, "min": pytest.approx(11 / 21), "detected": mean}
    assert tour["formation_m"]["median"] == pytest.approx(0.5)
    assert tour["distance_m"] == pytest.approx(4.25**0.5)
    assert tour["path_m"] == pytest.approx(4.0)
    assert "1 of 1" in result.output
    assert max(map(len, result.output.splitlines())) <= 80


class Elsewhere(Bag):
    def write(self, topic, ms, message):
        super().write("/b" + topic, ms, message)


def test_two_guides_in_a_bag_are_refused(tmp_path):
    path = tmp_path / "two.mcap"
    with BagWriter(path) as writer:
        guided(Bag(writer))
        Elsewhere(writer).guide_status(0, State.LEADING)
    with pytest.raises(BagError, match="2 topics of mrs_people_msgs/msg/GuideStatus"):
        evaluate_bag(path)

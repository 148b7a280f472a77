"""The whole loop over DDS: rendered heads, robot nodes, planner, guide, wheels, followers."""

from __future__ import annotations

import re
from pathlib import Path

import pytest

pytest.importorskip("rclpy")
pytest.importorskip("embreex", reason="the simulator needs embreex")

from typer.testing import CliRunner

from mrs_people_loc.guiding.guidance import State
from mrs_people_loc.messages import stamp_ns_of
from mrs_people_sim.evaluation.guided_tours import read_statuses
from mrs_tools.bags.reader import BagReader
from mrs_tools.cli import app

_TRUTH = "/ground_truth/people_poses"
SCENE = """
room: {length: 15.0, width: 5.0, posters: 10}
layout: {people: 4, activity: guided}
tour: {points: [[3.0, 2.5], [11.0, 2.5]]}
robots:
  robot_a: {x: 6.0, y: 2.5, head: {yaw: 3.14159}}
  robot_b: {x: 1.2, y: 3.2}
  robot_c: {x: 1.0, y: 1.8}
"""


@pytest.mark.alone
@pytest.mark.timeout(240)
def test_group_is_guided_through_the_whole_loop_and_an_outage_of_the_planner(
    tmp_path: Path,
) -> None:
    scene, bag = tmp_path / "short.yaml", tmp_path / "tour.mcap"
    scene.write_text(SCENE)
    arguments = ["--scene", str(scene), "--kill", "planner@9-10", "--duration", "150"]
    result = CliRunner().invoke(app, ["tour", "--simulate", *arguments, "--record", str(bag)])
    assert result.exit_code == 0, result.output
    assert re.search(r"short +1 of 1 .* 4 +0 ", result.output), result.output  # nobody is lost
    with BagReader(bag) as reader:
        statuses = read_statuses(reader)
        assert {"/tracked_people", "/map", _TRUTH} <= {
            topic.name for topic in reader.topics.values() if topic.count
        }
        # Bag times are those of the world, however slow it is.
        late_ns = [ns - stamp_ns_of(one.header.stamp) for _, ns, one in reader.decoded([_TRUTH])]
        assert -0.1e9 < min(late_ns) <= max(late_ns) < 1e9
    states = [status.state for status in statuses]
    halted = states.index(State.HALTED, states.index(State.LEADING))
    assert State.LEADING in states[halted:]
    assert states[-1] == State.FINISHED

"""The collision monitor of robot_node where the time jumps back, without DDS."""

from __future__ import annotations

from unittest.mock import MagicMock

import pytest
from geometry_msgs.msg import Twist

from mrs_people_loc.config import RobotConfig
from robot_node.collision_monitor import MonitorTopics


@pytest.mark.parametrize("driven", [True, False])
def test_driven_robot_is_told_to_stand_where_the_time_jumps_back(driven: bool) -> None:
    node, ranges = MagicMock(), MagicMock()
    node.config = RobotConfig()
    node.get_parameter.return_value.value = False
    node.get_clock.return_value.now.return_value.nanoseconds = 10**18
    monitor = MonitorTopics(node, "robot_a/base_link", ranges)
    published = node.offer.return_value.publish
    if driven:
        command = Twist()
        command.linear.x = 0.05
        monitor._on_command(command)
        assert published.call_args.args[0].linear.x == 0.05
    monitor.reset()
    sent = [call.args[0].linear.x for call in published.call_args_list]
    assert sent == ([0.05, 0.0] if driven else [])

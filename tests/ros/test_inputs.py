"""Which refused messages an input counts as faults of their sender, and what waiting logs."""

from __future__ import annotations

from collections.abc import Iterator
from types import SimpleNamespace
from typing import Any

import pytest
import rclpy
from rclpy.context import Context
from rclpy.node import Node
from sensor_msgs.msg import PointCloud2

from mrs_people_loc.clocks import Order, StampOrder
from mrs_people_loc.errors import OutdatedError, ScanError
from mrs_people_loc.health import reception
from mrs_people_loc.health.findings import ERROR, OK, WARN, Code, Finding
from mrs_ros import diagnostics
from mrs_ros.diagnostics import Input, Reporter
from mrs_ros.qos import STREAM

SECOND = 1_000_000_000


class Heard:
    """An input whose messages must go forward, without a network between."""

    def __init__(self, node: Node) -> None:
        self.order = StampOrder()
        self.error: Exception | None = None
        self.input = Input(node, PointCloud2, "points", self.callback, STREAM)

    def callback(self, message: Any) -> None:
        stamp = message.header.stamp
        if self.error is not None:
            raise self.error
        if self.order.take(stamp.sec * SECOND + stamp.nanosec) is Order.LATE:
            raise ScanError("wanted: newer")

    def take(self, *seconds: float) -> None:
        for second in seconds:
            message = PointCloud2()
            message.header.stamp.sec = int(second)
            message.header.stamp.nanosec = round((second - int(second)) * SECOND)
            self.input._take(message)

    def says(self) -> tuple[bytes, Code | None]:
        finding = self.input.finding()
        return finding.level, finding.code


@pytest.fixture
def node(domain: int) -> Iterator[Node]:
    context = Context()
    rclpy.init(context=context, domain_id=domain)
    made = Node("hearing", context=context)
    yield made
    made.destroy_node()
    rclpy.shutdown(context=context)


@pytest.fixture
def heard(node: Node) -> Heard:
    return Heard(node)


def test_refusals_until_a_jump_back_is_believed_are_no_fault(heard: Heard) -> None:
    for _ in range(3):
        heard.take(10.0, 10.2)
        for second in (1.0, 1.2, 1.4, 1.6):
            heard.take(second)
            assert heard.says() == (OK, None)
    assert heard.order.resets == 3
    assert dict(heard.input.reception.dropped) == {"jumped_back": 6}


def test_refusals_count_in_a_row(heard: Heard) -> None:
    error = ScanError("broken")
    for second, heard.error in enumerate((error, error, None, error, error), start=1):
        heard.take(float(second))
        assert heard.says()[1] is not Code.ALL_REFUSED
    heard.take(6.0)
    assert heard.says() == (ERROR, Code.ALL_REFUSED)


def test_single_late_message_is_a_fault(heard: Heard) -> None:
    heard.take(10.0, 5.0, 10.2)
    assert heard.says() == (WARN, Code.SOME_REFUSED)
    assert "1 dropped; last: wanted: newer" in heard.input.finding().message
    assert dict(heard.input.reception.dropped) == {"ScanError": 1}


@pytest.mark.parametrize("seconds", [[10.0], [5.0, 5.0, 5.0], [0.0, 0.0, 0.0], [9.5]])
def test_stamps_that_do_not_increase_are_a_fault(heard: Heard, seconds: list[float]) -> None:
    """Repeated stamps, a stopped clock, no stamps, and stamps that are a little late."""
    heard.take(10.0, *seconds)
    assert heard.says()[1] in (Code.SOME_REFUSED, Code.ALL_REFUSED)
    assert dict(heard.input.reception.dropped) == {"ScanError": len(seconds)}


def test_messages_on_their_way_when_clock_jumps_are_counted_but_no_fault(heard: Heard) -> None:
    heard.take(10.0)
    heard.error = OutdatedError("of before")
    heard.take(10.2, 10.4, 10.6, 10.8)
    assert heard.says() == (OK, None)
    heard.error = None
    heard.take(11.0)
    assert heard.says() == (OK, None)
    assert dict(heard.input.reception.dropped) == {"OutdatedError": 4}


def test_sender_that_does_not_follow_clock_is_reported_as_outdated(
    heard: Heard, monkeypatch: pytest.MonkeyPatch
) -> None:
    heard.error = OutdatedError("of before")
    heard.take(10.0)
    monkeypatch.setattr(reception, "SILENCE_S", -1.0)  # as if it had lasted for seconds
    heard.take(10.2, 10.4, 10.6)
    heard.input._arrivals.append(float("inf"))  # not silent
    assert heard.says()[1] == Code.OUTDATED


def test_node_that_waits_warns_once_of_all_that_it_lacks(
    node: Node, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its pose is missing at once, its inputs are silent after a while; new ones warn again."""
    lines: list[str] = []
    monkeypatch.setattr(node, "get_logger", lambda: SimpleNamespace(warning=lines.append))
    monkeypatch.setattr(diagnostics, "LOG_PERIOD_S", 0.0)
    pose = Finding("pose", ERROR, "no usable pose on odom yet", code=Code.NO_POSE)
    odom = Finding("odom", ERROR, "no data on odom", code=Code.NO_PUBLISHER)
    image = Finding("left/image_rect", ERROR, "no images", code=Code.NO_DATA)
    found: list[Finding] = []
    reporter = Reporter(node, "robot_a", lambda: found)

    def report(*findings: Finding) -> list[str]:
        found[:], lines[:] = findings, []
        reporter.report()
        return list(lines)

    start = [report(pose), report(pose), report(odom, pose)]
    assert start == [[], [], ["no data on odom; no usable pose on odom yet"]]
    for _ in range(20):
        assert report(odom, pose) == []
    assert report(odom, image, pose) == ["no data on odom; no images; no usable pose on odom yet"]
    assert report(Finding("odom"), image) == []
    blind = Finding("head", ERROR, "the head is blind", code=Code.BLIND)
    assert report(blind, image) == ["the head is blind"]

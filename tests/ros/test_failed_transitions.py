"""A transition that fails leaves a managed node in the state that it reports."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

import pytest
import rclpy
from rclpy.lifecycle import LifecycleState, TransitionCallbackReturn
from rclpy.parameter import Parameter
from std_msgs.msg import String

from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.errors import CameraError
from mrs_ros.managed_node import ManagedNode
from mrs_ros.qos import STREAM

SUCCESS, FAILURE, ERROR = (
    TransitionCallbackReturn.SUCCESS,
    TransitionCallbackReturn.FAILURE,
    TransitionCallbackReturn.ERROR,
)


class Fragile(ManagedNode):
    """Fails where it is told to."""

    def __init__(self) -> None:
        super().__init__("fragile", PlannerConfig)
        self.failures: dict[str, Exception] = {}
        self.stopped = 0
        self.was_active = False  # when it began to start

    def _fail(self, where: str) -> None:
        if where in self.failures:
            raise self.failures[where]

    def set_up(self) -> None:
        self.out = self.offer(String, "out", 1)
        self.offer(String, "other_out", 1)
        self._fail("set_up")

    def start(self) -> None:
        self.was_active = self.is_active
        self.listen(String, "in", lambda message: None, STREAM)
        self.listen(String, "other_in", lambda message: None, STREAM)
        self._fail("start")

    def stop(self) -> None:
        self.stopped += 1
        self._fail("stop")

    @property
    def state(self) -> str:
        return str(self._state_machine.current_state[1])

    def takes_a_structure(self) -> bool:
        """Whether it lets a parameter be set that counts when it is configured."""
        (result,) = self.set_parameters([Parameter("robots", value=["robot_a"])])
        self.set_parameters([Parameter("robots", value=[])])
        return bool(result.successful)


@pytest.fixture
def node(domain: int) -> Iterator[Fragile]:
    rclpy.init(args=["--ros-args", "-r", "__ns:=/test"])
    made = Fragile()
    yield made
    made.destroy_node()
    rclpy.shutdown()


@pytest.mark.parametrize(
    ("error", "result"), [(CameraError("broken"), FAILURE), (ValueError("a bug"), ERROR)]
)
def test_configuration_that_fails_leaves_nothing(
    node: Fragile, error: Exception, result: TransitionCallbackReturn
) -> None:
    node.failures["set_up"] = error
    assert node.trigger_configure() == result
    assert node.state == "unconfigured"
    assert not node.count_publishers("/test/out")
    assert node.takes_a_structure()

    node.failures.clear()
    assert node.trigger_configure() == SUCCESS
    assert not node.takes_a_structure()
    assert node.trigger_activate() == SUCCESS
    assert node.is_active


@pytest.mark.parametrize(
    ("error", "result", "state"),
    [
        (CameraError("broken"), FAILURE, "inactive"),
        (ValueError("a bug"), ERROR, "unconfigured"),
    ],
)
def test_activation_that_fails_is_undone(
    node: Fragile, error: Exception, result: TransitionCallbackReturn, state: str
) -> None:
    assert node.trigger_configure() == SUCCESS
    node.failures["start"] = error
    assert node.trigger_activate() == result
    assert node.state == state
    assert not node.is_active
    assert node.stopped == 1
    assert not node.inputs
    assert not node.count_subscribers("/test/in")
    if state == "inactive":
        assert not node.out.is_activated
    else:
        assert not node.count_publishers("/test/out")
        assert node.takes_a_structure()
        assert node.trigger_configure() == SUCCESS

    node.failures.clear()
    assert node.trigger_activate() == SUCCESS
    assert node.is_active
    assert node.out.is_activated


@pytest.mark.parametrize("error", [CameraError("broken"), ValueError("a bug")])
def test_node_that_cannot_stop_is_torn_down(node: Fragile, error: Exception) -> None:
    """A node that is stopped in part is not active."""
    assert node.trigger_configure() == SUCCESS
    assert node.trigger_activate() == SUCCESS
    node.failures["stop"] = error
    assert node.trigger_deactivate() == ERROR
    assert node.state == "unconfigured"
    assert not node.is_active
    assert not node.inputs
    assert not node.count_publishers("/test/out")


def test_node_is_configured_and_active_only_while_it_is(node: Fragile) -> None:
    """Not while it sets up or starts: a transition that fails there was never made."""
    assert node.trigger_configure() == SUCCESS
    assert not node.takes_a_structure()
    assert node.trigger_activate() == SUCCESS
    assert not node.was_active
    assert node.is_active
    assert node.trigger_deactivate() == SUCCESS
    assert not node.is_active
    assert not node.takes_a_structure()
    assert node.trigger_cleanup() == SUCCESS
    assert node.takes_a_structure()


@pytest.mark.parametrize("topic", ["in", "other_in"])
def test_input_that_cannot_be_ended_leaves_no_other_input(node: Fragile, topic: str) -> None:
    assert node.trigger_configure() == SUCCESS
    assert node.trigger_activate() == SUCCESS
    broken = node.inputs[topic]
    destroy = broken.destroy

    def fail() -> None:
        destroy()
        raise ValueError("a bug")

    broken.destroy = fail  # type: ignore[method-assign]
    assert node.trigger_deactivate() == ERROR
    assert node.state == "unconfigured"
    assert not node.is_active
    assert node.stopped == 1
    assert not node.inputs
    assert not node.count_subscribers("/test/in")
    assert not node.count_subscribers("/test/other_in")
    assert node.trigger_configure() == SUCCESS
    assert node.trigger_activate() == SUCCESS


@pytest.mark.parametrize("kept", ["/test/out", "/test/other_out"])
def test_output_that_cannot_be_ended_leaves_no_other_output(
    node: Fragile, monkeypatch: pytest.MonkeyPatch, kept: str
) -> None:
    destroy = node.destroy_lifecycle_publisher

    def destroy_others(publisher: Any) -> None:
        if publisher.topic_name == kept:
            raise ValueError("a bug")
        destroy(publisher)

    assert node.trigger_configure() == SUCCESS
    monkeypatch.setattr(node, "destroy_lifecycle_publisher", destroy_others)
    assert node.trigger_cleanup() == ERROR
    assert node.count_publishers("/test/out") == (kept == "/test/out")
    assert node.count_publishers("/test/other_out") == (kept == "/test/other_out")
    assert not node.count_publishers("/diagnostics")


def test_error_that_cannot_be_undone_finalizes_the_node(
    node: Fragile, monkeypatch: pytest.MonkeyPatch
) -> None:
    def fail(state: LifecycleState) -> None:
        raise ValueError("a bug")

    assert node.trigger_configure() == SUCCESS
    node.failures["start"] = ValueError("a bug")
    monkeypatch.setattr(node, "destroy_lifecycle_publisher", fail)
    assert node.trigger_activate() == ERROR
    assert node.state == "finalized"
    assert not node.is_active
    monkeypatch.undo()

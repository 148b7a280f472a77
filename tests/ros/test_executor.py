"""The nodes' executor, with and without the one that rclpy calls experimental."""

import sys

import pytest
import rclpy
from std_msgs.msg import String

from mrs_ros.running import make_executor


@pytest.mark.parametrize("has_events", [True, False])
def test_executor_delivers_messages_and_raises_errors(monkeypatch, domain, has_events):
    if not has_events:
        monkeypatch.setitem(sys.modules, "rclpy.experimental", None)
    rclpy.init(args=[], signal_handler_options=rclpy.SignalHandlerOptions.NO)
    try:
        node = rclpy.create_node("waits")
        publisher = node.create_publisher(String, "words", 10)

        def take(message: String) -> None:
            raise ValueError(message.data)

        node.create_subscription(String, "words", take, 10)
        node.create_timer(0.05, lambda: publisher.publish(String(data="heard")))
        executor = make_executor()
        assert (type(executor).__name__ == "EventsExecutor") == has_events
        executor.add_node(node)

        def spin() -> None:
            while True:
                executor.spin_once(timeout_sec=1.0)

        with pytest.raises(ValueError, match="heard"):
            spin()
        node.destroy_node()
    finally:
        rclpy.try_shutdown()

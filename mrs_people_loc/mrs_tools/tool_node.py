"""ROS nodes of the tools, and classes of installed message types."""

from __future__ import annotations

import importlib
import os
import re
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING, Any

from mrs_ros.network import given_domain

if TYPE_CHECKING:
    from rclpy.context import Context
    from rclpy.executors import Executor
    from rclpy.node import Node

NO_NAME = (
    "no ROS 2 name; allowed: / before each part, and parts of letters, digits and _ that do not "
    "begin with a digit"
)
#: Others are looked for until none has come for so long, or at most for so long [s].
_ALONE_S, _LOOK_S = 1.0, 5.0


@contextmanager
def node(name: str, context: Context | None = None, **how: Any) -> Iterator[Node]:
    """A node of a tool: no parameters, no log topic, and signals stay the tool's own business.

    Args:
        name: Node name; the process id is added.
        context: The ROS context to use; None: one of its own, from the environment.
        how: What else `rclpy.create_node` takes, such as a namespace.

    Yields:
        The node.
    """
    import rclpy
    from rclpy.context import Context
    from rclpy.signals import SignalHandlerOptions

    from mrs_ros.network import uninterrupted, use_shipped_profile

    own = context is None
    if context is None:
        given_domain()  # rclpy says only that the domain is invalid
        use_shipped_profile()
        context = Context()
        rclpy.init(args=[], context=context, signal_handler_options=SignalHandlerOptions.NO)
    try:
        with uninterrupted():
            made = rclpy.create_node(
                f"{name}_{os.getpid()}",
                context=context,
                use_global_arguments=False,
                enable_rosout=False,
                start_parameter_services=False,
                **how,
            )
        try:
            yield made
        finally:
            made.destroy_node()
    finally:
        if own:
            rclpy.shutdown(context=context)


@contextmanager
def spinning(made: Node) -> Iterator[Executor]:
    """An executor of a node, whose `spin_once` lets the node work for a moment."""
    from rclpy.executors import SingleThreadedExecutor

    executor = SingleThreadedExecutor(context=made.context)
    executor.add_node(made)
    try:
        yield executor
    finally:
        executor.shutdown()


@contextmanager
def working(made: Node) -> Iterator[None]:
    """Lets a node work in a thread of its own.

    The thread ends before its executor, as rclpy's `shutdown` destroys what would wake a spin that
    is about to wait: it would wait for ever.
    """
    stop = threading.Event()
    with spinning(made) as executor:

        def work() -> None:
            while not stop.is_set():
                executor.spin_once(timeout_sec=0.1)

        thread = threading.Thread(target=work, name="working", daemon=True)
        thread.start()
        try:
            yield
        finally:
            stop.set()
            thread.join()


def message_class(msgtype: str) -> Any:
    """The class of an installed message type, None if it is not installed."""
    package, _, name = msgtype.partition("/msg/")
    if not re.fullmatch("[a-z][a-z0-9_]*", package) or not re.fullmatch("[A-Z][A-Za-z0-9]*", name):
        return None
    try:
        return getattr(importlib.import_module(f"{package}.msg"), name, None)
    except ImportError:
        return None


def wait_for_discovery(node: Node) -> None:
    """Waits until a new node has discovered the other publishers of its domain."""
    end = time.monotonic() + _LOOK_S
    before, changed = -1, time.monotonic()
    while (now := time.monotonic()) < min(end, changed + _ALONE_S):
        names = [name for name, _ in node.get_topic_names_and_types()]
        count = sum(map(node.count_publishers, names))
        if count != before:
            before, changed = count, now
        time.sleep(0.02)

"""How the process of a node is run: from its arguments to its exit code."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable
from typing import Any

import rclpy
import rclpy.logging
import rclpy.utilities
from rclpy.exceptions import ParameterException
from rclpy.lifecycle import TransitionCallbackReturn
from rclpy.signals import SignalHandlerOptions

from mrs_people_loc.errors import ConfigError
from mrs_ros import security
from mrs_ros.ending import end_in_order, end_soon, ignore_signals
from mrs_ros.managed_node import ManagedNode
from mrs_ros.network import given_domain, use_shipped_profile

#: Exit code for bad configuration or arguments.
EXIT_USAGE = 2
#: A node that waits for messages notices within this that it is to end [s].
_NOTICE_S = 0.2


def run(make_node: Callable[[], ManagedNode], usage: str, argv: list[str] | None = None) -> int:
    """Runs a node until a signal, or the process that started it, ends it (`ending`).

    Args:
        make_node: Makes the node.
        usage: What `--help` prints: "usage: NAME ...".
        argv: Arguments of the process; None: those of this process.

    Returns:
        Exit code: 0 after a clean end, 2 if the configuration is wrong, 1 if it cannot start.
    """
    _open_streams()
    argv = sys.argv if argv is None else argv
    if {"-h", "--help"} & set(argv[1:]):
        sys.stdout.write(usage.strip() + "\n")
        return 0
    stop = end_in_order()
    try:
        own_network, secured = _join_network(argv)
    except ConfigError as err:
        sys.stderr.write(f"error: {err}\n")
        return EXIT_USAGE
    node: ManagedNode | None = None
    try:
        node = _make(make_node, argv, secured)
        if own_network:
            node.get_logger().info(own_network)
        if secured == "Permissive":
            node.get_logger().warning(security.UNSURE)
        if not _start(node, stop):
            return 1
        executor = make_executor()
        executor.add_node(node)
        while not stop.is_set():
            executor.spin_once(timeout_sec=_NOTICE_S)
    except ConfigError as err:
        rclpy.logging.get_logger(usage.split()[1]).error(str(err))
        return EXIT_USAGE
    finally:
        end_soon()
        if node is not None:
            node.destroy_node()
        rclpy.utilities.try_shutdown()
        ignore_signals()
    return 0


def _open_streams() -> None:
    """Opens closed standard streams, to nowhere.

    What the process opens first would take their places: a socket would get what is logged. rclpy's
    executor asks for `sys.stderr`.
    """
    for name in ("stdin", "stdout", "stderr"):
        if getattr(sys, name) is None:  # each takes the lowest number that is free: its own
            setattr(sys, name, open(os.devnull, "r+"))  # noqa: SIM115


def _join_network(argv: list[str]) -> tuple[str, str]:
    """Initializes rclpy.

    Returns:
        Why the shipped network profile is not used, and how much security is asked for
        (`security.asked`); each may be empty.

    Raises:
        ConfigError: The environment or an argument is wrong.
    """
    secured = security.asked(os.environ)
    given_domain()  # rclpy reports only that the domain is invalid
    try:
        own_network = use_shipped_profile()
        rclpy.init(args=argv, signal_handler_options=SignalHandlerOptions.NO)
    except Exception as err:  # rclpy raises different classes for different bad arguments
        if secured == "Enforce":
            raise security.refusal(err, os.environ) from err
        raise ConfigError(str(err)) from err
    return own_network, secured


def _make(make_node: Callable[[], ManagedNode], argv: list[str], secured: str) -> ManagedNode:
    """The node.

    Raises:
        ConfigError: A parameter or an argument is wrong, or there is no security and should be.
    """
    extra = rclpy.utilities.remove_ros_args(argv)[1:]
    if extra:
        raise ConfigError(f"unknown argument {extra[0]}; parameters go after --ros-args")
    try:
        return make_node()
    except ParameterException as err:  # of those that every node has, such as use_sim_time
        raise ConfigError(str(err)) from err
    except RuntimeError as err:  # rclpy's RCLError is one
        if not secured:
            raise
        raise security.refusal(err, os.environ) from err


def _start(node: ManagedNode, stop: threading.Event) -> bool:
    """Configures and activates a node that starts by itself; False if that fails."""
    if not node.autostart:
        own = node.get_fully_qualified_name()
        node.get_logger().info(
            f"{own}: unconfigured, for autostart is false; waits for "
            f"`ros2 lifecycle set {own} configure`, then `... activate`"
        )
        return True
    return all(
        stop.is_set() or transition() == TransitionCallbackReturn.SUCCESS
        for transition in (node.trigger_configure, node.trigger_activate)
    )


def make_executor() -> Any:
    """The executor of a node: rclpy's experimental one of events, or its usual one without that.

    The usual one builds a wait set of all that a node has, in Python, before each message: most of
    what a pose cost.
    """
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return rclpy.get_global_executor()
    return EventsExecutor()

"""A lifecycle node that configures and activates itself, and the way our nodes are run."""

from __future__ import annotations

import os
import sys
import traceback
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import rclpy
import rclpy.logging
import rclpy.utilities
from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from rclpy.exceptions import ParameterException
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile
from rclpy.signals import SignalHandlerOptions

from mrs_people_loc.clocks import RESET_NS
from mrs_people_loc.config import Parameter, Section
from mrs_people_loc.errors import ConfigError, OutdatedError, PeopleLocError
from mrs_people_loc.health.findings import Code
from mrs_people_loc.messages import stamp_ns_of
from mrs_ros import security
from mrs_ros.diagnostics import OK, STALE, Finding, Input, ProcessUse, Reporter
from mrs_ros.ending import end_in_order, ignore_signals
from mrs_ros.network import given_domain, use_shipped_profile
from mrs_ros.parameters import NodeConfig, declare, given_parameters

AUTOSTART = Parameter("autostart", "bool", True, "configure and activate at the start", live=False)
#: Exit code for bad configuration or arguments.
EXIT_USAGE = 2
#: So long a node that waits for messages takes to notice that it is to end, at most [s].
_NOTICE_S = 0.2


class ManagedNode(LifecycleNode):
    """Base of our nodes: parameters, inputs, diagnostics and life cycle.

    A node hands in its configuration class and says what to do in `set_up` (make publishers),
    `start` (listen) and `stop`; inputs made with `listen` and outputs made with
    `offer` are ended for it.

    Args:
        name: The node's name.
        config_type: Its configuration class.

    Raises:
        ConfigError: A parameter is wrong.
    """

    def __init__(self, name: str, config_type: type[Section]) -> None:
        super().__init__(name)
        self.autostart = bool(AUTOSTART.check(given_parameters(self).get("autostart", True)))
        declare(self, AUTOSTART, self.autostart, read_only=True)
        self.inputs: dict[str, Input] = {}
        self._outputs: list[Any] = []
        self._reporter: Reporter | None = None
        self._use = ProcessUse()
        self._configured = self._active = False
        self._ended_ns = 0  # where /clock was when it jumped back
        self._node_config = NodeConfig(
            self, config_type, may_restructure=lambda: not self._configured, changed=self.changed
        )
        back = JumpThreshold(
            min_forward=None, min_backward=Duration(nanoseconds=-RESET_NS), on_clock_change=False
        )
        self._jumps = self.get_clock().create_jump_callback(back, post_callback=self._on_jump)
        self._rclpy_change_state = self._service_change_state.callback
        self._service_change_state.callback = self._change_state

    # ---- for the node to fill in ----

    def set_up(self) -> None:
        """Makes what the node needs while it is configured."""

    def start(self) -> None:
        """Begins to work."""

    def stop(self) -> None:
        """Ends the work."""

    def jumped_back(self) -> None:
        """Begins anew: the time, as a bag gives it, was set back by more than a second."""

    def changed(self, config: Any) -> None:
        """Takes a configuration that was changed while the node exists.

        Raises:
            ConfigError: It does not fit; the change is refused.
        """

    def findings(self) -> list[Finding]:
        """What is to be said on `/diagnostics` besides the inputs."""
        return []

    def waits_for(self) -> str:
        """What it needs to be of use, in words: said when it has started."""
        return ", ".join(made.subscription.topic_name for made in self.inputs.values())

    # ---- for the node to use ----

    @property
    def config(self) -> Any:
        """The node's configuration as it is now."""
        return self._node_config.value

    @property
    def is_active(self) -> bool:
        """Whether it works now."""
        return self._active

    @property
    def name_in_team(self) -> str:
        """The node's namespace without the leading slash: the robot's name."""
        return str(self.get_namespace()).strip("/")

    def listen(
        self,
        message_type: type,
        topic: str,
        callback: Callable[[Any], None],
        qos: QoSProfile,
        *,
        once: bool = False,
    ) -> Input:
        """Subscribes to a topic until the node stops (see `Input`)."""

        def take(message: Any) -> None:
            if not once:
                self._check_is_of_now(message)
            callback(message)

        made = Input(self, message_type, topic, take, qos, once=once)
        self.inputs[topic] = made
        return made

    def end(self, heard: Input) -> None:
        """Ends a subscription before the node stops."""
        del self.inputs[heard.topic]
        heard.destroy()

    def offer(self, message_type: type, topic: str, qos: QoSProfile | int) -> Any:
        """Makes a publisher that works while the node is active."""
        publisher = self.create_lifecycle_publisher(message_type, topic, qos)
        self._outputs.append(publisher)
        return publisher

    # ---- life cycle ----

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Sets up; what was made until it failed is torn down again."""
        steps = [self._configure, lambda: super(ManagedNode, self).on_configure(state)]
        return self._transition("configure", steps, undo=[self._clean_up])

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Starts; what was started until it failed is stopped again."""
        # Publishers first: what `start` triggers may publish at once.
        steps = [lambda: super(ManagedNode, self).on_activate(state), self._begin]
        undo = [self._halt, lambda: super(ManagedNode, self).on_deactivate(state)]
        return self._transition("activate", steps, undo=undo)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stops."""
        steps = [self._halt, lambda: super(ManagedNode, self).on_deactivate(state)]
        return self._transition("deactivate", steps)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Tears down."""
        steps = [self._clean_up, lambda: super(ManagedNode, self).on_cleanup(state)]
        return self._transition("clean up", steps)

    def on_shutdown(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Stops and tears down."""
        steps = [self._clean_up, lambda: super(ManagedNode, self).on_shutdown(state)]
        return self._transition("shut down", steps)

    def on_error(self, state: LifecycleState) -> TransitionCallbackReturn:
        """Goes back to unconfigured; finalized, if even that fails."""
        return self._transition("tear down", [self._clean_up])

    def _configure(self) -> None:
        self._reporter = Reporter(self, self.name_in_team or self.get_name(), self._findings)
        self.set_up()
        self._configured = True

    def _begin(self) -> None:
        self._active = True
        self.start()
        waits = "/clock" if self._lacks_clock else self.waits_for()
        self.get_logger().info(
            f"{self.get_fully_qualified_name()}: active" + (f"; waits for {waits}" if waits else "")
        )

    def _halt(self) -> None:
        if not self._active:
            return
        self._active = False
        for made in self.inputs.values():
            made.destroy()
        self.inputs.clear()
        self.stop()

    def _clean_up(self) -> None:
        self._configured = False
        try:
            self._halt()
        finally:
            if self._reporter is not None:
                self._reporter.destroy()
                self._reporter = None
            for publisher in self._outputs:
                self.destroy_lifecycle_publisher(publisher)
            self._outputs.clear()

    def _transition(
        self,
        name: str,
        steps: list[Callable[[], TransitionCallbackReturn | None]],
        undo: list[Callable[[], TransitionCallbackReturn | None]] | None = None,
    ) -> TransitionCallbackReturn:
        """Takes the steps; if one fails, the state before, with `undo`, or else `on_error`."""
        # rclpy swallows what transitions raise, so it is said here.
        try:
            try:
                failed = _first_failure(steps)
            except PeopleLocError as err:
                self.get_logger().error(f"cannot {name}: {err}")
                failed = TransitionCallbackReturn.FAILURE
            if failed is None:
                return TransitionCallbackReturn.SUCCESS
            if undo is None or _first_failure(undo) is not None:
                return TransitionCallbackReturn.ERROR
        except Exception:
            self.get_logger().error(f"cannot {name}:\n{traceback.format_exc()}")
            return TransitionCallbackReturn.ERROR
        return failed

    def _change_state(self, request: Any, response: Any) -> Any:
        """Answers who asks for a transition.

        rclpy looks whether it is possible now only where it is asked for by its label; one that
        is asked for by its id alone, as Nav2's lifecycle manager does, would end the process.
        """
        asked = request.transition
        machine = self._state_machine
        possible = {number: label for number, label, *_ in machine.available_transitions}
        if not asked.label and asked.id not in possible:
            state = machine.current_state[1]
            allowed = ", ".join(f"{number} ({label})" for number, label in possible.items())
            self.get_logger().warning(
                f"transition {asked.id} is asked for in the state {state}; "
                f"allowed: {allowed or 'none'}"
            )
            response.success = False
            return response
        return self._rclpy_change_state(request, response)

    def _on_jump(self, jump: Any) -> None:
        self._ended_ns = self._now_ns() - jump.delta.nanoseconds
        if self._active:
            self.get_logger().warning("the time jumped back; starting anew")
            self.jumped_back()

    def _check_is_of_now(self, message: Any) -> None:
        """Refuses what was under way when /clock jumped back: it would be of the future now.

        Raises:
            OutdatedError: It is.
        """
        if self._ended_ns:
            stamp_ns, now_ns = stamp_ns_of(message.header.stamp), self._now_ns()
            if now_ns >= self._ended_ns:
                self._ended_ns = 0
            elif now_ns < stamp_ns - RESET_NS <= self._ended_ns:
                raise OutdatedError(f"stamp is {stamp_ns} ns, of before the time jumped back")

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    @property
    def _lacks_clock(self) -> bool:
        """Whether it takes its time from /clock, and nobody has told it yet."""
        return bool(self.get_parameter("use_sim_time").value) and not self._now_ns()

    def _findings(self) -> list[Finding]:
        if not self._active:
            text = "inactive: hears and sends nothing until activated"
            return [Finding("state", STALE, text, code=Code.INACTIVE)]
        inputs = [made.finding() for made in self.inputs.values()]
        state = Finding("state", OK, "active", self._use.values())
        found = [state, *inputs, *self.findings()]
        if not self._lacks_clock:
            return found
        # Without a time nothing is early or late.
        return [
            replace(one, level=STALE, message="waits for /clock", code=Code.NO_CLOCK)
            if one.code in (Code.STAMPS_OFF, Code.CLOCK_ASTRAY)
            else one
            for one in found
        ]


def _first_failure(
    steps: list[Callable[[], TransitionCallbackReturn | None]],
) -> TransitionCallbackReturn | None:
    """Takes steps until one fails, and returns how; None: none did."""
    for step in steps:
        result = step()
        if result not in (None, TransitionCallbackReturn.SUCCESS):
            return result
    return None


def _executor() -> Any:
    """What waits for messages.

    rclpy's usual executor builds a wait set of all that a node has, in Python, before each message:
    most of what a pose cost. The one of events does not; where this rclpy has none, the usual one.
    """
    try:
        from rclpy.experimental import EventsExecutor
    except ImportError:
        return rclpy.get_global_executor()
    return EventsExecutor()


def run(make_node: Callable[[], ManagedNode], usage: str, argv: list[str] | None = None) -> int:
    """Runs a node until Ctrl-C, SIGTERM or SIGHUP, or the end of who started it (`ending`).

    Args:
        make_node: Makes the node.
        usage: What `--help` prints: "usage: NAME ...".
        argv: Arguments of the process; None: those of this process.

    Returns:
        Exit code: 0 after a clean end, 2 if the configuration is wrong, 1 if it cannot start.
    """
    argv = sys.argv if argv is None else argv
    if {"-h", "--help"} & set(argv[1:]):
        sys.stdout.write(usage.strip() + "\n")
        return 0
    stop = end_in_order()
    try:
        given_domain()  # rclpy says only that the domain is invalid
        own_network = use_shipped_profile()
        secured = security.asked(os.environ)
        rclpy.init(args=argv, signal_handler_options=SignalHandlerOptions.NO)
    except ConfigError as err:
        sys.stderr.write(f"error: {err}\n")
        return EXIT_USAGE
    except Exception as err:  # rclpy raises different classes for different bad arguments
        why = security.refusal(err, os.environ) if secured == "Enforce" else err
        sys.stderr.write(f"error: {why}\n")
        return EXIT_USAGE
    name = usage.split()[1]
    node: ManagedNode | None = None
    try:
        extra = rclpy.utilities.remove_ros_args(argv)[1:]
        if extra:
            raise ConfigError(f"unknown argument {extra[0]}; parameters go after --ros-args")
        try:
            node = make_node()
        except ParameterException as err:  # of those that every node has, such as use_sim_time
            raise ConfigError(str(err)) from err
        except RuntimeError as err:  # rclpy's RCLError is one
            if not secured:
                raise
            raise security.refusal(err, os.environ) from err
        if own_network:
            node.get_logger().info(own_network)
        if secured == "Permissive":
            node.get_logger().warning(security.UNSURE)
        if node.autostart:
            for transition in (node.trigger_configure, node.trigger_activate):
                if not stop.is_set() and transition() != TransitionCallbackReturn.SUCCESS:
                    return 1
        else:
            own = node.get_fully_qualified_name()
            node.get_logger().info(
                f"{own}: unconfigured, for autostart is false; waits for "
                f"`ros2 lifecycle set {own} configure`, then `... activate`"
            )
        executor = _executor()
        executor.add_node(node)
        while not stop.is_set():
            executor.spin_once(timeout_sec=_NOTICE_S)
    except ConfigError as err:
        rclpy.logging.get_logger(name).error(str(err))
        return EXIT_USAGE
    finally:
        if node is not None:
            node.destroy_node()
        rclpy.utilities.try_shutdown()
        ignore_signals()
    return 0

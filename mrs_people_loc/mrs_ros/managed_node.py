"""The base of our nodes: a lifecycle node with checked parameters, inputs and diagnostics."""

from __future__ import annotations

import traceback
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from typing import Any

from rclpy.clock import JumpThreshold
from rclpy.duration import Duration
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn
from rclpy.qos import QoSProfile

from mrs_people_loc.clocks import RESET_NS
from mrs_people_loc.config import Parameter, Section
from mrs_people_loc.errors import OutdatedError, PeopleLocError
from mrs_people_loc.health.findings import Finding, of_state, without_clock
from mrs_people_loc.messages import stamp_ns_of
from mrs_ros.diagnostics import Input, ProcessUse, Reporter
from mrs_ros.network import uninterrupted
from mrs_ros.parameters import NodeConfig, declare, given_parameters

AUTOSTART = Parameter("autostart", "bool", True, "configure and activate at the start", live=False)


class ManagedNode(LifecycleNode):
    """Base of our nodes: parameters, inputs, diagnostics and life cycle.

    A node passes its configuration class and overrides `set_up` (make publishers), `start`
    (subscribe) and `stop`; inputs made with `listen` and outputs made with `offer` are destroyed
    for it.

    Args:
        name: The node's name.
        config_type: Its configuration class.

    Raises:
        ConfigError: A parameter is wrong.
    """

    def __init__(self, name: str, config_type: type[Section]) -> None:
        with uninterrupted():
            super().__init__(name)
        self.autostart = bool(AUTOSTART.check(given_parameters(self).get("autostart", True)))
        declare(self, AUTOSTART, self.autostart, read_only=True)
        self.inputs: dict[str, Input] = {}
        self._use = ProcessUse()
        # Set after the work that they stand for; the stacks undo that work, also where it failed
        # halfway.
        self._configured = self._active = False
        self._made = ExitStack()
        self._begun = ExitStack()
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
        """Forgets the past: the time on `/clock` was set back by more than a second."""

    def changed(self, config: Any) -> None:
        """Takes a configuration that was changed while the node exists.

        Raises:
            ConfigError: It does not fit; the change is refused.
        """

    def observe(self) -> None:
        """Updates what `findings` reports; called once a second while the node is active."""

    def findings(self) -> list[Finding]:
        """What is published on `/diagnostics` in addition to the inputs; has no side effects."""
        return []

    def waits_for(self) -> str:
        """What the node needs to be of use, for the log line at its start."""
        needed = (made for made in self.inputs.values() if not made.any_number)
        return ", ".join(made.subscription.topic_name for made in needed)

    # ---- for the node to use ----

    @property
    def config(self) -> Any:
        """The node's configuration as it is now."""
        return self._node_config.value

    @property
    def is_configured(self) -> bool:
        """Whether it is set up."""
        return self._configured

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
        **how: Any,
    ) -> Input:
        """Subscribes to a topic until the node stops (see `Input`)."""

        def take(message: Any) -> None:
            if not once:
                self._check_is_of_now(message)
            callback(message)

        made = Input(self, message_type, topic, take, qos, once=once, **how)
        self.inputs[topic] = made
        return made

    def end(self, source: Input) -> None:
        """Ends a subscription before the node stops."""
        del self.inputs[source.topic]
        source.destroy()

    def offer(self, message_type: type, topic: str, qos: QoSProfile | int) -> Any:
        """Makes a publisher that works while the node is active."""
        publisher = self.create_lifecycle_publisher(message_type, topic, qos)
        if self._active:
            publisher.on_activate(None)  # the others were with the node
        self.until_cleanup(lambda: self.destroy_lifecycle_publisher(publisher))
        return publisher

    def serve(self, service_type: type, name: str, callback: Callable[[Any, Any], Any]) -> None:
        """Answers a service while the node is configured."""
        service = self.create_service(service_type, name, callback)
        self.until_cleanup(lambda: self.destroy_service(service))

    def keep(self, lists: Mapping[str, Sequence[Any]]) -> None:
        """Sets parameters for the next start (see `NodeConfig.keep`)."""
        self._node_config.keep(lists)

    def until_cleanup(self, end: Callable[[], object]) -> None:
        """Has something that `set_up` made ended when the node is cleaned up."""
        self._made.callback(end)

    # ---- life cycle ----

    def destroy_node(self) -> None:
        """Destroys the node, with its services and the topic of its transitions.

        These belong to the state machine. rclpy leaves it to the garbage collector, and with it the
        DDS participant, which others go on to see.
        """
        super().destroy_node()
        self._state_machine.destroy_when_not_in_use()

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
        reporter = Reporter(self, self.name_in_team or self.get_name(), self._report)
        self._made.callback(reporter.destroy)
        self.set_up()
        self._configured = True

    def _begin(self) -> None:
        self._begun.callback(self.stop)
        self._begun.callback(self._end_inputs)
        self.start()
        self._active = True
        waits = "/clock" if self._lacks_clock else self.waits_for()
        self.get_logger().info(
            f"{self.get_fully_qualified_name()}: active" + (f"; waits for {waits}" if waits else "")
        )

    def _halt(self) -> None:
        """Ends what `_begin` began; all of it, also where some of that fails."""
        self._active = False
        self._begun.close()

    def _clean_up(self) -> None:
        """Ends what `_begin` and `_configure` made; all of it, also where some of that fails."""
        self._configured = False
        with ExitStack() as steps:
            steps.callback(self._made.close)
            steps.callback(self._halt)

    def _end_inputs(self) -> None:
        inputs, self.inputs = self.inputs, {}
        with ExitStack() as steps:
            for made in inputs.values():
                steps.callback(made.destroy)

    def _transition(
        self,
        name: str,
        steps: list[Callable[[], TransitionCallbackReturn | None]],
        undo: list[Callable[[], TransitionCallbackReturn | None]] | None = None,
    ) -> TransitionCallbackReturn:
        """Takes the steps; if one fails, goes back with `undo`, or by `on_error` without it."""
        # rclpy swallows what transitions raise, so it is logged here.
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
        """Answers a request for a transition.

        rclpy checks whether it is possible now only where it is requested by its label; one that
        is requested by its id alone, as Nav2's lifecycle manager does, would end the process.
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
            self.get_logger().warning("the time jumped back; starting over")
            self.jumped_back()

    def _check_is_of_now(self, message: Any) -> None:
        """Refuses a message that was on its way when `/clock` jumped back: it is of the future now.

        Raises:
            OutdatedError: It is.
        """
        if self._ended_ns and hasattr(message, "header"):
            stamp_ns, now_ns = stamp_ns_of(message.header.stamp), self._now_ns()
            if now_ns >= self._ended_ns:
                self._ended_ns = 0
            elif now_ns < stamp_ns - RESET_NS <= self._ended_ns:
                raise OutdatedError(f"stamp is {stamp_ns} ns, of before the time jumped back")

    def _now_ns(self) -> int:
        return int(self.get_clock().now().nanoseconds)

    @property
    def _lacks_clock(self) -> bool:
        """Whether it takes its time from `/clock`, and none has arrived yet."""
        return bool(self.get_parameter("use_sim_time").value) and not self._now_ns()

    def _report(self) -> list[Finding]:
        """What is published on `/diagnostics`, once a second."""
        if not self._active:
            return [of_state(active=False, values={})]
        self._use.update()
        self.observe()
        inputs = [made.finding() for made in self.inputs.values()]
        found = [of_state(active=True, values=self._use.values()), *inputs, *self.findings()]
        return without_clock(found) if self._lacks_clock else found


def _first_failure(
    steps: list[Callable[[], TransitionCallbackReturn | None]],
) -> TransitionCallbackReturn | None:
    """Takes steps until one fails, and returns how; None: none did."""
    for step in steps:
        result = step()
        if result not in (None, TransitionCallbackReturn.SUCCESS):
            return result
    return None

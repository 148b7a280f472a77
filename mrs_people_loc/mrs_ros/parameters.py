"""Configuration as ROS parameters: declared from the definitions in `mrs_people_loc.config`."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from typing import Any

from rcl_interfaces.msg import (
    FloatingPointRange,
    IntegerRange,
    ParameterDescriptor,
    SetParametersResult,
)
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from mrs_people_loc.config import NODE_PARAMETERS, Parameter, Section
from mrs_people_loc.errors import ConfigError

_TYPES = {
    "bool": RosParameter.Type.BOOL,
    "int": RosParameter.Type.INTEGER,
    "float": RosParameter.Type.DOUBLE,
    "str": RosParameter.Type.STRING,
    "floats": RosParameter.Type.DOUBLE_ARRAY,
    "strs": RosParameter.Type.STRING_ARRAY,
}


def given_parameters(node: Node) -> dict[str, Any]:
    """What the command line and parameter files set for this node, known to it or not.

    rclpy's public way to see them, `automatically_declare_parameters_from_overrides`, fails on an
    empty list, which has no type; here it is an empty tuple.
    """
    overrides: dict[str, RosParameter] = node._parameter_overrides
    return {name: () if p.value is None else p.value for name, p in overrides.items()}


def declare(node: Node, definition: Parameter, value: Any, *, read_only: bool = False) -> None:
    """Declares a parameter with its description and range; its value was checked already."""
    name, plain = definition.name, list(value) if isinstance(value, tuple) else value
    descriptor = _descriptor(definition)
    descriptor.read_only = read_only
    node.declare_parameter(name, plain, descriptor, ignore_override=True)
    if plain == []:  # which rclpy declares as a list of bytes
        node.set_parameters([RosParameter(name, _TYPES[definition.kind], [])])


class NodeConfig:
    """A node's configuration, kept in step with its ROS parameters.

    Args:
        node: The node.
        config_type: Its configuration class, such as `RobotConfig`.
        may_restructure: Whether a parameter that is not live may be changed now.
        changed: Called with the new configuration after each change.

    Raises:
        ConfigError: A parameter is unknown, of the wrong type or out of its range.
    """

    def __init__(
        self,
        node: Node,
        config_type: type[Section],
        *,
        may_restructure: Callable[[], bool],
        changed: Callable[[Any], None],
    ) -> None:
        self._node = node
        self._definitions = {p.name: p for p in config_type.parameters()}
        self._may_restructure = may_restructure
        self._changed = changed
        self._kept: Collection[str] = ()  # the parameters that are kept for the next start just now
        ours = {
            name: value
            for name, value in given_parameters(node).items()
            if name not in NODE_PARAMETERS and not name.startswith("qos_overrides.")
        }
        self.value: Any = config_type.from_mapping(ours)
        for definition in self._definitions.values():
            declare(node, definition, _lookup(self.value, definition.name))
        node.add_pre_set_parameters_callback(self._typed)
        node.add_on_set_parameters_callback(self._on_set)

    def keep(self, lists: Mapping[str, Sequence[Any]]) -> None:
        """Sets lists for the next start, also those that are not live in a configured node.

        Raises:
            ConfigError: One is not allowed; none is set.
        """
        self._kept = lists
        try:
            result = self._node.set_parameters_atomically(
                [
                    RosParameter(name, _TYPES[self._definitions[name].kind], list(value))
                    for name, value in lists.items()
                ]
            )
        finally:
            self._kept = ()
        if not result.successful:
            raise ConfigError(result.reason)

    def _typed(self, changes: list[RosParameter]) -> list[RosParameter]:
        """Gives `1` for a number, `1.0` for a whole one and empty lists the type declared."""
        typed = []
        for change in changes:
            kind = getattr(self._definitions.get(change.name), "kind", "")
            given, value = change.type_, change.value
            if kind == "float" and given is RosParameter.Type.INTEGER:
                value = float(value)
            elif kind == "int" and given is RosParameter.Type.DOUBLE and value.is_integer():
                value = int(value)
            elif kind == "floats" and given is RosParameter.Type.INTEGER_ARRAY:
                value = [float(item) for item in value]
            elif not (kind in ("floats", "strs") and given.name.endswith("ARRAY") and not value):
                typed.append(change)
                continue
            typed.append(RosParameter(change.name, _TYPES[kind], value))
        return typed

    def _on_set(self, changes: list[RosParameter]) -> SetParametersResult:
        # To delete a parameter is to set it to None, which none of ours allows.
        ours = {p.name: p.value for p in changes if p.name in self._definitions}
        if not ours:
            return SetParametersResult(successful=True)
        try:
            value = type(self.value).from_mapping(ours, base=self.value)
            for name in ours:
                same = _lookup(value, name) == _lookup(self.value, name)
                may = self._definitions[name].live or name in self._kept
                if not same and not may and not self._may_restructure():
                    raise ConfigError(
                        f"{name} is set while the node runs; "
                        "allowed: in the lifecycle state unconfigured (deactivate, clean up first)"
                    )
            self._changed(value)
        except ConfigError as err:
            return SetParametersResult(successful=False, reason=str(err))
        self.value = value
        return SetParametersResult(successful=True)


def _lookup(config: Section, name: str) -> Any:
    value: Any = config
    for part in name.split("."):
        value = getattr(value, part)
    return value


def _descriptor(definition: Parameter) -> ParameterDescriptor:
    # Typing is dynamic so that `1` is taken for `1.0`; our own check refuses everything else
    # and names what is allowed. The range is for tools to show.
    text = definition.doc if definition.live else f"{definition.doc} (taken when configured)"
    descriptor = ParameterDescriptor(
        name=definition.name,
        type=_TYPES[definition.kind].value,
        description=text,
        additional_constraints=definition.allowed(),
        dynamic_typing=True,
    )
    if definition.low is not None and definition.high is not None:
        if definition.kind == "int":
            whole = IntegerRange(from_value=int(definition.low), to_value=int(definition.high))
            descriptor.integer_range = [whole]
        elif definition.kind == "float":
            real = FloatingPointRange(from_value=definition.low, to_value=definition.high)
            descriptor.floating_point_range = [real]
    return descriptor

"""Parameters: frozen dataclasses whose fields carry meaning, unit and allowed range."""

from __future__ import annotations

import dataclasses
import difflib
import math
import re
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import dataclass
from typing import Any, TypeVar

from mrs_people_loc.errors import ConfigError

Value = Any  # bool | int | float | str | tuple[float, ...] | tuple[str, ...]

_SectionT = TypeVar("_SectionT", bound="Section")

_TYPE_NAMES = {
    "bool": "true or false",
    "int": "a whole number",
    "float": "a number",
    "str": "a text",
    "floats": "a list of numbers",
    "strs": "a list of texts",
}


@dataclass(frozen=True)
class Parameter:
    """Definition of one configuration field, by its dotted name.

    Attributes:
        name: Dotted name, such as `zones.low`.
        kind: One of bool, int, float, str, floats, strs.
        default: Default value.
        doc: What it means, with its unit.
        low: Smallest allowed value, inclusive; None without limit.
        high: Largest allowed value, inclusive; None without limit.
        choices: The allowed texts; empty for any.
        odd: Whether the number must be odd.
        length: Exact length of a list; None for any.
        live: Whether a running node takes a change.
    """

    name: str
    kind: str
    default: Value
    doc: str
    low: float | None = None
    high: float | None = None
    choices: tuple[str, ...] = ()
    odd: bool = False
    length: int | None = None
    live: bool = True

    def allowed(self) -> str:
        """Says in words which values are allowed."""
        if self.choices:
            return "one of " + ", ".join(self.choices)
        text = "an odd whole number" if self.odd else _TYPE_NAMES[self.kind]
        if self.length is not None:
            text += f" of length {self.length}"
        if self.low is not None and self.high is not None:
            text += f" from {self.low:g} to {self.high:g}"
        elif self.low is not None:
            text += f" of at least {self.low:g}"
        return text

    def check(self, value: object) -> Value:
        """Returns `value` in this field's type.

        Raises:
            ConfigError: Naming the field, the value and what is allowed.
        """
        checked = _CONVERTERS[self.kind](self, value)
        if checked is None:
            raise ConfigError(f"{self.name} is {value!r}; allowed: {self.allowed()}")
        return checked


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number that no float holds
        return False


def _is_text(value: object) -> bool:
    return isinstance(value, str) and value != ""


def _within(limits: Parameter, value: float) -> Value | None:
    below = limits.low is not None and value < limits.low
    return None if below or (limits.high is not None and value > limits.high) else value


def _as_text(limits: Parameter, value: Any) -> Value | None:
    ok = isinstance(value, str) and (not limits.choices or value in limits.choices)
    return value if ok else None


def _as_int(limits: Parameter, value: Any) -> Value | None:
    if not _is_number(value) or value != int(value) or (limits.odd and value % 2 == 0):
        return None
    return _within(limits, int(value))


def _as_float(limits: Parameter, value: Any) -> Value | None:
    return _within(limits, float(value)) if _is_number(value) else None


def _as_items(limits: Parameter, value: Any, is_one: Callable[[object], bool]) -> Value | None:
    if isinstance(value, (str, bytes)) or not hasattr(value, "__iter__"):
        return None
    items = tuple(value)
    fits = limits.length is None or len(items) in (0, limits.length)
    return items if fits and all(map(is_one, items)) else None


def _as_floats(limits: Parameter, value: Any) -> Value | None:
    items = _as_items(limits, value, _is_number)
    return items and tuple(map(float, items))


#: By kind: a value in this type; None: it is not allowed.
_CONVERTERS: dict[str, Callable[[Parameter, Any], Value | None]] = {
    "bool": lambda _, value: value if isinstance(value, bool) else None,
    "int": _as_int,
    "float": _as_float,
    "str": _as_text,
    "floats": _as_floats,
    "strs": lambda limits, value: _as_items(limits, value, _is_text),
}


def field(default: Value, doc: str, **limits: Any) -> Any:
    """A dataclass field with its definition (see `Parameter`) as metadata."""
    kind = limits.pop("kind", "strs") if isinstance(default, tuple) else type(default).__name__
    return dataclasses.field(default=default, metadata={"kind": kind, "doc": doc, **limits})


class Section:
    """A frozen dataclass of parameters and of further sections, validated when it is built."""

    def __post_init__(self) -> None:
        """Checks each value and the relations between them."""
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            if field.metadata:
                parameter = Parameter(field.name, default=field.default, **field.metadata)
                try:
                    checked = parameter.check(getattr(self, field.name))
                except ConfigError as err:
                    raise ConfigError(f"{type(self).__name__}: {err}") from None
                object.__setattr__(self, field.name, checked)
        self._check_relations()

    def _check_relations(self) -> None:
        """Raises ConfigError where values that are each allowed do not fit together."""

    @classmethod
    def parameters(cls, prefix: str = "") -> Iterator[Parameter]:
        """Yields the definition of every field, sections flattened to dotted names."""
        for field in dataclasses.fields(cls):  # type: ignore[arg-type]
            if field.metadata:
                yield Parameter(prefix + field.name, default=field.default, **field.metadata)
            else:
                section: Any = field.default_factory
                yield from section.parameters(f"{prefix}{field.name}.")

    @classmethod
    def from_mapping(
        cls: type[_SectionT], values: Mapping[str, Any], base: _SectionT | None = None
    ) -> _SectionT:
        """Builds the configuration from nested or dotted names; what is not named stays.

        Args:
            values: `{"zones": {"low": 0.2}}` or `{"zones.low": 0.2}`.
            base: What stays where nothing is named; the defaults if None.

        Raises:
            ConfigError: A name is unknown (the nearest one is suggested) or a value not allowed.
        """
        known = {parameter.name: parameter for parameter in cls.parameters()}
        flat = flatten(values)
        for name in flat:
            if name not in known:
                raise ConfigError(f"unknown parameter {name}; {suggestion(name, known)}")
        checked = {name: known[name].check(value) for name, value in flat.items()}
        return (base or cls())._replace(checked)

    def _replace(self: _SectionT, flat: Mapping[str, Value]) -> _SectionT:
        own = {name: value for name, value in flat.items() if "." not in name}
        inner: dict[str, dict[str, Value]] = {}
        for name, value in flat.items():
            if "." in name:
                section, rest = name.split(".", 1)
                inner.setdefault(section, {})[rest] = value
        own.update({name: getattr(self, name)._replace(part) for name, part in inner.items()})
        return dataclasses.replace(self, **own)  # type: ignore[type-var]

    def to_mapping(self) -> dict[str, Any]:
        """Returns nested plain values, as a YAML parameter file holds them."""
        result: dict[str, Any] = {}
        for field in dataclasses.fields(self):  # type: ignore[arg-type]
            value = getattr(self, field.name)
            if isinstance(value, Section):
                value = value.to_mapping()
            result[field.name] = list(value) if isinstance(value, tuple) else value
        return result


def check_robots(parameter: str, names: tuple[str, ...]) -> None:
    """Checks that a parameter names robots, each once.

    Raises:
        ConfigError: It does not.
    """
    for name in names:
        if not re.fullmatch(r"[A-Za-z_]\w*(/[A-Za-z_]\w*)*", name):
            raise ConfigError(
                f"{parameter} has {name!r}; allowed: ROS namespaces without a leading slash"
            )
    if len(set(names)) < len(names):
        name = next(name for name in names if names.count(name) > 1)
        raise ConfigError(f"{parameter} names {name} more than once; allowed: each robot once")


def suggestion(name: str, known: Collection[str]) -> str:
    """The nearest of the known names, in words; all of them if none is near."""
    near = difflib.get_close_matches(name, known, 1, 0.5)
    return f"did you mean {near[0]}?" if near else f"known: {', '.join(known)}"


def flatten(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Flattens nested mappings to one of dotted names."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat.update(flatten(value, f"{prefix}{name}."))
        else:
            flat[f"{prefix}{name}"] = value
    return flat

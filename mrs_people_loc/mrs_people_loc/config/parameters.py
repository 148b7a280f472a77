"""Parameters: frozen dataclasses whose fields carry meaning, unit and allowed range."""

from __future__ import annotations

import dataclasses
import difflib
import math
import re
from collections.abc import Iterator, Mapping
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
        checked = self._convert(value)
        if checked is None:
            raise ConfigError(f"{self.name} is {value!r}; allowed: {self.allowed()}")
        return checked

    def _convert(self, value: object) -> Value | None:
        if self.kind == "bool":
            return value if isinstance(value, bool) else None
        if self.kind == "str":
            ok = isinstance(value, str) and (not self.choices or value in self.choices)
            return value if ok else None
        if self.kind in ("floats", "strs"):
            if isinstance(value, (str, bytes)) or not hasattr(value, "__iter__"):
                return None
            items = tuple(value)
            if self.length is not None and len(items) not in (0, self.length):
                return None
            if self.kind == "strs":
                return items if all(isinstance(item, str) and item for item in items) else None
            return tuple(float(i) for i in items) if all(map(_is_number, items)) else None
        if not _is_number(value):
            return None
        assert isinstance(value, (int, float))
        if self.kind == "int":
            if value != int(value) or (self.odd and value % 2 == 0):
                return None
            value = int(value)
        else:
            value = float(value)
        if self.low is not None and value < self.low:
            return None
        if self.high is not None and value > self.high:
            return None
        return value


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        return False
    try:
        return math.isfinite(value)
    except OverflowError:  # a whole number that no float holds
        return False


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
                near = difflib.get_close_matches(name, known, 1, 0.5)
                hint = f"; did you mean {near[0]}?" if near else f"; known: {', '.join(known)}"
                raise ConfigError(f"unknown parameter {name}{hint}")
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


def flatten(values: Mapping[str, Any], prefix: str = "") -> dict[str, Any]:
    """Flattens nested mappings to one of dotted names."""
    flat: dict[str, Any] = {}
    for name, value in values.items():
        if isinstance(value, Mapping):
            flat.update(flatten(value, f"{prefix}{name}."))
        else:
            flat[f"{prefix}{name}"] = value
    return flat

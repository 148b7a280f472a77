"""Structs of arrays: many things of one kind, one array for each property; array types."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Any, TypeVar

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Float32 = NDArray[np.float32]
Int = NDArray[np.intp]
Bool = NDArray[np.bool_]

_Self = TypeVar("_Self", bound="StructOfArrays")


class StructOfArrays:
    """Base of dataclasses whose fields are arrays, or structs of arrays, of one length.

    Raises:
        ValueError: A field has another length than the first one.
    """

    def __post_init__(self) -> None:
        """Checks the lengths."""
        (first, *others), values = _names(type(self)), vars(self)
        size = len(values[first])
        for name in others:
            if len(values[name]) != size:
                raise ValueError(
                    f"{type(self).__name__}.{name} has length {len(values[name])}; wanted: {size}, "
                    f"as {first}"
                )

    def __len__(self) -> int:
        """How many they are."""
        return len(vars(self)[_names(type(self))[0]])

    def select(self: _Self, index: Int | Bool | slice) -> _Self:
        """Some of them.

        Args:
            index: Indices, shape (m,), or a mask, shape (n,), or a slice.
        """
        values, kind = vars(self), type(self)
        return _made(kind, {name: _select(values[name], index) for name in _names(kind)})

    @classmethod
    def joined(cls: type[_Self], parts: Sequence[_Self]) -> _Self:
        """All of several, in their order.

        Args:
            parts: One at least.
        """
        if len(parts) == 1:
            return parts[0]
        columns = {name: [vars(part)[name] for part in parts] for name in _names(cls)}
        return _made(cls, {name: _concatenate(values) for name, values in columns.items()})


_FIELDS: dict[type, tuple[str, ...]] = {}


def _names(kind: Any) -> tuple[str, ...]:
    """Names of the fields; `dataclasses.fields` takes longer than most selections."""
    if kind not in _FIELDS:
        _FIELDS[kind] = tuple(field.name for field in dataclasses.fields(kind))
    return _FIELDS[kind]


def _made(kind: type[_Self], values: dict[str, Any]) -> _Self:
    """One of fields that need no check, as parts of checked ones do not: half the time."""
    made = object.__new__(kind)
    vars(made).update(values)
    return made


def _select(value: Any, index: Int | Bool | slice) -> Any:
    return value.select(index) if isinstance(value, StructOfArrays) else value[index]


def _concatenate(values: Sequence[Any]) -> Any:
    if isinstance(values[0], StructOfArrays):
        return type(values[0]).joined(values)
    return np.concatenate(values)

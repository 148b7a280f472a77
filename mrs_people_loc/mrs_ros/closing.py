"""What is closed at the end of a `with` block."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import TypeVar

_Self = TypeVar("_Self", bound="Closing")


class Closing(ABC):
    """A context manager that is closed at the end of its block, however that ends."""

    @abstractmethod
    def close(self) -> object:
        """Release what is held."""

    def __enter__(self: _Self) -> _Self:
        """Return this object."""
        return self

    def __exit__(self, kind: object, *_: object) -> None:
        """Close it."""
        self.close()

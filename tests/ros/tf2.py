"""TF's packages for the tests: those that are installed, or what can be had without them.

`tf2_msgs` is built (`interfaces`). `tf2_ros` has a part in C++ whose sources are not at hand; in
its place there is `stand_in/tf2_ros`, for the tests only.
"""

from __future__ import annotations

import contextlib
import importlib.util
from collections.abc import Iterator
from pathlib import Path

import pytest

from ros.interfaces import add, interfaces

STAND_IN = Path(__file__).with_name("stand_in")


@contextlib.contextmanager
def tf2(factory: pytest.TempPathFactory) -> Iterator[None]:
    """Both packages can be imported, here and in processes that are started, while it lasts."""
    with interfaces(factory, "tf2_msgs"), pytest.MonkeyPatch.context() as patch:
        if importlib.util.find_spec("tf2_ros") is None:
            add(patch, "PYTHONPATH", STAND_IN)
        yield

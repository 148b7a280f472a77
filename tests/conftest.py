"""What every test needs. No ROS here: the core's tests also run where there is none."""

import os
import signal
import sys
from collections.abc import Callable, Iterator
from unittest import mock

import pytest
from hypothesis import settings

# A pip install sets nothing, and the ament index is not found without it.
os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)
# A shell lets what it starts in the background ignore Ctrl-C, and all that is started by that:
# `ros2 launch` would not end when it is asked to.
if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
    signal.signal(signal.SIGINT, signal.default_int_handler)
# nohup ignores a closed terminal, likewise. Under a handler it still ends no test run, and what is
# started has the default again.
if signal.getsignal(signal.SIGHUP) is signal.SIG_IGN:
    signal.signal(signal.SIGHUP, lambda *_: None)
# The same examples in every run: a failure is that of the change, and can be repeated.
settings.register_profile("repeatable", deadline=None, derandomize=True, database=None)
settings.load_profile("repeatable")


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Runs what is marked `soak` only where the markers on the command line ask for it.

    Files with slow tests come first, so that no worker is left alone with one at the end.
    """
    if "soak" not in config.option.markexpr:
        left_out = [item for item in items if item.get_closest_marker("soak")]
        items[:] = [item for item in items if item not in left_out]
        config.hook.pytest_deselected(items=left_out)
    slow = {item.path for item in items if item.get_closest_marker("slow")}
    items.sort(key=lambda item: item.path not in slow)


@pytest.fixture(scope="module", autouse=True)
def _environment() -> Iterator[None]:
    """What a module, or a call of `use_shipped_profile`, leaves there is not for the next one."""
    with mock.patch.dict(os.environ):
        yield


@pytest.fixture(scope="session")
def show(pytestconfig: pytest.Config) -> Callable[[str], None]:
    """Prints what was measured, also where pytest keeps the output."""
    capture = pytestconfig.pluginmanager.getplugin("capturemanager")

    def write(text: str) -> None:
        with capture.global_and_fixture_disabled():
            # The standard output of pytest-xdist's workers goes nowhere.
            print(f"\n{text}", file=sys.stderr, flush=True)

    return write

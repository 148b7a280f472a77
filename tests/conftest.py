"""What every test needs. No ROS here: the core's tests also run where there is none."""

import os
import signal
import sys
from collections.abc import Callable

import pytest

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


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Runs what is marked `soak` only where the markers on the command line ask for it."""
    if "soak" not in config.option.markexpr:
        left_out = [item for item in items if item.get_closest_marker("soak")]
        items[:] = [item for item in items if item not in left_out]
        config.hook.pytest_deselected(items=left_out)


@pytest.fixture(scope="session")
def show(pytestconfig: pytest.Config) -> Callable[[str], None]:
    """Prints what was measured, also where pytest keeps the output."""
    capture = pytestconfig.pluginmanager.getplugin("capturemanager")

    def write(text: str) -> None:
        with capture.global_and_fixture_disabled():
            print(f"\n{text}", flush=True)

    return write

"""A DDS domain for each test module, and processes and a peer on it."""

from __future__ import annotations

import importlib
import importlib.util
import warnings
from collections.abc import Iterator

import pytest

if importlib.util.find_spec("rclpy") is None:
    collect_ignore_glob = ["test_*.py"]  # the core's tests also run where there is no ROS
else:
    with warnings.catch_warnings():
        # rclpy imports this with the first message; the parser behind it uses deprecated modules.
        warnings.simplefilter("ignore", DeprecationWarning)
        importlib.import_module("rosidl_generator_py")
    from mrs_ros.network import use_shipped_profile
    from ros.harness import ROOT, Peer, Team, own_domain, ros2_command
    from ros.recording import Recording, read_recording


@pytest.fixture(scope="session")
def recording() -> Recording:
    """The formation of the paper: three robots, five people."""
    return read_recording(ROOT / "bags" / "paper_formation")


@pytest.fixture(scope="module")
def domain(tmp_path_factory: pytest.TempPathFactory) -> Iterator[int]:
    """A domain of this module's own; what it starts gets it by the environment."""
    with own_domain() as number, pytest.MonkeyPatch.context() as patch:
        patch.setenv("ROS_DOMAIN_ID", str(number))
        patch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
        patch.setenv("ROS_LOG_DIR", str(tmp_path_factory.mktemp("ros_log")))
        patch.setenv("RCUTILS_COLORIZED_OUTPUT", "0")
        patch.setenv("PYTHONUNBUFFERED", "1")
        patch.setenv("PYTHONFAULTHANDLER", "1")
        for name in (
            "ROS_DISCOVERY_SERVER",
            "ROS_LOCALHOST_ONLY",
            "ROS_STATIC_PEERS",
            "FASTDDS_BUILTIN_TRANSPORTS",
            "FASTRTPS_DEFAULT_PROFILES_FILE",
            "FASTDDS_DEFAULT_PROFILES_FILE",
            "RCUTILS_CONSOLE_OUTPUT_FORMAT",
            "RCUTILS_LOGGING_USE_STDOUT",
        ):
            patch.delenv(name, raising=False)
        # Fast DDS reads profiles once in a process: all of this one has the shipped profile.
        use_shipped_profile()
        yield number


@pytest.fixture(scope="module")
def team(domain: int, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Team]:
    """Starts processes, which must end cleanly with the module."""
    made = Team(tmp_path_factory.mktemp("nodes"))
    try:
        yield made
    finally:
        made.end()


@pytest.fixture(scope="module")
def peer(domain: int) -> Iterator[Peer]:
    """A node on the module's domain."""
    made = Peer(domain)
    try:
        yield made
    finally:
        made.close()


@pytest.fixture(scope="module")
def ros2(domain: int) -> str:
    """The real `ros2` command, on the module's domain."""
    return ros2_command()

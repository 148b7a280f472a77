"""Hosts, where this machine can make them; in CI it must."""

from __future__ import annotations

import importlib
import importlib.util
import os
import warnings
from collections.abc import Iterator
from pathlib import Path

import pytest

from network import hosts

if importlib.util.find_spec("rclpy") is None:
    collect_ignore_glob = ["test_*.py"]
else:
    with warnings.catch_warnings():
        # As in tests/ros/conftest.py: rclpy's parser uses deprecated modules.
        warnings.simplefilter("ignore", DeprecationWarning)
        importlib.import_module("rosidl_generator_py")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Every test in this folder is a network test."""
    for item in items:
        if Path(__file__).parent in item.path.parents:
            item.add_marker(pytest.mark.network)


@pytest.fixture(scope="session", autouse=True)
def _needs_hosts() -> None:
    reason = hosts.problem()
    if reason and os.environ.get("CI"):
        pytest.fail(f"in CI network tests must run: {reason}")
    if reason:
        pytest.skip(reason)


@pytest.fixture(scope="module", autouse=True)
def _plain_ros() -> Iterator[None]:
    """Nothing of what the user's shell says about ROS. Domain 0: the hosts are for themselves."""
    with pytest.MonkeyPatch.context() as patch:
        for name in list(os.environ):
            if name.startswith(("ROS_", "RMW_", "RCUTILS_", "FASTDDS_", "FASTRTPS_")):
                patch.delenv(name)
        yield

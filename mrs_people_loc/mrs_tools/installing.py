"""What is installed: files of the project, and how to get a module that is not, in words.

Ubuntu's and Debian's Python takes nothing from pip (PEP 668). There it is apt, or, for what apt
does not have, a virtual environment that sees the system's packages, ROS among them.
"""

from __future__ import annotations

import sys
import sysconfig
from pathlib import Path

from mrs_people_loc.errors import ConfigError
from mrs_ros.shipped import PACKAGES, shipped_file

#: The extra of this project that brings a module that may be missing.
_EXTRAS = {
    **dict.fromkeys(["typer", "rosbags", "lz4", "backports", "rich"], "[tools]"),
    **dict.fromkeys(["matplotlib", "PIL"], "[plots]"),
    "pypcd4": "[convert]",
    "aiohttp": "[view]",
    "embreex": "[sim]",
    **dict.fromkeys(["rclpy", "std_msgs", "sensor_msgs", "geometry_msgs", "nav_msgs"], "[ros]"),
    **dict.fromkeys(["diagnostic_msgs", "stereo_msgs", "visualization_msgs"], "[ros]"),
    **dict.fromkeys(["builtin_interfaces", "lifecycle_msgs", "rosgraph_msgs"], "[ros]"),
}
#: Ubuntu's packages; what is not among them is on PyPI alone.
_UBUNTU = {
    "typer": "python3-typer",
    "rich": "python3-rich",
    "matplotlib": "python3-matplotlib",
    "PIL": "python3-pil",
    "aiohttp": "python3-aiohttp",
}


def default_file(folder: str, *parts: str) -> Path:
    """A file that comes with the project, of its source tree or installed into `share/`.

    Args:
        folder: `config` or `bags`.
        parts: The path below it.

    Raises:
        ConfigError: It is nowhere.
    """
    if (path := shipped_file(folder, *parts)) is not None:
        return path
    raise ConfigError(
        f"{Path(folder, *parts)} is not installed: it belongs to {PACKAGES[folder]}; run `make "
        "setup`, or build the workspace again (colcon build) and source it"
    )


def how_to_install(module: str) -> str | None:
    """What to do about a module that is missing; None: it is none that this project needs."""
    if module == "mrs_people_msgs":
        return "run `make setup`, or source the workspace that has it"
    if module == "mrs_people_sim":
        return "install the folder simulation/ of the repository, or build it with colcon"
    if module == "mrs_studies":
        return "it is in the repository, where `make setup` makes an `mrs` that has it"
    if module not in _EXTRAS:
        return None
    extra = _EXTRAS[module]
    source = "source your ROS 2 installation, or " if extra == "[ros]" else ""
    if not _pip_is_refused():
        return f"{source}pip install 'mrs-people-loc{extra}'"
    if extra == "[ros]":
        return f"{source}run `make setup`"
    if module in _UBUNTU:
        return f"sudo apt install {_UBUNTU[module]}"
    return (
        "python3 -m venv --system-site-packages ~/mrs && ~/mrs/bin/pip install "
        f"{module}, then `~/mrs/bin/python -m mrs_tools` in place of `mrs`"
    )


def _pip_is_refused() -> bool:
    """Whether this is a system's Python that only the system's packages go into."""
    marker = Path(sysconfig.get_path("stdlib"), "EXTERNALLY-MANAGED")
    return sys.prefix == sys.base_prefix and marker.exists()

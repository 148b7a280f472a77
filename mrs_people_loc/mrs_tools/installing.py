"""How to get a module that is not installed, in words.

Ubuntu's and Debian's Python takes nothing from pip (PEP 668). There it is apt, or, for what apt
does not have, a virtual environment that sees the system's packages, ROS among them.
"""

from __future__ import annotations

import sys
import sysconfig
from pathlib import Path

#: The extra of this project that brings a module that may be missing.
_EXTRAS = {
    **dict.fromkeys(["typer", "rosbags", "lz4", "backports", "rich"], "[tools]"),
    **dict.fromkeys(["matplotlib", "PIL"], "[plots]"),
    "pypcd4": "[convert]",
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
}


def how_to_install(module: str) -> str | None:
    """What to do about a module that is missing; None: it is none that this project needs."""
    if module == "mrs_people_msgs":
        return "run `make setup`, or source the workspace that has it"
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
        f"python3 -m venv --system-site-packages ~/mrs && ~/mrs/bin/pip install {module}, then "
        "`~/mrs/bin/python -m mrs_tools` in place of `mrs`"
    )


def _pip_is_refused() -> bool:
    """Whether this is a system's Python that only the system's packages go into."""
    marker = Path(sysconfig.get_path("stdlib"), "EXTERNALLY-MANAGED")
    return sys.prefix == sys.base_prefix and marker.exists()

"""The network as the environment sets it: the ROS domain, and the Fast DDS profiles.

`config/fastdds/team.xml`, or `localhost.xml` where ROS 2 is limited to this machine; both receive
images, and everything else, by UDP and not by shared memory: docs/network.md has the reason.
"""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from mrs_people_loc.errors import ConfigError
from mrs_ros.shipped import shipped_file

#: Where Fast DDS looks for its profiles: the version of ROS 2 Jazzy, and Fast DDS 3.
PROFILES_FILE = "FASTRTPS_DEFAULT_PROFILES_FILE"
PROFILES_FILES = (PROFILES_FILE, "FASTDDS_DEFAULT_PROFILES_FILE")
#: Its transports; UDP and shared memory by default.
TRANSPORTS = "FASTDDS_BUILTIN_TRANSPORTS"
#: How far ROS 2 looks for others.
RANGE = "ROS_AUTOMATIC_DISCOVERY_RANGE"
#: Above this, DDS's UDP ports would go beyond 65535.
LARGEST_DOMAIN = 232

#: Who may not run first rests so long, after which the scheduler interrupts them less [s].
_REST_S = 0.03

#: What `use_shipped_profile` put into the environment: by name what, and what was there before.
_added: dict[str, tuple[str, str | None]] = {}


def given_domain() -> int | None:
    """The ROS_DOMAIN_ID of the environment; None: it names none, which is domain 0.

    Raises:
        ConfigError: It is no domain.
    """
    text = os.environ.get("ROS_DOMAIN_ID", "")
    if not text:
        return None
    if not (text.isascii() and text.isdecimal() and int(text) <= LARGEST_DOMAIN):
        raise ConfigError(
            f"ROS_DOMAIN_ID is {text!r}; allowed: a whole number from 0 to {LARGEST_DOMAIN} "
            "(on Linux up to 101), or unset it"
        )
    return int(text)


def node_of(endpoint: Any) -> str:
    """Full name of the node of a publisher or a subscription (rclpy's TopicEndpointInfo)."""
    return f"{endpoint.node_namespace.rstrip('/')}/{endpoint.node_name}"


def use_shipped_profile() -> str:
    """Points Fast DDS to the shipped profile, unless the user has a profile or transports.

    Before the first ROS context is made. Other middlewares are left alone.

    Returns:
        Why it is not used, a sentence; empty if it is.
    """
    from rclpy.utilities import get_rmw_implementation_identifier

    os.environ.setdefault("AMENT_PREFIX_PATH", sys.prefix)  # a pip install sets nothing
    if "fastrtps" not in get_rmw_implementation_identifier():
        return ""
    folder = shipped_file("config", "fastdds")
    if folder is None:
        return "fastdds/ of mrs_people_config is not installed: install it again (make setup)"
    before = environment()
    added, why_not = _settings(before, folder)
    _added.update({name: (value, before.get(name)) for name, value in added.items()})
    os.environ.update(added)
    return why_not


@contextmanager
def uninterrupted() -> Iterator[None]:
    """For the first node of a process: nobody else takes the processor from this thread.

    Fast DDS announces a participant before it listens. Whoever answers in between, on this machine
    within a millisecond, is not heard, and met only when they announce themselves again: after up
    to 3 s. So the thread runs with real-time priority where the user may have it.
    """
    policy = os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK
    if policy != os.SCHED_OTHER or os.getpriority(os.PRIO_PROCESS, 0) < 0:  # somebody's choice
        yield
        return
    try:
        # Threads that start meanwhile are as others are, and nobody may take that back.
        os.sched_setscheduler(0, os.SCHED_RR | os.SCHED_RESET_ON_FORK, os.sched_param(1))
    except PermissionError:
        time.sleep(_REST_S)
    try:
        yield
    finally:
        os.sched_setscheduler(0, os.SCHED_OTHER | os.SCHED_RESET_ON_FORK, os.sched_param(0))


def environment() -> dict[str, str]:
    """The environment of this process as the user set it, for processes to be started.

    Without what `use_shipped_profile` added: they ask for it themselves.
    """
    whole = dict(os.environ)
    for name, (added, before) in _added.items():
        if whole.get(name) == added:
            del whole[name]
            if before is not None:
                whole[name] = before
    return whole


def _settings(environ: Mapping[str, str], folder: Path) -> tuple[dict[str, str], str]:
    """The variables to set; or none, and the reason."""
    ours = {str(folder / name) for name in ("team.xml", "localhost.xml")}
    own = [name for name in PROFILES_FILES if environ.get(name) not in (None, *ours)]
    if environ.get(TRANSPORTS) not in (None, "", "UDPv4"):
        own.append(TRANSPORTS)
    if own:
        given = " ".join(f"{name}={environ[name]}" for name in own)
        return {}, f"{given} goes before our Fast DDS profile: docs/network.md, Shared memory"
    if environ.get(RANGE) == "LOCALHOST" and not environ.get("ROS_STATIC_PEERS"):
        # For this range rmw_fastrtps adds transports of its own, among them shared memory, to those
        # of a profile. localhost.xml does the rest of what it does.
        profile = {PROFILES_FILE: str(folder / "localhost.xml"), RANGE: "SYSTEM_DEFAULT"}
    else:
        profile = {PROFILES_FILE: environ.get(PROFILES_FILE, str(folder / "team.xml"))}
    return {TRANSPORTS: "UDPv4", **profile}, ""

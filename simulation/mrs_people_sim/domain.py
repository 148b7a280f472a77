"""ROS domains: the one that the environment names, and one that nobody else uses."""

from __future__ import annotations

import contextlib
import fcntl
import os
import socket
import tempfile
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from mrs_people_loc.errors import ConfigError, PeopleLocError
from mrs_ros.network import given_domain, node_of

if TYPE_CHECKING:
    from rclpy.node import Node

#: Domains of our own. Above them, ports are among those that Linux gives to anybody (32768 on).
_OWN = range(1, 102)
#: A domain has 250 ports, enough for so many participants. Each process counts its own, of all
#: domains: the only one in a domain may have any number.
_PARTICIPANTS = 120


@contextlib.contextmanager
def own_domain() -> Iterator[int]:
    """A ROS_DOMAIN_ID that nobody on this machine uses, while the context lasts.

    Ours agree by lock files, which end with their process; a domain of others is seen by the UDP
    ports of its participants.

    Raises:
        ConfigError: All are in use, or the folder of the lock files belongs to somebody else.
    """
    folder = Path(tempfile.gettempdir()) / f"mrs_people_loc-domains-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, exist_ok=True)
        (folder / "mine").touch()
    except OSError as err:  # somebody else made it
        raise ConfigError(
            f"{folder}: cannot be used ({err.strerror or err}), which keeps two from the same ROS "
            "domain; remove it, or set ROS_DOMAIN_ID, or TMPDIR to another folder"
        ) from err
    for step in range(len(_OWN)):
        domain = _OWN[(os.getpid() + step) % len(_OWN)]
        with (folder / str(domain)).open("w") as lock:
            try:
                fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except OSError:
                continue
            if not _in_use(domain):
                yield domain
                return
    raise ConfigError(f"all ROS domains from 1 to {_OWN[-1]} are in use on this machine")


@contextlib.contextmanager
def private_domain() -> Iterator[str]:
    """The environment's domain, or if it names none, one of our own in the environment meanwhile.

    Yields:
        Which, in words.

    Raises:
        ConfigError: As `given_domain`.
    """
    # A recorded team must not speak to robots on the network, nor hear them.
    reach = os.environ.setdefault("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    given = given_domain()
    if given is not None:
        yield f"in ROS domain {given}, as ROS_DOMAIN_ID says"
        return
    with own_domain() as domain:
        os.environ["ROS_DOMAIN_ID"] = str(domain)
        try:
            yield (
                f"in ROS domain {domain}, which nobody else uses; to look into it:\n  "
                f"ROS_DOMAIN_ID={domain} ROS_AUTOMATIC_DISCOVERY_RANGE={reach} mrs people"
            )
        finally:
            del os.environ["ROS_DOMAIN_ID"]


def refuse_other_publishers(node: Node, own: Mapping[str, str]) -> None:
    """Makes sure that no other node publishes on these topics.

    Args:
        node: The node that looks.
        own: By topic, the node of ours that publishes it, by its full name; empty: none does yet.

    Raises:
        PeopleLocError: Somebody else does.
    """
    for topic, ours in own.items():
        publishers = node.get_publishers_info_by_topic(topic)
        names = Counter(map(node_of, publishers))
        if len(publishers) > bool(ours):
            raise other_publishers_error({topic: sorted((names - Counter([ours])).elements())})


def other_publishers_error(found: Mapping[str, Sequence[str]]) -> PeopleLocError:
    """The error that others publish our topics: by topic, the names of their nodes."""
    others = "; ".join(
        f"{topic} has {len(names)} other publisher{'s' if len(names) > 1 else ''}: "
        f"{', '.join(names)}"
        for topic, names in found.items()
    )
    return PeopleLocError(
        f"somebody else is at work in this ROS domain: {others}. End the others, or unset "
        "ROS_DOMAIN_ID, and a domain that nobody uses is taken"
    )


def _in_use(domain: int) -> bool:
    for participant in range(_PARTICIPANTS):
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
            try:  # DDSI-RTPS 9.6.1: unicast, of discovery
                probe.bind(("", 7400 + 250 * domain + 10 + 2 * participant))
            except OSError:
                return True
    return False

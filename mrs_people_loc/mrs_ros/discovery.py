"""How the nodes of a team find each other without multicast: docs/network.md.

Used by `mrs up` and the launch files, which need no command line library.
"""

from __future__ import annotations

import os
import socket

from mrs_people_loc.errors import ConfigError

#: Default port of Fast DDS's discovery server.
DISCOVERY_PORT = 11811


def discovery_environment(server: str = "", peers: str = "") -> dict[str, str]:
    """What to add to the environment of a node so that it finds its team without multicast.

    Args:
        server: HOST or HOST:PORT of a Fast DDS discovery server; empty: none.
        peers: Hosts to look for nodes on, with commas between them; empty: none.

    Raises:
        ConfigError: A value is wrong, both are given, or a host has no IPv4 address.
    """
    if server and peers:
        raise ConfigError(
            f"discovery server {server} and peers {peers}; wanted: one of them, or neither"
        )
    if server:
        host, port = _host_and_port(server)
        _check_host(host)
        # A super client knows the whole graph: the planner looks for robots in it, and the nodes'
        # diagnostics for publishers.
        return {"ROS_DISCOVERY_SERVER": f"{host}:{port}", "ROS_SUPER_CLIENT": "TRUE"}
    if peers:
        hosts = [host.strip() for host in peers.split(",")]
        for host in hosts:
            _check_host(host)
        if os.environ.get("ROS_AUTOMATIC_DISCOVERY_RANGE", "SUBNET") not in ("SUBNET", "LOCALHOST"):
            raise ConfigError(
                "peers count only with ROS_AUTOMATIC_DISCOVERY_RANGE=SUBNET or LOCALHOST; it is "
                f"{os.environ['ROS_AUTOMATIC_DISCOVERY_RANGE']}"
            )
        return {"ROS_STATIC_PEERS": ";".join(hosts)}
    return {}


def _host_and_port(server: str) -> tuple[str, int]:
    host, colon, port = server.partition(":")
    if not colon:
        return host, DISCOVERY_PORT
    if not port.isdecimal() or not 1025 <= int(port) <= 65535:
        raise ConfigError(
            f"discovery server {server}: the port is {port!r}; wanted: HOST or HOST:PORT, "
            "PORT from 1025 to 65535"
        )
    return host, int(port)


def _check_host(host: str) -> None:
    """Fast DDS would silently look nowhere."""
    try:
        # Not "", which would be this host, nor "1", which would be 0.0.0.1.
        if not host or host.isdecimal():
            raise ConfigError(f"host {host!r}; wanted: a name or an IPv4 address")
        socket.getaddrinfo(host, None, socket.AF_INET)
    except (OSError, UnicodeError) as err:
        raise ConfigError(f"host {host!r} has no IPv4 address: {err}") from err

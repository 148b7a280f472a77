"""With ROS_AUTOMATIC_DISCOVERY_RANGE=LOCALHOST our nodes stay on their machine.

Our nodes take another range for it, and a profile (docs/network.md, Shared memory).
"""

from __future__ import annotations

import os
import signal
import sys
import time

import pytest

from network.hosts import Hosts


def sent(hosts: Hosts, host: str) -> int:
    """UDP datagrams that a host has sent on the wire so far, not those to itself."""
    rules = hosts.run(host, "iptables", "-t", "raw", "-vnxL", "OUTPUT")
    return sum(int(line.split()[0]) for line in rules.splitlines() if "eth0" in line)


@pytest.mark.parametrize(("range_", "speaks"), [("LOCALHOST", False), ("SUBNET", True)])
def test_range_localhost_keeps_a_node_off_the_network(range_: str, speaks: bool) -> None:
    with Hosts("one", "two") as hosts:
        hosts.run("one", *["iptables", "-t", "raw", "-A", "OUTPUT", "-o", "eth0", "-p", "udp"])
        node = hosts.popen(
            "one",
            [sys.executable, "-m", "robot_node", "--ros-args", "-r", "__ns:=/robot_a"],
            env={"ROS_AUTOMATIC_DISCOVERY_RANGE": range_},
        )
        # It is there once it reads its port: DDSI-RTPS 9.6.1, domain 0, participant 0.
        end = time.monotonic() + 40.0
        while ":1CF2 " not in hosts.run("one", "cat", "/proc/net/udp"):
            assert time.monotonic() < end, "the node opens no port"
            time.sleep(0.2)
        time.sleep(3.0)  # it announces itself once a second
        assert (sent(hosts, "one") > 0) == speaks
        os.kill(node.pid, signal.SIGINT)
        assert node.wait(20) == 0

"""The simulated hosts: which datagrams arrive where."""

from __future__ import annotations

import socket
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from network.hosts import Hosts

GROUP = "239.255.0.1"
#: Prints what arrives as it comes, until it is told to stop.
LISTEN = f"""
import socket, struct
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
s.setsockopt(socket.SOL_SOCKET, 33, 1 << 26)  # SO_RCVBUFFORCE: nothing is lost at this end
s.bind(("", 5000))
s.setsockopt(
    socket.IPPROTO_IP, socket.IP_ADD_MEMBERSHIP,
    socket.inet_aton("{GROUP}") + socket.inet_aton("OWN"),
)
print("ready", flush=True)
while (data := s.recv(65536)) != b"end":
    print(len(data), flush=True)
"""
SEND = """
import socket, sys, time
s = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
size, count = map(int, sys.argv[2:])
for _ in range(count):
    s.sendto(b"x" * size, (sys.argv[1], 5000))
    time.sleep(0.0005)  # what is on its way waits in queues, and they are not endless
"""


@pytest.fixture
def hosts() -> Iterator[Hosts]:
    with Hosts("a", "b", "c") as made:
        yield made


def received(
    hosts: Hosts, sender: str, receiver: str, *, to: str = "", size: int = 10, count: int = 1
) -> int:
    """How many datagrams of so many arrive."""
    own = hosts.addresses[receiver]
    listener = hosts.popen(
        receiver,
        [sys.executable, "-c", LISTEN.replace("OWN", own)],
        stdout=subprocess.PIPE,
        text=True,
    )
    assert listener.stdout is not None
    assert listener.stdout.readline() == "ready\n"
    hosts.run(sender, sys.executable, "-c", SEND, to or own, str(size), str(count))
    # From the host itself nothing is lost, and it comes behind all others.
    end = f"import socket; socket.socket(2, 2).sendto(b'end', ('{own}', 5000))"
    hosts.run(receiver, sys.executable, "-c", end)
    return len(listener.communicate(timeout=30)[0].splitlines())


def test_hosts_reach_each_other_on_a_network_of_their_own(hosts: Hosts) -> None:
    assert received(hosts, "a", "b") == 1
    assert received(hosts, "a", "c", to=GROUP) == 1
    assert not any(name.startswith("port") for _, name in socket.if_nameindex())


def test_link_that_is_down_passes_nothing_until_it_is_up(hosts: Hosts) -> None:
    hosts.link("b", up=False)
    assert received(hosts, "a", "b") == 0
    assert received(hosts, "a", "c") == 1
    hosts.link("b", up=True)
    end = time.monotonic() + 20.0
    while not received(hosts, "a", "b"):  # a may still be asking who has that address
        assert time.monotonic() < end
    assert received(hosts, "b", "a", to=GROUP) == 1


@pytest.mark.parametrize("host", ["a", "b"])
def test_loss_is_per_fragment_and_unnoticed_by_the_sender(hosts: Hosts, host: str) -> None:
    hosts.loss(host, 0.2)
    share = received(hosts, "a", "b", count=400) / 400
    assert share == pytest.approx(0.8, abs=0.1)  # five standard deviations
    share = received(hosts, "a", "b", size=7000, count=400) / 400
    assert share == pytest.approx(0.8**5, abs=0.12)
    hosts.loss(host, 0.0)
    assert received(hosts, "a", "b", count=100) == 100


def test_partitioned_hosts_do_not_reach_each_other(hosts: Hosts) -> None:
    hosts.partition("a", "b")
    assert received(hosts, "a", "b") == 1
    assert received(hosts, "a", "c") == received(hosts, "c", "b") == 0
    hosts.partition()
    assert received(hosts, "a", "c") == received(hosts, "c", "b") == 1


def test_multicast_can_be_blocked(hosts: Hosts) -> None:
    hosts.no_multicast()
    assert received(hosts, "a", "b", to=GROUP) == 0
    assert received(hosts, "a", "b") == 1


def test_no_namespace_is_left_behind(hosts: Hosts) -> None:
    sleeper = hosts.popen("a", ["sh", "-c", "trap '' TERM; sleep 1000 & sleep 1000"])
    names = [*hosts._namespaces.values(), hosts._switch]
    assert all((Path("/run/netns") / name).exists() for name in names)
    hosts.close()
    assert sleeper.poll() is not None
    assert not any((Path("/run/netns") / name).exists() for name in names)

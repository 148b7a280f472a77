"""Hosts on one machine: Linux network namespaces on a switch, with cables to pull.

Each host has the loopback, one interface `eth0` and shared memory of its own; the switch is a
bridge in a namespace of its own. So nothing of this machine's network is touched, and what happens
on the hosts is heard by nobody else.
"""

from __future__ import annotations

import itertools
import os
import shutil
import signal
import subprocess
import time
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any

#: Processes that are asked to end get this long [s].
_GRACE_S = 15.0
_PREFIX = "mrs-test-"
_numbers = itertools.count()


def problem() -> str | None:
    """Why this machine cannot make hosts; None if it can."""
    if os.geteuid() != 0:
        return "network namespaces need root"
    for command, package in (
        ("ip", "iproute2"),
        ("iptables-restore", "iptables"),
        ("nsenter", "util-linux"),
    ):
        if shutil.which(command) is None:
            return f"no {command} here: apt-get install {package}"
    name = f"{_PREFIX}{os.getpid()}-probe"
    made = subprocess.run(["ip", "netns", "add", name], capture_output=True, text=True, check=False)
    if made.returncode:
        return f"no network namespaces here: {made.stderr.strip()}"
    _run("ip", "netns", "del", name)
    return None


def _run(*command: str, **how: Any) -> subprocess.CompletedProcess[str]:
    done = subprocess.run(command, capture_output=True, text=True, check=False, **how)
    if done.returncode:
        raise RuntimeError(f"{' '.join(command)} ended with {done.returncode}: {done.stderr}")
    return done


class Hosts:
    """Hosts on one switch; use it as a context manager, which removes all of it.

    A packet is lost where it arrives, fragment by fragment: its sender does not notice.

    Args:
        names: Of the hosts, in the order of their addresses 10.77.0.1, 10.77.0.2, ...
    """

    def __init__(self, *names: str) -> None:
        base = f"{_PREFIX}{os.getpid()}-{next(_numbers)}-"
        self.addresses = {name: f"10.77.0.{n}" for n, name in enumerate(names, 1)}
        self._namespaces = {name: base + name for name in names}
        self._switch = base + "SWITCH"
        self._keepers: dict[str, subprocess.Popen[Any]] = {}
        self._processes: list[subprocess.Popen[Any]] = []
        self._loss: dict[str, float] = {}
        self._cut_off: frozenset[str] = frozenset()
        self._multicast = True

    def __enter__(self) -> Hosts:
        """Makes the hosts, connected."""
        _remove_left_over()
        try:
            self._make()
        except BaseException:
            self.close()
            raise
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        """Ends what runs on the hosts and removes them."""
        self.close()

    def _make(self) -> None:
        _run("ip", "netns", "add", self._switch)
        in_switch = ("ip", "-n", self._switch)
        # Multicast goes to all ports, as with the cheap switch: nobody here asks who wants it.
        _run(*in_switch, "link", "add", "br0", "type", "bridge", "mcast_snooping", "0")
        _run(*in_switch, "link", "set", "br0", "up")
        for n, (name, namespace) in enumerate(self._namespaces.items(), 1):
            port, on_host = f"port{n}", ("ip", "-n", namespace)
            _run("ip", "netns", "add", namespace)
            cable = ("eth0", "netns", namespace, "type", "veth", "peer", "name", port)
            _run("ip", "link", "add", *cable, "netns", self._switch)
            _run(*in_switch, "link", "set", "dev", port, "master", "br0")
            _run(*in_switch, "link", "set", "dev", port, "up")
            _run(*on_host, "addr", "add", f"{self.addresses[name]}/24", "dev", "eth0")
            _run(*on_host, "link", "set", "lo", "up")
            self.link(name, up=True)
            # Holds the mounts of the host: processes on it share memory with each other only.
            keep = "mount -t tmpfs tmpfs /dev/shm && echo ready && exec sleep infinity"
            self._keepers[name] = keeper = subprocess.Popen(
                ["ip", "netns", "exec", namespace, "sh", "-c", keep], stdout=subprocess.PIPE
            )
            assert keeper.stdout is not None
            if keeper.stdout.readline() != b"ready\n":
                raise RuntimeError(f"{name} gets no shared memory of its own")

    def close(self) -> None:
        """Ends what runs on the hosts and removes them."""
        for process in self._processes:
            if process.poll() is None:
                process.terminate()
        end = time.monotonic() + _GRACE_S
        for process in self._processes:
            try:
                process.wait(max(0.0, end - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
        for keeper in self._keepers.values():
            keeper.kill()
            keeper.communicate()
        self._keepers.clear()
        for namespace in (*self._namespaces.values(), self._switch):
            _remove(namespace)

    # ---- processes ----

    def command(self, host: str, *command: str) -> list[str]:
        """The command line that runs a command on a host, as the same process."""
        return [
            "nsenter",
            f"--wd={Path.cwd()}",
            f"--target={self._keepers[host].pid}",
            "--net",
            "--mount",
            "--",
            *command,
        ]

    def run(self, host: str, *command: str, **how: Any) -> str:
        """Runs a command on a host; returns what it prints, raises where it fails."""
        return _run(*self.command(host, *command), **how).stdout

    def popen(
        self, host: str, command: Sequence[str], env: Mapping[str, str] | None = None, **how: Any
    ) -> subprocess.Popen[Any]:
        """Starts a process on a host; it is ended with the hosts.

        Args:
            host: Its name.
            command: The command.
            env: Added to the environment.
            how: As `subprocess.Popen` takes it.
        """
        made = subprocess.Popen(
            self.command(host, *command), env={**os.environ, **(env or {})}, **how
        )
        self._processes.append(made)
        return made

    # ---- trouble ----

    def link(self, host: str, *, up: bool) -> None:
        """Takes a host's interface down, and its routes with it, or brings it up again."""
        on_host = ("ip", "-n", self._namespaces[host])
        _run(*on_host, "link", "set", "dev", "eth0", "up" if up else "down")
        if up:
            _run(*on_host, "route", "replace", "239.0.0.0/8", "dev", "eth0")

    def loss(self, host: str, probability: float) -> None:
        """From now on loses packets to and from a host at random; 0: none.

        A packet between two such hosts is tried once, with the receiver's probability.
        """
        self._loss[host] = probability
        self._apply()

    def partition(self, *hosts: str) -> None:
        """Cuts hosts off from the others, not from each other; without hosts: mends that."""
        self._cut_off = frozenset(hosts)
        self._apply()

    def no_multicast(self) -> None:
        """From now on no host gets multicast from another, as on many Wi-Fi networks."""
        self._multicast = False
        self._apply()

    def _apply(self) -> None:
        for host in self._namespaces:
            lines = ["*raw", ":PREROUTING ACCEPT [0:0]", *self._rules(host), "COMMIT", ""]
            self.run(host, "iptables-restore", input="\n".join(lines))

    def _rules(self, host: str) -> list[str]:
        """What a host does not get. (`raw` comes before fragments are put together.)"""
        rules = [] if self._multicast else ["-A PREROUTING -i eth0 -d 224.0.0.0/4 -j DROP"]
        for other, address in self.addresses.items():
            if other == host:
                continue
            if (other in self._cut_off) != (host in self._cut_off):
                rules.append(f"-A PREROUTING -s {address} -j DROP")
            probability = self._loss.get(host) or self._loss.get(other)
            if probability:
                dice = f"-m statistic --mode random --probability {probability}"
                rules.append(f"-A PREROUTING -s {address} {dice} -j DROP")
        return rules

    # ---- counters ----

    def bytes_sent(self, host: str) -> int:
        """What has left a host by its interface since it was made."""
        return int(self.run(host, "cat", "/sys/class/net/eth0/statistics/tx_bytes"))


def _remove(namespace: str) -> None:
    """Removes a namespace of ours with what still runs there."""
    if not (Path("/run/netns") / namespace).exists():
        return
    for pid in _run("ip", "netns", "pids", namespace).stdout.split():
        try:
            os.kill(int(pid), signal.SIGKILL)
        except ProcessLookupError:
            continue
    _run("ip", "netns", "del", namespace)


def _remove_left_over() -> None:
    """Removes what a run of these tests left that was killed."""
    for path in Path("/run/netns").glob(f"{_PREFIX}*"):
        pid = path.name.removeprefix(_PREFIX).partition("-")[0]
        if not Path("/proc", pid).exists():
            _remove(path.name)

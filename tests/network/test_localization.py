"""Robots that localize each other, where packets are lost and robots are cut off for a while.

Three robots drive side by side, each on its host, with odometry that drifts. One knows where it is;
the others know it by where they are to it, which a planner's host tells. The robots' nodes have the
shipped profile for discovery, the programs that play bases and the planner have none, as drivers.
"""

from __future__ import annotations

import json
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from machine import nine_of_ten
from network.hosts import Hosts

pytestmark = [pytest.mark.alone, pytest.mark.timeout(300)]
ROBOTS, PLANNER = ("robot_a", "robot_b", "robot_c"), "planner"
#: A robot that is farther from the truth than this is not localized [m].
OFF_M = 0.12
#: Nor is one that states a larger standard deviation than this [m].
SURE_M = 0.06
#: A robot that was cut off is localized again after this [s].
BACK_S = 2.0
#: What a condition is waited for, at most [s].
DEADLINE_S = 60.0
Show = Callable[[str], None]


class DrivingTeam:
    """Robots on hosts, and how wrong their poses are.

    Args:
        hosts: Named as `ROBOTS` and `PLANNER`.
        folder: For logs.

    Attributes:
        heard: By robot: when a pose came [s], how far from the truth [m], the sigma it stated [m].
    """

    def __init__(self, hosts: Hosts, folder: Path) -> None:
        self.hosts = hosts
        self.heard: dict[str, list[tuple[float, float, float]]] = {name: [] for name in ROBOTS}
        self._folder = folder
        self._env = {"ROS_LOG_DIR": str(folder / "ros")}
        script, began_ns = str(Path(__file__).with_name("base.py")), str(time.time_ns())
        for host in (*ROBOTS, PLANNER):
            command = [sys.executable, script, host, began_ns]
            if host == PLANNER:
                self._start(host, "base", command)
                continue
            process = self._start(host, "base", command, stdout=subprocess.PIPE, text=True)
            threading.Thread(target=self._read, args=(host, process.stdout), daemon=True).start()
            params = ["-r", f"__ns:=/{host}", "-p", "pose.map_from_odom:=[0.0, 0.05, 0.0]"]
            node = [sys.executable, "-m", "robot_node", "--ros-args", *params]
            self._start(host, "node", node)

    def _start(self, host: str, what: str, command: list[str], **how: Any) -> Any:
        with (self._folder / f"{host}-{what}.log").open("wb") as out:
            how = {"stdout": out, "stderr": out, **how}
            return self.hosts.popen(host, command, self._env, **how)

    def _read(self, robot: str, lines: Any) -> None:
        with lines:
            for line in lines:
                told = json.loads(line)
                self.heard[robot].append((told["at"], told["off"], told["sigma"]))

    def since(self, robot: str, moment: float) -> list[tuple[float, float, float]]:
        """The poses of a robot from a moment on."""
        return [one for one in self.heard[robot] if one[0] >= moment]

    def until(self, condition: Callable[[], bool], what: str) -> None:
        """Waits until a condition holds."""
        end = time.monotonic() + DEADLINE_S
        while not condition():
            if time.monotonic() > end:
                last = {robot: heard[-3:] for robot, heard in self.heard.items()}
                logs = [f"{f.name}: {f.read_text()[-500:]}" for f in self._folder.glob("*.log")]
                raise AssertionError(f"waited {DEADLINE_S:g} s in vain: {what}; {last}; {logs}")
            time.sleep(0.02)

    def until_localized(self) -> None:
        """Waits until all robots have been right, and sure of it, for a second."""

        def localized() -> bool:
            moment = time.monotonic() - 1.0
            recent = [self.since(robot, moment) for robot in ROBOTS]
            return all(
                len(poses) > 10 and all(off < OFF_M and sigma < SURE_M for _, off, sigma in poses)
                for poses in recent
            )

        self.until(localized, "all robots are right")


@pytest.fixture(scope="module")
def team(tmp_path_factory: pytest.TempPathFactory) -> Iterator[DrivingTeam]:
    with Hosts(*ROBOTS, PLANNER) as hosts:
        made = DrivingTeam(hosts, tmp_path_factory.mktemp("driving"))
        made.until_localized()
        yield made


def test_robots_stay_right_while_a_fifth_of_all_packets_is_lost(
    team: DrivingTeam, show: Show
) -> None:
    for host in (*ROBOTS, PLANNER):
        team.hosts.loss(host, 0.2)
    began = time.monotonic()
    time.sleep(8.0)
    found = {robot: team.since(robot, began) for robot in ROBOTS}
    for host in (*ROBOTS, PLANNER):
        team.hosts.loss(host, 0.0)
    worst = {robot: max(off for _, off, _ in poses) for robot, poses in found.items()}
    show(f"20 % of packets lost: off by at most {worst}")
    assert max(worst.values()) < OFF_M
    assert max(sigma for poses in found.values() for _, _, sigma in poses) < 0.12


def back_after(team: DrivingTeam, outage_s: float) -> float:
    """Cuts a robot off; returns how long after that it is right, and sure of it, again [s]."""
    robot = "robot_b"
    team.until_localized()
    team.hosts.partition(robot)
    time.sleep(outage_s)
    _, off, sigma = team.heard[robot][-1]
    assert sigma > SURE_M, f"{robot} does not say that it drifts: off by {off}, sigma {sigma}"
    moment = time.monotonic()
    team.hosts.partition()

    def back() -> list[float]:
        return [at for at, off, s in team.since(robot, moment) if off < OFF_M and s < SURE_M]

    team.until(lambda: bool(back()), f"{robot} is right again")
    return back()[0] - moment


def test_robot_that_was_cut_off_is_back_at_once(team: DrivingTeam, show: Show) -> None:
    what = "cut off for 12 s: right again after that"
    nine_of_ten(lambda: back_after(team, 12.0), BACK_S, what, tries=2, show=show)


@pytest.mark.soak
@pytest.mark.timeout(600)
def test_robot_that_was_cut_off_for_long_is_back_at_once(team: DrivingTeam, show: Show) -> None:
    what = "cut off for 30 s: right again after that"
    nine_of_ten(lambda: back_after(team, 30.0), BACK_S, what, tries=5, show=show)

"""The processes of a team: what `mrs up` and `ros2 launch planner_node team.launch.py` start."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from mrs_people_loc.config import (
    GUIDE_NODE,
    PLANNER_NODE,
    ROBOT_NODE,
    load_team,
    robots_named,
)
from mrs_people_loc.errors import ConfigError
from mrs_ros.closing import Closing
from mrs_ros.ending import LIFELINE
from mrs_ros.network import environment

#: A process that was asked to end gets this long [s].
_GRACE_S = 5.0


@dataclass(frozen=True)
class NodeProcess:
    """One node to start.

    Attributes:
        package: ROS package.
        namespace: The robot's name; empty for the planner and the guide.
        files: Parameter files, later ones win.
        sim_time: Whether the node takes its time from `/clock`; else as in its files.
        executable: In the package; empty: the one of its name.
    """

    package: str
    namespace: str
    files: tuple[str, ...]
    sim_time: bool
    executable: str = ""

    @property
    def label(self) -> str:
        """Name for people."""
        return self.namespace or (self.executable or self.package).removesuffix("_node")

    def command(self) -> list[str]:
        """The command line, with this Python."""
        module = f"{self.package}.{self.executable}" if self.executable else self.package
        args = [sys.executable, "-m", module, "--ros-args"]
        if self.namespace:
            args += ["-r", f"__ns:=/{self.namespace}"]
        for file in self.files:
            args += ["--params-file", file]
        return [*args, "-p", "use_sim_time:=true"] if self.sim_time else args


def team_processes(
    files: Sequence[str | Path], *, sim_time: bool = False, guide: bool = False
) -> list[NodeProcess]:
    """One robot_node for every robot that the files name, the planner, and the guide if wanted.

    Args:
        files: Parameter files of the team, later ones win.
        sim_time: Whether the nodes take their time from `/clock`.
        guide: Whether guide_node is started, too.

    Raises:
        ConfigError: A file is wrong, or names no robot.
    """
    names = robots_named(*files)
    load_team(*files, robots=names)
    if not names:
        raise ConfigError(
            f"{', '.join(map(str, files))}: no robot is named; wanted: the list `robots` in the "
            f"section of {PLANNER_NODE}, or a section of each robot, /NAME/{ROBOT_NODE}"
        )
    paths = tuple(str(Path(os.path.expanduser(file)).resolve()) for file in files)
    robots = [NodeProcess(ROBOT_NODE, name, paths, sim_time) for name in names]
    guides = [NodeProcess(PLANNER_NODE, "", paths, sim_time, GUIDE_NODE)] if guide else []
    return [*robots, NodeProcess(PLANNER_NODE, "", paths, sim_time), *guides]


class RunningTeam(Closing):
    """The started processes of a team; use it as a context manager, which ends them.

    Args:
        nodes: What to start.
        log: File that takes what they print; None: where this process prints.
        env: Added to their environment.
    """

    def __init__(
        self,
        nodes: Sequence[NodeProcess],
        log: IO[str] | None = None,
        env: Mapping[str, str] | None = None,
    ) -> None:
        # AMENT_PREFIX_PATH: a pip install sets nothing. A session of their own: Ctrl-C at the
        # terminal reaches us, and we end them in order. However we end, also killed, the other end
        # of their standard input is closed then, and they end, too.
        self._log, self._env = (
            log,
            {
                "AMENT_PREFIX_PATH": sys.prefix,
                **environment(),
                **(env or {}),
                LIFELINE: "1",
            },
        )
        self.processes: dict[NodeProcess, subprocess.Popen[bytes]] = {}
        for node in nodes:
            self.start(node)

    def start(self, node: NodeProcess) -> None:
        """Starts a node; one that was started before must have ended."""
        before = self.processes.get(node)
        if before is not None and before.stdin is not None:
            before.wait()
            before.stdin.close()
        self.processes[node] = subprocess.Popen(
            node.command(),
            env=self._env,
            start_new_session=True,
            stdin=subprocess.PIPE,
            stdout=self._log,
            stderr=self._log,
        )

    def ended(self) -> dict[NodeProcess, int]:
        """Exit codes of the processes that have ended."""
        codes = {node: process.poll() for node, process in self.processes.items()}
        return {node: code for node, code in codes.items() if code is not None}

    def close(self) -> dict[NodeProcess, int]:
        """Ends every process: asked first, then forced.

        Returns:
            Exit codes.
        """
        for process in self.processes.values():
            if process.poll() is None:
                process.send_signal(signal.SIGINT)
        deadline = time.monotonic() + _GRACE_S
        for process in self.processes.values():
            try:
                process.wait(max(0.0, deadline - time.monotonic()))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            assert process.stdin is not None
            process.stdin.close()
        return self.ended()

"""The launch files and what is installed, with the real `ros2 launch`, `run`, `lifecycle`, `param`.

These tools come with ROS from Ubuntu's packages; the wheels that `make setup` installs lack them.
"""

from __future__ import annotations

import os
import re
import signal
import subprocess
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path

import pytest

from ros.harness import DEADLINE_S, ROOT, Peer, holds

TEAM = """
/**/planner_node: {ros__parameters: {robots: [robot_a]}}
/**/guide_node: {ros__parameters: {pace: {speed: 0.5}}}
/**/robot_node: {ros__parameters: {mounting: {height: 1.25}}}
/robot_a/robot_node: {ros__parameters: {zones: {low: 0.1}}}
/camera_driver: {ros__parameters: {fps: 30}}
"""
#: Somebody else's launch file, of the same name, with an argument of its own.
OUTER = """
from launch import LaunchDescription
from launch.actions import DeclareLaunchArgument, IncludeLaunchDescription
from launch.launch_description_sources import PythonLaunchDescriptionSource

def generate_launch_description():
    ours = PythonLaunchDescriptionSource({ours!r})
    return LaunchDescription([
        DeclareLaunchArgument("cameras"),
        IncludeLaunchDescription(
            ours, launch_arguments={{"robot": "robot_b", "team": {team!r}}}.items()
        ),
    ])
"""


@dataclass
class Launched:
    """A running `ros2 launch`."""

    process: subprocess.Popen[str]

    def end(self, number: int = signal.SIGINT) -> str:
        """Ends it as who presses Ctrl-C does, and returns all that it has written."""
        self.process.send_signal(number)
        reported, _ = self.process.communicate(timeout=DEADLINE_S)
        return reported


def launch(ros2: str, *arguments: str) -> Launched:
    process = subprocess.Popen(
        [ros2, "launch", *arguments],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        start_new_session=True,
    )
    return Launched(process)


def ask(ros2: str, *arguments: str) -> str:
    done = subprocess.run(
        [ros2, *arguments], capture_output=True, text=True, check=False, timeout=DEADLINE_S
    )
    return done.stdout + done.stderr


# --- what is wrong is said, and nothing starts ----------------------------------------------------

WRONG = {
    "no team": (
        ("planner_node", "team.launch.py"),
        r"missing required argument team:=FILE; .*an example to copy: .*/config/team\.yaml",
    ),
    "no team for a robot": (
        ("robot_node", "robot.launch.py", "robot:=robot_a"),
        r"missing required argument team:=FILE",
    ),
    "no robot": (
        ("robot_node", "robot.launch.py", "team:=TEAM"),
        r"missing required argument robot:=NAME",
    ),
    "misspelt team": (
        ("planner_node", "team.launch.py", "taem:=x.yaml"),
        r"unknown launch argument taem; did you mean team\?",
    ),
    "no such file": (
        ("planner_node", "team.launch.py", "team:=~/none.yaml"),
        r"HOME/none\.yaml: there is no such file",
    ),
    "misspelt argument": (
        ("planner_node", "team.launch.py", "team:=TEAM", "autostrat:=false"),
        r"unknown launch argument autostrat; did you mean autostart\?",
    ),
    "unknown argument": (
        ("robot_node", "robot.launch.py", "team:=TEAM", "robot:=robot_a", "cameras:=2"),
        r"unknown launch argument cameras; allowed: robot, team, autostart",
    ),
    "by its path": (
        (str(ROOT / "planner_node/launch/team.launch.py"), "team:=TEAM", "peer:=a"),
        r"unknown launch argument peer; did you mean peers\?",
    ),
    "neither true nor false": (
        ("planner_node", "team.launch.py", "team:=TEAM", "autostart:=no"),
        r'Argument "autostart" provided value "no" is not valid',
    ),
    "a robot of another team": (
        ("robot_node", "robot.launch.py", "team:=TEAM", "robot:=robot_z"),
        r"robot_z is no robot of .*team\.yaml, which names robot_a",
    ),
    "misspelt node": (
        ("planner_node", "team.launch.py", "team:=~/misspelt.yaml"),
        r"/robot_a/robot_nod names no node of ours; did you mean .*robot_node",
    ),
}  # fmt: skip


@pytest.fixture(scope="module")
def home(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A home folder with the team's file."""
    folder = tmp_path_factory.mktemp("home")
    (folder / "team.yaml").write_text(TEAM)
    (folder / "misspelt.yaml").write_text(TEAM.replace("/robot_a/robot_node", "/robot_a/robot_nod"))
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("HOME", str(folder))
        yield folder


@pytest.fixture(scope="module")
def refused(ros2: str, home: Path) -> dict[str, Launched]:
    """All at once: most of the time each loads what it needs."""
    team = str(home / "team.yaml")
    return {
        name: launch(ros2, *(word.replace("TEAM", team) for word in words))
        for name, (words, _) in WRONG.items()
    }


@pytest.mark.parametrize("name", WRONG)
def test_launch_reports_wrong_arguments(
    refused: dict[str, Launched], home: Path, name: str
) -> None:
    reported, _ = refused[name].process.communicate(timeout=DEADLINE_S)
    assert refused[name].process.returncode == 1
    assert holds(reported, [WRONG[name][1].replace("HOME", str(home))]), reported
    assert "process started" not in reported
    assert "Traceback" not in reported


# --- what is right works --------------------------------------------------------------------------

#: The nodes of the launched team.
OF_TEAM = ("/robot_a/robot_node", "/planner_node", "/guide_node")


@pytest.fixture(scope="module")
def team(ros2: str, home: Path) -> Iterator[Launched]:
    file = ("team:=~/team.yaml", "guide:=true", "autostart:=false")
    made = launch(ros2, "planner_node", "team.launch.py", *file)
    yield made
    made.end()


@pytest.fixture(scope="module")
def included(ros2: str, home: Path) -> Iterator[Launched]:
    file = home / "robot.launch.py"
    ours = str(ROOT / "robot_node" / "launch" / "robot.launch.py")
    (home / "other.yaml").write_text("/robot_b/robot_node: {ros__parameters: {}}")
    file.write_text(OUTER.format(ours=ours, team=str(home / "other.yaml")))
    made = launch(ros2, str(file), "cameras:=2")
    yield made
    made.end()


@pytest.mark.slow
def test_team_with_autostart_false_waits_unconfigured(
    ros2: str, team: Launched, included: Launched, peer: Peer
) -> None:
    """`autostart:=false` and the file, in `~` and with sections of others, apply to all nodes."""
    for node in OF_TEAM:
        peer.until(lambda n=node: peer.state(n) == "unconfigured", f"{node} does not wait")  # type: ignore[misc]
    where = ("/robot_a/robot_node", "--no-daemon", "--spin-time", "2")
    asked = [
        ("param", "get", *where, "mounting.height"),
        ("param", "set", *where, "zones.low", "9.0"),
        ("lifecycle", "set", *where, "configure"),
    ]
    with ThreadPoolExecutor() as threads:
        got, refused, configured = threads.map(lambda words: ask(ros2, *words), asked)
    assert "Double value is: 1.25" in got
    assert holds(refused, [r"failed: zones\.low is 9; allowed: less than zones\.high"]), refused
    assert "Transitioning successful" in configured
    assert peer.state("/robot_a/robot_node") == "inactive"
    assert peer.change_state("/robot_a/robot_node", "activate")


@pytest.mark.slow
def test_launch_file_can_be_included_by_one_with_more_arguments(
    included: Launched, peer: Peer
) -> None:
    """The arguments of that file are not refused here; without `autostart` the nodes start."""
    peer.until_active("/robot_b/robot_node")


@pytest.mark.slow
def test_launch_ends_its_nodes_in_order(team: Launched, included: Launched, peer: Peer) -> None:
    for node in (*OF_TEAM, "/robot_b/robot_node"):
        peer.until(lambda n=node: peer.state(n), f"{node} does not start")  # type: ignore[misc]
    for one, count in ((team, 3), (included, 1)):
        reported = one.end()
        assert one.process.returncode == 0, reported
        assert reported.count("process has finished cleanly") == count, reported
        assert not re.search("Traceback|ERROR|escalating", reported), reported


@pytest.mark.slow
def test_executables_run(ros2: str, home: Path) -> None:
    files = ("--ros-args", "--params-file", str(home / "team.yaml"))
    command = [ros2, "run", "planner_node", "planner_node", *files]
    node = subprocess.Popen(
        command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True, start_new_session=True
    )
    assert node.stdout is not None
    is_active = any("/planner_node: active; waits for" in line for line in node.stdout)
    assert is_active
    os.killpg(node.pid, signal.SIGINT)  # a Ctrl-C at the terminal
    reported, _ = node.communicate(timeout=DEADLINE_S)
    assert node.returncode in (0, -signal.SIGINT), reported
    assert "Traceback" not in reported.replace("KeyboardInterrupt", ""), reported
    assert ask(ros2, "run", "mrs_people_loc", "mrs", "--version").startswith("mrs ")
    assert "usage: guide_node" in ask(ros2, "run", "planner_node", "guide_node", "--help")
    executables = ask(ros2, "pkg", "executables")
    assert "robot_node robot_node" in executables
    assert "planner_node guide_node" in executables

"""`mrs up`, `mrs people`, `mrs demo`: the processes of a team."""

from __future__ import annotations

import os
import re
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

pytest.importorskip("rclpy")

from typer.testing import CliRunner

from mrs_people_loc.errors import ConfigError
from mrs_ros.processes import team_processes
from mrs_tools.cli import app
from ros.harness import own_domain

ROOT = Path(__file__).parents[2]
TEAM = ROOT / "config" / "team.yaml"
FORMATION = ROOT / "bags" / "paper_formation"


@pytest.fixture
def environment() -> Iterator[dict[str, str]]:
    with own_domain() as number:
        yield {
            **os.environ,
            "ROS_DOMAIN_ID": str(number),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "COLUMNS": "120",
        }


def mrs(*arguments: object) -> list[str]:
    return [sys.executable, "-m", "mrs_tools", *map(str, arguments)]


def run_mrs(environment, *arguments: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        mrs(*arguments), env=environment, capture_output=True, text=True, cwd=ROOT
    )


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_one_process_per_robot_and_the_planner():
    processes = team_processes([TEAM])
    assert [p.label for p in processes] == ["robot_a", "robot_b", "robot_c", "planner"]
    assert [p.package for p in processes] == ["robot_node"] * 3 + ["planner_node"]
    robot, planner = processes[0].command(), processes[-1].command()
    assert robot[1:] == [
        "-m", "robot_node", "--ros-args", "-r", "__ns:=/robot_a", "--params-file", str(TEAM),
    ]  # fmt: skip
    assert planner[1:] == ["-m", "planner_node", "--ros-args", "--params-file", str(TEAM)]


def test_simulated_time_is_set_only_on_request():
    assert not any("use_sim_time" in a for p in team_processes([TEAM]) for a in p.command())
    for process in team_processes([TEAM], sim_time=True):
        assert process.command()[-2:] == ["-p", "use_sim_time:=true"]


def test_robots_may_be_named_by_their_sections(tmp_path):
    file = write(
        tmp_path / "team.yaml",
        "/robot_x/robot_node: {ros__parameters: {mounting: {height: 1.2}}}\n"
        "/**/planner_node: {ros__parameters: {robots: []}}\n",
    )
    assert [p.label for p in team_processes([file])] == ["robot_x", "planner"]
    *_, guide = team_processes([file], guide=True)
    assert guide.label == "guide"
    assert guide.command()[1:4] == ["-m", "planner_node.guide_node", "--ros-args"]


def test_team_without_robots_is_refused():
    with pytest.raises(ConfigError, match=r"paper\.yaml: no robot is named; wanted: the list"):
        team_processes([ROOT / "config" / "paper.yaml"])


def test_launch_files_need_no_command_line_library():
    code = "import sys; sys.modules['typer'] = None; import mrs_ros.processes"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_up_reports_a_wrong_team_file(tmp_path, environment):
    file = write(tmp_path / "team.yaml", "/**/robot_node: {ros__parameters: {zones: {lo: 1}}}\n")
    done = run_mrs(environment, "up", file)
    assert done.returncode == 1
    assert re.search(
        r"error: .*team\.yaml.* unknown parameter zones\.lo; did you mean", done.stderr
    )


@pytest.mark.timeout(180)
def test_up_and_people_run_until_ctrl_c(environment):
    """A team without cameras: the planner runs, finds nobody, and reports what is missing."""
    team = subprocess.Popen(
        mrs("up", TEAM), env=environment, stderr=subprocess.PIPE, text=True, start_new_session=True
    )
    try:
        shown = ""
        deadline = time.monotonic() + 60
        causes = r"/robot_[abc]/robot_node: left/image_rect: no data on .* that follow from it"
        while not re.search(causes, shown, re.DOTALL) and time.monotonic() < deadline:
            shown = run_mrs(environment, "people", "--duration", 4).stdout
        assert "waiting for people" in shown
        assert re.search(causes, shown, re.DOTALL), shown
        assert "4 nodes report" in shown
        assert "more; what to do: mrs doctor" in shown
        assert "/planner_node" not in shown  # what it lacks follows from the robots' troubles
        assert team.poll() is None
    finally:
        team.send_signal(signal.SIGINT)
        _, reported = team.communicate(timeout=50)
    assert team.returncode == 0, reported
    assert "started robot_a, robot_b, robot_c, planner" in reported
    assert "ended by itself" not in reported
    assert "Traceback" not in reported


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_demo_finds_all_people(tmp_path, environment):
    """On a busy machine, too, if it gets more time."""
    picture = tmp_path / "demo.png"
    del environment["ROS_DOMAIN_ID"]
    for rate in (0.5, 0.2, 0.1):
        done = run_mrs(
            environment,
            *("demo", FORMATION, "--team", TEAM, "--rate", rate, "--gif", "--out", picture),
        )
        assert done.returncode == 0, done.stderr
        assert re.search(
            r"in ROS domain \d+, which nobody else uses; to look into it:\n  ROS_DOMAIN_ID=",
            done.stdout,
        )
        # The page comes first, and does not keep the demo from ending: nobody sits before it.
        assert re.match(r" +\d+\.\d s  page: http://127\.0\.0\.1:\d+/\n", done.stdout)
        pattern = r"found (\d+) of (\d+) people in (\d+) frames .* (\d+) false"
        found = re.search(pattern, done.stdout)
        assert found is not None, done.stdout
        matched, *others = map(int, found.groups())
        # The first interval may close before every robot has seen its first view.
        if others == [75, 15, 0] and matched >= 70:
            break
    else:
        raise AssertionError(done.stdout)
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert picture.with_suffix(".gif").read_bytes().startswith(b"GIF89a")


@pytest.mark.slow
@pytest.mark.timeout(420)
def test_demo_tracks_a_walking_group(tmp_path, environment):
    """One of them falls behind, and one joins."""
    picture = tmp_path / "demo.png"
    for rate in (0.5, 0.2, 0.1):
        done = run_mrs(environment, "demo", "--rate", rate, "--gif", "--out", picture)
        assert done.returncode == 0, done.stderr
        if "the machine was too busy" not in done.stdout:
            break
    found = re.search(r"found (\d+) of (\d+) people", done.stdout)
    assert found is not None, done.stdout
    assert int(found[1]) > 0.9 * int(found[2]), done.stdout
    assert re.search(r"followed: \d id switches, MOTA 0\.9", done.stdout), done.stdout
    assert re.search(r"after +\d\.\d s: person \d+ has fallen behind", done.stdout), done.stdout
    assert re.search(r"after .* s: person \d+ joins group \d", done.stdout), done.stdout
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert picture.with_suffix(".gif").stat().st_size < 2_000_000


@pytest.mark.slow
def test_demo_refuses_a_domain_with_another_planner(tmp_path, environment):
    command = [sys.executable, "-m", "planner_node", "--ros-args", "-p", "robots:=[robot_x]"]
    planner = subprocess.Popen(command, env=environment, stderr=subprocess.PIPE)
    try:
        assert planner.stderr is not None
        while b": active" not in planner.stderr.readline():
            assert planner.poll() is None
        done = run_mrs(environment, "demo", FORMATION, "--out", tmp_path / "demo.png")
    finally:
        planner.send_signal(signal.SIGINT)
        planner.communicate(timeout=50)
    assert done.returncode == 1
    assert f"in ROS domain {environment['ROS_DOMAIN_ID']}, as ROS_DOMAIN_ID says" in done.stdout
    assert "starting" not in done.stdout  # before our nodes speak in a live team's domain
    wanted = (
        "/tracked_people has 1 other publisher: /planner_node. End the others, or unset "
        "ROS_DOMAIN_ID"
    )
    assert wanted in done.stderr
    assert not list(tmp_path.iterdir())


#: A node that offers a topic, and says when it does.
DRIVER = """
import sys
from importlib import import_module
from mrs_tools.tool_node import node

topic, package, kind = sys.argv[1:]
with node("driver") as driver:
    driver.create_publisher(getattr(import_module(package + ".msg"), kind), topic, 10)
    print(driver.get_name(), flush=True)
    sys.stdin.read()
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("topic", "kind"),
    [
        ("/clock", ("rosgraph_msgs", "Clock")),
        ("/robot_a/left/camera_info", ("sensor_msgs", "CameraInfo")),
        ("/robot_b/odom", ("nav_msgs", "Odometry")),
    ],
)
def test_demo_refuses_a_domain_with_publishers_of_the_bags_topics(
    tmp_path, environment, topic, kind
):
    """The replay would leave that to them, and the team would use their clock or camera."""
    with subprocess.Popen(
        [sys.executable, "-c", DRIVER, topic, *kind],
        env=environment,
        stdin=subprocess.PIPE,
        stdout=subprocess.PIPE,
        text=True,
    ) as driver:  # which ends it, too: its input is closed
        assert driver.stdout is not None
        # Fast DDS may write lines of its own.
        name = next(line.strip() for line in driver.stdout if line.startswith("driver_"))
        done = run_mrs(environment, "demo", FORMATION, "--out", tmp_path / "demo.png")
        driver.communicate()
    assert done.returncode == 1, done.stdout
    assert f"{topic} has 1 other publisher: /{name}. End the others" in done.stderr
    assert "replaying" not in done.stdout
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "arguments",
    [
        ["demo", FORMATION], ["up", TEAM], ["people"], ["doctor"], ["replay", FORMATION],
        ["record", "new.mcap"], ["bench"],
    ],
    ids=lambda arguments: arguments[0],
)  # fmt: skip
def test_wrong_domain_is_an_error_before_anything_runs(arguments, monkeypatch, tmp_path):
    monkeypatch.setenv("ROS_DOMAIN_ID", "abc")
    monkeypatch.chdir(tmp_path)
    done = CliRunner().invoke(app, [str(argument) for argument in arguments])
    assert done.exit_code == 1
    assert "error: ROS_DOMAIN_ID is 'abc'; allowed: a whole number from 0 to 232" in done.stderr
    assert not list(tmp_path.iterdir())


@pytest.mark.slow
def test_demo_reports_what_the_bag_lacks(tmp_path, environment):
    file = write(
        tmp_path / "team.yaml",
        "/**/planner_node: {ros__parameters: {robots: [robot_z]}}\n",
    )
    done = run_mrs(environment, "demo", FORMATION, "--team", file)
    assert done.returncode == 1
    assert "has no camera_info of robot_z" in done.stderr

"""What a release needs: changelogs, citation, workflows, the image."""

import re
import subprocess
import sys
from importlib import metadata
from pathlib import Path
from typing import Any

import pytest
import typer
import yaml

from mrs_people_loc.config import robots_named
from mrs_tools import cli
from test_packaging import PACKAGES, ROOT

WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yaml"))
SERVICES = yaml.safe_load((ROOT / "compose.yaml").read_text(encoding="utf-8"))["services"]


@pytest.mark.filterwarnings("ignore:nodes.Node.traverse:DeprecationWarning")  # in catkin_pkg
@pytest.mark.parametrize(("name", "folder"), PACKAGES.items())
def test_changelog_of_package_is_catkins(name: str, folder: str) -> None:
    """`catkin_prepare_release` finds "Forthcoming" and makes it the version that bloom reads."""
    changelog = pytest.importorskip("catkin_pkg.changelog")
    tag = pytest.importorskip("catkin_pkg.cli.tag_changelog")
    text = (ROOT / folder / "CHANGELOG.rst").read_text(encoding="utf-8")
    assert f"\nChangelog for package {name}\n" in text
    label = tag.get_forthcoming_label(text)
    assert label == "Forthcoming"
    released = changelog.Changelog(name)
    text = tag.rename_section(text, label, "9.9.9 (2026-01-01)")
    changelog.populate_changelog_from_rst(released, text)
    assert released.get_content_of_version("9.9.9")


def test_citation_is_complete_and_of_this_version() -> None:
    """Keys that version 1.2.0 of the Citation File Format requires, and a version."""
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert citation["cff-version"] == "1.2.0"
    assert {"authors", "message", "title"} <= set(citation)
    assert citation["version"] == metadata.version("mrs-people-loc")
    (article,) = citation["references"]
    assert {"authors", "title", "type"} <= set(article)


@pytest.mark.parametrize("path", WORKFLOWS, ids=lambda path: path.name)
def test_workflow_is_valid(path: Path) -> None:
    """Jobs have a machine and steps, may only read, and call targets that the Makefile has."""
    text = path.read_text(encoding="utf-8")
    workflow = yaml.safe_load(text)
    assert workflow["permissions"] == {"contents": "read"}
    assert workflow[True]  # YAML 1.1 reads the key `on` so
    assert workflow["jobs"]
    for name, job in workflow["jobs"].items():
        assert job["runs-on"], name
        assert job["steps"], name
        for step in job["steps"]:
            assert ("uses" in step) != ("run" in step), step
            assert re.fullmatch(r"[\w-]+(/[\w-]+)+@v\d+", step.get("uses", "a/b@v1")), step
    called = set(re.findall(r"\bmake ([a-z-]+)", text))
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert called <= set(re.findall(r"^([a-z-]+):", makefile, re.MULTILINE))


def test_there_are_workflows() -> None:
    assert {path.stem for path in WORKFLOWS} >= {"ros", "python", "wheels"}


def test_image_is_made_of_what_robots_and_planners_run() -> None:
    """All of each package; what the Dockerfile copies exists, and Docker is sent it."""
    dockerfile = (ROOT / "Dockerfile").read_text(encoding="utf-8")
    copied = set(re.findall(r"^COPY (\S+) ", dockerfile, re.MULTILINE))
    sent = re.findall(r"^!(\S+)$", (ROOT / ".dockerignore").read_text(), re.MULTILINE)
    for path in copied:
        assert (ROOT / path).exists(), path
        assert any(f"{path}/".startswith(f"{each}/") for each in sent), path
    packages = {path.parent.name for path in ROOT.glob("*/package.xml")} - {"bags", "simulation"}
    assert copied >= packages | {f"{package}/package.xml" for package in packages}
    (rosbags,) = re.findall(r"rosbags==\S+", dockerfile)
    assert rosbags in (ROOT / "requirements" / "lock.txt").read_text().splitlines()


@pytest.mark.parametrize("service", SERVICES)
def test_service_runs_a_command_of_ours(service: str) -> None:
    """An executable, a subcommand with its options, or a launch file with its arguments."""

    def filled(text: str) -> str:
        """The text with the defaults of its variables."""
        return re.sub(r"\$\{\w+:-(.*?)\}", r"\1", text)

    (team,) = SERVICES[service]["volumes"]
    program, *rest = map(filled, SERVICES[service]["command"])
    if program == "mrs":
        group: Any = typer.main.get_command(cli.app)
        name, command, options = group.resolve_command(typer.Context(group), rest)
        assert command.make_context(name, options).params["host"] == "127.0.0.1"
    elif program == "ros2":
        verb, package, file, *arguments = rest
        assert verb == "launch"
        text = (ROOT / package / "launch" / file).read_text()
        text += (ROOT / "mrs_people_loc" / "mrs_ros" / "launch_files.py").read_text()
        declared = re.findall(r'DeclareLaunchArgument\(\s*"(\w+)"', text)
        given = dict(argument.split(":=") for argument in arguments)
        assert given.keys() <= set(declared)
        assert given["team"] == team["target"]
        assert given["robot"] in robots_named(ROOT / filled(team["source"]))
    else:
        setup = (ROOT / program / "setup.py").read_text()
        assert f'"{program} = {program}.__main__:main"' in setup
        assert rest == ["--ros-args", "--params-file", team["target"]]


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("", "", "Ready to release 0.2.0."),
        ("a@people.net", "a@example.org", "a@example.org is a placeholder"),
        ("Issues", "Bugs", "[project.urls]: no Issues"),
        ("repository-code", "url", "CITATION.cff: no repository-code"),
        ("0.2.0 (2027-01-31)", "Forthcoming", "robot/CHANGELOG.rst: no section '0.2.0"),
        ("## 0.2.0 (2027-01-31)", "## 10.2.0 (2027-01-31)", "CHANGELOG.md: no section '0.2.0"),
    ],
)
def test_release_check_names_what_is_left(old: str, new: str, says: str, tmp_path: Path) -> None:
    script = (ROOT / "setup" / "release_check.py").read_text(encoding="utf-8")
    project = """\
        [project]
        version = "0.2.0"
        maintainers = [{name = "A", email = "a@people.net"}]
        urls = {Homepage = "https://h", Repository = "https://r", Issues = "https://i"}
    """
    for name, text in {
        "setup/release_check.py": script,
        "pyproject.toml": project.replace(old, new),
        "CITATION.cff": "cff-version: 1.2.0\nrepository-code: https://r\n".replace(old, new),
        "CHANGELOG.md": "# Changelog\n\n## 0.2.0 (2027-01-31)\n".replace(old, new),
        "robot/CHANGELOG.rst": "0.2.0 (2027-01-31)\n------------------\n".replace(old, new),
    }.items():
        (tmp_path / name).parent.mkdir(exist_ok=True)
        (tmp_path / name).write_text(text, encoding="utf-8")
    command = [sys.executable, "setup/release_check.py"]
    run = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
    assert says in run.stdout + run.stderr
    assert run.returncode == (1 if old else 0)

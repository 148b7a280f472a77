"""The command lines of the documentation: their commands, options and launch arguments exist."""

import re
import shlex
from pathlib import Path

import pytest

from tools.commands.parsing import exists, parsed

ROOT = Path(__file__).resolve().parents[3]
PAGES = sorted(
    page for folder in (".", "docs", "docs/tutorials", "studies/labels", "config/scenes")
    for page in (ROOT / folder).glob("*.md")
    if page.name != "CHANGELOG.md"
)  # fmt: skip
BLOCK = re.compile(r"^```(\w*)\n(.*?)^```$", re.DOTALL | re.MULTILINE)
#: `mrs` and `make` in a sentence.
IN_TEXT = re.compile(r"`((?:mrs|make) [^`\n]+)`")
TARGETS = set(re.findall(r"^([a-z][\w-]*):", (ROOT / "Makefile").read_text(), re.MULTILINE))
OURS = re.compile(r"mrs |make |ros2 (run|launch) ")
NOT_TO_RUN = re.compile(r"\[-|\.\.\.|…|--help")  # [--option], COMMAND ...


def command_lines(page: Path) -> list[str]:
    """The lines of the code blocks of a page that run `mrs`, `make`, nodes or launch files."""
    lines = []
    for language, block in BLOCK.findall(page.read_text(encoding="utf-8")):
        if language not in {"", "bash", "sh"}:
            continue  # YAML, or what a command prints
        for line in block.replace("\\\n", " ").splitlines():
            command = re.split(r"\s#|\s[|&]", f"{line} ")[0].strip()
            if OURS.match(command) and not NOT_TO_RUN.search(command):
                lines.append(command)
    return lines


def check(line: str) -> None:
    """Raises, or fails, if a command line cannot be run as it is written."""
    words = shlex.split(line)
    if words[0] == "make":
        assert {word for word in words[1:] if "=" not in word} <= TARGETS, line
        return
    if words[0] == "mrs" or words[:4] == ["ros2", "run", "mrs_people_loc", "mrs"]:
        parsed(shlex.join(words[words.index("mrs") + 1 :]))
        return
    _, verb, package, name, *arguments = words
    folder = ROOT / package
    if not folder.is_dir():
        return  # a package of others
    if verb == "run":
        assert (folder / "scripts" / name).is_file(), line
        return
    launch_file = folder / "launch" / name
    shared = ROOT / "mrs_people_loc" / "mrs_ros" / "launch_files.py"
    declared = r'DeclareLaunchArgument\(\s*"(\w+)"'
    known = {
        argument
        for path in (launch_file, shared)
        for argument in re.findall(declared, path.read_text(encoding="utf-8"))
    }
    assert {argument.partition(":=")[0] for argument in arguments} <= known, line


def test_there_are_command_lines() -> None:
    assert sum(len(command_lines(page)) for page in PAGES) > 50


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_command_lines_of_the_documentation_are_valid(page: Path) -> None:
    for line in command_lines(page):
        try:
            check(line)
        except Exception as err:
            pytest.fail(f"{line}: {err}")


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_commands_in_sentences_exist(page: Path) -> None:
    """Those of `mrs` may lack arguments there."""
    for line in IN_TEXT.findall(page.read_text(encoding="utf-8")):
        words = shlex.split(line)
        if words[0] == "make":
            check(line)
        elif re.fullmatch(r"[a-z][a-z-]*", words[1]):
            assert exists(words[1]), line


@pytest.mark.parametrize(
    "line",
    [
        "make tests",
        "mrs doctor --durations 10",
        "ros2 run mrs_people_loc mrs people --clock",
        "ros2 run robot_node robot_nod",
        "ros2 launch robot_node robots.launch.py",
        "ros2 launch robot_node robot.launch.py robo:=robot_a",
    ],
)
def test_invalid_command_line_is_noticed(line: str) -> None:
    with pytest.raises((Exception, AssertionError)):
        check(line)

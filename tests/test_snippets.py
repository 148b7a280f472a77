"""The snippets of the documentation: Python runs, YAML and XML are what their readers take.

Command lines: tests/tools/commands/test_documented_commands.py.
"""

import copy
import json
import re
import runpy
import sys
import xml.etree.ElementTree as ET
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml

from mrs_people_loc import load_team, read_tour
from mrs_people_loc.config import robots_named
from mrs_people_loc.localization.walls.known import read_walls
from mrs_people_sim.scene import read_scene
from test_docs import PAGES, ROOT

BLOCK = re.compile(r"^( *)```(\w+)\n(.*?)^\1```$", re.DOTALL | re.MULTILINE)
#: Languages of fenced blocks; `text` is what a command prints, the rest of these command lines.
LANGUAGES = {"bash", "python", "sh", "text", "xml", "yaml"}


def blocks(page: Path, language: str) -> list[str]:
    """Return the fenced blocks of a page in a language."""
    found = BLOCK.findall(page.read_text(encoding="utf-8"))
    return [text for _, of, text in found if of == language]


def pages_with(language: str) -> list[Any]:
    """Return the pages that have blocks in a language, as parameters of a test."""
    return [
        pytest.param(page, id=str(page.relative_to(ROOT)))
        for page in PAGES
        if blocks(page, language)
    ]


@pytest.fixture
def checkout(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A temporary folder with what a reader has in that of the repository; the current one."""
    for name in ("bags", "config"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    yield tmp_path
    if "matplotlib.pyplot" in sys.modules:
        sys.modules["matplotlib.pyplot"].close("all")


def run(text: str, space: dict[str, Any]) -> None:
    """Run a snippet; skip where a library that it shows, and nothing else needs, is missing."""
    for name in ("matplotlib", "pandas"):
        if re.search(rf"^import {name}", text, re.MULTILINE):
            pytest.importorskip(name)
    exec(compile(text, "<snippet>", "exec"), space)


def test_every_block_is_in_a_language_that_is_checked() -> None:
    for page in PAGES:
        found = BLOCK.findall(page.read_text(encoding="utf-8"))
        assert {language for _, language, _ in found} <= LANGUAGES, page


LIBRARY = ROOT / "docs" / "python.md"


def test_python_of_the_other_pages_runs(checkout: Path) -> None:
    """From the repository's folder, the blocks of a page one after the other."""
    for page in PAGES:
        space: dict[str, Any] = {"__name__": "snippets"}
        for text in blocks(page, "python") if page != LIBRARY else ():
            run(text, space)


@pytest.mark.slow
def test_snippets_of_the_library_find_what_they_say(
    checkout: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    space: dict[str, Any] = {"__name__": "snippets"}
    images, people, table, guide, localizer = blocks(LIBRARY, "python")
    run(images, space)
    run(people, space)
    # One look of one robot: the fifth of five, 4.3 m away behind two others, is hardly a person.
    found, view = space["people"].persons, space["view"]
    truth, _ = space["BagRun"]("bags/paper_formation").truth().at(view.images.stamp_ns)
    assert len(found) >= 4
    for person in found:
        assert np.hypot(*(truth - person.position).T).min() < 0.2
    run(table, space)
    assert {*range(1, 6)} <= {*space["table"].id}
    assert (checkout / "people.png").is_file()
    capsys.readouterr()
    run(guide, space)
    events = capsys.readouterr().out
    promised = re.search(r"print\(event\)  # (.*); \.\.\.", guide)
    assert promised is not None
    for event in promised[1].split("; "):
        assert event in events
    run(localizer, space)
    assert abs(space["pose"].y) < 0.1 * space["odometry"].y


@pytest.mark.slow
@pytest.mark.parametrize("page", sorted((ROOT / "docs").glob("*.ipynb")), ids=lambda p: p.name)
def test_notebook_prints_what_it_shows(page: Path, checkout: Path) -> None:
    """Someone who changes what it prints runs setup/notebook.py."""
    pytest.importorskip("matplotlib")
    pytest.importorskip("pandas")
    notebook = json.loads(page.read_text(encoding="utf-8"))
    stored = copy.deepcopy(notebook)
    runpy.run_path(str(ROOT / "setup" / "notebook.py"))["run_cells"](notebook)
    for now, then in zip(notebook["cells"], stored["cells"], strict=True):
        outputs, shown = now.get("outputs", []), then.get("outputs", [])
        assert [one["output_type"] for one in outputs] == [one["output_type"] for one in shown]
        for output, one in zip(outputs, shown, strict=True):
            assert output.get("text") == one.get("text"), "".join(now["source"])


def check_scene(path: Path) -> None:
    """Read a scene."""
    read_scene(yaml.safe_load(path.read_text(encoding="utf-8")), str(path))


def check_team(path: Path) -> None:
    """Read a team file, with the sections of robots that it does not list."""
    load_team(path, robots=robots_named(path))


def reader(document: Any) -> Callable[[Path], object] | None:
    """Return what reads a YAML document; None: another program, or it is a part of a file."""
    keys = {*document}
    if "points" in keys:
        return read_tour
    if "walls" in keys:
        return read_walls
    if "room" in keys:
        return check_scene
    if all(key.startswith("/") for key in keys) and keys != {"/**"}:
        return check_team
    return None


@pytest.mark.parametrize("page", pages_with("yaml"))
def test_yaml_is_read(page: Path, tmp_path: Path) -> None:
    for text in blocks(page, "yaml"):
        read = reader(yaml.safe_load(text))
        if read is not None:
            (tmp_path / "file.yaml").write_text(text, encoding="utf-8")
            read(tmp_path / "file.yaml")


def test_yaml_of_other_readers_is_known() -> None:
    """A new kind of file needs a reader here."""
    unread = {
        key
        for page in PAGES
        for text in blocks(page, "yaml")
        if reader(document := yaml.safe_load(text)) is None
        for key in document
    }
    assert unread <= {"/**", "robots", "bystanders"}  # a driver, parts of a scene


@pytest.mark.parametrize("page", pages_with("xml"))
def test_xml_is_a_launch_file(page: Path) -> None:
    for text in blocks(page, "xml"):
        assert ET.fromstring(text).tag == "launch"

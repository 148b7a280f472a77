"""What a release needs: changelogs, citation, workflows."""

import re
import xml.etree.ElementTree as ET
from importlib import metadata
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
PACKAGE_FOLDERS = ("msgs", "mrs_people_loc", "robot_node", "planner_node")
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yaml"))


@pytest.mark.filterwarnings("ignore:nodes.Node.traverse:DeprecationWarning")  # in catkin_pkg
@pytest.mark.parametrize("folder", PACKAGE_FOLDERS)
def test_changelog_of_package_is_catkins(folder: str) -> None:
    """`catkin_prepare_release` finds "Forthcoming" and makes it the version that bloom reads."""
    changelog = pytest.importorskip("catkin_pkg.changelog")
    tag = pytest.importorskip("catkin_pkg.cli.tag_changelog")
    name = ET.parse(ROOT / folder / "package.xml").getroot().findtext("name")
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
            assert re.fullmatch(r"[\w-]+/[\w-]+@v\d+", step.get("uses", "a/b@v1")), step
    called = set(re.findall(r"\bmake ([a-z-]+)", text))
    makefile = (ROOT / "Makefile").read_text(encoding="utf-8")
    assert called <= set(re.findall(r"^([a-z-]+):", makefile, re.MULTILINE))


def test_there_are_workflows() -> None:
    assert {path.stem for path in WORKFLOWS} >= {"ros", "python", "wheels"}

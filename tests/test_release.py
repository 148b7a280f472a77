"""What a release needs: changelogs, citation, workflows."""

import xml.etree.ElementTree as ET
from importlib import metadata
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).resolve().parents[1]
PACKAGE_FOLDERS = ("msgs", "mrs_people_loc", "robot_node", "planner_node")


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

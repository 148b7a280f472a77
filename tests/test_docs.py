"""The documentation: its links resolve, and the README stays short."""

import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = (".", "docs", "recordings", "mrs_people_loc/scenes")
PAGES = sorted(page for folder in FOLDERS for page in (ROOT / folder).glob("*.md"))
LINK = re.compile(r"\[[^][]*\]\(([^()\s]+)\)")
FILE = re.compile(
    r"`(?:pytest )?((?:bags|config|scenes|docs|mrs_people_loc|msgs|requirements|setup|tests)/"
    r"[\w./-]+\.(?:json|msg|py|rviz|sh|txt|xml|yaml))`"
)
CODE = re.compile(r"^```.*?^```$|`[^`\n]*`", re.DOTALL | re.MULTILINE)


def headings(text: str) -> set[str]:
    """Return the anchors that GitHub gives the headings of a page."""
    lines = re.findall(r"^#+ +(.*?) *$", re.sub(r"(?ms)^```.*?^```$", "", text), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", line.lower()).replace(" ", "-") for line in lines}


def broken_links(page: Path) -> list[str]:
    """Return the relative links of a page whose file or heading does not exist."""
    broken = []
    for link in LINK.findall(CODE.sub("", page.read_text(encoding="utf-8"))):
        if re.match(r"[a-z]+:", link):
            continue
        name, _, anchor = link.partition("#")
        target = page.parent / name if name else page
        if not target.exists() or (
            anchor and anchor not in headings(target.read_text(encoding="utf-8"))
        ):
            broken.append(link)
    return broken


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_relative_links_resolve(page: Path) -> None:
    assert broken_links(page) == []


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_named_files_exist(page: Path) -> None:
    if page.name != "CHANGELOG.md":  # older entries name files that have moved
        named = set(FILE.findall(page.read_text(encoding="utf-8")))
        assert not {name for name in named if not (ROOT / name).is_file()}


def test_broken_links_are_detected(tmp_path: Path) -> None:
    other = tmp_path / "other.md"
    other.write_text("# One heading, and `code`\n```\n# not a heading\n```\n")
    page = tmp_path / "page.md"
    page.write_text(
        "[a](other.md) [b](other.md#one-heading-and-code) [c](https://example.org/x) `[d](no.md)`\n"
        "[e](none.md) [f](other.md#not-a-heading) [g](#nowhere)\n"
    )
    assert broken_links(page) == ["none.md", "other.md#not-a-heading", "#nowhere"]


def test_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 200


def test_every_page_is_reachable_from_the_readme() -> None:
    reached, unread = set(), [ROOT / "README.md"]
    while unread:
        page = unread.pop().resolve()
        if page in reached or page.suffix != ".md":
            continue
        reached.add(page)
        links = LINK.findall(page.read_text(encoding="utf-8"))
        unread += [page.parent / link.partition("#")[0] for link in links if ":" not in link]
    assert not set(PAGES) - reached

"""The documentation: its links resolve, fields of messages are ours, lines are short."""

import re
import runpy
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
FOLDERS = (".", "docs", "docs/tutorials", "studies/labels", "config/scenes")
PAGES = sorted(page for folder in FOLDERS for page in (ROOT / folder).glob("*.md"))
LINK = re.compile(r"\[[^][]*\]\(([^()\s]+)\)")
FILE = re.compile(
    r"`(?:pytest )?((?:bags|config|docs|mrs_people_loc|msgs|planner_node|requirements|robot_node|"
    r"setup|simulation|studies|tests)/"
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


def misread_lines(text: str) -> list[str]:
    """Return the lists and tables that GitHub shows but the site would not, and lost rows.

    Its Markdown wants an empty line before a list, and four spaces before what is inside a list.
    Neither takes rows after an empty line for those of the table before it.
    """
    text = re.sub(r"(?ms)^```.*?^```$", "", text)
    begins = r"(?:[-*] |\d+\. |\|)"
    after_text = rf"(?m)^(?! |#|{begins})\S.*\n((?:[-*]|\d+\.) .*)"
    indented = rf"(?m)^( {{1,3}}{begins}.*)"
    lost_row = r"(?m)^\n( *\|.*)(?!\n *\|[-:| ]+$)$"
    return [line for wrong in (after_text, indented, lost_row) for line in re.findall(wrong, text)]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_lists_are_read_alike_by_github_and_the_site(page: Path) -> None:
    assert misread_lines(page.read_text(encoding="utf-8")) == []


def test_misread_lists_are_detected() -> None:
    text = "# A\n- b\n- c\n    - d\n\ntext\n- e\n\n1. f\n   | g |\n```\ntext\n- h\n```\n"
    assert misread_lines(text) == ["- e", "   | g |"]


def test_rows_that_an_empty_line_parts_from_their_table_are_detected() -> None:
    table = "| a | b |\n|---|:--:|\n| c | |\n"
    assert misread_lines(f"text\n\n{table}\n{table}| d | |\n\ntext\n") == []
    assert misread_lines(f"{table}\n| d | |\n| e | |\n") == ["| d | |"]
    assert misread_lines(f"{table}\n| d | |") == ["| d | |"]


def test_broken_links_are_detected(tmp_path: Path) -> None:
    other = tmp_path / "other.md"
    other.write_text("# One heading, and `code`\n```\n# not a heading\n```\n")
    page = tmp_path / "page.md"
    page.write_text(
        "[a](other.md) [b](other.md#one-heading-and-code) [c](https://example.org/x) `[d](no.md)`\n"
        "[e](none.md) [f](other.md#not-a-heading) [g](#nowhere)\n"
    )
    assert broken_links(page) == ["none.md", "other.md#not-a-heading", "#nowhere"]


def long_lines(text: str) -> list[str]:
    """Return the lines over 100 characters, without those of code, tables, links and results.

    Commands write the results, below a heading that begins with this word.
    """
    text = re.sub(r"(?ms)^ *```.*?^ *```$", "", text.partition("\n## Results")[0])
    lines = [line for line in text.splitlines() if not line.lstrip().startswith("|")]
    return [line for line in lines if len(line) > 100 and len(LINK.sub("", line)) > 80]


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(ROOT)))
def test_lines_are_short(page: Path) -> None:
    assert long_lines(page.read_text(encoding="utf-8")) == []


def test_long_lines_are_detected() -> None:
    long, link = "x " * 51, f"[a]({'b' * 120})"
    text = f"{long}\n| {long}|\n```\n{long}\n```\nsee {link}\n{link}\n## Results\n{long}\n"
    assert long_lines(text) == [long]


DEFINITIONS = sorted([*(ROOT / "msgs").glob("msg/*.msg"), *(ROOT / "msgs").glob("action/*.action")])
TYPE = re.compile(r"^ *([\w/]+(?:\[\d*\])?) +(\w+) *(?:= *(\d+))?", re.MULTILINE)


@pytest.mark.parametrize("path", DEFINITIONS, ids=lambda path: path.stem)
def test_fields_of_messages_are_documented(path: Path) -> None:
    """Names, types and order of the fields in docs/topics.md, and the names of constants."""
    definition = re.sub(r"#.*", "", path.read_text(encoding="utf-8"))
    defined = TYPE.findall(definition)
    page = (ROOT / "docs" / "topics.md").read_text(encoding="utf-8")
    section = page.partition(f"\n### {path.stem}\n")[2].partition("\n### ")[0]
    documented = []
    for names, kind in re.findall(r"^\| (`.*?) \| (\S+) \|", section, re.MULTILINE):
        documented += [(kind, name) for name in re.findall(r"`(\w+)`", names)]
    fields = [(kind, name) for kind, name, value in defined if not value]
    assert sorted(documented) == sorted(fields)
    for _, name, value in defined:
        assert not value or f"{value} {name}" in section


def test_readme_is_short() -> None:
    assert len((ROOT / "README.md").read_text(encoding="utf-8").splitlines()) <= 120


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


def test_site_shows_notebooks_as_pages() -> None:
    pytest.importorskip("tomllib", reason="make docs needs Python 3.11")
    show = runpy.run_path(str(ROOT / "setup" / "docs.py"))["notebook_page"]
    page = show(Path("docs/people_from_a_bag.ipynb"))
    assert page.startswith("# People from a bag\n")
    assert "```python\nfrom mrs_tools.bags import BagRun\n" in page
    assert "```text\n14.4 s of robot_a, robot_b, robot_c\n```" in page
    assert page.count("![](data:image/png;base64,") == 1


def test_check_of_the_site_names_what_is_broken(tmp_path: Path) -> None:
    """As `make docs` calls it on the pages that it has built."""
    pytest.importorskip("tomllib", reason="make docs needs Python 3.11")
    site_errors = runpy.run_path(str(ROOT / "setup" / "docs.py"))["site_errors"]
    (tmp_path / "sub").mkdir()
    (tmp_path / "sub" / "other.html").write_text('<h1 id="a-b">x</h1><a href="../page.html">x</a>')
    page = tmp_path / "page.html"
    page.write_text(
        '<a href="sub/other.html#a-b">x</a><a href="https://example.org/x">x</a><a href="#">x</a>'
        '<link href="data:,x"><a href="/sub/other.html">x</a>'
    )
    assert site_errors(tmp_path) == []
    page.write_text(
        '<a href="sub/other.html#b">x</a><a href="none.html">x</a><a href="#c">x</a>'
        '<img src="https://example.org/x.png"><script src="//example.org/x.js"></script>'
    )
    assert site_errors(tmp_path) == [
        "page.html: sub/other.html#b",
        "page.html: none.html",
        "page.html: #c",
        "page.html: https://example.org/x.png",
        "page.html: //example.org/x.js",
    ]

"""Build the documentation site into .site/html: `make docs`.

The pages that the README leads to are copied to .site/source in the layout of the repository, so
that their links are the same on GitHub and in the site. Any other file that a page links to (a YAML
file, say) becomes a page that shows it. The API reference is generated from the docstrings.

A broken link, anchor or image, a page that is missing in the navigation, and anything that would be
loaded from another host is an error.
"""

from __future__ import annotations

import json
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

import tomllib

ROOT = Path(__file__).resolve().parents[1]
CONFIG = ROOT / "zensical.toml"
SOURCE = ROOT / ".site" / "source"
HTML = ROOT / ".site" / "html"
ASSETS = {".png", ".jpg", ".gif", ".css"}

CODE_OR_LINK = re.compile(
    r"^```.*?^```$|`[^`\n]*`|(?P<text>\[[^][]*\]\()(?P<link>[^()\s:]+)\)", re.DOTALL | re.MULTILINE
)

#: Pages of the API reference, in the order of the data: title, introduction, modules (of
#: `mrs_people_loc` unless they begin with the name of another package).
API: dict[str, tuple[str, str, tuple[str, ...]]] = {
    "images": (
        "Images",
        "From messages of a head to a disparity image.",
        ("head", "sensing.camera", "sensing.images", "sensing.disparity", "sensing.cloud"),
    ),
    "scan": (
        "Scan",
        "From a disparity image to the cells that a robot sends: start at `RobotPipeline.step`. "
        "`bodies` is the default method, `cells` the paper's.",
        ("robot", "scan", "bodies.scanner", "bodies.finder", "bodies.search", "bodies.model")
        + ("cells.scanner", "cells.filters"),
    ),
    "map": (
        "Map",
        "The scans of all robots on one map, for one interval.",
        ("team.poses", "team.intervals", "team.quarantine", "team.fusion", "team.masking"),
    ),
    "clusters": (
        "Clusters",
        "What belongs together on the map: bodies that several robots found (the default method), "
        "clusters of cells (the paper's).",
        ("clusters", "bodies.joining", "bodies.places", "cells.clustering", "cells.splitting"),
    ),
    "people": (
        "People",
        "From clusters to people: start at `Planner.step`.",
        ("planner", "people", "bodies.detector", "cells.detector", "cells.human"),
    ),
    "tracks": (
        "Tracks",
        "People and their groups over time.",
        ("following.tracks", "following.groups", "team.visibility"),
    ),
    "guiding": (
        "Guiding",
        "A tour, the posts of the robots around the group, and how they drive there: "
        "start at `Guide.take_people` and `Guide.velocities`.",
        ("guiding.guide", "guiding.tour", "guiding.way", "guiding.guidance", "guiding.formation")
        + (
            "guiding.tour_control",
            "guiding.pace",
            "guiding.steering",
            "guiding.drive",
            "guiding.free_space",
            "guiding.progress",
        ),
    ),
    "localization": (
        "Localization",
        "Where the robots are.",
        ("localization.robot_localization", "localization.localizer", "localization.odometry")
        + ("localization.shared", "localization.walls.walls", "localization.walls.ranges"),
    ),
    "bags": (
        "Bags",
        "Recordings, and what the method makes of them: start at `BagRun`.",
        ("mrs_tools.bags.offline", "mrs_tools.bags.sources", "mrs_tools.bags.records")
        + ("mrs_tools.bags.truth", "mrs_tools.bags.reader", "mrs_tools.bags.writer"),
    ),
    "shared": (
        "Shared",
        "Configuration, errors, geometry, and the codes of `/diagnostics`. Every parameter, with "
        "its meaning and default, is in [default.yaml](../config/default.yaml.md).",
        ("config.robot", "config.planner", "config.guide", "config.files")
        + ("config.parameters", "errors", "geometry", "health.findings"),
    ),
}


def copy_page(page: Path) -> set[Path]:
    """Copy a page into SOURCE and return the files that it links to, all relative to ROOT."""
    linked = set()

    def site_link(match: re.Match[str]) -> str:
        name, mark, anchor = (match["link"] or "").partition("#")
        if not name:
            return match[0]  # code, or a heading of the same page
        target = (ROOT / page).parent / name
        if not target.is_file():
            sys.exit(f"{page}: {name} is not a file of the repository")
        linked.add(target.resolve().relative_to(ROOT))
        if target.suffix not in {".md", *ASSETS}:
            name += ".md"
        return f"{match['text']}{name}{mark}{anchor})"

    text = CODE_OR_LINK.sub(site_link, (ROOT / page).read_text(encoding="utf-8"))
    write(page, text)
    return linked


def notebook_page(path: Path) -> str:
    """Return a Markdown page that shows a notebook: its texts, code, and what that gave."""
    parts = []
    for cell in json.loads((ROOT / path).read_text(encoding="utf-8"))["cells"]:
        source = "".join(cell["source"])
        parts.append(source if cell["cell_type"] == "markdown" else f"```python\n{source}\n```")
        for output in cell.get("outputs", ()):
            if output["output_type"] == "stream":
                parts.append("```text\n" + "".join(output["text"]).rstrip() + "\n```")
            else:
                parts.append(f"![](data:image/png;base64,{output['data']['image/png']})")
    return "\n\n".join(parts) + "\n"


def write(page: Path, text: str) -> None:
    """Write a page of SOURCE."""
    target = SOURCE / page
    target.parent.mkdir(parents=True, exist_ok=True)
    target.write_text(text, encoding="utf-8")


def copy_pages() -> set[str]:
    """Copy all that the README leads to, and return its Markdown pages."""
    copied: set[Path] = set()
    waiting = {Path("README.md"), Path("docs/site.css")}
    while waiting:
        path = waiting.pop()
        copied.add(path)
        if path.suffix == ".md":
            waiting |= copy_page(path) - copied
        elif path.suffix in ASSETS:
            write(path, "")
            shutil.copy(ROOT / path, SOURCE / path)
        elif path.suffix == ".ipynb":
            write(path.with_name(f"{path.name}.md"), notebook_page(path))
        else:
            text = (ROOT / path).read_text(encoding="utf-8").rstrip()
            language = path.suffix.lstrip(".") or "text"
            write(
                path.with_name(f"{path.name}.md"),
                f"# {path.name}\n\n`{path}`\n\n````{language}\n{text}\n````\n",
            )
    return {str(path) for path in copied if path.suffix == ".md"}


def full_name(module: str) -> str:
    """Return the name by which a module of `API` is imported."""
    return module if module.startswith("mrs_tools.") else f"mrs_people_loc.{module}"


def write_api() -> set[str]:
    """Write the pages of the API reference, and return them."""
    for name, (title, introduction, modules) in API.items():
        parts = [f"# {title}", introduction, *(f"::: {full_name(m)}" for m in modules)]
        write(Path("api", f"{name}.md"), "\n\n".join(parts) + "\n")
    return {f"api/{name}.md" for name in API}


def nav_pages(nav: Any) -> Iterator[str]:
    """Yield the pages of a navigation."""
    if isinstance(nav, str):
        yield nav
    else:
        for entry in nav.values() if isinstance(nav, dict) else nav:
            yield from nav_pages(entry)


def check_navigation(pages: set[str]) -> None:
    """End with an error unless the navigation lists exactly these pages."""
    listed = set(nav_pages(tomllib.loads(CONFIG.read_text(encoding="utf-8"))["project"]["nav"]))
    if listed != pages:
        sys.exit(f"{CONFIG.name}: nav misses {pages - listed}, and lists {listed - pages}")


class _Page(HTMLParser):
    """What a page of the site contains.

    Attributes:
        links: Addresses that a reader may follow.
        loaded: Addresses that the browser loads with the page: scripts, style sheets, images.
        anchors: What a link may end with, behind the #.
    """

    def __init__(self, path: Path) -> None:
        super().__init__()
        self.links: list[str] = []
        self.loaded: list[str] = []
        self.anchors = {""}
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """Collect the addresses and anchors of an element."""
        values = {name: value for name, value in attrs if value}
        if "id" in values:
            self.anchors.add(values["id"])
        addresses = [values[name] for name in ("href", "src") if name in values]
        (self.links if tag == "a" else self.loaded).extend(addresses)


def site_errors(site: Path) -> list[str]:
    """Return the broken links of a site, and what its pages load from other hosts."""
    pages = {path.resolve(): _Page(path) for path in sorted(site.rglob("*.html"))}
    errors = []
    for path, page in pages.items():
        for address in (*page.links, *page.loaded):
            url = urlsplit(address)
            if url.scheme or url.netloc:
                wrong = address in page.loaded and url.scheme != "data"
            else:
                folder = site.resolve() if url.path.startswith("/") else path.parent
                target = (folder / unquote(url.path).lstrip("/")).resolve() if url.path else path
                wrong = not target.is_file() or (
                    target in pages and unquote(url.fragment) not in pages[target].anchors
                )
            if wrong:
                errors.append(f"{path.relative_to(site.resolve())}: {address}")
    return errors


def run(*command: str | Path) -> None:
    """Run a command of this environment; end with its exit code if it fails."""
    program, *arguments = command
    run = subprocess.run([Path(sys.executable).with_name(str(program)), *arguments], cwd=ROOT)
    if run.returncode:
        sys.exit(run.returncode)


def main() -> None:
    """Build and check the site."""
    for folder in (SOURCE, HTML):
        shutil.rmtree(folder, ignore_errors=True)
    check_navigation(copy_pages() | write_api())
    run("zensical", "build", "--clean", "--strict")
    errors = site_errors(HTML)
    if errors:
        sys.exit("\n".join(["Broken, or on another host:", *errors]))
    folder = HTML.relative_to(ROOT)
    print(
        f"\nOpen {folder}/index.html in a browser. Its search works only over HTTP: run\n"
        f"    python3 -m http.server --directory {folder}\n"
        "and open http://localhost:8000/"
    )


if __name__ == "__main__":
    main()

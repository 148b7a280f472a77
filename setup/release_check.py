"""Says what a release of the version in pyproject.toml still lacks: `make release-check`."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from typing import Any

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

ROOT = Path(__file__).resolve().parents[1]
#: In `[project.urls]`.
URLS = ("Homepage", "Repository", "Issues")


def missing(project: dict[str, Any]) -> list[str]:
    """Return what a release lacks, in words.

    Args:
        project: The table `project` of pyproject.toml.
    """
    found = [
        f"pyproject.toml: maintainers: {each['email']} is a placeholder"
        for each in project["maintainers"]
        if each["email"].endswith("@example.org")
    ]
    urls = project.get("urls", {})
    found += [f"pyproject.toml: [project.urls]: no {name}" for name in URLS if name not in urls]
    if "\nrepository-code: " not in (ROOT / "CITATION.cff").read_text(encoding="utf-8"):
        found.append("CITATION.cff: no repository-code")
    heading = rf"^(## )?{re.escape(project['version'])} \(\d{{4}}-\d\d-\d\d\)$"
    for path in (ROOT / "CHANGELOG.md", *sorted(ROOT.glob("*/CHANGELOG.rst"))):
        if not re.search(heading, path.read_text(encoding="utf-8"), re.MULTILINE):
            name = path.relative_to(ROOT)
            found.append(f"{name}: no section '{project['version']} (YYYY-MM-DD)'")
    return found


def main() -> None:
    """Print what is missing; the exit code is 1 then."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    if found := missing(project):
        sys.exit("\n  ".join(["Not ready to release:", *found]))
    print(f"Ready to release {project['version']}.")


if __name__ == "__main__":
    main()

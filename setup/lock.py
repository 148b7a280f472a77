"""Resolve requirements/lock.txt and requirements/docs.txt again: `make lock`.

Pins everything that `.[all]`, and the documentation site, needs, with the newest compatible
versions, for each Python that the project supports; differences between them get a marker. (`pip
freeze` is no alternative: some ROS wheels report a version that no index has.) What the demo does
not need gets the groups that do, as a comment: setup/install.sh installs by them.
"""

from __future__ import annotations

import json
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib import metadata
from pathlib import Path
from typing import NamedTuple

from packaging.requirements import Requirement
from packaging.utils import canonicalize_name

PYTHONS = ("3.10", "3.11", "3.12", "3.13")
ROOT = Path(__file__).resolve().parents[1]
#: Groups of extras, beside those that every target needs.
GROUPS = {
    "sim": {"plots", "sim", "convert"},
    "test": {"test"},
    "lint": {"lint"},
    "fuzz": {"fuzz"},
}
HEADER = """\
# Pinned by `make lock` from pyproject.toml's extra `{}`; do not edit by hand.
# Install with --no-deps: the list is whole.{}
"""
OF_GROUPS = """
# After a second #: the groups that need it (GROUPS in setup/lock.py); else `make demo` does."""


def find_python(version: str) -> str:
    """Return a working interpreter of that version."""
    command = [str(ROOT / "setup" / "find-python.sh"), version]
    found = subprocess.run(command, capture_output=True, text=True, check=False)
    if found.returncode:
        sys.exit(f"make lock needs all of Python {', '.join(PYTHONS)}: {version} was not found.")
    return found.stdout.strip()


def requirements_of(extra: str) -> list[str]:
    """Return what an extra of this project asks for, without the project's own dependencies."""
    given = map(Requirement, metadata.requires("mrs-people-loc") or [])
    return [f"{one.name}{one.specifier}" for one in given if f'"{extra}"' in str(one.marker)]


class Resolved(NamedTuple):
    """What pip would install with an interpreter.

    Attributes:
        pins: name -> version.
        needs: name -> its requirements; of this project, too.
    """

    pins: dict[str, str]
    needs: dict[str, list[Requirement]]

    def closure(self, extras: set[str], environment: dict[str, str]) -> set[str]:
        """Return the names of all that this project needs with these extras."""
        found: set[tuple[str, str]] = set()
        new = {("mrs-people-loc", extra) for extra in extras}
        while new:
            found |= new
            new = {
                (str(canonicalize_name(need.name)), extra)
                for name, of in new
                for need in self.needs.get(name, [])
                if not need.marker or need.marker.evaluate({**environment, "extra": of})
                for extra in {"", *need.extras}
            } - found
        return {name for name, _ in found}


def resolve(python: str, folder: Path, requirements: Sequence[str]) -> Resolved:
    """Return everything that pip would install with that interpreter."""
    subprocess.run([python, "-m", "venv", folder], check=True)
    report = folder / "report.json"
    pip = [f"{folder}/bin/python", "-m", "pip", "--quiet", "--disable-pip-version-check"]
    options = ["--dry-run", "--ignore-installed", "--report", str(report)]
    run = subprocess.run(
        [*pip, "install", *options, *requirements],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    if run.returncode:
        sys.exit(f"{python}: {run.stderr}")
    resolved = Resolved({}, {})
    for item in json.loads(report.read_text())["install"]:
        name = canonicalize_name(item["metadata"]["name"])
        needs = item["metadata"].get("requires_dist", [])
        resolved.needs[name] = [Requirement(need) for need in needs]
        if "dir_info" not in item["download_info"]:  # this project has no pin
            resolved.pins[name] = item["metadata"]["version"]
    return resolved


def groups_of(resolved: dict[str, Resolved]) -> dict[str, str]:
    """Return name -> comment with the groups that need it."""
    groups: dict[str, set[str]] = {}
    for python, each in resolved.items():
        environment = {"python_version": python, "python_full_version": f"{python}.0"}
        always = each.closure({"", "ros", "tools", "view", "build"}, environment)
        for group, extras in GROUPS.items():
            for name in each.closure(extras, environment) - always:
                groups.setdefault(name, set()).add(group)
    return {name: f"  # {' '.join(sorted(of))}" for name, of in groups.items()}


def marker(pythons: list[str]) -> str:
    """Return the marker that selects these versions, which follow each other in PYTHONS."""
    first, last = (PYTHONS.index(python) for python in (pythons[0], pythons[-1]))
    assert list(PYTHONS[first : last + 1]) == pythons, f"a gap in {pythons}"
    if 0 < first == last < len(PYTHONS) - 1:
        return f' ; python_version == "{pythons[0]}"'
    limits = []
    if first > 0:
        limits.append(f'python_version >= "{pythons[0]}"')
    if last < len(PYTHONS) - 1:
        limits.append(f'python_version <= "{pythons[-1]}"')
    return f" ; {' and '.join(limits)}" if limits else ""


def lock_lines(resolved: dict[str, Resolved], groups: dict[str, str]) -> list[str]:
    """Merge the pins of all Pythons into requirement lines."""
    lines = []
    for name in sorted(set().union(*(each.pins for each in resolved.values()))):
        taken_by: dict[str, list[str]] = {}  # version of the package -> Pythons that take it
        for python, each in resolved.items():
            if name in each.pins:
                taken_by.setdefault(each.pins[name], []).append(python)
        lines += [
            f"{name}=={version}{marker(pythons)}{groups.get(name, '')}"
            for version, pythons in taken_by.items()
        ]
    return lines


def write_lock(name: str, extra: str, pythons: Sequence[str], requirements: Sequence[str]) -> None:
    """Resolve for every Python (two at a time) and write requirements/NAME."""
    interpreters = [find_python(version) for version in pythons]
    with tempfile.TemporaryDirectory() as temporary, ThreadPoolExecutor(2) as pool:
        print(f"Resolving for Python {', '.join(pythons)} (a few minutes) ...", flush=True)
        folders = [Path(temporary, version) for version in pythons]
        each = pool.map(resolve, interpreters, folders, [requirements] * len(pythons))
        resolved = dict(zip(pythons, each, strict=True))
    groups = groups_of(resolved) if extra == "all" else {}
    header = HEADER.format(extra, OF_GROUPS if groups else "")
    path = ROOT / "requirements" / name
    path.write_text(header + "\n".join(lock_lines(resolved, groups)) + "\n")
    counts = ", ".join(f"{len(resolved[version].pins)} for {version}" for version in resolved)
    print(f"Wrote {path.relative_to(ROOT)}: {counts}.")


def main() -> None:
    """Write both."""
    write_lock("lock.txt", "all", PYTHONS, [".[all]"])
    # Zensical does not support Python 3.10.
    write_lock("docs.txt", "docs", PYTHONS[1:], requirements_of("docs"))


if __name__ == "__main__":
    main()

"""Resolve requirements/lock.txt and requirements/docs.txt anew: `make lock`.

Pins everything that `.[all]`, and the documentation site, needs, with the newest compatible
versions, for each Python that the project supports; differences between them get a marker. (`pip
freeze` is no alternative: some ROS wheels report a version that no index has.)
"""

from __future__ import annotations

import json
import re
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib import metadata
from pathlib import Path

from packaging.requirements import Requirement

PYTHONS = ("3.10", "3.11", "3.12", "3.13")
ROOT = Path(__file__).resolve().parents[1]
HEADER = """\
# Pinned by `make lock` from pyproject.toml's extra `{}`; do not edit by hand.
# Install with --no-deps: the list is whole.
"""


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


def resolve(python: str, folder: Path, requirements: Sequence[str]) -> dict[str, str]:
    """Return name -> version of everything that pip would install with that interpreter."""
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
    pins = {}
    for item in json.loads(report.read_text())["install"]:
        if "dir_info" in item["download_info"]:
            continue  # this project
        name = re.sub(r"[-_.]+", "-", item["metadata"]["name"]).lower()
        pins[name] = item["metadata"]["version"]
    return pins


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


def lock_lines(pins: dict[str, dict[str, str]]) -> list[str]:
    """Merge the pins (Python -> name -> version) into requirement lines."""
    lines = []
    for name in sorted(set().union(*pins.values())):
        taken_by: dict[str, list[str]] = {}  # version of the package -> Pythons that take it
        for python in pins:
            if name in pins[python]:
                taken_by.setdefault(pins[python][name], []).append(python)
        lines += [f"{name}=={version}{marker(pythons)}" for version, pythons in taken_by.items()]
    return lines


def write_lock(name: str, extra: str, pythons: Sequence[str], requirements: Sequence[str]) -> None:
    """Resolve for every Python (two at a time) and write requirements/NAME."""
    interpreters = [find_python(version) for version in pythons]
    with tempfile.TemporaryDirectory() as temporary, ThreadPoolExecutor(2) as pool:
        print(f"Resolving for Python {', '.join(pythons)} (a few minutes) ...", flush=True)
        folders = [Path(temporary, version) for version in pythons]
        resolved = pool.map(resolve, interpreters, folders, [requirements] * len(pythons))
        pins = dict(zip(pythons, resolved, strict=True))
    path = ROOT / "requirements" / name
    path.write_text(HEADER.format(extra) + "\n".join(lock_lines(pins)) + "\n")
    print(f"Wrote {path.relative_to(ROOT)}: {', '.join(f'{len(pins[v])} for {v}' for v in pins)}.")


def main() -> None:
    """Write both."""
    write_lock("lock.txt", "all", PYTHONS, [".[all]"])
    # Zensical does not support Python 3.10.
    write_lock("docs.txt", "docs", PYTHONS[1:], requirements_of("docs"))


if __name__ == "__main__":
    main()

"""Starts nodes many times over: each in a process of its own, forked when all is loaded.

A node takes a second or two to start, nearly all of it loading. Run as a script: takes
`[[executable, [argument, ...], {variable: value, ...}], ...]` on standard input as JSON, and gives
`[[exit code, what it wrote], ...]` on standard output. Only for starts that end by themselves.
"""

from __future__ import annotations

import importlib
import json
import os
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import IO, NamedTuple


class Start(NamedTuple):
    """A start of `robot_node`, `planner_node` or `guide_node`.

    Attributes:
        executable: Which one.
        arguments: Of the command line.
        variables: Added to the environment.
    """

    executable: str
    arguments: Sequence[str]
    variables: Mapping[str, str] = {}


def ends_of(starts: Sequence[Start], folder: Path) -> list[tuple[int, str]]:
    """Exit code and output of each of these starts, in a working folder."""
    done = subprocess.run(
        [sys.executable, __file__],
        input=json.dumps(starts),
        capture_output=True,
        text=True,
        timeout=110,
        check=False,
        cwd=folder,
    )
    assert done.returncode == 0, done.stderr
    return [(code, output) for code, output in json.loads(done.stdout)]


def start(executable: str, arguments: list[str], variables: dict[str, str], log: IO[bytes]) -> int:
    """Starts a node, and waits until it ends; gives its exit code."""
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
    os.environ.update(variables)
    for stream in (1, 2):
        os.dup2(log.fileno(), stream)
    sys.argv = [executable, *arguments]
    try:
        module = {"guide_node": "planner_node.guide_node"}.get(executable, executable)
        importlib.import_module(f"{module}.__main__").main()
        code: object = "main() came back"
    except SystemExit as end:
        code = end.code
    except BaseException:
        sys.excepthook(*sys.exc_info())
        code = 1
    sys.stdout.flush()
    sys.stderr.flush()
    os._exit(code if isinstance(code, int) else 99)


def main() -> None:
    """Starts all."""
    for name in (
        "robot_node.node",
        "planner_node.node",
        "planner_node.guide_node.node",
        "mrs_ros.running",
    ):
        importlib.import_module(name)
    results = []
    for executable, arguments, variables in json.load(sys.stdin):
        with tempfile.TemporaryFile() as log:
            code = start(executable, arguments, variables, log)
            log.seek(0)
            results.append([code, log.read().decode(errors="replace")])
    json.dump(results, sys.stdout)


if __name__ == "__main__":
    main()

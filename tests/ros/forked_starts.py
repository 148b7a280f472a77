"""Starts nodes many times over: each in a process of its own, forked when all is loaded.

A node takes a second or two to start, nearly all of it loading. Run as a script: takes
`[[executable, [argument, ...]], ...]` on standard input as JSON, and gives
`[[exit code, what it wrote], ...]` on standard output. Only for starts that end by themselves.
"""

from __future__ import annotations

import importlib
import json
import os
import sys
import tempfile
from typing import IO


def start(executable: str, arguments: list[str], log: IO[bytes]) -> int:
    """Starts a node, and waits until it ends; gives its exit code."""
    child = os.fork()
    if child:
        return os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
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
    for executable, arguments in json.load(sys.stdin):
        with tempfile.TemporaryFile() as log:
            code = start(executable, arguments, log)
            log.seek(0)
            results.append([code, log.read().decode(errors="replace")])
    json.dump(results, sys.stdout)


if __name__ == "__main__":
    main()

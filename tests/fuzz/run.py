"""Runs the coverage-guided fuzzer (atheris, on libFuzzer) on the targets of `targets.py`.

    python tests/fuzz/run.py all .fuzz -max_total_time=60       # options are libFuzzer's
    python tests/fuzz/run.py image,scan .fuzz --short           # so many runs as the targets say
    python tests/fuzz/run.py image .fuzz .fuzz/image-crash-...  # this input again

Each target has its corpus in a folder of its name, which grows. An input that raises something else
than our errors, takes more than 20 s or asks for more than 4 GB is left beside them, and the
exit code is 1.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import resource
import sys
import warnings
from collections.abc import Callable, Sequence
from pathlib import Path

import atheris

#: An allocation above this fails, whether it is ever used or not [bytes].
MEMORY = 4 << 30
TIMEOUT_S = 20

with atheris.instrument_imports(
    include=[
        "mrs_people_loc",
        "mrs_tools.bags.checks",
        "mrs_tools.bags.message_types",
        "mrs_tools.bags.reader",
        "mrs_tools.bags.sources",
        "mrs_tools.bags.truth",
        "mrs_tools.bags.writer",
        "mrs_tools.diagnosis",
        "mrs_tools.live",
        "mrs_studies.recordings",
        "mrs_people_sim",
        "mrs_tools.view.protocol",
        "rosbags.rosbag2",
        "pypcd4",
        "yaml",
    ]
):
    sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
    from fuzz.targets import TARGETS, Target
    from mrs_people_loc.errors import PeopleLocError


@atheris.instrument_func
def planted(data: bytes) -> None:
    """What is no error of ours, three bytes deep: for the test that the fuzzer finds such."""
    if data[:1] == b"m" and data[1:2] == b"r" and data[2:3] == b"s":
        raise KeyError("planted")


def fuzz(target: Target, corpus: Path, options: Sequence[str]) -> None:
    """Fuzzes one target; never returns."""
    corpus.mkdir(parents=True, exist_ok=True)
    for seed in target.seeds():
        (corpus / f"seed-{hashlib.sha1(seed).hexdigest()[:12]}").write_bytes(seed)
    limits = [
        f"-max_len={target.max_length}",
        f"-timeout={TIMEOUT_S}",
        f"-artifact_prefix={corpus}-",
    ]
    if "--short" in options:
        options = [f"-runs={target.runs}", "-seed=1"]
    if all(option.startswith("-") for option in options):
        options = [*options, str(corpus)]
    resource.setrlimit(resource.RLIMIT_AS, (MEMORY, MEMORY))
    atheris.Setup([sys.argv[0], *limits, *options], only_our_errors(target.take))
    atheris.Fuzz()


def only_our_errors(take: Callable[[bytes], None]) -> Callable[[bytes], None]:
    """The same, without the errors that are allowed."""

    def taken(data: bytes) -> None:
        with contextlib.suppress(PeopleLocError):
            take(data)

    return taken


def main() -> int:
    """Fuzzes one target after the other, each in a process of its own."""
    names, folder, *options = sys.argv[1:]
    warnings.simplefilter("error", RuntimeWarning)  # as in the tests: nothing overflows unnoticed
    targets = {**TARGETS, "planted": Target(planted, lambda: [b"abc"], 3, 100_000)}
    failed = []
    for name in TARGETS if names == "all" else names.split(","):
        print(f"---- {name}", flush=True)
        child = os.fork()  # instrumenting what is imported takes seconds; once is enough
        if child == 0:
            fuzz(targets[name], Path(folder, name), options)
        _, status = os.waitpid(child, 0)
        if status:
            failed.append(name)
    print(f"---- failed: {', '.join(failed)}" if failed else "---- nothing found", flush=True)
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())

"""The coverage-guided fuzzer in its short form; `make fuzz` is the long one."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

import pytest

from fuzz.targets import TARGETS

FUZZ = Path(__file__).with_name("run.py")


@pytest.mark.parametrize("name", TARGETS)
def test_seeds_are_accepted_by_their_targets(name: str) -> None:
    """The fuzzer starts from accepted inputs; the targets raise if a seed is refused."""
    for seed in TARGETS[name].seeds():
        assert len(seed) <= TARGETS[name].max_length
        TARGETS[name].take(seed)


def fuzz(*arguments: object) -> subprocess.CompletedProcess[str]:
    if importlib.util.find_spec("atheris") is None:
        assert not os.environ.get("CI"), "atheris is not installed"
        pytest.skip("atheris is not installed")
    return subprocess.run(
        [sys.executable, str(FUZZ), *map(str, arguments)],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        errors="replace",
        check=False,
    )


@pytest.mark.slow
@pytest.mark.timeout(600)  # 20 s of one core
def test_targets_raise_only_our_errors(tmp_path: Path) -> None:
    done = fuzz("all", tmp_path, "--short")
    assert done.returncode == 0, done.stdout[-5000:]
    assert "---- nothing found" in done.stdout
    for name, target in TARGETS.items():
        assert f"Done {target.runs} runs" in done.stdout.partition(f"---- {name}\n")[2]


@pytest.mark.slow
@pytest.mark.timeout(300)
def test_fuzzer_finds_planted_exception(tmp_path: Path) -> None:
    """Three consecutive bytes: 16 million random tries, some thousand with coverage."""
    done = fuzz("planted", tmp_path, "-runs=200000", "-seed=1")
    assert done.returncode == 1
    assert "KeyError" in done.stdout
    assert "---- failed: planted" in done.stdout
    assert len([*tmp_path.glob("planted-crash-*")]) == 1

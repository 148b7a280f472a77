"""Public recordings that are not part of this repository: `../shared/data`, beside a checkout."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

DATA = Path(__file__).resolve().parents[2] / "shared" / "data"


def shared_data(*parts: str) -> Path:
    """A file or folder of `../shared/data`; without it the test is skipped, and fails in CI."""
    path = DATA.joinpath(*parts)
    if not path.exists():
        text = f"../shared/data/{'/'.join(parts)} is not there"
        (pytest.fail if os.environ.get("CI") else pytest.skip)(text)
    return path

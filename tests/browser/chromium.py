"""Headless Chromium for the tests of the page."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest
from playwright.sync_api import Browser, Page, sync_playwright

CHROMIUM = Path(os.environ.get("MRS_CHROMIUM", "/usr/bin/chromium"))
_OPTIONS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)


@contextmanager
def open_browser() -> Iterator[Browser]:
    """Starts Chromium; a test that needs it is skipped without it, in CI it fails."""
    if not CHROMIUM.exists():
        reason = f"there is no {CHROMIUM} (Debian's package chromium, or set MRS_CHROMIUM)"
        if os.environ.get("CI") == "true":
            pytest.fail(reason)
        pytest.skip(reason)
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(executable_path=CHROMIUM, args=_OPTIONS)
        yield browser
        browser.close()


def wait_until(page: Page, condition: str) -> None:
    """Waits for a condition in JavaScript on `map` and `scene`, the page's own."""
    page.evaluate(
        f"""async () => {{
            const {{ map, scene }} = await import("./main.js");
            while (!({condition})) await new Promise((go) => setTimeout(go, 20));
        }}"""
    )


def settled(page: Page) -> None:
    """Waits until the page shows the whole made-up scene, and draws no more."""
    page.locator("#people tbody tr").first.wait_for(state="attached")
    page.locator("#summary li").first.wait_for(state="attached")
    wait_until(page, "map._grid && !map._frame")

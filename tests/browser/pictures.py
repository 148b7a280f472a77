"""Pictures of the page with the made-up scene: `python tests/browser/pictures.py` makes them again.

Those in `tests/browser/pictures/` are what the tests compare with; `docs/view.png` shows the page.
"""

from __future__ import annotations

import base64
import sys
from io import BytesIO
from pathlib import Path

import numpy as np
from PIL import Image
from playwright.sync_api import Page

ROOT = Path(__file__).resolve().parents[2]
REFERENCES = ROOT / "tests" / "browser" / "pictures"
DOCS = ROOT / "docs" / "view.png"
#: References are smaller than the map by this: letters are rendered differently elsewhere.
_SHRUNK = 4
#: Gives the map a size and a view of its own, and waits until that is drawn.
_SET_VIEW = """async ([width, height]) => {
    const { map } = await import("./main.js");
    Object.assign(map.element.style, { width: `${width}px`, height: `${height}px` });
    map.mode = "free";
    const ready = () => map.view.width === width && map.view.height === height;
    while (!ready()) await new Promise(requestAnimationFrame);
    Object.assign(map.view, { x: 10, y: 4.2, scale: width / 21 });
    map.invalidate();
    await new Promise(requestAnimationFrame);
    return map.canvas.toDataURL().split(",")[1];
}"""


def map_picture(page: Page, width: int = 640, height: int = 320) -> np.ndarray:
    """The whole map of the made-up scene, shrunk: height x width x 3, uint8."""
    png = base64.b64decode(page.evaluate(_SET_VIEW, [width, height]))
    picture = Image.open(BytesIO(png)).convert("RGB")
    size = (width // _SHRUNK, height // _SHRUNK)
    return np.asarray(picture.resize(size, Image.Resampling.BOX))


def difference(one: np.ndarray, other: np.ndarray) -> float:
    """How different pictures are where they differ most: the largest mean of 10 x 10 pixels."""
    apart = np.abs(one.astype(float) - other).mean(axis=2)
    rows, columns = (side // 10 * 10 for side in apart.shape)
    blocks = apart[:rows, :columns].reshape(rows // 10, 10, columns // 10, 10)
    return float(blocks.mean(axis=(1, 3)).max())


def _make_pictures() -> None:
    from browser import synthetic_scene as scene
    from browser.chromium import open_browser, settled
    from browser.page_server import PageServer

    server = PageServer(scene.hello(), *scene.everything())
    with open_browser() as browser:
        for scheme in ("light", "dark"):
            page = browser.new_page(color_scheme=scheme, reduced_motion="reduce")
            page.goto(server.url)
            settled(page)
            REFERENCES.mkdir(exist_ok=True)
            Image.fromarray(map_picture(page)).save(REFERENCES / f"map_{scheme}.png")
        page = browser.new_page(
            color_scheme="light", reduced_motion="reduce", viewport={"width": 1200, "height": 640}
        )
        page.goto(server.url)
        settled(page)
        for step in range(1, 30):
            server.show(scene.state(scene.T0 - 6 + 0.2 * step, with_tour=True))
            page.wait_for_timeout(50)  # for trails: faster states are left out
        page.get_by_role("button", name="Person 6").click()
        picture = Image.open(BytesIO(page.screenshot()))
        picture.convert("P", palette=Image.Palette.ADAPTIVE, colors=256).save(DOCS, optimize=True)
    server.end()


if __name__ == "__main__":
    sys.path.insert(0, str(ROOT / "tests"))
    _make_pictures()

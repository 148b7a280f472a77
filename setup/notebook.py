"""Run the notebooks of the documentation and store what their cells print and draw.

    .venv/bin/python setup/notebook.py docs/people_from_a_bag.ipynb

Jupyter is not needed. The cells run one after the other in the repository's folder, as a reader's
do; tests/test_snippets.py holds what is stored against what they print today.
"""

from __future__ import annotations

import base64
import contextlib
import io
import json
import os
import sys
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]


def run_cells(notebook: dict[str, Any]) -> None:
    """Run the cells of a notebook in one namespace, and put their outputs into it."""
    import matplotlib.pyplot as plt

    space: dict[str, Any] = {}
    cells = [cell for cell in notebook["cells"] if cell["cell_type"] == "code"]
    for number, cell in enumerate(cells, start=1):
        printed = io.StringIO()
        with contextlib.redirect_stdout(printed):
            exec(compile("".join(cell["source"]), f"<cell {number}>", "exec"), space)
        cell["execution_count"], cell["outputs"] = number, []
        if printed.getvalue():
            text = printed.getvalue().splitlines(keepends=True)
            cell["outputs"].append({"name": "stdout", "output_type": "stream", "text": text})
        for figure in map(plt.figure, plt.get_fignums()):
            drawn = io.BytesIO()
            figure.savefig(drawn, format="png", dpi=80, metadata={"Software": None})
            data = {"image/png": base64.b64encode(drawn.getvalue()).decode("ascii")}
            shown = {"data": data, "metadata": {}, "output_type": "display_data"}
            cell["outputs"].append(shown)
        plt.close("all")


def main() -> None:
    """Run the notebooks that are named."""
    os.environ["MPLBACKEND"] = "Agg"
    paths = [Path(name).resolve() for name in sys.argv[1:]]
    os.chdir(ROOT)
    for path in paths:
        notebook = json.loads(path.read_text(encoding="utf-8"))
        run_cells(notebook)
        path.write_text(json.dumps(notebook, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()

"""`mrs fit`: fits the body model to bags with ground truth.

    mrs simulate --suite train OUT_DIR/train
    mrs simulate --suite train --variants 20 OUT_DIR/more
    mrs fit OUT_DIR/*/*/ --out mrs_people_loc/mrs_people_loc/body_model.json

Each candidate of each view is an example: a person if somebody truly is there, none if nobody is
near. What is in between, and what is another robot of the team (the planner knows where those
are), is left out. Figures printed are cross-validated: each bag is judged by a model that has not
seen it. Meshes of the user's own that were rendered (`mrs simulate --assets`) are listed in the
model, with their licences.
"""

from __future__ import annotations

import functools
import json
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any

import typer

from mrs_tools.common import progress_bar, write_text
from mrs_tools.fitting.body_fit import fit
from mrs_tools.fitting.examples import Examples, assets_of, examples_of
from mrs_tools.fitting.validation import cross_validate, figures, table


def _read(bag: Path, number: int, **options: Any) -> Examples:
    import cv2

    cv2.setNumThreads(1)
    return examples_of(bag, number, **options)


def command(
    bags: Annotated[list[Path], typer.Argument(help="Bags of `mrs simulate`.")],
    out: Annotated[Path, typer.Option(help="Where the model goes (JSON).")],
    config: Annotated[
        list[Path] | None, typer.Option("--config", "-c", help="Parameter file of the team.")
    ] = None,
    views: Annotated[
        int, typer.Option(help="Views of each robot and bag that are used, at most.", min=1)
    ] = 8,
    jobs: Annotated[int, typer.Option("--jobs", "-j", min=1, help="Bags at the same time.")] = 1,
) -> None:
    """Fit the body model to bags with ground truth."""
    read = functools.partial(_read, configs=config or [], views=views)
    parts = []
    with progress_bar() as progress, ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        task = progress.add_task("reading", total=len(bags))
        for part in pool.map(read, bags, range(len(bags))):
            parts.append(part)
            progress.advance(task)
    examples = Examples.concatenate(parts)
    judged = cross_validate(examples)
    for name, value in figures(examples, judged).items():
        typer.echo(f"{name}: {value:.5g}")
    typer.echo("\n".join(table(examples, judged)))
    model = fit(examples).to_mapping()
    if assets := assets_of(bags):
        model["assets"] = assets
    text = json.dumps(model, separators=(",", ":")) + "\n"
    write_text(out, text)
    typer.echo(f"{out}: {len(text) / 1000:.0f} kB")

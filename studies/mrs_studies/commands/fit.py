"""`mrs fit`: fits the body model to bags with ground truth.

    mrs render-suite train OUT_DIR/train
    mrs render-suite train OUT_DIR/more --variants 12
    mrs fit OUT_DIR/*/*/ --out body_model.json

Each candidate of each view is an example: a person if somebody truly is there, none if nobody is
near. What is in between, and what is another robot of the team (the planner knows where those
are), is left out. Figures printed are cross-validated: each bag is judged by a model that has not
seen it. The networks of the appearance are trained beforehand (`train_network.py`); only the
weights of what they see are fitted.

    mrs fit OUT_DIR/*/*/ --real RECORDINGS --out ...

adds labelled recordings of real rooms (as of `mrs real`) to the fit of the weights by which the
human test and the appearance count, and `--rooms PICTURES` the rooms without people that are for
fitting (as of `mrs rooms`); the rest of the model is fitted to renderings alone.
"""

from __future__ import annotations

import functools
import itertools
import json
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any

import typer

from mrs_people_loc.arrays import Float
from mrs_people_loc.bodies.appearance import Scores
from mrs_people_loc.errors import FloorError
from mrs_people_sim.common import progress_bar, write_text
from mrs_studies import LABELS
from mrs_studies.experiment.real_rooms import Recording, find_recordings
from mrs_studies.fitting.body_fit import Parts, check_enough, combination
from mrs_studies.fitting.examples import (
    Examples,
    empty_examples,
    examples_of,
    labelled_examples,
)
from mrs_studies.fitting.validation import cross_validate, figures, real_rooms, table
from mrs_studies.recordings.empty_rooms import ROOMS, Half
from mrs_tools.options import Configs


def _read(bag: Path, number: int, **options: Any) -> Examples:
    import cv2

    cv2.setNumThreads(1)
    return examples_of(bag, number, **options)


def command(
    bags: Annotated[list[Path], typer.Argument(help="Bags of `mrs render-suite`.")],
    out: Annotated[Path, typer.Option(help="Where the model goes (JSON).")],
    config: Configs = None,
    views: Annotated[
        int, typer.Option(help="Views of each robot and bag that are used, at most.", min=1)
    ] = 8,
    jobs: Annotated[int, typer.Option("--jobs", "-j", min=1, help="Bags at the same time.")] = 1,
    rooms: Annotated[
        Path | None,
        typer.Option(help="Checkouts of the rooms without people, as of `mrs rooms`."),
    ] = None,
    real: Annotated[
        Path | None,
        typer.Option(help="Folder of labelled bags of real rooms, as of `mrs real`."),
    ] = None,
    labels: Annotated[
        Path | None,
        typer.Option(help="Folder of their label files.", show_default="studies/labels"),
    ] = None,
) -> None:
    """Fit the body model to bags with ground truth."""
    if labels is not None and real is None:
        raise typer.BadParameter("--labels needs --real, the folder of the recordings")
    read = functools.partial(_read, configs=config or [], views=views)
    parts = []
    with progress_bar() as progress, ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        task = progress.add_task("reading", total=len(bags))
        for part in pool.map(read, bags, range(len(bags))):
            parts.append(part)
            progress.advance(task)
    examples = Examples.joined(parts)
    check_enough(examples)
    judged, scores = cross_validate(examples)
    for name, value in figures(examples, judged).items():
        typer.echo(f"{name}: {value:.5g}")
    typer.echo("\n".join(table(examples, judged)))
    fitted = Parts.fit(examples)
    recordings: list[Recording] = []
    if real is not None:
        recordings, missing = find_recordings(real, labels or LABELS)
        for line in missing:
            typer.echo(line, err=True)
    room_of, real_parts = _of_recordings(recordings)
    if rooms is not None:
        for name, part in _of_rooms(rooms, len(real_parts)):
            room_of.append(name)
            real_parts.append(part)
    weights = _combination(examples, scores, fitted, room_of, real_parts)
    model = fitted.model(weights).to_mapping()
    model["fitted_to"] = {
        "bags": len(bags),
        "px_m": [round(float(examples.scale.min()), 1), round(float(examples.scale.max()), 1)],
        "people": int(examples.person.sum()),
        "others": int((examples.clear & ~examples.person).sum()),
        "rooms": sorted(set(room_of)),
    }
    text = json.dumps(model, separators=(",", ":")) + "\n"
    write_text(out, text)
    typer.echo(f"{out}: {len(text) / 1000:.0f} kB")


def _of_recordings(recordings: Sequence[Recording]) -> tuple[list[str], list[Examples]]:
    """Room and examples of each recording."""
    # lab1_c1 and lab2_c1 are of one room: the letters that a name begins with.
    rooms = ["".join(itertools.takewhile(str.isalpha, one.name)) for one in recordings]
    return rooms, [labelled_examples(one.bag, one.labels, k) for k, one in enumerate(recordings)]


def _of_rooms(folder: Path, first: int) -> list[tuple[str, Examples]]:
    """Names and examples of the rooms for fitting; their bags count from `first`."""
    found: list[tuple[str, Examples]] = []
    for room in (room for room in ROOMS if room.half == Half.FITTING.value):
        views = [view for _, view in room.views(folder) if not isinstance(view, FloorError)]
        if views:
            found.append((room.name, empty_examples(views, first + len(found))))
    return found


def _combination(
    examples: Examples,
    scores: Scores,
    fitted: Parts,
    rooms: Sequence[str],
    real_parts: Sequence[Examples],
) -> Float:
    """Weights of the combination; prints them, and figures of the real rooms."""
    real = Examples.joined(real_parts) if real_parts else None
    if real is not None and len(set(rooms)) > 1:
        typer.echo("\n".join(real_rooms(examples, scores, real, rooms, fitted)))
    weights = combination(examples, scores, real, fitted)
    names = ("human", "above", "network", "constant")
    typer.echo(", ".join(f"{n} {w:.3g}" for n, w in zip(names, weights, strict=True)))
    return weights

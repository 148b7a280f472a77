"""`mrs evaluate`: bags through the pipeline, scored against their ground truth."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import typer

from mrs_people_loc import timing
from mrs_people_sim.common import progress_bar, write_json
from mrs_people_sim.evaluation.labels import labels_at
from mrs_people_sim.evaluation.results import Result, as_json, evaluate_bag, names_of
from mrs_people_sim.evaluation.tables import show
from mrs_people_sim.options import JsonFile
from mrs_tools.bags.sources import overridden_beside
from mrs_tools.options import Configs, OwnConfig
from mrs_tools.plain import plain


def command(
    bags: Annotated[list[Path], typer.Argument(help="Bags with our topics.")],
    config: Configs = None,
    json_file: JsonFile = None,
    recorded: Annotated[
        bool, typer.Option("--recorded", help="Score the people that the bag has recorded.")
    ] = False,
    plots: Annotated[
        Path | None, typer.Option("--plots", help="Draw errors and stages into this folder.")
    ] = None,
    own_config: OwnConfig = True,
    use_map: Annotated[
        bool, typer.Option("--map", help="Mask walls and furniture by the bag's /map.")
    ] = False,
    labels: Annotated[
        Path | None,
        typer.Option(help="Hand labels: a file, or a folder of NAME.labels.json of each bag."),
    ] = None,
    tracking: Annotated[
        bool | None,
        typer.Option(
            "--tracking/--no-tracking",
            help="Follow people, or take each interval by itself, whatever the files say.",
        ),
    ] = None,
    localize: Annotated[
        bool,
        typer.Option("--localize", help="Robots correct odometry that drifts, as their nodes do."),
    ] = False,
    jobs: Annotated[int, typer.Option("--jobs", "-j", min=1, help="Bags at the same time.")] = 1,
) -> None:
    """Run bags through the pipeline, as fast as it goes, and score them against their truth.

    Robots are found in the bag as namespaces with images, or with points and poses; a bag that has
    neither but `tracked_people` is scored as recorded. JSON: for one bag an object, for several
    `{"bags": {name: object}, "total": object}`.
    """
    from rich.console import Console
    from rich.text import Text

    console = Console(highlight=False, soft_wrap=True)
    names = names_of(bags)
    for bag in bags if own_config and not recorded else ():
        if overridden := overridden_beside(bag, config or []):
            console.print(Text(plain(overridden)), style="yellow")
    options = {
        "configs": config or [],
        "recorded": recorded,
        "beside": own_config,
        "use_map": use_map,
        "labels": labels,
        "tracking": tracking,
        "localize": localize,
    }
    results = dict(zip(names, _evaluate(bags, options, jobs), strict=True))
    show(results, console)
    if json_file is not None:
        write_json(json_file, as_json(results))
    if plots is not None:
        from mrs_people_sim.figures.files import save
        from mrs_people_sim.figures.result_figures import figures_of_results

        files = save(figures_of_results(results), plots)
        console.print(f"{len(files)} pictures in {plots}: {', '.join(f.name for f in files)}")


def _evaluate(bags: Sequence[Path], options: Mapping[str, Any], jobs: int) -> Iterator[Result]:
    """Evaluates bags, in their order, with a progress bar."""
    with progress_bar() as progress:
        task = progress.add_task("", total=len(bags))
        if jobs > 1 and len(bags) > 1:
            with ProcessPoolExecutor(min(jobs, len(bags))) as pool:
                futures = [pool.submit(_one, bag, options) for bag in bags]
                progress.update(task, description=f"{len(bags)} bags")
                for _ in as_completed(futures):
                    progress.advance(task)
                yield from (future.result() for future in futures)
            return
        for index, bag in enumerate(bags):
            progress.update(task, description=bag.name)
            yield _one(bag, options, _Advance(progress, task, index))


@dataclass
class _Advance:
    """Moves a bar to a part of one of its steps."""

    progress: Any
    task: Any
    step: int

    def __call__(self, part: float) -> None:
        self.progress.update(self.task, completed=self.step + part)


def _one(
    bag: Path, options: Mapping[str, Any], on_progress: Callable[[float], None] | None = None
) -> Result:
    import cv2

    # Times are those of one core, whatever else the machine does.
    cv2.setNumThreads(1)
    labels = None if options["labels"] is None else labels_at(options["labels"], bag)
    with timing.processor_time():
        return evaluate_bag(bag, **{**options, "labels": labels}, on_progress=on_progress)

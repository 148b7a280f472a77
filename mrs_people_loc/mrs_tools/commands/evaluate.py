"""`mrs evaluate`: bags through the pipeline, scored against their ground truth.

The rules of the score are at the top of `mrs_tools.scoring.positions`, for who is who of
`mrs_tools.scoring.tracks`, and for stragglers of `mrs_tools.scoring.stragglers`. In Python:

    result = evaluate_bag("scene.mcap", ["config/default.yaml"])
    result.report()["people"]["recall"]
"""

from __future__ import annotations

import json
import os
from collections import defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import numpy as np
import typer

from mrs_people_loc import timing
from mrs_people_loc.config import Groups, PlannerConfig
from mrs_people_loc.errors import BagError, PeopleLocError
from mrs_tools.bags.offline import (
    TRUTH_TOPIC,
    BagRun,
    Interval,
    View,
    estimate_of,
    has_people,
    read_recorded,
    read_truth,
    robots_of,
)
from mrs_tools.bags.rosbag import BagReader
from mrs_tools.plain import plain
from mrs_tools.scoring.positions import Estimate, Frame, Truth, percentile, ratio, score, summary
from mrs_tools.scoring.stragglers import StragglerScores, score_centres, score_stragglers
from mrs_tools.scoring.tracks import TrackScores, score_tracks

if TYPE_CHECKING:
    from rich.console import Console

#: What is counted of each view, in the order of the stages.
STAGES = ("valid_pixels", "raw", "zones", "noise", "cells")


@dataclass
class Result:
    """What the evaluation of one bag, or of several pooled, gave.

    Attributes:
        frames: One per ground-truth message.
        tracks: What the scores of identities and velocities are made of.
        stragglers: What the scores of stragglers are made of.
        duration_s: From the first to the last message of the bag [s].
        counts: By robot, for each of its views the numbers named in `STAGES`.
        times_ms: By stage, what it took each time [ms]; `robot` and `planner` are what one view
            and one interval took altogether.
        estimates: What was found, one per interval.
        truth: What is true; None for several bags.
        notes: What a reader of the result should know.
    """

    frames: list[Frame] = field(default_factory=list)
    tracks: TrackScores = field(default_factory=TrackScores)
    stragglers: StragglerScores = field(default_factory=StragglerScores)
    duration_s: float = 0.0
    counts: dict[str, list[tuple[float, ...]]] = field(default_factory=dict)
    times_ms: dict[str, list[float]] = field(default_factory=dict)
    estimates: list[Estimate] = field(default_factory=list)
    truth: Truth | None = None
    notes: list[str] = field(default_factory=list)

    @classmethod
    def pooled(cls, results: Sequence[Result]) -> Result:
        """Several results as one; robots of one name count as one robot.

        People and identities of one bag are not those of another.
        """
        total = cls()
        for result in results:
            total.frames += result.frames
            total.tracks += result.tracks
            total.stragglers += result.stragglers
            total.duration_s += result.duration_s
            for robot, rows in result.counts.items():
                total.counts.setdefault(robot, []).extend(rows)
            for stage, times in result.times_ms.items():
                total.times_ms.setdefault(stage, []).extend(times)
        return total

    def report(self) -> dict[str, Any]:
        """The figures, as the JSON of `mrs evaluate` has them; what is undefined is None."""
        scores = summary(self.frames)
        return {
            "frames": scores["frames"],
            "duration_s": self.duration_s,
            "people": scores["people"],
            "group": scores["group"],
            "tracks": self.tracks.report(),
            "stragglers": self.stragglers.report(),
            "stages": {robot: _stage_means(rows) for robot, rows in sorted(self.counts.items())},
            "timing_ms": {
                stage: {"median": percentile(times, 50), "p99": percentile(times, 99)}
                for stage, times in self.times_ms.items()
            },
        }


def _stage_means(rows: Sequence[tuple[float, ...]]) -> dict[str, float | None]:
    means = dict(zip(STAGES, np.mean(np.array(rows), axis=0).tolist(), strict=True))
    kept = {
        f"{stage}_kept": ratio(means[stage], means[before])
        for before, stage in pairwise(STAGES[1:])
    }
    return {**means, **kept, "removed": means["raw"] - means["cells"]}


def evaluate_bag(
    bag: str | os.PathLike[str] | BagRun,
    configs: Sequence[str | Path] = (),
    *,
    recorded: bool = False,
    beside: bool = True,
    use_map: bool = False,
    on_interval: Callable[[Interval], None] | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> Result:
    """Runs a bag through the pipeline, or reads what a planner said, and scores it.

    Args:
        bag: The bag; or a `BagRun`, which may have another pipeline and planner.
        configs: Parameter files of the team, later ones win; not with a `BagRun`.
        recorded: Score the `people` in the bag. A bag that has them and no robot's images or
            `points` is scored so anyway.
        beside: Whether the bag's own parameter file is read, see `BagRun`.
        use_map: Whether its `/map` masks walls and furniture, likewise.
        on_interval: Called with each interval that is run.
        on_progress: Called with how much of the bag is done, 0 to 1.

    Raises:
        PeopleLocError: The bag or a file cannot be used.
    """
    if isinstance(bag, BagRun):
        result = Result(truth=bag.truth(), duration_s=bag.duration_s)
        _run(bag, result, on_interval, on_progress)
        return _scored(result, bag.team.planner.groups)
    with BagReader(bag) as reader:
        if recorded or (not robots_of(reader) and has_people(reader)):
            result = Result(truth=read_truth(reader), duration_s=reader.duration_s)
            topic, result.estimates = read_recorded(reader)
            result.notes.append(f"scored as recorded on {topic}")
            return _scored(result, PlannerConfig().groups)
    run = BagRun(bag, configs, beside=beside, use_map=use_map)
    return evaluate_bag(run, on_interval=on_interval, on_progress=on_progress)


def _scored(result: Result, groups: Groups) -> Result:
    assert result.truth is not None
    if not len(result.truth):
        result.notes.append(f"no {TRUTH_TOPIC}: nothing to compare with")
    frames = score(result.truth, result.estimates)
    result.frames = score_centres(result.truth, frames, result.estimates, config=groups)
    result.tracks = score_tracks(result.truth, result.frames, result.estimates)
    result.stragglers = score_stragglers(
        result.truth, result.frames, result.estimates, config=groups
    )
    return result


def _run(
    run: BagRun,
    result: Result,
    on_interval: Callable[[Interval], None] | None,
    on_progress: Callable[[float], None] | None,
) -> None:
    times: defaultdict[str, list[float]] = defaultdict(list)

    def on_view(view: View) -> None:
        stages = view.stages
        result.counts.setdefault(view.robot, []).append(
            (
                float(np.isfinite(stages.disparity).mean()),
                *(float(len(part)) for part in (stages.cloud, stages.zones, stages.noise)),
                float(len(stages.scan.cells)),
            )
        )
        for stage, took in view.times_ms.items():
            times[stage].append(took)
        times["robot"].append(sum(view.times_ms.values()))

    of_planner: defaultdict[str, list[float]] = defaultdict(list)
    for interval in run.intervals(on_view=on_view, on_progress=on_progress):
        if on_interval is not None:
            on_interval(interval)
        result.estimates.append(estimate_of(interval.people))
        for stage, took in interval.people.times_ms.items():
            of_planner[stage].append(took)
        of_planner["planner"].append(sum(interval.people.times_ms.values()))
    result.times_ms = {**times, **of_planner}
    result.notes += run.notes
    result.notes += [f"not used: {what} ({count})" for what, count in run.dropped.items()]


# --------------------------------------------------------------------------------------- command


def names_of(bags: Sequence[Path]) -> list[str]:
    """Short names of bags: as much of the end of their paths as tells them apart."""
    paths = [Path(os.path.abspath(bag)) for bag in bags]
    names = [path.stem if path.suffix == ".mcap" else path.name for path in paths]
    for depth in range(2, max((len(path.parts) for path in paths), default=0) + 1):
        names = [
            name if names.count(name) == 1 else "/".join(path.parts[-depth:])
            for name, path in zip(names, paths, strict=True)
        ]
    if len(set(names)) < len(names):
        raise BagError(f"a bag is named twice: {', '.join(sorted(map(str, bags)))}")
    return names


#: Whether a bag's own parameter file is read.
OwnConfig = Annotated[
    bool,
    typer.Option(
        "--own-config/--no-own-config",
        help="Read a parameter file of the bag's name that lies beside it, after the others.",
    ),
]


def command(
    bags: Annotated[list[Path], typer.Argument(help="Bags with our topics.")],
    config: Annotated[
        list[Path] | None,
        typer.Option(
            "--config",
            "-c",
            help="Parameter file: parameters and mounting of each robot; later win.",
        ),
    ] = None,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the figures to this file.")
    ] = None,
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
    jobs: Annotated[int, typer.Option("--jobs", "-j", min=1, help="Bags at the same time.")] = 1,
) -> None:
    """Run bags through the pipeline, as fast as it goes, and score them against their truth.

    Robots are found in the bag as namespaces with images, or with points and pose; a bag that has
    neither but `people` is scored as recorded. JSON: for one bag an object, for several
    `{"bags": {name: object}, "total": object}`.
    """
    from rich.console import Console

    console = Console(highlight=False, soft_wrap=True)
    names = names_of(bags)
    options = {
        "configs": config or [],
        "recorded": recorded,
        "beside": own_config,
        "use_map": use_map,
    }
    results = dict(zip(names, _evaluate(bags, options, jobs), strict=True))
    show(results, console)
    if json_file is not None:
        write_json(results, json_file)
    if plots is not None:
        from mrs_tools.commands import plot as figures

        files = figures.save(figures.figures_of_results(results), plots)
        console.print(f"{len(files)} pictures in {plots}: {', '.join(f.name for f in files)}")


def progress_bar() -> Any:
    """A progress bar on the terminal, nothing where there is none; to be used in a `with`."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    return Progress(
        TextColumn("{task.description}", markup=False),
        BarColumn(),
        TextColumn("{task.percentage:3.0f} %"),
        TimeRemainingColumn(),
        console=console,
        transient=True,
        disable=not console.is_terminal,
    )


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
    with timing.processor_time():
        return evaluate_bag(bag, **options, on_progress=on_progress)


def as_json(results: Mapping[str, Result]) -> dict[str, Any]:
    """The figures of one bag, or of several and of all of them pooled."""
    if len(results) == 1:
        return next(iter(results.values())).report()
    return {
        "bags": {name: result.report() for name, result in results.items()},
        "total": Result.pooled(list(results.values())).report(),
    }


def write_json(results: Mapping[str, Result], path: Path) -> None:
    """Writes `as_json`.

    Raises:
        PeopleLocError: The file cannot be written.
    """
    write_text(path, json.dumps(as_json(results), indent=2, allow_nan=False) + "\n")


def write_text(path: Path, text: str) -> None:
    """Writes a file.

    Raises:
        PeopleLocError: It cannot be written.
    """
    try:
        path.write_text(text, "utf-8")
    except OSError as err:
        raise PeopleLocError(f"{path}: cannot be written ({err.strerror or err})") from err


# ---------------------------------------------------------------------------------------- tables


def show(results: Mapping[str, Result], console: Console) -> None:
    """Prints the figures as tables."""
    from rich.text import Text

    rows = dict(results)
    if len(results) > 1:
        rows["total"] = Result.pooled(list(results.values()))
    reports = {name: result.report() for name, result in rows.items()}
    console.print(_people_table(reports))
    if any(result.tracks.tracks for result in rows.values()):
        console.print(_tracks_table(reports))
    if any(result.stragglers.observed_s for result in rows.values()):
        console.print(_stragglers_table(reports))
    last = reports[next(reversed(reports))]
    if last["stages"]:
        console.print(_stages_table(last["stages"]))
    if last["timing_ms"]:
        console.print(_timing_table(last["timing_ms"]))
    for name, result in results.items():
        for note in result.notes:
            console.print(Text(plain(f"{name}: {note}")), style="yellow")


def _table(title: str) -> Any:
    from rich import box
    from rich.table import Table
    from rich.text import Text

    # Text: a unit such as [ms] would be taken for markup.
    return Table(
        title=Text(title), title_justify="left", box=box.SIMPLE_HEAD, show_edge=False, padding=0
    )


def _people_table(reports: Mapping[str, Mapping[str, Any]]) -> Any:
    from rich.text import Text

    table = _table("people (errors in cm; in 95%: truth is in the 95 % ellipse)")
    table.add_column("bag", overflow="fold", min_width=8)
    for column in ("frames", "true", "found", "recall", "prec.", "mean", "p95", "max"):
        table.add_column(column, justify="right", no_wrap=True)
    table.add_column("in 95%", justify="right", no_wrap=True)
    table.add_column("centre", justify="right", no_wrap=True)
    for name, report in reports.items():
        people, error = report["people"], report["people"]["error_m"]
        table.add_row(
            Text(plain(name)),
            *(str(n) for n in (report["frames"], people["true"], people["matched"])),
            *(_number(people[key], 1, 3) for key in ("recall", "precision")),
            *(_number(error[key], 100, 1) for key in ("mean", "p95", "max")),
            _number(people["coverage_95"], 1, 3),
            _number(report["group"]["centre_error_m"]["mean"], 100, 1),
            style="bold" if name == "total" else None,
        )
    return table


def _tracks_table(reports: Mapping[str, Mapping[str, Any]]) -> Any:
    from rich.text import Text

    table = _table("tracks (switches; per person and minute; MOTP, GOSPA in cm; velocity in cm/s)")
    table.add_column("bag", overflow="fold", min_width=8)
    for column in ("MOTA", "IDF1", "switches", "/min", "frag."):
        table.add_column(column, justify="right", no_wrap=True)
    for column in ("MOTP", "GOSPA", "v mean", "p95"):
        table.add_column(column, justify="right", no_wrap=True)
    for name, report in reports.items():
        tracks, velocity = report["tracks"], report["tracks"]["velocity_error_mps"]
        table.add_row(
            Text(plain(name)),
            *(_number(tracks[key], 1, 3) for key in ("mota", "idf1")),
            _number(tracks["id_switches"], 1, 0),
            _number(tracks["switches_per_person_minute"], 1, 2),
            _number(tracks["fragments"], 1, 0),
            *(_number(tracks[key], 100, 1) for key in ("motp_m", "gospa")),
            *(_number(velocity[key], 100, 1) for key in ("mean", "p95")),
            style="bold" if name == "total" else None,
        )
    return table


def _stragglers_table(reports: Mapping[str, Mapping[str, Any]]) -> Any:
    from rich.text import Text

    table = _table("stragglers (delay of flags in s; false flags)")
    table.add_column("bag", overflow="fold", min_width=8)
    columns = ("true", "flagged", "in 1 s", "delay", "max", "unseen", "false", "minutes")
    for column in columns:
        table.add_column(column, justify="right", no_wrap=True)
    for name, report in reports.items():
        found = report["stragglers"]
        table.add_row(
            Text(plain(name)),
            *(_number(found[key], 1, 0) for key in ("true", "flagged")),
            _number(found["within_1_s"], 1, 3),
            *(_number(found["delay_s"][key], 1, 2) for key in ("mean", "max")),
            *(_number(found[key], 1, 0) for key in ("unseen", "false")),
            _number(found["minutes"], 1, 1),
            style="bold" if name == "total" else None,
        )
    return table


def _stages_table(stages: Mapping[str, Mapping[str, float | None]]) -> Any:
    from rich.text import Text

    table = _table(
        "stages: means per view, the share kept of the stage before, and what all of them remove"
    )
    table.add_column("robot")
    for column in ("valid pixels", "raw", "zones", "noise", "cells", "removed"):
        table.add_column(column, justify="right", no_wrap=True)
    for robot, means in stages.items():
        table.add_row(
            Text(plain(robot)),
            f"{_number(means['valid_pixels'], 100, 0)} %",
            _number(means["raw"], 1, 0),
            *(
                f"{_number(means[s], 1, 0)} {_number(means[f'{s}_kept'], 100, 1):>5} %"
                for s in ("zones", "noise", "cells")
            ),
            _number(means["removed"], 1, 0),
        )
    return table


def _timing_table(timing: Mapping[str, Mapping[str, float | None]]) -> Any:
    table = _table("time [ms]")
    for column in ("stage", "median", "p99"):
        table.add_column(column, justify="left" if column == "stage" else "right")
    for stage, times in timing.items():
        whole = stage in ("robot", "planner")
        table.add_row(
            f"whole {stage}" if whole else stage,
            *(_number(times[which], 1, 2) for which in ("median", "p99")),
            style="bold" if whole else None,
        )
    return table


def _number(value: float | None, factor: float, digits: int) -> str:
    return "-" if value is None else f"{value * factor:.{digits}f}"

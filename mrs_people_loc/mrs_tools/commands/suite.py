"""`mrs suite`: the published suite, rendered, run and scored; what each step of the method gives.

    mrs suite FOLDER                      the test half with paper.yaml and default.yaml
    mrs suite FOLDER --steps              and every step from the one to the other
    mrs suite FOLDER --steps --out docs/suite.md

Bags that are in the folder already are not rendered again. Recorded walks are left out where the
recordings are not there (--tracks).
"""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any

import typer
import yaml

from mrs_people_loc.config import PLANNER_NODE, ROBOT_NODE, PlannerConfig, RobotConfig
from mrs_people_loc.errors import PeopleLocError
from mrs_tools.commands.evaluate import Result, evaluate_bag, progress_bar, write_text
from mrs_tools.commands.simulate import simulate_suite, suite_file, suite_scenes, with_tracks
from mrs_tools.installing import default_file
from mrs_tools.simulation.scene import Scene

#: Activities of scenes in which people stand.
_STAND = ("stand", "talk", "close")
#: Kinds of scenes, each with a row of its own.
STANDING, WALKING, GROUP, RECORDED = "standing", "walking", "walking group", "recorded walks"
KINDS = (STANDING, WALKING, GROUP, RECORDED)
#: Kinds that are together in rows of no kind, and that every step is run on. Walks are ten times
#: as long: only the first and the last step are run on them.
SHORT = (STANDING, WALKING)


def kind_of(scene: Scene) -> str:
    """Which of `KINDS` a scene is."""
    if scene.tracks:
        return RECORDED
    if scene.layout.activity == "group":
        return GROUP
    return STANDING if scene.layout.activity in _STAND else WALKING


@dataclass(frozen=True)
class Step:
    """One step from the paper's method to ours.

    Attributes:
        name: Its name in tables.
        robot: Parameters of robots that it sets, by dotted name.
        planner: Parameters of the planner, likewise.
    """

    name: str
    robot: Mapping[str, Any]
    planner: Mapping[str, Any]


def steps() -> list[Step]:
    """From paper.yaml to default.yaml, one step after the other; each keeps those before it."""
    robot, planner = (
        {parameter.name: parameter.default for parameter in kind.parameters()}
        for kind in (RobotConfig, PlannerConfig)
    )

    def default(*names: str) -> dict[str, Any]:
        return {name: robot.get(name, planner.get(name)) for name in names}

    return [
        Step("the printed method", {}, {}),
        Step(
            "block 7, holes filled from block 11, pre-filter cap 63, from 0.7 m",
            default(
                "disparity.block_size_px",
                "disparity.fill_block_size_px",
                "disparity.pre_filter_cap",
                "disparity.min_range",
            ),
            {},
        ),
        Step(
            "bodies sought in bearing and inverse range",
            {
                "bodies.search": True,
                "bodies.human_test": False,
                "bodies.vote": False,
                "bodies.axis": False,
            },
            {
                "joining.min_score": 0.0,
                "joining.line_of_sight": False,
                "masking.robot_radius": 0.0,
                "joining.fragment_gate": 0.0,
                **default("splitting.max_width"),
            },
        ),
        Step("covariances long along the line of sight", {}, default("joining.line_of_sight")),
        Step("robots of the team are no people", {}, default("masking.robot_radius")),
        Step("one voted disparity per body", default("bodies.vote"), {}),
        Step("human test", default("bodies.human_test"), default("joining.min_score")),
        Step("from the surface to the axis", default("bodies.axis"), {}),
        Step("fragments of a person are that person", {}, default("joining.fragment_gate")),
        Step("people are followed from interval to interval", {}, default("tracking.enabled")),
    ]


@contextmanager
def _config_file(robot: Mapping[str, Any], planner: Mapping[str, Any]) -> Iterator[Path]:
    """A parameter file for the whole team."""
    document = {
        f"/**/{node}": {"ros__parameters": dict(values)}
        for node, values in ((ROBOT_NODE, robot), (PLANNER_NODE, planner))
        if values
    }
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder, "step.yaml")
        file.write_text(yaml.safe_dump(document), "utf-8")
        yield file


def _one(bag: Path, configs: Sequence[Path]) -> Result:
    import cv2

    cv2.setNumThreads(1)
    return evaluate_bag(bag, configs)


@dataclass(frozen=True)
class Row:
    """Results of one configuration.

    Attributes:
        name: Its name.
        results: By scene.
        kinds: Which of `KINDS` each scene is.
    """

    name: str
    results: Mapping[str, Result]
    kinds: Mapping[str, str]

    def report(self, *kinds: str) -> dict[str, Any]:
        """Figures over the scenes of some kinds; if none is named, over those of `SHORT`."""
        people: dict[str, Any] = self._pooled(*kinds).report()["people"]
        return people

    def tracks(self, *kinds: str) -> dict[str, Any]:
        """Figures of who is who, likewise."""
        return self._pooled(*kinds).tracks.report()

    def centre(self, *kinds: str) -> float | None:
        """Mean error of the groups' centre of gravity [m], likewise."""
        mean: float | None = self._pooled(*kinds).report()["group"]["centre_error_m"]["mean"]
        return mean

    def stragglers(self, *kinds: str) -> dict[str, Any]:
        """Figures of stragglers, likewise."""
        return self._pooled(*kinds).stragglers.report()

    def _pooled(self, *kinds: str) -> Result:
        return Result.pooled(
            [r for name, r in self.results.items() if self.kinds[name] in (kinds or SHORT)]
        )


def run_suite(
    scenes: list[Scene],
    folder: Path,
    *,
    paper: Path,
    every_step: bool = False,
    jobs: int = 1,
    on_progress: Any = None,
) -> list[Row]:
    """Renders scenes that are missing and runs all of them.

    Args:
        scenes: The scenes.
        folder: Where their bags are or go.
        paper: The paper's parameters.
        every_step: All steps on scenes of `SHORT`, or only the first and the last one.
        jobs: Processes.
        on_progress: Called with what is done and the share of it, 0 to 1.

    Raises:
        PeopleLocError: Something cannot be read or written.
    """
    said = on_progress or (lambda what, share: None)
    done = iter(range(1, len(scenes) + 1))
    bags = simulate_suite(
        scenes, folder, jobs=jobs, on_scene=lambda _: said("rendering", next(done) / len(scenes))
    )
    kinds = {scene.name: kind_of(scene) for scene in scenes}
    ladder = steps()
    robot: dict[str, Any] = {}
    planner: dict[str, Any] = {}
    rows = []
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        for number, step in enumerate(ladder):
            robot, planner = {**robot, **step.robot}, {**planner, **step.planner}
            chosen = bags
            if 0 < number < len(ladder) - 1:
                chosen = [bag for bag in bags if kinds[bag.name] in SHORT]
                if not (every_step and chosen):
                    continue
            with _config_file(robot, planner) as file:
                configs = [paper, file]
                found = pool.map(_one, chosen, [configs] * len(chosen))
                results = {}
                for count, (bag, result) in enumerate(zip(chosen, found, strict=True), 1):
                    results[bag.name] = result
                    said(step.name, count / len(chosen))
            rows.append(Row(step.name, results, kinds))
    return rows


# ---------------------------------------------------------------------------------------- tables

_HEAD = ("recall", "precision", "mean [cm]", "p95 [cm]", "in 95 %")
_TRACKS_HEAD = ("MOTA", "IDF1", "velocity [m/s]", "switches", "per person and minute")


def _number(value: float | None, factor: float, digits: int) -> str:
    return "-" if value is None else f"{value * factor:.{digits}f}"


def _figures(people: Mapping[str, Any]) -> list[str]:
    error = people["error_m"]
    return [
        _number(people["recall"], 1, 3),
        _number(people["precision"], 1, 3),
        _number(error["mean"], 100, 1),
        _number(error["p95"], 100, 1),
        _number(people["coverage_95"], 1, 3),
    ]


def _track_figures(tracks: Mapping[str, Any]) -> list[str]:
    return [
        _number(tracks["mota"], 1, 3),
        _number(tracks["idf1"], 1, 3),
        _number(tracks["velocity_error_mps"]["mean"], 1, 2),
        _number(tracks["id_switches"], 1, 0),
        _number(tracks["switches_per_person_minute"], 1, 2),
    ]


def _stragglers(found: Mapping[str, Any]) -> str:
    """A sentence on the stragglers; "" if there are no groups in the truth."""
    if found["minutes"] is None:
        return ""
    in_time = round((found["within_1_s"] or 0.0) * found["true"])
    delay = found["delay_s"]
    took = "" if not found["flagged"] else (
        f", after {_number(delay['mean'], 1, 2)} s on average and {_number(delay['max'], 1, 2)} s "
        "at most"
    )  # fmt: skip
    minutes = _number(found["minutes"], 1, 1)
    return (
        f"Stragglers of the walking groups: {found['flagged']} of {found['true']} flagged, "
        f"{in_time} of them within 1 s of crossing the limit{took}; "
        f"{found['false']} false flags in {minutes} minutes."
    )


def markdown(rows: Sequence[Row], half: str) -> str:
    """The results as tables in Markdown."""
    first, last = rows[0], rows[-1]
    there = {first.kinds[name] for name in first.results}
    chosen = [(f", {kind}", kind) for kind in KINDS if kind in SHORT or kind in there]
    lines = [f"## Results on the {half} half", ""]
    lines += _table(
        ("", "people", *_HEAD),
        [
            [f"{file}{label}", str(report["true"]), *_figures(report)]
            for row, file in ((first, "paper.yaml"), (last, "default.yaml"))
            for label, kinds in (("", ()), *((label, (kind,)) for label, kind in chosen))
            for report in (row.report(*kinds),)
        ],
    )
    explained = "With default.yaml; velocity, and the groups' centre, are mean errors."
    lines += ["", "## Who is who", "", explained, ""]
    lines += _table(
        ("", *_TRACKS_HEAD, "centre [cm]"),
        [
            [label, *_track_figures(last.tracks(*kinds)), _number(last.centre(*kinds), 100, 1)]
            for label, kinds in (("standing and walking", ()), *((k, (k,)) for _, k in chosen))
        ],
    )
    if sentence := _stragglers(last.stragglers(GROUP)):
        lines += ["", sentence]
    if len(rows) > 2:
        lines += [
            "",
            "## What each step gives",
            "",
            "Each step keeps those above it. Without the walking groups.",
            "",
        ]
        lines += _table(("step", *_HEAD), [[row.name, *_figures(row.report())] for row in rows])
    lines += [
        "",
        "## Scene by scene",
        "",
        "With default.yaml; in brackets with paper.yaml.",
        "",
    ]
    lines += _table(
        ("scene", "people", *_HEAD, *_TRACKS_HEAD[:-1]),
        [
            [
                name,
                str(result.report()["people"]["true"]),
                *(
                    f"{new} ({old})"
                    for new, old in zip(
                        _figures(result.report()["people"]),
                        _figures(first.results[name].report()["people"]),
                        strict=True,
                    )
                ),
                *_track_figures(result.tracks.report())[:-1],
            ]
            for name, result in last.results.items()
        ],
    )
    return "\n".join(lines) + "\n"


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> list[str]:
    bar = "|---" + "|---:" * (len(head) - 1) + "|"
    return [f"| {' | '.join(head)} |", bar, *(f"| {' | '.join(row)} |" for row in rows)]


# --------------------------------------------------------------------------------------- command


def command(
    folder: Annotated[Path, typer.Argument(help="Where the rendered bags are or go.")],
    half: Annotated[str, typer.Option(help="train, test or all.")] = "test",
    tracks: Annotated[
        Path | None, typer.Option(help="The folder of the UCY set, for the recorded walks.")
    ] = None,
    every_step: Annotated[
        bool, typer.Option("--steps", help="Every step from the paper's method to ours.")
    ] = False,
    out: Annotated[
        Path | None,
        typer.Option(help="Replace what follows the first table's heading in this file."),
    ] = None,
    jobs: Annotated[
        int, typer.Option("--jobs", "-j", help="Processes; 0: one per core.", min=0)
    ] = 0,
) -> None:
    """Render the published suite, run it with the paper's method and ours, and score both."""
    scenes = suite_scenes(suite_file(), half)
    walks, missing = with_tracks(suite_scenes(suite_file("walks.yaml"), half, tracks=tracks))
    for line in missing:
        typer.echo(line, err=True)
    with progress_bar() as progress:
        task = progress.add_task("", total=1.0)
        rows = run_suite(
            [*scenes, *walks],
            folder,
            paper=default_file("config", "paper.yaml"),
            every_step=every_step,
            jobs=jobs or os.cpu_count() or 1,
            on_progress=lambda what, share: progress.update(
                task, description=what, completed=share
            ),
        )
    text = markdown(rows, half)
    typer.echo(text, nl=False)
    if out is not None:
        try:
            before = out.read_text("utf-8").partition("## Results on")[0] if out.exists() else ""
        except OSError as err:
            raise PeopleLocError(f"{out}: cannot be read ({err.strerror or err})") from err
        write_text(out, before + text)

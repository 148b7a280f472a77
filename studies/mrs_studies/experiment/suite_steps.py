"""The published suite: rendered, run with each step of the method, and scored."""

from __future__ import annotations

import tempfile
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import yaml

from mrs_people_loc.config import PLANNER_NODE, ROBOT_NODE, PlannerConfig, RobotConfig
from mrs_people_sim.evaluation.results import Result, evaluate_bag
from mrs_people_sim.scene import Scene
from mrs_studies.suite_scenes import simulate_suite

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
            "block 7, holes filled from block 11, pre-filter cap 63, matched one way, from 0.7 m",
            default(
                "disparity.block_size_px",
                "disparity.fill_block_size_px",
                "disparity.pre_filter_cap",
                "disparity.left_right_difference_px",
                "disparity.min_range",
            ),
            {},
        ),
        Step(
            "bodies sought in bearing and inverse range",
            {
                "bodies.search": True,
                "bodies.human_test": False,
                "bodies.appearance": False,
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
        Step("appearance", default("bodies.appearance"), {}),
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
        """Figures of identities, likewise."""
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
    report = on_progress or (lambda what, share: None)
    done = iter(range(1, len(scenes) + 1))
    bags = simulate_suite(
        scenes, folder, jobs=jobs, on_scene=lambda _: report("rendering", next(done) / len(scenes))
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
                    report(step.name, count / len(chosen))
            rows.append(Row(step.name, results, kinds))
    return rows

"""Runs bags through the pipeline and scores them against their ground truth.

The rules of the scores are at the top of `scoring.positions`, for identities of `scoring.tracks`,
for stragglers of `scoring.stragglers`, for guided tours of `scoring.tours`.

    result = evaluate_bag("scene.mcap", ["config/default.yaml"])
    result.report()["people"]["recall"]
"""

from __future__ import annotations

import os
from collections import defaultdict
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from mrs_people_loc.config import Groups, PlannerConfig
from mrs_people_loc.errors import BagError
from mrs_people_loc.planner import Planner
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_sim.estimates import estimate_of, has_people, read_recorded
from mrs_people_sim.evaluation.guided_tours import read_statuses
from mrs_people_sim.evaluation.labels import Labels, labels_beside
from mrs_people_sim.evaluation.robot_poses import (
    named_robots,
    read_odometry,
    read_sent_poses,
    read_true_poses,
)
from mrs_people_sim.evaluation.team_poses import PlannerBesideExact, TeamScores, score_team
from mrs_people_sim.scoring.detections import DetectionScores, score_detections
from mrs_people_sim.scoring.hidden import GhostScores, score_ghosts, score_hidden
from mrs_people_sim.scoring.poses import PoseTrack
from mrs_people_sim.scoring.positions import (
    Frame,
    percentile,
    ratio,
    recall_by_visibility,
    score,
    summary,
)
from mrs_people_sim.scoring.stragglers import StragglerScores, score_centres, score_stragglers
from mrs_people_sim.scoring.tours import TourRecord, TourScores, score_tour
from mrs_people_sim.scoring.tracks import TrackScores, score_tracks
from mrs_tools.bags.offline import BagRun, Interval
from mrs_tools.bags.reader import BagReader
from mrs_tools.bags.records import Estimate, Truth
from mrs_tools.bags.sources import RobotView, read_grid, robots_of
from mrs_tools.bags.truth import TRUTH_TOPIC, read_truth

#: What is counted of each view, in the order of the stages.
STAGES = ("valid_pixels", "raw", "cropped", "foreground", "cells")


@dataclass
class Result:
    """What the evaluation of one bag, or of several pooled, gave.

    Attributes:
        frames: One per ground-truth message: the people in view.
        hidden: Likewise: those whom nobody sees.
        ghosts: How long those are reported who have left the view.
        detections: What MODA and MODP are made of.
        tracks: What the scores of identities and velocities are made of.
        stragglers: What the scores of stragglers are made of.
        team: Scores of the robots' poses, and of the people beside those with exact poses.
        tour: Scores of guided tours.
        tour_record: The tour as it was recorded; None: none, or several bags.
        grid: Walls and furniture of the tour, if they are known.
        duration_s: From the first to the last message of the bag [s].
        counts: By robot, for each of its views the numbers named in `STAGES`.
        times_ms: By stage, what it took each time [ms]; `robot` and `planner` are what one view
            and one interval took altogether.
        estimates: What was found, one per interval.
        truth: What is true; None for several bags.
        notes: What a reader of the result should know.
    """

    frames: list[Frame] = field(default_factory=list)
    hidden: list[Frame] = field(default_factory=list)
    ghosts: GhostScores = field(default_factory=GhostScores)
    detections: DetectionScores = field(default_factory=DetectionScores)
    tracks: TrackScores = field(default_factory=TrackScores)
    stragglers: StragglerScores = field(default_factory=StragglerScores)
    team: TeamScores = field(default_factory=TeamScores)
    tour: TourScores = field(default_factory=TourScores)
    tour_record: TourRecord | None = None
    grid: OccupancyGrid | None = None
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
            total.hidden += result.hidden
            total.ghosts += result.ghosts
            total.detections += result.detections
            total.tracks += result.tracks
            total.stragglers += result.stragglers
            total.team += result.team
            total.tour += result.tour
            total.duration_s += result.duration_s
            for robot, rows in result.counts.items():
                total.counts.setdefault(robot, []).extend(rows)
            for stage, times in result.times_ms.items():
                total.times_ms.setdefault(stage, []).extend(times)
        return total

    def report(self) -> dict[str, Any]:
        """The figures, as the JSON of `mrs evaluate` has them; what is undefined is None."""
        scores = summary(self.frames)
        ghosts, of_hidden = self.ghosts.report()
        poses = {"poses": self.team.report()} if self.team else {}
        tour = {"tour": self.tour.report()} if self.tour.tours else {}
        return {
            "frames": scores["frames"],
            "duration_s": self.duration_s,
            "people": {
                **scores["people"],
                **self.detections.report(),
                "by_visibility": recall_by_visibility(self.frames),
                "ghost_s": ghosts,
            },
            "people_hidden": {**summary(self.hidden)["people"], "ghost_s": of_hidden},
            "group": scores["group"],
            "tracks": self.tracks.report(),
            "stragglers": self.stragglers.report(),
            **poses,
            **tour,
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
    labels: Labels | None = None,
    tracking: bool | None = None,
    localize: bool = False,
    on_interval: Callable[[Interval], None] | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> Result:
    """Runs a bag through the pipeline, or reads the recorded output of a planner, and scores it.

    Args:
        bag: The bag; or a `BagRun`, which may have another pipeline and planner.
        configs: Parameter files of the team, later ones win; not with a `BagRun`.
        recorded: Score the `tracked_people` in the bag. A bag that has them and no robot's images
            or `points` is scored so anyway.
        beside: Whether the bag's own parameter file is read, see `BagRun`.
        use_map: Whether its `/map` masks walls and furniture, likewise.
        labels: Hand labels, which are the truth in place of the bag's; None: those that lie beside
            the bag, if there are any and `beside` is true.
        tracking: Whether people are followed, likewise; None: as the files say, but never where
            the labels say that it is not possible.
        localize: Whether robots correct their odometry, likewise.
        on_interval: Called with each interval that is run.
        on_progress: Called with how much of the bag is done, 0 to 1.

    Raises:
        PeopleLocError: The bag or a file cannot be used.
    """
    if labels is None and beside:
        labels = labels_beside(bag.path if isinstance(bag, BagRun) else bag)
    if isinstance(bag, BagRun):
        result = _unscored(labels, bag)
        _run(bag, result, on_interval, on_progress)
        return _scored(result, bag.team.planner.groups)
    with BagReader(bag) as reader:
        if recorded or (not robots_of(reader) and has_people(reader)):
            result = _unscored(labels, reader)
            topic, result.estimates = read_recorded(reader)
            result.notes.append(f"scored as recorded on {topic}")
            _scored(result, PlannerConfig().groups)
            _team_scored(result, reader, read_sent_poses(reader, named_robots(reader)))
            return _tour_scored(result, reader)
    if tracking is None and labels is not None and not labels.follow:
        tracking = False
    with BagReader(bag) as reader:
        true = read_true_poses(reader, named_robots(reader))
    beside_exact = PlannerBesideExact(true)
    run = BagRun(
        bag, configs, beside=beside, use_map=use_map, tracking=tracking, localize=localize,
        planner=beside_exact if true else Planner,
    )  # fmt: skip

    def on_each(interval: Interval) -> None:
        beside_exact.take_poses(interval.apart)
        if on_interval is not None:
            on_interval(interval)

    result = evaluate_bag(
        run, labels=labels, beside=False, on_interval=on_each, on_progress=on_progress
    )
    with BagReader(bag) as reader:
        _team_scored(result, reader, beside_exact.used(), beside_exact.estimates)
        return _tour_scored(result, reader)


def _unscored(labels: Labels | None, bag: BagReader | BagRun) -> Result:
    """The truth of a bag, nothing found yet.

    Raises:
        BagError: The truth is wrong, or the labels are of another recording.
    """
    if labels is None:
        truth = read_truth(bag) if isinstance(bag, BagReader) else bag.truth()
        return Result(truth=truth, duration_s=bag.duration_s)
    labels.check_span(bag.start_ns, bag.end_ns)
    notes = [f"the truth is that of {labels.path.name}"]
    return Result(truth=labels.truth(), duration_s=bag.duration_s, notes=notes)


def _scored(result: Result, groups: Groups) -> Result:
    assert result.truth is not None
    if not len(result.truth):
        result.notes.append(f"no {TRUTH_TOPIC}: nothing to compare with")
    frames = score(result.truth, result.estimates)
    result.hidden = score_hidden(result.truth, result.estimates)
    result.ghosts = score_ghosts(frames, result.estimates)
    result.detections = score_detections(result.truth, result.estimates)
    result.frames = score_centres(result.truth, frames, result.estimates, config=groups)
    result.tracks = score_tracks(result.truth, result.frames, result.estimates)
    result.stragglers = score_stragglers(
        result.truth, result.frames, result.estimates, config=groups
    )
    return result


def _team_scored(
    result: Result,
    bag: BagReader,
    estimated: Mapping[str, PoseTrack],
    exact: Sequence[Estimate] | None = None,
) -> None:
    """Adds scores of the robots' poses if the bag has true ones."""
    assert result.truth is not None
    true = read_true_poses(bag, estimated)
    if true:
        odometry = read_odometry(bag, estimated)
        result.team = score_team(true, estimated, odometry, result.truth, result.estimates, exact)


def _tour_scored(result: Result, bag: BagReader) -> Result:
    """The result, with scores of the tour that was guided while the bag was recorded.

    Its robots drove by the people that were found then: those are scored, if they are in the bag.
    """
    statuses = read_statuses(bag)
    if not statuses or result.truth is None or not len(result.truth):
        return result
    estimates = read_recorded(bag)[1] if has_people(bag) else result.estimates
    robots = read_true_poses(bag, named_robots(bag))
    result.tour_record = TourRecord(statuses, result.truth, robots, estimates)
    result.tour = score_tour(result.tour_record)
    result.grid = read_grid(bag, PlannerConfig().map_frame)
    return result


def _run(
    run: BagRun,
    result: Result,
    on_interval: Callable[[Interval], None] | None,
    on_progress: Callable[[float], None] | None,
) -> None:
    times: defaultdict[str, list[float]] = defaultdict(list)

    def on_view(view: RobotView) -> None:
        stages = view.stages
        result.counts.setdefault(view.robot, []).append(
            (
                float(np.isfinite(stages.disparity).mean()),
                *(float(len(part)) for part in (stages.cloud, stages.cropped, stages.foreground)),
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


def as_json(results: Mapping[str, Result]) -> dict[str, Any]:
    """The figures of one bag, or of several and of all of them pooled."""
    if len(results) == 1:
        return next(iter(results.values())).report()
    return {
        "bags": {name: result.report() for name, result in results.items()},
        "total": Result.pooled(list(results.values())).report(),
    }

"""`mrs experiment`: the paper's section 6, simulated and measured, with its figures beside ours.

Two scenes, each drawn several times with other people, clothes and textures: the formation of five
people, three robots and a table (`scenes/paper_formation.yaml`), and one person 2 m before one
robot (`scenes/single_person.yaml`, Fig. 4). The configuration is `config/paper.yaml`, the method as
printed. `TRIALS` are runs of the formation with a value of its own where the paper leaves a choice;
`compare_poses` gives the robots wrong poses, by the paper's method and by the default one
(`config/default.yaml`). All figures depend on the seed alone, but for the times, and for the last
digit of those by the default method, whose pre-filter cap makes StereoBM vary from call to call.

The architecture's claim (section 4.2: filter first, then share) is tested on the same images:
`FilterThenShare` sends what the robots send anyway, `ShareThenFilter` sends their raw clouds and
does the rest on the planner's machine.
"""

from __future__ import annotations

import dataclasses
import itertools
import json
import math
import os
import tempfile
from collections import Counter, defaultdict
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass, field
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer

from mrs_people_loc import timing
from mrs_people_loc.cells import filters
from mrs_people_loc.clusters import Clusters
from mrs_people_loc.config import Human, PlannerConfig, Team
from mrs_people_loc.geometry import Float, wrap_angle
from mrs_people_loc.planner import People, Planner
from mrs_people_loc.team.fusion import map_from_robot
from mrs_people_loc.team.poses import Pose
from mrs_tools.bags.offline import BagRun, Interval, View, estimate_of
from mrs_tools.commands.bench import one_thread
from mrs_tools.commands.evaluate import Result, evaluate_bag, progress_bar, write_text
from mrs_tools.commands.plot import PAPER_KEPT
from mrs_tools.commands.simulate import render_frames, team_file
from mrs_tools.experiment.report import (
    PAPER_CLUSTERS,
    PAPER_ERROR_M,
    PAPER_REMOVED,
    PAPER_SEEN,
    reasons,
    show,
)
from mrs_tools.experiment.ways import WAYS, size_on_wire
from mrs_tools.installing import default_file
from mrs_tools.scoring.positions import (
    MATCH_DISTANCE,
    Frame,
    Truth,
    percentile,
    ratio,
    score,
    summary,
)
from mrs_tools.simulation.layouts import expand
from mrs_tools.simulation.rooms import footprint
from mrs_tools.simulation.scene import Scene, load_scene

#: The scenes, by what they are called here.
SCENES = {"formation": "paper_formation.yaml", "single_person": "single_person.yaml"}
#: Sides of the cells that the last stage is tried with [m].
CELL_SIZES = (0.02, 0.03, 0.04, 0.05, 0.06, 0.08, 0.10)
#: Bands of the distance from a robot [m].
BANDS = (1.0, 2.0, 3.0, 4.0, 5.0)
#: Where the paper leaves a choice: parameters of the robots, by what they are called here.
TRIALS: Mapping[str, Mapping[str, Any]] = {
    "as printed": {},
    "th_n 15": {"noise": {"min_points": 15}},
    "edge mask 11 px": {
        "disparity": {"pre_filter": "normalized_response", "pre_filter_size_px": 11}
    },
}
#: Standard deviations of a robot's position on each axis [m] and of its heading [degrees].
POSE_ERRORS = ((0.0, 0.0), (0.05, 1.0), (0.10, 2.0), (0.20, 4.0), (0.30, 6.0))
#: Points this near belong to a wall or to a piece of furniture [m].
_BESIDE = 0.4
#: The planner's work is timed so many times; the best counts: what else the machine does slows it.
_REPEATS = 5
#: Wrong poses are drawn so many times for each recording.
_POSE_DRAWS = 5


# ------------------------------------------------------------------------------------- recordings


@dataclass(frozen=True)
class Draw:
    """One simulated recording, and what only the simulator knows of it.

    Attributes:
        bag: Its bag.
        scene: The scene as it was drawn.
        pixels: By robot, how much of each person its left camera saw [px], shape (frames, people).
    """

    bag: Path
    scene: Scene
    pixels: Mapping[str, Float]


def draw(scene: Scene, bag: Path) -> Draw:
    """Renders a scene into a bag.

    Args:
        scene: The scene.
        bag: The new bag.

    Raises:
        BagError: The bag exists already or cannot be written.
        ConfigError: The scene cannot be rendered.
    """
    from mrs_tools.simulation.world import World
    from mrs_tools.simulation.writer import write_bag, write_team

    scene = expand(scene)
    world = World(scene)
    pixels: defaultdict[str, list[Float]] = defaultdict(list)

    def frames() -> Iterator[Any]:
        for seen in render_frames(world):
            for frame in seen:
                pixels[frame.robot].append(frame.pixels)
            yield seen

    bag.parent.mkdir(parents=True, exist_ok=True)
    write_bag(bag, world, frames())
    write_team(team_file(bag), world)
    return Draw(bag, scene, {robot: np.array(rows) for robot, rows in pixels.items()})


def _draw(job: tuple[Scene, Path]) -> Draw:
    return draw(*job)


def draws_of(
    file: Path, folder: Path, *, seed: int | None, draws: int, frames: int
) -> list[tuple[Scene, Path]]:
    """What `draw` takes for each draw of a scene: seeds follow each other.

    Args:
        file: The scene.
        folder: Where the bags go.
        seed: Seed of the first one; None: the scene's own.
        draws: How many.
        frames: Frames of each.

    Raises:
        ConfigError: The scene cannot be used.
    """
    first = load_scene(file, seed=seed)
    first = dataclasses.replace(first, timing=dataclasses.replace(first.timing, frames=frames))
    seeds = range(first.seed, first.seed + draws)
    scenes = [dataclasses.replace(first, seed=number) for number in seeds]
    return [(scene, folder / f"{scene.name}_{scene.seed}") for scene in scenes]


# --------------------------------------------------------------------------------------- measures


def kinds_of(
    clusters: Clusters, human: Human, people: Sequence[int], true: Sequence[int]
) -> list[str]:
    """What each cluster is, by the size test: a key of `PAPER_CLUSTERS`.

    A cluster that fails in several ways is too small before it is too low: a fragment of noise is
    often both, furniture has many points.

    Args:
        clusters: The clusters.
        human: The limits.
        people: Labels of those that pass the test.
        true: Labels of those of them that are people.
    """
    kinds = []
    for label in range(len(clusters)):
        if label in people:
            kinds.append("person" if label in true else "false_person")
        elif clusters.points[label] < human.min_points or clusters.width[label] < human.min_width:
            kinds.append("too_small")
        elif clusters.height[label] < human.min_height:
            kinds.append("too_low")
        else:
            kinds.append("too_large")
    return kinds


def places_of(xy: Float, people: Float, scene: Scene) -> np.ndarray:
    """What stands nearest to where points are: person, furniture, wall or other.

    Args:
        xy: Points in the map [m], shape (n, 2).
        people: Where the people are [m], shape (m, 2).
        scene: The scene.

    Returns:
        Names, shape (n,).
    """

    def near(places: Float, reach: float | Float) -> np.ndarray:
        away = np.linalg.norm(xy[:, np.newaxis] - places[np.newaxis], axis=2)
        return (away <= reach).any(axis=1)

    pieces = np.array([footprint(piece) for piece in scene.furniture]).reshape(-1, 3)
    to_wall = np.minimum(xy, (scene.room.length, scene.room.width) - xy).min(axis=1)
    return np.select(
        [near(people, MATCH_DISTANCE), near(pieces[:, :2], pieces[:, 2]), to_wall <= _BESIDE],
        ["person", "furniture", "wall"],
        "other",
    )


@dataclass
class Recording:
    """A draw that went through the pipeline.

    Attributes:
        draw: The draw.
        team: Configuration of its team.
        truth: Ground truth.
        intervals: What the pipeline made of it.
        result: How that was scored.
    """

    draw: Draw
    team: Team
    truth: Truth
    intervals: list[Interval]
    result: Result

    @classmethod
    def of(cls, one: Draw, *configs: Path) -> Recording:
        """Runs a draw with a configuration: files of which later ones win."""
        intervals: list[Interval] = []
        # The paper looks at each interval by itself.
        run = BagRun(one.bag, configs, planner=lambda c: Planner(c.memoryless()))
        result = evaluate_bag(run, on_interval=intervals.append)
        assert result.truth is not None
        return cls(one, run.team, result.truth, intervals, result)

    def views(self) -> Iterator[tuple[View, Pose]]:
        """Each view that an interval used, and the robot's pose."""
        for interval in self.intervals:
            for robot, view in interval.views.items():
                yield view, interval.people.poses[robot]

    def score(self, people: Sequence[People]) -> list[Frame]:
        """How the people of some intervals meet the truth."""
        return score(self.truth, [estimate_of(one) for one in people])

    def in_view(self, robots: Sequence[str], frame: int) -> np.ndarray:
        """Whom a robot sees: with as many pixels as a person must have points, shape (people,)."""
        least = self.team.planner.human.min_points
        return np.any([self.draw.pixels[robot][frame] >= least for robot in robots], axis=0)


def retention(recordings: Sequence[Recording]) -> dict[str, dict[str, float]]:
    """What each stage keeps of the one before: of all robots together, and of each."""
    pooled = Result.pooled([recording.result for recording in recordings])
    pooled.counts["all"] = [row for rows in list(pooled.counts.values()) for row in rows]
    return {
        robot: {stage: means[f"{stage}_kept"] for stage in PAPER_KEPT}
        for robot, means in pooled.report()["stages"].items()
    }


def points_of(recordings: Sequence[Recording]) -> dict[str, dict[str, float]]:
    """By robot, of a view: pixels with a disparity, points that stages leave, what they remove."""
    pooled = Result.pooled([recording.result for recording in recordings])
    pixels: defaultdict[str, list[int]] = defaultdict(list)
    for recording in recordings:
        for view, _ in recording.views():
            pixels[view.robot].append(int(np.isfinite(view.stages.disparity).sum()))
    return {
        robot: {
            "ranged": float(np.mean(pixels[robot])),
            **{stage: means[stage] for stage in ("raw", *PAPER_KEPT, "removed")},
        }
        for robot, means in pooled.report()["stages"].items()
    }


def retention_of_cells(recordings: Sequence[Recording], sizes: Sequence[float]) -> list[float]:
    """What the last stage keeps with cells of some sizes [m]."""
    clouds = [view.stages.noise for recording in recordings for view, _ in recording.views()]
    points = sum(map(len, clouds))
    return [
        sum(len(filters.quantize(cloud, cell=size)) for cloud in clouds) / points for size in sizes
    ]


def count_clusters(recordings: Sequence[Recording]) -> dict[str, Any]:
    """Clusters per interval by kind.

    Returns:
        By kind (`all`: all of them) `mean`, `min` and `max` per interval; `where` they are, in
        all; the median of their points; and how many have points of one noise window only, that
        is less than twice its threshold.
    """
    rows: list[Counter[str]] = []
    where: defaultdict[str, Counter[str]] = defaultdict(Counter)
    points: defaultdict[str, list[int]] = defaultdict(list)
    least = max(c.noise.min_points for r in recordings for c in r.team.robots.values())
    for recording in recordings:
        for frame in recording.result.frames:
            if frame.estimate is None:
                continue
            people = recording.intervals[frame.estimate].people
            kinds = _kinds(people, frame, recording.team.planner)
            rows.append(Counter(kinds))
            places = places_of(people.clusters.centroid, frame.true, recording.draw.scene)
            for kind, place, count in zip(kinds, places, people.clusters.points, strict=True):
                where[kind][str(place)] += 1
                points[kind].append(int(count))
    names = [*PAPER_CLUSTERS]
    numbers = {kind: [row[kind] for row in rows] for kind in names}
    numbers["all"] = [sum(row.values()) for row in rows]
    return {
        kind: {
            "mean": float(np.mean(counts)),
            "min": min(counts),
            "max": max(counts),
            "where": dict(sorted(where[kind].items())),
            "median_points": float(np.median(points[kind])) if points[kind] else None,
            "one_window": ratio(sum(n < 2 * least for n in points[kind]), len(points[kind])),
        }
        for kind, counts in numbers.items()
    }


def _kinds(people: People, frame: Frame, config: PlannerConfig) -> list[str]:
    labels = [person.label for person in people.persons]
    true = [labels[index] for index in (*frame.pairs[:, 0], *frame.ignored)]
    return kinds_of(people.clusters, config.human, labels, true)


def subsets(names: Sequence[str]) -> list[tuple[str, ...]]:
    """All subsets but the empty one, small ones first."""
    return [s for n in range(1, len(names) + 1) for s in itertools.combinations(names, n)]


def people_of(recording: Recording, robots: Sequence[str]) -> list[People]:
    """What the planner finds with the scans of some of the robots."""
    planner, found = Planner(recording.team.planner.memoryless()), []
    for interval in recording.intervals:
        scans = [scan for scan in interval.scans if scan.robot in robots]
        if scans:
            time_ns = max(scan.stamp_ns for scan in scans)
            found.append(planner.step(scans, interval.people.poses, time_ns))
    return found


@dataclass
class Tally:
    """Scores of several recordings.

    Attributes:
        frames: All frames.
        offsets: Found minus true positions [m], each of shape (2,).
        in_view: People who were in view, summed over the frames.
        found_in_view: Those of them who were found.
        missed_as: What the others became, see `remains_of`.
        false_at: Where people were found who are none, see `places_of`.
    """

    frames: list[Frame] = field(default_factory=list)
    offsets: list[Float] = field(default_factory=list)
    in_view: int = 0
    found_in_view: int = 0
    missed_as: Counter[str] = field(default_factory=Counter)
    false_at: Counter[str] = field(default_factory=Counter)

    def add(self, recording: Recording, people: Sequence[People], robots: Sequence[str]) -> None:
        """Takes what was found in a recording, with some of the robots."""
        for index, frame in enumerate(recording.score(people)):
            self.frames.append(frame)
            seen = recording.in_view(robots, index) & frame.required
            self.in_view += int(seen.sum())
            self.found_in_view += int(seen[frame.pairs[:, 1]].sum())
            if frame.estimate is None:
                continue
            found = people[frame.estimate]
            at = np.array([person.position for person in found.persons]).reshape(-1, 2)
            self.offsets += [*(at[frame.pairs[:, 0]] - frame.true[frame.pairs[:, 1]])]
            self.false_at.update(
                places_of(at[frame.false], frame.true, recording.draw.scene).tolist()
            )
            missed = [j for j in frame.missed if seen[j]]
            self.missed_as.update(remains_of(found, frame, missed, recording.team.planner))

    def report(self) -> dict[str, Any]:
        """Means per frame, and errors [m]."""
        scores, count = summary(self.frames)["people"], len(self.frames)
        axes = np.abs(np.array(self.offsets).reshape(-1, 2))
        return {
            "in_view": self.in_view / count,
            "found": scores["matched"] / count,
            "recall": scores["recall"],
            "recall_in_view": ratio(self.found_in_view, self.in_view),
            "false": (scores["estimates"] - scores["matched"]) / count,
            "precision": scores["precision"],
            "error_m": scores["error_m"],
            "error_per_axis_m": float(axes.mean()) if len(axes) else None,
            "missed_as": dict(sorted(self.missed_as.items())),
            "false_at": dict(sorted(self.false_at.items())),
        }


def remains_of(
    found: People, frame: Frame, missed: Sequence[int], config: PlannerConfig
) -> Iterator[str]:
    """What people who were not found became.

    That is the kind of the cluster with most of the points within `MATCH_DISTANCE`; `nothing`:
    there are none; `displaced`: it is human-sized, but too far off or somebody else.
    """
    kinds = _kinds(found, frame, config)
    for j in missed:
        near = np.linalg.norm(found.fused.xy - frame.true[j], axis=1) <= MATCH_DISTANCE
        if not near.any():
            yield "nothing"
            continue
        points = np.bincount(found.clusters.label[near], found.fused.cells.count[near])
        kind = kinds[int(points.argmax())]
        yield "displaced" if "person" in kind else kind


def recall_of_subsets(recordings: Sequence[Recording]) -> list[dict[str, Any]]:
    """Who is found with every subset of the robots, against all people."""
    names = sorted(recordings[0].team.robots)
    rows = []
    for robots in subsets(names):
        tally = Tally()
        for recording in recordings:
            tally.add(recording, people_of(recording, robots), robots)
        rows.append({"robots": [*robots], **tally.report()})
    return rows


def compare_architectures(recordings: Sequence[Recording]) -> dict[str, dict[str, Any]]:
    """Filter, then share against share, then filter, on the same images."""
    reports = {}
    rate = recordings[0].draw.scene.timing.rate
    for name, make in WAYS.items():
        tally, sizes, times_ms, clusters = Tally(), [], [], []
        before = after = 0
        for recording in recordings:
            way, found = make(recording.team), []
            for interval in recording.intervals:
                sent = {robot: way.send(view) for robot, view in interval.views.items()}
                sizes.append(sum(map(size_on_wire, sent.values())))
                best_ms = math.inf
                for _ in range(_REPEATS):
                    begin_ns = timing.now_ns()
                    people = way.plan(sent, interval.people.poses, interval.people.stamp_ns)
                    best_ms = min(best_ms, (timing.now_ns() - begin_ns) / 1e6)
                times_ms.append(best_ms)
                found.append(people)
                clusters.append(len(people.clusters))
            before, after = before + way.zones, after + way.noise
            tally.add(recording, found, sorted(recording.team.robots))
        reports[name] = {
            **{key: value for key, value in tally.report().items() if "in_view" not in key},
            "clusters": float(np.mean(clusters)),
            "noise_kept": ratio(after, before),
            "bytes_per_frame": float(np.mean(sizes)),
            "rate_hz": rate,
            "bytes_per_s": float(np.mean(sizes)) * rate,
            "planner_ms": {"median": percentile(times_ms, 50), "p99": percentile(times_ms, 99)},
        }
    return reports


def try_values(draws: Sequence[Draw], config: Path, folder: Path) -> list[dict[str, Any]]:
    """Runs draws with each of `TRIALS`.

    Args:
        draws: Of the formation.
        config: The method.
        folder: Where a parameter file of each trial goes.

    Returns:
        Of each trial its name (`trial`), the share of pixels with a disparity (`ranged`), what the
        stages keep, clusters per interval, and how people are found.
    """
    rows = []
    for name, parameters in TRIALS.items():
        file = folder / f"{name.replace(' ', '_')}.yaml"
        text = {"/**/robot_node": {"ros__parameters": dict(parameters)}}
        write_text(file, json.dumps(text) + "\n")  # JSON is YAML
        recordings = [Recording.of(one, config, file) for one in draws]
        valid = [row[0] for r in recordings for views in r.result.counts.values() for row in views]
        clusters = [len(i.people.clusters) for r in recordings for i in r.intervals]
        rows.append(
            {
                "trial": name,
                "ranged": float(np.mean(valid)),
                **retention(recordings)["all"],
                "clusters": float(np.mean(clusters)),
                **_team_tally(recordings),
            }
        )
    return rows


def misplaced(pose: Pose, error: Float, sigmas: Float) -> Pose:
    """A pose that is wrong, with the covariance of what it is wrong by.

    Args:
        pose: The true one.
        error: By how much, x, y, yaw [m, m, rad], shape (3,).
        sigmas: Standard deviations of that, shape (3,).
    """
    x, y, yaw = error.tolist()
    return dataclasses.replace(
        pose,
        x=pose.x + x,
        y=pose.y + y,
        yaw=wrap_angle(pose.yaw + yaw),
        covariance=pose.covariance + np.diag(sigmas**2),
    )


def compare_poses(methods: Mapping[str, Sequence[Recording]]) -> list[dict[str, Any]]:
    """People with wrong poses: each robot's is wrong by the same all through a recording.

    Errors are normal and the planner is told their covariance. They are drawn `_POSE_DRAWS` times
    for each recording, the same for all methods, and grow from row to row in one direction.

    Args:
        methods: By the name of a method what it made of the same draws.

    Returns:
        For each of `POSE_ERRORS` the standard deviations `position_m` and `heading_deg`, and by
        method the recall, precision and mean error [m].
    """
    rows = []
    for position_m, heading_deg in POSE_ERRORS:
        sigmas = np.array([position_m, position_m, math.radians(heading_deg)])
        row: dict[str, Any] = {"position_m": position_m, "heading_deg": heading_deg, "methods": {}}
        for name, recordings in methods.items():
            frames: list[Frame] = []
            for recording in recordings:
                rng = np.random.default_rng(recording.draw.scene.seed)
                for _ in range(_POSE_DRAWS):
                    errors = {
                        robot: sigmas * rng.standard_normal(3)
                        for robot in sorted(recording.team.robots)
                    }
                    frames += recording.score(_with_poses(recording, errors, sigmas))
            scores = summary(frames)["people"]
            row["methods"][name] = {
                "recall": scores["recall"],
                "precision": scores["precision"],
                "error_m": scores["error_m"]["mean"],
            }
        rows.append(row)
    return rows


def _with_poses(recording: Recording, errors: Mapping[str, Float], sigmas: Float) -> list[People]:
    planner = Planner(recording.team.planner.memoryless())
    return [
        planner.step(
            interval.scans,
            {
                robot: misplaced(pose, errors[robot], sigmas)
                for robot, pose in interval.people.poses.items()
            },
            interval.people.stamp_ns,
        )
        for interval in recording.intervals
    ]


# -------------------------------------------------------------------------------------- causes ----


def zone_causes(recordings: Sequence[Recording]) -> dict[str, Any]:
    """Where the points between knees and shoulders are, and what else was ranged.

    Returns:
        `low`, `high`: shares of the raw points under and over the zone; `where`: shares of the
        points in it by `places_of`; `of_all_pixels`: what the zone keeps if every pixel with a
        disparity counts as raw, also beyond the working range.
    """
    low = high = raw = zones = pixels = 0
    where: Counter[str] = Counter()
    for recording in recordings:
        people = recording.truth.positions[0]
        for view, pose in recording.views():
            stages, limits = view.stages, recording.team.robots[view.robot].zones
            height = stages.cloud[:, 2]
            low += int((height < np.float32(limits.low)).sum())
            high += int((height > np.float32(limits.high)).sum())
            raw, zones = raw + len(height), zones + len(stages.zones)
            pixels += int(np.isfinite(stages.disparity).sum())
            xy = map_from_robot(stages.zones[:, :2].astype(np.float64), pose)
            where.update(places_of(xy, people, recording.draw.scene).tolist())
    return {
        "low": low / raw,
        "high": high / raw,
        "of_all_pixels": zones / pixels,
        "where": {place: count / zones for place, count in sorted(where.items())},
    }


def noise_causes(recordings: Sequence[Recording]) -> list[dict[str, Any]]:
    """What the noise windows keep of points in bands of the distance from their robot."""
    edges = np.array(BANDS)
    before, after = np.zeros((2, len(edges) - 1))
    for recording in recordings:
        for view, _ in recording.views():
            for counts, points in ((before, view.stages.zones), (after, view.stages.noise)):
                counts += np.histogram(np.hypot(points[:, 0], points[:, 1]), edges)[0]
    return [
        {"from_m": begin, "to_m": end, "points": int(n), "kept": ratio(float(m), float(n))}
        for (begin, end), n, m in zip(itertools.pairwise(BANDS), before, after, strict=True)
    ]


def along_sight(offset: Float, sight: Float) -> tuple[float, float]:
    """An offset [m], shape (2,), along a line of sight and to its left."""
    x, y = sight / np.linalg.norm(sight)
    return float(offset @ (x, y)), float(offset @ (-y, x))


def error_causes(recordings: Sequence[Recording]) -> dict[str, float | None]:
    """Where one robot alone puts people: behind (+) or before (-) their axis, and beside it [m].

    None if it finds nobody.
    """
    along: list[float] = []
    beside: list[float] = []
    for recording in recordings:
        for robot in recording.team.robots:
            people = people_of(recording, [robot])
            for frame in recording.score(people):
                if frame.estimate is None:
                    continue
                found = people[frame.estimate]
                pose = found.poses[robot]
                for i, j in frame.pairs:
                    offset = found.persons[i].position - frame.true[j]
                    one, other = along_sight(offset, frame.true[j] - (pose.x, pose.y))
                    along.append(one)
                    beside.append(abs(other))
    return {
        "along_m": ratio(sum(along), len(along)),
        "beside_m": ratio(sum(beside), len(beside)),
    }


def distances(recordings: Sequence[Recording], robots: Sequence[str]) -> dict[str, float]:
    """From robots to the people whom they have in view: least and greatest [m]."""
    away: list[float] = []
    for recording in recordings:
        scene, people = recording.draw.scene, recording.truth.positions[0]
        for name in robots:
            place = (scene.robots[name].x, scene.robots[name].y)
            seen = recording.in_view([name], 0)
            away += np.linalg.norm(people[seen] - place, axis=1).tolist()
    return {"from_m": min(away), "to_m": max(away)}


# ---------------------------------------------------------------------------------- the experiment


def run_experiment(
    scenes: Mapping[str, Path],
    config: Path,
    default: Path,
    folder: Path,
    *,
    seed: int | None = None,
    draws: int = 10,
    frames: int = 2,
    jobs: int = 1,
    on_step: Callable[[float, str], None] = lambda *_: None,
) -> dict[str, Any]:
    """Simulates the scenes and measures.

    Args:
        scenes: Scene files of `formation` and `single_person`.
        config: The method as printed.
        default: The method that it is compared with where poses are wrong.
        folder: Where the bags go.
        seed: Seed of the first draw; None: the scenes' own.
        draws: Recordings of each scene, with seeds that follow each other.
        frames: Frames of each recording.
        jobs: Processes that simulate.
        on_step: Told how much is done, 0 to 1, and what is done now.

    Returns:
        The report, as `mrs experiment --json` writes it.

    Raises:
        PeopleLocError: A file or folder cannot be used.
    """
    todo = [
        job
        for file in scenes.values()
        for job in draws_of(file, folder, seed=seed, draws=draws, frames=frames)
    ]
    recorded: list[Draw] = []
    for one in _drawn(todo, jobs):
        recorded.append(one)
        on_step(0.7 * len(recorded) / len(todo), "simulating")
    with one_thread(), timing.processor_time():
        on_step(0.7, "measuring")
        runs = [Recording.of(one, config) for one in recorded]
        recordings = {
            name: runs[index * draws : (index + 1) * draws] for index, name in enumerate(scenes)
        }
        formation = recordings["formation"]
        drawn = [recording.draw for recording in formation]
        by_default = [Recording.of(one, default) for one in drawn]
        on_step(0.8, "measuring")
        report = {
            "config": config.name,
            "draws": draws,
            "frames": frames,
            "seeds": {
                name: [r.draw.scene.seed for r in several] for name, several in recordings.items()
            },
            "paper": {
                "retention": PAPER_KEPT,
                "clusters": PAPER_CLUSTERS,
                "error_m": PAPER_ERROR_M,
                "seen": PAPER_SEEN,
                "removed": PAPER_REMOVED,
            },
            "retention": {name: retention(several) for name, several in recordings.items()},
            "points": {name: points_of(several) for name, several in recordings.items()},
            "cells": {
                "cell_m": [*CELL_SIZES],
                **{n: retention_of_cells(several, CELL_SIZES) for n, several in recordings.items()},
            },
            "clusters": count_clusters(formation),
            "people": {name: _team_tally(several) for name, several in recordings.items()},
            "robots": recall_of_subsets(formation),
            "architecture": compare_architectures(formation),
            "trials": try_values(drawn, config, folder),
            "poses": compare_poses({config.name: formation, default.name: by_default}),
            "causes": {
                "zones": {name: zone_causes(several) for name, several in recordings.items()},
                "noise": noise_causes(formation),
                "error": error_causes(formation),
                "distance_of_rear_robots": distances(formation, [*PAPER_SEEN]),
            },
        }
    on_step(1.0, "measured")
    return {**report, "reasons": reasons(report)}


def _drawn(todo: Sequence[tuple[Scene, Path]], jobs: int) -> Iterator[Draw]:
    if jobs <= 1:
        yield from map(_draw, todo)
        return
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        yield from pool.map(_draw, todo)


def _team_tally(recordings: Sequence[Recording]) -> dict[str, Any]:
    tally = Tally()
    for recording in recordings:
        people = [interval.people for interval in recording.intervals]
        tally.add(recording, people, sorted(recording.team.robots))
    return tally.report()


# ------------------------------------------------------------------------------------ command line


def command(
    seed: Annotated[
        int | None, typer.Option(help="Of the first draw; not given: the scenes' own.", min=0)
    ] = None,
    draws: Annotated[int, typer.Option(help="Recordings of each scene.", min=1)] = 20,
    frames: Annotated[int, typer.Option(help="Frames of each recording.", min=1)] = 2,
    json_file: Annotated[
        Path | None, typer.Option("--json", help="Write the figures into this file.")
    ] = None,
    out: Annotated[Path | None, typer.Option("--out", help="Keep the bags in this folder.")] = None,
    jobs: Annotated[
        int, typer.Option("--jobs", "-j", help="Processes that simulate; 0: one per core.", min=0)
    ] = 0,
) -> None:
    """Simulate the paper's experiment, and print its figures beside ours.

    Five people, three robots and a table, and one person 2 m before a robot, with the method as
    printed (config/paper.yaml); where poses are wrong, with config/default.yaml, too. People,
    clothes and textures differ from draw to draw. All figures but the planner's time follow from
    the seed; those by default.yaml to the last digit or so, for StereoBM varies a little there.
    """
    import sys

    from rich.console import Console

    with tempfile.TemporaryDirectory() as folder, progress_bar() as progress:
        task = progress.add_task("", total=1.0)
        report = run_experiment(
            {name: default_file("scenes", file) for name, file in SCENES.items()},
            default_file("config", "paper.yaml"),
            default_file("config", "default.yaml"),
            out or Path(folder),
            seed=seed,
            draws=draws,
            frames=frames,
            jobs=jobs or os.cpu_count() or 1,
            on_step=lambda part, what: progress.update(task, completed=part, description=what),
        )
    # Without a terminal Rich would take 80 columns.
    show(report, Console(highlight=False, width=None if sys.stdout.isatty() else 100))
    if json_file is not None:
        write_json(report, json_file)


def write_json(report: Mapping[str, Any], path: Path) -> None:
    """Writes a report.

    Raises:
        PeopleLocError: The file cannot be written.
    """
    write_text(path, json.dumps(report, indent=2, allow_nan=False) + "\n")

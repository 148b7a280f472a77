"""`mrs fit`: fits the body model to bags with ground truth.

    mrs simulate --suite train OUT_DIR/train
    mrs simulate --suite train --variants 32 OUT_DIR/more
    mrs fit OUT_DIR/*/*/ --out mrs_people_loc/mrs_people_loc/body_model.json

Each candidate of each view is an example: a person if somebody truly is there, none if nobody is
near. What is in between, and what is another robot of the team (the planner knows where those
are), is left out. Figures printed are cross-validated: each bag is judged by a model that has not
seen it.
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Annotated, Any

import numpy as np
import typer
from numpy.typing import NDArray
from scipy.optimize import minimize

from mrs_people_loc.bodies.finder import BodyFinder, View
from mrs_people_loc.bodies.model import BodyModel, Layered, Linear, Scaled
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.errors import BagError, PeopleLocError
from mrs_people_loc.geometry import rotation_2d, yaw_from_quaternion
from mrs_people_loc.messages import stamp_ns_of
from mrs_people_loc.scan import Cells, Scan, ScanStages
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.disparity import StereoMatcher
from mrs_people_loc.sensing.images import StereoImages
from mrs_people_loc.timing import StageTimes
from mrs_tools.bags.offline import BagRun
from mrs_tools.bags.rosbag import BagReader
from mrs_tools.commands.evaluate import progress_bar, write_text
from mrs_tools.scoring.positions import CHI2_95

Float = NDArray[np.float64]
Bool = NDArray[np.bool_]

#: Somebody is at a candidate if he is within this across the line of sight [m], and along it within
#: a part that is fixed [m] and one in disparity [px], but no more than that [m] ...
_ACROSS, _ALONG, _ALONG_PX, _ALONG_MOST = 0.2, 0.2, 0.7, 0.8
#: ... and nobody is if everybody is farther away than so many times that.
_NOBODY = 2.0
#: Width of the hidden layer, and what large weights cost.
_HIDDEN, _HIDDEN_COST, _LINEAR_COST = 16, 40.0, 30.0
_FOLDS = 5


@dataclass(frozen=True)
class Examples:
    """Candidates, a struct of arrays of one length (n,).

    Attributes:
        even: Even evidence.
        odd: Odd evidence.
        depth: Depth evidence.
        away: Distance to the nearest person in units of what counts as being there.
        across: How far that person's axis is to the left of the patch's middle [m].
        more_px: How much more inverse range that axis has [px].
        robot: Whether it is another robot.
        bag: Number of the bag.
    """

    even: Float
    odd: Float
    depth: Float
    away: Float
    across: Float
    more_px: Float
    robot: Bool
    bag: NDArray[np.intp]

    def __len__(self) -> int:
        """Number of examples."""
        return len(self.away)

    @property
    def person(self) -> Bool:
        """Which are people."""
        return (self.away < 1.0) & ~self.robot

    @property
    def clear(self) -> Bool:
        """Which are people or nobody, and not something in between."""
        return ((self.away < 1.0) | (self.away >= _NOBODY)) & ~self.robot

    def chosen(self, index: Bool) -> Examples:
        """Some of them."""
        return Examples(**{name: value[index] for name, value in vars(self).items()})

    @classmethod
    def joined(cls, parts: Sequence[Examples]) -> Examples:
        """Several together."""
        return cls(**{n: np.concatenate([getattr(p, n) for p in parts]) for n in vars(parts[0])})


class _Looker:
    """A robot's pipeline up to the evidence; keeps what it saw."""

    def __init__(self, robot: str, camera: StereoCamera, config: RobotConfig) -> None:
        self.robot, self.camera = robot, camera
        self._match = StereoMatcher(camera, config.disparity)
        self._find = BodyFinder(camera, config.bodies, min_range=config.disparity.min_range)
        self.views: list[tuple[int, View]] = []

    def stages(self, images: StereoImages) -> ScanStages:
        disparity = self._match(images)
        view = self._find.look(disparity, images, StageTimes())
        self.views.append((images.stamp_ns, view))
        return ScanStages(disparity, Scan(self.robot, images.stamp_ns, Cells.empty()), {})


def examples_of(
    path: Path, number: int, *, configs: Sequence[Path] = (), views: int = 8
) -> Examples:
    """The examples of a bag.

    Args:
        path: A bag with ground truth of people and robots, as `mrs simulate` writes it.
        number: What `Examples.bag` shall say.
        configs: Parameter files of the team.
        views: So many of each robot's views at most, evenly spread: neighbours are alike.

    Raises:
        PeopleLocError: The bag cannot be used.
    """
    lookers: list[_Looker] = []

    def make(robot: str, camera: StereoCamera, config: RobotConfig) -> _Looker:
        lookers.append(_Looker(robot, camera, config))
        return lookers[-1]

    run = BagRun(path, configs, pipeline=make)
    truth = run.truth()
    if not len(truth):
        raise BagError(f"{path}: has no ground truth of people")
    for _ in run.intervals():
        pass
    poses = _true_poses(path, [looker.robot for looker in lookers])
    parts = []
    for looker in lookers:
        count = len(looker.views)
        for index in np.unique(np.linspace(0, count - 1, min(count, views)).round().astype(int)):
            stamp_ns, view = looker.views[index]
            people, _ = truth.at(stamp_ns)
            at = {name: _at(track, stamp_ns) for name, track in poses.items()}
            others = np.array([at[n][:2] for n in at if n != looker.robot]).reshape(-1, 2)
            parts.append(_examples(looker.camera, view, at[looker.robot], people, others, number))
    return Examples.joined(parts)


def _true_poses(path: Path, robots: Sequence[str]) -> dict[str, Float]:
    """By robot, stamps [ns], x, y [m] and unwrapped yaw [rad], shape (n, 4)."""
    topics = {f"/ground_truth/{robot}/pose": robot for robot in robots}
    tracks: dict[str, list[tuple[float, ...]]] = {}
    with BagReader(path) as bag:
        for topic in topics:
            if topic not in bag.topics:
                raise BagError(f"{path}: has no {topic}; wanted: a bag of `mrs simulate`")
        for topic, _, message in bag.decoded(list(topics)):
            p, q = message.pose.position, message.pose.orientation
            yaw = yaw_from_quaternion(q.x, q.y, q.z, q.w)
            row = (stamp_ns_of(message.header.stamp), p.x, p.y, yaw)
            tracks.setdefault(topics[topic], []).append(row)
    result = {name: np.array(rows) for name, rows in tracks.items()}
    for track in result.values():
        track[:, 3] = np.unwrap(track[:, 3])
    return result


def _at(track: Float, stamp_ns: int) -> Float:
    return np.array([np.interp(stamp_ns, track[:, 0], track[:, k]) for k in (1, 2, 3)])


def _examples(
    camera: StereoCamera, view: View, pose: Float, people: Float, others: Float, number: int
) -> Examples:
    """Compares the candidates of a view with the truth, as seen from the lens."""
    scale = camera.depth_disparity
    bearing, inverse = view.patches.bearing, view.patches.inverse_range
    ranges = scale / inverse

    def seen(places: Float) -> tuple[Float, Float, Float]:
        """Across and along from each candidate (rows) to each place [m], and places' ranges."""
        _, lens = camera.robot_from_optical
        local = (places - pose[:2]) @ rotation_2d(pose[2]) - lens[:2]
        far, at = np.hypot(*local.T), np.arctan2(local[:, 1], local[:, 0])
        turn = np.angle(np.exp(1j * (at - bearing[:, np.newaxis])))
        return far * np.sin(turn), far * np.cos(turn) - ranges[:, np.newaxis], far

    count = len(bearing)
    people = people[np.isfinite(people[:, 0])]
    across, along, far = seen(people)
    allowed = np.minimum(_ALONG + _ALONG_PX * far**2 / scale, _ALONG_MOST)
    distance = np.hypot(across / _ACROSS, along / allowed)
    distance = np.column_stack([distance, np.full(count, 99.0)])
    nearest, row = distance.argmin(axis=1), np.arange(count)
    across, along = (np.column_stack([part, np.zeros(count)]) for part in (across, along))
    other_across, other_along, other_far = seen(others)
    robot = np.abs(other_across) < 0.35
    robot &= np.abs(other_along) < 0.3 + 0.3 * other_far**2 / scale
    return Examples(
        even=view.evidence.even,
        odd=view.evidence.odd,
        depth=view.evidence.depth,
        away=distance[row, nearest],
        across=across[row, nearest],
        more_px=scale / (ranges + along[row, nearest]) - inverse,
        robot=np.asarray(robot.any(axis=1)),
        bag=np.full(count, number),
    )


# --------------------------------------------------------------------------------------- fitting


def fit(examples: Examples) -> BodyModel:
    """Fits the model.

    Raises:
        PeopleLocError: There are too few examples of either kind.
    """
    people = examples.chosen(examples.person)
    clear = examples.chosen(examples.clear)
    others = int(len(clear) - clear.person.sum())
    if len(people) < 100 or others < 100:
        raise PeopleLocError(
            f"{len(people)} examples of people and {others} of other things; wanted: 100 of each"
        )
    human = _fit_layered(clear.even, clear.person.astype(np.float64))
    across = _fit_linear(people.odd, people.across, width=0.05, odd=True)
    depth = _fit_linear(people.depth, people.more_px, width=0.1)
    return BodyModel(
        human=human,
        across=across,
        depth=depth,
        across_log_sigma=_fit_log_sigma(people.even, people.across - across(people.odd), 0.005),
        depth_log_sigma=_fit_log_sigma(people.even, people.more_px - depth(people.depth), 0.01),
    )


def _scaled(values: Float, *, odd: bool = False) -> Scaled:
    mean = np.zeros(values.shape[1]) if odd else values.mean(axis=0)
    scale = np.sqrt(np.mean((values - mean) ** 2, axis=0)) + 0.02
    return Scaled(_rounded(mean), _rounded(scale))


def _fit_linear(values: Float, target: Float, *, width: float, odd: bool = False) -> Linear:
    """Huber's regression by reweighting, with a ridge; residuals above `width` count linearly."""
    scaled = _scaled(values, odd=odd)
    x = np.column_stack([scaled(values), np.full(len(values), 0.0 if odd else 1.0)])
    ridge = np.diag([_LINEAR_COST] * values.shape[1] + [1e-6])
    weight = np.ones(len(x))
    for _ in range(20):
        weighted = x * weight[:, np.newaxis]
        solution = np.linalg.solve(weighted.T @ x + ridge, weighted.T @ target)
        weight = np.minimum(1.0, width / np.maximum(np.abs(x @ solution - target), 1e-9))
    return Linear(scaled, _rounded(solution[:-1]), float(_rounded(solution[-1:])[0]))


def _fit_log_sigma(values: Float, residual: Float, floor: float) -> Linear:
    """Log of the residuals' size, raised so that 95 % of them are within 1.96 sigma."""
    model = _fit_linear(values, np.log(np.abs(residual) + floor), width=1.0)
    ratios = np.abs(residual) / np.exp(model(values))
    raised = model.offset + math.log(float(np.percentile(ratios, 95)) / 1.96)
    return Linear(model.scaled, model.weights, raised)


def _fit_layered(values: Float, target: Float) -> Layered:
    """Logistic loss over a hidden layer of tanh, with a ridge, by L-BFGS from a fixed start."""
    scaled = _scaled(values)
    x = scaled(values)
    inputs, width = x.shape[1], _HIDDEN
    rng = np.random.default_rng(0)
    start = np.concatenate(
        [
            rng.normal(0.0, 1.0 / math.sqrt(inputs), inputs * width),
            np.zeros(width),
            rng.normal(0.0, 0.3, width),
            [0.0],
        ]
    )

    def unpack(p: Float) -> tuple[Float, Float, Float, float]:
        cut = inputs * width
        return p[:cut].reshape(inputs, width), p[cut : cut + width], p[cut + width : -1], p[-1]

    def loss(p: Float) -> tuple[float, Float]:
        hidden, bias, output, offset = unpack(p)
        layer = np.tanh(x @ hidden + bias)
        z = layer @ output + offset
        cost = 0.5 * _HIDDEN_COST * (np.sum(hidden**2) + np.sum(output**2))
        error = 1.0 / (1.0 + np.exp(-z)) - target
        back = np.outer(error, output) * (1.0 - layer**2)
        gradient = [
            (x.T @ back + _HIDDEN_COST * hidden).ravel(),
            back.sum(axis=0),
            layer.T @ error + _HIDDEN_COST * output,
            [error.sum()],
        ]
        return float(np.sum(np.logaddexp(0.0, z) - target * z) + cost), np.concatenate(gradient)

    found: Any = minimize(loss, start, jac=True, method="L-BFGS-B", options={"maxiter": 250})
    hidden, bias, output, offset = unpack(_rounded(found.x))
    return Layered(scaled, hidden, bias, output, float(offset))


def _rounded(values: Float) -> Float:
    """Five digits are plenty, and keep the file small."""
    return np.array([float(f"{value:.5g}") for value in values])


# ---------------------------------------------------------------------------------------- report


def cross_validate(examples: Examples) -> dict[str, float]:
    """Figures of models that have not seen the bags that they judge."""
    count = len(examples)
    score, across, depth = np.zeros(count), np.zeros(count), np.zeros(count)
    inside = np.zeros(count, dtype=bool)
    for fold in range(_FOLDS):
        held = examples.bag % _FOLDS == fold
        if not held.any():
            continue
        model, part = fit(examples.chosen(~held)), examples.chosen(held)
        score[held] = model.human(part.even)
        across[held] = part.across - model.across(part.odd)
        depth[held] = part.more_px - model.depth(part.depth)
        squares = (across[held] / np.exp(model.across_log_sigma(part.even))) ** 2
        squares += (depth[held] / np.exp(model.depth_log_sigma(part.even))) ** 2
        inside[held] = squares < CHI2_95
    person, clear = examples.person, examples.clear
    order = np.flatnonzero(clear)[np.argsort(-score[clear], kind="stable")]
    hits = np.cumsum(person[order])
    precision = hits / np.arange(1, len(order) + 1)
    at = np.searchsorted(hits, 0.95 * hits[-1])
    loss = np.logaddexp(0.0, score[clear]) - person[clear] * score[clear]
    return {
        "examples": float(count),
        "people": float(person.sum()),
        "log loss": float(loss.mean()),
        "precision at recall 0.95": float(precision[at]),
        "error across, mean [cm]": float(100 * np.abs(across[person]).mean()),
        "error along, mean [px]": float(np.abs(depth[person]).mean()),
        "in the 95 % ellipse": float(inside[person].mean()),
    }


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
    examples = Examples.joined(parts)
    for name, value in cross_validate(examples).items():
        typer.echo(f"{name}: {value:.5g}")
    text = json.dumps(fit(examples).to_mapping(), separators=(",", ":")) + "\n"
    write_text(out, text)
    typer.echo(f"{out}: {len(text) / 1000:.0f} kB")

"""Candidates of bodies with what is truly there."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np

from mrs_people_loc.arrays import Bool, Float, Int, StructOfArrays
from mrs_people_loc.bodies.finder import (
    BODY_TUNING,
    Bodies,
    BodyFinder,
    BodyTuning,
    CandidateEvidence,
)
from mrs_people_loc.bodies.network import PersonNetwork
from mrs_people_loc.config import RobotConfig, load_team
from mrs_people_loc.errors import BagError
from mrs_people_loc.geometry import rotation_2d, yaw_from_quaternion
from mrs_people_loc.messages import stamp_ns_of
from mrs_people_loc.scan import Cells, Scan, ScanStages
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.disparity import StereoMatcher
from mrs_people_loc.sensing.images import Gray, StereoImages
from mrs_people_loc.team.poses import Pose
from mrs_people_loc.timing import StageTimes
from mrs_people_sim.evaluation.labels import Labels
from mrs_studies.recordings.depth_views import StereoView
from mrs_tools.bags.offline import BagRun
from mrs_tools.bags.reader import BagReader

#: A person is at a candidate if within this across the line of sight [m], and along it within a
#: part that is fixed [m] and one in disparity [px], but no more than that [m] ...
_ACROSS, _ALONG, _ALONG_PX, _ALONG_MOST = 0.2, 0.2, 0.7, 0.8
#: ... and nobody is if everybody is farther away than so many times that; whatever is just beside
#: or behind somebody is not them from so many times that on.
_NOBODY, _NOT_THEM = 2.0, 1.1
#: Another robot is at a candidate likewise, within these.
_ROBOT_ACROSS, _ROBOT_ALONG, _ROBOT_ALONG_PX = 0.35, 0.3, 0.3
#: Augmentation of every second image: largest sigma of blur [px] and of noise [grey levels], and
#: contrast, at least and at most.
_BLUR, _NOISE, _CONTRAST = 1.2, 6.0, (0.5, 1.3)
#: A room without people counts with so many frames, however many views of it there are.
_EMPTY_FRAMES = 8
_ROBOT = "robot_a"


@dataclass(frozen=True)
class Examples(StructOfArrays):
    """Candidates, a struct of arrays of one length (n,).

    Attributes:
        even: Even evidence.
        odd: Odd evidence.
        depth: Depth evidence.
        away: Distance to the nearest person in units of what counts as being there.
        across: How far that person's axis is to the left of the patch's middle [m].
        more_px: How much more inverse range that axis has [px].
        inverse_range: Of the patch [px].
        scale: Focal length times baseline of the head [px m].
        robot: Whether it is another robot.
        bag: Number of the bag.
        network: Log-odds by the network.
    """

    even: Float
    odd: Float
    depth: Float
    away: Float
    across: Float
    more_px: Float
    inverse_range: Float
    scale: Float
    robot: Bool
    bag: Int
    network: Float

    @property
    def person(self) -> Bool:
        """Which are people."""
        return (self.away < 1.0) & ~self.robot

    @property
    def clear(self) -> Bool:
        """Which are people or nobody, and not something in between."""
        return ((self.away < 1.0) | (self.away >= _NOBODY)) & ~self.robot

    @property
    def decided(self) -> Bool:
        """Likewise, and what is just beside or behind somebody."""
        return ((self.away < 1.0) | (self.away >= _NOT_THEM)) & ~self.robot


class _Looker:
    """A robot's pipeline up to the evidence; keeps what it saw."""

    def __init__(
        self, robot: str, camera: StereoCamera, config: RobotConfig, tuning: BodyTuning
    ) -> None:
        self.robot, self.camera = robot, camera
        self._match = StereoMatcher(camera, config.disparity)
        min_range = config.disparity.min_range
        shapes = replace(config.bodies, appearance=False)
        self._find = BodyFinder(camera, shapes, min_range=min_range, tuning=tuning)
        self.views: list[tuple[int, CandidateEvidence, Gray]] = []

    def stages(self, images: StereoImages) -> ScanStages:
        disparity = self._match(images)
        view = self._find.look(disparity, images, StageTimes())
        self.views.append((images.stamp_ns, view, images.left))
        return ScanStages(disparity, Scan(self.robot, images.stamp_ns, Cells.empty()), {})

    @functools.cached_property
    def _network(self) -> PersonNetwork:
        return PersonNetwork(self.camera)

    def bodies(self, view: CandidateEvidence) -> Bodies:
        """The candidates at the axes that the present model gives."""
        return self._find.all_bodies(view)

    def by_network(self, view: CandidateEvidence, left: Gray) -> Float:
        """Their log-odds by the network."""
        bodies = self.bodies(view)
        return self._network(left, bodies.bearing, bodies.range)


def _collected_lookers(
    tuning: BodyTuning,
) -> tuple[list[_Looker], Callable[[str, StereoCamera, RobotConfig], _Looker]]:
    """What makes the pipelines of a run, and the list of those that it has made."""
    lookers: list[_Looker] = []

    def make(robot: str, camera: StereoCamera, config: RobotConfig) -> _Looker:
        lookers.append(_Looker(robot, camera, config, tuning))
        return lookers[-1]

    return lookers, make


class _PoseCollector:
    """Stands in for the planner of a run; keeps the last pose of each robot."""

    def __init__(self) -> None:
        self.poses: dict[str, Pose] = {}

    def step(self, _scans: object, poses: Mapping[str, Pose], _time_ns: int) -> None:
        self.poses.update(poses)


@dataclass(frozen=True)
class TrueView:
    """A view of a bag with ground truth.

    Attributes:
        looker: The robot.
        index: Of the view among those of the robot.
        seen: The candidates.
        left: The left image.
        pose: The robot's true pose: x, y [m], yaw [rad], shape (3,).
        people: Where people truly are in the map [m], shape (n, 2); none is NaN.
        others: The other robots, likewise, shape (m, 2).
    """

    looker: _Looker
    index: int
    seen: CandidateEvidence
    left: Gray
    pose: Float
    people: Float
    others: Float

    def examples(self, number: int, network: Float) -> Examples:
        """The candidates as examples of a bag, by what the network says of them."""
        place = self.looker.camera, self.seen, self.pose
        return _examples(*place, self.people, self.others, number, network)


def true_views(
    path: Path, views: int, *, configs: Sequence[Path] = (), tuning: BodyTuning = BODY_TUNING
) -> Iterator[TrueView]:
    """Views of a bag.

    Args:
        path: A bag with ground truth of people and robots, as `mrs simulate` writes it.
        views: So many of each robot's views at most, evenly spread: neighbours are alike.
        configs: Parameter files of the team.
        tuning: Constants of the search, patches and votes.

    Raises:
        PeopleLocError: The bag cannot be used.
    """
    lookers, make = _collected_lookers(tuning)
    run = BagRun(path, configs, pipeline=make)
    truth = run.truth()
    if not len(truth):
        raise BagError(f"{path}: has no ground truth of people")
    for _ in run.intervals():
        pass
    poses = _true_poses(path, [looker.robot for looker in lookers])
    for looker in lookers:
        for index in _spread(len(looker.views), views):
            stamp_ns, seen, left = looker.views[index]
            at = {name: _at(track, stamp_ns) for name, track in poses.items()}
            pose = at.pop(looker.robot)
            people, _ = truth.at(stamp_ns)
            people = people[np.isfinite(people[:, 0])]
            others = np.array([place[:2] for place in at.values()]).reshape(-1, 2)
            yield TrueView(looker, int(index), seen, left, pose, people, others)


def examples_of(
    path: Path,
    number: int,
    *,
    configs: Sequence[Path] = (),
    views: int = 8,
    tuning: BodyTuning = BODY_TUNING,
) -> Examples:
    """The examples of a bag.

    Args:
        path: The bag, as of `true_views`.
        number: What `Examples.bag` shall say.
        configs: As of `true_views`.
        views: Likewise.
        tuning: Likewise.

    Raises:
        PeopleLocError: The bag cannot be used.
    """
    parts = []
    for view in true_views(path, views, configs=configs, tuning=tuning):
        left = view.left
        if view.index % 2:
            left = _augmented(left, np.random.default_rng([number, view.index]))
        parts.append(view.examples(number, view.looker.by_network(view.seen, left)))
    return Examples.joined(parts)


def labelled_examples(path: Path, labels: Labels, number: int) -> Examples:
    """The examples of a recording with hand labels, whose robots stand.

    Candidates near somebody who may be found but need not are left out.

    Args:
        path: The bag.
        labels: Its labels.
        number: What `Examples.bag` shall say.

    Raises:
        PeopleLocError: The bag cannot be used.
    """
    lookers, make = _collected_lookers(BODY_TUNING)
    collector = _PoseCollector()
    run = BagRun(path, pipeline=make, planner=lambda _: collector)
    for _ in run.intervals():
        pass
    truth, nobody, parts = labels.truth(trunk=True), np.empty((0, 2)), []
    for looker in lookers:
        pose = collector.poses[looker.robot]
        at = np.array([pose.x, pose.y, pose.yaw])
        for stamp_ns, view, left in looker.views:
            people, must = truth.at(stamp_ns)
            network = looker.by_network(view, left)
            common = looker.camera, view, at
            some = _examples(*common, people[must], nobody, number, network)
            others = _examples(*common, people[~must], nobody, number, network)
            parts.append(some.select(some.person | (others.away >= _NOBODY)))
    return Examples.joined(parts)


def empty_examples(views: Sequence[StereoView], number: int) -> Examples:
    """The examples of a room in which nobody is.

    Args:
        views: What a head sees of it.
        number: What `Examples.bag` shall say.
    """
    config, nobody, parts = load_team(robots=(_ROBOT,)).robots[_ROBOT], np.empty((0, 2)), []
    rng = np.random.default_rng(number)
    for index in range(_EMPTY_FRAMES):
        camera = views[index % len(views)].camera
        looker = _Looker(_ROBOT, camera, config, BODY_TUNING)
        looker.stages(StereoImages(index, *views[index % len(views)].images(rng)))
        ((_, view, left),) = looker.views
        network = looker.by_network(view, left)
        parts.append(_examples(camera, view, np.zeros(3), nobody, nobody, number, network))
    return Examples.joined(parts)


def _spread(count: int, most: int) -> Int:
    """So many indices at most, evenly spread."""
    return np.unique(np.linspace(0, count - 1, min(count, most)).round().astype(np.intp))


def _augmented(left: Gray, rng: np.random.Generator) -> Gray:
    """The image of a worse camera: blurred, of another contrast, noisy."""
    image: Any = left.astype(np.float32)
    image = cv2.GaussianBlur(image, (0, 0), max(float(rng.uniform(0.0, _BLUR)), 0.1))
    image = (image - image.mean()) * float(rng.uniform(*_CONTRAST)) + image.mean()
    image += rng.normal(0.0, rng.uniform(0.0, _NOISE), image.shape)
    return np.clip(np.rint(image), 0, 255).astype(np.uint8)


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
    camera: StereoCamera,
    view: CandidateEvidence,
    pose: Float,
    people: Float,
    others: Float,
    number: int,
    network: Float,
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
    robot = np.abs(other_across) < _ROBOT_ACROSS
    robot &= np.abs(other_along) < _ROBOT_ALONG + _ROBOT_ALONG_PX * other_far**2 / scale
    return Examples(
        even=view.evidence.even,
        odd=view.evidence.odd,
        depth=view.evidence.depth,
        away=distance[row, nearest],
        across=across[row, nearest],
        more_px=scale / (ranges + along[row, nearest]) - inverse,
        inverse_range=inverse,
        scale=np.full(count, scale),
        robot=np.asarray(robot.any(axis=1)),
        bag=np.full(count, number),
        network=network,
    )

"""Candidates of bodies with what is truly there."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import yaml

from mrs_people_loc.arrays import Bool, Float, Int, StructOfArrays
from mrs_people_loc.bodies.finder import BODY_TUNING, BodyFinder, BodyTuning, CandidateEvidence
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.errors import BagError
from mrs_people_loc.geometry import rotation_2d, yaw_from_quaternion
from mrs_people_loc.messages import stamp_ns_of
from mrs_people_loc.scan import Cells, Scan, ScanStages
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.disparity import StereoMatcher
from mrs_people_loc.sensing.images import StereoImages
from mrs_people_loc.timing import StageTimes
from mrs_tools.bags.offline import BagRun
from mrs_tools.bags.rosbag import BagReader
from mrs_tools.bags.truth import ASSETS_TOPIC

#: A person is at a candidate if within this across the line of sight [m], and along it within a
#: part that is fixed [m] and one in disparity [px], but no more than that [m] ...
_ACROSS, _ALONG, _ALONG_PX, _ALONG_MOST = 0.2, 0.2, 0.7, 0.8
#: ... and nobody is if everybody is farther away than so many times that.
_NOBODY = 2.0
#: Another robot is at a candidate likewise, within these.
_ROBOT_ACROSS, _ROBOT_ALONG, _ROBOT_ALONG_PX = 0.35, 0.3, 0.3


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

    @property
    def person(self) -> Bool:
        """Which are people."""
        return (self.away < 1.0) & ~self.robot

    @property
    def clear(self) -> Bool:
        """Which are people or nobody, and not something in between."""
        return ((self.away < 1.0) | (self.away >= _NOBODY)) & ~self.robot


class _Looker:
    """A robot's pipeline up to the evidence; keeps what it saw."""

    def __init__(
        self, robot: str, camera: StereoCamera, config: RobotConfig, tuning: BodyTuning
    ) -> None:
        self.robot, self.camera = robot, camera
        self._match = StereoMatcher(camera, config.disparity)
        min_range = config.disparity.min_range
        self._find = BodyFinder(camera, config.bodies, min_range=min_range, tuning=tuning)
        self.views: list[tuple[int, CandidateEvidence]] = []

    def stages(self, images: StereoImages) -> ScanStages:
        disparity = self._match(images)
        view = self._find.look(disparity, images, StageTimes())
        self.views.append((images.stamp_ns, view))
        return ScanStages(disparity, Scan(self.robot, images.stamp_ns, Cells.empty()), {})


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
        path: A bag with ground truth of people and robots, as `mrs simulate` writes it.
        number: What `Examples.bag` shall say.
        configs: Parameter files of the team.
        views: So many of each robot's views at most, evenly spread: neighbours are alike.
        tuning: Constants of the search, patches and votes.

    Raises:
        PeopleLocError: The bag cannot be used.
    """
    lookers: list[_Looker] = []

    def make(robot: str, camera: StereoCamera, config: RobotConfig) -> _Looker:
        lookers.append(_Looker(robot, camera, config, tuning))
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
    return Examples.concatenate(parts)


def assets_of(bags: Sequence[Path]) -> list[dict[str, str]]:
    """Meshes that are in bags of `mrs simulate --assets`: file, licence and origin of each.

    Raises:
        BagError: A bag or its list of meshes cannot be read.
    """
    found: dict[str, dict[str, str]] = {}
    for path in bags:
        with BagReader(path) as bag:
            if ASSETS_TOPIC in bag.topics:
                for _, _, message in bag.decoded([ASSETS_TOPIC]):
                    try:
                        items = yaml.safe_load(message.data)
                        found.update({str(item["file"]): dict(item) for item in items})
                    except (yaml.YAMLError, TypeError, ValueError, KeyError) as err:
                        raise BagError(f"{path}: {ASSETS_TOPIC} is no list of meshes") from err
    return [found[file] for file in sorted(found)]


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
    )

"""Rendered views with the people that they show, by the ground truth of simulated bags."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.scan import Cells, Scan, ScanStages
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import Gray, StereoImages
from mrs_studies.fitting.examples import _at, _PoseCollector, _spread, _true_poses
from mrs_studies.training.pictures import PERSON, UNKNOWN, Picture, figure
from mrs_tools.bags.offline import BagRun

#: Views of each robot and bag, at most.
_VIEWS = 16
#: Half of the width of people and robots with room beside them, and their heights [m].
_HALF, _PERSON_HEIGHT, _ROBOT_HEIGHT = 0.27, 1.78, 1.4
#: Views are centred on people within this [m]; whoever is nearer than this is left out [m].
_FARTHEST, _NEAREST = 6.0, 0.2


class Looker:
    """A robot that keeps its left images, with their stamps [ns]."""

    def __init__(self, robot: str, camera: StereoCamera, _config: RobotConfig) -> None:
        self.robot, self.camera = robot, camera
        self.views: list[tuple[int, Gray]] = []

    def stages(self, images: StereoImages) -> ScanStages:
        """Keeps one."""
        self.views.append((images.stamp_ns, images.left))
        nothing = np.full(images.left.shape, np.nan, dtype=np.float32)
        return ScanStages(nothing, Scan(self.robot, images.stamp_ns, Cells.empty()), {})


def lookers_of(path: Path) -> list[Looker]:
    """The robots of a bag, with all their left images.

    Args:
        path: The bag.

    Raises:
        PeopleLocError: It cannot be used.
    """
    lookers: list[Looker] = []

    def make(robot: str, camera: StereoCamera, config: RobotConfig) -> Looker:
        lookers.append(Looker(robot, camera, config))
        return lookers[-1]

    for _ in BagRun(path, pipeline=make, planner=lambda _: _PoseCollector()).intervals():
        pass
    return lookers


def pictures_of(path: Path) -> Iterator[Picture]:
    """Views of a bag of `mrs render-suite`.

    Args:
        path: The bag.

    Raises:
        PeopleLocError: It cannot be used.
    """
    lookers, truth = lookers_of(path), BagRun(path).truth()
    poses = _true_poses(path, [looker.robot for looker in lookers])
    for looker in lookers:
        for k in _spread(len(looker.views), _VIEWS):
            stamp_ns, left = looker.views[k]
            at = {name: _at(track, stamp_ns) for name, track in poses.items()}
            pose = at.pop(looker.robot)
            people = truth.at(stamp_ns)[0]
            people = people[np.isfinite(people[:, 0])]
            others = np.array([place[:2] for place in at.values()]).reshape(-1, 2)
            local = [(places - pose[:2]) @ rotation_2d(pose[2]) for places in (people, others)]
            yield _labelled(left, looker.camera, *local)


def _labelled(left: Gray, camera: StereoCamera, people: Float, robots: Float) -> Picture:
    """A view with people and robots at places in base_link [m]; the nearest ones hide others."""
    rotation, lens = camera.robot_from_optical
    label, boxes = np.zeros(left.shape, np.uint8), []
    column, row = np.meshgrid(np.arange(left.shape[1]), np.arange(left.shape[0]))
    things = [(place, True) for place in people] + [(place, False) for place in robots]
    for place, person in sorted(things, key=lambda one: -np.hypot(*(one[0] - lens[:2]))):
        away = np.hypot(*(place - lens[:2]))
        aside = _HALF * np.array([lens[1] - place[1], place[0] - lens[0]]) / away
        height = _PERSON_HEIGHT if person else _ROBOT_HEIGHT
        corners = [[*(place + side * aside), z] for side in (-1, 1) for z in (0.0, height)]
        seen = (np.array(corners) - lens) @ rotation
        if (seen[:, 2] < _NEAREST).any():
            continue
        u = camera.fx * seen[:, 0] / seen[:, 2] + camera.cx
        v = camera.fy * seen[:, 1] / seen[:, 2] + camera.cy
        across, down = (column - u.min()) / np.ptp(u), (row - v.min()) / np.ptp(v)
        inside = (across >= 0) & (across < 1) & (down >= 0) & (down < 1)
        if not inside.any():
            continue
        label[inside] = UNKNOWN
        if person:
            shape = figure(tall=True)
            rows, columns = (shape.shape * np.stack([down, across], axis=-1)[inside]).astype(int).T
            label[inside] = np.where(shape[rows, columns] == PERSON, PERSON, UNKNOWN)
            if away < _FARTHEST:
                x0, x1 = np.clip([u.min(), u.max()], 0, left.shape[1])
                y0, y1 = np.clip([v.min(), v.max()], 0, left.shape[0])
                boxes.append([x0, y0, x1, y1])
    return Picture(left, label, np.array(boxes, dtype=np.float64).reshape(-1, 4))

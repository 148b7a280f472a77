"""Rendered views with the people that they show, by the ground truth of simulated bags."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.bodies.finder import Bodies
from mrs_people_loc.bodies.patches import upright_pixels
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import Gray
from mrs_studies.fitting.examples import Examples, true_views
from mrs_studies.training.pictures import BODY_HEIGHT, PERSON, UNKNOWN, Picture, figure

#: Views of each robot and bag, at most.
_VIEWS = 16
#: Half of the width of people and robots with room beside them, and their heights [m].
_HALF, _PERSON_HEIGHT, _ROBOT_HEIGHT = 0.27, 1.78, 1.4
#: Views are centred on people within this [m]; whoever is nearer than this is left out [m].
_FARTHEST, _NEAREST = 6.0, 0.2


def pictures_of(path: Path) -> Iterator[Picture]:
    """Views of a bag of `mrs render-suite`, with the candidates of the body finder.

    Args:
        path: The bag.

    Raises:
        PeopleLocError: It cannot be used.
    """
    for view in true_views(path, _VIEWS):
        turn, camera = rotation_2d(view.pose[2]), view.looker.camera
        people, robots = ((some - view.pose[:2]) @ turn for some in (view.people, view.others))
        bodies = view.looker.bodies(view.seen)
        places = _places(camera, bodies, view.examples(0, np.zeros(len(bodies))))
        yield _labelled(view.left, camera, people, robots)._replace(places=places)


def _places(camera: StereoCamera, bodies: Bodies, some: Examples) -> Float:
    """Candidates as places of a picture."""
    heights, across = np.array([0.0, BODY_HEIGHT], dtype=np.float32), np.zeros(1, np.float32)
    u, v, _, _ = upright_pixels(camera, bodies.bearing, bodies.range, heights, across)
    tall = np.hypot(u[:, 1, 0] - u[:, 0, 0], v[:, 1, 0] - v[:, 0, 0])
    places = [u[:, 0, 0], v[:, 0, 0], tall / BODY_HEIGHT, some.person]
    return np.column_stack(places)[some.decided].astype(np.float64)


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

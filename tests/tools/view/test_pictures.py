"""Images for the page: places of bodies and walls worked out by hand."""

from __future__ import annotations

import base64

import cv2
import numpy as np

from mrs_people_loc.config import Mounting
from mrs_people_loc.scan import BODY_DTYPE, CELL_DTYPE, Cells
from mrs_people_loc.sensing.camera import CameraModel
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_tools.view.pictures import body_boxes, grid_of, in_colours, jpeg

P = np.array([[100.0, 0, 80.0, 0], [0, 100.0, 60.0, 0], [0, 0, 1.0, 0]])
CAMERA = CameraModel(160, 120, np.eye(3), (), np.eye(3), P)
MOUNTING = Mounting(height=1.0)


def cells(*rows: tuple[float, float, float, int]) -> Cells:
    """Cells by x, y, top [m] and body."""
    records = np.zeros(len(rows), BODY_DTYPE)
    for record, (x, y, top, body) in zip(records, rows, strict=True):
        record["x"], record["y"], record["top"], record["body"] = x, y, top, body
    return Cells.from_records(records)


def test_box_of_a_body() -> None:
    """Two metres ahead, 1.5 m high, 5 cm around each cell: the nearest corners are at 1.95 m."""
    (box,) = body_boxes(cells((2.0, 0.2, 1.4, 1), (2.0, -0.2, 1.5, 1)), CAMERA, MOUNTING)
    aside, above, below = 100.0 * 0.25 / 1.95, 100.0 * 0.5 / 1.95, 100.0 * 1.0 / 1.95
    assert box == tuple(map(round, (80 - aside, 60 - above, 80 + aside, 60 + below)))


def test_bodies_out_of_view_and_other_cells_have_no_box() -> None:
    behind, aside, no_body = (-2.0, 0.0, 1.7, 1), (1.0, 5.0, 1.7, 2), (2.0, 0.0, 1.7, 0)
    assert body_boxes(cells(behind, aside, no_body), CAMERA, MOUNTING) == []
    assert body_boxes(Cells.from_records(np.zeros(3, CELL_DTYPE)), CAMERA, MOUNTING) == []


def test_head_that_looks_back_sees_who_is_behind() -> None:
    mounting = Mounting(height=1.0, yaw=np.pi)
    assert len(body_boxes(cells((-2.0, 0.0, 1.7, 1)), CAMERA, mounting)) == 1


def test_map_is_drawn_as_map_server_does() -> None:
    data = np.array([[0, 100, -1], [25, 65, 50]], np.int8)  # the first row is the lowest
    grid = grid_of(OccupancyGrid(resolution=0.05, x=1.0, y=2.0, yaw=0.1, data=data))
    png = np.frombuffer(base64.b64decode(grid["png"]), np.uint8)
    image = cv2.imdecode(png, cv2.IMREAD_GRAYSCALE)
    assert image is not None
    assert image.tolist() == [[254, 0, 205], [254, 0, 205]]
    assert (grid["width"], grid["height"], grid["resolution"], grid["yaw"]) == (3, 2, 0.05, 0.1)


def test_wall_of_a_large_map_stays() -> None:
    data = np.zeros((4097, 10), np.int8)
    data[7, 4] = 100
    grid = grid_of(OccupancyGrid(resolution=0.1, x=0.0, y=0.0, yaw=0.0, data=data))
    assert (grid["width"], grid["height"], grid["resolution"]) == (4, 1366, 0.3)
    png = np.frombuffer(base64.b64decode(grid["png"]), np.uint8)
    image = cv2.imdecode(png, cv2.IMREAD_GRAYSCALE)
    assert image is not None
    assert np.argwhere(image[::-1] == 0).tolist() == [[2, 1]]


def test_disparities_are_red_near_blue_far_and_black_where_there_is_none() -> None:
    none, below, far, near = in_colours(
        np.array([[np.nan, -1.0, 2.5, 9.5]], np.float32), 2.0, 10.0
    )[0].astype(int)
    assert none.tolist() == below.tolist() == [0, 0, 0]
    assert far[0] > far[2]
    assert near[2] > near[0]


def test_jpeg_keeps_the_size() -> None:
    packed = np.frombuffer(base64.b64decode(jpeg(np.full((12, 34), 200, np.uint8))), np.uint8)
    image = cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE)
    assert image is not None
    assert image.shape == (12, 34)
    assert abs(int(image.mean()) - 200) < 3

"""What robots see, and maps, as images for the page."""

from __future__ import annotations

import base64

import cv2
import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Float32
from mrs_people_loc.config import Mounting
from mrs_people_loc.errors import ImageError
from mrs_people_loc.scan import Cells
from mrs_people_loc.sensing.camera import CameraModel, robot_from_optical
from mrs_people_loc.sensing.images import Gray
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_tools.view.protocol import Grid

#: Larger images are scaled down to fit [px].
WIDTH, HEIGHT = 480, 360
#: Larger maps are shown with fewer, larger cells, so that no side is longer than this [cells].
_MAX_SIDE = 2048
_JPEG_QUALITY = 75
#: Shades of grey of a map, as map_server writes them, and what is occupied [%].
_OCCUPIED, _FREE, _UNKNOWN = 0, 254, 205
_OCCUPIED_FROM, _FREE_TO = 65, 25
#: Half a cell of a scan, by which a body is wider than its cells' centres [m].
_HALF_CELL_M = 0.05
#: What is nearer than this to the lens has no place in the image [m].
_NEAREST_M = 0.1
_BOX_BGR = (60, 220, 60)

Colours = NDArray[np.uint8]


def jpeg(image: Gray | Colours) -> str:
    """An image, grey or BGR, as a JPEG in base64."""
    ok, data = cv2.imencode(".jpg", image, [cv2.IMWRITE_JPEG_QUALITY, _JPEG_QUALITY])
    if not ok:
        raise ImageError(f"an image of shape {image.shape} cannot be written as JPEG")
    return base64.b64encode(data.tobytes()).decode("ascii")


def body_boxes(cells: Cells, camera: CameraModel, mounting: Mounting) -> list[tuple[int, ...]]:
    """Where the bodies of a scan are in the left image.

    Args:
        cells: The scan's, in the robot's frame.
        camera: Of the rectified image.
        mounting: Where the camera is on the robot.

    Returns:
        Left, upper, right and lower edge of each body [px], cut at the image's edges.
    """
    rotation, origin = robot_from_optical(mounting)
    boxes = []
    for body in np.unique(cells.body[cells.body > 0]):
        own = cells.body == body
        xy = np.stack([cells.x[own], cells.y[own]], axis=1).astype(np.float64)
        around = _HALF_CELL_M * np.array([[1, 1], [1, -1], [-1, 1], [-1, -1]])
        floor = (xy[:, np.newaxis] + around).reshape(-1, 2)
        heights = np.repeat([0.0, float(cells.top[own].max())], len(floor))
        corners = np.column_stack([np.tile(floor, (2, 1)), heights])
        u, v, depth = camera.p[:, :3] @ rotation.T @ (corners - origin).T
        seen = depth > _NEAREST_M
        if not seen.any():
            continue
        u, v = u[seen] / depth[seen], v[seen] / depth[seen]
        limits = (camera.width - 1, camera.height - 1)
        low = np.clip([u.min(), v.min()], 0, limits)
        high = np.clip([u.max(), v.max()], 0, limits)
        if (low < high).all():
            boxes.append(tuple(int(edge) for edge in np.rint([*low, *high])))
    return boxes


def with_boxes(image: Gray, boxes: list[tuple[int, ...]]) -> Colours:
    """A grey image with boxes drawn into it, BGR."""
    drawn = cv2.cvtColor(image, cv2.COLOR_GRAY2BGR)
    for left, upper, right, lower in boxes:
        cv2.rectangle(drawn, (left, upper), (right, lower), _BOX_BGR, 2)
    return drawn  # type: ignore[return-value]


def in_colours(disparity: Float32, low: float, high: float) -> Colours:
    """Disparities in colours from blue (far) to red (near), BGR; black where there is none.

    Args:
        disparity: [px], shape (height, width), NaN where there is none.
        low: Disparity of the farthest depth [px].
        high: Of the nearest.
    """
    known = np.isfinite(disparity) & (disparity >= low)
    share = (np.where(known, disparity, low) - low) / max(high - low, 1e-6)
    shades = (255.0 * np.clip(share, 0.0, 1.0)).astype(np.uint8)
    coloured = cv2.applyColorMap(shades, cv2.COLORMAP_TURBO)
    coloured[~known] = 0
    return coloured  # type: ignore[return-value]


def grid_of(grid: OccupancyGrid) -> Grid:
    """An occupancy grid for the page."""
    height, width = grid.data.shape
    step = -(-max(height, width) // _MAX_SIDE)
    shades = np.full((-(-height // step) * step, -(-width // step) * step), _UNKNOWN, np.uint8)
    data = grid.data
    shades[:height, :width] = np.where(
        data >= _OCCUPIED_FROM,
        _OCCUPIED,
        np.where((data >= 0) & (data <= _FREE_TO), _FREE, _UNKNOWN),
    )
    rows, columns = shades.shape[0] // step, shades.shape[1] // step
    # The darkest of those that become one: a wall stays.
    shades = shades.reshape(rows, step, columns, step).min(axis=(1, 3))
    ok, data_png = cv2.imencode(".png", shades[::-1])
    assert ok
    return Grid(
        width=columns,
        height=rows,
        resolution=round(grid.resolution * step, 6),
        x=round(grid.x, 3),
        y=round(grid.y, 3),
        yaw=round(grid.yaw, 4),
        png=base64.b64encode(data_png.tobytes()).decode("ascii"),
    )

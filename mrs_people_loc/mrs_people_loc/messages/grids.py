"""Maps."""

from __future__ import annotations

import math

import numpy as np

from mrs_people_loc.errors import GridError
from mrs_people_loc.geometry import yaw_from_quaternion
from mrs_people_loc.messages.poses import QUATERNION_TOLERANCE
from mrs_people_loc.messages.stamps import Message
from mrs_people_loc.team.masking import OccupancyGrid


def read_occupancy_grid(message: Message, map_frame: str) -> OccupancyGrid:
    """Reads nav_msgs/OccupancyGrid.

    Args:
        message: The message.
        map_frame: The frame that it must be in: the common one.

    Raises:
        GridError: The frame, a size or a value is wrong, or the grid does not lie level.
    """
    if message.header.frame_id.lstrip("/") != map_frame:
        raise GridError(f"frame_id is {message.header.frame_id!r}; wanted: {map_frame!r}")
    info = message.info
    width, height = int(info.width), int(info.height)
    data = np.asarray(message.data)
    if data.size != width * height or not data.size:
        raise GridError(
            f"data has {data.size} cells; wanted: width * height = {width} * {height}, more than 0"
        )
    if data.dtype != np.int8:  # a plain list
        if not np.isin(data, np.arange(-128, 128)).all():
            raise GridError("data holds what is no int8; wanted: -1, or 0 to 100")
        data = data.astype(np.int8)
    position, q = info.origin.position, info.origin.orientation
    values = (q.x, q.y, q.z, q.w)
    norm = math.hypot(*values)
    if not abs(norm - 1.0) <= QUATERNION_TOLERANCE:
        raise GridError(f"origin has an orientation of length {norm:.4g}; wanted: a quaternion, 1")
    if math.hypot(q.x, q.y) > QUATERNION_TOLERANCE:
        raise GridError(f"origin's orientation is {values}; wanted: a level grid, turned about z")
    return OccupancyGrid(
        resolution=float(info.resolution),
        x=float(position.x),
        y=float(position.y),
        yaw=yaw_from_quaternion(*values),
        data=data.reshape(height, width),
    )

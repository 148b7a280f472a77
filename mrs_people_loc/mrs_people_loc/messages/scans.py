"""Scans of robots."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.errors import ScanError
from mrs_people_loc.messages.stamps import Message, stamp_ns_of
from mrs_people_loc.scan import BODY_DTYPE, CELL_DTYPE, Cells, Scan

#: PointField's datatypes (sensor_msgs/PointField).
_POINT_FIELD_TYPES = {1: "i1", 2: "u1", 3: "<i2", 4: "<u2", 5: "<i4", 6: "<u4", 7: "<f4", 8: "<f8"}
#: More than any robot sends (`bodies.max_count`), and more than a planner has time for.
_MAX_BODIES = 100
MAX_CELLS = 10_000


def read_scan(message: Message, robot: str, frame_id: str | None = None) -> Scan:
    """Reads a scan from sensor_msgs/PointCloud2, taking fields by name.

    Args:
        message: The message.
        robot: Name of the robot that sent it.
        frame_id: The frame it must be in; None: `<robot>/base_link`.

    Raises:
        ScanError: The frame, a field, the layout or a value is wrong.
    """
    wanted_frame = f"{robot}/base_link" if frame_id is None else frame_id
    if message.header.frame_id != wanted_frame:
        raise ScanError(f"frame_id is {message.header.frame_id!r}; wanted: {wanted_frame!r}")
    if message.is_bigendian:
        raise ScanError("is_bigendian is true; wanted: little-endian data")
    records = _records(message)
    with np.errstate(over="ignore", invalid="ignore"):  # what float32 cannot hold is refused as inf
        cells = Cells.from_records(records)
    bodies = len(np.unique(cells.body[cells.body > 0]))
    if bodies > _MAX_BODIES:
        raise ScanError(f"scan has {bodies} bodies; allowed: up to {_MAX_BODIES}")
    for name in ("sigma_range", "sigma_across"):
        if (getattr(cells, name)[cells.body > 0] <= 0).any():
            raise ScanError(f"{name} of a body is 0 or less; wanted: more than 0")
    return Scan(robot, stamp_ns_of(message.header.stamp), cells)


def _records(message: Message) -> NDArray[np.void]:
    """The cells of a PointCloud2 as records, with the fields of `CELL_DTYPE` or `BODY_DTYPE`.

    Raises:
        ScanError: A field, the layout or a count is wrong.
    """
    fields = {field.name: field for field in message.fields}
    # Either a plain scan or one of bodies, which has all of these.
    of_bodies = "body" in fields
    dtype = BODY_DTYPE if of_bodies else CELL_DTYPE
    names = dtype.names or ()
    point_step, row_step = int(message.point_step), int(message.row_step)
    formats, offsets = _formats_and_offsets(fields, names, point_step)
    width, height = int(message.width), int(message.height)
    if row_step < width * point_step:
        raise ScanError(f"row_step is {row_step}; wanted: at least {width * point_step}")
    data = np.frombuffer(message.data, dtype=np.uint8)
    if data.size != row_step * height:
        raise ScanError(
            f"data has {data.size} bytes; wanted: row_step * height = {row_step * height}"
        )
    if width * height > MAX_CELLS:
        raise ScanError(f"scan has {width * height} cells; allowed: up to {MAX_CELLS}")
    if width * height == 0:
        return np.empty(0, dtype)
    layout = np.dtype(
        {"names": names, "formats": formats, "offsets": offsets, "itemsize": point_step}
    )
    rows = np.ascontiguousarray(data.reshape(height, row_step)[:, : width * point_step])
    records = rows.reshape(-1).view(layout)
    for name in ("count", "body") if of_bodies else ("count",):
        numbers = records[name]
        if numbers.dtype.kind == "f" and not np.isfinite(numbers).all():
            raise ScanError(f"{name} is NaN or infinite")
        if (numbers < 0).any() or (numbers >= 2**32).any():
            raise ScanError(f"{name} is negative or too large; wanted: uint32")
    return records


def _formats_and_offsets(
    fields: Mapping[str, Message], names: tuple[str, ...], point_step: int
) -> tuple[list[str], list[int]]:
    """NumPy formats of the named fields of a PointCloud2, and their first bytes in a point.

    Raises:
        ScanError: One is missing, is no single number, or does not fit into a point.
    """
    missing = [name for name in names if name not in fields]
    if missing:
        raise ScanError(
            f"fields are missing: {', '.join(missing)}; got: {', '.join(fields) or 'none'}; "
            f"wanted: {', '.join(names)}"
        )
    formats, offsets = [], []
    for name in names:
        field = fields[name]
        code = _POINT_FIELD_TYPES.get(int(field.datatype))
        if code is None or int(field.count) != 1:
            raise ScanError(
                f"field {name} has datatype {field.datatype} and count {field.count}; "
                "wanted: one number"
            )
        end = int(field.offset) + np.dtype(code).itemsize
        if end > point_step:
            raise ScanError(f"field {name} ends at byte {end}; point_step is {point_step}")
        formats.append(code)
        offsets.append(int(field.offset))
    return formats, offsets

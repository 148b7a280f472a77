"""Reads organised PCD files."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.errors import BagError
from mrs_people_loc.sensing.images import Gray
from mrs_tools.installing import how_to_install

#: Depths beyond these are none [m].
_NEAREST_M, _FARTHEST_M = 0.05, 1000.0
#: What is read of a PCD file at most: bytes per line of its header, numbers per point, bytes.
_MAX_PCD_LINE, _MAX_PCD_VALUES, _MAX_PCD_BYTES = 1000, 100, 256 << 20


def read_rgbd(file: Path) -> tuple[Gray, Float]:
    """Reads an organised PCD file.

    Returns:
        Grey image, uint8, and depth along the optical axis [m], NaN where there is none; both of
        shape (height, width).

    Raises:
        BagError: The file cannot be read, or is not organised with x, y, z and rgb(a).
    """
    try:
        from pypcd4 import PointCloud  # needed by this converter alone
    except ImportError as err:
        how = how_to_install("pypcd4")
        raise BagError(f"reading PCD files needs pypcd4, which is not installed: {how}") from err
    if not file.is_file():
        raise BagError(f"{file} is no file")
    try:
        _check_pcd_size(file)
        cloud = PointCloud.from_path(file)
    except BagError:
        raise
    except Exception as err:  # pypcd4 raises whatever its parsing stumbles on
        reason = " ".join(str(err).split())
        raise BagError(f"{file} cannot be read as a PCD file: {reason}") from err
    about, points = cloud.metadata, cloud.pc_data
    names = points.dtype.names or ()
    color = next((name for name in ("rgba", "rgb") if name in names), None)
    shape = (int(about.height), int(about.width))
    if color is None or "z" not in names or shape[0] < 2 or shape[1] < 2:
        raise BagError(
            f"{file} has fields {', '.join(names)} and {shape[1]}x{shape[0]} points; "
            "wanted: an organised cloud with x, y, z and rgb or rgba"
        )
    color_bytes = points.dtype[color].itemsize
    if points.shape != (shape[0] * shape[1],) or color_bytes != 4:
        raise BagError(
            f"{file} has {points.size} points with colours of {color_bytes} bytes; "
            f"wanted: {shape[1]}x{shape[0]} points, 4 bytes"
        )
    depth = points["z"].astype(np.float64).reshape(shape)
    packed = np.ascontiguousarray(points[color]).view(np.uint32).reshape(shape)
    bgr = np.stack([(packed >> shift) & 255 for shift in (0, 8, 16)], axis=-1).astype(np.uint8)
    with np.errstate(invalid="ignore"):
        depth[~((depth >= _NEAREST_M) & (depth <= _FARTHEST_M))] = np.nan
    return cv2.cvtColor(bgr, cv2.COLOR_BGR2GRAY).astype(np.uint8), depth


def _check_pcd_size(file: Path) -> None:
    """Raise if a PCD file's header says more than is read; pypcd4 would allocate it all."""
    from pypcd4 import MetaData

    with file.open("rb") as stream:
        lines: list[str] = []
        while not (lines and lines[-1].startswith("DATA")):
            line = stream.readline(_MAX_PCD_LINE)
            if not line or len(line) == _MAX_PCD_LINE:
                raise BagError(f"{file} cannot be read as a PCD file: its header has no end")
            if not line.startswith(b"#") and line.strip():
                lines.append(line.decode().strip())
        about = MetaData.parse_header(lines)
        if len(lines) > 10 or not len(about.fields) == len(about.count) == len(about.size):
            raise BagError(f"{file} cannot be read as a PCD file: its header is no header")
        asked = about.points * sum(s * c for s, c in zip(about.size, about.count, strict=True))
        if about.data.value.startswith("binary") and about.data.value != "binary":
            asked = max(asked, *np.frombuffer(stream.read(8), "<u4").astype(int))
    values = sum(about.count)
    if asked > _MAX_PCD_BYTES or values > _MAX_PCD_VALUES:
        raise BagError(
            f"{file} has {values} values per point, {about.points} points, {asked} bytes; "
            f"allowed: {_MAX_PCD_VALUES} values per point, {_MAX_PCD_BYTES} bytes"
        )

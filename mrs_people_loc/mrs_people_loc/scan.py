"""A robot's scan: the occupied cells of the ground plane, and their bytes on the wire."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Float32, StructOfArrays
from mrs_people_loc.errors import ScanError

#: One cell on the wire (`points`, sensor_msgs/PointCloud2), little-endian.
CELL_DTYPE = np.dtype(
    [("x", "<f4"), ("y", "<f4"), ("z", "<f4"), ("z_min", "<f4"), ("top", "<f4"), ("count", "<u4")]
)
#: One cell of a body on the wire: a scan of bodies has these fields in addition.
BODY_DTYPE = np.dtype(
    [
        *((name, CELL_DTYPE[name].str) for name in CELL_DTYPE.names or ()),
        ("body", "<u4"), ("score", "<f4"), ("sigma_range", "<f4"), ("sigma_across", "<f4"),
    ]
)  # fmt: skip
_NAMES = BODY_DTYPE.names or ()


#: Stands for a field that is not given: zeros.
_MISSING: Any = None


@dataclass(frozen=True)
class Cells(StructOfArrays):
    """Occupied cells of the ground plane, a struct of arrays of one length (n,).

    Attributes:
        x: Cell centre [m], float32.
        y: Cell centre [m], float32.
        z: Highest point in the zone [m], float32.
        z_min: Lowest point in the zone [m], float32.
        top: Highest supported point of the column, measured before the zone cut [m], float32.
        count: Number of 3D points in the cell, uint32.
        body: Which body of its scan the cell belongs to, from 1; 0: none, as in scans of the
            paper's method, uint32.
        score: Log-odds that this body is a person, float32.
        sigma_range: Standard deviation of the body's place along the line of sight [m], float32.
        sigma_across: Likewise, across it [m], float32.
    """

    x: Float32
    y: Float32
    z: Float32
    z_min: Float32
    top: Float32
    count: NDArray[np.uint32]
    body: NDArray[np.uint32] = _MISSING
    score: Float32 = _MISSING
    sigma_range: Float32 = _MISSING
    sigma_across: Float32 = _MISSING

    def __post_init__(self) -> None:
        """Checks shapes, types and values.

        Raises:
            ScanError: Naming the field, what it is and what is wanted.
        """
        size = len(self.x)
        for name in _NAMES:
            dtype, value = BODY_DTYPE[name], getattr(self, name)
            if value is _MISSING:
                value = np.zeros(size, dtype)
                object.__setattr__(self, name, value)
            if value.shape != (size,):
                raise ScanError(f"{name} has shape {value.shape}; wanted: ({size},)")
            if value.dtype != dtype:
                raise ScanError(f"{name} is {value.dtype}; wanted: {dtype}")
            if dtype.kind == "f":
                bad = size - np.count_nonzero(np.isfinite(value))
                if bad:
                    raise ScanError(f"{name} is NaN or infinite in {bad} of {size} points")

    @classmethod
    def empty(cls) -> Cells:
        """No cell at all."""
        return cls.from_records(np.empty(0, CELL_DTYPE))

    @classmethod
    def from_records(cls, records: NDArray[np.void]) -> Cells:
        """Builds cells from a structured array with (at least) the fields of `CELL_DTYPE`."""
        given = records.dtype.names or ()
        return cls(
            **{
                name: np.ascontiguousarray(records[name], dtype=BODY_DTYPE[name])
                for name in _NAMES
                if name in given or name in (CELL_DTYPE.names or ())
            }
        )

    @classmethod
    def union(cls, parts: Sequence[Cells]) -> Cells:
        """All cells of several scans, in their order."""
        return cls.joined(parts) if parts else cls.empty()

    def to_records(self) -> NDArray[np.void]:
        """The cells as a structured array, shape (n,), of `BODY_DTYPE` if any is of a body."""
        records = np.empty(len(self), BODY_DTYPE if self.body.any() else CELL_DTYPE)
        for name in records.dtype.names or ():
            records[name] = getattr(self, name)
        return records


@dataclass(frozen=True)
class Scan:
    """The scan of one view of a robot.

    Attributes:
        robot: The robot's name.
        stamp_ns: Stamp of the images [ns].
        cells: Occupied cells in the robot's base_link.
    """

    robot: str
    stamp_ns: int
    cells: Cells


@dataclass(frozen=True)
class ScanStages:
    """All intermediate results of one view; scanners add their own.

    Attributes:
        disparity: [px], float32, shape (height, width), NaN where there is none.
        scan: The cells (W).
        times_ms: Duration of each stage, by name [ms].
    """

    disparity: Float32
    scan: Scan
    times_ms: dict[str, float]

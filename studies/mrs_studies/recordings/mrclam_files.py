"""Reads data sets of UTIAS MRCLAM: five robots that see landmarks and each other.

K. Leung, Y. Halpern, T. Barfoot, H. Liu, "The UTIAS multi-robot cooperative localization and
mapping dataset", Int. J. of Robotics Research 30(8), 2011. A data set is a folder of tables in
text, whose lines with `#` are comments.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from mrs_people_loc.arrays import Float, Int
from mrs_people_loc.errors import BagError


@dataclass(frozen=True)
class MrclamRobot:
    """What was recorded of a robot; times in seconds, ascending.

    Attributes:
        truth: Time, x, y [m] and yaw [rad] by motion capture, shape (n, 4).
        odometry: Time, speed [m/s] and turn to the left [rad/s], shape (m, 3).
        seen: Time, range [m] and bearing to the left [rad], shape (k, 3).
        subjects: What was seen, by its number, shape (k,).
        unknown: How many measurements were left out: their barcodes are nobody's, or the robot's.
    """

    truth: Float
    odometry: Float
    seen: Float
    subjects: Int
    unknown: int


@dataclass(frozen=True)
class Mrclam:
    """A data set.

    Attributes:
        robots: By number.
        landmarks: By number, x and y [m].
    """

    robots: Mapping[int, MrclamRobot]
    landmarks: Mapping[int, tuple[float, float]]


#: What the values of a column must be: in words, and whether one is. NaN is none of them.
_Check = tuple[str, Callable[[float], bool]]
_ANY: _Check = "-100000 to 100000", lambda value: abs(value) <= 1e5
_WHOLE: _Check = "whole numbers from 0 to 999", lambda value: value in range(1000)
_POSITIVE: _Check = "more than 0, at most 100000", lambda value: 0.0 < value <= 1e5
_TIME: _Check = "0 to 10000000000", lambda value: 0.0 <= value <= 1e10
_BARCODES = {"subject": _WHOLE, "barcode": _WHOLE}
_LANDMARKS = {"subject": _WHOLE, "x": _ANY, "y": _ANY, "sigma of x": _ANY, "sigma of y": _ANY}
_TRUTH = {"time": _TIME, "x": _ANY, "y": _ANY, "yaw": _ANY}
_ODOMETRY = {"time": _TIME, "speed": _ANY, "turn": _ANY}
_MEASUREMENTS = {"time": _TIME, "barcode": _WHOLE, "range": _POSITIVE, "bearing": _ANY}


def read_mrclam(folder: Path) -> Mrclam:
    """Reads a data set.

    Those in `Barcodes.dat` that are no landmarks are robots.

    Args:
        folder: Of `Barcodes.dat`, `Landmark_Groundtruth.dat`, and of each robot
            `Robot1_Groundtruth.dat`, `Robot1_Odometry.dat` and `Robot1_Measurement.dat`.

    Raises:
        BagError: A file is missing or wrong.
    """
    file = folder / "Barcodes.dat"
    barcodes = _table(file, _BARCODES).astype(np.intp)
    for column, name in enumerate(_BARCODES):
        numbers, counts = np.unique(barcodes[:, column], return_counts=True)
        if (counts > 1).any():
            again = numbers[counts > 1].tolist()
            raise BagError(f"{file}: {name} {again[0]} is given twice; allowed: once")
    file = folder / "Landmark_Groundtruth.dat"
    landmarks = {int(row[0]): (row[1], row[2]) for row in _table(file, _LANDMARKS).tolist()}
    everybody = barcodes[:, 0].tolist()
    if strange := sorted(set(landmarks) - set(everybody)):
        raise BagError(f"{file}: subject {strange[0]} is not in Barcodes.dat; allowed: {everybody}")
    robots = [subject for subject in everybody if subject not in landmarks]
    if not robots:
        raise BagError(f"{folder}: every subject of Barcodes.dat is a landmark; wanted: a robot")
    subject_of = {barcode: subject for subject, barcode in barcodes.tolist()}
    return Mrclam({n: _robot(folder, n, subject_of) for n in sorted(robots)}, landmarks)


def _robot(folder: Path, number: int, subject_of: Mapping[int, int]) -> MrclamRobot:
    truth, odometry, seen = (
        _table(folder / f"Robot{number}_{kind}.dat", columns)
        for kind, columns in (
            ("Groundtruth", _TRUTH), ("Odometry", _ODOMETRY), ("Measurement", _MEASUREMENTS),
        )
    )  # fmt: skip
    subjects = np.array([subject_of.get(int(code), number) for code in seen[:, 1]], dtype=np.intp)
    known = subjects != number
    return MrclamRobot(
        truth, odometry, seen[known][:, [0, 2, 3]], subjects[known], int((~known).sum())
    )


def _table(file: Path, columns: Mapping[str, _Check]) -> Float:
    """The rows of a file, one at least, shape (n, columns); times do not go back.

    Raises:
        BagError: The file, or one of its lines, is wrong.
    """
    try:
        lines = file.read_text(encoding="utf-8").splitlines()
    except FileNotFoundError as err:
        raise BagError(f"{file}: there is no such file") from err
    except (OSError, UnicodeDecodeError) as err:
        raise BagError(f"{file} cannot be read: {err}") from err
    rows: list[list[float]] = []
    for number, line in enumerate(lines, 1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        try:
            row = _row(words, columns)
            if "time" in columns and rows and row[0] < rows[-1][0]:
                raise ValueError(f"time is {row[0]:.3f}; allowed: from {rows[-1][0]:.3f} on")
        except ValueError as err:
            raise BagError(f"{file}, line {number}: {err}") from None
        rows.append(row)
    if not rows:
        raise BagError(f"{file} has no rows; wanted: {', '.join(columns)} in each")
    return np.array(rows)


def _row(words: Sequence[str], columns: Mapping[str, _Check]) -> list[float]:
    """The numbers of a line.

    Raises:
        ValueError: Saying what is wrong.
    """
    if len(words) != len(columns):
        raise ValueError(
            f"{len(words)} values; wanted: {len(columns)}, which are {', '.join(columns)}"
        )
    row = []
    for word, (name, (allowed, is_allowed)) in zip(words, columns.items(), strict=True):
        try:
            value = float(word)
        except ValueError:
            value = math.nan
        if not is_allowed(value):
            raise ValueError(f"{name} is {word}; allowed: {allowed}")
        row.append(value)
    return row

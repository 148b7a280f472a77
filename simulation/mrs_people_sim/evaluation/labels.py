"""Hand labels of a recording: positions of the people in each frame, read from a JSON file.

`studies/labels/README.md` describes the format and how the labels of this repository were made.
"""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from mrs_people_loc.errors import BagError
from mrs_tools.bags.records import Truth

#: End of the names of label files.
SUFFIX = ".labels.json"
#: An estimate that fits nobody is ignored if somebody who may be found is nearer than this [m]:
#: those who sit are labelled to some decimetres, at their desks or behind them.
IGNORE_WITHIN = 0.70
POSTURES = ("walks", "stands", "sits", "bends")
#: People in all frames of a recording at most.
MAX_PEOPLE = 2_000
#: Least and largest values of a label file: frames, stamps [ns].
_LIMITS = (("frames", 1, 5_000), ("first_ns", 0, 2**62), ("step_ns", 1, 3600 * 10**9))
#: Largest coordinate [m].
MAX_PLACE = 1e4
#: Types of the values of a label file, and of a person in it.
_FILE = {
    "first_ns": (int,),
    "step_ns": (int,),
    "frames": (int,),
    "follow": (bool,),
    "people": (list,),
}
_PERSON = {
    "frame": (int,),
    "id": (int,),
    "head": (list,),
    "trunk": (list, type(None)),
    "must": (bool,),
    "posture": (str,),
    "source": (str,),
}


@dataclass(frozen=True)
class Label:
    """One person in one frame.

    Attributes:
        frame: Number of the frame, from 0.
        id: The person's number from 1, the same in all frames; 0: unknown.
        head: Place of the head in `map` [m].
        trunk: Axis of the trunk in `map` [m]; None: not known.
        must: Whether the person must be found; otherwise they may be found.
        posture: One of `POSTURES`.
        source: What the place of the head was read from.
    """

    frame: int
    id: int
    head: tuple[float, float]
    trunk: tuple[float, float] | None
    must: bool
    posture: str
    source: str

    def place(self, *, trunk: bool = False) -> tuple[float, float]:
        """Place in `map` [m]: of the head, or of the trunk where that is asked for and known."""
        return self.trunk if trunk and self.trunk is not None else self.head


@dataclass(frozen=True)
class Labels:
    """The labels of a recording.

    Attributes:
        path: The file.
        first_ns: Stamp of the first frame [ns].
        step_ns: From one frame to the next [ns].
        frames: Number of frames.
        follow: Whether people can be followed from frame to frame: not where the stamps are wrong.
        people: One label per person and frame.
    """

    path: Path
    first_ns: int
    step_ns: int
    frames: int
    follow: bool
    people: Sequence[Label]

    def truth(self, *, trunk: bool = False) -> Truth:
        """The labels as ground truth: those who must be found are visible, the others are not.

        Args:
            trunk: Use the trunk's place in place of the head's where it is known.
        """
        known = sorted({label.id for label in self.people if label.id})
        column = {number: index for index, number in enumerate(known)}
        unknown = sum(not label.id for label in self.people)
        positions = np.full((self.frames, len(known) + unknown, 2), np.nan)
        visible = np.zeros(positions.shape[:2], dtype=bool)
        # Unknown people are not matched across frames: each has a column of their own.
        others = iter(range(len(known), len(known) + unknown))
        for label in self.people:
            index = column[label.id] if label.id else next(others)
            positions[label.frame, index] = label.place(trunk=trunk)
            visible[label.frame, index] = label.must
        stamps = self.first_ns + self.step_ns * np.arange(self.frames, dtype=np.int64)
        return Truth(stamps, positions, visible, ignore_within=IGNORE_WITHIN)

    def check_span(self, start_ns: int, end_ns: int) -> None:
        """Refuses labels of another recording.

        Args:
            start_ns: Bag time of the first message [ns].
            end_ns: Of the last [ns].

        Raises:
            BagError: A labelled frame is not in the bag's time.
        """
        last_ns = self.first_ns + self.step_ns * (self.frames - 1)
        if self.first_ns < start_ns - self.step_ns or last_ns > end_ns + self.step_ns:
            raise BagError(
                f"{self.path} labels {self.first_ns * 1e-9:.1f} to {last_ns * 1e-9:.1f} s; the bag "
                f"lasts from {start_ns * 1e-9:.1f} to {end_ns * 1e-9:.1f} s: another recording?"
            )


def name_of(bag: str | os.PathLike[str]) -> str:
    """Name of a bag, which its label file begins with: `um_c1` of `um_c1/` and `um_c1.mcap`."""
    path = Path(os.path.abspath(bag))
    return path.stem if path.suffix == ".mcap" else path.name


def labels_at(path: Path, bag: str | os.PathLike[str]) -> Labels:
    """The labels of a bag: a file, or `NAME.labels.json` in a folder.

    Raises:
        BagError: There are none, or the file is no label file.
    """
    return read_labels(path / f"{name_of(bag)}{SUFFIX}" if path.is_dir() else path)


def labels_beside(bag: str | os.PathLike[str]) -> Labels | None:
    """The labels that lie beside a bag, as `NAME.labels.json`; None: there are none.

    Raises:
        BagError: The file is no label file.
    """
    path = Path(os.path.abspath(bag)).with_name(f"{name_of(bag)}{SUFFIX}")
    return read_labels(path) if path.exists() else None


def read_labels(path: Path) -> Labels:
    """Reads a label file.

    Raises:
        BagError: It cannot be read, a key is missing or unknown, or a value is not allowed.
    """
    try:
        document = json.loads(path.read_text("utf-8"))
    except OSError as err:
        raise BagError(f"{path} cannot be read: {err.strerror or err}") from err
    except (ValueError, RecursionError) as err:
        raise BagError(f"{path} cannot be read: {err}") from err
    try:
        given = _values(document, _FILE)
        for key, least, most in _LIMITS:
            if not least <= given[key] <= most:
                raise ValueError(f"{key} is {given[key]}; allowed: {least} to {most}")
        if len(given["people"]) > MAX_PEOPLE:
            raise ValueError(f"{len(given['people'])} people; allowed: {MAX_PEOPLE} in all frames")
        people = [_label(one, given["frames"]) for one in given.pop("people")]
        named = Counter((label.frame, label.id) for label in people if label.id)
        for (frame, number), count in named.items():
            if count > 1:
                raise ValueError(f"person {number} is {count} times in frame {frame}")
    except ValueError as err:
        raise BagError(f"{path} is no label file: {err}") from err
    return Labels(path=path, people=tuple(people), **given)


def _label(document: object, frames: int) -> Label:
    """One person of a label file.

    Raises:
        ValueError: A key is missing or unknown, or a value is not allowed.
    """
    given = _values(document, _PERSON)
    for key in ("head", "trunk"):
        place = given[key]
        if place is None and key == "trunk":
            continue
        numbers = [value for value in place if type(value) in (int, float)]
        # NaN compares false.
        if not len(place) == len(numbers) == sum(abs(n) < MAX_PLACE for n in numbers) == 2:
            raise ValueError(f"{key} is {place}; allowed: [x, y] in metres")
        given[key] = (float(place[0]), float(place[1]))
    label = Label(**given)
    if not (0 <= label.frame < frames and label.id >= 0 and label.posture in POSTURES):
        raise ValueError(
            f"frame {label.frame}, id {label.id}, posture {label.posture!r}; allowed: 0 to "
            f"{frames - 1}, 0 or more, {', '.join(POSTURES)}"
        )
    return label


def _values(document: object, kinds: Mapping[str, tuple[type, ...]]) -> dict[str, Any]:
    """The values of an object of JSON.

    Raises:
        ValueError: A key is missing or unknown, or a value is of another type.
    """
    if not isinstance(document, dict) or set(document) != set(kinds):
        keys = sorted(document) if isinstance(document, dict) else repr(document)[:80]
        raise ValueError(f"keys are {keys}; wanted: {', '.join(kinds)}")
    for key, kind in kinds.items():
        if type(document[key]) not in kind:
            names = " or ".join(one.__name__ for one in kind)
            raise ValueError(f"{key} is {str(document[key])[:80]!r}; allowed: {names}")
    return document

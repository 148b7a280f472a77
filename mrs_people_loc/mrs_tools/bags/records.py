"""What is scored: where people truly are, and where they were found."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Bool, Float, Int


@dataclass(frozen=True)
class Truth:
    """Where the people of a recording truly are, over time.

    Attributes:
        stamps_ns: Stamps [ns], ascending, int64, shape (n,).
        positions: Of each person at each stamp [m], shape (n, m, 2); NaN: not there.
        visible: Whether a robot sees the person, i.e. whether they have to be found, shape (n, m).
        groups: Number of the group that each person belongs to, 0: none, shape (n, m); None: the
            truth does not say.
        ignore_within: An estimate that fits nobody is ignored if somebody who is not visible is
            nearer than this [m].
        shares: How much of each person the view shows that shows most of them, 1: all, shape
            (n, m); None: the truth does not say.
    """

    stamps_ns: NDArray[np.int64]
    positions: Float
    visible: Bool
    groups: Int | None = None
    ignore_within: float = 0.0
    shares: Float | None = None

    @classmethod
    def build(
        cls,
        stamps_ns: Sequence[int],
        positions: Sequence[Float],
        visible: Sequence[Bool | None] | None = None,
        groups: Sequence[NDArray[np.integer]] | None = None,
        shares: Sequence[Float] | None = None,
    ) -> Truth:
        """Puts messages together; of several with one stamp the last counts.

        Args:
            stamps_ns: Stamps [ns], in any order.
            positions: At each stamp [m], shape (m, 2); m may differ: the last ones are not there.
            visible: At each stamp, shape (m,); None: everybody is.
            groups: Numbers of their groups at each stamp, shape (m,); None: nothing is known.
            shares: How much of them is visible at each stamp, shape (m,); None: likewise.
        """
        given = visible if visible is not None else [None] * len(stamps_ns)
        nobody = [np.empty(0, dtype=np.intp)] * len(stamps_ns)
        of_group = nobody if groups is None else groups
        part_of = [np.empty(0)] * len(stamps_ns) if shares is None else shares
        every = zip(positions, given, of_group, part_of, strict=True)
        rows = dict(zip(stamps_ns, every, strict=True))
        count = max((len(xy) for xy, *_ in rows.values()), default=0)
        stamps = sorted(rows)
        xys = np.full((len(rows), count, 2), np.nan)
        seens = np.ones((len(rows), count), dtype=bool)
        numbers = np.zeros((len(rows), count), dtype=np.intp)
        parts = np.full((len(rows), count), np.nan)
        for index, stamp in enumerate(stamps):
            xy, seen, group, part = rows[stamp]
            xys[index, : len(xy)] = np.reshape(xy, (-1, 2))
            numbers[index, : len(group)] = group
            parts[index, : len(part)] = part
            if seen is not None:
                seens[index, : len(seen)] = seen
        belong = None if groups is None else numbers
        part_seen = None if shares is None else parts
        return cls(np.array(stamps, dtype=np.int64), xys, seens, belong, shares=part_seen)

    def __len__(self) -> int:
        """Number of ground-truth messages."""
        return len(self.stamps_ns)

    def at(self, stamp_ns: int) -> tuple[Float, Bool]:
        """The truth at a time.

        Positions are interpolated linearly. Where a person is there in one of the two messages
        around that time only, the nearer message decides; before the first and after the last
        message it is the same as in that one. The nearer message also decides on visibility.

        Args:
            stamp_ns: Time [ns].

        Returns:
            Positions [m], shape (m, 2), NaN: not there; and whether they are visible, shape (m,).
        """
        if not len(self):
            return np.empty((0, 2)), np.empty(0, dtype=bool)
        after = int(np.searchsorted(self.stamps_ns, stamp_ns))
        index = min(after, len(self) - 1)
        if after in (0, len(self)) or self.stamps_ns[index] == stamp_ns:
            return self.positions[index], self.visible[index]
        before = after - 1
        begin, end = int(self.stamps_ns[before]), int(self.stamps_ns[after])
        part = (stamp_ns - begin) / (end - begin)
        nearer = before if part <= 0.5 else after
        one, other = self.positions[before], self.positions[after]
        between = one + part * (other - one)
        both = np.isfinite(between).all(axis=1, keepdims=True)
        return np.where(both, between, self.positions[nearer]), self.visible[nearer]

    def shares_at(self, stamp_ns: int) -> Float:
        """How much of each person is visible in the message nearest to a time [ns], shape (m,).

        NaN where the truth does not say.
        """
        if self.shares is None or not len(self):
            return np.full(self.positions.shape[1], np.nan)
        return np.asarray(self.shares[int(np.abs(self.stamps_ns - stamp_ns).argmin())])


@dataclass(frozen=True)
class Estimate:
    """What was found in one interval.

    Attributes:
        stamp_ns: Its stamp [ns].
        positions: Of the people [m], shape (n, 2).
        covariances: Of the positions [m^2], shape (n, 2, 2).
        centre: Centre of gravity of all groups [m], shape (2,); None: there is none.
        largest: That of the largest group.
        ids: Of the people, int64, shape (n,); 0, and all of them if left out: not tracked.
        velocities: Of the people [m/s], shape (n, 2); NaN, and all of them if left out: unknown.
        coasting: Who of them is predicted, not seen, shape (n,); nobody if left out.
        hidden: Who of them has not been seen for long (`People.hidden`), likewise.
        stragglers: Ids of people that have fallen behind their groups or left them.

    Raises:
        ValueError: The arrays are not of one length, or somebody's id is somebody else's, too.
    """

    stamp_ns: int
    positions: Float
    covariances: Float
    centre: Float | None = None
    largest: Float | None = None
    ids: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    velocities: Float = field(default_factory=lambda: np.empty((0, 2)))
    coasting: Bool = field(default_factory=lambda: np.empty(0, dtype=bool))
    hidden: Bool = field(default_factory=lambda: np.empty(0, dtype=bool))
    stragglers: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        count = len(self.positions)
        unsaid = {
            "ids": np.zeros(count, dtype=np.int64),
            "velocities": np.full((count, 2), np.nan),
            "coasting": np.zeros(count, dtype=bool),
            "hidden": np.zeros(count, dtype=bool),
        }
        for name, nothing in unsaid.items():
            if not len(getattr(self, name)):
                object.__setattr__(self, name, nothing)
            if getattr(self, name).shape != nothing.shape:
                raise ValueError(
                    f"{name} has shape {getattr(self, name).shape}; wanted: {nothing.shape}"
                )
        tracked = self.ids[self.ids != 0]
        if len(np.unique(tracked)) < len(tracked):
            raise ValueError(f"an id is there twice: {sorted(tracked.tolist())}")

    def only(self, which: Bool) -> Estimate:
        """With some of the people, shape (n,)."""
        rows = ("positions", "covariances", "ids", "velocities", "coasting", "hidden")
        return dataclasses.replace(self, **{name: getattr(self, name)[which] for name in rows})

    def as_in_view(self) -> Estimate:
        """With nobody hidden: all of them count as in view."""
        return dataclasses.replace(self, hidden=np.zeros_like(self.hidden))

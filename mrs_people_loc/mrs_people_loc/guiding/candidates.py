"""Posts that robots behind and beside a group may take: laid out along the way, and free."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Bool, Float, Int, StructOfArrays
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.way import Way


@dataclass(frozen=True)
class LayoutTuning:
    """Constants of the layout, chosen by hand.

    Attributes:
        margin: Posts are farther apart than robots have to be, and farther from walls, by these
            [m, m].
        rows: Posts behind the group are the distance from people, and so many times the distance
            between robots, behind the last person ...
        columns: ... and so far to the left of the group's middle [m].
        beside: Posts beside a standing group: at these shares of its length, from its rear on,
        off: ... and so many times the distance from people to its left and right.
        ahead: While the group moves a post has to be free for so far ahead [m].
        narrowing: Where a post is not free, its distance from the way shrinks by these factors.
        closer: A post may be nearer to people than the distance, by this factor: they move.
        farther: What it costs to be behind the first row, per metre, as a share of all that can
            be seen.
        travel: What it costs to go there from where the nearest robot is, likewise, while the group
            stands: robots that drive to a side see nobody.
        longest: ... up to this distance [m].
        first_here: Numbers of posts where robots stand begin with this.
    """

    margin: tuple[float, float] = (0.3, 0.1)
    rows: tuple[float, ...] = (0.0, 0.5, 1.0, 2.0)
    columns: tuple[float, ...] = (
        0.0, -0.35, 0.35, -0.7, 0.7, -1.05, 1.05, -1.5, 1.5, -2.0, 2.0,
    )  # fmt: skip
    beside: tuple[float, ...] = (0.0, 0.5, 1.0)
    off: tuple[float, ...] = (1.0, 1.6)
    ahead: tuple[float, ...] = (0.0, 0.5, 1.0)
    narrowing: tuple[float, ...] = (1.0, 0.8, 0.6, 0.4, 0.2, 0.0)
    closer: float = 0.85
    farther: float = 0.02
    travel: float = 0.1
    longest: float = 3.0
    first_here: int = 1000


LAYOUT_TUNING = LayoutTuning()


@dataclass(frozen=True)
class Frame:
    """A group along the way.

    Attributes:
        rear: How far along it the last person is [m].
        front: ... and the first one [m].
        left: How far to the left of it the middle is [m].
        half_width: Half of its width across the way [m].
    """

    rear: float
    front: float
    left: float
    half_width: float

    @classmethod
    def of(cls, way: Way, people: Float, people_m: Float) -> Frame:
        """That of people.

        Args:
            way: The way.
            people: One at least [m], shape (n, 2).
            people_m: How far along the way they are [m], shape (n,).
        """
        ahead, off = way.ahead(people_m), people - way.at(people_m)
        left = ahead[:, 0] * off[:, 1] - ahead[:, 1] * off[:, 0]
        low, high = float(left.min()), float(left.max())
        ends = float(people_m.min()), float(people_m.max())
        return cls(*ends, 0.5 * (low + high), 0.5 * (high - low))

    def towards(self, other: Frame, step: float) -> Frame:
        """This one, each number nearer to that of another one by a step at most."""
        one, two = (np.array([f.rear, f.front, f.left, f.half_width]) for f in (self, other))
        return Frame(*(one + np.clip(two - one, -step, step)).tolist())

    def centre(self, way: Way) -> Float:
        """Middle of the group [m], shape (2,)."""
        return way.at(0.5 * (self.rear + self.front), self.left)


@dataclass(frozen=True)
class Candidates(StructOfArrays):
    """Posts to choose from.

    Attributes:
        number: Of the post in the layout: what stays while the group moves on.
        xy: [m], shape (n, 2).
        gaze: Where the head looks there [rad].
        cost: As a share of all that can be seen.
        beside: Whether it is beside the group.
    """

    number: Int
    xy: Float
    gaze: Float
    cost: Float
    beside: Bool


class Layout:
    """Lays posts out around a group.

    Args:
        config: Parameters.
        way: Of the tour.
        space: Where robots may be.
        tuning: Constants.
    """

    def __init__(
        self,
        config: cfg.GuideConfig,
        way: Way,
        space: FreeSpace,
        tuning: LayoutTuning = LAYOUT_TUNING,
    ) -> None:
        self.config = config
        self.space = space
        self._way, self._tuning = way, tuning

    @property
    def apart(self) -> float:
        """Least distance of two posts [m]."""
        return self.config.safety.robot_distance + self._tuning.margin[0]

    def behind(self, frame: Frame, people: Float) -> Candidates:
        """Posts behind a group that moves; robots there look along the way.

        Args:
            frame: The group.
            people: [m], shape (n, 2).
        """
        along, left = self._rows(frame)
        xy, free = self._narrowed(along, frame.left + left, self._tuning.ahead)
        gaze = _angles(self._way.ahead(along))
        number, beside = np.arange(len(xy)), np.zeros(len(xy), dtype=bool)
        cost = self._tuning.farther * (along.max() - along)
        every = Candidates(number, xy, gaze, cost, beside)
        return every.select(free & self._is_off(xy, people))

    def around(
        self, frame: Frame, people: Float, robots: Mapping[int, Float], *, beside: bool
    ) -> Candidates:
        """Posts around a group that stands, and where robots are; they look at its middle.

        Args:
            frame: The group.
            people: [m], shape (n, 2).
            robots: Places of the robots that are to take them [m], by a number that stays.
            beside: Whether there are posts beside the group, too.
        """
        tuning, distance = self._tuning, self.config.formation.distance
        along, left = self._rows(frame)
        cost = tuning.farther * (along.max() - along)
        sides = 0
        if beside:
            off = frame.half_width + distance * np.array(tuning.off)
            share, aside = np.meshgrid(tuning.beside, np.append(-off, off))
            sides = share.size
            along = np.append(along, frame.rear + share * (frame.front - frame.rear))
            left = np.append(left, aside)
        xy, free = self._narrowed(along, frame.left + left, (0.0,))
        here = np.array(list(robots.values())).reshape(-1, 2)
        number = np.append(np.arange(len(xy)), tuning.first_here + np.array([*robots], dtype=int))
        clear = self.space.clearance(here) >= self.config.safety.wall_distance
        xy, free = np.concatenate([xy, here]), np.append(free, clear)
        cost = np.append(cost, np.zeros(sides + len(here))) + self._travel(xy, robots)
        is_beside = np.zeros(len(xy), dtype=bool)
        is_beside[len(xy) - sides - len(here) : len(xy) - len(here)] = True
        every = Candidates(number, xy, _angles(frame.centre(self._way) - xy), cost, is_beside)
        return every.select(free & self._is_off(xy, people))

    def is_free(self, xy: Float) -> Bool:
        """Whether places are far enough from walls for a post, shape (...)."""
        least = self.config.safety.wall_distance + self._tuning.margin[1]
        return np.asarray(self.space.clearance(xy) >= least)

    def beside(self, person: Float, people: Float, angles: Float) -> tuple[Float, Bool]:
        """Places at the distance from a person, and whether they are free and see them.

        Args:
            person: [m], shape (2,).
            people: All of them [m], shape (n, 2).
            angles: Directions from the person [rad], shape (k,).

        Returns:
            Places [m], shape (k, 2), and shape (k,).
        """
        around = np.stack([np.cos(angles), np.sin(angles)], axis=1)
        xy = person + self.config.formation.distance * around
        seen = self.space.is_visible(xy, person[np.newaxis])
        return xy, np.asarray(self.is_free(xy) & seen & self._is_off(xy, people))

    def _rows(self, frame: Frame) -> tuple[Float, Float]:
        """How far along the way, and to the left of the group's middle, posts behind it are."""
        back = np.array(self._tuning.rows) * self.apart
        first = frame.rear - self.config.formation.distance
        along, left = np.meshgrid(first - back, self._tuning.columns, indexing="ij")
        return along.ravel(), left.ravel()

    def _travel(self, xy: Float, robots: Mapping[int, Float]) -> Float:
        here = np.array(list(robots.values())).reshape(-1, 2)
        away = np.linalg.norm(xy[:, np.newaxis] - here, axis=2)
        longest = self._tuning.longest
        return np.asarray(self._tuning.travel * away.min(axis=1, initial=longest))

    def _is_off(self, xy: Float, people: Float) -> Bool:
        """Whether places are off people."""
        away = np.linalg.norm(xy[:, np.newaxis] - people, axis=2)
        least = self._tuning.closer * self.config.formation.distance
        return np.asarray((away >= least).all(axis=1))

    def _narrowed(self, along: Float, left: Float, ahead: tuple[float, ...]) -> tuple[Float, Bool]:
        """Places, moved towards the way until they are free, and whether they are.

        Args:
            along: Along the way [m], shape (k,).
            left: To the left of it [m], shape (k,).
            ahead: So far ahead they have to be free, too [m].
        """
        lefts = left[:, np.newaxis] * np.array(self._tuning.narrowing)
        ways = along[:, np.newaxis, np.newaxis] + np.array(ahead)
        swept = self._way.at(ways, lefts[..., np.newaxis])
        free = self.is_free(swept)
        # On the way itself as near to walls as robots may be: there the tour was checked.
        free[:, -1] = self.space.clearance(swept[:, -1]) >= self.config.safety.wall_distance
        xy = swept[..., 0, :]
        reached = self.space.is_visible(self._way.at(along)[:, np.newaxis], xy)
        good = free.all(axis=-1) & reached
        first, every = good.argmax(axis=1), np.arange(len(along))
        return xy[every, first], good[every, first]


def angle_of(vector: Float) -> float:
    """Direction of a vector of shape (2,) [rad]."""
    return math.atan2(vector[1], vector[0])


def _angles(vectors: Float) -> Float:
    return np.asarray(np.arctan2(vectors[:, 1], vectors[:, 0]))

"""Clustering based segmentation of the map (eqs. 8-10, section 5.5)."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Bool, Float, Int
from mrs_people_loc.neighbours import connected

#: Cell centres travel as float32; two that are exactly `distance` apart arrive up to 8 um off when
#: they are 100 m from their robot.
_ROUNDING = 1e-5
#: Where points are farther than this from the middle one, along y, gaps are shortened [m].
_FAR = 1e4
#: Pairs that are compared at once: small enough for memory to be reused.
_BLOCK = 16_000
#: Where points have more candidates than this, on average, those of dense squares are not compared
#: one by one. Cells of 5 cm have 24 candidates within 15 cm.
_MANY_CANDIDATES = 64
#: A square that holds more points than this is dense.
_DENSE = 32


def cluster(xy: Float, *, distance: float) -> Int:
    """Labels the connected components of points within a distance of each other.

    By the paper's three rules (two free points, a free and a labelled one, two labelled ones:
    within d_th they belong together) clusters are the connected components of the graph whose edges
    join points at most d_th apart, whatever the order of the points.

    Args:
        xy: Points [m], shape (n, 2).
        distance: d_th [m], inclusive.

    Returns:
        Label of each point from 0, shape (n,). Clusters are numbered by their least point (x, then
        y), so the numbers do not depend on the order of the points.
    """
    count = len(xy)
    if count == 0:
        return np.empty(0, dtype=np.intp)
    order = np.lexsort((xy[:, 1], xy[:, 0]))
    root = _components(xy[order], distance + _ROUNDING)
    number = np.cumsum(root == np.arange(count)) - 1
    labels = np.empty(count, dtype=np.intp)
    labels[order] = number[root]
    return labels


def _components(xy: Float, reach: float) -> Int:
    """Connected components: of each point, the first one of its component, shape (n,).

    Args:
        xy: Points in the order of x, then y, shape (n, 2).
        reach: Points at most this far apart are connected.
    """
    candidates = _Candidates.of(xy, reach)
    if candidates.total <= _MANY_CANDIDATES * len(xy):
        return connected(*candidates.pairs_within(reach), len(xy))
    return _components_of_dense(xy, reach)


def _components_of_dense(xy: Float, reach: float) -> Int:
    """As `_components`, with work that does not grow with the square of the points in one place.

    The plane is cut into squares. All points of a dense one are connected, so it takes part with
    its four outermost points only; squares that these do not connect are compared in full.
    """
    squares = _Squares.of(xy, reach)
    dense = squares.dense[squares.of_point]
    kept = ~dense
    kept[squares.outermost()] = True
    thin, inside = np.flatnonzero(kept), np.flatnonzero(dense)
    one, other = _Candidates.of(xy[thin], reach).pairs_within(reach)
    one = np.concatenate([thin[one], squares.members[squares.first[squares.of_point[inside]]]])
    other = np.concatenate([thin[other], inside])
    more_one, more_other = squares.pairs_across(connected(one, other, len(xy)))
    return connected(
        np.concatenate([one, *more_one]), np.concatenate([other, *more_other]), len(xy)
    )


@dataclass(frozen=True)
class _Squares:
    """Points in squares whose diagonal is no longer than the reach: those of one are connected.

    Attributes:
        xy: The points, shape (n, 2).
        reach: Points at most this far apart are connected.
        of_point: Square of each point, shape (n,).
        members: The points square by square, shape (n,).
        first: Where in `members` each square begins, shape (k,).
        sizes: How many points each holds, shape (k,).
        index: Row and column of each, shape (k, 2).
        low: Least coordinates of its points, shape (k, 2).
        high: Greatest coordinates of its points, shape (k, 2).
        dense: Whether it holds many, shape (k,).
    """

    xy: Float
    reach: float
    of_point: Int
    members: Int
    first: Int
    sizes: Int
    index: Float
    low: Float
    high: Float
    dense: Bool

    @classmethod
    def of(cls, xy: Float, reach: float) -> _Squares:
        """Sorts points into squares."""
        side = 0.7071 * reach  # a diagonal is a little shorter than the reach
        index, of_point, sizes = np.unique(
            np.floor(xy / side), axis=0, return_inverse=True, return_counts=True
        )
        of_point = of_point.reshape(-1)
        members = np.argsort(of_point, kind="stable")
        first = np.cumsum(sizes) - sizes
        low, high = (f.reduceat(xy[members], first) for f in (np.minimum, np.maximum))
        # Far from the origin, where floor has no digits left, the square may be larger.
        dense = (sizes > _DENSE) & (((high - low) ** 2).sum(axis=1) <= reach**2)
        return cls(xy, reach, of_point, members, first, sizes, index, low, high, dense)

    def points(self, number: int) -> Int:
        """The points of a square."""
        return self.members[self.first[number] : self.first[number] + self.sizes[number]]

    def outermost(self) -> Int:
        """Of each square its least and greatest point along x and y, shape (4 k,)."""
        axes = (self.xy[:, 0], -self.xy[:, 0], self.xy[:, 1], -self.xy[:, 1])
        return np.concatenate(
            [
                self.members[
                    self.first + _first_of_each(axis[self.members], self.first, self.sizes)
                ]
                for axis in axes
            ]
        )

    def pairs_across(self, root: Int) -> tuple[list[Int], list[Int]]:
        """Connected pairs of points of dense squares and of squares around, not connected so far.

        Args:
            root: Of each point, the first one that it is connected with so far, shape (n,).
        """
        at = {place: number for number, place in enumerate(map(tuple, self.index.tolist()))}
        ones, others = [], []
        for number in np.flatnonzero(self.dense).tolist():
            i, j = self.index[number].tolist()
            own = root[self.members[self.first[number]]]
            around = [at[i + di, j + dj] for di, dj in _AROUND if (i + di, j + dj) in at]
            around = [
                k
                for k in around
                if not (self.dense[k] and root[self.members[self.first[k]]] == own)
            ]
            if not around:
                continue
            points = np.concatenate([self.points(k) for k in around])
            one, other = self._pairs_with(number, points[root[points] != own])
            ones.append(one)
            others.append(other)
        return ones, others

    def _pairs_with(self, number: int, points: Int) -> tuple[Int, Int]:
        """Of points near a square, those within the reach of one in it, and that one."""
        xy, reach = self.xy, self.reach
        low, high = self.low[number], self.high[number]
        # Only what is near the square at all.
        beyond = np.maximum(np.maximum(low - xy[points], xy[points] - high), 0.0)
        points = points[(beyond**2).sum(axis=1) <= reach**2]
        if not len(points):
            return points, points

        from scipy.spatial import KDTree  # here: it takes long to load

        mine = self.points(number)
        _, nearest = KDTree(xy[mine]).query(xy[points], distance_upper_bound=1.001 * reach)
        found = np.flatnonzero(nearest < len(mine))
        nearest, points = mine[nearest[found]], points[found]
        near = ((xy[points] - xy[nearest]) ** 2).sum(axis=1) <= reach**2
        return nearest[near], points[near]


#: Squares whose points may be within the reach: 1.41 sides.
_AROUND = [(i, j) for i in range(-2, 3) for j in range(-2, 3) if (i, j) != (0, 0)]


def _first_of_each(values: Float, first: Int, sizes: Int) -> Int:
    """Where in each stretch of values its least one is, shape (stretches,)."""
    least = np.repeat(np.minimum.reduceat(values, first), sizes)
    hits = np.flatnonzero(values == least)
    stretch = np.searchsorted(first, hits, side="right") - 1
    _, once = np.unique(stretch, return_index=True)
    return hits[once] - first


@dataclass(frozen=True)
class _Candidates:
    """Pairs of points that may be within the reach: of each point, a stretch of others.

    The plane is cut into stripes along y that are as wide as the reach. The neighbours of a point
    are in its own stripe or the next ones, within the reach along y: a stretch of the points sorted
    by stripe and y.

    Attributes:
        xy: The points, shape (n, 2).
        order: The points sorted by stripe and y.
        begin: Where in this order the stretch of each begins; first those in its own stripe, then
            those in the next one, shape (2 n,).
        count: How long it is.
        total: Number of pairs.
    """

    xy: Float
    order: Int
    begin: Int
    count: Int
    total: int

    @classmethod
    def of(cls, xy: Float, reach: float) -> _Candidates:
        """Candidates for being at most `reach` apart, of points in the order of x."""
        wide = 1.001 * reach  # so that rounding of the sums below loses no pair
        x, y = xy[:, 0], xy[:, 1]
        # Stripes are numbered with no more than one empty one between, and long gaps along y are
        # shortened: so a far outlier costs no precision.
        steps = np.minimum(np.diff(np.floor(x / wide)), 2.0)
        stripe = np.concatenate([[0.0], np.cumsum(steps)])
        along, length = y - y[len(y) // 2], 2.0 * _FAR + 3.0 * wide
        if along.max() > _FAR or along.min() < -_FAR:
            ordered = np.unique(y)
            gaps = np.minimum(np.diff(ordered), 3.0 * wide)
            along = np.concatenate([[0.0], np.cumsum(gaps)])[np.searchsorted(ordered, y)]
            length = float(along.max()) + 3.0 * wide
        place = stripe * length + along  # the stripes laid end to end
        order = np.argsort(place)
        place = place[order]
        # In the own stripe what follows, in the next one all; the one before finds this point.
        index = np.arange(len(x))
        begin = np.concatenate([index + 1, np.searchsorted(place, place + (length - wide))])
        until = np.concatenate([place + wide, place + (length + wide)])
        count = np.searchsorted(place, until, side="right") - begin
        return cls(xy, order, begin, count, int(count.sum()))

    def pairs_within(self, reach: float) -> tuple[Int, Int]:
        """Those at most `reach` apart, each once: indices of the points, shapes (m,)."""
        x, y = self.xy[:, 0][self.order], self.xy[:, 1][self.order]
        index = np.arange(len(x))
        index = np.concatenate([index, index])
        ends: list[int] = []
        if self.total > _BLOCK:
            past = np.arange(_BLOCK, self.total, _BLOCK)
            ends = np.searchsorted(np.cumsum(self.count), past).tolist()
        found = []
        for start, end in itertools.pairwise([0, *ends, len(index)]):
            block = slice(start, end)
            counts = self.count[block]
            one = np.repeat(index[block], counts)
            skipped = np.repeat(self.begin[block] - (np.cumsum(counts) - counts), counts)
            other = np.arange(len(one)) + skipped
            near = np.flatnonzero((x[one] - x[other]) ** 2 + (y[one] - y[other]) ** 2 <= reach**2)
            found.append((self.order[one[near]], self.order[other[near]]))
        if len(found) == 1:
            return found[0]
        ones, others = zip(*found, strict=True)
        return np.concatenate(ones), np.concatenate(others)

"""Clustering based segmentation of the map (eqs. 8-10, section 5.5)."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.geometry import Float
from mrs_people_loc.neighbours import connected

Int = NDArray[np.intp]

#: Cell centres travel as float32; two that are exactly `distance` apart arrive up to 8 um off when
#: they are 100 m from their robot.
_ROUNDING = 1e-5
#: Where points are farther than this from the middle one, along y, gaps are shortened [m].
_FAR = 1e4
#: So many pairs are compared at once: memory that is new costs more than it is used.
_BLOCK = 16_000
#: Where points have more others to look at than this, on average, most are spared. Cells of 5 cm
#: have 14 within 15 cm that follow them, of 24 that are looked at.
_CROWDED = 64
#: ... and those are spared that share a square with so many.
_CROWD = 32


def cluster(xy: Float, *, distance: float) -> Int:
    """Labels points so that those within a distance, directly or over others, share a label.

    The paper's three rules (two free points, a free and a labelled one, two labelled ones: within
    d_th they belong together) say that clusters are the connected components of the graph whose
    edges join points at most d_th apart. It has one solution, whatever the order of the points.

    Args:
        xy: Points [m], shape (n, 2).
        distance: d_th [m], inclusive.

    Returns:
        Label of each point from 0, shape (n,). Clusters are numbered by their least point (x, then
        y), so the numbers do not depend on the order either.
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
    """Of each point, the first one that it is connected with, shape (n,).

    Args:
        xy: Points in the order of x, then y, shape (n, 2).
        reach: Points at most this far apart are connected.
    """
    candidates = _Candidates.of(xy, reach)
    if candidates.total <= _CROWDED * len(xy):
        return connected(*candidates.pairs_within(reach), len(xy))
    return _components_in_crowds(xy, reach)


def _components_in_crowds(xy: Float, reach: float) -> Int:
    """The same where many points are in one place, with work that does not grow with their square.

    Points of a square whose diagonal is no longer than the reach are connected. Where they are
    many, a tree says if any of them is near any of a square around; it is asked only if the two
    squares are not connected anyhow, as most are by the outermost four points of each.
    """
    count = len(xy)
    side = 0.7071 * reach  # a diagonal is a little shorter than the reach
    cells, square, sizes = np.unique(
        np.floor(xy / side), axis=0, return_inverse=True, return_counts=True
    )
    square = square.reshape(-1)
    members = np.argsort(square, kind="stable")
    first = np.cumsum(sizes) - sizes
    low, high = (f.reduceat(xy[members], first) for f in (np.minimum, np.maximum))
    # Far from the origin, where floor has no digits left, the square may be larger.
    crowd = (sizes > _CROWD) & (((high - low) ** 2).sum(axis=1) <= reach**2)

    outermost = [
        members[first + _first_of_each(axis[members], first, sizes)]
        for axis in (xy[:, 0], -xy[:, 0], xy[:, 1], -xy[:, 1])
    ]
    kept = ~crowd[square]
    for points in outermost:
        kept[points] = True
    thin = np.flatnonzero(kept)
    one, other = _Candidates.of(xy[thin], reach).pairs_within(reach)
    crowded = np.flatnonzero(crowd[square])
    one = np.concatenate([thin[one], members[first[square[crowded]]]])
    other = np.concatenate([thin[other], crowded])
    root = connected(one, other, count)

    from scipy.spatial import KDTree  # here: it takes long to load

    at = {place: number for number, place in enumerate(map(tuple, cells.tolist()))}
    more_one, more_other = [], []
    for number in np.flatnonzero(crowd).tolist():
        mine = members[first[number] : first[number] + sizes[number]]
        i, j = cells[number].tolist()
        around = [at[i + di, j + dj] for di, dj in _AROUND if (i + di, j + dj) in at]
        others = [
            members[first[k] : first[k] + sizes[k]]
            for k in around
            if not (crowd[k] and root[members[first[k]]] == root[mine[0]])
        ]
        if not others:
            continue
        points = np.concatenate(others)
        points = points[root[points] != root[mine[0]]]
        # Only what is near the square at all.
        beyond = np.maximum(np.maximum(low[number] - xy[points], xy[points] - high[number]), 0.0)
        points = points[(beyond**2).sum(axis=1) <= reach**2]
        if not len(points):
            continue
        _, nearest = KDTree(xy[mine]).query(xy[points], distance_upper_bound=1.001 * reach)
        found = np.flatnonzero(nearest < len(mine))
        nearest, points = mine[nearest[found]], points[found]
        near = ((xy[points] - xy[nearest]) ** 2).sum(axis=1) <= reach**2
        more_one.append(nearest[near])
        more_other.append(points[near])
    return connected(np.concatenate([one, *more_one]), np.concatenate([other, *more_other]), count)


#: Squares whose points may be within the reach: 1.41 sides.
_AROUND = [(i, j) for i in range(-2, 3) for j in range(-2, 3) if (i, j) != (0, 0)]


def _first_of_each(values: Float, first: Int, sizes: Int) -> Int:
    """Where in each stretch of values the least one is, shape (stretches,)."""
    least = np.repeat(np.minimum.reduceat(values, first), sizes)
    hits = np.flatnonzero(values == least)
    stretch = np.searchsorted(first, hits, side="right") - 1
    _, once = np.unique(stretch, return_index=True)
    return hits[once] - first


@dataclass(frozen=True)
class _Candidates:
    """Pairs of points that may be near each other: of each point, a stretch of others.

    The plane is cut into stripes along y that are as wide as the reach. What is near a point lies
    in its own stripe or the next ones, not farther than the reach along y: a stretch of the points
    sorted by stripe and y.

    Attributes:
        xy: The points, shape (n, 2).
        order: The points sorted by stripe and y.
        begin: Where in this order the stretch of each begins; first those in its own stripe, then
            those in the next one, shape (2 n,).
        count: How long it is.
        total: How many pairs there are to look at.
    """

    xy: Float
    order: Int
    begin: Int
    count: Int
    total: int

    @classmethod
    def of(cls, xy: Float, reach: float) -> _Candidates:
        """Candidates for being at most `reach` apart, of points in the order of x."""
        wide = 1.001 * reach  # what rounding does to the sums below must hide no pair
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

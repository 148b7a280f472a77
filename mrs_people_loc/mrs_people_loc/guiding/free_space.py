"""Where robots may drive, and what walls hide, from the grid on `map`."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Bool, Float
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.team.masking import OccupancyGrid


@dataclass(frozen=True)
class SpaceTuning:
    """Constants of lines of sight and of paths; chosen.

    Attributes:
        margin: The grid is used up to this far beyond the places that matter [m].
        near_end: A wall hides nothing that is nearer to its face, or inside, than this [m]: places
            have errors.
        sight: Distance of samples along lines of sight [cells].
        farthest: Nobody is visible farther away than this, and no path is looked for [m].
        nodes: Distance of the nodes in which paths are looked for [m], ...
        most_nodes: ... more of it where a box would have more nodes than this, ...
        widest: ... up to this [m]; no path is looked for in a greater box ...
        samples: ... and of samples along lines [m].
        detour: Paths are first looked for in the box of start and goal and so much around them [m].
        narrow: A metre of path costs up to 1 + this where clearance is only what is needed, ...
        wide: ... less up to where it is this much more [m].
        through_disc: A metre of path through a disc costs so much more.
        escape: Without enough clearance, only this far around the start [m], ...
        too_near: ... and then a metre costs so much more.
        good_line: The line to the goal is taken where no path can cost much less.
        as_good: The path until now is kept up to this much of the cost of another one.
        longest_line: Straight lines replace up to so many nodes of a path.
        spare: Nodes of a path have more clearance by this than half their distance [m].
    """

    margin: float = 10.0
    near_end: float = 0.2
    sight: float = 0.7
    farthest: float = 60.0
    nodes: float = 0.15
    most_nodes: int = 16_000
    widest: float = 0.45
    samples: float = 0.08
    detour: float = 4.0
    narrow: float = 2.0
    wide: float = 0.5
    through_disc: float = 10.0
    escape: float = 1.0
    too_near: float = 20.0
    good_line: float = 1.25
    as_good: float = 1.25
    longest_line: int = 40
    spare: float = 0.005

    def least(self, nodes: float) -> float:
        """An edge between nodes with more clearance than half its length crosses no wall [m].

        Args:
            nodes: Distance of the nodes [m].
        """
        return 0.5 * nodes * 2**0.5 + self.spare


SPACE_TUNING = SpaceTuning()


class FreeSpace:
    """Free floor of a map; unknown floor and what is outside of the map are not free.

    Args:
        grid: The map; None: everything is free.
        occupied_from: Its cells from this value on are occupied [%].
        around: Places that matter [m], such as those of a tour, shape (n, 2): the map farther than
            10 m from their bounding box is left out. None: all of it is used.
        tuning: Constants.

    Attributes:
        tuning: Constants.
    """

    def __init__(
        self,
        grid: OccupancyGrid | None,
        *,
        occupied_from: int = 65,
        around: Float | None = None,
        tuning: SpaceTuning = SPACE_TUNING,
    ) -> None:
        self._grid, self.tuning = grid, tuning
        if grid is None:
            return
        self._turn = rotation_2d(grid.yaw)
        data, self._corner = _cropped(grid, around, self._turn, tuning.margin)
        self._size = np.array(data.shape[::-1]) * grid.resolution
        # A border that is not free, so that there always is something that is not.
        blocked = np.pad((data < 0) | (data >= occupied_from), 1, constant_values=True)
        self._clearance = _signed_distance(blocked) * grid.resolution
        self._occupied: Bool = np.pad(data >= occupied_from, 1)

    @classmethod
    def unbounded(cls) -> FreeSpace:
        """Free floor everywhere, for teams without a map."""
        return cls(None)

    def clearance(self, xy: Float) -> Float:
        """Distance to what is not free [m], negative inside of it; inf without a map.

        Args:
            xy: Places in the common frame [m], shape (..., 2).

        Returns:
            Interpolated between the cells, shape (...).
        """
        if self._grid is None:
            return np.full(np.shape(xy)[:-1], np.inf)
        height, width = self._clearance.shape
        place = self._cells(np.asarray(xy, dtype=np.float64)) - 0.5
        inside = np.clip(place, 0.0, (width - 1.001, height - 1.001))
        low = inside.astype(np.intp)
        (fx, fy), (column, row) = np.moveaxis(inside - low, -1, 0), np.moveaxis(low, -1, 0)
        flat, at = self._clearance.ravel(), row * width + column
        lower = flat[at] * (1 - fx) + flat[at + 1] * fx
        upper = flat[at + width] * (1 - fx) + flat[at + width + 1] * fx
        outside = np.linalg.norm(place - inside, axis=-1) * self._grid.resolution
        return np.asarray(lower * (1 - fy) + upper * fy - outside)

    def is_visible(self, a: Float, b: Float) -> Bool:
        """Whether no wall is between places.

        Walls closer than 0.2 m to either place hide nothing. Unknown floor does not, either.

        Args:
            a: In the common frame [m], shape (..., 2).
            b: Likewise; both are broadcast.

        Returns:
            Shape (...).
        """
        a, b = np.broadcast_arrays(np.asarray(a, np.float64), np.asarray(b, np.float64))
        if self._grid is None or not a.size:
            return np.ones(a.shape[:-1], dtype=bool)
        length = np.linalg.norm(b - a, axis=-1)[..., np.newaxis]
        far = length > self.tuning.farthest
        b, length = np.where(far, a, b), np.where(far, 0.0, length)
        longest = max(float(length.max()), self.tuning.near_end)
        step = self.tuning.sight * self._grid.resolution
        count = int(np.ceil(longest / step)) + 1
        part = np.linspace(0.0, 1.0, count)
        start, end = self._cells(a), self._cells(b)
        cell = start[..., np.newaxis, :] + part[:, np.newaxis] * (end - start)[..., np.newaxis, :]
        height, width = self._occupied.shape
        cell = np.clip(cell, 0, (width - 1, height - 1)).astype(np.intp)
        hit = self._occupied[cell[..., 1], cell[..., 0]]
        counts = np.minimum(part, 1.0 - part) * length > self.tuning.near_end
        return np.asarray(~((hit & counts).any(axis=-1) | far[..., 0]))

    def path(
        self,
        start: Float,
        goal: Float,
        radius: float,
        blocked: Float | None = None,
        before: Float | None = None,
    ) -> Float | None:
        """A short path that prefers clearance.

        Args:
            start: In the common frame [m], shape (2,). Where it has less clearance than wanted, the
                path leads out first.
            goal: Likewise.
            radius: Wanted clearance of the path [m].
            blocked: Discs (x, y, radius) that are avoided unless the detour is ten times as long as
                the way through, shape (k, 3) [m].
            before: The path until now, shape (m, 2): what is left of it is kept unless another one
                costs less by a fifth.

        Returns:
            From start to goal, shape (m, 2); None: there is no path.
        """
        start, goal = np.asarray(start, np.float64), np.asarray(goal, np.float64)
        discs = np.zeros((0, 3)) if blocked is None else blocked
        away = float(np.linalg.norm(goal - start))
        if away > self.tuning.farthest or self.clearance(goal) < radius:
            return None
        cost = _Cost(self, start, radius, discs)
        line = np.stack([start, goal])
        good = self.tuning.good_line * away
        if cost.of_lines(start, goal[np.newaxis])[0] <= good:
            return line
        low, high = line.min(axis=0) - self.tuning.detour, line.max(axis=0) + self.tuning.detour
        found = _search(cost, start, goal, low, high)
        if found is None and self._grid is not None:
            found = _search(cost, start, goal, *self._bounds())
        if found is None:
            return None
        path, kept = _pulled(cost, found), _rest(before, start, goal)
        is_kept = len(kept) > 1 and cost.of_path(kept) <= self.tuning.as_good * cost.of_path(path)
        return kept if is_kept else path

    def _cells(self, xy: Float) -> Float:
        """Column and row with fractions, of the padded arrays."""
        assert self._grid is not None
        origin = (self._grid.x, self._grid.y)
        local = (xy - origin) @ self._turn - self._corner
        return np.asarray(local / self._grid.resolution + 1.0)

    def _bounds(self) -> tuple[Float, Float]:
        """Bounding box in the common frame [m]."""
        assert self._grid is not None
        x, y = self._size
        local = self._corner + np.array([(0.0, 0.0), (x, 0.0), (0.0, y), (x, y)])
        corners = local @ self._turn.T + (self._grid.x, self._grid.y)
        return corners.min(axis=0), corners.max(axis=0)


class _Cost:
    """What a metre of path costs at a place.

    Attributes:
        tuning: Constants, those of `space`.

    Args:
        space: Free floor.
        start: Where the path begins [m], shape (2,).
        radius: Wanted clearance [m].
        discs: To be avoided, shape (k, 3) [m].
    """

    def __init__(self, space: FreeSpace, start: Float, radius: float, discs: Float) -> None:
        self._space, self._start, self._radius, self._discs = space, start, radius, discs
        self.tuning = space.tuning

    def at(self, xy: Float, nodes: float | None = None) -> Float:
        """Cost of a metre at places [m], shape (..., 2); inf where nobody may go.

        Args:
            xy: The places.
            nodes: Their distance from each other [m]; None: as usual.
        """
        tuning, clearance = self.tuning, self._space.clearance(xy)
        room = (clearance - self._radius) / tuning.wide
        cost = 1.0 + tuning.narrow * np.clip(1.0 - room, 0.0, 1.0)
        too_near = clearance < self._radius
        escapes = np.linalg.norm(xy[too_near] - self._start, axis=-1) < tuning.escape
        cost[too_near] += np.where(escapes, tuning.too_near, np.inf)
        cost[clearance < min(tuning.least(nodes or tuning.nodes), self._radius)] = np.inf
        if len(self._discs):
            # Half of |place|^2 - |place - centre|^2 + radius^2, from the start.
            place, centre = xy - self._start, self._discs[:, :2] - self._start
            beyond = 0.5 * (self._discs[:, 2] ** 2 - (centre**2).sum(axis=1))
            most = (place @ centre.T + beyond).max(axis=-1)
            cost = cost + tuning.through_disc * (most > 0.5 * (place**2).sum(axis=-1))
        return np.asarray(cost)

    def of_lines(self, a: Float, b: Float) -> Float:
        """Cost of straight lines [m], from shape (2,) or (n, 2), to shape (n, 2)."""
        along = b - a
        length = np.linalg.norm(along, axis=1)
        samples = self.tuning.samples
        count = int(np.ceil(max(float(length.max()), samples) / samples))
        part = (np.arange(count) + 0.5) / count
        places = b[:, np.newaxis] - part[:, np.newaxis] * along[:, np.newaxis]
        return np.asarray(self.at(places).mean(axis=1) * length)

    def of_path(self, path: Float) -> float:
        """Cost of a path, shape (m, 2)."""
        return float(self.of_lines(path[:-1], path[1:]).sum())


def _rest(path: Float | None, start: Float, goal: Float) -> Float:
    """What is left of a path from its segment nearest to a place on, to a goal, shape (m, 2).

    Empty where there was none, or a straight one.
    """
    if path is None or len(path) < 3:
        return np.empty((0, 2))
    a, along = path[:-1], np.diff(path, axis=0)
    share = ((start - a) * along).sum(axis=1) / np.maximum((along**2).sum(axis=1), 1e-12)
    nearest = a + np.clip(share, 0.0, 1.0)[:, np.newaxis] * along
    row = int(np.linalg.norm(nearest - start, axis=1).argmin())
    return np.concatenate([start[np.newaxis], path[row + 1 : -1], goal[np.newaxis]])


def _cropped(
    grid: OccupancyGrid, around: Float | None, turn: Float, margin: float
) -> tuple[NDArray[np.int8], Float]:
    """Cells that matter, and where their outer corner is in the grid's axes [m], shape (2,)."""
    height, width = grid.data.shape
    low, high = np.zeros(2, np.intp), np.array([width, height])
    if around is not None:
        local = (around - (grid.x, grid.y)) @ turn
        low = np.floor((local.min(axis=0) - margin) / grid.resolution).astype(np.intp)
        high = np.ceil((local.max(axis=0) + margin) / grid.resolution).astype(np.intp)
        low, high = np.clip(low, 0, (width - 1, height - 1)), np.minimum(high, (width, height))
        high = np.maximum(high, low + 1)
    data = grid.data[low[1] : high[1], low[0] : high[0]]
    return data, np.asarray(low * grid.resolution, np.float64)


def _signed_distance(blocked: Bool) -> Float:
    """Of each cell's centre to the border of what is blocked, negative inside [cells]."""
    outside, inside = (
        cv2.distanceTransform(mask.astype(np.uint8), cv2.DIST_L2, cv2.DIST_MASK_PRECISE)
        for mask in (~blocked, blocked)
    )
    signed = np.where(blocked, 0.5 - inside.astype(np.float64), outside.astype(np.float64) - 0.5)
    return np.asarray(np.clip(signed, -1e6, 1e6))


def _search(cost: _Cost, start: Float, goal: Float, low: Float, high: Float) -> Float | None:
    """Cheapest path along the nodes of a box, from start to goal, shape (m, 2)."""
    from scipy.sparse import coo_array  # here: they take long to load
    from scipy.sparse.csgraph import dijkstra

    tuning = cost.tuning
    nodes_m = max(tuning.nodes, float(np.sqrt(np.prod(high - low) / tuning.most_nodes)))
    if nodes_m > tuning.widest:
        return None
    columns, rows = np.ceil((high - low) / nodes_m).astype(np.intp) + 1
    x, y = np.meshgrid(low[0] + nodes_m * np.arange(columns), low[1] + nodes_m * np.arange(rows))
    places = np.stack([x, y], axis=-1)
    density = cost.at(places, nodes_m)
    free = np.isfinite(density).ravel()
    if not free.any():
        return None
    flat = places.reshape(-1, 2)
    first, last = (_nearest(flat, free, place) for place in (start, goal))
    number = np.arange(rows * columns).reshape(rows, columns)
    pairs = [
        (number[:, :-1], number[:, 1:], 1.0),
        (number[:-1], number[1:], 1.0),
        (number[:-1, :-1], number[1:, 1:], 2**0.5),
        (number[:-1, 1:], number[1:, :-1], 2**0.5),
    ]
    a = np.concatenate([pair[0].ravel() for pair in pairs])
    b = np.concatenate([pair[1].ravel() for pair in pairs])
    length = np.concatenate([np.full(pair[0].size, pair[2] * nodes_m) for pair in pairs])
    keep = free[a] & free[b]
    a, b = a[keep], b[keep]
    weight = 0.5 * (density.ravel()[a] + density.ravel()[b]) * length[keep]
    # SciPy before 1.13 takes indices of 32 bits only.
    edges = a.astype(np.int32), b.astype(np.int32)
    graph = coo_array((weight, edges), shape=(len(flat), len(flat))).tocsr()
    distance, before = dijkstra(graph, directed=False, indices=first, return_predecessors=True)
    if not np.isfinite(distance[last]):
        return None
    nodes = [last]
    while nodes[-1] != first:
        nodes.append(int(before[nodes[-1]]))
    return np.concatenate([start[np.newaxis], flat[nodes[::-1]], goal[np.newaxis]])


def _nearest(places: Float, free: Bool, to: Float) -> int:
    away = ((places - to) ** 2).sum(axis=1)
    return int(np.where(free, away, np.inf).argmin())


def _pulled(cost: _Cost, path: Float) -> Float:
    """The path without the points that straight lines leave out at no cost."""
    steps = cost.of_lines(path[:-1], path[1:])
    so_far = np.concatenate([[0.0], np.cumsum(np.nan_to_num(steps, posinf=1e6))])
    kept, at = [path[0]], 0
    while at < len(path) - 1:
        ends = slice(at + 1, at + 1 + cost.tuning.longest_line)
        good = cost.of_lines(path[at], path[ends]) <= so_far[ends] - so_far[at] + 1e-9
        at += 1 + int(np.flatnonzero(good)[-1]) if good.any() else 1
        kept.append(path[at])
    return np.array(kept)

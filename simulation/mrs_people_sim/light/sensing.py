"""What robots of a tour without rendering (`simulation.tours`) see: walls and people, with errors.

The errors have the form of a stereo head's. Those of walls come from noise in the inverse depth
along rays of the view, to which `StereoWalls` fits lines as well, and from the calibration, which
is off a little all the time. Those of people are long along the line of sight, and a part of their
variance lasts for seconds, as long as somebody is seen from one side.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.signal import lfilter

from mrs_people_loc.arrays import Float
from mrs_people_loc.localization.walls import Walls
from mrs_people_loc.scan import Cells, Scan

Rng = np.random.Generator


@dataclass(frozen=True)
class LightHead:
    """A stereo head at base_link that looks ahead.

    Attributes:
        half_view: Half of its field of view [rad].
        reach: Farthest that walls [m],
        people_reach: ... and people are seen [m].
        rays: Rays of the view.
        inverse_sigma: Noise of the inverse depth of a wall at a ray [1/m]: 0.25 px, with a focal
            length times baseline of 10.5 px m, over six independent rows.
        offset_sigma: Error of all inverse depths [1/m], and by the slope of a ray: 0.1 and 0.04 px
            at the border are stated; drawn once per robot, half as large.
        yaw_sigma: Likewise of the direction in which it looks [rad].
        least_rays: A wall is seen at so many rays at least,
        least_length: ... over so much of its length [m],
        most_bearing_sigma: ... and so surely [rad],
        found: ... and, if it is so far away [m], in this share of the views: a quarter of what is
            measured without people, which makes one view in four or five in their corridor.
        end_sigma: Noise of the direction of a wall's end, as tan [1].
        along: Errors of people along the line of sight at 1.5 m and at 4.5 m, and beyond [m].
        across: Likewise, across it [m].
        lasting: Share of their variance that lasts, for so long [s].
        missed: Share of people who are missed although they are in view.
    """

    half_view: float = math.radians(37.0)
    reach: float = 4.5
    people_reach: float = 5.0
    rays: int = 38
    inverse_sigma: float = 0.25 / 10.5 / math.sqrt(6.0)
    offset_sigma: tuple[float, float] = (0.10 / 10.5, 0.04 / 10.5 / 0.75)
    yaw_sigma: float = 0.005
    least_rays: int = 6
    least_length: float = 0.8
    most_bearing_sigma: float = 0.05
    found: tuple[tuple[float, ...], tuple[float, ...]] = ((2.5, 3.5, 4.5), (0.18, 0.12, 0.02))
    end_sigma: float = 0.01
    along: tuple[float, float] = (0.04, 0.10)
    across: float = 0.03
    lasting: tuple[float, float] = (0.35, 2.5)
    missed: float = 0.05


HEAD = LightHead()
#: Radius of what a person or a robot hides of a wall, or of somebody else [m].
BODY = 0.25


# ------------------------------------------------------------------------------------------ walls


def seen_walls(
    segments: NDArray,
    poses: NDArray,
    bodies: NDArray,
    rng: Rng,
    head: LightHead = HEAD,
    *,
    off: Float | None = None,
) -> list[Walls]:
    """The walls that a robot sees at several times.

    Args:
        segments: Both ends of each wall [m], shape (m, 2, 2).
        poses: The robot's x, y [m] and yaw [rad] at each time, shape (k, 3).
        bodies: Who may hide a wall, positions then [m], shape (k, b, 2).
        rng: Source of randomness.
        head: What it sees with.
        off: Errors of its calibration, see `calibration_errors`; None: they are drawn.

    Returns:
        At each time, walls in its base_link.
    """
    slopes = np.tan(np.linspace(-head.half_view, head.half_view, head.rays))
    ends = in_frames(poses, segments.reshape(-1, 2)).reshape(len(poses), -1, 2, 2)
    depth = _depths(ends, slopes)
    nearest, hit = depth.min(axis=2), depth.argmin(axis=2)
    nearest = np.where(_hidden(in_frames(poses, bodies), slopes, nearest), np.inf, nearest)
    seen = (hit[..., None] == np.arange(len(segments))) & (nearest <= head.reach)[..., None]
    inverse = 1.0 / nearest + head.inverse_sigma * rng.normal(size=nearest.shape)
    off = calibration_errors(rng, head) if off is None else off
    inverse += off[0] + off[1] * slopes
    lines, covariances = _fit(slopes, inverse, seen, head)
    return [
        _walls(slopes, seen[k], ends[k], lines[k], covariances[k], off[2], rng, head)
        for k in range(len(poses))
    ]


def calibration_errors(rng: Rng, head: LightHead = HEAD) -> Float:
    """Errors of all inverse depths [1/m], by the slope of a ray, and of the direction [rad]."""
    return np.asarray(0.5 * rng.normal(size=3) * [*head.offset_sigma, head.yaw_sigma])


def in_frames(poses: NDArray, places: NDArray) -> Float:
    """Places of the map in the base_link of poses, shape (k, n, 2).

    Args:
        poses: Shape (k, 3).
        places: Shape (n, 2), or one set per pose, (k, n, 2) [m].
    """
    off = places - poses[:, None, :2]
    cos, sin = np.cos(poses[:, 2])[:, None], np.sin(poses[:, 2])[:, None]
    return np.stack(
        [cos * off[..., 0] + sin * off[..., 1], cos * off[..., 1] - sin * off[..., 0]], axis=-1
    )


def _depths(ends: NDArray, slopes: NDArray) -> NDArray:
    """Depths at which rays (1, slope) meet segments [m], inf: not, shape (k, rays, m)."""
    (x0, y0), (x1, y1) = (np.moveaxis(ends[:, :, e], -1, 0)[..., None] for e in (0, 1))
    side0, side1 = y0 - slopes * x0, y1 - slopes * x1
    with np.errstate(divide="ignore", invalid="ignore"):
        part = side0 / (side0 - side1)
        depth = x0 + part * (x1 - x0)
    crosses = (side0 * side1 < 0.0) & (depth > 0.05)
    return np.moveaxis(np.where(crosses, depth, np.inf), 1, 2)


def _hidden(bodies: NDArray, slopes: NDArray, depth: NDArray) -> NDArray:
    """Whether somebody stands before what a ray meets, shape (k, rays)."""
    x, y = bodies[:, None, :, 0], bodies[:, None, :, 1]
    along = np.sqrt(1.0 + slopes**2)[:, None]
    across = np.abs(y - slopes[:, None] * x) / along
    found: NDArray = ((across < BODY) & (x > 0.0) & (x < depth[..., None])).any(axis=2)
    return found


def _fit(
    slopes: NDArray, inverse: NDArray, seen: NDArray, head: LightHead
) -> tuple[NDArray, NDArray]:
    """Lines p0 + p1 slope through inverse depths, each over the rays that see a wall.

    Returns:
        p0, p1 [1/m], shape (k, m, 2), and their covariance, shape (k, m, 2, 2).
    """
    count = seen.sum(axis=1).astype(np.float64)
    t, q = slopes[None, :, None], np.where(seen, inverse[..., None], 0.0)
    s1, s2 = (seen * t).sum(axis=1), (seen * t**2).sum(axis=1)
    r0, r1 = q.sum(axis=1), (q * t).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = 1.0 / (count * s2 - s1**2)
        line = np.stack([s2 * r0 - s1 * r1, count * r1 - s1 * r0], axis=-1) * scale[..., None]
        covariance = np.array([[s2, -s1], [-s1, count]]) * scale * head.inverse_sigma**2
    return line, np.moveaxis(covariance, (0, 1), (-2, -1))


def _walls(
    slopes: NDArray, seen: NDArray, ends: NDArray, line: NDArray, covariance: NDArray, yaw: float,
    rng: Rng, head: LightHead,
) -> Walls:  # fmt: skip
    """The walls of one time that are seen well enough."""
    rows = []
    for m in np.flatnonzero(seen.sum(axis=0) >= head.least_rays):
        p = line[m]
        size = math.hypot(*p)
        jacobian = np.array([[-p[0] / size, -p[1] / size], [-p[1], p[0]]]) / size**2
        of_line = covariance[m] + np.diag(np.square(head.offset_sigma))
        stated = jacobian @ of_line @ jacobian.T + np.diag([0.0, head.yaw_sigma**2])
        extent, is_end = _extent(slopes[seen[:, m]], ends[m], p, rng, head)
        if extent[1] - extent[0] < head.least_length:
            continue
        if stated[1, 1] > head.most_bearing_sigma**2:
            continue
        if rng.random() >= np.interp(1.0 / size, *head.found):
            continue
        rows.append((1.0 / size, math.atan2(p[1], p[0]) + yaw, stated, extent, is_end))
    distance, bearings, covariances, extents, are_ends = (
        zip(*rows, strict=True) if rows else [()] * 5
    )
    return Walls(
        np.array(distance, dtype=np.float64),
        np.array(bearings, dtype=np.float64),
        np.array(covariances, dtype=np.float64).reshape(-1, 2, 2),
        np.array(extents, dtype=np.float64).reshape(-1, 2),
        np.array(are_ends, dtype=bool).reshape(-1, 2),
    )


def _extent(
    slopes: NDArray, ends: NDArray, line: NDArray, rng: Rng, head: LightHead
) -> tuple[list[float], list[bool]]:
    """Which part of a wall is seen, measured from the perpendicular's foot, and its ends in it."""
    size = math.hypot(*line)
    along = np.array([-line[1], line[0]]) / size
    limit = math.tan(head.half_view)
    grain = 1.5 * 2.0 * head.half_view / head.rays
    parts = []
    for slope in (slopes.min(), slopes.max()):
        x, is_end = 1.0 / (line[0] + line[1] * slope), False
        for end in ends:
            if 0.3 < end[0] < head.reach and abs(end[1]) < limit * end[0]:
                at = end[1] / end[0]
                if abs(at - slope) < grain * (1.0 + slope**2):
                    is_end, slope = True, at + head.end_sigma * rng.normal()
                    x = 1.0 / (line[0] + line[1] * slope)
        parts.append((float(along @ (x, slope * x)), is_end))
    parts.sort()
    return [part for part, _ in parts], [is_end for _, is_end in parts]


# ----------------------------------------------------------------------------------------- people


@dataclass(frozen=True)
class PeopleInView:
    """Who a robot sees at one time.

    Attributes:
        person: Index of each, shape (n,).
        xy: Where, in its base_link [m], shape (n, 2).
        along: Stated standard deviation along the line of sight [m], shape (n,).
        across: Likewise, across it [m], shape (n,).
    """

    person: NDArray
    xy: Float
    along: Float
    across: Float


def seen_people(
    times: NDArray, poses: NDArray, people: NDArray, rng: Rng, head: LightHead = HEAD
) -> list[PeopleInView]:
    """The people whom a robot sees at several times.

    Args:
        times: The times [s], shape (k,).
        poses: The robot's x, y [m] and yaw [rad] then, shape (k, 3).
        people: Positions in the map [m], shape (k, people, 2).
        rng: Source of randomness.
        head: What it sees with.
    """
    local = in_frames(poses, people)
    seen = _in_view(local, head) & (rng.random(local.shape[:2]) >= head.missed)
    share, lasts = head.lasting
    slow = _changing(times, people.shape[1], lasts, rng)
    error = math.sqrt(share) * slow + math.sqrt(1.0 - share) * rng.normal(size=slow.shape)
    return [_measured(local[k], row, error[k], head) for k, row in enumerate(seen)]


def _in_view(local: NDArray, head: LightHead) -> NDArray:
    """Who is in view and not behind somebody else, shape (k, people).

    Args:
        local: Where people are in the base_link of a head that looks ahead, shape (k, people, 2).
        head: What it sees with.
    """
    away = np.hypot(local[..., 0], local[..., 1])
    angle = np.arctan2(local[..., 1], local[..., 0])
    seen = (np.abs(angle) < head.half_view) & (away < head.people_reach) & (away > 0.4)
    nearer = away[:, None, :] < away[:, :, None]
    beside = np.abs(np.sin(angle[:, None, :] - angle[:, :, None])) * away[:, None, :] < BODY
    found: NDArray = seen & ~(
        nearer & beside & (np.cos(angle[:, None, :] - angle[:, :, None]) > 0)
    ).any(axis=2)
    return found


def _measured(local: NDArray, seen: NDArray, error: NDArray, head: LightHead) -> PeopleInView:
    """People who are seen, with errors.

    Args:
        local: Where people are [m], shape (people, 2).
        seen: Who is seen, shape (people,).
        error: Along the line of sight and across it [sigmas], shape (people, 2).
        head: What it sees with.
    """
    away = np.hypot(local[:, 0], local[:, 1])
    along = np.interp(away, (1.5, 4.5), head.along)
    across = np.full_like(along, head.across)
    ahead = local / np.maximum(away, 1e-9)[:, None]
    aside = np.stack([-ahead[:, 1], ahead[:, 0]], axis=1)
    xy = local + (along * error[:, 0])[:, None] * ahead + (across * error[:, 1])[:, None] * aside
    return PeopleInView(np.flatnonzero(seen), xy[seen], along[seen], across[seen])


class Eyes:
    """A robot's head that sees people and walls, one time after another.

    Args:
        rng: Source of randomness.
        looks_back: Whether it looks back over base_link.
        head: What it sees with.
    """

    #: Radius of what a robot hides of a person: its mast [m].
    _MAST = 0.1

    def __init__(self, rng: Rng, *, looks_back: bool = False, head: LightHead = HEAD) -> None:
        self._rng, self._head = rng, head
        self._turn = math.pi if looks_back else 0.0
        self._off = calibration_errors(rng, head)
        self._slow: NDArray | None = None

    def people(
        self, pose: Float, people: Float, robots: Float, solid: Float, dt: float
    ) -> PeopleInView:
        """The people whom it sees.

        Args:
            pose: Its robot's x, y [m] and yaw [rad], shape (3,).
            people: Where they are in the map [m], shape (n, 2).
            robots: Where its team-mates are [m], shape (m, 2).
            solid: Both ends of what hides them [m], shape (k, 2, 2).
            dt: Time since the last call [s].
        """
        head, rng, count = self._head, self._rng, len(people)
        share, lasts = head.lasting
        kept = math.exp(-dt / lasts) if self._slow is not None else 0.0
        before = 0.0 if self._slow is None else self._slow
        self._slow = kept * before + math.sqrt(1.0 - kept**2) * rng.normal(size=(count, 2))
        error = math.sqrt(share) * self._slow + math.sqrt(1.0 - share) * rng.normal(size=(count, 2))
        local = in_frames(self._looking(pose), people)
        seen = _in_view(local, head)[0] & (rng.random(count) >= head.missed)
        seen &= ~_crosses(pose[:2], people, solid)
        for mate in robots:
            seen &= ~_is_before(pose[:2], people, mate, self._MAST)
        view = _measured(local[0], seen, error, head)
        return PeopleInView(view.person, self._ahead(view.xy), view.along, view.across)

    def walls(self, segments: NDArray, pose: Float, bodies: Float) -> Walls:
        """The walls that it sees; arguments as for `seen_walls`, at one time."""
        seen = seen_walls(
            segments, self._looking(pose), bodies[None], self._rng, self._head, off=self._off
        )[0]
        bearing = (seen.bearing + self._turn + math.pi) % (2.0 * math.pi) - math.pi
        return dataclasses.replace(seen, bearing=bearing)

    def _looking(self, pose: Float) -> Float:
        """The pose with the direction in which it looks, shape (1, 3)."""
        return np.array([[pose[0], pose[1], pose[2] + self._turn]])

    def _ahead(self, xy: Float) -> Float:
        """Places from the frame of the view in base_link."""
        return -xy if self._turn else xy


def _crosses(eye: Float, places: Float, segments: NDArray) -> NDArray:
    """Whether a segment is between an eye and places, shape (n,)."""

    def side(a: NDArray, b: NDArray, c: NDArray) -> NDArray:
        """On which side of the line from a to b each c is."""
        along, off = b - a, c - a
        found: NDArray = along[..., 0] * off[..., 1] - along[..., 1] * off[..., 0]
        return found

    one, other, place = segments[:, 0], segments[:, 1], places[:, None]
    apart = side(one, other, eye) * side(one, other, place) < 0
    hit: NDArray = (apart & (side(eye, place, one) * side(eye, place, other) < 0)).any(axis=1)
    return hit


def _is_before(eye: Float, places: Float, body: Float, radius: float) -> NDArray:
    """Whether a body hides the middle of places from an eye, shape (n,)."""
    toward = places - eye
    away = np.maximum(np.hypot(*toward.T), 1e-9)
    ahead = toward / away[:, None]
    off = body - eye
    along = ahead @ off
    aside = np.abs(ahead[:, 0] * off[1] - ahead[:, 1] * off[0])
    found: NDArray = (along > 0.0) & (along < away) & (aside < radius)
    return found


def _changing(times: NDArray, count: int, lasts: float, rng: Rng) -> NDArray:
    """Two numbers of variance 1 per person that change within some seconds, shape (k, count, 2).

    A first-order Gauss-Markov process; the times are evenly apart.
    """
    kept = math.exp(-float(np.diff(times[:2], prepend=0.0)[-1]) / lasts)
    white = rng.normal(size=(len(times), count, 2))
    white[1:] *= math.sqrt(1.0 - kept**2)
    return np.asarray(lfilter([1.0], [1.0, -kept], white, axis=0))


def scan_of(robot: str, stamp_ns: int, seen: PeopleInView) -> Scan:
    """The scan of a view that shows just these people: a cell for each."""
    count = len(seen.xy)

    def filled(value: float) -> NDArray:
        return np.full(count, value, dtype=np.float32)

    x, y = seen.xy.astype(np.float32).T
    return Scan(
        robot,
        stamp_ns,
        Cells(
            x=x.copy(), y=y.copy(), z=filled(1.6), z_min=filled(0.5), top=filled(1.7),
            count=np.full(count, 200, dtype=np.uint32),
            body=np.arange(1, count + 1, dtype=np.uint32), score=filled(5.0),
            sigma_range=seen.along.astype(np.float32), sigma_across=seen.across.astype(np.float32),
        ),
    )  # fmt: skip

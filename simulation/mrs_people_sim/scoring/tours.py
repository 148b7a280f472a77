"""Scores of guided tours: who came along, who was seen, and how the robots drove.

The rules, in one place:

- A tour begins when the group sets off, the first status of `LEADING`, `WAITING` or `AT_STOP`, and
  ends with the first of `FINISHED` or `CANCELLED` after it, or the last one. Only this time counts.
- The end of the way is where the leader's last post was. A tour that the guide calls finished is so
  if the true median of all people is within `END_M` of it.
- A person is seen while `tracked_people` has somebody, hidden or not, within `SEEN_M` of them, one
  to one, by the rules of `scoring.positions`; also those whom no robot can see have to be found.
  They are detected while somebody is there who is not only predicted.
- A person is lost who is not there at the end, or farther than `LOST_M` from the group's middle,
  the median of all people, or, once the guide calls the tour finished, farther than `LEFT_M` from
  the end of the way. Those whom the guide gave up are counted by themselves.
- Who is of no group at any time of the tour is a bystander: only distances count of them.
- Distances of robots to people are between their axes, every `STEP_NS`. A robot comes near by its
  own motion if its velocity towards the person is higher than `TOWARDS_MPS`.
- A contact is a time without a gap in which a robot and a person are within `TOUCH_M`; it is the
  robot's if it comes near by its own motion in it.
- Robots stand off while one that is farther than `AWAY_M` from its post has not got as far as
  `STANDS_M` for `STANDS_NS`, and a person is within `BESIDE_M` of it.
- The formation's error is the distance of a robot from its post, at each status. The post of a
  leader that drives is ahead of it, wherever it is: there it is the distance from the leaders' way,
  the nearest of all posts of leaders.
- Stragglers are the episodes of `scoring.stragglers`; they are back if the episode ends before the
  tour. A straggler is alone while no robot is within `BESIDE_M`.
"""

from __future__ import annotations

import dataclasses
import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Bool, Float
from mrs_people_loc.guiding.guidance import Guidance, Role, State
from mrs_people_sim.scoring.poses import PoseTrack
from mrs_people_sim.scoring.positions import nothing, percentile, ratio, score, sums_of
from mrs_people_sim.scoring.stragglers import episodes
from mrs_tools.bags.records import Estimate, Truth

#: A person is found by somebody within this distance [m].
SEEN_M = 0.5
#: Who is farther than this from the group's middle at the end is lost [m].
LOST_M = 6.0
#: The middle of a group that has come to the end is within this distance of it [m]; who is farther
#: from it than this is lost [m].
END_M, LEFT_M = 7.0, 10.0
#: Bodies of a robot and a person, 0.20 and 0.25 m, touch within this distance of their axes [m].
TOUCH_M = 0.45
#: Personal space that robots should stay out of, and what they may not enter by themselves [m].
PERSONAL_M, OWN_MOTION_M = 0.50, 0.45
#: A robot that comes nearer to a person faster than this does so by its own motion [m/s].
TOWARDS_MPS = 0.05
#: A robot that has not got as far as this [m] in this time [ns], although it is so far from its
#: post [m], is held up.
STANDS_M, STANDS_NS, AWAY_M = 0.15, 3_000_000_000, 0.5
#: A straggler with a robot within this distance is not alone [m].
BESIDE_M = 2.0
#: Distances are measured so often [ns].
STEP_NS = 100_000_000
#: Velocities of robots are means over so long before and after [ns].
_HALF_NS = 50_000_000

_ON_TOUR = (State.LEADING, State.WAITING, State.AT_STOP)
_ENDED = (State.FINISHED, State.CANCELLED)


@dataclass(frozen=True)
class TourRecord:
    """A tour as it went.

    Attributes:
        statuses: What the guide said, by stamp.
        truth: Where the people are.
        robots: By name, true poses of the robots.
        estimates: What `tracked_people` had.
    """

    statuses: Sequence[Guidance]
    truth: Truth
    robots: Mapping[str, PoseTrack]
    estimates: Sequence[Estimate]

    def span_ns(self) -> tuple[int, int] | None:
        """When the tour begins and ends [ns]; None: the group never set off."""
        begins = [status.stamp_ns for status in self.statuses if status.state in _ON_TOUR]
        if not begins:
            return None
        ends = [
            status.stamp_ns
            for status in self.statuses
            if status.state in _ENDED and status.stamp_ns >= begins[0]
        ]
        return begins[0], ends[0] if ends else self.statuses[-1].stamp_ns


@dataclass(frozen=True)
class TourScores:
    """What the scores of tours are made of: sums and lists, which add up over tours.

    Attributes:
        tours: How many.
        finished: How many of them to the end, with the group.
        times_s: What those took [s], shape (finished,).
        way_m: How far each group came along its way [m], shape (tours,).
        people: How many people were guided.
        lost: How many of them were lost.
        given_up: How many the guide went on without, in the end.
        seen: Share of the time each person is seen, shape (people,).
        detected: ... is detected, likewise.
        formation_m: Distances of robots from their posts [m].
        least_m: Least distance of a robot to a person in each tour [m], shape (tours,).
        contacts: How often a robot and a person touched, ...
        own_contacts: ... by the robot's own motion.
        bystander_m: Least distance of a robot to a bystander in each tour with one [m], shape (k,).
        near_s: How long each robot was within `PERSONAL_M` of each person, added up [s].
        own_motion_s: How long within `OWN_MOTION_M` and nearing by its own motion, likewise [s].
        own_longest_s: ... without a gap, the longest time of each tour [s], shape (tours,).
        stood_off_s: How long robots stood off, added up [s].
        leaders: How often the leader changed.
        path_m: What each robot drove [m].
        stragglers: Episodes.
        back: How many of them ended with the straggler back.
        behind_s: How long the episodes last, added up [s].
        alone_s: How long stragglers were alone, added up [s].
        spread_m: How far people are from the middle of all, a root mean square over people and
            time, of each tour [m], shape (tours,).
    """

    tours: int = 0
    finished: int = 0
    times_s: Float = field(default_factory=nothing)
    way_m: Float = field(default_factory=nothing)
    people: int = 0
    lost: int = 0
    given_up: int = 0
    seen: Float = field(default_factory=nothing)
    detected: Float = field(default_factory=nothing)
    formation_m: Float = field(default_factory=nothing)
    least_m: Float = field(default_factory=nothing)
    contacts: int = 0
    own_contacts: int = 0
    bystander_m: Float = field(default_factory=nothing)
    near_s: float = 0.0
    own_motion_s: float = 0.0
    own_longest_s: Float = field(default_factory=nothing)
    stood_off_s: float = 0.0
    leaders: int = 0
    path_m: Float = field(default_factory=nothing)
    stragglers: int = 0
    back: int = 0
    behind_s: float = 0.0
    alone_s: float = 0.0
    spread_m: Float = field(default_factory=nothing)

    def __add__(self, other: TourScores) -> TourScores:
        """Those of several tours."""
        return TourScores(**sums_of(self, other))

    def report(self) -> dict[str, Any]:
        """`tour` as in the JSON of `mrs evaluate`; what is undefined is None."""
        return {
            "tours": self.tours,
            "finished": self.finished,
            "time_s": _mean(self.times_s),
            "way_m": _mean(self.way_m),
            "people": self.people,
            "lost": self.lost,
            "given_up": self.given_up,
            "seen": {
                "mean": _mean(self.seen),
                "min": _least(self.seen),
                "detected": _mean(self.detected),
            },
            "formation_m": {
                "median": percentile(self.formation_m, 50),
                "p95": percentile(self.formation_m, 95),
            },
            "distance_m": _least(self.least_m),
            "bystander_m": _least(self.bystander_m),
            "contacts": self.contacts,
            "contacts_by_own_motion": self.own_contacts,
            "within_0_50_m_s": self.near_s,
            "within_0_45_m_by_own_motion_s": self.own_motion_s,
            "longest_by_own_motion_s": float(self.own_longest_s.max(initial=0.0)),
            "stood_off_s": self.stood_off_s,
            "leaders": self.leaders,
            "path_m": _mean(self.path_m),
            "stragglers": {
                "true": self.stragglers,
                "back": ratio(self.back, self.stragglers),
                "behind_s": self.behind_s,
                "alone_s": self.alone_s,
            },
            "spread_m": _mean(self.spread_m),
        }


def score_tour(record: TourRecord) -> TourScores:
    """Scores a tour.

    Args:
        record: How it went.
    """
    span = record.span_ns()
    if span is None:
        return TourScores(tours=1, way_m=np.zeros(1))
    begin_ns, end_ns = span
    last = max((s for s in record.statuses if s.stamp_ns <= end_ns), key=lambda s: s.stamp_ns)
    everybody = _during(record.truth, begin_ns, end_ns)
    truth = _of_group(everybody)
    end = _end_of(record, end_ns) if last.state == State.FINISHED else None
    finished = last.state == State.FINISHED and _has_come(truth, end)
    there = np.isfinite(truth.positions).all(axis=2)
    return dataclasses.replace(
        _driven(record, everybody, begin_ns, end_ns),
        tours=1,
        finished=int(finished),
        times_s=np.array([(end_ns - begin_ns) / 1e9] if finished else []),
        way_m=np.array([last.way_m]),
        people=int(there.any(axis=0).sum()),
        lost=int(_lost(truth, end).sum()),
        given_up=len(last.lost),
        seen=seen_shares(truth, [estimate.as_in_view() for estimate in record.estimates]),
        detected=seen_shares(truth, [_detected(estimate) for estimate in record.estimates]),
        formation_m=_formation_errors(record, begin_ns, end_ns),
        spread_m=_spread(truth),
    )


def seen_shares(truth: Truth, estimates: Sequence[Estimate]) -> Float:
    """Share of the time that each person is seen, of those who are there, shape (people,)."""
    everybody = dataclasses.replace(truth, visible=np.ones_like(truth.visible))
    frames = score(everybody, estimates, distance=SEEN_M)
    count = truth.positions.shape[1]
    found = np.concatenate([np.empty(0, np.intp), *(frame.pairs[:, 1] for frame in frames)])
    required = np.zeros(count)
    for frame in frames:
        required += frame.required
    there = required > 0
    return np.asarray(np.bincount(found, minlength=count)[there] / required[there])


def _during(truth: Truth, begin_ns: int, end_ns: int) -> Truth:
    """The truth of a time; everybody is of one group if it says nothing of groups."""
    rows = (truth.stamps_ns >= begin_ns) & (truth.stamps_ns <= end_ns)
    positions = truth.positions[rows]
    together = np.asarray(np.isfinite(positions).all(axis=2), dtype=np.intp)
    groups = together if truth.groups is None else truth.groups[rows]
    return Truth(truth.stamps_ns[rows], positions, truth.visible[rows], groups)


def _members(truth: Truth) -> Bool:
    """Who is of a group at some time, shape (m,)."""
    assert truth.groups is not None
    return np.asarray((truth.groups > 0).any(axis=0))


def _spread(truth: Truth) -> Float:
    """The root mean square of the distances of people from their middle [m], shape (1,)."""
    off = truth.positions - np.nanmedian(truth.positions, axis=1, keepdims=True)
    return np.sqrt(np.nanmean((off**2).sum(axis=2), keepdims=True).ravel())


def _of_group(truth: Truth) -> Truth:
    """The truth without bystanders."""
    assert truth.groups is not None
    keep = _members(truth)
    columns = (truth.positions[:, keep], truth.visible[:, keep], truth.groups[:, keep])
    return Truth(truth.stamps_ns, *columns)


def _detected(estimate: Estimate) -> Estimate:
    """Without those who are only predicted."""
    return estimate.only(~estimate.coasting)


def _end_of(record: TourRecord, end_ns: int) -> Float | None:
    """The end of the way [m], shape (2,); None: no leader had a post."""
    until = [status for status in record.statuses if status.stamp_ns <= end_ns]
    way = leaders_way(until)
    return way[-1] if len(way) else None


def _has_come(truth: Truth, end: Float | None) -> bool:
    """Whether the middle of the people has come to the end of the way, where that is known."""
    if end is None or not len(truth):
        return True
    last = truth.positions[-1]
    there = last[np.isfinite(last[:, 0])]
    if not len(there):
        return True
    middle = np.median(there, axis=0)
    return bool(np.linalg.norm(middle - end) <= END_M)


def _lost(truth: Truth, end: Float | None) -> Bool:
    """Who of the people is lost at the end, shape (m,).

    Args:
        truth: Of the tour.
        end: Where everybody should be [m], shape (2,); None: where the others are.
    """
    there = np.asarray(np.isfinite(truth.positions).all(axis=2).any(axis=0))
    if not there.any():
        return there
    last = truth.positions[-1]
    middle = np.median(last[np.isfinite(last).all(axis=1)], axis=0)
    here = np.linalg.norm(last - middle, axis=1) <= LOST_M
    if end is not None:
        here &= np.linalg.norm(last - end, axis=1) <= LEFT_M
    return np.asarray(there & ~here)


def leaders_way(statuses: Sequence[Guidance]) -> Float:
    """Posts of leaders, one after the other [m], shape (n, 2)."""
    posts = [post for status in statuses for post in status.posts.values()]
    return np.array([post.xy for post in posts if post.role == Role.LEADER]).reshape(-1, 2)


def off_post(status: Guidance, robot: str, xy: Float, way: Float) -> float:
    """How far a robot is from where it should be [m].

    Args:
        status: What the guide says then.
        robot: Its name.
        xy: Where it is [m], shape (2,).
        way: See `leaders_way`; of a leader that drives, the post says only where to.
    """
    post = status.posts[robot]
    if post.role == Role.LEADER and status.speed > 0.0:
        return float(np.linalg.norm(way - xy, axis=1).min())
    return float(np.linalg.norm(post.xy - xy))


def _formation_errors(record: TourRecord, begin_ns: int, end_ns: int) -> Float:
    """Distances of robots from where they should be, where both are known [m]."""
    during = [one for one in record.statuses if begin_ns <= one.stamp_ns <= end_ns]
    way = leaders_way(during)
    errors = []
    for name, track in record.robots.items():
        posted = [status for status in during if name in status.posts]
        stamps = np.array([status.stamp_ns for status in posted], dtype=np.int64)
        places = track.at(stamps)[:, :2]
        errors += [
            off_post(status, name, xy, way) for status, xy in zip(posted, places, strict=True)
        ]
    every = np.array(errors)
    return np.asarray(every[np.isfinite(every)])


def _driven(record: TourRecord, truth: Truth, begin_ns: int, end_ns: int) -> TourScores:
    """What robots drove, how near they came to people, and who was left alone."""
    stamps = np.arange(begin_ns, end_ns + 1, STEP_NS, dtype=np.int64)
    step_s = STEP_NS / 1e9
    people, members = people_at(truth, stamps), _members(truth)
    nearest = np.full(people.shape[:2], np.inf)
    near_s = own_motion_s = own_longest_s = stood_off_s = 0.0
    contacts = own_contacts = 0
    paths = []
    for name, track in record.robots.items():
        xy = track.at(stamps)[:, :2]
        ahead, behind = (track.at(stamps + sign * _HALF_NS)[:, :2] for sign in (1, -1))
        velocity = np.nan_to_num(ahead - behind) / (2 * _HALF_NS / 1e9)
        off = people - xy[:, np.newaxis]
        away = np.linalg.norm(off, axis=2)
        towards = (off * velocity[:, np.newaxis]).sum(axis=2) / np.maximum(away, 1e-9)
        near_s += float((away < PERSONAL_M).sum()) * step_s
        nearing = (away < OWN_MOTION_M) & (towards > TOWARDS_MPS)
        own_motion_s += float(nearing.sum()) * step_s
        own_longest_s = max(own_longest_s, step_s * max(map(len, _runs(nearing)), default=0))
        touches = _runs(away <= TOUCH_M)
        contacts += len(touches)
        own_contacts += sum(bool((towards.T.ravel()[rows] > TOWARDS_MPS).any()) for rows in touches)
        beside = (away <= BESIDE_M).any(axis=1)
        stood_off_s += float((_are_held_up(record, name, stamps, xy) & beside).sum()) * step_s
        nearest = np.fmin(nearest, away)
        paths.append(float(np.nansum(np.linalg.norm(np.diff(xy, axis=0), axis=1))))
    behind_all = episodes(truth, config=cfg.Groups())
    leaders = _leaders(record, begin_ns, end_ns)
    alone = np.zeros(people.shape[:2], dtype=bool)
    for one in behind_all:
        during = (stamps >= one.begin_ns) & (stamps <= one.end_ns)
        alone[during, one.person] = True
    known, others = (of[np.isfinite(of)] for of in (nearest, nearest[:, ~members]))
    return TourScores(
        least_m=np.array([known.min()] if len(known) else []),
        contacts=contacts,
        own_contacts=own_contacts,
        bystander_m=np.array([others.min()] if len(others) else []),
        near_s=near_s,
        own_motion_s=own_motion_s,
        own_longest_s=np.array([own_longest_s]),
        stood_off_s=stood_off_s,
        leaders=sum(one != other for one, other in itertools.pairwise(leaders)),
        path_m=np.array(paths),
        stragglers=len(behind_all),
        back=sum(one.end_ns < int(truth.stamps_ns[-1]) for one in behind_all),
        behind_s=sum(one.end_ns - one.begin_ns for one in behind_all) / 1e9,
        alone_s=float((alone & (nearest > BESIDE_M)).sum()) * step_s,
    )


def _runs(values: Bool) -> list[NDArray[np.intp]]:
    """Each run of true values in a column: its rows in the columns, one after the other.

    Args:
        values: Shape (n, m).
    """
    padded = np.pad(values, ((0, 1), (0, 0))).T.ravel()
    rows = np.flatnonzero(padded)
    parts = np.split(rows, np.flatnonzero(np.diff(rows) > 1) + 1)
    column = len(values) + 1
    return [part - part[0] // column for part in parts if len(part)]


def _are_held_up(record: TourRecord, name: str, stamps_ns: NDArray[np.int64], xy: Float) -> Bool:
    """Whether a robot does not get on, although its post is elsewhere, shape (n,)."""
    posted = [status for status in record.statuses if name in status.posts]
    if not posted:
        return np.zeros(len(xy), dtype=bool)
    given = np.array([status.stamp_ns for status in posted], dtype=np.int64)
    row = np.clip(np.searchsorted(given, stamps_ns, side="right") - 1, 0, None)
    posts = np.array([status.posts[name].xy for status in posted])[row]
    before = np.clip(np.arange(len(xy)) - STANDS_NS // STEP_NS, 0, None)
    moved = np.linalg.norm(xy - xy[before], axis=1)
    away = np.linalg.norm(posts - xy, axis=1) > AWAY_M
    long_enough = np.arange(len(xy)) >= STANDS_NS // STEP_NS
    return np.asarray(long_enough & (moved < STANDS_M) & away & away[before])


def _leaders(record: TourRecord, begin_ns: int, end_ns: int) -> list[str]:
    """Who leads, status by status of a tour."""
    return [
        name
        for status in record.statuses
        if begin_ns <= status.stamp_ns <= end_ns
        for name, post in status.posts.items()
        if post.role == Role.LEADER
    ]


def people_at(truth: Truth, stamps_ns: NDArray[np.int64]) -> Float:
    """Where people are at times, linear between two messages [m], shape (n, m, 2).

    NaN where they are not there in one of the two, and before the first and after the last one.

    Args:
        truth: The truth.
        stamps_ns: Times [ns], int64, shape (n,).
    """
    count = truth.positions.shape[1]
    found = np.full((len(stamps_ns), count, 2), np.nan)
    if not len(truth):
        return found
    start = truth.stamps_ns[0]
    at, given = (1e-9 * (stamps - start) for stamps in (stamps_ns, truth.stamps_ns))
    for person in range(count):
        for axis in range(2):
            xy = truth.positions[:, person, axis]
            found[:, person, axis] = np.interp(at, given, xy, np.nan, np.nan)
    return found


def _mean(values: Float) -> float | None:
    return float(values.mean()) if len(values) else None


def _least(values: Float) -> float | None:
    return float(values.min()) if len(values) else None

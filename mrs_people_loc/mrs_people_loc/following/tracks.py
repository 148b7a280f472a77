"""Tracking: the identity and the velocity of each person, from interval to interval.

Each person is a Kalman filter of place and velocity (constant velocity, driven by white noise of
acceleration; Bar-Shalom, Li & Kirubarajan, Estimation with Applications to Tracking and Navigation,
2001, section 6.2), which takes the detections of the planner with their measured covariance.
Detections are assigned to tracks by the least sum of squared Mahalanobis distances within a gate.

A detection brings log-odds of being a person. A track's evidence is their recent mean: views of one
thing resemble each other, so that a lamp seen ten times is no surer a person than a lamp seen once,
and the sum would say so. A track becomes a person when it has enough evidence, coasts while it is
not seen, and ends when the evidence or the time is used up. Ended tracks are remembered for a while
and may come back under the same id.

Time is an argument. Where it jumps back by more than `clocks.RESET_NS`, all tracks are new, and ids
go on.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple, TypeAlias

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Bool, Float, Int, StructOfArrays
from mrs_people_loc.clocks import RESET_NS
from mrs_people_loc.following.negative_evidence import not_found
from mrs_people_loc.geometry import squared_mahalanobis
from mrs_people_loc.neighbours import connected, pairs_between
from mrs_people_loc.people import NOBODY, Expected, Person
from mrs_people_loc.uncertainty import bounded


@dataclass(frozen=True)
class TracksTuning:
    """Constants of tracking, beside `tracking.*` in the configuration; chosen.

    Attributes:
        max_score: Upper bound of a detection's log-odds.
        max_height_cost: Upper bound of the cost of different heights, a squared Mahalanobis
            distance: two standard deviations.
        max_delay_s: Upper bound of a detection's age [s].
        max_variance: Upper bound of the variance of a place [m^2] and a velocity [m^2/s^2].
        published: Standard deviations of published positions over those of the filter; with `lead`,
            90 to 98 % of the true positions lie in 95 % ellipses of the training suite, of the
            suite with people rendered from textured meshes of other projects, and of recordings of
            real people.
        lead: Standard deviation along the velocity [m] that is added to published positions: of
            a person who walks, the head leads the trunk. It is proportional to the speed up to ...
        lead_speed: ... this speed [m/s].
        travelled: A person farther than this from where they were first seen [m] ...
        travelled_sigmas: ... and than so many standard deviations has walked there.
        lost_reach: A lost person reappears within this of where they were last seen [m], and of
            what they may have walked.
        adapt_s: Time in which a hidden member of a group takes up the velocity of those around [s].
        company: Standard deviation of the distance over which these count [m] ...
        company_reach: ... up to this one [m].
        found_s: Somebody in plain view is found after this time, in the mean [s]. Views that follow
            one another resemble each other, so that it is longer than an interval.
        least_missed: Least probability of being missed in plain view in an interval of any length.
    """

    max_score: float = 8.0
    max_height_cost: float = 4.0
    max_delay_s: float = 1.0
    max_variance: float = 25.0
    lost_reach: float = 0.5
    published: float = 0.87
    lead: float = 0.05
    lead_speed: float = 0.4
    travelled: float = 0.4
    travelled_sigmas: float = 3.0
    adapt_s: float = 0.5
    company: float = 1.0
    company_reach: float = 2.5
    found_s: float = 1.0
    least_missed: float = 0.05


TRACKS_TUNING = TracksTuning()

#: Tells whether robots would have people in plain view: takes places [m], shape (k, 2), those of
#: all people, shape (n, 2), and who of these would be at each, shape (k,); returns shape (k,).
Sees: TypeAlias = Callable[[Float, Float, Int], Bool]


def everybody(places: Float, _people: Float, _own: Int) -> Bool:
    """A `Sees` where nobody is hidden."""
    return np.ones(len(places), dtype=bool)


#: Moves places that nobody can be at, shape (k, 2) [m], to the nearest where somebody can be.
Off: TypeAlias = Callable[[Float], Float]


def anywhere(places: Float) -> Float:
    """An `Off` without walls."""
    return places


@dataclass
class _Tracks(StructOfArrays):
    """Tracks, a struct of arrays of one length (n,).

    Attributes:
        id: From 1; 0: no person yet.
        state: Place [m] and velocity [m/s], shape (n, 4).
        covariance: Of the state, shape (n, 4, 4).
        noise: Recent mean covariance of its detections [m^2], shape (n, 2, 2).
        evidence: Recent mean of its log-odds of being a person.
        height: Recent mean height [m].
        age_s: Since it was first seen [s].
        seen: Whether it is seen in this interval.
        unseen_s: Since it was last seen [s].
        missed_s: Since then, for how long nothing explains why it is not seen [s]: each interval
            counts by the share of its distribution that was in plain view.
        seen_s: For how long it was seen, in total [s].
        origin: Where it was first seen [m], shape (n, 2).
        origin_covariance: Of that place [m^2], shape (n, 2, 2).
        travelled: Whether it has been elsewhere since.
        last: Its last detection.
    """

    id: Int
    state: Float
    covariance: Float
    noise: Float
    evidence: Float
    height: Float
    age_s: Float
    seen: Bool
    unseen_s: Float
    missed_s: Float
    seen_s: Float
    origin: Float
    origin_covariance: Float
    travelled: Bool
    last: NDArray[np.object_]

    def move(self, rows: Int | slice, motion: _Motion, velocity: Float | float = 0.0) -> None:
        """The Kalman filter's prediction of some tracks.

        Args:
            rows: Which.
            motion: How people move.
            velocity: What their velocity tends to, shape (k, 2) [m/s].
        """
        move, noise, shift = motion
        state = self.state[rows] @ move.T
        state[:, :2] += shift[0] * velocity
        state[:, 2:] += shift[1] * velocity
        self.state[rows] = state
        self.covariance[rows] = move @ self.covariance[rows] @ move.T + noise

    def bound(self, max_variance: float) -> None:
        """Bounds the variances, by one factor for the whole matrix: it stays a covariance."""
        largest = self.covariance.diagonal(axis1=1, axis2=2).max(axis=1, initial=0.0)
        factor = np.minimum(1.0, max_variance / np.maximum(largest, 1e-12))
        self.covariance *= factor[:, np.newaxis, np.newaxis]


class _Motion(NamedTuple):
    """How the state of a person changes in a time.

    Attributes:
        move: Linear part, shape (4, 4).
        noise: Covariance that is added, shape (4, 4).
        shift: By how much the place [s] and the velocity change per velocity that they tend to.
    """

    move: Float
    noise: Float
    shift: tuple[float, float]

    @classmethod
    def alone(cls, t: float, acceleration: float) -> _Motion:
        """Constant velocity, and white noise of acceleration."""
        return cls._of(t, t, 1.0, acceleration**2 * np.array([t**3 / 3.0, t**2 / 2.0, t]))

    @classmethod
    def in_company(cls, t: float, acceleration: float, adapt_s: float) -> _Motion:
        """An Ornstein-Uhlenbeck velocity: it tends to that of others, with the same noise."""
        kept = math.exp(-t / adapt_s)
        reach = adapt_s * (1.0 - kept)
        squared = adapt_s * (1.0 - kept**2) / 2.0
        noise = np.array([adapt_s**2 * (t - 2.0 * reach + squared), reach**2 / 2.0, squared])
        return cls._of(t, reach, kept, acceleration**2 * noise)

    @classmethod
    def _of(cls, t: float, reach: float, kept: float, noise: Float) -> _Motion:
        """From the noise of place, of place with velocity, and of velocity."""
        place, both, velocity = noise.tolist()
        move = [
            [1.0, 0.0, reach, 0.0],
            [0.0, 1.0, 0.0, reach],
            [0.0, 0.0, kept, 0.0],
            [0.0, 0.0, 0.0, kept],
        ]
        added = [
            [place, 0.0, both, 0.0],
            [0.0, place, 0.0, both],
            [both, 0.0, velocity, 0.0],
            [0.0, both, 0.0, velocity],
        ]
        return cls(np.array(move), np.array(added), (t - reach, 1.0 - kept))


@dataclass(frozen=True)
class _Found(StructOfArrays):
    """Detections of an interval, a struct of arrays of one length (n,)."""

    persons: NDArray[np.object_]
    xy: Float
    covariance: Float
    score: Float
    delay_s: Float
    height: Float

    @classmethod
    def from_persons(cls, persons: Sequence[Person], time_ns: int, tuning: TracksTuning) -> _Found:
        each = np.empty(len(persons), dtype=object)
        each[:] = persons
        return cls(
            persons=each,
            xy=np.array([p.position for p in persons]).reshape(-1, 2),
            covariance=bounded(np.array([p.covariance for p in persons]).reshape(-1, 2, 2)),
            score=np.minimum([p.score for p in persons], tuning.max_score).reshape(-1),
            delay_s=np.clip(
                [(time_ns - p.stamp_ns) / 1e9 for p in persons], 0.0, tuning.max_delay_s
            ),
            height=np.array([p.height for p in persons]),
        )


class Tracker:
    """Follows people over time.

    Args:
        config: Its parameters; may be replaced at any time.
        tuning: Its constants.

    Attributes:
        config: Likewise.
        jumps_back: How often the time has jumped back, by more than `RESET_NS`.
        turned_away: How often a new detection was not followed because there were too many tracks.
        group_of: By id, the group of each of its members, as of the interval before.
    """

    def __init__(self, config: cfg.Tracking, tuning: TracksTuning = TRACKS_TUNING) -> None:
        self.config = config
        self.tuning = tuning
        self.jumps_back = 0
        self.turned_away = 0
        self.group_of: Mapping[int, int] = {}
        self._time_ns: int | None = None
        self._followed_s = 0.0
        self._next_id = 1
        self._tracks = _begun(_Found.from_persons((), 0, tuning), config)
        self._lost = self._tracks

    def reset(self) -> None:
        """Forgets all tracks: the time jumped back. Ids go on, so that none means two people."""
        self.jumps_back += 1
        self._time_ns = None
        self._followed_s = 0.0
        nobody = _Found.from_persons((), 0, self.tuning)
        self._tracks = self._lost = _begun(nobody, self.config)

    def expect(self, time_ns: int) -> Expected:
        """Where the followed people will be at a time [ns]; does not change the tracker."""
        if self._is_another(time_ns):
            return NOBODY
        people = self._tracks.select(self._tracks.id > 0)
        if not len(people):
            return NOBODY
        self._predict(people, self._since(time_ns))
        xy, velocity = people.state[:, :2], people.state[:, 2:]
        places = xy - self._late(time_ns) * velocity
        return Expected(places, people.covariance[:, :2, :2], people.id, people.travelled)

    def step(
        self,
        persons: Sequence[Person],
        time_ns: int,
        sees: Sees = everybody,
        off_walls: Off = anywhere,
    ) -> tuple[Person, ...]:
        """Takes the detections of an interval.

        Args:
            persons: The detections, with log-odds and stamps.
            time_ns: Time of the interval [ns]; a little older than the last one: scans that came
                late by themselves; older by more than `RESET_NS`: all tracks are new.
            sees: Tells who is in plain view of the robots of this interval.
            off_walls: Moves those who walk unseen off walls.

        Returns:
            All people who are followed, seen or not, by id.
        """
        if self._is_another(time_ns):
            self.reset()
        dt_s, late_s = self._since(time_ns), self._late(time_ns)
        if self._time_ns is None or not late_s:
            self._time_ns = time_ns
        self._followed_s += dt_s
        self._predict(self._tracks, dt_s)
        self._predict(self._lost, dt_s)
        self._associate(_Found.from_persons(persons, self._time_ns, self.tuning), dt_s, sees)
        tracks = self._tracks
        walks = np.flatnonzero((tracks.id > 0) & ~tracks.seen & tracks.travelled)
        if len(walks):
            tracks.state[walks, :2] = off_walls(tracks.state[walks, :2])
        return self._persons(late_s)

    def _predict(self, tracks: _Tracks, dt_s: float) -> None:
        if dt_s <= 0 or not len(tracks):
            return
        rows, velocity = self._company(tracks)
        acceleration, tuning = self.config.acceleration, self.tuning
        alone: Int | slice = slice(None)
        if len(rows):
            alone = np.delete(np.arange(len(tracks)), rows)
            tracks.move(rows, _Motion.in_company(dt_s, acceleration, tuning.adapt_s), velocity)
        tracks.move(alone, _Motion.alone(dt_s, acceleration))
        tracks.bound(tuning.max_variance)
        tracks.age_s = tracks.age_s + dt_s
        tracks.unseen_s = tracks.unseen_s + dt_s

    def _company(self, tracks: _Tracks) -> tuple[Int, Float]:
        """Unseen people who walk with others of their group.

        Returns:
            Rows of them; and the mean velocity of the others around, shape (k, 2) [m/s].
        """
        rows = np.flatnonzero(~tracks.seen & tracks.travelled)
        if len(rows):
            group = self._groups(tracks.id[rows])
            rows, group = rows[group > 0], group[group > 0]
        if not len(rows):
            return rows, np.empty((0, 2))
        tuning, seen = self.tuning, self._tracks.seen
        others, of_others = self._tracks.state[seen], self._groups(self._tracks.id[seen])
        away = np.linalg.norm(tracks.state[rows, np.newaxis, :2] - others[:, :2], axis=2)
        weight = np.exp(-0.5 * (away / tuning.company) ** 2)
        weight *= (away <= tuning.company_reach) & (group[:, np.newaxis] == of_others)
        total = weight.sum(axis=1)
        rows, weight, total = rows[total > 0.0], weight[total > 0.0], total[total > 0.0]
        return rows, weight @ others[:, 2:] / total[:, np.newaxis]

    def _groups(self, ids: Int) -> Int:
        """The group of each track; 0: none."""
        return np.array([self.group_of.get(who, 0) for who in ids.tolist()], dtype=np.intp)

    def _since(self, time_ns: int) -> float:
        return 0.0 if self._time_ns is None else max(0.0, (time_ns - self._time_ns) / 1e9)

    def _late(self, time_ns: int) -> float:
        """How much a time is before the last one [s]; 0 if it is not."""
        return 0.0 if self._time_ns is None else max(0.0, (self._time_ns - time_ns) / 1e9)

    def _is_another(self, time_ns: int) -> bool:
        """Whether time has jumped back."""
        return self._time_ns is not None and self._time_ns - time_ns > RESET_NS

    def _associate(self, found: _Found, dt_s: float, sees: Sees) -> None:
        """Updates tracks with their detections, ends old ones and begins new ones."""
        config, tracks = self.config, self._tracks
        tracks.seen[:] = False
        is_free = np.ones(len(found), dtype=bool)
        for confirmed in (True, False):  # people first, then tracks that may become some
            rows, free = np.flatnonzero((tracks.id > 0) == confirmed), np.flatnonzero(is_free)
            one, other = _assign(tracks, rows, found, free, config, self.tuning)
            _update(tracks, one, found, other, config, self.tuning, dt_s)
            is_free[other] = False
        ended = self._ended(dt_s, self._not_found(dt_s, sees))
        if ended.any():
            gone = tracks.select(ended & (tracks.id > 0))
            self._lost = _Tracks.joined([self._lost, gone])
            tracks = tracks.select(~ended)
        self._forget()

        free = np.flatnonzero(is_free & (found.score >= config.doubt_score))
        room = max(0, config.max_tracks - len(tracks))
        if len(free) > room:
            free = free[np.argsort(-found.score[free], kind="stable")]
            self.turned_away += len(free) - room
        if len(free):
            tracks = _Tracks.joined([tracks, _begun(found.select(free[:room]), config)])
        self._tracks = tracks
        new = np.flatnonzero(tracks.id == 0)
        if len(new):
            self._confirm(new)

    def _forget(self) -> None:
        """Forgets lost tracks: after a while, and those unseen for longest where there are many."""
        config, lost = self.config, self._lost
        if not len(lost):
            return
        lost = lost.select(lost.unseen_s <= np.minimum(config.memory, lost.seen_s))
        self._lost = lost.select(np.argsort(lost.unseen_s, kind="stable")[: config.max_tracks])

    def _not_found(self, dt_s: float, sees: Sees) -> Float:
        """Updates unseen people who walk with their group: they are rather where nobody looks.

        Returns:
            Of each track, the share of its distribution that was in plain view; 1 for all others.
        """
        tracks, tuning = self._tracks, self.tuning
        in_view = np.ones(len(tracks))
        rows, _ = self._company(tracks)
        if len(rows):
            is_person = tracks.id > 0
            people = tracks.state[is_person, :2]
            own = np.cumsum(is_person)[rows] - 1

            def of(places: Float) -> Bool:
                each = np.repeat(own, places.shape[1])
                return sees(places.reshape(-1, 2), people, each).reshape(places.shape[:2])

            missed = max(math.exp(-dt_s / tuning.found_s), tuning.least_missed)
            tracks.state[rows], tracks.covariance[rows], in_view[rows] = not_found(
                tracks.state[rows], tracks.covariance[rows], missed, of
            )
        return in_view

    def _ended(self, dt_s: float, in_view: Float) -> Bool:
        """Which tracks end: unseen for too long, or no longer likely to be people."""
        config, tracks = self.config, self._tracks
        # No track coasts for longer than this share of the time for which it was seen.
        most_s = config.coast_share * tracks.seen_s
        # Too fast for a person: the detections were of several people, or of nobody.
        most_s[np.hypot(*tracks.state[:, 2:].T) > config.max_speed] = 0.0
        coast_s = np.minimum(config.coast_time, most_s)
        hidden_s = np.maximum(coast_s, np.minimum(config.hidden_time, most_s))
        tracks.missed_s = np.where(tracks.seen, 0.0, tracks.missed_s + dt_s * in_view)
        is_person = tracks.id > 0
        too_long = (tracks.missed_s > coast_s) | (tracks.unseen_s > hidden_s)
        too_long = np.where(is_person, too_long, tracks.unseen_s > config.doubt_time)
        unlikely = is_person & (tracks.evidence < config.keep_score)
        return np.asarray(~tracks.seen & too_long | unlikely)

    def _confirm(self, rows: Int) -> None:
        """Gives ids to tracks that are people by now: a new one, or that of a lost track."""
        config, tracks = self.config, self._tracks
        old = tracks.age_s[rows] >= config.birth_time
        # In the beginning all people are new; later on, hardly any appear out of nowhere.
        old |= self._followed_s < config.start_time
        least = np.where(old, min(config.birth_score, config.sure_score), config.sure_score)
        rows = rows[(tracks.evidence[rows] >= least) & tracks.seen[rows]]
        if not len(rows):
            return
        # Who is hidden may have come out elsewhere.
        hidden = (tracks.id > 0) & ~tracks.seen & (tracks.unseen_s > config.coast_time)
        lost = _Tracks.joined([self._lost, tracks.select(hidden)])
        again: list[int] = []
        for row in rows.tolist():
            found = self._match_lost(row, lost)
            if found is None:
                tracks.id[row] = self._next_id
                self._next_id += 1
                continue
            tracks.id[row] = lost.id[found]
            tracks.age_s[row] = lost.age_s[found]
            tracks.seen_s[row] += lost.seen_s[found]
            tracks.travelled[row] |= lost.travelled[found]
            again.append(int(lost.id[found]))
            lost = lost.select(np.arange(len(lost)) != found)
        self._lost = self._lost.select(~np.isin(self._lost.id, again))
        self._tracks = tracks.select(~(hidden & np.isin(tracks.id, again)))

    def _match_lost(self, row: int, lost: _Tracks) -> int | None:
        """Which lost track a new one continues; None: none."""
        tracks = self._tracks
        if not len(lost):
            return None
        here, velocity = tracks.state[row, :2], lost.state[:, 2:]
        total = lost.covariance[:, :2, :2] + tracks.covariance[row, :2, :2]
        squared = squared_mahalanobis(here - lost.state[:, :2], total)
        seen_at = lost.state[:, :2] - lost.unseen_s[:, np.newaxis] * velocity
        possible = squared <= self.config.gate**2
        reach = self.tuning.lost_reach + self.config.max_speed * lost.unseen_s
        possible &= np.hypot(*(here - seen_at).T) <= reach
        if not possible.any():
            return None
        cost = (
            squared
            + np.log(_determinant(total))
            + _height_cost(tracks.height[row], lost.height, self.config, self.tuning)
        )
        return int(np.where(possible, cost, np.inf).argmin())

    def _persons(self, late_s: float) -> tuple[Person, ...]:
        """All people as they were so long before the tracker's time."""
        tracks = self._tracks
        rows = np.flatnonzero(tracks.id > 0)
        rows = rows[np.argsort(tracks.id[rows], kind="stable")]
        unsure_of = self._published(rows)
        places = tracks.state[rows, :2] - late_s * tracks.state[rows, 2:]
        velocities, unsure = tracks.state[rows, 2:], tracks.covariance[rows, 2:, 2:]
        hidden = ~tracks.seen & (tracks.unseen_s > self.config.in_view_time)
        columns = tracks.id, tracks.height, tracks.evidence, tracks.age_s, tracks.last, tracks.seen
        each = zip(*(column[rows].tolist() for column in (*columns, hidden)), strict=True)
        return tuple(
            Person(
                position=places[index],
                covariance=unsure_of[index],
                height=height,
                sigma=last.sigma,
                robots=last.robots if seen else (),
                label=last.label if seen else -1,
                score=score,
                stamp_ns=last.stamp_ns,
                id=number,
                velocity=velocities[index],
                velocity_covariance=unsure[index],
                age_s=age_s,
                coasting=not seen,
                seen_at=last.position if is_hidden else None,
            )
            for index, (number, height, score, age_s, last, seen, is_hidden) in enumerate(each)
        )

    def _published(self, rows: Int) -> Float:
        """Covariances of the positions of tracks, as they are published [m^2], shape (n, 2, 2)."""
        tracks, tuning = self._tracks, self.tuning
        # Errors of detections resemble each other from interval to interval: no mean removes them.
        lasting = self.config.lasting_share * tracks.noise[rows]
        velocity = tracks.state[rows, 2:]
        speed = np.maximum(np.hypot(*velocity.T), tuning.lead_speed)
        lead = tuning.lead * velocity / speed[:, np.newaxis]
        outer = lead[:, :, np.newaxis] * lead[:, np.newaxis]
        covariance = tuning.published**2 * (tracks.covariance[rows, :2, :2] + lasting) + outer
        return np.asarray(covariance)


def _begun(found: _Found, config: cfg.Tracking) -> _Tracks:
    """A new track of each detection."""
    count = len(found)
    covariance = np.zeros((count, 4, 4))
    covariance[:, :2, :2] = found.covariance
    covariance[:, (2, 3), (2, 3)] = config.any_velocity**2
    return _Tracks(
        id=np.zeros(count, dtype=np.intp),
        state=np.concatenate([found.xy, np.zeros((count, 2))], axis=1),
        covariance=covariance,
        noise=found.covariance.copy(),
        evidence=found.score.astype(np.float64),
        height=found.height.astype(np.float64),
        age_s=np.zeros(count),
        seen=np.ones(count, dtype=bool),
        unseen_s=np.zeros(count),
        missed_s=np.zeros(count),
        seen_s=np.zeros(count),
        origin=found.xy.copy(),
        origin_covariance=found.covariance.copy(),
        travelled=np.zeros(count, dtype=bool),
        last=found.persons,
    )


def _delayed(tracks: _Tracks, rows: Int, delay_s: Float) -> tuple[Float, Float]:
    """Where tracks were so long ago: places, shape (n, 2), and covariances, shape (n, 2, 2)."""
    state, p = tracks.state[rows], tracks.covariance[rows]
    d = delay_s[:, np.newaxis]
    d2 = d[:, :, np.newaxis]
    cross = p[:, :2, 2:]
    place = p[:, :2, :2] - d2 * (cross + cross.transpose(0, 2, 1)) + d2**2 * p[:, 2:, 2:]
    return state[:, :2] - d * state[:, 2:], place


def _assign(
    tracks: _Tracks,
    rows: Int,
    found: _Found,
    free: Int,
    config: cfg.Tracking,
    tuning: TracksTuning,
) -> tuple[Int, Int]:
    """Assigns detections to tracks: indices of tracks and detections, of one length."""
    if not len(rows) or not len(free):
        return np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp)
    reach = config.max_distance + config.max_speed * float(found.delay_s[free].max())
    row, column, _ = pairs_between(tracks.state[rows, :2], found.xy[free], reach)
    one, other = rows[row], free[column]
    places, covariances = _delayed(tracks, one, found.delay_s[other])
    measured = found.covariance[other]
    total = covariances + measured
    offset = found.xy[other] - places
    squared = squared_mahalanobis(offset, total)
    away = np.hypot(*offset.T)
    squared = np.where(away <= config.body, np.minimum(squared, config.gate**2), squared)
    # With the determinant of the likelihood, relative to that of the detection: a track that has
    # long been unseen may be anywhere, and must not take a detection from a surer one.
    cost = squared + np.log(_determinant(total) / _determinant(measured))
    cost += _height_cost(tracks.height[one], found.height[other], config, tuning)
    gain = 2.0 * config.gate**2 - cost  # over leaving both unassigned
    near = (squared <= config.gate**2) & (away <= config.max_distance)
    possible = np.flatnonzero(near & (gain > 0))
    best = possible[_best(row[possible], column[possible], gain[possible], len(rows), len(free))]
    return one[best], other[best]


def _best(row: Int, column: Int, gain: Float, rows: int, columns: int) -> Int:
    """Which pairs to take, each row and column at most once, so that the total gain is greatest.

    Connected components of the pairs are independent problems. Where the best pairs of all rows are
    in different columns, these are the solution.
    """
    order = np.argsort(gain)
    best = np.full(rows, -1)
    best[row[order]] = order  # the last one stays
    best = best[best >= 0]
    contested = np.bincount(column[best], minlength=columns)[column[best]] > 1
    if not contested.any():
        return best
    component = connected(row, rows + column, rows + columns)[row]
    open_ones = np.unique(component[best[contested]])
    taken = [best[~np.isin(component[best], open_ones)]]
    for number in open_ones.tolist():
        from scipy.optimize import linear_sum_assignment  # here: it takes long to load

        mine = np.flatnonzero(component == number)
        (_, i), (_, j) = (np.unique(of[mine], return_inverse=True) for of in (row, column))
        table = np.zeros((i.max() + 1, j.max() + 1))
        table[i, j] = gain[mine]
        chosen = np.zeros(table.shape, dtype=bool)
        chosen[linear_sum_assignment(table, maximize=True)] = True
        taken.append(mine[chosen[i, j]])
    return np.concatenate(taken)


def _update(
    tracks: _Tracks,
    rows: Int,
    found: _Found,
    index: Int,
    config: cfg.Tracking,
    tuning: TracksTuning,
    dt_s: float,
) -> None:
    """The Kalman filter's update of some tracks with their detections."""
    if not len(rows):
        return
    delay_s = found.delay_s[index]
    place, innovation = _delayed(tracks, rows, delay_s)
    p = tracks.covariance[rows]
    # H = [1, -delay]: a detection is where a person was when the robots looked at them.
    h_p = p[:, :2] - delay_s[:, np.newaxis, np.newaxis] * p[:, 2:]
    total = innovation + found.covariance[index]
    gain = np.linalg.solve(total, h_p).transpose(0, 2, 1)
    off = found.xy[index] - place
    tracks.state[rows] += (gain @ off[:, :, np.newaxis])[:, :, 0]
    updated = p - gain @ h_p
    tracks.covariance[rows] = 0.5 * (updated + updated.transpose(0, 2, 1))
    share = -math.expm1(-dt_s / config.evidence_time)
    tracks.noise[rows] += share * (found.covariance[index] - tracks.noise[rows])
    tracks.evidence[rows] += share * (found.score[index] - tracks.evidence[rows])
    tracks.height[rows] += share * (found.height[index] - tracks.height[rows])
    tracks.seen[rows] = True
    tracks.unseen_s[rows] = 0.0
    tracks.seen_s[rows] += dt_s
    tracks.last[rows] = found.persons[index]
    way = tracks.state[rows, :2] - tracks.origin[rows]
    unsure = tracks.covariance[rows, :2, :2] + tracks.origin_covariance[rows]
    away = np.hypot(*way.T) > tuning.travelled
    tracks.travelled[rows] |= away & (squared_mahalanobis(way, unsure) > tuning.travelled_sigmas**2)


def _height_cost(one: Float, other: Float, config: cfg.Tracking, tuning: TracksTuning) -> Float:
    squared = ((one - other) / config.height_sigma) ** 2
    return np.asarray(np.fmin(squared, tuning.max_height_cost))  # that of a NaN, too


def _determinant(matrices: Float) -> Float:
    return np.asarray(matrices[:, 0, 0] * matrices[:, 1, 1] - matrices[:, 0, 1] * matrices[:, 1, 0])

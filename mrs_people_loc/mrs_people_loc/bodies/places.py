"""Place memory: what stands in one place for long and never looks like a person is furniture.

One view cannot tell a dark chair from a person behind a desk, and more views of it say little more:
they resemble each other. What separates the two is the best view there has been. A place therefore
remembers for how long something has been seen there, T, and its best look b, the largest mean score
of `looks` consecutive intervals; bodies there lose

    min(static_score, gain * ln(1 + T / tau)) * clip(1 - b / sure, 0, 1)

of log-odds, so that a person who looked like one keeps their score however long they stand. Of what
has stood there since the robots first saw anything, and has not moved, the last factor is at least

    clip((T - soon_s) / (long_s - soon_s), 0, 1) * clip(1 - f / beyond_doubt, 0, 1)

where f is the largest median score of consecutive looks. T stays as it is while somebody stands
there who walked to the place. What a followed person adds to b and f is forgotten when they leave.
Time is an argument; where it jumps back by more than `clocks.RESET_NS`, all places are new.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Bool, Float, Int, StructOfArrays
from mrs_people_loc.bodies.joining import Joined
from mrs_people_loc.clocks import RESET_NS
from mrs_people_loc.neighbours import pairs_between
from mrs_people_loc.people import Expected
from mrs_people_loc.team.fusion import BodiesOnMap


@dataclass(frozen=True)
class PlacesTuning:
    """Constants of the place memory, beside `tracking.static_score` in the configuration.

    Chosen on the training suite and on public recordings of real rooms.

    Attributes:
        gain: Log-odds that are lost per unit of ln(1 + T / tau).
        tau: See above [s].
        sure: Score from which a look is that of a person.
        present: Share of the present look that counts if it is larger than b.
        max_look: Upper bound of a look's score: a single high one does not decide.
        looks: Of so many consecutive intervals is the mean, or the median.
        beyond_doubt: A median score from which on nothing is lost, however long nothing moves.
        soon_s: Less than that is no fault for this long [s], ...
        long_s: ... and quite one from here on [s], ...
        first_s: ... of what was seen within this after the first interval with bodies [s].
        reach: A body belongs to a place within this distance [m], ...
        reach_sigmas: ... plus so many standard deviations of its position, ...
        max_reach: ... but no more than this [m].
        max_gap_s: A place that is unseen for longer ages by no more than this [s].
        forget_s: A place that is unseen for longer is forgotten [s].
        max_places: Maximum number of places; the latest seen are kept.
    """

    gain: float = 2.5
    tau: float = 0.5
    sure: float = 1.5
    present: float = 0.5
    max_look: float = 2.25
    looks: int = 3
    beyond_doubt: float = 4.0
    soon_s: float = 5.0
    long_s: float = 20.0
    first_s: float = 2.0
    reach: float = 0.15
    reach_sigmas: float = 1.5
    max_reach: float = 0.45
    max_gap_s: float = 0.5
    forget_s: float = 30.0
    max_places: int = 1000


PLACES_TUNING = PlacesTuning()


@dataclass
class _Places(StructOfArrays):
    """Places, a struct of arrays of one length (n,).

    Attributes:
        xy: Mean position of what was seen there [m], shape (n, 2).
        count: In how many intervals.
        seen_s: For how long, without the time of people who came from elsewhere: T [s].
        last_ns: When it was last seen [ns].
        recent: The latest looks, the newest first; NaN: none yet, shape (n, looks).
        best: Largest mean of consecutive looks; -infinity: none yet.
        face: Largest median of them, likewise.
        first: Whether it was there when the robots first saw anything.
        visitor: Id of the followed person who stands there; 0: nobody.
        came: Whether they came from elsewhere.
        before: What was best and face when they came, shape (n, 2).
    """

    xy: Float
    count: Int
    seen_s: Float
    last_ns: NDArray[np.int64]
    recent: Float
    best: Float
    face: Float
    first: Bool
    visitor: Int
    came: Bool
    before: Float


class PlaceMemory:
    """Remembers places in the common frame.

    Args:
        tuning: Its constants.

    Attributes:
        tuning: Likewise.
    """

    def __init__(self, tuning: PlacesTuning = PLACES_TUNING) -> None:
        self.tuning = tuning
        self.reset()

    def __len__(self) -> int:
        """How many places are remembered."""
        return len(self._places)

    def reset(self) -> None:
        """Forgets all places: the time jumped back."""
        self._time_ns: int | None = None
        self._began_ns = 0
        self._places = _begun(np.empty((0, 2)), 0, self.tuning, first=True)

    def step(
        self,
        joined: Joined,
        bodies: BodiesOnMap,
        expected: Expected,
        time_ns: int,
        static_score: float,
    ) -> Float:
        """Takes the bodies of an interval.

        Args:
            joined: The joined bodies.
            bodies: What they were joined of.
            expected: Where followed people are expected.
            time_ns: Time of the interval [ns].
            static_score: Maximum log-odds that a body loses.

        Returns:
            Log-odds that each joined body loses, shape (m,).
        """
        if self._time_ns is not None and self._time_ns - time_ns > RESET_NS:
            self.reset()
        if self._time_ns is None:
            self._time_ns = self._began_ns = time_ns
        self._time_ns = max(self._time_ns, time_ns)
        tuning, places = self.tuning, self._places
        forgotten = self._time_ns - places.last_ns > tuning.forget_s * 1e9
        if forgotten.any():
            places = places.select(~forgotten)
        of_body = _place_of(joined, places, tuning)
        new = np.flatnonzero(of_body < 0)
        of_body[new] = len(places) + np.arange(len(new))
        if len(new):
            first = self._time_ns - self._began_ns < tuning.first_s * 1e9
            begun = _begun(joined.xy[new], self._time_ns, tuning, first=first)
            places = _Places.joined([places, begun])
        _update_visitors(places, expected, tuning)
        look = _best_look(joined, bodies)
        _add_looks(places, of_body, joined.xy, look, self._time_ns, tuning)
        seen = places.select(of_body)
        lost = tuning.gain * np.log1p(seen.seen_s / tuning.tau)
        doubt = np.clip(1.0 - np.maximum(seen.best, tuning.present * look) / tuning.sure, 0.0, 1.0)
        lasting = np.interp(seen.seen_s, [tuning.soon_s, tuning.long_s], [0.0, 1.0])
        lasting *= np.clip(1.0 - seen.face / tuning.beyond_doubt, 0.0, 1.0)
        doubt = np.where(seen.first & ~seen.came, np.maximum(doubt, lasting), doubt)
        if len(places) > tuning.max_places:
            latest = np.argsort(-places.last_ns, kind="stable")[: tuning.max_places]
            places = places.select(np.sort(latest))
        self._places = places
        return np.asarray(np.minimum(static_score, lost) * doubt)


def _begun(xy: Float, time_ns: int, tuning: PlacesTuning, *, first: bool) -> _Places:
    """New places."""
    count = len(xy)
    return _Places(
        xy=xy.copy(),
        count=np.zeros(count, dtype=np.intp),
        seen_s=np.zeros(count),
        last_ns=np.full(count, time_ns, dtype=np.int64),
        recent=np.full((count, tuning.looks), np.nan),
        best=np.full(count, -np.inf),
        face=np.full(count, -np.inf),
        first=np.full(count, first),
        visitor=np.zeros(count, dtype=np.intp),
        came=np.zeros(count, dtype=bool),
        before=np.full((count, 2), -np.inf),
    )


def _place_of(joined: Joined, places: _Places, tuning: PlacesTuning) -> Int:
    """The nearest place of each body; -1: none is near."""
    variance = 0.5 * np.trace(joined.covariance, axis1=1, axis2=2)
    reach = tuning.reach + tuning.reach_sigmas * np.sqrt(variance)
    body, place, away = pairs_between(joined.xy, places.xy, tuning.max_reach)
    near = np.flatnonzero(away <= reach[body])
    return _nearest(body[near], place[near], away[near], len(joined))


def _nearest(one: Int, other: Int, away: Float, count: int) -> Int:
    """Of pairs, the nearest other of each one, shape (count,); -1: none."""
    nearest = np.full(count, -1, dtype=np.intp)
    farthest_first = np.lexsort((-other, -away))
    nearest[one[farthest_first]] = other[farthest_first]  # the last one stays
    return nearest


def _best_look(joined: Joined, bodies: BodiesOnMap) -> Float:
    """The best score that a single robot gives each joined body, shape (m,)."""
    look = np.full(len(joined), -np.inf)
    member = np.flatnonzero(joined.of_body >= 0)
    np.maximum.at(look, joined.of_body[member], bodies.score[member])
    return look


def _update_visitors(places: _Places, expected: Expected, tuning: PlacesTuning) -> None:
    """Who stands at which place by now, and who has left; changes the places."""
    place, person, away = pairs_between(places.xy, expected.xy, tuning.max_reach)
    ids = expected.id
    stays = np.zeros(len(places), dtype=bool)
    stays[place[ids[person] == places.visitor[place]]] = True
    left = np.flatnonzero((places.visitor > 0) & ~stays)
    left = left[np.isin(places.visitor[left], ids)]  # not those who are not followed any more
    places.best[left], places.face[left] = places.before[left].T
    places.recent[left] = np.nan
    places.visitor[left], places.came[left] = 0, False

    nearest = _nearest(place, person, away, len(places))
    arrived = np.flatnonzero((nearest >= 0) & ~stays)
    places.before[arrived] = np.column_stack([places.best[arrived], places.face[arrived]])
    places.visitor[arrived] = ids[nearest[arrived]]
    known = np.flatnonzero(nearest >= 0)
    mine = ids[nearest[known]] == places.visitor[known]
    places.came[known[mine]] |= expected.travelled[nearest[known[mine]]]


def _add_looks(
    places: _Places, of_body: Int, xy: Float, look: Float, time_ns: int, tuning: PlacesTuning
) -> None:
    """Adds an interval's looks to the places that are seen, each the best of its bodies."""
    best_last = np.argsort(look, kind="stable")
    body = np.full(len(places), -1, dtype=np.intp)
    body[of_body[best_last]] = best_last
    seen = np.flatnonzero(body >= 0)
    body = body[seen]
    places.count[seen] += 1
    share = 1.0 / places.count[seen, np.newaxis]
    places.xy[seen] += share * (xy[body] - places.xy[seen])
    since_s = np.minimum((time_ns - places.last_ns[seen]) / 1e9, tuning.max_gap_s)
    places.seen_s[seen] += np.where(places.came[seen], 0.0, since_s)
    places.last_ns[seen] = time_ns
    recent = np.column_stack([look[body], places.recent[seen, :-1]])
    places.recent[seen] = recent
    mean = np.minimum(recent, tuning.max_look).mean(axis=1)
    places.best[seen] = np.fmax(places.best[seen], mean)
    places.face[seen] = np.fmax(places.face[seen], _median(recent))


def _median(values: Float) -> Float:
    """Of each row, as `np.median`, which takes long for so few; NaN: one is, shape (n,)."""
    ordered, half = np.sort(values, axis=1), values.shape[1] // 2
    middle = 0.5 * (ordered[:, -1 - half] + ordered[:, half])
    return np.where(np.isnan(ordered[:, -1]), np.nan, middle)

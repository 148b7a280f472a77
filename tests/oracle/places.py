"""What stands where, and for how long: one body and one place at a time."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field

from oracle.numbers import (
    BEST_OF,
    BEYOND_DOUBT,
    FIRST_S,
    FORGET_S,
    LARGEST_LOOK,
    LONG_S,
    LONGEST_GAP_S,
    LOST_PER_LOG,
    LOST_TAU_S,
    MOST_PLACES,
    PLACE_M,
    PLACE_MOST_M,
    PLACE_SIGMAS,
    PRESENT_SHARE,
    SOON_S,
    SURE_LOOK,
)


@dataclass(frozen=True)
class Look:
    """A body of an interval: place [m], its mean variance [m^2], and each robot's log-odds."""

    xy: tuple[float, float]
    variance: float
    scores: tuple[float, ...]


@dataclass(frozen=True)
class Guest:
    """A followed person: id, where they are expected [m], and whether they came from elsewhere."""

    id: int
    xy: tuple[float, float]
    travelled: bool


@dataclass
class _Place:
    """All that is remembered of a place; see `PlaceMemory`."""

    first: tuple[float, float]
    last_ns: int
    from_start: bool
    seen_s: float = 0.0
    seen_at: list[tuple[float, float]] = field(default_factory=list)
    looks: list[float] = field(default_factory=list)
    best: float = -math.inf
    face: float = -math.inf
    visitor: int = 0
    came: bool = False
    before: tuple[float, float] = (-math.inf, -math.inf)

    @property
    def xy(self) -> tuple[float, float]:
        """The mean of where it was seen; of a new one, where it is seen first."""
        x, y = zip(*(self.seen_at or [self.first]), strict=True)
        return sum(x) / len(x), sum(y) / len(y)


def lost_by(
    looks: Sequence[Sequence[Look]],
    guests: Sequence[Sequence[Guest]],
    times_ns: Sequence[int],
    most: float,
) -> list[list[float]]:
    """Log-odds that each body of each interval loses.

    Args:
        looks: The bodies, by interval.
        guests: Who is followed, likewise.
        times_ns: Times of the intervals, never back by more than a second [ns].
        most: What a body loses at most.
    """
    places: list[_Place] = []
    out: list[list[float]] = []
    now = times_ns[0]
    for bodies, people, time_ns in zip(looks, guests, times_ns, strict=True):
        now = max(now, time_ns)
        if not bodies:
            out.append([])
            continue
        places = [one for one in places if now - one.last_ns <= FORGET_S * 1e9]
        old, of_body = list(places), []
        for body in bodies:
            reach = min(PLACE_M + PLACE_SIGMAS * math.sqrt(body.variance), PLACE_MOST_M)
            near = [one for one in old if math.dist(one.xy, body.xy) <= reach]
            if not near:
                places.append(_Place(body.xy, now, now - times_ns[0] < FIRST_S * 1e9))
                near = places[-1:]
            of_body.append(_nearest(near, body))
        for place in places:
            _receive(place, people)
        for place in places:
            mine = [b for b, one in zip(bodies, of_body, strict=True) if one is place]
            if mine:
                _see(place, max(mine, key=lambda b: max(b.scores)), now)
        out.append([_lost(p, max(b.scores), most) for p, b in zip(of_body, bodies, strict=True)])
        places = sorted(places, key=lambda one: -one.last_ns)[:MOST_PLACES]
    return out


def _nearest(places: Sequence[_Place], body: Look) -> _Place:
    return min(places, key=lambda one: math.dist(one.xy, body.xy))


def _receive(place: _Place, people: Sequence[Guest]) -> None:
    """Followed people come to a place, stay, and leave."""
    known = {one.id: one for one in people}
    near = [one for one in people if math.dist(one.xy, place.xy) <= PLACE_MOST_M]
    if place.visitor in known and known[place.visitor] not in near:
        place.visitor, place.came, place.looks = 0, False, []
        place.best, place.face = place.before
    if not near:
        return
    nearest = min(near, key=lambda one: math.dist(one.xy, place.xy))
    if known.get(place.visitor) not in near:
        place.visitor, place.before = nearest.id, (place.best, place.face)
    if place.visitor == nearest.id:
        place.came = place.came or nearest.travelled


def _see(place: _Place, body: Look, now: int) -> None:
    place.seen_at.append(body.xy)
    if not place.came:
        place.seen_s += min((now - place.last_ns) / 1e9, LONGEST_GAP_S)
    place.last_ns = now
    place.looks.append(max(body.scores))
    latest = sorted(place.looks[-BEST_OF:])
    if len(latest) == BEST_OF:
        place.best = max(place.best, sum(min(one, LARGEST_LOOK) for one in latest) / BEST_OF)
        place.face = max(place.face, latest[BEST_OF // 2])


def _lost(place: _Place, look: float, most: float) -> float:
    best = max(place.best, PRESENT_SHARE * look)
    doubt = min(1.0, max(0.0, 1.0 - best / SURE_LOOK))
    if place.from_start and not place.came:
        lasting = min(1.0, max(0.0, (place.seen_s - SOON_S) / (LONG_S - SOON_S)))
        doubt = max(doubt, lasting * min(1.0, max(0.0, 1.0 - place.face / BEYOND_DOUBT)))
    return min(most, LOST_PER_LOG * math.log1p(place.seen_s / LOST_TAU_S)) * doubt

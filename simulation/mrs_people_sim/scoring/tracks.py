"""Scores of identities and velocities over the frames of `positions.score`.

The rules, besides those of `evaluation`:

- Only estimates with an id take part; one without is nobody's track.
- CLEAR MOT: in each frame a person keeps the identity that was last theirs while it is within the
  distance, and the other people and estimates are matched optimally. A switch counts when somebody
  gets another identity than their last one, however long ago that was.
- For people that no robot sees there is no frame: they are not missed and get no identity, so a gap
  in which nobody saw them breaks nothing. Their identity stays theirs while it is near them, and an
  estimate that is theirs, or that fits them and nobody who is required, is ignored.

Sources:

- MOTA, MOTP, switches: Bernardin and Stiefelhagen, "Evaluating multiple object tracking
  performance: the CLEAR MOT metrics", EURASIP Journal on Image and Video Processing, 2008.
- Fragments, mostly tracked, mostly lost: Li, Huang and Nevatia, "Learning to associate:
  HybridBoosted multi-target tracker for crowded scene", CVPR 2009.
- IDF1, IDP, IDR: Ristani et al., "Performance measures and a data set for multi-target,
  multi-camera tracking", ECCV workshops 2016.
- GOSPA: Rahmathullah, García-Fernández and Svensson, "Generalized optimal sub-pattern assignment
  metric", FUSION 2017.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linear_sum_assignment

from mrs_people_loc.arrays import Bool, Float, Int
from mrs_people_sim.scoring.positions import (
    MATCH_DISTANCE,
    Frame,
    interval_of,
    match,
    nothing,
    percentile,
    ratio,
    sums_of,
)
from mrs_tools.bags.records import Estimate, Truth

#: GOSPA's exponent p; its alpha is 2, its cut-off c the distance of a match.
GOSPA_POWER = 2
#: True velocities are central differences over this time [ns].
VELOCITY_WINDOW_NS = 400_000_000
#: A person that is followed in this share of their frames is mostly tracked, and
MOSTLY_TRACKED = 0.8
#: in less than this share mostly lost.
MOSTLY_LOST = 0.2


@dataclass(frozen=True)
class Followed:
    """Which track follows which person in one frame, by CLEAR MOT.

    Attributes:
        stamp_ns: When the people were at the estimated positions: the estimate's stamp; the frame's
            where there is no estimate [ns].
        ids: Of the estimates that have one, int64, shape (n,).
        positions: Theirs [m], shape (n, 2).
        velocities: Theirs [m/s], shape (n, 2); NaN: unknown.
        true: True positions [m], shape (m, 2); NaN: not there.
        required: Who has to be followed, shape (m,).
        pairs: Indices of those who are matched, in `ids` and in `true`, shape (k, 2); also of
            people who are not required.
        errors: Their distances [m], shape (k,).
        switched: Whose identity is not the last one, shape (k,).
    """

    stamp_ns: int
    ids: NDArray[np.int64]
    positions: Float
    velocities: Float
    true: Float
    required: Bool
    pairs: Int
    errors: Float
    switched: Bool

    @property
    def counted(self) -> Bool:
        """Which of the pairs count: those of people who are required, shape (k,)."""
        return self.required[self.pairs[:, 1]]

    @property
    def found(self) -> Int:
        """Indices in `ids` of the estimates that count: all that are not ignored."""
        ignored = self.pairs[~self.counted, 0]
        return np.delete(np.arange(len(self.ids)), ignored)


def follow(
    frames: Sequence[Frame], estimates: Sequence[Estimate], *, distance: float = MATCH_DISTANCE
) -> list[Followed]:
    """Matches identities with people over time, by the rules at the top of this module.

    Where two people had the same identity last, it belongs to the one that had it later.

    Args:
        frames: Of one recording, in their order; of all the same people (`evaluation.score`).
        estimates: Those that were scored.
        distance: People and estimates match within this [m].
    """
    people = len(frames[0].true) if frames else 0
    last_id = np.zeros(people, dtype=np.int64)
    last_time = np.full(people, -1)
    result = []
    for time, frame in enumerate(frames):
        ids, positions, velocities = _tracked(frame, estimates)
        there = np.isfinite(frame.true).all(axis=1)
        with np.errstate(invalid="ignore"):
            away = np.linalg.norm(positions[:, np.newaxis] - frame.true[np.newaxis], axis=2)
        # Those who keep their identity.
        theirs = (ids[:, np.newaxis] == last_id) & (away <= distance)
        since = np.where(theirs, last_time, -1)
        one = np.flatnonzero(theirs.any(axis=1))
        other = since[one].argmax(axis=1) if len(one) else one
        # The others who have to be followed, then those who do not.
        for wanted in (frame.required, there & ~frame.required):
            free, left = _without(wanted, other), _without(ids != 0, one)
            if len(free) and len(left):
                some, others, _ = match(positions[left], frame.true[free], distance=distance)
                one = np.concatenate([one, left[some]])
                other = np.concatenate([other, free[others]])
        had, has, counts = last_id[other], ids[one], frame.required[other]
        last_id[other[counts]] = has[counts]
        last_time[other[counts | (had == has)]] = time
        index = frame.estimate
        result.append(
            Followed(
                stamp_ns=frame.stamp_ns if index is None else estimates[index].stamp_ns,
                ids=ids,
                positions=positions,
                velocities=velocities,
                true=frame.true,
                required=frame.required,
                pairs=np.stack([one, other], axis=1),
                errors=away[one, other],
                switched=counts & (had != 0) & (had != has),
            )
        )
    return result


def _without(which: Bool, taken: Int) -> Int:
    """Indices of those who are not taken."""
    rest = which.copy()
    rest[taken] = False
    return np.flatnonzero(rest)


def _tracked(frame: Frame, estimates: Sequence[Estimate]) -> tuple[NDArray[np.int64], Float, Float]:
    """Ids, positions and velocities of the estimates of a frame that have an id.

    Without those that are hidden, or fit nobody, but are ignored (`Frame.beside`).
    """
    if frame.estimate is None:
        return np.empty(0, dtype=np.int64), np.empty((0, 2)), np.empty((0, 2))
    estimate = estimates[frame.estimate]
    kept = (estimate.ids != 0) & ~estimate.hidden
    kept[frame.beside] = False
    return estimate.ids[kept], estimate.positions[kept], estimate.velocities[kept]


def gospa(
    found: Float, true: Float, *, distance: float = MATCH_DISTANCE, power: float = GOSPA_POWER
) -> float:
    """Distance of two sets of positions: GOSPA with alpha = 2 [m].

    The least over all assignments of (sum of d^p over the pairs + c^p / 2 for each one of either
    set that is in no pair)^(1/p) (Rahmathullah et al. 2017, proposition 1).

    Args:
        found: Positions [m], shape (n, 2).
        true: Positions [m], shape (m, 2).
        distance: The cut-off c [m].
        power: The exponent p.
    """
    away = np.linalg.norm(found[:, np.newaxis] - true[np.newaxis], axis=2)
    # A pair at the cut-off costs what two without a partner do; so does one of NaN.
    cost = np.fmin(away, distance) ** power
    paired = float(cost[linear_sum_assignment(cost)].sum())
    alone = abs(len(found) - len(true)) * distance**power / 2
    return float((paired + alone) ** (1 / power))


def true_velocities(truth: Truth, stamps_ns: NDArray[np.int64], people: Int) -> Float:
    """How fast people truly are: central differences of their interpolated positions.

    Where somebody comes or goes, and at the ends of the truth, the difference is over that part of
    the window in which they are there.

    Args:
        truth: The truth.
        stamps_ns: When [ns], int64, shape (n,).
        people: Who: indices, shape (n,).

    Returns:
        Velocities [m/s], shape (n, 2); NaN: less than half of the window is there.
    """
    result = np.full((len(people), 2), np.nan)
    times, places = truth.stamps_ns, truth.positions
    if len(times) < 2 or not len(people):
        return result
    # The first and the last message of the stretch that each message is in: all there, or all not.
    there = np.asarray(np.isfinite(places).all(axis=2))
    edge = there[1:] ^ there[:-1]
    row = np.arange(len(times))[:, np.newaxis]
    begins, ends = np.vstack([there[:1], edge]), np.vstack([edge, there[-1:]])
    first = np.maximum.accumulate(np.where(begins, row, 0), axis=0)
    last = np.minimum.accumulate(np.where(ends, row, len(times) - 1)[::-1], axis=0)[::-1]

    # Before and after a stretch too little of the window is in it, whichever message is asked.
    at = np.minimum(np.searchsorted(times, stamps_ns), len(times) - 1)
    begin = np.maximum(stamps_ns - VELOCITY_WINDOW_NS // 2, times[first[at, people]])
    end = np.minimum(stamps_ns + VELOCITY_WINDOW_NS // 2, times[last[at, people]])
    known = 2 * (end - begin) >= VELOCITY_WINDOW_NS
    begin, end, which = begin[known], end[known], people[known]
    went = _places_at(truth, end, which) - _places_at(truth, begin, which)
    result[known] = went / ((end - begin) * 1e-9)[:, np.newaxis]
    return result


def _places_at(truth: Truth, stamps_ns: NDArray[np.int64], people: Int) -> Float:
    """Interpolated positions [m], shape (n, 2), at times within the truth (of 2 or more)."""
    times, places = truth.stamps_ns, truth.positions
    before = np.clip(np.searchsorted(times, stamps_ns, side="right") - 1, 0, len(times) - 2)
    one, other = places[before, people], places[before + 1, people]
    part = ((stamps_ns - times[before]) / (times[before + 1] - times[before]))[:, np.newaxis]
    # At a message the next one may be of nobody.
    return np.where(part == 0, one, one + part * (other - one))


@dataclass(frozen=True)
class TrackScores:
    """What the scores of tracks are made of: sums, which add up over recordings.

    Attributes:
        frames: Ground-truth messages.
        tracks: Different identities.
        people: Different people who had to be followed.
        true: Frames of all people in which they had to be followed.
        found: Estimates that count, over all frames.
        switches: How often somebody got another identity than their last one.
        fragments: How often somebody was lost and then followed again.
        mostly_tracked: People who were followed in 0.8 of their frames or more.
        mostly_lost: People who were in less than 0.2 of them.
        idtp: Frames in which people were followed by the identity that is theirs when each has at
            most one and each identity belongs to at most one (Ristani et al.).
        person_s: How long people had to be followed, all together [s].
        gospa_m: Sum over the frames [m].
        errors: Distances between those who follow and the followed [m].
        velocity_errors: Lengths of the differences of their velocities [m/s].
    """

    frames: int = 0
    tracks: int = 0
    people: int = 0
    true: int = 0
    found: int = 0
    switches: int = 0
    fragments: int = 0
    mostly_tracked: int = 0
    mostly_lost: int = 0
    idtp: int = 0
    person_s: float = 0.0
    gospa_m: float = 0.0
    errors: Float = field(default_factory=nothing)
    velocity_errors: Float = field(default_factory=nothing)

    def __add__(self, other: TrackScores) -> TrackScores:
        """Those of two recordings; people and identities of one are not those of the other."""
        return TrackScores(**sums_of(self, other))

    def report(self) -> dict[str, Any]:
        """`tracks` as in the JSON of `mrs evaluate`; all None if nothing has an identity."""
        matched, velocity = len(self.errors), self.velocity_errors
        # 1 - (missed + false + switches) / true
        right = self.true - (self.true - matched + self.found - matched + self.switches)
        figures: dict[str, Any] = {
            "mota": ratio(right, self.true),
            "motp_m": ratio(float(self.errors.sum()), matched),
            "idf1": ratio(2 * self.idtp, self.true + self.found),
            "idp": ratio(self.idtp, self.found),
            "idr": ratio(self.idtp, self.true),
            "id_switches": self.switches,
            "switches_per_person_minute": ratio(60.0 * self.switches, self.person_s),
            "fragments": self.fragments,
            "mostly_tracked": ratio(self.mostly_tracked, self.people),
            "mostly_lost": ratio(self.mostly_lost, self.people),
            "gospa": ratio(self.gospa_m, self.frames),
        }
        if not self.tracks:
            figures = dict.fromkeys(figures)
        return {
            **figures,
            "velocity_error_mps": {
                "mean": ratio(float(velocity.sum()), len(velocity)),
                "p95": percentile(velocity, 95),
            },
        }


def score_tracks(
    truth: Truth,
    frames: Sequence[Frame],
    estimates: Sequence[Estimate],
    *,
    distance: float = MATCH_DISTANCE,
) -> TrackScores:
    """Scores identities and velocities in one recording.

    Args:
        truth: The truth.
        frames: What `evaluation.score` made of it and of the estimates.
        estimates: What was found.
        distance: Found and true people match within this [m].
    """
    followed = follow(frames, estimates, distance=distance)
    kept = [f.found for f in followed]
    if not followed:
        return TrackScores()
    required = np.array([f.required for f in followed])
    tracked = np.zeros_like(required)
    for row, f in zip(tracked, followed, strict=True):
        row[f.pairs[f.counted, 1]] = True
    ids = np.unique(np.concatenate([np.empty(0, np.int64), *(f.ids for f in followed)]))
    share = tracked.sum(axis=0)[required.any(axis=0)] / required.sum(axis=0)[required.any(axis=0)]
    return TrackScores(
        frames=len(followed),
        tracks=len(ids),
        people=len(share),
        true=int(required.sum()),
        found=sum(map(len, kept)),
        switches=sum(int(f.switched.sum()) for f in followed),
        fragments=sum(map(_fragments, required.T, tracked.T)),
        mostly_tracked=int((share >= MOSTLY_TRACKED).sum()),
        mostly_lost=int((share < MOSTLY_LOST).sum()),
        idtp=_idtp(followed, kept, ids, distance),
        person_s=float(required.sum()) * interval_of(truth.stamps_ns.tolist()) * 1e-9,
        gospa_m=math.fsum(
            gospa(f.positions[found], f.true[f.required], distance=distance)
            for f, found in zip(followed, kept, strict=True)
        ),
        errors=np.concatenate([nothing(), *(f.errors[f.counted] for f in followed)]),
        velocity_errors=_velocity_errors(truth, followed),
    )


def _fragments(required: Bool, tracked: Bool) -> int:
    """How often a person is followed again after a gap, in the frames that require them."""
    status = tracked[required]
    again = int((status[1:] & ~status[:-1]).sum())
    # The first time is no second time.
    return again - int(bool(status.any()) and not status[0])


def _idtp(
    followed: Sequence[Followed], kept: Sequence[Int], ids: NDArray[np.int64], distance: float
) -> int:
    """The most frames in which people are near their identity, one to one over all frames."""
    people = len(followed[0].true)
    together = np.zeros((people, len(ids)), dtype=np.int64)
    for f, found in zip(followed, kept, strict=True):
        true = np.where(f.required[:, np.newaxis], f.true, np.nan)
        away = np.linalg.norm(true[:, np.newaxis] - f.positions[found][np.newaxis], axis=2)
        together[:, np.searchsorted(ids, f.ids[found])] += away <= distance
    return int(together[linear_sum_assignment(together, maximize=True)].sum())


def _velocity_errors(truth: Truth, followed: Sequence[Followed]) -> Float:
    stamps, people, found = [], [], []
    for f in followed:
        pairs = f.pairs[f.counted]
        stamps.append(np.full(len(pairs), f.stamp_ns, dtype=np.int64))
        people.append(pairs[:, 1])
        found.append(f.velocities[pairs[:, 0]])
    wanted = true_velocities(truth, np.concatenate(stamps), np.concatenate(people))
    errors: Float = np.linalg.norm(np.concatenate(found) - wanted, axis=1)
    return errors[np.isfinite(errors)]

"""Scores of stragglers (flagged in time, flagged wrongly) and of the groups' centres.

The rules, besides those of `evaluation` and `track_scores`:

- Members of one true group who are no farther apart than a limit are linked, and links make parts.
  The largest part is the group that goes on; if several are the largest, nobody can say which.
- An episode is a member who is alone, farther than `groups.distance` from every other member, for
  `LASTING_NS` or longer, while others are together. It begins where they cross that distance,
  linearly between two messages. When they are beyond it again before they were nearer to somebody
  than it less `groups.margin`, that is the same episode. Several who leave together are a split and
  no episode; nor is anybody whose crossing the truth does not show.
- An episode is flagged when, in the course of it, a group names the identity that is theirs, or was
  their last, as a straggler. The delay is the time from the crossing to the stamp of that estimate;
  0 if they were flagged before.
- An episode is unseen when no robot sees the person in its first `LASTING_NS`; it counts as nothing
  else.
- A flag is false when it is raised for an identity that belongs to nobody; to somebody who has not
  been a member so far; or to a member who, from `AROUND_NS` before to `AROUND_NS` after it, is with
  the group that goes on, held by links of `groups.distance` less `groups.margin`.
- Identities are those of all who are followed, also of the hidden.
- It is not false for somebody who was a member and is none any more: they have left. Nor for
  somebody who is not followed any more while no robot sees them: it says that they are missing.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Bool, Float, Int
from mrs_people_loc.neighbours import connected
from mrs_people_sim.scoring.positions import (
    MATCH_DISTANCE,
    Frame,
    interval_of,
    nothing,
    ratio,
    sums_of,
)
from mrs_people_sim.scoring.tracks import follow
from mrs_tools.bags.records import Estimate, Truth

#: Who is alone for a shorter time has not fallen behind [ns].
LASTING_NS = 1_000_000_000
#: A flag may come so long before or after what it says is true [ns].
AROUND_NS = 1_000_000_000
#: Who is flagged no later than this after the crossing is flagged in time [s].
IN_TIME_S = 1.0


@dataclass(frozen=True)
class Episode:
    """A member is farther than the limit from every other one.

    Attributes:
        person: Index of the person.
        begin_ns: When the member crossed the limit [ns].
        end_ns: Last message at which the member is beyond it [ns].
        seen: Whether a robot sees the member in the first `LASTING_NS` of it.
    """

    person: int
    begin_ns: int
    end_ns: int
    seen: bool


def episodes(truth: Truth, *, config: cfg.Groups) -> list[Episode]:
    """Who falls behind, and when, by the rules at the top of this module.

    Args:
        truth: The truth; without groups there is nothing.
        config: `distance` and `margin` count.
    """
    if truth.groups is None:
        return []
    nearest, largest, _ = _standing(truth, config.distance)
    alone = (nearest > config.distance) & (largest > 1)  # NaN compares false
    back = ~(nearest > config.distance - config.margin)
    times = truth.stamps_ns
    result = []
    for person in range(alone.shape[1]):
        mine: list[Episode] = []
        last = 0
        for first, end in _runs(alone[:, person]):
            if mine and not back[last:first, person].any():
                mine[-1] = Episode(person, mine[-1].begin_ns, int(times[end]), mine[-1].seen)
                last = end
                continue
            before = nearest[first - 1, person] if first else math.nan
            if not before <= config.distance:
                continue
            part = (config.distance - before) / (nearest[first, person] - before)
            part = part if math.isfinite(part) else 1.0
            begin = int(times[first - 1]) + round(part * float(times[first] - times[first - 1]))
            if times[end] - begin < LASTING_NS:
                continue
            early = (times >= begin) & (times <= begin + LASTING_NS)
            seen = bool(truth.visible[early, person].any())
            mine.append(Episode(person, begin, int(times[end]), seen))
            last = end
        result += mine
    return sorted(result, key=lambda episode: (episode.begin_ns, episode.person))


def _runs(which: Bool) -> Iterable[tuple[int, int]]:
    """First and last index of each stretch of true values."""
    change = np.flatnonzero(np.diff(which.astype(np.int8), prepend=0, append=0))
    return zip(change[::2].tolist(), (change[1::2] - 1).tolist(), strict=True)


def _standing(truth: Truth, limit: float) -> tuple[Float, Int, Bool]:
    """Distances of everybody to their group, over time; each of shape (n, m).

    Args:
        truth: The truth, with groups.
        limit: Members are linked up to this distance [m].

    Returns:
        Distance to the nearest other member [m], infinite where there is none, NaN for
        people that are no members or not there; the size of the largest part of their group; and
        whether they are in that part, and no other is as large.
    """
    assert truth.groups is not None
    shape = truth.groups.shape
    nearest, largest = np.full(shape, np.nan), np.zeros(shape, dtype=np.intp)
    onward = np.zeros(shape, dtype=bool)
    there = np.asarray(np.isfinite(truth.positions).all(axis=2))
    for row, (xy, group) in enumerate(zip(truth.positions, truth.groups, strict=True)):
        for number in np.unique(group[there[row] & (group > 0)]):
            members = np.flatnonzero(there[row] & (group == number))
            away = np.linalg.norm(xy[members][:, np.newaxis] - xy[members], axis=2)
            np.fill_diagonal(away, np.inf)
            nearest[row, members] = away.min(axis=1)
            one, other = np.nonzero(away <= limit)
            root = connected(one, other, len(members))
            size = np.bincount(root, minlength=len(members))
            largest[row, members] = size.max()
            onward[row, members] = (size[root] == size.max()) & (np.sum(size == size.max()) == 1)
    return nearest, largest, onward


@dataclass(frozen=True)
class StragglerScores:
    """What the scores of stragglers are made of: sums, which add up over recordings.

    Attributes:
        true: Episodes that somebody could see.
        unseen: Episodes that nobody could see.
        false: Flags that are false.
        observed_s: For how long there were members, and estimates with identities [s].
        delays_s: Of the episodes that were flagged [s].
    """

    true: int = 0
    unseen: int = 0
    false: int = 0
    observed_s: float = 0.0
    delays_s: Float = field(default_factory=nothing)

    def __add__(self, other: StragglerScores) -> StragglerScores:
        """Those of two recordings."""
        return StragglerScores(**sums_of(self, other))

    def report(self) -> dict[str, Any]:
        """`stragglers` as in the JSON of `mrs evaluate`; all None if nothing was observed."""
        flagged = len(self.delays_s)
        figures: dict[str, Any] = {
            "true": self.true,
            "flagged": flagged,
            "within_1_s": ratio(int((self.delays_s <= IN_TIME_S).sum()), self.true),
            "unseen": self.unseen,
            "false": self.false,
            "minutes": self.observed_s / 60.0,
        }
        if not self.observed_s:
            figures = dict.fromkeys(figures)
        return {
            **figures,
            "delay_s": {
                "mean": ratio(float(self.delays_s.sum()), flagged),
                "max": float(self.delays_s.max()) if flagged else None,
            },
        }


def score_stragglers(
    truth: Truth,
    frames: Sequence[Frame],
    estimates: Sequence[Estimate],
    *,
    config: cfg.Groups,
) -> StragglerScores:
    """Scores the stragglers of one recording.

    Args:
        truth: The truth; without groups nothing is scored.
        frames: What `evaluation.score` made of it and of the estimates.
        estimates: What was found; if nobody has an identity nothing is scored.
        config: The limits: `distance` and `margin`.
    """
    if truth.groups is None or not any(e.ids.any() for e in estimates):
        return StragglerScores()
    nearest, _, onward = _standing(truth, config.distance - config.margin)
    members = np.asarray(np.isfinite(nearest).any(axis=1))
    found = episodes(truth, config=config)
    delays: dict[int, float] = {}  # by index of the episode
    raised: dict[int, int] = {}  # by identity, since when it has been flagged [ns]
    person_of: dict[int, int] = {}
    id_of: dict[int, int] = {}
    false = observed = 0
    everybody = [estimate.as_in_view() for estimate in estimates]
    followed = follow(frames, everybody, distance=MATCH_DISTANCE)
    for row, (frame, f) in enumerate(zip(frames, followed, strict=True)):
        if frame.estimate is None:
            continue
        observed += bool(members[row])
        for index, person in f.pairs.tolist():
            person_of[int(f.ids[index])], id_of[person] = person, int(f.ids[index])
        flags = estimates[frame.estimate].stragglers
        for flag in set(flags) - set(raised):
            person = person_of.get(flag, -1)
            missing = person >= 0 and flag not in f.ids and not truth.visible[row, person]
            false += not missing and _is_false(truth, row, f.stamp_ns, person, onward)
        raised = {flag: raised.get(flag, f.stamp_ns) for flag in flags}
        for number, episode in enumerate(found):
            if number in delays or not episode.begin_ns <= f.stamp_ns <= episode.end_ns:
                continue
            since = raised.get(id_of.get(episode.person, 0))
            if since is not None:
                delays[number] = max(0, since - episode.begin_ns) * 1e-9
    seen = [number for number, episode in enumerate(found) if episode.seen]
    return StragglerScores(
        true=len(seen),
        unseen=len(found) - len(seen),
        false=false,
        observed_s=observed * interval_of(truth.stamps_ns.tolist()) * 1e-9,
        delays_s=np.array([delays[number] for number in seen if number in delays]),
    )


def score_centres(
    truth: Truth, frames: Sequence[Frame], estimates: Sequence[Estimate], *, config: cfg.Groups
) -> list[Frame]:
    """Frames with the error of the group's centre, where the truth has one group.

    It is the distance from the centre of the largest group that was found to that of the members
    who are with the group that goes on, and are required or were found all the same.

    Args:
        truth: The truth; without groups, or with several, the frames stay as they are.
        frames: What `evaluation.score` made of it and of the estimates.
        estimates: What was found.
        config: The limits: `distance` counts.
    """
    if truth.groups is None or len(np.unique(truth.groups[truth.groups > 0])) != 1:
        return list(frames)
    _, _, onward = _standing(truth, config.distance)
    result = []
    for row, frame in enumerate(frames):
        largest = None if frame.estimate is None else estimates[frame.estimate].largest
        counted = onward[row] & frame.counted
        error = math.nan
        if largest is not None and counted.any():
            error = float(np.linalg.norm(largest - frame.true[counted].mean(axis=0)))
        result.append(replace(frame, centre_error=error))
    return result


def _is_false(truth: Truth, row: int, stamp_ns: int, person: int, onward: Bool) -> bool:
    """Whether a flag that is raised at a time is false; `person` is -1 for nobody."""
    assert truth.groups is not None
    if person < 0 or not (truth.groups[: row + 1, person] > 0).any():
        return True
    around = np.abs(truth.stamps_ns - stamp_ns) <= AROUND_NS
    return bool(onward[around, person].all())

"""Scores of people whom nobody sees, and how long those are reported who have left the view.

The rules, besides those of `positions`:

- Those who are hidden by the planner are compared with the people whom no robot sees: these have to
  be known, and somebody hidden who fits a person in view is ignored.
- A ghost is an identity that is predicted, not seen, after its person has left the view: from the
  first frame in which nobody has to find them, as long as it is predicted and follows nobody else.
  One whose person comes back into view before it ends is none.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_sim.scoring.positions import Frame, nothing, percentile, score, sums_of
from mrs_people_sim.scoring.tracks import Followed, follow
from mrs_tools.bags.records import Estimate, Truth


@dataclass(frozen=True)
class GhostScores:
    """How long ghosts last; scores of several recordings are added.

    Attributes:
        shown_s: Among the people in view, each time that somebody leaves it [s], shape (k,).
        followed_s: Among these and the hidden, likewise [s].
    """

    shown_s: Float = field(default_factory=nothing)
    followed_s: Float = field(default_factory=nothing)

    def __add__(self, other: GhostScores) -> GhostScores:
        return GhostScores(**sums_of(self, other))

    def report(self) -> tuple[dict[str, Any], dict[str, Any]]:
        """`ghost_s` of `people` and of `people_hidden`, as in the JSON of `mrs evaluate`."""
        return _summary(self.shown_s), _summary(self.followed_s)


def _summary(lasted_s: Float) -> dict[str, Any]:
    median, p95 = (percentile(lasted_s, percent) for percent in (50, 95))
    return {"times": len(lasted_s), "median": median, "p95": p95}


def score_hidden(truth: Truth, estimates: Sequence[Estimate]) -> list[Frame]:
    """Compares those who are hidden with the people whom nobody sees.

    Args:
        truth: The truth.
        estimates: What was found, in any order.
    """
    unseen = replace(truth, visible=~truth.visible, ignore_within=0.0)
    return score(unseen, [one.only(one.hidden).as_in_view() for one in estimates])


def score_ghosts(frames: Sequence[Frame], estimates: Sequence[Estimate]) -> GhostScores:
    """How long identities outlast the time in which their people are in view.

    Args:
        frames: Of one recording, in their order (`positions.score`).
        estimates: Those that were scored.
    """
    everybody = [one.as_in_view() for one in estimates]
    followed = follow(frames, everybody)
    shown_s: list[float] = []
    followed_s: list[float] = []
    for row, person, number in _leaving(followed):
        for lasted_s, some in ((shown_s, estimates), (followed_s, everybody)):
            lasted = _lasts(row, person, number, frames, followed, some)
            if lasted is not None:
                lasted_s.append(lasted)
    return GhostScores(np.array(shown_s), np.array(followed_s))


def _leaving(followed: Sequence[Followed]) -> Iterator[tuple[int, int, int]]:
    """Who leaves the view: the first frame in which they are not required, who, and their id."""
    last_id: dict[int, int] = {}
    for row, now in enumerate(followed):
        if row:
            for person in np.flatnonzero(followed[row - 1].required & ~now.required).tolist():
                if person in last_id:
                    yield row, person, last_id.pop(person)
        pairs = now.pairs[now.counted]
        last_id |= dict(zip(pairs[:, 1].tolist(), now.ids[pairs[:, 0]].tolist(), strict=True))


def _lasts(
    row: int,
    person: int,
    number: int,
    frames: Sequence[Frame],
    followed: Sequence[Followed],
    estimates: Sequence[Estimate],
) -> float | None:
    """How long an identity is predicted from a frame on [s]; None: its person comes back before."""
    begin_ns = end_ns = None
    for frame, now in zip(frames[row:], followed[row:], strict=True):
        if now.required[person]:
            return None
        if frame.estimate is None:
            continue
        estimate = estimates[frame.estimate]
        mine = (estimate.ids == number) & ~estimate.hidden
        others = now.ids[now.pairs[now.counted, 0]]
        if not mine.any() or number in others:
            break
        if not estimate.coasting[mine].any():  # a part of them is still seen
            begin_ns = end_ns = None
            continue
        begin_ns, end_ns = begin_ns or estimate.stamp_ns, estimate.stamp_ns
    return 0.0 if begin_ns is None or end_ns is None else (end_ns - begin_ns) / 1e9

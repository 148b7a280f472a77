"""Scores of tracks against independent libraries on the same inputs: py-motmetrics, Stone Soup."""

from __future__ import annotations

import math
from dataclasses import dataclass
from datetime import datetime, timedelta

import numpy as np
import pytest

from mrs_people_sim.scoring.positions import MATCH_DISTANCE, Frame, score
from mrs_people_sim.scoring.tracks import Followed, follow, gospa, score_tracks
from mrs_tools.bags.records import Estimate, Truth

motmetrics = pytest.importorskip("motmetrics", reason="a check of scores needs motmetrics")
ospametric = pytest.importorskip(
    "stonesoup.metricgenerator.ospametric", reason="a check of scores needs Stone Soup"
)
state = pytest.importorskip("stonesoup.types.state")

STEP_NS = 100_000_000


@dataclass(frozen=True)
class Recording:
    """A recording made by chance, and how it was met."""

    truth: Truth
    estimates: list[Estimate]

    @property
    def frames(self) -> list[Frame]:
        return score(self.truth, self.estimates)


def recording(seed: int, *, hidden: bool) -> Recording:
    """People who walk close together, come, go and hide; tracks that swap, break and are false."""
    rng = np.random.default_rng(seed)
    people, frames = int(rng.integers(1, 7)), int(rng.integers(15, 50))
    walks = rng.uniform(0, rng.choice([1.0, 4.0]), (people, 2)) + np.cumsum(
        rng.normal(0, 0.1, (frames, people, 2)), axis=0
    )
    ids = np.arange(1, people + 1)
    fresh = people + 1
    stamps, places, visible, estimates = [], [], [], []
    there, seen, found = (np.ones(people, dtype=bool) for _ in range(3))
    ghosts: dict[int, np.ndarray] = {}
    for index, true in enumerate(walks):
        there ^= rng.random(people) < 0.03
        seen ^= rng.random(people) < (0.15 if hidden else 0.0)
        found ^= rng.random(people) < np.where(found, 0.1, 0.4)
        if people > 1 and rng.random() < 0.15:  # two tracks swap
            one, other = rng.choice(people, 2, replace=False)
            ids[one], ids[other] = ids[other], ids[one]
        for lost in np.flatnonzero(rng.random(people) < 0.04):  # a track begins again
            ids[lost], fresh = fresh, fresh + 1
        if rng.random() < 0.2:
            ghosts[fresh], fresh = rng.choice(true) + rng.normal(0, 0.5, 2), fresh + 1
        if ghosts and rng.random() < 0.2:
            del ghosts[next(iter(ghosts))]
        stamps.append(index * STEP_NS)
        places.append(np.where(there[:, np.newaxis], true, np.nan))
        visible.append(seen.copy())
        if rng.random() < 0.05:
            continue  # an interval was skipped
        xy = [*(true[found] + rng.normal(0, 0.15, (found.sum(), 2))), *ghosts.values()]
        numbers = np.array([*ids[found], *ghosts], dtype=np.int64)
        order = rng.permutation(len(numbers))
        estimates.append(
            Estimate(
                stamp_ns=index * STEP_NS,
                positions=np.array(xy).reshape(-1, 2)[order],
                covariances=np.zeros((len(xy), 2, 2)),
                ids=numbers[order],
            )
        )
    return Recording(Truth.build(stamps, places, visible), estimates)


def by_motmetrics(followed: list[Followed]) -> dict[str, float]:
    """The figures of frames, less what is ignored, as the library has them."""
    accumulator = motmetrics.MOTAccumulator(auto_id=True)
    last = dict.fromkeys(range(len(followed[0].true)), (0, -1))  # identity, frame
    for time, f in enumerate(followed):
        # Of two who had one identity the library prefers the first; our rule: who had it later.
        people = sorted(np.flatnonzero(f.required).tolist(), key=lambda person: -last[person][1])
        away = np.linalg.norm(
            f.true[people][:, np.newaxis] - f.positions[f.found][np.newaxis], axis=2
        )
        away[away > MATCH_DISTANCE] = np.nan
        accumulator.update(people, f.ids[f.found], away)
        for estimate, person in f.pairs.tolist():
            identity = int(f.ids[estimate])
            if f.required[person] or identity == last[person][0]:
                last[person] = identity, time
    names = {
        "mota": "mota",
        "motp": "motp_m",
        "idf1": "idf1",
        "idp": "idp",
        "idr": "idr",
        "num_switches": "id_switches",
        "num_fragmentations": "fragments",
        "mostly_tracked": "mostly_tracked",
        "mostly_lost": "mostly_lost",
        "num_unique_objects": "people",
        "num_objects": "true",
        "num_predictions": "found",
        "num_detections": "matched",
        "idtp": "idtp",
    }
    figures = motmetrics.metrics.create().compute(accumulator, metrics=list(names))
    return {ours: float(figures[theirs].iloc[0]) for theirs, ours in names.items()}


@pytest.mark.parametrize("hidden", [False, True])
def test_clear_mot_and_idf1_equal_those_of_motmetrics(hidden):
    switches = fragments = lost = ignored = 0
    for seed in range(50):
        made = recording(seed, hidden=hidden)
        followed = follow(made.frames, made.estimates)
        scores = score_tracks(made.truth, made.frames, made.estimates)
        report = scores.report()
        ours = {
            **{name: report[name] for name in ("mota", "motp_m", "idf1", "idp", "idr")},
            **{name: report[name] for name in ("id_switches", "fragments")},
            **{name: getattr(scores, name) for name in ("mostly_tracked", "mostly_lost")},
            **{name: getattr(scores, name) for name in ("people", "true", "found", "idtp")},
            "matched": len(scores.errors),
        }
        wanted = by_motmetrics(followed)
        given = {n: math.nan if value is None else value for n, value in ours.items()}
        assert given == pytest.approx(wanted, abs=1e-9, nan_ok=True), f"seed {seed}"
        switches += scores.switches
        fragments += scores.fragments
        lost += scores.mostly_lost
        ignored += sum(len(f.ids) - len(f.found) for f in followed)
    # The recordings have what there is to count.
    assert switches > 150
    assert fragments > 150
    assert lost > 0
    assert (ignored > 150) == hidden


def test_gospa_equals_that_of_stone_soup():
    metric = ospametric.GOSPAMetric(c=MATCH_DISTANCE, p=2)
    now = datetime(2026, 1, 1)
    frames = 0
    for seed in range(20):
        made = recording(seed, hidden=True)
        total = 0.0
        followed = follow(made.frames, made.estimates)
        for index, f in enumerate(followed):
            stamp = now + timedelta(seconds=index)
            found, true = (
                [state.State(xy[:, np.newaxis], timestamp=stamp) for xy in places]
                for places in (f.positions[f.found], f.true[f.required])
            )
            wanted = 0.0
            if found or true:
                wanted = metric.compute_gospa_metric(found, true)[0].value["distance"]
            assert gospa(f.positions[f.found], f.true[f.required]) == pytest.approx(wanted)
            total += wanted
            frames += 1
        report = score_tracks(made.truth, made.frames, made.estimates).report()
        assert report["gospa"] == pytest.approx(total / len(followed))
    assert frames > 400

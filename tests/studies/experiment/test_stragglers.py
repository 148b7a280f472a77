"""Ordinary walking raises no flag, and who falls behind is flagged in time.

The simulator's group walks without being rendered; what is found of it is as uncertain as what
robots find (`docs/suite.md`), and goes straight to those who follow people and groups.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.following.groups import Groups
from mrs_people_loc.following.tracks import Tracker
from mrs_people_loc.people import Person
from mrs_people_sim.scoring.positions import score
from mrs_people_sim.scoring.stragglers import StragglerScores, episodes, score_stragglers
from mrs_people_sim.scoring.tracks import TrackScores, score_tracks
from mrs_tools.bags.records import Estimate, Truth

pytest.importorskip("rosbags.interfaces", reason="the simulator writes bags")

from mrs_people_sim.layouts import expand
from mrs_people_sim.scene import read_scene
from mrs_people_sim.walking.walks import walk_together

pytestmark = pytest.mark.slow

CONFIG = PlannerConfig()
STEP_NS = 100_000_000
#: Of what is found: error [m], share that is missed, and how often [s] somebody is hidden and for
#: how long [s].
SIGMA, MISSED, HIDDEN_EVERY, HIDDEN = 0.04, 0.03, 60.0, 1.0
#: In the beginning everybody is seen for so long [s].
SEEN = 3.0


def walk(seconds: int, *, seed: int, people: int = 6, **section: Any) -> Truth:
    """A group that walks round a hall; where everybody is at 10 Hz."""
    scene = expand(
        read_scene(
            {
                "seed": seed,
                "timing": {"frames": 10 * seconds + 1},
                "room": {"length": 24.0, "width": 14.0},
                "layout": {"people": people, "activity": "group"},
                "walk": {"path": [3, 3, 21, 3, 21, 11, 3, 11], "loop": True, **section},
            },
            "scene.yaml",
        )
    )
    walked = walk_together(scene, {}, {}, float(seconds), np.random.default_rng([seed, 11]))
    times = 0.1 * np.arange(10 * seconds)
    ways = [[walked.people[k].at(t) for k in range(people)] for t in times.tolist()]
    return Truth.build(
        [STEP_NS * k for k in range(len(times))],
        [np.array([(place.x, place.y) for place in places]) for places in ways],
        groups=[walked.groups_at(t) for t in times.tolist()],
    )


def seen_of(shape: tuple[int, int], rng: np.random.Generator) -> NDArray[np.bool_]:
    """Who is found when, shape (steps, people)."""
    steps, people = shape
    seen = rng.random(shape) >= MISSED
    for person in range(people):
        time = rng.exponential(HIDDEN_EVERY)
        while time < steps / 10:
            seen[round(10 * time) : round(10 * (time + HIDDEN)), person] = False
            time += HIDDEN + rng.exponential(HIDDEN_EVERY)
    seen[: round(10 * SEEN)] = True
    return seen


@dataclass(frozen=True)
class Followed:
    """What came out of a walk."""

    truth: Truth
    estimates: list[Estimate]
    events: list[str]
    tracks: TrackScores
    stragglers: StragglerScores


def follow(truth: Truth, *, seed: int) -> Followed:
    """Finds people as robots do, follows them, and scores that."""
    rng = np.random.default_rng(seed)
    steps, people = truth.positions.shape[:2]
    seen = seen_of((steps, people), rng)
    found = truth.positions + rng.normal(0.0, SIGMA, truth.positions.shape)
    tracker, groups = Tracker(CONFIG.tracking), Groups(CONFIG.groups)
    estimates, events = [], []
    for row, now in enumerate(truth.stamps_ns.tolist()):
        persons = [
            Person(
                position=found[row, who],
                covariance=SIGMA**2 * np.eye(2),
                height=1.55 + 0.05 * who,
                sigma=0.1,
                robots=("robot_a",),
                label=who,
                stamp_ns=now,
            )
            for who in rng.permutation(np.flatnonzero(seen[row])).tolist()
        ]
        followed = tracker.step(persons, now)
        gathered, reported = groups.step(followed, now)
        events += [f"{now / 1e9:.1f} s: {line}" for line in reported]
        estimates.append(
            Estimate(
                stamp_ns=now,
                positions=np.array([p.position for p in followed]).reshape(-1, 2),
                covariances=np.array([p.covariance for p in followed]).reshape(-1, 2, 2),
                ids=np.array([p.id for p in followed], dtype=np.int64),
                stragglers=tuple({one for group in gathered for one in group.stragglers}),
            )
        )
    frames = score(truth, estimates)
    return Followed(
        truth,
        estimates,
        events,
        score_tracks(truth, frames, estimates),
        score_stragglers(truth, frames, estimates, config=CONFIG.groups),
    )


def nearest_of(truth: Truth) -> NDArray:
    """How far everybody is from the nearest other one [m], shape (steps, people)."""
    away = np.linalg.norm(truth.positions[:, :, None] - truth.positions[:, None], axis=3)
    who = np.arange(away.shape[1])
    away[:, who, who] = np.inf
    nearest: NDArray = away.min(axis=2)
    return nearest


@pytest.mark.timeout(600)
def test_ten_minutes_of_ordinary_walking_raise_no_flag() -> None:
    truth = walk(600, seed=1)
    # They dawdle, but nobody falls behind.
    speed = np.linalg.norm(np.diff(truth.positions, axis=0), axis=2) / 0.1
    assert ((speed < 0.15).sum(axis=0) >= 5).sum() >= 3
    nearest = nearest_of(truth)
    assert 1.5 < nearest.max() < CONFIG.groups.distance
    out = follow(truth, seed=1)
    figures, tracks = out.stragglers.report(), out.tracks.report()
    print(f"ten minutes: {figures}; nearest other one at most {nearest.max():.2f} m; {tracks}")
    assert figures["minutes"] == pytest.approx(10.0)
    assert (figures["true"], figures["false"]) == (0, 0), out.events
    assert not any(estimate.stragglers for estimate in out.estimates)
    # They keep their ids.
    assert out.tracks.tracks == 6
    assert tracks["id_switches"] == 0
    assert tracks["idf1"] > 0.98


@pytest.mark.parametrize("seed", [1, 2, 3, 4])
def test_straggler_is_flagged_within_a_second(seed: int) -> None:
    out = follow(walk(45, seed=seed, stragglers=1), seed=seed)
    figures = out.stragglers.report()
    print(f"a straggler: {figures}")
    assert figures["true"] >= 1
    assert len(episodes(out.truth, config=CONFIG.groups)) == figures["true"]
    assert figures["flagged"] == figures["true"]
    assert figures["delay_s"]["max"] <= 1.0
    assert figures["false"] == 0, out.events

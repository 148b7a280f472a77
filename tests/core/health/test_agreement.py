import dataclasses
import math

import numpy as np
import pytest

from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.health.agreement import Agreement, AgreementTuning
from mrs_people_loc.scan import Scan
from mrs_people_loc.team.fusion import fuse
from mrs_people_loc.team.poses import Pose

CONFIG = PlannerConfig()
PEOPLE = np.array([(3.0, 3.0), (3.2, 4.1), (4.5, 3.5), (4.1, 2.2), (2.0, 3.8)])
TRUE = {
    "robot_a": Pose(0, 6.0, 3.5, math.pi),
    "robot_b": Pose(0, 0.5, 2.0, 0.4),
    "robot_c": Pose(0, 0.5, 5.0, -0.4),
}
BODY = [(0.05 * i, 0.05 * j) for i in range(-3, 4) for j in range(-1, 2)]


@pytest.fixture(scope="session")
def watch(make_cells):
    """What agreement says of robots that say they stand elsewhere than they do."""

    def run(reported, seen=None, steps=10, noise=0.08, seed=1, agreement=None, **tuning):
        agreement = agreement or Agreement(tuning=AgreementTuning(**tuning))
        random = np.random.default_rng(seed)
        walked = np.zeros(2)
        for _ in range(steps):
            walked = walked + random.normal(0.1, 0.05, 2)
            scans = []
            for name, pose in TRUE.items():
                if name not in reported:
                    continue
                which = slice(None) if seen is None else seen[name]
                c, s = math.cos(pose.yaw), math.sin(pose.yaw)
                places = PEOPLE[which] + walked + random.normal(0, noise, PEOPLE[which].shape)
                here = (places - (pose.x, pose.y)) @ np.array([[c, -s], [s, c]])
                cells = [(x + dx, y + dy) for x, y in here for dx, dy in BODY]
                scans.append(Scan(name, 0, make_cells(cells, top=[1.7] * len(cells))))
            agreement.add(fuse(scans, reported), reported, CONFIG)
        return agreement.misplaced

    return run


def moved(name: str, x: float, y: float, turn: float = 0.0) -> dict[str, Pose]:
    pose = TRUE[name]
    return {**TRUE, name: Pose(0, pose.x + x, pose.y + y, pose.yaw + turn)}


def test_agreeing_robots_give_no_finding(watch):
    assert watch(TRUE) == {}
    assert watch(moved("robot_b", 0.1, -0.1)) == {}  # near enough


@pytest.mark.parametrize(
    ("name", "x", "y", "turn"),
    [
        ("robot_c", 0.6, -0.3, 0.0),
        ("robot_a", 0.0, 0.7, 0.0),
        ("robot_b", 0.0, 0.0, math.radians(12)),
        ("robot_b", -0.4, -0.3, math.radians(-6)),
    ],
)
def test_wrong_pose_is_named_with_its_offset(watch, name, x, y, turn):
    found = watch(moved(name, x, y, turn))
    assert list(found) == [name]
    one = found[name]
    assert one.turn == pytest.approx(-turn, abs=math.radians(2.5))
    np.testing.assert_allclose(one.move, (-x, -y), atol=0.12)
    assert one.agreed < 0.3 < 0.8 < one.would_agree


def test_of_two_robots_both_are_named(watch):
    reported = moved("robot_b", 0.7, 0.0)
    del reported["robot_c"]
    found = watch(reported)
    assert sorted(found) == ["robot_a", "robot_b"]
    np.testing.assert_allclose(found["robot_a"].move, (0.7, 0.0), atol=0.12)
    np.testing.assert_allclose(found["robot_b"].move, (-0.7, 0.0), atol=0.12)


def test_robots_that_see_different_people_do_not_disagree(watch):
    seen = {"robot_a": [0, 1], "robot_b": [2], "robot_c": [3, 4]}
    assert watch(TRUE, seen) == {}


def test_one_person_is_insufficient(watch):
    seen = {name: [0] for name in TRUE}
    assert watch(moved("robot_b", 0.7, 0.0), seen) == {}


def test_too_few_samples_are_insufficient(watch):
    assert watch(moved("robot_c", 0.6, -0.3), steps=7) == {}
    assert Agreement().misplaced == {}


def test_no_people_and_one_robot_give_no_finding(watch):
    assert watch({"robot_a": TRUE["robot_a"]}) == {}
    assert watch(moved("robot_c", 0.6, 0.0), {name: [] for name in TRUE}) == {}


def test_tuning_sets_samples_and_reach(watch):
    reported = moved("robot_c", 0.6, -0.3)
    assert list(watch(reported, steps=7, enough=7)) == ["robot_c"]
    assert watch(reported, reach=0.5) == {}
    assert watch(reported, samples=7) == {}


def test_robot_that_is_gone_is_no_longer_named(watch):
    agreement = Agreement(tuning=AgreementTuning(samples=10, enough=1))
    reported = moved("robot_c", 0.6, -0.3)
    assert list(watch(reported, agreement=agreement)) == ["robot_c"]
    del reported["robot_c"]
    assert list(watch(reported, steps=9, agreement=agreement)) == [
        "robot_c"
    ]  # seen 10 intervals ago
    assert watch(reported, steps=1, agreement=agreement) == {}


# ------------------------------------------------------------------------------------- bodies ----


@pytest.fixture
def watch_bodies(make_cells):
    """Likewise, of robots that send bodies: by robot, places on the map and log-odds."""

    def run(reported, seen):
        agreement = Agreement()
        random = np.random.default_rng(1)
        for _ in range(10):
            scans = []
            for name, pose in TRUE.items():
                x, y, score = np.array(seen(name, random), dtype=float).reshape(-1, 3).T
                c, s = math.cos(pose.yaw), math.sin(pose.yaw)
                here = np.stack([x - pose.x, y - pose.y], axis=1) @ np.array([[c, -s], [s, c]])
                one = np.ones(len(x), dtype=np.float32)
                cells = dataclasses.replace(
                    make_cells(here + random.normal(0, 0.03, here.shape)),
                    body=np.arange(1, len(x) + 1, dtype=np.uint32),
                    score=score.astype(np.float32),
                    sigma_range=0.1 * one,
                    sigma_across=0.05 * one,
                )
                scans.append(Scan(name, 0, cells))
            agreement.add(fuse(scans, reported), reported, CONFIG)
        return agreement.misplaced

    return run


def test_what_is_no_person_does_not_count(watch_bodies):
    """Beside each two people are four things, each time elsewhere."""

    def seen(name, random):
        things = random.uniform((-9.0, 9.0), (-5.0, 13.0), (4, 2))
        return [*((x, y, 2.0) for x, y in PEOPLE[:2]), *((x, y, -1.0) for x, y in things)]

    assert watch_bodies(TRUE, seen) == {}
    found = watch_bodies(moved("robot_c", 0.6, -0.3), seen)
    assert list(found) == ["robot_c"]
    assert found["robot_c"].would_agree == 1.0


def test_robots_that_see_each_other_are_no_people(watch_bodies):
    """One person fits anywhere; with the robots beside them they would be three."""

    def seen(name, random):
        others = [(pose.x, pose.y, 2.0) for other, pose in TRUE.items() if other != name]
        return [(*PEOPLE[0], 2.0), *others]

    assert watch_bodies(moved("robot_b", 0.7, 0.0), seen) == {}

import dataclasses
import math

import numpy as np
import pytest

from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.localization.people.seen_people import people_by_robot, people_in
from mrs_people_loc.people import Person
from mrs_people_loc.scan import Cells, Scan
from mrs_people_loc.team.fusion import fuse
from mrs_people_loc.team.intervals import Closed
from mrs_people_loc.team.poses import Pose

CONFIG = PlannerConfig()
#: a looks along the map's x axis, b, 8 m ahead, back; both are unsure of where they are.
UNSURE = np.diag([0.5, 0.5, 0.1])
POSES = {"a": Pose(0, 1.0, 2.0, 0.0, UNSURE), "b": Pose(0, 9.0, 2.0, math.pi, UNSURE)}


@pytest.fixture
def bodies(make_cells):
    """Cells of bodies at x, y with log-odds, one cell each: 0.1 m along, 0.05 m across."""

    def make(rows):
        x, y, score = np.array(rows, dtype=float).reshape(-1, 3).T
        one = np.ones(len(x), dtype=np.float32)
        return dataclasses.replace(
            make_cells(np.stack([x, y], axis=1)),
            body=np.arange(1, len(x) + 1, dtype=np.uint32),
            score=score.astype(np.float32),
            sigma_range=0.1 * one,
            sigma_across=0.05 * one,
        )

    return make


def seen(scans, poses=POSES):
    return people_by_robot(fuse(scans, poses), poses, CONFIG)


def test_places_and_covariances_are_the_robots_own(bodies):
    """At 3 m ahead, and 2 m to the left: along and across the line of sight, no pose in it."""
    found = seen([Scan("b", 70, bodies([(3.0, 0.0, 3.0), (0.0, 2.0, 3.0)]))])
    assert list(found) == ["b"]
    assert found["b"].stamp_ns == 70
    np.testing.assert_allclose(found["b"].xy, [(3.0, 0.0), (0.0, 2.0)], atol=1e-6)
    np.testing.assert_allclose(
        found["b"].covariance, [np.diag([0.01, 0.0025]), np.diag([0.0025, 0.01])], atol=1e-6
    )


def test_each_robot_has_its_own(bodies):
    scans = [Scan("a", 1, bodies([(3.0, 0.0, 3.0)])), Scan("b", 2, bodies([(4.0, 1.0, 3.0)]))]
    found = seen(scans)
    np.testing.assert_allclose(found["a"].xy, [(3.0, 0.0)], atol=1e-6)
    np.testing.assert_allclose(found["b"].xy, [(4.0, 1.0)], atol=1e-6)
    assert (found["a"].stamp_ns, found["b"].stamp_ns) == (1, 2)


def test_unlikely_bodies_and_robots_are_left_out(bodies):
    exact = {
        name: dataclasses.replace(pose, covariance=np.zeros((3, 3))) for name, pose in POSES.items()
    }
    rows = [(3.0, 0.0, 3.0), (4.0, 1.0, -1.0), (8.0, 0.0, 2.0)]  # the last is b
    found = seen([Scan("a", 0, bodies(rows)), Scan("b", 0, Cells.empty())], exact)
    np.testing.assert_allclose(found["a"].xy, [(3.0, 0.0)], atol=1e-6)
    assert found["b"].xy.shape == (0, 2)
    assert found["b"].covariance.shape == (0, 2, 2)


def test_human_clusters_of_plain_cells(make_cells):
    """A block of cells 0.30 m wide, 0.10 m deep is a person; a single cell is none."""
    body = [(3.0 + 0.05 * i, 1.0 + 0.05 * j) for i in range(3) for j in range(7)]
    cells = make_cells([*body, (5.0, -2.0)], top=1.7)
    found = seen([Scan("a", 0, cells)])
    np.testing.assert_allclose(found["a"].xy, [(3.05, 1.15)], atol=1e-4)
    # Variances of three and of seven equally spaced places.
    np.testing.assert_allclose(
        found["a"].covariance, [np.diag([0.0025 * 2 / 3, 0.0025 * 4.0])], rtol=0.01, atol=1e-6
    )


def test_nothing_is_seen():
    assert people_by_robot(fuse([], {}), {}, CONFIG) == {}
    assert len(seen([Scan("a", 0, Cells.empty())])["a"].xy) == 0


def test_who_is_known_to_walk_does_not_stand(bodies, person):
    """Of four, in the map at x = 1, 2, 3, 4 m beside a: the second walks."""
    rows = [(1.0, 0.0, 3.0), (2.0, 0.0, 3.0), (3.0, 0.0, 3.0), (4.0, 0.0, 3.0)]
    scans = [Scan("a", 0, bodies(rows))]
    fused = fuse(scans, POSES)

    def stands(*persons):
        return people_by_robot(fused, POSES, CONFIG, persons)["a"].stands.tolist()

    assert stands() == [True] * 4
    walking = person((3.1, 2.2), (0.0, 0.9))
    assert stands(walking) == [True, False, True, True]
    # Nobody knows how fast; too slow; not sure enough; somebody else.
    for other in (
        person((3.1, 2.2), None),
        person((3.1, 2.2), (0.1, 0.1)),
        person((3.1, 2.2), (0.3, 0.0), 0.2),
        person((3.0, 3.0), (0.9, 0.0)),
    ):
        assert stands(other) == [True] * 4
    assert stands(person((3.1, 2.2), (0.5, 0.0), 0.2)) == [True, False, True, True]


@pytest.fixture
def person():
    """Somebody who is followed: place, velocity and its standard deviation."""

    def make(place, velocity, sigma=0.05):
        one = Person(np.array(place), 0.01 * np.eye(2), 1.7, 0.1, ("a",), -1)
        if velocity is None:
            return one
        sure = sigma**2 * np.eye(2)
        return dataclasses.replace(one, velocity=np.array(velocity), velocity_covariance=sure)

    return make


def test_unlikely_bodies_and_robots_are_others(bodies):
    exact = {
        name: dataclasses.replace(pose, covariance=np.zeros((3, 3))) for name, pose in POSES.items()
    }
    rows = [(3.0, 0.0, 3.0), (4.0, 1.0, -1.0), (8.0, 0.0, 2.0)]  # the last is b
    found = seen([Scan("a", 0, bodies(rows)), Scan("b", 0, Cells.empty())], exact)
    np.testing.assert_allclose(found["a"].others, [(4.0, 1.0), (8.0, 0.0)], atol=1e-6)
    np.testing.assert_allclose(found["a"].others_covariance[1], np.diag([0.01, 0.0025]), atol=1e-6)
    assert found["b"].others.shape == (0, 2)
    assert found["b"].others_covariance.shape == (0, 2, 2)


def test_whether_those_stand_whom_a_robot_in_quarantine_sees_is_not_known(bodies, person):
    scan = Scan("b", 0, bodies([(2.0, 0.0, 3.0)]))
    closed = Closed(
        scans=(Scan("a", 0, bodies([(2.0, 0.0, 3.0)])),), poses={"a": POSES["a"]}, time_ns=0,
        left_out={}, others={}, quarantined=("b",), apart=(scan,), apart_poses={"b": POSES["b"]},
    )  # fmt: skip
    found = people_in(closed, (), CONFIG)
    assert found["a"].stands.tolist() == [True]
    np.testing.assert_allclose(found["b"].xy, [(2.0, 0.0)], atol=1e-6)
    assert found["b"].stands.shape == (0,)

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc import config as cfg
from mrs_people_loc.cells.human import is_human, locate
from mrs_people_loc.clusters import Clusters, measure
from mrs_people_loc.people import Detections, Person, combine, gather
from mrs_people_loc.scan import Cells
from mrs_people_loc.team.fusion import ShortTermMap
from mrs_people_loc.team.poses import Pose

EXACT = Pose(0, 0.0, 0.0, 0.0)


@pytest.fixture(scope="session")
def make_map(make_cells):
    """A map of cells that lie where their robots say; `robot` is the index of each one's robot."""

    def make(xy, robot=0, robots=("robot_a",), **fields) -> ShortTermMap:
        xy = np.array(xy, dtype=float).reshape(-1, 2)
        cells = make_cells(xy, **fields)
        return ShortTermMap(robots, np.full(len(xy), robot), xy, cells, (0,) * len(robots))

    return make


def only(clusters: Clusters) -> dict:
    """The measures of the only cluster."""
    assert len(clusters) == 1
    values = {f.name: getattr(clusters, f.name) for f in dataclasses.fields(clusters)}
    return {name: value[0] for name, value in values.items() if name != "label"}


# ---------------------------------------------------------------------------- measures ----


def test_row_of_three_cells_matches_hand_computed_values(make_map):
    fused = make_map(
        [(1, 5), (3, 5), (5, 5)], z_min=[0.4, 0.2, 0.3], top=[1.5, 1.7, 1.6], count=[10, 20, 30]
    )
    one = only(measure(fused, np.array([0, 0, 0])))
    np.testing.assert_allclose(one["centroid"], [3, 5])
    np.testing.assert_allclose(one["scatter"], [[8 / 3, 0], [0, 0]])
    # Distances from the centroid: 2, 0, 2. Mean 4/3, mean of squares 8/3.
    assert one["sigma"] == pytest.approx(math.sqrt(8 / 3 - (4 / 3) ** 2))
    assert one["width"] == pytest.approx(4.0)
    assert one["depth"] == pytest.approx(0.0)
    assert one["height"] == pytest.approx(1.7)
    assert one["bottom"] == pytest.approx(0.2)
    assert one["cells"] == 3
    assert one["points"] == 60


@pytest.mark.parametrize("angle", [0.0, 0.3, 0.7, 1.5, 2.0, 3.0])
def test_width_and_depth_lie_along_the_principal_axes(make_map, angle):
    grid = np.array([(x, y) for x in (-0.3, -0.1, 0.1, 0.3) for y in (-0.1, 0.1)])
    c, s = math.cos(angle), math.sin(angle)
    turned = grid @ np.array([[c, s], [-s, c]]) + (4, -2)
    one = only(measure(make_map(turned), np.zeros(8, dtype=int)))
    assert one["width"] == pytest.approx(0.6)
    assert one["depth"] == pytest.approx(0.2)
    np.testing.assert_allclose(one["centroid"], (4, -2))


def test_cluster_of_one_cell_is_measured(make_map):
    one = only(measure(make_map([(1, 2)]), np.array([0])))
    assert (one["sigma"], one["width"], one["depth"]) == (0.0, 0.0, 0.0)
    np.testing.assert_array_equal(one["scatter"], np.zeros((2, 2)))
    np.testing.assert_array_equal(one["centroid"], (1, 2))


def test_no_cells_give_no_clusters(make_map):
    clusters = measure(make_map([]), np.empty(0, dtype=np.intp))
    assert len(clusters) == 0
    assert clusters.centroid.shape == (0, 2)
    assert clusters.scatter.shape == (0, 2, 2)
    assert clusters.seen_by.shape == (0, 1)
    human = is_human(clusters, cfg.Human())
    assert human.shape == (0,)
    assert locate(make_map([]), clusters, human, {"robot_a": EXACT}) == ()


def test_cluster_lists_its_robots(make_map):
    fused = make_map(
        [(0, 0), (0, 0), (9, 0), (9, 0)],
        robot=[0, 2, 2, 2],
        robots=("robot_a", "robot_b", "robot_c"),
    )
    clusters = measure(fused, np.array([0, 0, 1, 1]))
    np.testing.assert_array_equal(clusters.seen_by, [[1, 0, 1], [0, 0, 1]])


def test_many_points_do_not_overflow(make_map):
    fused = make_map([(0, 0)] * 3, count=2**32 - 1)
    assert only(measure(fused, np.zeros(3, dtype=int)))["points"] == 3 * (2**32 - 1)


def measures_by_loop(xy: np.ndarray, cells: Cells) -> dict:
    """One cluster's measures, from their words."""
    n = len(xy)
    centroid = xy.sum(axis=0) / n
    distances = [math.dist(p, centroid) for p in xy]
    mean = sum(distances) / n
    scatter = sum(np.outer(p - centroid, p - centroid) for p in xy) / n
    return {
        "centroid": centroid,
        "scatter": scatter,
        "sigma": math.sqrt(sum((d - mean) ** 2 for d in distances) / n),
        "height": max(cells.top),
        "bottom": min(cells.z_min),
        "cells": n,
        "points": sum(int(c) for c in cells.count),
    }


@given(st.lists(st.integers(0, 4), min_size=1, max_size=40), st.integers(0, 99))
def test_measures_equal_a_plain_loop(make_map, drawn, seed):
    _, label = np.unique(drawn, return_inverse=True)  # from 0 without gaps
    n, rng = len(label), np.random.default_rng(seed)
    fields = {
        "top": rng.uniform(1, 2, n),
        "z_min": rng.uniform(0, 1, n),
        "count": rng.integers(1, 99, n),
    }
    fused = make_map(rng.uniform(-3, 3, (n, 2)), **fields)
    clusters = measure(fused, label)
    np.testing.assert_array_equal(clusters.label, label)
    for i in range(len(clusters)):
        mine = label == i
        cells = fused.cells.select(mine)
        for name, value in measures_by_loop(fused.xy[mine], cells).items():
            np.testing.assert_allclose(getattr(clusters, name)[i], value, atol=1e-9, err_msg=name)
        # Extents along the eigenvectors of the scatter.
        offsets = fused.xy[mine] - clusters.centroid[i]
        values, vectors = np.linalg.eigh(clusters.scatter[i])
        if values[1] - values[0] > 1e-6:
            depth, width = np.ptp(offsets @ vectors, axis=0)
            assert clusters.width[i] == pytest.approx(width, abs=1e-6)
            assert clusters.depth[i] == pytest.approx(depth, abs=1e-6)


# -------------------------------------------------------------------------- human size ----

LIMITS = cfg.Human(
    min_height=1.25, max_height=2.25, min_width=0.25, max_width=1.25, max_depth=0.75, min_points=150
)
PERSON = {"height": 1.75, "width": 0.5, "depth": 0.25, "points": 300}


@pytest.mark.parametrize(
    ("change", "human"),
    [
        ({}, True),
        ({"height": 1.25}, True),  # limits are inclusive
        ({"height": 1.249}, False),
        ({"height": 2.25}, True),
        ({"height": 2.251}, False),
        ({"width": 0.25}, True),
        ({"width": 0.249}, False),
        ({"width": 1.25}, True),
        ({"width": 1.251}, False),
        ({"depth": 0.0}, True),
        ({"depth": 0.75}, True),
        ({"depth": 0.751}, False),
        ({"points": 150}, True),
        ({"points": 149}, False),
    ],
)
def test_limits_of_human_size_are_inclusive(make_map, change, human):
    some = measure(make_map([(0, 0), (9, 9)]), np.array([0, 1]))
    values = {name: np.array([value, 0.0]) for name, value in (PERSON | change).items()}
    assert is_human(dataclasses.replace(some, **values), LIMITS).tolist() == [human, False]


def test_papers_furniture_and_fragments_are_not_people(make_map):
    body = [(0.05 * i, 0.05 * j) for i in range(6) for j in range(3)]
    for fields, human in (
        ({}, True),
        ({"top": 1.0, "z": 0.95}, False),  # a table on its edge
        ({"count": 8}, False),  # a fragment
    ):
        clusters = measure(make_map(body, **fields), np.zeros(18, dtype=int))
        assert is_human(clusters, cfg.Human()).tolist() == [human]
    wall = [(0.05 * i, 0.0) for i in range(30)]
    assert not is_human(measure(make_map(wall), np.zeros(30, dtype=int)), cfg.Human()).any()


# ----------------------------------------------------------------------------- people ----


def test_person_matches_hand_computed_values(make_map):
    fused = make_map(
        [(9, 9), (3, 4), (5, 4)],
        robot=[0, 0, 1],
        robots=("robot_a", "robot_b", "robot_c"),
        top=[1.1, 1.6, 1.7],
    )
    clusters = measure(fused, np.array([1, 0, 0]))
    poses = {
        "robot_a": Pose(0, 0.0, 0.0, 0.0, np.diag([0.1, 0.2, 0.0])),
        "robot_b": Pose(0, 4.0, 1.0, 2.0, np.diag([0.0, 0.0, 0.01])),
        "robot_c": Pose(0, 0.0, 0.0, 0.0, np.eye(3)),
    }
    (person,) = locate(fused, clusters, np.array([True, False]), poses)
    np.testing.assert_allclose(person.position, (4, 4))
    assert person.robots == ("robot_a", "robot_b")
    assert person.height == pytest.approx(1.7)
    assert person.label == 0
    assert person.sigma == pytest.approx(0.0)  # both cells are 1 m from the centre
    # Scatter of the cells: 1 m^2 along x. The poses: 0.1 and 0.2 of robot_a; robot_b, 3 m away in
    # y, turns by 0.1 rad: 0.3 m along x. Half the sum of both, and all of it shared by two robots.
    expected = (np.diag([1.0, 0.0]) + np.diag([0.1 + 0.09, 0.2]) / 2) / 2
    np.testing.assert_allclose(person.covariance, expected, atol=1e-12)


def test_uncertain_heading_adds_covariance_across_the_line_of_sight(make_map):
    fused = make_map([(3.0, 0.0)])
    pose = Pose(0, 1.0, 0.0, 0.5, np.diag([0.0, 0.0, 0.01]))
    clusters = measure(fused, np.array([0]))
    (person,) = locate(fused, clusters, np.array([True]), {"robot_a": pose})
    np.testing.assert_allclose(person.covariance, np.diag([0, 2.0**2 * 0.01]), atol=1e-15)
    # Correlated errors may cancel: x and y with the heading.
    covariance = np.array([[0.04, 0, 0.02], [0, 0.04, -0.02], [0.02, -0.02, 0.01]])
    for place, expected in (((1, 2), [[0, 0], [0, 0.04]]), ((3, 0), [[0.04, 0], [0, 0]])):
        fused = make_map([place])
        pose = Pose(0, 1.0, 0.0, 0.5, covariance)
        (person,) = locate(
            fused, measure(fused, np.array([0])), np.array([True]), {"robot_a": pose}
        )
        np.testing.assert_allclose(np.diag(person.covariance), np.diag(expected), atol=1e-15)


def test_covariance_of_a_person_is_that_of_its_robots(make_map):
    fused = make_map([(3, 0), (3, 0), (6, 0)], robot=[0, 1, 1], robots=("robot_a", "robot_b"))
    clusters = measure(fused, np.array([0, 0, 1]))
    poses = {
        "robot_a": Pose(0, 0.0, 0.0, 0.0, np.diag([0.1, 0.0, 0.0])),
        "robot_b": Pose(0, 0.0, 0.0, 0.0, np.diag([0.0, 0.2, 0.0])),
    }
    near, far = locate(fused, clusters, np.array([True, True]), poses)
    assert (near.robots, far.robots) == (("robot_a", "robot_b"), ("robot_b",))
    np.testing.assert_allclose(near.covariance, np.diag([0.1, 0.2]) / 4)
    np.testing.assert_allclose(far.covariance, np.diag([0.0, 0.2]))


def test_people_are_clusters_of_human_size(make_map):
    fused = make_map([(0, 0), (1, 0), (2, 0), (3, 0)])
    clusters = measure(fused, np.arange(4))
    people = locate(fused, clusters, np.array([0, 1, 0, 1], dtype=bool), {"robot_a": EXACT})
    assert [person.label for person in people] == [1, 3]
    assert [person.position.tolist() for person in people] == [[1, 0], [3, 0]]


# ------------------------------------------------------------------------------ group ----


def person_at(x: float, y: float, covariance=(0.0, 0.0)) -> Person:
    return Person(np.array([x, y]), np.diag(covariance), 1.7, 0.1, ("robot_a",), 0)


def test_no_people_form_no_group():
    assert gather(()) is None


def test_group_matches_hand_computed_values():
    group = gather(
        (person_at(0, 0, (0.1, 0)), person_at(6, 0, (0.2, 0)), person_at(0, 3, (0, 0.9)))
    )
    assert group is not None
    np.testing.assert_allclose(group.centre, (2, 1))
    np.testing.assert_allclose(group.covariance, np.diag([0.3 / 9, 0.9 / 9]))
    # Squared distances from the centre: 5, 17, 8.
    assert group.radius == pytest.approx(math.sqrt(17))
    assert group.rms_spread == pytest.approx(math.sqrt(10))
    assert group.size == 3


def test_one_person_is_a_group():
    group = gather((person_at(3, 4, (0.5, 0.25)),))
    assert group is not None
    np.testing.assert_array_equal(group.centre, (3, 4))
    np.testing.assert_array_equal(group.covariance, np.diag([0.5, 0.25]))
    assert (group.radius, group.rms_spread, group.size) == (0.0, 0.0, 1)


def test_person_of_two_detectors_is_the_preferred_one(make_map):
    fused = make_map([(0.0, 0.0), (3.0, 0.0), (0.3, 0.0), (6.0, 0.0)])

    def detected(cells, *places) -> Detections:
        people = tuple(
            dataclasses.replace(person_at(*place), label=k) for k, place in enumerate(places)
        )
        cells = np.array(cells)
        return Detections(cells, measure(fused, np.arange(len(cells)), cells), people)

    of_cells = detected([0, 1], (0.0, 0.0), (3.0, 0.0))
    of_bodies = detected([2, 3], (0.3, 0.0), (6.0, 0.0))
    both = combine(of_cells, of_bodies, min_distance=0.36)
    assert both.cells.tolist() == both.clusters.label.tolist() == [0, 1, 2, 3]
    assert [(p.position[0], p.label) for p in both.persons] == [(0.3, 2), (6.0, 3), (3.0, 1)]
    assert len(combine(of_cells, of_bodies, min_distance=0.3).persons) == 4  # exactly 0.3 is apart
    nothing = Detections.nothing(fused)
    assert combine(nothing, of_bodies, min_distance=0.36) is of_bodies
    assert combine(of_cells, nothing, min_distance=0.36) is of_cells


def test_clusters_of_two_detectors_keep_their_cells(make_map):
    """Cells of bodies may lie between the others: 0 and 2 are plain, 1 and 3 one body's."""
    fused = make_map([(0.0, 0.0), (3.0, 0.0), (6.0, 0.0), (4.0, 0.0)])

    def detected(cells, label, too_wide) -> Detections:
        cells, label = np.array(cells), np.array(label)
        return Detections(cells, measure(fused, label, cells), (), too_wide)

    both = combine(detected([0, 2], [0, 1], 2), detected([1, 3], [0, 0], 3), min_distance=0.3)
    assert both.cells.tolist() == [0, 1, 2, 3]
    assert both.clusters.label.tolist() == [0, 2, 1, 2]
    assert both.clusters.centroid[:, 0].tolist() == [0.0, 6.0, 3.5]
    assert both.too_wide == 5

import dataclasses
import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc import config as cfg
from mrs_people_loc.cells.clustering import cluster
from mrs_people_loc.cells.splitting import SplittingTuning, split
from mrs_people_loc.planner import Planner
from mrs_people_loc.scan import Cells, Scan
from mrs_people_loc.team.fusion import fuse
from mrs_people_loc.team.poses import Pose

HUMAN = cfg.Human()
ORIGIN = {"a": Pose(0, 0.0, 0.0, 0.0)}


def body(x: float, y: float, width: float = 0.45, depth: float = 0.2) -> list[tuple[float, float]]:
    """Cells of a body, 5 cm apart: y is across the sight of who looks along x."""
    across = np.arange(-width / 2 + 0.025, width / 2, 0.05)
    along = np.arange(-depth / 2 + 0.025, depth / 2, 0.05)
    return [(x + dx, y + dy) for dx in along for dy in across]


def parts_of(make_cells, places, *, poses=ORIGIN, max_width=0.75, **fields):
    """Parts of each cell of a scan of robot a, and how many clusters stayed whole."""
    fused = fuse([Scan("a", 0, make_cells(places, **{"count": 20, **fields}))], poses)
    label = cluster(fused.xy, distance=0.15)
    everything = np.arange(len(fused))
    config = cfg.Splitting(max_width=max_width)
    return split(fused, everything, label, poses, config, HUMAN)


def centres(places, label) -> list[tuple[float, float]]:
    """Centres of the parts, to the centimetre, sorted."""
    xy = np.array(places)
    means = [xy[label == k].mean(axis=0) for k in range(label.max() + 1)]
    return sorted((round(float(x), 2), round(float(y), 2)) for x, y in means)


def test_one_body_stays_whole(make_cells):
    label, whole = parts_of(make_cells, body(2.0, 0.0, width=0.7, depth=0.5))
    assert label.tolist() == [0] * len(label)
    assert whole == 0


def test_people_shoulder_to_shoulder_are_split(make_cells):
    places = body(2.0, -0.25, 0.5) + body(2.0, 0.25, 0.5)
    label, whole = parts_of(make_cells, places)
    assert centres(places, label) == [(2.0, -0.25), (2.0, 0.25)]
    assert label[0] == 0  # the first part keeps the cluster's number
    assert whole == 0
    label, whole = parts_of(make_cells, places, max_width=0.0)
    assert label.tolist() == [0] * len(places)
    label, _ = parts_of(make_cells, places, max_width=1.0)
    assert label.tolist() == [0] * len(places)


def test_people_behind_each_other_are_split(make_cells):
    # 1.5 m away ranges are sure: 0.6 m behind each other and joined by cells between them.
    between = [(1.5 + 0.05 * k, 0.0) for k in range(1, 12)]
    places = body(1.5, 0.0, depth=0.3) + body(2.1, 0.0, depth=0.3) + between
    label, _ = parts_of(make_cells, places)
    (near, _), (far, _) = centres(places, label)
    assert near == pytest.approx(1.5, abs=0.08)
    assert far == pytest.approx(2.1, abs=0.08)


def test_range_errors_do_not_split_a_person(make_cells):
    # One body 4 m away, smeared over 1 m along the line of sight; the same across it is two.
    assert parts_of(make_cells, body(4.0, 0.0, width=0.45, depth=1.0))[0].max() == 0
    assert parts_of(make_cells, body(4.0, 0.0, width=1.0, depth=0.45))[0].max() == 1
    # The robot's heading on the map does not matter.
    turned = {"a": Pose(0, 4.0, -4.0, math.pi / 2)}
    smeared = body(4.0, 0.0, width=0.45, depth=1.0)
    assert parts_of(make_cells, smeared, poses=turned)[0].max() == 0


@pytest.mark.parametrize(("range_sigma", "clusters"), [(0.25 / 10.5, 1), (0.001, 2)])
def test_range_error_of_cells_is_a_parameter(make_cells, range_sigma, clusters):
    config = cfg.PlannerConfig.from_mapping({"masking.cell_range_sigma": range_sigma})
    scan = Scan("a", 0, make_cells(body(4.0, 0.0, width=0.45, depth=1.0), count=20))
    assert len(Planner(config).step([scan], ORIGIN, 0).clusters) == clusters


def test_number_of_split_people_is_bounded_by_the_tuning(make_cells):
    places = [cell for k in range(3) for cell in body(2.0, 0.5 * k, 0.5)]
    fused = fuse([Scan("a", 0, make_cells(places, count=20))], ORIGIN)
    everything, one = np.arange(len(fused)), np.zeros(len(fused), dtype=np.intp)
    for most, wanted in ((3, (3, 0)), (2, (1, 1))):
        tuning = SplittingTuning(most_people=most)
        config = cfg.Splitting()
        label, whole = split(fused, everything, one, ORIGIN, config, HUMAN, tuning=tuning)
        assert (label.max() + 1, whole) == wanted


def test_five_people_in_a_row_of_unequal_distances_are_split(make_cells):
    true = [(2.0, 0.9), (2.3, 0.5), (2.8, 0.0), (2.5, -0.45), (2.1, -0.9)]
    bridges = [
        (a[0] + (b[0] - a[0]) * t, a[1] + (b[1] - a[1]) * t)
        for a, b in itertools.pairwise(true)
        for t in np.linspace(0, 1, 12)
    ]
    places = [cell for x, y in true for cell in body(x, y, width=0.4)] + bridges
    # Points fall with the square of the range; that does not pull the parts to the near.
    count = [round(400 / (x * x)) for x, _ in places]
    label, _ = parts_of(make_cells, places, count=count)
    np.testing.assert_allclose(centres(places, label), sorted(true), atol=0.1)


@pytest.mark.parametrize(
    "fields",
    [
        {"count": 1},  # hardly seen
        {"top": 0.9},  # a table
        {"top": 2.5},  # a wall
    ],
)
def test_clusters_unlike_people_are_not_split(make_cells, fields):
    places = body(2.0, 0.0, width=1.4)
    label, whole = parts_of(make_cells, places, **fields)
    assert label.max() == 0
    assert whole == 0


def test_person_at_a_table_stays_whole_and_is_counted(make_cells):
    places = body(2.0, 0.0) + body(2.0, 0.6, width=0.75)
    top = [1.7] * len(body(2.0, 0.0)) + [0.8] * len(body(2.0, 0.6, width=0.75))
    label, whole = parts_of(make_cells, places, top=top)
    assert label.max() == 0
    assert whole == 1


def test_much_too_wide_cluster_stays_whole_and_is_counted(make_cells):
    label, whole = parts_of(make_cells, body(3.0, 0.0, width=9.0))
    assert label.max() == 0
    assert whole == 1


def test_several_and_no_clusters_are_handled(make_cells):
    two = body(2.0, -0.25, 0.5) + body(2.0, 0.25, 0.5)
    places = [*body(2.0, 2.0), *two, *[(x + 1.5, y) for x, y in two]]
    label, _ = parts_of(make_cells, places)
    assert sorted(set(label)) == [0, 1, 2, 3, 4]
    assert len(set(label[: len(body(2.0, 2.0))])) == 1
    label, whole = parts_of(make_cells, [])
    assert (label.shape, whole) == ((0,), 0)


@given(st.integers(0, 10**6))
def test_parts_of_random_cells_respect_all_limits(seed):
    """Parts have no gaps, never unite two clusters, and are not wider than allowed."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 150))
    xy = rng.uniform(0.5, 4.0, (n, 2)).astype(np.float32)
    one = np.ones(n, dtype=np.float32)
    cells = Cells(
        x=xy[:, 0].copy(), y=xy[:, 1].copy(), z=one, z_min=0 * one,
        top=rng.uniform(1.0, 2.3, n).astype(np.float32),
        count=rng.integers(0, 60, n).astype(np.uint32),
    )  # fmt: skip
    fused = fuse([Scan("a", 0, cells)], ORIGIN)
    before = cluster(fused.xy, distance=0.3)
    everything = np.arange(n)
    label, whole = split(fused, everything, before, ORIGIN, cfg.Splitting(), HUMAN)
    assert sorted(set(label)) == list(range(label.max() + 1))
    for part in range(label.max() + 1):
        assert len(set(before[label == part])) == 1
    assert 0 <= whole <= before.max() + 1
    # What was split is not split again, and what stayed whole stays so.
    again, whole_again = split(fused, everything, label, ORIGIN, cfg.Splitting(), HUMAN)
    np.testing.assert_array_equal(again, label)
    assert whole_again == whole


def test_touching_people_as_cells_are_found_as_two_people(make_cells):
    scan = Scan("a", 0, make_cells(body(2.0, -0.25, 0.5) + body(2.0, 0.25, 0.5), count=20))
    planner = Planner(cfg.PlannerConfig())
    result = planner.step([scan], ORIGIN, 0)
    found = sorted(tuple(person.position.round(2)) for person in result.persons)
    assert found == [(2.0, -0.25), (2.0, 0.25)]
    assert result.too_wide == 0
    whole = dataclasses.replace(planner.config, splitting=cfg.Splitting(max_width=0.0))
    assert len(Planner(whole).step([scan], ORIGIN, 0).persons) == 1
    wall = Scan("a", 0, make_cells(body(3.0, 0.0, width=9.0), count=20))
    assert planner.step([wall], ORIGIN, 0).too_wide == 1

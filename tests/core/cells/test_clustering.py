import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.cells.clustering import cluster
from oracle.clusters import clusters_of

CELL = 0.05


def labels(points, distance=0.15) -> list[int]:
    return cluster(np.array(points, dtype=float).reshape(-1, 2), distance=distance).tolist()


@pytest.mark.parametrize(
    ("points", "expected"),
    [
        ([], []),
        ([(3, 4)], [0]),
        ([(0, 0), (0.14, 0)], [0, 0]),
        ([(0, 0), (0.15, 0)], [0, 0]),  # d <= d_th
        ([(0, 0), (0.1501, 0)], [0, 1]),
        ([(0, 0), (0, 0.15)], [0, 0]),
        ([(0, 0), (0.09, 0.12)], [0, 0]),  # 3-4-5: 0.15 m along a diagonal
        ([(0, 0), (0.12, 0.12)], [0, 1]),  # near along each axis, not on the plane
        ([(0, 0), (0, 0), (5, 5)], [0, 0, 1]),
        # Eq. 8: two free points; eq. 9: a third joins; eq. 10: two clusters become one.
        ([(0, 0), (0.1, 0), (0.2, 0)], [0, 0, 0]),
        ([(0, 0), (0.1, 0), (0.4, 0), (0.3, 0)], [0, 0, 1, 1]),
        ([(0, 0), (0.1, 0), (0.4, 0), (0.3, 0), (0.2, 0)], [0, 0, 0, 0, 0]),
        # A chain is one cluster however long it is.
        ([(0.15 * i, 0) for i in range(100)], [0] * 100),
        # Numbered by the least point: x, then y.
        ([(2, 0), (1, 5), (1, -5), (0, 9)], [3, 2, 1, 0]),
        ([(2, 0), (0, 0), (2.1, 0), (0.1, 0)], [1, 0, 1, 0]),
    ],
)
def test_clusters_match_hand_computed_values(points, expected):
    assert labels(points) == expected


@pytest.mark.parametrize("distance", [0.05, 0.15, 0.5, 2.0])
@pytest.mark.parametrize("yaw", [0.0, 0.3, 2.0])
def test_distance_is_inclusive_also_in_float32(distance, yaw):
    # Cell centres up to 100 m from their robot, rounded to float32, then turned and moved.
    x = np.arange(distance / 2, 100, distance).astype(np.float32).astype(float)
    points = np.stack([5 + x * np.cos(yaw), -3 + x * np.sin(yaw)], axis=1)
    assert cluster(points, distance=distance).max() == 0
    assert cluster(points, distance=distance - 1e-4).max() == len(x) - 1


cells = st.lists(st.tuples(st.integers(-8, 8), st.integers(-8, 8)), max_size=40)


@given(cells, st.integers(1, 5))
def test_clusters_of_cells_equal_brute_force(points, distance):
    # On a grid of 5 cm many pairs are exactly the distance apart.
    xy = np.array(points, dtype=np.float32).reshape(-1, 2) * np.float32(CELL)
    got = cluster(xy.astype(float), distance=distance * CELL)
    assert got.tolist() == clusters_of(points, distance)


@given(st.lists(st.tuples(st.integers(-500, 500), st.integers(-500, 500)), max_size=40))
def test_clusters_of_points_equal_brute_force(points):
    assert labels(np.array(points) / 1000) == clusters_of(points, 150)


@given(cells, st.randoms(use_true_random=False))
def test_clusters_are_independent_of_the_order(points, random):
    xy = np.array(points, dtype=float).reshape(-1, 2) * CELL
    order = np.array(random.sample(range(len(points)), len(points)), dtype=int)
    shuffled, ordered = (cluster(p, distance=0.15) for p in (xy[order], xy))
    np.testing.assert_array_equal(shuffled, ordered[order])


def test_labels_are_indices():
    for points in ([], [(0, 0)], [(0, 0), (1, 1)]):
        assert cluster(np.array(points, dtype=float).reshape(-1, 2), distance=0.15).dtype == np.intp


@pytest.mark.parametrize("far", [(1e5, 0.0), (-1e8, -1e8), (0.0, -1e20), (1e20, 1e20)])
def test_distant_point_does_not_change_other_clusters(far):
    xy = np.random.default_rng(3).uniform(0, 4, (400, 2))
    alone = cluster(xy, distance=0.15)
    labels = cluster(np.vstack([xy, far]), distance=0.15)
    assert labels[-1] not in labels[:-1]
    assert len(set(zip(labels[:-1], alone, strict=True))) == alone.max() + 1 == labels.max()


# ------------------------------------------------------------------------------------- crowds ----


def blobs(rng: np.random.Generator, count: int) -> np.ndarray:
    middles = rng.uniform(0, 1.5, (count // 60, 2))
    return middles[rng.integers(len(middles), size=count)] + rng.normal(0, 0.02, (count, 2))


def rings(rng: np.random.Generator, count: int) -> np.ndarray:
    """As far from each other as clusters just are not, or just are."""
    angle, radius = rng.uniform(0, 6.3, count), 0.151 * rng.integers(1, 5, count)
    return np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)


def two_heaps(rng: np.random.Generator, count: int) -> np.ndarray:
    points = rng.normal(0, 1e-3, (count, 2))
    points[::2, 0] += rng.choice([0.149, 0.15, 0.151])
    return points


def on_a_fine_grid(rng: np.random.Generator, count: int) -> np.ndarray:
    return rng.integers(-12, 12, (count, 2)) * 0.03 + 50.0


def far_apart(rng: np.random.Generator, count: int) -> np.ndarray:
    points = rng.uniform(0, 0.5, (count, 2))
    points[: count // 2] += (1e6, -3e7)
    points[-count // 4 :, 1] += np.arange(count // 4 + (count % 4 > 0)) * 7e4
    return points


SHAPES = [blobs, rings, two_heaps, on_a_fine_grid, far_apart]


@pytest.mark.parametrize("make", SHAPES)
@pytest.mark.parametrize("distance", [0.05, 0.15, 0.4])
def test_clusters_of_crowds_equal_comparison_of_all_pairs(make, distance):
    for seed in range(4):
        xy = make(np.random.default_rng(seed), 900)
        assert cluster(xy, distance=distance).tolist() == clusters_of(xy.tolist(), distance)


@pytest.mark.parametrize(("right", "up"), [(1, 1), (1, -1), (-1, 1), (-1, -1)])
def test_point_beside_a_crowd_belongs_to_it_through_its_nearest_point(right, up):
    """Where all distances but one from it to the crowd are more than that of a cluster, 1 m."""
    crowd = np.random.default_rng(0).uniform(0.28, 0.32, (200, 2))
    outermost = [(0.01, 0.3), (0.69, 0.3), (0.3, 0.01), (0.3, 0.69)]
    # From the last one: 0.75 m and 0.55 m; from the outermost 0.71 m and 0.9 m, or more.
    points = np.array([*crowd, *outermost, (0.65, 0.65), (1.4, 1.2)])
    mirrored = 0.35 + (points - 0.35) * (right, up)
    assert cluster(mirrored, distance=1.0).max() == 0
    without = np.delete(mirrored, -2, axis=0)
    assert cluster(without, distance=1.0).max() == 1


@pytest.mark.parametrize("size", [0.0, 0.1, 1.0])
def test_memory_is_linear_in_the_number_of_points(size):
    """All cells of a scan in one place: a list of all pairs would take gigabytes."""
    xy = np.random.default_rng(1).uniform(0, size, (20_000, 2))
    cluster(xy[:100], distance=0.15)  # loads SciPy
    tracemalloc.start()
    try:
        assert cluster(xy, distance=0.15).max() == 0
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 50e6


def test_distant_points_are_not_compared_with_each_other():
    xy = np.zeros((20_000, 2))
    xy[10_001:, 1] = 1e6 + 5.0 * np.arange(9_999)
    tracemalloc.start()
    try:
        assert cluster(xy, distance=0.15).max() == 9_999
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert most < 50e6

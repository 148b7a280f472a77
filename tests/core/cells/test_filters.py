import math
from collections import defaultdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.cells.filters import discriminate_zones, measure_tops, quantize, reduce_noise
from mrs_people_loc.scan import Cells

NAN = math.nan


def cloud(points) -> np.ndarray:
    return np.array(points, dtype=np.float32).reshape(-1, 3)


def column(x, y, heights) -> list[tuple[float, float, float]]:
    return [(x, y, z) for z in heights]


# Points in millimetres, half a millimetre off every border, so that float32 decides as the
# whole numbers do. 40 m is as far as a head could ever see; few cells, so that they are shared.
coordinate = st.integers(-300, 300) | st.integers(-40_000, 40_000)
points_mm = st.lists(st.tuples(coordinate, coordinate, st.integers(-500, 2500)), max_size=60)


def from_mm(points) -> np.ndarray:
    return cloud(np.array(points).reshape(-1, 3) / 1000 + 0.0005)


# --------------------------------------------------------------------- zones (eq. 1) ----


def test_zone_limits_are_inclusive():
    heights = [-1.0, 0.0, 0.19, 0.2, 0.8, 1.4, 1.41, 2.0, NAN, math.inf]
    kept = discriminate_zones(cloud([(i, -i, z) for i, z in enumerate(heights)]), low=0.2, high=1.4)
    np.testing.assert_array_equal(kept, cloud([(3, -3, 0.2), (4, -4, 0.8), (5, -5, 1.4)]))


@given(points_mm, st.integers(-500, 1000), st.integers(1, 1500))
def test_zones_equal_a_plain_loop(points, low, extent):
    high = low + extent
    kept = discriminate_zones(from_mm(points), low=low / 1000, high=high / 1000)
    expected = [p for p in points if low <= p[2] + 0.5 <= high]
    np.testing.assert_array_equal(kept, from_mm(expected))


# ----------------------------------------------------------------- noise (eqs. 2-3) ----


def noise_of(xy, *, min_points, window=0.25) -> np.ndarray:
    points = cloud([(x, y, 1) for x, y in xy])
    return reduce_noise(points, window=window, min_points=min_points)[:, :2]


@pytest.mark.parametrize(("count", "kept"), [(19, 0), (20, 20), (21, 21)])
def test_window_is_kept_from_th_n_points_on(count, kept):
    points = cloud([(1.05, 2.05, 0.01 * i) for i in range(count)])
    assert len(reduce_noise(points, window=0.1, min_points=20)) == kept


@pytest.mark.parametrize(
    ("one", "other", "same_window"),
    [
        # Windows of 0.25 m from the origin; borders belong to the upper window (x_j <= x < ...).
        (0.0, 0.24, True),
        (0.0, 0.25, False),
        (0.24, 0.25, False),
        (0.25, 0.49, True),
        (-0.01, 0.0, False),  # no window across the origin
        (-0.25, -0.01, True),
        (-0.25, 0.0, False),
        (-0.26, -0.25, False),
        (-0.5, -0.25, False),
        (-0.5, -0.26, True),
        (7.25, 7.49, True),
    ],
)
def test_windows_are_half_open_and_tile_from_the_origin(one, other, same_window):
    for xy in ([(one, 9.1), (other, 9.1)], [(-9.1, one), (-9.1, other)]):
        assert len(noise_of(xy, min_points=2)) == (2 if same_window else 0)


def test_windows_have_the_papers_borders():
    edges = [(k / 10, 0.05) for k in range(-5, 6)]  # 0.1 m is no binary number
    kept = noise_of([*edges, (0.09, 0.05)], min_points=2, window=0.1)
    np.testing.assert_allclose(kept, [(0.0, 0.05), (0.09, 0.05)])


def test_points_keep_their_order_and_heights():
    points = cloud([(0.2, 0, 3), (5, 5, 9), (0.1, 0, 1), (-0.1, 0, 7), (0.1, 0.1, 2)])
    kept = reduce_noise(points, window=0.25, min_points=3)
    np.testing.assert_array_equal(kept, points[[0, 2, 4]])


def noise_by_loop(points, window, min_points):
    """Eqs. 2-3 in millimetres."""
    windows = defaultdict(list)
    for x, y, z in points:
        windows[x // window, y // window].append((x, y, z))
    return [p for p in points if len(windows[p[0] // window, p[1] // window]) >= min_points]


FAR = (80_000_000, -90_000_000, 1000)  # an outlier that no table of all windows could hold


@given(points_mm, st.sampled_from([50, 100, 137]), st.integers(1, 5), st.booleans())
def test_noise_windows_equal_a_plain_loop(points, window, min_points, with_far_outlier):
    if with_far_outlier:
        points = [FAR, *points, FAR]
    kept = reduce_noise(from_mm(points), window=window / 1000, min_points=min_points)
    np.testing.assert_array_equal(kept, from_mm(noise_by_loop(points, window, min_points)))


# ----------------------------------------------------------------- cells (eqs. 4-5) ----


@pytest.mark.parametrize(
    ("h", "k"),
    # k = floor(h / hwin) + 1 with hwin = 0.25
    [(0.0, 1), (0.1, 1), (0.25, 2), (0.3, 2), (-0.1, 0), (-0.25, 0), (-0.26, -1), (10.1, 41)],
)
def test_cell_is_represented_by_its_centre(h, k):
    cells = quantize(cloud([(h, 5.1, 1), (7.1, h, 1)]), cell=0.25)
    assert (k - 0.5) * 0.25 in cells.x
    assert (k - 0.5) * 0.25 in cells.y


def test_cell_has_heights_and_number_of_points():
    points = cloud(
        [(0.12, 0.01, 1.0), (0.01, 0.02, 0.5), (0.14, 0.04, 0.3), (-0.01, 0.02, 0.7),
         (0.11, 0.03, 1.2), (0.01, -0.02, 0.6)]
    )  # fmt: skip
    cells = quantize(points, cell=0.05)
    # Ordered by x, then y.
    np.testing.assert_allclose(cells.x, [-0.025, 0.025, 0.025, 0.125])
    np.testing.assert_allclose(cells.y, [0.025, -0.025, 0.025, 0.025])
    np.testing.assert_allclose(cells.z, [0.7, 0.6, 0.5, 1.2])
    np.testing.assert_allclose(cells.z_min, [0.7, 0.6, 0.5, 0.3])
    np.testing.assert_array_equal(cells.top, cells.z)
    np.testing.assert_array_equal(cells.count, [1, 1, 1, 3])


def cells_by_loop(points, cell):
    """Eqs. 4-5 in millimetres: (k_x, k_y) -> heights."""
    heights = defaultdict(list)
    for x, y, z in points:
        heights[x // cell + 1, y // cell + 1].append(z)
    return dict(sorted(heights.items()))


@given(points_mm, st.sampled_from([50, 100, 37]), st.booleans())
def test_cells_equal_a_plain_loop(points, cell, with_far_outlier):
    if with_far_outlier:
        points = [FAR, *points, FAR]
    cells = quantize(from_mm(points), cell=cell / 1000)
    expected = cells_by_loop(points, cell)
    assert len(cells) == len(expected)
    centres = (np.array(list(expected)).reshape(-1, 2) - 0.5) * cell / 1000
    np.testing.assert_allclose(np.stack([cells.x, cells.y], axis=1), centres, rtol=1e-6)
    for got, want in ((cells.z, max), (cells.z_min, min), (cells.top, max)):
        np.testing.assert_allclose(got, [want(z) / 1000 + 0.0005 for z in expected.values()], 1e-6)
    np.testing.assert_array_equal(cells.count, [len(z) for z in expected.values()])


@given(st.permutations(range(12)))
def test_cells_are_independent_of_the_order_of_points(order):
    rng = np.random.default_rng(0)
    points = cloud(np.column_stack([rng.uniform(-0.2, 0.2, (12, 2)), rng.uniform(0, 2, 12)]))
    one, other = quantize(points, cell=0.1), quantize(points[order], cell=0.1)
    np.testing.assert_array_equal(one.to_records(), other.to_records())


# ------------------------------------------------------------------------------ tops ----

HIGH = 1.4


def tops(cells: Cells, points, *, in_zone=None, support=3, gap=0.25, window=0.1) -> list[float]:
    """Tops; each cell holds `support` points at its z unless points in the zone are given."""
    if in_zone is None:
        in_zone = np.repeat(np.stack([cells.x, cells.y, cells.z], axis=1), support, axis=0)
    top = measure_tops(
        cells,
        cloud(in_zone),
        cloud(points),
        zone_high=HIGH,
        window=window,
        support=support,
        gap=gap,
    )
    assert top.dtype == np.float32
    assert top.shape == (len(cells),)
    return top.tolist()


@pytest.mark.parametrize(
    ("heights", "top"),
    [
        ([], 1.35),  # nothing above the zone: the cell's own highest point
        ([1.5, 1.6, 1.7], 1.5),  # the third highest
        ([1.7, 1.5, 1.6, 1.8, 1.55], 1.6),
        ([1.5, 1.6], 1.35),  # two are no support
        ([1.5] * 5, 1.5),
        ([1.5, 1.5, 1.5, 2.3, 2.3, 2.3], 1.5),  # a ceiling, after a gap
        ([1.5, 1.5, 1.5, 1.7, 1.9, 2.1, 2.3, 2.3, 2.3], 2.3),  # a wall, without one
        ([2.3, 2.3, 2.3], 1.35),
        ([1.5, 1.6, 1.7, 2.1, 2.1, 2.1], 1.5),  # what is beyond the gap is no support
    ],
)
def test_top_of_a_column_is_its_highest_supported_point(make_cells, heights, top):
    cells = make_cells([(1.025, 0.025)], z=1.35)
    in_zone = column(1.03, 0.03, [0.5, 1.0, 1.35])
    assert tops(cells, in_zone + column(1.05, 0.05, heights)) == pytest.approx([top], abs=0.0011)


def test_gap_length_is_exact(make_cells):
    cells = make_cells([(1.025, 0.025)], z=1.39)
    for gap in (0.1, 0.25, 0.5):
        near = column(1.05, 0.05, [1.41] * 3 + [1.41 + gap - 0.05] * 3)
        far = column(1.05, 0.05, [1.41] * 3 + [1.41 + gap + 0.1] * 3)
        assert tops(cells, near, gap=gap) == pytest.approx([1.36 + gap], abs=0.0011)
        assert tops(cells, far, gap=gap) == pytest.approx([1.41], abs=0.0011)


def test_gap_starts_at_the_highest_point_in_the_zone(make_cells):
    person_behind = column(1.05, 0.05, [1.45, 1.5, 1.55])
    low = make_cells([(1.025, 0.025)], z=1.0)  # a table's edge, and a head far behind it
    assert tops(low, person_behind) == pytest.approx([1.0], abs=0.0011)
    # A neighbour in the same column reaches the end of the zone: it is one column.
    both = make_cells([(1.025, 0.025), (1.075, 0.025)], z=[1.0, 1.38])
    assert tops(both, person_behind) == pytest.approx([1.45, 1.45], abs=0.0011)
    # In the next column it does not count.
    apart = make_cells([(1.025, 0.025), (1.125, 0.025)], z=[1.0, 1.38])
    assert tops(apart, person_behind) == pytest.approx([1.0, 1.38], abs=0.0011)


def test_columns_equal_the_noise_windows(make_cells):
    cells = make_cells([(-0.025, 0.025), (0.025, 0.025), (0.075, 0.075)], z=1.35)
    points = column(0.0, 0.0, [1.5] * 3) + column(-0.001, 0.0, [1.6] * 3)
    assert tops(cells, points) == pytest.approx([1.6, 1.5, 1.5], abs=0.0011)
    assert tops(cells, points, window=0.05) == pytest.approx([1.6, 1.5, 1.35], abs=0.0011)


def test_points_in_the_zone_do_not_support_a_top_above_it(make_cells):
    cells = make_cells([(0.025, 0.025)], z=1.2)
    points = column(0.02, 0.02, [1.4] * 9 + [1.41] * 2)
    assert tops(cells, points) == pytest.approx([1.2], abs=0.0011)


@pytest.mark.parametrize(
    ("heights", "top"),
    [
        ([0.5, 1.0, 1.0, 1.05, 1.35], 1.0),  # the third highest: one mismatch makes no one taller
        ([0.5, 1.0, 1.35], 0.5),
        ([1.2, 1.35], 1.35),  # two are no support: the cell's own highest point
        ([], 1.35),
    ],
)
def test_column_that_ends_in_the_zone_has_its_top_there(make_cells, heights, top):
    cells = make_cells([(1.025, 0.025)], z=1.35)
    in_zone = column(1.03, 0.03, heights) + column(1.13, 0.03, [1.39] * 9)
    assert tops(cells, [], in_zone=in_zone) == pytest.approx([top], abs=0.0011)


columns_of_points = st.lists(
    st.tuples(
        st.tuples(st.integers(-3, 3), st.integers(-3, 3)),  # window
        st.sampled_from([900, 1000, 1360, 1390]),  # top of the zone's part: far or near its end
        st.lists(st.integers(200, 900), max_size=5),  # and what is below it
        # Steps upwards from the zone's end, clearly within or clearly beyond the gap.
        st.lists(st.integers(1, 180) | st.integers(400, 600), max_size=12),
    ),
    max_size=6,
    unique_by=lambda item: item[0],
)


@given(columns_of_points, st.integers(1, 4), st.booleans(), st.randoms(use_true_random=False))
def test_tops_equal_a_plain_loop(make_cells, columns, support, with_far_outlier, random):
    """Follows the docstring of measure_tops, column by column."""
    in_zone, above, centres, zone_tops, expected = [], [], [], [], []
    for (i, j), zone_top, lower, steps in columns:
        zone_heights = [h / 1000 + 0.0005 for h in (zone_top, *lower)]
        heights = [HIGH + sum(steps[: n + 1]) / 1000 + 0.0005 for n in range(len(steps))]
        in_zone += column(i / 10 + 0.06, j / 10 + 0.03, zone_heights)
        above += column(i / 10 + 0.03, j / 10 + 0.06, heights)
        centres.append((i / 10 + 0.025, j / 10 + 0.025))
        zone_tops.append(zone_heights[0])
        passed, level = [], zone_heights[0]
        for height in heights:
            if height - level > 0.25:
                break
            passed.append(height)
            level = height
        enough = [part for part in (passed, zone_heights) if len(part) >= support]
        expected.append(sorted(enough[0])[-support] if enough else zone_heights[0])
    if with_far_outlier:
        above.append((8e4, -9e4, 1.5))
    everything = in_zone + above
    random.shuffle(in_zone)
    random.shuffle(everything)
    cells = make_cells(centres, z=np.array(zone_tops, dtype=np.float32))
    got = tops(cells, everything, in_zone=in_zone, support=support)
    assert got == pytest.approx(expected, abs=0.0016)


def test_column_is_followed_up_to_3_m_above_the_zone(make_cells):
    wall = column(1.05, 0.05, np.arange(1.41, 9.0, 0.02))
    (top,) = tops(make_cells([(1.025, 0.025)], z=1.39), wall)
    assert top == pytest.approx(HIGH + 3.0, abs=0.1)


# ------------------------------------------------------------------------ degenerate ----


@pytest.mark.parametrize("n", [0, 1])
def test_stages_handle_few_points(n):
    points = cloud([(0.1, 0.1, 1.0)] * n)
    assert discriminate_zones(points, low=0.2, high=1.4).shape == (n, 3)
    assert reduce_noise(points, window=0.1, min_points=1).shape == (n, 3)
    assert reduce_noise(points, window=0.1, min_points=2).shape == (0, 3)
    assert len(quantize(points, cell=0.05)) == n


def test_tops_of_no_cells_or_points_are_empty(make_cells):
    assert tops(Cells.empty(), []) == []
    assert tops(Cells.empty(), column(0, 0, [1.5] * 5)) == []
    assert tops(make_cells([(0.025, 0.025)], z=1.25), []) == [1.25]


def test_stages_preserve_float32():
    points = cloud([(0.1, 0.1, 1.0)] * 3)
    assert discriminate_zones(points, low=0.2, high=1.4).dtype == np.float32
    assert reduce_noise(points, window=0.1, min_points=1).dtype == np.float32


def test_inputs_are_not_modified(make_cells):
    points = cloud(np.random.default_rng(0).uniform(0, 2, (50, 3)))
    before = points.copy()
    kept = reduce_noise(discriminate_zones(points, low=0.2, high=1.4), window=0.5, min_points=1)
    cells = quantize(kept, cell=0.5)
    records = cells.to_records()
    measure_tops(cells, kept, points, zone_high=1.4, window=0.5, support=1, gap=0.25)
    np.testing.assert_array_equal(points, before)
    np.testing.assert_array_equal(cells.to_records(), records)

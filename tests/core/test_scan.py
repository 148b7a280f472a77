import dataclasses
import math

import numpy as np
import pytest

from mrs_people_loc.errors import ScanError
from mrs_people_loc.scan import BODY_DTYPE, CELL_DTYPE, Cells, Scan

NAMES = ("x", "y", "z", "z_min", "top", "count")
OF_BODIES = ("body", "score", "sigma_range", "sigma_across")


def test_cell_has_the_documented_bytes():
    # The wire's contract: five float32 and a uint32, little-endian, without gaps.
    assert CELL_DTYPE.names == NAMES
    assert CELL_DTYPE.itemsize == 24
    record = np.array([(1.0, -2.0, 1.5, 0.25, 1.75, 258)], CELL_DTYPE)
    expected = "0000803f 000000c0 0000c03f 0000803e 0000e03f 02010000"
    assert record.tobytes() == bytes.fromhex(expected)


def test_cell_of_a_body_has_the_documented_bytes():
    # The same, and then a uint32 and three float32: old readers find what they know in its place.
    assert BODY_DTYPE.names == NAMES + OF_BODIES
    assert BODY_DTYPE.itemsize == 40
    assert BODY_DTYPE.fields is not None
    assert CELL_DTYPE.fields is not None
    assert all(BODY_DTYPE.fields[name] == CELL_DTYPE.fields[name] for name in NAMES)
    record = np.array([(1.0, -2.0, 1.5, 0.25, 1.75, 258, 3, -1.5, 0.5, 0.125)], BODY_DTYPE)
    expected = (
        "0000803f 000000c0 0000c03f 0000803e 0000e03f 0201000003000000 0000c0bf 0000003f 0000003e"
    )
    assert record.tobytes() == bytes.fromhex(expected)


def of_bodies(cells: Cells) -> Cells:
    n = len(cells)
    return dataclasses.replace(
        cells,
        body=np.arange(n, dtype=np.uint32),
        score=np.linspace(-2, 3, n, dtype=np.float32),
        sigma_range=np.linspace(0.1, 0.4, n, dtype=np.float32),
        sigma_across=np.linspace(0.05, 0.02, n, dtype=np.float32),
    )


def test_records_of_bodies_round_trip(make_cells):
    cells = of_bodies(make_cells([(1, 2), (3, -4), (5, 6)]))
    records = cells.to_records()
    assert records.dtype == BODY_DTYPE
    back = Cells.from_records(records)
    for name in NAMES + OF_BODIES:
        np.testing.assert_array_equal(records[name], getattr(cells, name))
        np.testing.assert_array_equal(getattr(back, name), getattr(cells, name))
    # Nobody in it: as a robot sends it that does not seek bodies.
    nobody = dataclasses.replace(cells, body=np.zeros(3, dtype=np.uint32))
    assert nobody.to_records().dtype == CELL_DTYPE


def test_cells_belong_to_no_body_by_default(make_cells):
    cells = make_cells([(1, 2), (3, 4)])
    for name in OF_BODIES:
        np.testing.assert_array_equal(getattr(cells, name), [0, 0])
        assert getattr(cells, name).dtype == BODY_DTYPE[name]


def test_records_round_trip(make_cells):
    cells = make_cells(
        [(1, 2), (3, -4)], z=[1.0, 1.1], z_min=[0.2, 0.3], top=[1.7, 1.8], count=[5, 6]
    )
    records = cells.to_records()
    assert records.dtype == CELL_DTYPE
    np.testing.assert_array_equal(records["y"], [2, -4])
    back = Cells.from_records(records)
    for name in NAMES:
        np.testing.assert_array_equal(getattr(back, name), getattr(cells, name))
        assert getattr(back, name).flags.c_contiguous


def test_records_may_have_more_fields_and_other_types():
    records = np.zeros(2, [("label", "u1"), *((name, "f8") for name in reversed(NAMES))])
    records["top"], records["count"] = 1.75, 7
    cells = Cells.from_records(records)
    np.testing.assert_array_equal(cells.top, [1.75, 1.75])
    assert cells.top.dtype == np.float32
    assert cells.count.dtype == np.uint32
    np.testing.assert_array_equal(cells.count, [7, 7])


def test_no_cells_are_valid():
    assert len(Cells.empty()) == 0
    assert len(Cells.union([])) == 0
    assert len(Cells.union([Cells.empty(), Cells.empty()])) == 0
    assert Cells.empty().to_records().shape == (0,)


def test_concatenation_keeps_the_order(make_cells):
    parts = [make_cells([(1, 1), (2, 2)], count=[1, 2]), Cells.empty(), make_cells([(0, 9)], top=1)]
    parts[0] = of_bodies(parts[0])
    cells = Cells.union(parts)
    np.testing.assert_array_equal(cells.body, [0, 1, 0])
    np.testing.assert_array_equal(cells.score, [-2, 3, 0])
    np.testing.assert_array_equal(cells.x, [1, 2, 0])
    np.testing.assert_array_equal(cells.y, [1, 2, 9])
    np.testing.assert_array_equal(cells.count, [1, 2, 100])
    np.testing.assert_allclose(cells.top, [1.7, 1.7, 1.0])


@pytest.mark.parametrize("name", NAMES + OF_BODIES)
@pytest.mark.parametrize(
    ("change", "message"),
    [
        (lambda value: value[:1], r"has shape \(.,\); wanted: \(.,\)"),
        (lambda value: value[:, None], r"has shape \(2, 1\); wanted: \(2,\)"),
        (lambda value: value.astype(np.int64), "is int64; wanted: (float32|uint32)"),
        (lambda value: value.astype(np.float64), "is float64; wanted: (float32|uint32)"),
    ],
    ids=["short", "two-dimensional", "int64", "float64"],
)  # fmt: skip
def test_bad_arrays_are_refused(make_cells, name, change, message):
    cells = make_cells([(1, 2), (3, 4)])
    with pytest.raises(ScanError, match=message) as error:
        dataclasses.replace(cells, **{name: change(getattr(cells, name))})
    # A short x is the others' measure.
    assert str(error.value).startswith(name) or name == "x"


@pytest.mark.parametrize("name", [n for n in NAMES + OF_BODIES if n not in ("count", "body")])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_non_finite_values_are_refused(make_cells, name, value):
    cells = make_cells([(1, 2), (3, 4), (5, 6)])
    getattr(cells, name)[1:] = value
    with pytest.raises(ScanError, match=f"{name} is NaN or infinite in 2 of 3 points"):
        dataclasses.replace(cells)


def test_cells_and_scans_are_immutable(make_cells):
    scan = Scan("robot_a", 5, make_cells([(1, 2)]))
    with pytest.raises(dataclasses.FrozenInstanceError):
        scan.stamp_ns = 6  # type: ignore[misc]
    with pytest.raises(dataclasses.FrozenInstanceError):
        scan.cells.x = scan.cells.y  # type: ignore[misc]

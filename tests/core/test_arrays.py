from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pytest

from mrs_people_loc.arrays import Float, Int, StructOfArrays


@dataclass(frozen=True)
class Inner(StructOfArrays):
    """Arrays within arrays."""

    weight: Float


@dataclass(frozen=True)
class Outer(StructOfArrays):
    """Numbers, places and what is within."""

    number: Int
    xy: Float
    inner: Inner


def outer(*numbers: int) -> Outer:
    """Each number n at (n, -n), with the weight n / 2."""
    each = np.array(numbers, dtype=np.intp)
    return Outer(each, np.stack([1.0 * each, -1.0 * each], axis=1), Inner(each / 2.0))


def check(got: Outer, *numbers: int) -> None:
    assert len(got) == len(got.inner) == len(numbers)
    assert got.number.tolist() == list(numbers)
    assert got.xy.tolist() == [[n, -n] for n in numbers]
    assert got.inner.weight.tolist() == [n / 2 for n in numbers]


@pytest.mark.parametrize(
    ("index", "selected"),
    [
        (np.array([2, 0, 2]), (7, 5, 7)),
        (np.array([False, True, True]), (6, 7)),
        (slice(None, 2), (5, 6)),
        (np.empty(0, dtype=np.intp), ()),
    ],
)
def test_selection_is_of_all_fields(index, selected):
    check(outer(5, 6, 7).select(index), *selected)


def test_parts_are_joined_in_their_order():
    check(Outer.joined([outer(1), outer(), outer(4, 2)]), 1, 4, 2)
    check(Outer.joined([outer(3, 1)]), 3, 1)


@pytest.mark.parametrize(
    ("xy", "weight", "message"),
    [
        (3, 2, r"Outer\.xy has length 3; wanted: 2, as number"),
        (2, 1, r"Outer\.inner has length 1; wanted: 2, as number"),
    ],
)
def test_fields_of_different_lengths_are_refused(xy, weight, message):
    with pytest.raises(ValueError, match=message):
        Outer(np.arange(2), np.zeros((xy, 2)), Inner(np.zeros(weight)))

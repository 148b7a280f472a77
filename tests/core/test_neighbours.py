import math
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc import neighbours
from mrs_people_loc.neighbours import pairs_between, pairs_within

#: On a grid, so that many distances are exactly the reach; and some that are hardly numbers.
COORDINATE = st.one_of(
    st.integers(-6, 6).map(float),
    st.floats(-3.0, 3.0),
    st.sampled_from([math.nan, math.inf, -math.inf, 1e308, -1e308, 5e9, 5e9 + 1.0, 1e-320]),
)
POINTS = st.lists(st.tuples(COORDINATE, COORDINATE), max_size=25)
REACH = st.sampled_from([0.0, 1.0, math.sqrt(2.0), 0.3, 4.0])
#: All pairs are few, or a tree is made.
FEW = st.sampled_from([neighbours._FEW, 0])


def array_of(points) -> np.ndarray:
    return np.array(points, dtype=float).reshape(-1, 2)


def away(a, b) -> float:
    with np.errstate(all="ignore"):
        return float(np.hypot(*np.subtract(a, b)))


@given(points=POINTS, reach=REACH, few=FEW)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_pairs_equal_those_of_comparing_all(points, reach, few):
    with patch.object(neighbours, "_FEW", few):
        one, other, distance = pairs_within(array_of(points), reach)
    wanted = {
        (i, j): away(points[i], points[j])
        for j in range(len(points))
        for i in range(j)
        if away(points[i], points[j]) <= reach
    }
    assert len(one) == len(wanted)  # each once
    assert dict(zip(zip(one, other, strict=True), distance, strict=True)) == wanted


@given(points=POINTS, others=POINTS, reach=REACH, few=FEW)
@pytest.mark.filterwarnings("ignore::RuntimeWarning")
def test_pairs_of_two_sets_equal_those_of_comparing_all(points, others, reach, few):
    with patch.object(neighbours, "_FEW", few):
        one, other, distance = pairs_between(array_of(points), array_of(others), reach)
    wanted = {
        (i, j): away(a, b)
        for i, a in enumerate(points)
        for j, b in enumerate(others)
        if away(a, b) <= reach
    }
    assert len(one) == len(wanted)
    assert dict(zip(zip(one, other, strict=True), distance, strict=True)) == wanted


@pytest.mark.parametrize("few", [neighbours._FEW, 0])
@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e6])
def test_reach_is_inclusive_at_any_scale(scale, few, monkeypatch):
    monkeypatch.setattr(neighbours, "_FEW", few)
    # 3, 4, 5, and 5 with a last digit more.
    xy = scale * np.array([(0.0, 0.0), (3.0, 4.0), (0.0, np.nextafter(5.0, 9.0))])
    one, other, _ = pairs_within(xy, 5.0 * scale)
    assert sorted(zip(one.tolist(), other.tolist(), strict=True)) == [(0, 1), (1, 2)]

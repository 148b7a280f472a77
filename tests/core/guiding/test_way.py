import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.errors import ConfigError
from mrs_people_loc.guiding.way import Way


def test_places_along_a_straight_way_match_hand_computed_values() -> None:
    way = Way([(1.0, 2.0), (11.0, 2.0)])
    assert way.length == pytest.approx(10.0)
    assert way.at(3.0, 0.5) == pytest.approx([4.0, 2.5])
    assert way.at(-2.0) == pytest.approx([-1.0, 2.0])
    assert way.at(12.0) == pytest.approx([13.0, 2.0], abs=1e-6)
    assert way.ahead(np.array([[0.0, 5.0]])) == pytest.approx(np.array([[[1.0, 0.0]] * 2]))
    places = np.array([[4.0, 3.0], [0.0, 2.0]])
    assert way.nearest(places) == pytest.approx([3.0, -1.0], abs=0.03)
    assert way.nearest(places, 2.6) == pytest.approx([3.0, 1.6], abs=0.06)
    assert way.nearest(places, np.array([3.6, -0.4])) == pytest.approx([3.0, -1.0], abs=0.01)
    assert way.nearest(places, 7.0, reach=3.0)[1] == pytest.approx(4.0, abs=0.06)
    # Of a clock that has jumped ahead by days; no table of so many places.
    assert way.nearest(places, 7.0, reach=1e12) == pytest.approx([3.0, -1.0], abs=0.01)


def test_corners_are_cut_as_documented_and_ends_stay() -> None:
    way = Way([(0.0, 0.0), (5.0, 0.0), (5.0, 0.0), (5.0, 5.0)], rounding=2.0)
    places = way.at(np.arange(0.0, way.length, 0.01))
    assert np.linalg.norm(places - [5.0, 0.0], axis=1).min() == pytest.approx(0.36, abs=0.02)
    assert way.at(0.0) == pytest.approx([0.0, 0.0], abs=0.01)
    assert way.at(way.length) == pytest.approx([5.0, 5.0], abs=0.06)
    assert way.at(3.5) == pytest.approx([3.5, 0.0], abs=0.01)
    turn = way.ahead(np.arange(3.0, 7.0, 0.1))
    assert (turn[1:] * turn[:-1]).sum(axis=1).min() > math.cos(0.2)


def test_way_that_crosses_itself_keeps_its_order() -> None:
    way = Way([(0.0, 0.0), (10.0, 0.0), (10.0, 5.0), (5.0, 5.0), (5.0, -5.0)])
    crossing = np.array([[5.0, 0.1]])
    first, second = way.nearest(crossing, 4.0, 3.0), way.nearest(crossing, way.length - 6.0, 3.0)
    assert first == pytest.approx([5.0], abs=0.1)
    assert second == pytest.approx([way.length - 5.1], abs=0.1)
    assert way.nearest(crossing - [0.0, 0.1])[0] == pytest.approx(5.0, abs=0.06)


@given(
    st.lists(st.tuples(st.floats(-20, 20), st.floats(-20, 20)), min_size=2, max_size=6),
    st.floats(0.0, 1.0),
)
def test_nearest_undoes_at(points: list[tuple[float, float]], part: float) -> None:
    try:
        way = Way(points)
    except ConfigError:
        return
    s = part * way.length
    place = way.at(s)[np.newaxis]
    found = way.nearest(place, s, 0.2)
    assert np.linalg.norm(way.at(float(found[0])) - place) < 0.1


@pytest.mark.parametrize(
    ("points", "text"),
    [
        ([(0.0, 0.0)], "0.00 m long"),
        ([(0.0, 0.0), (0.2, 0.0)], "0.20 m long"),
        ([(0.0, 0.0), (math.nan, 0.0)], "wanted: finite"),
        ([0.0, 1.0, 2.0], "shape"),
    ],
)
def test_points_without_a_way_are_refused(points: list, text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        Way(points)

"""Tours and their files."""

from __future__ import annotations

import numpy as np
import pytest

from mrs_people_loc.errors import TourError
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.tour import check_tour, read_tour, tour_from
from mrs_people_loc.team.masking import OccupancyGrid

HALL = """
name: hall
points: [[0.0, 0.0], [12, 0.0]]
stops:
  - {name: Foyer, at: [4.0, 1.0], wait: 10.0}
  - {name: Window, at: [9.0, -0.5]}
speed: 0.5
"""


@pytest.fixture
def read(tmp_path):
    def from_text(text: str):
        path = tmp_path / "tour.yaml"
        path.write_text(text)
        return read_tour(path)

    return from_text


def test_file_gives_way_stops_and_speed(read):
    tour = read(HALL)
    assert (tour.name, tour.frame, tour.speed) == ("hall", "map", 0.5)
    assert tour.way.length == pytest.approx(12.0)
    foyer, window = tour.stops
    assert (foyer.name, foyer.wait_s, window.wait_s) == ("Foyer", 10.0, 0.0)
    assert foyer.way_m == pytest.approx(4.0, abs=0.03)
    assert window.way_m == pytest.approx(9.0, abs=0.03)
    assert foyer.xy.tolist() == [4.0, 1.0]


def test_what_is_left_out_has_a_default(read):
    tour = read("points: [[0, 0], [3, 4]]")
    assert (tour.name, tour.stops, tour.speed) == ("tour", (), None)
    assert tour.way.length == pytest.approx(5.0)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("points: [[0, 0]", "cannot be read"),
        ("[1, 2]", r"a tour is \[1, 2\]; wanted: a mapping with name, frame, points"),
        ("name: hall", "a tour has no 'points'"),
        ("points: [[0, 0], [5, 0]]\nspead: 1", "a tour has the unknown key 'spead'; known: name"),
        ("", "the file is empty; wanted: a mapping with name, frame, points"),
        ("points: [[0, 0]]", "a tour needs at least two points"),
        ("points: [[0, 0], [5]]", r"points: .*; wanted: x, y in brackets \[m\]"),
        ("points: [[0, 0], [.nan, 1]]", "points is nan; wanted: a finite number"),
        ("points: [[0, 0], [0x" + "f" * 9999 + ", 1]]", "points is a int; wanted: a finite"),
        ("points: [[0, 0], [0.5, 0]]", "the way is 0.50 m long; allowed: 1 to 5000 m"),
        ("points: [[0, 0], [5, 0]]\nspeed: 3", "speed is 3.0; allowed: a number from 0.05 to 2"),
        ("points: [[0, 0], [5, 0]]\nstops: 3", "stops: wanted: a list"),
        ("points: [[0, 0], [5, 0]]\nstops: [{at: [1, 0]}]", "stop 1 has no 'name'"),
        (
            "points: [[0, 0], [5, 0]]\nstops: [{name: Foyer, at: [4, 2.1]}]",
            "stop 'Foyer' is 2.1 m from the way; allowed: 2 m",
        ),
        (
            "points: [[0, 0], [5, 0]]\nstops: [{name: A, at: [4, 0], wait: -1}]",
            "stop 'A' waits for -1 s; allowed: 0 to 3600 s",
        ),
        (
            "points: [[0, 0], [9, 0]]\nstops: [{name: A, at: [8, 0]}, {name: B, at: [2, 0]}]",
            "stop 'B' is before stop 'A' on the way; wanted: stops in the order of the way",
        ),
    ],
)
def test_file_that_is_no_tour_is_refused(read, text, message):
    with pytest.raises(TourError, match=message) as error:
        read(text)
    assert "tour.yaml: " in str(error.value)


def test_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(TourError, match=r"none\.yaml: there is no such file"):
        read_tour(tmp_path / "none.yaml")


def test_stops_of_a_way_that_crosses_itself_are_in_order():
    """The way comes back to (5, 0) after 20 m, from below."""
    points = [[0, 0], [10, 0], [10, -5], [5, -5], [5, 5]]
    tour = tour_from(points, [("A", (5, 0), 0), ("B", (10, -4), 0), ("C", (5, 0), 0)])
    ways = [stop.way_m for stop in tour.stops]
    assert ways == sorted(ways)
    for way_m in (ways[0], ways[2]):
        assert tour.way.at(way_m) == pytest.approx(np.array([5.0, 0.0]), abs=0.1)
    assert ways[2] - ways[0] > 15.0


def room() -> FreeSpace:
    """Free floor from (0, 0) to (10, 4), and a wall across it at x = 6 that is open below y = 1."""
    data = np.zeros((40, 100), np.int8)
    data[10:, 60:62] = 100
    return FreeSpace(OccupancyGrid(0.1, 0.0, 0.0, 0.0, data))


def test_way_through_free_floor_is_accepted():
    check_tour(tour_from([[1.0, 2.0], [5.0, 2.0]]), room(), 0.35)


@pytest.mark.parametrize(
    ("points", "message"),
    [
        ([[1.0, 2.0], [9.0, 2.0]], r"the way passes through a wall at \(6\.\d\d, 2\.00\), 5\.\d m"),
        ([[1.0, 2.0], [14.0, 2.0]], "through a wall at .*, or leaves the map"),
        (
            [[1.0, 0.8], [9.0, 0.8]],
            r"passes a wall at a distance of 0\.\d\d m at \(6\..*; allowed: at least 0\.35 m",
        ),
    ],
)
def test_way_through_a_wall_is_refused(points, message):
    with pytest.raises(TourError, match=message):
        check_tour(tour_from(points), room(), 0.35)

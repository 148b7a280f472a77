"""Messages that the guide receives: people and tours."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from mrs_people_loc.errors import PeopleError, StampError, TourError
from mrs_people_loc.messages import read_people, read_tour_goal, read_tour_path

NAN = math.nan


def header(frame_id: str = "map", sec: int = 12) -> SimpleNamespace:
    return SimpleNamespace(stamp=SimpleNamespace(sec=sec, nanosec=500_000_000), frame_id=frame_id)


def pose(x: float = 1.0, y: float = 2.0, variance: float = 0.04) -> SimpleNamespace:
    position = SimpleNamespace(x=x, y=y, z=0.0)
    covariance = variance * np.eye(6).reshape(-1)
    return SimpleNamespace(pose=SimpleNamespace(position=position), covariance=covariance)


def twist(x: float = 0.5, y: float = -0.25) -> SimpleNamespace:
    linear = SimpleNamespace(x=x, y=y, z=0.0)
    covariance = 0.01 * np.eye(6).reshape(-1)
    return SimpleNamespace(twist=SimpleNamespace(linear=linear), covariance=covariance)


def duration(seconds: float) -> SimpleNamespace:
    return SimpleNamespace(sec=int(seconds), nanosec=round(seconds % 1.0 * 1e9))


def person(**changes: Any) -> SimpleNamespace:
    values = {
        "id": 7, "pose": pose(), "velocity": twist(), "height": 1.75, "sigma": 0.125,
        "robots": ["robot_a"], "age": duration(3.5), "coasting": False,
    }  # fmt: skip
    return SimpleNamespace(**values | changes)


def group(**changes: Any) -> SimpleNamespace:
    values = {
        "id": 2, "size": 1, "centre": pose(3.0, 4.0), "velocity": twist(NAN, NAN), "radius": 0.5,
        "rms_spread": 0.25, "members": [7], "stragglers": [9], "straggling_for": [duration(1.5)],
    }  # fmt: skip
    return SimpleNamespace(**values | changes)


def people(persons: Any = (), groups: Any = (), **changes: Any) -> SimpleNamespace:
    values = {"header": header(), "scans": [], "persons": list(persons), "groups": list(groups)}
    return SimpleNamespace(**values | changes)


def test_people_and_groups_are_read():
    (one,), (all_of_them,) = read_people(people([person()], [group()]), "map")
    assert one.position.tolist() == [1.0, 2.0]
    assert one.covariance.tolist() == [[0.04, 0.0], [0.0, 0.04]]
    assert one.velocity is not None
    assert one.velocity.tolist() == [0.5, -0.25]
    assert (one.id, one.height, one.sigma, one.robots) == (7, 1.75, 0.125, ("robot_a",))
    assert (one.age_s, one.coasting, one.stamp_ns) == (3.5, False, 12_500_000_000)
    assert all_of_them.centre.tolist() == [3.0, 4.0]
    assert all_of_them.velocity is None
    assert (all_of_them.id, all_of_them.size, all_of_them.members) == (2, 1, (7,))
    assert dict(all_of_them.stragglers) == {9: 1.5}
    assert read_people(people(), "map") == ((), ())


def hidden(number: int = 4, x: float = 3.0, **changes: Any) -> SimpleNamespace:
    values = {
        "person": person(id=number, coasting=True, robots=[]),
        "last_seen": SimpleNamespace(sec=11, nanosec=0),
        "last_seen_at": SimpleNamespace(x=x, y=4.0, z=0.0),
    }
    return SimpleNamespace(**values | changes)


def test_hidden_people_are_among_the_others_by_their_ids():
    message = people([person(), person(id=1)], hidden=[hidden(), hidden(0)])
    nobody, first, unseen, last = read_people(message, "map")[0]
    assert [one.id for one in (nobody, first, unseen, last)] == [0, 1, 4, 7]
    assert (first.seen_at, last.seen_at, last.stamp_ns) == (None, None, 12_500_000_000)
    assert unseen.seen_at is not None
    assert (unseen.seen_at.tolist(), unseen.stamp_ns) == ([3.0, 4.0], 11_000_000_000)
    assert unseen.coasting


def test_recordings_of_before_there_were_hidden_people_are_read():
    message = people([person()])
    assert not hasattr(message, "hidden")
    assert [one.seen_at for one in read_people(message, "map")[0]] == [None]


@pytest.mark.parametrize(
    ("message", "error", "text"),
    [
        (people(header=header("odom")), PeopleError, "frame_id is 'odom'; wanted: 'map'"),
        (
            people([person(pose=pose(NAN))]),
            PeopleError,
            r"is \[nan, 2.0\]; wanted: finite",
        ),
        (people([person(pose=pose(1e9))]), PeopleError, "position is .* within 2.1e"),
        (people([person(pose=pose(variance=-1.0))]), PeopleError, "covariance is"),
        (
            people([person(), person()]),
            PeopleError,
            "two people with the id 7; wanted",
        ),
        (people([person()], hidden=[hidden(7)]), PeopleError, "two people with the id 7; wanted"),
        (people(hidden=[hidden(x=NAN)]), PeopleError, r"last_seen_at is \[nan, 4.0\]; wanted"),
        (people(groups=[group(straggling_for=[])]), PeopleError, "1 stragglers and 0 times"),
        (
            people(header=SimpleNamespace(stamp=SimpleNamespace(sec=0, nanosec=0), frame_id="map")),
            StampError,
            "stamp is 0",
        ),
    ],
)
def test_people_that_cannot_be_used_are_refused(message, error, text):
    with pytest.raises(error, match=text):
        read_people(message, "map")


def path(*points: tuple[float, float], frames: tuple[str, str] = ("map", "")) -> SimpleNamespace:
    of_path, of_poses = frames
    poses = [SimpleNamespace(header=header(of_poses), pose=pose(*xy).pose) for xy in points]
    return SimpleNamespace(header=header(of_path), poses=poses)


def goal(**changes: Any) -> SimpleNamespace:
    stop = SimpleNamespace(
        name="Foyer", position=SimpleNamespace(x=4.0, y=0.5, z=0.0), wait=duration(2.5)
    )
    values = {"name": "hall", "path": path((0.0, 0.0), (8.0, 0.0)), "stops": [stop], "speed": 0.0}
    return SimpleNamespace(**values | changes)


def test_goal_is_a_tour():
    tour = read_tour_goal(goal(), "map")
    (stop,) = tour.stops
    assert (tour.name, tour.speed, stop.name, stop.wait_s) == ("hall", None, "Foyer", 2.5)
    assert tour.way.length == pytest.approx(8.0)
    assert stop.way_m == pytest.approx(4.0, abs=0.03)
    assert read_tour_goal(goal(speed=0.5), "map").speed == 0.5


@pytest.mark.parametrize("frames", [("map", ""), ("map", "map"), ("/map", "")])
def test_path_is_a_tour_without_stops(frames):
    tour = read_tour_path(path((0.0, 0.0), (3.0, 4.0), frames=frames), "map")
    assert not tour.stops
    assert tour.way.length == pytest.approx(5.0)


@pytest.mark.parametrize("frames", [("odom", ""), ("map", "odom"), ("", "")])
def test_path_in_another_frame_is_refused(frames):
    with pytest.raises(TourError, match=r"frame_id of the path is '(odom)?'; wanted: 'map'"):
        read_tour_path(path((0.0, 0.0), (3.0, 4.0), frames=frames), "map")

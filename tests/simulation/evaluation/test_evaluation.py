"""`mrs evaluate` on bags whose scores were worked out by hand, and on the paper's formation."""

from __future__ import annotations

import dataclasses
import json
import math
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mrs_people_loc.errors import BagError, ConfigError, PeopleLocError, PoseError
from mrs_people_loc.planner import Planner

pytest.importorskip("rosbags.interfaces", reason="writing bags needs rosbags")
pytest.importorskip("typer", reason="the mrs command needs typer")

from rich.console import Console
from rosbags.typesys import Stores, get_typestore
from typer.testing import CliRunner

from mrs_people_sim import estimates
from mrs_people_sim.estimates import estimate_of, read_recorded
from mrs_people_sim.evaluation import tables
from mrs_people_sim.evaluation.results import Result, as_json, evaluate_bag, names_of
from mrs_tools.bags import truth as truth_module
from mrs_tools.bags.message_types import default_typestore, require_types
from mrs_tools.bags.offline import BagRun
from mrs_tools.bags.reader import BagReader
from mrs_tools.bags.sources import file_beside, overridden_beside
from mrs_tools.bags.truth import read_truth
from mrs_tools.bags.writer import BagWriter
from mrs_tools.cli import app
from tools.made_bag import MS, START_NS, Bag

ROOT = Path(__file__).resolve().parents[3]
PAPER = ROOT / "config" / "paper.yaml"
FORMATION = ROOT / "bags" / "paper_formation"
NOBODY = (math.nan, math.nan)
#: The figures of tracks where nobody is tracked.
NO_TRACKS = {
    **dict.fromkeys(
        ["mota", "motp_m", "idf1", "idp", "idr", "id_switches", "switches_per_person_minute",
         "fragments", "mostly_tracked", "mostly_lost", "gospa"]
    ),
    "velocity_error_mps": {"mean": None, "p95": None},
}  # fmt: skip
#: The figures of stragglers where there is no group in the truth.
NO_STRAGGLERS = {
    **dict.fromkeys(["true", "flagged", "within_1_s", "unseen", "false", "minutes"]),
    "delay_s": {"mean": None, "max": None},
}


@pytest.fixture
def make_bag(tmp_path: Path) -> Callable[[Callable[[Bag], None]], Path]:
    """Writes a bag with a function, and gives its path."""

    def make(fill: Callable[[Bag], None], name: str = "bag") -> Path:
        path = tmp_path / f"{name}.mcap"
        with BagWriter(path) as writer:
            fill(Bag(writer))
        return path

    return make


@pytest.fixture
def our_messages() -> None:
    try:
        require_types(get_typestore(Stores.ROS2_JAZZY), ["mrs_people_msgs/msg/People"])
    except BagError:
        pytest.skip("mrs_people_msgs is not installed")


def people_of(result: Result) -> dict[str, Any]:
    people: dict[str, Any] = result.report()["people"]
    return people


# ------------------------------------------------------------------------------- ground truth


@pytest.mark.parametrize("kind", ["Int8", "UInt8", "Int16", "UInt16", "Int32", "UInt32", "Int64"])
def test_visible_may_be_any_integer_array(make_bag, kind):
    def fill(bag: Bag) -> None:
        for ms in (0, 100):
            bag.truth(ms, (1, 1), (2, 2))
            bag.visible(ms + 3, (7, 0) if ms == 0 else (0, 1), kind)

    with BagReader(make_bag(fill)) as bag:
        truth = read_truth(bag)
    assert truth.visible.tolist() == [[True, False], [False, True]]


def test_one_visible_message_may_hold_for_all(make_bag):
    def fill(bag: Bag) -> None:
        for ms in (0, 100, 200):
            bag.truth(ms, (1, 1), (2, 2))
        bag.visible(0, (7, 0))

    with BagReader(make_bag(fill)) as bag:
        assert read_truth(bag).visible.tolist() == [[True, False]] * 3


def test_visible_for_another_number_of_people_is_refused(make_bag):
    path = make_bag(lambda bag: bag.truth(0, (1, 1), (2, 2), visible=(1, 1, 1)))
    with BagReader(path) as bag, pytest.raises(BagError, match="3 numbers for 2 people"):
        read_truth(bag)


def test_truth_of_another_type_is_refused(make_bag):
    def fill(bag: Bag) -> None:
        string = bag.make("std_msgs/msg/String", data="here")
        bag.write("/ground_truth/people_poses", 0, string)

    with BagReader(make_bag(fill)) as bag, pytest.raises(BagError, match=r"String.*PoseArray"):
        read_truth(bag)


def test_more_people_than_are_scored_are_refused(make_bag):
    crowd = make_bag(lambda bag: bag.truth(0, *[(0, n) for n in range(1001)]))
    with BagReader(crowd) as bag, pytest.raises(BagError, match="has 1001 people; allowed: 1000"):
        read_truth(bag)


def test_truth_above_the_memory_limit_is_refused(make_bag, monkeypatch):
    """One message determines the number of people for all others."""
    monkeypatch.setattr(truth_module, "MAX_PLACES", 100)

    def fill(bag: Bag) -> None:
        bag.truth(0, *[(0, n) for n in range(10)])
        for ms in range(1, 11):
            bag.truth(ms, (0, 0))

    with (
        BagReader(make_bag(fill)) as bag,
        pytest.raises(BagError, match="11 messages of up to 10 people; allowed: 100 places in all"),
    ):
        read_truth(bag)


@pytest.mark.usefixtures("our_messages")
def test_more_recorded_people_than_are_scored_are_refused(make_bag):
    crowd = make_bag(lambda bag: bag.people(0, *[(0, n) for n in range(1001)]))
    with (
        BagReader(crowd) as bag,
        pytest.raises(BagError, match="/tracked_people: has 1001 people; allowed: 1000"),
    ):
        read_recorded(bag)


@pytest.mark.usefixtures("our_messages")
def test_more_ids_than_are_scored_are_refused(make_bag, monkeypatch):
    monkeypatch.setattr(estimates, "MAX_IDS", 5)

    def fill(bag: Bag) -> None:
        for ms in range(6):
            bag.people(ms, (0, 0), ids=(ms + 1,))

    with (
        BagReader(make_bag(fill)) as bag,
        pytest.raises(BagError, match="/tracked_people has 6 ids; allowed: 5"),
    ):
        read_recorded(bag)


# ------------------------------------------------------------------------------------ recorded


NO_GHOSTS = {"times": 0, "median": None, "p95": None}


def recorded(bag: Bag) -> None:
    """Two people for 0.4 s at 10 Hz; the second is hidden from all robots in the last frame."""
    for index, ms in enumerate((0, 100, 200, 300, 400)):
        last = index == 4
        bag.truth(ms, (0.001 * ms, 0), (0, 3), visible=(9, 0) if last else (9, 50))
    # 20 ms late; the first person walks at 1 m/s. That of 300 is missing.
    bag.people(20, (0.02, 0.1), (0, 3), centre={2: (0.01, 1.5)})
    bag.people(120, (0.12, 0.2), (0, 3.3), centre={1: (0.12, 0.2), 2: (0.03, 2.45)})
    bag.people(220, (0.22, 0.0), (5, 5))
    bag.people(420, (0.42, 0.0), (0, 3.1))


@pytest.mark.usefixtures("our_messages")
def test_recorded_people_are_scored_unchanged(make_bag, tmp_path):
    path = make_bag(recorded)
    result = evaluate_bag(path)
    # At 420 the truth is still that of 400, where the walker was at (0.4, 0): 2 cm away.
    assert result.report() == {
        "frames": 5,
        "duration_s": pytest.approx(0.42),
        "people": {
            "true": 9,  # two in four frames, one in the last
            "estimates": 7,  # two in three frames and one in the last, where the other is ignored
            "matched": 6,
            "recall": pytest.approx(6 / 9),
            "precision": pytest.approx(6 / 7),
            "frames_without_false": 4,
            "error_m": {
                "mean": pytest.approx((0.1 + 0 + 0.2 + 0.3 + 0 + 0.02) / 6),
                "median": pytest.approx(0.06),  # of 0, 0, 0.02, 0.1, 0.2, 0.3
                "p95": pytest.approx(0.275),
                "max": pytest.approx(0.3),
            },
            "coverage_95": pytest.approx(5 / 6),  # sigma is 0.1; 0.3 is outside
            "moda": pytest.approx(1 - (3 + 1) / 9),
            "modp": pytest.approx(1 - (0.1 + 0 + 0.2 + 0.3 + 0 + 0.02) / 6 / 0.5),
            "by_visibility": {
                part: {"true": 0, "matched": 0, "recall": None}
                for part in ("below_0_50", "0_50_to_0_75", "from_0_75")
            },
            "ghost_s": NO_GHOSTS,  # who has no identity is not followed
        },
        "people_hidden": {
            "true": 1,  # in the last frame
            "estimates": 0,
            "matched": 0,
            "recall": 0.0,
            "precision": None,
            "frames_without_false": 5,
            "error_m": {"mean": None, "median": None, "p95": None, "max": None},
            "coverage_95": None,
            "ghost_s": NO_GHOSTS,
        },
        # True centres (0.02, 1.5) and (0.12, 1.5); two groups by their sizes: (0.06, 1.7).
        "group": {"centre_error_m": {"mean": pytest.approx(0.1), "p95": pytest.approx(0.19)}},
        "tracks": NO_TRACKS,
        "stragglers": NO_STRAGGLERS,
        "stages": {},
        "timing_ms": {},
    }
    assert [frame.missed.tolist() for frame in result.frames] == [[], [], [1], [0, 1], []]


@pytest.mark.usefixtures("our_messages")
def test_recorded_people_beside_scans_are_scored_only_on_request(make_bag):
    def fill(bag: Bag) -> None:
        recorded(bag)
        for ms in (0, 100):
            bag.pose_topic("robot_a", ms, 0, 0)
            bag.points("robot_a", ms, (0, 3))

    path = make_bag(fill)
    assert people_of(evaluate_bag(path, recorded=True))["matched"] == 6
    assert people_of(evaluate_bag(path, [PAPER]))["matched"] == 2


@pytest.mark.usefixtures("our_messages")
def test_recorded_is_refused_where_there_is_nothing_recorded():
    with pytest.raises(BagError, match="has 0 topics of mrs_people_msgs/msg/People"):
        evaluate_bag(FORMATION, recorded=True)


@pytest.mark.usefixtures("our_messages")
@pytest.mark.parametrize("topic", ["/tracked_people", "/people"], ids=["today", "old name"])
def test_identities_are_read_from_recorded_people(make_bag, topic):
    def fill(bag: Bag) -> None:
        ids, velocities = (7, 9), ((0.5, -1), NOBODY)
        bag.people(0, (1, 2), (3, 4), ids=ids, velocities=velocities, coasting=(9,), topic=topic)
        bag.people(100, (1, 2), topic=topic)
        bag.people(200, topic=topic)
        bag.people(300, (1, 2), (3, 4), ids=ids, hidden=(7,), topic=topic)

    with BagReader(make_bag(fill)) as bag:
        name, (tracked, found, empty, half) = read_recorded(bag)
    assert name == topic
    assert tracked.ids.tolist() == [7, 9]
    np.testing.assert_array_equal(tracked.velocities, [(0.5, -1), NOBODY])
    assert tracked.coasting.tolist() == [False, True]
    assert found.ids.tolist() == [0]
    assert np.isnan(found.velocities).all()
    assert found.velocities.shape == (1, 2)
    assert empty.ids.shape == (0,)
    assert empty.velocities.shape == (0, 2)
    assert (half.ids.tolist(), half.hidden.tolist()) == ([9, 7], [False, True])


def tracked(bag: Bag) -> None:
    """Two people for 0.5 s at 10 Hz, the first at 1 m/s; who follows the second changes."""
    for index in range(5):
        first, second = (0.1 * index, 0), (0, 3)
        bag.truth(100 * index, first, second, visible=(9, 9 if index < 4 else 0))
        bag.people(
            100 * index,
            first,
            *([(0, 3.1)] if index != 1 else []),
            *([(5, 5)] if index == 2 else []),
            ids=[(1, 2), (1,), (1, 4, 7), (1, 4), (1, 4)][index],
            velocities=[(1, 0.2), (0, 0), (9, 9)][: 1 if index == 1 else 3 if index == 2 else 2],
            coasting=(1,) if index == 3 else (),
        )


#: Of nine frames of people one is missed, and one gets another identity; one track is false.
TRACKED = {
    "mota": pytest.approx(1 - (1 + 1 + 1) / 9),
    "motp_m": pytest.approx(0.3 / 8),
    "idf1": pytest.approx(2 * 7 / (9 + 9)),  # five of 1, two of 4
    "idp": pytest.approx(7 / 9),
    "idr": pytest.approx(7 / 9),
    "id_switches": 1,
    "switches_per_person_minute": pytest.approx(60 / 0.9),
    "fragments": 1,
    "mostly_tracked": 0.5,  # the second in three of four frames
    "mostly_lost": 0.0,
    # 0.1 for the pair at 0.1 m, with a false one beside; nobody for the second.
    "gospa": pytest.approx((0.1 + 0.08**0.5 + (0.01 + 0.08) ** 0.5 + 0.1 + 0) / 5),
    "velocity_error_mps": {"mean": pytest.approx(5 * 0.2 / 8), "p95": pytest.approx(0.2)},
}


@pytest.mark.usefixtures("our_messages")
def test_identities_are_scored(make_bag, tmp_path):
    one, two = make_bag(tracked, "one"), make_bag(tracked, "a_longer_name_than_the_other")
    file = tmp_path / "figures.json"
    result = run_mrs("evaluate", one, "--json", file)
    assert result.exit_code == 0, result.output
    assert json.loads(file.read_text())["tracks"] == TRACKED
    assert max(map(len, result.output.splitlines())) <= 80

    result = run_mrs("evaluate", one, two, "--json", file)
    total = json.loads(file.read_text())["total"]["tracks"]
    assert total == {**TRACKED, "id_switches": 2, "fragments": 2}
    lines = [line for line in result.output.splitlines() if "tracks (" in line or "total" in line]
    assert len(lines) == 5  # people, detections, hidden, and the title and total of tracks
    # MOTA, IDF1, switches, those a minute, fragments, MOTP, GOSPA, velocity: mean, p95
    figures = ["0.667", "0.778", "2", "66.67", "2", "3.8", "15.7", "12.5", "20.0"]
    assert lines[-1].split()[1:] == figures


def partly_visible(bag: Bag) -> None:
    """Three people for 0.5 s at 10 Hz, of whom 30 %, 50 % and all are visible; who is found varies.

    In the last frame nobody has to find the second.
    """
    people = ((0, 0), (0, 3), (0, 6))
    for k in range(5):
        bag.truth(100 * k, *people, visible=(30, 50 if k < 4 else 0, 100))
        bag.percent(100 * k, (30, 50, 100))
        bag.people(100 * k, *(people if k < 3 else people[1:]))


@pytest.mark.usefixtures("our_messages")
def test_recall_is_told_by_how_much_of_people_is_visible(make_bag, tmp_path):
    path, file = make_bag(partly_visible), tmp_path / "figures.json"
    result = run_mrs("evaluate", path, "--json", file)
    assert result.exit_code == 0, result.output
    assert json.loads(file.read_text())["people"]["by_visibility"] == {
        "below_0_50": {"true": 5, "matched": 3, "recall": 0.6},
        "0_50_to_0_75": {"true": 4, "matched": 4, "recall": 1.0},
        "from_0_75": {"true": 5, "matched": 5, "recall": 1.0},
    }
    rows = [line.split()[1:] for line in result.output.splitlines()]
    assert ["5", "0.600", "4", "1.000", "5", "1.000"] in rows


def with_ghosts(bag: Bag) -> None:
    """Two people for 2 s at 10 Hz; the second leaves the view after 1 s, and walks on at 1 m/s.

    They are in `persons` for 0.4 s more, and `hidden` at their side for 0.3 s more.
    """
    for k in range(20):
        first, second = (0, 3), (0.1 * k, 0)
        bag.truth(100 * k, first, second, visible=(9, 9 if k < 10 else 0))
        places = [first, second] if k < 14 else [first, (0.1 * k, 0.3)] if k < 17 else [first]
        coasting, hidden = (2,) if 10 <= k < 14 else (), (2,) if k >= 14 else ()
        ids = (1, 2)[: len(places)]
        bag.people(100 * k, *places, ids=ids, coasting=coasting, hidden=hidden)


@pytest.mark.usefixtures("our_messages")
def test_people_in_view_and_those_who_are_hidden_are_scored_by_themselves(make_bag, tmp_path):
    path, file = make_bag(with_ghosts), tmp_path / "figures.json"
    result = run_mrs("evaluate", path, "--json", file)
    assert result.exit_code == 0, result.output
    report = json.loads(file.read_text())
    people, hidden = report["people"], report["people_hidden"]
    # Who is reported in view, and whom nobody sees, is ignored.
    assert (people["true"], people["matched"], people["estimates"]) == (30, 30, 30)
    assert (hidden["true"], hidden["matched"], hidden["estimates"]) == (10, 3, 3)
    assert hidden["error_m"]["mean"] == pytest.approx(0.3)
    assert people["ghost_s"] == {"times": 1, "median": 0.3, "p95": 0.3}
    assert hidden["ghost_s"] == {"times": 1, "median": 0.6, "p95": 0.6}
    (line,) = (line for line in result.output.splitlines()[-40:] if " 0.300 " in line)
    # unseen, hidden, found, recall, precision, mean; left, ghosts in view and at all
    figures = ["10", "3", "3", "0.300", "1.000", "30.0", "1", "0.30", "0.30", "0.60", "0.60"]
    assert line.split()[1:] == figures


def with_a_straggler(bag: Bag) -> None:
    """Four people for 6 s at 10 Hz; the third crosses 2.5 m at 1.5 s and is flagged at 1.9 s.

    The first, who is with the group, and the fourth, who has none, are flagged wrongly.
    """
    for k in range(60):
        people = ((2, 0), (1, 0), (-1.0 - 0.1 * (k - 10) if k > 10 else 0.0, 0), (1, 1))
        bag.truth(100 * k, *people)
        bag.group(100 * k, (1, 1, 1, 0))
        flags = [3] * (k >= 19) + [1] * (k == 40) + [4] * (k >= 50)
        bag.people(100 * k, *people, ids=(1, 2, 3, 4), centre={4: (1, 0)}, stragglers=flags)


@pytest.mark.usefixtures("our_messages")
def test_stragglers_are_scored(make_bag, tmp_path):
    one, two = make_bag(with_a_straggler, "one"), make_bag(with_a_straggler, "two")
    other = make_bag(tracked, "nobody")
    file = tmp_path / "figures.json"
    result = run_mrs("evaluate", one, two, other, "--json", file)
    assert result.exit_code == 0, result.output
    figures = json.loads(file.read_text())
    assert figures["bags"]["nobody"]["stragglers"] == NO_STRAGGLERS
    assert figures["bags"]["two"]["stragglers"] == {
        "true": 1, "flagged": 1, "within_1_s": 1.0, "unseen": 0, "false": 2,
        "minutes": pytest.approx(0.1),
        "delay_s": {"mean": pytest.approx(0.4), "max": pytest.approx(0.4)},
    }  # fmt: skip
    total = figures["total"]["stragglers"]
    assert (total["true"], total["flagged"], total["false"]) == (2, 2, 4)
    (head,) = [line for line in result.output.splitlines() if line.startswith("stragglers (")]
    rest = result.output[result.output.index(head) :].splitlines()
    (line,) = [line for line in rest if line.startswith("total")]
    assert line.split() == ["total", "2", "2", "1.000", "0.40", "0.40", "0", "4", "0.2"]
    assert max(map(len, result.output.splitlines())) <= 80


def test_true_groups_are_checked_and_belong_to_the_nearest_message(make_bag):
    def fill(bag: Bag) -> None:
        bag.group(-20, (0, 3))
        bag.truth(0, (1, 2), (3, 4))
        bag.group(90, (1, 2))
        bag.truth(100, (1, 2), (3, 4))

    with BagReader(make_bag(fill)) as bag:
        found = read_truth(bag).groups
    assert found is not None
    assert found.tolist() == [[0, 3], [1, 2]]
    with BagReader(make_bag(tracked_truth, "without")) as bag:
        assert read_truth(bag).groups is None

    def wrong(bag: Bag) -> None:
        bag.truth(0, (1, 2), (3, 4))
        bag.group(0, (1,))

    with (
        BagReader(make_bag(wrong, "wrong")) as bag,
        pytest.raises(BagError, match="/ground_truth/group has 1 numbers for 2 people"),
    ):
        read_truth(bag)


def tracked_truth(bag: Bag) -> None:
    bag.truth(0, (1, 2), visible=(1,))


@pytest.mark.usefixtures("our_messages")
def test_recorded_people_with_duplicate_ids_are_refused(make_bag):
    path = make_bag(lambda bag: bag.people(0, (1, 2), (3, 4), (5, 6), (7, 8), ids=(0, 0, 5, 5)))
    with (
        BagReader(path) as bag,
        pytest.raises(BagError, match=r"/tracked_people: .*twice: \[5, 5\]"),
    ):
        read_recorded(bag)


def test_identities_are_taken_from_the_planner(make_bag):
    (interval, *_) = BagRun(make_bag(team_of_two), [PAPER]).intervals()
    memoryless = estimate_of(interval.people)
    assert memoryless.ids.tolist() == [0, 0]
    assert np.isnan(memoryless.velocities).all()
    assert not memoryless.coasting.any()
    one, other = interval.people.persons
    followed = dataclasses.replace(one, id=3, velocity=np.array([1.0, 0.5]), coasting=True)
    tracked = estimate_of(dataclasses.replace(interval.people, persons=(followed, other)))
    assert tracked.ids.tolist() == [0, 3]  # by id
    np.testing.assert_array_equal(tracked.velocities, [NOBODY, (1.0, 0.5)])
    assert tracked.coasting.tolist() == [False, True]
    assert tracked.stragglers == ()
    group = dataclasses.replace(interval.people.groups[0], stragglers={7: 0.5, 3: 12.0})
    parted = dataclasses.replace(interval.people, groups=(group, group))
    assert estimate_of(parted).stragglers == (3, 7)


# --------------------------------------------------------------------------------- planner only


def team_of_two(bag: Bag) -> None:
    """Two robots look at each other across two people; their scans are 10 ms apart, at 10 Hz."""
    for ms in range(0, 401, 20):
        bag.pose_topic("robot_a", ms, 0, 0)
        bag.pose_topic("robot_b", ms, 6, 0, math.pi)
    for ms in (0, 100, 200, 300):
        bag.truth(ms, (2, 1), (4, -1))
        bag.points("robot_a", ms, (2, 1))
        bag.points("robot_b", ms + 10, (2.0, 1.06), at=ms + 10)  # at (4, -1.06) in the map


def test_points_and_poses_run_through_the_planner_only(make_bag):
    run = BagRun(make_bag(team_of_two), [PAPER])
    intervals = list(run.intervals())
    stamps = [i.people.stamp_ns - START_NS for i in intervals]
    assert stamps == [10 * MS, 110 * MS, 210 * MS, 310 * MS]
    for interval in intervals:
        assert list(interval.people.poses) == ["robot_a", "robot_b"]
        np.testing.assert_allclose(
            sorted(p.position.tolist() for p in interval.people.persons),
            [[2, 1], [4, -1.06]],
            atol=1e-6,
        )
    result = evaluate_bag(run)
    people = people_of(result)
    assert (people["true"], people["estimates"], people["matched"]) == (8, 8, 8)
    assert people["error_m"]["mean"] == pytest.approx(0.03, abs=1e-6)
    assert result.report()["group"]["centre_error_m"]["mean"] == pytest.approx(0.03, abs=1e-6)
    assert result.report()["stages"] == {}
    assert set(result.times_ms) >= {"fusion", "joining", "clustering", "planner"}
    assert result.notes == []


def test_map_masks_walls_on_request(make_bag, tmp_path):
    def fill(bag: Bag) -> None:
        bag.room(0, 14.0, 1.6)  # both people are beyond its walls, at y = 0.8 and -0.8
        bag.room(250, 14.0, 6.0)  # then nobody does
        team_of_two(bag)

    def found(run: BagRun) -> list[int]:
        return [len(interval.people.persons) for interval in run.intervals()]

    path = make_bag(fill)
    assert found(BagRun(path, [PAPER])) == [2, 2, 2, 2]
    run = BagRun(path, [PAPER], use_map=True)
    assert found(run) == [0, 0, 0, 2]
    assert run.notes == []
    config = tmp_path / "map.yaml"
    config.write_text("/**/planner_node: {ros__parameters: {masking: {occupancy_grid: true}}}")
    assert found(BagRun(path, [PAPER, config])) == [0, 0, 0, 2]
    figures = tmp_path / "figures.json"
    assert run_mrs("evaluate", path, "--config", PAPER, "--map", "--json", figures).exit_code == 0
    assert json.loads(figures.read_text())["people"]["estimates"] == 2


def test_missing_or_unusable_map_is_noted(make_bag):
    run = BagRun(make_bag(team_of_two), [PAPER], use_map=True)
    assert [len(interval.people.persons) for interval in run.intervals()] == [2, 2, 2, 2]
    assert run.notes == ["masking.occupancy_grid is true, but the bag has no /map"]

    def fill(bag: Bag) -> None:
        bag.room(0, 14.0, 1.6, frame="odom")
        team_of_two(bag)

    run = BagRun(make_bag(fill, "other"), [PAPER], use_map=True)
    assert [len(interval.people.persons) for interval in run.intervals()] == [2, 2, 2, 2]
    assert run.notes == ["/map: frame_id is 'odom'; wanted: 'map'"]
    assert run.dropped == {"/map": 1}


def test_intervals_close_when_the_live_planner_would_close_them(make_bag):
    def fill(bag: Bag) -> None:
        for ms in range(0, 1001, 20):
            bag.pose_topic("robot_a", ms, 0, 0)
            bag.pose_topic("robot_b", ms, 6, 0, math.pi)
        bag.points("robot_a", 0, (2, 1))
        bag.points("robot_b", 10, (2, 1))
        bag.points("robot_a", 200, (2, 1))  # robot_b is silent: max_wait passes at 300
        bag.points("robot_a", 400, (2, 1))
        bag.points("robot_b", 460, (2, 1))  # soon enough
        bag.points("robot_b", 700, (2, 1))
        bag.points("robot_b", 740, (2, 1))  # takes the place of the one before

    intervals = list(BagRun(make_bag(fill), [PAPER]).intervals())
    made = [
        (
            (i.closed_ns - START_NS) // MS,
            {robot: (pose.stamp_ns - START_NS) // MS for robot, pose in i.people.poses.items()},
        )
        for i in intervals
    ]
    # Poses come every 20 ms: at 20 the scan of 10 can be placed between two of them.
    assert made == [
        (20, {"robot_a": 0, "robot_b": 10}),
        (300, {"robot_a": 200}),
        (460, {"robot_a": 400, "robot_b": 460}),
        (800, {"robot_b": 740}),
    ]


def test_interval_closes_without_further_messages(make_bag):
    def fill(bag: Bag) -> None:
        for robot in ("robot_a", "robot_b"):
            for ms in (0, 100):
                bag.pose_topic(robot, ms, 0, 0)
            bag.points(robot, 0, (2, 1))
        bag.points("robot_a", 100, (2, 1))  # robot_b is waited for until 200
        bag.points("robot_a", 230, (2, 1))  # and this one does not replace the one before

    stamps = [i.people.stamp_ns - START_NS for i in BagRun(make_bag(fill), [PAPER]).intervals()]
    assert stamps == [0, 100 * MS, 230 * MS]


def test_the_last_interval_closes_after_the_end(make_bag):
    def fill(bag: Bag) -> None:
        for ms in (0, 100):
            bag.pose_topic("robot_a", ms, 0, 0)
            bag.pose_topic("robot_b", ms, 6, 0, math.pi)
        for ms in (0, 100):
            bag.points("robot_a", ms, (2, 1))
        bag.points("robot_b", 0, (2, 1))  # and then no more

    _, last = BagRun(make_bag(fill), [PAPER]).intervals()
    assert (last.closed_ns - START_NS) // MS == 200


def test_unusable_messages_are_counted_and_named(make_bag):
    def fill(bag: Bag) -> None:
        team_of_two(bag)
        bag.points("robot_a", 350, (math.nan, 0))
        bag.pose_topic("robot_b", 402, math.nan, 0)

    run = BagRun(make_bag(fill), [PAPER])
    assert len(list(run.intervals())) == 4
    assert run.dropped == {"/robot_a/points": 1, "/robot_b/pose": 1}
    assert any(re.search(r"robot_a: /robot_a/points: x is NaN", note) for note in run.notes)
    notes = list(run.notes)
    assert len(list(run.intervals())) == 4  # from the beginning again
    assert run.notes == notes
    assert run.dropped == {"/robot_a/points": 1, "/robot_b/pose": 1}


def test_silent_robot_is_noted_and_all_silent_is_an_error(make_bag):
    def one_is_silent(bag: Bag) -> None:
        bag.pose_topic("robot_a", 0, 0, 0)
        bag.pose_topic("robot_a", 100, 0, 0)
        bag.points("robot_a", 50, (2, 1))
        bag.pose_topic("robot_b", 0, 0, 0)
        bag.points("robot_b", 50, (math.inf, 0))

    run = BagRun(make_bag(one_is_silent), [PAPER])
    assert len(list(run.intervals())) == 1
    assert any(note.startswith("robot_b: no scan: /robot_b/points: x is") for note in run.notes)

    def both_are(bag: Bag) -> None:
        bag.pose_topic("robot_a", 0, 0, 0)
        bag.points("robot_a", 50, (math.inf, 0))

    with pytest.raises(BagError, match=r"bad\.mcap: robot_a: no scan: /robot_a/points: x is"):
        list(BagRun(make_bag(both_are, "bad"), [PAPER]).intervals())


def test_no_truth_leaves_the_figures_undefined(make_bag):
    def fill(bag: Bag) -> None:
        for ms in (0, 100):
            bag.pose_topic("robot_a", ms, 0, 0)
        bag.points("robot_a", 50, (2, 1))

    result = evaluate_bag(make_bag(fill), [PAPER])
    assert len(result.estimates) == 1
    people = people_of(result)
    assert (people["true"], people["estimates"], people["recall"]) == (0, 0, None)
    assert any("nothing to compare with" in note for note in result.notes)


def test_no_people_found_is_recall_0(make_bag):
    def fill(bag: Bag) -> None:
        for ms in (0, 100):
            bag.pose_topic("robot_a", ms, 0, 0)
            bag.points("robot_a", ms)
            bag.truth(ms, (2, 1), NOBODY)

    people = people_of(evaluate_bag(make_bag(fill), [PAPER]))
    assert (people["true"], people["estimates"]) == (2, 0)
    assert (people["recall"], people["precision"]) == (0.0, None)


# ---------------------------------------------------------------------------- paper's formation


@pytest.fixture(scope="module")
def formation() -> Result:
    return evaluate_bag(FORMATION, [PAPER])


def test_all_five_people_of_the_formation_are_found(formation):
    report = formation.report()
    assert report["frames"] == 15
    assert report["duration_s"] == pytest.approx(3.0, abs=0.05)
    people = report["people"]
    assert (people["true"], people["matched"]) == (75, 75)
    assert people["precision"] == 1.0
    assert people["error_m"]["mean"] < 0.05  # the paper's 5 cm
    assert (
        people["error_m"]["median"] <= people["error_m"]["p95"] <= people["error_m"]["max"] < 0.14
    )


def test_stages_of_the_formation_are_means_per_view(formation):
    stages = formation.report()["stages"]
    assert list(stages) == ["robot_a", "robot_b", "robot_c"]
    for robot, means in stages.items():
        assert len(formation.counts[robot]) == 15
        assert 0.8 < means["valid_pixels"] <= 1.0
        assert means["raw"] <= means["valid_pixels"] * 160 * 120
        assert means["raw"] > means["cropped"] > means["foreground"] > means["cells"] > 50
        for stage, before in (
            ("cropped", "raw"),
            ("foreground", "cropped"),
            ("cells", "foreground"),
        ):
            assert means[f"{stage}_kept"] == pytest.approx(means[stage] / means[before])
        assert means["removed"] == pytest.approx(means["raw"] - means["cells"])
    assert stages["robot_a"]["removed"] > 15000  # as the paper says of its Ra
    assert set(formation.report()["timing_ms"]) >= {"disparity", "robot", "clustering", "planner"}
    for times in formation.report()["timing_ms"].values():
        assert 0 <= times["median"] <= times["p99"]


def test_top_camera_is_used_by_default(tmp_path):
    binocular = tmp_path / "binocular.yaml"
    binocular.write_text("/**/robot_node: {ros__parameters: {images: {top: false}}}\n")
    assert BagRun(FORMATION).team.robots["robot_a"].images.top
    assert not BagRun(FORMATION).team.robots["robot_b"].images.top
    assert not BagRun(FORMATION, [binocular]).team.robots["robot_a"].images.top


def copy_formation(out: Path, change: Callable[[str, Any], tuple[str, Any] | None]) -> Path:
    """Copies the bag with changed topics and messages; None leaves a message out."""
    with BagReader(FORMATION) as bag, BagWriter(out) as writer:
        for topic, ns, message in bag.decoded():
            changed = change(topic, message)
            if changed is not None:
                writer.write(changed[0], ns, changed[1])
    return out


@pytest.mark.parametrize("says_rectified", [False, True])
def test_raw_images_are_rectified_if_the_bag_has_no_others(tmp_path, formation, says_rectified):
    def raw(topic: str, message: Any) -> tuple[str, Any]:
        if topic.endswith("camera_info"):  # no distortion: rectifying changes nothing
            k = np.array(
                [[message.p[0], 0, message.p[2]], [0, message.p[5], message.p[6]], [0, 0, 1]]
            )
            message = dataclasses.replace(
                message, k=k.reshape(-1), d=np.zeros(5), r=np.eye(3).reshape(-1)
            )
        return topic.replace("image_rect", "image_raw"), message

    path = copy_formation(tmp_path / "raw.mcap", raw)
    configs = [PAPER]
    if says_rectified:
        (tmp_path / "rect.yaml").write_text(
            "/**/robot_node: {ros__parameters: {images: {rectified: true}}}\n"
        )
        configs.append(tmp_path / "rect.yaml")
    result = evaluate_bag(path, configs)
    noted = any("only raw images" in note for note in result.notes)
    assert noted == says_rectified
    before, after = (r.report()["people"]["error_m"]["mean"] for r in (formation, result))
    assert after == pytest.approx(before, abs=1e-3)


def moved(topic: str, message: Any) -> tuple[str, Any]:
    """Odometry that begins where the robot is."""
    if topic.endswith("/odom"):
        header = dataclasses.replace(message.header, frame_id="odom")
        pose = dataclasses.replace(
            message.pose.pose,
            position=dataclasses.replace(message.pose.pose.position, x=0.0, y=0.0),
            orientation=dataclasses.replace(message.pose.pose.orientation, z=0.0, w=1.0),
        )
        pose = dataclasses.replace(message.pose, pose=pose)
        message = dataclasses.replace(message, header=header, pose=pose)
    return topic, message


def test_odometry_in_a_frame_of_its_own_needs_map_from_odom(tmp_path, formation):
    path = copy_formation(tmp_path / "moved.mcap", moved)
    with pytest.raises(PoseError, match=r"moved\.mcap: /robot_\w/odom: frame_id is 'odom'.*config"):
        evaluate_bag(path, [PAPER])
    where = tmp_path / "where.yaml"
    where.write_text(
        "/robot_a/robot_node: {ros__parameters: {pose: {map_from_odom: [6.3, 3.55, 3.14159265]}}}\n"
        "/robot_b/robot_node: {ros__parameters: {pose: {map_from_odom: [0.2, 2.0, 0.35]}}}\n"
        "/robot_c/robot_node: {ros__parameters: {pose: {map_from_odom: [0.2, 5.2, -0.35]}}}\n"
    )
    people = people_of(evaluate_bag(path, [PAPER, where]))
    assert people["matched"] == 75
    wanted = formation.report()["people"]["error_m"]["mean"]
    assert people["error_m"]["mean"] == pytest.approx(wanted, abs=1e-3)
    # The same file, when it lies beside the bag, needs not be named, and is the last to speak.
    where.rename(tmp_path / "moved.yaml")
    astray = tmp_path / "astray.yaml"
    astray.write_text("/**/robot_node: {ros__parameters: {pose: {map_from_odom: [9, 9, 0]}}}\n")
    assert overridden_beside(path, [PAPER, astray]) == (
        "moved.yaml beside the bag goes before paper.yaml, astray.yaml for pose.map_from_odom; "
        "--no-own-config ignores it"
    )
    result = evaluate_bag(path, [PAPER, astray])
    assert people_of(result)["matched"] == 75
    assert any("moved.yaml, which lies beside the bag" in note for note in result.notes)
    with pytest.raises(PoseError):
        evaluate_bag(path, [PAPER], beside=False)


def test_static_heads_need_no_odometry(tmp_path, formation):
    """Their poses are given in the same way as `map_from_odom` above."""

    def unplaced(topic: str, message: Any) -> tuple[str, Any]:
        return topic.replace("/odom", "/wheels"), message

    path = copy_formation(tmp_path / "unplaced.mcap", unplaced)
    where = tmp_path / "where.yaml"
    where.write_text(
        "/**/robot_node: {ros__parameters: {pose: {source: static}}}\n"
        "/robot_a/robot_node: {ros__parameters: {pose: {static: [6.3, 3.55, 3.14159265]}}}\n"
        "/robot_b/robot_node: {ros__parameters: {pose: {static: [0.2, 2.0, 0.35]}}}\n"
        "/robot_c/robot_node: {ros__parameters: {pose: {static: [0.2, 5.2, -0.35]}}}\n"
    )
    people = people_of(evaluate_bag(path, [PAPER, where]))
    assert people["matched"] == 75
    wanted = formation.report()["people"]["error_m"]["mean"]
    assert people["error_m"]["mean"] == pytest.approx(wanted, abs=1e-3)
    with pytest.raises(BagError, match="no pose"):
        evaluate_bag(path, [PAPER])
    nowhere = tmp_path / "nowhere.yaml"
    nowhere.write_text("/**/robot_node: {ros__parameters: {pose: {source: static}}}\n")
    with pytest.raises(ConfigError, match=r"pose\.static is empty"):
        evaluate_bag(path, [PAPER, nowhere])


def test_poses_may_come_on_pose_in(tmp_path, formation):
    kind = default_typestore().types["geometry_msgs/msg/PoseWithCovarianceStamped"]

    def pose_in(topic: str, message: Any) -> tuple[str, Any]:
        if topic.endswith("/odom"):
            return topic.replace("odom", "pose_in"), kind(message.header, message.pose)
        return topic, message

    path = copy_formation(tmp_path / "pose_in.mcap", pose_in)
    assert people_of(evaluate_bag(path, [PAPER])) == formation.report()["people"]


def test_robots_follow_the_bag_and_the_configuration(tmp_path):
    team = tmp_path / "team.yaml"
    team.write_text("/**/planner_node: {ros__parameters: {robots: [robot_b, robot_c, robot_d]}}\n")
    run = BagRun(FORMATION, [team])
    assert run.team.planner.robots == ("robot_b", "robot_c")
    assert "the bag has nothing of robot_d" in run.notes
    assert "the configuration leaves out robot_a" in run.notes
    team.write_text(
        "/robot_b/robot_node: {ros__parameters: {mounting: {height: 1.5}}}\n"
        "/robot_x/robot_node: {ros__parameters: {mounting: {height: 0.5}}}\n"
    )
    run = BagRun(FORMATION, [team])
    assert run.team.planner.robots == ("robot_a", "robot_b", "robot_c")
    assert run.team.robots["robot_b"].mounting.height == 1.5
    assert run.notes == ["the bag has nothing of robot_x"]
    team.write_text("/**/planner_node: {ros__parameters: {robots: [robot_x]}}\n")
    with pytest.raises(BagError, match="none of the configured robots robot_x"):
        BagRun(FORMATION, [team])


def test_a_wrong_parameter_is_an_error(tmp_path):
    wrong = tmp_path / "wrong.yaml"
    wrong.write_text("/**/robot_node: {ros__parameters: {zones: {hihg: 1.4}}}\n")
    with pytest.raises(ConfigError, match=r"zones\.hihg.*did you mean zones\.high"):
        evaluate_bag(FORMATION, [wrong])


@pytest.mark.parametrize(
    ("text", "counts"),
    [
        ("/**/robot_node: {ros__parameters: {}}\n", True),
        ("people: 5\norigin: elsewhere\n", False),
        ("- a list\n", False),
        ("{", False),
    ],
)
def test_only_a_parameter_file_beside_the_bag_is_read(tmp_path, text, counts):
    file = tmp_path / "scene.yaml"
    file.write_text(text)
    wanted = file if counts else None
    assert file_beside(tmp_path / "scene.mcap") == wanted
    assert file_beside(tmp_path / "scene") == wanted
    assert file_beside(tmp_path / "other") is None


def test_other_methods_can_be_passed():
    class Blind:
        def __init__(self, config: Any) -> None:
            self.planner = Planner(config)

        def step(self, scans: Any, poses: Any, time_ns: int) -> Any:
            return self.planner.step(scans[:1], poses, time_ns)

    result = evaluate_bag(BagRun(FORMATION, [PAPER], planner=Blind))
    assert people_of(result)["recall"] < 1.0


def test_unsuitable_calibration_is_reported_in_one_line(tmp_path):
    def crossed(topic: str, message: Any) -> tuple[str, Any]:
        swap = {"left": "right", "right": "left"}
        return re.sub("left|right", lambda m: swap[m[0]], topic), message

    path = copy_formation(tmp_path / "crossed.mcap", crossed)
    with pytest.raises(BagError, match="are left and right swapped"):
        evaluate_bag(path)


def test_head_looking_steeply_down_is_reported_in_one_line(tmp_path):
    def narrow(topic: str, message: Any) -> tuple[str, Any]:
        if topic.endswith("camera_info"):
            message.p = message.p * np.where(np.isin(np.arange(12), (0, 3, 5, 7)), 3.0, 1.0)
        return topic, message

    path = copy_formation(tmp_path / "narrow.mcap", narrow)
    config = tmp_path / "down.yaml"
    ranges = "disparity: {min_range: 2.0}, mounting: {pitch: 1.5}"
    config.write_text(f"/**/robot_node: {{ros__parameters: {{{ranges}}}}}\n")
    with pytest.raises(BagError, match="bodies.search is true but the head looks steeply down"):
        evaluate_bag(path, [config])
    cells = ranges + ", bodies: {search: false}"
    config.write_text(f"/**/robot_node: {{ros__parameters: {{{cells}}}}}\n")
    assert evaluate_bag(path, [config]).report()["frames"] > 0


def test_encodings_of_zed_and_opencv_are_read(tmp_path, formation):
    """One robot with alpha, one with 8UC1, one with 8UC3, of the same grey: no figure changes."""
    layers = {"robot_a": ("bgra8", 4), "robot_b": ("8UC1", 1), "robot_c": ("8UC3", 3)}

    def named(topic: str, message: Any) -> tuple[str, Any]:
        if topic.endswith("image_rect"):
            encoding, channels = layers[topic.split("/")[1]]
            message = dataclasses.replace(
                message,
                encoding=encoding,
                step=message.width * channels,
                data=np.repeat(message.data, channels),
            )
        return topic, message

    path = copy_formation(tmp_path / "named.mcap", named)
    assert same_figures(evaluate_bag(path, [PAPER]).report(), formation.report())


def test_unsynchronized_pairs_are_reported(tmp_path):
    def late(topic: str, message: Any) -> tuple[str, Any]:
        if topic.endswith("right/image_rect"):
            stamp = message.header.stamp
            stamp = dataclasses.replace(stamp, nanosec=stamp.nanosec + 12 * MS)
            header = dataclasses.replace(message.header, stamp=stamp)
            message = dataclasses.replace(message, header=header)
        return topic, message

    path = copy_formation(tmp_path / "late.mcap", late)
    with pytest.raises(
        BagError, match=r"0\.0120 s; allowed by images\.max_stamp_difference: 0\.005"
    ):
        evaluate_bag(path)
    apart = tmp_path / "apart.yaml"
    apart.write_text("/**/robot_node: {ros__parameters: {images: {max_stamp_difference: 0.012}}}\n")
    assert people_of(evaluate_bag(path, [apart]))["matched"] > 0


# ---------------------------------------------------------------------------------- hand labels


def labelled(folder: Path, name: str, **changes: Any) -> Path:
    """Labels of `team_of_two`: only the first of the two people has to be found."""
    people = [
        {"frame": frame, "id": 1 + who, "head": head, "trunk": trunk, "must": who == 0,
         "posture": "stands", "source": "head"}
        for frame in range(4)
        for who, (head, trunk) in enumerate((([2.0, 1.1], [2.0, 1.0]), ([4.6, -1.06], None)))
    ]  # fmt: skip
    document = {
        "first_ns": START_NS, "step_ns": 100 * MS, "frames": 4, "follow": True, "people": people,
    }  # fmt: skip
    file = folder / name
    file.write_text(json.dumps({**document, **changes}))
    return file


def test_labels_beside_a_bag_replace_its_truth(make_bag, tmp_path):
    bag = make_bag(team_of_two)
    labelled(tmp_path, "bag.labels.json")
    result = evaluate_bag(bag, [PAPER])
    people = people_of(result)
    # The second person is 0.6 m from their label, which need not be found.
    assert (people["true"], people["matched"], people["estimates"]) == (4, 4, 4)
    assert people["error_m"]["mean"] == pytest.approx(0.1, abs=1e-6)
    assert people["moda"] == 1.0
    assert "the truth is that of bag.labels.json" in result.notes
    unlabelled = people_of(evaluate_bag(bag, [PAPER], beside=False))
    assert unlabelled["true"] == 8


def test_labels_may_be_named_by_file_or_folder(make_bag, tmp_path):
    bag = make_bag(team_of_two)
    (tmp_path / "labels").mkdir()
    file = labelled(tmp_path / "labels", "bag.labels.json")
    figures = tmp_path / "figures.json"
    for labels in (file, file.parent):
        args = ("evaluate", bag, "-c", PAPER, "--labels", labels, "--json", figures)
        assert run_mrs(*args).exit_code == 0
        assert json.loads(figures.read_text())["people"]["true"] == 4
    refused = run_mrs("evaluate", bag, "--labels", tmp_path)
    assert refused.exit_code == 1
    assert re.fullmatch(r"error: .*bag\.labels\.json cannot be read.*\n", refused.stderr)


def test_labels_of_another_recording_are_refused(make_bag, tmp_path):
    bag = make_bag(team_of_two)
    labelled(tmp_path, "bag.labels.json", first_ns=START_NS + 900 * MS)
    with pytest.raises(BagError, match=r"bag\.labels\.json labels .*another recording\?"):
        evaluate_bag(bag, [PAPER])


def test_people_are_not_followed_where_the_labels_exclude_it(make_bag, tmp_path):
    bag = make_bag(team_of_two)

    def ids(**options: Any) -> set[int]:
        result = evaluate_bag(bag, **options)
        return {int(one) for estimate in result.estimates for one in estimate.ids}

    assert ids() != {0}
    labelled(tmp_path, "bag.labels.json", follow=False)
    assert ids() == {0}
    assert ids(tracking=True) != {0}
    labelled(tmp_path, "bag.labels.json", follow=True)
    assert ids() != {0}
    assert ids(tracking=False) == {0}


# --------------------------------------------------------------------------------- command line


def run_mrs(*args: object) -> Any:
    return CliRunner().invoke(app, [str(arg) for arg in args])


def same_figures(one: dict[str, Any], other: dict[str, Any]) -> bool:
    """Equal but for what the clock says."""
    return {**one, "timing_ms": 0} == {**other, "timing_ms": 0}


def test_table_counts_people_found_as_the_demo_does():
    """Estimates include false ones and are not counted."""
    error = dict.fromkeys(("mean", "median", "p95", "max"), 0.1)
    people = {"true": 9, "estimates": 7, "matched": 6, "recall": 6 / 9, "precision": 6 / 7}
    report = {
        "frames": 5,
        "people": {**people, "error_m": error, "coverage_95": 1.0},
        "group": {"centre_error_m": {"mean": 0.1, "p95": 0.1}},
    }
    console = Console(width=100)
    with console.capture() as reported:
        console.print(tables._people_table({"a [b]": report}))
    assert re.search(r"bag +frames true found recall prec\.", reported.get())
    assert re.search(r"a \[b\] +5 +9 +6 +0\.667 +0\.857", reported.get())


def test_table_of_detections_shows_moda_modp_and_clean_frames():
    people = {"moda": 0.52, "modp": None, "frames_without_false": 4}
    console = Console(width=80)
    with console.capture() as reported:
        console.print(tables._detections_table({"one": {"frames": 5, "people": people}}))
    assert re.search(r"bag +MODA +MODP +frames +clean", reported.get())
    assert re.search(r"one +0\.520 +- +5 +4", reported.get())


def test_json_of_one_bag_has_all_keys(tmp_path, formation):
    file = tmp_path / "figures.json"
    result = run_mrs("evaluate", FORMATION, "--config", PAPER, "--json", file)
    assert result.exit_code == 0, result.output
    figures = json.loads(file.read_text())
    assert list(figures) == [
        "frames", "duration_s", "people", "people_hidden", "group", "tracks", "stragglers",
        "stages", "timing_ms",
    ]  # fmt: skip
    assert figures["tracks"] == NO_TRACKS
    assert figures["stragglers"] == NO_STRAGGLERS
    assert "MOTA" not in result.output
    assert list(figures["people"]) == [
        "true", "estimates", "matched", "recall", "precision", "frames_without_false", "error_m",
        "coverage_95", "moda", "modp", "by_visibility", "ghost_s",
    ]  # fmt: skip
    assert list(figures["stages"]["robot_a"]) == [
        "valid_pixels", "raw", "cropped", "foreground", "cells", "cropped_kept", "foreground_kept",
        "cells_kept", "removed",
    ]  # fmt: skip
    assert same_figures(figures, formation.report())
    assert "paper_formation" in result.output


@pytest.mark.parametrize("jobs", [1, 2])
def test_several_bags_give_a_row_each_and_a_total(make_bag, tmp_path, formation, jobs):
    two = make_bag(team_of_two, "two")
    file = tmp_path / "figures.json"
    result = run_mrs("evaluate", FORMATION, two, "-c", PAPER, "--json", file, "--jobs", jobs)
    assert result.exit_code == 0, result.output
    figures = json.loads(file.read_text())
    assert list(figures) == ["bags", "total"]
    assert list(figures["bags"]) == ["paper_formation", "two"]
    assert same_figures(figures["bags"]["paper_formation"], formation.report())
    total = figures["total"]
    assert total["frames"] == 19
    assert total["people"]["true"] == 83
    assert total["duration_s"] == sum(bag["duration_s"] for bag in figures["bags"].values())
    mean = (75 * formation.report()["people"]["error_m"]["mean"] + 8 * 0.03) / 83
    assert total["people"]["error_m"]["mean"] == pytest.approx(mean, abs=1e-6)
    assert total["stages"] == formation.report()["stages"]
    for name in ("paper_formation", "two", "total"):
        assert re.search(rf"^{name} ", result.output, re.MULTILINE)


def test_undefined_figures_are_null(make_bag, tmp_path):
    def fill(bag: Bag) -> None:
        for ms in (0, 100):
            bag.pose_topic("robot_a", ms, 0, 0)
            bag.points("robot_a", ms)

    file = tmp_path / "figures.json"
    assert run_mrs("evaluate", make_bag(fill), "--json", file).exit_code == 0
    people = json.loads(file.read_text())["people"]
    assert people["recall"] is None
    assert people["error_m"] == {"mean": None, "median": None, "p95": None, "max": None}
    assert json.loads(file.read_text())["group"]["centre_error_m"] == {"mean": None, "p95": None}


def test_plots_are_written(tmp_path):
    pytest.importorskip("matplotlib")
    result = run_mrs("evaluate", FORMATION, "-c", PAPER, "--plots", tmp_path / "plots")
    assert result.exit_code == 0, result.output
    files = sorted(f.name for f in (tmp_path / "plots").iterdir())
    assert files == ["errors.png", "stages.png"]
    for file in files:
        assert (tmp_path / "plots" / file).read_bytes().startswith(b"\x89PNG")


def test_errors_are_printed_in_one_line(tmp_path, make_bag):
    def no_robot(bag: Bag) -> None:
        bag.truth(0, (1, 1))

    for args, text in (
        ((tmp_path / "none",), "there is no such bag"),
        ((make_bag(no_robot),), "no robot, i.e. no namespace with left and right images"),
        ((FORMATION, FORMATION), "a bag is named twice"),
        ((FORMATION, "-c", tmp_path / "none.yaml"), "none.yaml: there is no such file"),
        ((FORMATION, "--json", tmp_path / "no" / "folder.json"), "cannot be written"),
    ):
        result = run_mrs("evaluate", *args)
        assert result.exit_code == 1
        assert re.fullmatch(rf"error: .*{re.escape(text)}.*\n", result.stderr), result.stderr


def test_names_distinguish_bags(tmp_path):
    bags = [tmp_path / "a" / "walk.mcap", tmp_path / "b" / "walk.mcap", tmp_path / "c" / "talk.v2"]
    assert names_of(bags) == ["a/walk.mcap", "b/walk.mcap", "talk.v2"]
    with pytest.raises(PeopleLocError, match="twice"):
        names_of([bags[0], bags[0]])


def test_pooling_does_not_modify_its_parts(formation):
    before = len(formation.frames)
    Result.pooled([formation, formation])
    assert len(formation.frames) == before
    assert as_json({"one": formation})["frames"] == before


def test_centres_beyond_the_float_range_are_infinite():
    with np.errstate(all="raise"):
        centre = estimates._centre([(4, (1e308, 0.0)), (3, (1e308, 1.0))])
    np.testing.assert_allclose(centre, [np.inf, 3 / 7])

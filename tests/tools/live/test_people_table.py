"""`mrs people`: what its tables say of a message; and messages read back as people."""

from __future__ import annotations

import dataclasses
import math
import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

pytest.importorskip("rclpy")
pytest.importorskip("rich", reason="the tables need rich")

from rich.console import Console

from mrs_people_loc.clusters import measure
from mrs_people_loc.messages import read_people
from mrs_people_loc.people import Group, Person
from mrs_people_loc.planner import People
from mrs_people_loc.team.fusion import fuse
from mrs_people_loc.team.poses import Pose
from mrs_ros import convert
from mrs_tools.live.people_table import LivePeople, follow_clock

SECOND = 1_000_000_000
WALKS = Person(
    position=np.array([1.25, -2.5]),
    covariance=np.array([[0.04, 0.01], [0.01, 0.09]]),
    height=1.75,
    sigma=0.125,
    robots=("robot_a", "robot_b"),
    label=-1,
    stamp_ns=5 * SECOND,
    id=3,
    velocity=np.array([0.6, 0.8]),
    velocity_covariance=np.array([[0.01, 0.0], [0.0, 0.02]]),
    age_s=12.5,
)
COASTS = Person(
    position=np.array([4.0, 0.5]),
    covariance=np.eye(2),
    height=1.5,
    sigma=0.25,
    robots=(),
    label=-1,
    stamp_ns=5 * SECOND,
    id=8,
    age_s=1.0,
    coasting=True,
)
HIDDEN = dataclasses.replace(
    COASTS, id=4, stamp_ns=3 * SECOND, seen_at=np.array([3.5, 0.25]), position=np.array([4.5, 0.5])
)
GROUP = Group(
    centre=np.array([2.0, 1.0]),
    covariance=0.25 * np.eye(2),
    radius=1.5,
    rms_spread=1.0,
    size=4,
    velocity=np.array([0.0, 0.25]),
    velocity_covariance=0.5 * np.eye(2),
    members=(1, 2, 4, 5),
    id=2,
    stragglers={3: 4.25, 8: 11.5},
)


def message_of(*persons: Person, groups: tuple[Group, ...] = ()) -> Any:
    nothing = fuse([], {})
    clusters = measure(nothing, np.empty(0, dtype=np.intp))
    poses = {"robot_a": Pose(5 * SECOND, 1.0, 2.0, math.pi / 2)}
    shown = tuple(person for person in persons if person.seen_at is None)
    hidden = tuple(person for person in persons if person.seen_at is not None)
    people = People(5 * SECOND, poses, shown, groups, nothing, clusters, hidden=hidden)
    return convert.people(people, "map")


def assert_same(one: Any, other: Any) -> None:
    assert type(one) is type(other)
    for name, value in vars(one).items():
        if isinstance(value, np.ndarray):
            np.testing.assert_array_equal(getattr(other, name), value, err_msg=name)
        else:
            assert getattr(other, name) == value, name


def test_sent_people_are_read():
    persons, groups = read_people(message_of(WALKS, COASTS, HIDDEN, groups=(GROUP,)), "map")
    assert len(persons) == 3
    assert_same(persons[0], WALKS)
    assert_same(persons[1], HIDDEN)
    assert_same(persons[2], COASTS)  # its velocity is not known
    assert len(groups) == 1
    assert_same(groups[0], GROUP)


def test_empty_message_gives_no_people():
    assert read_people(message_of(), "map") == ((), ())


class Ear:
    """A node, as far as `LivePeople` needs one.

    Attributes:
        heard: By topic, what takes its messages.
        types: By topic, the type that others publish.
        looks: What looks at the network from time to time.
    """

    def __init__(self) -> None:
        self.heard: dict[str, Any] = {}
        self.types: dict[str, str] = {}
        self.looks: list[Any] = []

    def create_subscription(self, _kind: Any, topic: str, handler: Any, _depth: int) -> None:
        self.heard[topic] = handler

    def create_timer(self, _period_s: float, look: Any, clock: Any) -> Any:
        self.looks.append(look)
        return SimpleNamespace(cancel=self.looks.clear)

    def resolve_topic_name(self, topic: str) -> str:
        return topic

    def get_publishers_info_by_topic(self, topic: str) -> list[Any]:
        return [SimpleNamespace(topic_type=self.types[topic])] if topic in self.types else []

    def get_clock(self) -> Any:
        return SimpleNamespace(now=lambda: SimpleNamespace(nanoseconds=5 * SECOND + 20_000_000))


@pytest.fixture
def live() -> Any:
    """What is shown, and what it listens to, by topic."""
    ear: Any = Ear()
    return LivePeople(ear), ear.heard


def shown(live: LivePeople) -> list[list[str]]:
    """The cells of all rows that hold any, and other lines as one."""
    console = Console(width=100, force_terminal=False)
    with console.capture() as reported:
        console.print(live)
    lines = reported.get().splitlines()
    return [[c for c in re.split(r"\s{2,}", line.strip()) if c] for line in lines]


def test_old_name_is_listened_to_only_while_a_planner_publishes_there():
    ear: Any = Ear()
    live = LivePeople(ear)
    for kind in (None, "people_msgs/msg/People"):
        ear.types |= {"people": kind} if kind else {}
        ear.looks[0]()
        assert "people" not in ear.heard
    ear.types["people"] = "mrs_people_msgs/msg/People"
    ear.looks[0]()
    assert not ear.looks
    ear.heard["people"](message_of(WALKS))
    assert shown(live)[0] == ["1 people, - Hz"]


def test_people_and_groups_are_shown(live, monkeypatch):
    monkeypatch.setattr("time.monotonic", lambda: 100.0)
    table, heard = live
    assert shown(table) == [
        ["waiting for people ... (is the planner running?)"],
        ["health: unknown (no node reports on /diagnostics)"],
    ]
    heard["tracked_people"](message_of(WALKS, COASTS, HIDDEN, groups=(GROUP,)))
    rows = shown(table)
    assert rows[0] == ["2 people, - Hz, and 1 hidden"]
    assert ["4", "4.50", "0.50", "-", "1.50", "1", "nobody for 2.0 s, last at 3.5, 0.2"] in rows
    assert ["3", "1.25", "-2.50", "1.00", "1.75", "12", "robot_a, robot_b"] in rows
    assert ["8", "4.00", "0.50", "-", "1.50", "1", "nobody (coasting)"] in rows
    assert ["2", "4", "2.00", "1.00", "0.25", "1.50", "3 (4 s), 8 (12 s)"] in rows
    assert ["robot_a", "-", "20", "1.00", "2.00", "90"] in rows


def test_age_of_scans_grows_after_the_clock_has_ended(live, monkeypatch):
    """The time of the node stays where it is; the scan was 20 ms old when it came."""
    moment = 100.0
    monkeypatch.setattr("time.monotonic", lambda: moment)
    table, heard = live
    heard["tracked_people"](message_of(WALKS))
    moment = 100.5
    assert ["robot_a", "-", "520", "1.00", "2.00", "90"] in shown(table)


def test_untracked_people_have_no_id(live):
    table, heard = live
    nobody = Person(np.zeros(2), np.eye(2), 1.7, 0.1, ("robot_a",), 0)
    heard["tracked_people"](message_of(nobody, nobody))
    rows = shown(table)
    for number in ("(1)", "(2)"):
        assert [number, "0.00", "0.00", "-", "1.70", "0", "robot_a"] in rows


def test_latest_events_are_shown(live):
    table, heard = live
    heard["tracked_people"](message_of(WALKS))
    for number in range(7):
        heard["events"](SimpleNamespace(data=f"person {number} joins group 1"))
    printed = [row[0] for row in shown(table) if row and "joins" in row[0]]
    assert [re.sub(r"^\d+ s ago: ", "", line) for line in printed] == [
        f"person {number} joins group 1" for number in range(2, 7)
    ]


def report(*entries: tuple[int, str, str]) -> Any:
    return SimpleNamespace(
        status=[
            SimpleNamespace(level=bytes([level]), name=name, message=text, values=[])
            for level, name, text in entries
        ]
    )


def test_health_is_summarized(live):
    """The summary and the worst findings; ended ones are omitted."""
    table, heard = live
    heard["tracked_people"](message_of(WALKS))
    assert ["health: unknown (no node reports on /diagnostics)"] in shown(table)
    fine = [(0, "/robot_a/robot_node: scan", "ok"), (0, "/planner_node: intervals", "ok")]
    heard["/diagnostics"](report(*fine))
    assert ["health: ok (2 nodes report)"] in shown(table)
    late = [(1, f"/planner_node: robot {k}", "its last scan is old") for k in range(5)]
    silent = (2, "/robot_a/robot_node: odom", "no data on /robot_a/odom for 4 s")
    heard["/diagnostics"](
        report(*fine, *late, (3, "/robot_b/robot_node: scan", "none yet"), silent)
    )
    rows = [row[0] for row in shown(table) if row]
    first = rows.index("health: 1 error, 5 warnings, 1 stale (3 nodes report)")
    assert rows[first + 1] == f"{silent[1]}: {silent[2]}"
    assert rows[first + 2 :] == [
        *(f"/planner_node: robot {k}: its last scan is old" for k in range(3)),
        "and 3 more; what to do: mrs doctor",
    ]
    heard["/diagnostics"](report(*((0, name, "ok") for _, name, _ in (*late, silent))))
    assert any("health: 1 stale" in row[0] for row in shown(table) if row)


def test_foreign_texts_are_escaped(live):
    table, heard = live
    heard["tracked_people"](message_of(dataclasses.replace(WALKS, robots=("a\x1b[2J[/b]",))))
    heard["events"](SimpleNamespace(data="\x1b]0;title\x07person 1 [/b]\nsecond"))
    heard["/diagnostics"](report((2, "/x\x1b[31m: [/b]", "\x9bA [/] \u202e")))
    reported = "\n".join(cell for row in shown(table) for cell in row)
    for text in (r"a\x1b[2J[/b]", r"\x1b]0;title\x07person 1 [/b]\nsecond", r"\x9bA [/] \u202e"):
        assert text in reported
    assert not set(reported) & set("\x1b\x07\x9b\u202e")


def test_time_follows_the_clock_topic_while_published():
    publishers, timers, values = {"/clock": 0}, [], {"use_sim_time": False}

    def change(parameters):
        values.update({p.name: p.value for p in parameters})

    node: Any = SimpleNamespace(
        create_timer=lambda period, look, clock: timers.append(look),
        count_publishers=publishers.get,
        get_parameter=lambda name: SimpleNamespace(value=values[name]),
        set_parameters=change,
    )
    follow_clock(node)
    for count in (0, 1, 2, 0):
        publishers["/clock"] = count
        timers[0]()
        assert values == {"use_sim_time": count > 0}


def test_names_are_not_interpreted_as_markup(live):
    table, heard = live
    message = message_of(dataclasses.replace(WALKS, robots=("robot_a[/b]", "[red]b")))
    message.scans[0].robot = "[/]"
    heard["tracked_people"](message)
    rows = shown(table)
    assert any("robot_a[/b], [red]b" in row for row in rows)
    assert any(row[:1] == ["[/]"] for row in rows)


def test_inconsistent_message_is_refused_and_the_last_one_kept(live):
    table, heard = live
    heard["tracked_people"](message_of(WALKS))
    other = message_of(COASTS, groups=(GROUP,))
    other.groups[0].straggling_for.pop()
    heard["tracked_people"](other)
    rows = shown(table)
    assert any(row[:1] == ["3"] for row in rows)
    assert not any(row[:1] == ["8"] for row in rows)
    (refusal,) = (row for row in rows if "refused" in row[0])
    assert "group 2 has 2 stragglers and 1 times of straggling; wanted: as many" in refusal[0]


def test_consequences_of_a_finding_are_counted_with_it(live):
    table, heard = live
    heard["tracked_people"](message_of(WALKS))
    message = report(
        (2, "/planner_node: robot_a/points", "no data on /robot_a/points for 9 s"),
        (3, "/robot_a/robot_node: scan", "no scan yet"),
        (2, "/robot_a/robot_node: left/image_rect", "all 9 messages are refused"),
    )
    for status, code in zip(message.status, ("no_data", "no_scan", "all_refused"), strict=True):
        status.values = [SimpleNamespace(key="code", value=code)]
    heard["/diagnostics"](message)
    rows = [row[0] for row in shown(table) if row]
    first = rows.index("health: 1 error (2 nodes report)")
    reported = "/robot_a/robot_node: left/image_rect: all 9 messages are refused"
    assert rows[first + 1 :] == [f"{reported} (and 2 that follow from it)"]

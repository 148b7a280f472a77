"""How a tour is shown in the terminal, and what is said where there is no guide."""

from __future__ import annotations

import io
import threading
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from rich.console import Console

from mrs_people_loc.errors import PeopleLocError
from mrs_people_loc.guiding.guidance import Guidance, Post, Role, State
from mrs_people_loc.guiding.tour import tour_from
from mrs_people_loc.team.poses import Pose
from mrs_ros import convert
from mrs_tools.live import tour_client, tour_view
from mrs_tools.live.tour_view import TourView, describe

TOUR = tour_from(
    [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0)], [("Foyer", (3.0, 0.5), 10.25)], name="hall", speed=0.5
)
LEADING = Guidance(
    5_250_000_000, State.LEADING, stop="Foyer", way_m=2.5, length_m=60.0, speed=0.25,
    people=(1, 2, 7), stragglers=(7,), lost=(3,),
    posts={"robot_a": Post(Role.LEADER, np.array([4.0, 1.0]), np.pi / 2, 0.5)},
    faults={"robot_b": "no pose"},
)  # fmt: skip


def status_of(guidance: Guidance) -> Any:
    return convert.guide_status("hall", guidance, {"robot_a": Pose(0, 4.0, 3.0, 0.0)}, "map")


def test_status_holds_the_guidance() -> None:
    status = status_of(LEADING)
    assert (status.header.frame_id, status.header.stamp.sec) == ("map", 5)
    assert (status.tour, status.state, status.stop) == ("hall", status.LEADING, "Foyer")
    assert (status.way, status.length, status.speed) == (2.5, 60.0, 0.25)
    assert [list(ids) for ids in (status.people, status.stragglers, status.lost)] == [
        [1, 2, 7], [7], [3],
    ]  # fmt: skip
    leader, other = status.posts
    assert (leader.robot, leader.role, leader.distance, leader.fault) == ("robot_a", 0, 2.0, "")
    assert (leader.post.position.x, leader.post.position.y) == (4.0, 1.0)
    assert leader.post.orientation.z == pytest.approx(np.sqrt(0.5))
    assert (other.robot, other.fault) == ("robot_b", "no pose")
    assert np.isnan(other.distance)


def test_tour_as_a_goal_holds_the_way_and_the_stops() -> None:
    goal = convert.tour_goal(TOUR)
    assert (goal.name, goal.speed, goal.path.header.frame_id) == ("hall", 0.5, "map")
    points = [(pose.pose.position.x, pose.pose.position.y) for pose in goal.path.poses]
    assert points == [(0.0, 0.0), (4.0, 0.0), (4.0, 3.0)]
    (stop,) = goal.stops
    assert (stop.name, stop.position.x, stop.position.y) == ("Foyer", 3.0, 0.5)
    assert (stop.wait.sec, stop.wait.nanosec) == (10, 250_000_000)


def test_line_names_state_reason_and_roles() -> None:
    assert describe(status_of(LEADING)) == "leading; robot_a leader, robot_b out: no pose"
    at_stop = Guidance(0, State.AT_STOP, "waits for person 7", stop="Foyer\x1b[2J")
    assert describe(status_of(at_stop)) == r"at stop Foyer\x1b[2J; waits for person 7"


def test_each_change_is_one_line() -> None:
    out = io.StringIO()
    with TourView(Console(file=out, width=120), TOUR) as view:
        for guidance in (LEADING, LEADING, Guidance(0, State.FINISHED, "at the end", way_m=60.0)):
            view.show(status_of(guidance))
    assert out.getvalue().splitlines() == [
        "hall: waits for guide_node and the first people",
        "   2.5 m  leading; robot_a leader, robot_b out: no pose",
        "  60.0 m  finished; at the end",
    ]


def test_age_that_grows_is_told_once() -> None:
    out = io.StringIO()
    with TourView(Console(file=out, width=120), TOUR) as view:
        for age in ("0.48", "0.51", "12.60"):
            reason = f"the people are {age} s old"
            view.show(status_of(Guidance(0, State.HALTED, reason)))
        view.show(status_of(Guidance(0, State.WAITING, "waits for person 1")))
        view.show(status_of(Guidance(0, State.WAITING, "waits for person 2")))
    assert out.getvalue().splitlines() == [
        "hall: waits for guide_node and the first people",
        "   0.0 m  halted; the people are 0.48 s old",
        "   0.0 m  waiting; waits for person 1",
        "   0.0 m  waiting; waits for person 2",
    ]


def test_halts_that_follow_each_other_are_told_every_10_s(monkeypatch: pytest.MonkeyPatch) -> None:
    out, clock = io.StringIO(), SimpleNamespace(now_s=0.0)
    monkeypatch.setattr(tour_view, "time", SimpleNamespace(monotonic=lambda: clock.now_s))
    with TourView(Console(file=out, width=120), TOUR) as view:
        for clock.now_s, age in ((5.0, "0.47"), (7.0, "0.52"), (16.0, "0.61")):
            view.show(status_of(Guidance(0, State.HALTED, f"no people have come for {age} s")))
            view.show(status_of(Guidance(0, State.LEADING)))
    assert out.getvalue().splitlines()[1:] == [
        "   0.0 m  halted; no people have come for 0.47 s",
        "   0.0 m  leading",
        "   0.0 m  halted; no people have come for 0.61 s",
        "   0.0 m  leading",
    ]


class Client:
    """An action client that is never answered; who serves is known."""

    def __init__(self, *, serves: bool, accepts: bool = True) -> None:
        self.serves, self.accepts = serves, accepts
        self.cancels = 0

    def server_is_ready(self) -> bool:
        return self.serves

    def destroy(self) -> None:
        pass

    def send_goal_async(self, goal: Any, feedback_callback: Any) -> Any:
        never = SimpleNamespace(done=lambda: False)
        handle = SimpleNamespace(
            accepted=self.accepts, get_result_async=lambda: never, cancel_goal_async=self._cancel
        )
        return SimpleNamespace(done=lambda: True, result=lambda: handle)

    def _cancel(self) -> None:
        self.cancels += 1


@pytest.fixture(autouse=True)
def _impatient(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("_THERE_S", "_CANCELLED_S"):
        monkeypatch.setattr(tour_client, name, 0.05)


def ask(client: Client, monkeypatch: pytest.MonkeyPatch, stop: threading.Event, spin: Any) -> Any:
    node: Any = SimpleNamespace(resolve_service_name=lambda name: f"/{name}")
    monkeypatch.setattr("rclpy.action.ActionClient", lambda *_: client)
    return tour_client.guide(node, TOUR, spin=spin, stop=stop, show=lambda _: None)


def test_missing_guide_is_named_with_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    with pytest.raises(PeopleLocError, match="nobody serves the action /guide_tour.*--guide"):
        ask(Client(serves=False), monkeypatch, threading.Event(), lambda: None)


def test_inactive_guide_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    client = Client(serves=True, accepts=False)
    with pytest.raises(PeopleLocError, match="guide_node takes no tour: it is not active"):
        ask(client, monkeypatch, threading.Event(), lambda: None)


def test_guide_that_ends_without_a_word_is_noticed(monkeypatch: pytest.MonkeyPatch) -> None:
    client = Client(serves=True)

    def end() -> None:
        client.serves = False

    with pytest.raises(PeopleLocError, match="guide_node has ended"):
        ask(client, monkeypatch, threading.Event(), end)


def test_tour_is_cancelled_once_and_silence_after_that_is_an_error(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    client, stop = Client(serves=True), threading.Event()
    with pytest.raises(PeopleLocError, match="stop the robots yourself"):
        ask(client, monkeypatch, stop, stop.set)
    assert client.cancels == 1

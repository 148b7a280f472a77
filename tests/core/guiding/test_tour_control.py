"""Tours of a team, step by step, by a clock of the test's own."""

from __future__ import annotations

import dataclasses
from collections.abc import Container, Iterable, Mapping, Sequence
from typing import Any

import numpy as np
import pytest

from mrs_people_loc.config import GuideConfig, Safety
from mrs_people_loc.config.guide import Pace
from mrs_people_loc.errors import AheadError, TourError
from mrs_people_loc.guiding.guidance import Guidance, State
from mrs_people_loc.guiding.guide import Guide
from mrs_people_loc.guiding.tour import Tour, tour_from
from mrs_people_loc.guiding.tour_control import Ends, Now, TourControl
from mrs_people_loc.health.findings import OK, Code
from mrs_people_loc.health.guide import of_monitors, of_others, of_tour
from mrs_people_loc.people import Group, Person
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_loc.team.poses import Pose

PLACES = {"robot_a": (0.0, 0.0, 0.0), "robot_b": (-3.5, 0.0, 0.0)}
#: When the tour begins [s].
START = 100.0
HALL = tour_from([[0.0, 0.0], [10.0, 0.0]], name="hall")
PEOPLE = ((-1.5, 0.0), (-1.5, 0.6))


class Bases:
    """What the robots are told."""

    def __init__(self) -> None:
        self.velocities: Mapping[str, tuple[float, float]] = {}
        self.stops = self.kept = 0
        self.posts: Mapping[str, Any] = {}

    def begin(self, robots: Iterable[str], monitored: Container[str] = ()) -> None:
        self.begun = tuple(robots)
        self.monitored = [robot for robot in self.begun if robot in monitored]

    def drive(self, velocities: Mapping[str, tuple[float, float]]) -> None:
        self.velocities = velocities

    def send(self, posts: Mapping[str, Any], poses: Mapping[str, Pose]) -> None:
        self.posts = posts

    def stop(self, poses: Mapping[str, Pose]) -> None:
        self.stops += 1

    def keep_standing(self, *, always: bool) -> None:
        self.kept += 1
        if always:
            self.velocities = {}

    def finish(self) -> None:
        pass


class Stepped:
    """A control, its host, and the time."""

    def __init__(self) -> None:
        self.said: list[Guidance] = []
        self.events: list[str] = []
        self.ends: list[tuple[str, bool, Sequence[int]]] = []
        self.listeners = ["base"]
        self.drivers: list[str] = []
        self.monitors: list[str] = []
        self.now_s, self.steady_s = START, 0.0
        self.steady_ns: Iterable[int] | None = None
        self.bases = Bases()
        self.control = TourControl(GuideConfig(), self.bases, self)
        self.hear()
        self.begin()
        self.run(4.0)
        assert self.is_told(State.LEADING)

    # ---- as a host ----

    def publish(self, tour: Tour | None, guidance: Guidance, poses: Mapping[str, Pose]) -> None:
        self.said.append(guidance)

    def say(self, event: str) -> None:
        self.events.append(event)

    def ended(self, message: str, *, finished: bool, lost: Sequence[int]) -> None:
        self.ends.append((message, finished, lost))

    def people(self) -> Ends:
        return Ends("/steps/tracked_people")

    def pose(self, robot: str) -> Ends:
        return Ends(f"/steps/{robot}/pose")

    def commands(self, robot: str) -> Ends:
        return Ends(f"/steps/{robot}/cmd_vel", self.drivers, self.listeners, self.monitors)

    def guides(self) -> Ends:
        return Ends("/steps/guide_status", ["/steps/guide_node"])

    # ---- steps ----

    @property
    def now_ns(self) -> int:
        return round(self.now_s * 1e9)

    @property
    def now(self) -> Now:
        ns = self.now_ns if self.steady_ns is None else next(iter(self.steady_ns))
        return Now(ns, self.now_ns, self.steady_s)

    @property
    def guide(self) -> Guide:
        assert self.control.guide is not None
        return self.control.guide

    def begin(self) -> None:
        self.control.begin(HALL, self.now)

    def cancel(self) -> None:
        self.control.end()

    def hear_pose(self, robot: str, stamp_ns: int, x: float, y: float, yaw: float) -> None:
        self.control.take_pose(robot, Pose(stamp_ns, x, y, yaw), self.now)

    def hear_people(
        self,
        stamp_ns: int,
        places: Sequence[tuple[float, float]] = PEOPLE,
        robots: Iterable[str] = tuple(PLACES),
        first: int = 1,
    ) -> None:
        """People who stand, with ids from the first on, as one group."""
        people = [
            Person(
                np.array(place), np.zeros((2, 2)), 1.7, 0.1, tuple(PLACES), -1, id=number,
                velocity=np.zeros(2),
            )
            for number, place in enumerate(places, start=first)
        ]  # fmt: skip
        members = tuple(one.id for one in people)
        group = Group(
            np.mean(places, axis=0), np.zeros((2, 2)), 0.4, 0.4, len(people), id=1, members=members
        )
        scans = dict.fromkeys(robots, stamp_ns)
        self.control.take_people(stamp_ns, people, [group], scans, self.now)

    def hear(self, *, people: bool = True) -> None:
        """Poses of all robots, and people, of now."""
        for robot, place in PLACES.items():
            self.hear_pose(robot, self.now_ns, *place)
        if people:
            self.hear_people(self.now_ns)

    def take_grid(self, grid: OccupancyGrid) -> None:
        self.control.take_grid(grid, self.control.space_by(grid), self.now)

    def tick(self) -> None:
        self.control.tick(self.now)
        self.control.drive(lambda: self.now)

    def run(self, seconds: float, *, people: bool = True) -> None:
        """Poses and people come five times a second."""
        end = self.now_s + seconds
        while self.now_s < end - 1e-6:
            self.now_s += 0.05
            if round(self.now_s / 0.05) % 4 == 0:
                self.hear(people=people)
            self.tick()

    def is_told(self, state: State) -> bool:
        return self.said[-1].state == state

    def drives(self) -> bool:
        return any(v or w for v, w in self.bases.velocities.values())


@pytest.fixture
def team() -> Stepped:
    return Stepped()


def map_of(
    width_m: float,
    height_m: float,
    walls: Sequence[tuple[float, float, float, float]],
    value: int = 100,
) -> OccupancyGrid:
    """A map from (-5, -5) on, free but for boxes (x0, y0, x1, y1) [m]."""
    data = np.zeros((round(height_m / 0.1), round(width_m / 0.1)), np.int8)
    for x0, y0, x1, y1 in walls:
        columns = slice(round((x0 + 5) / 0.1), round((x1 + 5) / 0.1))
        data[round((y0 + 5) / 0.1) : round((y1 + 5) / 0.1), columns] = value
    return OccupancyGrid(0.1, -5.0, -5.0, 0.0, data)


def test_before_a_tour_nothing_is_guided() -> None:
    bases = Bases()
    control = TourControl(GuideConfig(), bases, Stepped())
    control.take_people(0, [], [], {}, Now(0, 0, 0.0))
    control.tick(Now(0, 0, 0.0))
    control.drive(lambda: Now(0, 0, 0.0))
    assert control.guide is None
    assert (bases.kept, bases.velocities, bases.posts) == (1, {}, {})


def test_robots_stand_once_people_are_as_old_as_allowed_and_go_on_after(team: Stepped) -> None:
    assert team.drives()
    while round(team.now_s / 0.05) % 4:  # people came just now
        team.run(0.05)
    team.run(0.4, people=False)
    assert team.drives()
    assert team.is_told(State.LEADING)
    team.run(0.05, people=False)
    assert not team.drives()  # it would be too late with the next velocity
    team.run(1.05, people=False)
    assert team.is_told(State.HALTED)
    assert "no people have come for 1.50 s" in team.said[-1].reason
    team.run(1.0, people=False)
    assert sum(told.state == State.HALTED for told in team.said) == 1
    team.run(1.0)
    assert team.drives()
    assert not team.is_told(State.HALTED)


@pytest.mark.parametrize("why", ["", "the time jumped back"])
def test_tour_that_is_ended_is_told_as_of_the_last_step(team: Stepped, why: str) -> None:
    before, message = team.said[-1], why or "cancelled"
    team.control.end(why)
    ended = dataclasses.replace(
        before, state=State.CANCELLED, reason=why, speed=0.0, posts={}, events=()
    )
    assert team.said[-1] == ended
    assert team.events[-1] == f"the tour hall has ended: {message}"
    assert team.ends == [(message, False, ())]
    team.control.end("again")
    assert len(team.ends) == team.bases.stops == 1


def test_tour_that_is_cancelled_before_any_people_is_told_without_its_events() -> None:
    team = Stepped()
    team.cancel()
    team.begin()
    team.cancel()
    stamp_ns = team.said[-1].stamp_ns
    assert team.said[-1] == Guidance(stamp_ns, State.CANCELLED)


def test_tour_that_comes_to_its_end_is_finished(team: Stepped) -> None:
    """The robots are at the leader's post, and people follow them, at once."""
    while not team.ends:
        assert team.now_s < START + 60.0
        team.now_s += 0.2
        post = team.guide.guidance.posts.get("robot_a")
        x = PLACES["robot_a"][0] if post is None else float(post.xy[0])
        team.hear_pose("robot_a", team.now_ns, x, 0.0, 0.0)
        team.hear_pose("robot_b", team.now_ns, x - 3.5, 0.0, 0.0)
        team.hear_people(team.now_ns, [(x - 1.5, 0.0), (x - 1.5, 0.6)])
    told = team.said[-1]
    assert (told.state, told.reason) == (State.FINISHED, "the group is at the end")
    assert told.events == ("everybody is at the end", "the tour hall is finished")
    assert (told.speed, told.posts, told.people) == (0.0, {}, (1, 2))
    assert team.ends == [("the group is at the end", True, ())]
    assert team.control.guide is None
    assert not [event for event in team.events if "has ended" in event]


@pytest.mark.slow
def test_tour_that_the_guide_gives_up_is_cancelled_for_its_reason(team: Stepped) -> None:
    while not team.ends:
        assert team.now_s < START + 120.0
        team.now_s += 0.2
        for robot, place in PLACES.items():
            team.hear_pose(robot, team.now_ns, *place)
        team.control.take_people(team.now_ns, [], [], dict.fromkeys(PLACES, team.now_ns), team.now)
    why = "nobody of the group is left"
    assert (team.said[-1].state, team.said[-1].reason) == (State.CANCELLED, why)
    assert team.said[-1].lost == (1, 2)
    assert team.events[-1] == f"the tour hall has ended: {why}"
    assert team.ends == [(why, False, (1, 2))]


def test_what_has_come_is_forgotten_when_the_time_jumps_back(team: Stepped) -> None:
    team.control.end("the time jumped back")
    team.control.forget()
    assert team.control.guide is None
    assert team.bases.stops == 1
    with pytest.raises(TourError, match="nothing comes on /steps/tracked_people"):
        team.begin()


def test_tour_is_refused_where_people_and_the_clock_have_stopped(team: Stepped) -> None:
    team.cancel()
    assert (team.said[-1].state, team.said[-1].reason) == (State.CANCELLED, "")
    team.steady_s += 4.0
    with pytest.raises(TourError, match=r"nothing came on /steps/tracked_people for 4\.\d s"):
        team.begin()
    team.now_s += 0.2
    team.hear()
    team.begin()


def test_second_tour_is_refused(team: Stepped) -> None:
    with pytest.raises(TourError, match="'hall' is under way"):
        team.begin()


def test_parameters_take_effect_on_a_tour_but_for_its_robots(team: Stepped) -> None:
    config = GuideConfig(pace=Pace(speed=0.1), robots=("robot_b",))
    team.control.configure(config, team.now)
    assert team.guide.config.pace.speed == 0.1
    assert team.guide.config.robots == tuple(PLACES)


def test_stop_holds_a_tour_until_it_is_released(team: Stepped) -> None:
    assert team.drives()
    team.control.stop("stopped by a test", team.now)
    told = team.said[-1]
    assert (told.state, told.reason, told.posts) == (State.STOPPED, "stopped by a test", {})
    assert told.events == ("stopped by a test",)
    assert team.bases.stops == 1
    team.control.stop("stopped again", team.now)
    team.bases.velocities = {"robot_a": (0.5, 0.0)}
    kept = team.bases.kept
    team.run(3.0)
    team.run(1.0, people=False)  # nor do outdated people end it
    assert not team.drives()
    assert team.bases.kept == kept + 80
    assert team.is_told(State.STOPPED)
    assert not team.ends
    team.bases.posts = {}
    team.control.release(team.now)
    assert team.events[-1] == "released"
    team.run(1.0)
    assert team.drives()
    assert team.is_told(State.LEADING)
    assert set(team.bases.posts) == set(PLACES)


def test_no_tour_begins_while_the_robots_are_stopped(team: Stepped) -> None:
    team.control.stop("stopped by a test", team.now)
    team.cancel()
    assert team.is_told(State.CANCELLED)
    refusal = "stopped by a test; release the robots first: mrs tour release"
    with pytest.raises(TourError, match=refusal):
        team.begin()
    team.steady_s += 2.0
    team.now_s += 0.2
    team.hear()
    team.tick()
    assert (team.said[-1].state, team.said[-1].reason) == (State.STOPPED, "stopped by a test")
    found = of_tour("", team.said[-1])
    assert found.code == Code.TOUR_STOPPED
    team.control.release(team.now)
    assert team.said[-1].state == State.IDLE
    kept = team.bases.kept
    team.control.release(team.now)
    team.begin()
    team.run(4.0)
    assert team.drives()
    assert team.bases.kept == kept


def test_new_map_does_not_hide_that_the_robots_are_stopped(team: Stepped) -> None:
    team.control.stop("stopped by a test", team.now)
    team.take_grid(map_of(20.0, 10.0, [(4.0, -5.0, 4.5, 5.0)]))
    assert team.is_told(State.STOPPED)
    team.control.release(team.now)
    assert team.is_told(State.HALTED)
    assert team.said[-1].reason.startswith("by the new map")


@pytest.mark.parametrize("attended", [True, False])
def test_attended_tour_ends_where_its_client_is_silent(team: Stepped, attended: bool) -> None:
    team.cancel()
    team.hear()
    team.control.begin(HALL, team.now, attended=attended)
    for _ in range(10):
        team.now_s += 0.2
        team.steady_s += 0.2
        team.hear()
        team.control.attend(team.now)
        team.tick()
    assert team.control.guide is not None
    for _ in range(11):
        team.now_s += 0.2
        team.steady_s += 0.2
        team.hear()
        team.tick()
    assert (team.control.guide is None) == attended
    if attended:
        assert team.ends[-1] == ("its client has been silent for 2 s", False, ())
        assert team.bases.stops == 2


def test_people_without_ids_are_named(team: Stepped) -> None:
    team.cancel()
    team.hear_people(team.now_ns + 1, [(-1.5, 0.0)], first=0)
    with pytest.raises(TourError, match=r"/steps/tracked_people have no ids; .*tracking.enabled"):
        team.begin()


def test_robots_of_a_tour_are_those_in_use_lately(team: Stepped) -> None:
    """One interval without the scan of a robot does not keep it out; more of them do."""
    team.cancel()
    for wanted in (("robot_a", "robot_b"), ("robot_a",)):
        team.hear_people(team.now_ns + 1, [(-1.5, 0.0)], ["robot_a"])
        team.begin()
        assert team.guide.config.robots == wanted
        team.cancel()
        team.now_s += 3.0
        team.hear_pose("robot_a", team.now_ns, *PLACES["robot_a"])


def test_recorder_is_no_base(team: Stepped) -> None:
    team.cancel()
    team.listeners = ["mrs_record_17", "rosbag2_recorder"]
    with pytest.raises(TourError, match="nobody subscribes to /steps/robot_a/cmd_vel"):
        team.begin()
    team.listeners.append("base")
    team.begin()


def test_late_pose_is_not_used(team: Stepped) -> None:
    team.now_s += 0.05
    team.hear_pose("robot_a", team.now_ns, 1.0, 0.0, 0.0)
    team.hear_pose("robot_a", team.now_ns - 10**8, 5.0, 0.0, 0.0)
    assert team.guide.poses()["robot_a"].x == 1.0


def test_walls_that_come_on_a_tour_are_avoided(team: Stepped) -> None:
    team.take_grid(map_of(20.0, 10.0, [(1.0, -5.0, 1.5, 5.0)]))
    walls = team.guide.space
    assert float(walls.clearance(np.array(PLACES["robot_a"][:2]))) == pytest.approx(1.0, abs=0.1)
    team.take_grid(map_of(20.0, 10.0, [(1.0, -5.0, 1.5, 5.0)]))
    assert team.guide.space is walls, "the same map costs nothing"


def test_robots_stand_while_a_new_map_has_a_wall_on_the_way(team: Stepped) -> None:
    assert team.drives()
    team.take_grid(map_of(20.0, 10.0, [(4.0, -5.0, 4.5, 5.0)]))
    team.run(1.0)
    assert not team.drives()
    assert team.is_told(State.HALTED)
    assert team.said[-1].reason.startswith("by the new map the way passes through a wall at (4.")
    team.take_grid(map_of(20.0, 10.0, []))
    team.run(1.0)
    assert team.drives()
    assert not team.is_told(State.HALTED)


def test_value_from_which_cells_are_walls_takes_effect_on_a_tour(team: Stepped) -> None:
    team.take_grid(map_of(20.0, 10.0, [(4.0, -5.0, 4.5, 5.0)], value=40))
    assert not team.is_told(State.HALTED)
    team.control.configure(GuideConfig(safety=Safety(occupied_from=30)), team.now)
    assert team.is_told(State.HALTED)


@pytest.mark.parametrize("is_steady", [False, True])
def test_clock_that_is_set_back_keeps_no_robot_going(team: Stepped, is_steady: bool) -> None:
    """By less than what counts as a jump, and nothing comes any more."""
    if is_steady:
        team.control.forget()
        team.steady_ns = iter(range(10**15, 2 * 10**15, 50_000_000 // 4))
        team.hear()
        team.run(1.0)
        team.tick()
    assert team.drives()
    team.now_s -= 0.9
    for _ in range(40):
        team.tick()
    assert not team.drives()


def test_stamps_ahead_of_the_clock_are_refused_and_told_once(team: Stepped) -> None:
    for _ in range(20):
        team.now_s += 0.15
        with pytest.raises(AheadError, match=r"stamp is 20\.00 s ahead of the clock; allowed: 0.1"):
            team.hear_pose("robot_b", team.now_ns + 20 * 10**9, *PLACES["robot_b"])
        team.hear_pose("robot_a", team.now_ns, *PLACES["robot_a"])
        team.hear_people(team.now_ns)
    assert list(team.said[-1].faults) == ["robot_b"]
    told = "stamps on /steps/robot_b/pose are ahead of the clock: refused"
    assert team.events.count(told) == 1
    with pytest.raises(AheadError):
        team.hear_people(team.now_ns + 110_000_000)
    team.hear_people(team.now_ns + 90_000_000)


@pytest.mark.parametrize("again", ["stamp", "scans", "late"])
def test_people_that_come_again_are_no_news(team: Stepped, again: str) -> None:
    """The same message; its people under new stamps; one of before."""
    last_ns = team.now_ns
    for _ in range(32):
        team.now_s += 0.05
        for robot, place in PLACES.items():
            team.hear_pose(robot, team.now_ns, *place)
        if again == "scans":
            scans = dict.fromkeys(PLACES, last_ns)
            team.control.take_people(team.now_ns, [], [], scans, team.now)
        else:
            team.hear_people(last_ns - (again == "late") * 100_000_000)
        team.tick()
    assert team.is_told(State.HALTED)
    assert not team.drives()
    assert len([event for event in team.events if "come late, or again" in event]) == 1


def test_limit_on_people_is_told_once_a_tour(team: Stepped) -> None:
    for _ in range(3):
        team.now_s += 0.2
        team.hear_people(team.now_ns, [*PEOPLE, *((0.1 * k, 9.0) for k in range(30))])
    told = "more than 24 people: each robot keeps clear of the nearest 24"
    assert team.events.count(told) == 1


@pytest.mark.parametrize(("late_s", "is_at_fault"), [(0.1, True), (0.67, False)])
def test_robots_that_stand_for_late_people_are_not_at_fault(
    team: Stepped, late_s: float, is_at_fault: bool
) -> None:
    """Bases that do not obey are; those that are told to stand are not."""
    team.said.clear()
    team.now_s += 1.0
    for _ in range(50):
        team.now_s += 0.2
        for robot, place in PLACES.items():
            team.hear_pose(robot, team.now_ns, *place)
        team.hear_people(team.now_ns - round(late_s * 1e9))
        team.tick()
        assert team.drives() != (late_s > 0.6) or is_at_fault
    events = [event for told in team.said for event in told.events]
    fault = "robot_a takes no part: is told to drive, but has not moved for 8 s"
    assert (fault in events) == is_at_fault


@pytest.mark.parametrize("driven", [0.0, 1.0])
def test_robot_that_its_collision_monitor_holds_is_not_at_fault(
    team: Stepped, driven: float
) -> None:
    """It stands, and so does one whose base does not obey."""
    for _ in range(50):
        team.now_s += 0.2
        for robot, place in PLACES.items():
            team.hear_pose(robot, team.now_ns, *place)
        team.hear_people(team.now_ns)
        team.tick()
        speed, turn = team.bases.velocities.get("robot_a", (0.0, 0.0))
        team.control.take_driven("robot_a", (driven * speed, driven * turn))
    fault = "robot_a takes no part: is told to drive, but has not moved for 8 s"
    assert (fault in [event for told in team.said for event in told.events]) == (driven > 0.0)


def test_robots_stand_while_simulated_time_stands_still(team: Stepped) -> None:
    for steady_s, drives in ((0.0, True), (0.9, True), (1.1, False), (9.0, False)):
        team.steady_s = steady_s
        team.control.drive(lambda: team.now)
        assert team.drives() == drives
    team.now_s += 0.05
    team.control.drive(lambda: team.now)
    assert team.drives()


def test_velocities_that_took_too_long_are_not_sent(team: Stepped) -> None:
    """A stalled machine: what was computed by ages of before says nothing."""
    for took_s, drives in ((0.04, True), (0.06, False)):
        team.now_s += 0.05
        times = iter([0.0, took_s])
        team.control.drive(lambda t=times: dataclasses.replace(team.now, steady_s=next(t)))  # type: ignore[misc]
        assert team.drives() == drives


def test_robots_stand_where_velocities_fail(team: Stepped, monkeypatch: pytest.MonkeyPatch) -> None:
    """A base goes on with the last velocity that it was told."""
    assert team.drives()
    assert team.control.guide is not None
    monkeypatch.setattr(team.control.guide, "velocities", lambda now_ns: 1 / 0)
    with pytest.raises(ZeroDivisionError):
        team.control.drive(lambda: team.now)
    assert not team.drives()


def test_robot_whose_base_is_gone_takes_no_part(team: Stepped) -> None:
    team.listeners = ["mrs_record_17"]
    team.run(1.5)
    assert "nobody subscribes to /steps/robot_a/cmd_vel" in team.said[-1].faults["robot_a"]
    assert team.is_told(State.HALTED)
    team.listeners = ["base"]
    team.run(1.5)
    assert not team.said[-1].faults


def test_robots_that_others_drive_are_refused_and_reported(team: Stepped) -> None:
    assert of_others({"robot_a": team.commands("robot_a").publishers}).level == OK
    team.drivers = ["/teleop"]
    others = of_others({"robot_a": team.commands("robot_a").publishers})
    assert others.code == Code.DRIVEN_BY_OTHERS
    team.cancel()
    team.hear()
    with pytest.raises(TourError, match=r"robot_a is driven by others: /teleop on /steps/robot_a"):
        team.begin()


def test_goals_of_robots_with_outdated_poses_stay_where_these_are(team: Stepped) -> None:
    assert set(team.bases.posts) == set(PLACES)
    for _ in range(3):
        team.now_s += 0.2
        team.hear_pose("robot_a", team.now_ns, *PLACES["robot_a"])
        team.hear_people(team.now_ns)
    assert set(team.bases.posts) == {"robot_a"}
    team.run(1.6, people=False)
    assert team.bases.posts == {}
    assert team.is_told(State.HALTED)


# ---- collision monitors ----

ALONE = "no collision monitor: only tracked people and the map stop robot_a, robot_b"


def test_robots_without_a_monitor_are_named(team: Stepped) -> None:
    assert team.bases.monitored == []
    assert ALONE in team.events
    assert of_monitors(team.control.unmonitored).code is Code.NO_MONITOR


def test_robots_are_driven_through_their_monitors_and_not_past_them(team: Stepped) -> None:
    team.cancel()
    team.events.clear()
    team.monitors = ["/steps/robot_a/robot_node"]
    team.begin()
    assert team.bases.monitored == ["robot_a", "robot_b"]
    assert of_monitors(team.control.unmonitored).level == OK
    assert not [event for event in team.events if "monitor" in event]
    team.run(4.0)
    assert not team.guide.guidance.faults
    team.monitors = []
    team.run(2.0)
    assert "nobody subscribes to /steps/robot_a/cmd_vel_guide" in " ".join(
        (*team.guide.guidance.faults.values(), team.guide.guidance.reason)
    )


def test_monitors_that_come_on_a_tour_drive_their_robots(team: Stepped) -> None:
    team.monitors = ["/steps/robot_a/robot_node"]
    team.control.stop("stopped", team.now)
    team.run(2.0)
    assert team.bases.monitored == []
    team.control.release(team.now)
    team.run(2.0)
    assert team.bases.monitored == ["robot_a", "robot_b"]
    assert team.control.monitored == {"robot_a", "robot_b"}
    assert of_monitors(team.control.unmonitored).level == OK
    told = [event for event in team.events if "through collision monitors" in event]
    assert told == ["drives robot_a, robot_b through collision monitors from now on"]
    assert not team.guide.guidance.faults


def test_recorder_is_no_monitor(team: Stepped) -> None:
    team.cancel()
    team.monitors = ["/steps/mrs_record"]
    team.begin()
    assert team.bases.monitored == []


def test_tour_without_monitors_is_refused_where_they_are_asked_for(team: Stepped) -> None:
    team.cancel()
    safety = dataclasses.replace(team.control.config.safety, monitored=True)
    team.control.configure(dataclasses.replace(team.control.config, safety=safety), team.now)
    with pytest.raises(TourError, match="robot_a has no collision monitor, and safety.monitored"):
        team.begin()
    team.monitors = ["/steps/robot_a/robot_node"]
    team.begin()

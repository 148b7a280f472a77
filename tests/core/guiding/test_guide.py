"""The guide: states of a tour, who is guided, who leads."""

from __future__ import annotations

import copy
import dataclasses
import functools
import math

import numpy as np
import pytest

from core.guiding.walking_group import START_NS, STEP_S, Walker, World
from mrs_people_loc.config import Formation, GuideConfig, Pace
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.guidance import Role, State
from mrs_people_loc.guiding.guide import Guide
from mrs_people_loc.guiding.pace import PaceControl, falls
from mrs_people_loc.guiding.tour import tour_from
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_loc.team.poses import Pose

FOYER = tour_from([[0.0, 0.0], [20.0, 0.0]], [("Foyer", (8.0, 0.0), 5.0)], name="hall", speed=0.5)


@functools.cache
def _on_its_way(config: GuideConfig) -> World:
    world = World(config=config)
    world.run(8.0)
    assert world.last().state == State.LEADING
    return world


def leading(**config: object) -> World:
    """A group on its way, after 8 s."""
    return copy.deepcopy(_on_its_way(GuideConfig(**config)))  # type: ignore[arg-type]


# ------------------------------------------------------------------------------------ the tour ----


@pytest.mark.slow
def test_tour_with_a_stop_goes_from_its_start_to_its_end():
    world = World(tour=FOYER)
    world.run_until(State.FINISHED)
    order = [State.GATHERING, State.LEADING, State.AT_STOP, State.LEADING, State.FINISHED]
    assert [state for state in world.states() if state != State.WAITING] == order
    assert world.events() == [
        "the tour hall begins",
        "robot_a leads",
        "sets off with people 1, 2, 3, 4, 5",
        "everybody is at Foyer",
        "goes on from Foyer",
        "everybody is at the end",
        "the tour hall is finished",
    ]
    at_stop = [time for time, guidance in world.said if guidance.state == State.AT_STOP]
    assert at_stop[-1] - at_stop[0] == pytest.approx(5.0, abs=2 * STEP_S)
    assert {guidance.stop for _, guidance in world.said} == {"Foyer", ""}
    assert world.last().posts == {}
    assert world.last().people == (1, 2, 3, 4, 5)
    assert max(guidance.speed for _, guidance in world.said) <= 0.5
    ways = [guidance.way_m for _, guidance in world.said if guidance.state > State.GATHERING]
    assert ways == sorted(ways)
    assert ways[-1] > 20.0 - 1.6 - 3.0


def test_group_is_near_the_stop_while_the_leader_waits_beyond_it():
    world = World(tour=FOYER)
    world.run_until(State.AT_STOP)
    ways = [walker.way_m for walker in world.walkers]
    assert np.abs(np.array(ways) - 8.0).max() < 3.0
    assert max(ways) < world.robots["robot_a"][0]


def test_leader_keeps_its_lead_and_the_others_are_behind():
    world = leading()
    world.run(4.0)
    foremost = max(walker.way_m for walker in world.walkers)
    last = min(walker.way_m for walker in world.walkers)
    assert world.last().posts["robot_a"].role == Role.LEADER
    assert 1.2 < world.robots["robot_a"][0] - foremost < 2.4
    for name in ("robot_b", "robot_c"):
        assert world.last().posts[name].role == Role.REAR
        assert world.last().posts[name].xy[0] < last - 0.8


@pytest.mark.slow
def test_the_same_inputs_give_the_same_guidance():
    one, other = World(tour=FOYER), World(tour=FOYER)
    one.run(30.0)
    other.run(30.0)
    for (_, a), (_, b) in zip(one.said, other.said, strict=True):
        assert repr(a) == repr(b)


def test_tour_does_not_set_off_without_people_or_far_from_the_way():
    world = World()
    nobody = world.walkers
    world.walkers = [Walker(0, 1.4, 0.0, 0.0)]
    world.run(5.0)
    assert world.last().state == State.GATHERING
    assert world.last().reason == "waits for people: none is seen"
    assert world.last().posts == {}
    world.walkers = [dataclasses.replace(one, left=one.left + 8.0) for one in nobody]
    world.run(5.0)
    assert world.last().state == State.GATHERING
    assert "from the way; allowed: 6 m" in world.last().reason


def test_cancelled_tour_gives_no_posts():
    world = leading()
    assert world.last().posts
    ended = world.guide.cancel()
    assert (ended.state, dict(ended.posts)) == (State.CANCELLED, {})
    assert (ended.reason, ended.speed, ended.people) == ("", 0.0, (1, 2, 3, 4, 5))
    assert world.guide.take_people(world.people(), [], world.now_ns, world.now_ns, ()) is None
    assert world.guide.cancel("again") == ended


# ---------------------------------------------------------------------------------- stragglers ----


@pytest.mark.slow
def test_straggler_is_waited_for_and_fetched_and_the_tour_goes_on_with_them():
    world = leading()
    last = world.walkers[-1]
    last.stands = True
    world.run_until(State.WAITING, 12.0)
    world.run(4.0)
    assert world.last().stragglers == (5,)
    assert world.last().reason == "waits for person 5"
    assert world.last().speed == 0.0
    (fetcher,) = [post for post in world.last().posts.values() if post.role == Role.FETCHER]
    place = world.tour.way.at(last.way_m, last.left)
    assert math.dist(fetcher.xy, place) < 2.0
    assert fetcher.xy[0] < place[0]  # on the side away from the group
    last.stands = False
    world.run_until(State.LEADING, 15.0)
    assert world.last().stragglers == ()
    assert "person 5 is back" in world.events()
    world.run_until(State.FINISHED)
    assert world.last().lost == ()


def test_what_happens_to_several_at_once_is_told_once() -> None:
    world = World()
    world.run_until(State.LEADING)
    for walker in world.walkers[3:]:
        walker.way_m, walker.stands = world.walkers[4].way_m, True
    world.run(12.0)
    behind = [event for event in world.events() if "behind" in event]
    assert behind == ["people 4, 5 have fallen behind"]


def test_straggler_is_noticed_soon_after_they_are_apart():
    world = leading()
    last, next_to = world.walkers[-1], world.walkers[-2]
    last.stands = True
    apart_s = None
    while 5 not in world.last().stragglers:
        world.step()
        away = math.hypot(next_to.way_m - last.way_m, next_to.left - last.left)
        if apart_s is None and away > 2.5:
            apart_s = world.time_s
        assert world.time_s < 40.0
    assert apart_s is not None
    assert world.time_s - apart_s < 2.5


@pytest.mark.slow
def test_tour_goes_on_without_a_straggler_after_the_patience():
    world = leading(pace=Pace(patience=8.0))
    world.walkers[-1].stands = True
    world.run_until(State.WAITING, 12.0)
    begun = world.time_s
    world.run_until(State.LEADING, 20.0)
    assert 6.0 < world.time_s - begun < 14.0
    assert world.last().lost == (5,)
    assert 5 not in world.last().people
    assert "goes on without person 5" in world.events()
    world.run_until(State.FINISHED)


@pytest.mark.slow
def test_person_who_fell_behind_and_left_is_waited_for_only_until_their_place_is_seen_empty():
    world = leading()
    world.walkers[-1].stands = True
    world.run_until(State.WAITING, 12.0)
    world.walkers[-1].id = 0
    begun = world.time_s
    world.run_until(State.LEADING, 30.0)
    assert 5.0 <= round(world.time_s - begun, 6) < 15.0  # steps of 0.2 s are not exact
    assert world.last().lost == (5,)
    assert "person 5 has left; goes on without them" in world.events()
    world.run_until(State.FINISHED)


@pytest.mark.slow
def test_person_who_is_lost_and_comes_back_is_guided_again():
    world = leading(pace=Pace(patience=3.0, speed=0.3))
    world.walkers[-1].stands = True
    world.run(20.0)
    assert world.last().lost == (5,)
    world.walkers[-1].stands = False
    world.run(20.0)
    assert world.last().lost == ()
    assert world.last().people == (1, 2, 3, 4, 5)


def test_person_who_was_given_up_while_hidden_is_back_when_seen_again():
    """Hidden in the middle of the group, so that nobody waits for them."""
    world = leading(pace=Pace(patience=3.0))
    number, world.walkers[2].id = world.walkers[2].id, 0
    world.run(4.0)
    assert world.last().lost == (number,)
    world.walkers[2].id, world.walkers[2].began_s = 17, world.time_s
    world.run(4.0)
    assert world.last().lost == ()
    assert world.last().people == (1, 2, 4, 5, 17)
    assert "person 17 is back" in world.events()


@pytest.mark.slow
@pytest.mark.parametrize("length", [10.0, 30.0])
def test_group_that_never_follows_is_not_left_behind(length):
    tour = tour_from([[0.0, 0.0], [length, 0.0]], name="hall")
    world = World(config=GuideConfig(pace=Pace(patience=10.0)), tour=tour)
    for walker in world.walkers:
        walker.stands = True
    world.run(90.0)
    assert world.last().state == State.CANCELLED
    assert world.last().reason == "the group has not come along for 10 s"
    foremost = max(walker.way_m for walker in world.walkers)
    assert world.robots["robot_a"][0] - foremost < 7.0


@pytest.mark.slow
def test_group_that_stays_a_little_before_the_end_has_arrived_but_not_everybody_is_there():
    world = World(tour=tour_from([[0.0, 0.0], [10.0, 0.0]], name="hall"))
    for walker in world.walkers:
        walker.distance += 3.2
    world.run_until(State.FINISHED, 120.0)
    (event,) = [event for event in world.events() if "after 10 s" in event]
    middle = np.median([walker.way_m for walker in world.walkers])
    assert f"the group is {math.hypot(10.0 - middle, 0.5):.1f} m from the end" in event
    assert "everybody is at the end" not in world.events()


def test_the_group_at_the_start_is_guided_rather_than_a_larger_one_farther_off():
    world = World()
    world.walkers = world.walkers[:2]
    strangers = [Walker(11 + k, 0.0, 5.0 + 0.4 * k, -3.0, stands=True) for k in range(3)]
    world.walkers += strangers
    world.run(6.0)
    assert world.last().state == State.LEADING
    assert world.last().people == (1, 2)


def test_short_loss_of_a_person_does_not_stop_the_tour():
    world = leading()
    for walker in world.walkers:
        number, walker.id = walker.id, 0
        world.run(2.0)
        walker.id = number
        assert world.last().state == State.LEADING
        assert world.last().people == (1, 2, 3, 4, 5)
        world.run(0.6)


def test_switched_id_is_the_same_person():
    world = leading()
    walker = world.walkers[2]
    walker.id = 0
    world.run(1.0)
    walker.id, walker.began_s = 17, world.time_s
    world.run(12.0)
    assert State.WAITING not in world.states()
    assert world.last().people == (1, 2, 4, 5, 17)
    assert world.last().lost == ()


def test_person_who_is_hidden_for_long_is_not_waited_for_where_nobody_is():
    """Robots behind the group see that nobody is where person 5 was seen last."""
    world = leading()
    world.walkers[-1].id = 0
    world.run(9.0)
    world.walkers[-1].id, world.walkers[-1].began_s = 23, world.time_s
    world.run(4.0)
    assert State.WAITING not in world.states()
    assert world.last().people == (1, 2, 3, 4, 23)


def test_person_who_is_not_seen_any_more_is_waited_for_where_no_robot_looks():
    world = leading(formation=Formation(nearest=1.0, reach=1.1))
    last = world.people()[-1].position
    world.walkers[-1].id = 0
    world.run(9.0)
    assert world.last().state == State.WAITING
    assert world.last().stragglers == (5,)
    (fetcher,) = (post for post in world.last().posts.values() if post.role == Role.FETCHER)
    ahead = world.config.formation.distance * np.array(
        [math.cos(fetcher.yaw), math.sin(fetcher.yaw)]
    )
    assert fetcher.xy + ahead == pytest.approx(last, abs=0.2)  # it looks where they were last
    world.walkers[-1].id = 5
    world.run(3.0)
    assert world.last().state == State.LEADING
    assert world.last().stragglers == ()


@pytest.mark.parametrize(("wall_m", "waits"), [(3.2, True), (2.0, False)])
def test_nobody_waits_for_a_person_whose_last_place_is_in_a_wall(wall_m, waits):
    """No robot looks there, 2.6 m beside the way. On both sides of it are walls."""
    world = leading(formation=Formation(nearest=1.0, reach=1.1))
    floor = np.full((100, 500), 100, dtype=np.int8)
    floor[round(50 - 10 * wall_m) : round(50 + 10 * wall_m)] = 0
    world.guide.take_space(FreeSpace(OccupancyGrid(0.1, -20.0, -5.0, 0.0, floor)))
    drifted = world.walkers[-1]
    drifted.left = 2.6
    world.run(STEP_S)
    drifted.id = 0
    world.run(9.0)
    assert (State.WAITING in world.states()) == waits


def test_robots_look_for_a_group_of_whom_nobody_is_seen_any_more():
    """No robot looks where people were last: the fetcher goes there, the leader turns to them."""
    world = leading(formation=Formation(nearest=1.0, reach=1.1), pace=Pace(patience=30.0))
    last = {walker.id: np.array([walker.way_m, walker.left]) for walker in world.walkers}
    for walker in world.walkers:
        walker.id, walker.stands = 0, True
    world.run(12.0)
    assert world.last().state == State.WAITING
    posts = world.last().posts
    assert set(posts) == {"robot_a", "robot_b", "robot_c"}
    (fetcher,) = (post for post in posts.values() if post.role == Role.FETCHER)
    assert min(np.linalg.norm(fetcher.xy - xy) for xy in last.values()) < 2.0
    assert abs(posts["robot_a"].yaw) == pytest.approx(math.pi, abs=0.3)
    for number, walker in zip(last, world.walkers, strict=True):
        walker.id, walker.stands = number, False
    world.run(4.0)
    assert world.last().state == State.LEADING
    assert world.last().people == (1, 2, 3, 4, 5)


def test_new_planner_with_other_ids_goes_on_with_the_same_people():
    world = leading()
    world.said.append((world.time_s, world.guide.halt("people are outdated")))
    assert world.last().state == State.HALTED
    assert world.last().speed == 0.0
    assert world.last().posts == {}
    world.time_s += 8.0
    for walker in world.walkers:
        walker.id, walker.began_s = 6 - walker.id, world.time_s
    world.groups.reset()
    assert world.step().people == (1, 2, 3, 4, 5)
    world.run(10.0)
    assert world.last().state == State.LEADING
    assert world.last().people == (1, 2, 3, 4, 5)
    assert world.last().lost == ()
    assert "goes on" in world.events()


def test_new_planner_that_numbers_a_standing_group_otherwise_loses_nobody():
    world = leading()
    for walker in world.walkers:
        walker.stands = True
    world.run(2.0)
    world.time_s += 1.0
    for walker in world.walkers:
        walker.id, walker.began_s = walker.id % 5 + 1, world.time_s
    world.groups.reset()
    assert world.step().people == (1, 2, 3, 4, 5)
    world.run(2.0)
    assert world.last().people == (1, 2, 3, 4, 5)
    assert not [event for event in world.events() if "joins" in event]


def test_one_wild_estimate_does_not_move_the_leader():
    world = leading()
    before = world.last().way_m

    def warped(people):
        return [
            dataclasses.replace(one, position=one.position + (9.0, 0.0)) if one.id == 3 else one
            for one in people
        ]

    world.warp = warped
    world.run(1.0)
    world.warp = lambda people: people
    assert world.last().way_m - before < 1.0
    assert world.last().posts["robot_a"].xy[0] < world.robots["robot_a"][0] + 1.8
    world.run(3.0)
    assert world.last().state == State.LEADING


def test_newcomer_is_guided_once_they_have_come_along():
    world = leading()
    group = world.walkers
    world.walkers.append(
        Walker(9, 3.2, 0.2, group[-1].way_m - 0.3, began_s=world.time_s)
    )  # fmt: skip
    world.run(1.0)
    assert world.last().people == (1, 2, 3, 4, 5)
    world.run(8.0)
    assert world.last().people == (1, 2, 3, 4, 5, 9)
    assert "person 9 joins the tour" in world.events()


def test_newcomer_who_is_not_seen_any_more_is_forgotten():
    """Such as somebody who was followed twice for a while."""
    world = leading(pace=Pace(patience=4.0))
    world.walkers.append(
        Walker(9, 3.2, 0.2, world.walkers[-1].way_m - 0.3, began_s=world.time_s)
    )  # fmt: skip
    world.run(8.0)
    assert world.last().people == (1, 2, 3, 4, 5, 9)
    world.walkers[-1].id = 0
    world.run(6.0)
    assert world.last().people == (1, 2, 3, 4, 5)
    assert world.last().lost == ()


def test_nobody_waits_for_who_stands_where_the_group_passes():
    world = leading()
    there = world.walkers[-1].way_m + 1.0
    world.walkers.append(Walker(9, 0.0, 1.0, there, began_s=world.time_s, stands=True))
    world.run(12.0)
    assert State.WAITING not in world.states()
    assert world.last().people == (1, 2, 3, 4, 5)
    assert world.last().stragglers == ()


def test_tour_ends_when_nobody_is_left():
    world = leading(pace=Pace(patience=5.0))
    for walker in world.walkers:
        walker.id = 0
    world.run_until(State.CANCELLED, 20.0)
    assert world.last().reason == "nobody of the group is left"
    assert set(world.last().lost) == {1, 2, 3, 4, 5}


# -------------------------------------------------------------------------------------- robots ----


def test_next_robot_leads_when_the_leader_fails():
    world = leading()
    world.silent.add("robot_a")
    failed = world.time_s
    world.run(2.8)
    leaders = [(t, n) for t, g in world.said for n, p in g.posts.items() if p.role == Role.LEADER]
    first = next(t for t, name in leaders if name != "robot_a")
    assert first - failed < 1.0 + 2 * STEP_S
    assert set(world.last().posts) == {"robot_b", "robot_c"}
    assert world.last().faults["robot_a"].startswith("pose is 2.")
    world.silent.clear()
    world.run(10.0)
    assert world.last().faults == {}
    assert "robot_a takes part again" in world.events()
    # The next one has not passed the group yet: the one in front leads.
    assert world.last().posts["robot_a"].role == Role.LEADER


def test_successor_looks_ahead_and_passes_those_who_are_hidden_before_it_leads():
    world = leading()
    world.silent.add("robot_a")
    front = max(world.walkers, key=lambda one: one.way_m)
    for walker in world.walkers:
        walker.stands = True
    hidden, front.id = front.id, 0  # the foremost is not followed any more
    world.run(2.0)
    (name,) = (n for n, post in world.last().posts.items() if post.role == Role.LEADER)
    assert world.last().posts[name].yaw == pytest.approx(0.0, abs=0.05)
    assert world.last().posts[name].xy[0] == pytest.approx(front.way_m + 1.6, abs=0.3)
    while world.last().state == State.WAITING and world.time_s < 60.0:
        world.step()
    assert world.robots[name][0] > front.way_m - 0.1, "beside the foremost"
    assert hidden in world.last().people


def test_robot_that_is_to_lead_leads_again_when_it_is_back():
    world = leading(leader="robot_a")
    world.silent.add("robot_a")
    world.run(3.0)
    assert world.last().posts["robot_b"].role == Role.LEADER or (
        world.last().posts["robot_c"].role == Role.LEADER
    )
    world.silent.clear()
    world.run(1.0)
    assert world.last().posts["robot_a"].role == Role.LEADER


def test_leader_that_does_not_move_is_replaced_and_takes_part_again_once_it_moves():
    world = leading()
    held = world.robots["robot_a"]
    for _ in range(60):
        world.step()
        world.robots["robot_a"] = held
    assert "robot_a: " not in world.last().reason
    assert "robot_a takes no part: is told to drive, but has not moved for 8 s" in world.events()
    assert "robot_a" not in world.last().posts
    leaders = [name for name, post in world.last().posts.items() if post.role == Role.LEADER]
    assert leaders in (["robot_b"], ["robot_c"])
    world.robots["robot_a"] = held - (0.5, 0.0)
    world.step()
    assert world.last().faults == {}
    assert "robot_a takes part again" in world.events()


def test_new_leader_is_in_front_where_people_pass_it_near_the_end():
    """The foremost stand 0.5 m before the end: nobody can get 0.8 m ahead of them."""
    world = World(tour=tour_from([[0.0, 0.0], [8.0, 0.0]], name="hall"))
    world.run(8.0)
    world.silent.add("robot_a")
    for walker in world.walkers:
        walker.distance = walker.way_m - 7.5 + 0.1 * walker.id
        walker.stands = True
        walker.way_m = 7.6 - 0.1 * walker.id
    world.run(60.0)
    assert world.last().state == State.FINISHED


def test_tour_out_and_back_comes_to_its_end():
    world = World(tour=tour_from([[0.0, 0.0], [8.0, 0.0], [0.0, 0.0]], name="there and back"))
    world.run(6.0)
    ways = []
    for _ in range(400):
        if world.guide.state == State.FINISHED:
            break
        leader = world.robots["robot_a"]
        for walker in world.walkers:
            xy = world.tour.way.at(walker.way_m, walker.left)
            away = float(np.hypot(*(leader - xy))) - walker.distance
            onward = float(np.sign(leader[0] - xy[0])) * min(max(away, 0.0), 0.18)
            walker.way_m, walker.speed, walker.stands = (
                walker.way_m + onward,
                onward / STEP_S,
                True,
            )
        ways.append(float(leader[0]))
        world.step()
    assert world.guide.state == State.FINISHED
    assert max(ways) > 6.5
    assert ways[-1] < 1.5
    before_last = world.said[-2][1]
    assert before_last.way_m > 8.0
    for name in ("robot_b", "robot_c"):
        assert before_last.posts[name].xy[0] > ways[-1] + 1.0


def test_robots_stand_while_none_takes_part_and_go_on():
    world = leading()
    world.silent.update(world.robots)
    world.run(3.0)
    assert world.last().state == State.HALTED
    assert world.last().reason.startswith("no robot takes part: robot_a: pose is ")
    assert world.last().posts == {}
    world.silent.clear()
    world.run(3.0)
    assert world.last().state == State.LEADING


def test_named_robots_without_a_pose_take_no_part():
    world = leading(robots=("robot_a", "robot_b", "robot_d"))
    assert set(world.last().posts) == {"robot_a", "robot_b"}
    assert world.last().faults == {"robot_d": "no pose"}


def test_time_that_jumps_back_is_no_error():
    world = leading()
    world.time_s -= 5.0
    world.groups.reset()
    world.last_seen = dict.fromkeys(world.robots, world.time_s)
    world.run(6.0)
    assert world.last().state in (State.LEADING, State.WAITING)


def test_one_robot_and_one_person_are_a_tour():
    walkers = [Walker(1, 1.4, 0.0, 0.0)]
    world = World(walkers=walkers, robots={"robot_a": np.array([1.5, 0.0])})
    world.run_until(State.FINISHED)


@pytest.mark.parametrize("poses", [{}, {"robot_a": Pose(START_NS, 0.0, 0.0, 0.0)}])
def test_nobody_and_no_robot_are_no_error(poses):
    guide = Guide(FOYER, GuideConfig(), FreeSpace.unbounded())
    for name, pose in poses.items():
        guide.take_pose(name, pose, START_NS)
    for k in range(3):
        guidance = guide.take_people([], [], START_NS + k, START_NS + k, ())
    assert guidance is not None
    assert guidance.state == (State.GATHERING if poses else State.HALTED)
    assert dict(guidance.posts) == {}


# ---------------------------------------------------------------------------------------- pace ----


@pytest.mark.parametrize(
    ("value", "share"),
    [(3.0, 1.0), (4.0, 1.0), (4.5, 0.84375), (5.0, 0.5), (6.0, 0.0), (9.0, 0.0), (-1.0, 1.0)],
)
def test_share_falls_smoothly(value, share):
    """At a quarter of the fall: 1 - (3 / 16 - 2 / 64) = 0.84375."""
    assert falls(value, 4.0, 6.0) == pytest.approx(share)


def speed_after(seconds: float, **group: float) -> float:
    pace = PaceControl()
    for _ in range(round(seconds / STEP_S)):
        pace.step(Pace(), highest=0.6, dt_s=STEP_S, **group)
    return pace.speed


def test_pace_slows_as_the_group_stretches_and_as_it_lags():
    assert speed_after(3.0, gap=1.0, stretch=3.0) == pytest.approx(0.6)
    assert speed_after(3.0, gap=1.0, stretch=5.0) == pytest.approx(0.3)
    assert speed_after(3.0, gap=1.0, stretch=7.0) == 0.0
    assert speed_after(3.0, gap=2.4, stretch=3.0) == pytest.approx(0.3)
    assert speed_after(3.0, gap=4.0, stretch=3.0) == 0.0


def test_leader_does_not_wait_for_ever_for_a_group_that_keeps_its_distance():
    assert speed_after(10.0, gap=4.0, stretch=3.0) > 0.0
    assert speed_after(10.0, gap=1.0, stretch=8.0) > 0.0


def test_leader_waits_in_the_end_for_a_group_that_does_not_come():
    pace = PaceControl()
    for _ in range(100):
        pace.step(Pace(), highest=0.6, gap=8.0, stretch=3.0, dt_s=STEP_S)
    assert pace.speed == 0.0
    assert 10.0 < pace.in_vain_s < 20.0
    pace.step(Pace(), highest=0.6, gap=1.0, stretch=3.0, dt_s=STEP_S)
    assert pace.in_vain_s == 0.0


def test_leader_slows_down_for_robots_that_are_off_their_posts_but_not_for_ever():
    assert speed_after(3.0, gap=1.0, stretch=3.0, off=0.5) == pytest.approx(0.6)
    assert speed_after(3.0, gap=1.0, stretch=3.0, off=1.1) == pytest.approx(0.3)
    assert speed_after(15.0, gap=1.0, stretch=3.0, off=5.0) == pytest.approx(0.15 * 0.6)
    assert speed_after(25.0, gap=1.0, stretch=3.0, off=5.0) == pytest.approx(0.6)


@pytest.mark.parametrize("seen", [True, False])
def test_leader_waits_for_robots_that_are_off_their_posts_only_where_somebody_is_unseen(seen):
    world = leading()
    if not seen:
        world.warp = lambda people: [*people[:-1], dataclasses.replace(people[-1], coasting=True)]
    for _ in range(round(3.0 / STEP_S)):
        for name in ("robot_b", "robot_c"):
            world.robots[name] = world.robots["robot_a"] - (8.0, 0.0)
        world.step()
    (speed,) = (post.speed for post in world.last().posts.values() if post.role is Role.LEADER)
    assert (speed > 0.5) if seen else (speed <= 0.15 * 0.6 + 1e-9)


def test_leader_sets_off_gently():
    pace = PaceControl()
    first = pace.step(Pace(), highest=0.6, gap=1.0, stretch=1.0, dt_s=STEP_S)
    second = pace.step(Pace(), highest=0.6, gap=1.0, stretch=1.0, dt_s=STEP_S)
    assert 0.0 < first < second < 0.6
    assert pace.stand() == 0.0

"""What is in the way limits a robot's velocity."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.config import CollisionMonitoring
from mrs_people_loc.guiding.collision_monitor import (
    MONITOR_TUNING,
    Action,
    CollisionMonitor,
    braking_speed,
    way_to_contact,
)
from mrs_people_loc.guiding.obstacles import BEARINGS, SECTORS, ObstacleScan

CONFIG = CollisionMonitoring(
    radius=0.25, time_before_collision=1.0, stop_distance=0.2, crawl=0.1, source_timeout=0.5
)
ALL = np.ones(SECTORS, dtype=bool)


def scan_of(*bodies, radius=0.0, looks=ALL, seen=ALL, reach=3.0, place=(0.0, 0.0)):
    """What a scanner sees of bodies, x, y [m] in its frame."""
    ranges = np.full(SECTORS, np.inf)
    for x, y in bodies:
        away, bearing = math.hypot(x, y), math.atan2(y, x)
        half = max(math.asin(min(radius / away, 1.0)), math.pi / SECTORS)
        hit = np.abs((BEARINGS - bearing + math.pi) % (2 * math.pi) - math.pi) <= half
        ranges[hit] = np.minimum(ranges[hit], away - radius)
    ranges[~looks] = np.inf
    return ObstacleScan(place[0], place[1], ranges, seen & looks, looks, reach)


def judge(*bodies, wanted=(0.5, 0.0), config=CONFIG, age=0.0, **how):
    monitor = CollisionMonitor(config)
    monitor.take_scan("scan", scan_of(*bodies, **how), 10.0 - age, 10.0)
    return monitor.step(wanted, 10.0)


# ---- the equations ----


def test_way_to_contact_of_hand_computed_cases():
    points = np.array([(1.0, 0.0), (1.0, 0.15), (1.0, 0.3), (-1.0, 0.0)])
    np.testing.assert_allclose(
        way_to_contact(points, (0.5, 0.0), 0.25), [0.75, 0.8, np.inf, np.inf]
    )
    np.testing.assert_allclose(
        way_to_contact(points, (-0.5, 0.0), 0.25), [np.inf, np.inf, np.inf, 0.75]
    )
    # On a circle of 1 m about (0, 1), a quarter turn leads to (1, 1).
    (way,) = way_to_contact(np.array([(1.0, 1.0)]), (0.5, 0.5), 0.25)
    assert way == pytest.approx(math.pi / 2 - 2 * math.asin(0.125))


@given(
    speed=st.sampled_from([-0.8, -0.3, 0.05, 0.4, 0.8]),
    turn=st.floats(-1.5, 1.5),
    x=st.floats(-2.0, 2.0),
    y=st.floats(-2.0, 2.0),
)
def test_way_to_contact_is_where_the_circle_first_touches(speed, turn, x, y):
    """Against the motion in small steps."""
    (way,) = way_to_contact(np.array([(x, y)]), (speed, turn), 0.25)
    times = np.arange(0.0, 3.0, 1e-3)
    yaw = turn * times
    if abs(turn) > 1e-9:
        places = speed / turn * np.stack([np.sin(yaw), 1.0 - np.cos(yaw)])
    else:
        places = np.stack([speed * times, np.zeros_like(times)])
    gap = np.hypot(x - places[0], y - places[1]) - 0.25
    if gap[0] <= 0.0:
        assert way in (0.0, np.inf)
        return
    touched = np.flatnonzero(gap <= 0.0)
    if len(touched):
        assert way == pytest.approx(abs(speed) * times[touched[0]], abs=2e-3)
    elif way < abs(speed) * 2.99:
        assert gap.min() < 1e-4  # it only just touches


def test_braking_speed_fills_the_way_that_is_left():
    speed = braking_speed(np.array([0.0, 0.375]), 1.0, 0.5)
    np.testing.assert_allclose(speed, [0.0, 0.5])  # 0.5 * 0.5 + 0.5^2 / 2


# ---- obstacles ----


def test_free_way_is_driven_as_wanted():
    verdict = judge(wanted=(0.5, 0.2))
    assert verdict.velocity == (0.5, 0.2)
    assert verdict.action is Action.PASSES
    assert not verdict.reason


def test_speed_is_scaled_to_the_time_before_a_collision():
    verdict = judge((0.85, 0.0))
    assert verdict.action is Action.SLOWS
    assert verdict.velocity == (pytest.approx(0.4, abs=0.005), 0.0)  # 0.85 - 0.25 - 0.2
    assert verdict.reason == "0.85 m ahead is something, by scan"


def test_old_data_count_for_a_longer_time():
    verdict = judge((0.85, 0.0), age=0.4)
    assert verdict.velocity[0] == pytest.approx(0.4 / 1.4, abs=0.005)


def test_weak_brakes_limit_the_speed_further():
    config = dataclasses.replace(CONFIG, deceleration=0.1)
    verdict = judge((0.85, 0.0), config=config)
    most = float(braking_speed(np.array([0.4]), 0.1, MONITOR_TUNING.reaction)[0])
    assert verdict.velocity[0] == pytest.approx(most, abs=0.01)
    assert most < 0.3


def test_robot_stands_at_the_stop_distance_and_may_turn_and_drive_away():
    verdict = judge((0.44, 0.0), wanted=(0.5, 0.3))
    assert verdict.velocity == (0.0, 0.3)
    assert verdict.action is Action.STOPS
    assert judge((0.44, 0.0), wanted=(-0.5, 0.0)).velocity == (-0.5, 0.0)
    assert judge((0.44, 0.0), wanted=(0.0, 0.8)).velocity == (0.0, 0.8)
    # Even where something touches it.
    assert judge((0.2, 0.0), wanted=(-0.5, 0.0)).velocity == (-0.5, 0.0)
    assert judge((0.2, 0.0)).velocity == (0.0, 0.0)
    assert judge((-0.44, 0.01), wanted=(-0.5, 0.0)).velocity == (0.0, 0.0)
    assert "behind" in judge((-0.44, 0.01), wanted=(-0.5, 0.0)).reason


def test_walls_beside_the_way_do_not_slow_it():
    wall = [(x, side) for x in np.arange(-1.0, 2.0, 0.05) for side in (0.3, -0.3)]
    assert judge(*wall).velocity == (0.5, 0.0)


def test_parts_of_the_robot_itself_are_no_obstacles():
    assert judge((0.1, 0.0)).velocity == (0.5, 0.0)


@given(
    bodies=st.lists(st.tuples(st.floats(-2.5, 2.5), st.floats(-2.5, 2.5)), max_size=6),
    speed=st.floats(-0.8, 0.8),
    turn=st.floats(-1.5, 1.5),
)
def test_velocity_is_never_faster_than_wanted_nor_turned_round(bodies, speed, turn):
    bodies = [(x, y) for x, y in bodies if math.hypot(x, y) > 0.01]
    v, w = judge(*bodies, wanted=(speed, turn)).velocity
    assert abs(v) <= abs(speed)
    assert v * speed >= 0.0
    assert w == turn


@pytest.mark.parametrize("wanted", [(math.nan, 0.0), (0.5, math.inf), (1e300, 0.0)])
def test_command_that_is_an_error_stops_the_robot(wanted):
    verdict = judge(wanted=wanted)
    assert verdict.velocity == (0.0, 0.0)
    assert verdict.action is Action.FAILS


# ---- what sensors cover ----


def test_robot_crawls_where_no_sensor_sees():
    blind = CollisionMonitor(CONFIG)
    verdict = blind.step((0.5, 0.2), 10.0)
    assert verdict.velocity == (0.1, 0.2)
    assert verdict.action is Action.CRAWLS
    assert blind.step((-0.5, 0.0), 10.1).velocity == (-0.1, 0.0)
    assert blind.step((0.05, 0.0), 10.2).action is Action.PASSES
    looks_back = np.abs(BEARINGS) > 1.5
    assert judge(looks=looks_back).velocity == (0.1, 0.0)
    assert judge(looks=looks_back, wanted=(-0.5, 0.0)).velocity == (-0.5, 0.0)


@pytest.mark.parametrize(("half_view", "most"), [(0.65, 0.1), (0.9, 0.1), (1.4, 0.5)])
def test_robot_whose_sensors_do_not_see_who_crosses_crawls(half_view, most):
    """A person of 1.2 m/s who is beside its way is on it in a moment: atan(1.2 / 0.5) is 1.18."""
    looks = np.abs(BEARINGS) < half_view
    assert judge(looks=looks).velocity == (most, 0.0)
    assert judge(looks=looks, wanted=(0.5, 0.2)).velocity == (most, 0.2)


def test_sonars_with_gaps_between_them_do_not_cover_the_way():
    monitor = CollisionMonitor(CONFIG)
    for k in range(8):
        yaw = math.radians(45.0 * k)
        looks = np.abs((BEARINGS - yaw + math.pi) % (2 * math.pi) - math.pi) < 0.26
        monitor.take_scan(f"sonar_{k}", scan_of(looks=looks), 10.0, 10.0)
    assert monitor.step((0.5, 0.0), 10.0).action is Action.CRAWLS


def test_gap_between_sectors_into_which_nobody_fits_is_covered():
    gaps = np.abs((np.degrees(BEARINGS) % 45.0) - 22.5) > 7.0
    assert judge(seen=gaps, looks=gaps).velocity == (0.5, 0.0)


def test_short_view_limits_the_speed_to_what_is_seen():
    config = dataclasses.replace(CONFIG, time_before_collision=3.0)
    verdict = judge(reach=1.3, config=config)
    assert verdict.action is Action.CRAWLS
    assert 0.1 < verdict.velocity[0] < 0.5


# ---- what was seen before ----


def test_silent_source_stops_the_robot_until_it_is_back():
    monitor = CollisionMonitor(CONFIG)
    monitor.take_scan("scan", scan_of(), 10.0, 10.0)
    assert monitor.step((0.5, 0.0), 10.5).velocity == (0.5, 0.0)
    verdict = monitor.step((0.5, 0.3), 10.6)
    assert verdict.velocity == (0.0, 0.0)
    assert verdict.reason == "nothing has come of scan for 0.6 s; allowed: 0.5 s"
    monitor.take_scan("scan", scan_of(), 10.7, 10.7)
    assert monitor.step((0.5, 0.0), 10.7).velocity == (0.5, 0.0)


def test_scans_that_are_old_when_they_come_stop_the_robot():
    verdict = judge(age=0.7)
    assert verdict.action is Action.FAILS
    assert verdict.reason == "scan is 0.7 s old when it comes; allowed: 0.5 s"


def test_sensor_that_has_not_delivered_or_is_refused_stops_the_robot_and_is_named():
    monitor = CollisionMonitor(CONFIG)
    monitor.expected = ("scan", "sonar_0")
    monitor.take_scan("scan", scan_of(), 10.0, 10.0)
    verdict = monitor.step((0.5, 0.3), 10.0)
    assert (verdict.velocity, verdict.reason) == ((0.0, 0.0), "nothing has come of sonar_0 yet")
    monitor.take_scan("sonar_0", scan_of(), 10.0, 10.0)
    assert monitor.step((0.5, 0.0), 10.0).velocity == (0.5, 0.0)
    monitor.refuse("scan", "has stamps 0.3 s ahead of the clock")
    assert monitor.step((0.5, 0.0), 10.0).reason == "scan has stamps 0.3 s ahead of the clock"
    monitor.take_scan("scan", scan_of(), 10.1, 10.1)
    assert monitor.step((0.5, 0.0), 10.1).velocity == (0.5, 0.0)
    monitor.reset()  # as where the node is deactivated
    assert monitor.step((0.5, 0.0), 10.2).reason == "nothing has come of scan yet"


def test_bumper_stops_the_robot_while_it_is_pressed():
    monitor = CollisionMonitor(CONFIG)
    monitor.take_contact("bumper", pressed=True)
    verdict = monitor.step((0.5, 0.3), 10.0)
    assert (verdict.velocity, verdict.reason) == ((0.0, 0.0), "bumper is true")
    monitor.reset()
    assert monitor.step((0.5, 0.3), 9.0).reason == "bumper is true", "forgotten with the time"
    monitor.take_contact("bumper", pressed=False)
    assert monitor.step((0.0, 0.3), 10.0).velocity == (0.0, 0.3)


def test_obstacles_come_nearer_as_the_robot_is_told_to_drive():
    monitor = CollisionMonitor(CONFIG)
    monitor.take_scan("scan", scan_of((2.0, 0.0)), 10.0, 10.0)
    monitor.step((0.5, 0.0), 10.0)
    monitor.step((0.5, 0.0), 10.4)
    np.testing.assert_allclose(monitor.obstacles(10.4), [(1.8, 0.0)], atol=0.04)


def test_obstacles_come_nearer_by_odometry_where_there_is_one():
    monitor = CollisionMonitor(CONFIG)
    monitor.take_odometry(5.0, 5.0, math.pi / 2, 9.9)
    monitor.take_scan("scan", scan_of((2.0, 0.0)), 10.0, 10.0)
    monitor.step((0.5, 0.0), 10.0)  # which is not obeyed
    for k in range(1, 5):
        monitor.take_odometry(5.0, 5.0, math.pi / 2, 9.9 + 0.1 * k)
    (place,) = monitor.obstacles(10.3)
    np.testing.assert_allclose(place, (2.0, 0.0), atol=0.05)
    monitor.take_odometry(5.0, 5.3, math.pi / 2 + 0.1, 10.4)  # 0.3 m ahead, and turned
    (place,) = monitor.obstacles(10.4)
    np.testing.assert_allclose(place, (1.7 * math.cos(0.1), -1.7 * math.sin(0.1)), atol=0.04)


def test_what_gets_too_near_to_be_seen_is_remembered_until_it_is_seen_to_be_gone():
    looks = np.abs(BEARINGS) < 1.4
    blind = looks & (np.abs(BEARINGS) > 0.3)
    monitor = CollisionMonitor(CONFIG)
    monitor.take_scan("head", scan_of((0.7, 0.0), looks=looks), 10.0, 10.0)
    for k in range(1, 100):  # nothing is matched there now
        monitor.take_scan("head", scan_of(looks=looks, seen=blind), 10.0 + 0.2 * k, 10.0 + 0.2 * k)
    assert monitor.step((0.5, 0.0), 29.8).velocity[0] < 0.3
    monitor.take_scan("head", scan_of(looks=looks), 30.0, 30.0)
    assert monitor.step((0.5, 0.0), 30.0).velocity == (0.5, 0.0)


def test_what_is_out_of_view_is_forgotten_after_a_while_or_where_another_sensor_sees_past_it():
    looks = np.abs(BEARINGS) < 0.6

    def turned(by_laser):
        """A robot whose head has seen somebody ahead, and that has turned by a right angle."""
        monitor = CollisionMonitor(CONFIG)
        monitor.take_odometry(0.0, 0.0, 0.0, 9.9)
        monitor.take_scan("head", scan_of((1.0, 0.0), looks=looks), 10.0, 10.0)
        monitor.take_odometry(0.0, 0.0, math.pi / 2, 10.1)
        monitor.take_scan("head", scan_of(looks=looks), 10.2, 10.2)
        assert len(monitor.obstacles(10.2)) == 1
        if by_laser:
            monitor.take_scan("scan", scan_of(), 10.3, 10.3)
        else:
            monitor.take_scan("head", scan_of(looks=looks), 12.1, 12.1)
        return monitor.obstacles(12.1)

    assert not len(turned(by_laser=True))
    assert not len(turned(by_laser=False))


# ---- what moves ----


def walks(path, wanted=(0.5, 0.0), until=2.0):
    """The last verdict of a robot that stands, while somebody walks along a path of time."""
    monitor = CollisionMonitor(CONFIG)
    monitor.take_odometry(0.0, 0.0, 0.0, 9.9)
    for k in range(round(until / 0.1) + 1):
        now_s = 10.0 + 0.1 * k
        monitor.take_odometry(0.0, 0.0, 0.0, now_s)
        monitor.take_scan("scan", scan_of(path(0.1 * k), radius=0.2), now_s, now_s)
    return monitor.step(wanted, now_s)


def test_who_walks_towards_the_robot_stops_it_sooner_than_who_stands():
    assert walks(lambda _: (1.3, 0.0)).velocity == (0.5, 0.0)
    # 0.7 m are left, which a person of 1.2 m/s and the robot go in 0.4 s.
    assert walks(lambda t: (3.3 - t, 0.0)).velocity[0] == pytest.approx(0.2, abs=0.051)


def test_who_moves_may_turn_towards_the_way_of_the_robot():
    assert walks(lambda t: (0.9, 2.8 - t)).velocity[0] < 0.4  # beside the way, 0.8 m from it
    assert walks(lambda _: (0.9, 0.8)).velocity == (0.5, 0.0)
    assert walks(lambda t: (0.9, 2.9 - 0.5 * t)).velocity == (0.5, 0.0)  # too far
    assert walks(lambda t: (-1.5, 1.9 - 0.5 * t)).velocity == (0.5, 0.0)  # behind


def test_who_walks_ahead_at_the_same_speed_is_followed():
    assert walks(lambda t: (0.2 + 0.5 * t, 0.0)).velocity == (0.5, 0.0)


def test_what_does_not_move_does_not_seem_to_while_the_robot_does():
    """Along a wall, and past its corner: what is seen anew was hidden."""
    monitor, wall = CollisionMonitor(CONFIG), np.arange(0.0, 3.0, 0.02)
    for k in range(30):
        now_s, x, yaw = 10.0 + 0.1 * k, 0.05 * k, 0.02 * k
        monitor.take_odometry(x, 0.0, yaw, now_s)
        places = np.array([[1.0 + along, 0.7] for along in wall] + [[1.0, 0.7 + a] for a in wall])
        here = (places - [x, 0.0]) @ [[math.cos(yaw), -math.sin(yaw)],
                                      [math.sin(yaw), math.cos(yaw)]]  # fmt: skip
        monitor.take_scan("scan", scan_of(*here), now_s, now_s)
        assert not monitor._known(now_s).moves.any()

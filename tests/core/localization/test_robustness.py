"""Robots that are carried, maps and team-mates that are wrong, sensors and networks that fail."""

import dataclasses
import functools

import numpy as np
import pytest

from core.localization.tours import Tour, as_walls, hall, l_corridor
from mrs_people_loc.localization.localizer import Localizer
from mrs_people_loc.team.poses import Pose

pytestmark = pytest.mark.slow

S = 1_000_000_000
RATE = 10.0
FAST = {"rate": RATE, "walls_every": 2, "met_every": 5, "seed": 3}
KNOWN = as_walls(l_corridor().walls, (0.005, 0.0005))


def off(record):
    """Position errors, shape (steps, robots)."""
    return np.hypot(record.errors()[..., 0], record.errors()[..., 1])


def off_odometry(record):
    errors = record.errors(record.odometry)
    return np.hypot(errors[..., 0], errors[..., 1])


def apart(record, second):
    """Errors of relative positions at a time, shape (robots - 1,)."""
    errors = record.relative()[round(second * RATE)]
    return np.hypot(errors[:, 0], errors[:, 1])


def carry(second, beside):
    """Carries the second robot away once."""

    def on_step(step, robots):
        if step == round(second * RATE):
            robots[1].carry(np.array(beside))

    return on_step


# ------------------------------------------------------------------------------------------ carried


@pytest.mark.parametrize("beside", [(0.0, 0.5, 0.0), (0.3, -0.4, 0.3)], ids=["aside", "turned"])
@pytest.mark.parametrize(
    ("world", "settings"),
    [
        (l_corridor(), {"met_every": 0}),
        (l_corridor(), {"met_every": 0, "known": KNOWN}),
        (hall(), {"walls_every": 0}),
    ],
    ids=["walls", "known", "people"],
)
def test_carried_robot_is_named_and_right_again(world, settings, beside):
    named = []

    def on_step(step, robots):
        carry(10, beside)(step, robots)
        states = [robot.localizer.state for robot in robots]
        named.append(["b" in state.trust and state.trust["b"].times_lost for state in states])

    tour = Tour(world, duration=16, on_step=on_step, **{**FAST, **settings})
    record = tour.run()
    at = round(10 * RATE)
    assert not any(named[at])
    assert all(named[at + round(5 * RATE)])
    assert abs(record.relative()[-1, 0, 2]) < 0.06
    assert abs(record.across()[-1, 1] - record.across()[-1, 0]) < 0.15
    others = tour.team[0].localizer.state.trust
    assert not any(trust.times_lost for robot, trust in others.items() if robot != "b")


def test_robot_that_is_not_carried_is_never_lost():
    for seed in range(2):
        tour = Tour(l_corridor(leg=20), **{**FAST, "seed": seed})
        tour.run()
        for robot in tour.team:
            assert all(t.times_lost == 0 for t in robot.localizer.state.trust.values())
            assert robot.localizer.state.doubted == {}
            assert robot.localizer.state.misfits == {}


# ------------------------------------------------------------------------------------- map is wrong


def test_known_wall_that_is_a_metre_off_is_named():
    walls = l_corridor().walls.copy()
    walls[0, [1, 3]] -= 1.0  # the right-hand one
    record = (tour := Tour(
        l_corridor(), duration=20, known=as_walls(walls, (0.01, 0.001)), met_every=0,
        **{k: v for k, v in FAST.items() if k != "met_every"},
    )).run()  # fmt: skip
    for robot in tour.team:
        misfits = robot.localizer.state.misfits
        assert set(misfits) == {0}
        assert misfits[0].offset == pytest.approx(-1.0, abs=0.1)  # nearer than in the map
    assert np.abs(record.across()).max() < 0.1


def test_map_that_is_a_metre_off_is_no_worse_than_odometry():
    walls = l_corridor().walls.copy()
    walls[:, [1, 3]] += 1.0
    record = (tour := Tour(
        l_corridor(), duration=40, known=as_walls(walls, (0.01, 0.001)), **FAST
    )).run()  # fmt: skip
    assert np.median(off(record)) < np.median(off_odometry(record))
    assert set(tour.team[0].localizer.state.misfits) == {0, 3}


# ------------------------------------------------------------------------------------------- a liar


def lie(since=0):
    """The last robot says that it is a metre from where it is."""

    def on_message(step, told, sender, receiver):
        if sender.name != "c" or step < since * RATE:
            return told
        pose = dataclasses.replace(told.pose, x=told.pose.x + 0.6, y=told.pose.y + 0.8)
        return dataclasses.replace(told, pose=pose)

    return on_message


WORLDS = {
    "all": (l_corridor(), {}),
    "walls": (l_corridor(), {"met_every": 0}),
    "people": (hall(), {"walls_every": 0}),
}


def tour_of(which, **more):
    world, settings = WORLDS[which]
    return Tour(world, duration=25, **{**FAST, **settings, **more})


@functools.cache
def honest(which):
    return tour_of(which).run()


@pytest.mark.parametrize("since", [0, 10])
@pytest.mark.parametrize("which", WORLDS)
def test_team_mate_that_lies_by_a_metre_is_named_and_does_no_harm(which, since):
    record = (tour := tour_of(which, on_message=lie(since))).run()
    for robot in tour.team[:2]:
        # Not the honest one.
        assert set(robot.localizer.state.doubted) == {"c"}
        assert robot.localizer.share().doubted == ("c",)
        # By walls alone the filters settle on less.
        assert 0.1 < robot.localizer.state.doubted["c"] < 1.4
    # Without what it knows, the others know a little less.
    limit = np.maximum(off_odometry(record), off(honest(which)) + 0.3)
    assert (off(record)[-1, :2] < limit[-1, :2]).all()
    assert np.median(off(record)[:, :2]) < np.median(limit[:, :2])


# ------------------------------------------------------------------------------ sensors and network


def test_dead_sensors_leave_dead_reckoning_and_are_told_by_their_age():
    localizer = Localizer("a", Tour(l_corridor()).config)
    tour = Tour(l_corridor(), robots=(("a", 0.0, 0.0),), duration=10, **FAST)
    tour.run()
    localizer = tour.team[0].localizer
    begin = localizer.state
    pose = begin.poses["a"]
    odometry = tour.team[0].odometry
    for k in range(1, 101):
        last = localizer.take_odometry(Pose(begin.stamp_ns + k * S // 10, *odometry))
    assert (last.x, last.y) == pytest.approx((pose.x, pose.y))
    after = localizer.state
    age = after.stamp_ns - after.sources["a", "walls"].stamp_ns
    assert age == pytest.approx(10 * S, abs=0.3 * S)


@pytest.mark.parametrize(
    ("world", "settings"),
    [(l_corridor(), {}), (hall(), {"walls_every": 0})],
    ids=["corridor", "hall"],
)
def test_partition_of_half_a_minute_is_over_within_two_seconds(world, settings):
    begin, end = 8, 38

    def cut(step, told, sender, receiver):
        return None if begin * RATE <= step < end * RATE else told

    class Cut(Tour):
        def _meet(self, stamp_ns, robots, rng):
            if not begin * S <= stamp_ns - S < end * S:
                super()._meet(stamp_ns, robots, rng)

    record = Cut(world, duration=45, on_message=cut, **{**FAST, **settings}).run()
    before, during, after = apart(record, begin), apart(record, end - 0.1), apart(record, end + 2)
    limit = 0.15
    assert before.max() < limit
    assert during.max() > limit
    assert after.max() < limit


@pytest.mark.parametrize("count", [1, 2, 8])
def test_any_number_of_robots(count):
    robots = tuple((f"r{k}", 1.0 * (k // 2), 0.8 * (k % 2) - 0.4) for k in range(count))
    tour = Tour(l_corridor(), robots=robots, duration=4, **FAST)
    record = tour.run()
    assert all(len(robot.localizer.state.poses) == count for robot in tour.team)
    assert off(record).max() < 0.15

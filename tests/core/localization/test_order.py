"""What comes late, twice or not at all; who comes, goes and begins again."""

import dataclasses
import math

import numpy as np
import pytest

from core.localization.test_localizer import (
    CONFIG,
    S,
    covariance,
    drive,
    hear,
    seen_at,
    stand,
    two,
)
from mrs_people_loc.errors import PoseError
from mrs_people_loc.localization.localizer import Localizer
from mrs_people_loc.localization.odometry import Odometry
from mrs_people_loc.localization.shared import RelativePose, TeamPose
from mrs_people_loc.team.poses import Pose


def observations(rng):
    """Of a robot that drives along a wall: walls, poses, relative poses, each with a stamp."""
    made = []
    for k in range(1, 24):
        stamp_ns = S + k * S // 10
        wall = seen_at(stamp_ns, (0.5, 2 + 0.005 * rng.normal(), 3.0, 2 + 0.005 * rng.normal()))
        made.append((stamp_ns, "take_walls", wall))
        if k % 5 == 0:
            pose = Pose(stamp_ns + 1, 0.05 * k, 0.02, 0.0, covariance(0.1, 0.1, 0.05))
            made.append((stamp_ns + 1, "take_absolute", pose))
        if k % 4 == 0:
            met = RelativePose(
                "b", stamp_ns - 2, "a", stamp_ns + 2,
                np.array([0.05 * k, -1.0, 0.0]) + 0.02 * rng.normal(size=3),
                covariance(0.05, 0.05, 0.02),
            )  # fmt: skip
            made.append((stamp_ns + 2, "take_relative", met))
    return made


def told(stamp_ns, way=0.0, **fields):
    """A team-mate that stands at (0, 1)."""
    return TeamPose(
        "b",
        Pose(stamp_ns, 0.0, 1.0, 0.0, covariance(0.1, 0.1, 0.05)),
        Odometry(stamp_ns, 0.0, 0.0, 0.0, 4e-4 * way, 3.6e-5 * way),
        **fields,
    )


def with_mate():
    localizer = Localizer("a", CONFIG)
    localizer.take_odometry(Pose(S, 0.0, 0.0, 0.0))
    localizer.take_teammate(told(S))
    for k in range(1, 51):
        stamp_ns = S + k * S // 20
        localizer.take_odometry(Pose(stamp_ns, 0.025 * k, 0.0, 0.0))
        localizer.take_teammate(told(stamp_ns))
    return localizer


@pytest.mark.parametrize("seed", range(3))
def test_late_observations_count_as_in_order(seed):
    rng = np.random.default_rng(seed)
    seen = observations(rng)
    in_order, shuffled = with_mate(), with_mate()
    for _, kind, value in sorted(seen, key=lambda one: one[0]):
        getattr(in_order, kind)(value)
    for k in rng.permutation(len(seen)):
        getattr(shuffled, seen[k][1])(seen[k][2])
        shuffled.pose_at(3 * S)  # applies what is there
    one, other = in_order.state, shuffled.state
    for robot in ("a", "b"):
        p, q = one.poses[robot], other.poses[robot]
        assert (p.x, p.y, p.yaw) == pytest.approx((q.x, q.y, q.yaw), abs=1e-9)
        np.testing.assert_allclose(p.covariance, q.covariance, atol=1e-9)
    assert one.sources == other.sources
    assert one.sources["a", "walls"].accepted > 10
    assert one.sources["b", "relative"].accepted > 3


def test_observation_waits_for_its_odometry():
    localizer = Localizer("a", CONFIG)
    localizer.take_odometry(Pose(S, 0.0, 0.0, 0.0))
    localizer.take_absolute(Pose(S + S // 10, 0.2, 0.0, 0.0, covariance(0.1, 0.1, 0.05)))
    assert localizer.take_odometry(Pose(S + S // 20, 0.0, 0.0, 0.0)).x == 0.0
    assert localizer.take_odometry(Pose(S + S // 5, 0.0, 0.0, 0.0)).x == pytest.approx(0.1)


def test_observation_before_all_odometry_is_counted_as_late():
    localizer = Localizer("a", CONFIG)
    localizer.take_odometry(Pose(5 * S, 0.0, 0.0, 0.0))
    localizer.take_absolute(Pose(S, 0.2, 0.0, 0.0, covariance(0.1, 0.1, 0.05)))
    assert localizer.state.late == 1
    assert localizer.pose_at(5 * S).x == 0.0


def test_two_sensors_may_measure_at_one_time():
    localizer = Localizer("a", CONFIG)
    localizer.take_odometry(Pose(S, 0.0, 0.0, 0.0))
    for _ in range(2):
        localizer.take_absolute(Pose(S, 0.3, 0.0, 0.0, covariance(0.1, 0.1, 0.05)))
    localizer.take_odometry(Pose(S + 10, 0.0, 0.0, 0.0))
    assert localizer.pose_at(S + 10).x == pytest.approx(0.2, abs=1e-3)


def test_lost_messages_cost_nothing():
    def run(keeps):
        a, b = two((0.0, 0.1, 0.0))
        for step in range(41):
            stamp_ns = S + step * S // 20
            for localizer in (a, b):
                localizer.take_odometry(Pose(stamp_ns, 0.02 * step, 0.0, 0.0))
                if step % 2 == 0:
                    localizer.take_walls(seen_at(stamp_ns, (0, 2, 3, 2)))
            if step == 0 or keeps(step):
                hear(a, b)
        hear(a, b)
        return a.state.poses["b"]

    all_heard, few_heard = run(lambda step: True), run(lambda step: step % 5 == 0)
    assert few_heard.y == pytest.approx(all_heard.y, abs=1e-6)
    np.testing.assert_allclose(few_heard.covariance, all_heard.covariance, atol=1e-8)


def test_robot_that_joins_later_is_taken_in():
    a, b = two()
    stand((a,), 2.0)
    assert list(a.state.poses) == ["a"]
    stand((a, b), 1.0, begin_ns=4 * S)
    assert set(a.state.poses) == set(b.state.poses) == {"a", "b"}


def test_robot_that_is_silent_for_long_has_left():
    a, b = two()
    stand((a, b), 1.0)
    stand((a,), 60.0, begin_ns=3 * S)
    assert "b" in a.state.poses
    stand((a,), 70.0, begin_ns=64 * S)
    assert list(a.state.poses) == ["a"]
    stand((a, b), 1.0, begin_ns=135 * S)
    assert set(a.state.poses) == {"a", "b"}


def test_team_mate_that_starts_again_begins_where_it_says():
    a, b = two()
    for k in range(41):
        for localizer in (a, b):
            localizer.take_odometry(Pose(S + k * S // 20, 0.05 * k, 0.0, 0.0))
        hear(a, b)
    assert a.state.poses["b"].x == pytest.approx(2.0)
    again = Localizer("b", dataclasses.replace(CONFIG, start=(2.0, 0.5, 0.3)))
    for k in range(21):
        stamp_ns = 4 * S + k * S // 20
        a.take_odometry(Pose(stamp_ns, 2.0, 0.0, 0.0))
        again.take_odometry(Pose(stamp_ns, 0.05 * k, 0.0, 0.0))
        hear(a, again)
    pose = a.state.poses["b"]
    assert (pose.x, pose.y) == pytest.approx((2 + math.cos(0.3), 0.5 + math.sin(0.3)))
    assert again.state.poses["b"].x == pytest.approx(pose.x)


def test_clock_that_jumps_back_begins_anew():
    localizer = Localizer("a", CONFIG)
    drive(localizer, velocity=1.0, seconds=3.0, start_ns=100 * S)
    for k in range(2):
        with pytest.raises(PoseError):
            localizer.take_odometry(Pose(S + k, 7.0, 0.0, 0.0))
    pose = localizer.take_odometry(Pose(S + 2, 7.0, 0.0, 0.0))
    assert pose.x == 7.0
    assert localizer.state.resets == 1
    np.testing.assert_allclose(pose.covariance, covariance(0.1, 0.1, 0.05))


def test_reset_forgets_everything():
    localizer = with_mate()
    localizer.reset()
    assert localizer.state.poses == {}
    assert localizer.take_odometry(Pose(S, 3.0, 0.0, 0.0)).x == 3.0


def test_team_mate_whose_clock_is_off_is_named_and_not_heard():
    localizer = Localizer("a", CONFIG)
    localizer.take_odometry(Pose(S, 0.0, 0.0, 0.0))
    localizer.take_teammate(told(9 * S))
    state = localizer.state
    assert state.clocks == {"b": 8.0}
    assert list(state.poses) == ["a"]


def test_own_messages_are_not_heard():
    localizer = Localizer("b", CONFIG)
    localizer.take_odometry(Pose(S, 0.0, 0.0, 0.0))
    localizer.take_teammate(told(S))
    assert localizer.pose_at(S).y == 0.0


@pytest.mark.slow
def test_history_is_bounded():
    localizer = Localizer("a", CONFIG)
    for k in range(2000):
        stamp_ns = S + k * S // 20
        localizer.take_odometry(Pose(stamp_ns, 0.0, 0.0, 0.0))
        localizer.take_walls(seen_at(stamp_ns, (0, 2, 3, 2)))
    # 3 to 4.5 s of 20 walls and one tick a second.
    assert len(localizer._history._observations) < 4.6 * 21
    assert len(localizer._track._stamps) < 7.6 * 20
    assert len(localizer.share().walls) <= 7

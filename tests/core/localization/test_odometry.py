"""Dead reckoning: what it adds up, and what lies between two times."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.config import Localization
from mrs_people_loc.errors import PoseError
from mrs_people_loc.localization.odometry import (
    TRUE_WHEELS,
    DeadReckoning,
    Odometry,
    OdometryTrack,
    by_wheels,
    carried_on,
    motion,
    wandered,
)
from mrs_people_loc.team.poses import Pose

S = 1_000_000_000
CONFIG = Localization(position_noise=0.1, heading_noise=0.2, turn_noise=0.3)


def odometry(stamp_ns=0, x=0.0, y=0.0, yaw=0.0, position=0.0, heading=0.0):
    return Odometry(stamp_ns, x, y, yaw, position, heading)


def test_way_and_turn_add_to_the_variances():
    reckoning = DeadReckoning(CONFIG)
    reckoning.take(Pose(S, 0.0, 0.0, 0.0))
    reckoning.take(Pose(2 * S, 0.3, 0.4, 0.0))  # 0.5 m
    made = reckoning.take(Pose(3 * S, 0.3, 0.4, -0.2))
    assert made.position_variance == pytest.approx(0.01 * 0.5)
    assert made.heading_variance == pytest.approx(0.04 * 0.5 + 0.09 * 0.2)


def test_larger_growth_that_the_odometry_states_is_used():
    reckoning = DeadReckoning(CONFIG)
    reckoning.take(Pose(S, 0.0, 0.0, 0.0, np.diag([1.0, 1.0, 0.5])))
    made = reckoning.take(Pose(2 * S, 1.0, 0.0, 0.0, np.diag([1.2, 1.1, 0.9])))
    assert made.position_variance == pytest.approx(0.1)
    assert made.heading_variance == pytest.approx(0.4)


def test_covariance_that_does_not_grow_adds_nothing():
    reckoning = DeadReckoning(CONFIG)
    reckoning.take(Pose(S, 0.0, 0.0, 0.0, np.eye(3)))
    made = reckoning.take(Pose(2 * S, 1.0, 0.0, 0.0, 0.5 * np.eye(3)))
    assert made.position_variance == pytest.approx(0.01)
    assert made.heading_variance == pytest.approx(0.04)


def test_heading_that_passes_pi_is_a_small_turn():
    reckoning = DeadReckoning(CONFIG)
    reckoning.take(Pose(S, 0.0, 0.0, 3.1))
    made = reckoning.take(Pose(2 * S, 0.0, 0.0, -3.1))
    assert made.heading_variance == pytest.approx(0.09 * (2 * math.pi - 6.2))


def test_clock_that_jumps_back_begins_anew():
    reckoning = DeadReckoning(CONFIG)
    reckoning.take(Pose(100 * S, 0.0, 0.0, 0.0))
    reckoning.take(Pose(101 * S, 9.0, 0.0, 0.0))
    for k in range(2):
        with pytest.raises(PoseError, match="wanted: newer"):
            reckoning.take(Pose(S + k, 0.0, 0.0, 0.0))
    made = reckoning.take(Pose(S + 2, 0.0, 0.0, 0.0))
    assert (made.stamp_ns, made.position_variance) == (S + 2, 0.0)


def test_odometry_that_starts_again_leaves_the_robot_where_it_was():
    reckoning = DeadReckoning(CONFIG)
    reckoning.take(Pose(S, 8.0, 0.0, 0.0))
    before = reckoning.take(Pose(2 * S, 8.0, 1.0, math.pi / 2))
    jumped = reckoning.take(Pose(3 * S, 0.0, 0.0, 0.0))
    assert (jumped.x, jumped.y, jumped.yaw) == pytest.approx((8.0, 1.0, math.pi / 2))
    assert jumped.position_variance == pytest.approx(before.position_variance + 0.25)
    assert jumped.heading_variance == pytest.approx(before.heading_variance + 0.04)
    after = reckoning.take(Pose(4 * S, 0.5, 0.0, 0.1))
    assert (after.x, after.y, after.yaw) == pytest.approx((8.0, 1.5, math.pi / 2 + 0.1))
    assert reckoning.jumps == 1


def test_motion_by_hand():
    # 2 m north, while the robot looks north and turns by 0.3.
    moved, covariance = motion(
        odometry(yaw=math.pi / 2),
        odometry(y=2.0, yaw=math.pi / 2 + 0.3, position=0.01, heading=0.06),
    )
    np.testing.assert_allclose(moved, [2.0, 0.0, 0.3], atol=1e-12)
    across = 0.01 + 0.06 * 4 / 3
    wanted = [[0.01, 0.0, 0.0], [0.0, across, 0.06], [0.0, 0.06, 0.06]]
    np.testing.assert_allclose(covariance, wanted, atol=1e-12)


def test_motion_in_parts_is_the_motion_at_once():
    # A straight way of 10 m in one piece and in a hundred.
    at = [odometry(k, 0.1 * k, 0.0, 0.0, 4e-4 * 0.1 * k, 3.6e-5 * 0.1 * k) for k in range(101)]
    place, covariance = np.array([1.0, 2.0, 0.0]), np.zeros((3, 3))
    for before, after in itertools.pairwise(at):
        moved, noise = motion(before, after)
        place, jacobian = carried_on(place, moved)
        covariance = jacobian @ covariance @ jacobian.T + noise
    whole, noise = motion(at[0], at[-1])
    np.testing.assert_allclose(place, carried_on(np.array([1.0, 2.0, 0.0]), whole)[0])
    np.testing.assert_allclose(covariance, noise, atol=1e-12)


def test_motion_with_random_errors_has_its_covariance():
    # Steps of 1 cm; the errors as `DeadReckoning` states them.
    rng = np.random.default_rng(1)
    steps, count = 300, 8_000
    x = y = yaw = np.zeros(count)
    for _ in range(steps):
        x = x + np.cos(yaw) * 0.01 + rng.normal(size=count) * 0.02 * math.sqrt(0.01)
        y = y + np.sin(yaw) * 0.01 + rng.normal(size=count) * 0.02 * math.sqrt(0.01)
        yaw = yaw + rng.normal(size=count) * 0.03 * math.sqrt(0.01)
    way = steps * 0.01
    _, wanted = motion(odometry(), odometry(1, way, 0.0, 0.0, 0.02**2 * way, 0.03**2 * way))
    np.testing.assert_allclose(np.cov([x, y, yaw]), wanted, rtol=0.06, atol=1e-4)


def test_track_interpolates():
    track = OdometryTrack()
    track.add(odometry(0, 0.0, 0.0, 3.1, 0.0, 0.0))
    track.add(odometry(S, 1.0, 2.0, -3.1, 0.4, 0.2))
    made = track.at(S // 4)
    assert (made.x, made.y) == pytest.approx((0.25, 0.5))
    assert made.yaw == pytest.approx(3.1 + (2 * math.pi - 6.2) / 4)
    assert (made.position_variance, made.heading_variance) == pytest.approx((0.1, 0.05))


def test_track_extrapolates_a_little():
    track = OdometryTrack()
    track.add(odometry(0, 0.0))
    track.add(odometry(S, 1.0, position=0.4))
    made = track.at(S + S // 10)
    assert (made.x, made.position_variance) == pytest.approx((1.1, 0.44))
    with pytest.raises(PoseError, match=r"0\.200 s away"):
        track.at(S + S // 5)


@given(st.permutations(range(8)))
def test_late_odometry_is_put_in_its_place(order):
    track = OdometryTrack()
    for k in order:
        track.add(odometry(k * S, float(k)))
        track.add(odometry(k * S, 99.0))  # repeated
    assert [track.at(k * S).x for k in range(8)] == list(range(8))
    assert track.at(7 * S // 2).x == pytest.approx(3.5)


def test_track_forgets_what_is_old():
    track = OdometryTrack(span_ns=2 * S)
    for k in range(20):
        track.add(odometry(k * S, float(k)))
    assert track.covers(17 * S)
    assert not track.covers(10 * S)
    with pytest.raises(PoseError, match="the nearest odometry is"):
        track.at(10 * S)


def test_covariance_that_is_large_only_while_driving_does_not_destroy_the_heading():
    """A metre with a stated 1000 rad^2: 25 times the modelled growth at most."""
    config = Localization()
    reckoning = DeadReckoning(config)
    reckoning.take(Pose(S, 0.0, 0.0, 0.0, np.diag([1e-9, 1e-9, 1e-9])))
    made = reckoning.take(Pose(2 * S, 1.0, 0.0, 0.0, np.diag([1e-3, 1e-3, 1e3])))
    assert made.heading_variance == pytest.approx(25.0 * config.heading_noise**2)


def test_base_that_starts_again_beside_its_origin_leaves_the_heading():
    reckoning = DeadReckoning(Localization())
    reckoning.take(Pose(S, 0.5, 0.0, 1.5))
    made = reckoning.take(Pose(S + 20_000_000, 0.0, 0.0, 0.0))
    assert (made.x, made.y, made.yaw) == pytest.approx((0.5, 0.0, 1.5))
    assert reckoning.jumps == 1


def test_motion_of_unknown_errors_stays_finite():
    _, covariance = motion(odometry(), odometry(stamp_ns=S, x=1.0, position=1e12, heading=1e12))
    assert np.linalg.eigvalsh(covariance)[0] > 0
    assert covariance.max() <= 1.1e4


# -------------------------------------------------------------------------------- systematic errors


@pytest.mark.parametrize(
    ("moved", "wheels", "wanted"),
    [
        ((2.0, 0.0, 0.0), (0.1, 0.0, 0.0), (2.2, 0.0, 0.0)),
        # A metre straight on that is an arc of 0.2 rad: its chord is turned by half of that.
        ((1.0, 0.0, 0.0), (0.0, 0.2, 0.0), (math.cos(0.1), math.sin(0.1), 0.2)),
        # Backwards: the same circle.
        ((-1.0, 0.0, 0.0), (0.0, 0.2, 0.0), (-math.cos(0.1), math.sin(0.1), -0.2)),
        ((-2.0, 0.0, 0.0), (0.1, 0.0, 0.0), (-2.2, 0.0, 0.0)),
        ((0.0, 0.0, 0.5), (0.1, 0.2, 0.04), (0.0, 0.0, 0.52)),
        ((0.0, 0.0, -0.5), (0.1, 0.2, 0.04), (0.0, 0.0, -0.52)),
        # No wheel drives to the side.
        ((0.0, 0.3, 0.0), (0.1, 0.2, 0.04), (0.0, 0.3, 0.0)),
    ],
    ids=["scale", "per metre", "backwards", "scale backwards", "per radian", "right", "aside"],
)
def test_systematic_errors_by_hand(moved, wheels, wanted):
    np.testing.assert_allclose(by_wheels(np.array(moved), np.array(wheels))[0], wanted, atol=1e-12)


WHEELS = st.tuples(*[st.floats(-0.3, 0.3)] * 3).map(np.array)
STEPS = st.tuples(st.floats(-2.0, 2.0), st.floats(-0.5, 0.5), st.floats(-1.5, 1.5)).map(np.array)


@given(STEPS, WHEELS, st.floats(0.0, 1.0))
def test_jacobian_by_wheels(moved, wheels, seconds):
    _, jacobian = by_wheels(moved, wheels, seconds)
    for k, axis in enumerate(1e-6 * np.eye(3)):
        up, down = (by_wheels(moved, wheels + by, seconds)[0] for by in (axis, -axis))
        np.testing.assert_allclose(jacobian[:, k], (up - down) / 2e-6, atol=1e-6)


@given(STEPS)
def test_true_wheels_change_nothing(moved):
    np.testing.assert_array_equal(by_wheels(moved, TRUE_WHEELS, 0.1)[0], moved)


@pytest.mark.parametrize("seconds", [0.05, 0.2, 1.0])
def test_turn_that_may_be_noise_tells_nothing_about_wheels(seconds):
    wheels = np.array([0.0, 0.0, 0.1])
    for rate in (0.0, 0.05, -0.099):
        turn = rate * seconds
        made, jacobian = by_wheels(np.array([0.0, 0.0, turn]), wheels, seconds)
        assert made[2] == turn
        np.testing.assert_array_equal(jacobian, np.zeros((3, 3)))
    # Of a turn at twice that rate three quarters count, of a fast one nearly all.
    for rate, share in ((0.2, 0.75), (-1.0, 0.99)):
        turn = rate * seconds
        made, jacobian = by_wheels(np.array([0.0, 0.0, turn]), wheels, seconds)
        assert made[2] == pytest.approx(turn + 0.1 * share * turn)
        assert jacobian[2, 2] == pytest.approx(share * turn)


def test_wheels_wander_with_the_way_and_the_turn():
    # By 5 % of what they may be, after 1 m and after 1 rad.
    made = wandered(odometry(), odometry(x=0.6, y=0.8, yaw=-0.5))
    np.testing.assert_allclose(made, 0.05**2 * np.array([1.0, 1.0, 0.5]))


@pytest.mark.parametrize("wheels", [(0.05, 0.0, 0.0), (0.0, -0.02, 0.0), (-0.03, 0.01, 0.06)])
def test_known_systematic_errors_are_corrected(wheels):
    """An S of 9 m, then back, in steps of 1 cm: the true way is known again."""
    scale, per_metre, per_radian = wheels
    true, said = np.zeros(3), np.array([3.0, -1.0, 2.0])
    reckoning = DeadReckoning(Localization(wheels=wheels))
    made = reckoning.take(Pose(S, *said))
    begin = np.array([made.x, made.y, made.yaw])
    for k in range(1, 1200):
        way, turn = (0.01 if k < 900 else -0.01), 0.008 * math.sin(k / 150)
        seen_way = way / (1.0 + scale)
        seen_turn = (turn - per_metre * seen_way) / (1.0 + per_radian)
        true = carried_on(true, along_arc(way, turn))[0]
        said = carried_on(said, along_arc(seen_way, seen_turn))[0]
        made = reckoning.take(Pose(S + k * S // 20, said[0], said[1], said[2]))
    wanted = carried_on(begin, true)[0]
    np.testing.assert_allclose([made.x, made.y], wanted[:2], atol=5e-4)
    assert math.remainder(made.yaw - wanted[2], 2 * math.pi) == pytest.approx(0.0, abs=1e-4)
    assert math.hypot(*(said - wanted)[:2]) > 0.1


def along_arc(way, turn):
    """What a robot moves that drives a short way while it turns evenly, shape (3,)."""
    return np.array([way * math.cos(0.5 * turn), way * math.sin(0.5 * turn), turn])


def hanging(speed, *, stands_s, then=0.0, rate=20):
    """Dead reckoning of a base that drives 2 s, says the same for a while, and goes on `then`."""
    reckoning, x, made = DeadReckoning(Localization(wheel_sigmas=(0.0, 0.0, 0.0))), 0.0, []
    for k in range(round((2.0 + stands_s) * rate)):
        if k < 2 * rate:
            x += speed / rate
        made.append(reckoning.take(Pose(S + k * S // rate, x, 0.0, 0.0)))
    made.append(reckoning.take(Pose(made[-1].stamp_ns + S // rate, x + then, 0.0, 0.0)))
    return reckoning, made


def test_odometry_that_stops_dead_hangs_and_is_as_unsure_as_if_it_drove_on():
    reckoning, made = hanging(0.5, stands_s=3.0)
    grown = made[-1].position_variance - made[39].position_variance
    assert grown == pytest.approx((0.5 * 3.05) ** 2, rel=0.05)
    assert reckoning.hung_ns == made[-1].stamp_ns
    # It does not grow for ever.
    grown = (again := hanging(0.5, stands_s=9.0)[1])[-1].position_variance - again[
        39
    ].position_variance
    assert grown == pytest.approx((0.5 * 5.0) ** 2, rel=0.05)


def test_odometry_that_hung_and_catches_up_has_not_jumped():
    reckoning, made = hanging(0.5, stands_s=3.0, then=1.5)
    assert (reckoning.jumps, made[-1].x) == (0, pytest.approx(2.5))
    reckoning, made = hanging(0.5, stands_s=3.0, then=9.0)
    assert (reckoning.jumps, made[-1].x) == (1, pytest.approx(1.0))


@pytest.mark.parametrize(("speed", "stands_s"), [(0.1, 3.0), (0.5, 0.2)])
def test_robot_that_was_slow_or_stood_for_a_moment_does_not_hang(speed, stands_s):
    reckoning, made = hanging(speed, stands_s=stands_s)
    assert reckoning.hung_ns == 0
    assert made[-1].position_variance == made[39].position_variance


@pytest.mark.parametrize(
    ("rate", "turn", "told"), [(8, 0.06, True), (4, 0.06, False), (4, 0.02, True)]
)
def test_when_a_robot_turned_is_not_known_where_odometry_was_lost(rate, turn, told):
    track = OdometryTrack()
    for k in range(3):
        track.add(Odometry(S + k * S // rate, 0.1 * k, 0.0, turn * k, 0.0, 0.0))
    assert track.tells(S + S // rate)
    assert track.tells(S + S // rate + 1) == told
    assert not track.tells(S - 1)
    assert not track.tells(S + 2 * S // rate + 1)

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.errors import PoseError
from mrs_people_loc.geometry import wrap_angle
from mrs_people_loc.team.poses import Pose, PoseBuffer, PoseTuning, frame_of, shared_effect

PI = math.pi
MS = 1_000_000
SECOND = 1000 * MS
EXACT = np.zeros((3, 3))


def pose(at_ms=0.0, x=0.0, y=0.0, yaw=0.0, covariance=EXACT) -> Pose:
    return Pose(round(at_ms * MS), x, y, yaw, covariance)


def buffer(*poses: Pose) -> PoseBuffer:
    result = PoseBuffer()
    for each in poses:
        result.add(each)
    return result


def assert_same_place(one: Pose, other: Pose, tolerance: float = 1e-9) -> None:
    assert (one.x, one.y) == pytest.approx((other.x, other.y), abs=tolerance)
    assert wrap_angle(one.yaw - other.yaw) == pytest.approx(0.0, abs=tolerance)


# ------------------------------------------------------------------------- one pose ----


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("name", ["x", "y", "yaw"])
def test_a_pose_must_be_finite(name, bad):
    with pytest.raises(PoseError, match=f"{name}={bad}.*; wanted: finite"):
        pose(**{name: bad})


@pytest.mark.parametrize(
    "covariance",
    [np.zeros(9), np.zeros((2, 2)), np.full((3, 3), math.nan), np.diag([1.0, -1e-9, 1.0])],
    ids=["flat", "small", "nan", "negative variance"],
)
def test_covariance_must_be_valid(covariance):
    with pytest.raises(PoseError, match=r"covariance of x, y, yaw is no covariance .*: \["):
        pose(covariance=covariance)


def test_pose_without_covariance_is_exact():
    np.testing.assert_array_equal(Pose(0, 1.0, 2.0, 3.0).covariance, EXACT)


# ---------------------------------------------------------------------- composition ----


def test_composition_matches_hand_computed_values():
    # In a frame at (1, 2) that is turned to the left: 3 ahead is 3 along y, 0.5 left is -0.5 in x.
    composed = pose(7, 1.0, 2.0, PI / 2) @ pose(9, 3.0, 0.5, PI)
    assert_same_place(composed, pose(0, 0.5, 5.0, -PI / 2))
    assert composed.stamp_ns == 9 * MS


def test_covariances_of_a_composition_match_hand_computed_values():
    # An error of the heading moves what is 2 m ahead sideways, twice as much.
    composed = pose(covariance=np.diag([0.1, 0.2, 0.01])) @ pose(0, 2.0, 0.0)
    np.testing.assert_allclose(
        composed.covariance, [[0.1, 0, 0], [0, 0.2 + 0.04, 0.02], [0, 0.02, 0.01]]
    )
    # The other's own is turned.
    composed = pose(yaw=PI / 2) @ pose(covariance=np.diag([0.1, 0.2, 0.3]))
    np.testing.assert_allclose(composed.covariance, np.diag([0.2, 0.1, 0.3]), atol=1e-15)


place = st.floats(-20, 20)
angle = st.floats(-7, 7)
poses = st.builds(pose, st.just(0.0), place, place, angle)


def inverse(of: Pose) -> Pose:
    c, s = math.cos(of.yaw), math.sin(of.yaw)
    return pose(0, -c * of.x - s * of.y, s * of.x - c * of.y, -of.yaw)


@given(poses)
def test_a_pose_and_its_inverse_cancel(one):
    assert_same_place(one @ inverse(one), pose())
    assert_same_place(inverse(one) @ one, pose())


@given(poses, poses, poses)
def test_composition_is_associative(a, b, c):
    assert_same_place((a @ b) @ c, a @ (b @ c), 1e-8)
    assert -PI < (a @ b).yaw <= PI


def test_frame_matches_hand_computed_values():
    """The frame is turned by a quarter; 3 m along its x is 3 m along y of the map."""
    frame = frame_of(pose(x=1.0, y=5.0, yaw=PI / 2 + 0.25), pose(x=3.0, y=0.0, yaw=0.25))
    assert_same_place(frame, pose(x=1.0, y=2.0, yaw=PI / 2))


@given(poses, poses)
def test_frame_of_a_composition_is_its_first_pose(frame, local):
    found = frame_of(frame @ local, local)
    assert_same_place(found, frame)
    np.testing.assert_array_equal(found.covariance, EXACT)


def random_covariance(seed: int) -> np.ndarray:
    root = np.random.default_rng(seed).normal(0, 0.3, (3, 3))
    return root @ root.T


@given(poses, poses, st.integers(0, 9))
def test_covariance_of_a_composition_equals_finite_differences(a, b, seed):
    def as_vector(of: Pose) -> np.ndarray:
        return np.array([of.x, of.y, of.yaw])

    def composed(vector: np.ndarray) -> np.ndarray:
        return as_vector(pose(0, *vector[:3]) @ pose(0, *vector[3:]))

    centre, step = np.concatenate([as_vector(a), as_vector(b)]), 1e-5
    jacobian = np.empty((3, 6))
    for i, unit in enumerate(np.eye(6) * step):
        difference = composed(centre + unit) - composed(centre - unit)
        difference[2] = wrap_angle(difference[2])
        jacobian[:, i] = difference / (2 * step)
    both = np.zeros((6, 6))
    both[:3, :3], both[3:, 3:] = random_covariance(seed), random_covariance(seed + 100)
    a, b = (dataclasses.replace(p, covariance=c) for p, c in ((a, both[:3, :3]), (b, both[3:, 3:])))
    np.testing.assert_allclose((a @ b).covariance, jacobian @ both @ jacobian.T, atol=1e-4)


# ---------------------------------------------------------------------- interpolation ----


def test_interpolation_halfway_matches_hand_computed_values():
    poses = buffer(
        pose(100, 1.0, 10.0, 0.2, np.diag([0.1, 0.2, 0.3])),
        pose(200, 2.0, 6.0, 0.6, np.diag([0.5, 0.2, 0.1])),
    )
    at = poses.at(125 * MS, SECOND)
    assert at.stamp_ns == 125 * MS
    assert_same_place(at, pose(0, 1.25, 9.0, 0.3))
    np.testing.assert_allclose(at.covariance, np.diag([0.2, 0.2, 0.25]))


def test_interpolation_is_exact_at_poses():
    given_poses = [pose(10 * i, 0.1 * i**3, -0.2 * i**2, 0.3 * i % 3) for i in range(9)]
    poses = buffer(*given_poses)
    for each in given_poses:
        assert poses.at(each.stamp_ns, 0) is each


@pytest.mark.parametrize(
    ("yaw_before", "yaw_after", "halfway"),
    [
        (3.0, -3.0, PI),  # to the left over pi
        (-3.0, 3.0, PI),
        (PI - 0.1, -PI + 0.3, -PI + 0.1),
        (-PI + 0.3, PI - 0.1, -PI + 0.1),
        (0.1, 2 * PI - 0.1, 0.0),
        (-0.2, 0.4, 0.1),
    ],
)
def test_heading_is_interpolated_the_shorter_way(yaw_before, yaw_after, halfway):
    at = buffer(pose(0, yaw=yaw_before), pose(10, yaw=yaw_after)).at(5 * MS, SECOND)
    assert wrap_angle(at.yaw - halfway) == pytest.approx(0.0, abs=1e-9)
    assert -PI < at.yaw <= PI


speed = st.floats(-2, 2)


@given(
    start=poses,
    velocity=st.tuples(speed, speed, speed),
    times_ms=st.lists(st.integers(0, 1000), min_size=2, max_size=8, unique=True),
    at_ms=st.integers(0, 1100),
)
def test_interpolation_is_exact_for_constant_velocity(start, velocity, times_ms, at_ms):
    def true(t_ms: float) -> Pose:
        x, y, yaw = (p + v * t_ms / 1000 for p, v in zip((start.x, start.y, start.yaw), velocity))  # noqa: B905
        return pose(t_ms, x, y, wrap_angle(yaw))

    poses = buffer(*map(true, times_ms))
    at_ms = max(at_ms, min(times_ms))
    at = poses.at(at_ms * MS, 2 * SECOND)
    if at_ms <= max(times_ms):
        assert_same_place(at, true(at_ms))
    else:  # past the newest, if there was another within the last 100 ms to take the speed from
        recent = [t for t in times_ms if t >= max(times_ms) - 100]
        assert_same_place(at, true(at_ms if len(recent) > 1 else max(times_ms)), 1e-7)
    assert at.stamp_ns == at_ms * MS


# ----------------------------------------------------------------- beyond the newest ----


def test_poses_are_extrapolated_past_the_newest():
    covariance = np.diag([0.01, 0.02, 0.03])
    # A long way back it was faster: the speed is that over the last 100 ms.
    poses = buffer(
        pose(0, -50.0), pose(400, 0.0), pose(450, 9.0), pose(500, 0.2, -0.1, 0.05, covariance)
    )
    at = poses.at(550 * MS, 50 * MS)
    assert_same_place(at, pose(0, 0.3, -0.15, 0.075))
    # The square of the way that it was carried is added, and what a change of speed makes.
    moved = np.diag([0.1**2, 0.05**2, 0.025**2]) + np.eye(3) * (0.05**2 / 2) ** 2
    np.testing.assert_allclose(at.covariance, covariance + moved, atol=1e-12)


def test_extrapolation_wraps_at_pi():
    at = buffer(pose(0, yaw=PI - 0.2), pose(100, yaw=PI - 0.1)).at(300 * MS, SECOND)
    assert at.yaw == pytest.approx(-PI + 0.1)
    np.testing.assert_allclose(at.covariance, np.diag([0, 0, 0.2**2]) + np.eye(3) * 0.02**2)


@pytest.mark.parametrize("at_ms", [50, 150])
def test_single_pose_is_kept_with_growing_uncertainty(at_ms):
    only = pose(100, 1.0, 2.0, 3.0, np.eye(3))
    at = buffer(only).at(at_ms * MS, 50 * MS)
    assert_same_place(at, only)
    np.testing.assert_allclose(at.covariance, np.eye(3) * (1.0 + 0.05**2))
    assert at.stamp_ns == at_ms * MS


def test_poses_are_extrapolated_backwards_after_a_gap():
    at = buffer(pose(100, 1.0), pose(200, 2.0)).at(60 * MS, 50 * MS)
    assert at.x == pytest.approx(0.6)
    assert at.stamp_ns == 60 * MS
    np.testing.assert_allclose(
        at.covariance, np.diag([0.4**2, 0, 0]) + np.eye(3) * (0.04**2 / 2) ** 2
    )


def test_uncertainty_grows_between_distant_poses():
    poses = buffer(pose(0), pose(100), pose(600))
    np.testing.assert_array_equal(poses.at(50 * MS, SECOND).covariance, EXACT)  # no gap
    at = poses.at(200 * MS, SECOND)
    np.testing.assert_allclose(at.covariance, np.eye(3) * (0.5 * 0.1 * 0.4) ** 2)


@pytest.mark.parametrize("alone", [True, False], ids=["one pose after the gap", "two"])
@pytest.mark.parametrize("after", [True, False], ids=["after the gap", "before"])
@given(
    speed=st.floats(-1, 1),
    turn=st.floats(-1, 1),
    change=st.floats(-1, 1),
    away_ms=st.integers(1, 250),
)
def test_stated_covariance_across_a_gap_covers_the_truth(
    alone, after, speed, turn, change, away_ms
):
    """A robot at varying speeds up to 1 m/s and 1 rad/s, with pose sigmas of 1 cm and 0.01 rad."""

    def true(t_ms: float) -> Pose:
        t, sign = t_ms / 1000, 1.0 if after else -1.0
        x = sign * speed * t + 0.5 * change * min(t, 0) ** 2
        return pose(sign * t_ms, x, 0.0, sign * turn * t, np.eye(3) * 0.01**2)

    poses = buffer(
        *sorted([true(t) for t in ((0,) if alone else (0, 50))], key=lambda p: p.stamp_ns)
    )
    truth = true(-away_ms)
    at = poses.at(truth.stamp_ns, 250 * MS)
    off = np.array([at.x - truth.x, at.y - truth.y, wrap_angle(at.yaw - truth.yaw)])
    assert (np.abs(off) <= 1.2 * np.sqrt(np.diag(at.covariance)) + 1e-12).all()


def test_uncertainty_of_the_nearest_pose_grows_with_its_age():
    poses = buffer(pose(0), pose(1000, 1.0, 2.0, 3.0, np.eye(3) * 0.01))
    at = poses.near(2500 * MS, 250 * MS, 2000 * MS)
    assert_same_place(at, pose(0, 1.0, 2.0, 3.0))
    assert at.stamp_ns == 2500 * MS
    np.testing.assert_allclose(at.covariance, np.eye(3) * (0.01 + 1.5**2))
    assert_same_place(poses.near(1000 * MS, 0, 0), poses.at(1000 * MS, 0))
    with pytest.raises(PoseError, match=r"the nearest pose is 2\.001 s away; allowed: 2 s"):
        poses.near(3001 * MS, 250 * MS, 2000 * MS)
    with pytest.raises(PoseError, match="no pose has arrived"):
        PoseBuffer().near(0, 0, SECOND)


# --------------------------------------------------------------------------- too far ----


def test_empty_buffer_has_no_pose():
    assert len(PoseBuffer()) == 0
    assert PoseBuffer().newest_ns is None
    assert not PoseBuffer().covers(0)
    with pytest.raises(PoseError, match="no pose has arrived"):
        PoseBuffer().at(0, SECOND)


@pytest.mark.parametrize(
    ("at_ms", "nearest"),
    [(-250, None), (-251, "0.251"), (1250, None), (1251, "0.251"), (2400, "0.6"), (3251, "0.251")],
)
def test_the_nearest_pose_must_be_near(at_ms, nearest):
    poses = buffer(pose(0), pose(1000), pose(3000))
    if nearest is None:
        poses.at(at_ms * MS, 250 * MS)
    else:
        message = rf"the nearest pose is {nearest}\d* s from the scan's stamp; allowed: 0.25 s"
        with pytest.raises(PoseError, match=message):
            poses.at(at_ms * MS, 250 * MS)


def test_a_pose_on_the_far_side_of_a_gap_is_not_used():
    before = [pose(0, 0.0), pose(100, 0.1, covariance=np.eye(3))]
    poses = buffer(*before, pose(3900, 39.0), pose(4000, 50.0))
    assert_same_place(poses.at(3800 * MS, 250 * MS), pose(0, 28.0))
    # After 100 ms it is carried on as if nothing had come later.
    at = poses.at(200 * MS, 250 * MS)
    assert_same_place(at, pose(0, 0.2))
    np.testing.assert_allclose(
        at.covariance, np.eye(3) * (1.0 + (0.1**2 / 2) ** 2) + np.diag([0.1**2, 0, 0])
    )


def test_only_poses_that_are_near_are_used():
    poses = buffer(pose(0, 0.0), pose(90, 9.0))
    assert poses.at(60 * MS, 60 * MS).x == pytest.approx(6.0)
    assert poses.at(60 * MS, 59 * MS).x == 9.0
    assert poses.at(20 * MS, 59 * MS).x == 0.0


# ----------------------------------------------------------------------- the buffer ----


def test_covered_times_are_reported():
    poses = buffer(pose(100), pose(200))
    assert [poses.covers(t * MS) for t in (99, 100, 150, 200, 201)] == [0, 1, 1, 1, 0]
    assert poses.newest_ns == 200 * MS


def test_late_poses_are_inserted_in_order():
    poses = buffer(pose(0, 0.0), pose(200, 2.0), pose(100, 5.0))
    assert poses.newest_ns == 200 * MS
    assert poses.at(50 * MS, SECOND).x == pytest.approx(2.5)


def test_a_repeated_stamp_is_refused():
    poses = buffer(pose(0), pose(100), pose(200))
    for at_ms in (200, 100):
        with pytest.raises(PoseError, match=f"stamp {at_ms}000000 ns is repeated; wanted: one po"):
            poses.add(pose(at_ms, 9.0))
    assert len(poses) == 3


def test_old_poses_are_dropped():
    assert PoseBuffer().span_ns == 5 * SECOND
    poses = PoseBuffer(span_ns=500 * MS)
    for i in range(100):
        poses.add(pose(100 * i))
    assert len(poses) == 6  # the newest and those of the last half second, inclusive
    assert not poses.covers(9399 * MS)
    assert poses.covers(9400 * MS)
    poses.add(pose(9399))  # too old when it comes
    assert len(poses) == 6
    assert not poses.covers(9399 * MS)


def test_stamps_that_jump_back_reset_the_state():
    poses = buffer(pose(5000, 5.0), pose(4000, 4.0))
    assert (len(poses), poses.resets) == (2, 0)  # one second late is late
    for late in (3000, 3100):  # too late, and dropped; if one more follows, time has jumped back
        with pytest.raises(PoseError, match=r"s older than the newest; allowed: 1 s"):
            poses.add(pose(late))
    assert (len(poses), poses.resets) == (2, 0)
    poses.add(pose(3200, 3.0))
    assert (len(poses), poses.resets, poses.newest_ns) == (1, 1, 3200 * MS)
    poses.add(pose(5000, 6.0))
    assert poses.at(5000 * MS, 0).x == 6.0


def test_jumps_are_counted():
    poses = buffer(pose(0), pose(100, 0.2), pose(200, 1.4), pose(300, 2.6))
    assert (poses.jumps, poses.last_jump) == (0, None)  # 1.3 m in 0.1 s: a robot, or nearly one
    before, after = pose(400, 2.8), pose(500, 2.8, -1.31)
    for each in (before, after):
        poses.add(each)
    assert (poses.jumps, poses.last_jump) == (1, (before, after))
    poses.add(pose(450, 9.0))  # late: it says nothing of now
    poses.add(pose(20_500, 60.0))  # a long gap
    assert poses.jumps == 1
    poses.add(pose(20_600, 9e7))
    assert poses.jumps == 2


def test_clearing_removes_all_poses():
    poses = buffer(pose(0), pose(100))
    poses.clear()
    assert len(poses) == 0
    assert poses.newest_ns is None
    poses.add(pose(100))
    assert len(poses) == 1


def test_tuning_sets_drift_and_jumps():
    tuning = PoseTuning(speeds=(0.5, 0.2, 0.1), jump=0.1, jump_speed=1.0)
    poses = PoseBuffer(tuning=tuning)
    poses.add(Pose(0, 0.0, 0.0, 0.0))
    stayed = poses.at(2 * SECOND, 2 * SECOND)  # 2 s at these speeds
    np.testing.assert_allclose(np.sqrt(np.diag(stayed.covariance)), (1.0, 0.4, 0.2))
    poses.add(Pose(SECOND, 1.05, 0.0, 0.0))
    assert poses.jumps == 0
    poses.add(Pose(2 * SECOND, 2.25, 0.0, 0.0))
    assert poses.jumps == 1


# ------------------------------------------------------------------ relative to the team ----

IN_TEAM = np.diag([0.01, 0.02, 0.001])


def test_poses_have_the_newest_covariance_in_the_team_for_a_second():
    poses = PoseBuffer()
    poses.in_team = (pose(at_ms=0.0).stamp_ns, IN_TEAM)
    for at_ms in (0.0, 999.0, 1000.0):
        poses.add(pose(at_ms=at_ms))
    told = [poses.at(pose(at_ms=t).stamp_ns, 0).in_team is not None for t in (0.0, 999.0, 1000.0)]
    assert told == [True, True, False]


def test_covariance_in_the_team_is_interpolated_and_grows_past_the_newest():
    poses = PoseBuffer()
    for at_ms, factor in ((0.0, 1.0), (40.0, 3.0)):
        poses.in_team = (pose(at_ms=at_ms).stamp_ns, factor * IN_TEAM)
        poses.add(pose(at_ms=at_ms, covariance=factor * IN_TEAM))
    between = poses.at(pose(at_ms=10.0).stamp_ns, 10**9)
    assert between.in_team == pytest.approx(1.5 * IN_TEAM)
    ahead = poses.at(pose(at_ms=240.0).stamp_ns, 10**9)
    assert ahead.in_team == pytest.approx(ahead.covariance)
    assert (np.diag(ahead.in_team) > np.diag(3.0 * IN_TEAM)).all()


def test_pose_relative_to_the_team_has_that_covariance():
    in_team = dataclasses.replace(pose(covariance=np.eye(3)), in_team=IN_TEAM)
    assert in_team.relative_to_team().covariance is IN_TEAM
    alone = pose(covariance=np.eye(3))
    assert alone.relative_to_team() is alone


def test_effect_of_the_team_is_that_of_its_surest_robot():
    """A robot at (0, 0) whose team may be turned by 0.1 rad; something 2 m ahead moves aside."""
    turned = np.diag([0.0, 0.0, 0.01])
    one = dataclasses.replace(pose(covariance=IN_TEAM + turned), in_team=IN_TEAM)
    other = dataclasses.replace(pose(covariance=IN_TEAM + np.eye(3)), in_team=IN_TEAM)
    effect = shared_effect([other, one], np.array([[2.0, 0.0]]))
    assert effect[0] == pytest.approx(np.diag([0.0, 0.04]))


def test_team_with_a_robot_of_independent_errors_has_no_shared_effect():
    in_team = dataclasses.replace(pose(covariance=np.eye(3)), in_team=IN_TEAM)
    for poses in ([in_team, pose()], []):
        assert not shared_effect(poses, np.array([[2.0, 0.0]])).any()

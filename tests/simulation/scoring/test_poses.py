"""Scores of robots' poses that were worked out by hand."""

from __future__ import annotations

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.team.poses import Pose
from mrs_people_sim.scoring.poses import (
    PoseScores,
    PoseTrack,
    aligning_motion,
    in_true_frame,
    nees_bounds,
    score_poses,
)
from mrs_tools.bags.records import Estimate

S = 1_000_000_000
SIGMAS = np.diag([0.1, 0.2, 0.05]) ** 2


def track(*rows, covariance=None) -> PoseTrack:
    """Rows: time [s], x, y, yaw."""
    cov = np.zeros((3, 3)) if covariance is None else np.asarray(covariance)
    return PoseTrack.build(Pose(round(t * S), x, y, yaw, cov) for t, x, y, yaw in rows)


def driving(offset=(0.0, 0.0, 0.0), *, y=0.0, covariance=None) -> PoseTrack:
    """Ten seconds along x at 1 m/s, heading across it, with an error."""
    dx, dy, turn = offset
    rows = [(t, t + dx, y + dy, math.pi / 2 + turn) for t in np.arange(0.0, 10.0, 0.25)]
    return track(*rows, covariance=covariance)


def test_a_track_is_linear_between_poses_and_turns_the_shorter_way():
    way = track((0.0, 0.0, 0.0, 3.1), (1.0, 2.0, -4.0, -3.1))
    (found,) = way.at(np.array([S // 4]))
    turn = 2 * math.pi - 6.2
    assert found == pytest.approx([0.5, -1.0, 3.1 + turn / 4])


def test_a_track_says_nothing_outside_and_in_gaps():
    way = track((0.0, 0.0, 0.0, 0.0), (1.0, 1.0, 0.0, 0.0), (3.0, 3.0, 0.0, 0.0))
    found = way.at(np.array([-1, 0, S // 2, 2 * S, 3 * S, 3 * S + 1]))
    assert np.isfinite(found).all(axis=1).tolist() == [False, True, True, False, True, False]


def test_along_and_across_follow_the_way_not_the_heading():
    true = {"a": driving()}
    scores = score_poses(true, {"a": driving((0.03, -0.04, 0.0))})
    assert scores is not None
    np.testing.assert_allclose(scores.along, 0.03, atol=1e-12)
    np.testing.assert_allclose(scores.across, -0.04, atol=1e-12)


def test_while_the_team_stands_the_way_is_the_last_one():
    rows = [(t, 0.0, min(t, 3.0), 0.0) for t in np.arange(0.0, 10.0, 0.25)]
    off = [(t, x + 0.02, y, yaw) for t, x, y, yaw in rows]
    scores = score_poses({"a": track(*rows)}, {"a": track(*off)})
    assert scores is not None
    # Along y, +x is to the right.
    np.testing.assert_allclose(scores.across, -0.02, atol=1e-12)
    np.testing.assert_allclose(scores.along, 0.0, atol=1e-12)


def test_before_the_team_moves_there_is_no_way_but_a_heading():
    rows = [(t, 0.0, 0.0, 0.1) for t in (0.0, 0.5, 1.0)]
    scores = score_poses({"a": track(*rows)}, {"a": track(*rows)})
    assert scores is not None
    assert np.isnan(scores.along).all()
    assert scores.heading.tolist() == [0.0, 0.0, 0.0]
    assert scores.report()["along_m"] == {"median": None, "p95": None, "max": None}


def test_relative_error_of_two_robots():
    # b is 2 m to the left of a, in the map; a looks along y, so b is 2 m ahead of it.
    true = {"a": driving(), "b": driving(y=2.0)}
    estimated = {"a": driving((0.0, 0.0, 0.01)), "b": driving((0.0, 0.1, 0.0), y=2.0)}
    scores = score_poses(true, estimated)
    assert scores is not None
    of_a, of_b = np.split(scores.apart, 2)
    # In a's frame: 2.1 m away in a direction that is 0.01 rad off.
    ahead, left = 2.1 * math.cos(0.01) - 2.0, -2.1 * math.sin(0.01)
    np.testing.assert_allclose(of_a, math.hypot(ahead, left), atol=1e-12)
    np.testing.assert_allclose(of_b, 0.1, atol=1e-12)
    np.testing.assert_allclose(np.abs(scores.turned), 0.01, atol=1e-12)


def test_errors_in_the_team_are_shared():
    # 3 cm to the left of where it should be to the other: each is 1.5 cm off.
    true = {"a": driving(), "b": driving(y=2.0)}
    scores = score_poses(true, {"a": driving(), "b": driving((0.0, 0.03, 0.0), y=2.0)})
    assert scores is not None
    np.testing.assert_allclose(scores.in_team, 0.015, atol=1e-9)
    np.testing.assert_allclose(scores.turned_in_team, 0.0, atol=1e-9)


def test_one_robot_is_no_team():
    scores = score_poses({"a": driving()}, {"a": driving((0.1, 0.0, 0.0))})
    assert scores is not None
    assert len(scores.in_team) == 0


@pytest.mark.slow
@given(st.floats(-20, 20), st.floats(-20, 20), st.floats(-3, 3))
def test_relative_error_does_not_see_what_moves_the_whole_team(x, y, turn):
    true = {"a": driving(), "b": driving(y=2.0)}
    frame = Pose(0, x, y, turn)
    moved = {
        name: PoseTrack.build(
            frame @ Pose(int(stamp), *pose)
            for stamp, pose in zip(one.stamps_ns, one.poses, strict=True)
        )
        for name, one in true.items()
    }
    scores = score_poses(true, moved)
    assert scores is not None
    assert scores.apart.max() < 1e-9
    assert np.abs(scores.turned).max() < 1e-9
    assert scores.in_team.max() < 1e-9


def test_nees_by_hand():
    scores = score_poses({"a": driving()}, {"a": driving((0.2, 0.2, 0.05), covariance=SIGMAS)})
    assert scores is not None
    np.testing.assert_allclose(scores.squares, 4.0 + 1.0 + 1.0)
    np.testing.assert_allclose(scores.along_sigmas, 2.0)
    report = scores.report()
    assert report["nees"]["mean"] == pytest.approx(6.0)
    assert report["along_in_3_sigma"] == 1.0


def test_nees_of_relative_positions_by_hand():
    # a takes b for 2 m ahead of it: b is 0.2 m farther, and 0.1 m to the left.
    true = {"a": driving(), "b": driving((-0.1, 0.2, 0.0), y=2.0)}
    of_a, exact = np.diag([0.1, 0.2, 0.05]) ** 2, 1e-9 * np.eye(3)
    estimated = {"a": driving(covariance=of_a), "b": driving(y=2.0, covariance=exact)}
    scores = score_poses(true, estimated)
    assert scores is not None
    from_a, from_b = np.split(scores.squares_apart, 2)
    # From a, its heading moves b by 0.1 m, beside its own 0.1 m to the left (-x of the map).
    np.testing.assert_allclose(from_a, 1.0 + 0.1**2 / (0.1**2 + 0.1**2), rtol=1e-5)
    np.testing.assert_allclose(from_b, 1.0 + 1.0, rtol=1e-5)
    nees = scores.report()["relative"]["nees"]
    assert nees["median"] == pytest.approx(np.median(scores.squares_apart))
    # Chi-square tables: 0.0506 and 7.378 with 2 degrees of freedom.
    assert (nees["low"], nees["high"]) == pytest.approx((0.0506, 7.378), abs=5e-4)


def test_covariances_of_relative_positions_are_those_in_the_team():
    true = {"a": driving(), "b": driving(y=2.0)}
    estimated = {
        name: PoseTrack.build(
            Pose(int(stamp), x + 0.1, y, yaw, np.eye(3), in_team=np.diag([0.005, 0.005, 1e-9]))
            for stamp, (x, y, yaw) in zip(one.stamps_ns, one.poses, strict=True)
        )
        for name, one in {"a": driving(), "b": driving((0.0, 0.1, 0.0), y=2.0)}.items()
    }
    scores = score_poses(true, estimated)
    assert scores is not None
    np.testing.assert_allclose(scores.squares_apart, 0.1**2 / (2 * 0.005), rtol=1e-5)
    assert scores.report()["nees"]["mean"] < 0.1


def test_nees_of_exact_poses_is_undefined():
    scores = score_poses({"a": driving()}, {"a": driving((0.2, 0.0, 0.0))})
    assert scores is not None
    assert scores.report()["nees"]["mean"] is None
    assert scores.report()["relative"]["nees"]["mean"] is None
    assert scores.report()["along_in_3_sigma"] is None


def test_bounds_of_nees():
    # Chi-square tables: 0.216 and 9.348 with 3 degrees of freedom, 16.791 and 46.979 with 30.
    assert nees_bounds(1) == pytest.approx((0.216, 9.348), abs=5e-4)
    assert nees_bounds(10) == pytest.approx((1.6791, 4.6979), abs=5e-5)
    assert nees_bounds(0) == (None, None)


def test_nees_of_consistent_errors_is_in_the_bounds():
    rng = np.random.default_rng(5)
    total = PoseScores()
    for _ in range(20):
        error = rng.multivariate_normal(np.zeros(3), SIGMAS)
        scores = score_poses({"a": driving()}, {"a": driving(tuple(error), covariance=SIGMAS)})
        assert scores is not None
        total += scores
    nees = total.report()["nees"]
    assert total.runs == 20
    assert nees["low"] < nees["mean"] < nees["high"]


def test_poses_are_compared_ten_times_a_second_at_most():
    rows = [(t, 0.01 * t, 0.0, 0.0) for t in np.arange(0.0, 1.0, 0.02)]
    scores = score_poses({"a": track(*rows)}, {"a": track(*rows)})
    assert scores is not None
    assert len(scores.heading) == 10


@pytest.mark.parametrize("estimated", [{}, {"a": track()}, {"c": driving()}])
def test_nothing_to_compare(estimated):
    assert score_poses({"a": driving(), "b": track()}, estimated) is None


def test_a_robot_without_a_true_pose_is_left_out():
    alone = score_poses({"a": driving()}, {"a": driving(), "c": driving()})
    assert alone is not None
    assert len(alone.apart) == 0
    assert alone.report()["relative"]["position_m"]["median"] is None


def test_the_motion_that_aligns_a_team():
    true = np.array([[0.0, 0.0, 0.0], [2.0, 0.0, 1.0], [0.0, 3.0, -2.0]])
    frame = Pose(0, 1.0, -2.0, 0.3)
    moved = [frame @ Pose(0, *pose) for pose in true]
    there = np.array([(pose.x, pose.y, pose.yaw) for pose in moved])
    np.testing.assert_allclose(aligning_motion(true, there), [1.0, -2.0, 0.3], atol=1e-12)


def test_the_motion_that_aligns_one_robot_takes_its_heading():
    found = aligning_motion(np.array([[1.0, 0.0, 0.0]]), np.array([[5.0, 5.0, math.pi / 2]]))
    # (1, 0) turned by a right angle is (0, 1).
    np.testing.assert_allclose(found, [5.0, 4.0, math.pi / 2], atol=1e-12)


def test_people_in_the_frame_of_a_team_that_is_off_as_a_whole():
    true, estimated = {"a": track((0, 0, 0, 0))}, {"a": track((0, 1.0, 2.0, math.pi / 2))}
    # 2 m ahead of the robot, and 0.1 m too far.
    person = Estimate(
        stamp_ns=0,
        positions=np.array([[1.0, 4.1]]),
        covariances=np.array([[[0.04, 0.0], [0.0, 0.01]]]),
        centre=np.array([1.0, 4.1]),
        velocities=np.array([[0.0, 0.5]]),
    )
    late = Estimate(5 * S, np.empty((0, 2)), np.empty((0, 2, 2)))
    (moved,) = in_true_frame([person, late], true, estimated)
    np.testing.assert_allclose(moved.positions, [[2.1, 0.0]], atol=1e-12)
    np.testing.assert_allclose(moved.covariances, [[[0.01, 0.0], [0.0, 0.04]]], atol=1e-12)
    np.testing.assert_allclose(moved.velocities, [[0.5, 0.0]], atol=1e-12)
    assert moved.centre == pytest.approx([2.1, 0.0])
    assert moved.largest is None

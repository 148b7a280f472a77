"""Predictions by hand, and each Jacobian against finite differences."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.localization.filter.observations import (
    beside_anchor,
    end_from,
    pose_from,
    wall_at,
    wall_from,
)
from mrs_people_loc.localization.odometry import carried_on

METRES = st.floats(-50.0, 50.0)
ANGLES = st.floats(-3.0, 3.0)
POSES = st.tuples(METRES, METRES, ANGLES).map(np.array)
PARTS = st.tuples(METRES, METRES, ANGLES, METRES, ANGLES).map(np.array)
ANCHORS = st.tuples(METRES, METRES)
SIDES = st.sampled_from([1.0, -1.0])


def differences(function, at, step=1e-5):
    """Central differences, shape (m, len(at))."""
    at = np.asarray(at, dtype=float)
    columns = [
        (function(at + step * axis) - function(at - step * axis)) / (2 * step)
        for axis in np.eye(len(at))
    ]
    return np.stack(columns, axis=1)


def close(jacobian, wanted):
    np.testing.assert_allclose(jacobian, wanted, atol=1e-6, rtol=1e-6)


@given(PARTS, ANCHORS, SIDES)
def test_wall_jacobian(part, anchor, side):
    close(
        wall_from(part, anchor, side)[1], differences(lambda p: wall_from(p, anchor, side)[0], part)
    )


@given(PARTS, ANCHORS, METRES, SIDES)
def test_end_jacobian(part, anchor, end, side):
    close(
        end_from(part, anchor, end, side)[1],
        differences(lambda p: end_from(p, anchor, end, side)[0], part),
    )


@given(POSES, st.floats(0.1, 10.0), ANGLES, ANCHORS)
def test_new_wall_jacobians(place, distance, bearing, anchor):
    seen = np.array([distance, bearing])
    _, by_pose, by_seen = wall_at(place, seen, anchor)
    close(by_pose, differences(lambda p: wall_at(p, seen, anchor)[0], place))
    close(by_seen, differences(lambda z: wall_at(place, z, anchor)[0], seen))


@given(POSES, POSES)
def test_relative_pose_jacobians(one, other):
    _, by_robot, by_other = pose_from(one, other)
    close(by_robot, differences(lambda p: pose_from(p, other)[0], one))
    close(by_other, differences(lambda p: pose_from(one, p)[0], other))


@given(POSES, POSES)
def test_motion_jacobian(place, moved):
    close(carried_on(place, moved)[1], differences(lambda p: carried_on(p, moved)[0], place))


@given(METRES, ANGLES, ANCHORS)
def test_anchored_line_jacobian(distance, bearing, anchor):
    close(
        beside_anchor(distance, bearing, anchor)[1],
        differences(lambda line: beside_anchor(line[0], line[1], anchor)[0], [distance, bearing]),
    )


@given(POSES, st.floats(0.1, 10.0), ANGLES, ANCHORS)
def test_new_wall_is_where_it_was_seen(place, distance, bearing, anchor):
    line, _, _ = wall_at(place, np.array([distance, bearing]), anchor)
    predicted, _ = wall_from(np.concatenate([place, line]), anchor)
    np.testing.assert_allclose(predicted, [distance, bearing], atol=1e-9)


def test_wall_by_hand():
    # The wall x = 5 beside the anchor (5, 2), seen from (3, 1) looking along y: 2 m to the right.
    part = np.array([3.0, 1.0, math.pi / 2, 0.0, 0.0])
    predicted, _ = wall_from(part, (5.0, 2.0))
    np.testing.assert_allclose(predicted, [2.0, -math.pi / 2])


def test_wall_from_its_other_side_by_hand():
    # The same wall from (6, 1): 1 m away, behind a robot that looks along x.
    predicted, _ = wall_from(np.array([6.0, 1.0, 0.0, 0.0, 0.0]), (5.0, 2.0), -1.0)
    np.testing.assert_allclose(predicted, [1.0, math.pi])


@pytest.mark.parametrize(("side", "wanted"), [(1.0, 4.0), (-1.0, -4.0)])
def test_end_by_hand(side, wanted):
    # The wall x = 5 ends at y = 5, 3 m beyond its anchor; the robot is at y = 1. In its view the
    # direction bearing + pi/2 is y, or from the wall's other side -y.
    x = 3.0 if side > 0 else 7.0
    predicted, _ = end_from(np.array([x, 1.0, 0.3, 0.0, 0.0]), (5.0, 2.0), 3.0, side)
    np.testing.assert_allclose(predicted, [wanted])


def test_relative_pose_by_hand():
    predicted, _, _ = pose_from(np.array([1.0, 1.0, math.pi / 2]), np.array([0.0, 3.0, math.pi]))
    np.testing.assert_allclose(predicted, [2.0, 1.0, math.pi / 2], atol=1e-12)


def test_line_beside_its_anchor_by_hand():
    line, _ = beside_anchor(5.0, 0.0, (4.0, 7.0))
    np.testing.assert_allclose(line, [1.0, 0.0])

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.geometry import (
    BODY_FROM_OPTICAL,
    margins,
    quaternion_from_rotation,
    quaternion_from_yaw,
    rotation_2d,
    rotation_from_rpy,
    wrap_angle,
    yaw_from_quaternion,
)

PI = math.pi
angles = st.floats(-10.0, 10.0)


def rotation_about(axis: int, angle: float) -> np.ndarray:
    """Right-handed rotation about x (0), y (1) or z (2)."""
    one, other = (axis + 1) % 3, (axis + 2) % 3
    rotation = np.eye(3)
    rotation[one, one] = rotation[other, other] = math.cos(angle)
    rotation[other, one], rotation[one, other] = math.sin(angle), -math.sin(angle)
    return rotation


def rotation_from_quaternion(x: float, y: float, z: float, w: float) -> np.ndarray:
    """q v q* of the unit vectors, written out."""
    return np.array(
        [
            [w * w + x * x - y * y - z * z, 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), w * w - x * x + y * y - z * z, 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), w * w - x * x - y * y + z * z],
        ]
    )


def test_optical_axes_are_mapped_to_the_body_frame():
    right, down, forward = np.eye(3)
    np.testing.assert_array_equal(BODY_FROM_OPTICAL @ right, [0, -1, 0])  # y is left
    np.testing.assert_array_equal(BODY_FROM_OPTICAL @ down, [0, 0, -1])  # z is up
    np.testing.assert_array_equal(BODY_FROM_OPTICAL @ forward, [1, 0, 0])


@pytest.mark.parametrize(
    ("rpy", "vector", "turned"),
    [
        ((0, 0, 0), (1, 2, 3), (1, 2, 3)),
        ((0, 0, PI / 2), (1, 0, 0), (0, 1, 0)),  # yaw: ahead turns to the left
        ((0, PI / 2, 0), (1, 0, 0), (0, 0, -1)),  # pitch: ahead turns down
        ((PI / 2, 0, 0), (0, 1, 0), (0, 0, 1)),  # roll: left turns up, right down
        ((0, PI / 2, PI / 2), (1, 0, 0), (0, 0, -1)),
        ((0, PI / 2, PI / 2), (0, 0, 1), (0, 1, 0)),  # pitched (up is ahead), then to the left
        ((PI / 2, 0, PI / 2), (0, 0, 1), (1, 0, 0)),  # rolled (up is right), then to the left
        ((PI / 2, PI / 2, 0), (0, 1, 0), (1, 0, 0)),  # rolled (left is up), then pitched
    ],
)
def test_rotation_matches_hand_computed_values(rpy, vector, turned):
    np.testing.assert_allclose(rotation_from_rpy(*rpy) @ vector, turned, atol=1e-15)


@given(roll=angles, pitch=angles, yaw=angles)
def test_rotation_is_an_orthonormal_product_of_three(roll, pitch, yaw):
    rotation = rotation_from_rpy(roll, pitch, yaw)
    product = rotation_about(2, yaw) @ rotation_about(1, pitch) @ rotation_about(0, roll)
    np.testing.assert_allclose(rotation, product, atol=1e-14)
    np.testing.assert_allclose(rotation @ rotation.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(rotation) == pytest.approx(1.0)


@given(yaw=angles)
def test_planar_rotation_equals_yaw_rotation(yaw):
    np.testing.assert_allclose(rotation_2d(yaw), rotation_from_rpy(0, 0, yaw)[:2, :2], atol=1e-15)


def test_planar_rotation_matches_hand_computed_values():
    np.testing.assert_allclose(rotation_2d(PI / 2) @ (3.0, 0.5), (-0.5, 3.0), atol=1e-15)


@pytest.mark.parametrize(
    ("angle", "wrapped"),
    [
        (0.0, 0.0),
        (PI, PI),
        (-PI, PI),
        (3 * PI, PI),
        (-3 * PI, PI),
        (1.5 * PI, -0.5 * PI),
        (-1.5 * PI, 0.5 * PI),
        (2 * PI, 0.0),
        (PI + 0.25, -PI + 0.25),
    ],
)
def test_wrap_angle_matches_hand_computed_values(angle, wrapped):
    assert wrap_angle(angle) == pytest.approx(wrapped, abs=1e-15)


@given(angle=st.floats(-1e4, 1e4))
def test_wrap_angle_keeps_the_direction(angle):
    wrapped = wrap_angle(angle)
    assert -PI < wrapped <= PI
    assert math.cos(wrapped) == pytest.approx(math.cos(angle), abs=1e-11)
    assert math.sin(wrapped) == pytest.approx(math.sin(angle), abs=1e-11)


@pytest.mark.parametrize(
    ("quaternion", "yaw"),
    [
        ((0, 0, 0, 1), 0.0),
        ((0, 0, math.sqrt(0.5), math.sqrt(0.5)), PI / 2),
        ((0, 0, -math.sqrt(0.5), math.sqrt(0.5)), -PI / 2),
        ((0, 0, 1, 0), PI),
        ((0, 0, -math.sqrt(0.5), -math.sqrt(0.5)), PI / 2),  # -q is the same rotation
    ],
)
def test_yaw_of_a_quaternion_matches_hand_computed_values(quaternion, yaw):
    assert yaw_from_quaternion(*quaternion) == pytest.approx(yaw)


def test_quaternion_of_a_yaw_matches_hand_computed_values():
    assert quaternion_from_yaw(PI / 3) == pytest.approx((0, 0, 0.5, math.sqrt(3) / 2))


@given(yaw=angles)
def test_yaw_round_trip(yaw):
    back = yaw_from_quaternion(*quaternion_from_yaw(yaw))
    assert wrap_angle(back - yaw) == pytest.approx(0.0, abs=1e-12)


@given(roll=st.floats(-0.5, 0.5), pitch=st.floats(-0.5, 0.5), yaw=angles)
def test_yaw_of_a_tilted_robot_is_its_heading(roll, pitch, yaw):
    quaternion = quaternion_from_rotation(rotation_from_rpy(roll, pitch, yaw))
    assert wrap_angle(yaw_from_quaternion(*quaternion) - yaw) == pytest.approx(0.0, abs=1e-9)


half_turns = st.sampled_from([0.0, PI / 2, PI, -PI / 2, 1e-9, PI - 1e-9])


@given(roll=angles | half_turns, pitch=angles | half_turns, yaw=angles | half_turns)
def test_quaternion_round_trip(roll, pitch, yaw):
    rotation = rotation_from_rpy(roll, pitch, yaw)
    quaternion = quaternion_from_rotation(rotation)
    np.testing.assert_allclose(rotation_from_quaternion(*quaternion), rotation, atol=1e-7)
    assert math.hypot(*quaternion) == pytest.approx(1.0)
    assert quaternion[3] >= 0.0


def test_quaternion_of_a_rotation_matches_hand_computed_values():
    s = math.sqrt(0.5)
    nose_down = rotation_from_rpy(0, PI / 2, 0)
    assert quaternion_from_rotation(nose_down) == pytest.approx((0, s, 0, s))
    # A camera's optical frame on a level robot, as every URDF has it: (-0.5, 0.5, -0.5, 0.5).
    assert quaternion_from_rotation(BODY_FROM_OPTICAL) == pytest.approx((-0.5, 0.5, -0.5, 0.5))


def test_margins_are_over_all_others_of_a_row_or_column():
    costs = np.array([[1.0, 5.0, 4.0], [2.0, 9.0, 8.0]])
    np.testing.assert_array_equal(margins(costs), [[1.0, -4.0, -3.0], [-1.0, -7.0, -6.0]])
    np.testing.assert_array_equal(margins(costs[:1, :1]), [[np.inf]])

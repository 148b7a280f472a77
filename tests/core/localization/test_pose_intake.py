"""What of a robot's odometry goes out."""

import math

import numpy as np
import pytest

from mrs_people_loc.config import PoseInput
from mrs_people_loc.errors import ConfigError, PoseError
from mrs_people_loc.localization.robot_localization import PoseIntake
from mrs_people_loc.team.poses import Pose, static_pose

MS = 1_000_000
START_NS = 1_700_000_000_000_000_000


def pose(ms: float, x=1.0, y=0.0, yaw=0.0) -> Pose:
    return Pose(START_NS + round(ms * MS), x, y, yaw)


def test_pose_in_the_map_frame_is_unchanged():
    given = pose(0)
    intake = PoseIntake(PoseInput())
    assert intake(given, "map") is given
    assert intake.last is given
    assert intake(pose(10), "/map") is not None


def test_pose_in_another_frame_is_transformed_to_the_map():
    # A quarter turn to the left at (5, 2): 1 m ahead is (5, 3).
    intake = PoseIntake(PoseInput(map_from_odom=(5.0, 2.0, math.pi / 2)))
    made = intake(pose(0, yaw=0.1), "robot_a/odom")
    assert made is not None
    np.testing.assert_allclose((made.x, made.y, made.yaw), (5.0, 3.0, math.pi / 2 + 0.1))
    assert made.stamp_ns == START_NS


def test_frame_without_a_transform_is_refused():
    intake = PoseIntake(PoseInput())
    with pytest.raises(PoseError, match=r"'odom'.*'map'.*pose\.map_from_odom"):
        intake(pose(0), "odom")
    assert intake.last is None

    def unknown(frame_id: str) -> Pose:
        raise PoseError(f"nothing of {frame_id}")

    intake = PoseIntake(PoseInput(), unknown)
    with pytest.raises(PoseError, match=r"'odom'.*'map'.*pose\.map_from_odom.*; nothing of odom"):
        intake(pose(0), "odom")


def test_parameter_takes_precedence_over_tf():
    asked = []

    def frame_in_map(frame_id: str) -> Pose:
        asked.append(frame_id)
        return Pose(0, 5.0, 2.0, math.pi / 2)

    intake = PoseIntake(PoseInput(), frame_in_map)
    made = intake(pose(0, yaw=0.1), "/odom")
    assert made is not None
    np.testing.assert_allclose((made.x, made.y, made.yaw), (5.0, 3.0, math.pi / 2 + 0.1))
    assert made.stamp_ns == START_NS
    assert intake(pose(10), "map") is not None
    intake.config = PoseInput(map_from_odom=(1.0, 0.0, 0.0))
    made = intake(pose(20), "odom")
    assert made is not None
    assert (made.x, made.y) == (2.0, 0.0)
    assert asked == ["odom"]


def test_static_pose_is_used():
    made = static_pose(PoseInput(source="static", static=(1.0, 2.0, 2.0 * math.pi + 0.5)), 7)
    assert (made.stamp_ns, made.x, made.y) == (7, 1.0, 2.0)
    assert made.yaw == pytest.approx(0.5)
    assert not made.covariance.any()
    made = static_pose(PoseInput(static=(0.0, 0.0, 0.0), sigmas=(0.1, 0.2, 0.3)), 7)
    np.testing.assert_allclose(made.covariance, np.diag([0.01, 0.04, 0.09]))
    with pytest.raises(ConfigError, match=r"pose\.static is empty; allowed: x, y .* and yaw"):
        static_pose(PoseInput(source="static"), 7)


@pytest.mark.parametrize("late_ms", [0, 1, 1000])
def test_pose_that_is_not_newer_is_refused(late_ms):
    intake = PoseIntake(PoseInput())
    intake(pose(2000), "map")
    with pytest.raises(PoseError, match="newer than"):
        intake(pose(2000 - late_ms), "map")


def test_jump_back_by_more_than_a_second_is_a_reset():
    intake = PoseIntake(PoseInput())
    intake(pose(2000), "map")
    for late in (979, 989):  # they may be late
        with pytest.raises(PoseError, match="newer than"):
            intake(pose(late), "map")
    assert intake(pose(999), "map") is not None


@pytest.mark.parametrize(
    ("rate_hz", "max_rate_hz", "out"),
    [(50, 100, 50), (100, 100, 100), (1000, 100, 100), (75, 50, 50)],
)
def test_long_term_rate_is_kept(rate_hz, max_rate_hz, out):
    intake = PoseIntake(PoseInput(max_rate=float(max_rate_hz)))
    made = [intake(pose(1000 * i / rate_hz), "map") for i in range(10 * rate_hz)]
    assert sum(one is not None for one in made) == pytest.approx(10 * out, abs=1)


def test_jitter_of_a_tenth_of_the_period_drops_no_pose():
    intake = PoseIntake(PoseInput(max_rate=100.0))
    made = [intake(pose(10 * i + (-1) ** i * 0.45), "map") for i in range(100)]
    assert None not in made


def test_after_a_pause_the_next_pose_is_sent_without_a_burst():
    intake = PoseIntake(PoseInput(max_rate=10.0))
    stamps = [0, 1000, 1010, 1020, 1095, 1200]
    assert [ms for ms in stamps if intake(pose(ms), "map")] == [0, 1000, 1095, 1200]


def test_when_time_begins_anew_any_stamp_is_the_first():
    intake = PoseIntake(PoseInput(max_rate=10.0))
    assert intake(pose(2000), "map") is not None
    intake.reset()
    assert intake.last is None
    assert [ms for ms in (1500, 1510, 1600) if intake(pose(ms), "map")] == [1500, 1600]

"""A robot whose pose is not estimated holds its team in place."""

import numpy as np
import pytest

from mrs_people_loc.config import Localization
from mrs_people_loc.localization.anchor import Anchor
from mrs_people_loc.localization.localizer import Localizer
from mrs_people_loc.localization.shared import RelativePose
from mrs_people_loc.team.poses import Pose

S = 1_000_000_000
TENTH = S // 10


def covariance(*sigmas):
    return np.diag(np.square(sigmas))


def placed(stamp_ns, sigmas=(0.1, 0.1, 0.05)):
    return Pose(stamp_ns, 2.0, 1.0, 0.5, covariance(*sigmas))


def test_team_mates_are_as_sure_of_it_as_its_source_however_long_they_hear_it():
    anchor, mate = Anchor("t"), Localizer("a", Localization())
    sigmas = []
    for k in range(1200):
        stamp_ns = S + k * TENTH
        mate.take_odometry(Pose(stamp_ns, 0.0, 0.0, 0.0))
        told = anchor.tell(placed(stamp_ns), 100.0)
        assert told is not None
        mate.take_teammate(told)
        sigmas.append(np.sqrt(np.diag(mate.state.poses["t"].covariance)))
    np.testing.assert_allclose(sigmas[5:], [(0.1, 0.1, 0.05)] * 1195, rtol=0.06)
    assert mate.state.sources["t", "absolute"].refused == 0


def test_robot_that_is_told_a_wrong_start_is_right_by_its_pose_relative_to_an_anchor():
    config = Localization(start=(0.3, -0.2, 0.1), start_sigmas=(0.3, 0.3, 0.15))
    anchor, mate = Anchor("t"), Localizer("a", config)
    place = np.array([2.0, 1.0, 0.5])
    for k in range(30):
        stamp_ns = S + k * TENTH
        mate.take_odometry(Pose(stamp_ns, 0.0, 0.0, 0.0))
        told = anchor.tell(placed(stamp_ns, (0.0, 0.0, 0.0)), 100.0)
        assert told is not None
        mate.take_teammate(told)
        if k > 5:
            seen = covariance(0.05, 0.05, 0.02)
            mate.take_relative(RelativePose("a", stamp_ns, "t", stamp_ns, place, seen))
    pose, other = mate.state.poses["a"], mate.state.poses["t"]
    assert (pose.x, pose.y, pose.yaw) == pytest.approx((0.0, 0.0, 0.0), abs=0.03)
    assert (other.x, other.y, other.yaw) == pytest.approx(place, abs=0.01)


def test_its_dead_reckoning_is_its_pose_and_begins_again_when_the_clock_jumps_back():
    anchor = Anchor("t")
    first, second = (anchor.tell(placed(t * S, (0.0, 0.3, 0.09)), 10.0) for t in (100, 101))
    assert first is not None
    assert second is not None
    odometry = second.odometry
    assert (odometry.x, odometry.y, odometry.yaw) == (2.0, 1.0, 0.5)
    # A ninth of the covariance is lost in a second; in each direction as in the worse one.
    assert odometry.position_variance == pytest.approx(0.01)
    assert odometry.heading_variance == pytest.approx(0.0009)
    assert first.odometry.position_variance == 0.0
    (measured,) = second.absolute
    np.testing.assert_allclose(measured.covariance, 10 * covariance(0.01, 0.3, 0.09))
    np.testing.assert_allclose(second.pose.covariance, covariance(0.01, 0.3, 0.09))
    assert anchor.tell(placed(101 * S), 10.0) is None, "it comes late"
    assert anchor.tell(placed(101 * S + TENTH // 2), 10.0) is None, "by the rate"
    again = [anchor.tell(placed(S + k * TENTH), 10.0) for k in range(3)]
    assert again[:2] == [None, None]
    assert again[2] is not None
    assert again[2].odometry.position_variance == 0.0

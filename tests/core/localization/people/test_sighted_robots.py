"""Robots that see each other among bodies that are nobody for sure."""

import math

import numpy as np
import pytest

from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.localization.people.relative_poses import RelativePoses
from mrs_people_loc.localization.people.seen_people import SeenPeople
from mrs_people_loc.localization.people.sighted_robots import SightedRobots, SightedRobotsTuning
from mrs_people_loc.localization.shared import YAW_UNKNOWN, RelativePose
from mrs_people_loc.team.poses import Pose

S = 1_000_000_000
TUNING = SightedRobotsTuning()
SURE = np.diag([1e-4, 1e-4, 1e-6])
#: a looks along the map's y axis; b is 4 m ahead of it.
POSES = {"a": Pose(100 * S, 1.0, 2.0, math.pi / 2, SURE), "b": Pose(100 * S, 1.0, 6.0, 2.0, SURE)}
#: Along and across the line of sight.
COVARIANCE = np.diag([0.1**2, 0.04**2])


def bodies(*xy, stamp_ns=100 * S, covariance=COVARIANCE):
    """What a robot sees: nobody for sure, and these bodies in its base_link."""
    return SeenPeople(
        stamp_ns, np.empty((0, 2)), np.empty((0, 2, 2)),
        others=np.reshape(xy, (-1, 2)), others_covariance=np.tile(covariance, (len(xy), 1, 1)),
    )  # fmt: skip


def seen(*xy, poses=POSES, robot="a"):
    return SightedRobots().step({robot: bodies(*xy)}, poses)


def test_team_mate_is_recognized_and_its_place_is_measured():
    (found,) = seen((4.2, -0.1))
    assert (found.robot, found.other) == ("a", "b")
    assert found.stamp_ns == found.other_stamp_ns == 100 * S
    np.testing.assert_allclose(found.pose, [4.2, -0.1, 2.0 - math.pi / 2])
    assert found.covariance[2, 2] >= YAW_UNKNOWN
    wanted = COVARIANCE + TUNING.outline**2 * np.eye(2)
    np.testing.assert_allclose(found.covariance[:2, :2], found.inflated * wanted)


@pytest.mark.parametrize("yaw", [0.0, 1.0, -2.5])
def test_covariance_of_poses_is_in_the_frame_of_the_robot(yaw):
    """b is known well along the map's x axis, and not along y; a may look anywhere."""
    unsure = np.diag([1e-4, 1.0, 1e-6])
    poses = {"a": Pose(0, 0.0, 0.0, yaw, SURE), "b": Pose(0, 4.0, 0.0, 0.0, unsure)}

    def sees(x, y):
        return len(seen((x, y) @ rotation_2d(yaw), poses=poses))

    assert sees(4.0, 2.0) == 1
    assert sees(6.0, 0.0) == 0


@pytest.mark.parametrize("place", [(6.0, 0.0), (4.0, 1.2), (-4.0, 0.0)])
def test_body_elsewhere_is_no_team_mate(place):
    assert seen(place) == ()


def test_of_two_bodies_that_may_be_it_none_counts():
    assert seen((4.1, 0.2), (4.1, -0.2)) == ()
    # A further one that is not where it is does not count against it.
    (found,) = seen((4.1, 0.1), (4.0, -1.5))
    np.testing.assert_allclose(found.pose[:2], (4.1, 0.1))


def test_of_two_team_mates_that_it_may_be_none_is_recognized():
    beside = POSES | {"c": Pose(100 * S, 1.4, 6.0, 0.0, SURE)}
    assert seen((4.0, -0.2), poses=beside) == ()
    # Both are seen: each is the other's alternative, as far as they can be told apart.
    assert seen((4.0, 0.0), (4.0, -0.4), poses=beside) == ()
    apart = POSES | {"c": Pose(100 * S, 3.0, 6.0, 0.0, SURE)}
    found = seen((4.0, 0.0), (4.0, -2.0), poses=apart)
    assert sorted((one.other, one.pose[1]) for one in found) == [("b", 0.0), ("c", -2.0)]


def test_team_mate_whose_place_is_not_known_is_not_recognized():
    for sigma, count in ((1.0, 1), (2.0, 0)):
        unsure = np.diag([sigma**2, sigma**2, 0.01])
        poses = POSES | {"b": Pose(100 * S, 1.0, 6.0, 2.0, unsure)}
        assert len(seen((4.0, 0.0), poses=poses)) == count


def test_pose_of_another_time_may_be_elsewhere():
    far = (5.6, 0.0)
    assert seen(far) == ()
    poses = POSES | {"b": Pose(98 * S, 1.0, 6.0, 2.0, SURE)}
    assert len(seen(far, poses=poses)) == 1


def test_robot_that_is_alone_or_sees_nobody():
    assert seen((4.0, 0.0), poses={"a": POSES["a"]}) == ()
    assert seen() == ()


def test_sights_that_follow_soon_count_less():
    """As errors last: the variance over a long time is that of white noise so often."""
    sighted = SightedRobots()

    def factor(second):
        stamp_ns = round((100 + second) * S)
        (found,) = sighted.step({"a": bodies((4.0, 0.0), stamp_ns=stamp_ns)}, POSES)
        assert isinstance(found, RelativePose)
        own = COVARIANCE[0, 0] + TUNING.outline**2
        assert found.covariance[0, 0] == pytest.approx(found.inflated * own)
        return found.inflated

    lasting = 2.0 * TUNING.lasting * TUNING.lasting_s
    assert factor(0.0) == pytest.approx(1.0, abs=0.1)
    assert factor(0.1) == pytest.approx(1.0 + lasting / 0.1)
    assert factor(0.6) == pytest.approx(1.0 + lasting / 0.5)
    assert factor(60.6) == pytest.approx(1.0 + lasting / 60.0)


def test_planner_measures_them_in_each_interval():
    relative = RelativePoses()
    for k in range(3):
        stamp_ns = 100 * S + k * S // 10
        found = relative.step({"a": bodies((4.0, 0.0), stamp_ns=stamp_ns)}, POSES)
        assert [(one.robot, one.other) for one in found if isinstance(one, RelativePose)] == [
            ("a", "b")
        ]

"""The estimator from outside: what goes in, what comes out."""

import dataclasses
import math

import numpy as np
import pytest

from core.localization.tours import as_walls
from mrs_people_loc.config import Localization
from mrs_people_loc.errors import PoseError
from mrs_people_loc.localization.filter.team_state import Trust
from mrs_people_loc.localization.localizer import Localizer
from mrs_people_loc.localization.shared import RelativePose
from mrs_people_loc.localization.walls import SeenWalls
from mrs_people_loc.team.poses import Pose

S = 1_000_000_000
CONFIG = Localization(start_sigmas=(0.1, 0.1, 0.05), wheel_sigmas=(0.0, 0.0, 0.0))


def covariance(*sigmas):
    return np.diag(np.square(sigmas))


def seen_at(stamp_ns, *walls, sigmas=(0.01, 0.005)):
    """Walls in base_link, each from (x, y) to (x, y)."""
    return SeenWalls(stamp_ns, as_walls(np.array(walls, dtype=float), sigmas))


def drive(localizer, begin=(0.0, 0.0, 0.0), velocity=0.5, seconds=2.0, start_ns=S, rate=20):
    """Straight ahead; what it said last."""
    made = None
    for k in range(round(seconds * rate) + 1):
        way = velocity * k / rate
        x, y = begin[0] + way * math.cos(begin[2]), begin[1] + way * math.sin(begin[2])
        made = localizer.take_odometry(Pose(start_ns + k * S // rate, x, y, begin[2]))
    return made


def test_start_is_where_the_odometry_says():
    pose = Localizer("a", CONFIG).take_odometry(Pose(S, 1.0, 2.0, 0.5))
    assert (pose.x, pose.y, pose.yaw) == pytest.approx((1.0, 2.0, 0.5))
    np.testing.assert_allclose(pose.covariance, covariance(0.1, 0.1, 0.05))


def test_configured_start_is_where_the_odometry_begins():
    config = dataclasses.replace(CONFIG, start=(5.0, 5.0, math.pi / 2))
    localizer = Localizer("a", config)
    localizer.take_odometry(Pose(S, 100.0, 0.0, 0.0))
    pose = localizer.take_odometry(Pose(2 * S, 101.0, 0.0, 0.0))
    assert (pose.x, pose.y, pose.yaw) == pytest.approx((5.0, 6.0, math.pi / 2))


def test_uncertainty_grows_with_the_way():
    # 4 m straight on: position 0.02^2 * 4 more along; across also 4 m of the start's heading and
    # a third of what the heading gains.
    pose = drive(Localizer("a", CONFIG), velocity=1.0, seconds=4.0)
    assert pose.x == pytest.approx(4.0)
    heading = 0.006**2 * 4
    assert pose.covariance[0, 0] == pytest.approx(0.1**2 + 0.02**2 * 4)
    across = 0.1**2 + 0.02**2 * 4 + 16 * 0.05**2 + 16 * heading / 3
    assert pose.covariance[1, 1] == pytest.approx(across, rel=1e-3)
    assert pose.covariance[2, 2] == pytest.approx(0.05**2 + heading)


def test_standing_adds_nothing():
    first = drive(Localizer("a", CONFIG), velocity=0.0, seconds=0.1)
    later = drive(Localizer("a", CONFIG), velocity=0.0, seconds=20.0)
    np.testing.assert_allclose(first.covariance, later.covariance)


def test_older_odometry_is_an_error():
    localizer = Localizer("a", CONFIG)
    localizer.take_odometry(Pose(2 * S, 0.0, 0.0, 0.0))
    with pytest.raises(PoseError, match="wanted: newer"):
        localizer.take_odometry(Pose(2 * S, 0.0, 0.0, 0.0))


def test_known_wall_corrects_across_and_heading_but_not_along():
    # The wall y = 2; the robot believes to be at the origin and is 0.1 m nearer, turned by 0.04.
    localizer = Localizer("a", CONFIG, as_walls([(-5, 2, 5, 2)]))
    localizer.take_odometry(Pose(S, 0.0, 0.0, 0.0))
    c, s = math.cos(0.04), math.sin(0.04)
    for k in range(1, 40):
        localizer.take_odometry(Pose(S + k * S // 20, 0.0, 0.0, 0.0))
        ends = [(x * c + 1.9 * s, 1.9 * c - x * s) for x in (0.0, 3.0)]
        localizer.take_walls(seen_at(S + k * S // 20, (*ends[0], *ends[1])))
    pose = localizer.pose_at(S + 39 * S // 20)
    assert pose.y == pytest.approx(0.1, abs=0.01)
    assert pose.yaw == pytest.approx(0.04, abs=0.005)
    sigma = np.sqrt(np.diag(pose.covariance))
    assert sigma[0] == pytest.approx(0.1, rel=0.01)
    assert sigma[1] < 0.01
    assert sigma[2] < 0.005
    assert localizer.state.sources["a", "known walls"].accepted == 39


def test_known_wall_that_was_elsewhere_is_used_again_after_it_has_agreed():
    """It drives along the wall y = 2, before which shelves stand for 8 m."""
    localizer = Localizer("a", CONFIG, as_walls([(-5, 2, 40, 2)]))
    accepted = {}
    for k in range(400):
        stamp_ns, x = S + k * S // 10, 0.05 * k
        localizer.take_odometry(Pose(stamp_ns, x, 0.0, 0.0))
        if x < 8.0 or x > 11.0:
            y = 1.0 if x < 8.0 else 2.0
            localizer.take_walls(seen_at(stamp_ns, (-1.0, y, 1.0, y)))
        source = localizer.state.sources["a", "known walls"]
        accepted[round(x, 2)] = source.accepted, set(localizer.state.misfits)
    assert accepted[8.0] == (0, {0})
    assert accepted[12.0] == (0, {0})  # it has agreed for a metre
    count, misfits = accepted[19.0]
    assert count > 20  # beside the wall that was unknown meanwhile
    assert misfits == set()


@pytest.mark.parametrize("off", [0.0, 0.8])
def test_map_that_was_wrong_is_less_sure_where_it_was_not_seen(off):
    """It drives along a wall that is off, or not, to one across that is known 0.8 m too near."""
    config = dataclasses.replace(CONFIG, position_noise=0.25)
    localizer = Localizer("a", config, as_walls([(-5, 2, 40, 2), (14.2, 2, 14.2, -5)]))
    for k in range(241):
        stamp_ns, x = S + k * S // 10, 0.05 * k
        localizer.take_odometry(Pose(stamp_ns, x, 0.0, 0.0))
        localizer.take_walls(seen_at(stamp_ns, (-1.0, 2.0 - off, 1.0, 2.0 - off)))
        if x > 11.0:
            localizer.take_walls(seen_at(stamp_ns, (15.0 - x, 1.0, 15.0 - x, -1.0)))
    pose = localizer.pose_at(stamp_ns)
    within_sigmas = abs(pose.x - x) / math.sqrt(pose.covariance[0, 0])
    assert within_sigmas < 1.0 if off else within_sigmas > 10.0


def test_absolute_pose_is_weighed_by_its_covariance():
    localizer = Localizer("a", CONFIG)
    localizer.take_odometry(Pose(S, 0.0, 0.0, 0.0))
    localizer.take_absolute(Pose(S, 0.2, 0.0, 0.0, covariance(0.1, 0.1, 0.05)))
    pose = localizer.pose_at(S)
    assert pose.x == pytest.approx(0.1, abs=1e-6)
    # The error of the heading turns the correction of 0.1 m, too.
    expected = covariance(0.1, 0.1, 0.05) / 2
    np.testing.assert_allclose(pose.covariance, expected, rtol=1e-3, atol=1e-4)


def test_absolute_pose_of_a_moment_ago_counts_there():
    localizer = Localizer("a", CONFIG)
    drive(localizer, velocity=1.0, seconds=2.0)
    before = localizer.pose_at(3 * S)
    localizer.take_absolute(Pose(2 * S, 1.2, 0.0, 0.0, covariance(1e-3, 1e-3, 1e-3)))
    assert before.x == pytest.approx(2.0)
    assert localizer.pose_at(3 * S).x == pytest.approx(2.2, abs=1e-3)


def test_wild_absolute_pose_is_refused_and_counted():
    localizer = Localizer("a", CONFIG)
    localizer.take_odometry(Pose(S, 0.0, 0.0, 0.0))
    localizer.take_absolute(Pose(S, 5.0, 0.0, 0.0, covariance(0.1, 0.1, 0.05)))
    assert localizer.pose_at(S).x == 0.0
    source = localizer.state.sources["a", "absolute"]
    assert (source.accepted, source.refused) == (0, 1)
    # 5 m by sigmas of 0.14 m, over three degrees of freedom.
    assert source.innovation == pytest.approx(math.sqrt(25 / 0.02 / 3), rel=1e-3)


def hear(*localizers):
    """Each tells all others."""
    for told in [(one, one.share()) for one in localizers]:
        for other in localizers:
            if other is not told[0]:
                other.take_teammate(told[1])


def two(offset=(0.0, 0.0, 0.0)):
    """Two robots side by side; the second believes to be off by this."""
    a = Localizer("a", dataclasses.replace(CONFIG, start=(0.0, 0.0, 0.0)))
    b = Localizer("b", dataclasses.replace(CONFIG, start=offset))
    return a, b


def stand(localizers, seconds, walls=lambda k, stamp_ns: (), begin_ns=S):
    """Robots stand and see; `walls(k, stamp)` for each."""
    for step in range(round(seconds * 10) + 1):
        stamp_ns = begin_ns + step * S // 10
        for k, localizer in enumerate(localizers):
            localizer.take_odometry(Pose(stamp_ns, 0.0, 0.0, 0.0))
            for seen in walls(k, stamp_ns):
                localizer.take_walls(seen)
        hear(*localizers)


def test_robots_that_see_one_wall_share_the_correction():
    # Both stand at the origin, one believes to be 0.1 m too far left: the same wall is 2 m away.
    a, b = two((0.0, 0.1, 0.0))
    stand((a, b), 3.0, lambda k, t: [seen_at(t, (0, 2, 3, 2))])
    ya, yb = a.state.poses["a"], b.state.poses["b"]
    assert ya.y == pytest.approx(0.05, abs=0.01)
    assert yb.y == pytest.approx(0.05, abs=0.01)
    # What they agree on is the mean of two starts, and no better known than that.
    assert ya.covariance[1, 1] == pytest.approx(0.1**2 / 2, rel=0.02)
    assert yb.covariance[0, 0] == pytest.approx(0.1**2, rel=0.01)


def test_both_robots_come_to_the_same_estimate_of_both():
    a, b = two((0.05, 0.1, 0.02))
    stand((a, b), 3.0, lambda k, t: [seen_at(t, (0, 2, 3, 2))])
    for robot in ("a", "b"):
        one, other = a.state.poses[robot], b.state.poses[robot]
        # Not exactly: each starts with what the other said after its own first sight.
        assert (one.x, one.y, one.yaw) == pytest.approx((other.x, other.y, other.yaw), abs=1e-4)
        np.testing.assert_allclose(one.covariance, other.covariance, atol=1e-5)


def test_what_one_hears_several_times_counts_once():
    a, b = two()
    stand((a, b), 2.0, lambda k, t: [seen_at(t, (0, 2, 3, 2))] if k else [])
    before = a.state
    for _ in range(20):
        hear(a, b)
    after = a.state
    assert after.sources["b", "walls"] == before.sources["b", "walls"]
    np.testing.assert_array_equal(after.poses["a"].covariance, before.poses["a"].covariance)


def test_walls_that_come_late_are_told_too():
    """As those of sonars: at the middle of the way on which they were measured."""
    a, b = two()
    stand((a, b), 2.0)
    a.take_walls(seen_at(2 * S, (0, 2, 3, 2)))
    assert [seen.stamp_ns for seen in a.share().walls] == [2 * S]
    hear(a, b)
    assert len(b.state.walls) == 1


def test_relative_pose_aligns_two_robots():
    a, b = two((0.2, 0.0, 0.0))
    stand((a, b), 1.0)
    for localizer in (a, b):
        localizer.take_relative(
            RelativePose("a", 2 * S, "b", 2 * S, np.zeros(3), covariance(0.01, 0.01, 0.01))
        )
    poses = a.state.poses
    assert poses["b"].x - poses["a"].x == pytest.approx(0.0, abs=0.005)
    assert poses["a"].x == pytest.approx(0.1, abs=0.005)


def test_relative_pose_to_itself_is_an_error():
    with pytest.raises(PoseError, match="a to itself"):
        Localizer("a", CONFIG).take_relative(RelativePose("a", S, "a", S, np.zeros(3), np.eye(3)))


def test_measured_pose_without_rank_is_an_error():
    localizer = Localizer("a", CONFIG)
    with pytest.raises(PoseError, match="positive definite"):
        localizer.take_absolute(Pose(S, 0.0, 0.0, 0.0))


def test_pose_far_from_all_odometry_is_an_error():
    localizer = Localizer("a", CONFIG)
    with pytest.raises(PoseError, match="no odometry"):
        localizer.pose_at(S)
    with pytest.raises(PoseError, match="no odometry"):
        localizer.share()
    localizer.take_odometry(Pose(S, 0.0, 0.0, 0.0))
    with pytest.raises(PoseError, match=r"0\.500 s away"):
        localizer.pose_at(3 * S // 2)


def test_walls_without_usable_values_are_left_out():
    localizer = Localizer("a", CONFIG)
    localizer.take_odometry(Pose(S, 0.0, 0.0, 0.0))
    seen = seen_at(S, (0, 2, 3, 2), (0, -2, 3, -2), (4, -1, 4, 1))
    seen.walls.distance[0] = np.nan
    seen.walls.covariance[1] = [[1.0, 2.0], [2.0, 1.0]]
    localizer.take_walls(seen)
    walls = localizer.state.walls
    assert walls.distance == pytest.approx([4.0])
    assert walls.bearing == pytest.approx([0.0], abs=1e-9)


def test_claimed_covariance_that_is_none_does_no_harm():
    a, b = two()
    stand((a, b), 1.0)
    told = b.share()
    bad = np.array([[1.0, 2.0, 0.0], [2.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    for k in range(1, 20):
        stamp_ns = 2 * S + k * S // 10
        odometry = dataclasses.replace(told.odometry, stamp_ns=stamp_ns)
        a.take_odometry(Pose(stamp_ns, 0.0, 0.0, 0.0))
        a.take_teammate(
            dataclasses.replace(told, pose=Pose(stamp_ns, 0.0, 0.0, 0.0, bad), odometry=odometry)
        )
    pose = a.state.poses["b"]
    assert np.linalg.eigvalsh(pose.covariance)[0] > 0
    assert (pose.x, pose.y) == pytest.approx((0.0, 0.0), abs=1e-6)


# ---------------------------------------------------------------------------- what a node asks ----


def test_what_was_measured_is_shared_for_a_while_and_no_longer():
    localizer = Localizer("a", CONFIG)
    drive(localizer, seconds=1.0)
    localizer.take_walls(seen_at(2 * S, ((3.0, -1.0), (3.0, 1.0))))
    localizer.take_absolute(Pose(2 * S, 0.5, 0.0, 0.0, covariance(0.1, 0.1, 0.1)))
    told = localizer.share()
    assert [len(told.walls), len(told.absolute)] == [1, 1]
    for later_ns, count in ((250_000_000, 1), (350_000_000, 0)):
        localizer.take_odometry(Pose(2 * S + later_ns, 0.5, 0.0, 0.0))
        told = localizer.share()
        assert [len(told.walls), len(told.absolute)] == [count, count]


def test_dead_reckoning_between_two_odometries_is_interpolated():
    localizer = Localizer("a", CONFIG)
    drive(localizer, velocity=1.0, seconds=1.0)
    odometry = localizer.odometry_at(S + 525_000_000)
    assert odometry.x == pytest.approx(0.525)
    assert odometry.position_variance == pytest.approx(0.525 * 0.02**2)
    with pytest.raises(PoseError, match="the nearest odometry is"):
        localizer.odometry_at(9 * S)


def test_known_walls_may_come_while_it_runs():
    localizer = Localizer("a", CONFIG)
    drive(localizer, seconds=1.0)
    sight = ((2.7, -1.0), (2.7, 1.0))  # 2.7 m ahead of x = 0.5: at 3.2 by the odometry
    localizer.take_known(as_walls(np.array([((3.1, -2.0), (3.1, 2.0))]), (0.001, 0.001)))
    localizer.take_walls(seen_at(2 * S, sight))
    assert localizer.state.sources["a", "known walls"].accepted == 1
    assert localizer.pose_at(2 * S).x == pytest.approx(0.4, abs=0.01)


def test_other_noise_counts_from_the_next_odometry_on():
    localizer = Localizer("a", CONFIG)
    drive(localizer, velocity=1.0, seconds=1.0)
    localizer.configure(dataclasses.replace(CONFIG, position_noise=0.1))
    localizer.take_odometry(Pose(3 * S, 2.0, 0.0, 0.0))
    assert localizer.share().odometry.position_variance == pytest.approx(0.02**2 + 0.1**2)


# --------------------------------------------------------------- team-mates that are silent ----


def test_pose_is_relative_to_the_team_while_it_is_heard():
    a, b = two()
    stand((a, b), 1.0)
    apart = a.share().pose
    assert apart.in_team == pytest.approx(apart.covariance)  # nothing ties the two
    tie = covariance(0.01, 0.01, 0.005)
    a.take_relative(RelativePose("a", 2 * S, "b", 2 * S, np.zeros(3), tie))
    newest = a.share().pose
    assert newest.in_team is not None
    assert (np.diag(newest.in_team) < 0.1 * np.diag(newest.covariance)).all()
    alone = drive(a, velocity=0.5, seconds=3.0, start_ns=newest.stamp_ns + S)
    assert alone.in_team is None
    assert Localizer("c", CONFIG).take_odometry(Pose(S, 0.0, 0.0, 0.0)).in_team is None


def test_team_mate_that_left_leaves_nothing_behind():
    a, b = two()
    stand((a, b), 1.0)
    a.take_relative(RelativePose("a", 2 * S, "b", 2 * S, np.zeros(3), covariance(0.1, 0.1, 0.05)))
    assert ("b", "relative") in a.state.sources
    drive(a, velocity=0.0, seconds=125.0, start_ns=3 * S)
    state = a.state
    assert set(state.poses) == {"a"}
    assert not [key for key in state.sources if key[0] == "b"]
    assert "b" not in state.trust


def test_clock_of_a_team_mate_that_left_is_told_no_longer():
    a, b = Localizer("a", CONFIG), Localizer("b", CONFIG)
    drive(a, seconds=1.0)
    drive(b, seconds=1.0, start_ns=10 * S)
    a.take_teammate(b.share())
    assert a.state.clocks == {"b": pytest.approx(9.0)}
    drive(a, velocity=0.0, seconds=20.0, start_ns=3 * S)
    assert a.state.clocks == {}


def test_relative_pose_of_a_robot_that_tells_nothing_does_not_wait_for_ever():
    a = Localizer("a", CONFIG)
    drive(a, seconds=1.0)
    a.take_relative(RelativePose("a", 2 * S, "c", 2 * S, np.zeros(3), covariance(0.1, 0.1, 0.05)))
    assert a.state.late == 0
    drive(a, velocity=0.0, seconds=4.0, start_ns=3 * S)
    assert a.state.late == 1


def test_message_holds_the_newest_walls_if_there_are_many():
    a = Localizer("a", CONFIG)
    drive(a, seconds=1.0)
    walls = [((x, -1.0), (x, 1.0)) for x in np.arange(1.0, 4.0, 0.25)]
    for k in range(5):
        a.take_walls(seen_at(2 * S - k * 10_000_000, *walls))
    told = a.share().walls
    assert sum(len(seen.walls) for seen in told) == 36
    assert len(told) == 3


# ------------------------------------------------------------- absolute poses that do not fit ----


def place_by(localizer, y, begin_ns, seconds, walls=()):
    """Stands with absolute poses at (0, y), ten a second; when it was first said to be lost [s]."""
    for k in range(round(seconds * 10)):
        stamp_ns = begin_ns + k * S // 10
        localizer.take_odometry(Pose(stamp_ns, 0.0, 0.0, 0.0))
        if walls:
            localizer.take_walls(seen_at(stamp_ns, *walls))
        localizer.take_absolute(Pose(stamp_ns, 0.0, y, 0.0, covariance(0.05, 0.05, 0.02)))
        if localizer.state.trust.get("a", Trust()).times_lost:
            return k / 10
    return None


def test_wrong_start_gives_way_to_absolute_poses():
    localizer = Localizer("a", CONFIG)
    assert place_by(localizer, 0.8, S, 5.0) == pytest.approx(2.4, abs=0.15)
    place_by(localizer, 0.8, 10 * S, 1.0)
    localizer.take_odometry(Pose(20 * S, 0.0, 0.0, 0.0))
    localizer.take_absolute(Pose(20 * S, 0.0, 0.8, 0.0, covariance(0.05, 0.05, 0.02)))
    assert localizer.pose_at(20 * S).y == pytest.approx(0.8, abs=0.02)


def test_robot_tells_that_it_is_lost_until_something_fits():
    localizer = Localizer("a", CONFIG)
    localizer.take_odometry(Pose(S, 0.0, 0.0, 0.0))
    assert not localizer.share().lost
    place_by(localizer, 0.8, 2 * S, 5.0)
    assert (localizer.state.trust["a"].lost, localizer.share().lost) == (True, True)
    place_by(localizer, 0.8, 10 * S, 1.0)
    assert (localizer.state.trust["a"].lost, localizer.share().lost) == (False, False)


def test_walls_of_its_own_do_not_hide_that_a_robot_was_carried():
    localizer, wall = Localizer("a", CONFIG), (((3.0, -1.0), (3.0, 1.0)),)
    assert place_by(localizer, 0.0, S, 2.0, wall) is None
    assert place_by(localizer, 0.8, 3 * S, 5.0, wall) == pytest.approx(0.4, abs=0.15)


def test_robot_at_known_walls_is_not_lost_by_absolute_poses_that_do_not_fit():
    known = as_walls(np.array([((3.0, -1.0), (3.0, 1.0)), ((-1.0, 2.0), (1.0, 2.0))]), (0.01, 0.01))
    localizer = Localizer("a", CONFIG, known)
    seen = (((3.0, -1.0), (3.0, 1.0)), ((-1.0, 2.0), (1.0, 2.0)))
    assert place_by(localizer, 0.8, S, 6.0, seen) is None
    assert localizer.pose_at(S * 69 // 10).y == pytest.approx(0.0, abs=0.05)


# ------------------------------------------------------------- carried along one of two walls ----


@pytest.mark.parametrize("is_known", [True, False], ids=["known", "unknown"])
def test_robot_that_was_carried_along_a_wall_is_lost_by_the_other_one(is_known):
    ends = np.array([(3.0, -3.0, 3.0, 2.0), (3.0, 2.0, -3.0, 2.0)])
    localizer = Localizer("a", CONFIG, as_walls(ends, (0.01, 0.01)) if is_known else None)
    for k in range(80):
        stamp_ns, y = S + k * S // 10, -0.5 if k > 30 else 0.0
        localizer.take_odometry(Pose(stamp_ns, 0.0, 0.0, 0.0))
        localizer.take_walls(seen_at(stamp_ns, *(ends - [0.0, y, 0.0, y])))
    trust = localizer.state.trust["a"]
    assert (trust.times_lost, trust.lost) == (1, False)
    assert trust.lost_ns == S + 5.1 * S  # 2 s after it was carried
    assert localizer.pose_at(stamp_ns).y == pytest.approx(-0.5, abs=0.05)


def test_robot_whose_odometry_hangs_says_that_it_is_lost_until_it_is_known_where_it_is():
    one, other = two((0.0, 2.0, 0.0))
    for k in range(101):
        x, stamp_ns = 0.05 * min(k, 40), S + k * S // 10
        one.take_odometry(Pose(stamp_ns, x, 0.0, 0.0))
        other.take_odometry(Pose(stamp_ns, 0.0, 2.0, 0.0))
        hear(one, other)
        if k == 20:
            take_each_other((one, other), stamp_ns, (-1.0, 2.0))
        assert k == 43 or one.share().lost == (k > 43)  # after 0.3 s
        assert not other.share().lost
    drive(one, (2.0, 0.0, 0.0), start_ns=12 * S, seconds=1.0)
    drive(other, (0.0, 2.0, 0.0), 0.0, start_ns=12 * S, seconds=1.0)
    hear(one, other)
    assert one.share().lost
    take_each_other((one, other), 13 * S, (-4.5, 2.0))
    assert not one.share().lost


def take_each_other(localizers, stamp_ns, place):
    """A relative pose of the second of two robots, measured well."""
    measured = RelativePose(
        "a", stamp_ns, "b", stamp_ns, np.array([*place, 0.0]), covariance(0.05, 0.05, 0.02)
    )
    for localizer in localizers:
        localizer.take_relative(measured)


def test_team_mates_are_known_where_they_are_in_base_link_while_they_are_heard():
    one, other = two((0.0, 2.0, 0.0))
    stand((one, other), 1.0)
    ((x, y, off),) = one.mates_at(2 * S)
    assert (x, y) == pytest.approx((0.0, 2.0), abs=0.01)
    assert 0.1 < off <= 0.5
    take_each_other((one, other), 2 * S, (0.0, 2.0))
    ((_, _, surer),) = one.mates_at(2 * S)
    assert surer < off
    drive(one, start_ns=2 * S + S // 20, seconds=3.0)
    assert not len(one.mates_at(5 * S))
    assert not len(one.mates_at(20 * S))


@pytest.mark.parametrize(("degrees", "lost"), [(3.0, False), (30.0, True)])
def test_robot_that_was_bumped_is_not_lost_and_one_that_was_turned_is(degrees, lost):
    """It stands before a corner, which it knows well."""
    localizer = Localizer("a", CONFIG)
    for k in range(80):
        turn = math.radians(degrees) if k >= 40 else 0.0
        c, s = math.cos(turn), math.sin(turn)
        corner = np.array([[3.0, 2.0], [-1.0, 2.0], [3.0, 2.0], [3.0, -1.0]]) @ [[c, -s], [s, c]]
        localizer.take_odometry(Pose(S + k * S // 10, 0.0, 0.0, 0.0))
        seen = corner.reshape(2, 4).tolist()
        localizer.take_walls(seen_at(S + k * S // 10, *seen))
    trust = localizer.state.trust["a"]
    assert (trust.times_lost > 0) == lost
    assert lost or localizer.pose_at(S + 79 * S // 10).yaw == pytest.approx(turn, abs=0.01)

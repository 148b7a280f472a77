"""What a robot senses, given to its localizer."""

import math

import numpy as np
import pytest

from core.localization.walls.test_laser import AHEAD
from core.localization.walls.test_laser import scan as ranges_to
from core.localization.walls.test_people_in_view import scan as view_of
from mrs_people_loc.config import Localization, PoseInput, RobotConfig, WallSensors
from mrs_people_loc.errors import PoseError
from mrs_people_loc.localization.robot_localization import RobotLocalization, localizes
from mrs_people_loc.localization.walls.ranges import LaserScan
from mrs_people_loc.team.poses import Pose

S = 1_000_000_000


@pytest.mark.parametrize(
    ("pose", "localization", "in_own_frame", "in_map"),
    [
        ({"map_from_odom": [0.0, 0.0, 0.0]}, {}, True, False),
        ({}, {"start": [0.0, 0.0, 0.0]}, True, False),
        ({}, {}, False, False),
        ({"map_from_odom": [0.0, 0.0, 0.0]}, {"run": "never"}, False, False),
        ({"map_from_odom": [0.0, 0.0, 0.0], "source": "tf"}, {}, False, False),
        ({"map_from_odom": [0.0, 0.0, 0.0], "source": "pose_in"}, {}, False, False),
        ({"source": "pose_in"}, {"run": "always"}, True, True),
        ({}, {"run": "always"}, True, True),
    ],
)
def test_what_is_dead_reckoning(pose, localization, in_own_frame, in_map):
    config = RobotConfig(
        pose=PoseInput.from_mapping(pose), localization=Localization.from_mapping(localization)
    )
    assert localizes(config, "odom") is in_own_frame
    assert localizes(config, "map") is in_map


def test_odometry_begins_at_its_place_in_the_map():
    pose = PoseInput.from_mapping({"map_from_odom": [10.0, 20.0, math.pi / 2]})
    own = RobotLocalization("robot_a", RobotConfig(pose=pose))
    assert own.share() is None
    own.take_odometry(Pose(S, 1.0, 0.0, 0.0))
    placed = own.take_odometry(Pose(2 * S, 2.0, 0.5, 0.1))
    assert (placed.x, placed.y, placed.yaw) == pytest.approx((9.5, 22.0, math.pi / 2 + 0.1))
    assert own.began_ns == S


def test_team_hears_a_robot_at_the_configured_rate():
    own = RobotLocalization(
        "robot_a", RobotConfig(localization=Localization(start=(0.0, 0.0, 0.0), share_rate=10.0))
    )
    told = []
    for step in range(95):
        own.take_odometry(Pose(S + step * S // 100, 0.0, 0.0, 0.0))
        told.append(own.share())
    assert sum(one is not None for one in told) == 10


def test_wheels_are_kept_after_ten_metres_and_not_taken_before_the_next_start():
    """The true way is 2 % longer than the odometry's, of which the robot is told 1.5 %."""
    localization = Localization(start=(0.0, 0.0, 0.0), wheels=(0.015, 0.0, 0.0))
    own = RobotLocalization("robot_a", RobotConfig(localization=localization))
    with pytest.raises(PoseError, match="does not run"):
        own.wheels_to_keep()

    def drive(first: int, last: int) -> None:
        for step in range(first, last):
            stamp_ns, x = S + step * S // 10, 0.05 * step
            own.take_odometry(Pose(stamp_ns, x, 0.0, 0.0))
            if step % 20 == 0:
                covariance = np.diag([1e-4, 1e-4, 1e-4])
                own.take_absolute(Pose(stamp_ns, 1.02 * x, 0.0, 0.0, covariance))

    drive(0, 190)
    with pytest.raises(PoseError, match="driven 9.5 m; wanted: 10 m"):
        own.wheels_to_keep()
    drive(190, 601)
    kept = Localization.from_mapping(
        {name.removeprefix("localization."): value for name, value in own.wheels_to_keep().items()},
        base=localization,
    )
    assert kept.wheels == pytest.approx((0.02, 0.0, 0.0), abs=2e-3)
    # The turn per metre is known better than wheels stay the same; it did not turn.
    assert kept.wheel_sigmas == pytest.approx((0.0047, 0.002, 0.03), rel=0.05)
    before = own.state
    own.configure(RobotConfig(localization=kept))
    drive(601, 602)
    assert own.state.wheels == pytest.approx(before.wheels, abs=1e-9)
    assert own.state.poses["robot_a"].x == pytest.approx(1.02 * 30.05, abs=0.01)
    own.reset()
    assert own.state.wheels == pytest.approx(kept.wheels)
    assert own.state.wheel_sigmas == pytest.approx(kept.wheel_sigmas)


def walls_known(own: RobotLocalization, stamp_ns: int) -> int:
    """How many walls a robot knows after a laser scan of 1.2 m of a wall ahead."""
    ranges = ranges_to([((2.0, -0.6), (2.0, 0.6))], AHEAD)
    own.take_odometry(Pose(stamp_ns, 0.0, 0.0, 0.0))
    own.take_laser(LaserScan(stamp_ns, "laser", 10.0, AHEAD, ranges), (0.0, 0.0, 0.0))
    return len(own.state.walls)


@pytest.mark.parametrize(("stamp_ns", "known"), [(S // 2, 0), (S // 2 + 1000, 1)])
def test_laser_sees_no_wall_at_people_of_the_last_view_for_half_a_second(
    make_head, stamp_ns, known
):
    own = RobotLocalization("robot_a", RobotConfig(walls=WallSensors(stereo=False)))
    camera = make_head().camera()
    nothing = np.full((camera.height, camera.width), np.nan, np.float32)
    view = view_of((1, 3.0, [(2.0, 0.0)]))  # at 1 ns, before the middle of the wall
    own.take_view(view, nothing, camera)
    assert walls_known(own, stamp_ns) == known


def test_walls_are_looked_for_in_four_laser_scans_a_second():
    own = RobotLocalization("robot_a", RobotConfig(walls=WallSensors(stereo=False)))
    stamps = set()
    for step in range(40):
        assert walls_known(own, S + step * S // 20) == 1
        told = own.share()
        stamps |= {seen.stamp_ns for seen in told.walls} if told else set()
    assert stamps == {S + k * S // 4 for k in range(8)}


def test_walls_in_a_laser_scan_are_as_seen_at_its_stamp():
    """The robot turns by 0.2 rad while the scanner sweeps from right to left, towards a wall."""
    own = RobotLocalization("robot_a", RobotConfig(walls=WallSensors(stereo=False)))
    turned = np.linspace(0.0, 0.2, len(AHEAD))
    ranges = 2.0 / np.cos(AHEAD + turned)
    for part in (0.0, 0.5, 1.0, 1.5):
        own.take_odometry(Pose(S + round(part * S / 10), 0.0, 0.0, 0.2 * part))
    own.take_laser(LaserScan(S, "laser", 10.0, AHEAD, ranges, 0.1), (0.0, 0.0, 0.0))
    told = own.share()
    assert told is not None
    (seen,) = told.walls
    assert (seen.stamp_ns, len(seen.walls)) == (S, 1)
    assert seen.walls.distance[0] == pytest.approx(2.0, abs=1e-6)
    assert seen.walls.bearing[0] == pytest.approx(0.0, abs=1e-6)

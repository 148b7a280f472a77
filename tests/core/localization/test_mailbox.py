"""What waits for odometry, and what is recognized when it comes again."""

import numpy as np

from core.localization.tours import CONFIG
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.localization.localizer import Localizer
from mrs_people_loc.localization.mailbox import MAIL_TUNING, RecentSet
from mrs_people_loc.localization.robot_localization import RobotLocalization
from mrs_people_loc.team.poses import Pose

S = 1_000_000_000
COVARIANCE = np.diag([0.01, 0.01, 0.0025])


def test_recent_set_knows_the_last_items_and_forgets_the_first():
    items, count = RecentSet(), 10 * MAIL_TUNING.remembered
    for item in range(count):
        items.add(item)
    known = [item for item in range(count) if item in items]
    assert MAIL_TUNING.remembered <= len(known) <= 2 * MAIL_TUNING.remembered
    assert known == list(range(known[0], count))


def test_too_many_waiting_measurements_drop_the_oldest():
    localizer, surplus = Localizer("a", CONFIG), 3
    localizer.take_odometry(Pose(S, 0.0, 0.0, 0.0))
    for k in range(MAIL_TUNING.most_waiting + surplus):
        localizer.take_absolute(Pose(S + 1 + k, 0.0, 0.0, 0.0, COVARIANCE))
    assert localizer.state.late == surplus


def test_what_comes_before_the_first_odometry_is_not_used():
    own = RobotLocalization("robot_a", RobotConfig())
    own.take_absolute(Pose(S, 5.0, 0.0, 0.0, COVARIANCE))
    assert not own.has_begun
    assert own.share() is None
    assert own.take_odometry(Pose(S, 0.0, 0.0, 0.0)).x == 0.0
    assert own.take_odometry(Pose(2 * S, 0.0, 0.0, 0.0)).x == 0.0
    assert own.state.late == 0

import contextlib
import itertools
from collections.abc import Sequence
from typing import Any

import pytest

from mrs_people_loc import config as cfg
from mrs_people_loc.errors import PoseError, ScanError
from mrs_people_loc.scan import Cells, Scan
from mrs_people_loc.team.intervals import IntervalCollector
from mrs_people_loc.team.poses import Pose

MS = 1_000_000
CONFIG = cfg.Interval(max_wait=0.1, max_scan_age=0.25, max_pose_age=0.2, robot_timeout=2.0)


class Team:
    """A collector whose times are milliseconds."""

    def __init__(self, *robots: str, known: Sequence[str] = ()) -> None:
        self.collector = IntervalCollector(CONFIG, known)
        for robot in robots:  # poses at all times of these tests
            self.collector.robot(robot).poses.span_ns = 100_000 * MS
            for at in range(0, 20_001, 100):
                self.pose(robot, at)

    def pose(self, robot: str, at: float, x: float | None = None) -> None:
        x = at / 1000 if x is None else x
        self.collector.robot(robot).poses.add(Pose(round(at * MS), x, 0.0, 0.0))

    def scan(self, robot: str, stamp: float, now: float | None = None) -> None:
        scan = Scan(robot, round(stamp * MS), Cells.empty())
        self.collector.add_scan(scan, round((stamp if now is None else now) * MS))

    def close(self, now: float) -> dict[str, float] | None:
        """Stamps of the scans of the interval that closes, by robot."""
        self.closed: Any = self.collector.close(round(now * MS))
        if self.closed is None:
            return None
        return {scan.robot: scan.stamp_ns / MS for scan in self.closed.scans}

    def dropped(self, robot: str) -> dict[str, int]:
        return dict(self.collector.robot(robot).dropped)


THREE = ("robot_a", "robot_b", "robot_c")


def live_team(*robots: str) -> Team:
    """A team of which every robot has delivered a scan that was used, at 1000."""
    team = Team(*robots)
    for robot in robots:
        team.scan(robot, 1000)
    assert team.close(1000) == dict.fromkeys(robots, 1000)
    return team


def test_no_interval_closes_before_a_scan():
    team = Team(*THREE)
    assert team.close(0) is None
    assert team.close(99_999) is None


def test_interval_of_one_robot_closes_at_once():
    team = Team("robot_a")
    for stamp in (1000, 1050):
        team.scan("robot_a", stamp)
        assert team.close(stamp) == {"robot_a": stamp}
        assert team.close(stamp) is None  # a scan is used once
    assert team.close(9000) is None


def test_closed_interval_has_scans_and_poses():
    team = Team("robot_a", "robot_b")
    team.scan("robot_a", 1013)
    team.scan("robot_b", 1050)
    assert team.close(1060) == {"robot_a": 1013, "robot_b": 1050}
    closed = team.closed
    assert closed.time_ns == 1050 * MS
    assert dict(closed.left_out) == {}
    # Poses at the scans' stamps, between those given (x is the time in seconds).
    assert {name: p.stamp_ns for name, p in closed.poses.items()} == {
        "robot_a": 1013 * MS,
        "robot_b": 1050 * MS,
    }
    assert closed.poses["robot_a"].x == pytest.approx(1.013)


def test_interval_has_poses_of_robots_without_a_scan():
    team = Team("robot_a", "robot_b")
    team.collector.robot("robot_c")  # has no pose
    team.scan("robot_a", 1013)
    assert team.close(20_000) == {"robot_a": 1013}
    assert list(team.closed.poses) == ["robot_a"]
    assert {name: pose.stamp_ns for name, pose in team.closed.others.items()} == {
        "robot_b": 1013 * MS
    }
    assert team.closed.others["robot_b"].x == pytest.approx(1.013)


def test_three_robots_wait_for_each_other():
    team = live_team(*THREE)
    team.scan("robot_b", 1200)
    assert team.close(1200) is None
    team.scan("robot_a", 1190, now=1210)
    assert team.close(1210) is None
    team.scan("robot_c", 1213)
    assert team.close(1213) == {"robot_a": 1190, "robot_b": 1200, "robot_c": 1213}


def test_after_max_wait_the_interval_closes_without_the_missing_robot():
    team = live_team(*THREE)
    team.scan("robot_b", 1200, now=1230)
    team.scan("robot_a", 1200, now=1280)
    assert team.close(1329.999999) is None
    assert team.close(1330) == {"robot_a": 1200, "robot_b": 1200}  # 100 ms after the first
    # The next one counts again.
    team.scan("robot_c", 1250, now=1331)
    assert team.close(1430) is None
    assert team.close(1431) == {"robot_c": 1250}


def test_newer_scan_supersedes_the_older_one():
    team = live_team("robot_a", "robot_b")
    team.scan("robot_a", 1200)
    team.scan("robot_a", 1250)
    assert team.dropped("robot_a") == {"superseded": 1}
    team.scan("robot_b", 1260)
    assert team.close(1260) == {"robot_a": 1250, "robot_b": 1260}
    # It does not open the interval later.
    team.scan("robot_a", 1300)
    team.scan("robot_a", 1350)
    assert team.close(1399) is None
    assert team.close(1400) == {"robot_a": 1350}


@pytest.mark.parametrize(("age", "used"), [(250, True), (250.000001, False), (400, False)])
def test_too_old_scan_is_dropped(age, used):
    team = live_team("robot_a", "robot_b")
    team.scan("robot_a", 2000 - age, now=2000)
    team.scan("robot_b", 2000)
    closed = team.close(2000)
    assert closed == ({"robot_a": 2000 - age, "robot_b": 2000} if used else {"robot_b": 2000})
    assert team.dropped("robot_a") == ({} if used else {"too_old": 1})
    if not used:
        assert "robot_a" not in team.closed.poses
        assert team.closed.left_out["robot_a"] == (
            f"scan is {age / 1000:.3f} s older than the newest; allowed: 0.25 s"
        )
    assert team.close(2500) is None  # it is used up


def test_scan_older_than_the_last_interval_is_dropped():
    """It arrives by itself, without a newer one in its interval."""
    team = live_team(*THREE)
    for robot in THREE:
        team.scan(robot, 5000)
    assert len(team.close(5000)) == 3
    for now in range(5200, 7000, 200):
        for robot in ("robot_a", "robot_c"):
            team.scan(robot, now)
        assert team.close(now + 100) == {"robot_a": now, "robot_c": now}
    # 4 s ago it was stopped, and what it had in its hands comes first.
    team.scan("robot_b", 5200, now=6900)
    assert team.close(6900) is None
    assert team.close(7099) is None  # it makes no interval by itself
    for robot in ("robot_a", "robot_c"):
        team.scan(robot, 7100)
    assert team.close(7100) == {"robot_a": 7100, "robot_c": 7100}
    assert dict(team.closed.left_out) == {
        "robot_b": "scan is 1.900 s older than the newest; allowed: 0.25 s"
    }
    assert team.dropped("robot_b") == {"too_old": 1}
    team.scan("robot_b", 7110)
    assert team.close(7210) == {"robot_b": 7110}


def seen(
    team: Team,
    *,
    late: dict[str, float],
    until: float,
    phase: float = 0.0,
    ends: dict[str, float] | None = None,
) -> list[dict]:
    """Intervals of a team at 5 Hz, whose robots' messages are late from 3000 on [ms].

    Poses come as late as scans. robot_b's camera is `phase` behind the others'. `ends` says when
    robots die.
    """
    arrivals = []
    for robot in team.collector.robots:
        begin = 1000 + (phase if robot == "robot_b" else 0)
        for k in range(int((until - begin) / 200)):
            stamp = begin + 200 * k
            delay = 5 + (late.get(robot, 0) if stamp >= 3000 else 0)
            if stamp < (ends or {}).get(robot, until):
                arrivals.append((stamp + delay, robot, stamp))
    intervals, order = [], sorted(arrivals)
    for now in range(1000, int(until), 5):
        while order and order[0][0] <= now:
            at, robot, stamp = order.pop(0)
            pose = Pose(round((stamp + 1) * MS), 0.0, 0.0, 0.0)
            team.collector.add_pose(robot, pose, round(at * MS))
            team.scan(robot, stamp, now=at)
        used = team.close(now)
        if used:
            intervals.append({"now": now, "time": team.closed.time_ns / MS, **used})
    return intervals


@pytest.mark.parametrize("late", [3200, 3250])
def test_suddenly_late_messages_do_not_set_people_back(late):
    team = Team(known=THREE)
    intervals = seen(team, late={"robot_b": late}, until=20_000)
    times = [each["time"] for each in intervals]
    assert times == sorted(times)
    assert all(each["time"] - min(each[r] for r in THREE if r in each) <= 250 for each in intervals)
    assert not any("robot_b" in each for each in intervals if each["now"] > 3000 + 250)
    others = [each for each in intervals if each["now"] > 6500]
    assert len(others) == pytest.approx(5 * 13.5, abs=2)
    assert all({"robot_a", "robot_c"} < each.keys() for each in others)  # and they wait for nobody
    dropped = team.dropped("robot_b")
    assert dropped["too_old"] > 10
    assert dropped["clock_offset"] > 10  # after ten seconds it is its clock that is behind


@pytest.mark.parametrize("late", [2500, 3200, 3400, 8000, 30_000])
@pytest.mark.parametrize("lived", [0, 2000, 9000])
def test_late_robot_left_alone_does_not_set_time_back(late, lived):
    """Its scans are used again once they are not too old relative to the last interval."""
    team, died = Team(known=("robot_a", "robot_b")), 3000 + lived
    intervals = seen(team, late={"robot_b": late}, until=died + 45_000, ends={"robot_a": died})
    times = [each["time"] for each in intervals]
    assert times == sorted(times)
    last = max(each["robot_a"] for each in intervals if "robot_a" in each)
    after = [each for each in intervals if "robot_a" not in each and each["now"] > died + 200]
    assert all(each["robot_b"] >= last - 250 for each in after)
    assert after[0]["now"] < max(last + late, died + 2000) + 250  # it is soon of use
    now = [each["now"] for each in after]
    assert max(y - x for x, y in itertools.pairwise(now)) <= 300  # and remains so
    assert max(times.count(time) for time in times) <= 3  # nor does it stand for longer than that


def test_late_newcomer_after_the_others_left_does_not_set_time_back():
    team = Team(known=("robot_a",))
    last = seen(team, late={}, until=10_000)[-1]["time"]
    used = []
    for now in range(13_000, 18_000, 200):
        stamp = now - 5000
        team.collector.add_pose("robot_b", Pose(stamp * MS, 0.0, 0.0, 0.0), now * MS)
        team.scan("robot_b", stamp, now=now)
        if team.close(now + 100):
            used.append(team.closed.time_ns / MS)
    assert used == sorted(used)
    assert used[0] >= last


def test_old_recording_after_the_team_has_left_resets_the_state():
    """Its robots differ, so that no robot's stamps jump back."""
    team = Team(known=("robot_a",))
    for now in range(200_000, 205_000, 200):
        team.pose("robot_a", now)
        team.scan("robot_a", now)
        assert team.close(now)
    for now in range(208_000, 300_000, 200):
        stamp = now - 150_000
        team.collector.add_pose("robot_b", Pose(stamp * MS, 0.0, 0.0, 0.0), now * MS)
        team.scan("robot_b", stamp, now=now)
        assert (team.close(now) or team.close(now + 100)) == {"robot_b": stamp}
        assert team.closed.time_ns == stamp * MS


def test_robot_silent_before_a_reset_makes_no_later_scan_old():
    """robot_b is heard only in the first pass of a recording."""
    team = live_team("robot_a", "robot_b")
    for now in range(1100, 9001, 100):
        team.scan("robot_a", now)
        if now < 4000:
            team.scan("robot_b", now)
        assert team.close(now) or now < 6200
        team.close(now + 99)
    stamps_jump(team, 8000, "robot_a", at=9100)
    assert team.close(9300) == {"robot_a": 1300}
    for now in range(1400, 9000, 100):
        team.scan("robot_a", now, now=now + 8000)
        assert team.close(now + 8000) == {"robot_a": now}
        assert team.closed.time_ns == now * MS


@pytest.mark.parametrize("phase", [0, 50, 100, 150])
@pytest.mark.parametrize(("late", "used"), [(200, 1.0), (205, 0.0)])
def test_scans_up_to_the_documented_delay_are_used(late, used, phase):
    """The limit documented in docs/network.md: interval.max_clock_offset."""
    team = Team(known=THREE)
    intervals = seen(team, late={"robot_b": late}, until=30_000, phase=phase)
    late_ones = [each for each in intervals if 15_000 <= each["now"] < 29_000]
    assert sum("robot_b" in each for each in late_ones) == pytest.approx(70 * used, abs=2)
    times = [each["time"] for each in intervals]
    assert times == sorted(times)


def test_interval_of_late_scans_has_the_time_of_the_last_interval():
    team = live_team("robot_a", "robot_b")
    team.scan("robot_a", 2000)
    assert team.close(2100) == {"robot_a": 2000}
    team.scan("robot_b", 1900, now=2110)
    assert team.close(2210) == {"robot_b": 1900}
    assert team.closed.time_ns == 2000 * MS
    assert team.closed.poses["robot_b"].stamp_ns == 1900 * MS


@pytest.mark.parametrize("together", [True, False])
def test_jump_back_of_all_stamps_resets_the_intervals(together):
    """A recording that loops, or robots whose clocks are set back one after the other."""
    team = Team(known=THREE)
    times = []
    for now in range(200_000, 212_000, 200):
        for number, robot in enumerate(THREE):
            again = 204_000 + (0 if together else 1000 * number)
            stamp = now - (4000 if now >= again else 0)
            with contextlib.suppress(ScanError, PoseError):
                team.collector.add_pose(robot, Pose(stamp * MS, 0.0, 0.0, 0.0), now * MS)
            with contextlib.suppress(ScanError):
                team.scan(robot, stamp, now=now)
        used = team.close(now) or team.close(now + 100)
        if used:
            times.append(team.closed.time_ns / MS)
    back = [k for k in range(1, len(times)) if times[k] < times[k - 1]]
    assert len(back) == 1
    assert times[-1] == 211_800 - 4000
    assert used == dict.fromkeys(THREE, 207_800)


def test_first_robot_with_a_wrong_clock_makes_no_other_scan_old():
    """The first robot's clock is an hour ahead; the second one's is right."""
    team = Team()
    hour = 3_600_000
    for now in range(10_000, 16_000, 200):
        for robot, ahead in (("robot_b", hour), ("robot_a", 0)):
            if robot == "robot_b" or now >= 13_000:
                stamp = (now + ahead) * MS
                team.collector.add_pose(robot, Pose(stamp, 0.0, 0.0, 0.0), now * MS)
                team.scan(robot, now + ahead, now=now)
        used = team.close(now)
        if now > 13_200:
            assert used == {"robot_a": now}
            assert team.closed.time_ns == now * MS


def test_scan_without_poses_is_dropped_after_waiting():
    team = Team("robot_a")
    team.scan("robot_b", 1000)
    team.scan("robot_a", 1000)
    assert team.close(1000) is None
    assert team.close(1100) == {"robot_a": 1000}
    assert dict(team.closed.left_out) == {"robot_b": "no pose has arrived"}
    assert team.dropped("robot_b") == {"no_pose": 1}


def test_interval_without_usable_scans_is_empty():
    team = Team()
    team.scan("robot_a", 1000)
    assert team.close(1099) is None
    assert team.close(1100) == {}
    assert team.closed.time_ns == 1000 * MS
    assert dict(team.closed.poses) == {}
    assert dict(team.closed.left_out) == {"robot_a": "no pose has arrived"}
    assert team.dropped("robot_a") == {"no_pose": 1}
    assert team.close(1200) is None
    assert team.dropped("robot_a") == {"no_pose": 1}  # it was used up
    with pytest.raises(ScanError, match="wanted: newer than 1000000000"):
        team.scan("robot_a", 1000)


def test_interval_has_the_time_of_its_newest_used_scan():
    team = Team("robot_a")
    team.scan("robot_a", 1000)
    team.scan("robot_b", 1050)  # it has no pose
    assert team.close(1200) == {"robot_a": 1000}
    assert team.closed.time_ns == 1000 * MS


def test_interval_waits_for_a_later_pose():
    team = Team()
    team.pose("robot_a", 980)
    team.scan("robot_a", 1000)
    assert team.close(1010) is None
    team.pose("robot_a", 990)
    assert team.close(1020) is None
    team.pose("robot_a", 1000)
    assert team.close(1021) == {"robot_a": 1000}


@pytest.mark.parametrize(("age", "used"), [(200, True), (200.000001, False)])
def test_last_pose_is_used_up_to_max_pose_age(age, used):
    team = Team()
    team.pose("robot_a", 1000)
    team.scan("robot_a", 1000 + age)
    assert team.close(1000 + age) is None
    assert team.close(2000) == ({"robot_a": 1000 + age} if used else {})
    assert team.dropped("robot_a") == ({} if used else {"no_pose": 1})


def test_interval_does_not_wait_for_a_silent_robot():
    team = live_team("robot_a", "robot_b")
    team.scan("robot_a", 2900)
    assert team.close(2900) is None  # robot_b was heard 1.9 s ago
    assert team.close(3000) == {"robot_a": 2900}
    team.scan("robot_a", 2950, now=3000)
    assert team.close(3000) is None  # 2 s
    assert team.close(3000.000001) == {"robot_a": 2950}
    team.scan("robot_a", 4000)
    again = team.collector.close(4000 * MS, ["robot_b"])
    assert again is not None
    assert [scan.robot for scan in again.scans] == ["robot_a"]
    # It counts again with its next scan.
    team.scan("robot_b", 4100)
    team.scan("robot_a", 4100)
    assert team.close(4100) == {"robot_a": 4100, "robot_b": 4100}
    team.scan("robot_a", 4200)
    assert team.close(4200) is None


def test_interval_waits_for_a_known_robot_from_the_start():
    for team in (Team("robot_a", "robot_b"), Team("robot_a", known=["robot_b"])):
        team.scan("robot_a", 1000, now=9000)
        assert team.close(9000) is None  # robot_b sent a pose, or was named at the beginning
        assert team.close(9100) == {"robot_a": 1000}
        team.scan("robot_a", 2000, now=10_950)
        assert team.close(11_000) is None  # ... and nothing else, for 2 s
        assert team.close(11_000.000001) == {"robot_a": 2000}


def test_interval_waits_for_a_new_robot_from_its_first_scan_on():
    team = live_team("robot_a")
    for at in range(0, 5001, 100):
        team.pose("robot_b", at)
    team.scan("robot_a", 1200)
    assert team.close(1200) == {"robot_a": 1200}
    team.scan("robot_b", 1250)
    assert team.close(1250) is None
    team.scan("robot_a", 1260)
    assert team.close(1260) == {"robot_a": 1260, "robot_b": 1250}


@pytest.mark.parametrize("late", [0, 0.000001, 500, 1000])
@pytest.mark.parametrize("used", [True, False])
def test_repeated_and_late_scans_are_refused(late, used):
    team = Team("robot_a")
    team.scan("robot_a", 2000)
    if used:
        assert team.close(2000)
    stamp = round((2000 - late) * MS)
    with pytest.raises(ScanError, match=f"stamp is {stamp} ns; wanted: newer than 2000000000 ns"):
        team.scan("robot_a", 2000 - late, now=2001)
    assert team.collector.robot("robot_a").order.resets == 0
    assert team.close(2101) == (None if used else {"robot_a": 2000})


def test_a_repeated_pose_is_refused():
    team = Team("robot_a")
    with pytest.raises(PoseError, match="stamp 20000000000 ns is repeated"):
        team.pose("robot_a", 20_000)


@pytest.mark.parametrize("used", [True, False])
def test_stamps_that_jump_back_reset_the_state(used):
    team = Team("robot_a")
    team.scan("robot_a", 9000)
    if used:
        assert team.close(9000)
    for stamp in (7990, 7995):  # one or two may be late
        with pytest.raises(ScanError):
            team.scan("robot_a", stamp, now=9040)
    team.scan("robot_a", 7999, now=9050)
    assert team.collector.robot("robot_a").order.resets == 1
    assert team.close(9050) == {"robot_a": 7999}
    team.scan("robot_a", 8100, now=9100)
    assert team.close(9100) == {"robot_a": 8100}


def test_clock_set_back_slightly_causes_no_long_delay():
    team = live_team("robot_a", "robot_b")
    team.scan("robot_a", 1200)
    assert team.close(700) is None
    assert team.close(799) is None
    assert team.close(800) == {"robot_a": 1200}
    # robot_a was heard "in the future": also this is forgotten, so that it times out.
    team.scan("robot_b", 2801, now=2801)
    assert team.close(2801) == {"robot_b": 2801}


def test_clock_that_jumps_back_resets_the_state():
    """As when a bag loops: waiting scans belong to another time."""
    team = live_team(*THREE)
    team.scan("robot_a", 9000)
    assert team.close(0) is None
    for robot in THREE:
        assert len(team.collector.robot(robot).poses) == 0
        for at in (400, 500):
            team.pose(robot, at)
        team.scan(robot, 500)
    assert team.close(500) == dict.fromkeys(THREE, 500)
    assert team.dropped("robot_a") == {}


def stamps_jump(team: Team, by: float, *robots: str, at: float) -> None:
    """The stamps of robots jump back, and the planner's clock goes on: three scans say so."""
    for robot in robots:
        for step in (0, 100):
            with pytest.raises(ScanError):
                team.scan(robot, at - by + step, now=at + step)
        team.scan(robot, at - by + 200, now=at + 200)


def test_jump_back_of_all_stamps_resets_the_team():
    """A bag that loops, without /clock. A robot silent before does not delay the others."""
    team = live_team(*THREE)
    for now in range(7000, 9001, 100):  # robot_c is silent
        for robot in THREE[:2]:
            team.scan(robot, now)
        assert team.close(now + 100)
    assert team.closed.others["robot_c"].x == 9.0
    stamps_jump(team, 5000, "robot_a", at=9100)
    assert not team.close(9400)  # not all of them, so far
    stamps_jump(team, 5000, "robot_b", at=9100)
    team.scan("robot_a", 4400, now=9400)
    assert team.close(9400) == {"robot_a": 4400, "robot_b": 4300}
    assert "robot_c" not in team.closed.others  # where it was is of another time
    for now in range(4500, 9400, 100):
        for robot in THREE[:2]:
            team.scan(robot, now, now=now + 5000)
        assert team.close(now + 5000) == {"robot_a": now, "robot_b": now}


@pytest.mark.parametrize("by", [1300, 60_000])
def test_stamps_of_one_robot_that_jump_back_do_not_set_time_back(by):
    """Also if the others' scans arrive slightly later, and an interval closes without them."""
    team = live_team(*THREE)
    last = 1000.0
    for now in range(62_000, 66_000, 100):
        if now == 62_000:
            for robot in THREE:
                team.pose(robot, now - 50)
                team.scan(robot, now - 50)
            assert team.close(now - 50)
        with contextlib.suppress(ScanError):
            team.scan("robot_c", now - by, now=now)
        closed = team.close(now + 100)
        assert not closed
        for robot in THREE[:2]:
            team.pose(robot, now + 10)
            team.scan(robot, now + 10, now=now + 110)
        closed = team.close(now + 110) or team.close(now + 230)
        assert closed == dict.fromkeys(THREE[:2], now + 10)
        assert team.closed.time_ns > last
        last = team.closed.time_ns
    assert sum(team.dropped("robot_c").values()) > 30


def clocks(**ahead: float) -> Team:
    """A team whose robots' clocks are ahead of the planner's [ms], two seconds long."""
    team = Team(*ahead)
    for now in (0, 1000, 2000):
        for robot, offset in ahead.items():
            team.scan(robot, now + offset, now=now)
    return team


@pytest.mark.parametrize("offset", [-1900, -300, 300, 8000])
def test_robot_with_a_wrong_clock_is_excluded(offset):
    team = clocks(robot_a=-10, robot_b=-30, robot_c=offset)
    assert team.close(2000) == {"robot_a": 1990, "robot_b": 1970}
    assert team.closed.time_ns == 1990 * MS
    side = "ahead of" if offset > 0 else "behind"
    assert dict(team.closed.left_out) == {
        "robot_c": f"its clock is {abs(offset + 10) / 1000:.3f} s {side} the others'; "
        "allowed: 0.2 s"
    }
    assert team.dropped("robot_c") == {"superseded": 2, "clock_offset": 1}
    assert team.collector.clock_offsets(2000 * MS)["robot_c"] == offset * MS
    assert list(team.collector.clocks_astray(2000 * MS)) == ["robot_c"]


def test_position_of_a_robot_with_a_wrong_clock_is_known():
    """The others may see it: its position is that at their time, by its own clock."""
    team = clocks(robot_a=0, robot_b=3000)
    assert team.close(2000) == {"robot_a": 2000}
    assert team.closed.others["robot_b"].stamp_ns == 5000 * MS


@pytest.mark.parametrize("offset", [-190, 190])
def test_small_clock_offset_is_accepted(offset):
    team = clocks(robot_a=0, robot_b=offset)
    assert team.close(2000) == {"robot_a": 2000, "robot_b": 2000 + offset}


@pytest.mark.parametrize("offset", [-1e9, -5000, 5000])
def test_equally_wrong_clocks_agree(offset):
    """The planner's own is off, or a recording is played."""
    team = Team()
    for robot, more in {"robot_a": 0, "robot_b": -150}.items():
        stamp = 2e9 + offset + more
        team.pose(robot, stamp)
        team.scan(robot, stamp, now=2e9)
    assert len(team.close(2e9)) == 2
    assert team.collector.clocks_astray(round(2e9 * MS)) == {}


def test_corrected_clock_is_used_again():
    for offset in (3000, -1500):
        team = clocks(robot_a=0, robot_b=offset)
        assert team.close(2000) == {"robot_a": 2000}
        for now in range(2100, 4300, 100):
            team.scan("robot_a", now)
            with contextlib.suppress(ScanError):  # set back: not believed at once
                team.scan("robot_b", now)
            last = team.close(now)
        assert last == {"robot_a": 4200, "robot_b": 4200}


def test_single_late_message_does_not_make_a_clock_slow():
    team = live_team("robot_a", "robot_b")
    team.scan("robot_a", 1400, now=1800)
    team.scan("robot_b", 1800)
    assert team.close(1800) == {"robot_b": 1800}
    assert team.dropped("robot_a") == {"too_old": 1}
    assert team.collector.clocks_astray(1800 * MS) == {}


def test_poses_contribute_to_the_clock_offset():
    collector = IntervalCollector(CONFIG)
    collector.add_pose("robot_a", Pose(5000 * MS, 0.0, 0.0, 0.0), 2000 * MS)
    assert collector.clock_offsets(2000 * MS) == {"robot_a": 3000 * MS}
    assert collector.clock_offsets(11_900 * MS) == {"robot_a": 3000 * MS}
    assert collector.clock_offsets(12_000 * MS) == {}


@pytest.mark.parametrize("ahead", [300, 5000])
def test_clock_that_is_ahead_is_detected_at_once(ahead):
    """The planner has just started: already the first interval is that of the others."""
    team = Team("robot_a", "robot_b")
    team.scan("robot_b", 1000 + ahead, now=1010)
    team.scan("robot_a", 1000, now=1020)
    assert team.close(1020) == {"robot_a": 1000}
    assert list(team.closed.left_out) == ["robot_b"]


def test_clock_slightly_ahead_makes_no_other_scan_old():
    team = Team("robot_a", "robot_b")
    for now in range(25_000, 28_000, 100):
        for robot, stamp in (("robot_a", now + 150), ("robot_b", now - 10)):
            pose = Pose(stamp * MS, 0.0, 0.0, 0.0)
            team.collector.add_pose(robot, pose, now * MS)
        team.scan("robot_a", now + 150, now=now)
        team.scan("robot_b", now - 120, now=now)  # 270 ms older by the stamps, 110 ms in truth
        closed = team.close(now + 100)
    assert closed == {"robot_a": 28_050, "robot_b": 27_780}


def test_joint_jump_of_all_stamps_is_accepted():
    """From an old recording to live data."""
    team = Team()
    for now in range(200_000, 206_000, 100):
        stamp = now - (100_000 if now < 203_000 else 0)
        for robot in ("robot_a", "robot_b"):
            pose = Pose(stamp * MS, 0.0, 0.0, 0.0)
            team.collector.add_pose(robot, pose, now * MS)
            team.scan(robot, stamp, now=now)
        assert team.close(now) == {"robot_a": stamp, "robot_b": stamp}


def test_single_wrong_stamp_excludes_only_its_own_scan():
    for wrong in (300, 900):
        team = live_team("robot_a", "robot_b")
        for now in range(1100, 4000, 100):
            team.scan("robot_b", now)
            with contextlib.suppress(ScanError):  # until the others are newer than the wrong one
                team.scan("robot_a", now + (wrong if now == 1500 else 0), now=now)
            closed = team.close(now)
            if now == 1500:
                assert closed == {"robot_b": now}
                assert list(team.closed.left_out) == ["robot_a"]
            elif closed is not None and (now < 1500 or now > 1500 + wrong):
                assert closed == {"robot_a": now, "robot_b": now}
        assert team.dropped("robot_a")["clock_offset"] == 1


def test_last_position_of_a_silent_robot_grows_uncertain_and_expires():
    """It was killed, or moves without sending: after a while its last position is not masked."""
    team = Team(known=["robot_b"])
    for at in (900, 1000):
        team.pose("robot_b", at, x=7.0)
    for now, sigma in ((1000.0, 0.0), (1200.0, 0.5 * 0.2**2), (1500.0, 0.5), (3000.0, 2.0)):
        team.scan("robot_a", now)
        team.pose("robot_a", now)
        assert team.close(now + 100) == {"robot_a": now}
        last = team.closed.others["robot_b"]
        assert (last.x, last.stamp_ns) == (pytest.approx(7.0), now * MS)
        assert last.covariance[0, 0] == pytest.approx(sigma**2)
    for now in (3000.001, 60_000, 700_000):
        team.scan("robot_a", now)
        team.pose("robot_a", now)
        assert team.close(now + 100) == {"robot_a": now}
        assert team.closed.all_poses.keys() == {"robot_a"}


def test_a_robot_that_is_silent_for_ten_minutes_is_forgotten():
    team = Team("robot_a", known=["robot_c"])
    team.scan("robot_b", 0)
    for minute in range(12):
        team.scan("robot_a", 1 + 60_000 * minute)
        team.close(1000 + 60_000 * minute)
        assert ("robot_b" in team.collector.robots) == (minute <= 9)
    assert list(team.collector.robots) == ["robot_c", "robot_a"]


def test_robots_are_created_when_first_named():
    collector = IntervalCollector(CONFIG)
    assert collector.robots == {}
    assert list(IntervalCollector(CONFIG, ["robot_b", "robot_a"]).robots) == ["robot_b", "robot_a"]
    state = collector.robot("robot_a")
    assert collector.robot("robot_a") is state
    assert (state.pending, state.used_ns, state.heard_ns) == (None, None, None)


def test_robots_are_apart_by_the_distance_of_the_nearest():
    team = Team()
    team.pose("robot_a", 0, x=0.0)
    assert team.collector.apart_m("robot_a") is None  # alone
    team.pose("robot_b", 0, x=5.0)
    team.pose("robot_c", 0, x=-2.0)
    assert [team.collector.apart_m(name) for name in THREE] == [2.0, 5.0, 2.0]
    team.pose("robot_c", 100, x=-9.0)
    assert [team.collector.apart_m(name) for name in THREE] == [5.0, 5.0, 9.0]
    assert team.collector.apart_m("robot_d") is None  # nothing is known of it


# --- quarantine -----------------------------------------------------------------------------------


def played(offsets: dict[str, int], quarantined: Sequence[str] = ()) -> list[tuple[Any, ...]]:
    """What closes while robots scan every 100 ms at offsets [ms], and one of them falls silent.

    Returns:
        Of each interval when it closes and its time [ms], its scans, and whose poses are known.
    """
    team, log = Team(*offsets), []
    for now in range(1000, 6000, 10):
        for robot, offset in offsets.items():
            if now % 100 == offset and not (robot == "robot_a" and 2000 < now < 5000):
                team.scan(robot, now)
        closed = team.collector.close(now * MS, quarantined)
        if closed is not None and closed.scans:
            scans = {scan.robot: scan.stamp_ns // MS for scan in closed.scans}
            log.append((now, closed.time_ns // MS, scans, set(closed.all_poses)))
            assert closed.quarantined == tuple(quarantined)
            assert {scan.robot for scan in closed.apart} <= set(quarantined)
    return log


@pytest.mark.parametrize("offset", range(0, 100, 10))
def test_intervals_are_as_without_a_robot_in_quarantine(offset):
    others = {"robot_a": 0, "robot_b": 40}
    assert played({"robot_c": offset, **others}, ["robot_c"]) == played(others)


def test_scans_of_a_robot_in_quarantine_are_apart():
    team = live_team(*THREE)
    for robot in THREE:
        team.scan(robot, 1100)
    closed = team.collector.close(1100 * MS, ["robot_b"])
    assert closed is not None
    assert [scan.robot for scan in closed.scans] == ["robot_a", "robot_c"]
    assert [scan.robot for scan in closed.apart] == ["robot_b"]
    assert closed.quarantined == ("robot_b",)
    assert closed.all_poses.keys() == {"robot_a", "robot_c"}
    assert closed.everywhere.keys() == set(THREE)
    team.scan("robot_a", 1150)
    alone = team.collector.close(1250 * MS, ["robot_b"])
    assert alone is not None
    assert (list(alone.poses), list(alone.others)) == (["robot_a"], ["robot_c"])
    assert alone.apart == ()
    assert alone.everywhere.keys() == set(THREE)  # any of them may be what robot_a sees
    for robot in THREE:
        team.scan(robot, 1200)
    assert team.close(1200) == dict.fromkeys(THREE, 1200)  # it is back
    assert team.closed.quarantined == team.closed.apart == ()


def test_robot_in_quarantine_that_is_alone_makes_intervals_without_scans():
    team = live_team("robot_a", "robot_b")
    closed = []
    for now in range(1100, 4000, 100):
        team.scan("robot_b", now)
        closed.append(team.collector.close(now * MS, ["robot_b", "robot_c"]))
    assert closed[:19] == [None] * 19  # the other one is waited for, until it is silent
    for one in closed[20:]:
        assert one is not None
        assert (one.scans, one.quarantined) == ((), ("robot_b",))
        assert len(one.apart) == 1
    team.scan("robot_a", 4000)
    again = team.collector.close(4000 * MS, ["robot_b"])
    assert again is not None
    assert [scan.robot for scan in again.scans] == ["robot_a"]

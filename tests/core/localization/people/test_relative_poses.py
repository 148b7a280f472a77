import math
from collections import Counter
from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from core.localization.people.test_alignment import places
from mrs_people_loc.geometry import rotation_2d, wrap_angle
from mrs_people_loc.localization.people.alignment import align
from mrs_people_loc.localization.people.relative_poses import RELATIVE_POSES_TUNING, RelativePoses
from mrs_people_loc.localization.people.seen_people import SeenPeople
from mrs_people_loc.localization.people.window_tracks import TracksTuning, tracks_of
from mrs_people_loc.localization.shared import StandingPeople
from mrs_people_loc.team.poses import Pose

#: Standard deviations along and across the line of sight [m].
ALONG, ACROSS = 0.08, 0.04
ROUGH = (1.0, 1.0, math.radians(15.0))


@dataclass
class Team:
    """Robots that drive with people, and see them with errors.

    Attributes:
        people: Where they are at first [m], shape (n, 2).
        robots: By name x, y [m] and yaw [rad] at first, in the frame of the group.
        velocity: Of all, in the map [m/s].
        reported: By robot, what its pose is wrong by: x, y, yaw.
        sigmas: What the poses say that they may be wrong by.
        late_s: By robot, how much later its scans are [s].
        unseen: By robot, people whom it does not see.
        lasting: Share of the variance of the errors that lasts.
        lasts_s: For how long [s]: its correlation falls to 1 / e.
        noise: Standard deviations of the errors over those that are stated.
        ghosts: Places per scan where nobody is.
        stated: Standard deviations of the errors along and across the line of sight [m].
    """

    people: np.ndarray
    robots: dict
    velocity: tuple = (0.0, 0.0)
    reported: dict = field(default_factory=dict)
    sigmas: tuple = (0.0, 0.0, 0.0)
    late_s: dict = field(default_factory=dict)
    unseen: dict = field(default_factory=dict)
    lasting: float = 0.35
    lasts_s: float = 4.0
    noise: float = 1.0
    ghosts: float = 0.0
    stated: tuple = (ALONG, ACROSS)
    seed: int = 0
    #: Velocity of the people past the robots [m/s].
    pass_by: tuple = (0.0, 0.0)

    def __post_init__(self):
        self.random = np.random.default_rng(self.seed)
        shape = len(self.people), 2
        self.biases = {name: (0.0, self.random.standard_normal(shape)) for name in self.robots}
        self.phase, self.pace = (
            self.random.uniform(0, 6.28, shape),
            self.random.uniform(1, 2, shape),
        )
        self.swing = 0.15 if any(self.velocity) else 0.0

    def true(self, name, t):
        x, y, yaw = self.robots[name]
        return np.array([x + self.velocity[0] * t, y + self.velocity[1] * t, yaw])

    def pose(self, name, t):
        """The pose that the robot reports: its way is turned and moved as a whole."""
        (x, y, yaw), (x0, y0, _) = self.true(name, t), self.true(name, 0.0)
        dx, dy, turn = self.reported.get(name, (0.0, 0.0, 0.0))
        x, y = rotation_2d(turn) @ (x - x0, y - y0) + (x0 + dx, y0 + dy)
        return Pose(round(t * 1e9), x, y, yaw + turn, np.diag(np.square(self.sigmas)))

    def where(self, t):
        walk = self.swing * np.sin(self.pace * t + self.phase)
        return self.people + np.add(self.velocity, self.pass_by) * t + walk

    def bias(self, name, t):
        """Errors that last, an Ornstein-Uhlenbeck process."""
        before, bias = self.biases[name]
        kept = math.exp(-abs(t - before) / self.lasts_s)
        bias = kept * bias + math.sqrt(1.0 - kept**2) * self.random.standard_normal(bias.shape)
        self.biases[name] = t, bias
        return bias

    def seen(self, name, t):
        x, y, yaw = self.true(name, t)
        who = [k for k in range(len(self.people)) if k not in self.unseen.get(name, ())]
        here = (self.where(t)[who] - (x, y)) @ rotation_2d(yaw)
        ghosts = self.random.uniform((1, -4), (7, 4), (self.random.poisson(self.ghosts), 2))
        here = np.concatenate([here, ghosts])
        sight = here / np.hypot(*here.T)[:, np.newaxis]
        axes = np.stack([sight, np.stack([-sight[:, 1], sight[:, 0]], 1)], axis=2)
        root = axes * self.stated
        bias = np.concatenate([self.bias(name, t)[who], np.zeros_like(ghosts)])
        white = self.random.standard_normal(here.shape)
        error = math.sqrt(self.lasting) * bias + math.sqrt(1.0 - self.lasting) * white
        places = here + self.noise * np.einsum("nij,nj->ni", root, error)
        return SeenPeople(round(t * 1e9), places, root @ root.transpose(0, 2, 1))

    def run(self, seconds, relative=None, *, rate=10.0, start=0.0):
        """All measurements, after so long."""
        relative = relative or RelativePoses()
        found = []
        for k in range(round(seconds * rate)):
            times = {name: start + k / rate + self.late_s.get(name, 0.0) for name in self.robots}
            seen = {name: self.seen(name, t) for name, t in times.items()}
            poses = {name: self.pose(name, t) for name, t in times.items()}
            found += relative.step(seen, poses)
        return found

    def error(self, measured):
        """What a measurement is wrong by: x, y, yaw."""
        one = self.true(measured.robot, measured.stamp_ns / 1e9)
        other = self.true(measured.other, measured.other_stamp_ns / 1e9)
        x, y = rotation_2d(-one[2]) @ (other - one)[:2]
        return np.array(
            [
                measured.pose[0] - x,
                measured.pose[1] - y,
                wrap_angle(measured.pose[2] - (other - one)[2]),
            ]
        )


FIVE = np.array([(3.0, 3.0), (3.2, 4.1), (4.5, 3.5), (4.1, 2.2), (2.0, 3.8)])
THREE_ROBOTS = {"a": (7.0, 3.5, math.pi), "b": (0.5, 2.0, 0.4), "c": (0.5, 5.0, -0.4)}
TWO_ROBOTS = {name: THREE_ROBOTS[name] for name in "ab"}


def draw(seed, robots=3, **options):
    """A team of five or six people and some robots about them."""
    random = np.random.default_rng(seed)
    people = FIVE + random.normal(0, 0.25, FIVE.shape)
    names = "abcdefgh"[:robots]
    angles = random.uniform(-0.3, 0.3, robots) + 2 * np.pi * np.arange(robots) / robots
    at = FIVE.mean(axis=0) + 3.5 * np.stack([np.cos(angles), np.sin(angles)], 1)
    poses = {n: (*xy, a + math.pi) for n, xy, a in zip(names, at.tolist(), angles, strict=True)}
    return Team(people, poses, seed=seed, **options)


# ----------------------------------------------------------------------------------- by hand ----


def test_relative_pose_by_hand():
    """b stands 7 m ahead of a, looks back, and reports to be 0.3 m farther to the left."""
    team = Team(
        np.array([(3.0, 0.0), (4.0, 1.5), (3.5, -1.0)]),
        {"a": (0.0, 0.0, 0.0), "b": (7.0, 0.0, math.pi)},
        reported={"b": (0.0, 0.3, 0.0)},
        noise=0.0,
    )
    (found,) = team.run(0.9)
    assert (found.robot, found.other) == ("a", "b")
    assert found.stamp_ns == found.other_stamp_ns == 700_000_000
    np.testing.assert_allclose(found.pose[:2], (7.0, 0.0), atol=1e-6)
    assert abs(found.pose[2]) == pytest.approx(math.pi, abs=1e-6)
    assert (np.linalg.eigvalsh(found.covariance) > 0).all()


def test_frame_is_the_first_robots_base_link():
    """a looks to the left of the map: b, 2 m ahead of it in y and 1 m in x, is to its right."""
    team = Team(
        np.array([(3.0, 3.0), (4.0, 4.5), (2.5, 4.0)]),
        {"a": (1.0, 0.0, math.pi / 2), "b": (2.0, 2.0, 0.0)},
        reported={"a": (0.1, 0.2, 0.05), "b": (-0.1, 0.1, 0.0)},
        noise=0.0,
    )
    (found,) = team.run(0.9)
    np.testing.assert_allclose(found.pose, (2.0, -1.0, -math.pi / 2), atol=1e-6)


def test_people_are_compared_at_one_time():
    """Both drive with people who walk at 1.2 m/s; b sees them 100 ms later, 12 cm farther."""
    team = Team(FIVE, TWO_ROBOTS, velocity=(1.2, 0.0), late_s={"b": 0.1}, noise=0.0)
    team.swing = 0.0
    (found,) = team.run(0.9)
    assert found.other_stamp_ns - found.stamp_ns == 100_000_000
    np.testing.assert_allclose(team.error(found), 0.0, atol=5e-3)


def test_robots_that_stand_while_people_pass():
    team = Team(FIVE, TWO_ROBOTS, late_s={"b": 0.06}, noise=0.0)
    team.pass_by = (0.6, -0.8)
    (found,) = team.run(0.9)
    np.testing.assert_allclose(team.error(found), 0.0, atol=5e-3)


def test_track_by_hand():
    """Seen at 1.0, 1.2 and 1.4 m, a scan every 0.1 s: at 1.3 m between the last two."""
    pose = Pose(0, 10.0, 0.0, math.pi / 2)
    seen = [
        (
            SeenPeople(k * 100_000_000, np.array([(1.0 + 0.2 * k, 0.0)]), 0.01 * np.eye(2)[None]),
            pose,
        )
        for k in range(3)
    ]
    tuning = TracksTuning(any_velocity=1e3, lasting=0.25, acceleration=0.0)
    tracks = tracks_of(seen, 150_000_000, tuning)
    np.testing.assert_allclose(tracks.xy, [(10.0, 1.3)], atol=1e-6)
    # A line through three places at -0.15, -0.05 and 0.05 s: variance s^2 (1/3 + 0.05^2 / 0.02).
    np.testing.assert_allclose(tracks.white, [0.0075 * (1 / 3 + 0.125) * np.eye(2)], atol=1e-6)
    np.testing.assert_allclose(tracks.lasting, [0.0025 * np.eye(2)], atol=1e-9)


def test_tracks_of_people_who_pass_each_other_and_are_missed():
    """Two walk 0.6 m apart in opposite directions; one is missed in the third scan."""
    pose, seen = Pose(0, 0.0, 0.0, 0.0), []
    for k in range(6):
        xy = np.array([(2.0 + 0.1 * k, 0.0), (2.5 - 0.1 * k, 0.6)])[: 1 if k == 2 else 2]
        cov = np.tile(0.0025 * np.eye(2), (len(xy), 1, 1))
        seen.append((SeenPeople(k * 100_000_000, xy, cov), pose))
    tracks = tracks_of(seen, 250_000_000)
    np.testing.assert_allclose(
        sorted(tracks.xy.tolist(), key=lambda p: p[1]), [(2.25, 0), (2.25, 0.6)], atol=0.01
    )


# -------------------------------------------------------------------------- errors and drift ----


@pytest.mark.slow
@pytest.mark.parametrize("robots", [2, 3])
def test_errors_are_as_large_as_stated(robots):
    """First measurements of 60 teams that walk: normalized squared errors of 3 on average.

    Errors are no larger than stated, and no less than half as large.
    """
    nees = []
    for seed in range(60):
        team = draw(seed, robots, velocity=(1.0, 0.3), late_s={"b": 0.07})
        for found in team.run(0.9):
            error = team.error(found)
            nees.append(error @ np.linalg.solve(found.covariance, error))
    assert len(nees) > 50
    assert 0.75 < np.mean(nees) < 3.3
    assert np.percentile(nees, 99) < 20.0


@pytest.mark.slow
@pytest.mark.parametrize(("lasts_s", "most"), [(4.0, 4.5), (1e6, 8.0)])
def test_many_windows_are_no_surer_than_they_may_be(lasts_s, most):
    """Weighted means of 20 s: normalized squared errors of 3, and not 30, if errors never end."""
    nees = []
    for seed in range(20):
        team = draw(seed, 2, velocity=(1.0, 0.0), lasts_s=lasts_s)
        found = team.run(20.0)
        information = [np.linalg.inv(one.covariance) for one in found]
        total = sum(information)
        weighted = [i @ team.error(one) for i, one in zip(information, found, strict=True)]
        mean = np.linalg.solve(total, sum(weighted))
        nees.append(mean @ total @ mean)
    assert np.mean(nees) < most


def test_robots_that_stand_for_long_are_no_surer():
    """Robots and people stand: the hundredth measurement tells hardly more than the first ten."""
    team = draw(3, 2)
    found = team.run(60.0)
    information = np.cumsum([np.linalg.inv(one.covariance)[0, 0] for one in found])
    assert len(found) > 70
    assert information[-1] < 3.0 * information[9]


def test_every_sighting_is_used_once():
    team = draw(1, 3, velocity=(1.0, 0.0))
    found = team.run(10.0)
    stamps = {
        pair: [o.stamp_ns for o in found if (o.robot, o.other) == pair]
        for pair in {(o.robot, o.other) for o in found}
    }
    assert sorted(stamps) == [("a", "b"), ("a", "c"), ("b", "c")]
    for of_pair in stamps.values():
        assert len(of_pair) > 8
        assert np.diff(of_pair).min() >= 700_000_000


@pytest.mark.parametrize("rate", [3.0, 30.0])
def test_other_rates(rate):
    team = draw(2, 2, velocity=(1.0, 0.0))
    found = team.run(6.0, rate=rate)
    assert len(found) >= 4
    assert max(np.hypot(*team.error(one)[:2]) for one in found) < 0.25


def test_ordinary_drift():
    team = draw(
        4, 3, velocity=(1.0, 0.0), reported={"b": (0.1, -0.1, 0.03)}, sigmas=(0.1, 0.1, 0.03)
    )
    found = team.run(5.0)
    assert len(found) > 15
    assert np.median([np.hypot(*team.error(one)[:2]) for one in found]) < 0.1


# ------------------------------------------------------------------------------ rough starts ----


@pytest.mark.slow
def test_rough_start():
    """Poses wrong by 1 m and 15 degrees, known to be: most are measured at once, none is wrong."""
    measured, wrong = 0, 0
    for seed in range(40):
        random = np.random.default_rng(seed)
        reported = {name: random.normal(0, ROUGH) * 0.7 for name in "abc"}
        team = draw(seed, 3, velocity=(0.7, 0.0), reported=reported, sigmas=ROUGH, ghosts=0.3)
        found = team.run(2.5)
        measured += len({(one.robot, one.other) for one in found})
        wrong += sum(np.hypot(*team.error(one)[:2]) > 0.5 for one in found)
    assert measured > 0.6 * 3 * 40
    assert wrong == 0


def test_pose_that_claims_to_be_exact_and_is_not():
    team = draw(5, 2, reported={"b": (0.4, -0.3, math.radians(7.0))}, velocity=(0.7, 0.0))
    found = team.run(3.0)
    assert len(found) >= 3
    assert max(np.hypot(*team.error(one)[:2]) for one in found) < 0.25


def test_row_of_people_is_ambiguous_where_poses_are_rough():
    """Six in a row, 1 m apart; a sees the first four, b the last four: any of them may match.

    That all four match is likeliest, and wrong. Of 80 windows hardly one takes it for sure.
    """
    row = np.array([(3.0, float(k)) for k in range(-2, 4)])
    robots = {"a": (0.0, 0.0, 0.0), "b": (0.0, 1.0, 0.0)}
    unseen = {"a": [4, 5], "b": [0, 1]}
    found = []
    for seed in range(20):
        found += Team(row, robots, unseen=unseen, sigmas=ROUGH, seed=seed).run(3.0)
    assert len(found) <= 2


def test_row_of_people_is_not_ambiguous_where_poses_are_known():
    row = np.array([(4.0, 1.4 * k) for k in range(-2, 4)])
    robots = {"a": (0.0, 0.0, 0.0), "b": (0.0, 1.0, 0.0)}
    team = Team(row, robots, unseen={"a": [5], "b": [0]}, sigmas=(0.05, 0.05, 0.02))
    found = team.run(5.0)
    assert len(found) >= 2
    assert max(np.hypot(*team.error(one)[:2]) for one in found) < 0.3


def test_two_people_and_poses_that_are_known():
    two = {"people": FIVE[:2] + [(0.0, 0.0), (0.5, 0.8)], "robots": TWO_ROBOTS}
    team = Team(**two, sigmas=(0.05, 0.05, 0.02))
    found = team.run(3.0)
    assert found
    assert max(abs(team.error(one)[2]) for one in found) < math.radians(15.0)
    assert Team(**two, sigmas=ROUGH).run(3.0) == []


def test_two_by_two_of_whom_each_robot_sees_another_row_are_not_the_same():
    """A pose that is wrong by how far the rows are apart would explain it, in every window."""
    own = places([(2.4, 0.92), (2.3, -0.07)], 0.042)
    others = replace(own, xy=own.xy + (0.6, 0.03))
    told, mistaken = (np.diag(np.square(s)) for s in ((0.17, 0.12, 0.04), (0.37, 0.35, 0.11)))
    tuning = RELATIVE_POSES_TUNING
    found = align(own, others, told, mistaken, wider=tuning.often_mistaken)
    assert found is not None
    assert not tuning.may_count(found)
    found = align(own, others, told, mistaken, wider=tuning.often_missed)
    assert found is not None
    assert tuning.may_count(found)


# ----------------------------------------------------------------------------------- refused ----


def test_robots_that_see_different_people_are_not_measured():
    for seed in range(10):
        people = np.random.default_rng(seed).uniform((1.0, -3.0), (7.0, 9.0), (10, 2))
        team = Team(
            people, TWO_ROBOTS, unseen={"a": range(5), "b": range(5, 10)}, sigmas=(0.1, 0.1, 0.03),
            seed=seed,
        )  # fmt: skip
        assert team.run(3.0) == []


def test_nobody_and_one_robot_give_nothing():
    assert Team(FIVE, TWO_ROBOTS, unseen={"b": range(5)}).run(3.0) == []
    assert Team(FIVE, {"a": THREE_ROBOTS["a"]}).run(3.0) == []
    assert RelativePoses().step({}, {}) == ()


def test_one_person_whom_both_see_tells_all_but_the_turn():
    """Robots of a tour with one visitor drift apart no more than they see."""
    off = (0.15, -0.1, 0.0)
    squared = []
    for seed in range(20):
        team = Team(
            FIVE[:1], TWO_ROBOTS, (0.7, 0.0), {"b": off}, sigmas=(0.1, 0.1, 0.02), seed=seed
        )
        found = team.run(6.0)
        assert len(found) >= 4
        for one in found:
            error = team.error(one)
            squared.append(error @ np.linalg.solve(one.covariance, error))
            assert one.covariance[2, 2] > 0.5  # the turn is unknown: this counts with the place
            assert np.hypot(*error[:2]) < 0.25
    assert np.mean(squared) < 3.0


def test_one_person_tells_nothing_where_poses_are_unsure():
    assert Team(FIVE[:1], TWO_ROBOTS, sigmas=(1.5, 1.5, 0.1)).run(6.0) == []


@pytest.mark.parametrize("seed", range(20))
def test_two_people_of_whom_each_robot_sees_another_are_not_taken_for_one(seed):
    two = np.array([(3.0, 3.0), (3.0, 3.9)])
    unseen = {"a": [0], "b": [1]}
    team = Team(two, TWO_ROBOTS, (0.7, 0.0), sigmas=(0.1, 0.1, 0.02), unseen=unseen, seed=seed)
    assert team.run(6.0) == []


def test_covariance_may_be_unknown():
    unknown = math.sqrt(np.finfo(float).max / 2.0)
    team = draw(6, 2, velocity=(0.7, 0.0), sigmas=(unknown, unknown, unknown))
    found = team.run(5.0)
    assert found
    assert max(np.hypot(*team.error(one)[:2]) for one in found) < 0.3


def test_covariance_relative_to_the_team_is_what_counts():
    """A team that has drifted by metres as a whole, and knows its shape."""
    of_shape, lost = draw(7, 3, sigmas=(0.1, 0.1, 0.03)), draw(7, 3, sigmas=(9.0, 9.0, 2.0))
    drawn = of_shape.pose
    of_shape.pose = lambda name, t: replace(
        drawn(name, t), covariance=lost.pose(name, t).covariance, in_team=drawn(name, t).covariance
    )
    told = draw(7, 3, sigmas=(0.1, 0.1, 0.03)).run(2.0)
    assert told
    for one, other in zip(of_shape.run(2.0), told, strict=True):
        np.testing.assert_array_equal(one.pose, other.pose)
        np.testing.assert_array_equal(one.covariance, other.covariance)


def test_robot_that_leaves_and_comes_back():
    team, relative = draw(7, 3, velocity=(0.5, 0.0)), RelativePoses()
    assert len({one.other for one in team.run(2.0, relative)}) == 2
    gone = team.robots.pop("c")
    team.run(1.0, relative, start=2.0)
    found = team.run(2.0, relative, start=3.0)
    assert {(one.robot, one.other) for one in found} == {("a", "b")}
    team.robots["c"] = gone
    assert len({one.other for one in team.run(2.0, relative, start=5.0)}) == 2


def test_reset_takes_older_stamps():
    team, relative = draw(8, 2), RelativePoses()
    assert team.run(3.0, relative, start=100.0)
    relative.reset()
    found = team.run(3.0, relative)
    assert found
    assert max(one.stamp_ns for one in found) < 3_000_000_000


@pytest.mark.slow
def test_pairs_of_many_robots_come_in_turn():
    """Eight robots are 28 pairs; 6 per window."""
    team, relative = draw(9, 8, velocity=(0.5, 0.0)), RelativePoses()
    pairs = Counter()
    for window in range(10):
        found = team.run(0.8, relative, start=0.8 * window)
        assert len(found) <= 6
        pairs.update((one.robot, one.other) for one in found)
    assert len(pairs) > 20
    assert max(pairs.values()) <= 3


# ------------------------------------------------------------------------ people who may stand ----


def standing(team, stands, seconds=3.0):
    """Who may stand, as measured of each robot; `stands`: by robot, who of those it sees."""
    relative, found = RelativePoses(), []
    for t in np.arange(0.0, seconds, 0.1):
        seen = {
            name: replace(team.seen(name, t), stands=np.array(who)) for name, who in stands.items()
        }
        poses = {name: team.pose(name, t) for name in stands}
        found += relative.step(seen, poses)
    return [one for one in found if isinstance(one, StandingPeople)]


def test_who_may_stand_is_told_of_a_robot_that_is_alone_once_a_window():
    team = Team(FIVE, {"b": THREE_ROBOTS["b"]}, noise=0.0)
    found = standing(team, {"b": [True, False, True, False, False]})
    assert len(found) == 3
    assert [one.stamp_ns for one in found] == [700_000_000, 1_500_000_000, 2_300_000_000]
    expected = (FIVE[[0, 2]] - THREE_ROBOTS["b"][:2]) @ rotation_2d(THREE_ROBOTS["b"][2])
    for one in found:
        assert one.robot == "b"
        np.testing.assert_allclose(one.xy, expected)
        # Of errors that last, each measurement tells what white noise of this variance would.
        assert one.inflated == pytest.approx(1.0 + 2.0 * 0.7 * 4.0 / 0.7)
        variances = np.linalg.eigvalsh(one.covariance)
        wanted = one.inflated * np.square([ACROSS, ALONG])
        np.testing.assert_allclose(variances, [wanted] * 2)


@pytest.mark.parametrize("who", [[False] * 5, []], ids=["walk", "unknown"])
def test_of_people_who_walk_or_may_walk_nothing_is_told(who):
    assert standing(Team(FIVE, {"b": THREE_ROBOTS["b"]}), {"b": who}) == []


def test_robots_that_share_people_tell_of_nobody_who_stands():
    """What they see is used already for where they are to each other."""
    everybody = [True] * 5
    assert standing(Team(FIVE, TWO_ROBOTS), dict.fromkeys("ab", everybody)) == []
    # One that shares nobody does, beside them.
    apart = {**TWO_ROBOTS, "c": (40.0, 0.0, 0.0)}
    team = Team(np.concatenate([FIVE, FIVE + (38.0, -3.0)]), apart)
    team.unseen = {"a": range(5, 10), "b": range(5, 10), "c": range(5)}
    found = standing(team, dict.fromkeys("abc", everybody))
    assert {one.robot for one in found} == {"c"}

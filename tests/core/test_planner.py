import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mrs_people_loc.bodies.joining import JoiningTuning
from mrs_people_loc.cells.splitting import SplittingTuning
from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.errors import PoseError, ScanError
from mrs_people_loc.following.groups import GroupsTuning
from mrs_people_loc.following.tracks import TracksTuning
from mrs_people_loc.geometry import wrap_angle
from mrs_people_loc.planner import People, Planner, PlannerTuning
from mrs_people_loc.scan import BODY_DTYPE, Cells, Scan
from mrs_people_loc.team.masking import MaskingTuning
from mrs_people_loc.team.poses import Pose

PI = math.pi
STRIDE = [0.1 * k for k in range(-2, 3)]
BODY = [(0.05 * i, 0.05 * j) for i in range(-3, 4) for j in range(-1, 2)]  # 0.3 x 0.1 m

# People on the map, and the robots: a looks back at them, b and c follow.
PEOPLE = [(3.0, 3.0), (3.0, 4.0), (4.5, 3.5)]
POSES = {
    "robot_a": Pose(0, 6.0, 3.5, PI, np.diag([0.01, 0.02, 0.001])),
    "robot_b": Pose(0, 0.5, 2.0, 0.4, np.diag([0.02, 0.01, 0.002])),
    "robot_c": Pose(0, 0.5, 5.0, -0.4),
}


def in_robot(pose: Pose, points) -> np.ndarray:
    """Points of the map in a robot's base_link."""
    c, s = math.cos(pose.yaw), math.sin(pose.yaw)
    return (np.array(points) - (pose.x, pose.y)) @ np.array([[c, -s], [s, c]])


@pytest.fixture(scope="session")
def scene(make_cells):
    """A scan of every robot: of each person a body around the place, and a low table."""

    def scan(robot: str, stamp: int) -> Scan:
        placed = [(x + dx, y + dy) for x, y in PEOPLE for dx, dy in BODY]
        table = [(1.0 + dx, 1.0 + dy) for dx, dy in BODY]
        top = [1.7] * len(placed) + [0.7] * len(table)
        return Scan(robot, stamp, make_cells(in_robot(POSES[robot], placed + table), top=top))

    return [scan(robot, stamp) for stamp, robot in enumerate(POSES)]


def step(scans, poses=None, time_ns=7) -> People:
    return Planner(PlannerConfig()).step(scans, POSES if poses is None else poses, time_ns)


def positions(people: People) -> np.ndarray:
    return np.array([person.position for person in people.persons]).reshape(-1, 2)


def test_people_of_a_scene_are_found(scene):
    people = step(scene)
    np.testing.assert_allclose(positions(people), PEOPLE, atol=1e-6)
    assert all(p.robots == ("robot_a", "robot_b", "robot_c") for p in people.persons)
    assert all(p.height == pytest.approx(1.7) for p in people.persons)
    assert len(people.clusters) == 4  # and the table
    assert people.stamp_ns == 7
    assert people.group is not None
    np.testing.assert_allclose(people.group.centre, (3.5, 3.5), atol=1e-6)
    assert people.group.size == 3
    assert len(people.fused) == 3 * 4 * len(BODY)
    stages = ["fusion", "masking", "joining", "clustering", "tracking", "groups"]
    assert list(people.times_ms) == stages


def test_result_has_its_scans_and_poses(scene):
    people = step(scene[:2])
    assert people.poses == {name: POSES[name] for name in ("robot_a", "robot_b")}
    assert people.fused.robots == ("robot_a", "robot_b")


def test_configuration_takes_effect(scene):
    for values, found in (
        ({"human.min_height": 0.5}, 4),
        ({"human.min_height": 1.8}, 0),
        ({"clustering.distance": 0.01}, 0),
        ({"clustering.distance": 0.75}, 3),
        ({"clustering.distance": 0.95, "splitting.max_width": 0, "human.max_width": 2.0}, 2),
        ({"clustering.distance": 0.95}, 3),  # two in a row are one cluster, and split
    ):
        planner = Planner(PlannerConfig.from_mapping(values))
        assert len(planner.step(scene, POSES, 0).persons) == found, values


@pytest.mark.parametrize("scans", [[], [Scan("robot_a", 0, Cells.empty())]])
def test_empty_scans_give_no_people(scans):
    people = step(scans, time_ns=5)
    assert people.persons == ()
    assert people.group is None
    assert len(people.clusters) == 0
    assert people.stamp_ns == 5
    assert list(people.poses) == [scan.robot for scan in scans]


def test_single_cell_is_not_a_person(make_cells):
    people = step([Scan("robot_a", 0, make_cells([(1, 1)]))])
    assert (len(people.clusters), people.persons) == (1, ())


def test_two_scans_of_one_robot_are_refused(scene):
    message = "two scans of one robot in an interval: robot_a, robot_b, robot_b"
    with pytest.raises(ScanError, match=message):
        step([scene[1], scene[0], scene[1]])


def test_a_robot_without_a_pose_is_refused(scene):
    with pytest.raises(PoseError, match="no pose for the scan of robot_a, robot_c"):
        step(scene, {"robot_b": POSES["robot_b"]})


@given(st.permutations(range(3)), st.randoms(use_true_random=False))
@settings(max_examples=30)
def test_order_of_scans_and_cells_does_not_matter(scene, order, random):
    def shuffled(scan: Scan) -> Scan:
        cells = random.sample(range(len(scan.cells)), len(scan.cells))
        return Scan(scan.robot, scan.stamp_ns, scan.cells.select(cells))

    one, other = step(scene), step([shuffled(scene[i]) for i in order])
    assert len(other.persons) == len(one.persons) == 3
    for a, b in zip(one.persons, other.persons, strict=True):
        np.testing.assert_allclose(b.position, a.position, atol=1e-12)
        np.testing.assert_allclose(b.covariance, a.covariance, atol=1e-12)
        assert (b.label, b.robots, b.height) == (a.label, a.robots, a.height)
        assert b.sigma == pytest.approx(a.sigma)
    np.testing.assert_array_equal(other.clusters.points, one.clusters.points)


@given(st.floats(-50, 50), st.floats(-50, 50), st.floats(-7, 7))
@settings(max_examples=50)
def test_people_move_with_the_map(scene, x, y, yaw):
    moved_map = Pose(0, x, y, yaw)
    moved_poses = {name: moved_map @ pose for name, pose in POSES.items()}
    before, after = step(scene), step(scene, moved_poses)

    c, s = math.cos(yaw), math.sin(yaw)
    rotation = np.array([[c, -s], [s, c]])
    by_place = {tuple(np.round(p.position, 4)): p for p in before.persons}
    assert len(after.persons) == len(by_place) == 3
    for person in after.persons:
        back = rotation.T @ (person.position - (x, y))
        old = by_place[tuple(np.round(back, 4))]
        np.testing.assert_allclose(back, old.position, atol=1e-9)
        np.testing.assert_allclose(
            person.covariance, rotation @ old.covariance @ rotation.T, atol=1e-9
        )
        assert (person.sigma, person.height) == pytest.approx((old.sigma, old.height))
        assert person.robots == old.robots
    assert before.group is not None
    assert after.group is not None
    np.testing.assert_allclose(after.group.centre, rotation @ before.group.centre + (x, y))
    assert after.group.radius == pytest.approx(before.group.radius)
    assert after.group.rms_spread == pytest.approx(before.group.rms_spread)


def test_wrong_heading_moves_distant_people(scene):
    # By 0.1 rad, about the robot's place; the person at (3, 4) is at (-3, 0.5) from there.
    people = step(scene[:1], {"robot_a": Pose(0, 6.0, 3.5, wrap_angle(PI + 0.1))})
    c, s = math.cos(0.1), math.sin(0.1)
    turned = (6.0 - 3.0 * c - 0.5 * s, 3.5 - 3.0 * s + 0.5 * c)
    assert np.linalg.norm(positions(people) - turned, axis=1).min() < 1e-6


def test_older_scans_have_larger_covariances(scene):
    """One robot observed them half a second before the interval: they may have walked 0.35 m."""
    old, fresh = scene[0], scene[1]
    memoryless = {"tracking.enabled": False}
    planner = Planner(PlannerConfig.from_mapping({"interval.walking_speed": 0.7, **memoryless}))

    def covariance(*scans: Scan) -> np.ndarray:
        return planner.step(scans, POSES, 500_000_000).persons[0].covariance

    def at(scan: Scan, stamp_ns: int) -> Scan:
        return Scan(scan.robot, stamp_ns, scan.cells)

    spread = covariance(at(old, 0)) - covariance(at(old, 500_000_000))
    np.testing.assert_allclose(spread, 0.35**2 * np.eye(2), atol=1e-12)
    # Of two robots the mean over both, divided by two, as what their poses are uncertain by.
    both = at(old, 0), at(fresh, 500_000_000)
    now = at(old, 500_000_000), at(fresh, 500_000_000)
    spread = covariance(*both) - covariance(*now)
    np.testing.assert_allclose(spread, 0.35**2 / 4 * np.eye(2), atol=1e-12)
    still = Planner(PlannerConfig.from_mapping({"interval.walking_speed": 0.0, **memoryless}))
    first, second = (still.step(scans, POSES, 500_000_000) for scans in (both, now))
    np.testing.assert_array_equal(first.persons[0].covariance, second.persons[0].covariance)
    assert first.poses == {name: POSES[name] for name in ("robot_a", "robot_b")}


def tuned(scan: Scan, **tuning) -> People:
    """One interval without memory, of a planner with these constants."""
    config = PlannerConfig.from_mapping({"tracking.enabled": False})
    poses = {"robot_a": Pose(0, 0.0, 0.0, 0.0), "robot_b": Pose(0, 3.0, 0.0, 0.0)}
    return Planner(config, PlannerTuning(**tuning)).step([scan], poses, 0)


def test_constants_of_splitting_reach_it(make_cells):
    pair = [(3.0 + dx, y + dy) for y in (1.0, 1.5) for dx in (0.0, 0.05) for dy in STRIDE]
    scan = Scan("robot_a", 0, make_cells(pair))
    people = tuned(scan)
    assert (len(people.persons), people.too_wide) == (2, 0)
    people = tuned(scan, splitting=SplittingTuning(most_people=1))
    assert people.too_wide == 1


def test_constants_of_masking_and_joining_reach_them(make_cells):
    # A body 0.4 m from the other robot, with a range that is as uncertain as that.
    cell = make_cells([(3.4, 0.0)])
    body = {"body": 1, "score": 1.0, "sigma_range": 0.3, "sigma_across": 0.05}
    given = {name: np.array([v], dtype=BODY_DTYPE[name]) for name, v in body.items()}
    scan = Scan("robot_a", 0, dataclasses.replace(cell, **given))
    assert not tuned(scan).persons
    (person,) = tuned(scan, masking=MaskingTuning(gate=0.1)).persons
    assert person.score == 1.0
    joining = JoiningTuning(min_score=2.0)
    (person,) = tuned(scan, masking=MaskingTuning(gate=0.1), joining=joining).persons
    assert person.score == 2.0


def test_constants_of_tracks_and_groups_reach_them():
    tuning = PlannerTuning(tracks=TracksTuning(max_score=1.0), groups=GroupsTuning(max_step_s=9.0))
    planner = Planner(PlannerConfig(), tuning)
    assert planner.tracker.tuning is tuning.tracks
    assert planner.groups.tuning is tuning.groups


def test_robots_that_are_unsure_together_tell_two_people_apart(make_cells):
    """One robot sees somebody 0.6 m beside whom the other sees; their team may be 1 m off."""
    body = {"body": 1, "score": 6.0, "sigma_range": 0.05, "sigma_across": 0.05}
    given = {name: np.array([v], dtype=BODY_DTYPE[name]) for name, v in body.items()}
    scans = [
        Scan(robot, 0, dataclasses.replace(make_cells([(2.0, y)]), **given))
        for robot, y in (("robot_a", 0.0), ("robot_b", 0.6))
    ]
    unsure = np.diag([1.0, 1.0, 1e-4])
    poses = {name: Pose(0, 0.0, 0.0, 0.0, unsure) for name in ("robot_a", "robot_b")}
    assert len(step(scans, poses, 0).persons) == 1
    sure = np.diag([1e-4, 1e-4, 1e-6])
    together = {name: dataclasses.replace(p, in_team=sure) for name, p in poses.items()}
    people = step(scans, together, 0)
    assert sorted(positions(people)[:, 1]) == pytest.approx([0.0, 0.6], abs=0.01)
    for person in people.persons:
        assert (np.linalg.eigvalsh(person.covariance) > 1.0 - 1e-4).all()
    (group,) = people.groups
    assert (np.linalg.eigvalsh(group.covariance) > 1.0 - 1e-4).all()
    assert people.poses == together


def test_shared_heading_error_moves_far_people_more(scene):
    """The team is turned by 0.01 rad (sigma) about robot_a, the surest: across, 1 cm per metre."""
    exact = {name: Pose(0, p.x, p.y, p.yaw) for name, p in POSES.items()}
    turned = {
        name: dataclasses.replace(
            p, covariance=np.diag([0.0, 0.0, 1e-4 if name == "robot_a" else 1.0]),
            in_team=np.zeros((3, 3)),
        )
        for name, p in exact.items()
    }  # fmt: skip
    pairs = zip(step(scene, turned).persons, step(scene, exact).persons, strict=True)
    more = [one.covariance - other.covariance for one, other in pairs]
    # Seen from robot_a at (6, 3.5), the people are at (-3, -0.5), (-3, 0.5) and (-1.5, 0).
    wanted = 1e-4 * np.array(
        [[[0.25, -1.5], [-1.5, 9.0]], [[0.25, 1.5], [1.5, 9.0]], [[0.0, 0.0], [0.0, 2.25]]]
    )
    np.testing.assert_allclose(more, wanted, atol=1e-9)

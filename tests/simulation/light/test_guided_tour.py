import numpy as np
import pytest

from mrs_people_loc.config import GuideConfig, Pace
from mrs_people_loc.guiding.guidance import State
from mrs_people_sim.guided import guided_scene
from mrs_people_sim.light.guided_tour import LightTour, Trouble

pytestmark = pytest.mark.slow

SCENE = """
room: {length: 20.0, width: 8.0}
layout: {people: 3, activity: guided}
tour: {points: [[5.0, 4.0], [13.0, 4.0]]}
odometry: {sigma: 0.01, sigma_yaw: 0.003, drift: 0.02, drift_yaw: 0.006}
robots:
  robot_a: {x: 7.5, y: 4.0, head: {yaw: 3.1416}}
  robot_b: {x: 2.5, y: 4.7}
  robot_c: {x: 2.5, y: 3.3}
laser: {field_of_view: 6.2832}
"""


def run(tmp_path, seconds, poses="exact", scene=SCENE, seed=1, **how):
    file = tmp_path / "scene.yaml"
    file.write_text(scene)
    return LightTour(guided_scene(file, seed), poses, **how).run(seconds)


def off(result):
    """By robot, how far it is from where it believes to be, at each of its poses [m]."""
    true = result.record.robots
    return {
        name: np.linalg.norm((track.poses - true[name].at(track.stamps_ns))[:, :2], axis=1)
        for name, track in result.poses.items()
    }


def test_a_group_is_guided_to_the_end(tmp_path):
    result = run(tmp_path, 60.0)
    record = result.record
    assert record.statuses[-1].state == State.FINISHED
    assert np.linalg.norm(record.truth.positions[-1] - [13.0, 4.0], axis=1).max() < 4.0
    assert result.world.bumps == 0
    assert len(record.estimates[-1].positions) == 3


def test_robots_with_heads_alone_crawl(tmp_path):
    result = run(tmp_path, 12.0, scene=SCENE.replace("laser:", "#"))
    assert 0.05 < result.speeds[:, 1:].max() <= 0.1 + 1e-9


def test_tour_goes_on_without_somebody_who_leaves(tmp_path):
    scene = SCENE.replace("[13.0, 4.0]", "[17.0, 4.0]") + "followers: {leavers: 1}\n"
    config = GuideConfig(pace=Pace(patience=8.0))
    result = run(tmp_path, 60.0, scene=scene, seed=4, config=config)  # they leave after 2.6 m
    statuses, (left,) = result.record.statuses, result.world.crowd.stragglers.leaving
    assert statuses[-1].state == State.FINISHED
    assert len(statuses[-1].lost) == 1
    assert [event for s in statuses for event in s.events if "without" in event]
    away = np.linalg.norm(result.record.truth.positions[-1] - [17.0, 4.0], axis=1)
    assert np.flatnonzero(away > 5.0).tolist() == [left]


@pytest.mark.parametrize(("poses", "largest_m"), [("localized", 0.1), ("odometry", 0.3)])
def test_robots_take_estimated_poses_for_theirs(tmp_path, poses, largest_m):
    result = run(tmp_path, 7.0, poses)
    errors = off(result)
    assert set(errors) == set(result.record.robots)
    for error in errors.values():
        assert 0.0 < error.max() < largest_m


def test_walls_that_the_laser_scanner_shows_keep_robots_in_the_map(tmp_path):
    poor = SCENE.replace("drift: 0.02, drift_yaw: 0.006", "drift: 0.1, drift_yaw: 0.05")
    medians = []
    for reach in ("2.0", "10.0"):  # the walls are 4 m away
        scene = poor.replace("6.2832", f"6.2832, max_range: {reach}")
        result = run(tmp_path, 6.0, "localized", scene)
        medians.append(np.median(np.concatenate([*off(result).values()])))
    assert medians[1] < 0.6 * medians[0]


def test_robots_stand_while_there_is_no_planner_and_one_that_is_killed_stays(tmp_path):
    trouble = Trouble(killed=("robot_c", 8.0), planner_gone=(10.16, 12.0))
    result = run(tmp_path, 14.0, trouble=trouble)
    times, speeds = result.speeds[:, 0], result.speeds[:, 1:]
    assert speeds[times < 10.16].max() > 0.2
    assert speeds[(times > 10.16 + 0.5) & (times < 12.0)].max() == 0.0
    assert speeds[times > 12.5, :2].max() > 0.1
    assert speeds[times > 9.0, 2].max() == 0.0
    assert State.HALTED in [status.state for status in result.record.statuses]

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from mrs_people_loc.errors import ConfigError
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.tour import check_tour
from mrs_people_sim.guided import RADIUS, GuidedWorld, guided_scene

SCENES = Path(__file__).parents[2] / "config" / "scenes"
TOURS = sorted(SCENES.glob("guided_*.yaml"))


def world(name="guided_corridor", seed=1, people=None):
    return GuidedWorld(guided_scene(SCENES / f"{name}.yaml", seed, people=people))


@pytest.mark.parametrize("path", TOURS, ids=lambda path: path.stem)
def test_tours_of_the_scenes_are_about_60_m_and_can_be_driven(path):
    one = GuidedWorld(guided_scene(path, 1, people=10))
    assert 55.0 < one.tour.way.length < 65.0
    assert one.tour.stops
    check_tour(one.tour, FreeSpace(one.plan), 0.35)
    assert one.looks_back == ("robot_a",)
    assert one.crowd.guided == 10
    apart = np.linalg.norm(one.crowd.xy[:, None] - one.poses()[None, :, :2], axis=2)
    assert apart.min() > 0.9


def test_robots_obey_and_people_follow_the_one_that_leads():
    one = world(people=5)
    one.leader = "robot_a"
    begin, people = one.poses(), one.crowd.xy.copy()
    for _ in range(200):
        one.wheels["robot_a"].command(0.5, 0.0)
        one.step()
    assert one.time == pytest.approx(10.0)
    assert (one.poses()[0] - begin[0])[0] == pytest.approx(5.0, abs=0.2)
    assert (one.poses()[1:] == begin[1:]).all()
    assert (one.crowd.xy - people)[:, 0].mean() > 2.0
    assert one.bumps == 0


def test_bystanders_set_out_once_the_leader_is_near_and_belong_to_no_group():
    one = world("guided_bystanders", people=5)
    assert one.groups.tolist() == [1] * 5 + [0] * 4
    assert len(one.scene.people) == len(one.crowd.xy) == 9
    one.leader = "robot_a"
    for _ in range(100):
        one.step()
    start = one.crowd.xy[5:].copy()
    np.testing.assert_allclose(start[0], [20.0, 1.9], atol=0.1)
    one.wheels["robot_a"].pose = np.array([12.0, 0.6, 0.0])
    for _ in range(160):
        one.step()
    assert one.crowd.xy[5, 0] < 14.0  # it has passed the robot, or been held up by it
    np.testing.assert_allclose(one.crowd.xy[6:], start[1:], atol=0.1)


def test_one_who_ignores_robots_walks_into_them_and_others_evade_them():
    scene = guided_scene(SCENES / "guided_bystanders.yaml", 1, people=5)
    nearest = {}
    for ignores in (False, True):
        others = tuple(dataclasses.replace(b, ignores=ignores, near=0.0) for b in scene.bystanders)
        others = (dataclasses.replace(others[0], near=100.0), *others[1:])
        one = GuidedWorld(dataclasses.replace(scene, bystanders=others))
        one.leader = "robot_a"
        one.wheels["robot_a"].pose = np.array([12.0, 1.72, 0.0])
        away = []
        for _ in range(300):
            one.step()
            away.append(np.linalg.norm(one.crowd.xy[5] - [12.0, 1.72]))
        nearest[ignores] = min(away)
    assert nearest[True] < 0.45 < 0.6 < nearest[False]


@pytest.mark.parametrize("into", ["wall", "person"])
def test_robots_do_not_drive_through_what_is_solid(into):
    one = world()
    wheels = one.wheels["robot_b"]
    yaw = -1.57 if into == "wall" else 0.0
    wheels.pose = np.array([0.8 if into == "wall" else 1.8, 1.3, yaw])
    if into == "person":
        one.crowd.xy[:] += [10.0, 0.0]
        one.crowd.xy[0] = [2.5, 1.3]
        one.crowd.velocity[:] = 0.0
    for _ in range(100):
        if into == "person":
            one.crowd.xy[0] = [2.5, 1.3]
        wheels.command(0.5, 0.0)
        one.step()
    assert one.bumps == 1
    place = wheels.pose[:2]
    assert RADIUS - 0.05 < place[1] < RADIUS + 0.1 if into == "wall" else 2.0 < place[0] < 2.2


def test_scenes_without_what_a_tour_needs_are_refused(tmp_path):
    text = "{room: {}, robots: {robot_a: {}}, people: [{x: 1.0, y: 1.0}]}"
    file = tmp_path / "scene.yaml"
    file.write_text(text)
    with pytest.raises(ConfigError, match=r"scene.yaml: has no tour; wanted: tour, robots, people"):
        guided_scene(file, 1)
    file.write_text(text.replace("room", "tour: {points: [[0.0, 0.0]]}, room"))
    with pytest.raises(ConfigError, match="at least two points; this one has one"):
        GuidedWorld(guided_scene(file, 1))
    file.write_text("{robots: {robot_a: {}}, layout: {people: 3, activity: guided}}")
    with pytest.raises(ConfigError, match="wanted with it: a tour"):
        guided_scene(file, 1)


def test_stragglers_are_as_many_as_the_scene_says():
    scene = guided_scene(SCENES / "guided_hall.yaml", 3, people=6)
    followers = dataclasses.replace(scene.followers, stragglers=2, stay=5.0)
    one = GuidedWorld(dataclasses.replace(scene, followers=followers))
    one.crowd.walked[:] = 100.0
    one.step()
    assert len(one.crowd.stragglers.who) == 2
    for _ in range(110):
        one.step()
    assert [stay.end_s for stay in one.crowd.stragglers.stays] == pytest.approx([5.0, 5.0], abs=0.1)


def test_scene_has_as_many_robots_as_are_wanted():
    path = SCENES / "guided_hall.yaml"
    assert list(guided_scene(path, 1, robots=2).robots) == ["robot_a", "robot_b"]
    world = GuidedWorld(guided_scene(path, 1, robots=4))
    assert world.poses()[3] == pytest.approx([3.2 - 0.9, 4.1, 0.0])
    assert world.looks_back == ("robot_a",)

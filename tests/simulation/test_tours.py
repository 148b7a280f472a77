"""Tours without rendering: where the walls are, and what robots see of them and of people."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from mrs_people_loc.errors import ConfigError
from mrs_people_sim.light.sensing import (
    HEAD,
    in_frames,
    scan_of,
    seen_people,
    seen_walls,
)
from mrs_people_sim.scene import Furniture, Room, Scene, load_scene
from mrs_people_sim.tours import known_walls, tour_of, walls_of

SCENES = Path(__file__).resolve().parents[2] / "config" / "scenes"
TOURS = sorted(path.stem for path in SCENES.glob("tour_*.yaml"))
#: It finds every wall that it could.
SURE = dataclasses.replace(HEAD, found=((0.0,), (1.0,)))
NOBODY = np.empty((1, 0, 2))
#: A wall along x, 2 m to the left of the origin.
LEFT = np.array([[[20.0, 2.0], [-20.0, 2.0]]])


def rng() -> np.random.Generator:
    return np.random.default_rng(3)


def test_walls_of_a_room_have_it_to_their_left():
    walls = walls_of(Scene(room=Room(length=6.0, width=4.0)))
    assert len(walls) == 4
    span = walls[:, 1] - walls[:, 0]
    inwards = np.array([3.0, 2.0]) - walls[:, 0]
    assert (span[:, 0] * inwards[:, 1] - span[:, 1] * inwards[:, 0] > 0).all()


def test_walls_of_a_corner_are_those_that_can_be_reached():
    block = Furniture(kind="wall", x=2.0, y=3.0, size=(4.0, 4.0, 2.8))
    walls = walls_of(Scene(room=Room(length=6.0, width=5.0), furniture=(block,)))
    lengths = np.hypot(*(walls[:, 1] - walls[:, 0]).T)
    # Outside 6, 5, 2 and 1 m, inside 4 and 4 m.
    np.testing.assert_allclose(sorted(lengths), [1.0, 2.0, 4.0, 4.0, 5.0, 6.0], atol=0.06)


def test_known_walls_by_hand():
    walls = known_walls(
        np.array([[[1.0, -2.0], [4.0, -2.0]], [[0.0, 3.0], [0.0, 1.0]]]), (0.1, 0.2)
    )
    np.testing.assert_allclose(walls.distance, [2.0, 0.0])
    assert walls.bearing[0] == pytest.approx(-math.pi / 2)
    # The foot is (0, -2), bearing + pi/2 is along x.
    np.testing.assert_allclose(walls.extent[0], [1.0, 4.0])
    ends = walls.extent[1, :, None] * [-math.sin(walls.bearing[1]), math.cos(walls.bearing[1])]
    np.testing.assert_allclose(sorted(ends[:, 1]), [1.0, 3.0])
    np.testing.assert_allclose(walls.covariance[0], np.diag([0.01, 0.04]))


@pytest.mark.parametrize("name", TOURS)
def test_tours_are_a_hundred_metres_long_and_in_the_free_space(name):
    scene = load_scene(SCENES / f"{name}.yaml")
    tour = tour_of(scene, 1)
    assert len(tour.robots) == 3
    assert tour.people.shape[1] == 5
    everybody = [*tour.people.transpose(1, 0, 2), *(pose[:, :2] for pose in tour.robots.values())]
    span = tour.walls[:, 1] - tour.walls[:, 0]
    for places in everybody:
        assert np.hypot(*np.diff(places, axis=0).T).sum() > 100.0
        # Nobody walks through a wall.
        off = places[:, None] - tour.walls[:, 0]
        side = span[:, 0] * off[..., 1] - span[:, 1] * off[..., 0]
        part = (off * span).sum(axis=2) / (span**2).sum(axis=1)
        assert not ((np.diff(np.sign(side), axis=0) != 0) & (np.abs(part[1:] - 0.5) < 0.5)).any()


def test_tours_differ_by_their_seed_only():
    scene = load_scene(SCENES / "tour_l_corridor.yaml")
    one, same, other = (tour_of(scene, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.odometry["robot_a"], same.odometry["robot_a"])
    size = min(len(one.times), len(other.times))
    assert np.abs(one.people[:size] - other.people[:size]).max() > 0.1


def test_places_in_the_frame_of_a_robot():
    found = in_frames(np.array([[1.0, 2.0, math.pi / 2]]), np.array([[1.0, 5.0], [0.0, 2.0]]))
    np.testing.assert_allclose(found, [[[3.0, 0.0], [0.0, 1.0]]], atol=1e-12)


def test_walls_are_seen_with_the_stated_errors():
    poses = np.tile([0.0, 0.0, 0.3], (40, 1))
    offs = []
    for seed in range(20):
        bodies = np.empty((len(poses), 0, 2))
        for walls in seen_walls(LEFT, poses, bodies, np.random.default_rng(seed), SURE):
            if len(walls):
                offs.append([walls.distance[0] - 2.0, walls.bearing[0] - (math.pi / 2 - 0.3)])
                covariance = walls.covariance[0]
    error = np.array(offs)
    assert len(error) > 200
    squares = np.einsum("ni,ij,nj->n", error, np.linalg.inv(covariance), error)
    # Two degrees of freedom; the stated covariance has errors of the calibration twice as large.
    assert 1.0 < squares.mean() < 2.4


def test_a_wall_out_of_range_or_view_is_not_seen():
    far = LEFT + [0.0, 10.0]
    for pose in ([0.0, 0.0, 0.3], [0.0, 0.0, -math.pi / 2]):
        poses = np.array([pose])
        assert len(seen_walls(far, poses, NOBODY, rng(), SURE)[0]) == 0
    assert len(seen_walls(LEFT, np.array([[0.0, 0.0, -math.pi / 2]]), NOBODY, rng(), SURE)[0]) == 0


def test_a_wall_is_found_in_its_share_of_the_views():
    poses = np.tile([0.0, 0.0, math.pi / 2], (3000, 1))
    views = seen_walls(LEFT, poses, np.empty((3000, 0, 2)), rng())
    assert np.mean([len(walls) for walls in views]) == pytest.approx(HEAD.found[1][0], abs=0.03)


def test_a_scene_without_posts_is_no_tour():
    scene = load_scene(SCENES / "guided_hall.yaml")
    with pytest.raises(ConfigError, match="8 people, robots with a post: none; wanted: people"):
        tour_of(scene, 1)


def test_a_robot_that_was_turned_looks_at_the_group_again():
    scene = load_scene(SCENES / "tour_hall.yaml")
    turned = dataclasses.replace(scene.robots["robot_b"], carried=(60.0, 0.0, 0.0, 0.7))
    other = dataclasses.replace(scene, robots={**scene.robots, "robot_b": turned})
    one, two = (tour_of(each, 1) for each in (scene, other))
    off = two.robots["robot_b"][:, 2] - one.robots["robot_b"][:, 2]
    np.testing.assert_allclose(off[one.times <= 60.0], 0.0, atol=1e-12)
    assert off[one.times > 60.01][0] == pytest.approx(0.7, abs=0.02)
    np.testing.assert_allclose(off[one.times > 65.0], 0.0, atol=1e-12)
    # Its odometry sees it turn back only.
    believed = two.odometry["robot_b"][:, 2] - one.odometry["robot_b"][:, 2]
    assert believed[-1] == pytest.approx(-0.7, abs=0.02)


def test_people_hide_walls():
    poses = np.array([[0.0, 0.0, math.pi / 2]])
    across = np.linspace(-2.0, 2.0, 11)
    crowd = np.column_stack([across, np.full(11, 1.0)])[None]
    assert len(seen_walls(LEFT, poses, NOBODY, rng(), SURE)[0]) == 1
    assert len(seen_walls(LEFT, poses, crowd, rng(), SURE)[0]) == 0


def test_the_end_of_a_wall_in_view_is_seen_as_such():
    # It ends straight ahead and to the right: the foot is ahead, the end 0.5 m to the right of it.
    wall = np.array([[[2.0, -0.5], [2.0, 20.0]]])
    (walls,) = seen_walls(wall, np.zeros((1, 3)), NOBODY, rng(), SURE)
    assert walls.is_end.tolist() == [[True, False]]
    assert walls.extent[0, 0] == pytest.approx(-0.5, abs=0.15)


def test_people_are_seen_with_the_stated_errors_and_not_behind_each_other():
    times = np.arange(0.0, 400.0, 0.2)
    poses = np.zeros((len(times), 3))
    places = np.tile([[3.0, 0.0], [4.0, 0.1], [2.0, 1.0], [-2.0, 0.0]], (len(times), 1, 1))
    views = seen_people(times, poses, places, rng())
    persons = np.concatenate([view.person for view in views])
    assert set(persons.tolist()) == {0, 2}
    share = (persons == 0).mean() * 2
    assert share == pytest.approx(1.0, abs=0.05)
    assert len(persons) == pytest.approx(2 * len(times) * (1 - HEAD.missed), rel=0.02)
    xy = np.concatenate([view.xy for view in views])[persons == 0]
    along = np.concatenate([view.along for view in views])[persons == 0]
    assert along[0] == pytest.approx(0.07)  # half-way from 1.5 to 4.5 m
    assert np.std(xy[:, 0]) == pytest.approx(0.07, rel=0.15)
    assert np.std(xy[:, 1]) == pytest.approx(0.03, rel=0.15)
    # A part of it lasts.
    off = xy[:, 0] - xy[:, 0].mean()
    assert (off[1:] * off[:-1]).mean() / off.var() == pytest.approx(0.35, abs=0.1)


def test_the_scan_of_people_has_a_body_for_each():
    (view,) = seen_people(
        np.zeros(1), np.zeros((1, 3)), np.array([[[2.0, 0.0], [3.0, 1.0]]]), rng()
    )
    scan = scan_of("robot_a", 7, view)
    assert scan.cells.body.tolist() == list(range(1, len(view.xy) + 1))
    np.testing.assert_allclose(scan.cells.x, view.xy[:, 0], rtol=1e-6)

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.errors import ConfigError
from mrs_people_sim.layouts import expand
from mrs_people_sim.models.meshes import box, merge
from mrs_people_sim.scene import Laser, Sonar, read_scene
from mrs_people_sim.sensors.range_sensors import (
    laser_angles,
    laser_ranges,
    outline_at,
    people_circles,
    sonar_ranges,
)
from mrs_people_sim.views.world import World

NOBODY = np.empty((0, 3))
NOTHING = np.empty((0, 4))
#: x = 2 from y = -5 to 5.
WALL = np.array([[2.0, -5.0, 2.0, 5.0]])
HERE = (0.0, 0.0, 0.0)
EXACT = {"noise": 0.0, "least_noise": 0.0, "dropout": 0.0, "cross_talk": 0.0}
SONAR = Sonar(field_of_view=0.5, specular_limit=0.25, edge_echo=1.0, cloth_echo=1.0, **EXACT)
LASER = Laser(noise=0.0, dropout=0.0)


def rng() -> np.random.Generator:
    return np.random.default_rng(1)


def one_range(segments: np.ndarray, circles: np.ndarray, sonar: Sonar, yaw: float = 0.0) -> float:
    return float(sonar_ranges(segments, circles, (0.0, 0.0, yaw), [sonar], rng())[0])


# ---------------------------------------------------------------------------------------- sonar


@pytest.mark.parametrize("yaw", [0.0, 0.2, -0.2])
def test_sonar_measures_perpendicular_distance_of_wall_in_its_cone(yaw: float) -> None:
    assert one_range(WALL, NOBODY, SONAR, yaw) == pytest.approx(2.0)


def test_wall_that_is_turned_away_sends_no_echo() -> None:
    assert one_range(WALL, NOBODY, SONAR, 0.3) == math.inf


def test_edge_in_the_cone_is_heard_where_the_foot_is_not() -> None:
    wall = np.array([[2.0, 0.3, 2.0, 5.0]])
    assert one_range(wall, NOBODY, SONAR) == pytest.approx(math.hypot(2.0, 0.3))


def test_edge_that_sends_no_echo_is_not_heard() -> None:
    wall = np.array([[2.0, 0.3, 2.0, 5.0]])
    assert one_range(wall, NOBODY, dataclasses.replace(SONAR, edge_echo=0.0)) == math.inf


def test_mounting_and_pose_place_the_sonar() -> None:
    """It stands at (1, 1) + (-0.5, 0.3) and looks along the map's y."""
    sonar = dataclasses.replace(SONAR, x=0.3, y=0.5, yaw=0.0)
    wall = np.array([[-5.0, 4.0, 5.0, 4.0]])
    ranges = sonar_ranges(wall, NOBODY, (1.0, 1.0, math.pi / 2), [sonar], rng())
    assert ranges == pytest.approx([4.0 - 1.3])


def test_tilted_surface_hides_what_is_behind_it_without_an_echo() -> None:
    tilted = np.array([[0.5, -0.5, 1.5, 0.5]])  # its foot is 45 degrees off the axis
    silent = dataclasses.replace(SONAR, edge_echo=0.0)
    assert one_range(np.concatenate([WALL, tilted]), NOBODY, silent) == math.inf


def test_person_before_the_wall_is_nearer() -> None:
    assert one_range(WALL, np.array([[1.0, 0.1, 0.2]]), SONAR) == pytest.approx(
        math.hypot(1.0, 0.1) - 0.2
    )


def test_person_at_the_sonar_is_too_near() -> None:
    assert one_range(WALL, np.array([[0.0, 0.1, 0.2]]), SONAR) == -math.inf


def test_what_is_farther_than_the_longest_range_sends_no_echo() -> None:
    assert one_range(WALL, NOBODY, dataclasses.replace(SONAR, max_range=1.9)) == math.inf
    assert one_range(NOTHING, NOBODY, SONAR) == math.inf


def test_side_lobes_hear_a_part_of_the_time() -> None:
    """Half way between the cone (0.25) and the limit (0.45): half of 2000."""
    sonar = dataclasses.replace(SONAR, specular_limit=0.45)
    ranges = sonar_ranges(WALL, NOBODY, (0.0, 0.0, 0.35), [sonar] * 2000, rng())
    assert np.isfinite(ranges).sum() == pytest.approx(1000, abs=4 * math.sqrt(500))


def test_noise_grows_with_range() -> None:
    sonar = dataclasses.replace(SONAR, noise=0.01, least_noise=0.005)
    ranges = sonar_ranges(WALL, NOBODY, HERE, [sonar] * 4000, rng())
    assert ranges.mean() == pytest.approx(2.0, abs=0.002)
    assert ranges.std() == pytest.approx(math.hypot(0.005, 0.02), rel=0.05)


def test_cross_talk_is_shorter_and_needs_two_sonars() -> None:
    talk = dataclasses.replace(SONAR, cross_talk=1.0, min_range=0.0)
    assert (sonar_ranges(WALL, NOBODY, HERE, [talk] * 50, rng()) < 2.0).all()
    assert sonar_ranges(WALL, NOBODY, HERE, [talk], rng()) == pytest.approx([2.0])


def test_dropouts_are_infinite() -> None:
    mute = dataclasses.replace(SONAR, dropout=0.25)
    lost = ~np.isfinite(sonar_ranges(WALL, NOBODY, HERE, [mute] * 4000, rng()))
    assert lost.mean() == pytest.approx(0.25, abs=0.03)


def test_robot_without_sonars_measures_nothing() -> None:
    assert sonar_ranges(WALL, NOBODY, HERE, [], rng()).shape == (0,)


# ---------------------------------------------------------------------------------------- laser


def test_laser_sees_a_square_room() -> None:
    room = np.array([[-2.0, -2, 2, -2], [2, -2, 2, 2], [2, 2, -2, 2], [-2, 2, -2, -2]], dtype=float)
    ranges = laser_ranges(room, NOBODY, HERE, LASER, rng())
    angles = laser_angles(LASER)
    expected = 2.0 / np.maximum(np.abs(np.cos(angles)), np.abs(np.sin(angles)))
    np.testing.assert_allclose(ranges, expected, rtol=1e-9)


def test_laser_sees_circles_and_its_limits() -> None:
    laser = dataclasses.replace(LASER, field_of_view=3.0, rays=3, min_range=0.5, max_range=3.0)
    circles = np.array([[0.0, 0.0, 0.1]]) + [[1.0, 0, 0]]
    away = laser_ranges(NOTHING, circles, HERE, laser, rng())
    assert away == pytest.approx([math.inf, 0.9, math.inf])
    assert laser_ranges(NOTHING, circles - [[0.6, 0, 0]], HERE, laser, rng())[1] == -math.inf


def test_full_turn_has_no_ray_twice() -> None:
    angles = laser_angles(Laser(field_of_view=2 * math.pi, rays=360))
    steps = np.diff(np.concatenate([angles, angles[:1] + 2 * math.pi]))
    np.testing.assert_allclose(steps, math.radians(1.0))


@given(st.floats(-3, 3), st.floats(-1, 1), st.floats(-1, 1))
def test_ranges_do_not_depend_on_the_maps_frame(turn: float, x: float, y: float) -> None:
    c, s = math.cos(turn), math.sin(turn)
    rotation, move = np.array([[c, -s], [s, c]]), np.array([x, y])
    wall = (WALL.reshape(-1, 2) @ rotation.T + move).reshape(-1, 4)
    moved = laser_ranges(wall, NOBODY, (x, y, turn), LASER, rng())
    still = laser_ranges(WALL, NOBODY, HERE, LASER, rng())
    seen = np.isfinite(still) & np.isfinite(moved)
    assert seen.sum() >= np.isfinite(still).sum() - 2  # a ray may just miss an end
    np.testing.assert_allclose(moved[seen], still[seen], rtol=1e-6)


# ------------------------------------------------------------------------------------- outlines


def test_people_are_wider_than_deep_and_may_be_absent() -> None:
    circles = people_circles(np.array([[1.0, 2.0, 0.0], [np.nan, np.nan, 0.0]]))
    assert len(circles) == 3
    low, high = (circles[:, :2] - circles[:, 2:]).min(0), (circles[:, :2] + circles[:, 2:]).max(0)
    assert tuple(high - low) == pytest.approx((0.26, 0.46))
    assert tuple((high + low) / 2) == pytest.approx((1.0, 2.0))


def test_outline_of_a_box_has_four_sides_without_joints() -> None:
    outline = outline_at(box((1.0, 2.0, 0.5), (0.4, 0.6, 1.0), 0), 0.3)
    lengths = np.hypot(*(outline[:, 2:] - outline[:, :2]).T)
    np.testing.assert_allclose(np.sort(lengths), [0.4, 0.4, 0.6, 0.6], atol=1e-6)
    assert len(outline_at(box((1.0, 2.0, 0.5), (0.4, 0.6, 1.0), 0), 1.3)) == 0
    assert len(outline_at(merge([]), 0.3)) == 0


def test_outline_of_a_room_holds_its_walls() -> None:
    scene = expand(read_scene({"room": {"length": 6.0, "width": 4.0, "doors": 0}}, "room.yaml"))
    outline = outline_at(World(scene).room, 0.3)
    middle = (3.0, 2.0, 0.0)
    ranges = sonar_ranges(outline, NOBODY, middle, [SONAR, Sonar(yaw=1.57, **EXACT)], rng())
    # Posters are a few millimetres before a wall.
    np.testing.assert_allclose(ranges, [3.0, 2.0], atol=0.01)


# ---------------------------------------------------------------------------------------- scene


def test_scene_gives_robots_sonars_and_a_laser() -> None:
    scene = read_scene(
        {
            "robots": {
                "robot_a": {"sonars": [{"y": 0.2, "yaw": 1.57}, {"x": 0.2}], "laser": {}},
                "robot_b": {},
            }
        },
        "scene.yaml",
    )
    assert scene.sonars == {"robot_a": (Sonar(y=0.2, yaw=1.57), Sonar(x=0.2))}
    assert scene.lasers == {"robot_a": Laser()}


@pytest.mark.parametrize(
    ("robot", "text"),
    [
        ({"sonars": [{"yow": 1.0}]}, "unknown parameter yow; did you mean yaw"),
        ({"sonars": {"yaw": 1.0}}, "robots.robot_a.sonars is .*wanted: a list"),
        ({"laser": 3}, "robots.robot_a.laser is 3; wanted: a mapping"),
        ({"laser": {"rays": 0}}, "rays"),
    ],
)
def test_bad_sensors_are_named(robot: dict, text: str) -> None:
    with pytest.raises(ConfigError, match=text):
        read_scene({"robots": {"robot_a": robot}}, "scene.yaml")

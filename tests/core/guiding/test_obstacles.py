"""What laser scanners, sonars and heads see around a robot."""

import dataclasses
import math

import numpy as np
import pytest

from mrs_people_loc.config import CollisionMonitoring, Disparity, Mounting
from mrs_people_loc.guiding.obstacles import (
    BEARINGS,
    OBSTACLE_TUNING,
    SECTORS,
    HeadObstacles,
    SonarObstacles,
    obstacles_of_laser,
    sectors_at,
)
from mrs_people_loc.localization.walls.ranges import LaserScan, SonarRange
from mrs_people_loc.sensing.disparity import StereoMatcher

CONFIG = CollisionMonitoring()


def sector(degrees):
    return int(sectors_at(np.array([math.radians(degrees)]))[0])


def laser(ranges, step=math.pi / 180, **how):
    angles = step * (np.arange(len(ranges)) - len(ranges) // 2)
    return LaserScan(1, "laser", 10.0, angles, np.array(ranges, dtype=float), **how)


def sonar(measured, stamp_ns=1, **how):
    limits = {"field_of_view": 0.5, "min_range": 0.15, "max_range": 4.0} | how
    return SonarRange(stamp_ns, "sonar", range=measured, **limits)


def test_sectors_cover_the_full_turn_from_behind_to_the_left():
    assert len(BEARINGS) == SECTORS == 180
    np.testing.assert_array_equal(sectors_at(BEARINGS), np.arange(SECTORS))
    assert sector(-180.0) == sector(180.0) == 0


def test_laser_scan_gives_the_nearest_range_of_each_sector():
    # Rays at 88.5 to 92.5 degrees.
    turned = math.radians(90.5)
    seen = obstacles_of_laser(laser([2.0, 1.5, 1.0, 5.0, np.inf]), (0.1, 0.2, turned))
    ahead = sectors_at(np.radians([88.5, 90.5, 92.5]))
    np.testing.assert_allclose(seen.ranges[ahead], [1.5, 1.0, np.inf])
    assert seen.seen.sum() == seen.looks.sum() == 3
    assert seen.reach == OBSTACLE_TUNING.reach
    middle = (0.1 - math.sin(math.radians(1.0)), 1.2)  # of the sector of that range
    np.testing.assert_allclose(seen.places[1], middle, atol=1e-3)


def test_laser_ray_without_a_value_sees_nothing_and_one_that_is_too_near_an_obstacle():
    seen = obstacles_of_laser(
        laser([np.nan, -np.inf], math.radians(4.0), min_range=0.12), (0, 0, 0)
    )
    unknown, near = sector(-4.0), sector(0.0)
    assert seen.looks[unknown]
    assert not seen.seen[unknown]
    assert seen.seen[near]
    assert seen.ranges[near] == 0.12


def test_single_echo_of_a_sonar_is_none_and_two_alike_are():
    ears = SonarObstacles()
    assert not len(ears(sonar(1.0), (0, 0, 0))[0].places)
    scan, age_s = ears(sonar(1.1, 100_000_001), (0.2, 0.0, 0.0))
    assert age_s == 0.0
    hit = np.isfinite(scan.ranges)
    assert (scan.ranges[hit] == 1.1).all()
    assert np.abs(BEARINGS[hit]).max() == pytest.approx(0.375, abs=math.radians(1.0))
    assert np.abs(BEARINGS[scan.looks]).max() == pytest.approx(0.25, abs=math.radians(2.0))
    scan, age_s = ears(sonar(np.inf, 200_000_001), (0.2, 0.0, 0.0))
    assert age_s == pytest.approx(0.1)
    assert np.nanmin(scan.ranges) == 1.1
    for k in range(3, 7):
        scan, _ = ears(sonar(np.inf, k * 100_000_000), (0.2, 0.0, 0.0))
    assert not len(scan.places)
    assert scan.seen.any()


@pytest.mark.parametrize("near", [-np.inf, 0.0, 0.1])
def test_what_is_too_near_for_a_sonar_is_an_obstacle(near):
    ears = SonarObstacles()
    ears(sonar(near), (0.2, 0, 0))
    assert np.hypot(*ears(sonar(near), (0.2, 0, 0))[0].places.T).max() <= 0.3 + 1e-9


def test_sonar_without_a_value_sees_nothing():
    scan, _ = SonarObstacles()(sonar(np.nan), (0, 0, 0))
    assert not scan.seen.any()
    assert not len(scan.places)


# ---- heads, with the real StereoBM ----


@pytest.fixture(scope="module")
def look(make_head, rectangle):
    """What a head sees of a room, and of a body so far ahead [m]."""
    floor = rectangle(corner=(-9, -9, 0), side_a=(18, 0, 0), side_b=(0, 18, 0), grain=0.1)
    wall = rectangle(corner=(5, -5, 0), side_a=(0, 10, 0), side_b=(0, 0, 2.8), seed=2)

    def made(ahead=None, *, low=0.0, high=1.7, mounting=Mounting()):  # noqa: B008
        head = make_head(mounting=mounting)
        things = [floor, wall]
        if ahead is not None:
            things.append(
                rectangle(
                    corner=(ahead, -0.22, low), side_a=(0, 0.44, 0), side_b=(0, 0, high - low),
                    grain=0.04, seed=5,
                )
            )  # fmt: skip
        camera = head.camera()
        images, _ = head.draw(*things)
        eyes = HeadObstacles(camera, CONFIG, nearest=Disparity().min_range)
        return eyes(StereoMatcher(camera, Disparity())(images))

    return made


MIDDLE = np.abs(BEARINGS) < 0.05


def test_head_sees_nothing_on_the_floor_and_beyond_its_reach(look):
    scan = look()
    assert not len(scan.places)
    assert scan.seen.sum() >= scan.looks.sum() - 2
    assert np.degrees(np.abs(BEARINGS[scan.looks])).max() == pytest.approx(36.0, abs=3.0)


@pytest.mark.parametrize("ahead", [0.8, 1.2, 2.0, 2.8])
def test_head_sees_a_body_where_it_is(look, ahead):
    scan = look(ahead)
    np.testing.assert_allclose(scan.ranges[MIDDLE], ahead, rtol=0.06)
    assert scan.seen[MIDDLE].all()


@pytest.mark.parametrize("ahead", [0.3, 0.45, 0.6])
def test_head_does_not_see_past_a_body_that_is_too_near_to_be_matched(look, ahead):
    assert not look(ahead).seen[MIDDLE].any()


def test_what_is_too_low_or_too_high_is_no_obstacle_of_a_head(look):
    assert not len(look(1.5, high=0.2).places)
    assert not len(look(1.5, low=1.85, high=2.4).places)
    assert len(look(1.5, high=0.5).places)


def test_head_that_looks_back_sees_what_is_behind(make_head, rectangle):
    head = make_head(mounting=Mounting(yaw=math.pi, height=1.0))
    body = rectangle(corner=(-1.5, -0.5, 0), side_a=(0, 1, 0), side_b=(0, 0, 1.7))
    eyes = HeadObstacles(head.camera(), CONFIG, nearest=0.7)
    scan = eyes(head.disparity(body))
    assert scan.places[:, 0].max() < -1.4
    assert not scan.looks[MIDDLE].any()


def test_a_few_wrong_pixels_are_no_obstacle(make_head):
    camera = make_head().camera()
    eyes = HeadObstacles(camera, CONFIG, nearest=0.7)
    disparity = np.full((120, 160), camera.disparity_of(4.0), np.float32)
    rng = np.random.default_rng(3)
    wrong = rng.random(disparity.shape) < 0.01
    disparity[wrong] = camera.disparity_of(1.0)
    assert not len(eyes(disparity).places)


def test_wrong_pixels_at_all_ranges_are_no_obstacle(make_head):
    """As where walls have little texture; before, the nearest few of them stopped a robot."""
    camera = make_head().camera()
    eyes = HeadObstacles(camera, CONFIG, nearest=0.7)
    rng = np.random.default_rng(3)
    for _ in range(20):
        disparity = np.full((120, 160), camera.disparity_of(4.0), np.float32)
        wrong = rng.random(disparity.shape) < 0.15
        span = camera.disparity_of(4.0), camera.disparity_of(0.75)
        disparity[wrong] = rng.uniform(*span, wrong.sum())
        assert not len(eyes(disparity).places)


@pytest.mark.parametrize("ahead", [0.8, 1.2, 2.0])
def test_head_sees_a_post_of_a_hand_s_width(make_head, rectangle, ahead):
    head = make_head(mounting=Mounting(height=1.0))
    post = rectangle(corner=(ahead, -0.04, 0), side_a=(0, 0.08, 0), side_b=(0, 0, 1.2))
    eyes = HeadObstacles(head.camera(), CONFIG, nearest=0.7)
    places = eyes(head.disparity(post)).places
    assert np.abs(places[:, 0] - ahead).min() < 0.1 * ahead


def test_support_is_as_stated(make_head):
    camera = make_head().camera()
    tuning = dataclasses.replace(OBSTACLE_TUNING, support=2, across=camera.width)
    eyes = HeadObstacles(camera, CONFIG, nearest=0.7, tuning=tuning)
    disparity = np.full((120, 160), camera.disparity_of(4.0), np.float32)
    disparity[60, 80] = camera.disparity_of(1.0)
    assert not len(eyes(disparity).places)
    disparity[58, 80] = camera.disparity_of(1.0)
    np.testing.assert_allclose(eyes(disparity).places, [(1.0, 0.0)], atol=0.02)


def test_narrow_head_that_looks_straight_down_sees_no_way(make_head):
    camera = make_head(mounting=Mounting(pitch=1.5)).camera()
    camera = dataclasses.replace(camera, fx=3.0 * camera.fx, fy=3.0 * camera.fy)
    eyes = HeadObstacles(camera, CONFIG, nearest=2.0)
    scan = eyes(np.full((camera.height, camera.width), 5.0, dtype=np.float32))
    assert not scan.looks.any()
    assert not len(scan.places)

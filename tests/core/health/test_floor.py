"""The floor in disparity images: planes and walls whose disparity is worked out from geometry."""

from __future__ import annotations

import dataclasses
import math
from typing import Any

import numpy as np
import pytest

from mrs_people_loc import config as cfg
from mrs_people_loc.config import Mounting
from mrs_people_loc.errors import FloorError
from mrs_people_loc.health.floor import (
    Floor,
    FloorFinder,
    FloorTuning,
    FloorWatch,
    FloorWatchTuning,
    in_words,
    watch_for,
)
from mrs_people_loc.sensing.camera import StereoCamera

CAMERA = StereoCamera(
    width=160, height=120, fx=105.46, fy=105.46, cx=79.5, cy=59.5, baseline=0.10
)  # as the paper's
SECOND = 1_000_000_000


def head(camera: StereoCamera = CAMERA, **mounting: float) -> StereoCamera:
    return dataclasses.replace(camera, mounting=Mounting(**mounting))


def disparity_of(
    camera: StereoCamera,
    *surfaces: tuple[str, float],
    noise_px: float = 0.12,
    error_px: float = 0.0,
    seed: int = 0,
) -> np.ndarray:
    """What a head sees of planes, the nearest one at each pixel, in sixteenths of a pixel.

    Args:
        camera: The head.
        surfaces: ("floor", height of the plane), ("wall", x of the plane ahead), ("post", x of a
            half metre of wall in the middle) or ("table", height of 1.2 m in the middle).
        noise_px: Of each pixel.
        error_px: Of all pixels.
        seed: Of the noise.
    """
    rotation, lens = camera.robot_from_optical
    u, v = np.meshgrid(np.arange(camera.width), np.arange(camera.height))
    rays = np.stack([(u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy, np.ones(u.shape)])
    x, y, z = (rotation @ rays.reshape(3, -1)).reshape(3, *u.shape)
    nearest = np.full(u.shape, np.inf)
    for kind, place in surfaces:
        with np.errstate(divide="ignore", invalid="ignore"):
            depth = (place - lens[2]) / z if kind in ("floor", "table") else (place - lens[0]) / x
        inside = depth > 0.1
        if kind in ("post", "table"):
            inside &= np.abs(lens[1] + depth * y) < (0.25 if kind == "post" else 0.6)
        if kind == "table":
            inside &= lens[0] + depth * x < 4.0
        nearest = np.where(inside & (depth < nearest), depth, nearest)
    exact = camera.depth_disparity / nearest
    rng = np.random.default_rng(seed)
    noisy = exact + error_px + rng.normal(0.0, noise_px, exact.shape)
    noisy = np.ceil(noisy * 16) / 16 + camera.disparity_offset_px
    noisy[(nearest > 8.0) | (rng.random(exact.shape) < 0.1)] = np.nan
    return noisy.astype(np.float32)


def configured(camera: StereoCamera, **mounting: float) -> StereoCamera:
    """The same head with another mounting in its configuration."""
    return dataclasses.replace(camera, mounting=Mounting(**mounting))


def check(found: Floor, mounting: Mounting, *, height: float = 0.015, angle: float = 0.3) -> None:
    assert found.height == pytest.approx(mounting.height, rel=height)
    assert math.degrees(found.pitch) == pytest.approx(math.degrees(mounting.pitch), abs=angle)
    assert math.degrees(found.roll) == pytest.approx(math.degrees(mounting.roll), abs=angle)


# --- where a head sits ----------------------------------------------------------------------------


def test_level_head_matches_hand_computed_values() -> None:
    """One metre over the floor a row below the horizon has a tenth of a pixel: f B / (f h)."""
    rows = np.arange(120, dtype=np.float32)[:, np.newaxis] - np.float32(59.5)
    sixteenths = np.where(rows > 0, np.ceil(1.6 * rows), np.nan)
    disparity = (sixteenths / 16).repeat(160, axis=1).astype(np.float32)
    found = FloorFinder(head(height=1.0))([disparity])
    assert found.height == pytest.approx(1.0, abs=2e-3)
    assert found.pitch == pytest.approx(0.0, abs=2e-3)
    assert found.roll == pytest.approx(0.0, abs=2e-3)
    # From 2 px on, less the rows at the border over which no slope can be taken.
    assert found.part == pytest.approx((60 - 20 - 5) / 120, abs=0.01)
    assert found.frames == 1


@pytest.mark.parametrize(
    "mounting",
    [
        Mounting(height=1.0),
        Mounting(height=1.0, pitch=0.17, roll=-0.05),
        Mounting(height=0.5, pitch=0.1),
        Mounting(height=2.4, pitch=0.52, roll=0.17, yaw=0.7, forward=0.3, left=-0.2),
        Mounting(height=1.3, pitch=-0.1, roll=0.3),
        Mounting(height=1.6, pitch=0.9, roll=-0.3),
    ],
)
def test_mounting_is_found_without_a_good_initial_guess(mounting: Mounting) -> None:
    """The configuration is level, 1 m high; the true mounting is neither."""
    camera = dataclasses.replace(CAMERA, mounting=mounting)
    view = disparity_of(camera, ("floor", 0.0), ("wall", 6.0))
    check(FloorFinder(head())([view]), mounting, angle=0.5)


@pytest.mark.parametrize("pitch", [1.35, math.pi / 2, 1.7])
def test_head_looking_straight_down_is_measured(pitch: float) -> None:
    """Roll and yaw then rotate about nearly the same axis; the vertical is observable."""
    mounting = Mounting(height=2.7, pitch=pitch, roll=0.02)
    camera = dataclasses.replace(CAMERA, mounting=mounting)
    view = disparity_of(camera, ("floor", 0.0), noise_px=0.05)
    found = FloorFinder(configured(camera, height=2.0, pitch=1.4))([view])
    assert found.height == pytest.approx(2.7, rel=0.01)
    assert math.degrees(found.pitch) == pytest.approx(math.degrees(pitch), abs=0.5)
    assert found.sigma_tilt < 0.06
    assert found.sigma[2] > 0.05


def test_an_upside_down_head_stays_upside_down() -> None:
    mounting = Mounting(height=1.2, pitch=0.3, roll=math.pi - 0.05)
    camera = dataclasses.replace(CAMERA, mounting=mounting)
    view = disparity_of(camera, ("floor", 0.0))
    check(FloorFinder(configured(camera, height=1.0, roll=math.pi))([view]), mounting)


def test_disparity_at_infinity_is_subtracted() -> None:
    camera = dataclasses.replace(head(height=1.1, pitch=0.2), disparity_offset_px=3.0)
    view = disparity_of(camera, ("floor", 0.0))
    check(FloorFinder(camera)([view]), camera.mounting)


# --- what is no floor -----------------------------------------------------------------------------


def test_walls_people_and_tables_are_not_floor() -> None:
    """A wall fills most of the view, with a person, and a table that is nearer than the floor."""
    camera = head(height=1.4, pitch=0.25, roll=0.05)
    for surfaces in ((("wall", 3.0),), (("post", 2.2), ("wall", 4.0)), (("table", 0.72),)):
        view = disparity_of(camera, ("floor", 0.0), *surfaces)
        check(FloorFinder(head())([view]), camera.mounting, height=0.02, angle=0.6)


@pytest.mark.parametrize("distance", [3.2, 3.6, 4.0])
def test_distant_large_wall_is_not_taken_for_a_low_floor(distance: float) -> None:
    """Its disparity hardly differs from that of a floor 5 m below: only the slope tells."""
    camera = head(height=1.0, pitch=-0.02)
    view = disparity_of(camera, ("floor", 0.0), ("wall", distance))
    check(FloorFinder(head())([view]), camera.mounting, height=0.03, angle=1.0)


@pytest.mark.parametrize("camera", [head(), head(height=1.5, pitch=0.2)])
@pytest.mark.parametrize("distance", [1.0, 2.0, 4.0])
def test_wall_alone_is_not_floor(camera: StereoCamera, distance: float) -> None:
    view = disparity_of(camera, ("wall", distance))
    with pytest.raises(FloorError):
        FloorFinder(camera)([view])


@pytest.mark.parametrize(
    ("view", "why"),
    [
        (np.full((120, 160), np.nan), "hardly any"),
        (np.zeros((120, 160)), "hardly any"),
        (np.full((120, 160), 6.0), "floor"),
        (np.random.default_rng(1).uniform(0, 16, (120, 160)), "floor|hardly"),
    ],
)
def test_missing_floor_is_reported(view: np.ndarray, why: str) -> None:
    with pytest.raises(FloorError, match=why):
        FloorFinder(head())([view.astype(np.float32)])


def test_small_patch_of_floor_is_insufficient() -> None:
    view = disparity_of(head(), ("floor", 0.0))
    view[:, 10:] = disparity_of(head(), ("wall", 2.5))[:, 10:]
    with pytest.raises(FloorError, match=r"only .* of a view looks like floor; wanted: 2\.5%"):
        FloorFinder(head())([view])


def test_floor_below_an_implausible_head_height_is_refused() -> None:
    with pytest.raises(FloorError):
        FloorFinder(head())([disparity_of(head(height=8.0, pitch=0.7), ("floor", 0.0))])


@pytest.mark.parametrize(("height", "plausible"), [(4.5, True), (5.5, False)])
def test_head_is_no_higher_than_5_m(height: float, plausible: bool) -> None:
    wide = dataclasses.replace(CAMERA, baseline=0.5)
    looking_down = {"pitch": 1.2}
    seen = disparity_of(head(wide, height=height, **looking_down), ("floor", 0.0))
    finder = FloorFinder(head(wide, height=4.8, **looking_down))
    if plausible:
        check(finder([seen]), Mounting(height=height, **looking_down))
    else:
        with pytest.raises(FloorError):
            finder([seen])


# --- how sure -------------------------------------------------------------------------------------


def test_standard_deviations_match_the_errors() -> None:
    """Heads with wrong rectification: errors are about as large as stated."""
    mounting = Mounting(height=1.2, pitch=0.15, roll=-0.08)
    camera = dataclasses.replace(CAMERA, mounting=mounting)
    rng = np.random.default_rng(3)
    errors = []
    for seed in range(30):
        error = float(rng.normal(0.0, 0.1))
        views = [
            disparity_of(camera, ("floor", 0.0), ("wall", 5.0), error_px=error, seed=seed + k)
            for k in range(2)
        ]
        found = FloorFinder(camera, tuning=FloorTuning(hypotheses=300))(views)
        off = (found.height - 1.2, found.pitch - 0.15, found.roll + 0.08)
        errors.append(np.divide(off, found.sigma))
    spread = np.sqrt(np.mean(np.square(errors), axis=0))
    assert (spread < 1.4).all()
    assert spread[1] > 0.4
    assert (np.abs(errors) < 2.0).mean() > 0.93


def test_disagreeing_views_increase_the_uncertainty() -> None:
    nodding = [
        disparity_of(head(height=1.2, pitch=0.2 + change), ("floor", 0.0), seed=seed)
        for seed, change in enumerate((-0.012, 0.012, -0.01, 0.01))
    ]
    still = [disparity_of(head(height=1.2, pitch=0.2), ("floor", 0.0), seed=s) for s in range(4)]
    find = FloorFinder(head(height=1.2, pitch=0.2))
    moving, fixed = find(nodding), find(still)
    assert moving.frames == fixed.frames == 4
    assert moving.pitch == pytest.approx(0.2, abs=0.015)
    assert moving.sigma[1] > 1.05 * fixed.sigma[1]


def test_covariance_is_symmetric_and_positive_definite() -> None:
    found = FloorFinder(head())([disparity_of(head(), ("floor", 0.0))])
    np.testing.assert_allclose(found.covariance, found.covariance.T, atol=1e-12)
    assert (np.linalg.eigvalsh(found.covariance) > 0).all()
    # A higher lens and a nose that is more down explain each other.
    assert found.covariance[0, 1] > 0


def test_description_is_in_words() -> None:
    reported = in_words(Mounting(height=1.234, pitch=math.radians(10.04), roll=-0.1))
    assert reported == "height 1.23 m, pitch 10.0 deg, roll -5.7 deg"


# --- the watch ------------------------------------------------------------------------------------


def watch(camera: StereoCamera, **config: Any) -> FloorWatch:
    return FloorWatch(camera, cfg.Floor(**config))


def feed(floor: FloorWatch, seen: StereoCamera, first_s: int, looks: int, **how: Any) -> list[bool]:
    """Looks two seconds apart; whether the head has moved after each."""
    moved = []
    for k in range(looks):
        view = disparity_of(seen, ("floor", 0.0), ("wall", 6.0), seed=first_s + k, **how)
        floor.step(view, (first_s + 2 * k) * SECOND)
        moved.append(floor.moved)
    return moved


def test_correctly_mounted_head_gives_no_warning() -> None:
    camera = head(height=1.2, pitch=0.15)
    floor = watch(camera)
    assert feed(floor, camera, 0, 12, error_px=0.1) == [False] * 12
    assert floor.floor is not None
    check(floor.floor, camera.mounting, height=0.05, angle=1.0)
    assert floor.why_not == ""


@pytest.mark.parametrize(
    "change", [{"pitch": 0.12}, {"pitch": -0.06}, {"roll": 0.07}, {"height": 1.4}, {"height": 1.0}]
)
def test_moved_head_is_reported_until_it_returns(change: dict[str, float]) -> None:
    camera = head(height=1.2, pitch=0.03)
    seen = dataclasses.replace(camera, mounting=dataclasses.replace(camera.mounting, **change))
    floor = watch(camera)
    # Nothing is said before five looks, and then not before most of the five say so.
    assert feed(floor, seen, 0, 5) == [False] * 4 + [True]
    assert feed(floor, camera, 10, 5) == [True, True, False, False, False]
    assert feed(floor, seen, 20, 5) == [False, False, True, True, True]


def test_uncertain_deviation_does_not_change_the_state() -> None:
    """2.5 degrees off: 1.5 are allowed, plus one to two standard deviations of 0.67."""
    camera = head(height=1.2, pitch=0.1)
    doubtful = head(height=1.2, pitch=0.1 + math.radians(2.5))
    floor = watch(camera)
    assert not any(feed(floor, doubtful, 0, 8))
    assert feed(floor, head(height=1.2, pitch=0.2), 20, 5)[-1]
    assert all(feed(floor, doubtful, 30, 8))
    assert not feed(floor, camera, 50, 5)[-1]


def test_temporary_deviation_is_not_reported() -> None:
    camera, tilted = head(height=1.2, pitch=0.1), head(height=1.2, pitch=0.2)
    floor = watch(camera)
    feed(floor, camera, 0, 5)
    assert not any(feed(floor, tilted, 10, 2))
    assert not any(feed(floor, camera, 14, 5))


def test_tolerance_follows_the_parameter() -> None:
    camera, seen = head(height=1.2, pitch=0.1), head(height=1.2, pitch=0.17)
    assert feed(watch(camera), seen, 0, 5)[-1]
    assert not feed(watch(camera, max_angle=0.1), seen, 0, 5)[-1]
    higher = head(height=1.4, pitch=0.1)
    assert feed(watch(camera), higher, 0, 5)[-1]
    assert not feed(watch(camera, max_height=0.3), higher, 0, 5)[-1]


def test_most_views_are_skipped() -> None:
    camera = head(height=1.2, pitch=0.1)
    floor = watch(camera)
    view = disparity_of(camera, ("floor", 0.0))
    for k in range(4 * 30):  # 30 Hz for 4 s: at 0 and at 2 s
        floor.step(view, k * SECOND // 30)
    assert floor.floor is None
    for second in (4, 6, 8):
        floor.step(view, second * SECOND)
    assert floor.floor is not None
    assert floor.floor.frames == 5


def test_without_floor_the_last_estimate_is_kept() -> None:
    camera, tilted = head(height=1.2, pitch=0.1), head(height=1.2, pitch=0.25)
    floor = watch(camera)
    feed(floor, tilted, 0, 5)
    assert floor.moved
    nothing = np.full((120, 160), np.nan, dtype=np.float32)
    for second in range(10, 60, 2):
        floor.step(nothing, second * SECOND)
    assert floor.moved
    assert floor.floor is None
    assert "hardly any surface" in floor.why_not
    assert feed(floor, camera, 60, 5)[-1] is False


def test_stamps_that_jump_back_reset_the_state() -> None:
    camera, tilted = head(height=1.2, pitch=0.1), head(height=1.2, pitch=0.25)
    floor = watch(camera)
    feed(floor, tilted, 1000, 4)
    assert feed(floor, tilted, 0, 5) == [False] * 4 + [True]


def test_watch_begins_anew_only_where_head_or_parameters_change() -> None:
    camera, config = head(height=1.2, pitch=0.1), cfg.RobotConfig()
    floor = watch_for(camera, config, None)
    assert floor is not None
    assert floor.block_px == 11
    assert watch_for(head(height=1.2, pitch=0.1), config, floor) is floor
    changes = {"floor.max_angle": 0.1, "disparity.block_size_px": 15, "floor.watch": False}
    watches = [
        watch_for(camera, cfg.RobotConfig.from_mapping({k: v}), floor) for k, v in changes.items()
    ]
    assert watches[0] is not floor
    assert watches[1] is not None
    assert watches[1].block_px == 15
    assert watches[2] is None
    assert watch_for(head(height=1.3, pitch=0.1), config, floor) is not floor


def test_tuning_sets_periods_and_looks() -> None:
    camera = head(height=1.2, pitch=0.1)
    tuning = FloorWatchTuning(period_s=1.0, looks=3)
    floor = FloorWatch(camera, cfg.Floor(), tuning=tuning)
    view = disparity_of(camera, ("floor", 0.0))
    for second in range(3):
        assert floor.floor is None
        floor.step(view, second * SECOND)
    assert floor.floor is not None
    assert 0.1 < FloorFinder(camera)([view]).part < 0.2
    with pytest.raises(FloorError):
        FloorFinder(camera, tuning=FloorTuning(least_part=0.2))([view])

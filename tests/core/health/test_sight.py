"""A head that goes blind, view by view."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from mrs_people_loc import config as cfg
from mrs_people_loc.health.sight import SightTuning, SightWatch
from mrs_people_loc.sensing.images import StereoImages

SHAPE = (120, 160)
FULL = np.full(SHAPE, 5.0, dtype=np.float32)
rng = np.random.default_rng(0)


def image(mean: float = 120.0, deviation: float = 30.0) -> np.ndarray:
    return np.rint(rng.normal(mean, deviation, SHAPE)).clip(0, 255).astype(np.uint8)


def view(**cameras: Any) -> StereoImages:
    return StereoImages(0, **{"left": image(), "right": image(), **cameras})


def with_valid(share: float) -> np.ndarray:
    disparity = FULL.copy()
    disparity.reshape(-1)[round(share * disparity.size) :] = np.nan
    return disparity


def after(views: int, sight: SightWatch, disparity: np.ndarray = FULL, **cameras: Any) -> str:
    """What it says after so many views; an image, or a function that makes a new one each time."""
    for _ in range(views):
        now = {name: made() if callable(made) else made for name, made in cameras.items()}
        sight.step(view(**now), disparity)
    return sight.trouble


def test_seeing_head_gives_no_warning() -> None:
    sight = SightWatch(cfg.Sight())
    assert after(20, sight) == ""
    assert sight.values["valid_pixels"] == 1.0
    assert sight.values["left_mean"] == pytest.approx(120.0, abs=1.0)
    assert sight.values["right_deviation"] == pytest.approx(30.0, abs=1.0)
    assert "top_mean" not in sight.values


@pytest.mark.parametrize("camera", ["left", "right", "top"])
@pytest.mark.parametrize(
    ("mean", "deviation", "what"),
    [
        (2.0, 1.0, "black (mean 2 of 255)"),
        (0.0, 0.0, "black (mean 0 of 255)"),
        (252.0, 2.0, "white (mean 252 of 255)"),
        (128.0, 1.0, "flat (all of it about 128 of 255)"),
    ],
)
def test_bad_camera_is_named(camera: str, mean: float, deviation: float, what: str) -> None:
    def bad() -> np.ndarray:
        return image(mean, deviation)

    cameras = {"top": image, camera: bad}
    reported = after(6, SightWatch(cfg.Sight()), **cameras)
    assert reported.startswith(f"{camera} image is {what}")
    assert reported.count("image is") == 1


def test_both_cameras_are_named() -> None:
    dark = np.zeros(SHAPE, dtype=np.uint8)
    reported = after(5, SightWatch(cfg.Sight()), left=dark, right=dark)
    assert reported == "left image is black (mean 0 of 255); right image is black (mean 0 of 255)"


def test_few_disparities_are_reported_only_with_good_images() -> None:
    reported = after(5, SightWatch(cfg.Sight()), with_valid(0.2))
    assert reported.startswith("only 20% of the pixels have a disparity (sight.min_valid: 25%)")
    assert after(5, SightWatch(cfg.Sight()), with_valid(0.3)) == ""
    assert after(5, SightWatch(cfg.Sight(min_valid=0.5)), with_valid(0.3)) != ""
    assert after(5, SightWatch(cfg.Sight(min_valid=0.0)), with_valid(0.0)) == ""
    reported = after(5, SightWatch(cfg.Sight()), with_valid(0.0), left=lambda: image(2.0, 1.0))
    assert reported == "left image is black (mean 2 of 255)"


def test_warning_needs_consecutive_views_to_start_and_end() -> None:
    sight = SightWatch(cfg.Sight(frames=4))
    assert after(3, sight, with_valid(0.1)) == ""
    assert after(1, sight) == ""
    assert after(3, sight, with_valid(0.1)) == ""
    assert after(1, sight, with_valid(0.1)) != ""
    assert after(3, sight) != ""
    assert after(1, sight, with_valid(0.1)) != ""
    assert after(3, sight) != ""
    assert after(1, sight) == ""


def test_warning_follows_the_current_views() -> None:
    sight = SightWatch(cfg.Sight())
    assert "disparity" in after(5, sight, with_valid(0.1))
    assert "left image is black" in after(1, sight, left=np.zeros(SHAPE, dtype=np.uint8))


def test_frozen_camera_is_detected_while_the_other_moves() -> None:
    frozen = image()
    reported = after(9, SightWatch(cfg.Sight()), right=frozen)
    assert reported == "right image stands still"
    # A recording of one frame stands still as a whole: nothing is broken there.
    assert after(9, SightWatch(cfg.Sight()), left=frozen, right=frozen) == ""


def test_tuning_sets_what_is_black() -> None:
    dark = image(mean=15.0, deviation=5.0)
    assert after(5, SightWatch(cfg.Sight()), left=dark, right=dark) == ""
    sight = SightWatch(cfg.Sight(), tuning=SightTuning(black=20.0))
    assert after(5, sight, left=dark, right=dark).startswith("left image is black (mean 15")

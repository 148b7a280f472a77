import dataclasses
import itertools
import math

import cv2
import numpy as np
import pytest

from mrs_people_loc import config as cfg
from mrs_people_loc import timing
from mrs_people_loc.errors import CameraError, ConfigError, ImageError
from mrs_people_loc.sensing.disparity import StereoMatcher, combine, make_stereo_bm
from mrs_people_loc.sensing.images import StereoImages

NAN = math.nan
ABOVE, BELOW = (0, -0.1), (0, 0.1)

# A wall 2 m ahead, all over the image: 5.273 px, for the horizontal and the vertical pair.
WALL = {"corner": (2, 4, -3), "side_a": (0, -8, 0), "side_b": (0, 0, 6), "grain": 0.04}
DISPARITY = 105.46 * 0.1 / 2.0
ROWS_ALIKE = {**WALL, "grain_b": 1e6}  # upright stripes
#: The paper's mask, in one pass.
PAPERS = {"block_size_px": 15, "fill_block_size_px": 0}
COLUMNS_ALIKE = {**WALL, "grain": 1e6, "grain_b": 0.04}  # level stripes


def match(head, images: StereoImages, **config) -> np.ndarray:
    disparity = StereoMatcher(head.camera(), cfg.Disparity(**config))(images)
    assert disparity.dtype == np.float32
    assert disparity.shape == (head.height, head.width)
    return disparity


def vertical_pair_only(images: StereoImages) -> StereoImages:
    """The same with a right image in which nothing can be matched."""
    return dataclasses.replace(images, right=np.full_like(images.right, 128))


@pytest.fixture(scope="module")
def head(make_head):
    return make_head()


@pytest.fixture(scope="module")
def wall_images(head, rectangle) -> StereoImages:
    return head.draw(rectangle(**WALL))[0]


# ---------------------------------------------------------------------- padding ----


@pytest.mark.parametrize(
    "config",
    [
        {},
        {"fill_block_size_px": 0},
        {
            "block_size_px": 5,
            "fill_block_size_px": 0,
            "pre_filter_cap": 31,
            "left_right_difference_px": 1,
        },
        {"block_size_px": 21},
        PAPERS,
        {"min_range": 0.3},  # 48 px are searched
        {"pre_filter": "normalized_response"},
    ],
    ids=str,
)
def test_no_column_with_a_match_is_lost(head, wall_images, config):
    disparity = match(head, wall_images, **config)
    columns = np.isfinite(disparity).mean(axis=0)
    # Their match lies left of the right image; small blocks alone leave more of them.
    small = {"block_size_px", "pre_filter"}.isdisjoint(config)
    assert columns[:6].mean() < (0.2 if small else 0.15)
    assert columns[6:].min() > 0.5  # a small block alone leaves 0.6 of the last one
    assert columns[6:].mean() > 0.95
    assert np.nanmedian(disparity) == pytest.approx(DISPARITY, abs=1 / 16)


@pytest.mark.parametrize(
    ("top", "seen", "unseen"),
    [(ABOVE, slice(0, 114), slice(114, 120)), (BELOW, slice(6, 120), slice(0, 6))],
    ids=["above", "below"],
)
@pytest.mark.parametrize(("config", "false_matches"), [(PAPERS, 0.01), ({}, 0.15)], ids=str)
def test_no_row_with_a_match_is_lost(
    make_head, rectangle, top, seen, unseen, config, false_matches
):
    trinocular = make_head(positions={"top": top})
    images = vertical_pair_only(trinocular.draw(rectangle(**WALL))[0])
    disparity = match(trinocular, images, **config)
    rows = np.isfinite(disparity).mean(axis=1)
    assert rows[unseen].mean() < false_matches  # their match lies outside the top image
    assert rows[seen].min() > 0.8
    assert rows[seen].mean() > 0.98
    assert np.nanmedian(disparity) == pytest.approx(DISPARITY, abs=1 / 16)


# ------------------------------------------------------------------ second pass ----


def test_second_pass_fills_only_the_holes_of_the_first(head, rectangle):
    strip = {"corner": (1.5, 0.1, -3), "side_a": (0, -0.2, 0), "side_b": (0, 0, 6), "seed": 3}
    images, _ = head.draw(rectangle(**WALL), rectangle(**strip))
    # A cap up to 31, for with larger ones OpenCV's small blocks do not repeat themselves.
    first, second, both = (
        match(head, images, pre_filter_cap=31, block_size_px=block, fill_block_size_px=fill)
        for block, fill in ((7, 0), (11, 0), (7, 11))
    )
    inner = (slice(8, -8), slice(8, -8))  # at the border the padding counts, which differs
    expected = np.where(np.isnan(first), second, first)[inner]
    np.testing.assert_array_equal(both[inner], expected)
    filled = np.isnan(first[inner]) & np.isfinite(expected)
    assert filled.sum() > 100


# ------------------------------------------------------------------- trinocular ----


@pytest.mark.parametrize("top", [ABOVE, BELOW], ids=["above", "below"])
def test_each_pair_fills_the_holes_of_the_other(make_head, rectangle, top):
    binocular, trinocular = make_head(), make_head(positions={"top": top})
    for stripes, seen_by_two in ((ROWS_ALIKE, True), (COLUMNS_ALIKE, False)):
        images, _ = trinocular.draw(rectangle(**stripes))
        two, three = match(binocular, images), match(trinocular, images)
        assert np.isfinite(two).mean() == pytest.approx(0.96 if seen_by_two else 0.0, abs=0.03)
        assert np.isfinite(three).mean() > 0.85
        assert np.nanmedian(three) == pytest.approx(DISPARITY, abs=1 / 16)


@pytest.mark.parametrize(
    ("top", "centres"),
    [
        ((0, -0.2), {}),  # 10.5 px in the vertical pair, 5.3 px in the horizontal
        ((0, 0.05), {}),
        (ABOVE, {"left": (82, 60), "right": (79, 60), "top": (82, 65)}),
        (BELOW, {"left": (82, 60), "right": (79, 60), "top": (82, 55)}),
    ],
)
def test_vertical_disparities_are_in_pixels_of_the_horizontal_pair(
    make_head, rectangle, top, centres
):
    trinocular = make_head(positions={"top": top}, centres=centres)
    disparity = match(trinocular, vertical_pair_only(trinocular.draw(rectangle(**WALL))[0]))
    assert np.isfinite(disparity).mean() > 0.85
    expected = DISPARITY + trinocular.camera().disparity_offset_px
    assert np.nanmedian(disparity) == pytest.approx(expected, abs=0.15)


@pytest.mark.parametrize("top", [ABOVE, BELOW], ids=["above", "below"])
def test_disagreeing_pairs_give_no_disparity(make_head, rectangle, top):
    trinocular = make_head(positions={"top": top})
    images, _ = trinocular.draw(rectangle(**WALL))
    shift = -2 if top is ABOVE else 2
    moved = dataclasses.replace(images, top=np.roll(images.top, -shift, axis=0))  # + 2 px
    inner = (slice(12, 108), slice(12, 150))
    assert np.isnan(match(trinocular, moved)[inner]).mean() > 0.98
    tolerant = match(trinocular, moved, trinocular_difference_px=2.5)
    assert np.nanmedian(tolerant[inner]) == pytest.approx(DISPARITY + 1.0, abs=0.1)  # the mean


def test_binocular_head_ignores_the_top_image(head, wall_images):
    with_top = dataclasses.replace(wall_images, top=np.zeros_like(wall_images.left))
    # With a larger cap OpenCV's small blocks do not repeat themselves.
    binocular, other = (match(head, seen, pre_filter_cap=31) for seen in (wall_images, with_top))
    np.testing.assert_array_equal(other, binocular)


@pytest.mark.parametrize(
    ("horizontal", "vertical", "joined"),
    [
        (4.0, 4.5, 4.25),  # both: the mean
        (4.0, 5.0, 4.5),  # the limit is inclusive
        (5.0, 4.0, 4.5),
        (4.0, 5.0625, NAN),  # no agreement
        (5.0625, 4.0, NAN),
        (4.0, NAN, 4.0),  # one
        (NAN, 4.0, 4.0),
        (NAN, NAN, NAN),
        (0.0, NAN, 0.0),
    ],
)
def test_combination_matches_hand_computed_values(horizontal, vertical, joined):
    one, other = np.full((2, 2, 3), NAN, dtype=np.float32)
    one[1, 2], other[1, 2] = horizontal, vertical
    before = one.copy(), other.copy()
    result = combine(one, other, max_difference_px=1.0)
    expected = np.full((2, 3), NAN)
    expected[1, 2] = joined
    np.testing.assert_array_equal(result, expected)
    assert result.dtype == np.float32
    np.testing.assert_array_equal((one, other), before)


def test_combination_of_nothing_is_empty():
    none = np.empty((0, 5), dtype=np.float32)
    assert combine(none, none, max_difference_px=1.0).shape == (0, 5)


# ------------------------------------------------------------------- parameters ----


@pytest.mark.parametrize("distance", [0.72, 1.0, 3.0, 4.8])
def test_search_covers_the_working_range(head, rectangle, distance):
    wall = {"corner": (distance, 4, -3), "side_a": (0, -8, 0), "side_b": (0, 0, 8)}
    images, _ = head.draw(rectangle(**wall, grain=distance / 50))
    disparity = match(head, images)
    assert np.nanmedian(disparity) == pytest.approx(10.546 / distance, abs=0.08)
    assert np.isfinite(disparity[:, 16:]).mean() > 0.95


@pytest.mark.parametrize(
    "change",
    [
        {"pre_filter": "normalized_response"},
        {"pre_filter": "normalized_response", "pre_filter_size_px": 31},
        {"pre_filter_cap": 5},
        {"block_size_px": 9},
        {"fill_block_size_px": 0},
        {"uniqueness_ratio": 60},
        {"texture_threshold": 3000},
        {"left_right_difference_px": 1},
    ],
    ids=str,
)
def test_each_parameter_has_its_effect(head, wall_images, change):
    noise = np.random.default_rng(0).normal(0, 25, (2, 120, 160))
    noisy = StereoImages(
        0,
        np.clip(wall_images.left + noise[0], 0, 255).astype(np.uint8),
        np.clip(cv2.GaussianBlur(wall_images.right, (5, 5), 1) + noise[1], 0, 255).astype(np.uint8),
    )
    base: dict[str, object] = {"pre_filter_cap": 31}
    if len(change) > 1:
        base["pre_filter"] = "normalized_response"
    before = match(head, noisy, **base)
    np.testing.assert_array_equal(match(head, noisy, **base), before)
    assert not np.array_equal(match(head, noisy, **{**base, **change}), before, equal_nan=True)


def test_new_matchers_give_the_same_whatever_was_in_memory(head, wall_images):
    noise = np.random.default_rng(0).normal(0, 25, (2, 120, 160))
    left, right = (
        np.clip(image + more, 0, 255).astype(np.uint8)
        for image, more in zip((wall_images.left, wall_images.right), noise, strict=True)
    )
    found = []
    for level in (0, 85, 170, 255):
        freed = [np.full(size, level, np.uint8) for size in 2 ** np.arange(10, 21) for _ in "1234"]
        del freed
        found.append(match(head, StereoImages(0, left, right)))
    for one in found[1:]:
        np.testing.assert_array_equal(one, found[0])


@pytest.mark.parametrize("change", [{"pre_filter_cap": 32}, {"fill_block_size_px": 23}], ids=str)
def test_matching_back_with_a_large_cap_or_window_is_refused(change):
    # OpenCV compares costs that it has not written there.
    checked = {"pre_filter_cap": 31, "left_right_difference_px": 1}
    cfg.Disparity(**checked)
    wanted = (
        r"left_right_difference_px is 1 .*; allowed: -1, or a cap up to 31 and windows up to 21"
    )
    with pytest.raises(ConfigError, match=wanted):
        cfg.Disparity(**{**checked, **change})


def test_stereo_bm_has_the_configured_values():
    config = cfg.Disparity(
        pre_filter="normalized_response", pre_filter_size_px=31, pre_filter_cap=5, block_size_px=9,
        uniqueness_ratio=60, texture_threshold=3000, left_right_difference_px=3,
    )  # fmt: skip
    bm = make_stereo_bm(config, 48)
    assert bm.getPreFilterType() == cv2.STEREO_BM_PREFILTER_NORMALIZED_RESPONSE
    assert (bm.getPreFilterSize(), bm.getPreFilterCap()) == (31, 5)
    assert (bm.getBlockSize(), bm.getNumDisparities()) == (9, 48)
    assert (bm.getUniquenessRatio(), bm.getTextureThreshold()) == (60, 3000)
    assert bm.getDisp12MaxDiff() == 3
    assert make_stereo_bm(cfg.Disparity(), 16).getPreFilterType() == cv2.STEREO_BM_PREFILTER_XSOBEL


@pytest.mark.parametrize("grey", [0, 128, 255])
def test_images_without_texture_give_no_disparity(make_head, grey):
    flat = np.full((120, 160), grey, dtype=np.uint8)
    trinocular = make_head(positions={"top": ABOVE})
    assert np.isnan(match(trinocular, StereoImages(0, flat, flat, flat))).all()


def test_searched_disparities_match_hand_computed_values(make_head):
    trinocular = make_head(positions={"top": (0, -0.25)})
    for min_range, searched in ((1.0, (16, 32)), (0.7, (32, 48)), (0.35, (32, 80))):
        config = cfg.Disparity(min_range=min_range)
        assert StereoMatcher(trinocular.camera(), config).searched_px == searched
    assert StereoMatcher(make_head().camera(), cfg.Disparity()).searched_px == (32,)


@pytest.mark.parametrize(("positions", "ms"), [({}, 2.0), ({"top": ABOVE}, 4.0)])
def test_time_of_stereo_bm_is_measured(make_head, wall_images, monkeypatch, positions, ms):
    matcher = StereoMatcher(make_head(positions=positions).camera(), cfg.Disparity())
    assert matcher.stereo_bm_ms == 0.0
    clock = itertools.count(7_000_000, 2_000_000)
    monkeypatch.setattr(timing, "now_ns", lambda: next(clock))
    for _ in range(2):  # that of the last call
        matcher(dataclasses.replace(wall_images, top=wall_images.left))
        assert matcher.stereo_bm_ms == ms


# ----------------------------------------------------------------------- errors ----


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        # 15.07 px and one for the sixteenths: 32 px are searched
        ({"width": 32}, "disparity.min_range = 0.7 m asks for 32 px .* image of 32 px; allow"),
        ({"height": 24, "positions": {"top": (0, -0.1)}}, "asks for 32 px .* image of 24 px"),
        ({"positions": {"right": (1.0, 0.0)}}, "asks for 160 px .* image of 160 px"),
    ],
)
def test_range_too_large_for_the_image_is_refused(make_head, changes, message):
    with pytest.raises(CameraError, match=message):
        StereoMatcher(make_head(**changes).camera(), cfg.Disparity())


def test_images_of_another_size_are_refused(head):
    small = np.zeros((60, 80), dtype=np.uint8)
    with pytest.raises(ImageError, match="images are 80x60; wanted as the camera: 160x120"):
        match(head, StereoImages(0, small, small))


def test_a_missing_top_image_is_refused(make_head, wall_images):
    with pytest.raises(ImageError, match="trinocular but there is no top image"):
        match(make_head(positions={"top": ABOVE}), wall_images)

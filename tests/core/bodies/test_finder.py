import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from mrs_people_loc import config as cfg
from mrs_people_loc.bodies import network
from mrs_people_loc.bodies.finder import Bodies, BodyFinder, CandidateEvidence, cells_of, points_of
from mrs_people_loc.bodies.model import (
    DEPTH,
    EVEN,
    ODD,
    BodyModel,
    Evidence,
    Layered,
    Linear,
    Scaled,
    fitted,
)
from mrs_people_loc.bodies.patches import ACROSS, HEIGHTS, Patches
from mrs_people_loc.bodies.search import Candidates
from mrs_people_loc.bodies.votes import Vote
from mrs_people_loc.config import Mounting
from mrs_people_loc.errors import ConfigError
from mrs_people_loc.sensing.images import StereoImages
from mrs_people_loc.timing import StageTimes

SHAPE = (len(HEIGHTS), len(ACROSS))
SCALE = 10.0  # focal length times baseline of the heads here [px m]
FLAT = StereoImages(0, *(np.full((120, 160), 128, dtype=np.uint8) for _ in range(2)))
NOTHING = np.full((120, 160), np.nan, dtype=np.float32)
TILTED = Mounting(height=1.9, forward=0.2, left=-0.3, pitch=0.35, roll=0.1, yaw=2.0)


def model_of(*, score=0.0, across=0.0, depth=0.0, across_sigma=0.06, depth_sigma_px=0.2):
    """A model that says the same of everything; the score adds the first even number."""

    def linear(width: int, value: float) -> Linear:
        return Linear(Scaled(np.zeros(width), np.ones(width)), np.zeros(width), value)

    first = np.zeros((EVEN, 1))
    first[0] = 1e-5  # so small that tanh is linear
    return BodyModel(
        human=Layered(
            Scaled(np.zeros(EVEN), np.ones(EVEN)), first, np.zeros(1), np.array([1e5]), score
        ),
        across=linear(ODD, across),
        depth=linear(DEPTH, depth),
        across_log_sigma=linear(EVEN, math.log(across_sigma)),
        depth_log_sigma=linear(EVEN, math.log(depth_sigma_px)),
        appearance=fitted().appearance,
    )


def finder_of(head, model=None, appearance=False, **config) -> BodyFinder:
    parameters = cfg.Bodies(appearance=appearance, **config)
    return BodyFinder(head.camera(), parameters, min_range=0.7, model=model)


def judged(finder, view) -> Bodies:
    return finder.judge(view, FLAT.left, StageTimes())


@pytest.fixture
def head(make_head):
    return make_head(fx=100.0, fy=100.0)


def patches_of(difference, bearing=None, inverse_range=None, tolerance=0.5) -> Patches:
    difference = np.array(difference, dtype=np.float32).reshape(-1, *SHAPE)
    n = len(difference)
    inverse = np.full(n, 5.0) if inverse_range is None else np.array(inverse_range, dtype=float)
    return Patches(
        bearing=np.zeros(n) if bearing is None else np.array(bearing, dtype=float),
        inverse_range=inverse,
        u=np.zeros_like(difference),
        v=np.zeros_like(difference),
        expected=np.ones_like(difference) * inverse[:, None, None].astype(np.float32),
        difference=difference,
        inside=np.isfinite(difference),
        tolerance=np.full(n, tolerance),
    )


def view_of(bearing, ranges, *, score=0.0, shift=0.0, extent=1.0, top=1.7) -> CandidateEvidence:
    """Bodies 0.4 m wide at some bearings and ranges; `score` is the first even number of each."""
    bearing, inverse = np.array(bearing, dtype=float), SCALE / np.array(ranges, dtype=float)
    n = len(bearing)
    difference = np.full((n, *SHAPE), -9.0)
    difference[:, np.ix_(top > HEIGHTS, np.abs(ACROSS) < 0.21)[0], np.abs(ACROSS) < 0.21] = 0.0
    even = np.zeros((n, EVEN))
    even[:, 0] = score
    return CandidateEvidence(
        Candidates(bearing, inverse, np.full(n, extent)),
        patches_of(difference, bearing, inverse),
        dataclasses.replace(Vote.nothing(n), shift=np.full(n, shift)),
        Evidence(even, np.zeros((n, ODD)), np.zeros((n, DEPTH))),
    )


# -------------------------------------------------------------------------------- judge ----


def test_axis_matches_hand_computed_values(head):
    # 2.5 m away at 30 degrees: 4 px. The model adds 1 px, that is 2 m, and 0.2 m to the left.
    model = model_of(score=1.5, across=0.2, depth=1.0, across_sigma=0.05, depth_sigma_px=0.1)
    bodies = judged(finder_of(head, model), view_of([math.pi / 6], [2.5], score=0.25, shift=0.3))
    assert len(bodies) == 1
    c, s = math.cos(math.pi / 6), math.sin(math.pi / 6)
    assert bodies.x == pytest.approx([2 * c - 0.2 * s])
    assert bodies.y == pytest.approx([2 * s + 0.2 * c])
    assert bodies.range == pytest.approx([math.hypot(2.0, 0.2)])
    assert bodies.bearing == pytest.approx([math.pi / 6 + math.atan(0.1)])
    assert bodies.score == pytest.approx([1.75])
    assert bodies.sigma_across == pytest.approx([0.05])
    assert bodies.sigma_range == pytest.approx([0.1 * 2 * 2 / SCALE])  # a pixel is 0.4 m


def test_without_the_model_results_match_hand_computed_values(head):
    model = model_of(score=-9.0, across=0.2, depth=1.0)
    finder = finder_of(head, model, axis=False, human_test=False)
    bodies = judged(finder, view_of([0.1], [2.5], shift=1.0, extent=1.3))
    assert bodies.range == pytest.approx([2.0])
    assert bodies.bearing == pytest.approx([0.1])
    assert bodies.score == pytest.approx([1.3])
    assert bodies.sigma_range == pytest.approx([math.hypot(0.06, 0.3 * 2 * 2 / SCALE)])
    assert bodies.sigma_across == pytest.approx([0.06])


def test_sigma_along_the_line_of_sight_is_4_cm_at_least(head):
    for sigma_px, sigma in ((0.06, 0.04), (0.2, 0.08)):  # at 2 m, where a pixel is 0.4 m
        model = model_of(depth_sigma_px=sigma_px)
        bodies = judged(finder_of(head, model), view_of([0.0], [2.0], score=1.0))
        assert bodies.sigma_range == pytest.approx([sigma])


def test_lens_offset_from_the_robots_origin_is_included(make_head):
    mounting = Mounting(height=1.3, forward=0.3, left=-0.5, yaw=1.0)
    head = make_head(fx=100.0, fy=100.0, mounting=mounting)
    bodies = judged(finder_of(head, model_of()), view_of([math.pi / 2], [2.0]))
    assert (bodies.x[0], bodies.y[0]) == pytest.approx((0.3, 1.5))


def test_no_body_is_found_beyond_infinity(head):
    bodies = judged(finder_of(head, model_of(depth=-9.0)), view_of([0.0], [2.0]))
    assert bodies.range == pytest.approx([1.5 * 6.0])  # half as far again as bodies.max_range


@pytest.mark.parametrize(
    ("beside", "behind", "kept"),
    [
        (0.0, 0.0, 1),
        (0.25, 0.0, 1),
        (0.35, 0.0, 1),  # nearer than 0.36 m
        (0.38, 0.0, 2),
        (0.0, 0.3, 1),
        (0.25, 0.6, 1),  # within 2 sigma along the line of sight
        (0.25, 0.8, 2),
        (0.35, 0.6, 2),
    ],
)
def test_of_two_bodies_in_one_place_one_is_kept(head, beside, behind, kept):
    # 0.42 px are 0.168 m at 2 m and 0.284 m at 2.6 m, 2 sigma of both 0.66 m; at 2.8 m 0.74 m.
    model = model_of(depth_sigma_px=0.42)
    bearing, distance = beside / 2.0, 2.0 + behind
    view = view_of([0.0, bearing], [2.0, distance], score=[1.0, 2.0])
    finder = finder_of(head, model)
    bodies = judged(finder, view)
    assert len(bodies) == kept
    assert bodies.score[0] == pytest.approx(2.0)  # the likelier one stays
    assert bodies.range[0] == pytest.approx(distance)


@pytest.mark.parametrize(
    ("scores", "kept"),
    [
        ([5.0, 8.0, 4.0], [5.0, 4.0]),  # together more than what lies between them
        ([3.0, 8.0, 4.0], [8.0]),
        ([7.0, 8.0, 1.9], [8.0]),  # one of the two is doubtful
        ([7.9, 7.0, 1.9], [7.9, 1.9]),
    ],
)
def test_two_people_side_by_side_take_the_place_of_what_lies_between_them(head, scores, kept):
    scores = np.array(scores) - 4.0
    view = view_of([-0.1, 0.0, 0.1], [2.0] * 3, score=scores)  # 0.2 m and 0.4 m from each other
    bodies = judged(finder_of(head, model_of(score=4.0)), view)
    np.testing.assert_allclose(sorted(bodies.score, reverse=True), kept, atol=1e-5)


def test_two_on_one_side_of_a_likelier_body_do_not_take_its_place(head):
    # Both are on its left, one behind the other.
    view = view_of([0.0, 0.1, 0.1], [2.0, 1.8, 2.25], score=[3.0, 2.5, 2.5])
    bodies = judged(finder_of(head, model_of(depth_sigma_px=0.01)), view)
    np.testing.assert_allclose(bodies.score, [3.0], atol=1e-5)


def test_bodies_are_sorted_by_score_and_low_scores_are_dropped(head):
    view = view_of([-0.6, -0.2, 0.2, 0.6], [2.0, 2.5, 3.0, 3.5], score=[0.5, -3.1, 2.0, -2.9])
    finder = finder_of(head, model_of())
    bodies = judged(finder, view)
    np.testing.assert_allclose(bodies.score, [2.0, 0.5, -2.9], atol=1e-5)
    np.testing.assert_allclose(bodies.range, [3.0, 2.0, 3.5])
    np.testing.assert_allclose(bodies.patches.bearing, [0.2, -0.6, 0.6])  # each with its patch
    assert len(judged(finder_of(head, model_of(score=-9.0)), view)) == 0


@pytest.mark.parametrize("off", ["appearance", "human_test"])
def test_network_is_read_only_if_appearance_counts(head, monkeypatch, off):
    monkeypatch.setattr(network, "_FEATURES", "absent.onnx")
    finder_of(head, **{"appearance": True, off: False})
    with pytest.raises(ConfigError, match="absent.onnx"):
        finder_of(head, appearance=True)


@pytest.mark.parametrize("n", [0, 1])
def test_view_without_candidates_gives_no_bodies(head, n):
    finder = finder_of(head, model_of(), vote=bool(n), axis=bool(n))
    view = finder.look(NOTHING, FLAT, StageTimes())
    assert len(view.candidates) == len(view.patches) == len(view.vote.shift) == 0
    bodies = finder(NOTHING, FLAT, StageTimes())
    assert len(bodies) == 0
    assert points_of(bodies).shape == (0, 3)
    assert len(cells_of(bodies)) == 0


# --------------------------------------------------------------------------------- tops ----


def test_background_match_above_a_body_is_not_its_top(head):
    view = view_of([0.0], [2.0], top=1.95)
    contrast = np.where(HEIGHTS > 1.6, -0.5, 0.5).astype(np.float32)
    vote = dataclasses.replace(view.vote, contrast=np.broadcast_to(contrast[:, None], (1, *SHAPE)))
    above = judged(finder_of(head, model_of()), view).top[0]
    below = judged(finder_of(head, model_of()), dataclasses.replace(view, vote=vote)).top[0]
    assert above == pytest.approx(1.95, abs=0.0376)
    assert below == pytest.approx(1.6, abs=0.0376)


def top_of(head, same) -> float:
    """Top of a body whose samples at these heights are its own, all across."""
    difference = np.full(SHAPE, -9.0)
    difference[same] = 0.0
    view = view_of([0.0], [2.0])
    view = CandidateEvidence(view.candidates, patches_of(difference), view.vote, view.evidence)
    return float(judged(finder_of(head, model_of()), view).top[0])


@pytest.mark.parametrize("top", [1.0, 1.37, 1.7, 1.95])
def test_tops_match_hand_computed_values(head, top):
    assert top_of(head, top > HEIGHTS) == pytest.approx(top, abs=0.0376)


def test_top_continues_across_small_gaps_and_stops_at_large_ones(head):
    body = HEIGHTS < 1.3
    neck = body | ((HEIGHTS > 1.42) & (HEIGHTS < 1.7))  # two samples are missing
    assert top_of(head, neck) == pytest.approx(1.7, abs=0.04)
    lamp = body | ((HEIGHTS > 1.5) & (HEIGHTS < 1.9))  # three samples are missing
    assert top_of(head, lamp) == pytest.approx(1.3, abs=0.04)
    everything = HEIGHTS > 0
    assert top_of(head, everything) == pytest.approx(HEIGHTS[-1], abs=0.04)
    nothing = HEIGHTS < 0
    assert top_of(head, nothing) < 0.9


# -------------------------------------------------------------------------------- cells ----


def bodies_of(seed: int, n: int) -> Bodies:
    """Bodies with silhouettes of any shape, some of them with none."""
    rng = np.random.default_rng(seed)
    difference = rng.normal(0.0, 1.0, (n, *SHAPE))
    difference[rng.uniform(size=difference.shape) < rng.uniform(size=(n, 1, 1))] = np.nan
    difference[rng.uniform(size=n) < 0.2] = np.nan
    score, sigma_range, sigma_across, top = rng.uniform(0.1, 2.0, (4, n))
    x, y, bearing, distance = rng.uniform(-3.0, 3.0, (4, n))
    return Bodies(
        x=x,
        y=y,
        bearing=bearing,
        range=np.abs(distance),
        score=score,
        sigma_range=sigma_range,
        sigma_across=sigma_across,
        top=top,
        patches=patches_of(difference, bearing),
    )


@given(st.integers(0, 10**6), st.integers(0, 6))
def test_each_cell_belongs_to_its_body(seed, n):
    bodies = bodies_of(seed, n)
    cells, points = cells_of(bodies), points_of(bodies)
    assert points.dtype == np.float32
    assert sorted(set(cells.body)) == list(range(1, n + 1))  # nobody is lost
    assert cells.count.sum() == len(points)
    assert (cells.count > 0).all()
    assert (cells.z_min <= cells.z).all()
    assert (points[:, 2] > 0.2).all()
    assert (points[:, 2] < 1.95).all()
    for number in range(n):
        mine = cells.body == number + 1
        for axis in ("x", "y"):
            mean = np.average(getattr(cells, axis)[mine], weights=cells.count[mine])
            assert mean == pytest.approx(getattr(bodies, axis)[number], abs=1e-5)
        for name in ("score", "sigma_range", "sigma_across", "top"):
            np.testing.assert_allclose(
                getattr(cells, name)[mine], getattr(bodies, name)[number], rtol=1e-6
            )
        # On a line across the line of sight, as wide as a silhouette may be.
        along = np.cos(bodies.bearing[number]) * (cells.x[mine] - bodies.x[number])
        along += np.sin(bodies.bearing[number]) * (cells.y[mine] - bodies.y[number])
        np.testing.assert_allclose(along, 0.0, atol=1e-5)
        assert np.hypot(np.ptp(cells.x[mine]), np.ptp(cells.y[mine])) < 0.66


def test_cells_match_hand_computed_values():
    # A body of three columns, seen from bearing 90 degrees: its left is -x.
    difference = np.full(SHAPE, np.nan)
    low, high = np.abs(HEIGHTS - 0.4).argmin(), np.abs(HEIGHTS - 1.6).argmin()
    middle = len(ACROSS) // 2
    difference[low : high + 1, middle : middle + 2] = 0.1
    difference[low, middle - 1] = -0.49
    difference[high, middle - 1] = 0.51  # beyond the tolerance
    difference[high, middle + 9] = 0.0  # 0.45 m beside
    difference[0, middle] = difference[-1, middle] = 0.0  # a foot, a lamp
    one = np.ones(1)
    bodies = Bodies(
        1.0 * one, 2.0 * one, math.pi / 2 * one, 2.0 * one, one, one, one, 1.65 * one,
        patches_of(difference),
    )  # fmt: skip
    cells = cells_of(bodies)
    rows = high + 1 - low
    np.testing.assert_array_equal(cells.count, [1, rows, rows])
    mean = (-0.05 + 0.05 * rows) / (2 * rows + 1)
    np.testing.assert_allclose(cells.x, 1.0 - (np.array([-0.05, 0.0, 0.05]) - mean), atol=1e-6)
    np.testing.assert_allclose(cells.y, 2.0, atol=1e-6)
    np.testing.assert_allclose(cells.z_min, [0.4] * 3, atol=1e-6)
    np.testing.assert_allclose(cells.z, [0.4, 1.6, 1.6], atol=1e-6)
    np.testing.assert_allclose(cells.top, 1.65)
    points = points_of(bodies)
    np.testing.assert_allclose(sorted(set(points[:, 0])), sorted(cells.x), atol=1e-6)
    np.testing.assert_allclose(np.unique(points[:, 2]), HEIGHTS[low : high + 1])


# -------------------------------------------------------------------------- drawn views ----


@settings(max_examples=20)
@given(
    st.sampled_from([Mounting(), TILTED]),
    st.floats(1.9, 3.2),
    st.floats(-0.25, 0.25),
    st.floats(1.4, 1.8),
)  # fmt: skip
def test_simulated_body_is_found_at_its_position(
    make_head, rectangle, mounting, distance, beside, height
):
    head = make_head(width=240, height=180, fx=140.0, fy=140.0, mounting=mounting)
    bearing = mounting.yaw + beside
    cos, sin = math.cos(bearing), math.sin(bearing)
    x, y = mounting.forward + distance * cos, mounting.left + distance * sin
    front = rectangle(
        corner=(x - 0.2 * sin, y + 0.2 * cos, 0),
        side_a=(0.4 * sin, -0.4 * cos, 0),
        side_b=(0, 0, height),
    )
    images, _ = head.draw(front)
    bodies = finder_of(head, model_of(), axis=False)(head.disparity(front), images, StageTimes())
    assert len(bodies) == 1
    assert (bodies.x[0], bodies.y[0]) == pytest.approx((x, y), abs=0.05)
    assert bodies.top[0] == pytest.approx(height, abs=0.06)

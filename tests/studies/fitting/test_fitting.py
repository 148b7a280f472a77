"""`mrs fit`: what it learns from examples, and what it takes for examples."""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import yaml

from mrs_people_loc.bodies.model import DEPTH, EVEN, ODD, BodyModel, Evidence
from mrs_people_loc.config import Mounting
from mrs_people_loc.errors import BagError, PeopleLocError
from mrs_people_loc.sensing.camera import StereoCamera

pytest.importorskip("rosbags.interfaces", reason="reading bags needs rosbags")
pytest.importorskip("typer", reason="the mrs command needs typer")
pytest.importorskip("scipy", reason="fitting needs scipy")

from typer.testing import CliRunner

from mrs_people_loc.arrays import Bool, Float
from mrs_people_loc.bodies.finder import BodyTuning, CandidateEvidence
from mrs_people_loc.bodies.patches import PatchSampler
from mrs_people_loc.bodies.search import Candidates, SearchTuning
from mrs_people_sim.evaluation.labels import Label, Labels
from mrs_studies.fitting import examples as examples_module
from mrs_studies.fitting import regression
from mrs_studies.fitting.body_fit import (
    Parts,
    check_enough,
    combination,
    fit_offsets,
    held_out,
    held_out_scores,
    true_range,
)
from mrs_studies.fitting.examples import (
    Examples,
    empty_examples,
    examples_of,
    labelled_examples,
)
from mrs_studies.fitting.validation import cross_validate, figures, real_rooms, table
from mrs_studies.recordings.depth_views import stereo_view
from mrs_tools.cli import app
from tools.box_room import BOX, CAMERA, person, picture

ROOT = Path(__file__).resolve().parents[3]


def log_odds_of(person: Bool, rng: np.random.Generator) -> Float:
    """People have more."""
    return rng.normal(0.0, 1.0, len(person)) + 2.0 * person


def examples(count: int, *, bags: int = 10, noise: float = 0.0, seed: int = 0) -> Examples:
    """People have a positive first even number; their axes are linear in the other evidence."""
    rng = np.random.default_rng(seed)
    even, odd, depth = (rng.normal(size=(count, width)) for width in (EVEN, ODD, DEPTH))
    even[:, 0] = rng.choice((-1.0, 1.0), count) * rng.uniform(0.5, 2.0, count)
    return Examples(
        even=even,
        odd=odd,
        depth=depth,
        away=np.where(even[:, 0] > 0, 0.5, 5.0),
        across=0.05 * odd[:, 0] - 0.03 * odd[:, 1] + rng.normal(0.0, noise, count),
        more_px=0.2 + 0.1 * depth[:, 0] + rng.normal(0.0, 2 * noise, count),
        inverse_range=rng.uniform(3.0, 6.0, count),
        scale=np.full(count, 10.0),
        robot=np.zeros(count, dtype=bool),
        bag=np.arange(count) % bags,
        network=log_odds_of(even[:, 0] > 0, rng),
    )


@pytest.fixture(scope="module", autouse=True)
def _small_network() -> Iterator[None]:
    """What is told apart here is told by one number; a small hidden layer is fitted fast."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(regression, "_HIDDEN", 2)
        yield


def fit(some: Examples) -> BodyModel:
    parts = Parts.fit(some)
    return parts.model(combination(some, held_out_scores(some, held_out(some))))


@pytest.fixture(scope="module")
def fitted() -> BodyModel:
    return fit(examples(4000, noise=0.02))


# ----------------------------------------------------------------------------- examples ----


def test_examples_are_labelled_by_distance() -> None:
    some = dataclasses.replace(
        examples(6),
        away=np.array([0.0, 0.99, 1.01, 1.99, 2.0, 0.5]),
        robot=np.array([False] * 5 + [True]),
    )
    np.testing.assert_array_equal(some.person, [True, True, False, False, False, False])
    np.testing.assert_array_equal(some.clear, [True, True, False, False, True, False])
    chosen = some.select(some.person)
    assert len(chosen) == 2
    np.testing.assert_array_equal(chosen.depth, some.depth[:2])
    both = Examples.joined([chosen, some])
    np.testing.assert_array_equal(both.away, [0.0, 0.99, *some.away])
    assert both.even.shape == (8, EVEN)


def view_of(camera: StereoCamera, bearing: list[float], ranges: list[float]) -> CandidateEvidence:
    """Candidates at some bearings and ranges."""
    n = len(bearing)
    nothing = np.full((camera.height, camera.width), np.nan, dtype=np.float32)
    places = np.array(bearing, dtype=float), camera.depth_disparity / np.array(ranges, dtype=float)
    return CandidateEvidence(
        Candidates(*places, np.ones(n)),
        PatchSampler(camera)(nothing, *places),
        np.zeros(n),
        Evidence(np.zeros((n, EVEN)), np.zeros((n, ODD)), np.zeros((n, DEPTH))),
    )


def test_labels_of_candidates_match_hand_computed_values() -> None:
    # 10 px m. The robot is at (1, 2) and looks along +y; its lens is 0.5 m ahead, at (1, 2.5).
    camera = StereoCamera(
        width=160, height=120, fx=100, fy=100, cx=79.5, cy=59.5, baseline=0.1,
        mounting=Mounting(forward=0.5),
    )  # fmt: skip
    pose = np.array([1.0, 2.0, math.pi / 2])
    # 2 m from the lens: where somebody stands 0.1 m to the left and 0.5 m farther away, where
    # nobody does, and where a robot does. 4 m to the left: somebody who is not there (NaN).
    view = view_of(camera, [0.0, math.pi / 4, -math.pi / 4, math.pi / 2], [2.0, 2.0, 2.0, 4.0])
    people = np.array([(0.9, 5.0), (math.nan, math.nan), (-3.0, 9.0)])
    others = np.array([(1.0 + math.sqrt(2), 2.5 + math.sqrt(2) + 0.2)])
    network = log_odds_of(np.zeros(4, dtype=bool), np.random.default_rng(0))
    got = examples_module._examples(camera, view, pose, people, others, 7, network)
    far = math.hypot(0.1, 2.5)
    allowed = 0.2 + 0.7 * far**2 / 10
    assert got.away[0] == pytest.approx(math.hypot(0.1 / 0.2, 0.5 / allowed))
    assert got.across[0] == pytest.approx(0.1)
    assert got.more_px[0] == pytest.approx(10 / 2.5 - 10 / 2.0)
    assert (got.away[1:] > 2.0).all()
    np.testing.assert_array_equal(got.robot, [False, False, True, False])
    np.testing.assert_array_equal(got.person, [True, False, False, False])
    np.testing.assert_array_equal(got.bag, 7)


def test_candidates_without_truth_are_clear_negatives() -> None:
    camera = StereoCamera(width=160, height=120, fx=100, fy=100, cx=79.5, cy=59.5, baseline=0.1)
    nobody = np.empty((0, 2))
    network = log_odds_of(np.zeros(1, dtype=bool), np.random.default_rng(0))
    got = examples_module._examples(
        camera, view_of(camera, [0.1], [2.0]), np.zeros(3), nobody, nobody, 0, network
    )
    assert not got.person.any()
    assert got.clear.all()
    none = examples_module._examples(
        camera,
        view_of(camera, [], []),
        np.zeros(3),
        np.ones((2, 2)),
        nobody,
        0,
        network[:0],
    )
    assert len(none) == 0
    assert none.robot.shape == (0,)


# ------------------------------------------------------------------------------- fitting ----


@pytest.mark.slow
def test_separable_examples_are_learned(fitted: BodyModel) -> None:
    new = examples(500, seed=1)
    score = fitted.human(new.even)
    assert ((score > 0) == new.person).mean() > 0.97
    assert np.abs(fitted.across(new.odd) - new.across).mean() < 0.015
    assert np.abs(fitted.depth(new.depth) - new.more_px).mean() < 0.02


@pytest.mark.slow
def test_fit_is_symmetric_in_left_and_right(fitted: BodyModel) -> None:
    odd = examples(50, seed=2).odd
    np.testing.assert_allclose(fitted.across(-odd), -fitted.across(odd), atol=1e-12)


@pytest.mark.slow
def test_fitted_sigmas_equal_the_size_of_the_errors(fitted: BodyModel) -> None:
    new = examples(2000, noise=0.02, seed=3)
    for name, error, sigma in (
        ("across", fitted.across(new.odd) - new.across, fitted.across_log_sigma(new.even)),
        ("depth", fitted.depth(new.depth) - new.more_px, fitted.depth_log_sigma(new.even)),
    ):
        within = np.abs(error) < 1.96 * np.exp(sigma)
        assert 0.9 < within[new.person].mean() < 0.995, name


@pytest.mark.slow
def test_outliers_do_not_bias_the_fit(fitted: BodyModel) -> None:
    some = examples(4000, noise=0.02)
    wrong = np.arange(len(some)) % 20 == 0
    some = dataclasses.replace(some, across=np.where(wrong, 0.5, some.across))
    pulled = fit_offsets(some.select(some.person))
    new = examples(300, seed=1)
    assert np.abs(pulled["across"](new.odd) - new.across).mean() < 0.03
    np.testing.assert_allclose(pulled["depth"].weights, fitted.depth.weights)


@pytest.mark.slow
def test_the_same_examples_give_the_same_file() -> None:
    one, other = (json.dumps(fit(examples(500)).to_mapping()) for _ in range(2))
    assert one == other
    BodyModel.from_mapping(json.loads(one))


@pytest.mark.parametrize(
    ("people", "others", "enough"),
    [(100, 100, True), (99, 200, False), (200, 99, False), (0, 200, False), (0, 0, False)],
)
def test_too_few_examples_are_refused(people: int, others: int, enough: bool) -> None:
    some = examples(people + others + 40)
    # The last ones do not count: robots, and what is neither here nor there.
    away = np.array([0.0] * people + [9.0] * others + [1.5] * 20 + [0.0] * 20)
    some = dataclasses.replace(some, away=away, robot=np.arange(len(some)) >= len(some) - 20)
    if enough:
        check_enough(some)
        return
    what = rf"{people} examples of people and {others} of other things; wanted: 100 of each"
    with pytest.raises(PeopleLocError, match=what):
        check_enough(some)


# ------------------------------------------------------------------------ cross-validation ----


@pytest.mark.slow
def test_figures_of_separable_examples_are_good() -> None:
    some = examples(2000, noise=0.02)
    got = figures(some, cross_validate(some)[0])
    assert got["examples"] == 2000
    assert got["people"] == some.person.sum()
    assert 0 < got["log loss"] < 0.08  # 0.056
    assert got["precision at recall 0.95"] > 0.99  # 1
    # The mean of what noise of 2 cm and 0.04 px does, and a little.
    assert 1.5 < got["error across, mean [cm]"] < 2.6
    assert 1.0 < got["error along, mean [cm]"] < 4.0
    assert 0.9 < got["in the 95 % ellipse"] < 0.98


def test_figures_of_inseparable_examples_are_at_chance() -> None:
    some = examples(600)
    people = np.random.default_rng(5).uniform(size=len(some)) < 0.5
    some = dataclasses.replace(some, away=np.where(people, 0.0, 9.0))
    got = figures(some, cross_validate(some)[0])
    assert got["log loss"] > 0.6
    assert got["precision at recall 0.95"] == pytest.approx(people.mean(), abs=0.08)


def test_cross_validation_never_scores_bags_of_the_fit(monkeypatch: pytest.MonkeyPatch) -> None:
    some = examples(2400, bags=12)
    seen: list[set[int]] = []
    parts = Parts.fit(some)

    def watched(part: Examples) -> Parts:
        seen.append(set(part.bag.tolist()))
        return parts

    monkeypatch.setattr(Parts, "fit", watched)
    cross_validate(some)
    held = [set(range(12)) - bags for bags in seen]
    assert all(held)
    assert sorted(bag for bags in held for bag in bags) == list(range(12))  # each just once


@pytest.mark.slow
def test_table_has_a_row_for_each_range_and_head() -> None:
    some = examples(1000, noise=0.02)
    other = dataclasses.replace(
        some, scale=2.0 * some.scale, inverse_range=2.0 * some.inverse_range
    )
    both = Examples.joined([some, other])
    lines = table(both, cross_validate(both)[0])
    far = (true_range(some) > 1.5) & (true_range(some) < 2.5) & some.person
    for scale in ("10.0", "20.0"):
        (row,) = (line for line in lines if line.startswith(f"{scale}   1.5-2.5"))
        mean, error = (float(row.split()[column]) for column in (3, 5))
        assert abs(mean) < 4.0 * error < 10.0
        assert int(row.split()[2]) == pytest.approx(far.sum(), abs=0.1 * far.sum())
        assert 0.85 < float(row.split()[-1]) <= 1.0


@pytest.mark.slow
def test_real_rooms_are_judged_by_the_others() -> None:
    some = examples(1500, noise=0.02)
    real = dataclasses.replace(examples(300, seed=4), bag=np.repeat([0, 1, 2], 100))
    parts = Parts.fit(some)
    scores = held_out_scores(some, held_out(some))
    lines = real_rooms(some, scores, real, ["lab", "hall", "lab"], parts)
    assert [line.split()[0] for line in lines[1:]] == ["hall", "lab"]
    people = [int(line.split()[1]) for line in lines[1:]]
    assert people == [int(real.person[100:200].sum()), int(real.person.sum() - people[0])]
    for line in lines[1:]:
        _, of_people, of_others, found, false = line.split()
        assert int(found) > 0.9 * int(of_people)
        assert int(false) < 0.1 * int(of_others)


# ---------------------------------------------------------------------------------- bags ----

SCENE = """
name: two
seed: 3
timing: {frames: 2, rate: 10.0}
room: {length: 6.0, width: 5.0}
people: [{x: 3.0, y: 2.2}, {x: 3.2, y: 3.2}]
robots: {robot_a: {x: 1.0, y: 2.5}, robot_b: {x: 5.4, y: 2.4, yaw: 3.14159}}
odometry: {mode: exact}
"""


@pytest.fixture(scope="module")
def bag(tmp_path_factory: pytest.TempPathFactory) -> Path:
    pytest.importorskip("embreex", reason="ray casting needs embreex, the extra sim")
    from mrs_people_sim.render_scene import simulate
    from mrs_people_sim.scene import read_scene

    out = tmp_path_factory.mktemp("bags") / "two"
    simulate(read_scene(yaml.safe_load(SCENE), "scene.yaml"), out)
    return out


def test_examples_of_a_bag_are_labelled(bag: Path) -> None:
    got = examples_of(bag, 4)
    # Two robots, two views each, two people in view, one of whom may be behind the other.
    assert got.person.sum() >= 4
    assert len(got) > got.person.sum()
    np.testing.assert_array_equal(got.bag, 4)
    person = got.select(got.person)
    assert np.abs(person.across).max() < 0.2
    assert np.isfinite(got.even).all()
    fewer = examples_of(bag, 4, views=1)
    assert 0 < len(fewer) < len(got)
    one_a_view = examples_of(bag, 4, tuning=BodyTuning(search=SearchTuning(apart=9.0)))
    assert 0 < len(one_a_view) < len(got)


def test_examples_of_a_labelled_bag_leave_out_whoever_need_not_be_found(bag: Path) -> None:
    def label(x: float, y: float, must: bool) -> Label:
        return Label(0, 0, (x, y), None, must, "stands", "map")

    stamp = 10**9
    labels = Labels(bag, stamp, 10**9, 1, False, [label(3.0, 2.2, True), label(3.2, 3.2, False)])
    got = labelled_examples(bag, labels, 4)
    all_found = dataclasses.replace(labels, people=[label(3.0, 2.2, True), label(3.2, 3.2, True)])
    both = labelled_examples(bag, all_found, 4)
    assert 0 < got.person.sum() < both.person.sum()
    assert len(got) <= len(both)
    assert (got.clear & ~got.person).any()


def test_whoever_is_found_in_a_room_without_people_is_a_false_example() -> None:
    seen = (*BOX, *person(2.5, 0.4)), ()
    views = [stereo_view(*picture(boxes), CAMERA) for boxes in seen]
    got = empty_examples(views, 7)
    assert len(got) > 0
    assert got.clear.all()
    assert not got.person.any()
    np.testing.assert_array_equal(got.bag, 7)
    again = empty_examples(views, 7)
    np.testing.assert_array_equal(got.even, again.even)


def test_true_poses_are_required() -> None:
    formation = ROOT / "bags" / "paper_formation"
    with pytest.raises(BagError, match=r"has no /ground_truth/robot_a/pose; wanted: a bag of"):
        examples_of(formation, 0)


def test_command_reports_missing_inputs(bag: Path, tmp_path: Path) -> None:
    out = tmp_path / "model.json"
    result = CliRunner().invoke(app, ["fit", str(bag), "--out", str(out), "--views", "1"])
    assert result.exit_code == 1
    assert "wanted: 100 of each" in result.output + result.stderr
    assert not out.exists()


def test_command_refuses_labels_without_recordings(tmp_path: Path) -> None:
    out = tmp_path / "model.json"
    result = CliRunner().invoke(
        app, ["fit", str(tmp_path), "--out", str(out), "--labels", str(tmp_path)]
    )
    assert result.exit_code == 2
    assert "--labels needs --real" in result.output + result.stderr

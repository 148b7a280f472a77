"""Regressions of `mrs fit` recover what the data were made with."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

pytest.importorskip("scipy", reason="fitting needs scipy")

from mrs_people_loc.arrays import Float
from mrs_people_loc.bodies.appearance import Scores
from mrs_people_loc.bodies.model import DEPTH, EVEN, ODD
from mrs_studies.fitting import regression
from mrs_studies.fitting.appearance_fit import fit_combination, shared_weights
from mrs_studies.fitting.body_fit import fit_offsets, range_weights, true_range
from mrs_studies.fitting.examples import Examples
from mrs_studies.fitting.regression import fit_linear, fit_quantile


def test_quantile_is_right_in_each_group() -> None:
    rng = np.random.default_rng(0)
    group = np.arange(4000) % 2
    target = rng.exponential(1.0 + 3.0 * group)
    columns = np.column_stack([group, np.ones(4000)]).astype(float)
    above = columns @ fit_quantile(columns, target, 0.95, weight=np.ones(4000))
    for one in (0, 1):
        assert (target < above)[group == one].mean() == pytest.approx(0.95, abs=0.01)
    # Those of the first group only, by their weights.
    only = fit_quantile(columns[:, 1:], target, 0.5, weight=2.0 * (group == 0))
    assert only[0] == pytest.approx(np.median(target[group == 0]), abs=0.05)


def test_linear_regression_is_unbiased_in_groups_where_that_is_asked_for() -> None:
    # Least squares draws the few far ones to the many near ones: what is measured is noisy.
    rng = np.random.default_rng(2)
    far = np.arange(3000) % 10 == 0
    truth = np.where(far, 1.0, 0.0)
    measured = (truth + rng.normal(0.0, 0.5, 3000))[:, np.newaxis]
    groups = np.column_stack([far, ~far]).astype(float)
    ones = np.ones(3000)
    common = {"size": 9.0 * ones, "weight": ones}
    drawn = fit_linear(measured, truth, **common)(measured)
    fair = fit_linear(measured, truth, groups=groups, **common)(measured)
    assert (drawn - truth)[far].mean() < -0.3
    assert abs((fair - truth)[far].mean()) < 0.1
    assert abs((fair - truth)[~far].mean()) < 0.05


def people(count: int, scale: float, seed: int) -> Examples:
    """Errors of matching of 0.1 px and of bodies' shapes of 0.05 m, seen by one head."""
    rng = np.random.default_rng(seed)
    far = rng.uniform(1.0, 5.0, count)
    # The surface is a tenth of a metre before the axis.
    more_px = -0.1 * scale / far**2 + rng.normal(0.0, np.hypot(0.1, 0.05 * scale / far**2))
    inverse = scale / far - more_px
    ranges, worth = scale / inverse, inverse**2 / scale
    even = rng.normal(size=(count, EVEN))
    even[:, -5] = np.log(np.hypot(0.3, 0.06 * worth))
    even[:, -4] = np.log(np.hypot(0.06, ranges / 100.0))
    even[:, -3:] = np.maximum(ranges[:, np.newaxis] - [2.0, 3.0, 4.0], 0.0)
    depth = np.zeros((count, DEPTH))
    depth[:, -2] = worth
    return Examples(
        even=even,
        odd=rng.normal(size=(count, ODD)),
        depth=depth,
        away=np.zeros(count),
        across=rng.normal(0.0, np.hypot(0.02, 0.5 * ranges / 100.0)),
        more_px=more_px,
        inverse_range=inverse,
        scale=np.full(count, scale),
        robot=np.zeros(count, dtype=bool),
        bag=np.arange(count) % 10,
        network=np.zeros(count),
    )


def test_network_is_the_mean_of_its_members(monkeypatch: pytest.MonkeyPatch) -> None:
    # Members of one hidden number: tanh(x) * (seed + 1) + seed.
    def member(x: Float, _target: Float, seed: int) -> tuple[Float, Float, Float, float]:
        assert x.shape == (3, 1)
        return np.ones((1, 1)), np.zeros(1), np.array([seed + 1.0]), float(seed)

    monkeypatch.setattr(regression, "_fit_hidden", member)
    monkeypatch.setattr(regression, "_MEMBERS", 4)
    found = regression.fit_layered(np.array([[-1.0], [0.0], [1.0]]), np.zeros(3))
    x = 1.0 / (np.sqrt(2.0 / 3.0) + 0.02)  # scaled by the columns' size
    np.testing.assert_allclose(
        found(np.array([[0.0], [1.0]])), [1.5, 1.5 + 2.5 * np.tanh(x)], rtol=1e-4
    )


@pytest.mark.slow
def test_offsets_and_sigmas_hold_for_heads_of_5_and_of_25_px_m() -> None:
    offsets = fit_offsets(Examples.joined([people(3000, s, k) for k, s in enumerate((5, 25))]))
    for scale in (5.0, 11.0, 25.0):  # the second one has not been seen
        new = people(2000, scale, 7)
        error = offsets["depth"](new.depth) - new.more_px
        for low, high in ((1.0, 2.0), (2.0, 3.5), (3.5, 5.0)):
            chosen = (true_range(new) >= low) & (true_range(new) < high)
            # The offset is a tenth of a metre, wherever and by whichever head.
            metres = (error * true_range(new) ** 2 / scale)[chosen]
            assert abs(metres.mean()) < 0.03, (scale, low)
            for name, errors in (
                ("depth", error),
                ("across", offsets["across"](new.odd) - new.across),
            ):
                sigma = np.exp(offsets[f"{name}_log_sigma"](new.even))
                inside = (np.abs(errors) < 1.96 * sigma)[chosen].mean()
                assert 0.9 < inside < 0.99, (scale, low, name)


def test_all_ranges_weigh_alike() -> None:
    near, far = people(900, 10.0, 0), people(100, 10.0, 1)
    inverse = 10.0 / np.repeat([2.2, 4.2], [900, 100])
    some = Examples.joined([near, far])
    some = dataclasses.replace(some, inverse_range=inverse, more_px=np.zeros(1000))
    weight = range_weights(some)
    assert weight.mean() == pytest.approx(1.0)
    np.testing.assert_allclose(true_range(some)[[0, -1]], [2.2, 4.2])
    # Up to four times the mean, so not quite alike.
    assert weight[:900].sum() < 3.0 * weight[900:].sum()


def test_combination_recovers_its_weights() -> None:
    rng = np.random.default_rng(5)
    scores = Scores(rng.uniform(-5.0, 8.0, 30_000), rng.normal(0.0, 1.5, 30_000))
    wanted = np.array([0.4, 0.2, 1.0, -1.0])
    z = scores.combined(wanted)
    person = rng.uniform(size=len(z)) < 1.0 / (1.0 + np.exp(-z))
    found = fit_combination(scores, person, np.ones(len(z)))
    np.testing.assert_allclose(found, wanted, atol=0.15)
    # What speaks against people is no evidence for them.
    turned = Scores(scores.human, -scores.network)
    assert fit_combination(turned, person, np.ones(len(z)))[2] == 0.0


@pytest.mark.parametrize("count", [10, 400])
def test_real_examples_weigh_the_same_however_many_there_are(count: int) -> None:
    real = np.arange(1000) < count
    weight = shared_weights(real)
    assert weight[real].sum() == pytest.approx(200.0)
    assert weight.sum() == pytest.approx(1000.0)
    np.testing.assert_array_equal(shared_weights(real & False), shared_weights(real & False)[0])

"""Each size of a body and each distance between people has one value, wherever it is used."""

import numpy as np
import pytest

from mrs_people_loc import anthropometry as people
from mrs_people_loc import precision
from mrs_people_loc.bodies.finder import BODY_TUNING
from mrs_people_loc.bodies.patches import ACROSS, BODY, HEIGHTS, SILHOUETTE, TRUNK
from mrs_people_loc.config import PlannerConfig


def test_distances_are_the_documented_ones():
    assert people.CLOSEST == 0.25
    assert people.APART_ACROSS == 0.30
    assert people.APART_AMONG_ROBOTS == 0.35
    assert people.APART == 0.36  # docs/masking.md, docs/limits.md


def test_stages_take_them_from_one_place():
    config = PlannerConfig()
    assert config.joining.apart == people.APART
    assert config.tracking.body == people.APART_ACROSS
    assert BODY_TUNING.search.apart == BODY_TUNING.finder.apart_across == people.APART_ACROSS
    assert BODY_TUNING.finder.apart == people.APART


def test_matching_errs_by_one_fact():
    assert precision.BODY_TOLERANCE_PX == 0.45
    assert precision.BODY_SIGMA_PX == 0.3
    assert precision.PLANE_TOLERANCES_PX == (0.4, 0.3, 0.2)


@pytest.mark.parametrize(
    ("columns", "outermost"), [(TRUNK, 0.10), (BODY, 0.25), (SILHOUETTE, 0.30)]
)
def test_columns_of_a_body_that_the_model_was_fitted_to(columns, outermost):
    np.testing.assert_allclose(ACROSS[columns][[0, -1]], [-outermost, outermost], atol=1e-6)
    assert HEIGHTS[-1] > people.TALLEST  # the grid sees what is above a head

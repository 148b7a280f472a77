import numpy as np
import pytest

from mrs_people_loc.uncertainty import bounded


@pytest.mark.parametrize(
    ("given", "expected"),
    [
        ([[0.04, 0.01], [0.01, 0.09]], [[0.04, 0.01], [0.01, 0.09]]),
        # Standard deviations are from 1 cm to 100 m.
        ([[0.0, 0.0], [0.0, 4.0]], [[1e-4, 0.0], [0.0, 4.0]]),
        ([[4.0, 0.0], [0.0, 1e6]], [[4.0, 0.0], [0.0, 1e4]]),
        # Along the diagonals: variances of 2 and 0, of 4 and -2, of 3e4 and 1e4.
        ([[1.0, 1.0], [1.0, 1.0]], [[1.00005, 0.99995], [0.99995, 1.00005]]),
        ([[1.0, 3.0], [3.0, 1.0]], [[2.00005, 1.99995], [1.99995, 2.00005]]),
        ([[2e4, 1e4], [1e4, 2e4]], [[1e4, 0.0], [0.0, 1e4]]),
        # What says nothing is as uncertain as can be.
        ([[np.nan, 0.0], [0.0, 1.0]], [[1e4, 0.0], [0.0, 1e4]]),
        ([[1.0, 0.0], [0.0, np.inf]], [[1e4, 0.0], [0.0, 1e4]]),
        ([[1.0, 2e12], [2e12, 1.0]], [[1e4, 0.0], [0.0, 1e4]]),
    ],
)
def test_bounds_match_hand_computed_values(given, expected):
    beside = 0.25 * np.eye(2)  # one does not change another
    got = bounded(np.array([given, beside]))
    np.testing.assert_allclose(got[0], expected, rtol=1e-12, atol=1e-9)
    np.testing.assert_allclose(got[1], beside)


def test_no_covariances_are_bounded():
    assert bounded(np.empty((0, 2, 2))).shape == (0, 2, 2)

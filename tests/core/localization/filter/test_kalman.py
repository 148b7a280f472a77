"""The algebra that all observations share."""

import pytest
from scipy.stats import chi2

from mrs_people_loc.config import Localization
from mrs_people_loc.localization.filter import kalman
from mrs_people_loc.localization.filter.kalman import gates_of


@pytest.mark.parametrize("share", [0.5, 0.95, 0.999, 0.9999])
def test_gates_are_quantiles_of_chi_square(share: float) -> None:
    expected = {m: pytest.approx(chi2.ppf(share, m), rel=1e-14) for m in (1, 2, 3)}
    assert gates_of(share) == expected


def test_gates_of_the_default_are_written_down() -> None:
    assert Localization().gate in kalman._QUANTILES

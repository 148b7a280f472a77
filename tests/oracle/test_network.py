"""The network of the core equals that of the oracle, which reads the file of weights by itself."""

import numpy as np
import pytest

from mrs_people_loc.bodies import network
from mrs_people_loc.bodies.network import PersonNetwork, sample_windows
from mrs_people_loc.config import Mounting
from mrs_people_loc.sensing.camera import StereoCamera
from oracle.network import log_odds_of, window_of
from oracle.votes import STEPS

CAMERA = StereoCamera(
    width=160, height=120, fx=110.0, fy=112.0, cx=78.3, cy=61.2, baseline=0.1,
    mounting=Mounting(height=1.2, forward=0.1, left=-0.2, pitch=0.15, roll=-0.05, yaw=0.4),
)  # fmt: skip
BEARING = np.array([0.4, 0.9, 0.1, 0.35, 2.9])
RANGES = np.array([2.0, 3.1, 0.8, 4.6, 1.5])
IMAGE = np.random.default_rng(3).integers(0, 256, (120, 160), dtype=np.uint8)
#: Grey levels, log-odds: what float32 leaves, and where OpenCV looks between pixels in steps.
GREY, SCORE = (8.0, 0.2) if STEPS else (0.02, 1e-3)


def check() -> None:
    grey, inside = sample_windows(CAMERA, IMAGE, BEARING, RANGES)
    scores = PersonNetwork(CAMERA)(IMAGE, BEARING, RANGES)
    shares = set()
    for k in range(len(BEARING)):
        wanted, there = window_of(IMAGE, CAMERA, BEARING[k], RANGES[k])
        np.testing.assert_array_equal(inside[k], there)
        np.testing.assert_allclose(grey[k][inside[k]], wanted[inside[k]], atol=GREY)
        assert scores[k] == pytest.approx(log_odds_of(wanted, there), abs=SCORE)
        shares.add(float(there.mean().round(1)))
    assert 0.0 in shares
    assert len(shares) > 2
    assert np.ptp(scores) > 0.1


def test_scores_equal_the_oracle():
    check()


@pytest.mark.parametrize(
    ("name", "wrong"),
    [
        ("_HEIGHTS", network._HEIGHTS + np.float32(0.05)),
        ("_ACROSS", -network._ACROSS),
        ("_SMOOTHING", ((1.25, 0.0001), (2.5, 0.7))),
        ("_LEAST_CONTRAST", np.float32(5.0)),
    ],
)
def test_wrong_windows_are_noticed(monkeypatch, name, wrong):
    monkeypatch.setattr(network, name, wrong)
    with pytest.raises(AssertionError):
        check()

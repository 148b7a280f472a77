"""What a body looks like, in the left image, beside what the human test says."""

from __future__ import annotations

from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import Gray
from oracle.evidence import model
from oracle.network import window_log_odds
from oracle.numbers import LEAST_HUMAN, MOST_HUMAN, RULED_OUT, SURE_SHAPE


def with_appearance(
    human: float, left: Gray, camera: StereoCamera, bearing: float, away: float
) -> float:
    """The log-odds of a person whose axis is at this bearing [rad] and range [m]."""
    if human < RULED_OUT:
        return human
    of = model()["appearance"]
    score = float(of["human"]) * min(max(human, LEAST_HUMAN), MOST_HUMAN)
    seen = window_log_odds(left, camera, bearing, away)
    if seen < 0.0:
        seen *= min(1.0, max(0.0, (SURE_SHAPE - human) / (SURE_SHAPE - MOST_HUMAN)))
    score += float(of["network"]) * seen
    return score + float(of["above"]) * max(human - MOST_HUMAN, 0.0) + float(of["offset"])

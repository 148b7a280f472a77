"""How long those are reported who have left the view."""

import dataclasses

import numpy as np
import pytest

from mrs_people_sim.scoring.hidden import score_ghosts, score_hidden
from mrs_people_sim.scoring.positions import score, summary
from mrs_people_sim.scoring.tracks import score_tracks
from mrs_tools.bags.records import Estimate, Truth

STEP_NS = 200_000_000


def made(kinds: str, *, visible: str) -> tuple[Truth, list[Estimate]]:
    """One person at 5 Hz, and what is said of them.

    Args:
        kinds: By frame, s: seen, c: coasting, h: hidden, -: nothing.
        visible: By frame, v: a robot sees them.
    """
    count = len(visible)
    stamps = [k * STEP_NS for k in range(count)]
    truth = Truth.build(
        stamps, [np.zeros((1, 2))] * count, [np.array([one == "v"]) for one in visible]
    )
    estimates = []
    for stamp_ns, kind in zip(stamps, kinds, strict=True):
        people = int(kind != "-")
        estimates.append(
            Estimate(
                stamp_ns=stamp_ns,
                positions=np.zeros((people, 2)),
                covariances=np.tile(0.01 * np.eye(2), (people, 1, 1)),
                ids=np.full(people, 5, dtype=np.int64),
                coasting=np.full(people, kind in "ch"),
                hidden=np.full(people, kind == "h"),
            )
        )
    return truth, estimates


@pytest.mark.parametrize(
    ("kinds", "visible", "shown_s", "followed_s"),
    [
        ("sss---", "vvv...", [0.0], [0.0]),
        ("sssc--", "vvv...", [0.0], [0.0]),
        ("ssscc-", "vvv...", [0.2], [0.2]),
        ("ssscchhh-", "vvv......", [0.2], [0.8]),
        ("ssscchhhh", "vvv......", [0.2], [1.0]),  # until the recording ends
        ("sssssccc-", "vvv......", [0.4], [0.4]),  # a part of them is still seen
        ("ssscss---", "vvv.vv...", [0.0], [0.0]),  # the first time they are back before
        ("ssscchss", "vvv...vv", [0.2], []),  # they are back before the whole of it ends
        ("---cc-", "vvv...", [], []),  # nobody followed them
        ("ssssss", "vvvvvv", [], []),
    ],
)
def test_a_ghost_lasts_as_long_as_it_is_predicted(kinds, visible, shown_s, followed_s):
    truth, estimates = made(kinds, visible=visible)
    scores = score_ghosts(score(truth, estimates), estimates)
    assert scores.shown_s.tolist() == pytest.approx(shown_s)
    assert scores.followed_s.tolist() == pytest.approx(followed_s)


def test_an_identity_that_follows_somebody_else_is_no_ghost():
    truth, estimates = made("sscc", visible="vv..")
    other = Truth.build(
        truth.stamps_ns.tolist(),
        [np.array([[0.0 if k < 2 else 9.0, 0.0], [0.3, 0.0]]) for k in range(4)],
        [np.array([k < 2, k > 2]) for k in range(4)],
    )
    assert score_ghosts(score(truth, estimates), estimates).shown_s.tolist() == [0.2]
    assert score_ghosts(score(other, estimates), estimates).shown_s.tolist() == [0.0]


def test_who_is_hidden_is_compared_with_whom_nobody_sees():
    truth, estimates = made("sshhhs", visible="vv...v")
    of_view, of_hidden = (
        summary(frames)["people"]
        for frames in (score(truth, estimates), score_hidden(truth, estimates))
    )
    assert [of_view[key] for key in ("true", "matched", "estimates")] == [3, 3, 3]
    assert [of_hidden[key] for key in ("true", "matched", "estimates")] == [3, 3, 3]
    elsewhere = [dataclasses.replace(one, positions=one.positions + 9.0) for one in estimates]
    of_hidden = summary(score_hidden(truth, elsewhere))["people"]
    assert [of_hidden[key] for key in ("matched", "estimates")] == [0, 3]


def test_who_is_hidden_while_in_view_is_missed():
    truth, estimates = made("sshs", visible="vvvv")
    frames = score(truth, estimates)
    assert summary(frames)["people"]["recall"] == 0.75
    assert score_tracks(truth, frames, estimates).report()["fragments"] == 1
    assert summary(score_hidden(truth, estimates))["people"]["estimates"] == 0  # it is ignored

"""Scores of stragglers that were worked out by hand."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from mrs_people_loc import config as cfg
from mrs_people_sim.scoring.positions import score
from mrs_people_sim.scoring.stragglers import (
    Episode,
    StragglerScores,
    episodes,
    score_centres,
    score_stragglers,
)
from mrs_tools.bags.records import Estimate, Truth

MS = 1_000_000
GROUPS = cfg.Groups(distance=2.5, margin=0.4)
NOBODY = (math.nan, math.nan)
NOTHING = {
    "true": None, "flagged": None, "within_1_s": None, "unseen": None, "false": None,
    "minutes": None, "delay_s": {"mean": None, "max": None},
}  # fmt: skip


def truth(ways, count, *, groups=None, visible=None) -> Truth:
    """Where `ways(k)` says, every 100 ms; `groups(k)` and `visible(k)` likewise."""
    rows = [np.array(ways(k), dtype=float).reshape(-1, 2) for k in range(count)]
    of_group = [np.array(groups(k) if groups else [1] * len(rows[k])) for k in range(count)]
    seen = [np.array(visible(k)) > 0 if visible else None for k in range(count)]
    return Truth.build([100 * MS * k for k in range(count)], rows, seen, of_group)


def behind(k, *, begin=10, speed=1.0, back=None):
    """Three in a row of 1 m, of whom the last stays behind from 2 m on at `begin`."""
    away = 2.0 + 0.1 * speed * (k - begin) if k >= begin else 1.0
    if back is not None and k >= back:
        away = 1.0
    return ((2, 0), (1, 0), (1 - away, 0))


def estimated(there: Truth, flags, ids=None) -> list[Estimate]:
    """Everybody at their true position, ids 1, 2, ... or `ids(k)`; `flags(k)` are stragglers."""
    out = []
    for k, xy in enumerate(there.positions):
        ids_seen = np.array(ids(k) if ids else range(1, len(xy) + 1), dtype=np.int64)
        kept = np.isfinite(xy).all(axis=1) & (ids_seen > 0)
        out.append(
            Estimate(
                stamp_ns=int(there.stamps_ns[k]),
                positions=xy[kept],
                covariances=np.zeros((int(kept.sum()), 2, 2)),
                ids=ids_seen[kept],
                stragglers=tuple(flags(k)),
            )
        )
    return out


def scored(there: Truth, estimates: list[Estimate], config: cfg.Groups = GROUPS) -> StragglerScores:
    return score_stragglers(there, score(there, estimates), estimates, config=config)


# ------------------------------------------------------------------------------- episodes ----


def test_episode_begins_at_the_interpolated_crossing():
    # 2.46 m at 1.2 s, 2.69 m at 1.3 s: 2.5 m at 1.2 s + 0.04 / 0.23 of 0.1 s.
    there = truth(lambda k: behind(k, speed=2.3, back=30), 50)
    (episode,) = episodes(there, config=GROUPS)
    assert episode == Episode(
        2, pytest.approx(1200 * MS + 4 / 23 * 100 * MS, abs=2), 2900 * MS, True
    )


def test_person_alone_for_less_than_a_second_is_no_straggler():
    # Beyond 2.5 m from 1.5 s (by a hair: from 1.6 s) on.
    assert episodes(truth(lambda k: behind(k, back=25), 40), config=GROUPS) == []
    (episode,) = episodes(truth(lambda k: behind(k, back=27), 40), config=GROUPS)
    assert episode.begin_ns == pytest.approx(1500 * MS, abs=2)


def test_limit_follows_the_configuration():
    there = truth(behind, 75)
    near, far = (episodes(there, config=cfg.Groups(distance=d)) for d in (2.25, 5.95))
    assert [e.begin_ns for e in near] == [pytest.approx(1250 * MS, abs=2)]
    assert [e.begin_ns for e in far] == [pytest.approx(4950 * MS, abs=2)]


def test_person_hovering_at_the_limit_is_one_episode():
    def ways(k, nearest):
        away = 3.0 if 10 <= k < 30 or 35 <= k < 60 else nearest if k >= 30 else 1.0
        return ((2, 0), (1, 0), (1 - away, 0))

    assert len(episodes(truth(lambda k: ways(k, 2.2), 70), config=GROUPS)) == 1
    (one,) = episodes(truth(lambda k: ways(k, 2.2), 70), config=GROUPS)
    assert one.end_ns == 5900 * MS
    assert len(episodes(truth(lambda k: ways(k, 2.0), 70), config=GROUPS)) == 2


def test_leaving_together_or_a_group_of_two_is_no_episode():
    def two_of_five(k):
        away = 1.0 + 0.1 * max(0, k - 10)
        return ((2, 0), (1, 0), (3, 0), (1 - away, 0), (1 - away, 1))

    assert episodes(truth(two_of_five, 50), config=GROUPS) == []
    assert episodes(truth(lambda k: behind(k)[1:], 50), config=GROUPS) == []


def test_only_members_of_the_same_group_count():
    # A stranger walks with the one who falls behind.
    def ways(k):
        return (*behind(k), np.array(behind(k)[2]) + (0, 0.5))

    there = truth(ways, 50, groups=lambda k: (1, 1, 1, 0))
    assert [e.person for e in episodes(there, config=GROUPS)] == [2]
    assert episodes(truth(ways, 50, groups=lambda k: (1, 1, 1, 1)), config=GROUPS) == []
    # Of another group of one each: nobody is with anybody.
    assert episodes(truth(ways, 50, groups=lambda k: (1, 2, 3, 4)), config=GROUPS) == []


def test_initially_distant_or_former_members_are_no_episode():
    assert episodes(truth(lambda k: behind(k, begin=-20), 40), config=GROUPS) == []
    leaves = truth(lambda k: behind(k), 50, groups=lambda k: (1, 1, int(k < 15)))
    assert episodes(leaves, config=GROUPS) == []


# ------------------------------------------------------------------------------- in time ----


def test_all_figures_of_one_recording_match_hand_computed_values():
    # They cross at 1.5 s and are flagged at 2.1 s; 1 is flagged wrongly at 4 s, for 0.5 s.
    there = truth(behind, 61)
    estimates = estimated(there, lambda k: [3] * (k >= 21) + [1] * (40 <= k < 45))
    scores = scored(there, estimates)
    assert scores.report() == {
        "true": 1,
        "flagged": 1,
        "within_1_s": 1.0,
        "unseen": 0,
        "false": 1,
        "minutes": pytest.approx(6.1 / 60),
        "delay_s": {"mean": pytest.approx(0.6), "max": pytest.approx(0.6)},
    }
    both = (scores + scored(there, estimated(there, lambda k: [3] * (k >= 31)))).report()
    assert (both["true"], both["flagged"], both["within_1_s"], both["false"]) == (2, 2, 0.5, 1)
    assert both["minutes"] == pytest.approx(12.2 / 60)
    assert both["delay_s"] == {"mean": pytest.approx(1.1), "max": pytest.approx(1.6)}


def test_stragglers_flagged_never_or_too_late_have_no_delay():
    there = truth(lambda k: behind(k, back=40), 60)
    for flags in (lambda k: [], lambda k: [3] * (k >= 41)):
        report = scored(there, estimated(there, flags)).report()
        assert (report["true"], report["flagged"], report["within_1_s"]) == (1, 0, 0.0)
        assert report["delay_s"] == {"mean": None, "max": None}


def test_flag_before_the_crossing_has_zero_delay():
    there = truth(behind, 60)
    report = scored(there, estimated(there, lambda k: [3] * (k >= 12))).report()
    assert report["delay_s"] == {"mean": 0.0, "max": 0.0}
    assert report["false"] == 0  # it is less than 1 s early


def test_flag_refers_to_the_current_or_last_identity():
    there = truth(behind, 60)
    # 3 until 1.6 s, then nobody; or then 9.
    lost = estimated(there, lambda k: [3] * (k >= 25), lambda k: (1, 2, 3 if k <= 16 else 0))
    assert scored(there, lost).report()["flagged"] == 1
    other = estimated(there, lambda k: [3] * (k >= 25), lambda k: (1, 2, 3 if k <= 16 else 9))
    assert scored(there, other).report()["flagged"] == 0


def test_episode_unseen_in_its_first_second_is_unseen():
    def visible(k, again):
        return (9, 9, 9 if k < 15 or k >= again else 0)

    late = truth(behind, 60, visible=lambda k: visible(k, 26))
    report = scored(late, estimated(late, lambda k: [])).report()
    assert (report["true"], report["unseen"], report["within_1_s"]) == (0, 1, None)
    soon = truth(behind, 60, visible=lambda k: visible(k, 25))
    report = scored(soon, estimated(soon, lambda k: [])).report()
    assert (report["true"], report["unseen"]) == (1, 0)


# ------------------------------------------------------------------------------- false ----


def false_flags(there: Truth, flags, ids=None) -> int:
    return scored(there, estimated(there, flags, ids)).false


def test_flag_counts_once_when_raised():
    there = truth(lambda k: behind(0), 40)
    assert false_flags(there, lambda k: [3] * (k >= 20)) == 1
    assert false_flags(there, lambda k: [3] * (k >= 20 and k != 30)) == 2
    assert false_flags(there, lambda k: [2, 3] * (k >= 20)) == 2


def test_flag_is_accepted_a_second_before_and_after_the_episode():
    # Farther than 2.1 m, the limit less the margin, from 1.2 s to 2.9 s.
    there = truth(lambda k: behind(k, back=30), 60)
    at = {k: false_flags(there, lambda n, k=k: [3] * (n == k)) for k in (1, 2, 20, 39, 40, 45)}
    assert at == {1: 1, 2: 0, 20: 0, 39: 0, 40: 1, 45: 1}


def test_larger_part_continues_and_equal_parts_are_undefined():
    def ways(k, aside):
        away = 1.0 + 0.1 * max(0, k - 10)
        return [(0.5 * i, 0) for i in range(5 - aside)] + [
            (-away, 0.5 * i) for i in range(aside)
        ]  # fmt: skip

    there = truth(lambda k: ways(k, 2), 60)
    assert false_flags(there, lambda k: [4, 5] * (k >= 50)) == 0
    assert false_flags(there, lambda k: [1, 2, 3] * (k >= 50)) == 3
    even = truth(lambda k: ways(k, 2)[1:], 60)
    assert false_flags(even, lambda k: [1, 2] * (k >= 50)) == 0
    assert false_flags(even, lambda k: [3, 4] * (k >= 50)) == 0


def test_flags_of_strangers_are_false_and_of_former_members_are_not():
    def ways(k):
        return (*behind(0), (0, 1))

    stranger = truth(ways, 40, groups=lambda k: (1, 1, 1, 0))
    assert false_flags(stranger, lambda k: [4] * (k >= 20)) == 1
    assert false_flags(stranger, lambda k: [77] * (k >= 20)) == 1
    leaver = truth(ways, 40, groups=lambda k: (1, 1, 1, int(k < 10)))
    assert false_flags(leaver, lambda k: [4] * (k >= 25)) == 0
    joiner = truth(ways, 40, groups=lambda k: (1, 1, 1, int(k > 25)))
    assert false_flags(joiner, lambda k: [4] * (k == 20)) == 1


def test_flag_of_a_missing_person_is_false_only_where_seen():
    def flags(k):
        return [3] * (k >= 30)

    def ids(k):
        return (1, 2, 3 if k < 20 else 0)

    seen = truth(lambda k: behind(0), 40)
    hidden = truth(lambda k: behind(0), 40, visible=lambda k: (9, 9, 9 if k < 20 else 0))
    assert false_flags(seen, flags, ids) == 1
    assert false_flags(hidden, flags, ids) == 0
    assert false_flags(hidden, flags) == 1  # still tracked, and near


# ------------------------------------------------------------------------------- nothing ----


def test_without_groups_or_identities_there_is_nothing_to_score():
    there = truth(behind, 60)
    untold = Truth(there.stamps_ns, there.positions, there.visible)
    assert episodes(untold, config=GROUPS) == []
    assert scored(untold, estimated(untold, lambda k: [3])).report() == NOTHING
    assert scored(there, estimated(there, lambda k: [], lambda k: (0, 0, 0))).report() == NOTHING
    assert scored(there, []).report() == NOTHING
    nobody = truth(behind, 60, groups=lambda k: (0, 0, 0))
    assert scored(nobody, estimated(nobody, lambda k: [])).report() == NOTHING
    empty = Truth.build([], [], None, [])
    assert scored(empty, []).report() == NOTHING
    assert StragglerScores().report() == NOTHING


def test_frames_without_an_estimate_raise_no_flag():
    there = truth(lambda k: behind(0), 40)
    estimates = [
        e for k, e in enumerate(estimated(there, lambda k: [3] * (k >= 10))) if not 15 <= k < 30
    ]
    report = scored(there, estimates).report()
    assert report["false"] == 1
    assert report["minutes"] == pytest.approx(2.5 / 60)


def test_absent_person_is_no_neighbour():
    def ways(k):
        return ((2, 0), (1, 0), (0, 0), NOBODY if k >= 10 else (0, 1))

    there = truth(ways, 40)
    assert episodes(there, config=GROUPS) == []
    assert false_flags(there, lambda k: [4] * (k >= 30)) == 0


# --------------------------------------------------------------------------------- centre ----


def centres(there: Truth, largest) -> list[float]:
    """Errors of the group's centre, which is said to be at `largest(k)`."""
    estimates = [
        dataclasses.replace(one, centre=np.array(largest(k)), largest=np.array(largest(k)))
        for k, one in enumerate(estimated(there, lambda k: ()))
    ]
    frames = score_centres(there, score(there, estimates), estimates, config=GROUPS)
    return [round(frame.centre_error, 6) for frame in frames]


def test_centre_is_that_of_the_continuing_group():
    # The third is at -1 m at 1 s, 2 m from the second, and 2.6 m from them at 1.6 s.
    there = truth(behind, 17)
    errors = centres(there, lambda k: (1.0, 0.1))
    assert errors[0] == pytest.approx(0.1)
    assert errors[10] == pytest.approx(math.hypot(1.0 - 2.0 / 3.0, 0.1), abs=1e-6)
    assert errors[16] == pytest.approx(math.hypot(0.5, 0.1), abs=1e-6)  # from (1.5, 0)


def test_strangers_are_excluded_from_the_centre():
    def ways(k):
        return ((0, 0), (1, 0), (9, 0))

    there = truth(ways, 3, groups=lambda k: (1, 1, 0))
    assert centres(there, lambda k: (0.5, 0.2)) == [0.2] * 3
    # Of several groups nobody says which one it is: all who are counted.
    there = truth(ways, 3, groups=lambda k: (1, 1, 2))
    assert centres(there, lambda k: (10 / 3, 0.2)) == [0.2] * 3

"""A small part of the published suite, held to just below what it reaches."""

from __future__ import annotations

import dataclasses
import os
from pathlib import Path

import pytest

from mrs_studies.experiment.suite_steps import run_suite
from mrs_studies.suite_scenes import suite_file, suite_scenes
from mrs_tools.installing import default_file

pytestmark = pytest.mark.slow

pytest.importorskip("embreex", reason="the simulator is an extra: [sim]")

#: Scenes of the test half, and how many frames of each.
SCENES = ("three", "talk", "close_tilted", "poor_dark", "far", "office", "walk_four", "tour_tilted")
FRAMES = 2
#: What `default.yaml` reaches on them: 66 of 68 people, 66 of 73 found are true, 4.5 cm. Six runs
#: on one machine found the same people, with mean errors within 0.02 cm. Another machine may round
#: otherwise: with 2 % of the pixels changed by one grey level, ten times, it was 0.971 to 0.985,
#: 0.904 to 0.944, and 4.45 cm with a standard deviation of 0.08. So the limits are one missed
#: person more than ever, one false person more, and three standard deviations.
LEAST = {"recall": 65 / 68, "precision": 66 / 74}
LARGEST_ERROR_M = 0.047
#: The printed method finds 0.46 of them.
BETTER_BY = 0.45


@pytest.mark.timeout(600)
def test_suite_scores_do_not_regress(tmp_path: Path) -> None:
    chosen = [
        dataclasses.replace(scene, timing=dataclasses.replace(scene.timing, frames=FRAMES))
        for scene in suite_scenes(suite_file(), "test")
        if scene.name.split("_", 2)[2] in SCENES
    ]
    assert len(chosen) == len(SCENES)
    rows = run_suite(
        chosen, tmp_path, paper=default_file("config", "paper.yaml"), jobs=os.cpu_count() or 1
    )
    printed, people = rows[0].report(), rows[-1].report()
    print({key: people[key] for key in ("true", "estimates", "matched", "recall", "precision")})
    print(f"mean error {100 * people['error_m']['mean']:.2f} cm; printed {printed['recall']:.3f}")
    for key, least in LEAST.items():
        assert people[key] >= least, key
    assert people["error_m"]["mean"] <= LARGEST_ERROR_M
    # What was built to beat the printed method does so here, too.
    assert people["recall"] >= printed["recall"] + BETTER_BY

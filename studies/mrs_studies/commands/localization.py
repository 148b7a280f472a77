"""`mrs localization`: how well a team knows where it is on tours of 100 m.

mrs localization                                  the table of docs/localization_results.md
mrs localization --seeds 2 --only hall            cases whose name contains a word
mrs localization --scene FILE --seed 7 --seeds 1  a tour in a scene of one's own
"""

from __future__ import annotations

from typing import Annotated

import typer

from mrs_people_sim.common import process_count
from mrs_people_sim.options import Jobs, JsonFile, scene_file
from mrs_studies.experiment.localization import CASES, cases_in, run_cases
from mrs_studies.experiment.localization_report import HEADING, markdown
from mrs_studies.experiment.repeats import chosen_cases, print_cases
from mrs_studies.options import Only, SceneFile, Seed, TablesFile


def command(
    seeds: Annotated[
        int,
        typer.Option(help="Tours of each kind.", min=1),
    ] = 10,
    seed: Seed = 1,
    only: Only = "",
    scene: SceneFile = "",
    out: TablesFile = None,
    json_file: JsonFile = None,
    jobs: Jobs = 0,
) -> None:
    """Simulate tours of 100 m, and print how well the robots know where they are.

    Corridors, a hall and a loop with five people and three robots, without rendering: what robots
    see of walls and people has the errors of real scans. Beside them tours on which something goes
    wrong, odometry alone, and the people that follow from the poses.
    """
    ours = cases_in(scene_file(scene, "tour_*.yaml")) if scene else CASES
    cases = chosen_cases(ours, only)
    scores = run_cases(cases, seeds, first=seed, jobs=process_count(jobs))
    print_cases(cases, scores, markdown, heading=HEADING, out=out, json_file=json_file)

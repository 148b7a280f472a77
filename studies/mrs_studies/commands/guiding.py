"""`mrs guiding`: how well a team guides groups on tours of 60 m.

mrs guiding                                  the tables of docs/guiding_results.md
mrs guiding --seeds 2 --only doors           cases whose name contains a word
mrs guiding --scene FILE --seed 7 --seeds 1  a tour in a scene of one's own
"""

from __future__ import annotations

from typing import Annotated

import typer

from mrs_people_sim.common import process_count
from mrs_people_sim.options import Jobs, JsonFile, scene_file
from mrs_studies.experiment.repeats import chosen_cases, print_cases
from mrs_studies.experiment.tours import CASES, FEW, cases_in, run_cases
from mrs_studies.experiment.tours_report import HEADING, markdown
from mrs_studies.options import Only, SceneFile, Seed, TablesFile


def command(
    seeds: Annotated[
        int,
        typer.Option(
            help=f"Tours of each kind with exact poses; of the others {FEW} at most.", min=1
        ),
    ] = 10,
    seed: Seed = 1,
    only: Only = "",
    scene: SceneFile = "",
    out: TablesFile = None,
    json_file: JsonFile = None,
    jobs: Jobs = 0,
) -> None:
    """Simulate guided tours of 60 m, and print how they went.

    Three robots guide 5 to 10 people through a corridor, a hall, doors and round a block; with
    exact poses, localized ones and odometry alone; with two and four robots; where somebody
    leaves, and with a robot or the planner failing. Nothing is rendered: what robots see of walls
    and people has the errors of real scans.
    """
    ours = cases_in(scene_file(scene, "guided_*.yaml")) if scene else CASES
    cases = chosen_cases(ours, only)
    scores = run_cases(cases, seeds, first=seed, jobs=process_count(jobs))
    print_cases(cases, scores, markdown, heading=HEADING, out=out, json_file=json_file)

"""The paper's section 6, simulated and measured.

Two scenes of `config/scenes/`, each drawn several times with other people, clothes and textures:
the formation of five people, three robots and a table (`paper_formation.yaml`), and one person 2 m
before one robot (`single_person.yaml`, Fig. 4). The configuration is `config/paper.yaml`, the
method as printed. `TRIALS` are runs of the formation with a value of its own where the paper leaves
a choice; `compare_poses` gives the robots wrong poses, by the paper's method and by the default one
(`config/default.yaml`). All figures depend on the seed alone, but for the times.

The architecture's claim (section 4.2: filter first, then share) is tested on the same images:
`FilterThenShare` sends what the robots send anyway, `ShareThenFilter` sends their raw clouds and
does the rest on the planner's machine.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from mrs_people_loc import timing
from mrs_people_sim.common import one_thread
from mrs_people_sim.paper import (
    PAPER_CLUSTERS,
    PAPER_ERROR_M,
    PAPER_KEPT,
    PAPER_REMOVED,
    PAPER_SEEN,
)
from mrs_studies.experiment.causes import distances, error_causes, noise_causes, zone_causes
from mrs_studies.experiment.cluster_kinds import count_clusters
from mrs_studies.experiment.comparisons import compare_architectures, compare_poses, try_values
from mrs_studies.experiment.draws import Draw, draw_all, draws_of
from mrs_studies.experiment.recording import Recording
from mrs_studies.experiment.report import reasons
from mrs_studies.experiment.stages import points_of, retention, retention_of_cells
from mrs_studies.experiment.tally import recall_of_subsets, team_tally

#: The scenes, by what they are called here.
SCENES = {"formation": "paper_formation.yaml", "single_person": "single_person.yaml"}
#: Sides of the cells that the last stage is tried with [m].
CELL_SIZES = (0.02, 0.03, 0.04, 0.05, 0.06, 0.08, 0.10)


def run_experiment(
    scenes: Mapping[str, Path],
    config: Path,
    default: Path,
    folder: Path,
    *,
    seed: int | None = None,
    draws: int = 10,
    frames: int = 2,
    jobs: int = 1,
    on_step: Callable[[float, str], None] = lambda *_: None,
) -> dict[str, Any]:
    """Simulates the scenes and measures.

    Args:
        scenes: Scene files of `formation` and `single_person`.
        config: The method as printed.
        default: The method that it is compared with where poses are wrong.
        folder: Where the bags go.
        seed: Seed of the first draw; None: the scenes' own.
        draws: Recordings of each scene, with seeds that follow each other.
        frames: Frames of each recording.
        jobs: Processes that simulate.
        on_step: Told how much is done, 0 to 1, and what is done now.

    Returns:
        The report, as `mrs experiment --json` writes it.

    Raises:
        PeopleLocError: A file or folder cannot be used.
    """
    todo = [
        job
        for file in scenes.values()
        for job in draws_of(file, folder, seed=seed, draws=draws, frames=frames)
    ]
    recorded: list[Draw] = []
    for one in draw_all(todo, jobs):
        recorded.append(one)
        on_step(0.7 * len(recorded) / len(todo), "simulating")
    with one_thread(), timing.processor_time():
        on_step(0.7, "measuring")
        runs = [Recording.of(one, config) for one in recorded]
        recordings = {
            name: runs[index * draws : (index + 1) * draws] for index, name in enumerate(scenes)
        }
        by_default = [Recording.of(r.draw, default) for r in recordings["formation"]]
        on_step(0.8, "measuring")
        report = {
            "config": config.name,
            "draws": draws,
            "frames": frames,
            **_measured(recordings, config, folder),
            "poses": compare_poses(
                {config.name: recordings["formation"], default.name: by_default}
            ),
            "causes": _causes(recordings),
        }
    on_step(1.0, "measured")
    return {**report, "reasons": reasons(report)}


def _measured(
    recordings: Mapping[str, Sequence[Recording]], config: Path, folder: Path
) -> dict[str, Any]:
    """What the report has of the method as printed, beside the paper's figures."""
    formation = recordings["formation"]
    return {
        "seeds": {
            name: [r.draw.scene.seed for r in several] for name, several in recordings.items()
        },
        "paper": {
            "retention": PAPER_KEPT,
            "clusters": PAPER_CLUSTERS,
            "error_m": PAPER_ERROR_M,
            "seen": PAPER_SEEN,
            "removed": PAPER_REMOVED,
        },
        "retention": {name: retention(several) for name, several in recordings.items()},
        "points": {name: points_of(several) for name, several in recordings.items()},
        "cells": {
            "cell_m": [*CELL_SIZES],
            **{n: retention_of_cells(several, CELL_SIZES) for n, several in recordings.items()},
        },
        "clusters": count_clusters(formation),
        "people": {name: team_tally(several) for name, several in recordings.items()},
        "robots": recall_of_subsets(formation),
        "architecture": compare_architectures(formation),
        "trials": try_values([recording.draw for recording in formation], config, folder),
    }


def _causes(recordings: Mapping[str, Sequence[Recording]]) -> dict[str, Any]:
    formation = recordings["formation"]
    return {
        "zones": {name: zone_causes(several) for name, several in recordings.items()},
        "noise": noise_causes(formation),
        "error": error_causes(formation),
        "distance_of_rear_robots": distances(formation, [*PAPER_SEEN]),
    }

"""What an interval costs the planner, stage by stage."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

from mrs_people_loc import timing
from mrs_people_loc.config import load_team
from mrs_people_loc.planner import Planner
from mrs_studies.bench.oracle import Oracle
from mrs_studies.bench.samples import Samples, blocks
from mrs_studies.bench.scenes import INTERVAL_NS, PEOPLE, ROBOTS, Scene, drawn_scans

#: Intervals of the drawn scene, each with noise of its own.
_DRAWN = 10


def time_planner(
    configs: Mapping[str, Path],
    frames: int,
    oracle: Oracle,
    on_step: Callable[[str], None] = lambda _: None,
) -> dict[str, dict[str, Any]]:
    """Times the planner on the drawn scene.

    Args:
        configs: Parameter files by name.
        frames: Intervals to time for each.
        oracle: What the people of the first scene are compared with before.
        on_step: Told what is done now.

    Returns:
        By configuration: stages [ms], and what there is in the scene.

    Raises:
        DiffersError: A result differs from the oracle.
    """
    planners, scenes, found = {}, {}, {}
    for name, path in configs.items():
        team = load_team(path, robots=tuple(ROBOTS))
        planners[name] = Planner(team.planner)
        config = next(iter(team.robots.values()))
        scenes[name] = [drawn_scans(config, seed) for seed in range(_DRAWN)]
        scans, poses = scenes[name][0]
        found[name] = Planner(team.planner.memoryless()).step(scans, poses, 0)
        oracle.check_people(scans, found[name], team.planner)
        if found[name].fused.cells.body.any() and team.planner.tracking.enabled:
            times_ns = [turn * INTERVAL_NS for turn in range(_DRAWN)]
            oracle.check_places(scenes[name], times_ns, team.planner)
    on_step(f"timing {frames} intervals")
    samples = _time(planners, scenes, frames)
    return {
        name: {
            "of_bodies": bool(found[name].fused.cells.body.any()),
            "robots": len(ROBOTS),
            "people": len(PEOPLE),
            "people_found": len(found[name].persons),
            "cells": len(found[name].fused),
            "clusters": len(found[name].clusters),
            "intervals": len(sample.ms["whole"]),
            "stages_ms": sample.report(),
        }
        for name, sample in samples.items()
    }


def _time(
    planners: Mapping[str, Planner], scenes: Mapping[str, Sequence[Scene]], frames: int
) -> dict[str, Samples]:
    """What intervals take, by configuration, which take turns."""
    samples = {name: Samples() for name in planners}
    now_ns = 0
    for turns in blocks(frames):
        for name, planner in planners.items():
            for turn, counts in turns:
                scans, poses = scenes[name][turn % _DRAWN]
                now_ns += INTERVAL_NS
                began = timing.now_ns()
                people = planner.step(scans, poses, now_ns)
                whole = (timing.now_ns() - began) / 1e6
                if counts:
                    samples[name].add({**people.times_ms, "whole": whole})
    return samples

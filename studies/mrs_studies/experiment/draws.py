"""Simulated recordings of a scene, each with another seed."""

from __future__ import annotations

import dataclasses
from collections import defaultdict
from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_sim.layouts import expand
from mrs_people_sim.render_scene import render_frames, team_file
from mrs_people_sim.scene import Scene, load_scene


@dataclass(frozen=True)
class Draw:
    """One simulated recording, and what only the simulator knows of it.

    Attributes:
        bag: Its bag.
        scene: The scene as it was drawn.
        pixels: By robot, how much of each person its left camera saw [px], shape (frames, people).
    """

    bag: Path
    scene: Scene
    pixels: Mapping[str, Float]


def draw(scene: Scene, bag: Path) -> Draw:
    """Renders a scene into a bag.

    Args:
        scene: The scene.
        bag: The new bag.

    Raises:
        BagError: The bag exists already or cannot be written.
        ConfigError: The scene cannot be rendered.
    """
    from mrs_people_sim.views.world import World
    from mrs_people_sim.writer import write_bag, write_team

    scene = expand(scene)
    world = World(scene)
    pixels: defaultdict[str, list[Float]] = defaultdict(list)

    def frames() -> Iterator[Any]:
        for seen in render_frames(world):
            for frame in seen:
                pixels[frame.robot].append(frame.pixels)
            yield seen

    bag.parent.mkdir(parents=True, exist_ok=True)
    write_bag(bag, world, frames())
    write_team(team_file(bag), world)
    return Draw(bag, scene, {robot: np.array(rows) for robot, rows in pixels.items()})


def _draw(job: tuple[Scene, Path]) -> Draw:
    return draw(*job)


def draws_of(
    file: Path, folder: Path, *, seed: int | None, draws: int, frames: int
) -> list[tuple[Scene, Path]]:
    """What `draw` takes for each draw of a scene: seeds follow each other.

    Args:
        file: The scene.
        folder: Where the bags go.
        seed: Seed of the first one; None: the scene's own.
        draws: How many.
        frames: Frames of each.

    Raises:
        ConfigError: The scene cannot be used.
    """
    first = load_scene(file, seed=seed)
    first = dataclasses.replace(first, timing=dataclasses.replace(first.timing, frames=frames))
    seeds = range(first.seed, first.seed + draws)
    scenes = [dataclasses.replace(first, seed=number) for number in seeds]
    return [(scene, folder / f"{scene.name}_{scene.seed}") for scene in scenes]


def draw_all(todo: Sequence[tuple[Scene, Path]], jobs: int) -> Iterator[Draw]:
    """Renders scenes into bags, in their order, by so many processes."""
    if jobs <= 1:
        yield from map(_draw, todo)
        return
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        yield from pool.map(_draw, todo)

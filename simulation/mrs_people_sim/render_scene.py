"""Renders scenes into bags."""

from __future__ import annotations

from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mrs_people_loc.errors import ConfigError
from mrs_people_sim.layouts import expand
from mrs_people_sim.scene import Scene

if TYPE_CHECKING:
    from mrs_people_sim.views.world import RenderedFrame, World


def simulate(scene: Scene, out: Path, *, jobs: int = 1, on_frame: Any = None) -> World:
    """Renders a scene into a bag, and writes its team's parameters beside it.

    Args:
        scene: The scene, its layout not yet expanded.
        out: A folder, or `NAME.mcap`.
        jobs: Processes.
        on_frame: Called after each frame, without arguments.

    Returns:
        The world.

    Raises:
        BagError: The bag exists already or cannot be written.
        ConfigError: The scene cannot be rendered.
    """
    from mrs_people_sim.views.world import World
    from mrs_people_sim.writer import write_bag, write_team

    scene = expand(scene)
    if not scene.robots:
        raise ConfigError(f"{scene.name}: there is no robot in the scene")
    world = World(scene)
    out.parent.mkdir(parents=True, exist_ok=True)
    write_bag(out, world, _counted(render_frames(world, jobs), on_frame))
    write_team(team_file(out), world)
    return world


def team_file(bag: Path) -> Path:
    """The team's parameter file beside a bag."""
    return bag.with_name(f"{bag.name.removesuffix('.mcap')}.yaml")


def render_frames(world: World, jobs: int = 1) -> Iterator[list[RenderedFrame]]:
    """What all robots see, frame by frame, rendered by so many processes."""
    indices = range(world.scene.timing.frames)
    if jobs <= 1:
        for index in indices:
            yield [world.render(name, index) for name in world.names]
        return
    with ProcessPoolExecutor(
        jobs, get_context("spawn"), initializer=_start_worker, initargs=(world.scene,)
    ) as pool:
        todo = [(name, index) for index in indices for name in world.names]
        results = pool.map(_render, todo)
        for _ in indices:
            yield [next(results) for _ in world.names]


_world: World | None = None


def _start_worker(scene: Scene) -> None:
    from mrs_people_sim.views.world import World

    global _world
    _world = World(scene)


def _render(job: tuple[str, int]) -> RenderedFrame:
    assert _world is not None
    return _world.render(*job)


def _counted(frames: Iterator[list[RenderedFrame]], on_frame: Any) -> Iterator[list[RenderedFrame]]:
    for frame in frames:
        yield frame
        if on_frame is not None:
            on_frame()

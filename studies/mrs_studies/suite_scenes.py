"""The published suite of scenes, and variants of them for fitting."""

from __future__ import annotations

import dataclasses
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np

from mrs_people_loc.config import load_yaml
from mrs_people_loc.errors import ConfigError
from mrs_people_sim.layouts import expand
from mrs_people_sim.render_scene import simulate
from mrs_people_sim.scene import Scene, read_scene
from mrs_tools.installing import default_file


def suite_scenes(file: Path, half: str, *, tracks: Path | None = None) -> list[Scene]:
    """Scenes of one half of a suite.

    Args:
        file: A YAML list of scenes, each with `half: train` or `half: test`; recorded tracks are
            where they say, relative to it.
        half: train, test or all.
        tracks: The folder of recorded tracks (`zara01/obsmat.txt`, ...), instead.

    Raises:
        ConfigError: The file or a scene cannot be used, or the half is empty.
    """
    if half not in ("train", "test", "all"):
        raise ConfigError(f"suite is {half!r}; allowed: train, test, all")
    document = load_yaml(file)
    if not isinstance(document, list):
        raise ConfigError(f"{file}: is not a suite (a list of scenes)")
    scenes = []
    for number, item in enumerate(document):
        scene = read_scene(item, f"{file}, scene {number + 1}")
        if item.get("half") not in ("train", "test"):
            raise ConfigError(f"{file}: scene {scene.name} has no `half: train` or `half: test`")
        if scene.tracks:
            path = Path(scene.tracks)
            path = tracks / path.parent.name / path.name if tracks else file.parent / path
            scene = dataclasses.replace(scene, tracks=str(path))
        if half in ("all", item["half"]):
            scenes.append(scene)
    if not scenes:
        raise ConfigError(f"{file}: no scene of the half {half}")
    return scenes


def variants(scenes: list[Scene], count: int) -> list[Scene]:
    """More scenes of the same kinds, for fitting: `count` of each.

    Each has a seed, furniture and clutter of its own; walls, floor, light, faults of the cameras
    and odometry are those of other scenes of the list, drawn at random. Two frames each. Every
    third keeps the suite's kinds of furniture, people and heads (of another scene); the others
    have all kinds that there are (`layout.variety`), varied heads, robots at other distances and
    stronger faults of the cameras. Every second is in a narrower room, where everybody fits in, so
    that walls are near.
    """
    result = []
    for number in range(1, count + 1):
        rng = np.random.default_rng([number, 77])
        rooms, imagings, odometries, heads = (rng.permutation(len(scenes)) for _ in range(4))
        for k, scene in enumerate(scenes):
            look = scenes[rooms[k]].room
            room = dataclasses.replace(scene.room, **{name: getattr(look, name) for name in _LOOKS})
            layout = dataclasses.replace(
                scene.layout,
                heads=scenes[heads[k]].layout.heads,
                furniture=int(rng.integers(0, 14)),
                clutter=int(rng.integers(0, 10)),
            )
            variant = dataclasses.replace(
                scene,
                name=f"{scene.name}_{number:02d}",
                seed=scene.seed + 10_000 * number,
                timing=dataclasses.replace(scene.timing, frames=2),
                room=room,
                layout=layout,
                imaging=scenes[imagings[k]].imaging,
                odometry=scenes[odometries[k]].odometry,
            )
            if number % 3:
                variant = _varied(variant, rng)
            if number % 2 == 0:
                variant = _narrowed(variant, rng)
            result.append(variant)
    return result


def _varied(scene: Scene, rng: np.random.Generator) -> Scene:
    """The scene with everything that rooms, people and heads may be."""
    near = float(rng.uniform(1.2, 2.2))
    layout = dataclasses.replace(
        scene.layout,
        variety=True,
        heads="varied",
        furniture=int(rng.integers(2, 18)),
        near=round(near, 3),
        far=round(near + float(rng.uniform(0.6, 2.4)), 3),
    )
    imaging = dataclasses.replace(
        scene.imaging,
        target=round(float(rng.uniform(75.0, 140.0)), 1),
        noise=round(float(rng.uniform(0.8, 4.0)), 2),
        blur=round(float(rng.uniform(0.2, 1.0)), 2),
        gain_difference=round(float(rng.uniform(0.0, 0.08)), 3),
        brightness_difference=round(float(rng.uniform(0.0, 4.0)), 2),
        calibration_error=round(float(rng.uniform(0.0, 0.12)), 3),
        gamma=round(float(rng.uniform(0.6, 1.0)), 2) if rng.random() < 0.3 else 1.0,
    )
    contrast = scene.room.contrast * float(rng.uniform(0.4, 1.5))
    room = dataclasses.replace(
        scene.room, contrast=round(contrast, 3), doors=int(rng.integers(0, 4))
    )
    return dataclasses.replace(scene, layout=layout, imaging=imaging, room=room)


def _narrowed(scene: Scene, rng: np.random.Generator) -> Scene:
    """The scene in a narrower room, with less furniture; as it is if people or robots stick out."""
    length, width = rng.uniform(0.65, 0.9), rng.uniform(0.5, 0.8)
    room = dataclasses.replace(
        scene.room, length=scene.room.length * length, width=scene.room.width * width
    )
    layout = dataclasses.replace(scene.layout, furniture=scene.layout.furniture // 3)
    narrow = dataclasses.replace(scene, room=room, layout=layout)
    expanded = expand(narrow)
    places = [(person.x, person.y) for person in expanded.people]
    places += [(robot.x, robot.y) for robot in expanded.robots.values()]
    fits = all(0.3 < x < room.length - 0.3 and 0.3 < y < room.width - 0.3 for x, y in places)
    return narrow if fits else scene


#: What a variant takes from another scene's room.
_LOOKS = ("walls", "floor", "contrast", "wall_shade", "floor_shade", "posters", "lamps", "ambient")


def with_tracks(scenes: list[Scene]) -> tuple[list[Scene], list[str]]:
    """The scenes that can be rendered here, and why others cannot: their tracks are missing."""
    there = [scene for scene in scenes if not scene.tracks or Path(scene.tracks).is_file()]
    missing = [
        f"{scene.name} is left out: no recording {scene.tracks} (--tracks: where the UCY set is)"
        for scene in scenes
        if scene not in there
    ]
    return there, missing


def suite_file(name: str = "suite.yaml") -> Path:
    """A file of the published suite: `suite.yaml`, or `walks.yaml` for its walking groups.

    Raises:
        ConfigError: It is neither in the source tree nor installed.
    """
    return default_file("config", "scenes", name)


def simulate_suite(
    scenes: list[Scene], folder: Path, *, jobs: int = 1, on_scene: Any = None
) -> list[Path]:
    """Renders scenes into a folder, several at a time; a bag that is there already stays.

    Args:
        scenes: The scenes.
        folder: Where the bags go, each under its scene's name.
        jobs: Processes, each with a scene of its own.
        on_scene: Called with the scene's name after each.

    Returns:
        The bags.

    Raises:
        BagError: A bag cannot be written.
        ConfigError: A scene cannot be rendered.
    """
    folder.mkdir(parents=True, exist_ok=True)
    bags = [folder / scene.name for scene in scenes]
    todo = [(s, bag) for s, bag in zip(scenes, bags, strict=True) if not bag.exists()]
    # The longest first, so that no process is left alone with one at the end.
    todo.sort(
        key=lambda job: -job[0].timing.frames * max(1, job[0].layout.robots, len(job[0].robots))
    )
    if jobs <= 1:
        for job in todo:
            on_scene and on_scene(_simulate_job(job))
        return bags
    with ProcessPoolExecutor(jobs, get_context("spawn")) as pool:
        for name in pool.map(_simulate_job, todo):
            on_scene and on_scene(name)
    return bags


def _simulate_job(job: tuple[Scene, Path]) -> str:
    scene, bag = job
    simulate(scene, bag)
    return scene.name

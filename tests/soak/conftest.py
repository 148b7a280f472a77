"""A DDS domain for each test, bags of the scene, and a way to say what was measured."""

from __future__ import annotations

import dataclasses
import importlib
import importlib.util
import warnings
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest

if any(importlib.util.find_spec(name) is None for name in ("rclpy", "rosbags", "embreex")):
    collect_ignore_glob = ["test_*.py"]
else:
    with warnings.catch_warnings():
        # rclpy imports this with the first message; the parser behind it uses deprecated modules.
        warnings.simplefilter("ignore", DeprecationWarning)
        importlib.import_module("rosidl_generator_py")
    from mrs_people_sim.render_scene import simulate, team_file
    from mrs_people_sim.scene import load_scene
    from ros.harness import ROOT, own_domain


@pytest.fixture(autouse=True)
def _domain(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[None]:
    for name in (
        "ROS_DISCOVERY_SERVER",
        "ROS_STATIC_PEERS",
        "FASTDDS_BUILTIN_TRANSPORTS",
        "FASTRTPS_DEFAULT_PROFILES_FILE",
        "FASTDDS_DEFAULT_PROFILES_FILE",
    ):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("ROS_AUTOMATIC_DISCOVERY_RANGE", "LOCALHOST")
    monkeypatch.setenv("ROS_LOG_DIR", str(tmp_path))
    monkeypatch.setenv("PYTHONFAULTHANDLER", "1")
    with own_domain() as number:
        monkeypatch.setenv("ROS_DOMAIN_ID", str(number))
        yield


@pytest.fixture(scope="session")
def hall(tmp_path_factory: pytest.TempPathFactory) -> Callable[[int], tuple[Path, Path]]:
    """Draws so many frames of config/scenes/hall.yaml: the bag, and its team's parameter file."""
    drawn: dict[int, Path] = {}

    def draw(frames: int) -> tuple[Path, Path]:
        if frames not in drawn:
            scene = load_scene(ROOT / "config" / "scenes" / "hall.yaml")
            timing = dataclasses.replace(scene.timing, frames=frames)
            bag = tmp_path_factory.mktemp("hall") / "hall"
            simulate(dataclasses.replace(scene, timing=timing), bag, jobs=2)
            drawn[frames] = bag
        return drawn[frames], team_file(drawn[frames])

    return draw

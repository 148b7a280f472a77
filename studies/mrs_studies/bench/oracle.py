"""Where the benchmark finds what it compares with: the oracle of the repository, `tests/oracle`."""

from __future__ import annotations

import importlib
import importlib.util
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Protocol, cast

from mrs_people_loc.arrays import Float
from mrs_people_loc.config import PlannerConfig, RobotConfig
from mrs_people_loc.people import Person
from mrs_people_loc.planner import People
from mrs_people_loc.robot import Stages
from mrs_people_loc.scan import Scan
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import StereoImages
from mrs_people_loc.team.poses import Pose

_FOLDER = Path(__file__).resolve().parents[3] / "tests" / "oracle"


class Oracle(Protocol):
    """Compares results with plain loops; raises `DiffersError`. See `tests/oracle/comparison`."""

    def check_view(
        self, images: StereoImages, stages: Stages, camera: StereoCamera, config: RobotConfig
    ) -> None:
        """Compares the stages of a view."""

    def check_people(self, scans: Sequence[Scan], people: People, config: PlannerConfig) -> None:
        """Compares an interval of a planner without memory."""

    def check_places(
        self,
        intervals: Sequence[tuple[Sequence[Scan], Mapping[str, Pose]]],
        times_ns: Sequence[int],
        config: PlannerConfig,
    ) -> list[Float]:
        """Compares what bodies lose by their places, over intervals."""

    def check_tracks(
        self,
        found: Sequence[Sequence[Person]],
        people: Sequence[Person],
        times_ns: Sequence[int],
        config: PlannerConfig,
    ) -> None:
        """Compares people who are followed."""


def find() -> Oracle:
    """The oracle."""
    if "oracle" not in sys.modules:
        # Of this folder and no other: whatever else is called so must not be taken for it.
        spec = importlib.util.spec_from_file_location(
            "oracle", _FOLDER / "__init__.py", submodule_search_locations=[str(_FOLDER)]
        )
        assert spec is not None
        assert spec.loader is not None
        sys.modules["oracle"] = package = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(package)
    return cast(Oracle, importlib.import_module("oracle.comparison"))

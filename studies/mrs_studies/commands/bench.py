"""`mrs bench`: is it fast enough? Compares the results with the oracle, then times them."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from mrs_people_sim.common import write_json
from mrs_people_sim.options import JsonFile
from mrs_ros.network import given_domain
from mrs_studies.bench.growth import LARGEST
from mrs_studies.bench.run import finite, run_bench
from mrs_studies.bench.tables import show
from mrs_tools.installing import default_file


def command(
    bag: Annotated[
        Path | None, typer.Argument(help="A bag with images. Default: bags/paper_formation.")
    ] = None,
    config: Annotated[
        list[Path] | None,
        typer.Option(
            "--config",
            "-c",
            help="Parameter file to measure with; several are compared, the targets are for the "
            "first of each method. Default: config/paper.yaml and config/default.yaml.",
        ),
    ] = None,
    team: Annotated[
        list[Path] | None,
        typer.Option(
            "--team",
            "-t",
            help="Parameter file of the bag's team, for the live part: on top of the first "
            "--config. Default: config/team.yaml.",
        ),
    ] = None,
    frames: Annotated[
        int, typer.Option(min=1, help="Views, and intervals, to time of each kind.")
    ] = 600,
    robots: Annotated[
        int, typer.Option(min=1, help="The largest team to time the planner with.")
    ] = LARGEST,
    live: Annotated[
        bool, typer.Option("--live/--no-live", help="Measure real processes over DDS, too.")
    ] = True,
    seconds: Annotated[
        float, typer.Option(min=1.0, help="How long the live part measures [s].")
    ] = 10.0,
    json_file: JsonFile = None,
) -> None:
    """Compare the results with plain loops, then measure the speed.

    Every figure names its configuration. A target that is missed is a measurement, not an error;
    results that differ from the oracle, the repository's plain loops, are one (exit code 1), and
    nothing is timed then.
    """  # fmt: skip
    if live:
        given_domain()
    bag = bag or default_file("bags", "paper_formation")
    configs = config or [default_file("config", f"{name}.yaml") for name in ("paper", "default")]
    files = [configs[0], *(team or [default_file("config", "team.yaml")])] if live else None
    progress = Console(stderr=True, soft_wrap=True, highlight=False)
    with progress.status("") as status:
        report = run_bench(
            bag,
            configs,
            frames=frames,
            robots=robots,
            live_files=files,
            seconds=seconds,
            on_step=lambda text: status.update(f"{text} ..."),
            on_domain=progress.print,
        )
    show(report, Console(highlight=False))
    if json_file is not None:
        write_json(json_file, finite(report))

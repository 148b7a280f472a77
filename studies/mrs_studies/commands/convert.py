"""`mrs convert`: foreign recordings as bags that the nodes and the offline tools read.

Three sources, all real: the OAK-D stereo video that looks down on people who walk by, and PCL's
RGB-D frame of five people. They prove that the same pipeline works on other cameras and mountings
with its configuration changed and nothing else. The bags hold what a robot's cameras and base
would send: images, `camera_info` and `odom` in frame `map`. The third, MRCLAM, has wheels that
drift and no images: its bags hold `odom` in frames of their own, and scans.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mrs_studies.recordings.frames import parse_frames
from mrs_studies.recordings.mrclam import convert_mrclam
from mrs_studies.recordings.oak import convert_oak
from mrs_studies.recordings.pcl import convert_pcl
from mrs_tools.plain import plain

app = typer.Typer(
    help="Write foreign recordings as bags.",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode="markdown",
)
Robot = Annotated[str, typer.Option(help="Name of the robot, the first part of its topics.")]
Reduce = Annotated[int, typer.Option(help="Scale images down by this: 1, 2, 4, ...", min=1)]


@app.command("oak")
def oak_command(
    folder: Annotated[Path, typer.Argument(help="Folder of left.mp4, right.mp4, calib.json.")],
    out: Annotated[Path, typer.Argument(help="The new bag: a folder, or NAME.mcap.")],
    robot: Robot = "robot_a",
    frames: Annotated[str, typer.Option(help="START:STOP:STEP, such as 0:627:3.")] = "::",
    reduce: Reduce = 2,
) -> None:
    """OAK-D stereo video with its calibration: raw images, to be rectified by the node."""
    count = convert_oak(folder, out, robot=robot, frames=parse_frames(frames), reduce=reduce)
    typer.echo(plain(f"{out}: {count} stereo pairs of {robot}"))


@app.command("pcl")
def pcl_command(
    file: Annotated[Path, typer.Argument(help="PCL's five_people.pcd.")],
    out: Annotated[Path, typer.Argument(help="The new bag: a folder, or NAME.mcap.")],
    robot: Robot = "robot_a",
    repeat: Annotated[int, typer.Option(help="Number of stereo pairs.", min=1)] = 10,
    rate: Annotated[float, typer.Option(help="Stereo pairs per second.")] = 5.0,
    baseline: Annotated[float, typer.Option(help="Between the cameras [m].")] = 0.12,
    reduce: Reduce = 1,
    noise: Annotated[float, typer.Option(help="Sensor noise added [grey levels].")] = 2.0,
) -> None:
    """RGB-D frame of five people: a rectified pair, the right view drawn from the depth."""
    count = convert_pcl(
        file,
        out,
        robot=robot,
        repeat=repeat,
        rate_hz=rate,
        baseline_m=baseline,
        reduce=reduce,
        noise_grey=noise,
    )
    typer.echo(plain(f"{out}: {count} stereo pairs of {robot}"))


@app.command("mrclam")
def mrclam_command(
    folder: Annotated[Path, typer.Argument(help="Folder of Barcodes.dat, Robot1_Odometry.dat ...")],
    out: Annotated[Path, typer.Argument(help="The new bag: a folder, or NAME.mcap.")],
) -> None:
    """Robots with wheel odometry that see landmarks and each other: UTIAS MRCLAM.

    Landmarks become people who stand. The file of the team's parameters beside the bag says where
    the robots start: `mrs evaluate --localize OUT` scores how well they know where they are.
    """
    made = convert_mrclam(folder, out)
    for name, (scans, landmarks, robots) in made.counts.items():
        typer.echo(plain(f"{name}: {scans} scans with {landmarks} landmarks, {robots} robots"))
    if made.unknown:
        typer.echo(plain(f"left out: {made.unknown} measurements of unknown barcodes"))
    typer.echo(plain(f"{out}: {made.seconds:.1f} s of {len(made.counts)} robots"))

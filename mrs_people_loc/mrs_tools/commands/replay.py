"""`mrs replay`: publish a bag's messages over ROS, in their timing."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Annotated

import typer

from mrs_tools.bags.playing import play_bag


def _positive(value: float) -> float:
    if not (value > 0 and math.isfinite(value)):
        raise typer.BadParameter("must be a number over 0")
    return value


def command(
    bag: Annotated[Path, typer.Argument(help="A bag's folder, or a .mcap or .db3 file.")],
    rate: Annotated[
        float, typer.Option("--rate", "-r", callback=_positive, help="Times as fast as recorded.")
    ] = 1.0,
    loop: Annotated[
        bool, typer.Option("--loop", "-l", help="Begin again at the end, until Ctrl-C.")
    ] = False,
    clock: Annotated[
        bool, typer.Option("--clock", help="Publish bag time on /clock, for use_sim_time.")
    ] = False,
    topics: Annotated[
        list[str] | None,
        typer.Option("--topics", "-t", help="Only these; names or patterns, several with commas."),
    ] = None,
    wait: Annotated[
        float, typer.Option("--wait", min=0.0, help="Wait for subscribers at most this long [s].")
    ] = 5.0,
) -> None:
    """Publish a bag's messages over ROS, in their timing.

    Starts when the number of subscribers has been the same for a second, after --wait seconds at
    the latest. Every topic is offered as reliable, and as transient local where it was recorded
    so. Topics that others on the network publish are left out, but not /tf and /tf_static, which
    many share. Ctrl-C ends it.
    """
    names = [name for text in topics or [] for name in text.replace(",", " ").split()]
    if code := play_bag(bag, rate=rate, loop=loop, clock=clock, topics=names, wait_s=wait):
        raise typer.Exit(code)

"""`mrs calibrate`: height, pitch and roll of stereo heads, by the floor that they see.

    mrs calibrate walk.mcap                                    every head of a bag
    mrs calibrate --robot robot_a --duration 10 -c team.yaml   one that is running now

The YAML goes to the standard output, ready for the team's file; everything else to the terminal.
The floor says nothing of `forward`, `left` and `yaw`: these stay as they are configured.
"""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from mrs_people_loc.errors import FloorError
from mrs_people_loc.health.floor import in_words
from mrs_tools.bags.sources import overridden_beside
from mrs_tools.calibration import from_bag, head_of, how_sure, live, snippet
from mrs_tools.options import Configs, OwnConfig
from mrs_tools.plain import plain

_REMEDY = (
    "Point the head so that two metres and more of bare floor are in view, one and a half to four "
    "metres away, with nobody in between. Floor without any pattern needs a rug or newspapers. "
    "What is configured (--config) must be right within 50 degrees of pitch and 25 of roll"
)


def command(
    bag: Annotated[Path | None, typer.Argument(help="A bag. Default: what is running now.")] = None,
    robot: Annotated[
        list[str] | None,
        typer.Option("--robot", "-r", help="Robot whose head is measured. Default for a bag: all."),
    ] = None,
    config: Configs = None,
    duration: Annotated[
        float,
        typer.Option("--duration", "-d", min=0.1, help="Without a bag: look for this long [s]."),
    ] = 10.0,
    own_config: OwnConfig = True,
) -> None:
    """Measure how high a stereo head sits, its pitch and its roll, by the floor that it sees.

    Prints the mounting as YAML for the team's file, and says how sure it is. The floor says
    nothing of `forward`, `left` and `yaw`: they stay as they are configured.
    """
    from rich.console import Console

    console = Console(stderr=True, soft_wrap=True, highlight=False)
    files, names = config or [], robot or []
    if bag is not None:
        if own_config and (overridden := overridden_beside(bag, files)):
            console.print(plain(overridden), style="yellow", markup=False)
        made = from_bag(bag, files, names, beside=own_config)
    elif len(names) == 1:
        head = head_of(names[0], files)
        console.print(f"looking at /{names[0]} for {duration:g} s ...")
        made = {names[0]: live(head, duration)}
    else:
        raise typer.BadParameter("give a bag, or one --robot that is running")
    failed: list[str] = []
    for name, one in made.items():
        try:
            floor = one.floor()
        except FloorError as err:
            failed.append(str(err))
            continue
        typer.echo(snippet(name, one.config.mounting, floor), nl=False)
        console.print(plain(f"{name}: {in_words(floor)}; {how_sure(floor)}"), markup=False)
        console.print(f"{name} was configured: {in_words(one.config.mounting)}", markup=False)
    if failed:
        raise FloorError("\n".join([*failed, _REMEDY]))

"""`mrs plot`: the figures of the paper's section 6, from a bag.

One interval is shown in every picture: `fig03` the images and their disparity, `fig04` what a
robot ranges, from above and from the side, `fig07`, `fig13`, `fig14` and `fig15` what the stages
leave of it on the common map, `fig16` the fused map, `fig17` its clusters and `fig18` the people.
`stages` and `errors` are about the whole bag. Or an animation of it, see `animation`.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mrs_people_sim.common import progress_bar
from mrs_people_sim.figures.animation import animate, check_is_gif
from mrs_people_sim.figures.bag_figures import Ran, figures_of, run_bag
from mrs_people_sim.figures.files import save
from mrs_tools.bags.sources import overridden_beside
from mrs_tools.options import Configs, OwnConfig
from mrs_tools.plain import plain

if TYPE_CHECKING:
    from rich.progress import Progress


def command(
    bag: Annotated[Path, typer.Argument(help="A bag with our topics.")],
    out: Annotated[
        Path | None, typer.Option("--out", "-o", help="Folder for the pictures.")
    ] = None,
    animation: Annotated[
        Path | None, typer.Option("--animation", "-a", help="GIF file for an animation.")
    ] = None,
    config: Configs = None,
    at: Annotated[
        float | None,
        typer.Option(
            "--at",
            min=0.0,
            help="Draw the interval at this time since the bag's start [s]. Default: the middle.",
        ),
    ] = None,
    own_config: OwnConfig = True,
) -> None:
    """Draw the paper's figures from a bag, as PNG files, or an animation of all of it.

    Images with disparity, views of every stage from above and from the side, the fused map, its
    clusters, the people; then what each stage keeps and a histogram of the errors. The animation
    shows robots, people with their ids and ways, and groups, from above.
    """
    from rich.console import Console
    from rich.text import Text

    if out is None and animation is None:
        raise typer.BadParameter("what is to be drawn? --out FOLDER, --animation FILE, or both")
    if animation is not None:
        check_is_gif(animation)
    console = Console(highlight=False, soft_wrap=True)
    if own_config and (overridden := overridden_beside(bag, config or [])):
        console.print(Text(plain(overridden)), style="yellow")
    with progress_bar() as progress:
        task = progress.add_task(bag.name, total=1.0)
        ran = run_bag(
            bag,
            config or [],
            beside=own_config,
            at_s=at,
            all_views=animation is not None,
            on_progress=lambda p: progress.update(task, completed=p),
        )
        files = [] if out is None else _save_figures(ran, out, progress)
        if animation is not None:
            task = progress.add_task("animation", total=1.0)
            animate(ran.views, animation, on_progress=lambda p: progress.update(task, completed=p))
    for note in ran.result.notes:
        console.print(Text(plain(note)), style="yellow")
    if out is not None:
        console.print(f"{len(files)} pictures in {out}: {', '.join(f.name for f in files)}")
    if animation is not None:
        console.print(f"animation: {animation}")


def _save_figures(ran: Ran, out: Path, progress: Progress) -> list[Path]:
    figures = figures_of(ran)
    task = progress.add_task("drawing", total=len(figures))
    files = []
    for name, figure in figures.items():
        files += save({name: figure}, out)
        progress.advance(task)
    return files

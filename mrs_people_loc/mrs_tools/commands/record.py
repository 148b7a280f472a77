"""`mrs record`: record topics into a bag."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from mrs_tools.bags.recorder import Recorder, Status
from mrs_tools.bags.writer import part_of
from mrs_tools.common import print_note
from mrs_tools.plain import plain
from mrs_tools.signals import Stop, stop_on_signals

if TYPE_CHECKING:
    from rich.console import Console

# So many topics are shown while it records, the largest, and so many are named in a note.
#: So many topics are shown while it records, the largest, and so many are named in a note.
_SHOWN, _NAMED = 12, 5


def command(
    out: Annotated[Path, typer.Argument(help="OUT.mcap, or a new folder's name.")],
    topics: Annotated[
        list[str] | None,
        typer.Argument(
            help="Names or patterns such as '/robot_a/*', exactly these; none: what is needed to "
            "reproduce what the nodes do, and what they say."
        ),
    ] = None,
    duration: Annotated[
        float | None, typer.Option("--duration", "-d", min=0.0, help="End after this time [s].")
    ] = None,
    recover: Annotated[
        bool,
        typer.Option("--recover", help="Make a bag from what a killed recorder left."),
    ] = False,
) -> None:
    """Record topics into a bag, until Ctrl-C.

    Without names: every visible topic but images and clouds that no node of ours takes in (debug
    images, other cameras); '*' is everything. Topics that appear later are taken in. An existing
    bag is never overwritten.
    """
    from rich.console import Console

    console = Console(stderr=True, soft_wrap=True, highlight=False)
    if recover:
        _recover(out, console)
        return
    with stop_on_signals() as stop, Recorder(out, topics or ()) as recorder:
        print_note(console, f"until it is ended (Ctrl-C) the bag lies in {part_of(out)}")
        _record(recorder, out, duration, stop, console)
        _print_left_out(recorder, console)
    _print_counts(recorder.counts, recorder.sizes, console)
    total, size_bytes = sum(recorder.counts.values()), sum(recorder.sizes.values())
    _print(f"{total:8} messages in {plain(str(out))}, {size_bytes / 1e6:.1f} MB", console)


def _recover(out: Path, console: Console) -> None:
    """Makes the bag of a recorder that was killed."""
    from mrs_tools.bags.recovery import recover

    recovered = recover(out)
    _print_counts(recovered.counts, {}, console)
    total = sum(recovered.counts.values())
    _print(f"{total:8} messages recovered in {plain(str(out))}", console)
    if recovered.lost_bytes:
        print_note(
            console, f"of the end {recovered.lost_bytes} bytes are lost, which were not whole"
        )


def _record(
    recorder: Recorder, out: Path, duration_s: float | None, stop: Stop, console: Console
) -> None:
    """Records, and shows the largest topics meanwhile."""
    from rich.live import Live
    from rich.text import Text

    with Live(console=console, auto_refresh=False, transient=True) as live:

        def show(status: Status) -> None:
            if console.is_terminal:
                lines = _lines(recorder.counts, status.sizes, _SHOWN)
                live.update(Text("\n".join([*lines, _line(out, status)])), refresh=True)

        recorder.run(duration_s=duration_s, stop=stop, on_status=show)


def _print_left_out(recorder: Recorder, console: Console) -> None:
    for topic, why in recorder.skipped.items():
        print_note(console, f"{topic} was left out: {why}")
    if recorder.left_out:
        print_note(
            console,
            f"left out, as no node takes them in: {_some(sorted(recorder.left_out))}. "
            "Name topics to record exactly these, or '*' for everything",
        )
    for pattern in recorder.silent():
        print_note(console, f"no message came on {pattern}")


def _print_counts(counts: Mapping[str, int], sizes: Mapping[str, int], console: Console) -> None:
    _print("\n".join(_lines(counts, sizes)), console)


def _print(text: str, console: Console) -> None:
    from rich.text import Text  # names from outside are no markup

    console.print(Text(text))


def _line(out: Path, status: Status) -> str:
    return (
        f"{plain(out.name)}  {status.elapsed_s:.0f} s  {status.topics} topics  "
        f"{status.messages} messages  {status.size_bytes / 1e6:.1f} MB"
    )


def _lines(
    counts: Mapping[str, int], sizes: Mapping[str, int], most: int | None = None
) -> list[str]:
    """Messages and megabytes of each topic; of the largest ones, if not all are wanted."""
    names = sorted(counts)
    if most is not None and len(names) > most:
        names = sorted(sorted(counts, key=lambda name: -sizes.get(name, 0))[:most])
    lines = []
    for name in names:
        size = f"{sizes[name] / 1e6:9.2f} MB  " if name in sizes else ""
        lines.append(f"{counts[name]:8}  {size}{plain(name)}")
    if len(names) < len(counts):
        lines.append(f"     ...  and {len(counts) - len(names)} smaller ones")
    return lines


def _some(names: list[str]) -> str:
    rest = f" and {len(names) - _NAMED} more" if len(names) > _NAMED else ""
    return ", ".join(names[:_NAMED]) + rest

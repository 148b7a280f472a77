"""Replays a bag and tells the terminal about it."""

from __future__ import annotations

import re
import time
from collections.abc import Collection
from pathlib import Path
from typing import TYPE_CHECKING

from mrs_tools.bags.replayer import Replayed, Replayer, by_reason, listed
from mrs_tools.common import print_note
from mrs_tools.plain import plain
from mrs_tools.signals import Stop, stop_on_signals

if TYPE_CHECKING:
    from rich.console import Console

#: Messages that were published so much too late are reported [s].
_LATE_S = 0.1


def play_bag(
    bag: Path,
    *,
    rate: float = 1.0,
    loop: bool = False,
    clock: bool = False,
    topics: Collection[str] = (),
    wait_s: float = 5.0,
) -> int:
    """Publishes a bag until its end, or until a signal comes; notes go to the terminal.

    Args:
        bag: The bag.
        rate: Seconds of bag time per second.
        loop: Whether it begins again at its end.
        clock: Whether `/clock` is published.
        topics: Names or patterns; none: all.
        wait_s: How long to wait for subscribers, at most [s].

    Returns:
        Exit code: 0, or of the signal that stopped it, unless it loops.

    Raises:
        BagError: The bag cannot be replayed, see `Replayer`.
    """
    from rich.console import Console

    console = Console(stderr=True, soft_wrap=True, highlight=False)
    with (
        stop_on_signals() as stop,
        Replayer(bag, rate=rate, clock=clock, topics=topics) as player,
    ):
        _wait_for_subscribers(player, wait_s, stop, console)
        done = _play(player, plain(bag.name), loop, stop, console)
        total = sum(done.counts.values())
        console.print(f"published {total} messages on {len(done.counts)} topics")
        if done.latest_s > _LATE_S:
            late = f"was up to {done.latest_s:.1f} s behind"
            print_note(console, f"{late}: this rate is too much for the machine")
    return 0 if loop else stop.exit_code


def _wait_for_subscribers(player: Replayer, wait_s: float, stop: Stop, console: Console) -> None:
    """Waits, and notes what will not be heard."""
    if player.is_old:
        print_note(
            console,
            f"the bag is from {time.strftime('%F', time.gmtime(player.bag.start_ns * 1e-9))}: "
            "nodes will take its messages for hopelessly late. Replay with --clock, and start "
            "the nodes with use_sim_time:=true",
        )
    matched = player.wait_for_subscribers(wait_s, stop)
    for why, topics in by_reason(player.skipped).items():
        _note_left_out(console, topics, why)
    for topic in player.mismatched():
        print_note(
            console, f"a subscriber of {topic} gets nothing: its quality of service does not fit"
        )
    if not any(matched.values()) and not stop.is_set():
        print_note(console, "nobody listens yet (same ROS_DOMAIN_ID?)")


def _play(player: Replayer, label: str, loop: bool, stop: Stop, console: Console) -> Replayed:
    """Plays with a bar of the bag's time."""
    from rich.progress import BarColumn, Progress, TextColumn

    with Progress(
        TextColumn("{task.fields[label]}", markup=False),
        BarColumn(),
        TextColumn("{task.completed:.1f} / {task.total:.1f} s"),
        console=console,
        disable=not console.is_terminal,
    ) as bar:
        task = bar.add_task("", label=label, total=player.bag.duration_s)
        return player.play(
            loop=loop,
            stop=stop,
            on_progress=lambda p: bar.update(task, completed=max(0.0, p.position_s)),
            on_left_out=lambda topics, why: _note_left_out(console, topics, why),
        )


def _note_left_out(console: Console, topics: list[str], why: str) -> None:
    if len(topics) > 1:
        why = re.sub(" it$", " them", re.sub("^its type ", "their type ", why))
    verb = "is" if len(topics) == 1 else "are"
    print_note(console, f"{listed(topics)} {verb} left out: {why}")

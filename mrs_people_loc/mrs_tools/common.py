"""What several commands print: notes and tables."""

from __future__ import annotations

from typing import TYPE_CHECKING

from mrs_tools.plain import plain

if TYPE_CHECKING:
    from rich.console import Console
    from rich.table import Table


def print_note(console: Console, text: str) -> None:
    """Prints a line that begins with "note: "; names from outside are harmless in it."""
    from rich.text import Text

    console.print(Text.assemble(("note: ", "yellow"), plain(text)))


def make_table(title: str, *columns: str, padding: tuple[int, int] = (0, 1)) -> Table:
    """A table without frame: the first column to the left, the others, of numbers, to the right.

    Title and heads are no markup, so that they may hold "[ms]".
    """
    from rich import box
    from rich.table import Table
    from rich.text import Text

    table = Table(
        title=Text(title),
        title_justify="left",
        box=box.SIMPLE_HEAD,
        show_edge=False,
        padding=padding,
    )
    for column in columns:
        if table.columns:
            table.add_column(Text(column), justify="right", no_wrap=True)
        else:
            table.add_column(Text(column), overflow="fold")
    return table

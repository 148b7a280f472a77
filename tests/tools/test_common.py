"""What the commands print."""

from __future__ import annotations

import io

from rich.console import Console

from mrs_tools.common import make_table, print_note


def test_note_is_harmless_to_the_terminal() -> None:
    out = io.StringIO()
    print_note(Console(file=out, width=80), "[bold]/topic\x1b[31m[/] is left out")
    assert out.getvalue() == "note: [bold]/topic\\x1b[31m[/] is left out\n"


def test_title_and_heads_of_a_table_are_no_markup() -> None:
    out = io.StringIO()
    table = make_table("time [ms]", "stage", "median [ms]")
    Console(file=out, width=80).print(table)
    assert out.getvalue().split() == ["time", "[ms]", "stage", "median", "[ms]", "─" * 21]

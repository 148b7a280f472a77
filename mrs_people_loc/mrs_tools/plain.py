"""Texts of others, as they may be printed."""

from __future__ import annotations

import unicodedata


def plain(text: str) -> str:
    r"""A text of a message or a file, harmless to a terminal.

    What is no printable character (escape sequences, which move the cursor or change colours; line
    ends; marks that turn the direction of writing) is spelled out: `\x1b`. Where rich prints it,
    make it a `rich.text.Text`, or `rich.markup.escape` it too: brackets are markup there.

    Args:
        text: Any text, of one line.
    """
    return "".join(c if _is_harmless(c) else _spelled(c) for c in text)


def _is_harmless(character: str) -> bool:
    return unicodedata.category(character) not in ("Cc", "Cf", "Cs", "Zl", "Zp")


def _spelled(character: str) -> str:
    return character.encode("unicode_escape").decode("ascii")

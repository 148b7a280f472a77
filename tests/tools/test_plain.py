"""Texts of messages and files are printed so that they do nothing to a terminal."""

from __future__ import annotations

import pytest

pytest.importorskip("typer", reason="the mrs command needs typer")

from typer.testing import CliRunner

from mrs_tools.cli import app
from mrs_tools.plain import plain


@pytest.mark.parametrize(
    ("text", "wanted"),
    [
        ("/robot_a: 3 scans [ms]", "/robot_a: 3 scans [ms]"),
        ("Müller, 5 °C, 人", "Müller, 5 °C, 人"),
        ("\x1b[2Jgone", r"\x1b[2Jgone"),
        ("\x9b31m", r"\x9b31m"),
        ("one\r\ntwo\t\x00\x7f", r"one\r\ntwo\t\x00\x7f"),
        ("\u202eabc\u2028", r"\u202eabc\u2028"),
        ("\ud800", r"\ud800"),
    ],
)
def test_unprintable_characters_are_escaped(text, wanted):
    assert plain(text) == wanted


@pytest.mark.parametrize("command", [["evaluate"], ["replay"], ["plot", "--out", "out"]])
def test_file_names_in_errors_are_escaped(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    result = CliRunner().invoke(app, [*command, "\x1b]0;title\x07[/b].mcap"])
    assert result.exit_code == 1
    assert r"\x1b]0;title\x07[/b].mcap: there is no such bag" in result.output
    assert "\x1b" not in result.output

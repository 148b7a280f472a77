"""What the commands share."""

from __future__ import annotations

import json
from pathlib import Path

import cv2
import pytest

from mrs_people_loc.errors import PeopleLocError
from mrs_people_sim.common import (
    counting_bar,
    number,
    one_thread,
    process_count,
    write_json,
    write_text,
)


@pytest.mark.parametrize(
    ("value", "factor", "digits", "text"),
    [(0.1234, 100, 1, "12.3"), (2.0, 1, 0, "2"), (-0.5, 1, 2, "-0.50"), (None, 100, 1, "-")],
)
def test_number_has_factor_and_digits(value, factor, digits, text):
    assert number(value, factor, digits) == text


def test_json_file_ends_with_a_line_end_and_is_what_was_written(tmp_path: Path) -> None:
    file = tmp_path / "report.json"
    write_json(file, {"recall": 0.5, "none": None})
    assert file.read_text() == '{\n  "recall": 0.5,\n  "none": null\n}\n'
    assert json.loads(file.read_text()) == {"recall": 0.5, "none": None}


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_json_file_takes_no_nan(tmp_path: Path, value: float) -> None:
    file = tmp_path / "report.json"
    with pytest.raises(ValueError, match="JSON"):
        write_json(file, {"recall": value})
    assert not file.exists()


def test_file_that_cannot_be_written_is_an_error_with_its_name(tmp_path: Path) -> None:
    with pytest.raises(PeopleLocError, match="nowhere/report.md: cannot be written"):
        write_text(tmp_path / "nowhere" / "report.md", "text")


def test_bar_shows_nothing_without_a_terminal(capsys: pytest.CaptureFixture[str]) -> None:
    with counting_bar("frames", 2) as advance:
        advance()
        advance()
    assert capsys.readouterr() == ("", "")


def test_no_number_of_jobs_is_one_per_core(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("os.cpu_count", lambda: 6)
    assert process_count(0) == 6
    assert process_count(3) == 3
    monkeypatch.setattr("os.cpu_count", lambda: None)
    assert process_count(0) == 1


def test_threads_of_opencv_are_as_before_also_after_an_error() -> None:
    before = cv2.getNumThreads()
    during = []

    def fail() -> None:
        with one_thread():
            during.append(cv2.getNumThreads())
            raise KeyError

    with pytest.raises(KeyError):
        fail()
    assert during == [1]
    assert cv2.getNumThreads() == before

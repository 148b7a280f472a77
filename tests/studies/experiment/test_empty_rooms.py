"""`mrs rooms`: on rooms made of boxes, and what the list and the page of the real ones say."""

from __future__ import annotations

import json
from collections import Counter
from pathlib import Path

import cv2
import numpy as np
import pytest

from mrs_people_loc.errors import BagError

pytest.importorskip("typer", reason="the mrs command needs typer")

from typer.testing import CliRunner

from mrs_studies.experiment import empty_rooms
from mrs_studies.experiment.empty_rooms import Count, as_json, count_false, markdown, run_rooms
from mrs_studies.recordings.depth_views import stereo_view
from mrs_studies.recordings.empty_rooms import HALVES, ROOMS, Room
from mrs_tools.cli import app
from tools.box_room import BOX, CAMERA, Box, person, picture

ROOT = Path(__file__).resolve().parents[3]
BY_NAME = {room.name: room for room in ROOMS}
#: One room of each half, each the only one of its source.
DINING, LIVING = BY_NAME["dining room"], BY_NAME["living room"]


@pytest.fixture(autouse=True)
def short(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(empty_rooms, "FRAMES", 6)


def write_room(folder: Path, room: Room, *views: tuple[Box, ...] | None) -> None:
    """The pictures of a room, of boxes; None: of a wall alone."""
    checkout = folder / room.source.repository.replace("/", "+")
    for number, boxes in zip(room.numbers, views, strict=True):
        size = (560, 425) if room is DINING else (640, 480)
        grey, depth = picture(boxes or (), camera=room.camera, size=size)
        if boxes is None:
            depth[:] = 3.0
        values = np.rint(depth / room.camera.unit_m).astype(np.uint16)
        for path, image in ((room.colour, grey), (room.depth, values)):
            file = checkout / path.format(number)
            file.parent.mkdir(parents=True, exist_ok=True)
            assert cv2.imwrite(str(file), image)


def rows(text: str) -> dict[str, list[str]]:
    """The rows of the first table, by room."""
    first = text.partition("By data set")[0]
    cells = [line.strip("| ").split(" | ") for line in first.splitlines() if line.startswith("| ")]
    return {name: figures for name, *figures in cells[1:]}


def test_box_is_nobody_and_who_stands_there_is_counted_once() -> None:
    empty = count_false(stereo_view(*picture(BOX), CAMERA))
    assert empty == Count(1, 6)
    two = count_false(stereo_view(*picture((*BOX, *person(2.5, 0.4))), CAMERA))
    assert (two.present, two.single) == (6, 6)
    assert list(two.ranges) == pytest.approx([np.hypot(2.5, 0.4)], abs=0.15)
    assert two.by_range() == [0, 1, 0, 0]


def test_figures_match_hand_computed_values() -> None:
    # Ten seconds with three false people, of whom two are there for half of the time and the
    # third for all of it; 20 s with nobody; and a room in which no view can be used.
    found = Count(1, 50, 100, 150, (1.9, 2.1, 6.0))
    nobody = Count(2, 100, 0, 0, (), {"y": "no floor"})
    counts = {DINING: found, LIVING: nobody, BY_NAME["office"]: Count(left_out={"x": "no floor"})}
    table = rows(markdown(counts))
    assert table["dining room"] == [
        "untouched", "1", "0", "0.17", "3", "18.0", "2.00", "3.00", "1", "1", "0", "1",
    ]  # fmt: skip
    assert table["living room"][1:8] == ["2", "1", "0.33", "0", "0.0", "0.00", "0.00"]
    assert table["office"][1:8] == ["0", "1", "0.00", "0", "-", "-", "-"]
    assert table["**all**"][1:8] == ["3", "2", "0.50", "3", "6.0", "0.67", "1.00"]
    assert table["**untouched**"][1:] == table["dining room"][1:]
    assert "median room: fitting 0.0, untouched 18.0, all 9.0." in markdown(counts)
    report = as_json(counts)
    assert report["total"]["false_people_per_minute"] == pytest.approx(6.0)
    assert report["total"]["median_room"] == pytest.approx(9.0)
    assert report["halves"]["fitting"]["false_people_up_to_m"] == {
        "2.0": 0, "3.5": 0, "5.0": 0, "None": 0,
    }  # fmt: skip
    assert report["rooms"]["living room"]["left_out"] == {"y": "no floor"}


def test_missing_rooms_and_views_without_floor_are_named(tmp_path: Path) -> None:
    write_room(tmp_path, LIVING, BOX, None, None, None, None)
    counts, lines = run_rooms([LIVING, DINING], tmp_path)
    assert list(counts) == [LIVING]
    assert (counts[LIVING].views, len(counts[LIVING].left_out)) == (1, 4)
    assert len(lines) == 5
    assert lines[0].startswith("living room 2: left out, ")
    assert DINING.source.commit in lines[-1]
    with pytest.raises(BagError, match="none of the rooms; dining room: "):
        run_rooms([DINING], tmp_path)


def test_damaged_pictures_are_an_error(tmp_path: Path) -> None:
    (tmp_path / DINING.source.repository.replace("/", "+")).mkdir()
    with pytest.raises(BagError, match=r"images\.png cannot be read"):
        run_rooms([DINING], tmp_path)


def test_command_prints_and_writes_the_chosen_half(tmp_path: Path) -> None:
    write_room(tmp_path, DINING, person(2.5, 0.0))
    page, figures = tmp_path / "page.md", tmp_path / "figures.json"
    page.write_text("# Page\n\n## Results\n\nold\n")
    args = ["rooms", tmp_path, "--only", "untouched", "--out", page, "--json", figures]
    result = CliRunner().invoke(app, [str(arg) for arg in args])
    assert result.exit_code == 0, result.output
    assert page.read_text() == f"# Page\n\n{result.stdout}"
    assert rows(result.stdout)["dining room"][:5] == ["untouched", "1", "0", "0.02", "1"]
    assert "**fitting**" not in rows(result.stdout)
    document = json.loads(figures.read_text())
    assert document["rooms"]["dining room"]["false_people"] == 1
    assert len(document["left_out"]) == sum(room.half == "untouched" for room in ROOMS) - 1


def test_rooms_are_split_evenly_and_a_hall_is_in_one_half() -> None:
    assert Counter(room.half for room in ROOMS) == dict.fromkeys(HALVES, len(ROOMS) // 2)
    assert len(BY_NAME) == len(ROOMS) >= 12
    assert len({room.data_set for room in ROOMS}) >= 3
    assert all(len(room.numbers) <= 8 for room in ROOMS)
    hall = [room for room in ROOMS if "hall" in room.name]
    assert len(hall) == 4
    assert len({room.half for room in hall}) == 1


def test_page_has_every_room_and_source() -> None:
    page = (ROOT / "docs" / "rooms.md").read_text("utf-8")
    text, _, results = page.partition("## Results")
    figures = rows(results)
    for room in ROOMS:
        half, views, left_out, *_ = figures.pop(room.name)
        assert half == room.half
        assert int(views) + int(left_out) == len(room.numbers)
        for what in (room.source.repository, room.source.commit[:10], room.source.licence):
            assert what in text
    assert list(figures) == [f"**{half}**" for half in (*HALVES, "all")]

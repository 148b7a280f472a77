"""`mrs real`: on bags made by hand, and on the recordings of real rooms where they are."""

from __future__ import annotations

import dataclasses
import json
import os
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mrs_people_loc.errors import BagError

pytest.importorskip("rosbags.interfaces", reason="writing bags needs rosbags")
pytest.importorskip("typer", reason="the mrs command needs typer")

from typer.testing import CliRunner

from mrs_people_sim.evaluation.labels import SUFFIX, read_labels
from mrs_studies.experiment.real_rooms import (
    Scores,
    as_json,
    find_recordings,
    markdown,
    run_recordings,
)
from mrs_tools.bags.writer import BagWriter
from mrs_tools.cli import app
from mrs_tools.installing import default_file
from tools.made_bag import MS, START_NS, Bag

ROOT = Path(__file__).resolve().parents[3]
PAPER = default_file("config", "paper.yaml")
PLACES = ((2.0, 1.0), (4.0, -1.0))
FRAMES = 4


def write_recording(folder: Path, name: str, *, mounting: bool = True) -> None:
    """One robot at the origin of the map sends two people who stand, at 10 Hz."""
    with BagWriter(folder / f"{name}.mcap") as writer:
        bag = Bag(writer)
        for index in range(FRAMES):
            bag.pose_topic("robot_x", 100 * index, 0, 0)
            bag.points("robot_x", 100 * index, *PLACES)
    if mounting:
        text = "/**/robot_node: {ros__parameters: {mounting: {height: 1.0}}}\n"
        (folder / f"{name}.yaml").write_text(text)


def write_labels(folder: Path, name: str, *, must: int, follow: bool = True) -> None:
    """The heads of the first people are 0.1 m from where they are sent, their trunks there."""
    people = [
        {"frame": index, "id": 1 + who, "head": [x + 0.1, y], "trunk": [x, y], "must": True,
         "posture": "stands", "source": "head"}
        for index in range(FRAMES)
        for who, (x, y) in enumerate(PLACES[:must])
    ]  # fmt: skip
    document = {"first_ns": START_NS, "step_ns": 100 * MS, "frames": FRAMES, "follow": follow}
    (folder / f"{name}{SUFFIX}").write_text(json.dumps({**document, "people": people}))


@pytest.fixture
def rooms(tmp_path: Path) -> tuple[Path, Path]:
    """Folders of bags and of labels: two labelled rooms, three bags or labels without partner."""
    bags, labels = tmp_path / "bags", tmp_path / "labels"
    bags.mkdir()
    labels.mkdir()
    for name in ("hall", "empty", "unlabelled"):
        write_recording(bags, name)
    write_recording(bags, "unmounted", mounting=False)
    write_labels(labels, "hall", must=1)
    write_labels(labels, "empty", must=0, follow=False)
    for name in ("absent", "unmounted"):
        write_labels(labels, name, must=1)
    return bags, labels


def run_both(bags: Path, labels: Path) -> Scores:
    found, _ = find_recordings(bags, labels)
    return run_recordings(found, paper=PAPER)


def rows(text: str) -> dict[str, list[str]]:
    """The rows of the first table, by recording."""
    first = text.partition("## By range")[0]
    cells = [line.strip("| ").split(" | ") for line in first.splitlines() if line.startswith("| ")]
    return {name: figures for name, *figures in cells[1:]}


def test_recordings_without_labels_bag_or_mounting_are_named(rooms: tuple[Path, Path]) -> None:
    bags, labels = rooms
    found, lines = find_recordings(bags, labels)
    assert [one.name for one in found] == ["empty", "hall"]
    assert lines == [
        f"absent: missing, {bags} has no such bag",
        f"unlabelled: left out, it has no unlabelled.labels.json beside it or in {labels}",
        "unmounted: left out, unmounted.yaml with its mounting is not beside it",
    ]


def test_labels_beside_a_bag_come_before_those_of_the_folder(rooms: tuple[Path, Path]) -> None:
    bags, labels = rooms
    write_labels(bags, "hall", must=2)
    write_labels(bags, "unlabelled", must=1)
    found, _ = find_recordings(bags, labels)
    assert {one.name: len(one.labels.people) for one in found} == {
        "empty": 0, "hall": 2 * FRAMES, "unlabelled": FRAMES,
    }  # fmt: skip


def test_folders_without_labelled_recordings_are_refused(rooms: tuple[Path, Path]) -> None:
    bags, labels = rooms
    with pytest.raises(BagError, match="none is no folder"):
        find_recordings(bags / "none", labels)
    with pytest.raises(BagError, match=r"no labelled recording; .*hall: missing"):
        find_recordings(labels, labels)


def test_table_matches_hand_computed_values(rooms: tuple[Path, Path]) -> None:
    # Both methods find the two people that the robot sends; only the first is labelled, in the
    # hall. A match is 0.1 m from the head, and at the trunk.
    figures = rows(markdown(run_both(*rooms)))
    hall = ["4", "4", "4", "1.000", "0.500", "10.0 (0.0)"]
    assert figures["hall"][:6] == hall
    assert figures["hall"][7:] == ["0.000", "0.800", "0 of 4"]
    assert figures["empty"] == ["0", "0", "8", "-", "0.000", "- (-)", "- (-)", "-", "-", "0 of 4"]
    for name in ("**all**", "all, paper.yaml"):
        assert figures[name][:6] == ["4", "4", "12", "1.000", "0.250", "10.0 (0.0)"]
        assert figures[name][7:] == ["-2.000", "0.800", "0 of 8"]


def test_errors_along_the_line_of_sight_are_by_range(rooms: tuple[Path, Path]) -> None:
    scores = run_both(*rooms)
    hall = scores.default()["hall"]
    away = float(np.hypot(*hall.trunk[0].true[0]))
    farther = dataclasses.replace(
        hall,
        trunk=[dataclasses.replace(one, true=one.true * (1 - 0.1 / away)) for one in hall.trunk],
    )
    np.testing.assert_allclose(farther.along[:, 1], 0.1, atol=1e-6)
    assert len(farther.along) == 4
    found = {row["up_to_m"]: row["found"] for row in as_json(scores)["by_range"]}
    assert sum(found.values()) == 4
    assert found[min(most for most in found if most >= away)] == 4


def test_people_are_followed_only_where_the_labels_allow_it(rooms: tuple[Path, Path]) -> None:
    scores = run_both(*rooms)
    assert scores.follow == {"empty": False, "hall": True}

    def ids(name: str) -> bool:
        estimates = scores.default()[name].result.estimates
        return any(estimate.ids.any() for estimate in estimates)

    assert ids("hall")
    assert not ids("empty")
    for name in ("empty", "hall"):
        assert any(e.ids.any() for e in scores.followed[name].result.estimates)
        assert not any(e.ids.any() for e in scores.intervals[name].result.estimates)
    assert "empty: interval by interval, the others followed" in markdown(scores)


def test_command_prints_writes_and_names_what_is_left_out(
    rooms: tuple[Path, Path], tmp_path: Path
) -> None:
    bags, labels = rooms
    page, figures = tmp_path / "page.md", tmp_path / "figures.json"
    page.write_text("# Page\n\n## Results\n\nold\n")
    args = ["real", bags, "--labels", labels, "--out", page, "--json", figures]
    result = CliRunner().invoke(app, [str(arg) for arg in args])
    assert result.exit_code == 0, result.output
    assert "absent: missing" in result.stderr
    assert page.read_text() == f"# Page\n\n{result.stdout}"
    assert rows(result.stdout)["hall"][0] == "4"
    document = json.loads(figures.read_text())
    assert [line.partition(":")[0] for line in document["left_out"]] == [
        "absent", "unlabelled", "unmounted",
    ]  # fmt: skip
    hall, empty = (document["recordings"][name] for name in ("hall", "empty"))
    assert (hall["table"], empty["table"]) == ("followed", "intervals")
    assert hall["followed"]["people"]["error_m"]["mean"] == pytest.approx(0.1)
    assert hall["intervals"]["trunk"]["error_m"]["mean"] == pytest.approx(0.0, abs=1e-6)
    assert document["total"]["default"]["people"]["moda"] == pytest.approx(1 - 12 / 4)


def test_documented_table_has_every_labelled_recording() -> None:
    page = (ROOT / "docs" / "real_rooms.md").read_text("utf-8")
    figures = rows(page.partition("## Results")[2])
    for file in sorted((ROOT / "studies" / "labels").glob(f"*{SUFFIX}")):
        labels = read_labels(file)
        row = figures.pop(file.name.removesuffix(SUFFIX))
        assert int(row[0]) == sum(label.must for label in labels.people)
        assert row[-1].endswith(f" of {labels.frames}")
    assert list(figures) == ["**all**", "all, paper.yaml"]


def test_readme_has_the_totals_of_the_documented_table() -> None:
    page = (ROOT / "docs" / "real_rooms.md").read_text("utf-8")
    figures = rows(page.partition("## Results")[2])
    readme = (ROOT / "README.md").read_text("utf-8")
    for label, total in (
        ("default, real rooms", figures["**all**"]),
        ("the paper's method, real rooms", figures["all, paper.yaml"]),
    ):
        mean = total[5].partition(" ")[0]
        wanted = [label, *total[3:5], f"{mean} cm", *total[7:9]]
        assert f"| {' | '.join(wanted)} |" in readme


# --------------------------------------------------------------------------- real recordings

#: Just below what default.yaml reaches over all recordings, 62 of 67 people and 3 false: two people
#: fewer, three more false ones; the mean error [m]; and frames of the empty room, of 15, in which
#: nobody is found.
LEAST = {"recall": 60 / 67, "precision": 60 / 66}
LARGEST_ERROR_M = 0.104
LEAST_EMPTY = 13


@pytest.fixture(scope="module")
def real() -> Scores:
    folder = os.environ.get("MRS_RECORDINGS")
    if not folder:
        pytest.skip("MRS_RECORDINGS names no folder of recordings (docs/real_rooms.md)")
    found, lines = find_recordings(Path(folder), ROOT / "studies" / "labels")
    for line in lines:
        print(line)
    return run_recordings(found, paper=PAPER)


def people_of(scores: Scores) -> dict[str, Any]:
    from mrs_studies.experiment.real_rooms import Score

    people: dict[str, Any] = Score.pooled(list(scores.default().values())).report()["people"]
    return people


def test_real_rooms_scores_do_not_regress(real: Scores) -> None:
    people = people_of(real)
    print(people)
    if people["true"] < 67:
        pytest.skip(f"only {people['true']} of the 67 people are in this folder")
    for key, least in LEAST.items():
        assert people[key] >= least, key
    assert people["error_m"]["mean"] <= LARGEST_ERROR_M


def test_nobody_is_found_in_the_empty_room(real: Scores) -> None:
    if "room1_c1" not in real.follow:
        pytest.skip("room1_c1 is not in this folder")
    people = real.default()["room1_c1"].result.report()["people"]
    assert people["frames_without_false"] >= LEAST_EMPTY


def test_documented_table_is_that_of_the_command(real: Scores) -> None:
    """Counts may differ by some people between machines and versions of OpenCV."""
    page = (ROOT / "docs" / "real_rooms.md").read_text("utf-8")
    documented = rows(page.partition("## Results")[2])
    for name, row in rows(markdown(real)).items():
        if name not in real.follow:
            continue
        must, found, false = map(int, row[:3])
        assert must == int(documented[name][0])
        assert abs(found - int(documented[name][1])) <= 2
        assert abs(false - int(documented[name][2])) <= 3
        assert re.search(r" of \d+$", row[-1])

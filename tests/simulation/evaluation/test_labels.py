"""Label files: what they become, and what is refused."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mrs_people_loc.errors import BagError

pytest.importorskip("rosbags.interfaces", reason="reading bags needs rosbags")

from mrs_people_sim.evaluation.labels import SUFFIX, labels_at, labels_beside, name_of, read_labels

RECORDINGS = Path(__file__).resolve().parents[3] / "studies" / "labels"
#: People who must and may be found, as in the table of docs/real_rooms.md.
COUNTS = {
    "um_c1": (25, 176),
    "lab1_c1": (4, 31),
    "lab2_c1": (21, 80),
    "lab2_c2": (17, 7),
    "room1_c1": (0, 0),
}


def person(frame: int, number: int, x: float, **more: Any) -> dict[str, Any]:
    return {
        "frame": frame, "id": number, "head": [x, 0.5], "trunk": None, "must": True,
        "posture": "walks", "source": "head", **more,
    }  # fmt: skip


def write(path: Path, *people: dict[str, Any], **changes: Any) -> Path:
    document = {"first_ns": 1000, "step_ns": 10, "frames": 3, "follow": True, "people": people}
    path.write_text(json.dumps({**document, **changes}))
    return path


def test_labels_become_truth(tmp_path: Path) -> None:
    labels = read_labels(
        write(
            tmp_path / "a.labels.json",
            person(0, 7, 1.0, trunk=[1.1, 0.4]),
            person(2, 7, 3.0, must=False),
            person(0, 2, 5.0),
        )
    )
    truth = labels.truth()
    assert truth.stamps_ns.tolist() == [1000, 1010, 1020]
    # Person 2 is the first column, person 7 the second.
    nan = math.nan
    np.testing.assert_array_equal(truth.positions[..., 0], [[5, 1], [nan, nan], [nan, 3]])
    assert truth.visible.tolist() == [[True, True], [False, False], [False, False]]
    trunk = labels.truth(trunk=True)
    np.testing.assert_array_equal(trunk.positions[0], [[5.0, 0.5], [1.1, 0.4]])


def test_unknown_people_of_different_frames_are_different_people(tmp_path: Path) -> None:
    people = [person(0, 0, 1.0), person(0, 0, 2.0), person(1, 0, 3.0)]
    truth = read_labels(write(tmp_path / "a.labels.json", *people)).truth()
    assert np.isfinite(truth.positions[..., 0]).sum(axis=0).tolist() == [1, 1, 1]
    # Halfway between two frames nobody is halfway between two people.
    places, _ = truth.at(1005)
    assert sorted(places[np.isfinite(places[:, 0]), 0].tolist()) == [1.0, 2.0]


@pytest.mark.parametrize(
    ("document", "text"),
    [
        ([], r"keys are \[\]; wanted: first_ns, step_ns, frames, follow, people"),
        ({"frames": 3}, r"keys are \['frames'\]; wanted"),
        ({"frames": True}, "frames is 'True'; allowed: int"),
        ({"frames": 0}, "frames is 0; allowed: 1 to"),
        ({"step_ns": -5}, "step_ns is -5; allowed: 1 to"),
        ({"follow": 1}, "follow is '1'; allowed: bool"),
        ({"people": [3]}, "keys are 3; wanted: frame, id"),
        ({"people": [person(3, 1, 1.0)]}, "frame 3, id 1.*allowed: 0 to 2"),
        ({"people": [person(0, -1, 1.0)]}, "id -1"),
        ({"people": [person(0, 1, 1.0, posture="lies")]}, "'lies'; allowed: .*sits"),
        ({"people": [person(0, 1, math.nan)]}, r"head is \[nan, 0.5\]; allowed: \[x, y\]"),
        ({"people": [person(0, 1, 1.0, trunk=[1.0])]}, r"trunk is \[1.0\]"),
        ({"people": [person(0, 1, 1.0, head=["1", 2])]}, "head is"),
        ({"people": [person(1, 4, 1.0), person(1, 4, 2.0)]}, "person 4 is 2 times in frame 1"),
        ({"people": [person(0, 0, 1.0)] * 2001}, "2001 people; allowed: 2000"),
    ],
)
def test_wrong_label_files_are_refused(tmp_path: Path, document: Any, text: str) -> None:
    path = tmp_path / "a.labels.json"
    if document == [] or document == {"frames": 3}:
        path.write_text(json.dumps(document))
    else:
        write(path, **document)
    with pytest.raises(BagError, match=rf"a\.labels\.json is no label file: .*{text}"):
        read_labels(path)


def test_unreadable_label_files_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "a.labels.json"
    for text in ("{", "[" * 200_000):
        path.write_text(text)
        with pytest.raises(BagError, match="cannot be read"):
            read_labels(path)
    with pytest.raises(BagError, match=r"b\.labels\.json cannot be read"):
        labels_at(tmp_path, tmp_path / "b.mcap")


def test_labels_are_found_beside_their_bag(tmp_path: Path) -> None:
    write(tmp_path / "walk.v2.labels.json", person(0, 1, 1.0))
    for bag in ("walk.v2", "walk.v2.mcap"):
        found = labels_beside(tmp_path / bag)
        assert found is not None
        assert len(found.people) == 1
    assert labels_beside(tmp_path / "walk") is None


def test_committed_labels_have_the_documented_counts() -> None:
    files = sorted(RECORDINGS.glob(f"*{SUFFIX}"))
    assert sorted(file.name.removesuffix(SUFFIX) for file in files) == sorted(COUNTS)
    for file in files:
        labels = read_labels(file)
        must = sum(label.must for label in labels.people)
        assert (must, len(labels.people) - must) == COUNTS[name_of(file.name.removesuffix(SUFFIX))]
        # Everybody who must be found is within the working range, standing or walking.
        for label in labels.people:
            if label.must:
                assert 0.5 < math.hypot(*label.head) <= 5.0
                assert label.posture in ("walks", "stands")

"""The people before whom a robot sees no wall."""

import numpy as np

from mrs_people_loc.localization.walls.people_in_view import people_in
from mrs_people_loc.scan import BODY_DTYPE, CELL_DTYPE, Cells, Scan


def scan(*bodies, dtype=BODY_DTYPE) -> Scan:
    """Bodies of number, log-odds and cells (x, y)."""
    records = np.zeros(sum(len(cells) for *_, cells in bodies), dtype)
    at = 0
    for number, score, cells in bodies:
        part = records[at : at + len(cells)]
        part["x"], part["y"] = np.transpose(cells)
        if number:
            part["body"], part["score"] = number, score
        at += len(cells)
    return Scan("robot_a", 1, Cells.from_records(records))


def test_middle_of_each_likely_person_is_given():
    found = people_in(
        scan(
            (2, 3.0, [(2.0, 1.0), (2.0, 1.25), (2.0, 1.5)]),
            (5, -0.5, [(4.0, 4.0)]),  # rather a chair
            (7, 0.0, [(3.0, -1.0), (3.5, -2.0)]),
        )
    )
    np.testing.assert_allclose(found, [(2.0, 1.25, 0.0), (3.25, -1.5, 0.0)])


def test_scans_without_people_have_none():
    assert people_in(scan()).shape == (0, 3)
    assert people_in(scan((0, 0.0, [(1.0, 1.0)]), dtype=CELL_DTYPE)).shape == (0, 3)

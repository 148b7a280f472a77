import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.cells.detector import detect
from mrs_people_loc.people import NOBODY, Expected
from mrs_people_loc.scan import Scan
from mrs_people_loc.team.fusion import fuse
from mrs_people_loc.team.masking import Known
from mrs_people_loc.team.poses import Pose

POSES = {"a": Pose(0, 0.0, 0.0, 0.0)}
#: Cells of a body about its axis: 20 of them.
BODY = [(dx, dy) for dx in (-0.1, -0.05, 0.0, 0.05, 0.1) for dy in (-0.15, -0.05, 0.05, 0.15)]


def found(make_cells, *people: tuple[float, float, int], expected=NOBODY, masked: int = 0):
    """Places and scores of people of so many points per cell, the first of them masked."""
    cells = [(x + dx, y + dy) for x, y, _ in people for dx, dy in BODY]
    count = [points for _, _, points in people for _ in BODY]
    fused = fuse([Scan("a", 0, make_cells(cells, count=count))], POSES)
    everything = np.arange(len(fused))
    known = Known(everything, everything < masked * len(BODY), np.empty(0, dtype=bool))
    result = detect(fused, known, POSES, expected, cfg.PlannerConfig())
    return [(*person.position.round(2).tolist(), person.score > 0) for person in result.persons]


def test_weak_cluster_is_an_uncertain_person_only_where_one_is_expected(make_cells):
    """A person needs 150 points; 80 are enough where one is expected (half of them: 75)."""
    strong, weak, elsewhere = (3.0, 0.0, 20), (3.0, 1.5, 4), (3.0, -1.5, 4)
    expected = Expected(
        np.array([(3.0, 1.5)]), 0.01 * np.eye(2)[np.newaxis], np.array([1]), np.array([False])
    )
    people = strong, weak, elsewhere
    assert found(make_cells, *people) == [(3.0, 0.0, True)]
    assert found(make_cells, *people, expected=expected) == [(3.0, 0.0, True), (3.0, 1.5, False)]


def test_masked_cluster_is_nobody(make_cells):
    two = (3.0, 0.0, 20), (3.0, 1.5, 20)
    assert found(make_cells, *two) == [(3.0, 0.0, True), (3.0, 1.5, True)]
    assert found(make_cells, *two, masked=1) == [(3.0, 1.5, True)]

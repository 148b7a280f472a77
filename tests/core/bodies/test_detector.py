import dataclasses

import numpy as np
import pytest

from mrs_people_loc import config as cfg
from mrs_people_loc.bodies.detector import detect
from mrs_people_loc.people import NOBODY, Expected
from mrs_people_loc.scan import Scan
from mrs_people_loc.team.fusion import fuse, place_bodies
from mrs_people_loc.team.masking import Known
from mrs_people_loc.team.poses import Pose

ORIGIN = Pose(0, 0.0, 0.0, 0.0)


@pytest.fixture
def detected(make_cells):
    """Detections among bodies as (x, y, score), one list per robot; some of them are robots."""

    def run(*scans, robots=(), expected=NOBODY):
        made = []
        for number, found in enumerate(scans):
            x, y, score = np.array(found, dtype=np.float32).reshape(-1, 3).T.copy()
            cells = dataclasses.replace(
                make_cells(np.stack([x, y], axis=1)),
                body=np.arange(1, len(x) + 1, dtype=np.uint32),
                score=score,
                sigma_range=np.full(len(x), 0.1, dtype=np.float32),
                sigma_across=np.full(len(x), 0.05, dtype=np.float32),
            )
            made.append(Scan("abc"[number], 0, cells))
        poses = {scan.robot: ORIGIN for scan in made}
        fused = fuse(made, poses)
        bodies = place_bodies(fused, poses, line_of_sight=True)
        known = np.isin(np.arange(len(bodies)), robots)
        nothing = np.empty(0, dtype=np.intp), np.empty(0, dtype=bool)
        return detect(fused, bodies, Known(*nothing, known), None, expected, cfg.PlannerConfig())

    return run


def test_score_of_a_person_is_that_of_its_bodies_without_the_prior(detected):
    """Where a person is expected, less evidence is enough, but it is no evidence."""
    expected = Expected(
        np.array([(3.0, 0.0)]), 0.01 * np.eye(2)[np.newaxis], np.array([1]), np.array([False])
    )
    for where in (NOBODY, expected):
        (person,) = detected([(3.0, 0.0, 1.5)], [(3.0, 0.0, 0.75)], expected=where).persons
        assert person.score == 2.25
    assert detected([(3.0, 0.0, -0.25)]).persons == ()
    (person,) = detected([(3.0, 0.0, -0.25)], expected=expected).persons
    assert person.score == -0.25


def test_bodies_that_are_robots_are_clusters_of_their_own_after_the_others(detected):
    bodies = [(1.0, 0.0, 2.0), (3.0, 0.0, 2.0), (5.0, 0.0, 2.0)]
    found = detected(bodies, robots=(0, 2))
    assert found.cells.tolist() == [0, 1, 2]
    assert found.clusters.label.tolist() == [1, 0, 2]
    assert found.clusters.centroid[:, 0].tolist() == [3.0, 1.0, 5.0]
    (person,) = found.persons
    assert person.position.tolist() == pytest.approx([3.0, 0.0])

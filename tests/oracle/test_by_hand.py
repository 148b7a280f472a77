"""The oracle against numbers worked out by hand."""

import math

import numpy as np
import pytest

from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.scan import Cells, Scan
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.team.fusion import fuse
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_loc.team.poses import Pose
from oracle.bodies import top_of
from oracle.clusters import clusters_of
from oracle.fusion import bodies_seen
from oracle.joining import are_people, joined_of
from oracle.masking import Walls
from oracle.people import people_on
from oracle.search import cross_out, extents_of, histogram_of
from oracle.splitting import split_of
from oracle.votes import value_at, vote_of


def test_clusters_match_hand_computed_values():
    places = [(1.0, 0.0), (0.0, 0.0), (0.15, 0.0), (0.30, 0.0), (1.0, 0.16)]
    assert clusters_of(places, 0.15) == [1, 0, 0, 0, 2]


def scan_of(robot, cells):
    """A scan of (x, y, body, score) in base_link."""
    x, y, body, score = np.array(cells, dtype=np.float32).T.copy()
    one = np.ones(len(cells), dtype=np.float32)
    made = Cells(
        x=x, y=y, z=one, z_min=one, top=one, count=one.astype(np.uint32),
        body=body.astype(np.uint32), score=score, sigma_range=0.1 * one, sigma_across=0.01 * one,
    )  # fmt: skip
    return Scan(robot, 0, made)


def test_joining_matches_hand_computed_values():
    # Seen by a from the left and by b from below, each sure across its line of sight (1 cm) and
    # not along it (10 cm): the place is where their lines cross. Seen by a alone: another one.
    poses = {"a": Pose(0, 0.0, 2.0, 0.0), "b": Pose(0, 2.0, 0.0, math.pi / 2)}
    scans = [
        scan_of("a", [(2.05, 0.0, 1, 1.0), (2.15, 0.0, 1, 1.0), (4.0, 1.0, 2, -1.0)]),
        scan_of("b", [(1.9, 0.0, 5, 2.0)]),
    ]
    config = PlannerConfig()
    joined = joined_of(bodies_seen(fuse(scans, poses), poses, config.joining), config.joining)
    assert [one.cells for one in joined] == [[0, 1, 3], [2]]
    assert are_people(joined, config.joining) == [True, False]
    # The first is 10 cm off along x for a and 10 cm along y for b.
    np.testing.assert_allclose(joined[0].xy, (2.0 + 0.1 / 101, 2.0 - 0.1 / 101), atol=1e-6)
    assert joined[0].score == pytest.approx(3.0)
    # Where one robot stands, another sees that robot.
    poses["b"] = Pose(0, 4.0, 3.1, 0.0)
    found = people_on(fuse(scans[:1], poses), poses, poses, config)
    assert found.label == [0, 0, 1]
    assert len(found.clusters) == 2
    assert len(found.persons) == 1


def test_splitting_matches_hand_computed_values():
    # Two of 0.45 m side by side, 2 m ahead: 0.9 m, more than 0.75; the halves are not.
    cells = [(2.0, 0.025 + 0.05 * k, 0, 0.0) for k in range(-9, 9)]
    poses = {"a": Pose(0, 0.0, 0.0, 0.0)}
    config = PlannerConfig.from_mapping({"human.min_points": 9, "human.min_height": 0.5})
    fused = fuse([scan_of("a", cells)], poses)
    arguments = fused, range(18), [0] * 18, poses, config.splitting
    label, whole = split_of(*arguments, config.human, 0.02)
    assert whole == 0
    assert {len(set(label[:9])), len(set(label[9:])), label[0] + label[9]} == {1}
    many = PlannerConfig.from_mapping({"human.min_points": 10, "human.min_height": 0.5})
    assert split_of(*arguments, many.human, 0.02) == ([0] * 18, 0)  # not the points of two
    tall = PlannerConfig.from_mapping({"human.min_points": 9, "human.min_height": 1.1})
    assert split_of(*arguments, tall.human, 0.02) == ([0] * 18, 0)


#: 10 px of focal length and 0.1 m: 1 px of disparity is 1 m. Level, 1 m up.
CAMERA = StereoCamera(width=21, height=21, fx=10, fy=10, cx=10, cy=10, baseline=0.1)


def test_extents_match_hand_computed_values():
    disparity = np.full((21, 21), np.nan, dtype=np.float32)
    disparity[8:13, 10] = 0.5  # 2 m ahead: each pixel is 0.2 m high
    disparity[0, 10] = 0.5  # 3 m up: too high
    bins, histogram = histogram_of(disparity, CAMERA, min_range=0.5, max_range=4.0)
    assert histogram.sum() == pytest.approx(5 * 0.2, rel=0.02)
    (row,), (column,) = (np.unique(index) for index in np.nonzero(histogram))
    assert row == 1  # from 0.25 px in steps of 0.25
    assert column == int(math.atan(1.0) / 0.1)  # 45 degrees from the left border
    # A body is three columns wide there: 0.18 m to each side are one column of 0.1 rad.
    extents = extents_of(histogram, bins)
    assert extents[row, column] == pytest.approx(histogram.sum() / 3)
    cross_out(extents, bins, int(row), int(column))
    assert extents[row, column] == 0.0


def test_values_between_pixels_are_interpolated():
    image = np.array([[0.0, 10.0], [20.0, 30.0]])
    assert value_at(image, 0.5, 0.5) == pytest.approx(15.0)
    assert value_at(image, 0.25, 0.0) == pytest.approx(2.5)
    assert value_at(image, -3.0, 1.0) == pytest.approx(20.0)
    assert value_at(image, 9.0, 9.0) == pytest.approx(30.0)


def test_vote_matches_hand_computed_values():
    # A slope of grey levels: right shows what left shows, 0.4 px more to the left than expected.
    rows, columns = 30, 29
    grey = np.tile(20.0 + 60.0 * np.sin(np.arange(100) / 4.0), (60, 1))
    u = np.tile(np.linspace(30.0, 60.0, columns), (rows, 1))
    v = np.tile(np.arange(float(rows))[:, np.newaxis], columns)
    right = np.tile(20.0 + 60.0 * np.sin((np.arange(100) + 5.4) / 4.0), (60, 1))
    flat = np.zeros((rows, columns))
    ballot = vote_of(grey, right, u, v, flat + 5.0, flat, flat == 0.0, 0.5, 0.0)
    assert ballot.shift == pytest.approx(0.4, abs=0.02)
    assert ballot.gain == pytest.approx(1.0, abs=0.02)


@pytest.mark.parametrize("top", [1.0, 1.3, 1.75])
def test_tops_match_hand_computed_values(top):
    difference = np.full((30, 29), -5.0)
    heights = 0.1 + 0.075 * np.arange(30)
    difference[heights < top] = 0.0
    got = top_of(difference, 0.5, np.ones((30, 29)))
    assert abs(got - top) < 0.0376
    difference[11] = -5.0  # a gap of one row is none
    assert top_of(difference, 0.5, np.ones((30, 29))) == got
    assert top_of(difference, 0.5, -np.ones((30, 29))) == pytest.approx(0.8125)


def test_walls_match_hand_computed_values():
    data = np.zeros((10, 10), dtype=np.int8)
    data[:, 5] = 100
    walls = Walls(OccupancyGrid(0.1, 0.0, 0.0, 0.0, data), occupied_from=65)
    assert walls.distance(0.25, 0.5) == pytest.approx(0.25)  # from 0.25 m to 0.5 m
    assert walls.distance(0.55, 0.5) == 0.0
    assert walls.distance(9.0, 0.5) == math.inf
    # Unknown behind it is its inside.
    data[:, 6:] = -1
    walls = Walls(OccupancyGrid(0.1, 0.0, 0.0, 0.0, data), occupied_from=65)
    assert walls.distance(0.85, 0.5) == 0.0

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc.scan import Cells, Scan
from mrs_people_loc.team.fusion import fuse, map_from_robot
from mrs_people_loc.team.poses import Pose

PI = math.pi
coordinate = st.floats(-20, 20, width=32)


def test_eq_6_matches_hand_computed_values():
    # At (1, 2), turned to the left: ahead is +y, left is -x.
    points = np.array([(0.0, 0.0), (3.0, 0.0), (0.0, 0.5), (3.0, 0.5)])
    placed = map_from_robot(points, Pose(0, 1.0, 2.0, PI / 2))
    np.testing.assert_allclose(placed, [(1, 2), (1, 5), (0.5, 2), (0.5, 5)], atol=1e-15)
    # Turned by 30 degrees: cos = 0.866, sin = 0.5.
    placed = map_from_robot(np.array([(2.0, 1.0)]), Pose(0, -1.0, 0.0, PI / 6))
    np.testing.assert_allclose(placed, [(math.sqrt(3) - 0.5 - 1, 1 + math.sqrt(3) / 2)])


@given(
    st.lists(st.tuples(coordinate, coordinate), max_size=10), coordinate, coordinate,
    st.floats(-7, 7),
)  # fmt: skip
def test_eq_6_equals_a_plain_loop(points, x, y, yaw):
    c, s = math.cos(yaw), math.sin(yaw)
    placed = map_from_robot(np.array(points).reshape(-1, 2), Pose(0, x, y, yaw))
    assert placed.shape == (len(points), 2)
    for (px, py), (mx, my) in zip(points, placed, strict=True):
        assert math.isclose(mx, x + c * px - s * py, abs_tol=1e-12)
        assert math.isclose(my, y + s * px + c * py, abs_tol=1e-12)


def test_the_map_is_the_union_of_all_robots(make_cells):
    scans = [
        Scan("robot_b", 5, make_cells([(1, 0), (2, 0)], top=[1.5, 1.6])),
        Scan("robot_c", 6, Cells.empty()),
        Scan("robot_a", 7, make_cells([(1, 0)], count=9)),
    ]
    poses = {
        "robot_a": Pose(0, 0.0, 10.0, PI),
        "robot_b": Pose(0, 5.0, 5.0, 0.0),
        "robot_c": Pose(0, 0.0, 0.0, 0.0),
        "robot_d": Pose(0, 0.0, 0.0, 0.0),
    }
    fused = fuse(scans, poses)
    assert fused.robots == ("robot_b", "robot_c", "robot_a")
    np.testing.assert_array_equal(fused.robot, [0, 0, 2])
    np.testing.assert_allclose(fused.xy, [(6, 5), (7, 5), (-1, 10)])
    assert fused.xy.dtype == np.float64
    assert len(fused) == 3
    # The cells are as they were sent.
    np.testing.assert_array_equal(fused.cells.x, [1, 2, 1])
    np.testing.assert_allclose(fused.cells.top, [1.5, 1.6, 1.7])
    np.testing.assert_array_equal(fused.cells.count, [100, 100, 9])


def test_map_without_cells_is_empty():
    pose = Pose(0, 1.0, 2.0, 3.0)
    for scans in ([], [Scan("robot_a", 0, Cells.empty())]):
        fused = fuse(scans, {"robot_a": pose})
        assert len(fused) == len(fused.robot) == len(fused.cells) == 0
        assert fused.xy.shape == (0, 2)
        assert fused.robot.dtype == np.intp


def test_positions_are_exact_far_from_the_origin(make_cells):
    # In float32 a map coordinate of 10 km would jump by a millimetre.
    fused = fuse([Scan("r", 0, make_cells([(0.125, 0)]))], {"r": Pose(0, 1e4, -1e4, 0.0)})
    np.testing.assert_array_equal(fused.xy, [(10000.125, -10000)])

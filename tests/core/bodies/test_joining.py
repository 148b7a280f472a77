import dataclasses
import math
import tracemalloc

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from mrs_people_loc import config as cfg
from mrs_people_loc.bodies import joining
from mrs_people_loc.bodies.joining import Joined, are_people, join
from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.planner import Planner
from mrs_people_loc.scan import Cells, Scan
from mrs_people_loc.team.fusion import BodiesOnMap, fuse, place_bodies
from mrs_people_loc.team.poses import Pose
from oracle import joining as plain
from oracle.fusion import Seen

ROUND = 0.05**2 * np.eye(2)


def bodies_of(*bodies) -> BodiesOnMap:
    """Bodies as (robot, (x, y), covariance, score); no cells."""
    robots, xy, covariance, score = zip(*bodies, strict=True) if bodies else ([], [], [], [])
    return BodiesOnMap(
        of_cell=np.empty(0, dtype=np.intp),
        robot=np.array(robots, dtype=np.intp),
        xy=np.array(xy, dtype=float).reshape(-1, 2),
        covariance=np.array(covariance, dtype=float).reshape(-1, 2, 2),
        score=np.array(score, dtype=float),
    )


def seen_of(bodies: BodiesOnMap) -> list[Seen]:
    """The same for the oracle, numbered by their cells."""
    fields = zip(bodies.robot, bodies.xy, bodies.covariance, bodies.score, strict=True)
    return [
        Seen(str(robot), (k,), xy, covariance, float(score))
        for k, (robot, xy, covariance, score) in enumerate(fields)
    ]


def joined_of(bodies: BodiesOnMap, **config) -> Joined:
    return join(bodies, np.ones(len(bodies), dtype=bool), cfg.Joining(**config))


def scan_of(make_cells, robot: str, *bodies, sigma_range=0.2, sigma_across=0.05) -> Scan:
    """A scan of cells as (x, y, count, body, score) in base_link."""
    x, y, count, body, score = np.array(bodies, dtype=float).reshape(-1, 5).T
    cells = make_cells(np.stack([x, y], axis=1), count=count)
    one = np.ones(len(x), dtype=np.float32)
    return Scan(
        robot,
        0,
        dataclasses.replace(
            cells,
            body=body.astype(np.uint32),
            score=score.astype(np.float32),
            sigma_range=sigma_range * one,
            sigma_across=sigma_across * one,
        ),
    )


# ----------------------------------------------------------------------- bodies on maps ----


def test_bodies_of_a_map_match_hand_computed_values(make_cells):
    # a looks along +x from the origin, b along +y from (2, -2); body numbers are their own.
    of_a = [(2, 0.1, 3, 2, 1.5), (2, -0.3, 1, 2, 1.5), (4, 0, 9, 1, -1), (9, 9, 5, 0, 0)]
    scans = [
        scan_of(make_cells, "a", *of_a),
        scan_of(make_cells, "b", (2, 0, 7, 2, 0.5)),
    ]  # fmt: skip
    poses = {"a": Pose(0, 0.0, 0.0, 0.0), "b": Pose(0, 2.0, -2.0, math.pi / 2)}
    fused = fuse(scans, poses)
    bodies = place_bodies(fused, poses, line_of_sight=True)
    np.testing.assert_array_equal(bodies.of_cell, [1, 1, 0, -1, 2])
    np.testing.assert_array_equal(bodies.robot, [0, 0, 1])
    np.testing.assert_allclose(bodies.xy, [(4, 0), (2, 0), (2, 0)], atol=1e-7)
    np.testing.assert_allclose(bodies.score, [-1, 1.5, 0.5])
    along_x, along_y = np.diag([0.04, 0.0025]), np.diag([0.0025, 0.04])
    np.testing.assert_allclose(bodies.covariance, [along_x, along_x, along_y], atol=1e-8)

    level = place_bodies(fused, poses, line_of_sight=False)
    # Of the same area: 0.2 * 0.05 = 0.1^2.
    np.testing.assert_allclose(level.covariance, [0.01 * np.eye(2)] * 3, atol=1e-8)
    np.testing.assert_array_equal(level.xy, bodies.xy)


def test_pose_covariance_adds_to_position_covariance(make_cells):
    # 3 m ahead along +y: a heading that is off by 0.1 rad moves it by 0.3 m along x.
    covariance = np.diag([0.01, 0.02, 0.1**2])
    poses = {"a": Pose(0, 1.0, 1.0, math.pi / 2, covariance)}
    fused = fuse([scan_of(make_cells, "a", (3, 0, 1, 1, 0))], poses)
    bodies = place_bodies(fused, poses, line_of_sight=True)
    expected = np.diag([0.0025 + 0.01 + 0.09, 0.04 + 0.02])
    np.testing.assert_allclose(bodies.covariance, [expected], atol=1e-7)


def test_sigma_has_a_lower_bound(make_cells):
    scan = scan_of(make_cells, "a", (0, 0, 0, 1, 0), sigma_range=0.0, sigma_across=0.0)
    poses = {"a": Pose(0, 0.0, 0.0, 0.0)}  # it stands on the robot: no line of sight either
    bodies = place_bodies(fuse([scan], poses), poses, line_of_sight=True)
    np.testing.assert_allclose(bodies.covariance, [0.01**2 * np.eye(2)])
    np.testing.assert_allclose(bodies.xy, [(0, 0)])


def test_map_without_bodies_gives_no_people(make_cells):
    poses = {"a": Pose(0, 0.0, 0.0, 0.0)}
    for scans in ([], [Scan("a", 0, Cells.empty())], [Scan("a", 0, make_cells([(1, 0), (2, 0)]))]):
        fused = fuse(scans, poses)
        bodies = place_bodies(fused, poses, line_of_sight=True)
        assert len(bodies) == 0
        np.testing.assert_array_equal(bodies.of_cell, np.full(len(fused), -1))
        joined = joined_of(bodies)
        assert len(joined) == 0
        assert joined.xy.shape == (0, 2)
        assert joined.covariance.shape == (0, 2, 2)
        assert are_people(joined, bodies, cfg.Joining()).shape == (0,)


# -------------------------------------------------------------------------------- joining ----


def test_robots_at_right_angles_correct_each_others_range():
    # a is sure of y and b of x; each is 0.3 m off along its own line of sight.
    a, b = np.diag([0.09, 0.0025]), np.diag([0.0025, 0.09])
    joined = joined_of(bodies_of((0, (2.3, 0.0), a, 1.0), (1, (2.0, 0.3), b, 2.5)))
    # Weights 1 / 0.09 = 11.11 and 1 / 0.0025 = 400: 11.11 / 411.11 = 1 / 37.
    np.testing.assert_allclose(joined.xy, [(2.0 + 0.3 / 37, 0.3 / 37)])
    np.testing.assert_allclose(joined.covariance, [np.eye(2) / (400 + 1 / 0.09)])
    np.testing.assert_allclose(joined.score, [3.5])
    np.testing.assert_array_equal(joined.of_body, [0, 0])


@given(
    st.lists(
        st.tuples(
            st.floats(-0.05, 0.05), st.floats(-0.05, 0.05), st.floats(0.1, 0.4),
            st.floats(0.05, 0.1), st.floats(-math.pi, math.pi), st.floats(-1.9, 3.0),
        ),
        min_size=1, max_size=5,
    ),
    st.randoms(),
)  # fmt: skip
def test_agreeing_robots_are_fused_as_by_an_information_filter(drawn, random):
    """Compared with the textbook's information filter, in any order of the robots."""
    bodies = []
    for robot, (x, y, along, across, angle, score) in enumerate(drawn):
        c, s = math.cos(angle), math.sin(angle)
        turn = np.array([[c, -s], [s, c]])
        bodies.append((robot, (x, y), turn @ np.diag([along**2, across**2]) @ turn.T, score))
    wanted = plain.one_of(seen_of(bodies_of(*bodies)))
    random.shuffle(bodies)
    joined = joined_of(bodies_of(*bodies), gate=10.0)
    np.testing.assert_array_equal(joined.of_body, 0)
    np.testing.assert_allclose(joined.xy, [wanted.xy], atol=1e-9)
    np.testing.assert_allclose(joined.covariance, [wanted.covariance], atol=1e-12)
    np.testing.assert_allclose(joined.score, [sum(b[3] for b in bodies)])


def random_bodies(seed: int) -> list[tuple]:
    rng = np.random.default_rng(seed)
    result = []
    for _ in range(rng.integers(0, 14)):
        root = rng.normal(0.0, 0.2, (2, 2))
        covariance = root @ root.T + ROUND
        result.append(
            (int(rng.integers(0, 4)), tuple(rng.uniform(0, 1.5, 2)), covariance, rng.normal(0, 3))
        )
    return result


@given(st.integers(0, 10**6), st.randoms())
def test_joining_random_bodies_respects_all_rules(seed, random):
    bodies = random_bodies(seed)
    on_map = bodies_of(*bodies)
    joined = joined_of(on_map)
    # Everybody is of one, bodies of one robot are never one, and nobody is made up.
    assert sorted(set(joined.of_body)) == list(range(len(joined)))
    for number in range(len(joined)):
        members = np.flatnonzero(joined.of_body == number)
        robots = on_map.robot[members]
        assert len(set(robots)) == len(robots)
        if len(members) == 1:
            np.testing.assert_allclose(joined.xy[number], on_map.xy[members[0]])
            np.testing.assert_allclose(joined.covariance[number], on_map.covariance[members[0]])
    # In another order, and with other numbers for the robots, it is the same.
    order = list(range(len(bodies)))
    random.shuffle(order)
    renamed = [bodies[k] for k in order]
    renamed = [(3 - robot, *rest) for robot, *rest in renamed]
    other = joined_of(bodies_of(*renamed))
    partners = {frozenset(np.flatnonzero(joined.of_body == n)) for n in range(len(joined))}
    again = {
        frozenset(order[k] for k in np.flatnonzero(other.of_body == n)) for n in range(len(other))
    }
    assert partners == again
    one, two = (np.array(sorted(map(tuple, j.xy))).reshape(-1, 2) for j in (joined, other))
    np.testing.assert_allclose(one, two, atol=1e-9)
    people = are_people(joined, on_map, cfg.Joining())
    people_again = are_people(other, bodies_of(*renamed), cfg.Joining())
    np.testing.assert_allclose(
        np.array(sorted(map(tuple, joined.xy[people]))).reshape(-1, 2),
        np.array(sorted(map(tuple, other.xy[people_again]))).reshape(-1, 2),
        atol=1e-9,
    )


@pytest.mark.parametrize(
    ("away", "sigma", "config", "joins"),
    [
        (0.29, 0.0707, {}, True),  # 0.1 m together: 2.9 sigma
        (0.31, 0.0707, {}, False),
        (0.31, 0.0707, {"gate": 3.2}, True),
        (0.69, 0.5, {}, True),
        (0.71, 0.5, {}, False),
        (0.71, 0.5, {"max_distance": 0.72}, True),
    ],
)
def test_bodies_are_joined_within_gate_and_distance(away, sigma, config, joins):
    covariance = sigma**2 * np.eye(2)
    bodies = bodies_of((0, (0, 0), covariance, 0.0), (1, (0, away), covariance, 0.0))
    assert len(joined_of(bodies, **config)) == 2 - joins


def test_nearest_bodies_in_sigmas_are_joined_first():
    # Nearest in metres is (0.2, 0), but it is sure of its place; (0, 0.3) is not.
    sure, unsure = 0.04**2 * np.eye(2), 0.3**2 * np.eye(2)
    bodies = bodies_of(
        (0, (0.0, 0.0), 0.06**2 * np.eye(2), 0.0), (1, (0.2, 0.0), sure, 0.0),
        (1, (0.0, 0.3), unsure, 0.0),
    )  # fmt: skip
    np.testing.assert_array_equal(joined_of(bodies).of_body, [0, 1, 0])


def test_joined_bodies_are_compared_at_their_updated_position():
    # Three in a row, 0.28 m apart, each pair within 3 sigma (0.1 m together, as above): once two
    # are one, in their middle, the third is 0.42 m away.
    one = 0.0707**2 * np.eye(2)
    row = [(k, (0.28 * k, 0.0), one, 0.0) for k in range(3)]
    joined = joined_of(bodies_of(*row))
    assert len(joined) == 2
    wide = joined_of(bodies_of(*row), gate=10.0)
    assert len(wide) == 1
    np.testing.assert_allclose(wide.xy, [(0.28, 0.0)], atol=1e-12)


def test_excluded_bodies_are_not_joined():
    bodies = bodies_of(*((k, (0.0, 0.01 * k), ROUND, 1.0) for k in range(3)))
    joined = join(bodies, np.array([True, False, True]), cfg.Joining())
    np.testing.assert_array_equal(joined.of_body, [0, -1, 0])
    np.testing.assert_allclose(joined.xy, [(0.0, 0.01)])
    np.testing.assert_allclose(joined.score, [2.0])
    assert len(join(bodies, np.zeros(3, dtype=bool), cfg.Joining())) == 0


def test_one_robot_cannot_outvote_the_others():
    bodies = bodies_of((0, (0, 0), ROUND, 2.6), (1, (0, 0), ROUND, -15.0))
    assert joined_of(bodies).score == pytest.approx([0.6])
    assert joined_of(bodies_of((1, (0, 0), ROUND, -15.0))).score == pytest.approx([-2.0])


# --------------------------------------------------------------------------------- people ----


def people_of(*bodies, **config) -> list[bool]:
    """Which of some bodies are people; none of them joins."""
    on_map = bodies_of(*bodies)
    joined = Joined(np.arange(len(on_map)), on_map.xy, on_map.covariance, on_map.score)
    return are_people(joined, on_map, cfg.Joining(**config)).tolist()


@pytest.mark.parametrize(
    ("score", "config", "is_person"),
    [(0.6, {}, True), (0.4, {}, False), (0.4, {"min_score": 0.3}, True), (-9.0, {}, False)],
)
def test_bodies_from_min_score_on_are_people(score, config, is_person):
    assert people_of((0, (0, 0), ROUND, score), **config) == [is_person]


def test_of_two_people_closer_than_apart_the_likelier_is_kept():
    def beside(away: float, **config) -> list[bool]:
        return people_of((0, (0, 0), ROUND, 2.0), (0, (0, away), ROUND, 3.0), **config)

    assert beside(0.35) == [False, True]  # the likelier one stays
    assert beside(0.37) == [True, True]
    assert beside(0.35, apart=0.34) == [True, True]


def test_only_people_suppress_nearby_bodies():
    # A row, 0.3 m apart: the middle one yields to the first, so the last one stays.
    row = [(0, (0.3 * k, 0), ROUND, 3.0 - k) for k in range(3)]
    assert people_of(*row) == [True, False, True]
    # What is no person itself takes nobody's place.
    assert people_of((0, (0, 0), ROUND, 0.4), (0, (0.1, 0), ROUND, 0.6)) == [False, True]


@pytest.mark.parametrize(
    ("robots", "away", "config", "kept"),
    [
        ((0, 1), 0.9, {}, False),  # 0.2 m together: 4.5 sigma
        ((0, 0), 0.9, {}, True),  # one robot saw both
        ((0, 1), 0.9, {"fragment_gate": 4.4}, True),
        ((0, 1), 0.9, {"fragment_gate": 0.0}, True),
        ((0, 1), 0.9, {"fragment_distance": 0.8}, True),
        ((0, 1), 1.05, {}, True),
    ],
)
def test_fragments_belong_to_the_likelier_person(robots, away, config, kept):
    covariance = 0.1414**2 * np.eye(2)
    one, other = robots
    got = people_of((one, (0, 0), covariance, 5.0), (other, (away, 0), covariance, 1.0), **config)
    assert got == [True, kept]


def test_fragment_stays_if_its_robot_saw_both():
    covariance = 0.1414**2 * np.eye(2)
    bodies = bodies_of(
        (0, (0, 0), covariance, 3.0), (1, (0, 0), covariance, 3.0), (1, (0.9, 0), covariance, 1.0)
    )
    joined = joined_of(bodies)
    np.testing.assert_array_equal(joined.of_body, [0, 0, 1])
    np.testing.assert_array_equal(are_people(joined, bodies, cfg.Joining()), [True, True])


# ----------------------------------------------------------------- whatever messages say ----


@pytest.mark.parametrize("sigma", [3e38, 1e7, 1e-30])
@pytest.mark.parametrize("variance", [0.0, 1e15, 1.7e308])
def test_any_uncertainty_gives_finite_results(make_cells, sigma, variance):
    """Two robots see one body; their uncertainties are arbitrary."""
    covariance = np.diag([variance, variance, variance])
    poses = {
        "a": Pose(0, 0.0, 0.0, 0.0, covariance),
        "b": Pose(0, 2.0, -2.0, math.pi / 2, covariance),
    }
    scans = [
        scan_of(make_cells, "a", (2, 0, 9, 1, 3.0), sigma_range=sigma),
        scan_of(make_cells, "b", (2, 0, 9, 1, 3.0), sigma_range=sigma),
    ]
    people = Planner(cfg.PlannerConfig()).step(scans, poses, 0).persons
    assert len(people) >= 1
    for person in people:
        np.testing.assert_allclose(person.position, (2.0, 0.0), atol=1e-3)
        assert np.isfinite(person.covariance).all()
        assert (np.linalg.eigvalsh(person.covariance) > 0).all()


def test_invalid_covariance_is_repaired(make_cells):
    none = np.zeros((3, 3))
    none[0, 1] = none[1, 0] = 0.5  # variances of 0, and yet they vary together
    poses = {"a": Pose(0, 0.0, 0.0, 0.0, none)}
    fused = fuse([scan_of(make_cells, "a", (2, 0, 9, 1, 3.0))], poses)
    bodies = place_bodies(fused, poses, line_of_sight=True)
    assert (np.linalg.eigvalsh(bodies.covariance) > 0).all()


def test_robots_without_a_scan_are_masked_too(make_cells):
    scan = scan_of(make_cells, "a", (2, 0, 9, 1, 3.0))
    poses = {"a": Pose(0, 0.0, 0.0, 0.0)}
    planner = Planner(cfg.PlannerConfig.from_mapping({"tracking.enabled": False}))
    assert len(planner.step([scan], poses, 0).persons) == 1
    result = planner.step([scan], {**poses, "b": Pose(0, 2.0, 0.0, 0.0)}, 0)
    assert result.persons == ()
    assert list(result.poses) == ["a"]  # what it was made from


def test_mixed_team_of_both_methods_finds_each_person_once(make_cells):
    """The cells of b, which has no body detector, are a cluster with the size of a person."""
    grid = [(x, y) for x in np.arange(-0.15, 0.2, 0.05) for y in np.arange(-0.15, 0.2, 0.05)]
    plain = [(2.0 + x, y, 20, 0, 0.0) for x, y in grid]
    beside = [(2.0 + x, 2.0 + y, 20, 0, 0.0) for x, y in grid]
    scans = [
        scan_of(make_cells, "a", (2, 0, 9, 1, 3.0)),
        scan_of(make_cells, "b", *plain, *beside),
    ]
    poses = {name: Pose(0, 0.0, 0.0, 0.0) for name in ("a", "b")}
    people = Planner(cfg.PlannerConfig()).step(scans, poses, 0).persons
    places = sorted(tuple(person.position.round(2)) for person in people)
    assert places == [(2.0, 0.0), (2.0, 2.0)]


# ------------------------------------------------------------------------------ all pairs ----


def crowd(seed: int) -> BodiesOnMap:
    """Some people seen by most of many robots, fragments beside them, and things around."""
    rng = np.random.default_rng(seed)
    robots, people = int(rng.integers(1, 12)), rng.uniform(0.0, 6.0, (int(rng.integers(1, 15)), 2))
    bodies = []
    for robot in range(robots):
        seen = people[rng.random(len(people)) < 0.8] + rng.normal(0.0, 0.15, 2)
        beside = people[rng.random(len(people)) < 0.2] + rng.normal(0.0, 0.5, 2)
        for xy in np.concatenate([seen, beside, rng.uniform(0.0, 6.0, (2, 2))]):
            sigma, angle = rng.uniform(0.03, 0.5, 2), rng.uniform(0.0, math.pi)
            cos, sin = math.cos(angle), math.sin(angle)
            turn = np.array([(cos, -sin), (sin, cos)])
            xy = xy + turn @ (sigma * rng.normal(0.0, 1.0, 2))
            if seed % 3 == 0:  # many are at one place, and equally likely
                sigma, xy = np.array([0.2, 0.2]), np.round(xy, 1)
            score = float(np.round(rng.normal(1.0, 2.0)))
            bodies.append((robot, xy, turn @ np.diag(sigma**2) @ turn.T, score))
    return bodies_of(*bodies)


@pytest.mark.parametrize("seed", range(24))
def test_crowd_is_joined_as_by_comparing_all_pairs(seed):
    bodies, rng = crowd(seed), np.random.default_rng(seed)
    used = rng.random(len(bodies)) < 0.9
    config = cfg.Joining(
        gate=rng.choice([2.0, 3.0, 8.0]),
        max_distance=rng.choice([0.3, 0.7, 3.0]),
        apart=rng.choice([0.0, 0.42, 2.0]),
        fragment_gate=rng.choice([0.0, 5.0]),
        fragment_distance=rng.choice([0.3, 1.0]),
    )
    joined = join(bodies, used, config)
    seen = seen_of(bodies)
    wanted = plain.joined_of([seen[k] for k in np.flatnonzero(used)], config)
    groups = [np.flatnonzero(joined.of_body == k).tolist() for k in range(len(joined))]
    assert groups == [one.cells for one in wanted]
    assert (joined.of_body[~used] == -1).all()
    for k, one in enumerate(wanted):
        np.testing.assert_allclose(joined.xy[k], one.xy, atol=1e-9)
        np.testing.assert_allclose(joined.covariance[k], one.covariance, atol=1e-9)
        assert joined.score[k] == pytest.approx(one.score, abs=1e-12)
    assert are_people(joined, bodies, config).tolist() == plain.are_people(wanted, config)


@pytest.mark.parametrize("block", [1, 7, 100])
def test_joining_in_blocks_equals_joining_at_once(block, monkeypatch):
    for seed in range(5):
        bodies = crowd(seed)
        at_once = joined_of(bodies)
        with monkeypatch.context() as patch:
            patch.setattr(joining, "_BLOCK", block)
            made = joined_of(bodies)
        np.testing.assert_array_equal(made.of_body, at_once.of_body)
        np.testing.assert_array_equal(made.xy, at_once.xy)
        assert are_people(made, bodies, cfg.Joining()).any()


def test_in_a_crowded_place_only_the_likeliest_are_joined():
    rng = np.random.default_rng(1)
    places = rng.uniform(0.05, 0.45, (150, 2))
    scores = rng.permutation(150) / 10.0
    heap = [(k, xy, ROUND, score) for k, (xy, score) in enumerate(zip(places, scores, strict=True))]
    bodies = bodies_of(*heap, (0, (5.0, 5.0), ROUND, -1.0))
    joined = joined_of(bodies)
    np.testing.assert_array_equal(joined.of_body[:150] >= 0, scores >= 5.0)
    assert joined.of_body[150] >= 0  # elsewhere nothing is changed
    assert joined_of(bodies_of(*heap[:100])).of_body.min() == 0


@pytest.mark.slow
@pytest.mark.parametrize("size", [0.6, 3.5])
def test_fifty_robots_with_a_hundred_bodies_each_stay_in_bounds(size):
    """Comparing all pairs would take gigabytes and ten seconds."""
    rng = np.random.default_rng(2)
    places = rng.uniform(0, size, (5000, 2))
    bodies = bodies_of(*[(k % 50, xy, 0.3**2 * np.eye(2), 3.0) for k, xy in enumerate(places)])
    joined_of(bodies_of((0, (0, 0), ROUND, 1.0), (1, (0, 0), ROUND, 1.0)))  # loads SciPy
    tracemalloc.start()
    try:
        joined = joined_of(bodies)
        people = are_people(joined, bodies, cfg.Joining())
        _, most = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert people.any()
    assert most < 100e6


def test_excluded_bodies_stay_on_the_map(make_cells):
    heap = [(2 + 0.001 * k, 0.1, 3, k, 5.0 + k) for k in range(1, 101)]
    scans = [scan_of(make_cells, robot, *heap) for robot in ("a", "b")]
    poses = {robot: Pose(0, 0.0, 0.0, 0.0) for robot in ("a", "b")}
    people = Planner(PlannerConfig()).step(scans, poses, 0)
    assert len(people.fused) == 200
    assert people.clusters.label.min() == 0
    assert people.clusters.cells.sum() == 200
    assert len(people.persons) == 1

"""What following people gives back to segmentation: who is expected is found sooner, and apart."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from mrs_people_loc import config as cfg
from mrs_people_loc.cells.splitting import split_at
from mrs_people_loc.planner import Planner
from mrs_people_loc.scan import Scan
from mrs_people_loc.team.fusion import fuse
from mrs_people_loc.team.poses import Pose

POSES = {"a": Pose(0, 0.0, 0.0, 0.0)}
#: Cells of a body about its axis.
BODY = [(dx, dy) for dx in (-0.1, -0.05, 0.0, 0.05, 0.1) for dy in (-0.15, -0.05, 0.05, 0.15)]
STEP_NS = 100_000_000


@pytest.fixture
def plain(make_cells):
    """Scans of people as plain cells: `plain(k, (x, y), ..., points=...)` at step k."""

    def scan(k: int, *places, points: int = 20) -> Scan:
        cells = [(x + dx, y + dy) for x, y in places for dx, dy in BODY]
        return Scan("a", k * STEP_NS, make_cells(cells, count=[points] * len(cells)))

    return scan


@pytest.fixture
def bodies(make_cells):
    """Scans of bodies: `bodies(k, (x, y, score), ...)` at step k."""

    def scan(k: int, *found) -> Scan:
        x, y, score = np.array(found, dtype=np.float32).reshape(-1, 3).T.copy()
        one = np.ones(len(x), dtype=np.float32)
        cells = dataclasses.replace(
            make_cells(np.stack([x, y], axis=1)), body=np.arange(1, len(x) + 1, dtype=np.uint32),
            score=score, sigma_range=0.06 * one, sigma_across=0.04 * one,
        )  # fmt: skip
        return Scan("a", k * STEP_NS, cells)

    return scan


def planner(**changes) -> Planner:
    """Without what else would tell people apart."""
    values = {"splitting.max_width": 0.0, **{k.replace("__", "."): v for k, v in changes.items()}}
    return Planner(cfg.PlannerConfig.from_mapping(values))


def run(made: Planner, scans):
    return [made.step([scan], POSES, scan.stamp_ns) for scan in scans]


def seen(people) -> list[tuple[float, float]]:
    """Where those are who are seen [m], sorted."""
    return sorted(tuple(p.position.round(1)) for p in people.persons if not p.coasting)


# ----------------------------------------------------------------- one cluster, two people ----


def towards(scan, steps=26):
    """Two who walk towards each other, and stand 0.4 m apart: their cells are one cluster."""
    gaps = [max(0.4, 1.6 - 0.1 * k) for k in range(steps)]
    return [scan(k, (3.0, -gap / 2), (3.0, gap / 2)) for k, gap in enumerate(gaps)]


def test_cluster_is_cut_at_expected_people(plain):
    last = run(planner(), towards(plain))[-1]
    assert seen(last) == [(3.0, -0.2), (3.0, 0.2)]
    assert {person.id for person in last.persons} == {1, 2}
    assert len(last.clusters) == 2


def test_without_tracks_the_cluster_is_one_person(plain):
    last = run(planner(tracking__enabled=False), towards(plain))[-1]
    assert seen(last) == [(3.0, 0.0)]
    assert len(last.clusters) == 1


def test_cluster_with_a_part_without_points_stays_whole(plain):
    """One of the two has left, so all cells belong to the other one."""
    followed = planner()
    run(followed, towards(plain))
    last = followed.step([plain(26, (3.0, 0.0))], POSES, 26 * STEP_NS)
    assert len(last.clusters) == 1


def test_cluster_with_a_low_part_stays_whole(make_cells):
    """A low bag, as far from the person as another person would be."""
    cells = [(3.0 + dx, y + dy) for y in (-0.2, 0.2) for dx, dy in BODY]
    top = [1.7] * len(BODY) + [0.6] * len(BODY)
    scan = Scan("a", 0, make_cells(cells, top=top))
    fused = fuse([scan], POSES)
    everything, one = np.arange(len(cells)), np.zeros(len(cells), dtype=np.intp)
    expected = np.array([(3.0, -0.2), (3.0, 0.2)])
    assert not split_at(expected, fused, everything, one, cfg.Human()).any()
    tall = fuse([Scan("a", 0, make_cells(cells, top=[1.7] * len(cells)))], POSES)
    assert split_at(expected, tall, everything, one, cfg.Human()).any()


@pytest.mark.parametrize(("y", "cut"), [(0.64, True), (0.66, False)])
def test_cluster_is_cut_only_at_people_expected_within_30_cm_of_it(make_cells, y, cut):
    """Cells of two, up to y = 0.35 m; two rows, 400 points, are nearer to the second one."""
    cells = [(3.0 + dx, side + dy) for side in (-0.2, 0.2) for dx, dy in BODY]
    fused = fuse([Scan("a", 0, make_cells(cells, count=[40] * len(cells)))], POSES)
    everything, one = np.arange(len(cells)), np.zeros(len(cells), dtype=np.intp)
    parts = split_at(np.array([(3.0, -0.2), (3.0, y)]), fused, everything, one, cfg.Human())
    assert parts.any() == cut


def test_close_bodies_stay_two_where_two_are_expected(bodies):
    followed = planner()
    gaps = [max(0.3, 1.5 - 0.1 * k) for k in range(20)]
    scans = [bodies(k, (3.0, -g / 2, 5.0), (3.0, g / 2, 4.0)) for k, g in enumerate(gaps)]
    assert len(seen(run(followed, scans)[-1])) == 2
    assert len(seen(run(planner(tracking__enabled=False), scans)[-1])) == 1
    # Out of nowhere they are one, for ever.
    close = [bodies(k, (3.0, -0.15, 5.0), (3.0, 0.15, 4.0)) for k in range(20)]
    assert {len(people.persons) for people in run(planner(), close)} == {1}


# --------------------------------------------------------------------------- weak evidence ----


def test_weak_cluster_is_a_person_where_one_is_expected(plain):
    """20 cells of 4 points; a person needs 150, and half of it where they are expected."""
    strong = [plain(k, (3.0, 0.0)) for k in range(10)]
    weak = [plain(k, (3.0, 0.0), (3.0, 1.5), points=4) for k in range(10, 20)]
    last = run(planner(tracking__expected_points=0.5), [*strong, *weak])[-1]
    assert seen(last) == [(3.0, 0.0)]
    assert last.persons[0].id == 1
    assert seen(run(planner(tracking__expected_points=1.0), [*strong, *weak])[-1]) == []
    assert seen(run(planner(tracking__enabled=False), [*strong, *weak])[-1]) == []


def test_weak_cluster_starts_no_track(plain):
    """Beside a person it is not a second one, however long it persists."""
    strong = [plain(k, (3.0, 0.0)) for k in range(10)]
    cells = [plain(k, (3.0, 0.0), (3.38, 0.0)) for k in range(10, 40)]
    for scan in cells:
        scan.cells.count[len(BODY) :] = 4
    for people in run(planner(), [*strong, *cells]):
        assert [person.id for person in people.persons] == [1]


def test_doubtful_body_is_a_person_where_one_is_expected(bodies):
    strong = [bodies(k, (3.0, 0.0, 4.0)) for k in range(10)]
    doubtful = [bodies(k, (3.0, 0.0, -0.2), (3.0, 1.5, -0.2)) for k in range(10, 13)]
    last = run(planner(tracking__expected_score=1.0), [*strong, *doubtful])[-1]
    assert seen(last) == [(3.0, 0.0)]
    assert seen(run(planner(tracking__expected_score=0.0), [*strong, *doubtful])[-1]) == []
    assert seen(run(planner(tracking__enabled=False), [*strong, *doubtful])[-1]) == []


def test_walking_person_is_expected_where_they_are_by_now(bodies):
    """At 1.5 m/s, so that a second later they are farther away than tracking.max_distance, 1 m."""
    walked = [bodies(k, (3.0, -1.5 + 0.15 * k, 4.0 if k < 10 else -0.2)) for k in range(13)]
    last = run(planner(tracking__expected_score=1.0), walked)[-1]
    assert seen(last) == [(3.0, 0.3)]


# ------------------------------------------------------------------------------ memoryless ----


def test_papers_planner_is_stateless(plain):
    """With tracking off, every interval is independent."""
    config = cfg.PlannerConfig.from_mapping({"tracking.enabled": False})
    scans = [*towards(plain), plain(26), plain(27, (1.0, 1.0))]
    together = Planner(config)
    for scan in scans:
        one = together.step([scan], POSES, scan.stamp_ns)
        alone = Planner(config).step([scan], POSES, scan.stamp_ns)
        assert [p.id for p in one.persons] == [0] * len(alone.persons)
        assert all(p.velocity is None for p in one.persons)
        np.testing.assert_array_equal(
            [p.position for p in one.persons], [p.position for p in alone.persons]
        )
        assert [group.id for group in one.groups] == [0] * bool(one.persons)
        assert one.events == ()


def test_configuration_change_loses_no_track(plain):
    followed = planner()
    run(followed, [plain(k, (3.0, 0.0)) for k in range(5)])
    followed.config = planner(clustering__distance=0.2).config
    (person,) = followed.step([plain(5, (3.0, 0.0))], POSES, 5 * STEP_NS).persons
    assert person.id == 1
    assert person.age_s == pytest.approx(0.5)


def test_configuration_change_reaches_tracks_and_groups(plain):
    followed = planner()
    two = [plain(k, (3.0, -1.0), (3.0, 1.0)) for k in range(6)]
    assert [group.size for group in run(followed, two[:5])[-1].groups] == [2]
    changes = {"tracking__coast_time": 0.0, "groups__distance": 1.0, "groups__leave_time": 0.0}
    followed.config = planner(**changes).config
    (people,) = run(followed, two[5:])
    assert [group.size for group in people.groups] == [1, 1]
    (people,) = run(followed, [plain(6)])
    assert people.persons == ()


def test_planner_that_begins_anew_knows_no_person_and_no_group(plain):
    followed = planner()
    two = [plain(k, (3.0, 0.0), (3.0, 1.0)) for k in range(110)]
    before = run(followed, two[:30])[-1]
    assert [(group.id, group.members) for group in before.groups] == [(1, (1, 2))]
    followed.reset()
    after = run(followed, two[30::4])
    assert {(group.id, group.members) for one in after for group in one.groups} == {(2, (3, 4))}
    # Of the first two it would be said after groups.missing_time, 6 s, that they are missing.
    assert [event for people in after for event in people.events] == []

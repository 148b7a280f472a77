"""A team on a tour without rendering: what its localizers hear and make of it."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from mrs_people_sim.light.sensing import HEAD, LightHead
from mrs_people_sim.light.team import LightTeam, TeamRun, Trouble
from mrs_people_sim.scene import load_scene
from mrs_people_sim.scoring.poses import score_poses
from mrs_people_sim.tours import tour_of

SCENES = Path(__file__).resolve().parents[3] / "config" / "scenes"


def run(
    scene: str,
    trouble: Trouble = Trouble(),  # noqa: B008
    *,
    frames: int = 300,
    seed: int = 1,
    head: LightHead = HEAD,
) -> TeamRun:
    """The first so many tenths of a second of a tour whose odometry is poor."""
    read = load_scene(SCENES / f"{scene}.yaml")
    odometry = dataclasses.replace(read.odometry, drift=0.05, drift_yaw=0.02)
    read = dataclasses.replace(
        read, timing=dataclasses.replace(read.timing, frames=frames), odometry=odometry
    )
    return LightTeam(tour_of(read, seed), trouble, seed, head).run()


def relative(result: TeamRun, way: str = "localized") -> float:
    """Median error of robots' positions to each other [m]."""
    scores = score_poses(result.true, getattr(result, way))
    assert scores is not None
    return float(np.median(scores.apart))


@pytest.mark.slow
def test_a_team_knows_better_than_its_odometry_where_it_is():
    result = run("tour_l_corridor")
    assert relative(result) < 0.6 * relative(result, "odometry")
    assert {len(people) for people in result.people.values()} == {30}


@pytest.mark.slow
def test_robots_that_see_nobody_in_a_corridor_know_how_unsure_they_are():
    """Its walls tell nothing about the way along it, however often they are seen."""
    read = load_scene(SCENES / "tour_straight_corridor.yaml")
    read = dataclasses.replace(read, timing=dataclasses.replace(read.timing, frames=800))
    tour = tour_of(read, 11)
    tour = dataclasses.replace(tour, people=tour.people + np.array([0.0, 500.0]))
    result = LightTeam(tour, Trouble(), 11).run()
    scores = score_poses(result.true, result.localized)
    assert scores is not None
    assert np.mean(scores.squares < 14.2) > 0.99  # 3 sigma of three components
    assert np.mean(scores.squares) < 5.0


def test_a_run_depends_on_its_seed_alone():
    one, same, other = (run("tour_hall", frames=60, seed=seed) for seed in (1, 1, 2))
    for name, track in one.localized.items():
        np.testing.assert_array_equal(track.poses, same.localized[name].poses)
    assert relative(one) != relative(other)


def test_without_walls_people_or_messages_a_team_has_its_odometry():
    alone = Trouble(stereo=False, sonars=0.0, lost=1.0)
    result = run("tour_l_corridor", alone, frames=100)
    for name, track in result.localized.items():
        odometry = result.odometry[name]
        np.testing.assert_allclose(
            track.poses[:, :2], odometry.at(track.stamps_ns)[:, :2], atol=1e-9
        )


def test_who_is_cut_off_has_its_odometry_until_it_hears_again():
    cut = Trouble(stereo=False, sonars=0.0, cut_off=("robot_b", 0.0, 5.0))
    result = run("tour_hall", cut, frames=200)
    track, odometry = result.localized["robot_b"], result.odometry["robot_b"]
    off = np.abs(track.poses[:, :2] - odometry.at(track.stamps_ns)[:, :2]).max(axis=1)
    seconds = (track.stamps_ns - result.start_ns) / 1e9
    assert off[seconds < 5.0].max() < 1e-9
    assert off[seconds > 8.0].min() > 1e-3


def test_who_is_restarted_is_at_its_start_again():
    alone = Trouble(stereo=False, sonars=0.0, lost=1.0, restarted=("robot_b", 5.0))
    result = run("tour_hall", alone, frames=80)
    track, odometry = result.localized["robot_b"], result.odometry["robot_b"]
    seconds = (track.stamps_ns - result.start_ns) / 1e9
    start = odometry.poses[0]
    off = track.poses[:, :2] - odometry.at(track.stamps_ns)[:, :2]
    assert np.abs(off[seconds < 4.95]).max() < 1e-9
    assert np.hypot(*off[-1]) > 3.0
    np.testing.assert_allclose(track.poses[seconds >= 4.95][0], start, atol=1e-9)
    others = result.localized["robot_a"]
    np.testing.assert_allclose(
        others.poses[:, :2], result.odometry["robot_a"].at(others.stamps_ns)[:, :2], atol=1e-9
    )


def test_a_start_is_as_unsure_as_it_is_said():
    starts = []
    for seed in range(6):
        result = run("tour_hall", Trouble(start=(1.0, 1.0, 0.2)), frames=4, seed=seed)
        starts += [
            track.poses[0] - result.true[name].poses[0] for name, track in result.odometry.items()
        ]
    spread = np.std(starts, axis=0)
    # 18 draws: within a factor of two with near certainty.
    assert (spread / [1.0, 1.0, 0.2] > 0.5).all()
    assert (spread / [1.0, 1.0, 0.2] < 2.0).all()


@pytest.mark.slow
def test_a_map_that_is_right_keeps_the_team_in_the_corridor():
    # In stereo as without people: it finds all walls.
    head = dataclasses.replace(HEAD, found=((0.0,), (1.0,)))
    result = run("tour_straight_corridor", Trouble(known=True), frames=400, head=head)
    scores = score_poses(result.true, result.localized)
    odometry = score_poses(result.true, result.odometry)
    assert scores is not None
    assert odometry is not None
    across = float(np.median(np.abs(scores.across)))
    assert across < 0.05
    assert across < 0.5 * float(np.median(np.abs(odometry.across)))


@pytest.mark.slow
def test_people_are_found_with_all_kinds_of_poses():
    found = run("tour_hall", frames=60).people
    assert set(found) == {"exact", "localized", "odometry"}
    assert all(len(one.positions) >= 3 for estimates in found.values() for one in estimates)


@pytest.mark.slow
@pytest.mark.parametrize("liar", ["robot_a", "robot_b", "robot_c"])
@pytest.mark.parametrize("since", [0.0, 10.0])
def test_a_liar_is_named_and_nobody_else(liar, since):
    lying = run("tour_l_corridor", Trouble(lies=liar, lies_from=since))
    assert {fault.split()[0] for fault in lying.named} == {liar}
    assert f"{liar} doubted" in lying.named
    assert since < min(lying.named.values()) < since + 15.0
    assert relative(lying) < 0.6 * relative(lying, "odometry")

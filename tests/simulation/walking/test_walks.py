"""Walking groups: their dynamics, the team that drives with them, and who belongs to them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from mrs_people_loc.errors import ConfigError

pytest.importorskip("rosbags.interfaces", reason="writing bags needs rosbags")
pytest.importorskip("typer", reason="the mrs command needs typer")


from mrs_people_sim import motion
from mrs_people_sim.layouts import expand
from mrs_people_sim.render_scene import simulate
from mrs_people_sim.scene import Odometry, Scene, load_scene, read_scene
from mrs_people_sim.sensors.odometry import believe
from mrs_people_sim.views.world import World
from mrs_people_sim.walking.walks import Boxes, Walked, walk_together, way_along
from mrs_people_sim.writer import GROUP_TOPIC, PEOPLE_TOPIC
from mrs_studies.suite_scenes import suite_scenes, with_tracks
from mrs_tools.bags.reader import BagReader

SCENES = Path(__file__).resolve().parents[3] / "config" / "scenes"
SMALL = {"width": 80, "height_px": 60, "focal": 52.7}


def scene_of(**sections: Any) -> Scene:
    return read_scene(sections, "scene.yaml")


@dataclass(frozen=True)
class Watched:
    """A walk every 0.1 s: positions [m] of people (samples, people, 2) and robots, and groups."""

    scene: Scene
    walked: Walked
    times: NDArray
    people: NDArray
    robots: NDArray
    groups: NDArray

    @property
    def away(self) -> NDArray:
        """Distances of members from the middle of all members [m]; NaN for others."""
        members = np.where(self.groups[..., None] > 0, self.people, np.nan)
        return np.linalg.norm(members - np.nanmean(members, axis=1, keepdims=True), axis=2)


def watch(scene: Scene) -> Watched:
    scene = expand(scene)
    duration = (scene.timing.frames - 1) / scene.timing.rate
    walked = walk_together(scene, {}, {}, duration, np.random.default_rng([scene.seed, 11]))
    times = np.arange(0.0, duration, 0.1)
    people = [
        [(p.x, p.y) for p in (walked.people[k].at(float(t)) for k in range(len(scene.people)))]
        for t in times
    ]
    robots = [
        [(p.x, p.y) for p in (walked.robots[name].at(float(t)) for name in scene.robots)]
        for t in times
    ]
    groups = np.array([walked.groups_at(float(t)) for t in times])
    return Watched(scene, walked, times, np.array(people), np.array(robots), groups)


def kinds() -> list[str]:
    scenes = suite_scenes(SCENES / "walks.yaml", "test")
    return [s.name for s in scenes if s.layout.activity == "group"]


@cache
def of_the_suite(name: str) -> Watched:
    (scene,) = [s for s in suite_scenes(SCENES / "walks.yaml", "test") if s.name == name]
    return watch(scene)


def gaps(some: NDArray, others: NDArray | None = None) -> NDArray:
    """Distances between everybody at each time [m]; infinite to themselves and to absent people."""
    both = np.linalg.norm(some[:, :, None] - (some if others is None else others)[:, None], axis=3)
    if others is None:
        both[:, np.arange(both.shape[1]), np.arange(both.shape[1])] = np.inf
    return np.nan_to_num(both, nan=np.inf)


# ----------------------------------------------------------------------------- dynamics ----


@pytest.mark.parametrize("name", kinds())
def test_people_do_not_walk_through_people_or_objects(name: str) -> None:
    walk = of_the_suite(name)
    assert gaps(walk.people).min() > 0.40
    assert gaps(walk.people, walk.robots).min() > 0.55
    assert gaps(walk.robots).min() > 0.60
    boxes = Boxes(walk.scene)
    for people, robots in zip(walk.people, walk.robots, strict=True):
        there = people[np.isfinite(people).all(axis=1)]
        assert boxes.clearances(there)[0].min() > 0.20
        assert boxes.clearances(robots)[0].min() > 0.25


@pytest.mark.parametrize("name", kinds())
def test_people_and_robots_move_smoothly_at_plausible_speeds(name: str) -> None:
    walk = of_the_suite(name)
    for ways, fastest, strongest in ((walk.people, 2.0, 7.0), (walk.robots, 1.7, 3.0)):
        speed = np.linalg.norm(np.diff(ways, axis=0), axis=2) / 0.1
        assert np.nanmax(speed) < fastest
        push = np.linalg.norm(np.diff(ways, 2, axis=0), axis=2) / 0.01
        assert np.nanmax(push) < strongest
    # They get on: at half the pace that they like, whatever comes in between.
    members = np.where(walk.groups[..., None] > 0, walk.people, np.nan)
    done = np.linalg.norm(np.diff(members, axis=0), axis=2)
    assert np.nanmean(done) / 0.1 > 0.65 * walk.scene.walk.speed


@pytest.mark.parametrize("name", kinds())
def test_the_group_stays_together_but_for_its_stragglers(name: str) -> None:
    walk = of_the_suite(name)
    ordinary = [k for k, p in enumerate(walk.scene.people) if p.member and not p.behind]
    assert np.nanmax(walk.away[:, ordinary]) < 2.8
    # Round it, and no farther than robots see.
    middle = np.nanmean(np.where(walk.groups[..., None] > 0, walk.people, np.nan), axis=1)
    assert np.linalg.norm(walk.robots - middle[:, None], axis=2)[0].max() < 5.0
    # One of them is always near enough to the group.
    assert np.linalg.norm(walk.robots - middle[:, None], axis=2).min(axis=1).max() < 4.0


def test_a_straggler_falls_behind_for_some_seconds_and_catches_up() -> None:
    found = 0
    for name in kinds():
        walk = of_the_suite(name)
        for k, person in enumerate(walk.scene.people):
            if not person.behind:
                continue
            found += 1
            assert (walk.groups[:, k] == 1).all()  # still a member
            behind = walk.away[:, k] > 3.0
            assert 0.1 * behind.sum() > 3.0
            assert walk.times[behind][0] > person.behind[0]
            # In one piece, and at its end they come nearer.
            assert np.diff(np.flatnonzero(behind)).max() < 5
            assert walk.away[-1, k] < walk.away[:, k].max() - 0.5
    assert found >= 2


def test_leavers_leave_and_joiners_join() -> None:
    walk = of_the_suite("test_30_group_come_and_go")
    (leaver,) = [k for k, p in enumerate(walk.scene.people) if p.leaves >= 0]
    when = walk.scene.people[leaver].leaves
    np.testing.assert_array_equal(walk.groups[walk.times < when - 0.1, leaver], 1)
    np.testing.assert_array_equal(walk.groups[walk.times > when + 0.1, leaver], 0)
    middle = np.nanmean(np.where(walk.groups[..., None] > 0, walk.people, np.nan), axis=1)
    away = np.linalg.norm(walk.people[:, leaver] - middle, axis=1)
    assert not away[-1] < 3.0  # out of the door, or far
    (joiner,) = [k for k, p in enumerate(walk.scene.people) if p.joins >= 0]
    when = walk.scene.people[joiner].joins
    waits = walk.people[walk.times < when - 0.2, joiner]
    assert np.linalg.norm(waits - waits[0], axis=1).max() < 1.0  # they let them pass
    assert (walk.groups[walk.times < when, joiner] == 0).all()
    changes = np.flatnonzero(np.diff(walk.groups[:, joiner]))
    assert len(changes) == 1
    assert np.linalg.norm((walk.people[:, joiner] - middle)[changes[0] + 1]) < 2.5
    assert walk.away[-1, joiner] < 2.5


def test_strangers_pass_and_are_never_members() -> None:
    walk = of_the_suite("test_28_group_strangers")
    strangers = [k for k, p in enumerate(walk.scene.people) if not p.member]
    assert len(strangers) == 4
    assert (walk.groups[:, strangers] == 0).all()
    members = walk.people[:, [k for k, p in enumerate(walk.scene.people) if p.member]]
    met = gaps(members, walk.people[:, strangers]).min(axis=(0, 1))
    assert (met < 3.0).sum() >= 3  # they come across the group ...
    first = np.linalg.norm(walk.people[0, strangers] - members[0].mean(axis=0), axis=1)
    assert (first > 3.0).all()  # ... from somewhere else


def test_members_of_a_dense_group_occlude_and_pass_each_other() -> None:
    dense = of_the_suite("test_29_group_dense")
    loose = of_the_suite("test_26_group_corridor")
    near, far = (gaps(walk.people).min(axis=2).mean() for walk in (dense, loose))
    assert near < 0.85 < far
    order = np.argsort(dense.people[..., 0], axis=1)
    assert (order[0] != order[-1]).sum() >= 3


def test_the_same_scene_gives_the_same_walk_and_another_seed_another() -> None:
    def of(seed: int) -> Watched:
        return watch(
            scene_of(
                seed=seed, timing={"frames": 60}, room={"length": 16.0, "width": 5.0},
                layout={"people": 4, "robots": 2, "activity": "group"}, walk={"strangers": 1},
            )
        )  # fmt: skip

    one, again, other = of(3), of(3), of(4)
    np.testing.assert_array_equal(one.people, again.people)
    np.testing.assert_array_equal(one.robots, again.robots)
    np.testing.assert_array_equal(one.groups, again.groups)
    assert np.abs(one.people - other.people).max() > 0.2


def test_dawdling_person_stops_and_catches_up() -> None:
    walk = watch(
        scene_of(
            seed=8, timing={"frames": 400}, room={"length": 40.0, "width": 5.0},
            layout={"people": 5, "robots": 1, "activity": "group"}, walk={"dawdle": 6.0},
        )
    )  # fmt: skip
    speed = np.linalg.norm(np.diff(walk.people, axis=0), axis=2) / 0.1
    stands = speed < 0.15
    assert (stands.sum(axis=0) > 8).sum() >= 3  # several stop for most of a second or longer
    assert walk.away.max() < 2.9
    behind = walk.away > 1.6
    assert behind.any()
    assert (walk.away[-1] < 2.4).all()


def test_distant_member_returns_to_the_others() -> None:
    spots = [(7.0, 2.0), (7.0, 3.0), (8.0, 2.5), (2.5, 2.5)]
    walk = watch(
        scene_of(
            seed=6, timing={"frames": 150}, room={"length": 26.0, "width": 5.0},
            people=[{"x": x, "y": y, "member": True} for x, y in spots],
            walk={"dawdle": 0.0, "wander": 0.0},
        )
    )  # fmt: skip
    lag = walk.people[:, :3, 0].mean(axis=1) - walk.people[:, 3, 0]
    assert lag[0] > 4.0
    assert lag[-1] < 1.5
    assert walk.people[-1, :3, 0].mean() > 13.0  # they did not come nearer


def test_obstacles_beside_the_path_are_avoided() -> None:
    walk = watch(
        scene_of(
            seed=6, timing={"frames": 200}, room={"length": 22.0, "width": 6.0},
            furniture=[{"kind": "pillar", "x": 9.0, "y": 1.8, "size": [0.8, 0.8, 2.5]}],
            people=[{"x": x, "y": y, "member": True} for x, y in ((4, 2.9), (4.5, 3.8), (3, 2.2))],
            walk={"dawdle": 0.0, "wander": 0.0},
        )
    )  # fmt: skip
    assert (walk.people[-1, :, 0] > 11.0).all()
    gap = [Boxes(walk.scene).clearances(places)[0][:, 4] for places in walk.people]
    assert 0.2 < np.min(gap) < 0.8


def test_group_stops_at_the_end_of_the_path() -> None:
    walk = watch(
        scene_of(
            seed=2, timing={"frames": 300}, room={"length": 18.0, "width": 4.0},
            layout={"people": 4, "robots": 3, "activity": "group"}, walk={"dawdle": 0.0},
        )
    )  # fmt: skip
    last = walk.people[-30:]
    assert np.linalg.norm(last[-1] - last[0], axis=1).max() < 0.6
    assert 9.0 < last[..., 0].mean() < 16.0
    assert gaps(walk.people, walk.robots).min() > 0.55
    assert (walk.robots[..., 0] < 17.8).all()


def test_closed_path_is_repeated() -> None:
    way = [3.0, 3.0, 8.0, 3.0, 8.0, 6.0, 3.0, 6.0]
    walk = watch(
        scene_of(
            seed=5, timing={"frames": 300}, room={"length": 11.0, "width": 9.0},
            layout={"people": 3, "robots": 1, "activity": "group"},
            walk={"path": way, "loop": True, "speed": 1.0, "width": 0.8},
        )
    )  # fmt: skip
    # A round is less than 16 m: in 30 s everybody has been on all four sides, some of them twice.
    angle = np.unwrap(np.arctan2(walk.people[..., 1] - 4.5, walk.people[..., 0] - 5.5), axis=0)
    assert ((angle[-1] - angle[0]) / (2 * math.pi) > 1.1).all()
    assert walk.away.max() < 2.8


# ------------------------------------------------------------------------- way and walls ----


def test_path_matches_hand_computed_values() -> None:
    way = way_along((1.0, 2.0, 11.0, 2.0))
    assert way.length == pytest.approx(10.0, abs=1e-6)
    assert way.at(3.0, 0.5) == pytest.approx([4.0, 2.5])
    assert way.at(-2.0) == pytest.approx([-1.0, 2.0])  # straight on at both ends
    assert way.ahead(5.0) == pytest.approx([1.0, 0.0])
    places = np.array([[4.0, 3.0], [0.0, 2.0]])
    assert way.nearest(places) == pytest.approx([3.0, -1.0], abs=0.03)
    assert way.nearest(places, np.array([3.6, -0.4])) == pytest.approx([3.0, -1.0], abs=0.01)
    # No farther than a metre from where one was.
    assert way.nearest(places, np.array([7.0, 3.0])) == pytest.approx([6.0, 2.0], abs=0.06)


def test_corners_are_rounded_and_closed_paths_repeat() -> None:
    square = (0.0, 0.0, 6.0, 0.0, 6.0, 6.0, 0.0, 6.0)
    once, often = way_along(square), way_along(square, loop=True, length=60.0)
    turn = once.ahead(np.arange(4.0, 8.0, 0.1))
    assert (turn[1:] * turn[:-1]).sum(axis=1).min() > math.cos(0.25)
    corner = np.linalg.norm(once.at(np.arange(5.0, 7.0, 0.02)) - [6.0, 0.0], axis=1)
    assert 0.5 < corner.min() < 0.9
    # Who goes beside it on its inside goes on, too.
    for left in (-1.0, 1.0):
        beside = np.diff(once.at(np.arange(0.5, 15.0, 0.1), left), axis=0)
        assert ((beside * once.ahead(np.arange(0.5, 14.9, 0.1))).sum(axis=1) > 0.01).all()
    assert often.length > 60.0
    lap = np.linalg.norm(often.at(np.arange(20.0, 26.0, 0.05)) - often.at(2.0), axis=1)
    assert lap.min() < 0.05
    # A place that the way passes several times is where it passes first.
    assert 2.0 < often.nearest(np.array([[3.0, 0.1]]))[0] < 4.0


def test_clearances_match_hand_computed_values() -> None:
    scene = scene_of(
        room={"length": 10.0, "width": 8.0},
        furniture=[
            {"kind": "block", "x": 5.0, "y": 4.0, "size": [2.0, 1.0, 1.0]},
            {"kind": "block", "x": 2.0, "y": 6.0, "yaw": math.pi / 4, "size": [2.0, 2.0, 1.0]},
            {"kind": "block", "x": 9.0, "y": 1.0, "z": 2.0},  # overhead
        ],
    )
    gap, out = Boxes(scene).clearances(np.array([[5.0, 5.0], [4.3, 4.0], [2.0, 4.0]]))
    assert gap[0] == pytest.approx([5.0, 5.0, 5.0, 3.0, 0.5, 3.1623 - 1.0], abs=0.3)
    assert out[0, 4] == pytest.approx([0.0, 1.0])
    assert gap[1, 4] == pytest.approx(-0.3)  # inside: out by the nearest side
    assert out[1, 4] == pytest.approx([-1.0, 0.0])
    # The second stands on its corner: 1.414 from its middle.
    assert gap[2, 5] == pytest.approx(2.0 - math.sqrt(2.0))
    assert out[2, 5] == pytest.approx([0.0, -1.0], abs=1e-6)
    assert Boxes(scene).at_wall((0.5, 4.0))
    assert not Boxes(scene).at_wall((1.0, 4.0))


# ------------------------------------------------------------------------ scenes and bags ----


def test_walks_of_the_suite_are_as_documented() -> None:
    halves = {half: suite_scenes(SCENES / "walks.yaml", half) for half in ("train", "test")}
    both = [*halves["train"], *halves["test"], *suite_scenes(SCENES / "suite.yaml", "all")]
    assert len({s.name for s in both}) == len({s.seed for s in both}) == len(both)
    for half, scenes in halves.items():
        groups = [s for s in scenes if s.layout.activity == "group"]
        assert [s.name[len(half) :] for s in groups] == [n[len("test") :] for n in kinds()]
        assert {s.odometry.mode for s in groups} == {"exact", "localized", "drift"}
        assert {s.layout.heads for s in groups} == {"level", "tilted", "mixed", "trinocular"}
        assert all(20 <= s.timing.frames / s.timing.rate <= 40 for s in groups)
        recorded = [s for s in scenes if s.tracks]
        assert len(recorded) == 2
        assert len(groups) + len(recorded) == len(scenes)


def test_recorded_walks_without_a_recording_are_omitted(tmp_path: Path) -> None:
    scenes = suite_scenes(SCENES / "walks.yaml", "test", tracks=tmp_path)
    there, missing = with_tracks(scenes)
    assert [s.name for s in there] == kinds()
    assert len(missing) == 2
    assert str(tmp_path / "zara02" / "obsmat.txt") in missing[0]
    (tmp_path / "zara02").mkdir()
    (tmp_path / "zara02" / "obsmat.txt").touch()
    assert with_tracks(scenes) == (scenes, [])


def test_robots_of_recorded_walks_stand_where_nobody_walks() -> None:
    scenes, missing = with_tracks(suite_scenes(SCENES / "walks.yaml", "all"))
    if missing:
        pytest.skip(missing[0])
    for scene in [s for s in scenes if s.tracks]:
        duration = (scene.timing.frames - 1) / scene.timing.rate
        size = (scene.room.length, scene.room.width)
        tracks = motion.read_tracks(scene.tracks, scene.tracks_window, duration, size)
        groups = motion.read_groups(scene.tracks)
        assert sum(one in groups for one in tracks) >= 5
        places = np.array(
            [
                [(p.x, p.y) for p in (t.at(float(now)) for t in tracks.values())]
                for now in np.arange(0.0, duration, 0.1)
            ]
        )
        robots = np.array([[(r.x, r.y) for r in scene.robots.values()]] * len(places))
        assert gaps(places, robots).min() > 0.6
        near = gaps(places, robots).min(axis=2)
        assert (near[np.isfinite(near)] < 5.0).mean() > 0.8


def test_groups_of_a_recording_are_read(tmp_path: Path) -> None:
    assert motion.read_groups(tmp_path / "obsmat.txt") == {}
    (tmp_path / "groups.txt").write_text("4 9\n\n7\n1 2 3\n")
    assert motion.read_groups(tmp_path / "obsmat.txt") == {4: 1, 9: 1, 1: 2, 2: 2, 3: 2}
    (tmp_path / "groups.txt").write_text("four\n")
    with pytest.raises(ConfigError, match=r"no groups\.txt"):
        motion.read_groups(tmp_path / "obsmat.txt")


@pytest.mark.parametrize(
    ("document", "part"),
    [
        ({"walk": {"path": [1, 2]}}, "walk: path has 2 numbers"),
        ({"walk": {"sped": 1}}, "did you mean speed"),
        ({"walk": {"speed": 0.0}}, "speed is 0"),
        ({"people": [{"behind": [3.0]}]}, "behind"),
        ({"robots": {"robot_a": {"post": [1.0, 2.0, 3.0]}}}, "post"),
    ],
)
def test_a_bad_walk_is_refused(document: dict, part: str) -> None:
    with pytest.raises(ConfigError) as error:
        read_scene(document, "scene.yaml")
    assert part in str(error.value)


def test_odometry_of_a_sideways_moving_robot_is_correct() -> None:
    t = motion.times(4.0)
    ways = np.stack([0.6 * t, np.zeros_like(t)], axis=1)
    track = motion.Track(-motion.LEAD_S, ways, np.full(len(t), math.pi / 2), free=True)
    for mode in ("exact", "drift"):
        settings = Odometry(mode=mode, sigma=0.0, sigma_yaw=0.0, drift=0.0, drift_yaw=0.0)
        sample = believe(track, settings, 4.0, np.random.default_rng(1)).samples[100]
        assert (sample.velocity, sample.sideways) == pytest.approx((0.0, -0.6), abs=1e-6)
    along = motion.along((0.0, 0.0, 4.0, 0.0, 4.0, 4.0), 1.0, 4.0)
    settings = Odometry(mode="localized")
    assert {
        s.sideways for s in believe(along, settings, 4.0, np.random.default_rng(1)).samples
    } == {0.0}


def test_bag_contains_the_group_memberships(tmp_path: Path) -> None:
    pytest.importorskip("embreex", reason="ray casting needs embreex, the extra sim")
    scene = scene_of(
        name="walk", seed=4, timing={"frames": 3, "rate": 2.0}, imaging={"samples": 1},
        room={"length": 12.0, "width": 5.0}, head=SMALL,
        people=[
            {"x": 4.0, "y": 2.0, "member": True},
            {"x": 4.5, "y": 3.0, "member": True, "leaves": 0.6, "goal": [0.5, 3.0]},
            {"x": 8.0, "y": 1.0, "walks": True, "goal": [2.0, 1.0]},
            {"x": 9.0, "y": 4.0},
        ],
        robots={"robot_a": {"x": 7.0, "y": 2.5, "yaw": 3.14, "post": [2.5, 0.0]}},
    )  # fmt: skip
    world = simulate(scene, tmp_path / "walk.mcap")
    with BagReader(tmp_path / "walk.mcap") as bag:
        found = list(bag.decoded([GROUP_TOPIC]))
        reported = [message.data.tolist() for _, _, message in found]
        stamps = [ns for _, ns, _ in found]
        assert stamps == [ns for _, ns, _ in bag.decoded([PEOPLE_TOPIC])]
    assert reported == [[1, 1, 0, 0], [1, 1, 0, 0], [1, 0, 0, 0]]
    assert world.robot_place("robot_a", 1.0).x > 7.3  # it drives ahead of them, and looks back
    assert abs(world.robot_place("robot_a", 1.0).yaw) > 2.8
    # Where nobody is in a group there is no such topic.
    alone = scene_of(name="alone", timing={"frames": 1}, people=[{"x": 3.0, "y": 3.0}],
                     robots={"robot_a": {"x": 1.0, "y": 3.0}}, head=SMALL)  # fmt: skip
    simulate(alone, tmp_path / "alone.mcap")
    with BagReader(tmp_path / "alone.mcap") as bag:
        assert GROUP_TOPIC not in bag.topics


def test_recorded_walk_equals_its_scene() -> None:
    """bags/walking_group: the people of the demo and of the nodes' tests walk as in the scene."""
    scene = load_scene(SCENES / "walking_group.yaml")
    world = World(expand(scene))
    straggler, joiner = 3, 4
    assert scene.people[straggler].behind
    assert scene.people[joiner].joins > 0
    with BagReader(SCENES.parents[1] / "bags" / "walking_group") as bag:
        groups = {ns: message.data for _, ns, message in bag.decoded([GROUP_TOPIC])}
        places = {ns: message.poses for _, ns, message in bag.decoded([PEOPLE_TOPIC])}
    assert list(groups) == list(places)
    far = []
    for ns, poses in places.items():
        time = (ns - world.stamp_ns(0.0)) * 1e-9
        there = np.array([(p.position.x, p.position.y) for p in poses])
        want = motion.positions(world.person_places(time))
        np.testing.assert_allclose(there, want, atol=0.02)
        np.testing.assert_array_equal(groups[ns], world.groups(time))
        members = there[groups[ns] == 1]
        far.append(np.linalg.norm(there[straggler] - members.mean(axis=0)) > 3.0)
    assert 10 < sum(far) < 30  # 2 to 6 s
    assert not far[0]
    assert not far[-1]
    assert [int(data[joiner]) for data in groups.values()].count(1) > 30


def test_recorded_groups_are_part_of_the_world(tmp_path: Path) -> None:
    rows = [
        [10 * frame, one, 1.0 + 0.4 * frame, 0, 1.0 + one, 1, 0, 0]
        for frame in range(10)
        for one in (1, 2, 3)
    ]
    np.savetxt(tmp_path / "obsmat.txt", rows)
    (tmp_path / "groups.txt").write_text("2\n1 3\n")
    (tmp_path / "scene.yaml").write_text(
        "tracks: obsmat.txt\ntiming: {frames: 20}\n"
        "people: [{x: 5.0, y: 6.0}]\nrobots: {robot_a: {x: 7.0, y: 5.0}}\n"
    )
    world = World(expand(load_scene(tmp_path / "scene.yaml")))
    assert world.has_group
    np.testing.assert_array_equal(world.groups(1.0), [0, 2, 0, 2])
    assert world.person_places(0.8)[1].x == pytest.approx(1.8, abs=0.02)

"""Fast views of a scene: the same as of one mesh of everything, from any places."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

pytest.importorskip("embreex", reason="the simulator needs embreex")

from mrs_people_loc.config import load_yaml
from mrs_people_sim.models.meshes import merge
from mrs_people_sim.motion import Place
from mrs_people_sim.scene import Scene, read_scene
from mrs_people_sim.views import live_view
from mrs_people_sim.views.live_view import LiveView
from mrs_people_sim.views.ray_casting import Caster
from mrs_people_sim.views.stage import Stage

CLEAN = {
    "samples": 1, "slices": 1, "exposure": 0.0, "noise": 0.0, "shot_noise": 0.0, "blur": 0.0,
    "calibration_error": 0.0, "gain_difference": 0.0, "brightness_difference": 0.0, "target": 60.0,
}  # fmt: skip
NOWHERE = Place(math.nan, math.nan, 0.0, 0.0, 0.0)


def scene_of(**robots: Any) -> Scene:
    people: list[dict[str, Any]] = [{"x": 3.0, "y": 3.2, "yaw": 1.0}, {"x": 5.0, "y": 3.9}]
    document = {
        "room": {"length": 8.0, "width": 7.0},
        "people": people,
        "robots": {name: {"y": 3.5, **robot} for name, robot in robots.items()},
        "imaging": CLEAN,
    }
    return read_scene(document, "scene")


def place(x: float, y: float, yaw: float = 0.0, speed: float = 0.0) -> Place:
    return Place(x, y, yaw, speed, 0.0)


@pytest.mark.parametrize("head", [{}, {"pitch": 0.3, "roll": 0.1, "yaw": 3.0}])
def test_view_equals_that_of_one_mesh_of_everything(head: dict[str, float]) -> None:
    scene = scene_of(a={"x": 1.0, "head": head}, b={"x": 6.5})
    stage = Stage(scene)
    bodies = stage.bodies(scene.people)
    view = LiveView(stage, scene.people)
    people = [place(3.0, 3.2, 1.0), place(5.0, 3.9, -2.0)]
    robots = {"a": place(1.0, 3.5, -head.get("yaw", 0.0)), "b": place(6.5, 3.5, 3.0)}
    view.move(people, robots)
    for name, other in ("ab", "ba"):
        there = robots[other]
        robot = stage.robot_meshes[other].placed(there.x, there.y, there.yaw)
        persons = [bodies[k].mesh(people[k], 0.0).owned_by(k) for k in (0, 1)]
        everything = Caster(merge([stage.room, robot, *persons]), stage.atlas, stage.light)
        images, pixels = view.look(name)
        for camera in stage.cameras[name]:
            rays = stage.rays(name, camera, robots[name])
            light, owner, _ = everything.look(*rays, camera.pixel_angle)
            if camera.name == "left":
                counts = np.bincount(owner[owner >= 0])
                assert min(counts) > 100
                assert pixels == pytest.approx(counts, abs=3)  # rays at edges
            want = light.reshape(camera.shade.shape) * camera.shade
            image = images[camera.name].astype(float)
            difference = np.abs(want / want.mean() - image / image.mean())
            assert np.quantile(difference, 0.99) < 0.02


def test_who_is_behind_hidden_or_gone_is_not_seen() -> None:
    scene = scene_of(a={"x": 3.0}, b={"x": 1.0})
    view = LiveView(Stage(scene), scene.people)
    robots = {"a": place(3.0, 3.5), "b": place(7.5, 6.5)}
    view.move([place(2.0, 3.5), place(5.0, 3.5)], robots)
    behind, ahead = view.look("a")[1]
    assert behind == 0
    assert ahead > 300
    view.move([place(5.0, 3.5), place(6.0, 3.5)], robots)
    assert view.look("a")[1][1] < 0.1 * ahead
    view.move([NOWHERE, place(5.0, 3.5)], robots)
    assert list(view.look("a")[1]) == [0, ahead]
    turned = {**robots, "a": place(3.0, 3.5, math.pi)}  # bearings beyond a half turn
    view.move([place(1.0, 3.4), place(1.2, 3.7)], turned)
    assert min(view.look("a")[1]) > 300


def test_robot_sees_the_others_but_not_itself() -> None:
    scene = scene_of(a={"x": 1.0}, b={"x": 1.0})
    view = LiveView(Stage(scene), scene.people)
    alone = {"a": place(1.0, 3.5), "b": place(1.0, 6.0)}
    view.move([NOWHERE, NOWHERE], alone)
    empty = view.look("a")[0]["left"]
    view.move([NOWHERE, NOWHERE], {**alone, "b": place(3.0, 3.5)})
    assert (np.abs(view.look("a")[0]["left"].astype(float) - empty) > 20).sum() > 300


def test_gait_follows_the_way_and_repeats_with_each_stride() -> None:
    scene = scene_of(a={"x": 1.0})
    view = LiveView(Stage(scene), scene.people)
    robots = {"a": place(1.0, 3.5)}
    stride = Stage(scene).bodies(scene.people)[0].stride(0.9)
    feet = []
    for k in range(9):
        view.move([place(3.0, 2.0 + k * stride / 4, math.pi / 2, 0.9), NOWHERE], robots)
        mesh = view._seen[0].solid.mesh
        low = mesh.vertices[mesh.vertices[:, 2] < 0.05]
        feet.append(float(low[:, 0].max()))
    assert feet[4:] == pytest.approx(feet[:5], abs=1e-6)
    assert max(feet) - min(feet) > 0.05


def test_so_many_poses_are_kept_at_most(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(live_view, "_KEPT", 3)
    scene = scene_of(a={"x": 1.0})
    view = LiveView(Stage(scene), scene.people)
    for k in range(9):
        view.move([place(3.0, 2.0 + 0.2 * k, 0.0, 0.9), NOWHERE], {"a": place(1.0, 3.5)})
        assert len(view._poses) <= 3
        assert view._seen[0].solid in [thing.solid for thing in view._poses.values()]


def test_scene_of_a_tour_is_valid_for_the_whole_team() -> None:
    """Every guided scene has heads that robot_node accepts."""
    from mrs_people_sim.guided import guided_scene
    from mrs_tools.installing import default_file

    for path in sorted(default_file("config", "scenes").glob("guided_*.yaml")):
        assert load_yaml(path)
        scene = guided_scene(path, 1)
        assert set(Stage(scene).stereo) == set(scene.robots)

"""The simulator: geometry, bodies, ground truth, odometry, bags, the suite."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
import yaml

from mrs_people_loc.config import load_team
from mrs_people_loc.errors import BagError, ConfigError
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.messages import (
    read_camera_info,
    read_image,
    read_occupancy_grid,
    read_pose,
    stamp_ns_of,
)
from mrs_people_loc.sensing.camera import StereoCamera

pytest.importorskip("rosbags.interfaces", reason="writing bags needs rosbags")
pytest.importorskip("typer", reason="the mrs command needs typer")
pytest.importorskip("embreex", reason="ray casting needs embreex, the extra sim")

from typer.testing import CliRunner

from mrs_people_sim import motion
from mrs_people_sim.layouts import expand
from mrs_people_sim.models import textures
from mrs_people_sim.models.human_body import HumanBody
from mrs_people_sim.models.meshes import box, cylinder, merge, quad
from mrs_people_sim.models.rooms import SIZES, floor_plan, furniture_mesh
from mrs_people_sim.models.textures import Atlas, Texture
from mrs_people_sim.motion import Place, Walker
from mrs_people_sim.render_scene import simulate, team_file
from mrs_people_sim.scene import (
    FURNITURE,
    Furniture,
    Odometry,
    Person,
    Room,
    Scene,
    load_scene,
    read_scene,
)
from mrs_people_sim.sensors.heads import sample_offsets
from mrs_people_sim.sensors.odometry import believe
from mrs_people_sim.views.world import RenderedFrame, World
from mrs_people_sim.writer import (
    MAP_TOPIC,
    PEOPLE_TOPIC,
    PERCENT_TOPIC,
    VISIBLE_TOPIC,
    Messages,
    true_pose_topic,
)
from mrs_tools.bags.reader import BagReader
from mrs_tools.cli import app

ROOT = Path(__file__).resolve().parents[2]
SUITE = ROOT / "config" / "scenes" / "suite.yaml"
CLEAN = {
    "noise": 0.0, "shot_noise": 0.0, "gain_difference": 0.0, "brightness_difference": 0.0,
    "vignetting": 0.0, "blur": 0.0, "exposure": 0.0, "calibration_error": 0.0, "samples": 9,
}  # fmt: skip
SMALL = {"width": 80, "height_px": 60, "focal": 52.7}


def scene_of(text: str = "", **sections: Any) -> Scene:
    """A scene from YAML text and from sections that are added to it."""
    return read_scene({**(yaml.safe_load(text) or {}), **sections}, "scene.yaml")


def world_of(text: str = "", **sections: Any) -> World:
    return World(expand(scene_of(text, **sections)))


# -------------------------------------------------------------------------- scene files ----


@pytest.mark.parametrize(
    ("document", "part"),
    [
        ("[]", "is not a scene"),
        ("rooms: {}", "unknown section rooms; did you mean room?"),
        ("1: {}", "unknown section 1; known: name, seed,"),
        ("room: {lenght: 3}", "did you mean length"),
        ("room: {length: 0.2}", "length is 0.2; allowed: a number from 1 to 200"),
        ("room: {length: .nan}", "length is nan"),
        ("room: 3", "room is 3; wanted: a mapping"),
        ("people: {x: 1}", "wanted: a list"),
        ("people: [{cloth: silk}]", "cloth is 'silk'"),
        ("people: [{path: [1, 2]}]", "at least two points"),
        ("people: [{path: [1, 2, 3]}]", "path has 3 numbers"),
        ("bystanders: [{path: [1, 2, 3]}]", "bystanders: path has 3 numbers"),
        ("bystanders: [{near: 3}]", "bystanders: path is empty"),
        ("bystanders: [{path: [1, 2]}]", "has bystanders, but no tour"),
        ("bystanders: [{path: [1, 2], stays: 3}]", "unknown"),
        ("furniture: [{kind: piano}]", "kind is 'piano'"),
        ("robots: {robot-a: {}}", "allowed: ROS namespaces"),
        ("robots: {robot_a: {head: {basline: 1}}}", "did you mean baseline"),
        ("seed: -1", "seed is -1"),
        ("tracks_window: [1, 2]", "tracks_window wants four numbers"),
    ],
)
def test_bad_scene_is_refused_with_its_location(document: str, part: str) -> None:
    with pytest.raises(ConfigError, match="scene.yaml") as error:
        read_scene(yaml.safe_load(document), "scene.yaml")
    assert part in str(error.value)


def test_common_head_is_the_default_of_each_robot() -> None:
    scene = scene_of("{head: {baseline: 0.2, pitch: 0.1}, robots: {a: {head: {pitch: 0.4}}, b: }}")
    assert (scene.heads["a"].baseline, scene.heads["a"].pitch) == (0.2, 0.4)
    assert (scene.heads["b"].baseline, scene.heads["b"].pitch) == (0.2, 0.1)


def test_missing_scenes_and_invalid_yaml_are_errors(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="there is no such file"):
        load_scene(tmp_path / "none.yaml")
    (tmp_path / "bad.yaml").write_text("a: [")
    with pytest.raises(ConfigError, match=r"bad\.yaml"):
        load_scene(tmp_path / "bad.yaml")


@pytest.mark.parametrize(
    "path",
    sorted(p for p in SUITE.parent.glob("*.yaml") if p.name not in ("suite.yaml", "walks.yaml")),
)
def test_every_scene_of_the_repository_can_be_built(path: Path) -> None:
    scene = expand(load_scene(path))
    assert scene.robots
    start = dataclasses.replace(scene.timing, frames=min(scene.timing.frames, 100))
    scene = dataclasses.replace(scene, timing=start, tracks="")
    assert World(scene).names == list(scene.robots)


# ------------------------------------------------------------------------------ meshes ----


def test_solids_face_outwards_and_have_the_requested_size() -> None:
    for mesh, low, high in (
        (box((1, 2, 3), (2, 4, 6), 0), (0, 0, 0), (2, 4, 6)),
        (cylinder((1, 2, 0.5), 2.0, 0.3, 0, segments=40), (0.7, 1.7, 0.5), (1.3, 2.3, 2.5)),
    ):
        assert mesh.vertices.min(axis=0) == pytest.approx(low, abs=0.01)
        assert mesh.vertices.max(axis=0) == pytest.approx(high, abs=0.01)
        outward = mesh.vertices - mesh.vertices.mean(axis=0)
        assert (np.einsum("ij,ij->i", mesh.normals, outward) > 0).all()
        assert np.linalg.norm(mesh.normals, axis=1) == pytest.approx(1.0, abs=1e-5)
        assert mesh.triangles.max() == len(mesh.vertices) - 1


def test_merging_and_placing_keep_meshes_intact() -> None:
    one = quad(np.zeros(3), np.array([1.0, 0, 0]), np.array([0, 1.0, 0]), 3)
    two = one.placed(5.0, 1.0, math.pi / 2).owned_by(7)
    both = merge([one, two])
    assert both.material.tolist() == [3] * 4
    assert both.owner.tolist() == [-1, -1, 7, 7]
    assert both.vertices[both.triangles[2:]].max(axis=(0, 1)) == pytest.approx([5, 2, 0])
    assert len(merge([]).triangles) == 0


@pytest.mark.parametrize("kind", FURNITURE)
def test_furniture_stands_on_the_floor_in_its_size(kind: str) -> None:
    atlas = Atlas()
    piece = Furniture(kind=kind)
    vertices = furniture_mesh(piece, np.random.default_rng(3), atlas, 1.0).vertices
    dx, dy, dz = SIZES[kind]
    assert vertices[:, 2].min() == pytest.approx(0.0, abs=0.121 if kind == "curtain" else 0.05)
    # Things on top may add to the height, leaves and boxes a little to the sides.
    assert 0.75 * dz < vertices[:, 2].max() < dz + 0.75
    assert np.ptp(vertices[:, 0]) < 1.9 * dx + 0.05
    assert np.ptp(vertices[:, 1]) < 1.9 * dy + 0.05


# ---------------------------------------------------------------------------- textures ----


def test_textures_are_interpolated_and_averaged_at_a_distance() -> None:
    atlas = Atlas()
    image = np.zeros((4, 8), dtype=np.float32)
    image[:, 1::2] = 1.0
    material = np.full(3, atlas.add(Texture(image, (8.0, 4.0))))
    # Centres of texels are at half units; the tile repeats.
    uv = np.array([[0.5, 0.5], [1.5, 2.5], [9.5, -0.5]], dtype=np.float32)
    near = np.full(3, 0.5, dtype=np.float32)
    assert atlas.sample(material, uv, near) == pytest.approx([0.0, 1.0, 1.0])
    between = uv + np.array([0.5, 0.0], dtype=np.float32)
    assert atlas.sample(material, between, near) == pytest.approx([0.5] * 3)
    assert atlas.sample(material, uv, 8 * near) == pytest.approx([0.5] * 3)


@pytest.mark.parametrize(
    "texture",
    [textures.plaster, textures.concrete, textures.carpet, textures.wood, textures.planks,
     textures.tiles, textures.brick, textures.wallpaper, textures.plain, textures.speckle],
)  # fmt: skip
def test_textures_have_the_requested_mean_and_contrast(texture: Any) -> None:
    rich = texture(np.random.default_rng(1), 0.4, 1.0).image
    poor = texture(np.random.default_rng(1), 0.4, 0.25).image
    assert rich.mean() == pytest.approx(0.4, abs=0.04)
    assert poor.std() == pytest.approx(0.25 * rich.std(), rel=0.2)
    assert rich.min() > 0.0
    assert rich.max() < 1.0


def test_a_dark_pullover_is_dark_and_nearly_plain() -> None:
    cloth = textures.fabric(np.random.default_rng(1), "plain", 0.06).image
    assert cloth.mean() == pytest.approx(0.06, abs=0.005)
    assert cloth.std() < 0.01


# ------------------------------------------------------------------------------ bodies ----


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("speed", [0.0, 0.7, 1.4])
def test_a_body_stands_on_the_floor_with_its_neck_over_its_place(seed: int, speed: float) -> None:
    body = HumanBody(Person(hair="bald", bag="none"), seed, Atlas())
    for step in range(7):
        place = Place(3.0, 2.0, 0.7, speed, 0.21 * step)
        vertices = body.mesh(place, 0.3 * step).vertices
        bob = 0.0 if speed == 0.0 else 0.08
        assert vertices[:, 2].min() == pytest.approx(0.0, abs=0.012 + 0.02 * speed)
        assert body.height - bob - 0.02 < vertices[:, 2].max() < body.height + 0.02
        local = (vertices[:, :2] - [3.0, 2.0]) @ rotation_2d(0.7)
        neck = local[np.abs(vertices[:, 2] - (vertices[:, 2].max() - 0.155 * body.height)) < 0.012]
        assert len(neck) > 8
        # Middle of the neck's outline.
        assert 0.5 * (neck.min(axis=0) + neck.max(axis=0)) == pytest.approx([0, 0], abs=0.02)


def test_people_vary_and_are_reproducible() -> None:
    def shape(seed: int) -> np.ndarray:
        return HumanBody(Person(), seed, Atlas()).mesh(Place(0, 0, 0, 0, 0), 0.0).vertices

    heights = [HumanBody(Person(), seed, Atlas()).height for seed in range(30)]
    assert 1.45 <= min(heights) < 1.62
    assert 1.80 < max(heights) <= 1.95
    widths = [np.ptp(shape(seed)[:, 1]) for seed in range(12)]
    assert max(widths) - min(widths) > 0.1
    np.testing.assert_array_equal(shape(3), shape(3))


def test_feet_on_the_floor_do_not_slide() -> None:
    body = HumanBody(Person(top="pullover", bottom="trousers", bag="none"), 1, Atlas())
    ankles = []
    for k in range(60):
        way = 0.02 * k
        legs = body._walk(Place(way, 0.0, 0.0, 1.2, way), 1.0)
        ankles.append([legs.ankles[side] + [way, 0, 0] for side in (0, 1)])
    track = np.array(ankles)
    low = track[:, :, 2] < track[:, :, 2].min() + 0.002
    assert low.any(axis=1).mean() > 0.6  # mostly one foot is flat on the floor
    both = low[1:] & low[:-1]
    assert np.abs(np.diff(track[:, :, 0], axis=0))[both] == pytest.approx(0.0, abs=1e-6)
    assert np.ptp(track[:, 0, 0]) > 1.0


# ------------------------------------------------------------------------------ motion ----


def test_path_is_followed_at_its_speed_and_heading() -> None:
    track = motion.along((0.0, 1.0, 9.0, 1.0), 1.2, 3.0)
    for time in (0.0, 1.0, 2.9):
        place = track.at(time)
        assert place.x == pytest.approx(1.2 * (time + motion.LEAD_S), abs=0.01)
        assert (place.y, place.yaw) == pytest.approx((1.0, 0.0), abs=1e-6)
        assert place.speed == pytest.approx(1.2, abs=0.02)
    back = motion.along((0.0, 1.0, 9.0, 1.0), 1.2, 3.0, backwards=True).at(1.0)
    assert abs(back.yaw) == pytest.approx(math.pi)
    assert back.speed == pytest.approx(-1.2, abs=0.02)


def test_walkers_keep_their_distance_and_stay_in_the_room() -> None:
    rng = np.random.default_rng(5)
    spots = [(1.0, 1.0), (6.0, 1.0), (1.0, 5.0), (6.0, 5.0), (3.5, 1.0), (3.5, 5.0)]
    robot = motion.standing(3.5, 3.0, 0.0, 20.0)
    pillar = np.array([[2.0, 3.0, 0.3]])
    tracks = motion.walk_about(
        [Walker(x, y, 1.1) for x, y in spots],
        duration=20.0,
        bounds=(0.0, 7.0, 0.0, 6.0),
        obstacles=pillar,
        others=[robot],
        rng=rng,
    )
    for time in np.arange(0.0, 20.0, 0.1):
        at = motion.positions([t.at(float(time)) for t in tracks])
        assert (at > 0.2).all()
        assert (at < [6.8, 5.8]).all()
        gaps = np.linalg.norm(at[:, None] - at[None], axis=2) + 9 * np.eye(len(at))
        assert gaps.min() > 0.45
        assert np.linalg.norm(at - [3.5, 3.0], axis=1).min() > 0.35
        assert np.linalg.norm(at - pillar[0, :2], axis=1).min() > 0.3
    ways = [t.at(20.0).way for t in tracks]
    assert min(ways) > 5.0


def test_recorded_pedestrians_follow_their_tracks(tmp_path: Path) -> None:
    rows = []
    for frame in range(10):
        rows.append([100 + 10 * frame, 4, 5.0 + 0.5 * frame, 0, 7.0, 1.25, 0, 0])
        if frame > 4:
            rows.append([100 + 10 * frame, 9, 8.0, 0, 9.0 - 0.4 * frame, 0, 0, -1])
    file = tmp_path / "obsmat.txt"
    np.savetxt(file, rows)
    tracks = motion.read_tracks(file, (0.4, 3.0, 5.0, 6.0), 2.4)
    one, two = tracks[4], tracks[9]
    # 0.4 s between rows; the window starts at 0.4 s, and its origin is (5, 6).
    assert (one.at(0.8).x, one.at(0.8).y) == pytest.approx((1.5, 1.0), abs=0.02)
    assert one.at(0.8).speed == pytest.approx(1.25, abs=0.05)
    assert math.isnan(two.at(0.0).x)
    assert two.at(2.2).y == pytest.approx(9.0 - 0.4 * 6.5 - 6.0, abs=0.05)
    with pytest.raises(ConfigError, match="nobody is there"):
        motion.read_tracks(file, (100.0, 110.0, 0.0, 0.0), 1.0)
    for text in ("a b c", "1 1 nan 0 1\n2 1 1 0 1\n", "1 1 1 0 1\n1 1 1 0 1\n"):
        file.write_text(text)
        with pytest.raises(ConfigError, match=r"no obsmat\.txt"):
            motion.read_tracks(file, (), 1.0)


# ---------------------------------------------------------------------------- odometry ----


@pytest.mark.parametrize("mode", ["exact", "localized", "drift"])
def test_odometry_error_matches_its_covariance(mode: str) -> None:
    track = motion.along((0.0, 0.0, 6.0, 0.0, 6.0, 6.0), 0.8, 10.0)
    settings = Odometry(mode=mode)
    squares, last = [], []
    for seed in range(60):
        belief = believe(track, settings, 10.0, np.random.default_rng(seed))
        assert np.diff([s.time for s in belief.samples]) == pytest.approx(0.02)
        assert belief.samples[0].time < -0.05
        assert belief.samples[-1].time > 10.05
        sample = belief.samples[-1]
        x0, y0, yaw0 = belief.map_from_odom or (0.0, 0.0, 0.0)
        at = np.array([x0, y0]) + rotation_2d(yaw0) @ [sample.x, sample.y]
        true = track.at(sample.time)
        error = at - [true.x, true.y]
        turn = rotation_2d(yaw0)
        covariance = turn @ sample.covariance[:2, :2] @ turn.T
        squares.append(error @ np.linalg.solve(covariance, error))
        last.append(np.linalg.norm(error))
    if mode == "exact":
        assert max(last) < 1e-9
    else:
        assert (belief.frame == "odom") == (mode == "drift")
        assert np.median(last) > 0.01
        # Squares of two normal numbers have the mean 2; of 60 of them it strays by 0.26.
        assert 1.2 < np.mean(squares) < 2.8


# ---------------------------------------------------------------------------- geometry ----

GEOMETRY = """
seed: 3
timing: {frames: 1}
room: {length: 5.0, width: 5.0, walls: speckle, floor: speckle, posters: 0, doors: 0}
furniture:
  - {kind: block, x: 2.9, y: 2.5, size: [0.6, 1.6, 1.8]}
  - {kind: block, x: 3.9, y: 1.0, size: [0.6, 1.2, 1.2], yaw: 0.5}
robots: {robot_a: {x: 1.0, y: 2.5, yaw: 0.1, body: none}}
"""


def stereo_bm(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Disparity [px] with columns for 24 px of it on both sides; negative: none."""
    pad = [cv2.copyMakeBorder(i, 0, 0, 24, 24, cv2.BORDER_REPLICATE) for i in (left, right)]
    matcher = cv2.StereoBM.create(16, 15)
    matcher.setUniquenessRatio(10)
    return matcher.compute(pad[0], pad[1])[:, 24:-24] / 16.0


@pytest.mark.parametrize("pair", ["horizontal", "vertical"])
@pytest.mark.parametrize("roll", [0.0, 0.15])
def test_disparity_agrees_with_true_depth(pair: str, roll: float) -> None:
    head = {"top": 0.10, "pitch": 0.2, "roll": roll, "height": 1.2}
    world = world_of(GEOMETRY, imaging={**CLEAN, "noise": 1.0}, head=head)
    images = world.render("robot_a", 0).images
    _, depth = world.look("robot_a", 0.0)
    true = world.stage.stereo["robot_a"].depth_disparity * np.mean(1.0 / depth, axis=0)
    if pair == "horizontal":
        found = stereo_bm(images["left"], images["right"])
    else:
        turned = [cv2.rotate(images[k], cv2.ROTATE_90_CLOCKWISE) for k in ("left", "top")]
        found = cv2.rotate(stereo_bm(*turned), cv2.ROTATE_90_COUNTERCLOCKWISE)
    # Where the block sees one surface.
    mixed = np.abs(cv2.blur(true, (15, 15)) - true) > 0.05
    clear = (found > 0.5) & (cv2.dilate(mixed.astype(np.uint8), np.ones((3, 3))) == 0)
    assert clear.mean() > 0.3
    error = (found - true)[clear]
    # StereoBM rounds up: 1/32 px.
    assert abs(np.median(error)) < 0.06
    assert np.median(np.abs(error)) < 0.1
    assert np.percentile(np.abs(error), 95) < 0.25


@pytest.mark.parametrize("camera", [0, 1, 2])
def test_rays_hit_the_room_at_its_position(camera: int) -> None:
    """Depths, transformed into the map with camera_info and mounting."""
    head = {"top": 0.08, "pitch": 0.4, "roll": -0.17, "yaw": 0.2, "forward": 0.1, "left": 0.05,
            "height": 2.1, "cx": 70.0, "cy": 63.0}  # fmt: skip
    world = world_of(
        GEOMETRY, furniture=[], imaging={**CLEAN, "samples": 1}, head=head,
        robots={"robot_a": {"x": 1.3, "y": 2.0, "yaw": 0.6}},
    )  # fmt: skip
    owner, depth = world.look("robot_a", 0.0, camera)
    assert (owner == -1).all()
    p = world.cameras["robot_a"][camera].model.p
    v, u = np.mgrid[:120, :160]
    # P maps a point of the left camera's frame to w * (u, v, 1), and w is the depth.
    flat = np.stack([u * depth[0], v * depth[0], depth[0]], axis=-1) - p[:, 3]
    optical = flat @ np.linalg.inv(p[:, :3]).T
    turn, lens = world.stage.stereo["robot_a"].robot_from_optical
    robot = optical @ turn.T + lens
    at = robot[..., :2] @ rotation_2d(0.6).T + [1.3, 2.0]
    room = world.scene.room
    gaps = np.abs(
        np.stack([at[..., 0], at[..., 0] - room.length, at[..., 1], at[..., 1] - room.width,
                  robot[..., 2], robot[..., 2] - room.height])
    ).min(axis=0)  # fmt: skip
    # But for the skirting board, 2 cm thick, every point is on the room's inside.
    assert (gaps < 0.0201).all()
    assert (gaps < 1e-3).mean() > 0.9


@pytest.mark.slow
def test_rectified_raw_images_equal_the_rectified_ones() -> None:
    plain = world_of(GEOMETRY, imaging=CLEAN)
    raw = world_of(GEOMETRY, imaging=CLEAN, head={"distortion": [-0.25, 0.08, 0.001, -0.002, 0.0]})
    assert raw.stage.raw["robot_a"]
    assert not plain.stage.raw["robot_a"]
    want = plain.render("robot_a", 0).images["left"].astype(float)
    model = raw.cameras["robot_a"][0].model
    maps = cv2.initUndistortRectifyMap(
        model.k, np.array(model.d), model.r, model.p[:, :3], (160, 120), cv2.CV_32FC1
    )
    got = cv2.remap(raw.render("robot_a", 0).images["left"], *maps, cv2.INTER_LINEAR)
    inside = (slice(15, 105), slice(20, 140))
    scale = want[inside].mean() / got[inside].mean()
    shift, _ = cv2.phaseCorrelate(want[inside], got[inside].astype(float) * scale)
    assert shift == pytest.approx((0.0, 0.0), abs=0.05)
    # Two interpolations soften it.
    assert np.corrcoef(want[inside].ravel(), got[inside].ravel())[0, 1] > 0.97


def test_calibration_files_define_the_camera(tmp_path: Path) -> None:
    def written(name: str, tx: float) -> str:
        document = {
            "image_width": 64, "image_height": 48, "distortion_model": "plumb_bob",
            "camera_matrix": {"data": [50.0, 0, 31, 0, 50.0, 25, 0, 0, 1]},
            "distortion_coefficients": {"data": [0.0] * 5},
            "rectification_matrix": {"data": [1.0, 0, 0, 0, 1, 0, 0, 0, 1]},
            "projection_matrix": {"data": [50.0, 0, 31, tx, 0, 50.0, 25, 0, 0, 0, 1, 0]},
        }  # fmt: skip
        (tmp_path / name).write_text(yaml.safe_dump(document))
        return name

    files = [written("left.yaml", 0.0), written("right.yaml", -6.0)]
    scene = tmp_path / "scene.yaml"
    scene.write_text(f"{{robots: {{a: }}, head: {{calibration: {files}}}}}")
    world = World(load_scene(scene))
    stereo = world.stage.stereo["a"]
    assert (stereo.width, stereo.baseline) == pytest.approx((64, 0.12))
    (tmp_path / "right.yaml").write_text("{}")
    with pytest.raises(ConfigError, match=r"right\.yaml: not a camera calibration"):
        World(load_scene(scene))


@pytest.mark.parametrize("count", [1, 4, 5, 9, 16])
def test_samples_of_a_pixel_form_a_latin_square(count: int) -> None:
    offsets = sample_offsets(count)
    want = (np.arange(count) + 0.5) / count - 0.5
    for axis in (0, 1):
        assert np.sort(offsets[:, axis]) == pytest.approx(want)


# ------------------------------------------------------------------------------ images ----

PEOPLE = """
seed: 5
timing: {frames: 2}
room: {length: 6.0, width: 5.0}
people:
  - {x: 3.2, y: 2.5, yaw: 3.0}
  - {x: 5.0, y: 3.4, walks: true}
robots:
  robot_a: {x: 1.0, y: 2.5}
  robot_b: {x: 4.0, y: 0.6, yaw: 1.57, phase: 0.02}
"""


def test_the_same_seed_gives_the_same_images_in_any_order() -> None:
    one, two = world_of(PEOPLE, head=SMALL), world_of(PEOPLE, head=SMALL)
    ahead = {(n, k): one.render(n, k) for k in (0, 1) for n in one.names}
    back = {(n, k): two.render(n, k) for k in (1, 0) for n in reversed(two.names)}
    for key, frame in ahead.items():
        for camera, image in frame.images.items():
            np.testing.assert_array_equal(image, back[key].images[camera])
    other = world_of(PEOPLE, head=SMALL, seed=6).render("robot_a", 0)
    assert (other.images["left"] != ahead["robot_a", 0].images["left"]).mean() > 0.5


def test_images_have_the_requested_exposure_and_noise() -> None:
    quiet = world_of(PEOPLE, imaging={**CLEAN, "target": 90.0})
    noisy = world_of(PEOPLE, imaging={**CLEAN, "target": 90.0, "noise": 3.0})
    clean = quiet.render("robot_a", 0).images["left"].astype(float)
    assert clean.mean() == pytest.approx(90.0, rel=0.05)
    noise = noisy.render("robot_a", 0).images["left"] - clean
    assert noise[clean < 240].std() == pytest.approx(3.0, rel=0.1)


def test_cameras_differ_in_gain_and_offset() -> None:
    settings = {**CLEAN, "gain_difference": 0.1, "brightness_difference": 5.0}
    world = world_of(GEOMETRY, imaging=settings)
    left, right = world.cameras["robot_a"]
    assert left.gain != right.gain
    assert left.offset != right.offset
    clean = world_of(GEOMETRY, imaging=CLEAN).render("robot_a", 0).images["left"].astype(float)
    got = world.render("robot_a", 0).images["left"]
    dull = clean < 200
    assert got[dull] == pytest.approx(clean[dull] * left.gain + left.offset, abs=1.01)


def test_moving_objects_are_blurred_along_their_motion() -> None:
    robots = {"robot_a": {"path": [1.0, 2.5, 3.0, 2.5], "speed": 1.0, "head": {"yaw": 1.57}}}

    def sharpness(exposure: float) -> tuple[float, float]:
        settings = {**CLEAN, "samples": 16, "slices": 8, "exposure": exposure}
        image = world_of(GEOMETRY, robots=robots, imaging=settings).render("robot_a", 0)
        grey = image.images["left"].astype(float)
        return np.abs(np.diff(grey, axis=1)).mean(), np.abs(np.diff(grey, axis=0)).mean()

    (still_x, still_y), (moved_x, moved_y) = sharpness(0.0), sharpness(0.08)
    assert moved_x / still_x < 0.7
    assert moved_y / still_y > 1.2 * moved_x / still_x


def test_robot_sees_the_others_but_not_itself() -> None:
    robots = {"a": {"x": 1.0, "y": 2.5}, "b": {"x": 3.0, "y": 2.5, "yaw": 3.14}}
    world = world_of("{room: {length: 6.0, width: 5.0}}", robots=robots)
    assert set(np.unique(world.look("a", 0.0)[0])) == {-1, -11}
    assert set(np.unique(world.look("b", 0.0)[0])) == {-1, -10}


# ------------------------------------------------------------------------ ground truth ----


def test_pixels_of_a_person_are_those_of_the_left_cameras() -> None:
    world = world_of(
        PEOPLE,
        people=[{"x": 3.2, "y": 2.5}, {"x": 4.4, "y": 2.5}, {"x": 5.3, "y": 4.4}],
        furniture=[{"kind": "partition", "x": 2.2, "y": 2.5, "size": [0.1, 5.0, 2.8]}],
    )
    frame = world.render("robot_a", 0)
    assert frame.pixels.tolist() == [0, 0, 0]  # behind the partition
    owner, _ = world.look("robot_b", 0.02)
    want = [(owner == k).sum() / len(owner) for k in range(3)]
    assert world.render("robot_b", 0).pixels == pytest.approx(want)
    assert want[0] > 200


def test_near_and_visible_people_are_seen() -> None:
    """Three people, 2, 4 and 6 m ahead; a whole one has 0.57 m^2 of pixels."""
    robots = {name: {"x": 1.0, "y": 2.5, "head": {"height": 1.0}} for name in ("a", "b")}
    people = [{"x": 3.0, "y": 2.5}, {"x": 5.0, "y": 2.5}, {"x": 7.0, "y": 2.5}]
    world = world_of("{room: {length: 9.0, width: 5.0}}", robots=robots, people=people)
    f = world.stage.stereo["a"].fx
    quarter = 0.25 * 0.57 * f * f / np.array([4.0, 16.0, 36.0])
    image = {"left": np.zeros((2, 2), np.uint8)}

    def seen(a: list[float], b: list[float]) -> list[float]:
        frames = [RenderedFrame(n, 0, 0, image, np.array(p)) for n, p in (("a", a), ("b", b))]
        return world.seen_pixels(frames).tolist()

    nobody = [0.0, 0.0, 0.0]
    assert seen([*(0.95 * quarter)], nobody) == nobody
    at_least = [*(1.05 * quarter[:2]), 0.0]  # the third one is beyond 5 m
    assert seen([*(1.05 * quarter)], nobody) == at_least
    assert seen([*(1.05 * quarter)], [900.0, 0.0, 0.0]) == [900.0, at_least[1], 0.0]


def test_share_that_is_seen_is_that_of_the_robot_that_sees_most() -> None:
    robots = {name: {"x": 1.0, "y": 2.5, "head": {"height": 1.0}} for name in ("a", "b")}
    people = [{"x": 3.0, "y": 2.5}, {"x": 7.0, "y": 2.5}]
    world = world_of("{room: {length: 9.0, width: 5.0}}", robots=robots, people=people)
    f = world.stage.stereo["a"].fx
    whole = 0.57 * f * f / np.array([4.0, 36.0])
    image = {"left": np.zeros((2, 2), np.uint8)}
    frames = [RenderedFrame(n, 0, 0, image, s * whole) for n, s in (("a", 0.2), ("b", 0.6))]
    shares = world.seen_shares(frames)
    assert shares[0] == pytest.approx(0.6, rel=0.01)
    assert shares[1] == 0.0  # beyond 5 m
    message = Messages().percent(np.array([0.604, 0.0]))
    assert message.data.tolist() == [60, 0]
    assert message.layout.dim[0].label == "people_percent"


def test_visible_is_rounded_and_labelled() -> None:
    message = Messages().visible(np.array([3.4, 0.0, 9.6]))
    assert message.data.tolist() == [3, 0, 10]
    assert message.layout.dim[0].label == "people_pixels"


def test_person_appears_at_the_true_position() -> None:
    """From straight above, head and shoulders surround the point over the true place."""
    robots = {"a": {"x": 3.0, "y": 2.0, "head": {"height": 3.9, "pitch": 1.5708}}}
    people = [{"x": 3.4, "y": 2.3, "yaw": 1.0, "bag": "none", "pose": "hang"}]
    world = world_of("{room: {height: 4.0}}", robots=robots, people=people)
    place = world.person_places(0.0)[0]
    owner, depth = world.look("a", 0.0)
    camera = world.cameras["a"][0].model
    high = (owner[0] == 0) & (3.9 - depth[0] > 1.2)
    v, u = np.nonzero(high)
    x = 3.0 - (v - camera.p[1, 2]) / camera.p[1, 1] * depth[0][high]
    y = 2.0 - (u - camera.p[0, 2]) / camera.p[0, 0] * depth[0][high]
    assert (x.mean(), y.mean()) == pytest.approx((place.x, place.y), abs=0.06)
    assert (place.x, place.y) == pytest.approx((3.4, 2.3), abs=0.02)


# -------------------------------------------------------------------------------- bags ----

TEAM = """
name: team
seed: 9
timing: {frames: 3, rate: 10.0}
room: {length: 7.0, width: 6.0}
people: [{x: 3.0, y: 3.0}, {path: [2.0, 1.5, 5.0, 1.5]}]
head: {width: 80, height_px: 60, focal: 52.7}
odometry: {mode: drift}
robots:
  robot_a: {x: 5.0, y: 3.0, yaw: 3.14159, head: {top: 0.1, pitch: 0.2, roll: -0.1, height: 1.6}}
  robot_b: {path: [0.5, 3.0, 2.0, 3.0], phase: 0.013, head: {left: 0.05}}
"""


@pytest.fixture(scope="module")
def team(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, World]:
    out = tmp_path_factory.mktemp("bags") / "team"
    return out, simulate(scene_of(TEAM), out)


def test_bag_has_the_documented_topics_types_and_frames(team: tuple[Path, World]) -> None:
    out, _ = team
    image, info = "sensor_msgs/msg/Image", "sensor_msgs/msg/CameraInfo"
    with BagReader(out) as bag:
        kinds = {name: topic.type for name, topic in bag.topics.items()}
        counts = {name: topic.count for name, topic in bag.topics.items()}
        heads = {t: m.header for t, _, m in bag.decoded() if hasattr(m, "header")}
    cameras = {"robot_a": ("left", "right", "top"), "robot_b": ("left", "right")}
    wanted = {
        PEOPLE_TOPIC: "geometry_msgs/msg/PoseArray",
        VISIBLE_TOPIC: "std_msgs/msg/Int32MultiArray",
        PERCENT_TOPIC: "std_msgs/msg/Int32MultiArray",
        MAP_TOPIC: "nav_msgs/msg/OccupancyGrid",
    }
    for robot, names in cameras.items():
        wanted[f"/{robot}/odom"] = "nav_msgs/msg/Odometry"
        wanted[true_pose_topic(robot)] = "geometry_msgs/msg/PoseStamped"
        assert heads[f"/{robot}/odom"].frame_id == f"{robot}/odom"
        for name in names:
            wanted |= {f"/{robot}/{name}/image_rect": image, f"/{robot}/{name}/camera_info": info}
            frame = heads[f"/{robot}/{name}/image_rect"].frame_id
            assert frame == f"{robot}/{name}_camera_optical"
    assert kinds == wanted
    assert {t: c for t, c in counts.items() if "camera" in t or "image" in t or "people" in t} == {
        t: 3 for t in wanted if "camera" in t or "image" in t or "people" in t
    }
    assert heads[PEOPLE_TOPIC].frame_id == heads[MAP_TOPIC].frame_id == "map"
    assert counts[MAP_TOPIC] == 1


def test_map_of_a_bag_is_the_latched_floor_plan(team: tuple[Path, World]) -> None:
    out, world = team
    with BagReader(out) as bag:
        (qos,) = bag.topics[MAP_TOPIC].qos
        ((_, time_ns, message),) = bag.decoded([MAP_TOPIC])
    assert (qos.durability.name, qos.reliability.name, qos.depth) == (
        "TRANSIENT_LOCAL", "RELIABLE", 1,
    )  # fmt: skip
    assert time_ns == world.stamp_ns(0.0)
    grid = read_occupancy_grid(message, "map")
    plan = floor_plan(world.scene.room, world.scene.furniture)
    assert (grid.x, grid.y, grid.yaw) == (plan.x, plan.y, plan.yaw)
    assert grid.resolution == pytest.approx(plan.resolution)  # float32 on the wire
    np.testing.assert_array_equal(grid.data, plan.data)


def test_floor_plan_matches_hand_computed_values() -> None:
    room = Room(length=4.0, width=3.0)
    turned = Furniture(kind="shelf", x=2.0, y=1.5, yaw=math.pi / 6, size=(0.4, 1.0, 1.9))
    sheet = Furniture(kind="sign", x=1.0, y=0.5, size=(0.001, 0.5, 1.0))
    plan = floor_plan(room, [turned, sheet])
    assert (plan.resolution, plan.x, plan.y, plan.yaw) == (0.05, -0.15, -0.15, 0.0)
    assert plan.data.shape == (66, 86)

    def at(x: float, y: float) -> int:
        return int(plan.data[int((y + 0.15) / 0.05), int((x + 0.15) / 0.05)])

    assert [at(x, 1.0) for x in (-0.1, -0.01, 0.01, 3.99, 4.01, 4.1)] == [100, 100, 0, 0, 100, 100]
    assert [at(1.0, y) for y in (-0.01, 0.01, 2.99, 3.01)] == [100, 0, 0, 100]
    # The shelf: 0.4 m wide along its x, which is turned by 30 degrees, 1 m along its y.
    c, s = math.cos(math.pi / 6), math.sin(math.pi / 6)
    for along, across, occupied in ((0.15, 0.45, True), (0.25, 0.0, False), (0.0, 0.55, False)):
        place = (2.0 + c * along - s * across, 1.5 + s * along + c * across)
        assert (at(*place) == 100) == occupied
    assert plan.data[3:-3, 3:-3].mean() / 100 * 12.0 == pytest.approx(0.4 + 0.5 * 0.05, rel=0.15)


def test_bag_has_the_rendered_images_with_stamps_and_truth(team: tuple[Path, World]) -> None:
    out, world = team
    stamps: dict[str, list[int]] = {}
    with BagReader(out) as bag:
        for topic, time_ns, message in bag.decoded():
            if hasattr(message, "header"):
                stamps.setdefault(topic, []).append(stamp_ns_of(message.header.stamp))
                assert stamps[topic][-1] == time_ns
            if topic == "/robot_b/left/image_rect" and len(stamps[topic]) == 2:
                want = world.render("robot_b", 1).images["left"]
                np.testing.assert_array_equal(read_image(message), want)
            if topic == "/robot_a/top/camera_info":
                top = read_camera_info(message)
            if topic == "/robot_a/right/camera_info":
                right = read_camera_info(message)
            if topic == "/robot_a/left/camera_info":
                left = read_camera_info(message)
            if topic == PEOPLE_TOPIC:
                time = (time_ns - world.stamp_ns(0.0)) * 1e-9
                got = [[p.position.x, p.position.y] for p in message.poses]
                assert got == pytest.approx(motion.positions(world.person_places(time)), abs=1e-6)
            if topic == VISIBLE_TOPIC:
                assert message.layout.dim[0].label == "people_pixels"
                assert len(message.data) == 2
                assert message.data.max() > 50
    base = world.stamp_ns(0.0)
    frames = [base + k * 100_000_000 for k in range(3)]
    assert stamps["/robot_a/left/image_rect"] == stamps["/robot_a/top/camera_info"] == frames
    late = [ns + 13_000_000 for ns in frames]
    assert stamps["/robot_b/right/image_rect"] == late
    # The truth carries the stamp of the frame's newest image, as the planner's output does.
    assert stamps[PEOPLE_TOPIC] == late
    assert stamps["/robot_b/odom"][0] < frames[0]
    assert stamps["/robot_b/odom"][-1] > late[-1]
    camera = StereoCamera.from_models(left, right, top)
    assert (camera.baseline, camera.vertical_baseline) == pytest.approx((0.1, 0.1))


def test_team_file_places_robots_at_their_true_poses(team: tuple[Path, World]) -> None:
    out, world = team
    config = load_team(team_file(out))
    assert config.planner.robots == ("robot_a", "robot_b")
    assert config.robots["robot_a"].images.top
    assert not config.robots["robot_b"].images.top
    for name, settings in config.robots.items():
        assert settings.mounting == world.stage.stereo[name].mounting
        x0, y0, yaw0 = settings.pose.map_from_odom
        with BagReader(out) as bag:
            _, _, reported = next(bag.decoded([f"/{name}/odom"]))
            _, _, true = next(bag.decoded([true_pose_topic(name)]))
        pose = read_pose(reported)
        at = np.array([x0, y0]) + rotation_2d(yaw0) @ [pose.x, pose.y]
        assert at == pytest.approx([true.pose.position.x, true.pose.position.y], abs=0.06)


@pytest.mark.slow
def test_several_processes_render_the_same_as_one(tmp_path: Path) -> None:
    scene = scene_of(TEAM)
    simulate(scene, tmp_path / "one")
    simulate(scene, tmp_path / "two", jobs=2)
    with BagReader(tmp_path / "one") as one, BagReader(tmp_path / "two") as two:
        assert list(one.messages()) == list(two.messages())


def test_existing_bag_is_kept(tmp_path: Path, team: tuple[Path, World]) -> None:
    (tmp_path / "team").mkdir()
    with pytest.raises(BagError, match="exists already"):
        simulate(scene_of(TEAM), tmp_path / "team")


# ----------------------------------------------------------------------------- command ----


def test_command_writes_a_bag_and_its_team(tmp_path: Path) -> None:
    scene = tmp_path / "scene.yaml"
    scene.write_text(TEAM)
    out = tmp_path / "deep" / "out.mcap"
    arguments = ["simulate", str(scene), str(out), "--frames", "1", "--seed", "3", "-j", "1"]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 0, result.output
    assert "1 frame of 2 robots and 2 people" in result.output
    assert team_file(out).name == "out.yaml"
    with BagReader(out) as bag:
        assert bag.topics["/robot_a/left/image_rect"].count == 1


@pytest.mark.parametrize(
    ("arguments", "code", "part"),
    [
        (["SCENE"], 2, "OUT"),
        (["none.yaml", "out"], 1, "there is no such file"),
    ],
)
def test_command_reports_errors(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, arguments: list[str], code: int, part: str
) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.yaml").write_text(TEAM)
    arguments = [a.replace("SCENE", "scene.yaml") for a in arguments]
    result = CliRunner().invoke(app, ["simulate", *arguments])
    assert result.exit_code == code
    assert part in result.output + result.stderr
    assert not Path("out").exists()


@pytest.mark.parametrize(
    ("scene", "hint"),
    [
        ({"timing": {"frames": 100_000, "rate": 0.1}}, "last 999990 s; allowed: 3600"),
        ({"people": [{"path": [0, 0, 1e12, 0]}]}, "people: path is 1000000000000 m long; allowed"),
        ({"walk": {"path": [0, 0, 1e12, 0]}}, "walk: path is 1000000000000 m long; allowed: 10000"),
    ],
)
def test_scenes_above_the_memory_limit_are_refused(scene, hint):
    with pytest.raises(ConfigError, match=hint):
        read_scene(scene, "scene")

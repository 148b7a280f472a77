"""Meshes of the user's own in the simulator: made here, nothing is fetched."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
import yaml
from numpy.typing import NDArray

from mrs_people_loc.errors import BagError, ConfigError

pytest.importorskip("rosbags.interfaces", reason="writing bags needs rosbags")
pytest.importorskip("typer", reason="the mrs command needs typer")
pytest.importorskip("embreex", reason="ray casting needs embreex, the extra sim")
pytest.importorskip("collada", reason="COLLADA needs pycollada, the extra sim")
pytest.importorskip("trimesh", reason="meshes need trimesh, the extra sim")

import trimesh
from PIL import Image
from typer.testing import CliRunner

from mrs_tools.bags.rosbag import BagReader, BagWriter, default_typestore
from mrs_tools.bags.truth import ASSETS_TOPIC
from mrs_tools.cli import app
from mrs_tools.fitting.examples import assets_of
from mrs_tools.simulation.layouts import expand
from mrs_tools.simulation.models.assets import Assets, Shape, with_assets
from mrs_tools.simulation.models.mesh_body import MeshBody
from mrs_tools.simulation.models.meshes import Mesh
from mrs_tools.simulation.models.textures import Atlas
from mrs_tools.simulation.motion import Place
from mrs_tools.simulation.render_scene import simulate, team_file
from mrs_tools.simulation.scene import Scene, load_scene, read_scene
from mrs_tools.simulation.views.ray_casting import Caster, Light
from mrs_tools.simulation.views.world import World
from mrs_tools.simulation.writer import PEOPLE_TOPIC

ROOT = Path(__file__).resolve().parents[4]
#: The chest's image by quarters, as seen by an observer in front of the person: sRGB values.
UPPER_LEFT, UPPER_RIGHT, LOWER_LEFT, LOWER_RIGHT = 255, 128, 64, 0
#: Their reflectance, by the definition of sRGB; black is kept at 0.01, white at 0.98.
REFLECTANCE = {255: 0.98, 128: 0.2159, 64: 0.0513, 0: 0.01}
#: How far the head of the made person is ahead of the trunk [m].
AHEAD = 0.10


def chest() -> Image.Image:
    image = np.zeros((64, 64, 3), dtype=np.uint8)
    image[:32, :32], image[:32, 32:] = UPPER_LEFT, UPPER_RIGHT
    image[32:, :32], image[32:, 32:] = LOWER_LEFT, LOWER_RIGHT
    return Image.fromarray(image)


def made_person(*, crossed: bool = False, tall: float = 1.75) -> trimesh.Scene:
    """A person of boxes in the frame of glTF: y up, facing z, their left side along x."""
    parts = []

    def add(low: tuple, high: tuple, colour: int) -> None:
        box = trimesh.creation.box(bounds=[low, high])
        box.visual.face_colors = [colour, colour, colour, 255]
        parts.append(box)

    add((-0.09, 1.50, -0.10 + AHEAD), (0.09, 1.75, 0.10 + AHEAD), 200)  # head
    add((-0.19, 0.85, -0.10), (0.19, 1.50, 0.10), 128)  # trunk
    inner = -0.06 if crossed else 0.04
    for side in (-1, 1):
        x = sorted((side * inner, side * 0.16))
        for low, high, ahead in ((0.0, 0.06, 0.17), (0.06, 0.85, 0.07)):  # foot, leg
            add((x[0], low, -0.07), (x[1], high, ahead), 90)
    corners = [
        (x, y, z)
        for z in (0.101, -0.101)  # on the chest and on the back
        for x, y in ((-0.19, 0.9), (0.19, 0.9), (0.19, 1.48), (-0.19, 1.48))
    ]
    faces = [(0, 1, 2), (0, 2, 3), (4, 5, 6), (4, 6, 7)]
    prints = trimesh.Trimesh(corners, faces, process=False)
    uv = [(0, 0), (1, 0), (1, 1), (0, 1)] * 2
    prints.visual = trimesh.visual.TextureVisuals(uv=uv, image=chest())
    scene = trimesh.Scene([prints, trimesh.util.concatenate(parts)])
    scene.apply_scale(tall / 1.75)
    return scene


def folder_of(
    folder: Path, name: str = "person.glb", mesh: trimesh.Scene | None = None, **line: object
) -> Path:
    """A folder with one person, and furniture: a crate, 0.5 x 0.9 x 1.1 m, in STL's frame."""
    folder.mkdir(exist_ok=True)
    (mesh or made_person()).export(folder / name)
    crate = trimesh.creation.box(extents=(0.5, 0.9, 1.1))
    crate.unmerge_vertices()
    crate.visual.vertex_colors = [100, 100, 100, 255]
    crate.export(folder / "crate.ply")
    mine = {"licence": "CC0-1.0", "origin": "made by the test"}
    document = {
        "people": [{"files": [name], **mine, **line}],
        "furniture": [{"files": ["*.ply"], **mine}],
    }
    (folder / "assets.yaml").write_text(yaml.safe_dump(document))
    return folder


def shape_of(folder: Path, file: str) -> Shape:
    return Assets(folder).shape(file)


def seen(
    mesh: Mesh, atlas: Atlas, origin: tuple, points: NDArray, pixel_angle: float = 1e-4
) -> NDArray:
    """Reflectance at points as seen from `origin`, in light from everywhere."""
    caster = Caster(mesh, atlas, Light(np.zeros((0, 3)), np.zeros(0), 1.0))
    directions = (points - np.array(origin)).astype(np.float32)
    light, _, _ = caster.look(np.array(origin), directions, pixel_angle)
    return light / 0.8  # of upright surfaces


@pytest.mark.parametrize("name", ["person.glb", "person.obj"])
def test_person_stands_on_the_floor_and_faces_x(tmp_path: Path, name: str) -> None:
    shape = shape_of(folder_of(tmp_path, name), name)
    vertices = shape.mesh.vertices
    assert shape.size == pytest.approx((0.301, 0.38, 1.75), abs=1e-3)
    assert vertices[:, 2].min() == pytest.approx(0.0, abs=1e-6)
    head = vertices[vertices[:, 2] > 1.6].mean(axis=0)
    hips = vertices[np.abs(vertices[:, 2] - 0.85) < 0.01].mean(axis=0)
    assert head[0] > hips[0] + 0.05  # bent ahead, and ahead is x
    # The place is between the middles of head and trunk.
    assert head[:2] == pytest.approx((AHEAD / 2, 0.0), abs=0.01)


def test_texture_lies_where_the_file_puts_it(tmp_path: Path) -> None:
    atlas = Atlas()
    mesh = shape_of(folder_of(tmp_path), "person.glb").drawn_from(atlas)
    front = float(mesh.vertices[np.abs(mesh.vertices[:, 2] - 1.48) < 0.01, 0].max())
    # The person's left side is on the right of an observer in front.
    points = np.array([(front, y, z) for z in (1.4, 1.0) for y in (-0.1, 0.1)])
    light = seen(mesh, atlas, (3.0, 0.0, 1.2), points)
    wanted = [UPPER_LEFT, UPPER_RIGHT, LOWER_LEFT, LOWER_RIGHT]
    assert light == pytest.approx([REFLECTANCE[value] for value in wanted], rel=0.02)


def test_coarse_pixels_see_the_mean_of_what_they_cover(tmp_path: Path) -> None:
    shape = shape_of(folder_of(tmp_path), "person.glb")
    # The image covers the chest once.
    assert shape.textures[1].size == pytest.approx([math.sqrt(0.38 * 0.58)] * 2, rel=1e-3)
    atlas = Atlas()
    mesh = shape.drawn_from(atlas)
    front = float(mesh.vertices[np.abs(mesh.vertices[:, 2] - 1.48) < 0.01, 0].max())
    light = seen(mesh, atlas, (3.0, 0.0, 1.2), np.array([(front, 0.0, 1.19)]), 0.5)
    assert light == pytest.approx(np.mean(list(REFLECTANCE.values())), rel=0.03)


@pytest.mark.parametrize("pixel_angle", [1e-4, 0.1])
def test_colours_without_an_image_are_seen(tmp_path: Path, pixel_angle: float) -> None:
    atlas = Atlas()
    mesh = shape_of(folder_of(tmp_path), "crate.ply").drawn_from(atlas)
    points = np.array([(0.25, 0.3, 0.7), (0.25, -0.2, 0.2)])
    light = seen(mesh, atlas, (3.0, 0.0, 0.5), points, pixel_angle)
    assert light == pytest.approx(0.1274, abs=0.001)  # sRGB 100


COLLADA = """<?xml version="1.0"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
 <asset><unit meter="0.01"/><up_axis>{up}</up_axis></asset>
 <library_images><image id="i"><init_from>../images/Paint.png</init_from></image></library_images>
 <library_effects><effect id="e"><profile_COMMON>
  <newparam sid="s"><surface type="2D"><init_from>i</init_from></surface></newparam>
  <newparam sid="p"><sampler2D><source>s</source></sampler2D></newparam>
  <technique sid="t"><lambert><diffuse><texture texture="p" texcoord="T"/></diffuse></lambert>
  </technique></profile_COMMON></effect></library_effects>
 <library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>
 <library_geometries><geometry id="g"><mesh>
  <source id="v"><float_array id="va" count="12">{corners}</float_array><technique_common>
   <accessor source="#va" count="4" stride="3"><param name="X" type="float"/>
   <param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common>
  </source>
  <source id="u"><float_array id="ua" count="8">0 0 1 0 1 1 0 1</float_array><technique_common>
   <accessor source="#ua" count="4" stride="2"><param name="S" type="float"/>
   <param name="T" type="float"/></accessor></technique_common></source>
  <vertices id="vs"><input semantic="POSITION" source="#v"/></vertices>
  <polylist count="1"{symbol}><input semantic="VERTEX" source="#vs" offset="0"/>
   <input semantic="TEXCOORD" source="#u" offset="1" set="0"/>
   <vcount>4</vcount><p>0 0 1 1 2 2 3 3</p></polylist></mesh></geometry></library_geometries>
 <library_visual_scenes><visual_scene id="w"><node><scale>2 2 2</scale>
  <instance_geometry url="#g"><bind_material><technique_common>
   <instance_material symbol="paint" target="#m"/></technique_common></bind_material>
  </instance_geometry></node></visual_scene></library_visual_scenes>
 <scene><instance_visual_scene url="#w"/></scene>
</COLLADA>"""
#: A board that faces x, 1 m wide and high: corners in units of 2 cm.
BOARD = {"Z_UP": "0 -25 0  0 25 0  0 25 50  0 -25 50", "Y_UP": "0 0 25  0 0 -25  0 50 -25  0 50 25"}


@pytest.mark.parametrize("up", BOARD)
@pytest.mark.parametrize("symbol", [' material="paint"', ""])
def test_collada_keeps_units_axes_and_textures(tmp_path: Path, up: str, symbol: str) -> None:
    (tmp_path / "meshes").mkdir()
    (tmp_path / "images").mkdir()
    chest().save(tmp_path / "images" / "Paint.png")
    text = COLLADA.format(up=up, corners=BOARD[up], symbol=symbol)
    (tmp_path / "meshes" / "board.dae").write_text(text)
    line = {"files": ["meshes/board.dae"], "licence": "CC0-1.0", "origin": "made by the test"}
    (tmp_path / "assets.yaml").write_text(yaml.safe_dump({"furniture": [line]}))
    shape = shape_of(tmp_path, "meshes/board.dae")
    assert shape.size == pytest.approx((0.0, 1.0, 1.0), abs=1e-4)
    atlas = Atlas()
    mesh = shape.drawn_from(atlas)
    points = np.array([(0.0, y, z) for z in (0.75, 0.25) for y in (-0.25, 0.25)])
    light = seen(mesh, atlas, (2.0, 0.0, 0.5), points)
    wanted = [UPPER_LEFT, UPPER_RIGHT, LOWER_LEFT, LOWER_RIGHT]
    assert light == pytest.approx([REFLECTANCE[value] for value in wanted], rel=0.02)
    (tmp_path / "images" / "Paint.png").unlink()
    with pytest.raises(ConfigError, match=r"board\.dae: its texture .*Paint\.png is missing"):
        shape_of(tmp_path, "meshes/board.dae")


def test_obj_has_its_texture_or_is_refused(tmp_path: Path) -> None:
    board = trimesh.Trimesh(
        [(-0.5, 0, 0), (0.5, 0, 0), (0.5, 1, 0), (-0.5, 1, 0)], [(0, 1, 2), (0, 2, 3)]
    )
    board.visual = trimesh.visual.TextureVisuals(uv=[(0, 0), (1, 0), (1, 1), (0, 1)], image=chest())
    board.export(folder_of(tmp_path) / "board.obj")
    line = {"files": ["board.obj"], "licence": "CC0-1.0", "origin": "made by the test"}
    (tmp_path / "assets.yaml").write_text(yaml.safe_dump({"furniture": [line]}))
    atlas = Atlas()
    mesh = shape_of(tmp_path, "board.obj").drawn_from(atlas)
    points = np.array([(0.0, y, z) for z in (0.75, 0.25) for y in (-0.25, 0.25)])
    light = seen(mesh, atlas, (2.0, 0.0, 0.5), points)
    wanted = [UPPER_LEFT, UPPER_RIGHT, LOWER_LEFT, LOWER_RIGHT]
    assert light == pytest.approx([REFLECTANCE[value] for value in wanted], rel=0.02)
    (tmp_path / "material_0.png").unlink()
    with pytest.raises(ConfigError, match=r"board\.obj: its file material_0\.png is missing"):
        shape_of(tmp_path, "board.obj")


def test_transparent_triangles_are_left_out(tmp_path: Path) -> None:
    image = np.full((64, 64, 4), 255, dtype=np.uint8)
    image[:, 32:, 3] = 0
    corners = [(0, y, z) for z in (0.0, 1.0) for y in (0.0, 0.5, 1.0)]
    card = trimesh.Trimesh(corners, [(0, 1, 4), (0, 4, 3), (1, 2, 5), (1, 5, 4)], process=False)
    card.visual = trimesh.visual.TextureVisuals(
        uv=[(y, z) for _, y, z in corners],
        material=trimesh.visual.material.PBRMaterial(baseColorTexture=Image.fromarray(image)),
    )
    folder_of(tmp_path)
    card.export(tmp_path / "card.glb")
    line = {"files": ["card.glb"], "licence": "CC0-1.0", "origin": "made", "up": "z"}
    (tmp_path / "assets.yaml").write_text(yaml.safe_dump({"furniture": [line]}))
    assert shape_of(tmp_path, "card.glb").size == pytest.approx((0.0, 0.5, 1.0), abs=1e-6)


# ------------------------------------------------------------------------------ walking ----


def feet(mesh: Mesh, standing: Mesh) -> float:
    """How far the left foot's sole is ahead of the right's [m]."""
    sole = standing.vertices[:, 2] < 0.001
    left = standing.vertices[:, 1] > 0
    return float(mesh.vertices[sole & left, 0].mean() - mesh.vertices[sole & ~left, 0].mean())


def body_of(folder: Path, height: float = 0.0) -> MeshBody:
    return MeshBody(shape_of(folder, "person.glb").drawn_from(Atlas()), height)


def test_legs_alternate_while_walking(tmp_path: Path) -> None:
    body = body_of(folder_of(tmp_path))
    speed = 1.0
    stride = (0.55 + 0.48 * speed) * 1.75 / 1.7
    standing = body.mesh(Place(0.0, 0.0, 0.0, 0.0, 0.0), 0.0)
    for way, step in ((0.25, 0.5), (0.5, 0.0), (0.75, -0.5)):
        mesh = body.mesh(Place(0.0, 0.0, 0.0, speed, way * stride), 0.0)
        assert feet(mesh, standing) == pytest.approx(step * stride, abs=1e-3)
    for way in np.linspace(0.0, stride, 7):
        mesh = body.mesh(Place(0.0, 0.0, 0.0, speed, float(way)), 0.0)
        assert mesh.vertices[:, 2].min() == pytest.approx(0.0, abs=1e-6)
        head = mesh.vertices[mesh.vertices[:, 2] > 1.6]
        assert head[:, 0].mean() == pytest.approx(AHEAD / 2, abs=0.01)


def test_crossed_legs_stay(tmp_path: Path) -> None:
    body = body_of(folder_of(tmp_path, mesh=made_person(crossed=True)))
    standing = body.mesh(Place(1.0, 2.0, 0.5, 0.0, 0.0), 0.0)
    walking = body.mesh(Place(1.0, 2.0, 0.5, 1.0, 0.4), 0.0)
    assert walking.vertices == pytest.approx(standing.vertices)


def test_height_of_a_person_scales_the_mesh(tmp_path: Path) -> None:
    body = body_of(folder_of(tmp_path), height=1.5)
    mesh = body.mesh(Place(0.0, 0.0, 0.0, 0.0, 0.0), 0.0)
    assert np.ptp(mesh.vertices, axis=0) == pytest.approx(
        np.array([0.301, 0.38, 1.75]) * 1.5 / 1.75, abs=1e-3
    )


# ------------------------------------------------------------------------------- scenes ----


def scene_with(folder: Path | str, **sections: object) -> Scene:
    document = {
        "name": "made",
        "timing": {"frames": 1},
        "robots": {"robot_a": {"x": 1.0, "y": 3.5}},
        "head": {"width": 80, "height_px": 60, "focal": 52.7},
        "people": [{"x": 4.0, "y": 3.5, "yaw": 3.0}, {"x": 3.5, "y": 2.8, "yaw": 1.0}],
        "furniture": [{"kind": "cabinet", "x": 5, "y": 5}, {"kind": "pillar", "x": 7, "y": 1}],
        "assets": str(folder),
        **sections,
    }  # fmt: skip
    return read_scene(document, "scene.yaml")


def test_bag_has_the_same_truth_and_names_the_assets(tmp_path: Path) -> None:
    scene = scene_with(folder_of(tmp_path / "assets"))
    meshes, ours = tmp_path / "meshes", tmp_path / "ours"
    simulate(scene, meshes)
    simulate(dataclasses.replace(scene, assets=""), ours)
    truths = []
    for bag in (meshes, ours):
        with BagReader(bag) as reader:
            truths.append([raw.data for raw in reader.messages([PEOPLE_TOPIC])])
            lists = [message.data for _, _, message in reader.decoded([ASSETS_TOPIC])] \
                if ASSETS_TOPIC in reader.topics else []  # fmt: skip
        if bag is meshes:
            (text,) = lists
            assert {"file": "person.glb", "licence": "CC0-1.0", "origin": "made by the test"} in (
                yaml.safe_load(text)
            )
            assert "made by the test (CC0-1.0)" in team_file(bag).read_text()
        else:
            assert lists == []
            assert "CC0" not in team_file(bag).read_text()
    assert truths[0] == truths[1]
    mine = {"licence": "CC0-1.0", "origin": "made by the test"}
    assert {"file": "person.glb", **mine} in assets_of([ours, meshes, meshes])
    assert len(assets_of([meshes, meshes])) == len(assets_of([meshes])) <= 2
    assert assets_of([ours]) == []


@pytest.mark.parametrize("text", ["- person.glb", "people: 1", "- {licence: MIT}", "["])
def test_list_of_assets_that_is_none_is_refused(tmp_path: Path, text: str) -> None:
    message = default_typestore().types["std_msgs/msg/String"](data=text)
    with BagWriter(tmp_path / "bag.mcap") as bag:
        bag.add_topic(ASSETS_TOPIC, "std_msgs/msg/String")
        bag.write(ASSETS_TOPIC, 1, message)
    with pytest.raises(BagError, match=r"bag\.mcap: /ground_truth/assets is no list of meshes"):
        assets_of([tmp_path / "bag.mcap"])


def test_robot_sees_the_mesh_where_the_truth_says(tmp_path: Path) -> None:
    world = World(with_assets(scene_with(folder_of(tmp_path))))
    owner, depth = world.look("robot_a", 0.0)
    middle = depth[owner == 0]
    # The person faces the robot from 3 m; the surface is some centimetres in front of the axis.
    assert len(middle) > 50
    assert np.median(middle) == pytest.approx(3.0 - 0.05, abs=0.08)


def test_height_in_the_scene_counts(tmp_path: Path) -> None:
    folder = folder_of(tmp_path)
    pixels = []
    for height in (1.3, 1.9):
        person = {"x": 5.0, "y": 3.5, "height": height}
        world = World(with_assets(scene_with(folder, people=[person], furniture=[])))
        owner, _ = world.look("robot_a", 0.0)
        pixels.append((owner == 0).sum())
    assert pixels[1] / pixels[0] == pytest.approx((1.9 / 1.3) ** 2, rel=0.15)


def test_layout_draws_meshes_by_its_seed(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "assets")
    document = yaml.safe_load((folder / "assets.yaml").read_text())
    made_person(tall=1.6).export(folder / "other.glb")
    document["people"].append({**document["people"][0], "files": ["other.glb"]})
    (folder / "assets.yaml").write_text(yaml.safe_dump(document))
    layout = {"people": 8, "robots": 1, "activity": "stand"}
    drawn = {
        seed: [
            person.mesh
            for person in with_assets(
                expand(scene_with(folder, people=[], layout=layout, seed=seed))
            ).people
        ]
        for seed in (1, 1, 2, 3)
    }
    again = with_assets(expand(scene_with(folder, people=[], layout=layout, seed=1))).people
    assert [person.mesh for person in again] == drawn[1]
    assert set(drawn[1]) == {"person.glb", "other.glb"}
    assert len({tuple(meshes) for meshes in drawn.values()}) == 3


def test_furniture_of_like_size_is_replaced(tmp_path: Path) -> None:
    folder = folder_of(tmp_path)
    drawn = [with_assets(scene_with(folder, seed=seed)).furniture for seed in range(12)]
    assert {cabinet.mesh for cabinet, _ in drawn} == {"crate.ply", ""}
    assert {pillar.mesh for _, pillar in drawn} == {""}  # no mesh is as high
    for cabinet, _ in drawn:
        assert cabinet.size == ((0.5, 0.9, 1.1) if cabinet.mesh else ())


def test_named_mesh_stays(tmp_path: Path) -> None:
    folder = folder_of(tmp_path)
    scene = scene_with(
        folder, furniture=[{"kind": "pillar", "x": 6.0, "y": 2.0, "mesh": "crate.ply"}]
    )
    world = World(with_assets(scene))
    assert list(world.assets) == ["crate.ply", "person.glb"]


@pytest.mark.parametrize(
    ("change", "part"),
    [
        ({"files": ["nobody*.glb"]}, "no file nobody*.glb"),
        ({"files": ["/etc/passwd"]}, "is not below the folder"),
        ({"files": ["../*/person.glb"]}, "is not below the folder"),
        ({"files": []}, "has no files"),
        ({"licence": ""}, "has no licence"),
        ({"origin": ""}, "has no origin"),
        ({"up": "x"}, "up is 'x'"),
        ({"size": 2}, "unknown parameter size"),
        ({"scale": 100.0}, "person.glb: is 175 m tall; allowed: 1.2 to 2.2 m"),
        ({"up": "z"}, "person.glb: is 0.301 m tall"),
        ({"files": ["assets.yaml"]}, "is no mesh that can be read; allowed: .dae"),
        ({"files": ["broken.glb"]}, "broken.glb: cannot be read as a mesh"),
        ({"files": ["broken.dae"]}, "broken.dae: cannot be read as a mesh"),
        ({"files": ["bare.stl"]}, "bare.stl: has neither textures nor colours"),
    ],
)
def test_bad_assets_are_refused_by_name(tmp_path: Path, change: dict, part: str) -> None:
    folder = folder_of(tmp_path)
    (folder / "broken.glb").write_bytes(b"glTF but not really")
    (folder / "broken.dae").write_text("<COLLADA")
    trimesh.creation.box().export(folder / "bare.stl")
    document = yaml.safe_load((folder / "assets.yaml").read_text())
    document["people"][0].update(change)
    (folder / "assets.yaml").write_text(yaml.safe_dump(document))
    with pytest.raises(ConfigError) as error:
        World(with_assets(scene_with(folder)))
    assert part in str(error.value)
    assert str(folder) in str(error.value)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        (None, "there is no such file"),
        ("[]", "wanted: a mapping with people and furniture"),
        ("chairs: []", "wanted: a mapping with people and furniture"),
        ("people: []", "names neither people nor furniture"),
        ("people: person.glb", "people is 'person.glb'; wanted: a list"),
        ("people: [person.glb]", "people[0] is 'person.glb'; wanted: a mapping"),
    ],
)
def test_bad_list_is_refused(tmp_path: Path, text: str | None, part: str) -> None:
    if text is not None:
        (tmp_path / "assets.yaml").write_text(text)
    with pytest.raises(ConfigError) as error:
        with_assets(scene_with(tmp_path))
    assert part in str(error.value)
    assert "assets.yaml" in str(error.value)


def test_folder_that_is_not_there_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match="is not a folder with assets"):
        with_assets(scene_with(tmp_path / "nowhere"))


def test_mesh_without_a_folder_is_refused() -> None:
    scene = scene_with("", people=[{"x": 4.0, "y": 3.0, "mesh": "person.glb"}])
    with pytest.raises(ConfigError, match=r"mesh 'person.glb' needs a folder of assets"):
        with_assets(scene)


@pytest.mark.parametrize(
    ("section", "file"),
    [("people", "nobody.glb"), ("people", "crate.ply"), ("furniture", "person.glb")],
)
def test_mesh_that_the_list_does_not_name_is_refused(
    tmp_path: Path, section: str, file: str
) -> None:
    scene = scene_with(folder_of(tmp_path), **{section: [{"x": 4.0, "y": 3.0, "mesh": file}]})
    with pytest.raises(ConfigError, match=rf"names no mesh '{file}' of {section}"):
        with_assets(scene)


# ------------------------------------------------------------------------------ commands ----


def test_command_renders_with_the_assets(tmp_path: Path) -> None:
    folder = folder_of(tmp_path / "assets")
    scene = ROOT / "mrs_people_loc" / "scenes" / "single_person.yaml"
    arguments = ["simulate", str(scene), str(tmp_path / "out"), "--frames", "1", "-j", "1"]
    result = CliRunner().invoke(app, [*arguments, "--assets", str(folder)])
    assert result.exit_code == 0, result.output
    assert [item["file"] for item in assets_of([tmp_path / "out"])] == ["person.glb"]


def test_command_reports_a_folder_that_is_not_there(tmp_path: Path) -> None:
    scene = ROOT / "mrs_people_loc" / "scenes" / "single_person.yaml"
    nowhere = tmp_path / "nowhere"
    arguments = ["simulate", str(scene), str(tmp_path / "out"), "--assets", str(nowhere)]
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 1
    assert "is not a folder with assets" in " ".join((result.output + result.stderr).split())
    assert not (tmp_path / "out").exists()


def test_scene_file_names_the_folder_relative_to_itself(tmp_path: Path) -> None:
    folder_of(tmp_path / "assets")
    (tmp_path / "scene.yaml").write_text("assets: assets\npeople: [{x: 3.0, y: 3.0}]\n")
    (person,) = with_assets(load_scene(tmp_path / "scene.yaml")).people
    assert person.mesh == "person.glb"
    assert person.height == pytest.approx(1.75, rel=0.051)

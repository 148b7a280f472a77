"""The simulator's variety: furniture of lived-in rooms, varied people and varied heads."""

from __future__ import annotations

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest

from mrs_people_loc.errors import ConfigError

pytest.importorskip("rosbags.interfaces", reason="writing bags needs rosbags")
pytest.importorskip("embreex", reason="ray casting needs embreex, the extra sim")

from mrs_people_sim.layouts import expand
from mrs_people_sim.models.human_body import HumanBody
from mrs_people_sim.models.interiors import HANGING, MAKERS, WALLED
from mrs_people_sim.models.meshes import Mesh, merge
from mrs_people_sim.models.rooms import SIZES, furniture_mesh
from mrs_people_sim.models.textures import Atlas
from mrs_people_sim.motion import Place
from mrs_people_sim.scene import FURNITURE, Furniture, Person, Scene, read_scene
from mrs_people_sim.views.ray_casting import Solid
from mrs_people_sim.views.world import World
from mrs_studies.suite_scenes import suite_scenes, variants

SUITE = Path(__file__).resolve().parents[3] / "config" / "scenes" / "suite.yaml"


def piece_mesh(seed: int = 3, **piece: object) -> Mesh:
    """A piece of furniture at the origin."""
    kind = Furniture.from_mapping(piece)
    return furniture_mesh(kind, np.random.default_rng(seed), Atlas(), 1.0)


def hit(mesh: Mesh, origin: tuple[float, ...], direction: tuple[float, ...]) -> float:
    """How far a ray goes before it hits the mesh [m]; infinity: it does not."""
    solid = Solid(mesh)
    triangle, distance, _ = solid.cast(
        np.array([origin], dtype=np.float32), np.array([direction], dtype=np.float32)
    )
    return float(distance[0]) if triangle[0] >= 0 else math.inf


# ------------------------------------------------------------------------------ furniture ----


def test_unknown_kind_of_furniture_is_refused_with_the_allowed_ones() -> None:
    with pytest.raises(ConfigError) as error:
        read_scene({"furniture": [{"kind": "wardrobes"}]}, "scene.yaml")
    assert all(kind in str(error.value) for kind in FURNITURE)
    assert set(MAKERS) < set(FURNITURE)


def test_every_kind_of_furniture_is_documented() -> None:
    text = (SUITE.parent / "README.md").read_text()
    assert [kind for kind in FURNITURE if f"`{kind}`" not in text] == []


@pytest.mark.parametrize("kind", list(MAKERS))
@pytest.mark.parametrize("scale", [1.0, 0.7])
def test_a_piece_has_its_size(kind: str, scale: float) -> None:
    size = [edge * scale for edge in SIZES[kind]]
    if kind in ("door", "doorway"):
        size[1:] = SIZES[kind][1:]
    for seed in range(4):
        vertices = piece_mesh(seed, kind=kind, size=size).vertices
        width = np.ptp(vertices[:, 1])
        # Sleeves, sills and cornices stick out a little; things stand on top.
        assert width == pytest.approx(size[1], abs=0.2 if kind != "office_chair" else 0.35)
        assert 0.8 * size[2] < vertices[:, 2].max() < size[2] + 0.72
        assert np.ptp(vertices[:, 0]) < size[0] + 0.25


#: Front of the leaf or of its opening, of a door and of a doorway of usual sizes [m].
_DOOR_FRONT, _DOORWAY_FRONT = 0.08 - 0.03 + 0.021, 0.07 - 0.03 + 0.021


@pytest.mark.parametrize(
    ("piece", "origin", "direction", "distance", "tolerance"),
    [
        ({"kind": "door"}, (2, 0, 1), (-1, 0, 0), 2 - _DOOR_FRONT, 1e-3),
        # Through an open one the ray reaches the wall's picture of another room ...
        ({"kind": "door", "open": 1.57}, (2, 0, 1), (-1, 0, 0), 2 + 0.07, 1e-3),
        # ... and the leaf sticks out of the wall by its width.
        ({"kind": "door", "open": 1.57}, (0.8, -2, 1), (0, 1, 0), 2 - 0.43, 0.9),
        ({"kind": "door"}, (0.8, -2, 1), (0, 1, 0), math.inf, 0),
        ({"kind": "doorway"}, (2, 0, 1), (-1, 0, 0), 2 - _DOORWAY_FRONT, 1e-3),
        ({"kind": "doorway", "open": 1.57}, (2, 0, 1), (-1, 0, 0), math.inf, 0),
        ({"kind": "doorway", "open": 1.57}, (2, 0.9, 1), (-1, 0, 0), 2 - 0.055, 1e-3),
        ({"kind": "doorway", "open": 1.57}, (2, 0, 2.4), (-1, 0, 0), 2 - 0.055, 1e-3),
        ({"kind": "corner"}, (2, 0, 1), (-1, 0, 0), 2 + 0.6 - 0.14, 1e-3),
        ({"kind": "corner"}, (0, -2, 1), (0, 1, 0), 2 + 0.6 - 0.14, 1e-3),
        ({"kind": "pier"}, (2, 0, 1), (-1, 0, 0), 2 - 0.175, 1e-3),
        ({"kind": "wardrobe"}, (2, 0.2, 1), (-1, 0, 0), 2 - 0.31, 1e-3),
        ({"kind": "curtain"}, (2, 0, 2.0), (-1, 0, 0), 2.0, 0.1),
        ({"kind": "covered_table"}, (0.1, 0.5, 2), (0, 0, -1), 1.25, 0.5),
        ({"kind": "covered_table"}, (2, 0, 0.6), (-1, 0, 0), 2 - 0.375, 0.12),
        ({"kind": "workplace"}, (0, 0, 0.4), (0, 0, 1), 0.3, 1e-3),
        ({"kind": "office_chair"}, (-2, 0, 0.8), (1, 0, 0), 2 - 0.28, 0.07),
        ({"kind": "coat_on_stand"}, (2, 0, 1.3), (-1, 0, 0), 2 - 0.19, 0.14),
        ({"kind": "water_cooler"}, (2, 0, 0.5), (-1, 0, 0), 2 - 0.165, 1e-3),
        ({"kind": "radiator"}, (2, 0.02, 0.5), (-1, 0, 0), 2 - 0.055, 0.04),
        ({"kind": "whiteboard"}, (2, 0.3, 1.5), (-1, 0, 0), 2 - 0.014, 2e-3),
        # Below the board and between the steps there is nothing.
        ({"kind": "whiteboard"}, (2, 0.3, 0.5), (-1, 0, 0), math.inf, 0),
        ({"kind": "ladder"}, (2, 0, 0.6), (-1, 0, 0), math.inf, 0),
        ({"kind": "rack"}, (2, 0.44, 1), (-1, 0, 0), 2 - 0.1975, 1e-3),
    ],
)
def test_a_ray_hits_a_piece_where_it_is(
    piece: dict[str, object],
    origin: tuple[float, ...],
    direction: tuple[float, ...],
    distance: float,
    tolerance: float,
) -> None:
    found = hit(piece_mesh(**piece), origin, direction)
    assert found == pytest.approx(distance, abs=tolerance)


@pytest.mark.parametrize("kind", list(MAKERS))
def test_a_piece_is_seen_by_a_level_head(kind: str) -> None:
    room = {"length": 6, "width": 6, "posters": 0, "doors": 0}
    robots = {"a": {"x": 5.4, "y": 3, "yaw": math.pi}}
    piece = {"kind": kind, "x": 3, "y": 3, "z": HANGING.get(kind, 0.0)}
    depths = []
    for furniture in ([], [piece]):
        scene = {"seed": 1, "room": room, "robots": robots, "furniture": furniture}
        _, depth = World(read_scene(scene, "scene.yaml")).look("a", 0.0)
        depths.append(depth[0])
    nearer = depths[1] < depths[0] - 0.5
    assert nearer.sum() > 150
    assert 1.5 < np.median(depths[1][nearer]) < 2.9


# ------------------------------------------------------------------------- random scenes ----


@pytest.fixture(scope="module")
def varied() -> list[Scene]:
    scenes = variants(suite_scenes(SUITE, "train"), 2)
    return [expand(scene) for scene in scenes]


def test_variants_use_every_kind_of_furniture(varied: list[Scene]) -> None:
    kinds = {piece.kind for scene in varied for piece in scene.furniture}
    assert kinds >= set(MAKERS)
    opened = [p.open for s in varied for p in s.furniture if p.kind in ("door", "doorway")]
    assert min(opened) == 0.0
    assert max(opened) > 1.2


def test_the_suite_has_the_kinds_that_it_was_published_with() -> None:
    for scene in suite_scenes(SUITE, "all"):
        full = expand(scene)
        assert not {piece.kind for piece in full.furniture} & set(MAKERS)
        assert {head.focal for head in full.heads.values()} == {105.46}
        assert {person.bag for person in full.people} == {"random"}
        assert {person.lean for person in full.people} == {0.0}


@pytest.mark.slow
def test_furniture_of_variants_stays_in_the_room(varied: list[Scene]) -> None:
    for scene in varied[::5]:
        room = np.array([scene.room.length, scene.room.width, scene.room.height])
        for piece in scene.furniture:
            vertices = furniture_mesh(piece, np.random.default_rng(0), Atlas(), 1.0).vertices
            # Things lie on top; leaves and sleeves may touch a wall.
            slack = [0.35, 0.35, 0.8]
            assert (vertices > np.negative(slack)).all(), (scene.name, piece)
            assert (vertices < room + slack).all(), (scene.name, piece)
            if piece.kind in WALLED:
                gap = min(piece.x, piece.y, room[0] - piece.x, room[1] - piece.y)
                assert gap == pytest.approx(piece.size[0] / 2 + 0.03)


@pytest.mark.slow
def test_nobody_stands_in_furniture_but_some_close_to_it(varied: list[Scene]) -> None:
    around = np.linspace(0.0, 2 * math.pi, 24, endpoint=False)
    sides = np.stack([np.cos(around), np.sin(around), 0 * around], axis=1).astype(np.float32)
    nearest = []
    for scene in varied:
        if scene.layout.activity not in ("stand", "talk", "close") or not scene.furniture:
            continue
        rng = np.random.default_rng(0)
        pieces = [furniture_mesh(piece, rng, Atlas(), 1.0) for piece in scene.furniture]
        solid = Solid(merge(pieces))
        for person in scene.people:
            for height in (0.4, 1.0, 1.5):
                origins = np.full((24, 3), (person.x, person.y, height), dtype=np.float32)
                triangle, distance, _ = solid.cast(origins, sides)
                nearest.append(distance[triangle >= 0].min(initial=9.0))
    assert min(nearest) > 0.15
    assert np.mean(np.array(nearest) < 0.6) > 0.05


def test_a_level_head_often_sees_a_near_person_from_the_knees_to_the_chest(
    varied: list[Scene],
) -> None:
    cut = []
    for scene in varied:
        for name, robot in scene.robots.items():
            head = scene.heads[name]
            for person in scene.people:
                away = math.dist((robot.x, robot.y), (person.x, person.y))
                bearing = math.atan2(person.y - robot.y, person.x - robot.x) - robot.yaw
                inside = abs(math.remainder(bearing, 2 * math.pi)) < math.atan(80 / head.focal)
                if away > 2.0 or not inside or person.path:
                    continue
                half = math.atan(60 / head.focal)
                low = head.height - away * math.tan(half + head.pitch)
                high = head.height + away * math.tan(half - head.pitch)
                cut.append(0.15 < low < 0.8 and 0.9 < high < 1.6)
    assert len(cut) > 60
    assert np.mean(cut) > 0.2


def test_varied_heads_are_in_their_ranges_and_mostly_level(varied: list[Scene]) -> None:
    heads = [head for scene in varied for head in scene.heads.values()]
    product = np.array([head.focal * head.baseline for head in heads])
    assert 4.99 < product.min() < 6.0
    assert 20.0 < product.max() <= 25.01
    assert np.percentile(product, 50) == pytest.approx(math.sqrt(5 * 25), rel=0.15)
    assert min(h.focal for h in heads) >= 80.0
    assert max(h.focal for h in heads) <= 400.0
    assert min(h.baseline for h in heads) >= 0.0499
    assert max(h.baseline for h in heads) <= 0.2501
    assert min(h.height for h in heads) >= 0.7
    assert 1.8 < max(h.height for h in heads) <= 2.4
    pitch = np.array([head.pitch for head in heads])
    assert pitch.min() < -0.1
    assert 0.4 < pitch.max() <= math.radians(30.01)
    level = [abs(h.pitch) < 0.1 and 0.75 < h.height < 1.3 for h in heads]
    assert 0.5 < np.mean(level) < 0.75


def test_a_varied_scene_depends_on_its_seed_alone() -> None:
    scene = variants(suite_scenes(SUITE, "train"), 1)[2]
    assert expand(scene) == expand(scene)
    other = expand(dataclasses.replace(scene, seed=scene.seed + 1))
    assert expand(scene).furniture != other.furniture
    name = next(iter(expand(scene).robots))
    images = [World(expand(scene)).render(name, 1).images["left"] for _ in range(2)]
    np.testing.assert_array_equal(*images)


# -------------------------------------------------------------------------------- people ----


def body_points(speed: float = 0.0, **person: object) -> np.ndarray:
    """Vertices of a person at the origin who faces x, shape (n, 3)."""
    looks = {"height": 1.75, "build": 1.0, "top": "pullover", "bottom": "trousers", "hair": "bald"}
    body = HumanBody(Person.from_mapping({**looks, "bag": "none", **person}), 5, Atlas())
    return np.asarray(body.mesh(Place(0.0, 0.0, 0.0, speed, 0.3), 0.0).vertices)


def test_a_box_is_before_the_chest_and_a_bag_beside_the_knee() -> None:
    plain = body_points(pose="behind")
    carried = body_points(bag="box")
    ahead = carried[carried[:, 0] > plain[:, 0].max() + 0.05]
    assert 0.9 < ahead[:, 2].min() < 1.15
    assert 1.1 < ahead[:, 2].max() < 1.5
    assert 0.3 < ahead[:, 0].max() < 0.75
    bag = body_points(bag="hand", pose="behind")
    aside = bag[np.abs(bag[:, 1]) > np.abs(plain[:, 1]).max() + 0.01]
    assert 0.2 < aside[:, 2].min() < 0.6


def test_a_coat_hangs_over_the_arm() -> None:
    coat = body_points(bag="coat", pose="behind")
    plain = body_points(pose="behind")
    coat, plain = (points[points[:, 2] > 0.3] for points in (coat, plain))
    before = coat[coat[:, 0] > plain[:, 0].max() + 0.03]
    assert 0.35 < before[:, 2].min() < 0.9
    assert before[:, 2].max() < 1.3


def test_raised_hands_are_above_the_head() -> None:
    points = body_points(pose="raised")
    assert points[:, 2].max() > 1.75 + 0.1


@pytest.mark.parametrize(("speed", "lean"), [(0.0, 0.06), (0.0, 0.3), (1.2, 0.06)])
def test_who_leans_has_the_head_ahead_and_the_hips_behind(speed: float, lean: float) -> None:
    def ahead(points: np.ndarray) -> tuple[float, float]:
        """Middle of the head and of the hips."""
        top = points[:, 2].max()
        low, high = (np.abs(points[:, 2] - z) < 0.03 for z in (0.93, top - 0.1))
        middle = np.abs(points[:, 1]) < 0.2
        return tuple(
            0.5 * (points[rows & middle, 0].min() + points[rows & middle, 0].max())
            for rows in (high, low)
        )

    straight = ahead(body_points(speed, pose="crossed"))
    leaning = ahead(body_points(speed, pose="crossed", lean=lean))
    assert leaning[0] - straight[0] == pytest.approx(lean / 2, abs=0.02)
    assert leaning[1] - straight[1] == pytest.approx(-lean / 2, abs=0.35 * lean + 0.02)


@pytest.mark.parametrize("hair", ["hat", "hood", "bun"])
def test_what_covers_the_head_is_on_the_head(hair: str) -> None:
    short, covered = body_points(hair="short"), body_points(hair=hair)
    np.testing.assert_array_equal(short[short[:, 2] < 1.3], covered[covered[:, 2] < 1.3])
    bare = body_points()
    bare, covered = bare[bare[:, 2] > 1.5], covered[covered[:, 2] > 1.5]
    assert np.ptp(covered, axis=0).prod() > 1.2 * np.ptp(bare, axis=0).prod()
    assert 1.72 < covered[:, 2].max() < 1.95

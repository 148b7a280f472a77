"""What the heads of a team see at one instant, fast enough to be rendered live.

In contrast to `World.render` there is no motion blur, pixels away from the outlines of people and
robots have one ray, and a body that walks has some poses per stride. What does not change is built
once: the room, the robots and each pose of each body are solids of their own, in their own frames,
to which the rays are moved.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Float32
from mrs_people_loc.geometry import wrap_angle
from mrs_people_loc.sensing.images import Gray
from mrs_people_sim.models.human_body import HumanBody
from mrs_people_sim.models.meshes import Int32
from mrs_people_sim.models.textures import Atlas
from mrs_people_sim.motion import Place
from mrs_people_sim.scene import Person
from mrs_people_sim.sensors.heads import Camera, expose
from mrs_people_sim.views.ray_casting import Light, Solid, Surface, shade
from mrs_people_sim.views.stage import Stage

#: Poses of a stride, and the speeds that they are kept for [m/s].
_POSES = 16
_SPEEDS = np.array([0.0, 0.2, 0.5, 0.9, 1.4])
#: So many poses are kept, of all bodies; each takes about 1 MB.
_KEPT = 400
#: Lamps farther away are left out [m].
_LIT = 20.0
#: Share by which the exposure follows the light from image to image.
_FOLLOWS = 0.2


@dataclass(frozen=True)
class _Thing:
    """A solid somewhere in the map.

    Attributes:
        solid: In its own frame.
        reach: Its largest distance from its z axis [m].
        top: Its greatest height [m].
        x: Where its frame is [m].
        y: Likewise.
        yaw: How that is turned [rad].
    """

    solid: Solid
    reach: float
    top: float
    x: float = 0.0
    y: float = 0.0
    yaw: float = 0.0

    def at(self, place: Place) -> _Thing:
        return dataclasses.replace(self, x=place.x, y=place.y, yaw=place.yaw)


def _thing(solid: Solid) -> _Thing:
    x, y, z = solid.mesh.vertices.T
    return _Thing(solid, float(np.hypot(x, y).max()), float(z.max()))


class _Eye:
    """The rays of a camera, sorted by their bearing in the robot's frame."""

    def __init__(self, stage: Stage, robot: str, camera: Camera) -> None:
        self.camera = camera
        turn, lens = stage.stereo[robot].robot_from_optical
        self._lens = lens + turn @ camera.centre
        self._samples = camera.rays @ turn.T.astype(np.float32)
        self._rays = self._samples.mean(axis=0)
        x, y, z = self._rays.T
        bearing = np.arctan2(y, x)
        self._order = np.argsort(bearing, kind="stable").astype(np.int32)
        self._bearing = bearing[self._order]
        self._slope = (z / np.maximum(np.hypot(x, y), np.float32(1e-6)))[self._order]

    def at(self, place: Place) -> tuple[NDArray, Float32]:
        """The lens [m], shape (3,), and the directions in the map, shape (n, 3)."""
        turn = _turn(place.yaw)
        origin = turn @ self._lens + [place.x, place.y, 0.0]
        return origin, self._rays @ turn.T.astype(np.float32)

    def samples(self, place: Place, pixels: NDArray) -> Float32:
        """Directions in the map of all samples of some pixels, shape (samples, pixels, 3)."""
        return self._samples[:, pixels] @ _turn(place.yaw).T.astype(np.float32)

    def towards(self, thing: _Thing, origin: NDArray, yaw: float) -> Int32:
        """Rays that may hit a thing; their indices.

        Args:
            thing: Where it is.
            origin: The lens in the map [m], shape (3,).
            yaw: Of the robot [rad].
        """
        away = math.hypot(thing.x - origin[0], thing.y - origin[1])
        if away <= thing.reach:
            return self._order
        half = math.asin(thing.reach / away)
        middle = math.atan2(thing.y - origin[1], thing.x - origin[0]) - yaw
        # The nearest of it is lowest in the view, and highest if it is higher than the lens.
        lens, rise = float(origin[2]), thing.top - float(origin[2])
        lowest = -lens / (away - thing.reach)
        highest = rise / (away - thing.reach if rise > 0.0 else away + thing.reach)
        parts = []
        for turn in (-2 * math.pi, 0.0, 2 * math.pi):
            low = wrap_angle(middle) + turn - half
            rows = slice(*np.searchsorted(self._bearing, (low, low + 2 * half)))
            slope = self._slope[rows]
            parts.append(self._order[rows][(slope >= lowest) & (slope <= highest)])
        return np.concatenate(parts)


def _turn(yaw: float) -> NDArray:
    c, s = math.cos(yaw), math.sin(yaw)
    return np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])


class LiveView:
    """The heads of a team in a scene whose people and robots are anywhere.

    Args:
        stage: The scene.
        people: Who is there.
        seed: Of the images' noise.
    """

    def __init__(self, stage: Stage, people: Sequence[Person], seed: int = 0) -> None:
        self._stage = stage
        self._bodies = stage.bodies(people)
        self._room = _thing(Solid(stage.room))
        self._robots = {
            name: _thing(Solid(mesh))
            for name, mesh in stage.robot_meshes.items()
            if len(mesh.triangles)
        }
        self._eyes = {
            name: [_Eye(stage, name, camera) for camera in cameras]
            for name, cameras in stage.cameras.items()
        }
        self._poses: dict[tuple[int, int, int], _Thing] = {}
        self._phase = np.zeros(len(people))
        self._before = np.full((len(people), 2), np.nan)
        self._exposure: dict[str, float] = {}
        self._rng = np.random.default_rng([seed, 16])
        self._seen: list[_Thing] = []
        self._places: Mapping[str, Place] = {}

    def move(self, people: Sequence[Place], robots: Mapping[str, Place]) -> None:
        """Takes everybody to where they are at the next instant.

        Args:
            people: In the order of the constructor; who is not there has a NaN position.
            robots: By name.
        """
        self._places = robots
        self._seen = []
        for k, place in enumerate(people):
            if math.isfinite(place.x):
                self._seen.append(self._body(k, place).at(place))

    def _body(self, k: int, place: Place) -> _Thing:
        """The pose of a body that is nearest to that of its gait."""
        body = self._bodies[k]
        speed = int(np.abs(_SPEEDS - abs(place.speed)).argmin())
        step = math.dist(self._before[k], (place.x, place.y))
        self._before[k] = place.x, place.y
        pace = float(_SPEEDS[speed])
        if step < 1.0:  # NaN at the first instant
            self._phase[k] += math.copysign(step / body.stride(pace), place.speed)
        pose = round(self._phase[k] * _POSES) % _POSES if speed else 0
        return self._pose(body, (k, speed, pose))

    def _pose(self, body: HumanBody, key: tuple[int, int, int]) -> _Thing:
        if key in self._poses:
            self._poses[key] = self._poses.pop(key)  # the least used is the first
        else:
            if len(self._poses) >= _KEPT:
                self._poses.pop(next(iter(self._poses)))
            k, speed, pose = key
            pace = float(_SPEEDS[speed])
            way = pose / _POSES * body.stride(pace)
            mesh = body.mesh(Place(0.0, 0.0, 0.0, pace, way), 0.0)
            self._poses[key] = _thing(Solid(mesh.owned_by(k)))
        return self._poses[key]

    def look(self, robot: str) -> tuple[dict[str, Gray], NDArray]:
        """What a robot sees at the instant of the last `move`.

        Returns:
            Images by camera, and how much of each person the left one shows [px], shape (people,).
        """
        place = self._places[robot]
        things = [
            *self._seen,
            *(t.at(self._places[name]) for name, t in self._robots.items() if name != robot),
        ]
        light = self._near(place)
        pixels = np.zeros(len(self._bodies), dtype=np.intp)
        seen = {}
        for eye in self._eyes[robot]:
            hits = self._hits(eye, place, things)
            seen[eye.camera.name] = self._light(eye, place, things, hits, light)
            if eye.camera.name == "left":
                pixels = hits.pixels(len(self._bodies))
        wanted = self._stage.scene.imaging.target / max(float(seen["left"].mean()), 1e-6)
        before = self._exposure.get(robot, wanted)
        self._exposure[robot] = exposure = before + _FOLLOWS * (wanted - before)
        imaging = self._stage.scene.imaging
        images = {
            e.camera.name: expose(seen[e.camera.name], e.camera, exposure, imaging, self._rng)
            for e in self._eyes[robot]
        }
        return images, pixels

    def _near(self, place: Place) -> Light:
        light = self._stage.light
        near = np.hypot(*(light.lamps[:, :2] - [place.x, place.y]).T) < _LIT
        return Light(light.lamps[near], light.power[near], light.ambient)

    def _hits(self, eye: _Eye, place: Place, things: Sequence[_Thing]) -> _Hits:
        """What the middle of each pixel shows."""
        origin, directions = eye.at(place)
        hits = _Hits(directions)
        hits.cast(self._room, origin, None)
        for thing in things:
            hits.cast(thing, origin, eye.towards(thing, origin, place.yaw))
        return hits

    def _light(
        self, eye: _Eye, place: Place, things: Sequence[_Thing], hits: _Hits, light: Light
    ) -> Float32:
        """Light of each pixel, shape (height, width).

        Args:
            eye: The camera.
            place: Where the robot is.
            things: What it sees besides the room.
            hits: What the middle of each pixel shows.
            light: What lights it.
        """
        origin, _ = eye.at(place)
        shape, samples = eye.camera.shade.shape, len(eye.camera.rays)
        angle = eye.camera.pixel_angle
        found = hits.light(origin, self._stage.atlas, light, angle * math.sqrt(samples))
        edges = _edges(hits.layer.reshape(shape))
        if samples > 1 and len(edges):
            finer = self._finer(eye, place, things, edges).light(
                origin, self._stage.atlas, light, angle
            )
            found[edges] = finer.reshape(samples, -1).mean(axis=0)
        return found.reshape(shape)

    def _finer(self, eye: _Eye, place: Place, things: Sequence[_Thing], pixels: NDArray) -> _Hits:
        """What all samples of some pixels show, by sample, then by pixel."""
        origin, _ = eye.at(place)
        directions = eye.samples(place, pixels)
        samples, count = directions.shape[:2]
        hits = _Hits(directions.reshape(-1, 3))
        hits.cast(self._room, origin, None)
        rows = np.full(len(eye.camera.rays[0]), -1, dtype=np.int32)
        rows[pixels] = np.arange(count)
        for thing in things:
            chosen = rows[eye.towards(thing, origin, place.yaw)]
            chosen = chosen[chosen >= 0]
            every = chosen + count * np.arange(samples, dtype=np.int32)[:, None]
            hits.cast(thing, origin, every.ravel())
        return hits


def _edges(layer: Int32) -> NDArray:
    """Indices of pixels one of whose neighbours shows another thing, shape (n,).

    Args:
        layer: What each shows, shape (height, width).
    """
    across, down = layer[:, 1:] != layer[:, :-1], layer[1:] != layer[:-1]
    edge = np.zeros(layer.shape, dtype=bool)
    edge[:, 1:] |= across
    edge[:, :-1] |= across
    edge[1:] |= down
    edge[:-1] |= down
    return np.flatnonzero(edge)


class _Hits:
    """What each ray hits first of several things.

    Args:
        directions: Of the rays in the map, length 1 along the optical axis, shape (n, 3).
    """

    def __init__(self, directions: Float32) -> None:
        count = len(directions)
        self._directions = directions
        self._things: list[_Thing] = []
        self.layer = np.full(count, -1, dtype=np.int32)
        self.depth = np.full(count, np.inf, dtype=np.float32)
        self._triangle = np.zeros(count, dtype=np.int32)
        self._u = np.zeros(count, dtype=np.float32)
        self._v = np.zeros(count, dtype=np.float32)

    def cast(self, thing: _Thing, origin: NDArray, chosen: Int32 | None) -> None:
        """Casts some rays, by index, or all, from a point at a thing."""
        rays = self._directions
        index = np.arange(len(rays)) if chosen is None else chosen
        if not len(index):
            return
        turn = _turn(-thing.yaw)
        start = (turn @ (origin - [thing.x, thing.y, 0.0])).astype(np.float32)
        directions = (rays if chosen is None else rays[chosen]) @ turn.T.astype(np.float32)
        starts = np.broadcast_to(start, directions.shape)
        triangle, depth, more = thing.solid.cast(starts, directions)
        nearer = np.flatnonzero((triangle >= 0) & (depth < self.depth[index]))
        index = index[nearer]
        self.layer[index] = len(self._things)
        self.depth[index] = depth[nearer]
        self._triangle[index] = triangle[nearer]
        self._u[index], self._v[index] = more["u"][nearer], more["v"][nearer]
        self._things.append(thing)

    def pixels(self, people: int) -> NDArray:
        """How many rays hit each person, shape (people,)."""
        owners = [thing.solid.mesh.owner[0] for thing in self._things]
        owner = np.array([*owners, -1])[self.layer]  # a ray that hits nothing has the layer -1
        return np.bincount(owner[owner >= 0], minlength=people)

    def light(self, origin: NDArray, atlas: Atlas, light: Light, pixel_angle: float) -> Float32:
        """Light that the rays from a point see, shape (n,); see `shade`."""
        seen = np.flatnonzero(self.layer >= 0)
        found = np.zeros(len(self.layer), dtype=np.float32)
        found[seen] = shade(
            self._surface(seen), atlas, light, origin.astype(np.float32), self._directions[seen],
            self.depth[seen], pixel_angle,
        )  # fmt: skip
        return found

    def _surface(self, seen: NDArray) -> Surface:
        """What the rays of these indices hit, in the map."""
        normal = np.empty((len(seen), 3), dtype=np.float32)
        uv = np.empty((len(seen), 2), dtype=np.float32)
        material = np.empty(len(seen), dtype=np.int32)
        layer = self.layer[seen]
        for k, thing in enumerate(self._things):
            of = np.flatnonzero(layer == k)
            if not len(of):
                continue
            at = seen[of]
            part = thing.solid.surface(self._triangle[at], self._u[at], self._v[at])
            normal[of] = part.normal @ _turn(thing.yaw).T.astype(np.float32)
            uv[of], material[of] = part.uv, part.material
        return Surface(normal, uv, material)

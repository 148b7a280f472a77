"""What a scene looks like: its room, bodies and cameras, wherever people and robots are.

Owners of triangles: -1 the room and its furniture, i >= 0 person i, -10 - k robot k.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Float32
from mrs_people_loc.geometry import rotation_from_rpy
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_sim.models.human_body import HumanBody
from mrs_people_sim.models.meshes import Mesh, merge
from mrs_people_sim.models.robots import robot_mesh
from mrs_people_sim.models.rooms import furniture_mesh, room_mesh
from mrs_people_sim.models.textures import Atlas
from mrs_people_sim.motion import Place
from mrs_people_sim.scene import Person, Scene
from mrs_people_sim.sensors.heads import Camera, camera_models, is_raw, make_camera
from mrs_people_sim.sensors.heads import mounting as head_mounting
from mrs_people_sim.views.ray_casting import Light

_ROBOT = -10
#: What a person covers of the view, seen from the front [m^2]: the mean of this simulator's people.
_BODY_AREA = 0.57
#: Height that distances to people are measured to [m].
_CHEST = 1.0


class Stage:
    """The room, the cameras and the bodies of a scene, with everything drawn that it leaves open.

    Args:
        scene: The scene, its layout already expanded.

    Attributes:
        scene: The scene.
        atlas: Textures of everything.
        room: The room and its furniture, in the map.
        light: What lights it.
        raw: Whether a robot gives raw images, by name.
        cameras: Each robot's cameras, by name.
        stereo: Each robot's calibrated head, by name.
        robot_meshes: Each robot's body in its base_link, by name.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.atlas = Atlas()
        self._build_room()
        self._build_robots()

    def _rng(self, *what: int) -> np.random.Generator:
        return np.random.default_rng([self.scene.seed, *what])

    def _build_room(self) -> None:
        scene, room = self.scene, self.scene.room
        parts = [room_mesh(room, self._rng(1), self.atlas)]
        for k, piece in enumerate(scene.furniture):
            parts.append(furniture_mesh(piece, self._rng(2, k), self.atlas, room.contrast))
        self.room = merge(parts)
        rng = self._rng(3)
        span = (np.arange(room.lamps) + 0.5) / room.lamps
        along = room.length >= room.width
        x = room.length * (span if along else np.full(room.lamps, 0.5))
        y = room.width * (np.full(room.lamps, 0.5) if along else span)
        lamps = np.stack([x, y, np.full(room.lamps, room.height - 0.05)], axis=1)
        lamps[:, :2] += rng.normal(0.0, 0.3, (room.lamps, 2))
        power = rng.uniform(2.0, 4.0, room.lamps) * (1.0 - room.ambient)
        self.light = Light(lamps, power, room.ambient)

    def _build_robots(self) -> None:
        scene = self.scene
        self.raw: dict[str, bool] = {}
        self.cameras: dict[str, list[Camera]] = {}
        self.stereo: dict[str, StereoCamera] = {}
        self.robot_meshes: dict[str, Mesh] = {}
        for k, (name, robot) in enumerate(scene.robots.items()):
            head = scene.heads[name]
            models = camera_models(head)
            self.raw[name] = is_raw(head, models)
            self.stereo[name] = StereoCamera.from_models(
                models["left"], models["right"], models.get("top"), head_mounting(head)
            )
            rng = self._rng(4, k)
            self.cameras[name] = [
                make_camera(camera, model, self.raw[name], scene.imaging, rng)
                for camera, model in models.items()
            ]
            body = robot_mesh(robot, head, self._rng(6, k), self.atlas)
            self.robot_meshes[name] = body.owned_by(_ROBOT - k)

    def bodies(self, people: Sequence[Person]) -> list[HumanBody]:
        """The bodies of people, whose textures go into the atlas."""
        dark = self.scene.layout.cloth == "dark"
        return [
            HumanBody(
                person,
                int(self._rng(8, k).integers(1, 2**31)),
                self.atlas,
                contrast=self.scene.room.contrast,
                dark=dark,
            )
            for k, person in enumerate(people)
        ]

    def rays(
        self, name: str, camera: Camera, place: Place, samples: slice = slice(None)
    ) -> tuple[NDArray, Float32]:
        """Rays of a robot's camera in the map.

        Args:
            name: The robot.
            camera: One of its cameras.
            place: Where the robot is.
            samples: Which of the samples of each pixel.

        Returns:
            The lens [m], shape (3,), and directions of depth 1, shape (n, 3).
        """
        turn, lens = self.stereo[name].robot_from_optical
        heading = rotation_from_rpy(0.0, 0.0, place.yaw)
        rotation = heading @ turn
        origin = heading @ (lens + turn @ camera.centre) + [place.x, place.y, 0.0]
        rays = camera.rays[samples].reshape(-1, 3)
        return origin, rays @ rotation.T.astype(np.float32)

    def seen_pixels(
        self, name: str, robot: Place, people: Sequence[Place], pixels: NDArray
    ) -> NDArray:
        """Pixels of those whom a robot sees, shape (people,).

        0 for who is farther away than `visibility.range`, or shows less than `visibility.share` of
        the pixels that a whole person has at that distance.

        Args:
            name: The robot.
            robot: Where it is.
            people: Where they are.
            pixels: How much of each its left camera shows, shape (people,).
        """
        share = self.seen_shares(name, robot, people, pixels)
        seen: NDArray = np.where(share >= self.scene.visibility.share, pixels, 0.0)
        return seen

    def seen_shares(
        self, name: str, robot: Place, people: Sequence[Place], pixels: NDArray
    ) -> NDArray:
        """Pixels of people over those that a whole person has at that distance, shape (people,).

        -1 for who is farther away than `visibility.range`. Arguments are those of `seen_pixels`.
        """
        camera = self.stereo[name]
        above = camera.mounting.height - _CHEST
        x, y = np.array([(place.x, place.y) for place in people]).reshape(-1, 2).T
        away = np.sqrt((x - robot.x) ** 2 + (y - robot.y) ** 2 + above**2)
        whole = _BODY_AREA * camera.fx * camera.fy / np.maximum(away, 0.1) ** 2
        share: NDArray = np.where(away <= self.scene.visibility.range, pixels / whole, -1.0)
        return share

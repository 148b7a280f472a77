"""A scene come to life: what one robot sees at one instant, and what is true then."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.sensing.images import Gray
from mrs_people_sim import motion
from mrs_people_sim.models.meshes import Mesh, merge
from mrs_people_sim.models.rooms import footprint
from mrs_people_sim.motion import Place, Track, Walker
from mrs_people_sim.scene import Person, Robot, Scene
from mrs_people_sim.sensors.heads import Camera, expose
from mrs_people_sim.sensors.odometry import Belief, believe
from mrs_people_sim.views.ray_casting import Caster
from mrs_people_sim.views.stage import Stage
from mrs_people_sim.walking.walks import Walked, walk_together

#: For so many instants the bodies are kept.
_INSTANTS = 4


@dataclass(frozen=True)
class RenderedFrame:
    """What one robot's head saw.

    Attributes:
        robot: Its name.
        index: Number of the frame.
        stamp_ns: When the images were taken [ns].
        images: By camera: left, right, top.
        pixels: How much of each person the left camera saw [px], shape (people,).
    """

    robot: str
    index: int
    stamp_ns: int
    images: dict[str, Gray]
    pixels: NDArray


class World:
    """A scene with everything drawn that was left to chance.

    Args:
        scene: The scene, its layout already expanded (`layouts.expand`).

    Attributes:
        scene: The scene.
        names: Names of the robots.
        stage: What the scene looks like.
        cameras: Each robot's cameras, by name.
        beliefs: What each robot says about its pose, by name.
        has_group: Whether somebody is known to walk in a group.
    """

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.names = list(scene.robots)
        self._duration = (scene.timing.frames - 1) / scene.timing.rate + max(
            [r.phase for r in scene.robots.values()], default=0.0
        )
        self.stage = Stage(scene)
        self.cameras = self.stage.cameras
        self._walked = self._walk()
        self._build_robots()
        self._build_people()
        self._casters: dict[tuple, Caster] = {}
        self._meshes: dict[float, list[Mesh]] = {}
        self._exposure: dict[str, float] = {}

    def _rng(self, *what: int) -> np.random.Generator:
        return np.random.default_rng([self.scene.seed, *what])

    # --------------------------------------------------------------------- building ----

    def _walk(self) -> Walked | None:
        """The ways of a group and of the team that goes with it, if there is one."""
        scene = self.scene
        if not any(person.member for person in scene.people):
            return None
        people = {
            k: self._person_track(person, k)
            for k, person in enumerate(scene.people)
            if not (person.member or person.walks)
        }
        robots = {
            name: _robot_track(robot, self._duration)
            for name, robot in scene.robots.items()
            if not robot.post
        }
        return walk_together(scene, people, robots, self._duration, self._rng(11))

    def _build_robots(self) -> None:
        scene = self.scene
        self.beliefs: dict[str, Belief] = {}
        self._robot_tracks: dict[str, Track] = {}
        for k, (name, robot) in enumerate(scene.robots.items()):
            walked = self._walked.robots if self._walked else {}
            track = walked.get(name) or _robot_track(robot, self._duration)
            if robot.carried:
                track = track.carried(*robot.carried)
            self._robot_tracks[name] = track
            self.beliefs[name] = believe(
                track, scene.odometry, self._duration, self._rng(5, k), robot
            )

    def _build_people(self) -> None:
        scene = self.scene
        people = list(scene.people)
        self._tracks: list[Track] = []
        walkers: dict[int, Walker] = {}
        for k, person in enumerate(people):
            if self._walked and k in self._walked.people:
                self._tracks.append(self._walked.people[k])
                continue
            if person.walks:
                goal = (person.goal[0], person.goal[1]) if person.goal else None
                area = (person.area[0], person.area[1], person.area[2]) if person.area else None
                walkers[k] = Walker(person.x, person.y, person.speed, goal, area)
            self._tracks.append(self._person_track(person, k))
        self._groups = np.zeros(len(people), dtype=np.int32)
        self.has_group = self._walked is not None
        recorded = self._recorded_tracks() if scene.tracks else []
        if walkers:
            self._walk_about(walkers, recorded)
        self._tracks += recorded
        people += [Person()] * len(recorded)
        self.people = people
        self._bodies = self.stage.bodies(people)

    @property
    def room(self) -> Mesh:
        """The room and its furniture, in the map."""
        return self.stage.room

    def _recorded_tracks(self) -> list[Track]:
        """Tracks of recorded people; their groups are added to those of the scene."""
        scene = self.scene
        found = motion.read_tracks(
            scene.tracks,
            scene.tracks_window,
            self._duration,
            (scene.room.length, scene.room.width),
        )
        groups = motion.read_groups(scene.tracks)
        self.has_group |= bool(groups)
        # The number 1 is that of a group that the simulator walks.
        numbers = [groups[one] + 1 if one in groups else 0 for one in found]
        self._groups = np.concatenate([self._groups, np.array(numbers, dtype=np.int32)])
        return list(found.values())

    def _walk_about(self, walkers: Mapping[int, Walker], recorded: Sequence[Track]) -> None:
        """Replaces the tracks of people who walk on their own.

        Args:
            walkers: By index of the person.
            recorded: Tracks of recorded people, whom they evade.
        """
        scene = self.scene
        others = [track for k, track in enumerate(self._tracks) if k not in walkers]
        ways = motion.walk_about(
            list(walkers.values()),
            duration=self._duration,
            bounds=(0.0, scene.room.length, 0.0, scene.room.width),
            obstacles=np.array([footprint(f) for f in scene.furniture]).reshape(-1, 3),
            others=[*others, *recorded, *self._robot_tracks.values()],
            rng=self._rng(7),
        )
        for k, way in zip(walkers, ways, strict=True):
            self._tracks[k] = way

    def _person_track(self, person: Person, k: int) -> Track:
        if person.path:
            return motion.along(person.path, person.speed, self._duration)
        rng = self._rng(9, k)
        return motion.standing(
            person.x,
            person.y,
            person.yaw,
            self._duration,
            turn_rate=person.turn_rate,
            sway=0.006,
            phase=float(rng.uniform(0, 2 * math.pi)),
        )

    # ------------------------------------------------------------------------ truth ----

    def time_of(self, index: int) -> float:
        """Time of a frame [s]; a robot's images are its phase later."""
        return index / self.scene.timing.rate

    def stamp_ns(self, time: float) -> int:
        """The stamp of a time [ns]."""
        return round(self.scene.timing.start * 1e9) + round(time * 1e9)

    def truth_time(self, index: int) -> float:
        """Time at which a frame's ground truth is given: that of its newest images [s]."""
        return self.time_of(index) + max([r.phase for r in self.scene.robots.values()], default=0.0)

    def person_places(self, time: float) -> list[Place]:
        """Where the people are."""
        return [track.at(time) for track in self._tracks]

    def groups(self, time: float) -> NDArray:
        """Number of each person's group at a time, 0 for none, int32, shape (people,)."""
        found: NDArray = self._groups.copy()
        if self._walked is not None:
            members = self._walked.groups_at(time)
            found[: len(members)] = members
        return found

    def robot_place(self, name: str, time: float) -> Place:
        """Where a robot's base_link is."""
        return self._robot_tracks[name].at(time)

    # ---------------------------------------------------------------------- looking ----

    def render(self, name: str, index: int) -> RenderedFrame:
        """What a robot sees in a frame. The same every time, whatever was rendered before."""
        time = self.time_of(index) + self.scene.robots[name].phase
        exposure = self._exposure_of(name)
        robot = self.names.index(name)
        lights, pixels = self._lights(name, time)
        images = {
            camera.name: expose(
                lights[camera.name], camera, exposure, self.scene.imaging,
                self._rng(10, robot, k, index),
            )
            for k, camera in enumerate(self.cameras[name])
        }  # fmt: skip
        return RenderedFrame(name, index, self.stamp_ns(time), images, pixels)

    def look(self, name: str, time: float, camera: int = 0) -> tuple[NDArray, NDArray]:
        """Owner and depth [m] at the samples of a camera's pixels, without exposing.

        Returns:
            Owners and depths along the optical axis, shape (samples, height, width).
        """
        seen = self.cameras[name][camera]
        caster = self._caster(name, time)
        shape = (-1, seen.model.height, seen.model.width)
        origin, directions = self._rays(name, seen, time, slice(None))
        _, owner, depth = caster.look(origin, directions, seen.pixel_angle)
        return owner.reshape(shape), depth.reshape(shape)

    def seen_pixels(self, frames: Sequence[RenderedFrame]) -> NDArray:
        """Pixels of each person in the left image that shows most of them, shape (people,).

        0 where no robot within `visibility.range` of the person has `visibility.share` of the
        pixels that a whole person has at that distance.

        Args:
            frames: One per robot.
        """
        return self._most(frames, self.stage.seen_pixels)

    def seen_shares(self, frames: Sequence[RenderedFrame]) -> NDArray:
        """Share of each person in the left image that shows most of them, shape (people,).

        0 where no robot is within `visibility.range` of the person.

        Args:
            frames: One per robot.
        """
        return self._most(frames, self.stage.seen_shares)

    def _most(self, frames: Sequence[RenderedFrame], seen: Callable[..., NDArray]) -> NDArray:
        best = np.zeros(len(self.people))
        for frame in frames:
            time = self.time_of(frame.index) + self.scene.robots[frame.robot].phase
            robot, people = self.robot_place(frame.robot, time), self.person_places(time)
            best = np.maximum(best, seen(frame.robot, robot, people, frame.pixels))
        return best

    def _lights(self, name: str, time: float) -> tuple[dict[str, NDArray], NDArray]:
        imaging = self.scene.imaging
        slices = min(imaging.slices, imaging.samples) if self._moves(time) else 1
        cameras = self.cameras[name]
        sums = {c.name: np.zeros(c.rays.shape[1], dtype=np.float32) for c in cameras}
        counts = np.zeros(len(self._bodies))
        for k in range(slices):
            instant = time + imaging.exposure * ((k + 0.5) / slices - 0.5)
            caster = self._caster(name, instant)
            for camera in cameras:
                chosen = slice(k, None, slices)
                origin, directions = self._rays(name, camera, instant, chosen)
                light, owner, _ = caster.look(origin, directions, camera.pixel_angle)
                sums[camera.name] += light.reshape(-1, camera.rays.shape[1]).sum(axis=0)
                if camera.name == "left" and len(counts):
                    people = owner[owner >= 0]
                    counts += np.bincount(people, minlength=len(counts))
        shape = (cameras[0].model.height, cameras[0].model.width)
        lights = {key: (s / imaging.samples).reshape(shape) for key, s in sums.items()}
        return lights, counts / imaging.samples

    def _moves(self, time: float) -> bool:
        """Whether anything moves so that it could blur."""
        places = [*self.person_places(time), *(t.at(time) for t in self._robot_tracks.values())]
        turning = any(p.turn_rate for p in self.scene.people)
        return self.scene.imaging.exposure > 0 and (
            turning or any(abs(p.speed) > 0.05 for p in places)
        )

    def _rays(
        self, name: str, camera: Camera, time: float, chosen: slice
    ) -> tuple[NDArray, NDArray]:
        """Lens and directions in the map."""
        return self.stage.rays(name, camera, self._robot_tracks[name].at(time), chosen)

    def _caster(self, name: str, time: float) -> Caster:
        """Everything that a robot can see at a time; its own body is not."""
        others = {n: self._robot_tracks[n].at(time) for n in self.names if n != name}
        key = (name, time)
        if key not in self._casters:
            parts = [self.room, *self._people_meshes(time)]
            for other, place in others.items():
                mesh = self.stage.robot_meshes[other]
                parts.append(mesh.placed(place.x, place.y, place.yaw))
            self._casters = {key: Caster(merge(parts), self.stage.atlas, self.stage.light)}
        return self._casters[key]

    def _people_meshes(self, time: float) -> list[Mesh]:
        """The bodies at a time; kept for the robots that look at the same time."""
        if time not in self._meshes:
            while len(self._meshes) >= _INSTANTS:
                self._meshes.pop(next(iter(self._meshes)))
            self._meshes[time] = [
                body.mesh(place, time, talking=person.pose == "talk").owned_by(k)
                for k, (body, person, place) in enumerate(
                    zip(self._bodies, self.people, self.person_places(time), strict=True)
                )
                if math.isfinite(place.x)
            ]
        return self._meshes[time]

    def _exposure_of(self, name: str) -> float:
        """Grey levels per light that give the head's first left image its mean."""
        if name not in self._exposure:
            instant = self.scene.robots[name].phase
            caster = self._caster(name, instant)
            left = self.cameras[name][0]
            origin, directions = self._rays(name, left, instant, slice(0, 1))
            light, _, _ = caster.look(origin, directions[::4], left.pixel_angle)
            self._exposure[name] = self.scene.imaging.target / max(float(light.mean()), 1e-6)
        return self._exposure[name]


def _robot_track(robot: Robot, duration: float) -> Track:
    if robot.path:
        return motion.along(robot.path, robot.speed, duration, backwards=robot.backwards)
    return motion.standing(robot.x, robot.y, robot.yaw, duration)

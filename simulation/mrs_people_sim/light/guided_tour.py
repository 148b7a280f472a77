"""A guided tour in a closed loop without rendering and without DDS, faster than real time.

What robots see of people and walls has the errors of `sensing`. Everything else is done by
the code of the nodes: planner, localizers, guide and steering. Messages are late as they are live.
"""

from __future__ import annotations

import dataclasses
from collections import deque
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.config import GuideConfig, Localization, PlannerConfig
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.guidance import Guidance, Role
from mrs_people_loc.guiding.guide import Guide
from mrs_people_loc.localization.localizer import Localizer
from mrs_people_loc.localization.people.relative_poses import RelativePoses
from mrs_people_loc.localization.walls import SeenWalls
from mrs_people_loc.planner import People, Planner
from mrs_people_loc.team.poses import Pose
from mrs_people_loc.team.quarantine import Quarantine
from mrs_people_sim.estimates import estimate_of
from mrs_people_sim.guided import STEP_S, GuidedWorld
from mrs_people_sim.light.monitored import MonitoredBase
from mrs_people_sim.light.ranging import RangeSensors
from mrs_people_sim.light.sensing import Eyes, PeopleInView, scan_of
from mrs_people_sim.light.team import (
    MAP_SIGMA,
    START_NS,
    pose_at,
    seen_places,
    stamp_at,
)
from mrs_people_sim.scene import Scene
from mrs_people_sim.scoring.poses import PoseTrack
from mrs_people_sim.scoring.tours import TourRecord
from mrs_people_sim.tours import known_walls
from mrs_tools.bags.records import Estimate, Truth

#: Poses, images and scored positions come at each so many steps of the world.
_POSE, _IMAGE, _TRUTH = 2, 4, 2
#: The planner publishes the people of an interval so long after its images [s]; they arrive in the
#: same step.
_LATE_S = 0.15
#: The recording goes on for so long after the tour [s].
_AFTER_S = 1.0
_CONFIG = GuideConfig()
#: What a blind head sees.
_NOBODY = PeopleInView(np.empty(0, dtype=np.intp), np.empty((0, 2)), np.empty(0), np.empty(0))
#: How wrong a pose is, see `Trouble.misplaced` [m].
OFF_M = 3.0

#: Where the team takes its poses from: the truth, localizers, or odometry alone.
POSES = ("exact", "localized", "odometry")


@dataclass(frozen=True)
class Trouble:
    """What goes wrong on a tour, besides stragglers.

    Attributes:
        killed: A robot that is silent and stands from a time on [s].
        back: When it is there again [s]; None: never.
        planner_gone: From when to when there is no planner [s]: what it has not published yet is
            never published; another one then begins again.
        misplaced: A robot whose pose is wrong by `OFF_M` in x from a time on [s], and it does not
            know.
        silent: A robot whose head delivers nothing from a time on [s], while its pose lives; ...
        blind: ... one whose head sees nobody and no walls.
    """

    killed: tuple[str, float] | None = None
    back: float | None = None
    planner_gone: tuple[float, float] | None = None
    misplaced: tuple[str, float] | None = None
    silent: tuple[str, float] | None = None
    blind: tuple[str, float] | None = None


@dataclass(frozen=True)
class TourRun:
    """What became of a tour.

    Attributes:
        record: What is scored.
        poses: By robot, where the team took it to be.
        world: In its last state.
        speeds: Times [s] and true speeds of the robots [m/s], in the order of `world.names`,
            shape (n, 1 + robots).
        start_ns: Stamp of the beginning [ns].
    """

    record: TourRecord
    poses: dict[str, PoseTrack]
    world: GuidedWorld
    speeds: Float
    start_ns: int = START_NS


@dataclass
class _Log:
    statuses: list[Guidance] = field(default_factory=list)
    stamps: list[int] = field(default_factory=list)
    people: list[Float] = field(default_factory=list)
    true: dict[str, list[Pose]] = field(default_factory=dict)
    estimates: list[Estimate] = field(default_factory=list)
    poses: dict[str, list[Pose]] = field(default_factory=dict)
    speeds: list[tuple[float, ...]] = field(default_factory=list)


class LightTour:
    """A tour that can be run.

    Args:
        scene: The scene, see `guided.guided_scene`; its odometry is exact where `poses` is.
        poses: One of `POSES`.
        trouble: What goes wrong.
        config: Of the guide; its robots and which of them look back are those of the scene.
    """

    def __init__(
        self,
        scene: Scene,
        poses: str = "exact",
        trouble: Trouble = Trouble(),
        config: GuideConfig = _CONFIG,
    ) -> None:
        mode = "exact" if poses == "exact" else "drift"
        odometry = dataclasses.replace(scene.odometry, mode=mode)
        self.world = world = GuidedWorld(dataclasses.replace(scene, odometry=odometry))
        self._trouble, self._names = trouble, world.names
        self._rng = np.random.default_rng([scene.seed, 58])
        self._eyes = {
            name: Eyes(self._rng, looks_back=name in world.looks_back) for name in world.names
        }
        self._ranging = {
            name: RangeSensors(scene, name, world.walls, self._rng) for name in world.names
        }
        self._monitors = {
            name: MonitoredBase(scene, name, world.solid, looks_back=name in world.looks_back)
            for name in world.names
        }
        self._localizers = self._made_localizers() if poses == "localized" else {}
        self._relative, self._quarantine = RelativePoses(), Quarantine()
        self._planner = self._made_planner()
        config = dataclasses.replace(config, robots=tuple(world.names), looks_back=world.looks_back)
        space = FreeSpace(
            world.plan, occupied_from=config.safety.occupied_from, around=world.tour.points
        )
        self._guide = Guide(world.tour, config, space, START_NS)
        self._underway: deque[tuple[float, People]] = deque()
        self._poses: dict[str, Pose] = {}
        self._log = _Log(
            true={name: [] for name in world.names}, poses={name: [] for name in world.names}
        )

    def _made_planner(self) -> Planner:
        planner = Planner(PlannerConfig(robots=tuple(self._names)))
        planner.take_grid(self.world.plan)
        return planner

    def _made_localizers(self) -> dict[str, Localizer]:
        settings = self.world.scene.odometry
        sigmas = (settings.sigma, settings.sigma, settings.sigma_yaw)
        known = known_walls(self.world.walls, MAP_SIGMA)
        return {
            name: Localizer(
                name,
                Localization(start=wheels.map_from_odom or (), start_sigmas=sigmas),
                known,
            )
            for name, wheels in self.world.wheels.items()
        }

    def run(self, longest_s: float = 900.0) -> TourRun:
        """The tour, from its beginning until a little after its end.

        Args:
            longest_s: It is broken off after this time [s].
        """
        ends, step, world = longest_s, 0, self.world
        while world.time < ends:
            self._step(step)
            if not self._guide.is_running:
                ends = min(ends, world.time + _AFTER_S)
            step += 1
        log = self._log
        truth = Truth.build(log.stamps, log.people, groups=[world.groups] * len(log.stamps))
        true = {name: PoseTrack.build(poses) for name, poses in log.true.items()}
        return TourRun(
            TourRecord(log.statuses, truth, true, log.estimates),
            {name: PoseTrack.build(poses) for name, poses in log.poses.items()},
            world,
            np.array(log.speeds),
        )

    # ---------------------------------------------------------------------------- a step ----

    def _step(self, step: int) -> None:
        world, now_ns = self.world, stamp_at(self.world.time)
        if step % _TRUTH == 0:
            self._log.stamps.append(now_ns)
            self._log.people.append(world.crowd.xy.copy())
        for name, pose in zip(self._names, world.poses(), strict=True):
            self._log.true[name].append(pose_at(now_ns, pose))
        alive = [name for name in self._names if self._is_alive(name)]
        if step % _POSE == 0:
            for name in alive:
                self._take_pose(name, now_ns)
        if self._is_planner_gone():
            self._underway.clear()
        if step % _IMAGE == 0:
            self._look(alive, now_ns)
        while self._underway and self._underway[0][0] <= world.time + 1e-9:
            people = self._underway.popleft()[1]
            self._say(
                self._guide.take_people(
                    people.everybody, people.groups, people.stamp_ns, now_ns,
                    tuple(people.poses), people.quarantined,
                )
            )  # fmt: skip
        self._drive(alive, now_ns)
        world.step()
        speeds = (abs(world.wheels[name].speed) for name in self._names)
        self._log.speeds.append((world.time, *speeds))

    def _is_alive(self, name: str) -> bool:
        killed, back = self._trouble.killed, self._trouble.back
        if killed is None or killed[0] != name or self.world.time < killed[1]:
            return True
        return back is not None and self.world.time >= back

    def _has(self, trouble: tuple[str, float] | None, name: str) -> bool:
        """Whether a robot has a trouble now."""
        return trouble is not None and trouble[0] == name and self.world.time >= trouble[1]

    def _is_planner_gone(self) -> bool:
        gone = self._trouble.planner_gone
        return gone is not None and gone[0] <= self.world.time + 1e-9 < gone[1]

    def _take_pose(self, name: str, now_ns: int) -> None:
        """A robot says where it is."""
        wheels = self.world.wheels[name]
        said = wheels.odometry()
        pose = Pose(now_ns, said.x, said.y, said.yaw)
        if name in self._localizers:
            localizer = self._localizers[name]
            pose = localizer.take_odometry(pose)
            odometry, mates = localizer.odometry_at(now_ns), localizer.mates_at(now_ns)
            place, bodies = wheels.pose, self._bodies(name)
            for seen in self._ranging[name].by_sonar(place, bodies, odometry, mates):
                localizer.take_walls(seen)
        elif wheels.map_from_odom is not None:
            pose = Pose(0, *wheels.map_from_odom) @ pose
        pose = self._misplaced(name, pose)
        self._poses[name] = pose
        self._log.poses[name].append(pose)
        self._guide.take_pose(name, pose, now_ns)

    def _misplaced(self, name: str, pose: Pose) -> Pose:
        is_off = self._has(self._trouble.misplaced, name)
        return dataclasses.replace(pose, x=pose.x + OFF_M) if is_off else pose

    def _look(self, alive: list[str], now_ns: int) -> None:
        """Robots see people and walls; a planner makes people of what they see."""
        world, dt = self.world, _IMAGE * STEP_S
        places = dict(zip(self._names, world.poses(), strict=True))
        views: dict[str, PeopleInView] = {}
        for name in alive:
            if self._has(self._trouble.silent, name):
                continue
            mates = np.array([p[:2] for other, p in places.items() if other != name])
            views[name] = self._eyes[name].people(
                places[name], world.crowd.xy, mates.reshape(-1, 2), world.solid, dt
            )
            if self._has(self._trouble.blind, name):
                views[name] = _NOBODY
        if self._localizers:
            self._localize(places, views, alive, now_ns)
        if self._is_planner_gone():
            self._planner = self._made_planner()
            return
        apart = self._quarantine.at(now_ns)
        scans = [scan_of(name, now_ns, view) for name, view in views.items() if name not in apart]
        if scans:
            poses = {name: self._poses[name] for name in alive if name not in apart}
            people = self._planner.step(scans, poses, now_ns)
            people = dataclasses.replace(people, quarantined=tuple(sorted(apart)))
            self._log.estimates.append(estimate_of(people))
            self._underway.append((world.time + _LATE_S, people))

    def _localize(
        self,
        places: dict[str, Float],
        views: dict[str, PeopleInView],
        alive: list[str],
        now_ns: int,
    ) -> None:
        """Robots see walls, and share what they know; the planner measures relative poses."""
        told = []
        for name in alive:
            localizer = self._localizers[name]
            for walls in self._seen_walls(name, places[name], views.get(name), now_ns):
                localizer.take_walls(walls)
            said = localizer.share()
            said = dataclasses.replace(said, pose=self._misplaced(name, said.pose))
            self._quarantine.hear(name, said.lost, said.doubted, now_ns)
            told.append(said)
        poses = {name: self._poses[name] for name in views}
        seen = {name: seen_places(now_ns, view) for name, view in views.items()}
        relative = self._relative.step(seen, poses, self._quarantine.at(now_ns))
        for name in alive:
            for message in told:
                if message.robot != name:
                    self._localizers[name].take_teammate(message)
            for pose in relative:
                self._localizers[name].take_relative(pose)

    def _seen_walls(
        self, name: str, place: Float, view: PeopleInView | None, now_ns: int
    ) -> Iterator[SeenWalls]:
        """What the laser scanner and the head of a robot show; a head may have failed."""
        sensors, localizer, bodies = self._ranging[name], self._localizers[name], self._bodies(name)
        if view is not None:
            sensors.take_people(scan_of(name, now_ns, view))
        odometry, mates = localizer.odometry_at(now_ns), localizer.mates_at(now_ns)
        yield from sensors.by_laser(place, bodies, odometry, mates)
        walls = self._eyes[name].walls(self.world.walls, place, bodies)
        if len(walls) and view is not None and not self._has(self._trouble.blind, name):
            yield SeenWalls(now_ns, walls)

    def _bodies(self, name: str) -> Float:
        """Where people and the other robots are, shape (n, 2)."""
        wheels = self.world.wheels
        mates = [wheels[other].pose[:2] for other in self._names if other != name]
        return np.concatenate([self.world.crowd.xy, np.array(mates).reshape(-1, 2)])

    def _drive(self, alive: list[str], now_ns: int) -> None:
        """The robots get commands, as from guide_node."""
        self._say(self._guide.check_age(now_ns))
        for name, velocity in self._guide.velocities(now_ns).items():
            wanted = velocity if name in alive else (0.0, 0.0)
            wheels, bodies = self.world.wheels[name], self._bodies(name)
            verdict = self._monitors[name].drive(wanted, wheels, bodies)
            self._guide.take_driven(name, verdict.velocity)

    def _say(self, guidance: Guidance | None) -> None:
        """What the guide says is recorded, and tells people who leads."""
        if guidance is None:
            return
        self._log.statuses.append(guidance)
        for name, post in guidance.posts.items():
            if post.role == Role.LEADER:
                self.world.leader = name

"""A team on a tour without rendering: its localizers, the messages between them, and a planner.

Everything that a robot estimates is done by the same code as in its node. Messages go from robot to
robot as they would over the network: late, and not all of them.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc.arrays import Float
from mrs_people_loc.config import Localization, PlannerConfig, Tracking
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.localization.localizer import Localizer
from mrs_people_loc.localization.people.relative_poses import RelativePoses
from mrs_people_loc.localization.people.seen_people import SeenPeople
from mrs_people_loc.localization.shared import TeamMeasurement, TeamPose
from mrs_people_loc.localization.walls import SeenWalls, Walls
from mrs_people_loc.planner import Planner
from mrs_people_loc.team.poses import Pose
from mrs_people_loc.team.quarantine import Quarantine
from mrs_people_sim.estimates import estimate_of
from mrs_people_sim.light.ranging import RangeSensors
from mrs_people_sim.light.sensing import (
    HEAD,
    LightHead,
    PeopleInView,
    scan_of,
    seen_people,
    seen_walls,
)
from mrs_people_sim.scoring.poses import PoseTrack
from mrs_people_sim.sensors.range_topics import SONAR_RATE
from mrs_people_sim.tours import STEP_S, Tour, known_walls
from mrs_tools.bags.records import Estimate, Truth

#: Odometry and views come at each so many steps of the tour; walls in views, laser scans, messages
#: to team-mates, scores of people, and looks at what the localizers know less often, to save time.
_VIEW, _TELL, _SCORED = 2, 4, 20
#: How sure a map is of its walls: distance [m] and bearing [rad].
MAP_SIGMA = 0.01, 0.002
#: Time of the first step [ns].
START_NS = 1_000_000_000_000


@dataclass(frozen=True)
class Trouble:
    """What goes wrong on a tour.

    Attributes:
        stereo: Whether robots see walls in their stereo,
        sonars: How often their sonars fire, if the scene has some [Hz]; 0: never.
        known: Whether they know the walls of the map,
        map_off: ... which is wrong by so much in x and in y [m].
        lies: A robot that says that it is a metre from where it is,
        lies_from: ... from this time on [s].
        lost: Share of the messages that are lost.
        cut_off: A robot that hears nobody and is heard by nobody, from when to when [s].
        restarted: A robot whose node begins again with its first start, and when [s].
        start: Standard deviations with which the start is known, x, y [m] and yaw [rad]; None: as
            the scene says.
    """

    stereo: bool = True
    sonars: float = SONAR_RATE
    known: bool = False
    map_off: float = 0.0
    lies: str = ""
    lies_from: float = 0.0
    lost: float = 0.0
    cut_off: tuple[str, float, float] | None = None
    restarted: tuple[str, float] | None = None
    start: tuple[float, float, float] | None = None


@dataclass
class TeamRun:
    """What became of a tour.

    Attributes:
        true: By robot, its true poses.
        localized: By robot, what its localizer says.
        odometry: By robot, where it would be by its odometry alone.
        truth: Where the people are.
        people: People by the planner with exact poses, with those of the localizers and with
            odometry alone.
        used: By robot, the poses of the localizers that people were placed with.
        named: What was said to be wrong, and when it first was [s].
        start_ns: Stamp of the beginning [ns].
    """

    true: dict[str, PoseTrack]
    localized: dict[str, PoseTrack]
    odometry: dict[str, PoseTrack]
    truth: Truth
    people: dict[str, list[Estimate]]
    used: dict[str, PoseTrack]
    named: dict[str, float] = field(default_factory=dict)
    start_ns: int = START_NS


#: Whose poses people are placed with.
WAYS = ("exact", "localized", "odometry")


class LightTeam:
    """A team on a tour.

    Args:
        tour: Where everybody is.
        trouble: What goes wrong.
        seed: Of the errors of what is seen, and of what is lost.
        head: What robots see with.
    """

    def __init__(self, tour: Tour, trouble: Trouble, seed: int, head: LightHead = HEAD) -> None:
        self._tour, self._trouble = tour, trouble
        self._rng = np.random.default_rng([seed, 57])
        self.names = list(tour.robots)
        self._start = dict(tour.start)
        settings = tour.scene.odometry
        self._sigmas = trouble.start or (settings.sigma, settings.sigma, settings.sigma_yaw)
        if trouble.start is not None:
            self._start = {
                name: pose[0] + self._rng.normal(size=3) * trouble.start
                for name, pose in tour.robots.items()
            }
        self._known: Walls | None = None
        if trouble.known:
            self._known = known_walls(tour.walls + trouble.map_off, MAP_SIGMA)
        self._localizers = {name: self._made_localizer(name) for name in self.names}
        self._views = np.arange(0, len(tour.times), _VIEW)
        self._bodies = {
            name: np.concatenate(
                [tour.people, *(tour.robots[o][:, None, :2] for o in self.names if o != name)],
                axis=1,
            )
            for name in self.names
        }
        self._walls = {
            name: seen_walls(
                tour.walls, tour.robots[name][self._views], self._bodies[name][self._views],
                self._rng, head,
            )
            for name in self.names if trouble.stereo
        }  # fmt: skip
        self._ranging = {name: self._made_sensors(name) for name in self.names}
        self._people = {
            name: seen_people(
                tour.times[self._views],
                tour.robots[name][self._views],
                tour.people[self._views],
                self._rng,
            )
            for name in self.names
        }
        self._relative = RelativePoses()
        self._quarantine = Quarantine()
        self._underway: list[tuple[str, TeamPose | TeamMeasurement]] = []

    def _made_localizer(self, name: str) -> Localizer:
        start = tuple(map(float, self._start[name]))
        return Localizer(name, Localization(start=start, start_sigmas=self._sigmas), self._known)

    def _made_sensors(self, name: str) -> RangeSensors:
        return RangeSensors(self._tour.scene, name, self._tour.walls, self._rng)

    # ------------------------------------------------------------------------------- run ----

    def run(self) -> TeamRun:
        """The tour, from its beginning to its end."""
        tour = self._tour
        localized: dict[str, list[Pose]] = {name: [] for name in self.names}
        people: dict[str, list[Estimate]] = {way: [] for way in WAYS}
        named: dict[str, float] = {}
        used: dict[str, list[Pose]] = {name: [] for name in self.names}
        restarted = self._trouble.restarted
        planner = Planner(PlannerConfig(tracking=Tracking(enabled=False)))
        for step in range(0, len(tour.times), _VIEW):
            time = float(tour.times[step])
            self._deliver(time)
            if restarted and restarted[1] <= time:
                self._localizers[restarted[0]] = self._made_localizer(restarted[0])
                self._ranging[restarted[0]] = self._made_sensors(restarted[0])
                restarted = None
            for name, localizer in self._localizers.items():
                pose = localizer.take_odometry(pose_at(stamp_of(step), tour.odometry[name][step]))
                localized[name].append(pose)
                for seen in self._seen_walls(name, step):
                    localizer.take_walls(seen)
            if step % _TELL == 0:
                for localizer in self._localizers.values():
                    told = self._told(localizer)
                    self._underway += [(o, told) for o in self.names if o != localizer.robot]
                    if not self._is_cut_off(localizer.robot, time):
                        self._quarantine.hear(told.robot, told.lost, told.doubted, stamp_of(step))
            self._see_people(step, time)
            if step % _SCORED == 0:
                for fault in self._faults(stamp_of(step)):
                    named.setdefault(fault, time)
                for way, poses in self._poses(step, localized).items():
                    people[way].append(self._plan(planner, step, poses))
                    if way == "localized":
                        for name, pose in poses.items():
                            used[name].append(pose)
        return TeamRun(
            {name: self._track(poses) for name, poses in tour.robots.items()},
            {name: PoseTrack.build(poses) for name, poses in localized.items()},
            {name: self._track(self._by_odometry(name)) for name in self.names},
            Truth.build(
                [stamp_of(step) for step in range(0, len(tour.times), _SCORED)],
                [*tour.people[::_SCORED]],
                self._visible(),
            ),
            people,
            {name: PoseTrack.build(poses) for name, poses in used.items()},
            named,
        )

    def _seen_walls(self, name: str, step: int) -> Iterator[SeenWalls]:
        """What the sonars, the laser scanner and the head of a robot show at a step."""
        pose, bodies = self._tour.robots[name][step], self._bodies[name][step]
        sensors, localizer = self._ranging[name], self._localizers[name]
        odometry, mates = localizer.odometry_at(stamp_of(step)), localizer.mates_at(stamp_of(step))
        sensors.take_people(scan_of(name, stamp_of(step), self._people[name][step // _VIEW]))
        sonars = self._trouble.sonars
        if sonars and step % round(1.0 / sonars / STEP_S) == 0:
            yield from sensors.by_sonar(pose, bodies, odometry, mates)
        if step % _TELL:
            return
        yield from sensors.by_laser(pose, bodies, odometry, mates)
        if self._trouble.stereo and len(walls := self._walls[name][step // _VIEW]):
            yield SeenWalls(stamp_of(step), walls)

    def _see_people(self, step: int, time: float) -> None:
        """The planner measures relative poses by the people whom robots see."""
        stamp_ns = stamp_of(step)
        heard = [name for name in self.names if not self._is_cut_off(name, time)]
        seen = {name: seen_places(stamp_ns, self._people[name][step // _VIEW]) for name in heard}
        poses = {name: self._localizers[name].pose_at(stamp_ns) for name in heard}
        measured = self._relative.step(seen, poses, self._quarantine.at(stamp_ns))
        self._quarantine.compare(self._relative.fits, stamp_ns)
        for relative in measured:
            self._underway += [(name, relative) for name in self.names]

    def _told(self, localizer: Localizer) -> TeamPose:
        told = localizer.share()
        lies_from_ns = START_NS + round(1e9 * self._trouble.lies_from)
        if told.robot == self._trouble.lies and told.odometry.stamp_ns >= lies_from_ns:
            moved = dataclasses.replace(told.pose, x=told.pose.x + 1.0)
            told = dataclasses.replace(told, pose=moved)
        return told

    def _deliver(self, time: float) -> None:
        underway, self._underway = self._underway, []
        for to, message in underway:
            sender = message.robot if isinstance(message, TeamPose) else ""
            if self._rng.random() < self._trouble.lost:
                continue
            if self._is_cut_off(to, time) or self._is_cut_off(sender, time):
                continue
            if isinstance(message, TeamPose):
                self._localizers[to].take_teammate(message)
            else:
                self._localizers[to].take_relative(message)

    def _is_cut_off(self, name: str, time: float) -> bool:
        cut = self._trouble.cut_off
        return cut is not None and name == cut[0] and cut[1] <= time < cut[2]

    def _faults(self, stamp_ns: int) -> Iterator[str]:
        """Who is left out, and what the localizers' states say; of a robot that lies, others'."""
        yield from (f"{robot} left out" for robot in self._quarantine.at(stamp_ns))
        for name, localizer in self._localizers.items():
            if name == self._trouble.lies:
                continue
            state = localizer.state
            yield from (f"{robot} was carried" for robot, t in state.trust.items() if t.times_lost)
            yield from (f"{robot} doubted" for robot in state.doubted)
            yield from (f"known wall {k} is off" for k in state.misfits)
            if state.hung_ns:
                yield f"odometry of {name} hangs"
            if state.jumps:
                yield f"odometry of {name} jumped"

    # ---------------------------------------------------------------------------- people ----

    def _poses(self, step: int, localized: Mapping[str, list[Pose]]) -> dict[str, dict[str, Pose]]:
        """By whose poses: by robot, its pose at a step."""
        stamp_ns, tour = stamp_of(step), self._tour
        return {
            "exact": {name: pose_at(stamp_ns, tour.robots[name][step]) for name in self.names},
            "localized": {
                name: poses[-1]
                for name, poses in localized.items()
                if name not in self._quarantine.at(stamp_ns)
            },
            "odometry": {
                name: pose_at(stamp_ns, self._by_odometry(name)[step]) for name in self.names
            },
        }

    def _plan(self, planner: Planner, step: int, poses: Mapping[str, Pose]) -> Estimate:
        stamp_ns, view = stamp_of(step), step // _VIEW
        scans = [scan_of(name, stamp_ns, self._people[name][view]) for name in poses]
        return estimate_of(planner.step(scans, poses, stamp_ns))

    def _visible(self) -> list[NDArray[np.bool_]]:
        """Who is seen by a robot at least, at each time that is scored."""
        count = self._tour.people.shape[1]
        return [
            np.isin(
                np.arange(count), np.concatenate([self._people[n][v].person for n in self.names])
            )
            for v in range(0, len(self._views), _SCORED // _VIEW)
        ]

    def _by_odometry(self, name: str) -> NDArray:
        """Where a robot would be by its odometry alone, shape (n, 3)."""
        start, odometry = self._start[name], self._tour.odometry[name]
        places = odometry[:, :2] @ rotation_2d(start[2]).T + start[:2]
        return np.column_stack([places, odometry[:, 2] + start[2]])

    def _track(self, poses: NDArray) -> PoseTrack:
        stamps = np.array([stamp_of(step) for step in range(len(poses))], dtype=np.int64)
        return PoseTrack(stamps, poses, np.zeros((len(poses), 3, 3)))


def stamp_of(step: int) -> int:
    """The stamp of a step of a tour [ns]."""
    return stamp_at(step * STEP_S)


def stamp_at(time: float) -> int:
    """The stamp of a time since the first step [s], in ns."""
    return START_NS + round(time * 1e9)


def pose_at(stamp_ns: int, pose: NDArray) -> Pose:
    """A pose of x, y [m] and yaw [rad] at a time [ns]."""
    return Pose(stamp_ns, float(pose[0]), float(pose[1]), float(pose[2]))


def seen_places(stamp_ns: int, seen: PeopleInView) -> SeenPeople:
    """What a robot sees, as the measurement of relative poses takes it."""
    bearing = np.arctan2(seen.xy[:, 1], seen.xy[:, 0])
    cos, sin = np.cos(bearing), np.sin(bearing)
    turn = np.array([[cos, -sin], [sin, cos]]).transpose(2, 0, 1)
    variances = np.stack([seen.along, seen.across], axis=1) ** 2
    covariance: Float = (turn * variances[:, np.newaxis]) @ turn.transpose(0, 2, 1)
    return SeenPeople(stamp_ns, seen.xy, covariance)

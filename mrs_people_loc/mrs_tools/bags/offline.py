"""A bag through the pipeline in this process, as fast as it goes.

    run = BagRun("bags/paper_formation")
    for interval in run.intervals():
        interval.people                      # what the planner would publish
        interval.views["robot_a"].stages     # what its robots made of their images
    run.truth()                              # ground truth, if the bag has it

What comes out is what the live nodes would say on an infinitely fast machine: messages are handed
over in the order of their bag time, and bag time is the clock. Robots are discovered as namespaces
of the bag; their images, or the `points` and `pose` that they sent, are where an interval starts
from. To try another method, hand over other classes than `RobotPipeline` and `Planner`.
"""

from __future__ import annotations

import dataclasses
import math
import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc import head, messages
from mrs_people_loc.config import (
    PLANNER_NODE,
    ROBOT_NODE,
    PlannerConfig,
    RobotConfig,
    Team,
    load_team,
    load_yaml,
    robots_named,
)
from mrs_people_loc.errors import (
    BagError,
    ConfigError,
    GridError,
    PeopleLocError,
    PoseError,
)
from mrs_people_loc.geometry import Float
from mrs_people_loc.messages import stamp_ns_of
from mrs_people_loc.people import Group, Person
from mrs_people_loc.planner import People, Planner
from mrs_people_loc.robot import RobotPipeline, Stages
from mrs_people_loc.scan import Scan
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import StereoImages
from mrs_people_loc.team.intervals import IntervalCollector
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_loc.team.poses import Pose, PoseIntake, static_pose
from mrs_tools.bags.rosbag import BagReader
from mrs_tools.scoring.positions import Estimate, Truth

TRUTH_TOPIC = "/ground_truth/people_poses"
VISIBLE_TOPIC = "/ground_truth/visible"
GROUP_TOPIC = "/ground_truth/group"
MAP_TOPIC = "/map"
PEOPLE_TYPE = "mrs_people_msgs/msg/People"

_GRID = "nav_msgs/msg/OccupancyGrid"
_IMAGE = "sensor_msgs/msg/Image"
_POINTS = "sensor_msgs/msg/PointCloud2"
_POSE = "geometry_msgs/msg/PoseWithCovarianceStamped"
_ODOMETRY = "nav_msgs/msg/Odometry"
#: Where a robot's pose may be, and as what.
_POSE_TOPICS = {"odom": _ODOMETRY, "pose_in": _POSE, "pose": _POSE}
#: std_msgs' arrays of whole numbers.
_INTEGER_ARRAYS = tuple(
    f"std_msgs/msg/{sign}Int{bits}MultiArray" for sign in ("", "U") for bits in (8, 16, 32, 64)
)
#: What is scored at most: people of one message, messages times people, identities.
_MAX_PEOPLE, _MAX_PLACES, _MAX_IDS = 1_000, 10_000_000, 20_000


# --------------------------------------------------------------------------------- ground truth


def read_truth(bag: BagReader) -> Truth:
    """Ground truth of a bag; without any messages where it has none.

    `/ground_truth/people_poses` is a PoseArray in `map`. `/ground_truth/visible` and
    `/ground_truth/group` are any arrays of whole numbers of std_msgs, one number per person; 0: no
    robot sees that one, he belongs to no group. They have no stamps, so each message of the first
    belongs to those of the others that are nearest in bag time.

    Raises:
        BagError: A topic has another type, they do not fit together, or are more than are scored.
    """
    kinds = {
        TRUTH_TOPIC: ("geometry_msgs/msg/PoseArray",),
        VISIBLE_TOPIC: _INTEGER_ARRAYS,
        GROUP_TOPIC: _INTEGER_ARRAYS,
    }
    topics = [topic for topic in kinds if topic in bag.topics]
    for topic in topics:
        if bag.topics[topic].type not in kinds[topic]:
            raise BagError(
                f"{bag.path}: {topic} is {bag.topics[topic].type}; "
                f"allowed: {', '.join(kinds[topic])}"
            )
    stamps: list[int] = []
    times: list[int] = []
    positions: list[Float] = []
    numbers: dict[str, list[tuple[int, NDArray[np.integer]]]] = {VISIBLE_TOPIC: [], GROUP_TOPIC: []}
    for topic, time_ns, message in bag.decoded(topics) if topics else ():
        if topic != TRUTH_TOPIC:
            numbers[topic].append((time_ns, np.asarray(message.data)))
            continue
        if len(message.poses) > _MAX_PEOPLE:
            raise BagError(
                f"{bag.path}: {topic} has {len(message.poses)} people; allowed: {_MAX_PEOPLE}"
            )
        stamps.append(stamp_ns_of(message.header.stamp))
        times.append(time_ns)
        places = [(pose.position.x, pose.position.y) for pose in message.poses]
        positions.append(np.array(places, dtype=np.float64).reshape(-1, 2))

    most = max(map(len, positions), default=0)
    if len(positions) * most > _MAX_PLACES:
        raise BagError(
            f"{bag.path}: {TRUTH_TOPIC} has {len(positions)} messages of up to {most} people; "
            f"allowed: {_MAX_PLACES} places in all. Cut the bag"
        )

    def nearest(topic: str) -> list[NDArray[np.integer]] | None:
        given = numbers[topic]
        if not given:
            return None
        given_ns = np.array([time_ns for time_ns, _ in given])
        found = [given[int(np.argmin(np.abs(given_ns - time_ns)))][1] for time_ns in times]
        for each, xy in zip(found, positions, strict=True):
            if len(each) != len(xy):
                raise BagError(
                    f"{bag.path}: {topic} has {len(each)} numbers for {len(xy)} people of "
                    f"{TRUTH_TOPIC}; wanted: one per person"
                )
        return found

    visible = nearest(VISIBLE_TOPIC)
    seen = None if visible is None else [each > 0 for each in visible]
    return Truth.build(stamps, positions, seen, nearest(GROUP_TOPIC))


def read_grid(bag: BagReader, map_frame: str) -> OccupancyGrid | None:
    """What a bag's `/map` says of walls and furniture; None: it has none, or none of any use."""
    if MAP_TOPIC not in bag.topics or bag.topics[MAP_TOPIC].type != _GRID:
        return None
    for _, _, message in bag.decoded([MAP_TOPIC]):
        with suppress(GridError):
            return messages.read_occupancy_grid(message, map_frame)
    return None


# -------------------------------------------------------------------------------------- results


@dataclass(frozen=True)
class View:
    """One view of a robot's head, and what the robot made of it.

    Attributes:
        robot: The robot's name.
        camera: Its head.
        images: The prepared images.
        stages: What its pipeline made of them.
        times_ms: What each stage took, preparing the images (`prepare`) included [ms].
    """

    robot: str
    camera: StereoCamera
    images: StereoImages
    stages: Stages
    times_ms: Mapping[str, float]


@dataclass(frozen=True)
class Interval:
    """One run of the planner.

    Attributes:
        closed_ns: Bag time at which it closed [ns].
        scans: What it was made from.
        people: What came out.
        views: By robot, the view behind its scan; not for robots whose `points` were recorded.
    """

    closed_ns: int
    scans: Sequence[Scan]
    people: People
    views: Mapping[str, View]


def estimate_of(people: People) -> Estimate:
    """The people of an interval, as they are scored."""
    persons = people.persons
    unknown = np.full(2, np.nan)
    velocities = [unknown if p.velocity is None else p.velocity for p in persons]
    return Estimate(
        stamp_ns=people.stamp_ns,
        positions=np.array([p.position for p in persons]).reshape(-1, 2),
        covariances=np.array([p.covariance for p in persons]).reshape(-1, 2, 2),
        centre=_centre([(group.size, group.centre) for group in people.groups]),
        largest=people.group.centre if people.group else None,
        ids=np.array([p.id for p in persons], dtype=np.int64),
        velocities=np.array(velocities).reshape(-1, 2),
        coasting=np.array([p.coasting for p in persons], dtype=bool),
        stragglers=tuple(sorted({one for group in people.groups for one in group.stragglers})),
    )


def read_estimate(message: Any) -> Estimate:
    """The people of a mrs_people_msgs/People, as they are scored.

    Raises:
        ValueError: Two of them have one id, or they are more than are scored.
    """
    if len(message.persons) > _MAX_PEOPLE:
        raise ValueError(f"has {len(message.persons)} people; allowed: {_MAX_PEOPLE}")

    def place(pose: Any) -> tuple[float, float]:
        return pose.pose.position.x, pose.pose.position.y

    persons = message.persons
    poses = [person.pose for person in persons]
    velocities = [person.velocity.twist.linear for person in persons]
    covariances = [np.reshape(pose.covariance, (6, 6))[:2, :2] for pose in poses]
    return Estimate(
        stamp_ns=stamp_ns_of(message.header.stamp),
        positions=np.array([place(pose) for pose in poses], dtype=np.float64).reshape(-1, 2),
        covariances=np.array(covariances, dtype=np.float64).reshape(-1, 2, 2),
        centre=_centre([(group.size, place(group.centre)) for group in message.groups]),
        largest=np.array(place(message.groups[0].centre)) if message.groups else None,
        ids=np.array([person.id for person in persons], dtype=np.int64),
        velocities=np.array([(v.x, v.y) for v in velocities], dtype=np.float64).reshape(-1, 2),
        coasting=np.array([person.coasting for person in persons], dtype=bool),
        stragglers=tuple(sorted({int(i) for group in message.groups for i in group.stragglers})),
    )


def _centre(groups: Sequence[tuple[int, Any]]) -> Float | None:
    """Centre of gravity of groups, given their sizes and centres; None if there are none."""
    if not any(size for size, _ in groups):
        return None
    sizes, centres = zip(*groups, strict=True)
    with np.errstate(over="ignore", invalid="ignore"):  # a message may say anything
        return np.asarray(np.average(np.array(centres, dtype=np.float64), axis=0, weights=sizes))


def read_people(message: Any) -> tuple[tuple[Person, ...], tuple[Group, ...]]:
    """The people and groups of a mrs_people_msgs/People.

    Raises:
        ValueError: A group does not say of each straggler for how long.
    """

    def place(pose: Any) -> tuple[Float, Float]:
        at = pose.pose.position
        return np.array([at.x, at.y]), np.reshape(pose.covariance, (6, 6))[:2, :2]

    def velocity(twist: Any) -> tuple[Float | None, Float | None]:
        v = twist.twist.linear
        if math.isnan(v.x) or math.isnan(v.y):
            return None, None
        return np.array([v.x, v.y]), np.reshape(twist.covariance, (6, 6))[:2, :2]

    for group in message.groups:
        if len(group.stragglers) != len(group.straggling_for):
            raise ValueError(
                f"group {group.id} has {len(group.stragglers)} stragglers and "
                f"{len(group.straggling_for)} times of straggling; wanted: as many"
            )
    persons = tuple(
        Person(
            *place(person.pose),
            height=person.height,
            sigma=person.sigma,
            robots=tuple(person.robots),
            label=-1,
            stamp_ns=stamp_ns_of(message.header.stamp),
            id=person.id,
            velocity=velocity(person.velocity)[0],
            velocity_covariance=velocity(person.velocity)[1],
            age_s=seconds_of(person.age),
            coasting=person.coasting,
        )
        for person in message.persons
    )
    groups = tuple(
        Group(
            *place(group.centre),
            radius=group.radius,
            rms_spread=group.rms_spread,
            size=group.size,
            velocity=velocity(group.velocity)[0],
            velocity_covariance=velocity(group.velocity)[1],
            members=tuple(group.members),
            id=group.id,
            stragglers=dict(
                zip(group.stragglers, map(seconds_of, group.straggling_for), strict=True)
            ),
        )
        for group in message.groups
    )
    return persons, groups


def seconds_of(duration: Any) -> float:
    """A builtin_interfaces/Duration [s]."""
    return float(duration.sec + duration.nanosec * 1e-9)


# ---------------------------------------------------------------------------------- what is there


@dataclass(frozen=True)
class BagRobot:
    """What a bag holds of one robot.

    Attributes:
        name: Its name: its namespace without the leading slash.
        images: By kind (`image_rect`, `image_raw`), the cameras that have them.
        points: Whether there are recorded scans.
        poses: Which of the topics `odom`, `pose_in` and `pose` there are.
    """

    name: str
    images: Mapping[str, tuple[str, ...]]
    points: bool
    poses: tuple[str, ...]


def robots_of(bag: BagReader) -> dict[str, BagRobot]:
    """The robots of a bag, by name: namespaces with images of a pair, or with `points`."""
    types = {name: topic.type for name, topic in bag.topics.items() if topic.count}
    namespaces = {
        name.removesuffix(end)
        for name in types
        for end in ("/left/image_rect", "/left/image_raw", "/points")
        if name.endswith(end) and name != end
    }
    robots = {}
    for space in sorted(namespaces):
        images = {}
        for kind in ("image_rect", "image_raw"):
            cameras = tuple(
                c for c in ("left", "right", "top") if types.get(f"{space}/{c}/{kind}") == _IMAGE
            )
            if cameras[:2] == ("left", "right"):
                images[kind] = cameras
        poses = tuple(
            name for name, kind in _POSE_TOPICS.items() if types.get(f"{space}/{name}") == kind
        )
        points = types.get(f"{space}/points") == _POINTS and "pose" in poses
        if images or points:
            robots[space.lstrip("/")] = BagRobot(space.lstrip("/"), images, points, poses)
    return robots


def file_beside(bag: Path) -> Path | None:
    """The parameter file that belongs to a bag: `scene.yaml` beside `scene` or `scene.mcap`.

    `mrs simulate` writes it: the mounting of each head, where odometry begins. A file of that name
    that is something else does not count.
    """
    bag = Path(os.path.abspath(bag))
    file = bag.with_name(f"{bag.stem if bag.suffix == '.mcap' else bag.name}.yaml")
    try:
        document = load_yaml(file)
    except ConfigError:
        return None
    keys = [str(key) for key in document] if isinstance(document, Mapping) else []
    return file if any(key.endswith((ROBOT_NODE, PLANNER_NODE)) for key in keys) else None


# ---------------------------------------------------------------------------------------- robots


class _FrameError(PoseError):
    """Poses in a frame that nothing places in the map: every other one will be, too."""


@dataclass
class _Source:
    """A robot of the team, fed with its messages. Handlers by topic are in `handlers`.

    Attributes:
        has: What the bag holds of it.
        config: Its configuration.
        views: Views so far.
        scans: Scans so far.
        poses: Poses so far.
        stands: Whether its pose is a parameter, at any time.
    """

    has: BagRobot
    config: RobotConfig
    make: Callable[[str, StereoCamera, RobotConfig], Any]
    handlers: dict[str, Callable[[Any], Scan | Pose | View | None]] = field(default_factory=dict)
    scans: int = 0
    poses: int = 0

    def __post_init__(self) -> None:
        name, config = self.has.name, self.config
        if self.has.images:
            kind = "image_rect" if config.images.rectified else "image_raw"
            self.head = head.Head(name, config, self.make)
            for camera in self.head.cameras:
                base = f"/{name}/{camera}"
                self.handlers[f"{base}/camera_info"] = partial(self._on_info, camera)
                self.handlers[f"{base}/{kind}"] = partial(self._on_image, camera)
        else:
            self.handlers[f"/{name}/points"] = self._on_points
        self.stands = bool(self.has.images) and config.pose.source == "static"
        if self.stands:
            static_pose(config.pose, 0)
        else:
            self.handlers[f"/{name}/{self._pose_topic()}"] = self._on_pose
        self._intake = PoseIntake(self.config.pose)

    def _pose_topic(self) -> str:
        has = self.has.poses
        if not self.has.images:
            return "pose"
        return next((name for name in (self.config.pose.source, *has) if name in has), "odom")

    # ---- images ----

    def _on_info(self, camera: str, message: Any) -> View | None:
        return self._view(self.head.take_camera_info(camera, message))

    def _on_image(self, camera: str, message: Any) -> View | None:
        return self._view(self.head.take_image(camera, message))

    def _view(self, view: head.View | None) -> View | None:
        if view is None:
            return None
        times = {"prepare": view.prepare_ms, **view.stages.times_ms}
        camera = self.head.pipeline.camera
        return View(self.has.name, camera, view.images, view.stages, times)

    def _on_points(self, message: Any) -> Scan:
        return messages.read_scan(message, self.has.name)

    # ---- pose ----

    def _on_pose(self, message: Any) -> Pose | None:
        pose = messages.read_pose(message, f"{self.has.name}/base_link")
        frame_id = message.header.frame_id
        config, recorded = self.config.pose, self._pose_topic() == "pose"
        if frame_id.lstrip("/") != config.map_frame and (recorded or not config.map_from_odom):
            remedy = ", or pose.map_from_odom (x, y, yaw of that frame in the map) in a --config"
            raise _FrameError(
                f"frame_id is {frame_id!r}; wanted: {config.map_frame!r}"
                + ("" if recorded else remedy)
            )
        return pose if recorded else self._intake(pose, frame_id)

    def nothing_said(self) -> str:
        """Why there was no scan, as far as it is known."""
        if self.has.images and self.head.pairer.unpaired:
            return f"images found no pair; {self.head.pairer.why_unpaired()}"
        return "it has no camera_info" if self.has.images else "no message on points can be used"

    def no_pose(self) -> str:
        """Why there was no pose."""
        return f"there is nothing on {', '.join(_POSE_TOPICS)}"


# ------------------------------------------------------------------------------------------- run


class BagRun:
    """A bag, and the team that its robots make with some configuration.

    Args:
        path: The bag.
        configs: Parameter files, later ones win. What they do not say follows the bag: which images
            (rectified or raw), whether there is a top camera, where the pose is.
        beside: Whether the bag's own parameter file is read, after the others (`file_beside`).
        use_map: Whether the bag's `/map` masks walls and furniture, whatever the files say.
        pipeline: What makes scans: takes robot, camera and configuration, has `stages(images)`.
        planner: What makes people: takes the configuration, has `step(scans, poses, time_ns)`.

    Attributes:
        path: The bag.
        team: Configuration of the robots of the bag and of the planner.
        notes: What a reader of the results should know, one line each.
        dropped: How many messages were not used in the last run, by topic, or by robot and reason.

    Raises:
        PeopleLocError: The bag cannot be read or has nothing to run, or a file is wrong.
    """

    def __init__(
        self,
        path: str | os.PathLike[str],
        configs: Sequence[str | Path] = (),
        *,
        beside: bool = True,
        use_map: bool = False,
        pipeline: Callable[[str, StereoCamera, RobotConfig], Any] = RobotPipeline,
        planner: Callable[[PlannerConfig], Any] = Planner,
    ) -> None:
        self.path = Path(path)
        self.notes: list[str] = []
        self.dropped: Counter[str] = Counter()
        self._make_pipeline, self._make_planner = pipeline, planner
        with BagReader(self.path) as bag:
            self.start_ns, self.end_ns = bag.start_ns, bag.end_ns
            self._has = robots_of(bag)
            if not self._has:
                raise BagError(
                    f"{self.path}: no robot, i.e. no namespace with left and right images or with "
                    f"points and pose; topics: {', '.join(bag.topics)}"
                )
        own = file_beside(self.path) if beside else None
        if own is not None and own.resolve() not in [Path(file).resolve() for file in configs]:
            configs = [*configs, own]
            self.notes.append(f"{own.name}, which lies beside the bag, was read, too")
        self.team = self._load(configs)
        if use_map:
            planner_config = self.team.planner
            masking = dataclasses.replace(planner_config.masking, occupancy_grid=True)
            planner_config = dataclasses.replace(planner_config, masking=masking)
            self.team = Team(planner_config, self.team.robots)

    def _load(self, configs: Sequence[str | Path]) -> Team:
        has = self._has
        unless_said = {
            name: {
                "images.rectified": "image_rect" in robot.images or not robot.images,
                "images.top": any("top" in cameras for cameras in robot.images.values()),
                "pose.source": "pose_in" if robot.poses[:1] == ("pose_in",) else "odom",
            }
            for name, robot in has.items()
        }
        names = tuple(dict.fromkeys([*robots_named(*configs), *has]))
        team = load_team(*configs, robots=names, unless_said=unless_said)
        listed = team.planner.robots
        wanted = listed or tuple(has)
        if missing := [name for name in names if name not in has]:
            self.notes.append(f"the bag has nothing of {', '.join(missing)}")
        if others := [name for name in has if name not in wanted]:
            self.notes.append(f"the configuration leaves out {', '.join(others)}")
        used = tuple(name for name in wanted if name in has)
        if not used:
            raise BagError(
                f"{self.path}: has none of the configured robots {', '.join(wanted)}; it has: "
                f"{', '.join(has)}"
            )
        return Team(
            dataclasses.replace(team.planner, robots=used),
            {name: self._fit(has[name], team.robots[name]) for name in used},
        )

    def _fit(self, has: BagRobot, config: RobotConfig) -> RobotConfig:
        """The configuration, changed where the bag does not have what it asks for."""
        if not has.images:
            return config
        images = config.images
        rectified = images.rectified
        if ("image_rect" if rectified else "image_raw") not in has.images:
            rectified = not rectified
            self.notes.append(
                f"{has.name}: the bag has only {'rectified' if rectified else 'raw'} images"
            )
        top = images.top and "top" in has.images["image_rect" if rectified else "image_raw"]
        if top != images.top:
            self.notes.append(f"{has.name}: the bag has no top images")
        return dataclasses.replace(
            config, images=dataclasses.replace(images, rectified=rectified, top=top)
        )

    @property
    def duration_s(self) -> float:
        """Seconds from the bag's first message to its last."""
        return (self.end_ns - self.start_ns) * 1e-9

    def truth(self) -> Truth:
        """Ground truth; without any messages where the bag has none."""
        with BagReader(self.path) as bag:
            return read_truth(bag)

    def intervals(
        self,
        *,
        on_view: Callable[[View], None] | None = None,
        on_progress: Callable[[float], None] | None = None,
    ) -> Iterator[Interval]:
        """Runs the bag, from the beginning each time.

        Args:
            on_view: Called with each view, also with those that no interval uses.
            on_progress: Called with how much of the bag is done, 0 to 1.

        Yields:
            The intervals, as they close.

        Raises:
            PeopleLocError: The bag is damaged; the poses of a robot are in an unknown frame; or
                no robot has anything that can be used. Single messages that cannot be used are
                counted in `dropped`, as the nodes do.
        """
        sources = {
            name: _Source(self._has[name], config, self._make_pipeline)
            for name, config in self.team.robots.items()
        }
        handlers = {t: (s, h) for s in sources.values() for t, h in s.handlers.items()}
        collector = IntervalCollector(self.team.planner.interval, self.team.planner.robots)
        planner = self._make_planner(self.team.planner)
        waiting: dict[str, View] = {}  # behind the scans that wait for their interval
        reasons: dict[str, str] = {}
        self.dropped.clear()

        def close(now_ns: int) -> Iterator[Interval]:
            closed = collector.close(now_ns)
            if closed is None:
                return
            for robot, reason in closed.left_out.items():
                reasons.setdefault(robot, reason)
            if closed.scans:
                people = planner.step(closed.scans, closed.all_poses, closed.time_ns)
                names = [scan.robot for scan in closed.scans if scan.robot in waiting]
                views = {name: waiting[name] for name in names}
                yield Interval(now_ns, closed.scans, people, views)

        def take(source: _Source, made: Pose | View | Scan, now_ns: int) -> None:
            if isinstance(made, Pose):
                collector.add_pose(source.has.name, made, now_ns)
                source.poses += 1
                return
            if isinstance(made, View) and on_view is not None:
                on_view(made)
            scan = made.stages.scan if isinstance(made, View) else made
            if source.stands:
                take(source, static_pose(source.config.pose, scan.stamp_ns), now_ns)
            collector.add_scan(scan, now_ns)
            source.scans += 1
            if isinstance(made, View):
                waiting[scan.robot] = made

        span_ns = max(1, self.end_ns - self.start_ns)
        wanted = [*handlers, *([MAP_TOPIC] if self.team.planner.masking.occupancy_grid else [])]
        with BagReader(self.path) as bag:
            if MAP_TOPIC in wanted:
                if MAP_TOPIC not in bag.topics:
                    self._note(f"masking.occupancy_grid is true, but the bag has no {MAP_TOPIC}")
                elif bag.topics[MAP_TOPIC].type != _GRID:
                    raise BagError(
                        f"{self.path}: {MAP_TOPIC} is {bag.topics[MAP_TOPIC].type}; wanted: {_GRID}"
                    )
            for raw in bag.messages([topic for topic in wanted if topic in bag.topics]):
                if raw.topic == MAP_TOPIC:
                    self._take_map(planner, bag.decode(raw))
                    continue
                source, handle = handlers[raw.topic]
                # The live planner looks at the clock all the time, not only when something comes.
                yield from close(raw.time_ns)
                message = bag.decode(raw)
                try:
                    made = handle(message)
                    if made is not None:
                        take(source, made, raw.time_ns)
                except _FrameError as err:
                    raise PoseError(f"{self.path}: {raw.topic}: {err}") from err
                except PeopleLocError as err:
                    self.dropped[raw.topic] += 1
                    reasons.setdefault(source.has.name, f"{raw.topic}: {err}")
                yield from close(raw.time_ns)
                if on_progress is not None:
                    on_progress((raw.time_ns - self.start_ns) / span_ns)
        yield from close(self.end_ns + round(self.team.planner.interval.max_wait * 1e9))
        for name, source in sources.items():
            for reason, count in collector.robot(name).dropped.items():
                self.dropped[f"{name}: scan {reason}"] += count
            if source.has.images and source.head.pairer.unpaired:
                self.dropped[f"{name}: image without its pair"] += source.head.pairer.unpaired
        self._check(sources, reasons)

    def _take_map(self, planner: Any, message: Any) -> None:
        try:
            planner.take_grid(messages.read_occupancy_grid(message, self.team.planner.map_frame))
        except GridError as err:
            self.dropped[MAP_TOPIC] += 1
            self._note(f"{MAP_TOPIC}: {err}")

    def _note(self, line: str) -> None:
        if line not in self.notes:
            self.notes.append(line)

    def _check(self, sources: Mapping[str, _Source], reasons: Mapping[str, str]) -> None:
        """Notes robots that gave nothing; an error if it was all of them."""
        silent = {}
        for name, source in sources.items():
            if not source.scans:
                silent[name] = "no scan: " + reasons.get(name, source.nothing_said())
            elif not source.poses:
                silent[name] = "no pose: " + reasons.get(name, source.no_pose())
        lines = [f"{name}: {why}" for name, why in silent.items()]
        if len(silent) == len(sources):
            raise BagError(f"{self.path}: {'; '.join(lines)}")
        lines += [f"{name}: {why}" for name, why in reasons.items() if name not in silent]
        for line in lines:
            self._note(line)


def has_people(bag: BagReader) -> bool:
    """Whether a planner's `people` are in a bag."""
    return any(topic.type == PEOPLE_TYPE and topic.count for topic in bag.topics.values())


def read_recorded(bag: BagReader) -> tuple[str, list[Estimate]]:
    """The people that a planner said when a bag was recorded.

    Returns:
        The topic, and what was said on it.

    Raises:
        BagError: There is no such topic, or several; two people of a message have one id; or they
            are more than are scored.
    """
    topics = [t.name for t in bag.topics.values() if t.type == PEOPLE_TYPE and t.count]
    if len(topics) != 1:
        raise BagError(
            f"{bag.path}: has {len(topics)} topics of {PEOPLE_TYPE}; wanted: one "
            f"(topics: {', '.join(topics or bag.topics)})"
        )
    try:
        estimates = [read_estimate(message) for _, _, message in bag.decoded(topics)]
    except ValueError as err:
        raise BagError(f"{bag.path}: {topics[0]}: {err}") from err
    ids = len({int(one) for estimate in estimates for one in estimate.ids})
    if ids > _MAX_IDS:
        raise BagError(f"{bag.path}: {topics[0]} has {ids} ids; allowed: {_MAX_IDS}. Cut the bag")
    return topics[0], estimates

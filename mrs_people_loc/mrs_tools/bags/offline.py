"""A bag through the pipeline in this process, as fast as it goes.

    run = BagRun("bags/paper_formation")
    for interval in run.intervals():
        interval.people                      # what the planner would publish
        interval.views["robot_a"].stages     # what its robots made of their images
    run.truth()                              # ground truth, if the bag has it

What comes out is what the live nodes would say on an infinitely fast machine: messages are handed
over in the order of their bag time, and bag time is the clock. Robots are discovered as namespaces
of the bag; their images, or the `points` that they sent, are where an interval starts from. Beside
`points` their poses are those on `pose`, or else made of odometry, as with images. To try another
method, hand over other classes than `RobotPipeline` and `Planner`.
"""

from __future__ import annotations

import dataclasses
import os
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from mrs_people_loc import messages
from mrs_people_loc.config import PlannerConfig, RobotConfig, Team, load_team, robots_named
from mrs_people_loc.errors import BagError, GridError, PeopleLocError, PoseError
from mrs_people_loc.planner import People, Planner
from mrs_people_loc.robot import RobotPipeline
from mrs_people_loc.scan import Scan
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.team.intervals import IntervalCollector
from mrs_people_loc.team.poses import Pose, static_pose
from mrs_tools.bags.reader import BagReader
from mrs_tools.bags.records import Truth
from mrs_tools.bags.sources import (
    GRID_TYPE,
    MAP_TOPIC,
    BagRobot,
    FrameError,
    RobotView,
    Source,
    own_file,
    robots_of,
)
from mrs_tools.bags.team_localization import TeamLocalization
from mrs_tools.bags.truth import read_truth


@dataclass(frozen=True)
class Interval:
    """One run of the planner.

    Attributes:
        closed_ns: Bag time at which it closed [ns].
        scans: What it was made from.
        people: What came out.
        views: By robot, the view behind its scan; not for robots whose `points` were recorded.
        apart: By robot in quarantine, its pose: its scan takes no part.
    """

    closed_ns: int
    scans: Sequence[Scan]
    people: People
    views: Mapping[str, RobotView]
    apart: Mapping[str, Pose] = field(default_factory=dict)


class _Playback:
    """One run of a bag: what its messages have become so far.

    Args:
        sources: The robots, by name.
        team: Their configuration.
        planner: What makes people.
        on_view: Called with each view.

    Attributes:
        handlers: By topic, its robot and what takes its messages.
        planner: What makes people.
        reasons: By robot, why its first message or scan was not used.
    """

    def __init__(
        self,
        sources: Mapping[str, Source],
        team: Team,
        planner: Any,
        on_view: Callable[[RobotView], None] | None,
    ) -> None:
        self.handlers = {t: (s, h) for s in sources.values() for t, h in s.handlers.items()}
        self.planner = planner
        self.reasons: dict[str, str] = {}
        self._sources = sources
        self._collector = IntervalCollector(team.planner.interval, team.planner.robots)
        self._on_view = on_view
        self._config = team.planner
        self._team = TeamLocalization(
            {name: source.localization for name, source in sources.items() if source.localizes}
        )
        self._waiting: dict[str, RobotView] = {}  # behind the scans that wait for their interval

    def take(self, topic: str, message: Any, now_ns: int) -> None:
        """Takes a message.

        Raises:
            PeopleLocError: It cannot be used.
        """
        source, handle = self.handlers[topic]
        made = handle(message)
        if isinstance(made, Pose):
            self._take_pose(source, made, now_ns)
        elif made is not None:
            self._take_scan(source, made, now_ns)

    def _take_pose(self, source: Source, pose: Pose, now_ns: int) -> None:
        self._collector.add_pose(source.has.name, pose, now_ns)
        self._team.share(source.has.name, now_ns)
        source.poses += 1

    def _take_scan(self, source: Source, made: RobotView | Scan, now_ns: int) -> None:
        if isinstance(made, RobotView):
            if self._on_view is not None:
                self._on_view(made)
            if source.localizes:
                stages = made.stages
                source.localization.take_view(stages.scan, stages.disparity, made.camera)
        scan = made.stages.scan if isinstance(made, RobotView) else made
        if source.stands:
            self._take_pose(source, static_pose(source.config.pose, scan.stamp_ns), now_ns)
        self._collector.add_scan(scan, now_ns)
        source.scans += 1
        if isinstance(made, RobotView):
            self._waiting[scan.robot] = made

    def close(self, now_ns: int) -> Iterator[Interval]:
        """The interval that closes now, if one does and has scans."""
        closed = self._collector.close(now_ns, self._team.quarantine.at(now_ns))
        if closed is None:
            return
        for robot, reason in closed.left_out.items():
            self.reasons.setdefault(robot, reason)
        people: People | None = None
        if closed.scans:
            people = self.planner.step(closed.scans, closed.all_poses, closed.time_ns)
            if closed.quarantined:
                people = dataclasses.replace(people, quarantined=closed.quarantined)
        walls = getattr(self.planner, "walls", None)
        self._team.measure(closed, people, self._config, walls)
        if people is not None:
            names = [scan.robot for scan in closed.scans if scan.robot in self._waiting]
            views = {name: self._waiting[name] for name in names}
            yield Interval(now_ns, closed.scans, people, views, closed.apart_poses)

    def unused(self) -> Counter[str]:
        """How many scans and images were not used, by robot and reason."""
        counts: Counter[str] = Counter()
        for name, source in self._sources.items():
            for reason, count in self._collector.robot(name).dropped.items():
                counts[f"{name}: scan {reason}"] += count
            if source.has.images and source.head.pairer.unpaired:
                counts[f"{name}: image without its pair"] += source.head.pairer.unpaired
        return counts


class BagRun:
    """A bag, and the team that its robots make with some configuration.

    Args:
        path: The bag.
        configs: Parameter files, later ones win. What they do not say follows the bag: which images
            (rectified or raw), whether there is a top camera, where the pose is.
        beside: Whether the bag's own parameter file is read, after the others (`own_file`).
        use_map: Whether the bag's `/map` masks walls and furniture, whatever the files say.
        tracking: Whether people are followed, whatever the files say; None: as they say.
        localize: Whether robots correct odometry that is dead reckoning, as their nodes do.
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
        tracking: bool | None = None,
        localize: bool = False,
        pipeline: Callable[[str, StereoCamera, RobotConfig], Any] = RobotPipeline,
        planner: Callable[[PlannerConfig], Any] = Planner,
    ) -> None:
        self.path = Path(path)
        self.notes: list[str] = []
        self.dropped: Counter[str] = Counter()
        self._make_pipeline, self._make_planner = pipeline, planner
        self._localize = localize
        with BagReader(self.path) as bag:
            self.start_ns, self.end_ns = bag.start_ns, bag.end_ns
            self._has = robots_of(bag)
            if not self._has:
                raise BagError(
                    f"{self.path}: no robot, i.e. no namespace with left and right images or with "
                    f"points and pose, odom or pose_in; topics: {', '.join(bag.topics)}"
                )
        own = own_file(self.path, configs) if beside else None
        if own is not None:
            configs = [*configs, own]
            self.notes.append(f"{own.name}, which lies beside the bag, was read, too")
        self.team = self._load(configs)
        planner_config = self.team.planner
        if use_map:
            masking = dataclasses.replace(planner_config.masking, occupancy_grid=True)
            planner_config = dataclasses.replace(planner_config, masking=masking)
        if tracking is not None:
            followed = dataclasses.replace(planner_config.tracking, enabled=tracking)
            planner_config = dataclasses.replace(planner_config, tracking=followed)
        self.team = Team(planner_config, self.team.robots)

    def _load(self, configs: Sequence[str | Path]) -> Team:
        has = self._has
        defaults = {
            name: {
                "images.rectified": "image_rect" in robot.images or not robot.images,
                "images.top": any("top" in cameras for cameras in robot.images.values()),
                "pose.source": "pose_in" if robot.poses[:1] == ("pose_in",) else "odom",
            }
            for name, robot in has.items()
        }
        names = tuple(dict.fromkeys([*robots_named(*configs), *has]))
        team = load_team(*configs, robots=names, defaults=defaults)
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
        on_view: Callable[[RobotView], None] | None = None,
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
            name: Source(self._has[name], config, self._make_pipeline, self._localize)
            for name, config in self.team.robots.items()
        }
        playback = _Playback(sources, self.team, self._make_planner(self.team.planner), on_view)
        span_ns = max(1, self.end_ns - self.start_ns)
        self.dropped.clear()
        with BagReader(self.path) as bag:
            for raw in bag.messages(self._topics(bag, playback)):
                if raw.topic == MAP_TOPIC:
                    self._take_map(playback.planner, bag.decode(raw))
                    continue
                # The live planner looks at the clock all the time, not only when something comes.
                yield from playback.close(raw.time_ns)
                self._take(playback, raw.topic, bag.decode(raw), raw.time_ns)
                yield from playback.close(raw.time_ns)
                if on_progress is not None:
                    on_progress((raw.time_ns - self.start_ns) / span_ns)
        yield from playback.close(self.end_ns + round(self.team.planner.interval.max_wait * 1e9))
        self.dropped.update(playback.unused())
        self._check(sources, playback.reasons)

    def _topics(self, bag: BagReader, playback: _Playback) -> list[str]:
        """Topics of the bag that are read.

        Raises:
            BagError: The bag's `/map`, which is to be used, has another type.
        """
        wanted = list(playback.handlers)
        if self.team.planner.masking.occupancy_grid:
            wanted.append(MAP_TOPIC)
            if MAP_TOPIC not in bag.topics:
                self._note(f"masking.occupancy_grid is true, but the bag has no {MAP_TOPIC}")
            elif bag.topics[MAP_TOPIC].type != GRID_TYPE:
                raise BagError(
                    f"{self.path}: {MAP_TOPIC} is {bag.topics[MAP_TOPIC].type}; wanted: {GRID_TYPE}"
                )
        return [topic for topic in wanted if topic in bag.topics]

    def _take(self, playback: _Playback, topic: str, message: Any, now_ns: int) -> None:
        """Hands a message over; one that cannot be used is counted.

        Raises:
            PoseError: It is a pose in an unknown frame.
        """
        try:
            playback.take(topic, message, now_ns)
        except FrameError as err:
            raise PoseError(f"{self.path}: {topic}: {err}") from err
        except PeopleLocError as err:
            self.dropped[topic] += 1
            source, _ = playback.handlers[topic]
            playback.reasons.setdefault(source.has.name, f"{topic}: {err}")

    def _take_map(self, planner: Any, message: Any) -> None:
        try:
            planner.take_grid(messages.read_occupancy_grid(message, self.team.planner.map_frame))
        except GridError as err:
            self.dropped[MAP_TOPIC] += 1
            self._note(f"{MAP_TOPIC}: {err}")

    def _note(self, line: str) -> None:
        if line not in self.notes:
            self.notes.append(line)

    def _check(self, sources: Mapping[str, Source], reasons: Mapping[str, str]) -> None:
        """Notes robots that gave nothing; an error if it was all of them."""
        silent = {}
        for name, source in sources.items():
            if not source.scans:
                silent[name] = "no scan: " + reasons.get(name, source.why_no_scan())
            elif not source.poses:
                silent[name] = "no pose: " + reasons.get(name, source.no_pose())
        lines = [f"{name}: {why}" for name, why in silent.items()]
        if len(silent) == len(sources):
            raise BagError(f"{self.path}: {'; '.join(lines)}")
        lines += [f"{name}: {why}" for name, why in reasons.items() if name not in silent]
        for line in lines:
            self._note(line)

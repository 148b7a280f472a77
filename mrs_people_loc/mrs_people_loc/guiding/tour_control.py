"""Tours of a team, one at a time: when one may begin, what its robots get, and why it ends."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Collection, Container, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np

from mrs_people_loc.clocks import BELIEVED, RESET_NS, Standstill
from mrs_people_loc.config import GuideConfig
from mrs_people_loc.errors import AheadError, TourError
from mrs_people_loc.guiding.drive import Velocity
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.guidance import Guidance, Post, State
from mrs_people_loc.guiding.guide import Guide
from mrs_people_loc.guiding.tour import Tour
from mrs_people_loc.people import Group, Person
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_loc.team.poses import Pose


@dataclass(frozen=True)
class ControlTuning:
    """Constants of the control of tours; chosen.

    Attributes:
        most_robots: Robots of a tour, at most.
        goals_s: Period of goals while there are no people [s].
        look_s: Period of looking for robots without a base [s].
        recorders: Nodes with these names subscribe to everything, and are no base.
        ahead_s: Stamps that are farther ahead of the clock than this are refused [s].
        attended_s: An attended tour ends once its client is silent for so long [s].
        late_s: Velocities that took longer than this are outdated: zero is sent instead [s].
        frozen_s: Simulated time has ended once it stands still for so long [s]: likewise.
    """

    most_robots: int = 4
    goals_s: float = 0.2
    look_s: float = 1.0
    recorders: tuple[str, ...] = ("mrs_record", "rosbag2_recorder")
    ahead_s: float = 0.1
    attended_s: float = 2.0
    late_s: float = 0.05
    frozen_s: float = 1.0


CONTROL_TUNING = ControlTuning()


@dataclass(frozen=True)
class Now:
    """The time.

    Attributes:
        ns: By which ages are counted, that nobody sets back; or simulated time [ns].
        stamp_ns: By the clock of stamps [ns].
        steady_s: That goes on while simulated time stands still [s].
    """

    ns: int
    stamp_ns: int
    steady_s: float

    def of_stamp(self, stamp_ns: int) -> int:
        """What `ns` was at a stamp [ns]; now at the latest."""
        return self.ns - max(self.stamp_ns - stamp_ns, 0)


@dataclass(frozen=True)
class Ends:
    """Who is at a topic.

    Attributes:
        topic: Its full name.
        publishers: Full names of the nodes that publish; on commands, of the others.
        subscribers: Names of the nodes that subscribe.
        monitors: Full names of the nodes that would take commands, and limit them by what is in the
            way.
    """

    topic: str
    publishers: Sequence[str] = ()
    subscribers: Sequence[str] = ()
    monitors: Sequence[str] = ()


class Bases(Protocol):
    """How robots are driven: by velocities, or by goals."""

    def begin(self, robots: Iterable[str], monitored: Container[str] = ()) -> None:
        """Takes the robots of a tour, and those of them that a monitor drives."""

    def drive(self, velocities: Mapping[str, Velocity]) -> None:
        """Sends velocities; robots without one stand."""

    def send(self, posts: Mapping[str, Post], poses: Mapping[str, Pose]) -> None:
        """Moves goals to posts; of robots without one, to where these are."""

    def stop(self, poses: Mapping[str, Pose]) -> None:
        """Lets the robots stand."""

    def keep_standing(self, *, always: bool) -> None:
        """Called at the rate of velocities without a tour; always: robots are stopped."""

    def finish(self) -> None:
        """Waits until what was sent last has arrived."""


class Host(Protocol):
    """What a node does for the control, and knows of the network."""

    def publish(self, tour: Tour | None, guidance: Guidance, poses: Mapping[str, Pose]) -> None:
        """Publishes how a tour goes on, or that there is none."""

    def say(self, event: str) -> None:
        """Publishes a sentence."""

    def ended(self, message: str, *, finished: bool, lost: Sequence[int]) -> None:
        """Publishes how a tour has ended, and without whom, by their ids."""

    def people(self) -> Ends:
        """Of the people."""

    def pose(self, robot: str) -> Ends:
        """Of a robot's poses."""

    def commands(self, robot: str) -> Ends:
        """Of a robot's commands."""

    def guides(self) -> Ends:
        """Of what guides publish of their tours; this one is among them."""


class TourControl:
    """Begins tours, drives their robots, and ends them.

    `drive` may be called by another thread than all the rest.

    Args:
        config: Parameters.
        bases: Of the robots.
        host: Of this control.
        tuning: Constants.

    Attributes:
        config: Parameters; of a tour under way, see `configure`.
        guide: The tour under way; None: there is none.
        grid: The map; None: none has come.
        stopped: Who has stopped the robots, in words; empty: nobody.
        unmonitored: Names of the robots of the last tour that no collision monitor drives.
    """

    def __init__(
        self, config: GuideConfig, bases: Bases, host: Host, tuning: ControlTuning = CONTROL_TUNING
    ) -> None:
        self.config, self._bases, self._host, self._tuning = config, bases, host, tuning
        self.guide: Guide | None = None
        self.grid: OccupancyGrid | None = None
        self.stopped = ""
        self._attended_s: float | None = None  # when a client was heard; None: it need not be
        self._stated_s = 0.0
        self.unmonitored: tuple[str, ...] = ()
        self._monitored: frozenset[str] = frozenset()
        self._poses: dict[str, tuple[Pose, int]] = {}  # stamped by `Now.ns`, and when it came [ns]
        self._people_came_s: float | None = None
        self._people_before: tuple[int, Mapping[str, int]] | None = None  # stamps, of scans, too
        self._again = 0  # people in a row that were no news
        self._told: set[str] = set()  # what is told once a tour
        self._have_ids = True
        self._used_ns: dict[str, int] = {}  # when a scan of a robot was used last
        self._people_ns = self._sent_ns = self._looked_ns = 0
        self._clock = Standstill()

    # ---- inputs ----

    def configure(self, config: GuideConfig, now: Now) -> None:
        """Takes new parameters at once; another list of robots from the next tour on."""
        self.config = config
        if self.guide is not None:
            before, self.guide.config = self.guide.config.safety, config
            if config.safety.occupied_from != before.occupied_from:
                space = _space(self.grid, self.guide.tour, config)
                self._go_on(self.guide, self.guide.take_space(space), now)

    def take_pose(self, robot: str, pose: Pose, now: Now) -> None:
        """Takes a pose of any robot, unless it comes late, or again.

        Raises:
            AheadError: Its stamp is ahead of the clock.
        """
        self._check_is_past(pose.stamp_ns, now, partial(self._host.pose, robot))
        pose = dataclasses.replace(pose, stamp_ns=now.of_stamp(pose.stamp_ns))
        before = self._poses.get(robot)
        if before is not None and 0 <= before[0].stamp_ns - pose.stamp_ns < RESET_NS:
            return
        self._poses[robot] = pose, now.ns
        if self.guide is not None:
            self.guide.take_pose(robot, pose, now.ns)

    def take_people(
        self,
        stamp_ns: int,
        people: Sequence[Person],
        groups: Sequence[Group],
        scans: Mapping[str, int],
        now: Now,
        quarantined: Collection[str] = (),
    ) -> None:
        """Takes the people of an interval, unless they come late, or again.

        Args:
            stamp_ns: Of the people [ns].
            people: Who is followed.
            groups: Their groups.
            scans: By robot whose scan was used, its stamp [ns].
            now: When they came.
            quarantined: Names of those in quarantine.

        Raises:
            AheadError: The stamp is ahead of the clock.
        """
        self._check_is_past(stamp_ns, now, self._host.people)
        before = self._people_before
        if before is not None:
            is_same = bool(scans) and scans == before[1]
            if is_same or 0 <= before[0] - stamp_ns < RESET_NS:
                self._again += 1
                if self._again == BELIEVED:
                    topic = self._host.people().topic
                    self._tell_once(f"people on {topic} come late, or again: these count as old")
                return
        self._again = 0
        self._people_before = stamp_ns, dict(scans)
        self._people_came_s = now.steady_s
        self._have_ids = not people or any(person.id for person in people)
        self._used_ns |= dict.fromkeys(scans, now.ns)
        guide = self.guide
        if guide is None:
            return
        self._people_ns = stamp_ns
        if now.ns - self._looked_ns >= self._tuning.look_s * 1e9:
            faults = {robot: self._fault_of_base(robot) for robot in guide.config.robots}
            guide.faults = {robot: fault for robot, fault in faults.items() if fault}
            self._take_monitors(guide)
            self._looked_ns = now.ns
        in_time_ns = now.of_stamp(stamp_ns)
        guidance = guide.take_people(people, groups, in_time_ns, now.ns, scans, quarantined)
        for limit in guide.limits(len(people)):
            self._tell_once(limit)
        self._go_on(guide, guidance, now)

    def space_by(self, grid: OccupancyGrid) -> tuple[Guide, FreeSpace] | None:
        """What a map makes of the free floor of the tour under way; another thread may call it.

        Returns:
            The tour, and its free floor; None: there is none, or the map is the same.
        """
        guide, before = self.guide, self.grid
        if guide is None or (before is not None and _are_same(before, grid)):
            return None
        return guide, _space(grid, guide.tour, guide.config)

    def take_grid(
        self, grid: OccupancyGrid, made: tuple[Guide, FreeSpace] | None, now: Now
    ) -> None:
        """Takes the map, with what `space_by` has made of it."""
        guide, known = self.guide, made is not None and made[0] is self.guide
        if guide is not None:
            made = made if known else self.space_by(grid)
        self.grid = grid
        if guide is not None and made is not None:
            self._go_on(guide, guide.take_space(made[1]), now)

    def forget(self) -> None:
        """Forgets what has come: the time jumped back, or the node is deactivated."""
        self._poses.clear()
        self._used_ns.clear()
        self._people_came_s = self._people_before = None

    def tick(self, now: Now) -> None:
        """Halts a tour whose people are outdated, and moves goals; to be called often."""
        guide, tuning = self.guide, self._tuning
        if self.stopped and now.steady_s - self._stated_s >= tuning.look_s:
            self._tell_stopped(now)
        if guide is None:
            return
        if self._attended_s is not None and now.steady_s - self._attended_s > tuning.attended_s:
            self.end(f"its client has been silent for {tuning.attended_s:g} s")
            return
        self._go_on(guide, guide.check_age(now.ns), now)
        if now.ns - self._sent_ns >= tuning.goals_s * 1e9:
            self._send_goals(guide, now)

    def drive(self, clock: Callable[[], Now]) -> None:
        """Drives the robots; to be called at the rate of velocities. They stand where that fails.

        Args:
            clock: Tells the time: velocities that took too long are not sent.
        """
        guide, stopped = self.guide, bool(self.stopped)
        if guide is None or stopped:
            self._bases.keep_standing(always=stopped)
            return
        now = clock()
        try:
            velocities = guide.velocities(now.ns)
        except Exception:
            self._bases.drive({})
            raise
        is_late = clock().steady_s - now.steady_s > self._tuning.late_s
        frozen = self._clock.lasts_s(now.ns, now.steady_s) > self._tuning.frozen_s
        self._bases.drive({} if is_late or frozen else velocities)

    @property
    def monitored(self) -> frozenset[str]:
        """Names of the robots of the last tour that collision monitors drive."""
        return self._monitored

    def take_driven(self, robot: str, velocity: Velocity) -> None:
        """Takes what a collision monitor has made of a robot's velocity."""
        if self.guide is not None:
            self.guide.take_driven(robot, velocity)

    def _check_is_past(self, stamp_ns: int, now: Now, ends: Callable[[], Ends]) -> None:
        """Refuses what is of the future.

        Raises:
            AheadError: It is.
        """
        ahead_s, allowed = (stamp_ns - now.stamp_ns) / 1e9, self._tuning.ahead_s
        if ahead_s > allowed:
            self._tell_once(f"stamps on {ends().topic} are ahead of the clock: refused")
            raise AheadError(f"stamp is {ahead_s:.2f} s ahead of the clock; allowed: {allowed:g} s")

    def _tell_once(self, event: str) -> None:
        if event not in self._told:
            self._told.add(event)
            self._host.say(event)

    # ---- a stop that holds ----

    def stop(self, reason: str, now: Now) -> None:
        """Lets all robots stand until `release`: those of a tour, which is kept, or the last ones.

        Args:
            reason: Who has stopped them, in words.
            now: The time.
        """
        if self.stopped:
            return
        self.stopped, guide = reason, self.guide
        self._bases.stop({} if guide is None else guide.poses())
        if guide is None:
            self._host.say(reason)
            self._tell_stopped(now)
        else:
            self._publish(guide, guide.stop(reason))

    def release(self, now: Now) -> None:
        """Ends a stop: a tour goes on."""
        if not self.stopped:
            return
        self.stopped, guide = "", self.guide
        self._host.say("released")
        if guide is None:
            self._host.publish(None, Guidance(now.stamp_ns, State.IDLE), {})
        else:
            self._bases.begin(guide.config.robots, self._monitored)
            self._publish(guide, guide.release())

    def _tell_stopped(self, now: Now) -> None:
        """Publishes it again, for those who have come since."""
        self._stated_s = now.steady_s
        if self.guide is None:
            stopped = Guidance(now.stamp_ns, State.STOPPED, self.stopped)
            self._host.publish(None, stopped, {})
        else:
            self._publish(self.guide, self.guide.guidance)

    # ---- a tour ----

    def attend(self, now: Now) -> None:
        """Takes a word of the client of an attended tour."""
        if self._attended_s is not None:
            self._attended_s = now.steady_s

    def check_is_free(self) -> None:
        """Checks whether a tour may begin, before it is read.

        Raises:
            TourError: Another one is under way, or the robots are stopped.
        """
        if self.stopped:
            raise TourError(f"{self.stopped}; release the robots first: mrs tour release")
        if self.guide is not None:
            raise TourError(f"the tour {self.guide.tour.name!r} is under way; cancel it first")

    def begin(self, tour: Tour, now: Now, *, attended: bool = False) -> Guide:
        """Begins a tour.

        Args:
            tour: The tour.
            now: The time.
            attended: Whether it ends where its client is silent, see `attend`.

        Raises:
            TourError: Something is wrong with it, or with the team.
        """
        self.check_is_free()
        tour = dataclasses.replace(tour, name=tour.name or "tour")
        config = dataclasses.replace(self.config, robots=self._check_team(now))
        guide = Guide(tour, config, _space(self.grid, tour, config), now.ns)
        for robot, (pose, came_ns) in self._poses.items():
            guide.take_pose(robot, pose, came_ns)
        driven = config.robots if config.drive == "cmd_vel" else ()
        self.unmonitored = tuple(name for name in driven if not self._monitors(name))
        self._monitored = frozenset(driven) - {*self.unmonitored}
        self._bases.begin(config.robots, self._monitored)
        if self.unmonitored:
            self._host.say(without_monitor(self.unmonitored))
        self._told.clear()
        self._attended_s = now.steady_s if attended else None
        self.guide = guide
        self._people_ns, self._sent_ns, self._looked_ns = now.stamp_ns, 0, 0
        if self.grid is None:
            self._host.say("there is no map: the robots do not keep clear of walls")
        return guide

    def end(self, reason: str = "", *, last: bool = False) -> None:
        """Ends the tour under way, if there is one: the robots stand.

        Args:
            reason: Why, in words; empty: somebody asked for it.
            last: Whether nothing is published after it: what stops the robots is waited for.
        """
        if self.guide is not None:
            self._ended(self.guide, self.guide.cancel(reason), last=last)

    def _ended(self, guide: Guide, guidance: Guidance, *, last: bool = False) -> None:
        """Lets the robots of a tour that has ended stand, and publishes how it has."""
        self.guide = None
        self._bases.stop(guide.poses())
        if last:
            self._bases.finish()
        self._publish(guide, guidance)
        message = guidance.reason or "cancelled"
        finished = guidance.state == State.FINISHED
        if not finished:
            self._host.say(f"the tour {guide.tour.name} has ended: {message}")
        self._host.ended(message, finished=finished, lost=guidance.lost)

    def _go_on(self, guide: Guide, guidance: Guidance | None, now: Now) -> None:
        """Publishes how a tour goes on, if that has changed, and moves goals; ends one that has."""
        if guidance is None:
            return
        if guide.is_running:
            self._publish(guide, guidance)
            self._send_goals(guide, now)
        else:
            self._ended(guide, guidance)

    def _send_goals(self, guide: Guide, now: Now) -> None:
        """Moves goals to posts, or to where robots are whose poses are outdated."""
        if self.stopped:
            return
        self._bases.send(guide.goals(now.ns), guide.poses())
        self._sent_ns = now.ns

    def _publish(self, guide: Guide, guidance: Guidance) -> None:
        guidance = dataclasses.replace(guidance, stamp_ns=self._people_ns)
        self._host.publish(guide.tour, guidance, guide.poses())

    # ---- the team ----

    def _check_team(self, now: Now) -> tuple[str, ...]:
        """The robots of a tour that begins now.

        Raises:
            TourError: There is another guide, there are no people or robots, or a robot cannot take
                part.
        """
        config, most = self.config, self._tuning.most_robots
        guides, people = self._host.guides(), self._host.people().topic
        if len(guides.publishers) > 1:
            raise TourError(second_guide(guides.topic, guides.publishers))
        if self._people_came_s is None:
            raise TourError(f"nothing comes on {people}; is the planner running?")
        silent_s = now.steady_s - self._people_came_s
        if silent_s > config.safety.robot_timeout:
            raise TourError(f"nothing came on {people} for {silent_s:.1f} s; `mrs doctor` says why")
        if not self._have_ids:
            raise TourError(f"people on {people} have no ids; set tracking.enabled of the planner")
        robots = config.robots or self._robots_in_use(now)
        if not 1 <= len(robots) <= most:
            named = ", ".join(robots) or "the planner uses no robot's scans"
            raise TourError(
                f"robots of the tour: {named}; allowed: 1 to {most}, by the parameter `robots`"
            )
        if config.leader and config.leader not in robots:
            raise TourError(f"leader is {config.leader!r}; allowed: {', '.join(robots)}")
        for robot in robots:
            self._check_robot(robot, now)
        return robots

    def _robots_in_use(self, now: Now) -> tuple[str, ...]:
        """Robots whose scans the planner has used lately."""
        oldest_ns = now.ns - round(self.config.safety.robot_timeout * 1e9)
        return tuple(sorted(robot for robot, used in self._used_ns.items() if used >= oldest_ns))

    def _check_robot(self, robot: str, now: Now) -> None:
        pose, topic = self._poses.get(robot), self._host.pose(robot).topic
        if pose is None:
            raise TourError(f"{robot} has no pose: nothing comes on {topic}")
        age_s, timeout = (now.ns - pose[0].stamp_ns) / 1e9, self.config.safety.robot_timeout
        if age_s > timeout:
            raise TourError(
                f"{robot}: the pose on {topic} is {age_s:.1f} s old; allowed: {timeout:g} s"
            )
        fault, commands = self._fault_of_base(robot), self._host.commands(robot)
        if fault:
            raise TourError(f"{robot} {fault}")
        if self.config.safety.monitored and not self._monitors(robot):
            raise TourError(
                f"{robot} has no collision monitor, and safety.monitored is true; "
                "nobody subscribes to its cmd_vel_guide"
            )
        if commands.publishers:
            others = ", ".join(commands.publishers)
            raise TourError(f"{robot} is driven by others: {others} on {commands.topic}; end them")

    def _take_monitors(self, guide: Guide) -> None:
        """Drives robots through the monitors that have come since the tour began."""
        found = {robot for robot in self.unmonitored if self._monitors(robot)}
        if not found or self.stopped:
            return
        self.unmonitored = tuple(robot for robot in self.unmonitored if robot not in found)
        self._monitored |= found
        self._bases.begin(guide.config.robots, self._monitored)
        self._host.say(f"drives {', '.join(sorted(found))} through collision monitors from now on")

    def _fault_of_base(self, robot: str) -> str:
        """Why a robot cannot be driven; empty: it can."""
        base = self._host.commands(robot)
        if not self._but_recorders(base.subscribers):
            return f"has no base: nobody subscribes to {base.topic}"
        if self.guide is not None and robot in self._monitored and not self._monitors(robot):
            return f"has no base: nobody subscribes to {base.topic}_guide"
        return ""

    def _monitors(self, robot: str) -> list[str]:
        """Names of the nodes that limit a robot's commands by what is in the way."""
        return self._but_recorders(self._host.commands(robot).monitors)

    def _but_recorders(self, names: Iterable[str]) -> list[str]:
        recorders = self._tuning.recorders
        return [one for one in names if not one.rpartition("/")[2].startswith(recorders)]


def without_monitor(robots: Sequence[str]) -> str:
    """That robots have no collision monitor, in words."""
    return f"no collision monitor: only tracked people and the map stop {', '.join(robots)}"


def second_guide(topic: str, guides: Sequence[str]) -> str:
    """That there are several guides, in words.

    Args:
        topic: Full name of `guide_status`.
        guides: Full names of the nodes that publish it.
    """
    return (
        f"{len(guides)} publishers on {topic}: {', '.join(guides)}; another guide_node, or a "
        "replay of one, is at work: end it, or give it a namespace or a ROS_DOMAIN_ID of its own; "
        "or one was killed in the last 20 s"
    )


def _space(grid: OccupancyGrid | None, tour: Tour, config: GuideConfig) -> FreeSpace:
    if grid is None:
        return FreeSpace.unbounded()
    return FreeSpace(grid, occupied_from=config.safety.occupied_from, around=tour.points)


def _are_same(one: OccupancyGrid, other: OccupancyGrid) -> bool:
    places = [(grid.resolution, grid.x, grid.y, grid.yaw) for grid in (one, other)]
    return places[0] == places[1] and np.array_equal(one.data, other.data)

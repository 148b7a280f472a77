"""A tour under way: who is guided, where the robots go, and how they drive there."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping, Sequence

from mrs_people_loc.config import GuideConfig
from mrs_people_loc.errors import TourError
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.guidance import Guidance, Post, State
from mrs_people_loc.guiding.guide import Guide
from mrs_people_loc.guiding.steering import Steering, Velocity
from mrs_people_loc.guiding.tour import Tour, check_tour
from mrs_people_loc.people import Group, Person
from mrs_people_loc.team.poses import Pose


class RunningTour:
    """A tour under way.

    Args:
        tour: The tour.
        config: Parameters; `robots` are those of the tour.
        space: Free floor.
        now_ns: Time [ns].

    Attributes:
        tour: The tour.
        guidance: The last one; without events, which are told once.

    Raises:
        TourError: The tour is not possible there.
    """

    def __init__(self, tour: Tour, config: GuideConfig, space: FreeSpace, now_ns: int) -> None:
        check_tour(tour, space, config.safety.wall_distance)
        self.tour = tour
        self.guidance = Guidance(now_ns, State.GATHERING)
        self._guide = Guide(config, space)
        self._steering = Steering(config, space, config.robots)
        self._guide.begin(tour)
        self._begun_ns = now_ns
        self._misfit = ""

    @property
    def is_running(self) -> bool:
        """Whether it has not ended."""
        return self._guide.is_running

    @property
    def config(self) -> GuideConfig:
        """Parameters; may be replaced at any time, but for `robots`."""
        return self._guide.config

    @config.setter
    def config(self, config: GuideConfig) -> None:
        config = dataclasses.replace(config, robots=self.robots)
        self._guide.config = self._steering.config = config

    @property
    def space(self) -> FreeSpace:
        """Free floor."""
        return self._guide.space

    @property
    def robots(self) -> tuple[str, ...]:
        """Names of the robots that are driven."""
        return self._steering.robots

    @property
    def avoided(self) -> tuple[str, ...]:
        """Names of the robots outside the tour that are avoided."""
        return self._steering.avoided

    @property
    def faults(self) -> Mapping[str, str]:
        """Why robots can take no part, by name, besides what the guide finds; may be set."""
        return self._guide.faults

    @faults.setter
    def faults(self, faults: Mapping[str, str]) -> None:
        self._guide.faults = faults

    def take_space(self, space: FreeSpace) -> Guidance | None:
        """Takes another map: robots stand while the tour is not possible by it.

        Returns:
            How the tour goes on, if that has changed.
        """
        self._guide.space = self._steering.space = space
        before, self._misfit = self._misfit, ""
        try:
            check_tour(self.tour, space, self.config.safety.wall_distance)
        except TourError as err:
            self._misfit = f"by the new map {err}"
        return self._halt(self._misfit) if self._misfit not in ("", before) else None

    def take_pose(self, robot: str, pose: Pose, now_ns: int) -> None:
        """Takes a pose of any robot, also of one that is not driven: it is avoided."""
        self._steering.take_pose(robot, pose, now_ns)

    def take_people(
        self, people: Sequence[Person], groups: Sequence[Group], stamp_ns: int, now_ns: int
    ) -> Guidance | None:
        """Takes the people of an interval.

        Args:
            people: Who is followed, with ids.
            groups: Their groups, with ids.
            stamp_ns: Of the people [ns].
            now_ns: Time [ns].

        Returns:
            How the tour goes on; None: it has ended before, or robots stand for the map.
        """
        if not self.is_running:
            return None
        self._steering.take_people(people, stamp_ns, now_ns)
        if self._misfit:
            return None
        return self._told(self._guide.step(people, groups, self._steering.poses(), stamp_ns))

    def check_age(self, now_ns: int) -> Guidance | None:
        """Halts the tour once people are outdated.

        Args:
            now_ns: Time [ns].

        Returns:
            How the tour goes on, if that has changed.
        """
        age_s = min(self._steering.people_age_s(now_ns), (now_ns - self._begun_ns) / 1e9)
        timeout = self.config.safety.people_timeout
        if not self.is_running or age_s < timeout or self.guidance.state == State.HALTED:
            return None
        return self._halt(f"no people have come for {age_s:.2f} s; allowed: {timeout:g} s")

    def velocities(self, now_ns: int) -> dict[str, Velocity]:
        """The velocity of each robot from now on, see `Steering.step`."""
        return self._steering.step(now_ns)

    def poses(self) -> dict[str, Pose]:
        """The newest pose of each robot; its stamp is no later than when it came."""
        return self._steering.poses()

    def goals(self, now_ns: int) -> dict[str, Post]:
        """Posts of the robots whose poses are not outdated."""
        timeout = self.config.safety.pose_timeout
        return {
            robot: post
            for robot, post in self.guidance.posts.items()
            if self._steering.pose_age_s(robot, now_ns) < timeout
        }

    def off_posts(self) -> dict[str, float]:
        """How far robots are from their posts [m]."""
        poses = self._steering.poses()
        return {
            robot: math.dist(post.xy, (poses[robot].x, poses[robot].y))
            for robot, post in self.guidance.posts.items()
            if robot in poses
        }

    def _halt(self, reason: str) -> Guidance:
        return self._told(self._guide.halt(reason))

    def _told(self, guidance: Guidance) -> Guidance:
        self.guidance = dataclasses.replace(guidance, events=())
        self._steering.take_posts(guidance.posts)
        return guidance

"""Velocities of all robots of a tour, from posts, people and poses that come now and then."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.config import GuideConfig
from mrs_people_loc.guiding.drive import Drive, Situation, Velocity
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.guidance import Post
from mrs_people_loc.guiding.margins import sigma_of, widened
from mrs_people_loc.guiding.views import are_in_view
from mrs_people_loc.neighbours import nearest_to
from mrs_people_loc.people import Person
from mrs_people_loc.team.poses import Pose, places_of


@dataclass(frozen=True)
class SteeringTuning:
    """Constants of what happens between messages; chosen by hand in simulation.

    Attributes:
        shortest_s: Time between two steps that a drive gets, at least ...
        longest_s: ... and at most [s].
        detour: Paths keep so much farther from people and team-mates than the drive's own limit [m]
        at_post: ... and those who are nearer to the post than this are no reason for one [m].
        kept_s: Somebody who is not followed any more is avoided for so long [s], ...
        empty_s: ... unless robots have seen that their place is empty for so long [s], ...
        beside: ... or somebody is so near to it [m].
        people_s: Images become people in this time [s]; poses come at once.
        future_s: What comes from so far in the future is of no use [s]: the clock was set back.
        outside_s: A robot outside the tour is avoided for so long after its last pose [s].
        passes: A collision monitor that leaves less than this share of a robot's speed, or of its
            turn, holds it.
        most: So many people count for each robot: those who are nearest to it. Whoever is farther
            away is behind these.
    """

    shortest_s: float = 0.01
    longest_s: float = 0.2
    detour: float = 0.2
    at_post: float = 0.1
    kept_s: float = 4.0
    empty_s: float = 0.6
    beside: float = 0.6
    people_s: float = 0.2
    future_s: float = 0.05
    outside_s: float = 120.0
    passes: float = 0.5
    most: int = 24


STEERING_TUNING = SteeringTuning()


@dataclass(frozen=True)
class _Heard:
    """A pose, and when it came [ns]."""

    pose: Pose
    came_ns: int


@dataclass
class _Vanished:
    """A person who is not followed any more.

    Attributes:
        xy: Where they were last [m], shape (2,).
        since_ns: Stamp of the first people without them [ns].
        empty_s: For how long robots have seen their place empty [s].
    """

    xy: Float
    since_ns: int
    empty_s: float = 0.0


@dataclass(frozen=True)
class _Seen:
    """The people that were heard of last.

    Attributes:
        xy: Where they are, and who vanished [m], shape (n, 2).
        velocity: [m/s], 0 where unknown, shape (n, 2).
        stamp_ns: [ns]; None: none have come.
        came_ns: When they came [ns].
    """

    xy: Float
    velocity: Float
    stamp_ns: int | None = None
    came_ns: int = 0


class Steering:
    """Drives the robots of a tour to their posts.

    `step` may be called by another thread than all the rest: what it reads is replaced as a whole.

    Robots are never faster than they can stop before the people, or their own pose, are as old as
    the timeout. What comes from the future counts as outdated. The age counts from the arrival;
    where that is later than usual after the stamp, from then.

    Args:
        config: Parameters; may be replaced at any time.
        space: Free floor; likewise.
        robots: Names of the robots that are driven.
        tuning: Constants.

    Attributes:
        config: Parameters.
        space: Free floor.
        robots: Names of the robots that are driven.
        blind: Names of robots that see nothing: no place is seen empty by them.
        spare: Margins of unsure poses bring robots no farther off walls than this [m].
        held: Those of them that had to stand in a step because people or poses were outdated, or
            that their collision monitors held; to be emptied by the caller.
    """

    def __init__(
        self,
        config: GuideConfig,
        space: FreeSpace,
        robots: Iterable[str],
        tuning: SteeringTuning = STEERING_TUNING,
    ) -> None:
        self.config, self.space, self._tuning = config, space, tuning
        self.robots = tuple(robots)
        self.blind: frozenset[str] = frozenset()
        self.spare = math.inf
        self.held: frozenset[str] = frozenset()
        self._drives = {robot: Drive() for robot in self.robots}
        self._heard: dict[str, _Heard] = {}
        self._velocities: dict[str, Velocity] = dict.fromkeys(self.robots, (0.0, 0.0))
        self._posts: Mapping[str, tuple[Post, Float | None]] = {}  # and the paths to them
        self._followed: dict[int, Float] = {}
        self._vanished: list[_Vanished] = []
        self._seen = _Seen(np.empty((0, 2)), np.empty((0, 2)))
        self._stepped_ns: int | None = None

    def take_pose(self, robot: str, pose: Pose, now_ns: int) -> None:
        """Takes a pose of any robot, also of one that is not driven: it is avoided."""
        self._heard[robot] = _Heard(pose, now_ns)

    def take_driven(self, robot: str, velocity: Velocity) -> None:
        """Takes what a collision monitor has made of the velocity of a robot: it may hold it."""
        told, share = self._velocities.get(robot, (0.0, 0.0)), self._tuning.passes
        if any(abs(made) < share * abs(one) for made, one in zip(velocity, told, strict=True)):
            self.held |= {robot}

    def take_people(self, people: Sequence[Person], stamp_ns: int, now_ns: int) -> None:
        """Takes the people of an interval; those who vanished are avoided for some seconds."""
        self._keep_vanished(people, stamp_ns)
        kept = [one.xy for one in self._vanished]
        still = np.zeros(2)
        velocities = [still if one.velocity is None else one.velocity for one in people]
        self._seen = _Seen(
            np.array([*(one.position for one in people), *kept]).reshape(-1, 2),
            np.array([*velocities, *(still for _ in kept)]).reshape(-1, 2),
            min(stamp_ns, now_ns),
            now_ns,
        )
        for robot in self.avoided:
            if now_ns - self._heard[robot].came_ns > self._tuning.outside_s * 1e9:
                del self._heard[robot]

    def _keep_vanished(self, people: Sequence[Person], stamp_ns: int) -> None:
        """Who vanished is still there for some seconds, unless robots see that nobody is."""
        tuning, last_ns = self._tuning, self._seen.stamp_ns
        since_s = 0.0 if last_ns is None else (stamp_ns - last_ns) / 1e9
        before, self._followed = self._followed, {one.id: one.position for one in people if one.id}
        if since_s < tuning.kept_s:
            gone = [xy for number, xy in before.items() if number not in self._followed]
            self._vanished += [_Vanished(xy, stamp_ns) for xy in gone]
        if not self._vanished:
            return
        looking = self._drives.keys() - self.blind
        robots = {name: h.pose for name, h in self._heard.items() if name in looking}
        team = places_of(robots.values())
        places = np.array([one.xy for one in self._vanished])
        near = nearest_to(team, places, tuning.most)
        self._vanished, places = [self._vanished[row] for row in near], places[near]
        others = np.array([one.position for one in people]).reshape(-1, 2)
        others = others[nearest_to(team, others, tuning.most)]
        seen = are_in_view(places, others, robots, self.config, self.space)
        away = np.linalg.norm(places[:, None] - others, axis=2).min(axis=1, initial=math.inf)
        for one, is_seen in zip(self._vanished, seen, strict=True):
            one.empty_s += max(since_s, 0.0) if is_seen else 0.0
        self._vanished = [
            one
            for one, off in zip(self._vanished, away, strict=True)
            if off > tuning.beside
            and one.empty_s < tuning.empty_s
            and 0 <= stamp_ns - one.since_ns < tuning.kept_s * 1e9
        ]

    def take_posts(self, posts: Mapping[str, Post]) -> None:
        """Takes new posts, and plans the paths to them; robots without one stand."""
        self._posts = {
            robot: (post, self._path(robot, post) if robot in self._heard else None)
            for robot, post in posts.items()
        }

    def people_age_s(self, now_ns: int) -> float:
        """For how long people have been missing [s]: see the class."""
        return self._age_of(self._seen, now_ns)

    def _age_of(self, seen: _Seen, now_ns: int) -> float:
        if seen.stamp_ns is None:
            return math.inf
        people_ns = round(self._tuning.people_s * 1e9)
        return self._age_s(now_ns, min(seen.stamp_ns + people_ns, seen.came_ns))

    def pose_age_s(self, robot: str, now_ns: int) -> float:
        """Age of a robot's pose [s]."""
        return self._age_of_pose(self._heard.get(robot), now_ns)

    def _age_of_pose(self, heard: _Heard | None, now_ns: int) -> float:
        if heard is None:
            return math.inf
        return self._age_s(now_ns, min(heard.pose.stamp_ns, heard.came_ns))

    @property
    def most(self) -> int:
        """So many people count for each robot."""
        return self._tuning.most

    @property
    def avoided(self) -> tuple[str, ...]:
        """Names of the robots outside the tour that are avoided."""
        return tuple(sorted(set(self._heard) - set(self.robots)))

    def poses(self) -> dict[str, Pose]:
        """The newest pose of each robot; its stamp is no later than when it came."""
        return {
            robot: dataclasses.replace(heard.pose, stamp_ns=min(heard.pose.stamp_ns, heard.came_ns))
            for robot, heard in self._heard.items()
        }

    def step(self, now_ns: int) -> dict[str, Velocity]:
        """The velocity of each robot from now on.

        Args:
            now_ns: Time [ns].

        Returns:
            By robot; 0 for those that are to stand.
        """
        since_s = math.inf if self._stepped_ns is None else (now_ns - self._stepped_ns) / 1e9
        self._stepped_ns = now_ns
        dt = min(max(since_s, self._tuning.shortest_s), self._tuning.longest_s)
        heard, seen, posts = dict(self._heard), self._seen, self._posts
        poses = {robot: self._now(robot, one.pose, now_ns) for robot, one in heard.items()}
        people_s, safety = self._age_of(seen, now_ns), self.config.safety
        driven, held = {}, set()
        for robot in self.robots:
            left_s = min(
                safety.people_timeout - people_s,
                safety.pose_timeout - self._age_of_pose(heard.get(robot), now_ns),
            )
            if left_s <= dt:  # before the next step
                driven[robot] = 0.0, 0.0
                held.add(robot)
            else:
                post = posts.get(robot)
                driven[robot] = self._drive(robot, poses, seen, post, now_ns, left_s - dt, dt)
        self._velocities, self.held = driven, self.held | held
        return dict(driven)

    def _drive(
        self,
        robot: str,
        poses: Mapping[str, Pose],
        seen: _Seen,
        post: tuple[Post, Float | None] | None,
        now_ns: int,
        stands_within: float,
        dt: float,
    ) -> Velocity:
        pose = poses[robot]
        near = nearest_to(np.array([[pose.x, pose.y]]), seen.xy, self._tuning.most)
        others = {name: pose for name, pose in poses.items() if name != robot}
        motions = [self._motion(name, pose) for name, pose in others.items()]
        now = Situation(
            config=self._config_of(pose),
            pose=pose,
            twist=self._velocities[robot],
            post=None if post is None else post[0],
            people=seen.xy[near],
            people_velocity=seen.velocity[near],
            people_age=0.0 if seen.stamp_ns is None else (now_ns - seen.stamp_ns) / 1e9,
            robots=places_of(others.values()),
            robots_velocity=np.array(motions).reshape(-1, 2),
            space=self.space,
            path=None if post is None else post[1],
            stands_within=stands_within,
            dt=dt,
        )
        return self._drives[robot].step(now)

    def _config_of(self, pose: Pose) -> GuideConfig:
        """The parameters, wider for a robot whose pose is unsure."""
        return widened(self.config, sigma_of(pose), self.spare)

    def _now(self, robot: str, pose: Pose, now_ns: int) -> Pose:
        """Where a robot is by its last pose and its velocity since."""
        age_s = min(max((now_ns - pose.stamp_ns) / 1e9, 0.0), self.config.safety.pose_timeout)
        v, w = self._velocities.get(robot, (0.0, 0.0))
        middle = pose.yaw + 0.5 * w * age_s
        return Pose(
            now_ns,
            pose.x + v * age_s * math.cos(middle),
            pose.y + v * age_s * math.sin(middle),
            pose.yaw + w * age_s,
            pose.covariance,
        )

    def _motion(self, robot: str, pose: Pose) -> tuple[float, float]:
        """Velocity of a robot in the common frame [m/s]."""
        v, _ = self._velocities.get(robot, (0.0, 0.0))
        return v * math.cos(pose.yaw), v * math.sin(pose.yaw)

    def _path(self, robot: str, post: Post) -> Float | None:
        """The way to a post past walls, people and team-mates."""
        tuning, pose = self._tuning, self._heard[robot].pose
        safety = self._config_of(pose).safety
        mates = places_of(h.pose for name, h in self._heard.items() if name != robot)
        here = np.array([[pose.x, pose.y]])
        people = self._seen.xy[nearest_to(here, self._seen.xy, tuning.most)]
        places = np.concatenate([people, mates])
        radii = np.repeat(
            [safety.person_distance + tuning.detour, safety.robot_distance + tuning.detour],
            [len(people), len(mates)],
        )
        away = np.linalg.norm(places - post.xy, axis=1)
        discs = np.column_stack([places, np.minimum(radii, away - tuning.at_post)])
        discs, (_, before) = discs[discs[:, 2] > 0.0], self._posts.get(robot, (None, None))
        return self.space.path(here[0], post.xy, safety.wall_distance, discs, before)

    def _age_s(self, now_ns: int, then_ns: int) -> float:
        """Age [s]; infinite for what comes from the future."""
        age_s = (now_ns - then_ns) / 1e9
        return age_s if age_s >= -self._tuning.future_s else math.inf

"""A group that follows a leader along a way, and robots that are where their posts are."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from mrs_people_loc.config import Groups, GuideConfig
from mrs_people_loc.following import groups as following
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.guidance import Guidance, State
from mrs_people_loc.guiding.guide import Guide
from mrs_people_loc.guiding.tour import Tour, tour_from
from mrs_people_loc.people import Person
from mrs_people_loc.team.poses import Pose

START_NS, STEP_S = 1_000_000_000_000, 0.2
STRAIGHT = tour_from([[0.0, 0.0], [20.0, 0.0]], name="hall")


@dataclass
class Walker:
    """A person who keeps so far behind the leader, to the left of the way.

    Attributes:
        id: Of their track now; 0: nobody follows them.
        distance: [m].
        left: [m].
        way_m: Where they are.
        began_s: When their track began.
        stands: Whether they have stopped.
        speed: Their last one [m/s].
    """

    id: int
    distance: float
    left: float
    way_m: float
    began_s: float = -60.0
    stands: bool = False
    speed: float = 0.0


@dataclass
class World:
    """Five people behind robot_a, with robot_b and robot_c behind them; time goes by `run`.

    Attributes:
        config: Of the guide.
        tour: The tour.
        walkers: The people.
        robots: Places of the robots; who is missing sends no pose.
        time_s: Now.
        said: What the guide has said, with the times.
        warp: Changes what the planner says, before the guide gets it.
    """

    config: GuideConfig = field(default_factory=GuideConfig)
    tour: Tour = STRAIGHT
    walkers: list[Walker] = field(default_factory=list)
    robots: dict[str, np.ndarray] = field(default_factory=dict)
    time_s: float = 0.0
    said: list[tuple[float, Guidance]] = field(default_factory=list)
    warp: Callable[[list[Person]], list[Person]] = lambda people: people

    def __post_init__(self) -> None:
        if not self.walkers:
            self.walkers = [
                Walker(k + 1, 1.4 + 0.35 * k, (-0.5, 0.5)[k % 2], -0.35 * k) for k in range(5)
            ]
        if not self.robots:
            places = {"robot_a": (1.5, 0.0), "robot_b": (-3.0, 1.0), "robot_c": (-3.0, -1.0)}
            self.robots = {name: np.array(place) for name, place in places.items()}
        self.last_seen = dict.fromkeys(self.robots, 0.0)
        self.silent: set[str] = set()
        self.leader = "robot_a"
        self.groups = following.Groups(Groups())
        self.guide = Guide(self.tour, self.config, FreeSpace.unbounded())

    @property
    def now_ns(self) -> int:
        return START_NS + round(self.time_s * 1e9)

    def last(self) -> Guidance:
        return self.said[-1][1]

    def people(self) -> list[Person]:
        return [
            Person(
                position=self.tour.way.at(one.way_m, one.left),
                covariance=0.01 * np.eye(2),
                height=1.7,
                sigma=0.1,
                robots=tuple(self.robots),
                label=-1,
                id=one.id,
                velocity=one.speed * self.tour.way.ahead(one.way_m),
                age_s=self.time_s - one.began_s,
            )
            for one in sorted(self.walkers, key=lambda one: one.id)
            if one.id
        ]

    def step(self) -> Guidance:
        people = self.warp(self.people())
        groups, _ = self.groups.step(people, self.now_ns)
        for name in self.robots:
            if name not in self.silent:
                self.last_seen[name] = self.time_s
        for name, xy in self.robots.items():
            stamp_ns = START_NS + round(self.last_seen[name] * 1e9)
            pose = Pose(stamp_ns, float(xy[0]), float(xy[1]), 0.0)
            self.guide.take_pose(name, pose, self.now_ns)
        guidance = self.guide.take_people(
            people, groups, self.now_ns, self.now_ns, tuple(self.robots)
        )
        assert guidance is not None, "the tour has ended"
        self.said.append((self.time_s, guidance))
        self._move(guidance)
        self.time_s += STEP_S
        return guidance

    def _move(self, guidance: Guidance) -> None:
        for name, post in guidance.posts.items():
            if name in self.silent:
                continue
            offset = post.xy - self.robots[name]
            away = float(np.linalg.norm(offset))
            way = min(post.speed * STEP_S, away)
            self.robots[name] = self.robots[name] + offset * way / max(away, 1e-9)
            if post.role == 0:
                self.leader = name
        (leader_m,) = self.tour.way.nearest(self.robots[self.leader][None], None)
        for one in self.walkers:
            wanted = 0.0 if one.stands else leader_m - one.distance - one.way_m
            one.speed = float(np.clip(wanted, 0.0, 0.9))
            one.way_m += one.speed * STEP_S

    def run(self, seconds: float) -> None:
        """So long, or until the tour ends."""
        for _ in range(round(seconds / STEP_S)):
            if self.guide.is_running:
                self.step()

    def run_until(self, state: State, longest_s: float = 120.0) -> None:
        """Until the tour is in a state."""
        for _ in range(round(longest_s / STEP_S)):
            if self.step().state == state:
                return
        raise AssertionError(f"not {state!r} within {longest_s} s: {self.last()}")

    def events(self) -> list[str]:
        return [event for _, guidance in self.said for event in guidance.events]

    def states(self) -> list[State]:
        """One after the other."""
        states = [guidance.state for _, guidance in self.said]
        return [b for a, b in zip([None, *states], states, strict=False) if a != b]

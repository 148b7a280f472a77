"""Which robots of a tour see anything: a robot that does not has seen no place empty."""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.guiding.free_space import FreeSpace
from mrs_people_loc.guiding.views import detection_rates
from mrs_people_loc.neighbours import nearest_to
from mrs_people_loc.people import Person
from mrs_people_loc.team.poses import Pose, places_of


@dataclass(frozen=True)
class SightTuning:
    """When a head sees nothing; chosen.

    Attributes:
        silent_s: None of its scans has been used for so long [s]: it is not told of one whose pose
            has stopped, too, and takes no part; ...
        blind_s: ... or there has been somebody for so long in all [s] whom it should have seen, ...
        surely: ... with at least this probability at each time, and it has not seen anybody.
        most: So many people are looked at: the nearest ones.
        longest_s: An interval counts as no longer than this [s].
    """

    silent_s: float = 1.5
    blind_s: float = 3.0
    surely: float = 0.7
    most: int = 24
    longest_s: float = 0.5


SIGHT_TUNING = SightTuning()


class Sights:
    """Follows which robots see.

    Args:
        tuning: Constants.

    Attributes:
        seeing: Names of the robots that see, in the last interval.
        events: What has happened in the last step.
    """

    def __init__(self, tuning: SightTuning = SIGHT_TUNING) -> None:
        self._tuning = tuning
        self.seeing: frozenset[str] = frozenset()
        self.events: list[str] = []
        self._used_s: dict[str, float] = {}
        self._missed_s: dict[str, float] = {}
        self._blind: set[str] = set()
        self._now_s: float | None = None

    def step(
        self,
        scans: Collection[str],
        people: Sequence[Person],
        robots: Mapping[str, Pose],
        config: cfg.GuideConfig,
        space: FreeSpace,
        now_s: float,
    ) -> None:
        """Takes an interval.

        Args:
            scans: Names of the robots whose scans were used.
            people: Who is followed.
            robots: Poses of those that take part, by name.
            config: Reach and field of view; whose head looks back.
            space: Its walls hide.
            now_s: Time of the interval [s].
        """
        self.events = []
        since_s = 0.0 if self._now_s is None else now_s - self._now_s
        dt_s, self._now_s = min(max(since_s, 0.0), self._tuning.longest_s), now_s
        see_somebody = {name for person in people for name in person.robots}
        should = self._who_should(people, robots, config, space)
        self._used_s = {
            name: now_s if name in scans else self._used_s.get(name, now_s) for name in robots
        }
        self._missed_s = {
            name: 0.0 if name in see_somebody else before + dt_s * (name in should)
            for name, before in ((name, self._missed_s.get(name, 0.0)) for name in robots)
        }
        for name in robots:
            self._judge(name, now_s)
        self._blind &= set(robots)
        self.seeing = frozenset(set(robots) & set(scans)) - self._blind

    def _who_should(
        self,
        people: Sequence[Person],
        robots: Mapping[str, Pose],
        config: cfg.GuideConfig,
        space: FreeSpace,
    ) -> set[str]:
        """Robots that should see somebody."""
        if not people or not robots:
            return set()
        places, xy = places_of(robots.values()), np.array([person.position for person in people])
        xy = xy[nearest_to(places, xy, self._tuning.most)]
        back = [math.pi * (name in config.looks_back) for name in robots]
        gaze = np.array([pose.yaw for pose in robots.values()]) + back
        rates = detection_rates(places, gaze, xy, config.formation, space).max(axis=1)
        surely = self._tuning.surely
        return {name for name, rate in zip(robots, rates, strict=True) if rate >= surely}

    def _judge(self, name: str, now_s: float) -> None:
        tuning, why = self._tuning, ""
        if now_s - self._used_s[name] >= tuning.silent_s:
            why = f"none of its scans has been used for {tuning.silent_s:g} s"
        elif self._missed_s[name] >= tuning.blind_s:
            why = f"it has not seen anybody for {tuning.blind_s:g} s who was in its view"
        if why and name not in self._blind:
            self._blind.add(name)
            self.events.append(f"{name} sees nothing: {why}")
        elif not why and name in self._blind:
            self._blind.remove(name)
            self.events.append(f"{name} sees again")

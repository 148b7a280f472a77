"""Where robots see people: within the ranges at which they have detected some, and unhidden."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from mrs_people_loc.arrays import Bool, Float, Int
from mrs_people_loc.people import Person
from mrs_people_loc.team.occlusion import hidden_by_people, hidden_by_robots
from mrs_people_loc.team.poses import Pose

#: Bearings around a robot are told apart by this [rad].
_STEP = np.radians(5.0)
_BEARINGS = round(2.0 * np.pi / _STEP)
#: People of whom more than this share is hidden may be missed.
_HIDDEN = 0.25


class FieldsOfView:
    """What each robot has in view, learned from where it has detected people.

    The planner does not know the heads, and what a head should see is not what the whole chain
    detects.
    """

    def __init__(self) -> None:
        #: By robot and bearing, the least and the greatest distance of a detection [m].
        self._ranges: dict[str, tuple[Float, Float]] = {}

    def learn(self, found: Sequence[Person], poses: Mapping[str, Pose]) -> None:
        """Takes the detections of an interval.

        Args:
            found: The detections, on the map.
            poses: By robot that looked, its pose.
        """
        for name in {name for person in found for name in person.robots}:
            places = [person.position for person in found if name in person.robots]
            bearing, away = _seen_from(np.array(places), poses[name])
            unknown = np.full(_BEARINGS, np.inf), np.zeros(_BEARINGS)
            least, greatest = self._ranges.setdefault(name, unknown)
            np.minimum.at(least, bearing, away)
            np.maximum.at(greatest, bearing, away)

    def are_seen(
        self, xy: Float, people: Float, looking: Mapping[str, Pose], robots: Mapping[str, Pose]
    ) -> Bool:
        """Whether a robot has a person in plain view.

        Args:
            xy: Places of the persons on the map [m], shape (k, 2).
            people: Those of everybody, who hide each other, shape (n, 2) [m].
            looking: By robot whose scan there is, its pose.
            robots: Likewise of all robots, who hide people, too.

        Returns:
            Shape (k,).
        """
        seen = np.zeros(len(xy), dtype=bool)
        if not len(xy):
            return seen
        known = {name: pose for name, pose in looking.items() if name in self._ranges}
        places = _places(known)
        by_people = hidden_by_people(places, xy, people)
        by_robots = hidden_by_robots(places, xy, _places(robots)).max(axis=1, initial=0.0)
        for k, (name, pose) in enumerate(known.items()):
            least, greatest = self._ranges[name]
            bearing, away = _seen_from(xy, pose)
            in_range = (away >= least[bearing]) & (away <= greatest[bearing])
            seen |= in_range & (np.maximum(by_people[k], by_robots[k]) <= _HIDDEN)
        return seen


def _places(poses: Mapping[str, Pose]) -> Float:
    return np.array([(pose.x, pose.y) for pose in poses.values()]).reshape(-1, 2)


def _seen_from(xy: Float, pose: Pose) -> tuple[Int, Float]:
    """Bearings, as indices, and distances [m] of places, shape (n,) each."""
    offset = xy - (pose.x, pose.y)
    bearing = (np.arctan2(offset[:, 1], offset[:, 0]) - pose.yaw) % (2.0 * np.pi)
    index = (bearing / _STEP).astype(np.intp) % _BEARINGS
    return index, np.asarray(np.hypot(*offset.T))

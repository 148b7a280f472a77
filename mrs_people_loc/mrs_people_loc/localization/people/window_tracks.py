"""Tracks of the people whom a robot sees over a window: straight motion, by weighted least squares.

So people whom two robots see at different times are compared at one time (`relative_poses`).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mrs_people_loc.arrays import Float, Int, StructOfArrays
from mrs_people_loc.geometry import rotation_2d
from mrs_people_loc.localization.people.alignment import MovingPlaces
from mrs_people_loc.localization.people.seen_people import SeenPeople
from mrs_people_loc.neighbours import connected
from mrs_people_loc.team.fusion import map_from_robot
from mrs_people_loc.team.poses import Pose


@dataclass(frozen=True)
class TracksTuning:
    """Constants of tracks over a window.

    The shares of errors were measured on the shipped bags and the suite's; the others were chosen
    by hand, with simulated people who walk.

    Attributes:
        sightings: Of a person in a window, at least.
        step: Two sightings of a person are no farther apart than this [m] ...
        speed: ... and this speed explains [m/s].
        bridged: Scans that a person may be missed in, between two sightings.
        any_velocity: Standard deviation of a person's velocity on each axis [m/s].
        acceleration: Standard deviation of the change of a person's velocity in a second; it grows
            with the square root of time [m/s].
        bend: Variance of the middle of a line that is fitted to a path with such changes, over
            `acceleration` squared and the cube of its span: by simulation 0.003 to 0.007, doubled.
        slope: Variance of the slope of that line, against the velocity in the middle, over
            `acceleration` squared and its span (exact: 33 / 560).
        lasting: Share of a sighting's variance that lasts over windows.
    """

    sightings: int = 3
    step: float = 0.15
    speed: float = 2.0
    bridged: int = 2
    any_velocity: float = 1.0
    acceleration: float = 0.5
    bend: float = 0.01
    slope: float = 0.06
    lasting: float = 0.35


TRACKS_TUNING = TracksTuning()
#: Over two windows: a path that bends, bends for both robots.
TWO_WINDOWS_TUNING = TracksTuning(step=0.3, sightings=5, bend=0.0025, slope=0.015)


@dataclass(frozen=True)
class Tracks(StructOfArrays):
    """People that a robot saw over a window, a struct of arrays of one length (n,).

    Attributes:
        xy: Places at one time, on the map [m], shape (n, 2).
        white: Covariance of the places by errors that differ from scan to scan, shape (n, 2, 2).
        lasting: Likewise by errors that last [m^2], shape (n, 2, 2).
        velocity: [m/s], shape (n, 2).
        velocity_covariance: [m^2/s^2], shape (n, 2, 2).
    """

    xy: Float
    white: Float
    lasting: Float
    velocity: Float
    velocity_covariance: Float

    def moving(self, pose: Pose) -> MovingPlaces:
        """The people relative to the place of a robot."""
        return MovingPlaces(
            self.xy - (pose.x, pose.y), self.white + self.lasting, np.zeros(len(self), np.intp),
            self.velocity, self.velocity_covariance,
        )  # fmt: skip


NOBODY = Tracks(*(np.empty((0, *shape)) for shape in ((2,), (2, 2), (2, 2), (2,), (2, 2))))


def tracks_of(
    seen: Sequence[tuple[SeenPeople, Pose]],
    time_ns: int,
    tuning: TracksTuning = TRACKS_TUNING,
) -> Tracks:
    """The people that a robot saw over a window, and where they were at a time.

    Sightings of successive scans that are each other's nearest are of one person. Straight motion
    is fitted to those of each, by weighted least squares.

    Args:
        seen: By scan, in their order, the people and the robot's pose in the map.
        time_ns: The time [ns].
        tuning: Constants.
    """
    sizes = [len(people.xy) for people, _ in seen]
    if not sum(sizes):
        return NOBODY
    scan = np.repeat(np.arange(len(seen)), sizes)
    xy = np.concatenate([map_from_robot(people.xy, pose) for people, pose in seen])
    rotation = np.array([rotation_2d(pose.yaw) for _, pose in seen])[scan]
    covariance = np.concatenate([people.covariance for people, _ in seen])
    covariance = rotation @ covariance @ rotation.transpose(0, 2, 1)
    seconds = np.array([(people.stamp_ns - time_ns) / 1e9 for people, _ in seen])[scan]
    label = _linked(xy, scan, seconds, tuning)
    _, number, count = np.unique(label, return_inverse=True, return_counts=True)
    enough = count[number] >= tuning.sightings
    _, number = np.unique(number[enough], return_inverse=True)
    return _fitted(xy[enough], covariance[enough], seconds[enough], number, tuning)


def _linked(xy: Float, scan: Int, seconds: Float, tuning: TracksTuning) -> Int:
    """Of each sighting the first one of the same person.

    Args:
        xy: Places [m], shape (n, 2).
        scan: Number of the scan of each, ascending.
        seconds: Time of each [s].
        tuning: Constants.
    """
    # Each sighting with those of the next scans: far fewer pairs than all where scans are many.
    last = np.searchsorted(scan, scan + tuning.bridged + 1, side="right")
    later = last - np.searchsorted(scan, scan, side="right")
    one = np.repeat(np.arange(len(xy)), later)
    other = np.arange(len(one)) + np.repeat(last - np.cumsum(later), later)
    away = np.hypot(*(xy[other] - xy[one]).T)
    near = away <= tuning.step + tuning.speed * (seconds[other] - seconds[one])
    one, other, away = one[near], other[near], away[near]
    passed = scan[other] - scan[one]
    has_next, has_last = np.zeros((2, len(xy)), dtype=bool)
    links = []
    for scans in range(1, tuning.bridged + 2):
        free = np.flatnonzero((passed == scans) & ~has_next[one] & ~has_last[other])
        nearest, its_nearest = np.full((2, len(xy)), np.inf)
        np.minimum.at(nearest, one[free], away[free])
        np.minimum.at(its_nearest, other[free], away[free])
        mutual = free[(away[free] == nearest[one[free]]) & (away[free] == its_nearest[other[free]])]
        has_next[one[mutual]] = has_last[other[mutual]] = True
        links.append(mutual)
    linked = np.concatenate(links)
    return connected(one[linked], other[linked], len(xy))


def _fitted(
    xy: Float, covariance: Float, seconds: Float, number: Int, tuning: TracksTuning
) -> Tracks:
    """Straight motion of numbered people: where they are at second 0."""
    if not len(number):
        return NOBODY
    order = np.argsort(number, kind="stable")
    size = np.bincount(number)
    first = np.cumsum(size) - size
    xy, covariance, t = xy[order], covariance[order], seconds[order][:, np.newaxis, np.newaxis]
    information = np.linalg.inv((1.0 - tuning.lasting) * covariance)
    normal = np.empty((len(xy), 4, 5))  # of place and velocity, with the right side
    normal[:, :2, :2] = information
    normal[:, :2, 4:] = information @ xy[:, :, np.newaxis]
    normal[:, :2, 2:4] = normal[:, 2:, :2] = t * information
    normal[:, 2:, 2:] = t * normal[:, :2, 2:]
    normal = np.add.reduceat(normal, first)
    normal[:, (2, 3), (2, 3)] += 1.0 / tuning.any_velocity**2
    inverse = np.linalg.inv(normal[:, :, :4])
    span = float(np.ptp(seconds))
    bend = tuning.bend * tuning.acceleration**2 * span**3 * np.eye(2)
    slope = tuning.slope * tuning.acceleration**2 * span * np.eye(2)
    state = (inverse @ normal[:, :, 4:])[:, :, 0]
    return Tracks(
        state[:, :2],
        inverse[:, :2, :2] + bend,
        tuning.lasting * np.add.reduceat(covariance, first) / size[:, np.newaxis, np.newaxis],
        state[:, 2:],
        inverse[:, 2:, 2:] + slope,
    )

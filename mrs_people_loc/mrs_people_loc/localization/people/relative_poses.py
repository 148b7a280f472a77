"""Relative poses of robots, measured with the people whom both see.

What each robot sees by itself over a window of some intervals becomes tracks of straight motion
(`window_tracks`), so that people whom two robots see at different times are compared at one time.
The tracks of two robots are aligned (`alignment`). Windows do not overlap: no sighting is used for
two measurements of one pair of robots.

Part of a robot's error about a person lasts as long as it sees them from the same side. A filter
that takes it for white noise is too certain after many windows. So the variance of that part is
multiplied by 1 + 2 tau / T, where tau is the time that it lasts and T the time between
measurements: white noise of that variance has the same effect on a mean over a long time (Bartlett,
On the theoretical specification and sampling properties of autocorrelated time-series, 1946). While
both robots stand, tau is the time that they have been standing.

The sightings of a robot also enter its measurements with several others. With m robots, each
measured with each, independent measurements would have m / 2 times the information that there is;
the covariances are multiplied accordingly.

The search is as wide as the poses are unsure. Two robots that it does not find for some windows, or
of which one is lost, are searched whatever their poses are wrong by (`align_anywhere`), with the
people and velocities of two windows: those of all robots that were measured with one of the two
lately, as if one robot had seen them; for a lost one, with those of all that are not. What is found
has to be found again in the next window. Then the usual search begins there, and measures with the
people of the last window.
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections import Counter
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.geometry import rotation_2d, wrap_angle
from mrs_people_loc.localization.people.alignment import (
    ALIGNMENT_TUNING,
    ANYWHERE_TUNING,
    Alignment,
    AlignmentTuning,
    Places,
    align,
    align_anywhere,
    fit,
)
from mrs_people_loc.localization.people.contradictions import Contradictions
from mrs_people_loc.localization.people.seen_people import SeenPeople
from mrs_people_loc.localization.people.sighted_robots import SightedRobots
from mrs_people_loc.localization.people.window_tracks import (
    TRACKS_TUNING,
    TWO_WINDOWS_TUNING,
    Tracks,
    TracksTuning,
    tracks_of,
)
from mrs_people_loc.localization.shared import RelativePose, StandingPeople, TeamMeasurement
from mrs_people_loc.neighbours import connected
from mrs_people_loc.team.masking import Walls
from mrs_people_loc.team.poses import Pose


@dataclass(frozen=True)
class RelativePosesTuning:
    """Constants of `RelativePoses`.

    The times and the share of errors were measured on the shipped bags and the suite's; the others
    were chosen by hand, with simulated people who walk.

    Attributes:
        window_ns: Span of a window, at least [ns] ...
        intervals: ... and intervals in it.
        pairs: Pairs of robots that are compared per window, at most; the others come next.
        lasting_s: For how long that part of a sighting's error lasts (`tracks.lasting`) [s].
        lasting_alone: Share of its variance that lasts where nobody else sees them from another
            side.
        least: Standard deviations of a relative pose, at least, likewise lasting: what all people
            have in common, x, y, yaw [m, m, rad].
        told: Standard deviations of what a pose may be wrong by, beside its covariance, where that
            is right: x, y, yaw [m, m, rad].
        mistaken: Likewise, where it is not.
        farthest: Likewise, at most.
        often_mistaken: Probability that a pose is mistaken: low, as people who walk two by two look
            like those behind them, and a pose wrong by their distance would explain that ...
        often_missed: ... but higher if the two robots were measured lately, and are not any more.
        evidence: Log-odds of an alignment that counts by itself, at least ...
        margin: ... and log-odds over the next best one.
        evidence_again: Likewise of one that counts if the last one of the two robots was such, and
        margin_again: ... and the same to within ...
        same: ... this distance [m] and ...
        same_turn: ... this turn [rad].
        memory_ns: After so long a pair of robots is a new one [ns].
        alone_ns: Robots whose relative pose was not measured for so long share nobody [ns].
        stands: A robot stands if it is no farther from where it was than this [m] ...
        stands_turn: ... and turned by no more than this [rad].
        unknown: A covariance with a larger element is taken for unknown [m^2, m rad, rad^2].
        tracks: Constants of tracks over a window, and
        anywhere_tracks: ... over two, for the search whatever poses are wrong by.
        alignment: Constants of the search.
        anywhere: Constants of the search whatever poses are wrong by.
        anywhere_after: After so many comparisons in a row that found nothing, a pair of robots is
            searched whatever their poses are wrong by ...
        anywhere_people: ... if each of them sees so many people, at least; and people in an
            alignment of that search, at least; it counts if the last window had the same.
        anywhere_evidence: Log-odds of each of the two, at least ...
        anywhere_both: ... and their sum, at least. Where nobody was the same, by simulation, less
            than one of 1000 windows had the former by chance, and none of 30,000 both.
        anywhere_margin: Log-odds of each over the next best one, at least.
        anywhere_gate: The two are the same to within so many standard deviations.
    """

    window_ns: int = 700_000_000
    intervals: int = 4
    pairs: int = 6
    lasting_s: float = 4.0
    lasting_alone: float = 0.7
    least: tuple[float, float, float] = (0.02, 0.02, math.radians(0.4))
    told: tuple[float, float, float] = (0.1, 0.1, math.radians(2.0))
    mistaken: tuple[float, float, float] = (0.35, 0.35, math.radians(6.0))
    farthest: tuple[float, float, float] = (4.0, 4.0, math.radians(60.0))
    often_mistaken: float = 0.25
    often_missed: float = 0.5
    evidence: float = 3.5
    margin: float = 5.0
    evidence_again: float = 2.0
    margin_again: float = 4.0
    same: float = 0.3
    same_turn: float = math.radians(7.0)
    memory_ns: int = 10_000_000_000
    alone_ns: int = 2_000_000_000
    stands: float = 0.05
    stands_turn: float = math.radians(2.0)
    unknown: float = 1e6
    anywhere_after: int = 3
    anywhere_people: int = 3
    anywhere_evidence: float = 0.0
    anywhere_both: float = 2.0
    anywhere_margin: float = 3.5
    anywhere_gate: float = 4.0
    tracks: TracksTuning = TRACKS_TUNING
    anywhere_tracks: TracksTuning = TWO_WINDOWS_TUNING
    alignment: AlignmentTuning = ALIGNMENT_TUNING
    anywhere: AlignmentTuning = ANYWHERE_TUNING

    def may_count(self, found: Alignment) -> bool:
        """Whether an alignment counts if it is the last one again."""
        return found.evidence >= self.evidence_again and found.margin >= self.margin_again


RELATIVE_POSES_TUNING = RelativePosesTuning()


@dataclass
class _Robot:
    """What a robot saw in the window.

    Attributes:
        seen: By scan, the people, and its pose.
        before: Likewise in the window before.
        stands: The first of its poses that is where it is now.
    """

    seen: list[tuple[SeenPeople, Pose]] = field(default_factory=list)
    before: list[tuple[SeenPeople, Pose]] = field(default_factory=list)
    stands: Pose | None = None

    @property
    def stands_since_ns(self) -> int:
        """Since when it is where it is now [ns]."""
        return 0 if self.stands is None else self.stands.stamp_ns

    def take(self, people: SeenPeople, pose: Pose, tuning: RelativePosesTuning) -> None:
        """Takes a scan."""
        self.seen.append((people, pose))
        at = self.stands
        if (
            at is None
            or math.hypot(pose.x - at.x, pose.y - at.y) > tuning.stands
            or abs(wrap_angle(pose.yaw - at.yaw)) > tuning.stands_turn
        ):
            self.stands = pose


@dataclass(frozen=True)
class _Far:
    """An alignment that was found whatever the poses are wrong by.

    Attributes:
        evidence: See `Alignment`.
        pose: Of the second robot, as it is believed to be.
        off: What that is wrong by, x, y, yaw [m, m, rad], shape (3,).
        covariance: Of `off`, shape (3, 3).
    """

    evidence: float
    pose: Pose
    off: Float
    covariance: Float

    def confirms(self, last: _Far | None, tuning: RelativePosesTuning) -> bool:
        """Whether it is the last one again, and both together are evident."""
        if last is None or self.evidence + last.evidence < tuning.anywhere_both:
            return False
        expected = _carried_on(last.off[:2], float(last.off[2]), last.pose, self.pose)
        off = self.off - [*expected, last.off[2]]
        off[2] = wrap_angle(off[2])
        squared = off @ np.linalg.solve(self.covariance + last.covariance, off)
        return bool(squared < tuning.anywhere_gate**2)


@dataclass
class _Pair:
    """Two robots.

    Attributes:
        compared_ns: When they were compared last [ns]; 0: never.
        measured_ns: When their relative pose was measured last [ns]; 0: never.
        guess: The last alignment that was good enough to be confirmed, and the pose of the second
            robot that it moves.
        missed: Comparisons in a row that found nothing where both saw people enough.
        far: The last alignment that was found whatever the poses are wrong by, and is to be
            confirmed.
        known: The last one that was confirmed, or measured again since, and ...
        known_ns: ... when [ns].
    """

    compared_ns: int = 0
    measured_ns: int = 0
    guess: tuple[Alignment, Pose] | None = None
    missed: int = 0
    far: _Far | None = None
    known: _Far | None = None
    known_ns: int = 0

    def was_measured(self, since_ns: int) -> bool:
        """Whether their relative pose was measured after a time [ns]."""
        return self.measured_ns > max(since_ns, 0)

    def confirms(self, found: Alignment, pose: Pose, tuning: RelativePosesTuning) -> bool:
        """Whether an alignment of the second robot, at a pose, is the last one again."""
        if self.guess is None:
            return False
        last, at = self.guess
        expected = _carried_on(last.move, last.turn, at, pose)
        return bool(
            np.hypot(*(found.move - expected)) < tuning.same
            and abs(wrap_angle(found.turn - last.turn)) < tuning.same_turn
        )


def _carried_on(move: Float, turn: float, at: Pose, pose: Pose) -> Float:
    """The move of a robot at a pose, that is the same as one at another with a turn about it."""
    way = np.array([pose.x - at.x, pose.y - at.y])
    return np.asarray(move + rotation_2d(turn) @ way - way)


class RelativePoses:
    """Measures relative poses of robots, window by window.

    Args:
        tuning: Constants.

    Attributes:
        fits: By robot, where that is known: whether it sees people where another one does, or where
            others see nobody (`Contradictions`).
    """

    def __init__(self, tuning: RelativePosesTuning = RELATIVE_POSES_TUNING) -> None:
        self.tuning = tuning
        self.reset()

    def reset(self) -> None:
        """Forgets all sightings: the time jumped back."""
        self._robots: dict[str, _Robot] = {}
        self._pairs: dict[tuple[str, str], _Pair] = {}
        self._intervals = 0
        self._sighted = SightedRobots()
        self._contradictions = Contradictions()
        self.fits: dict[str, bool] = {}

    def step(
        self,
        seen: Mapping[str, SeenPeople],
        poses: Mapping[str, Pose],
        lost: Collection[str] = (),
        walls: Walls | None = None,
    ) -> tuple[TeamMeasurement, ...]:
        """Takes an interval.

        Args:
            seen: By robot, the people that it sees; robots may be left out.
            poses: By robot, its pose in the map at that stamp. Over a window, what lies between two
                poses of a robot is taken for exact; where a robot is, for as sure as the
                covariance says (that relative to the team, where it is known), or else wrong by
                `mistaken` in the tuning.
            lost: Robots that may be anywhere. So may others that were not measured for some
                windows (`anywhere_after`), whatever their poses say.
            walls: What hides people, where it is known.

        Returns:
            The robots that see each other now, whose headings are unknown; and if a window ends
            with this interval, its measurements, and who may stand for robots without any.
        """
        in_team = {name: pose.relative_to_team() for name, pose in poses.items()}
        sighted = self._sighted.step(seen, in_team)
        self.fits = self._contradictions.step(seen, in_team, walls)
        for name, people in seen.items():
            self._robots.setdefault(name, _Robot()).take(people, in_team[name], self.tuning)
        self._intervals += 1
        stamps = [people.stamp_ns for r in self._robots.values() for people, _ in r.seen]
        span_ns = max(stamps, default=0) - min(stamps, default=0)
        if span_ns < self.tuning.window_ns or self._intervals < self.tuning.intervals:
            return sighted
        found = self._measure((max(stamps) + min(stamps)) // 2, lost)
        standing = self._standing(max(stamps))
        self._robots = {name: robot for name, robot in self._robots.items() if robot.seen}
        for robot in self._robots.values():
            robot.before, robot.seen = robot.seen, []
        self._intervals = 0
        return sighted + found + standing

    def _standing(self, now_ns: int) -> tuple[StandingPeople, ...]:
        """People who may stand, of the last scans of robots that share nobody with another one.

        Who tells a pair where they are to each other must not do so twice.
        """
        tuning, lately_ns = self.tuning, now_ns - self.tuning.alone_ns
        pairs = (names for names, pair in self._pairs.items() if pair.was_measured(lately_ns))
        sharing = {name for names in pairs for name in names}
        factor = 1.0 + 2.0 * tuning.lasting_alone * tuning.lasting_s / (tuning.window_ns / 1e9)
        found = []
        for name, robot in self._robots.items():
            if name in sharing or not robot.seen:
                continue
            people, _ = robot.seen[-1]
            if people.stands.any():
                xy, covariance = people.xy[people.stands], people.covariance[people.stands]
                found.append(StandingPeople(name, people.stamp_ns, xy, factor * covariance, factor))
        return tuple(found)

    def _measure(self, time_ns: int, lost: Collection[str]) -> tuple[RelativePose, ...]:
        """Compares the robots that saw people in the window whose middle is at a time [ns]."""
        tracks, last = {}, {}
        for name, robot in self._robots.items():
            people = tracks_of(robot.seen, time_ns, self.tuning.tracks)
            if len(people):
                tracks[name], last[name] = people, robot.seen[-1][1]
        found = {}
        for names in self._next_pairs(last):
            pair = self._pairs.setdefault(names, _Pair())
            one, other = ((last[name], tracks[name]) for name in names)
            factor = self._factor(names, pair, time_ns)
            wrong_by = self._compare(pair, one, other, factor)
            pair.compared_ns = time_ns
            if wrong_by is not None:
                pair.missed, pair.far, pair.known = 0, None, None
            else:
                is_anywhere = self._is_anywhere(names, pair, one[1], other[1], lost)
                other, wrong_by = self._known_again(pair, one, other, factor, time_ns)
                if wrong_by is None and is_anywhere:
                    far = self._anywhere(names, pair, lost)
                    if far is not None:
                        other = _moved(*other, far.off)
                        wrong_by = self._compare(pair, one, other, factor, far.covariance)
                        pair.known, pair.known_ns = far, time_ns
            if wrong_by is not None:
                inflated = 1.0 + self.tuning.tracks.lasting * (factor - 1.0)
                found[names] = one[0], other[0], wrong_by, inflated
                pair.measured_ns = time_ns
        oldest_ns = time_ns - self.tuning.memory_ns
        self._pairs = {
            names: pair for names, pair in self._pairs.items() if pair.compared_ns > oldest_ns
        }
        used = Counter(name for names in found for name in names)
        return tuple(
            _relative(names, *measured, factor=(2 + used[names[0]] + used[names[1]]) / 4)
            for names, measured in found.items()
        )

    def _known_again(
        self,
        pair: _Pair,
        one: tuple[Pose, Tracks],
        other: tuple[Pose, Tracks],
        factor: float,
        time_ns: int,
    ) -> tuple[tuple[Pose, Tracks], tuple[Float, Float] | None]:
        """The second robot where it was found to be lately, and what that is wrong by.

        Who is the same as whom is then told by far less than a search anywhere needs.
        """
        known, (pose, people) = pair.known, other
        if known is None or time_ns - pair.known_ns > self.tuning.memory_ns:
            return other, None
        turn = float(known.off[2])
        off = np.array([*_carried_on(known.off[:2], turn, known.pose, pose), turn])
        there = _moved(pose, people, off)
        wrong_by = self._compare(pair, one, there, factor, known.covariance, again=True)
        if wrong_by is None:
            return other, None
        pair.known, pair.known_ns = dataclasses.replace(known, pose=pose, off=off), time_ns
        return there, wrong_by

    def _is_anywhere(
        self,
        names: tuple[str, str],
        pair: _Pair,
        one: Tracks,
        other: Tracks,
        lost: Collection[str],
    ) -> bool:
        """Notes that two robots were not measured; whether their poses may be wrong by anything."""
        pair.missed += min(len(one), len(other)) >= self.tuning.anywhere_people
        is_lost = names[0] in lost or names[1] in lost
        return is_lost or pair.missed >= self.tuning.anywhere_after

    def _anywhere(self, names: tuple[str, str], pair: _Pair, lost: Collection[str]) -> _Far | None:
        """What the pose of a robot is wrong by, relative to another's, whatever it is.

        Their people over two windows are aligned; where one of the two is lost, with those of all
        that know where they are. What these tell is used for nothing else: with the pose corrected,
        the two are compared by the people of the last window, as usual.

        Args:
            names: The other, and the robot.
            pair: The two.
            lost: Robots that may be anywhere.

        Returns:
            None: not found, or not yet confirmed.
        """
        tuning, last, pair.far = self.tuning, pair.far, None
        pose = self._robots[names[1]].seen[-1][1]
        teams = self._teams(names, lost)
        there, own = (people.moving(pose) for people in self._over_two_windows(teams))
        found = align_anywhere(own, there, tuning=tuning.anywhere)
        if (
            found is None
            or len(found.own) < tuning.anywhere_people
            or found.evidence < tuning.anywhere_evidence
            or found.margin < tuning.anywhere_margin
        ):
            return None
        i, j = found.own, found.others
        off, covariance = fit(
            own.xy[i], own.covariance[i], there.xy[j], there.covariance[j], found.turn
        )
        pair.far = _Far(found.evidence, pose, off, covariance)
        return pair.far if pair.far.confirms(last, tuning) else None

    def _teams(self, names: tuple[str, str], lost: Collection[str]) -> list[Collection[str]]:
        """Each robot of a pair, with those that it was measured with lately, or these with others.

        If one of the two alone is lost, the other one is with all that are not.
        """
        present = [name for name in self._robots if name not in lost]
        if set(names) & set(lost):
            return [[name] if name in lost else present for name in names]
        lately_ns = max(p.compared_ns for p in self._pairs.values()) - self.tuning.alone_ns
        linked = [
            [present.index(name) for name in measured]
            for measured, pair in self._pairs.items()
            if pair.was_measured(lately_ns) and set(measured) <= set(present)
        ]
        one, other = np.array(linked, dtype=np.intp).reshape(-1, 2).T
        team = dict(zip(present, connected(one, other, len(present)).tolist(), strict=True))
        if team[names[0]] == team[names[1]]:
            return [[name] for name in names]
        return [sorted(mate for mate in present if team[mate] == team[name]) for name in names]

    def _over_two_windows(self, teams: Sequence[Collection[str]]) -> Iterator[Tracks]:
        """People in the last window and the one before, those of each team as if of one robot."""
        robots = self._robots
        seen = [[s for name in t for s in robots[name].before + robots[name].seen] for t in teams]
        stamps = [people.stamp_ns for of_team in seen for people, _ in of_team]
        for team, of_team in zip(teams, seen, strict=True):
            tuning = self.tuning.anywhere_tracks
            bridged = len(team) * (tuning.bridged + 1) - 1
            tuning = dataclasses.replace(tuning, bridged=bridged)
            of_team.sort(key=lambda scan: scan[0].stamp_ns)
            yield tracks_of(of_team, (max(stamps) + min(stamps)) // 2, tuning)

    def _next_pairs(self, poses: Mapping[str, Pose]) -> list[tuple[str, str]]:
        """The pairs of robots that were not compared for the longest time, the nearest first."""

        def order(names: tuple[str, str]) -> tuple[int, float]:
            one, other = poses[names[0]], poses[names[1]]
            away = math.hypot(one.x - other.x, one.y - other.y)
            return self._pairs[names].compared_ns if names in self._pairs else 0, away

        return sorted(itertools.combinations(sorted(poses), 2), key=order)[: self.tuning.pairs]

    def _factor(self, names: tuple[str, str], pair: _Pair, time_ns: int) -> float:
        """What the variance of errors that last is multiplied by, for a pair at a time [ns]."""
        if not pair.measured_ns:
            return 1.0
        since_s = (time_ns - pair.measured_ns) / 1e9
        stand_ns = max(self._robots[name].stands_since_ns for name in names)
        lasts_s = max(self.tuning.lasting_s, (time_ns - stand_ns) / 1e9)
        return 1.0 + 2.0 * lasts_s / max(since_s, 1e-3)

    def _alignment(
        self, pair: _Pair, sees: Places, seen: Places, one: Pose, other: Pose
    ) -> Alignment | None:
        """Which people are the same as others, if it is sure; notes it if it is to be confirmed."""
        tuning = self.tuning
        is_missed = pair.missed > 0 and pair.was_measured(other.stamp_ns - tuning.memory_ns)
        wider = tuning.often_missed if is_missed else tuning.often_mistaken
        priors = _priors(one, other, tuning)
        found = align(sees, seen, *priors, wider=wider, tuning=tuning.alignment)
        if found is None or not tuning.may_count(found):
            pair.guess = None
            return None
        sure = found.evidence >= tuning.evidence and found.margin >= tuning.margin
        again = pair.confirms(found, other, tuning)
        pair.guess = found, other
        return found if sure or again else None

    def _compare(
        self,
        pair: _Pair,
        one: tuple[Pose, Tracks],
        other: tuple[Pose, Tracks],
        factor: float,
        settled: Float | None = None,
        *,
        again: bool = False,
    ) -> tuple[Float, Float] | None:
        """What the pose of a robot is wrong by, relative to another's.

        Args:
            pair: The two robots.
            one: Pose of the first, and the people that it sees.
            other: Likewise of the second.
            factor: What the variance of errors that last is multiplied by.
            settled: Covariance of the pose of the second relative to the first, if it is known
                which people are the same, shape (3, 3).
            again: Whether the people have to confirm that.

        Returns:
            x, y, yaw on the map [m, m, rad], shape (3,), and covariance, shape (3, 3); None: not
            known.
        """
        tuning, (pose, own), there = self.tuning, other, one[1]
        sees, seen = own.moving(pose), there.moving(pose)
        if settled is None:
            found = self._alignment(pair, sees, seen, one[0], pose)
        else:
            prior = settled + np.diag(np.square(tuning.told))
            found = align(sees, seen, prior, tuning=tuning.alignment)
        if found is None or (again and not tuning.may_count(found)):
            return None
        i, j = found.own, found.others
        state, covariance = fit(
            sees.xy[i], own.white[i] + factor * own.lasting[i],
            seen.xy[j], there.white[j] + factor * there.lasting[j],
            found.turn,
        )  # fmt: skip
        return state, covariance + factor * np.diag(np.square(tuning.least))


def _priors(one: Pose, other: Pose, tuning: RelativePosesTuning) -> list[Float]:
    """Covariances of what a pose may be wrong by relative to another's, x, y, yaw: see `align`.

    Poses without covariance claim nothing.
    """
    told = bool(one.covariance.any() and other.covariance.any())
    least = (tuning.told, tuning.mistaken) if told else (tuning.mistaken,)
    lever = np.eye(3)
    lever[:2, 2] = one.y - other.y, other.x - one.x
    with np.errstate(over="ignore", invalid="ignore"):  # DBL_MAX may stand for "unknown"
        total = other.covariance + lever @ one.covariance @ lever.T
    most = np.diag(np.square(tuning.farthest))
    if not (np.abs(total) < RELATIVE_POSES_TUNING.unknown).all():  # NaN compares false
        return [most]
    priors = (total + np.diag(np.square(sigmas)) for sigmas in least)
    return [np.linalg.inv(np.linalg.inv(prior) + np.linalg.inv(most)) for prior in priors]


def _moved(pose: Pose, people: Tracks, by: Float) -> tuple[Pose, Tracks]:
    """A robot and its people, moved and turned about its place by x, y, yaw [m, m, rad]."""
    x, y, turn = by.tolist()
    moved = dataclasses.replace(pose, x=pose.x + x, y=pose.y + y, yaw=pose.yaw + turn)
    rotation = rotation_2d(turn)
    white, lasting, of_velocity = (
        rotation @ one @ rotation.T
        for one in (people.white, people.lasting, people.velocity_covariance)
    )
    xy = (people.xy - (pose.x, pose.y)) @ rotation.T + (moved.x, moved.y)
    return moved, Tracks(xy, white, lasting, people.velocity @ rotation.T, of_velocity)


def _relative(
    pair: tuple[str, str],
    one: Pose,
    other: Pose,
    wrong_by: tuple[Float, Float],
    inflated: float,
    *,
    factor: float,
) -> RelativePose:
    """The relative pose of two robots.

    Args:
        pair: Their names.
        one: Pose of the first.
        other: Pose of the second.
        wrong_by: What that is wrong by, x, y, yaw, and covariance.
        inflated: By how much the covariance is larger than that of a single measurement.
        factor: What it is multiplied by.
    """
    (x, y, yaw), covariance = wrong_by
    to_one = np.eye(3)
    to_one[:2, :2] = rotation_2d(-one.yaw)
    place = to_one[:2, :2] @ (other.x + x - one.x, other.y + y - one.y)
    return RelativePose(
        robot=pair[0],
        stamp_ns=one.stamp_ns,
        other=pair[1],
        other_stamp_ns=other.stamp_ns,
        pose=np.array([*place, wrap_angle(other.yaw + yaw - one.yaw)]),
        covariance=factor * (to_one @ covariance @ to_one.T),
        inflated=factor * inflated,
    )

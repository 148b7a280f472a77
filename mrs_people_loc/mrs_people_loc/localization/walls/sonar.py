"""Flat walls from the ranges of sonars, at one time and while driving.

A flat wall reflects sound like a mirror: the echo comes from the foot of the perpendicular from the
sonar wherever that is in its cone. A sonar at p with range r therefore says

    d = r + p . (cos b, sin b),

one equation for the distance d and the bearing b of the wall, which is a tangent of the circle of
radius r about p. Two sonars at different places, or one at different times, give both (Leonard and
Durrant-Whyte, Directed Sonar Sensing for Mobile Robot Navigation, 1992, whose regions of constant
depth these are; Martinez-Garcia, Ohya and Yuta 2004, section 5.4: triangulation with a flat wall).
All echoes of the last piece of way are used together, whatever sonar they are from: they vote for
a wall, and generalized least squares fits it. The covariance holds the noise of the ranges and that
of the odometry between them.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from mrs_people_loc.arrays import Bool, Float, Int
from mrs_people_loc.geometry import rotation_2d, wrap_angle, wrap_angles
from mrs_people_loc.localization.odometry import Odometry
from mrs_people_loc.localization.walls import NOBODY, SeenWalls, Walls
from mrs_people_loc.localization.walls.ranges import SonarRange


@dataclass(frozen=True)
class SonarTuning:
    """Constants of the walls from sonars, chosen by hand.

    Attributes:
        sigma: Standard deviation of a range near 0 [m] ...
        sigma_relative: ... and by how much it grows per metre; both are usual for ultrasound, and
            hold where messages state no variance.
        least_sigma: A smaller one is not believed [m].
        side_lobes: An echo may come from so far beside the cone [rad].
        body: An echo that may come from less than this beside the middle of a person or a team-mate
            is not used [m].
        span_s: Echoes are used together for so long [s] ...
        way: ... and over so much of the way [m].
        period_s: Walls are looked for that often [s].
        directions: So many are tried all around.
        bin: Distances of echoes that vote for one wall differ by less than two of these [m].
        gate: Residuals of a wall's echoes are less than so many standard deviations.
        least: Fewest echoes of a wall.
        walls: Most walls that are looked for at one time.
        refits: How often a wall is fitted, each time to what is near it then.
        vote_sigma: What the directions' steps add to an echo's standard deviation [m].
        inflation: What cross-talk that passes for echoes adds to the variances.
        fitting: Of the echoes from where a wall is, or from behind it, so many must fit ...
        rough: ... and those that are less than this nearer count [m].
        sigma_bearing: A wall is good enough once its bearing is known as well as this [rad] ...
        sigma_bearing_late: ... or as this, before its first echoes are forgotten: when they ...
        leaving: ... have used up this share of the way or time.
        post_radius: What is no wall is like a post of this radius [m]: a person, an edge.
        unheard: Standard deviation of the angle to a post outside a cone [rad].
        odds: A wall must explain its echoes better than a post by this log-likelihood.
        remembered: So many walls are kept to be known again ...
        near: ... where they were touched, or so far beyond [m] ...
        slack: ... within the uncertainty and this [m], [rad].
        contradicting: Two lines that differ by more, but by less than this [m], [rad], are of one
            thing that moves: the older one is forgotten.
        times: A wall is reported from this time on that it is found.
    """

    sigma: float = 0.005
    sigma_relative: float = 0.01
    least_sigma: float = 0.001
    side_lobes: float = 0.2
    body: float = 0.35
    span_s: float = 3.0
    way: float = 1.5
    period_s: float = 0.2
    directions: int = 180
    bin: float = 0.05
    gate: float = 3.0
    least: int = 6
    walls: int = 4
    refits: int = 4
    vote_sigma: float = 0.01
    inflation: float = 1.15
    fitting: float = 0.85
    rough: float = 0.15
    sigma_bearing: float = 0.03
    sigma_bearing_late: float = 0.08
    leaving: float = 0.85
    post_radius: float = 0.15
    unheard: float = 0.05
    odds: float = 3.0
    remembered: int = 8
    near: float = 1.0
    slack: tuple[float, float] = (0.01, 0.005)
    contradicting: tuple[float, float] = (0.5, 0.6)
    times: int = 4


SONAR_TUNING = SonarTuning()


class _Echo(NamedTuple):
    """One echo; the sonar's place and axis are in the odometry's frame.

    Those that a wall was found by stay: others must not contradict them.
    """

    odometry: Odometry
    x: float
    y: float
    axis: float
    cone: float
    range: float
    sigma: float
    used: bool = False


@dataclass(frozen=True)
class _Window:
    """Echoes in base_link at one of their times.

    Attributes:
        odometry: Of that time.
        xy: Of the sonars [m], shape (n, 2).
        axis: Of their cones [rad], shape (n,).
        cone: Half of each cone [rad], shape (n,).
        range: [m], shape (n,).
        sigma: Of the ranges [m], shape (n,).
        used: Whether a wall was found by it already, shape (n,).
        pieces: Which pieces of the way lie between that time and an echo: 1 if the echo came
            later, -1 if earlier, shape (n, k).
        middles: Of the pieces [m], shape (k, 2).
        added: Variances of position [m^2] and heading [rad^2] that each piece added, shape (k, 2).
    """

    odometry: Odometry
    xy: Float
    axis: Float
    cone: Float
    range: Float
    sigma: Float
    used: Bool
    pieces: Float
    middles: Float
    added: Float

    def distances(self, bearing: float) -> Float:
        """How far a wall of that bearing is by each echo [m], shape (n,)."""
        return np.asarray(self.range + self.xy @ _unit(bearing))

    def off_axis(self, bearing: float) -> Float:
        """Angle between a direction and each cone's axis [rad], shape (n,)."""
        return np.abs(wrap_angles(bearing - self.axis))

    def noise(self, bearing: float, of: Int) -> Float:
        """Covariance of those distances [m^2], for some echoes, shape (m, m)."""
        moved, turned = self._effects(bearing, of)
        covariance = (moved * self.added[:, 0]) @ moved.T + (turned * self.added[:, 1]) @ turned.T
        covariance[np.diag_indices(len(of))] += self.sigma[of] ** 2
        return np.asarray(covariance)

    def variances(self, bearing: float) -> Float:
        """Their variances [m^2], for all echoes, shape (n,)."""
        moved, turned = self._effects(bearing, slice(None))
        effects = moved**2 @ self.added[:, 0] + turned**2 @ self.added[:, 1]
        return np.asarray(self.sigma**2 + effects)

    def _effects(self, bearing: float, of: Int | slice) -> tuple[Float, Float]:
        """What errors of each piece of the way do to distances, each of shape (m, k).

        One of the position moves the sonar; one of the heading [m/rad] turns what is on the other
        side of the piece about its middle.
        """
        aside = _unit(bearing + math.pi / 2)
        moved = self.pieces[of]
        return moved, -moved * ((self.xy[of] @ aside)[:, np.newaxis] - self.middles @ aside)


@dataclass(frozen=True)
class _Line:
    """A line fitted to echoes of a window.

    Attributes:
        distance: [m].
        bearing: [rad].
        covariance: Of both, shape (2, 2).
        of: Which echoes it was fitted to, shape (m,).
        chi2: Sum of their squared residuals, in standard deviations.
        surprises: How far each is from what the others say, in standard deviations, shape (m,).
        whitening: Makes their residuals independent, of variance 1, shape (m, m).
    """

    distance: float
    bearing: float
    covariance: Float
    of: Int
    chi2: float
    surprises: Float
    whitening: Float

    def feet(self, window: _Window) -> Float:
        """Where along the line every echo of the window comes from [m], shape (n,)."""
        return np.asarray(window.xy @ _unit(self.bearing + math.pi / 2))


@dataclass(frozen=True)
class _Known:
    """A wall that was found, in the odometry's frame.

    Attributes:
        odometry: When it was found last.
        middle: Of the part that was touched then [m], shape (2,).
        bearing: Of the perpendicular [rad].
        covariance: Of the place across, at the middle, and the bearing [m, rad], shape (2, 2).
        half_length: Of the part that was touched [m].
        times: How often it was found.
    """

    odometry: Odometry
    middle: Float
    bearing: float
    covariance: Float
    half_length: float
    times: int = 1


class SonarWalls:
    """Finds walls in the ranges of one robot's sonars.

    A wall is reported from the fourth time on that it is found, each time by new echoes. Until then
    its echoes must tell it from a post (a person, an edge), which takes some decimetres of way each
    time; later on fewer do, also while the robot stands. What moves fits no line, or not the same
    one again and again. Cross-talk, and ranges that passers-by cut short, are outvoted.

    Args:
        tuning: Constants.
    """

    def __init__(self, tuning: SonarTuning = SONAR_TUNING) -> None:
        self._tuning = tuning
        self._echoes: list[_Echo] = []
        self._known: list[_Known] = []
        self._searched_ns = self._reported_ns = 0

    def reset(self) -> None:
        """Forgets everything, as after a jump of the odometry or of time."""
        self._echoes.clear()
        self._known.clear()
        self._searched_ns = self._reported_ns = 0

    def take(
        self,
        measured: SonarRange,
        mounting: tuple[float, float, float],
        odometry: Odometry,
        bodies: Float = NOBODY,
    ) -> SeenWalls | None:
        """Takes a range.

        Args:
            measured: The range; one without an echo is welcome, too.
            mounting: x, y [m] and yaw [rad] of the sonar in base_link.
            odometry: The robot's dead reckoning at the range's stamp.
            bodies: Where people and team-mates are then (`walls.NOBODY`), shape (n, 3).

        Returns:
            Walls that were found by this range and those before, in base_link at the time of one
            of these; it is newer than that of the walls returned before. None: none.
        """
        since_s = (odometry.stamp_ns - self._searched_ns) / 1e9
        if since_s < -self._tuning.span_s:  # time jumped back
            self.reset()
        if measured.is_echo and not _may_be_of(bodies, measured, mounting, self._tuning):
            self._echoes.append(_echo(measured, mounting, odometry, self._tuning))
        if 0.0 <= since_s < self._tuning.period_s or not self._echoes:
            return None
        self._searched_ns = odometry.stamp_ns
        return self._search(odometry)

    def _search(self, now: Odometry) -> SeenWalls | None:
        """Looks for walls among the echoes, and forgets those that are old or used."""
        tuning = self._tuning
        leaving = self._forget(now)
        window = self._window()
        if window is None:
            return None
        free = ~window.used
        seen: list[_Line] = []
        for _ in range(tuning.walls):
            if free.sum() < tuning.least:
                break
            line = _next_line(window, free, tuning)
            if line is None:
                continue
            leaves = bool((line.of < leaving).any())
            enough = tuning.sigma_bearing_late if leaves else tuning.sigma_bearing
            if line.covariance[1, 1] > enough**2 or not _is_surface(window, line, tuning):
                continue
            is_flat = _odds(window, line, tuning) > tuning.odds
            times = self._note(window, line, is_flat)
            if times > 0:
                for k in line.of.tolist():
                    self._echoes[k] = self._echoes[k]._replace(used=True)
            if times >= tuning.times:
                seen.append(line)
        if not seen:
            return None
        self._reported_ns = window.odometry.stamp_ns
        return SeenWalls(window.odometry.stamp_ns, _walls(window, seen))

    def _forget(self, now: Odometry) -> int:
        """Forgets what is too old; returns how many of the others leave next."""
        tuning = self._tuning
        self._echoes.sort(key=lambda echo: echo.odometry.stamp_ns)
        stamps_xy = [(e.odometry.stamp_ns, e.odometry.x, e.odometry.y) for e in self._echoes]
        values = np.array([*stamps_xy, (now.stamp_ns, now.x, now.y)], dtype=np.float64)
        steps = np.hypot(*np.diff(values[:, 1:], axis=0).T)
        way, age_s = steps[::-1].cumsum()[::-1], (values[-1, 0] - values[:-1, 0]) / 1e9
        share = np.maximum(way / tuning.way, age_s / tuning.span_s)
        old, leaving = int((share > 1.0).sum()), int((share > tuning.leaving).sum())
        del self._echoes[:old]
        return leaving - old

    def _window(self) -> _Window | None:
        """The echoes in base_link at the time of the middle one; None: too few."""
        echoes = self._echoes
        fresh = [k for k, echo in enumerate(echoes) if not echo.used]
        newer = [k for k in fresh if echoes[k].odometry.stamp_ns > self._reported_ns]
        if len(fresh) < self._tuning.least or not newer:
            return None
        # Errors of the odometry before the middle and after it have opposite effects on a filter
        # that takes them for independent of this.
        middle = max(fresh[len(fresh) // 2], newer[0])
        here = echoes[middle].odometry
        turn = rotation_2d(here.yaw)
        values = np.array([echo[1:] for echo in echoes])
        stamps = np.array([echo.odometry.stamp_ns for echo in echoes])
        _, first, which = np.unique(stamps, return_index=True, return_inverse=True)
        track = [echoes[k].odometry for k in first]
        robot = (np.array([(o.x, o.y) for o in track]) - (here.x, here.y)) @ turn
        sums = np.array([(o.position_variance, o.heading_variance) for o in track])
        piece = np.arange(len(track) - 1)
        after, before = which[:, np.newaxis] > piece, which[middle] > piece
        return _Window(
            odometry=here,
            xy=(values[:, :2] - (here.x, here.y)) @ turn,
            axis=values[:, 2] - here.yaw,
            cone=values[:, 3],
            range=values[:, 4],
            sigma=values[:, 5],
            used=values[:, 6] > 0,
            pieces=after.astype(np.float64) - before,
            middles=0.5 * (robot[1:] + robot[:-1]),
            added=np.maximum(np.diff(sums, axis=0), 0.0),
        )

    def _note(self, window: _Window, line: _Line, is_flat: bool) -> int:
        """Keeps a wall; returns how often it was found, 0: it is new and may be a post."""
        tuning, found = self._tuning, _found(window, line)
        trusted = [known.times >= tuning.times for known in self._known]
        for k, known in enumerate(self._known):
            again = _again(known, found, tuning)
            if again is not None and (is_flat or trusted[k]):
                self._known[k] = again
                return again.times
        if not is_flat:
            return 0
        kept = [known for known in self._known if not _contradicts(known, found, tuning)]
        self._known = [*kept, found][-tuning.remembered :]
        return 1


def _echo(
    measured: SonarRange,
    mounting: tuple[float, float, float],
    odometry: Odometry,
    tuning: SonarTuning,
) -> _Echo:
    x, y = rotation_2d(odometry.yaw) @ mounting[:2]
    sigma = math.hypot(tuning.sigma, tuning.sigma_relative * measured.range)
    if measured.variance > 0:
        sigma = max(math.sqrt(measured.variance), tuning.least_sigma)
    return _Echo(
        odometry,
        odometry.x + float(x),
        odometry.y + float(y),
        odometry.yaw + mounting[2],
        0.5 * measured.field_of_view,
        measured.range,
        sigma,
    )


def _may_be_of(
    bodies: Float,
    measured: SonarRange,
    mounting: tuple[float, float, float],
    tuning: SonarTuning,
) -> bool:
    """Whether an echo may come from one of some bodies; the arguments are those of `take`."""
    x, y = (bodies[:, :2] - mounting[:2]).T
    away, reach = np.hypot(x, y), tuning.body + bodies[:, 2]
    off_axis = np.abs(wrap_angles(np.arctan2(y, x) - mounting[2]))
    wide = np.arcsin(np.minimum(reach / np.maximum(away, reach), 1.0))
    heard = off_axis < 0.5 * measured.field_of_view + tuning.side_lobes + wide
    return bool((heard & (np.abs(measured.range - away) < reach)).any())


def _next_line(window: _Window, free: Bool, tuning: SonarTuning) -> _Line | None:
    """The wall of most of the free echoes, which are free no longer; None: it is none."""
    bearing, voters = _vote(window, free, tuning)
    if len(voters) < tuning.least:
        free[:] = False  # others have fewer
        return None
    line = _fit(window, bearing, voters, tuning)
    sigma = np.sqrt(window.variances(line.bearing))
    near = np.abs(window.distances(line.bearing) - line.distance) < tuning.gate * sigma
    heard = window.off_axis(line.bearing) < window.cone + tuning.side_lobes
    of = np.flatnonzero(free & near & heard)
    for _ in range(tuning.refits):
        if len(of) < tuning.least:
            free[voters] = False
            return None
        line = _fit(window, line.bearing, of, tuning)
        kept = of[np.abs(line.surprises) < tuning.gate]
        if len(kept) == len(of):
            break
        of = kept
    free[line.of] = False
    return line


def _vote(window: _Window, free: Bool, tuning: SonarTuning) -> tuple[float, Int]:
    """Bearing [rad] and echoes of the line that most of the free echoes may come from.

    A Hough transform: each echo votes for a distance in each direction in its cone. Votes in two
    neighbouring bins count, less what their squared residuals take from them.
    """
    step = 2.0 * math.pi / tuning.directions
    of, widest = np.flatnonzero(free), window.cone + tuning.side_lobes
    nearest = np.rint(window.axis[of] / step).astype(np.intp)
    reach = math.ceil(widest.max() / step)
    aside = np.arange(-reach, reach + 1)
    off_axis = np.abs((nearest[:, np.newaxis] + aside) * step - window.axis[of, np.newaxis])
    each, k = np.nonzero(off_axis < widest[of, np.newaxis])
    echo, row = of[each], (nearest[each] + aside[k]) % tuning.directions
    if not len(echo):
        return 0.0, echo
    bearings = np.arange(tuning.directions) * step
    x, y = window.xy[echo].T
    distance = window.range[echo] + x * np.cos(bearings)[row] + y * np.sin(bearings)[row]
    bins = np.floor(distance / tuning.bin).astype(np.intp)
    bins -= bins.min()
    width = int(bins.max()) + 2
    weight = 1.0 / (window.sigma[echo] ** 2 + tuning.vote_sigma**2)
    votes, total, first, second = (
        summed[:-1] + summed[1:]
        for summed in (
            np.bincount(row * width + bins, values, width * tuning.directions)
            for values in (None, weight, weight * distance, weight * distance**2)
        )
    )
    total = np.maximum(total, 1e-12)
    best = int(np.argmax(votes - (second - first**2 / total) / tuning.gate**2))
    at, middle = best // width, first[best] / total[best]
    chosen = (row == at) & (np.abs(distance - middle) < tuning.bin)
    return float(bearings[at]), echo[chosen]


def _fit(window: _Window, bearing: float, of: Int, tuning: SonarTuning) -> _Line:
    """Generalized least squares; that the foot is in the cones is a weak observation, too."""
    whitening = np.linalg.inv(np.linalg.cholesky(window.noise(bearing, of)))
    axis, cone = window.axis[of], window.cone[of].max() + tuning.side_lobes
    ones = np.ones(len(of))
    for _ in range(2):
        along = window.xy[of] @ _unit(bearing + math.pi / 2)
        design = whitening @ np.stack([ones, -along], axis=1)
        wanted = whitening @ window.distances(bearing)[of]
        off_axis = float(wrap_angles(axis - bearing).mean())
        information = design.T @ design
        information[1, 1] += 3.0 / cone**2  # a uniform distribution's variance
        covariance = tuning.inflation * np.linalg.inv(information)
        moments = design.T @ wanted + (0.0, off_axis * 3.0 / cone**2)
        distance, turn = np.linalg.solve(information, moments)
        bearing += float(turn)
    residuals = wanted - design @ (distance, turn)
    surprises = (whitening.T @ residuals) / np.sqrt((whitening**2).sum(axis=0))
    chi2 = float(residuals @ residuals)
    return _Line(float(distance), bearing, covariance, of, chi2, surprises, whitening)


def _is_surface(window: _Window, line: _Line, tuning: SonarTuning) -> bool:
    """Whether what was heard from where a line's echoes come from is that line."""
    feet = line.feet(window)
    low, high = feet[line.of].min(), feet[line.of].max()
    there = (window.off_axis(line.bearing) < window.cone) & (feet >= low) & (feet <= high)
    beyond = window.distances(line.bearing) - line.distance
    # What is clearly nearer may be a passer-by.
    contrary = there & (beyond > -tuning.rough)
    # Used ones are of this wall, too.
    fits = np.abs(beyond) < tuning.gate * np.sqrt(window.variances(line.bearing))
    contrary[window.used & fits] = contrary[line.of] = False
    return bool(len(line.of) >= tuning.fitting * (len(line.of) + contrary.sum()))


def _odds(window: _Window, line: _Line, tuning: SonarTuning) -> float:
    """Log-likelihood of a line's echoes, less that if they came from a post."""
    of, radius = line.of, tuning.post_radius
    xy, measured = window.xy[of], window.range[of]
    place = xy.mean(axis=0) + (measured.mean() + radius) * _unit(line.bearing)
    for _ in range(4):
        offset = place - xy
        away = np.hypot(offset[:, 0], offset[:, 1])
        design = line.whitening @ (offset / away[:, np.newaxis])
        residuals = line.whitening @ (measured + radius - away)
        # A metre's uncertainty holds it where the echoes do not.
        place = place + np.linalg.solve(design.T @ design + np.eye(2), design.T @ residuals)
    offset = place - xy
    residuals = line.whitening @ (measured + radius - np.hypot(offset[:, 0], offset[:, 1]))
    off_axis = np.abs(wrap_angles(np.arctan2(offset[:, 1], offset[:, 0]) - window.axis[of]))
    unheard = np.maximum(off_axis - window.cone[of] - tuning.side_lobes, 0.0) / tuning.unheard
    return 0.5 * (float(residuals @ residuals + unheard @ unheard) - line.chi2)


def _found(window: _Window, line: _Line) -> _Known:
    """A line of a window, in the odometry's frame."""
    feet, here = line.feet(window)[line.of], window.odometry
    middle = 0.5 * (feet.min() + feet.max())
    normal, along = _unit(line.bearing), _unit(line.bearing + math.pi / 2)
    place = rotation_2d(here.yaw) @ (line.distance * normal + middle * along)
    shift = np.array([[1.0, -middle], [0.0, 1.0]])
    return _Known(
        odometry=here,
        middle=place + (here.x, here.y),
        bearing=wrap_angle(line.bearing + here.yaw),
        covariance=shift @ line.covariance @ shift.T,
        half_length=0.5 * float(feet.max() - feet.min()),
    )


def _again(known: _Known, found: _Known, tuning: SonarTuning) -> _Known | None:
    """Both together, where the found line is the known one; None: it is another."""
    before, now = known.odometry, found.odometry
    offset = found.middle - known.middle
    lever = float(offset @ _unit(known.bearing + math.pi / 2))
    difference = np.array(
        [offset @ _unit(known.bearing), wrap_angle(found.bearing - known.bearing)]
    )
    shift = np.array([[1.0, -lever], [0.0, 1.0]])
    expected = shift @ known.covariance @ shift.T
    position = abs(now.position_variance - before.position_variance)
    heading = abs(now.heading_variance - before.heading_variance)
    away = float(np.hypot(*(found.middle - (now.x, now.y))))
    expected += np.diag([position + heading * away**2, heading])
    expected += np.diag(np.square(tuning.slack))
    total = expected + found.covariance
    if difference @ np.linalg.solve(total, difference) > tuning.gate**2 + 2.0:
        return None
    if abs(lever) > known.half_length + found.half_length + tuning.near:
        return None
    gain = expected @ np.linalg.inv(total)
    across, turn = gain @ difference
    return _Known(
        odometry=now,
        middle=found.middle + (across - difference[0]) * _unit(known.bearing),
        bearing=wrap_angle(known.bearing + float(turn)),
        covariance=expected - gain @ expected,
        half_length=found.half_length,
        times=known.times + 1,
    )


def _contradicts(known: _Known, found: _Known, tuning: SonarTuning) -> bool:
    """Whether a line is where a known one is, and turned against it or a little beside it."""
    offset = found.middle - known.middle
    lever = float(offset @ _unit(known.bearing + math.pi / 2))
    beside = float(offset @ _unit(known.bearing))
    return (
        abs(wrap_angle(found.bearing - known.bearing)) < tuning.contradicting[1]
        and abs(beside) < tuning.contradicting[0]
        and abs(lever) < known.half_length + found.half_length + tuning.near
    )


def _walls(window: _Window, lines: list[_Line]) -> Walls:
    """Lines in normal form."""
    distance = np.array([line.distance for line in lines])
    bearing = np.array([line.bearing for line in lines])
    covariance = np.array([line.covariance for line in lines])
    feet = [line.feet(window)[line.of] for line in lines]
    extent = np.array([(f.min(), f.max()) for f in feet])
    behind = distance < 0  # between base_link and the sonar
    distance[behind] *= -1.0
    bearing[behind] += math.pi
    extent[behind] = -extent[behind, ::-1]
    covariance[behind] *= np.array([[1.0, -1.0], [-1.0, 1.0]])
    # In (-pi, pi].
    bearing = -wrap_angles(-bearing)
    return Walls(distance, bearing, covariance, extent, np.zeros((len(lines), 2), dtype=bool))


def _unit(bearing: float) -> Float:
    return np.array([math.cos(bearing), math.sin(bearing)])

"""Alignment: the move and turn that brings a robot's people onto those of others.

Hypotheses come from two people each: two places of the robot and two of others that are equally far
apart give a move and a turn. Each is refined with all people that match. The best is judged by its
evidence: the log-odds that the matched people are the same against that all are different people,
which takes into account how wide the search is (Laplace's approximation; MacKay, Information
Theory, Inference, and Learning Algorithms, 2003, chapter 28). So two people that match prove little
where the pose is hardly known, and five prove it. One person is enough where each of the two robots
sees nobody else and the pose is known well; they tell nothing about the turn.

Where nothing is known of the pose (`align_anywhere`), velocities are compared, too. Chance has many
tries then. Evidence is the logarithm of a ratio of likelihoods in which the prior probabilities of
all moves, turns and matches add up to 1: where nobody is the same, it is more than x with a
probability of at most exp(-x) (Markov's inequality), and by simulation much less.
"""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mrs_people_loc.arrays import Bool, Float, Int, StructOfArrays
from mrs_people_loc.geometry import rotation_2d, squared_mahalanobis, wrap_angle


@dataclass(frozen=True)
class AlignmentTuning:
    """Constants of the search, chosen by hand.

    Attributes:
        gate: A move and turn is within so many standard deviations of the expected one.
        baseline: Two people are a hypothesis if they are farther apart than this [m].
        density: People whom only one of two robots sees [1/m^2]; what a match has to beat.
        density_of_one: Likewise where each of them sees one person.
        candidates: Possible matches that hypotheses are made of, at most.
        hypotheses: Hypotheses that are scored, at most: those of people whose distance agrees best.
        refined: Different ones that are refined, at most: the best.
        steps: Gauss-Newton steps of a refinement.
        distinct: Two hypotheses are different ones if they bring people to places that are farther
            apart than this, root mean square [m].
        tie: Of two matches that are equally good the first is better by this gain.
        margin_of_spread: Added to the spread of people on each side, where their density is
            measured, and to how far their middles are apart [m].
        walk: Standard deviation of the velocity of a group that walks, on each axis [m/s].
    """

    gate: float = 3.5
    baseline: float = 0.4
    density: float = 0.5
    density_of_one: float = 0.1
    candidates: int = 80
    hypotheses: int = 128
    refined: int = 10
    steps: int = 3
    distinct: float = 0.25
    tie: float = 1e-9
    margin_of_spread: float = 0.5
    walk: float = 0.8


ALIGNMENT_TUNING = AlignmentTuning()
#: Of `align_anywhere`: 12 people on each side, at all turns.
ANYWHERE_TUNING = AlignmentTuning(candidates=144, hypotheses=192, refined=12)


@dataclass(frozen=True)
class Places(StructOfArrays):
    """Places of people, a struct of arrays of one length (n,).

    Attributes:
        xy: Relative to the place of the robot that is moved [m], shape (n, 2).
        covariance: [m^2], shape (n, 2, 2).
        sample: Number of the time that they are of: only those of one time are matched.
    """

    xy: Float
    covariance: Float
    sample: Int


@dataclass(frozen=True)
class MovingPlaces(Places):
    """Places of people who may walk, likewise.

    Attributes:
        velocity: Shape (n, 2) [m/s].
        velocity_covariance: Shape (n, 2, 2) [m^2/s^2].
    """

    velocity: Float
    velocity_covariance: Float


@dataclass(frozen=True)
class Alignment:
    """A move and turn of a robot, and of the people that it sees.

    Attributes:
        move: [m], shape (2,).
        turn: To the left, about the place of the robot [rad].
        own: Indices of its people that match, shape (m,).
        others: Indices of the places that they match, likewise.
        evidence: Log-odds that the matched people are the same, against that nobody is.
        margin: By how much that is more than with the best other move and turn; infinite: there is
            no other.
    """

    move: Float
    turn: float
    own: Int
    others: Int
    evidence: float
    margin: float


def align(
    own: Places,
    others: Places,
    *priors: Float,
    wider: float = 0.5,
    tuning: AlignmentTuning = ALIGNMENT_TUNING,
) -> Alignment | None:
    """Finds the move and turn with which most of a robot's people are where others see people.

    Args:
        own: Places of people that the robot sees.
        others: Places of people that others see, relative to the same point.
        *priors: Covariances of what its pose may be wrong by, x, y, turn [m, m, rad], shape (3, 3):
            one, or two of which the second is wider.
        wider: Probability of the second.
        tuning: Constants.

    Returns:
        The likeliest, the priors taken into account; None: no two people match, or not the one
        whom both see.
    """
    alone = len(own) == len(others) == 1
    if alone:
        tuning = dataclasses.replace(tuning, density=tuning.density_of_one)
    matches = _possible_matches(own, others, priors[-1], tuning)
    if len(matches) < (1 if alone else 2):
        return None
    likely = (1.0 - wider, wider) if len(priors) == 2 else (1.0,)
    return _likeliest(matches, priors, likely, tuning)


def align_anywhere(
    own: MovingPlaces, others: MovingPlaces, *, tuning: AlignmentTuning = ANYWHERE_TUNING
) -> Alignment | None:
    """Finds the move and turn with which people are where others see people, whatever they are.

    Of the turn nothing is known; of the move, that it brings the middle of the people near that of
    the others: as near as people are spread. Covariances of the own people count as if they were
    the same along and across, as the turn is not known.

    Args:
        own: People that the robot sees.
        others: People that others see, relative to the same point.
        tuning: Constants.

    Returns:
        The likeliest; None: no two people match.
    """
    fewer = min(len(own), len(others))
    if fewer < 2:
        return None
    middle, there = own.xy.mean(axis=0), others.xy.mean(axis=0)
    spread = [np.cov(one.xy, rowvar=False, bias=True) for one in (own, others)]
    more = tuning.margin_of_spread**2 * np.eye(2)
    variance = 0.5 * float(np.trace(spread[0] + spread[1] + more))
    # People spread evenly over an ellipse have a quarter of its half axes squared for variances.
    areas = [4.0 * math.pi * math.sqrt(np.linalg.det(one + more)) for one in spread]
    density = max(tuning.density, len(own) / areas[0], len(others) / areas[1])
    tuning = dataclasses.replace(tuning, density=density)
    own = dataclasses.replace(
        own, xy=own.xy - middle, covariance=_round(own.covariance),
        velocity_covariance=_round(own.velocity_covariance),
    )  # fmt: skip
    others = dataclasses.replace(others, xy=others.xy - there)
    prior = np.diag([variance, variance, 2.0 * math.pi])  # the last one: see `_likeliest`
    matches = _possible_matches(own, others, prior, tuning)
    if len(matches) < 2:
        return None
    # Each number of matches is equally likely, and so is each choice of so many.
    ways = [math.log((fewer + 1) * math.comb(fewer, m)) for m in range(fewer + 1)]
    extra = _log_group(own, others, tuning) - np.array(ways)
    found = _likeliest(_moving(matches, own, others), (prior,), (1.0,), tuning, extra)
    if found is None:
        return None
    move = found.move + there - rotation_2d(found.turn) @ middle
    return dataclasses.replace(found, move=move, turn=wrap_angle(found.turn))


def fit(
    own: Float, own_covariance: Float, others: Float, others_covariance: Float, turn: float
) -> tuple[Float, Float]:
    """The move and turn that bring places nearest to others, one by one: weighted least squares.

    Args:
        own: Places relative to that of the robot that is moved [m], shape (m, 2), m >= 1.
        own_covariance: Of these [m^2], shape (m, 2, 2).
        others: Where they are brought to [m], shape (m, 2).
        others_covariance: Of these [m^2], shape (m, 2, 2).
        turn: First guess [rad].

    Returns:
        x, y, turn [m, m, rad], shape (3,), and their covariance, shape (3, 3). One place tells
        nothing about the turn: it is as guessed, with a standard deviation of 1 rad.
    """
    state = np.array([0.0, 0.0, turn])
    of_turn = np.diag([0.0, 0.0, float(len(own) == 1)])
    for _ in range(4):
        rotation = rotation_2d(state[2])
        turned = own @ rotation.T
        total = rotation @ own_covariance @ rotation.T + others_covariance
        jacobian = np.zeros((len(own), 2, 3))
        jacobian[:, 0, 0] = jacobian[:, 1, 1] = 1.0
        jacobian[:, 0, 2], jacobian[:, 1, 2] = -turned[:, 1], turned[:, 0]
        weighted = np.linalg.solve(total, jacobian)
        covariance = np.linalg.inv(np.einsum("nji,njk->ik", jacobian, weighted) + of_turn)
        off = others - turned - state[:2]
        state = state + covariance @ np.einsum("nji,nj->i", weighted, off)
    return state, covariance


def _likeliest(
    matches: _Matches,
    priors: Sequence[Float],
    likely: Sequence[float],
    tuning: AlignmentTuning,
    extra: Float | None = None,
) -> Alignment | None:
    """The likeliest move and turn.

    Args:
        matches: Two at least, or one that is all there is.
        priors: See `align`.
        likely: Their probabilities.
        tuning: Constants.
        extra: By number of matches, what is added to the evidence; None: nothing. If given, each
            turn is as likely as the others: a normal distribution about it with a variance of
            2 pi has a density of 1 / (2 pi) there.
    """
    prior = priors[-1]
    few = matches.select(slice(tuning.candidates))
    states = _hypotheses(few, prior, tuning)
    states = states[few.different(states, few.matched(states)[1], tuning)]
    information, known = np.linalg.inv(prior), np.array([1.0, 1.0, float(extra is None)])
    for _ in range(tuning.steps):
        matched, _ = matches.matched(states)
        normal, gradient = matches.normal_equations(states, matched)
        step = gradient - (states * known) @ information
        states = states + np.linalg.solve(normal + information, step[:, :, np.newaxis])[:, :, 0]
    matched, gain = matches.matched(states)
    normal, gradient = matches.normal_equations(states, matched)
    freedom = [
        math.log(share) + _log_mean(states * known, normal, gradient, one)
        for one, share in zip(priors, likely, strict=True)
    ]
    evidence = gain + np.logaddexp.reduce(freedom)
    count = matched.sum(axis=1)
    if extra is not None:
        evidence += extra[count]
    evidence[count < min(2, len(matches))] = -np.inf
    best = int(evidence.argmax())
    if not np.isfinite(evidence[best]):
        return None
    other = matches.distance(states, best) > tuning.distinct
    margin = evidence[best] - evidence[other].max(initial=-np.inf)
    which = np.flatnonzero(matched[best])
    return Alignment(
        states[best, :2], float(states[best, 2]), matches.own[which], matches.others[which],
        float(evidence[best]), float(margin),
    )  # fmt: skip


@dataclass(frozen=True)
class _Groups:
    """Columns of a table in groups.

    Attributes:
        order: The columns, those of one group one after the other, shape (k,).
        first: Where each group begins in that order.
        number: Of each column, its group, shape (k,).
    """

    order: Int
    first: Int
    number: Int

    @classmethod
    def of(cls, key: Int) -> _Groups:
        """Columns of one key are a group."""
        order = np.argsort(key, kind="stable")
        begins = np.ones(len(key), dtype=bool)
        begins[1:] = key[order[1:]] != key[order[:-1]]
        number = np.empty(len(key), dtype=np.intp)
        number[order] = np.cumsum(begins) - 1
        return cls(order, np.flatnonzero(begins), number)

    def largest(self, values: Float) -> Float:
        """By row, the largest value in each column's group; shape (h, k), as the values'."""
        largest = np.maximum.reduceat(values[:, self.order], self.first, axis=1)
        return np.asarray(largest[:, self.number])


@dataclass(frozen=True)
class _Matches(StructOfArrays):
    """Possible matches, arrays of one length (k,), those of one own place one after the other.

    Attributes:
        own: Index of the robot's own place.
        others: Index of the other place.
        sample: Their time.
        here: The own place [m], shape (k, 2).
        there: The other [m], shape (k, 2).
        total: Covariance of the difference [m^2], shape (k, 2, 2).
        information: Its inverse: xx, xy, yy, shape (k, 3).
        most: Gain of a match where the places are equal.
    """

    own: Int
    others: Int
    sample: Int
    here: Float
    there: Float
    total: Float
    information: Float
    most: Float

    @cached_property
    def _rivals(self) -> tuple[_Groups, _Groups]:
        """Matches of one own place, and of one other place: one of them at most is right."""
        return _Groups.of(self.own), _Groups.of(self.others)

    def offsets(self, states: Float) -> tuple[Float, Float, Float, Float]:
        """Where own places, moved and turned, are short of the others, and the turned places.

        Returns:
            x and y of the offset, x and y of the turned place [m], each of shape (h, k).
        """
        c, s = np.cos(states[:, 2:]), np.sin(states[:, 2:])
        x = c * self.here[:, 0] - s * self.here[:, 1]
        y = s * self.here[:, 0] + c * self.here[:, 1]
        return self.there[:, 0] - x - states[:, :1], self.there[:, 1] - y - states[:, 1:2], x, y

    def gain(self, states: Float) -> Float:
        """Gain of each match with each move and turn, shape (h, k)."""
        dx, dy, _, _ = self.offsets(states)
        xx, xy, yy = self.information.T
        return np.asarray(self.most - 0.5 * (xx * dx * dx + 2.0 * xy * dx * dy + yy * dy * dy))

    def matched(self, states: Float) -> tuple[Bool, Float]:
        """Which match with each move and turn, one to one, shape (h, k), and their gain, (h,)."""
        gain = self.gain(states)
        gain -= ALIGNMENT_TUNING.tie * np.arange(len(self))
        matched = gain > 0.0
        for groups in self._rivals:
            matched &= gain >= groups.largest(gain)
        return matched, np.where(matched, gain, 0.0).sum(axis=1)

    def normal_equations(self, states: Float, matched: Bool) -> tuple[Float, Float]:
        """Information of the matches on x, y, turn, shape (h, 3, 3), and gradient, shape (h, 3)."""
        dx, dy, x, y = self.offsets(states)
        a, b, c = (np.where(matched, one, 0.0) for one in self.information.T)
        # Jacobian of a moved place: [[1, 0, -y], [0, 1, x]].
        turn_x, turn_y = b * x - a * y, c * x - b * y
        normal = np.empty((len(states), 3, 3))
        normal[:, 0, 0], normal[:, 1, 1] = a.sum(axis=1), c.sum(axis=1)
        normal[:, 0, 1] = normal[:, 1, 0] = b.sum(axis=1)
        normal[:, 0, 2] = normal[:, 2, 0] = turn_x.sum(axis=1)
        normal[:, 1, 2] = normal[:, 2, 1] = turn_y.sum(axis=1)
        normal[:, 2, 2] = (turn_y * x - turn_x * y).sum(axis=1)
        gradient = np.stack(
            [a * dx + b * dy, b * dx + c * dy, turn_x * dx + turn_y * dy], axis=1
        ).sum(axis=2)
        return normal, gradient

    def distance(self, states: Float, one: int) -> Float:
        """Distances of the own places, moved and turned by one state and by each [m].

        Root mean square: that of the centres of gravity, and the turn times the radius of gyration.

        Args:
            states: Shape (h, 3).
            one: Index of the one.

        Returns:
            Shape (h,).
        """
        centre = self.here.mean(axis=0)
        squared_radius = np.square(self.here - centre).sum(axis=1).mean()
        c, s = np.cos(states[:, 2]), np.sin(states[:, 2])
        x = states[:, 0] + c * centre[0] - s * centre[1]
        y = states[:, 1] + s * centre[0] + c * centre[1]
        turned = 2.0 - 2.0 * np.cos(states[:, 2] - states[one, 2])
        squared = (x - x[one]) ** 2 + (y - y[one]) ** 2
        return np.asarray(np.sqrt(squared + squared_radius * turned))

    def different(self, states: Float, score: Float, tuning: AlignmentTuning) -> list[int]:
        """Indices of states that are different from each other, the best first."""
        left = score.copy()
        found: list[int] = []
        while len(found) < tuning.refined and np.isfinite(left).any():
            best = int(left.argmax())
            found.append(best)
            left[self.distance(states, best) < tuning.distinct] = -np.inf
        return found

    def disagreement(self, first: Int, second: Int, turn: Float) -> Float:
        """What speaks against turns of two matches each, beside the places: here nothing."""
        return np.zeros(len(turn))


@dataclass(frozen=True)
class _MovingMatches(_Matches):
    """Possible matches of people who may walk.

    Attributes:
        velocity: The same, of the velocities: these are turned, and not moved.
    """

    velocity: _Matches

    def disagreement(self, first: Int, second: Int, turn: Float) -> Float:
        """Squared Mahalanobis lengths of the velocities' differences, beyond the expected 4."""
        squared, c, s = np.zeros(len(turn)), np.cos(turn), np.sin(turn)
        for k in (first, second):
            v, total = self.velocity.here[k], self.velocity.total[k]
            turned = np.stack([c * v[:, 0] - s * v[:, 1], s * v[:, 0] + c * v[:, 1]], axis=1)
            squared += squared_mahalanobis(self.velocity.there[k] - turned, total)
        return np.maximum(squared - 4.0, 0.0)

    def gain(self, states: Float) -> Float:
        """Gain of each match with each move and turn, shape (h, k)."""
        return super().gain(states) + self.velocity.gain(states * (0.0, 0.0, 1.0))

    def normal_equations(self, states: Float, matched: Bool) -> tuple[Float, Float]:
        """Information of the matches on x, y, turn, shape (h, 3, 3), and gradient, shape (h, 3)."""
        normal, gradient = super().normal_equations(states, matched)
        of_turn = self.velocity.normal_equations(states * (0.0, 0.0, 1.0), matched)
        normal[:, 2, 2] += of_turn[0][:, 2, 2]
        gradient[:, 2] += of_turn[1][:, 2]
        return normal, gradient


def _possible_matches(
    own: Places, others: Places, prior: Float, tuning: AlignmentTuning
) -> _Matches:
    """Places of one time that may be of one person."""
    i, j = np.nonzero(own.sample[:, np.newaxis] == others.sample)
    here, there = own.xy[i], others.xy[j]
    total = own.covariance[i] + others.covariance[j]
    moved = np.zeros((len(i), 2, 3))
    moved[:, 0, 0] = moved[:, 1, 1] = 1.0
    moved[:, 0, 2], moved[:, 1, 2] = -here[:, 1], here[:, 0]
    squared = squared_mahalanobis(there - here, moved @ prior @ moved.transpose(0, 2, 1) + total)
    near = np.flatnonzero(squared < tuning.gate**2)
    total = total[near]
    information, most = _weights(total, tuning.density)
    return _Matches(
        i[near], j[near], own.sample[i[near]], here[near], there[near], total, information, most
    )


def _weights(total: Float, density: float | Float) -> tuple[Float, Float]:
    """Information of matches: xx, xy, yy, shape (k, 3); and their gain at most, shape (k,).

    Args:
        total: Covariance of the difference, shape (k, 2, 2).
        density: What a match has to beat.
    """
    determinant = total[:, 0, 0] * total[:, 1, 1] - total[:, 0, 1] ** 2
    inverse = np.stack([total[:, 1, 1], -total[:, 0, 1], total[:, 0, 0]], axis=1)
    most = -np.log(density * 2.0 * math.pi * np.sqrt(determinant))
    return inverse / determinant[:, np.newaxis], most


def _moving(matches: _Matches, own: MovingPlaces, others: MovingPlaces) -> _MovingMatches:
    """Possible matches of people who may walk."""
    i, j = matches.own, matches.others
    total = own.velocity_covariance[i] + others.velocity_covariance[j]
    density = np.maximum(_velocity_density(own)[i], _velocity_density(others)[j])
    information, most = _weights(total, density)
    here, there = own.velocity[i], others.velocity[j]
    velocity = _Matches(i, j, matches.sample, here, there, total, information, most)
    return _MovingMatches(**vars(matches), velocity=velocity)


def _round(covariance: Float) -> Float:
    """Covariances of the same mean variance that are the same at any turn, shape (n, 2, 2)."""
    half = 0.5 * np.trace(covariance, axis1=1, axis2=2)
    return np.asarray(half[:, np.newaxis, np.newaxis] * np.eye(2))


def _velocity_density(people: MovingPlaces) -> Float:
    """How dense velocities are at that of each person, at most [s^2/m^2], shape (n,).

    The larger one of a normal distribution of all, and of what the others have: of people who all
    walk alike, or stand, a velocity tells none from another.
    """
    everybody = _spread_of_velocities(people) + people.velocity_covariance
    normal = _normal_density(people.velocity - people.velocity.mean(axis=0), everybody)
    offset = (people.velocity - people.velocity[:, np.newaxis]).reshape(-1, 2)
    covariance = people.velocity_covariance
    both = (covariance + covariance[:, np.newaxis]).reshape(-1, 2, 2)
    of_others = _normal_density(offset, both).reshape(len(people), -1)
    np.fill_diagonal(of_others, 0.0)
    return np.asarray(np.maximum(normal, of_others.sum(axis=1) / (len(people) - 1)))


def _spread_of_velocities(people: MovingPlaces) -> Float:
    return np.asarray(np.cov(people.velocity, rowvar=False, bias=True))


def _normal_density(offset: Float, covariance: Float) -> Float:
    """Of a normal distribution about zero, at offsets of shape (m, 2)."""
    scale = 2.0 * math.pi * np.sqrt(np.linalg.det(covariance))
    return np.asarray(np.exp(-0.5 * squared_mahalanobis(offset, covariance)) / scale)


def _log_group(own: MovingPlaces, others: MovingPlaces, tuning: AlignmentTuning) -> float:
    """What it proves that two groups walk alike, or stand, as a whole [log-odds].

    Every other group stands; the others walk with any velocity.
    """
    gains = []
    for people in (own, others):
        mean = people.velocity.mean(axis=0)[np.newaxis]
        unsure = _spread_of_velocities(people) + people.velocity_covariance.mean(axis=0)
        stands, walks = unsure[np.newaxis], (unsure + tuning.walk**2 * np.eye(2))[np.newaxis]
        chance = 0.5 * float(_normal_density(mean, stands)[0] + _normal_density(mean, walks)[0])
        chance = max(chance, 1e-99)  # nobody walks like that
        gains.append(-math.log(2.0 * math.pi * math.sqrt(np.linalg.det(unsure)) * chance))
    return min(gains)


def _hypotheses(matches: _Matches, prior: Float, tuning: AlignmentTuning) -> Float:
    """Moves and turns of two people each, shape (h, 3): those whose distance agrees best; and none.

    A move and turn of two people is their middle's and that of the line between them. Where one
    match is all there is, it is that match's, without a turn.
    """
    if len(matches) == 1:
        return np.array([np.zeros(3), [*(matches.there - matches.here)[0], 0.0]])
    k, n = np.nonzero(np.triu(matches.sample[:, np.newaxis] == matches.sample, 1))
    two = (matches.own[k] != matches.own[n]) & (matches.others[k] != matches.others[n])
    k, n = k[two], n[two]
    here, there = matches.here[n] - matches.here[k], matches.there[n] - matches.there[k]
    away, other_away = np.hypot(*here.T), np.hypot(*there.T)
    # Most of them fail by far: a variance is at most the trace.
    trace = matches.total[:, 0, 0] + matches.total[:, 1, 1]
    rough = (away - other_away) ** 2 < tuning.gate**2 * (trace[k] + trace[n])
    k, n, here, there = k[rough], n[rough], here[rough], there[rough]
    away, other_away = away[rough], other_away[rough]
    total = matches.total[k] + matches.total[n]
    variance = np.einsum("ni,nij,nj->n", there, total, there) / np.maximum(other_away**2, 1e-9)
    mismatch = (away - other_away) ** 2 / variance
    turn = np.arctan2(
        here[:, 0] * there[:, 1] - here[:, 1] * there[:, 0], (here * there).sum(axis=1)
    )
    c, s = np.cos(turn), np.sin(turn)
    middle = 0.5 * (matches.here[n] + matches.here[k])
    turned = np.stack([c * middle[:, 0] - s * middle[:, 1], s * middle[:, 0] + c * middle[:, 1]], 1)
    move = 0.5 * (matches.there[n] + matches.there[k]) - turned
    state = np.column_stack([move, turn])
    # Two people say little about the turn: it is judged with all of them.
    unsure = total[:, 0, 0] + total[:, 1, 1]
    allowed = tuning.gate * np.sqrt(prior[2, 2] + unsure / np.maximum(away, tuning.baseline) ** 2)
    good = (np.minimum(away, other_away) > tuning.baseline) & (np.abs(turn) < allowed)
    good &= mismatch < tuning.gate**2
    index = np.flatnonzero(good)
    mismatch = mismatch[index] + matches.disagreement(k[index], n[index], turn[index])
    order = np.argsort(mismatch, kind="stable")[: tuning.hypotheses]
    index = index[order[mismatch[order] < tuning.gate**2]]
    return np.vstack([np.zeros(3), state[index]])


def _log_mean(states: Float, normal: Float, gradient: Float, prior: Float) -> Float:
    """Log of the mean likelihood over a prior, relative to that at a state, shape (h,).

    The log-likelihood is taken for quadratic about the state.

    Args:
        states: Shape (h, 3).
        normal: Its information there, shape (h, 3, 3).
        gradient: Its gradient, shape (h, 3).
        prior: Covariance of a normal distribution about zero, shape (3, 3).
    """
    information = np.linalg.inv(prior)
    off = states @ information
    slope = (gradient - off)[:, :, np.newaxis]
    higher = (slope * np.linalg.solve(normal + information, slope)).sum(axis=(1, 2))
    volume = np.linalg.slogdet(np.eye(3) + normal @ prior)[1]
    return np.asarray(0.5 * (higher - (off * states).sum(axis=1) - volume))

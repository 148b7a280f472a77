"""Alignment: the move and turn that brings a robot's people onto those of others.

Hypotheses come from two people each: two places of the robot and two of others that are equally far
apart give a move and a turn. Each is refined with all people that match. The best is judged by its
evidence: the log-odds that the matched people are the same against that all are different people,
which takes into account how wide the search is (Laplace's approximation; MacKay, Information
Theory, Inference, and Learning Algorithms, 2003, chapter 28). So two people that match prove little
where the pose is hardly known, and five prove it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from mrs_people_loc.arrays import Bool, Float, Int, StructOfArrays
from mrs_people_loc.geometry import rotation_2d, squared_mahalanobis


@dataclass(frozen=True)
class AlignmentTuning:
    """Constants of the search, chosen by hand.

    Attributes:
        gate: A move and turn is within so many standard deviations of the expected one.
        baseline: Two people are a hypothesis if they are farther apart than this [m].
        density: People whom only one of two robots sees [1/m^2]; what a match has to beat.
        candidates: Possible matches that hypotheses are made of, at most.
        hypotheses: Hypotheses that are scored, at most: those of people whose distance agrees best.
        refined: Different ones that are refined, at most: the best.
        steps: Gauss-Newton steps of a refinement.
        distinct: Two hypotheses are different ones if they bring people to places that are farther
            apart than this, root mean square [m].
        tie: Of two matches that are equally good the first is better by this gain.
    """

    gate: float = 3.5
    baseline: float = 0.4
    density: float = 0.5
    candidates: int = 80
    hypotheses: int = 128
    refined: int = 10
    steps: int = 3
    distinct: float = 0.25
    tie: float = 1e-9


ALIGNMENT_TUNING = AlignmentTuning()


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
    own: Places, others: Places, *priors: Float, tuning: AlignmentTuning = ALIGNMENT_TUNING
) -> Alignment | None:
    """Finds the move and turn with which most of a robot's people are where others see people.

    Args:
        own: Places of people that the robot sees.
        others: Places of people that others see, relative to the same point.
        *priors: Covariances of what its pose may be wrong by, x, y, turn [m, m, rad], shape (3, 3),
            one at least; each is as likely as the others, and the last is the widest.
        tuning: Constants.

    Returns:
        The likeliest, the priors taken into account; None: no two people match.
    """
    prior = priors[-1]
    matches = _possible_matches(own, others, prior, tuning)
    if len(matches) < 2:
        return None
    few = matches.select(slice(tuning.candidates))
    states = _hypotheses(few, prior, tuning)
    states = states[few.different(states, few.matched(states)[1], tuning)]
    information = np.linalg.inv(prior)
    for _ in range(tuning.steps):
        matched, _ = matches.matched(states)
        normal, gradient = matches.normal_equations(states, matched)
        step = gradient - states @ information
        states = states + np.linalg.solve(normal + information, step[:, :, np.newaxis])[:, :, 0]
    matched, gain = matches.matched(states)
    normal, gradient = matches.normal_equations(states, matched)
    freedom = [_log_mean(states, normal, gradient, one) for one in priors]
    evidence = gain + np.logaddexp.reduce(freedom) - math.log(len(priors))
    evidence[matched.sum(axis=1) < 2] = -np.inf
    best = int(evidence.argmax())
    if not np.isfinite(evidence[best]):
        return None
    other = matches.distance(states)[best] > tuning.distinct
    margin = evidence[best] - evidence[other].max(initial=-np.inf)
    which = np.flatnonzero(matched[best])
    return Alignment(
        states[best, :2], float(states[best, 2]), matches.own[which], matches.others[which],
        float(evidence[best]), float(margin),
    )  # fmt: skip


def fit(
    own: Float, own_covariance: Float, others: Float, others_covariance: Float, turn: float
) -> tuple[Float, Float]:
    """The move and turn that bring places nearest to others, one by one: weighted least squares.

    Args:
        own: Places relative to that of the robot that is moved [m], shape (m, 2), m >= 2.
        own_covariance: Of these [m^2], shape (m, 2, 2).
        others: Where they are brought to [m], shape (m, 2).
        others_covariance: Of these [m^2], shape (m, 2, 2).
        turn: First guess [rad].

    Returns:
        x, y, turn [m, m, rad], shape (3,), and their covariance, shape (3, 3).
    """
    state = np.array([0.0, 0.0, turn])
    for _ in range(4):
        rotation = rotation_2d(state[2])
        turned = own @ rotation.T
        total = rotation @ own_covariance @ rotation.T + others_covariance
        jacobian = np.zeros((len(own), 2, 3))
        jacobian[:, 0, 0] = jacobian[:, 1, 1] = 1.0
        jacobian[:, 0, 2], jacobian[:, 1, 2] = -turned[:, 1], turned[:, 0]
        weighted = np.linalg.solve(total, jacobian)
        covariance = np.linalg.inv(np.einsum("nji,njk->ik", jacobian, weighted))
        off = others - turned - state[:2]
        state = state + covariance @ np.einsum("nji,nj->i", weighted, off)
    return state, covariance


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

    def matched(self, states: Float) -> tuple[Bool, Float]:
        """Which match with each move and turn, one to one, shape (h, k), and their gain, (h,)."""
        dx, dy, _, _ = self.offsets(states)
        xx, xy, yy = self.information.T
        gain = self.most - 0.5 * (xx * dx * dx + 2.0 * xy * dx * dy + yy * dy * dy)
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

    def distance(self, states: Float) -> Float:
        """Distances of the own places, moved and turned by one state and another [m].

        Root mean square: that of the centres of gravity, and the turn times the radius of gyration.

        Args:
            states: Shape (h, 3).

        Returns:
            Shape (h, h).
        """
        centre = self.here.mean(axis=0)
        squared_radius = np.square(self.here - centre).sum(axis=1).mean()
        c, s = np.cos(states[:, 2]), np.sin(states[:, 2])
        x = states[:, 0] + c * centre[0] - s * centre[1]
        y = states[:, 1] + s * centre[0] + c * centre[1]
        turned = 2.0 - 2.0 * np.cos(states[:, 2] - states[:, 2:])
        squared = (x - x[:, np.newaxis]) ** 2 + (y - y[:, np.newaxis]) ** 2
        return np.asarray(np.sqrt(squared + squared_radius * turned))

    def different(self, states: Float, score: Float, tuning: AlignmentTuning) -> list[int]:
        """Indices of states that are different from each other, the best first."""
        near = self.distance(states) < tuning.distinct
        left = score.copy()
        found: list[int] = []
        while len(found) < tuning.refined and np.isfinite(left).any():
            best = int(left.argmax())
            found.append(best)
            left[near[best]] = -np.inf
        return found


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
    determinant = total[:, 0, 0] * total[:, 1, 1] - total[:, 0, 1] ** 2
    inverse = np.stack([total[:, 1, 1], -total[:, 0, 1], total[:, 0, 0]], axis=1)
    most = -np.log(tuning.density * 2.0 * math.pi * np.sqrt(determinant))
    return _Matches(
        i[near], j[near], own.sample[i[near]], here[near], there[near], total,
        inverse / determinant[:, np.newaxis], most,
    )  # fmt: skip


def _hypotheses(matches: _Matches, prior: Float, tuning: AlignmentTuning) -> Float:
    """Moves and turns of two people each, shape (h, 3): those whose distance agrees best; and none.

    A move and turn of two people is their middle's and that of the line between them.
    """
    k, n = np.nonzero(np.triu(matches.sample[:, np.newaxis] == matches.sample, 1))
    two = (matches.own[k] != matches.own[n]) & (matches.others[k] != matches.others[n])
    k, n = k[two], n[two]
    here, there = matches.here[n] - matches.here[k], matches.there[n] - matches.there[k]
    away, other_away = np.hypot(*here.T), np.hypot(*there.T)
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
    index = index[np.argsort(mismatch[index], kind="stable")[: tuning.hypotheses]]
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

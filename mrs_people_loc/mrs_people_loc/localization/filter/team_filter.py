"""One extended Kalman filter over a team's poses and the walls it sees.

The joint state of Roumeliotis & Bekey 2002 ("Distributed multirobot localization"), with the
cross-covariances of all robots and walls, so that nothing is counted twice; walls as in SLAM with
lines (Smith, Self & Cheeseman 1990). What team-mates' own filters say is correlated with the state
in an unknown way and is fused by covariance intersection (Julier & Uhlmann 1997).
"""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.config import Localization
from mrs_people_loc.localization.filter.kalman import (
    Residual,
    corrected,
    gates_of,
    noted,
    share_of_claim,
    wrapped,
)
from mrs_people_loc.localization.filter.observations import (
    Claimed,
    Joined,
    Left,
    Met,
    Observation,
    PeopleStand,
    Placed,
    Reached,
    WallsSeen,
    pose_from,
)
from mrs_people_loc.localization.filter.standing_people import StandingLandmarks
from mrs_people_loc.localization.filter.team_state import Source, TeamState, Trust, changed
from mrs_people_loc.localization.filter.wall_landmarks import Verdict, WallLandmarks
from mrs_people_loc.localization.odometry import carried_on, turned
from mrs_people_loc.localization.shared import YAW_UNKNOWN
from mrs_people_loc.localization.walls import Walls


@dataclass(frozen=True)
class FilterTuning:
    """Constants, chosen by hand.

    Attributes:
        lost_after: A robot is lost after so many observations in a row that do not fit,
        refuted_after: or so many relative poses, if others tell which of the two, ...
        lost_after_s: ... and this time [s].
        bumped_after: After so many walls in a row it may have been bumped: its pose is less sure
        bump_sigmas: by this [m, m, rad].
        far: Relative poses by people that are off by so many gates are no errors of odometry:
        far_after: ... after so many in a row a robot is lost; after one if the two never fitted.
        restart: A team-mate that begins again farther than this from where it was [m] ...
        restart_speed: ... and this speed explains [m/s] is not believed until something fits.
        contradicted_s: Likewise where other walls of the same sights fit, as they do if it was
            carried along them [s].
        across: Known walls speak for a robot that is off in a direction whose cosine with theirs is
            larger.
        start_patience: It takes so many times as many absolute poses, and as long, where none has
            ever fitted.
        lost_sigmas: How much less sure its pose is then [m, m, rad].
        fitted_lately_s: What fitted within this time still speaks for a robot [s].
        claim_gain: Least weight with which a claim is fused.
        claims_refused: From so many claims in a row that do not fit, a robot is doubted ...
        claims_refused_s: ... and this time [s]: where a loop closes, filters differ for a moment.
        silence_s: A robot that claimed nothing for so long was out of contact [s].
        agree_s: After that, filters have this time to agree [s].
        max_differ: Otherwise claims differ by less than this [m] ...
        max_turn: ... and this [rad] ...
        max_offset: ... and pull by less than this [m].
        agree_within: Filters that hear each other may differ by this [m, rad].
        agree_gain: What is more shrinks by this share with each claim.
        pull_kept: Of how far claims pulled, this share counts at the next one: filters whose
            headings differ by what they may drift apart slowly and for long.
    """

    lost_after: int = 5
    refuted_after: int = 3
    lost_after_s: float = 0.4
    bumped_after: int = 2
    bump_sigmas: tuple[float, float, float] = (0.03, 0.03, math.radians(2.0))
    far: float = 10.0
    far_after: int = 2
    restart: float = 2.0
    restart_speed: float = 1.0
    contradicted_s: float = 2.0
    across: float = 0.5
    start_patience: int = 5
    lost_sigmas: tuple[float, float, float] = (1.0, 1.0, math.radians(30.0))
    fitted_lately_s: float = 2.0
    claim_gain: float = 0.05
    claims_refused: int = 3
    claims_refused_s: float = 1.0
    silence_s: float = 2.0
    agree_s: float = 3.0
    max_differ: float = 0.45
    max_turn: float = 0.15
    max_offset: float = 0.3
    agree_within: tuple[float, float] = (0.05, 0.02)
    agree_gain: float = 0.1
    pull_kept: float = 0.95


FILTER_TUNING = FilterTuning()


class TeamFilter:
    """Applies observations to a state. Its arguments are those of `Localizer`."""

    def __init__(
        self,
        robot: str,
        config: Localization,
        known: Walls | None = None,
        tuning: FilterTuning = FILTER_TUNING,
    ) -> None:
        self.robot = robot
        self.tuning = tuning
        self.gates = gates_of(config.gate)
        self.walls = WallLandmarks(known, self.gates)
        self.people = StandingLandmarks(self.gates)
        self._wheels = np.square(config.wheel_sigmas)
        self._apply: dict[type[Observation], Callable[[TeamState, Any], TeamState]] = {
            Reached: lambda state, _: state,
            Joined: self._joined,
            Left: lambda state, seen: state.without_robot(seen.robot),
            WallsSeen: self._walls_seen,
            Placed: self._placed,
            Claimed: self._claimed,
            Met: self._met,
            PeopleStand: lambda state, seen: self.people.take(state, seen),
        }

    def apply(self, state: TeamState, observation: Observation) -> TeamState:
        """The state after an observation; the same where it is of a robot that is not in it."""
        if not isinstance(observation, Joined):
            if observation.robot not in state.odometry:
                return state
            state = state.carried_on(observation.robot, observation.odometry, self._wheels)
            trust = state.trust.get(observation.robot)
            if trust is not None and trust.astray and isinstance(observation, _OF_PLACES):
                return state
        return self._apply[type(observation)](state, observation)

    def _joined(self, state: TeamState, seen: Joined) -> TeamState:
        robot, stamp_ns, astray = seen.robot, seen.odometry.stamp_ns, False
        if robot in state.odometry:
            i = state.at(robot)
            way = np.hypot(*(seen.place[:2] - state.mean[i : i + 2]))
            seconds = (stamp_ns - state.odometry[robot].stamp_ns) / 1e9
            astray = way > self.tuning.restart + self.tuning.restart_speed * max(seconds, 0.0)
            state = state.without_robot(robot)
        state = state.with_robot(robot, seen.odometry, seen.place, seen.covariance, self._wheels)
        if not astray:
            return state
        trust = Trust(lost=True, astray=True, lost_ns=stamp_ns, times_lost=1, off=float(way))
        return _with_trust(state, robot, trust)

    def _walls_seen(self, state: TeamState, seen: WallsSeen) -> TeamState:
        state, verdict = self.walls.take(state, seen)
        if verdict.off is not None:
            trust = state.trust.get(seen.robot, Trust())
            trust = changed(trust, disputed=trust.disputed + 1, off=verdict.off)
            state = _with_trust(state, seen.robot, trust)
        if verdict.fitted:
            state = self._fitted(state, seen.robot, verdict.shared)
            return self._contradicted(state, seen, verdict) if verdict.refused else state
        if verdict.refused:
            return self._refused(state, seen.robot, seen.odometry.stamp_ns)
        return state

    def _contradicted(self, state: TeamState, seen: WallsSeen, verdict: Verdict) -> TeamState:
        """Notes that some walls fitted and others did not; if for long, the robot is lost."""
        trust, stamp_ns = state.trust[seen.robot], seen.odometry.stamp_ns
        is_new = not trust.contradicted or verdict.missed_ns > trust.contradicted_ns
        since_ns = stamp_ns if is_new else trust.contradicted_ns
        count, tuning = 1 if is_new else trust.contradicted + 1, self.tuning
        if _is_long(count, since_ns, stamp_ns, tuning.lost_after, tuning.contradicted_s):
            return self._lost(state, seen.robot, stamp_ns)
        trust = changed(trust, contradicted=count, contradicted_ns=since_ns)
        return _with_trust(state, seen.robot, trust)

    def _placed(self, state: TeamState, seen: Placed) -> TeamState:
        robot, stamp_ns = seen.robot, seen.odometry.stamp_ns
        made, found = self._with_pose(state, seen)
        accepted = found.squared <= self.gates[3]
        state = noted(made if accepted else state, robot, "absolute", accepted, found, stamp_ns)
        if not accepted:
            return self._misplaced(state, robot, stamp_ns)
        return self._fitted(state, robot, True)

    def _misplaced(self, state: TeamState, robot: str, stamp_ns: int) -> TeamState:
        """An absolute pose did not fit; if none did for long, the robot is lost.

        Walls that its team has added fit wherever it is, and count nothing here; known ones do.
        Where no absolute pose has ever fitted, the start is believed for longer.
        """
        absolute, tuning = state.sources[robot, "absolute"], self.tuning
        patience = 1 if absolute.accepted else tuning.start_patience
        known_ns = state.sources.get((robot, "known walls"), Source()).stamp_ns
        is_known = known_ns > 0 and stamp_ns - known_ns < 1e9 * tuning.fitted_lately_s
        least, least_s = patience * tuning.lost_after, patience * tuning.lost_after_s
        is_long = _is_long(absolute.in_a_row, absolute.since_ns, stamp_ns, least, least_s)
        if is_known or not is_long:
            return state
        return self._lost(state, robot, stamp_ns)

    def _claimed(self, state: TeamState, claim: Claimed) -> TeamState:
        """Compares what a team-mate's filter says about its pose.

        Filters that hear each other know the same. After a silence they may not: where the claim
        is much surer, it is fused by covariance intersection. Else both know as much, but have
        drifted apart as a whole: the whole state moves towards the claim, as covariance
        intersection of equally sure estimates does, and nothing changes between robots and walls.
        At any other time they drift apart by little and slowly, and agree likewise. With known
        walls, which stay, the pose moves alone, and what is unsure with it.
        """
        robot, i, stamp_ns = claim.robot, state.at(claim.robot), claim.odometry.stamp_ns
        place, own = state.mean[i : i + 3], state.covariance[i : i + 3, i : i + 3]
        offset = wrapped(claim.place - place)
        # Whatever the correlation, the difference has no more than twice the sum.
        bound = 2.0 * (own + claim.covariance)
        squared = float(offset @ np.linalg.solve(bound, offset))
        trust = self._heard(state.trust.get(robot, Trust()), stamp_ns)
        accepted = squared <= self.gates[3] and self._believes(trust, offset, own, stamp_ns)
        state = noted(state, robot, "claim", accepted, Residual(squared, 3), stamp_ns)
        if not accepted:
            off, refused = math.hypot(offset[0], offset[1]), trust.claims_refused + 1
            since_ns = trust.claims_refused_ns if refused > 1 else stamp_ns
            trust = changed(trust, claims_refused=refused, claims_refused_ns=since_ns, off=off)
            return _with_trust(state, robot, trust)
        trust = changed(trust, claims_refused=0)
        again = self._is_in_contact_again(trust, stamp_ns)
        if trust.disputed >= self.tuning.lost_after:
            return _with_trust(state, robot, trust)
        share = share_of_claim(own, claim.covariance) if again else 0.0
        if share >= self.tuning.claim_gain:
            state = _with_trust(state, robot, trust)
            wide = changed(state, covariance=state.covariance / (1.0 - share))
            fused = changed(claim, covariance=claim.covariance / share)
            return self._with_pose(wide, fused)[0]
        if again:
            precision = np.trace(np.linalg.inv(own)), np.trace(np.linalg.inv(claim.covariance))
            step = offset * precision[1] / (precision[0] + precision[1])
        else:
            step = self.tuning.agree_gain * _beyond(offset, self.tuning.agree_within)
        pulled = math.hypot(step[0], step[1])
        kept = 1.0 if again else self.tuning.pull_kept
        trust = changed(trust, pulled=kept * trust.pulled + pulled if pulled else 0.0)
        state = _with_trust(state, robot, trust)
        if not step.any():
            return state
        return state.drawn(robot, step) if state.has_map else state.moved(place, place + step)

    def is_refused(self, trust: Trust) -> bool:
        """Whether a robot's claims have not fitted for long."""
        refused, since_ns = trust.claims_refused, trust.claims_refused_ns
        least, least_s = self.tuning.claims_refused, self.tuning.claims_refused_s
        return _is_long(refused, since_ns, trust.claimed_ns, least, least_s)

    def _heard(self, trust: Trust, stamp_ns: int) -> Trust:
        """The same at the time of a further claim."""
        silent_s = (stamp_ns - trust.claimed_ns) / 1e9
        if trust.claimed_ns and silent_s > self.tuning.silence_s:
            trust = changed(trust, contact_ns=stamp_ns, pulled=0.0)
        elif self._is_in_contact_again(trust, trust.claimed_ns) != self._is_in_contact_again(
            trust, stamp_ns
        ):
            trust = changed(trust, pulled=0.0)
        return changed(trust, claimed_ns=stamp_ns)

    def _is_in_contact_again(self, trust: Trust, stamp_ns: int) -> bool:
        """Whether a robot is heard again after a silence, and filters have time to agree."""
        contact_ns = trust.contact_ns
        return bool(contact_ns) and (stamp_ns - contact_ns) / 1e9 < self.tuning.agree_s

    def _believes(self, trust: Trust, offset: Float, own: Float, stamp_ns: int) -> bool:
        """Whether two filters may differ so much.

        Those that hear each other differ little. After a silence they may differ by as much as
        they are unsure; a claim that pulls farther than that is false. One that agrees pulls no
        more, however far those before it did.
        """
        tuning = self.tuning
        if self._is_in_contact_again(trust, stamp_ns):
            return trust.pulled < tuning.max_offset + 3.0 * math.sqrt(own[0, 0] + own[1, 1])
        near = math.hypot(offset[0], offset[1]) < tuning.max_differ
        near = near and bool(abs(offset[2]) < tuning.max_turn)
        agrees = not _beyond(offset, tuning.agree_within).any()
        return agrees or (near and trust.pulled < tuning.max_offset)

    def _with_pose(self, state: TeamState, seen: Placed) -> tuple[TeamState, Residual]:
        """The state after a measured pose, and its residual."""
        columns = state.at(seen.robot) + np.arange(3)

        def model(part: Float) -> tuple[Float, Float]:
            return wrapped(seen.place - part), np.eye(3)

        return corrected(state, columns, model, seen.covariance)

    def _met(self, state: TeamState, seen: Met) -> TeamState:
        if seen.other not in state.odometry:
            return state
        state = state.carried_on(seen.other, seen.other_odometry, self._wheels)
        columns = np.r_[state.at(seen.robot) + np.arange(3), state.at(seen.other) + np.arange(3)]
        freedom = 2 if seen.covariance[2, 2] >= YAW_UNKNOWN else 3

        def model(part: Float) -> tuple[Float, Float]:
            predicted, by_robot, by_other = pose_from(part[:3], part[3:])
            residual = wrapped(seen.place - predicted)
            return residual[:freedom], np.hstack([by_robot, by_other])[:freedom]

        covariance = seen.covariance[:freedom, :freedom]
        made, found = corrected(state, columns, model, covariance, seen.inflated)
        stamp_ns = seen.odometry.stamp_ns
        accepted = found.squared <= self.gates[freedom]
        state = made if accepted else state
        kind = "relative" if freedom == 3 else "sighting"
        for robot in (seen.robot, seen.other):
            state = noted(state, robot, kind, accepted, found, stamp_ns)
        if freedom == 2:
            return state  # what was sighted may be something else, or turned
        return self._meeting(state, seen, accepted, found)

    def _meeting(self, state: TeamState, seen: Met, fits: bool, found: Residual) -> TeamState:
        """Notes how a relative pose fitted; if it does not for long, one of the two is lost."""
        pair = min(seen.robot, seen.other), max(seen.robot, seen.other)
        stamp_ns = seen.odometry.stamp_ns
        met = state.meetings.get(pair, Source()).noted(fits, found.squared, found.freedom, stamp_ns)
        state = _with_meetings(state, pair, met)
        if fits:
            for robot in pair:
                if state.trust.get(robot, Trust()).lost:
                    state = self._fitted(state, robot, True)
            return state
        tuning, off = self.tuning, self._towards(state, seen)
        far = found.squared > tuning.far * self.gates[3]
        suspects: tuple[str, ...] = ()
        refuted_after, lost_after_s = tuning.refuted_after, tuning.lost_after_s
        if _is_long(met.in_a_row, met.since_ns, stamp_ns, refuted_after, lost_after_s):
            suspects = self._suspects(state, pair, off)
            if len(suspects) == 1 or met.in_a_row >= tuning.lost_after:
                state = _with_meetings(state, pair, met.restarted())
            else:
                suspects = ()
        elif far and (met.in_a_row >= tuning.far_after or not met.accepted):
            lately_ns = stamp_ns - round(1e9 * tuning.fitted_lately_s)
            since_ns = met.since_ns - 1 if met.accepted else lately_ns
            suspects = self._lonely(state, pair, off, since_ns)
        for robot in suspects:
            if not state.trust.get(robot, Trust()).lost:
                state = self._lost(state, robot, stamp_ns)
        lost = [robot for robot in pair if state.trust.get(robot, Trust()).lost]
        if len(lost) == 1:
            state = self._found_again(state, seen, lost[0])
        return state

    def _found_again(self, state: TeamState, seen: Met, robot: str) -> TeamState:
        """Places a lost robot by its pose relative to one that is not, whatever it was before."""
        mate = seen.other if robot == seen.robot else seen.robot
        i, of_mate = state.at(robot), state.at(mate)
        place, covariance = seen.place, seen.covariance
        if robot == seen.robot:
            place, by_place, _ = pose_from(seen.place, np.zeros(3))
            covariance = by_place @ covariance @ by_place.T
        placed, by_mate = carried_on(state.mean[of_mate : of_mate + 3], place)
        across = by_mate @ state.covariance[of_mate : of_mate + 3]
        across[:, i : i + 3] = 0.0
        own = across[:, of_mate : of_mate + 3] @ by_mate.T
        own += turned(covariance, float(state.mean[of_mate + 2]))
        state = state.replaced(robot, placed, across, own)
        return self._fitted(state, robot, True)

    def _towards(self, state: TeamState, seen: Met) -> float | None:
        """In which direction of the map a relative pose does not fit [rad]; None: it is turned."""
        i, j = state.at(seen.robot), state.at(seen.other)
        own = state.mean[i : i + 3]
        off = wrapped(seen.place - pose_from(own, state.mean[j : j + 3])[0])
        if abs(off[2]) > self.tuning.max_turn:
            return None
        return float(own[2]) + math.atan2(off[1], off[0])

    def _suspects(
        self, state: TeamState, pair: tuple[str, str], off: float | None
    ) -> tuple[str, ...]:
        """Which of two robots, whose relative pose does not fit, are lost.

        Those that fit no third robot and no map since the two do not fit; where that does not tell
        them apart, those that never did: they are new, and nothing confirms yet where they say that
        they are. Where that does not, either: both if they fitted each other before; else the
        team-mate if it is the own robot that does not fit, and of two team-mates none, until more
        is known.
        """
        for since_ns in (state.meetings[pair].since_ns - 1, 0):
            if lonely := self._lonely(state, pair, off, since_ns):
                return lonely
        if state.meetings[pair].accepted:
            return pair
        return tuple(robot for robot in pair if robot != self.robot and self.robot in pair)

    def _lonely(
        self, state: TeamState, pair: tuple[str, str], off: float | None, since_ns: int
    ) -> tuple[str, ...]:
        """The one of two robots that nothing confirmed since a time [ns]; empty: both, or none."""
        found = tuple(r for r in pair if self._confirmed_ns(state, r, pair, off) <= since_ns)
        return found if len(found) == 1 else ()

    def _confirmed_ns(
        self, state: TeamState, robot: str, pair: tuple[str, str], off: float | None
    ) -> int:
        """When a third robot or the map confirmed last where one of two is [ns]; 0: never.

        A known wall confirms nothing of what is off along it.
        """
        met = (
            value.stamp_ns
            for other, value in state.meetings.items()
            if robot in other and other != pair
        )
        absolute = state.sources.get((robot, "absolute"), Source()).stamp_ns
        bearings = state.mean[state.wall_at(0) + 1 :: 2].tolist()
        known = (
            wall.sights[robot].stamp_ns
            for wall, bearing in zip(state.walls, bearings, strict=True)
            if wall.known >= 0 and robot in wall.sights
            if off is None or abs(math.cos(bearing - off)) > self.tuning.across
        )
        return max(absolute, *met, *known, 0)

    def _fitted(self, state: TeamState, robot: str, shared: bool) -> TeamState:
        """Notes that an observation fitted; `shared`: it ties the robot to the team or the map."""
        before = state.trust.get(robot, Trust())
        if not (before.refused or before.lost or before.astray or before.disputed):
            return state
        alone = len(state.odometry) == 1
        trust = changed(
            before,
            refused=0,
            since_ns=0,
            lost=before.lost and not (shared or alone),
            astray=before.astray and not (shared or alone),
            disputed=0 if shared else before.disputed,
        )
        return _with_trust(state, robot, trust)

    def _refused(self, state: TeamState, robot: str, stamp_ns: int) -> TeamState:
        """Notes that observations did not fit, though such had done; if for long, it is lost."""
        before, tuning = state.trust.get(robot, Trust()), self.tuning
        refused = before.refused + 1
        since_ns = before.since_ns if before.refused else stamp_ns
        if _is_long(refused, since_ns, stamp_ns, tuning.lost_after, tuning.lost_after_s):
            return self._lost(state, robot, stamp_ns)
        if refused == tuning.bumped_after:
            state = state.widened(robot, tuning.bump_sigmas)
        trust = changed(before, refused=refused, since_ns=since_ns)
        return _with_trust(state, robot, trust)

    def _lost(self, state: TeamState, robot: str, stamp_ns: int) -> TeamState:
        before = state.trust.get(robot, Trust())
        trust = changed(
            before,
            refused=0,
            since_ns=0,
            contradicted=0,
            lost=True,
            lost_ns=stamp_ns,
            times_lost=before.times_lost + 1,
        )
        # Known walls did not fit because of the robot, not of the map.
        wide = changed(state.widened(robot, self.tuning.lost_sigmas), misfits={})
        absolute = wide.sources.get((robot, "absolute"))
        if absolute is not None:
            sources = {**wide.sources, (robot, "absolute"): absolute.restarted()}
            wide = changed(wide, sources=sources)
        return _with_trust(wide, robot, trust)


def _is_long(count: int, since_ns: int, now_ns: int, least: int, least_s: float) -> bool:
    """Whether there were so many in a row, at least, and over this time [s]."""
    return count >= least and (now_ns - since_ns) / 1e9 >= least_s


def _beyond(offset: Float, within: tuple[float, float]) -> Float:
    """The part of an offset of x, y [m] and yaw [rad] that is beyond these, shape (3,)."""
    away = math.hypot(offset[0], offset[1])
    x, y = max(1.0 - within[0] / away, 0.0) * offset[:2] if away else (0.0, 0.0)
    yaw = math.copysign(max(abs(offset[2]) - within[1], 0.0), offset[2])
    return np.array([x, y, yaw])


def _with_trust(state: TeamState, robot: str, trust: Trust) -> TeamState:
    return changed(state, trust={**state.trust, robot: trust})


def _with_meetings(state: TeamState, pair: tuple[str, str], meetings: Source) -> TeamState:
    return changed(state, meetings={**state.meetings, pair: meetings})


#: Of a robot that is nowhere near where it says, they would be taken for others.
_OF_PLACES = (WallsSeen, PeopleStand, Claimed)
#: At one stamp, in this order.
_ORDER = (Joined, Reached, Placed, WallsSeen, Met, PeopleStand, Claimed, Left)
_Key = tuple[int, int, str, str, int]


def _key(observation: Observation) -> _Key:
    other, other_ns = "", 0
    if isinstance(observation, Met):
        other, other_ns = observation.other, observation.other_odometry.stamp_ns
    rank = _ORDER.index(type(observation))
    return observation.odometry.stamp_ns, rank, observation.robot, other, other_ns


@dataclass
class History:
    """The last observations with the state after each.

    A late observation is put in its place and those after it are applied again, so that the state
    is that of observations in order.

    Attributes:
        filter: Applies them.
        span_ns: Observations older than the newest by more are not taken [ns].
    """

    filter: TeamFilter
    span_ns: int = 3_000_000_000
    _first: TeamState = field(default_factory=TeamState)
    _keys: list[_Key] = field(default_factory=list)
    _observations: list[Observation] = field(default_factory=list)
    _states: list[TeamState] = field(default_factory=list)  # after each; some may be missing
    _begin_ns: int = 0

    @property
    def newest(self) -> TeamState:
        """The state after all observations."""
        self._settle()
        return self._states[-1] if self._states else self._first

    def until(self, stamp_ns: int) -> TeamState:
        """The state after the observations up to a time, or the oldest that is there."""
        self._settle()
        index = bisect.bisect_right(self._keys, (stamp_ns, len(_ORDER), "", "", 0))
        return self._states[index - 1] if index else self._first

    def add(self, observation: Observation) -> bool:
        """Takes an observation; False: it is too old, or it is there already."""
        key = _key(observation)
        if key[0] < self._begin_ns:
            return False
        index = bisect.bisect_left(self._keys, key)
        if index < len(self._keys) and self._keys[index] == key:
            return False
        self._keys.insert(index, key)
        self._observations.insert(index, observation)
        del self._states[index:]
        # Rarely, and many at once: removing the first of a list moves all others.
        if self._keys[-1][0] - self._begin_ns > 1.5 * self.span_ns:
            self._forget(self._keys[-1][0] - self.span_ns)
        return True

    def _settle(self) -> None:
        """Applies what was not yet applied."""
        states = self._states
        state = states[-1] if states else self._first
        for observation in self._observations[len(states) :]:
            state = self.filter.apply(state, observation)
            states.append(state)

    def _forget(self, begin_ns: int) -> None:
        self._settle()
        index = bisect.bisect_left(self._keys, (begin_ns, -1, "", "", 0))
        if index:
            self._first = self._states[index - 1]
            del self._keys[:index], self._observations[:index], self._states[:index]
        self._begin_ns = begin_ns

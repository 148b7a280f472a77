"""Place memory in the real planner: furniture, people who stand, and people who come and go.

Scores are what the scanner gave single views, with appearance: furniture of a recorded office, and
rendered people who stand: of 68, the quarter and the twentieth who look least like people.
"""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest

from mrs_people_loc import config as cfg
from mrs_people_loc.bodies.joining import join
from mrs_people_loc.bodies.places import PlaceMemory, PlacesTuning
from mrs_people_loc.people import NOBODY, Expected
from mrs_people_loc.planner import Planner, PlannerTuning
from mrs_people_loc.scan import Scan
from mrs_people_loc.team.fusion import BodiesOnMap
from mrs_people_loc.team.poses import Pose

MS = 1_000_000
CHAIR = [0.5, 0.3, 0.3, 0.7, 0.4, 0.2, 0.0, 0.1, -0.9, -0.7, 0.3, 0.1, 0.3, 0.6, 0.2]
BLANKET = [0.2, 0.7, 0.1, 0.2, 1.5, 0.3, -0.5, 0.4, -0.5, 0.0, -0.3, -1.0, -0.4, 0.6, 1.0]
CABINET = [1.3, 1.4, 1.1, 1.6, 1.7, 1.3, 1.4]
STANDS = [5.7, 5.7, 5.5, 5.2]
HARD_TO_SEE = [3.0, 3.1, 4.2, 3.3]
HIDDEN = [-0.9, -0.7, -2.0, -1.6, 0.6, -0.1, -1.4]


@pytest.fixture
def bodies(make_cells):
    """Scans of bodies: `bodies(robot, pose, at_ns, [(x, y, score), ...])`; places on the map."""

    def scan(robot: str, pose: Pose, at_ns: int, found) -> Scan:
        x, y, score = np.array(found, dtype=np.float64).reshape(-1, 3).T
        cos, sin = math.cos(pose.yaw), math.sin(pose.yaw)
        dx, dy = x - pose.x, y - pose.y
        one = np.ones(len(x), dtype=np.float32)
        cells = dataclasses.replace(
            make_cells(np.stack([cos * dx + sin * dy, cos * dy - sin * dx], axis=1)),
            body=np.arange(1, len(x) + 1, dtype=np.uint32), score=score.astype(np.float32),
            sigma_range=0.1 * one, sigma_across=0.05 * one,
        )  # fmt: skip
        return Scan(robot, at_ns, cells)

    return scan


@pytest.fixture
def watch(bodies):
    """Runs a planner: `watch(ways, seconds)`, each way a function of time to (x, y, scores).

    A robot that moves drives to and fro by 1 m at 0.25 m/s, and turns meanwhile.
    """

    def run(ways, seconds, *, moves=False, planner=None, start_s=0.0, robots=("a",), step_s=0.1):
        rng = np.random.default_rng(0)
        planner = planner or Planner(cfg.PlannerConfig())
        out = []
        for k in range(round(seconds / step_s)):
            t = start_s + step_s * k
            poses, scans = {}, []
            for number, robot in enumerate(robots):
                x = abs((0.25 * t + 1.0) % 2.0 - 1.0) if moves else 0.0
                poses[robot] = Pose(0, x, -float(number), 0.3 * math.sin(t) if moves else 0.0)
                found = []
                for way in ways:
                    if (here := way(t)) is not None:
                        x, y, scores = here
                        found.append((*rng.normal((x, y), 0.05), scores[k % len(scores)]))
                scans.append(bodies(robot, poses[robot], round(t * 1e9), found))
            out.append(planner.step(scans, poses, round(t * 1e9)))
        return out

    return run


def still(x, y, scores):
    return lambda _: (x, y, scores)


def seen_near(people, x, y) -> bool:
    return any(np.hypot(*(p.position - (x, y))) < 0.4 for p in people.everybody)


def share_seen(out, x, y) -> float:
    return float(np.mean([seen_near(people, x, y) for people in out]))


moving = pytest.mark.parametrize("moves", [False, True], ids=["still", "moving"])


# -------------------------------------------------------------------------- furniture ----


@pytest.mark.slow
@moving
def test_furniture_that_stands_doubtful_for_a_minute_is_nobody(watch, moves):
    """Also where a room makes it look more like a person, by half a unit of log-odds."""
    doubtful = {(2.6, 0.7): CHAIR, (2.6, -0.7): BLANKET}
    more = {(x + 1.5, y): [score + 0.5 for score in of] for (x, y), of in doubtful.items()}
    out = watch([still(*at, scores) for at, scores in (doubtful | more).items()], 60, moves=moves)
    assert [share_seen(out, *at) for at in doubtful] == [0.0, 0.0]
    assert max(share_seen(out, *at) for at in more) <= 0.05
    assert not any(people.everybody for people in out[50:])


def test_what_is_taken_for_a_person_at_first_loses_its_track(watch):
    """Two high looks start a track; the mean of three is that of furniture."""
    scores = [1.4, 1.3, *CHAIR * 10]
    out = watch([still(2.6, 0.7, scores)], 12)
    assert any(people.everybody for people in out[:5])
    assert not any(people.everybody for people in out[50:])
    without = cfg.PlannerConfig.from_mapping({"tracking.static_score": 0.0})
    out = watch([still(2.6, 0.7, scores)], 12, planner=Planner(without))
    assert any(people.everybody for people in out[50:])


@moving
def test_what_never_moves_and_never_looks_like_a_person_beyond_doubt_is_nobody(watch, moves):
    """A cabinet that always looks like somebody, and is followed and therefore expected."""
    out = watch([still(3.0, 0.5, CABINET)], 40, moves=moves)
    assert any(people.everybody for people in out[:40])
    assert not any(people.everybody for people in out[250:])


# ---------------------------------------------------------------------- people who stand ----


@pytest.mark.slow
@moving
def test_people_who_stand_for_ten_minutes_stay(watch, moves):
    """The usual one and one who is hard to see, each 2 m from the other."""
    out = watch(
        [still(3.0, 0.0, STANDS), still(3.0, 2.0, HARD_TO_SEE)], 600, moves=moves, step_s=0.5
    )
    assert share_seen(out, 3.0, 0.0) > 0.995
    assert share_seen(out, 3.0, 2.0) > 0.995
    assert len({person.id for people in out for person in people.everybody}) == 2


@pytest.mark.slow
def test_person_who_looked_like_one_stays_when_they_look_doubtful(watch):
    """Ten seconds from the front, then nine minutes behind somebody or something."""
    way = lambda t: (3.0, 0.0, STANDS if t < 10 else CHAIR)  # noqa: E731
    out = watch([way], 600, step_s=0.3)
    assert share_seen(out, 3.0, 0.0) > 0.98


@pytest.mark.slow
def test_person_who_walks_up_stays_though_they_look_doubtful_there(watch):
    def way(t):
        return (4.0, max(0.0, 2.0 - 0.8 * t), STANDS if t < 1.5 else CHAIR)

    planner = Planner(cfg.PlannerConfig())
    out = watch([way], 60, planner=planner)
    assert share_seen(out[30:], 4.0, 0.0) > 0.98
    # Their exemption is the place's, while they are hidden and have no track.
    gone = watch([still(8.0, 3.0, CHAIR)], 15, planner=planner, start_s=60.0)
    assert not seen_near(gone[-1], 4.0, 0.0)
    back = watch([still(4.0, 0.0, [1.2])], 3, planner=planner, start_s=75.0)
    assert seen_near(back[-1], 4.0, 0.0)


@pytest.mark.slow
def test_stranger_at_a_place_of_furniture_is_as_doubtful_as_the_furniture(watch):
    """The same looks as in the test before, where nobody had come."""
    planner = Planner(cfg.PlannerConfig())
    watch([still(4.0, 0.0, CHAIR)], 60, planner=planner)
    out = watch([still(4.0, 0.0, [1.2])], 3, planner=planner, start_s=60.0)
    assert not any(people.everybody for people in out)


@pytest.mark.slow
@pytest.mark.parametrize("gap", [0.1, 0.5])
def test_person_who_walks_up_and_stops_in_front_of_furniture(watch, gap):
    """They are seen while they are there, and the furniture is nobody afterwards."""
    visit = (20.0, 40.0)

    def person(t):
        if not visit[0] <= t < visit[1] + 2.5:
            return None
        y = 2.0 - 0.8 * (t - visit[0]) if t < visit[0] + 2.5 else 0.8 * (t - visit[1])
        return (3.0 - gap, max(0.0, y), STANDS)

    # What is so close behind a person is hidden by them.
    chair = lambda t: None if gap < 0.3 and person(t) else (3.0, 0.0, CHAIR)  # noqa: E731
    out = watch([chair, person], 70)
    assert share_seen(out[230:400], 3.0 - gap, 0.0) > 0.98
    assert not any(people.everybody for people in out[450:])
    assert not any(people.everybody for people in out[20:200])


@pytest.mark.slow
@moving
def test_person_at_a_place_where_furniture_was_is_found(watch, moves):
    """They come into view there: nobody saw them walk up."""
    planner = Planner(cfg.PlannerConfig())
    watch([still(3.0, 0.0, CHAIR)], 60, planner=planner, moves=moves)
    out = watch([still(3.0, 0.0, STANDS)], 20, planner=planner, moves=moves, start_s=60.0)
    assert share_seen(out[10:], 3.0, 0.0) == 1.0


@pytest.mark.slow
@moving
def test_walking_person_loses_nothing(watch, moves):
    """To and fro at 0.5 m/s, doubtful for seconds at a time."""

    def way(t):
        away = abs((0.5 * t + 3.0) % 6.0 - 3.0)
        return (3.5, away - 1.5, STANDS if t % 8 < 5 else CHAIR)

    out = watch([way], 60, moves=moves)
    without = Planner(cfg.PlannerConfig.from_mapping({"tracking.static_score": 0.0}))
    same = watch([way], 60, moves=moves, planner=without)
    count = [sum(len(people.everybody) for people in each) for each in (out, same)]
    assert count[0] >= 0.99 * count[1] > 500


def test_two_robots_that_doubt_do_not_make_a_look_sure(watch):
    """Log-odds of robots add up, but the best look at a place is that of a single one."""
    lone = watch([still(3.0, 0.5, [0.7])], 20)
    both = watch([still(3.0, 0.5, [0.7])], 20, robots=("a", "b", "c"))
    assert not any(people.everybody for people in lone[50:])
    assert not any(people.everybody for people in both[50:])


# ----------------------------------------------------------------------------- the memory ----


def taken(memory, places, t, expected=NOBODY, most=50.0):
    """Log-odds that bodies lose at a time [s]; places are (x, y, score)."""
    x, y, score = np.array(places, dtype=np.float64).reshape(-1, 3).T
    count = len(x)
    on_map = BodiesOnMap(
        np.arange(count), np.zeros(count, dtype=np.intp), np.stack([x, y], axis=1),
        np.tile(0.01 * np.eye(2), (count, 1, 1)), score,
    )  # fmt: skip
    joined = join(on_map, np.ones(count, dtype=bool), cfg.Joining())
    return memory.step(joined, on_map, expected, round(t * 1e9), most)


def guest(number, x, y, *, travelled):
    return Expected(
        np.array([(x, y)]), 0.01 * np.eye(2)[np.newaxis], np.array([number]), np.array([travelled])
    )


def after(memory, seconds, score=0.0, start=0.0, **more):
    """What the last body loses that stands for so long, seen every 0.1 s."""
    lost = [
        taken(memory, [(2.0, 0.0, score)], start + 0.1 * k, **more)
        for k in range(round(10 * seconds) + 1)
    ]
    return float(lost[-1][0])


@pytest.mark.parametrize(("seconds", "lost"), [(0.0, 0.0), (0.5, 1.7329), (9.5, 7.4893)])
def test_log_odds_grow_with_the_logarithm_of_time(seconds, lost):
    """2.5 ln(1 + T / 0.5 s), of what never looked like a person at all."""
    assert after(PlaceMemory(), seconds) == pytest.approx(lost, abs=1e-4)


def test_no_more_is_lost_than_the_parameter_allows():
    assert after(PlaceMemory(), 100.0, most=3.0) == 3.0
    assert after(PlaceMemory(), 10.0, most=0.0) == 0.0


@pytest.mark.parametrize(("score", "share"), [(-3.0, 1.0), (0.0, 1.0), (0.75, 0.5), (1.5, 0.0)])
def test_less_is_lost_where_the_best_look_was_better(score, share):
    assert after(PlaceMemory(), 5.0, score=score) == pytest.approx(share * 5.9947, abs=1e-4)


@pytest.mark.parametrize(("seconds", "share"), [(5.0, 0.0), (12.5, 0.25), (20.0, 0.5), (40.0, 0.5)])
def test_what_never_moves_must_look_like_a_person_beyond_doubt(seconds, share):
    whole = after(PlaceMemory(), seconds)
    assert after(PlaceMemory(), seconds, score=2.0) == pytest.approx(share * whole)
    assert after(PlaceMemory(), seconds, score=4.0) == 0.0
    came = guest(7, 2.0, 0.0, travelled=True)
    assert after(PlaceMemory(), seconds, score=2.0, expected=came) == 0.0


def test_what_is_seen_later_need_not_look_better():
    memory = PlaceMemory()
    for k in range(21):
        taken(memory, [(9.0, 9.0, 0.0)], 0.1 * k)
    assert after(memory, 20.0, score=2.0, start=2.1) == 0.0
    memory.reset()
    assert after(memory, 20.0, score=2.0) > 4.0


def test_one_lucky_look_is_not_beyond_doubt():
    memory = PlaceMemory()
    after(memory, 20.0, score=2.0)
    for k, (score, sure) in enumerate([(13.0, False), (2.0, False), (13.0, True)]):
        assert (float(taken(memory, [(2.0, 0.0, score)], 20.1 + 0.1 * k)[0]) == 0.0) == sure


def test_one_lucky_look_does_not_decide():
    memory = PlaceMemory()
    after(memory, 4.8)
    assert float(taken(memory, [(2.0, 0.0, 8.0)], 4.9)[0]) == 0.0  # itself, it loses nothing
    # It counts as 2.25, of a mean of three: half of a sure one.
    assert after(memory, 4.4, start=5.0) == pytest.approx(0.5 * 7.45, abs=0.05)


def test_place_is_forgotten_after_thirty_seconds():
    for pause, forgotten in ((29.0, False), (31.0, True)):
        memory = PlaceMemory()
        after(memory, 10.0)
        lost = float(taken(memory, [(2.0, 0.0, 0.0)], 10.0 + pause)[0])
        assert (lost == 0.0) == forgotten


def test_pause_counts_half_a_second():
    memory = PlaceMemory()
    after(memory, 9.0)
    lost = float(taken(memory, [(2.0, 0.0, 0.0)], 20.0)[0])
    assert lost == pytest.approx(2.5 * math.log1p(9.5 / 0.5))


def test_time_that_stands_still_or_is_a_little_late_ages_nothing():
    memory = PlaceMemory()
    before = after(memory, 5.0)
    for t in (5.0, 4.8, 4.1, 5.0):
        assert float(taken(memory, [(2.0, 0.0, 0.0)], t)[0]) == pytest.approx(before)
    assert float(taken(memory, [(2.0, 0.0, 0.0)], 5.1)[0]) > before


def test_time_that_jumps_back_begins_anew():
    memory = PlaceMemory()
    after(memory, 10.0)
    assert float(taken(memory, [(2.0, 0.0, 0.0)], 3.0)[0]) == 0.0
    assert len(memory) == 1


def test_planner_that_begins_anew_forgets_places(watch):
    planner = Planner(cfg.PlannerConfig())
    watch([still(2.6, 0.7, CHAIR)], 5, planner=planner)
    assert len(planner.places) == 1
    planner.reset()
    assert len(planner.places) == 0


def test_memory_is_off_where_intervals_are_independent(watch):
    planner = Planner(cfg.PlannerConfig().memoryless())
    watch([still(2.6, 0.7, CHAIR)], 5, planner=planner)
    assert len(planner.places) == 0


def test_time_of_those_who_came_does_not_count():
    came, born = (guest(7, 2.0, 0.0, travelled=far) for far in (True, False))
    assert after(PlaceMemory(), 20.0, expected=came) == 0.0
    assert after(PlaceMemory(), 20.0, expected=born) > 7.0


def test_looks_of_a_followed_person_leave_with_them():
    memory = PlaceMemory()
    after(memory, 10.0)
    here, away = (guest(7, x, 0.0, travelled=True) for x in (2.0, 3.0))
    assert after(memory, 3.0, score=3.0, start=10.1, expected=here) == 0.0
    # Where the track ends, the person may still be there.
    assert after(memory, 1.0, start=13.2) == 0.0
    assert after(memory, 1.0, start=14.3, expected=away) > 7.0


def test_who_walks_past_takes_the_place_of_nobody_who_stands_there():
    memory = PlaceMemory()
    stands = guest(7, 2.0, 0.0, travelled=False)
    after(memory, 3.0, score=4.0, expected=stands)
    for k in range(12):
        passing = guest(8, 2.1, -0.6 + 0.1 * k, travelled=True)
        taken(memory, [(2.0, 0.0, 0.0)], 3.1 + 0.1 * k, Expected.joined([stands, passing]))
    assert after(memory, 20.0, start=4.4, expected=stands) == 0.0


def test_many_places_are_bounded_and_the_latest_are_kept():
    memory = PlaceMemory(PlacesTuning(max_places=50))
    for k in range(20):
        taken(memory, [(2.0, y, 0.0) for y in np.arange(20.0)], 0.1 * k)
    many = [(5.0 + x, y, 0.0) for x in range(10) for y in range(10)]
    taken(memory, many, 2.0)
    assert len(memory) == 50
    lost = taken(memory, [(2.0, 1.0, 0.0)], 2.1)
    assert float(lost[0]) == 0.0


def test_nothing_is_seen_and_nothing_lost():
    memory = PlaceMemory()
    assert taken(memory, [], 0.0).shape == (0,)
    after(memory, 1.0)
    assert taken(memory, [], 1.1, guest(1, 2.0, 0.0, travelled=True)).shape == (0,)


def test_constants_of_places_reach_them():
    tuning = PlannerTuning(places=PlacesTuning(gain=1.0))
    assert Planner(cfg.PlannerConfig(), tuning).places.tuning is tuning.places

"""Which sonars are dead, by their readings."""

import math

import pytest

from mrs_people_loc.health.sonars import SameReading, SonarWatch
from mrs_people_loc.localization.walls.ranges import SonarRange

S = 1_000_000_000
LEFT, RIGHT = "/robot_a/sonar/left", "/robot_a/sonar/right"


def reading(stamp_ns, value):
    return SonarRange(stamp_ns, "sonar", 0.4, 0.1, 4.0, value)


def watched(readings, speed=0.2, seconds=30, period=0.5):
    """A watch after a drive, with one reading after the other, over and over again."""
    watch = SonarWatch()
    for k in range(round(seconds / period) + 1):
        value = readings[k % len(readings)]
        watch.take(LEFT, reading(S + round(k * period * S), value), speed * k * period)
    return watch


@pytest.mark.parametrize(
    "readings", [[math.inf], [math.nan], [4.0], [5.0], [0.0], [math.inf, math.nan, 4.0, 0.0]]
)
def test_sonar_without_any_echo_is_dead(readings):
    assert watched(readings).dead() == {LEFT: SameReading(None, 30.0, pytest.approx(6.0))}


def test_sonar_that_says_the_same_is_dead():
    assert watched([1.5]).dead() == {LEFT: SameReading(1.5, 30.0, pytest.approx(6.0))}
    assert watched([1.5, 1.5, 1.501]).dead() == {}


def test_robot_that_stands_or_has_just_begun_tells_nothing():
    assert watched([math.inf], speed=0.09).dead() == {}
    assert watched([math.inf], seconds=19.5).dead() == {}
    assert watched([math.inf], seconds=20).dead()


def test_dead_sonar_that_measures_again_lives():
    watch = watched([math.inf])
    watch.take(RIGHT, reading(32 * S, 1.0), 6.1)
    assert set(watch.dead()) == {LEFT}
    watch.take(LEFT, reading(32 * S, 1.0), 6.1)
    assert watch.dead() == {}


def test_it_begins_again_with_the_clock_or_the_way():
    for stamp_ns, way in ((S // 2, 6.0), (40 * S, -1.0)):
        watch = watched([math.inf])
        watch.take(LEFT, reading(stamp_ns, math.inf), way)
        assert watch.dead() == {}

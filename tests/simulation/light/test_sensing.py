import dataclasses
import math

import numpy as np
import pytest

from mrs_people_sim.light.sensing import HEAD, Eyes

SURE = dataclasses.replace(HEAD, missed=0.0, found=((0.0,), (1.0,)))
NOBODY = np.empty((0, 2))
NOTHING = np.empty((0, 2, 2))


def eyes(head=SURE, **options):
    return Eyes(np.random.default_rng(1), head=head, **options)


def seen(people, *, pose=(0.0, 0.0, 0.0), robots=NOBODY, solid=NOTHING, **options):
    view = eyes(**options).people(np.array(pose), np.array(people), robots, solid, 0.2)
    return view.person.tolist(), view.xy


@pytest.mark.parametrize(("looks_back", "who"), [(False, [0]), (True, [1])])
def test_a_head_sees_who_is_before_it_in_base_link(looks_back, who):
    # The robot at (1, 1) drives along y: one is 2 m ahead of it, one 2 m behind.
    found, xy = seen(
        [[1.0, 3.0], [1.0, -1.0]], pose=(1.0, 1.0, 0.5 * math.pi), looks_back=looks_back
    )
    assert found == who
    assert xy[0] == pytest.approx([-2.0 if looks_back else 2.0, 0.0], abs=0.3)


def test_people_walls_and_robots_hide_people():
    people = [[2.0, 0.0], [4.0, 0.1], [3.0, 1.5]]
    assert seen(people)[0] == [0, 2]  # the second is behind the first
    wall = np.array([[[1.0, 0.2], [1.0, 3.0]]])
    assert seen(people, solid=wall)[0] == [0]
    assert seen(people, robots=np.array([[1.0, 0.0]]))[0] == [2]
    assert seen(people, robots=np.array([[-1.0, 0.0], [5.0, 0.0]]))[0] == [0, 2]


def test_errors_last_for_seconds_and_are_as_large_as_stated():
    one, place = eyes(), np.array([[3.0, 0.0]])
    errors = []
    for _ in range(3000):
        view = one.people(np.zeros(3), place, NOBODY, NOTHING, 0.2)
        errors.append((view.xy[0, 0] - 3.0) / view.along[0])
    off = np.array(errors)
    assert off.std() == pytest.approx(1.0, abs=0.15)
    share, lasts = HEAD.lasting
    assert (off[1:] * off[:-1]).mean() == pytest.approx(share * math.exp(-0.2 / lasts), abs=0.12)


def test_walls_are_seen_where_they_are_by_a_head_that_looks_back():
    wall = np.array([[[2.0, -3.0], [2.0, 3.0]]])
    one = eyes(looks_back=True).walls(wall, np.array([0.0, 0.0, math.pi]), NOBODY)
    assert one.distance == pytest.approx([2.0], abs=0.1)
    # base_link points to -x: the wall is behind it.
    assert np.cos(one.bearing) == pytest.approx([-1.0], abs=0.01)
    assert not len(eyes().walls(wall, np.array([0.0, 0.0, math.pi]), NOBODY))

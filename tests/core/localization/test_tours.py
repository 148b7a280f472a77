"""Tours of more than 100 m, repeated: errors, and whether the stated covariances are true.

Three robots with ordinary drift, each with its own estimate, a fifth of the messages lost. Sensors
are slow here, so that it takes seconds.
"""

import numpy as np
import pytest
from scipy.stats import chi2

from core.localization.tours import START, Tour, as_walls, hall, l_corridor, straight_corridor
from mrs_people_loc.config import Localization

pytestmark = pytest.mark.slow

RUNS = 8
SLOW = {"rate": 8.0, "speed": 1.6, "walls_every": 4, "met_every": 8}
#: What the wheels may be wrong by is not told; scale 3 %, -1 %, 1.5 %, 1.5, -2 and 1 mrad a metre.
UNKNOWN_WHEELS = Localization(start_sigmas=START)
WHEELS = ((0.03, 1.5e-3, 0.0), (-0.01, -2e-3, 0.0), (0.015, 1e-3, 0.0))


def records(world, runs=RUNS, **settings):
    return [Tour(world, seed=seed, **{**SLOW, **settings}).run() for seed in range(runs)]


def distances(relative):
    return np.hypot(relative[..., 0], relative[..., 1])


def nees_inside(made):
    """Share of times at which the mean over runs is within its 95 % bounds, and above them."""
    mean = np.mean([record.nees() for record in made], axis=0)
    low, high = chi2.ppf([0.025, 0.975], 3 * len(made)) / len(made)
    return np.mean((mean > low) & (mean < high)), np.mean(mean > high)


@pytest.fixture(scope="module")
def in_l_corridor():
    return records(l_corridor())


@pytest.fixture(scope="module")
def in_hall():
    return records(hall(), walls_every=0)


def test_tours_are_long():
    assert min(world.length for world in (l_corridor(), straight_corridor(), hall())) > 100


@pytest.mark.parametrize("where", ["in_l_corridor", "in_hall"])
def test_covariances_are_true(where, request):
    inside, above = nees_inside(request.getfixturevalue(where))
    assert inside > 0.9
    assert above < 0.06


@pytest.mark.parametrize(("where", "limit"), [("in_l_corridor", 0.06), ("in_hall", 0.08)])
def test_robots_know_where_they_are_to_each_other(where, limit, request):
    made = request.getfixturevalue(where)
    found = np.median(distances(np.array([record.relative() for record in made])))
    drifted = np.median([distances(record.relative(record.odometry)) for record in made])
    assert found < limit
    assert found < 0.1 * drifted


def test_known_walls_hold_the_robots_in_the_map():
    world = l_corridor()
    known = as_walls(world.walls, (0.005, 0.0005))
    for record in records(world, 2, known=known):
        errors = np.hypot(record.errors()[..., 0], record.errors()[..., 1])
        assert np.median(np.abs(record.across())) < 0.03
        # The wall at the end of each leg tells the way along it.
        assert errors[-1].max() < 0.1


def test_one_corridor_does_not_tell_the_way_along_it():
    world = straight_corridor()
    known = as_walls(world.walls, (0.005, 0.0005))
    made = records(world, 4, known=known, met_every=0)
    sigmas = np.sqrt([record.covariance[..., 0, 0] for record in made])  # the corridor is along x
    along = np.array([record.along() for record in made])
    across = np.array([record.across() for record in made])
    assert np.median(np.abs(across)) < 0.03
    assert np.mean(np.abs(along) < 3 * sigmas) > 0.95
    # It grows as that of the odometry: 2 cm per root metre, and the start's 2 cm.
    way = np.hypot(0.02 * np.sqrt(world.length - 1), 0.02)
    np.testing.assert_allclose(sigmas[:, -1], way, rtol=0.1)


# ----------------------------------------------------------------------------------------- odometry


def trust_of(robots):
    """What each robot's filter says about each of them."""
    return [one for robot in robots for one in robot.localizer.state.trust.values()]


@pytest.mark.parametrize(
    ("world", "runs", "settings"),
    [
        (l_corridor(leg=45), RUNS, SLOW),
        # Filters that hear each other less often in a turn drift apart as a whole.
        (hall(), 3, {"rate": 16.0, "speed": 1.2, "walls_every": 0, "met_every": 16}),
    ],
    ids=["corridor", "hall"],
)
def test_systematic_errors_of_wheels_are_found_on_the_way(world, runs, settings):
    clean = records(world, 3, config=UNKNOWN_WHEELS, **settings)
    given = {**settings, "config": UNKNOWN_WHEELS, "wheels": WHEELS}
    tours = [Tour(world, seed=seed, **given) for seed in range(runs)]
    made = [tour.run() for tour in tours]
    for tour in tours:
        assert not any(trust.times_lost for trust in trust_of(tour.team))
        assert not any(robot.localizer.state.doubted for robot in tour.team)
        state = tour.team[0].localizer._history.newest
        for robot in tour.team:
            own = state.wheels_at(robot.name) + np.arange(3)
            sigmas = np.sqrt(np.diag(state.covariance)[own])
            assert (np.abs(state.mean[own] - robot.wheels) < 3.0 * sigmas).all()
            # They know more than at the start.
            assert (sigmas < 0.7 * np.array(UNKNOWN_WHEELS.wheel_sigmas)).all()
    begin = round(20.0 / settings["speed"] * settings["rate"])
    errors = [distances(np.array([r.relative()[begin:] for r in one])) for one in (clean, made)]
    for share in (50, 95):
        least, found = (np.percentile(one, share) for one in errors)
        assert found < 1.5 * least
    inside, above = nees_inside(made)
    assert inside > 0.9
    assert above < 0.06


@pytest.mark.parametrize(("noise", "least", "most"), [(1.0, 1.0, 2.0), (5.0, 5.0, 50.0)])
def test_noise_of_odometry_is_found_by_what_does_not_fit(noise, least, most):
    """Five times as much noise as the model says: 25 times its variance."""
    world = l_corridor(leg=30)
    known = as_walls(world.walls, (0.005, 0.0005))
    found, nees = [], []

    def on_step(step, robots):
        found[-1].append(max([1.0, *(trust.noise for trust in trust_of(robots))]))

    for seed in range(2):
        found.append([])
        tour = Tour(world, seed=seed, noise=noise, known=known, on_step=on_step, **SLOW)
        nees.append(tour.run().nees())
    highest = np.max(found, axis=1)
    assert least <= highest.min()
    assert highest.max() < most
    # Of five times the noise, without this: more than 100.
    last = np.array(nees)[:, -len(nees[0]) // 3 :]
    assert np.median(last) < (5.0 if noise == 1.0 else 30.0)

"""A wrong output of any stage of either method is noticed, at that stage."""

import dataclasses
import functools
import pickle

import numpy as np
import pytest

pytest.importorskip("rosbags", reason="reading bags needs rosbags")

from mrs_people_loc import planner as planner_module
from mrs_people_loc.bodies import (
    appearance,
    finder,
    model,
    network,
    patches,
    places,
    scanner,
    search,
    votes,
)
from mrs_people_loc.bodies import detector as body_detector
from mrs_people_loc.cells import detector as cell_detector
from mrs_people_loc.cells import filters
from mrs_people_loc.config import PlannerConfig
from mrs_people_loc.planner import Planner
from mrs_people_loc.robot import RobotPipeline
from mrs_people_loc.sensing import camera, cloud, disparity
from mrs_people_loc.team import fusion, masking
from mrs_studies.bench.differs import DiffersError
from mrs_studies.bench.scenes import INTERVAL_NS, drawn_scans
from mrs_studies.bench.tracking import found_people
from mrs_tools.bags.offline import BagRun
from oracle import comparison
from oracle.cells import cells_of
from oracle.comparison import check_cells, check_people, check_places, check_tracks, check_view
from oracle.scenes import BAG, BODIES, CELLS, PAPER, furnished_room, mixed_team, random_cloud

F32 = np.float32


def change(**more):
    """Adds to fields of what a function gives."""

    def changed(right):
        def wrong(*args, **kwargs):
            result = right(*args, **kwargs)
            values = {
                name: (getattr(result, name) + value).astype(getattr(result, name).dtype)
                for name, value in more.items()
            }
            return dataclasses.replace(result, **values)

        return wrong

    return changed


def then(function):
    """Does something to what a function gives."""
    return lambda right: lambda *args, **kwargs: function(right(*args, **kwargs))


def instead(function):
    """Another function in its place."""
    return lambda right: function


def remembered(function):
    """The same, and computed once for each input."""
    known = {}

    @functools.wraps(function)
    def of(*args, **kwargs):
        key = pickle.dumps((args, kwargs))
        if key not in known:
            known[key] = pickle.dumps(function(*args, **kwargs))
        return pickle.loads(known[key])

    return of


@pytest.fixture(scope="module", autouse=True)
def _oracle_computes_once():
    """Most inputs of the oracle are those of another mutation; nothing of the core is in it."""
    names = [
        *("disparity_of", "cloud_of", "histogram_of", "extents_of", "centred", "patch_at"),
        *("vote_of", "evidence_of", "bodies_of", "lost_by"),
    ]
    with pytest.MonkeyPatch.context() as patch:
        for name in names:
            patch.setattr(comparison, name, remembered(getattr(comparison, name)))
        yield


# -------------------------------------------------------------------------------------- one view


@pytest.fixture(scope="module")
def recorded():
    """A view of the paper's formation: images, camera and the team's name for it."""
    run = BagRun(BAG, [PAPER])
    return next(iter(next(run.intervals()).views.values()))


def check_made(view, config):
    pipeline = RobotPipeline(view.robot, view.camera, config)
    check_view(view.images, pipeline.stages(view.images), view.camera, config)


def one_pixel_more(values):
    values = values.copy()
    values[60, 80] = np.nan_to_num(values[60, 80]) + 1 / 16
    return values


def aside(right):
    return lambda self, seen, bearing, inverse: self(seen, bearing + 0.02, inverse)


def turned(right):
    def wrong(mounting):
        axes, lens = right(mounting)
        return axes, lens + (0.0, 0.0, 0.001)

    return wrong


def all_but_one(inside):
    inside = inside.copy()
    inside[:, inside.shape[1] // 2] = False  # of all three windows
    return inside


OF_BOTH = {
    "disparity": (disparity.StereoMatcher, "__call__", then(one_pixel_more), "disparity"),
    "cloud": (cloud.CloudMaker, "__call__", then(lambda points: points + F32(0.001)), "cloud"),
    "mounting": (camera, "robot_from_optical", turned, "cloud"),
}
OF_CELLS = {
    "zones": (filters, "discriminate_zones", then(lambda points: points[1:]), "zones"),
    "zone limits": (
        filters, "discriminate_zones",
        lambda right: lambda points, *, low, high: right(points, low=low, high=high - 0.01),
        "zones",
    ),
    "noise": (filters, "reduce_noise", then(lambda points: points[1:]), "noise"),
    "noise windows": (
        filters, "reduce_noise",
        lambda right: lambda points, *, window, min_points: right(
            points, window=window, min_points=min_points + 1
        ), "noise",
    ),
    "cells": (filters, "quantize", change(x=0.01), r"cells\.x"),
    "counts": (filters, "quantize", change(count=1), r"cells\.count"),
    "tops": (filters, "measure_tops", then(lambda top: top + F32(0.001)), r"cells\.top"),
}  # fmt: skip
OF_BODIES = {
    "cropped": (scanner, "discriminate_zones", then(lambda points: points[1:]), "cropped"),
    "histogram": (search.BodySearch, "histogram", then(lambda h: h * 1.001), "histogram"),
    "candidates": (
        search.BodySearch, "__call__", then(lambda found: found.select(slice(1, None))),
        "best candidate",
    ),
    "no candidates": (
        search.BodySearch, "__call__", then(lambda found: found.select(slice(-1))), "missed",
    ),
    "extents": (search.BodySearch, "__call__", change(extent=0.001), "extent of candidate"),
    "centring": (patches.PatchSampler, "centred", aside, r"patches\.bearing"),
    **{
        f"patches, {name}": (
            patches.PatchSampler, "__call__", change(**{name: 0.005}), rf"patches\.({name}|bearing)"
        )
        for name in ("u", "v", "expected", "difference", "tolerance")
    },
    "patches, inside": (
        patches.PatchSampler, "__call__",
        then(lambda p: dataclasses.replace(p, inside=~p.inside)), r"patches\.inside",
    ),
    "vote": (votes, "vote", change(shift=0.03), r"vote\.shift"),
    "sigma of votes": (
        votes, "vote", then(lambda v: dataclasses.replace(v, sigma=v.sigma * 1.2)), r"vote\.sigma",
    ),
    "contrast": (votes, "vote", change(contrast=0.2), r"vote\.contrast"),
    "even evidence": (finder, "gather_evidence", change(even=1e-3), r"evidence\.even"),
    "odd evidence": (finder, "gather_evidence", change(odd=1e-3), r"evidence\.odd"),
    "depth evidence": (finder, "gather_evidence", change(depth=1e-3), r"evidence\.depth"),
    "human test": (model.Layered, "__call__", then(lambda score: score + 0.1), r"bodies"),
    "appearance": (
        appearance.Scores, "combined", then(lambda score: score + 0.01), r"bodies",
    ),
    "network": (network.PersonNetwork, "__call__", then(lambda score: score + 0.05), r"bodies"),
    "features": (network.PersonNetwork, "features", then(lambda seen: seen * F32(0.9)), r"bodies"),
    "rows of windows": (
        network, "WINDOW_HEIGHTS", instead(network.WINDOW_HEIGHTS + F32(0.05)), r"bodies",
    ),
    "columns of windows": (
        network, "WINDOW_ACROSS", instead(-network.WINDOW_ACROSS), r"bodies",
    ),
    "size of windows": (network, "MIDDLE_SIZE", instead(30.0), r"bodies"),
    "contrast of the image": (network, "_LEAST_CONTRAST", instead(F32(5.0)), r"bodies"),
    "around": (network, "_AROUND", instead((9, 9)), r"bodies"),
    "axis": (model.Linear, "__call__", then(lambda place: place + 1e-3), r"bodies\.(x|y)"),
    "selection": (finder.BodyFinder, "_alone", then(lambda kept: kept[:-1]), "number of bodies"),
    "all selected": (
        finder.BodyFinder, "_alone",
        instead(lambda self, bodies: np.argsort(-bodies.score, kind="stable")), "number of bodies",
    ),
    "tops": (finder, "_tops", then(lambda top: top + 0.075), r"bodies\.top"),
    "points": (scanner, "points_of", then(lambda points: points + F32(0.001)), "foreground"),
    **{
        f"cells, {name}": (scanner, "cells_of", change(**{name: by}), rf"cells\.{name}")
        for name, by in {
            "x": 0.001, "y": 0.001, "z": 0.01, "z_min": 0.01, "top": 0.01, "count": 1, "body": 1,
            "score": 0.01, "sigma_range": 0.001, "sigma_across": 0.001,
        }.items()
    },
}  # fmt: skip


def mutations(cases):
    return pytest.mark.parametrize(
        ("module", "name", "wrong", "what"), cases.values(), ids=cases.keys()
    )


@mutations(OF_BOTH | OF_CELLS)
def test_wrong_stage_of_the_papers_method_is_detected(
    recorded, monkeypatch, module, name, wrong, what
):
    monkeypatch.setattr(module, name, wrong(getattr(module, name)))
    with pytest.raises(DiffersError, match=what):
        check_made(recorded, CELLS)


@mutations(OF_BOTH | OF_BODIES)
def test_wrong_stage_of_the_default_method_is_detected(
    recorded, monkeypatch, module, name, wrong, what
):
    monkeypatch.setattr(module, name, wrong(getattr(module, name)))
    with pytest.raises(DiffersError, match=what):
        check_made(recorded, BODIES)


def test_unchanged_stages_pass_the_comparison(recorded):
    check_made(recorded, CELLS)
    check_made(recorded, BODIES)


@pytest.mark.parametrize("field", ["x", "y", "z", "z_min", "top", "count"])
def test_one_bit_of_one_cell_is_detected(field):
    from mrs_people_loc.cells.scanner import filter_cloud
    from mrs_people_loc.timing import StageTimes

    cloud = random_cloud(2)
    cells = filter_cloud(cloud, CELLS, StageTimes())[2]
    values = getattr(cells, field).copy()
    values[3] = values[3] + 1 if field == "count" else np.nextafter(values[3], F32(9))
    with pytest.raises(DiffersError, match=rf"cells\.{field} .* 1 of \d+ values.*\(3,\)"):
        check_cells("v", dataclasses.replace(cells, **{field: values}), cells_of(cloud, CELLS))


# ---------------------------------------------------------------------------------- one interval


def people_of_the_mixed_team():
    (scans, poses), grid = mixed_team()
    planner = Planner(PlannerConfig().memoryless())
    planner.take_grid(grid)
    people = planner.step(scans, poses, 10_000_000)
    return scans, people, planner.config, grid


def nothing_known(known):
    return dataclasses.replace(
        known, cells=np.zeros_like(known.cells), bodies=np.zeros_like(known.bodies)
    )


OF_PEOPLE = {
    "walking": (
        planner_module, "allow_for_walking", instead(lambda scans, poses, *_: poses), "position",
    ),
    "map": (fusion, "map_from_robot", then(lambda xy: xy + 1e-6), "map"),
    "places of bodies": (planner_module, "place_bodies", change(xy=0.01), "position|clusters"),
    "covariance of bodies": (
        planner_module, "place_bodies",
        then(lambda b: dataclasses.replace(b, covariance=1.01 * b.covariance)), "covariance",
    ),
    "scores of bodies": (planner_module, "place_bodies", change(score=0.01), "score"),
    "masks": (planner_module, "mask", then(nothing_known), "clusters"),
    "masks of cells": (
        planner_module, "mask",
        then(lambda known: dataclasses.replace(known, cells=~known.cells)), "clusters",
    ),
    "masks of bodies": (
        planner_module, "mask",
        then(lambda known: dataclasses.replace(known, bodies=~known.bodies)), "clusters",
    ),
    "walls": (masking.Walls, "distance", then(lambda away: away + 0.15), "clusters|score"),
    "log-odds of walls": (masking.Walls, "log_odds", then(lambda odds: odds - 0.01), "score"),
    "clusters": (cell_detector, "cluster", then(lambda label: label.max(initial=-1) - label),
                 "clusters"),
    "distance of clusters": (
        cell_detector, "cluster", lambda right: lambda xy, *, distance: right(xy, distance=0.04),
        "clusters",
    ),
    "splitting": (
        cell_detector, "split",
        instead(lambda fused, cells, label, *_, **__: (label, 0)), "clusters",
    ),
    "too wide": (cell_detector, "split", then(lambda found: (found[0], found[1] + 1)), "too wide"),
    "measures": (cell_detector, "measure", change(width=0.01), "width"),
    "human size": (cell_detector, "is_human", then(lambda human: ~human), "number of people"),
    "positions": (
        cell_detector, "locate",
        then(lambda found: tuple(dataclasses.replace(p, position=p.position + 1) for p in found)),
        "position",
    ),
    "joining": (body_detector, "join", change(score=0.01), "score"),
    "nothing is joined": (
        body_detector, "join",
        lambda right: lambda bodies, used, config, *rest: right(
            bodies, used, dataclasses.replace(config, gate=0.1), *rest
        ), "clusters",
    ),
    "place of joined": (body_detector, "join", change(xy=1e-4), "position"),
    "selection": (
        body_detector, "are_people", then(lambda people: np.ones_like(people)), "number of people"
    ),
    "both methods": (
        planner_module, "combine",
        lambda right: lambda one, other, *, min_distance: right(one, other, min_distance=0.0),
        "number of people",
    ),
}  # fmt: skip


def test_unchanged_people_pass_the_comparison():
    check_people(*people_of_the_mixed_team())


@mutations(OF_PEOPLE)
def test_wrong_stage_of_the_planner_is_detected(monkeypatch, module, name, wrong, what):
    monkeypatch.setattr(module, name, wrong(getattr(module, name)))
    with pytest.raises(DiffersError, match=what):
        check_people(*people_of_the_mixed_team())


def with_clusters(people, **changes):
    return dataclasses.replace(people, clusters=dataclasses.replace(people.clusters, **changes))


def with_person(people, **changes):
    first = dataclasses.replace(people.persons[0], **changes)
    return dataclasses.replace(people, persons=(first, *people.persons[1:]))


@pytest.mark.parametrize(
    ("wrong", "what"),
    [
        (lambda p: with_clusters(p, label=np.roll(p.clusters.label, 1)), "clusters differs"),
        (lambda p: with_clusters(p, width=p.clusters.width + 0.01), "width"),
        (lambda p: with_clusters(p, sigma=p.clusters.sigma * 1.001), "sigma"),
        (lambda p: with_clusters(p, seen_by=~p.clusters.seen_by), "seen_by"),
        (lambda p: dataclasses.replace(p, persons=p.persons[1:]), "number of people"),
        (lambda p: with_person(p, position=p.persons[0].position + 1e-5), "position"),
        (lambda p: with_person(p, covariance=p.persons[0].covariance * 1.1), "covariance"),
        (lambda p: with_person(p, robots=("robot_z",)), "robots"),
        (lambda p: with_person(p, score=p.persons[0].score + 0.01), "score"),
        (lambda p: with_person(p, stamp_ns=1), "stamp_ns"),
        (lambda p: dataclasses.replace(p, groups=()), "group"),
        (lambda p: dataclasses.replace(
            p, groups=(dataclasses.replace(p.group, radius=p.group.radius + 0.1),)), "radius"),
        (lambda p: dataclasses.replace(p, too_wide=p.too_wide + 1), "too wide"),
        (lambda p: dataclasses.replace(
            p, fused=dataclasses.replace(p.fused, xy=p.fused.xy + 1e-3)), "map"),
        (lambda p: dataclasses.replace(
            p, fused=dataclasses.replace(p.fused, robot=p.fused.robot[::-1])), "map: robots"),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)  # fmt: skip
@pytest.mark.parametrize("base", [CELLS, BODIES], ids=["cells", "bodies"])
def test_wrong_person_is_detected(wrong, what, base):
    config = PlannerConfig()
    scans, poses = drawn_scans(base, 0)
    people = Planner(config.memoryless()).step(scans, poses, 0)
    check_people(scans, people, config)
    with pytest.raises(DiffersError, match=what):
        check_people(scans, wrong(people), config)


# ---------------------------------------------------------------------------------------- places


def constants(**changes):
    return lambda right: dataclasses.replace(right, **changes)


def without_exemption(right):
    def wrong(of, expected, tuning):
        right(of, expected, tuning)
        of.came[:] = False

    return wrong


OF_PLACES = {
    "body of another place": (places, "_place_of", then(lambda of: of[::-1].copy())),
    "every body is new": (places, "_place_of", then(lambda of: np.full_like(of, -1))),
    "nearest": (places, "_nearest", then(lambda of: np.roll(of, 1))),
    "look": (places, "_best_look", then(lambda look: look + 0.01)),
    "no visitors": (places, "_update_visitors", instead(lambda *_: None)),
    "nobody is exempt": (places, "_update_visitors", without_exemption),
    "sum of robots": (
        places, "_best_look", instead(lambda joined, bodies: joined.score.copy()),
    ),
    **{
        f"tuning: {name}": (places, "PLACES_TUNING", constants(**{name: value}))
        for name, value in {
            "gain": 2.4, "tau": 0.6, "sure": 1.6, "present": 0.6, "max_look": 2.0, "looks": 2,
            "beyond_doubt": 5.0, "soon_s": 1.0, "long_s": 10.0, "first_s": 0.0,
            "reach": 0.1, "reach_sigmas": 1.0, "max_reach": 0.4, "max_gap_s": 0.4, "forget_s": 2.0,
            "max_places": 4,
        }.items()
    },
}  # fmt: skip


@pytest.mark.parametrize(("module", "name", "wrong"), OF_PLACES.values(), ids=OF_PLACES.keys())
def test_wrong_step_of_the_place_memory_is_detected(monkeypatch, module, name, wrong):
    changed = wrong(getattr(module, name))
    monkeypatch.setattr(module, name, changed)
    if name == "PLACES_TUNING":
        monkeypatch.setattr(places.PlaceMemory.__init__, "__defaults__", (changed,))
    with pytest.raises(DiffersError, match="places: log-odds lost"):
        check_places(*furnished_room(0), PlannerConfig())


# ---------------------------------------------------------------------------------------- tracks


@pytest.mark.parametrize(
    ("changes", "what"),
    [
        ({}, None),
        ({"position": 1e-6}, "place of person 1"),
        ({"velocity": 1e-6}, "velocity of person 1"),
        ({"velocity_covariance": 1e-6}, "covariance of person 1"),
        ({"covariance": 1e-6}, "place"),
    ],
)
def test_wrong_track_is_detected(changes, what):
    from mrs_people_loc.following.tracks import Tracker

    config = PlannerConfig.from_mapping({"tracking.gate": 20.0, "tracking.lasting_share": 0.0})
    tracker = Tracker(config.tracking)
    found = [found_people(3, step) for step in range(20)]
    times_ns = [step * INTERVAL_NS for step in range(20)]
    people = [tracker.step(of, now) for of, now in zip(found, times_ns, strict=True)][-1]
    one = people[1]
    values = {name: getattr(one, name) + value for name, value in changes.items()}
    people = (people[0], dataclasses.replace(one, **values), people[2])
    if what is None:
        check_tracks(found, people, times_ns, config)
        return
    with pytest.raises(DiffersError, match=what):
        check_tracks(found, people, times_ns, config)

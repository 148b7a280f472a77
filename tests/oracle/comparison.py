"""Holds what the packages compute against the oracle, stage by stage.

    check_view(images, stages, camera, config)
    check_people(scans, people, config)
    check_places(intervals, times_ns, config)
    check_tracks(found, people, stamps_ns, config)

Each stage is computed from the packages' own result of the stage before, so that a rounding changes
nothing but itself. What is compared, and how closely:

- disparities, zones, noise windows and cells of the paper's method: bit for bit (disparities where
  StereoBM repeats itself; else all but one in 200);
- points, maps, clusters, people, groups, places and tracks: to rounding;
- the default method's histogram, candidates, patches, votes, evidence, bodies, tops and cells: to
  what float32 leaves; a sample that rounding may put into another pixel is left out. Its candidates
  are held to their definition: each is the best that those before it leave, since several may be
  equally good.

Not compared: rectification, clocks and poses (tests of their own); people who are expected
somewhere, assignment, births and ends of tracks, and groups that are followed. Intervals are
compared without memory.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, fields

import numpy as np

from mrs_people_loc.bodies.finder import BodyFinder, CandidateEvidence
from mrs_people_loc.bodies.joining import Joined
from mrs_people_loc.bodies.patches import Patches
from mrs_people_loc.bodies.places import PlaceMemory
from mrs_people_loc.bodies.scanner import BodyStages
from mrs_people_loc.bodies.search import BodySearch, Candidates
from mrs_people_loc.clusters import Clusters
from mrs_people_loc.config import PlannerConfig, RobotConfig
from mrs_people_loc.people import Expected, Person
from mrs_people_loc.planner import People, Planner
from mrs_people_loc.robot import Stages
from mrs_people_loc.scan import CELL_DTYPE, Cells, Scan
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import StereoImages
from mrs_people_loc.team.fusion import BodiesOnMap, ShortTermMap
from mrs_people_loc.team.masking import OccupancyGrid
from mrs_people_loc.team.poses import Pose
from mrs_people_loc.timing import StageTimes
from mrs_studies.bench.differs import TOLERANCE, DiffersError, near, same
from oracle.arrays import Float, Float32
from oracle.bodies import Body, BodyCell, Candidate, bodies_of, cells_of, points_of
from oracle.cells import Cell, noise_of, zones_of
from oracle.cells import cells_of as plain_cells_of
from oracle.cloud import cloud_of
from oracle.clusters import Cluster
from oracle.disparity import disparity_of
from oracle.evidence import evidence_of
from oracle.fusion import fused_of, in_order, placed_of
from oracle.head import scale_of
from oracle.masking import Walls
from oracle.numbers import HIGHEST_M, LOWEST_M
from oracle.patches import Patch, centred, patch_at
from oracle.people import group_of, people_on
from oracle.places import Guest, Look, lost_by
from oracle.search import Bins, cross_out, extents_of, histogram_of
from oracle.tracks import filtered, published
from oracle.votes import STEPS, smoothed, vote_of

#: float32 has 24 bits: 5 m to half a micrometre, and some roundings on the way.
_CLOUD_M = 1e-5
#: Inverting matrices, and heights in float32, lose some digits.
_SUMS = 1e-6
#: What float32 leaves of metres and log-odds, and of a pixel in the hundreds after some sums.
_FLOAT32, _FLOAT32_PX = 1e-5, 1e-3
#: Where a patch ends up, when a few of its samples fall into other pixels [rad], [px].
_CENTRED_RAD, _CENTRED_PX = 4e-3, 0.02
#: How far votes [px], their sigmas (as a part) and contrasts may be off; more where OpenCV looks
#: between pixels in steps, since rounding may decide for the next one.
_VOTE_PX, _VOTE_SIGMA, _CONTRAST = (0.01, 0.02, 0.05) if STEPS else (1e-3, 1e-3, 0.01)
#: What OpenCV's angles [log-odds] leave of a score, and where it looks between pixels in steps.
_APPEARANCE = 0.1 if STEPS else 5e-3


# ------------------------------------------------------------------------------------- one view


def check_view(
    images: StereoImages, stages: Stages, camera: StereoCamera, config: RobotConfig
) -> None:
    """Compares the stages of a view, of either method.

    Raises:
        DiffersError: Naming the first stage and field that differ.
    """
    name = f"{stages.scan.robot} at {stages.scan.stamp_ns} ns"
    wanted = disparity_of(images, camera, config.disparity)
    same(f"{name}: disparity", stages.disparity, wanted)
    cloud = cloud_of(stages.disparity, camera, config.disparity)
    near(f"{name}: cloud", stages.cloud, np.reshape(cloud, (-1, 3)), _CLOUD_M)
    if isinstance(stages, BodyStages):
        _check_bodies(name, images, stages, camera, config)
        return
    zones = zones_of(stages.cloud, config)
    same(f"{name}: zones", stages.cropped, np.reshape(zones, (-1, 3)))
    same(f"{name}: noise", stages.foreground, np.reshape(noise_of(zones, config), (-1, 3)))
    check_cells(name, stages.scan.cells, plain_cells_of(stages.cloud, config))


def check_cells(name: str, got: Cells, wanted: Sequence[Cell]) -> None:
    """Compares all fields of the paper's cells, bit for bit.

    Raises:
        DiffersError: Naming the field that differs.
    """
    for field in CELL_DTYPE.names or ():
        values = np.array([getattr(c, field) for c in wanted], dtype=CELL_DTYPE[field])
        same(f"{name}: cells.{field}", getattr(got, field), values)


def _check_bodies(
    name: str, images: StereoImages, stages: BodyStages, camera: StereoCamera, config: RobotConfig
) -> None:
    low, high = np.float32(LOWEST_M), np.float32(HIGHEST_M)
    cropped = [point for point in stages.cloud if low <= point[2] <= high]
    same(f"{name}: cropped", stages.cropped, np.reshape(cropped, (-1, 3)).astype(np.float32))
    # What a finder keeps to itself; that it came to the same is seen from what it found.
    find = BodyFinder(camera, config.bodies, min_range=config.disparity.min_range)
    view = find.look(stages.disparity, images, StageTimes())
    check_search(name, view.candidates, stages.disparity, camera, config)
    check_centring(name, view, stages.disparity, camera)
    check_patches(name, view.patches, stages.disparity, camera)
    if config.bodies.vote:
        check_votes(name, view, images, camera)
    check_evidence(name, view, camera)
    candidates = _candidates_of(view)
    wanted = bodies_of(candidates, images.left, camera, config.bodies)
    same(f"{name}: number of bodies", len(stages.bodies), len(wanted))
    for field in [field.name for field in fields(Body)][1:]:
        values = [getattr(body, field) for body in wanted]
        tolerance = _APPEARANCE if field == "score" else _SUMS
        near(f"{name}: bodies.{field}", getattr(stages.bodies, field), values, tolerance)
    points = np.reshape(points_of(wanted, candidates), (-1, 3))
    near(f"{name}: foreground", stages.foreground, points, _FLOAT32)
    cells = cells_of(wanted, candidates)
    for field in [field.name for field in fields(BodyCell)]:
        values = [getattr(cell, field) for cell in cells]
        tolerance = _APPEARANCE if field == "score" else _FLOAT32
        near(f"{name}: cells.{field}", getattr(stages.scan.cells, field), values, tolerance)


def check_search(
    name: str, got: Candidates, disparity: Float32, camera: StereoCamera, config: RobotConfig
) -> None:
    """Compares the search's histogram and its candidates.

    Raises:
        DiffersError: Naming what differs.
    """
    near_m, far_m = config.disparity.min_range, config.bodies.max_range
    bins, histogram = histogram_of(disparity, camera, min_range=near_m, max_range=far_m)
    core = BodySearch(camera, min_range=near_m, max_range=far_m).histogram(disparity)
    near(f"{name}: histogram", core, histogram, _FLOAT32)
    extents = extents_of(histogram, bins)
    for k, (bearing, inverse, extent) in enumerate(
        zip(got.bearing, got.inverse_range, got.extent, strict=True)
    ):
        row, column = _bin_of(f"{name}: candidate {k}", bins, bearing, inverse)
        near(f"{name}: extent of candidate {k}", extent, extents[row, column], _FLOAT32)
        near(f"{name}: extent of the best candidate {k}", extent, extents.max(), _FLOAT32)
        cross_out(extents, bins, row, column)
    most, least = config.bodies.max_count, config.bodies.min_extent
    if len(got) > most or (len(got) and got.extent.min() < least):
        raise DiffersError(f"{name}: candidates differ: {len(got)} of {most}, or too little extent")
    if len(got) < most and extents.max() >= least + _FLOAT32:
        raise DiffersError(f"{name}: candidates differ: {len(got)} of {most}, and one was missed")


def _bin_of(what: str, bins: Bins, bearing: float, inverse: float) -> tuple[int, int]:
    """Row and column of a candidate, which is in the middle of a bin."""
    column = round((bearing - bins.first) / bins.step - 0.5)
    row = next((r for r in range(bins.rows) if math.isclose(bins.inverse_range(r), inverse)), -1)
    near(f"{what}: bearing", bearing, bins.first + (column + 0.5) * bins.step, _FLOAT32)
    if row < 0 or not 0 <= column < bins.columns:
        raise DiffersError(f"{what} differs from the oracle: it is in no bin")
    return row, column


def check_centring(
    name: str, view: CandidateEvidence, disparity: Float32, camera: StereoCamera
) -> None:
    """Compares where patches end up that stand at candidates.

    Raises:
        DiffersError: Naming what differs.
    """
    at = zip(view.candidates.bearing.tolist(), view.candidates.inverse_range.tolist(), strict=True)
    places = [centred(disparity, camera, *place) for place in at]
    for field, values, tolerance in (
        ("bearing", [bearing for bearing, _ in places], _CENTRED_RAD),
        ("inverse_range", [inverse for _, inverse in places], _CENTRED_PX),
    ):
        near(f"{name}: patches.{field}", getattr(view.patches, field), values, tolerance)


def check_patches(name: str, got: Patches, disparity: Float32, camera: StereoCamera) -> None:
    """Compares each sample of patches: where it is in the image, and what is seen there.

    Raises:
        DiffersError: Naming what differs.
    """
    for k, place in enumerate(zip(got.bearing.tolist(), got.inverse_range.tolist(), strict=True)):
        wanted = patch_at(disparity, camera, *place)
        # Between two pixels, and at the border of the image, rounding decides.
        sure = wanted.ahead & (_from_border(wanted.u) > _FLOAT32_PX)
        sure &= _from_border(wanted.v) > _FLOAT32_PX
        same(f"{name}: patches.inside", got.inside[k][sure], wanted.inside[sure])
        sure &= wanted.inside
        for field in ("u", "v", "expected"):
            values = getattr(wanted, field)[wanted.inside]
            near(f"{name}: patches.{field}", getattr(got, field)[k][wanted.inside], values,
                 _FLOAT32_PX)  # fmt: skip
        seen, mine = got.difference[k][sure], wanted.difference[sure]
        known = ~np.isnan(mine)
        same(f"{name}: patches.difference, where known", np.isfinite(seen), known)
        near(f"{name}: patches.difference", seen[known], mine[known], _FLOAT32_PX)
        near(f"{name}: patches.tolerance", got.tolerance[k], wanted.tolerance, _FLOAT32_PX)


def _from_border(place: Float) -> Float:
    """How far from the border between two pixels [px]."""
    return np.abs(np.remainder(place, 1.0) - 0.5)


def check_votes(
    name: str, view: CandidateEvidence, images: StereoImages, camera: StereoCamera
) -> None:
    """Compares votes with those of the patches' samples, one body at a time.

    Raises:
        DiffersError: Naming what differs.
    """
    left, right, patches = smoothed(images.left), smoothed(images.right), view.patches
    for k in range(len(patches)):
        wanted = vote_of(
            left, right, patches.u[k], patches.v[k], patches.expected[k], patches.difference[k],
            patches.inside[k], float(patches.tolerance[k]), camera.disparity_offset_px,
        )  # fmt: skip
        shift, sigma = float(view.vote.shift[k]), float(view.vote.sigma[k])
        near(f"{name}: vote.shift", shift, wanted.shift, _VOTE_PX)
        near(f"{name}: vote.sigma", sigma / wanted.sigma, 1.0, _VOTE_SIGMA)
        near(f"{name}: vote.contrast", view.vote.contrast[k], wanted.contrast, _CONTRAST)


def check_evidence(name: str, view: CandidateEvidence, camera: StereoCamera) -> None:
    """Compares evidence with what patches and votes say, one body at a time.

    Raises:
        DiffersError: Naming what differs.
    """
    patches, vote = view.patches, view.vote
    for k in range(len(patches)):
        wanted = evidence_of(
            patches.difference[k], patches.inside[k], float(patches.tolerance[k]),
            float(patches.inverse_range[k]), float(view.candidates.extent[k]), vote.contrast[k],
            float(vote.shift[k]), float(vote.sigma[k]), scale_of(camera), camera.fx,
        )  # fmt: skip
        for field, values in asdict(wanted).items():
            near(f"{name}: evidence.{field}", getattr(view.evidence, field)[k], values, _FLOAT32)


def _patch_of(patches: Patches, k: int) -> Patch:
    return Patch(
        ahead=np.ones(patches.u[k].shape, dtype=bool), u=patches.u[k], v=patches.v[k],
        expected=patches.expected[k], difference=patches.difference[k], inside=patches.inside[k],
        tolerance=float(patches.tolerance[k]),
    )  # fmt: skip


def _candidates_of(view: CandidateEvidence) -> list[Candidate]:
    patches, vote, evidence = view.patches, view.vote, view.evidence
    return [
        Candidate(
            bearing=float(patches.bearing[k]), inverse_range=float(patches.inverse_range[k]),
            extent=float(view.candidates.extent[k]), patch=_patch_of(patches, k),
            contrast=vote.contrast[k],
            shift=float(vote.shift[k]), even=evidence.even[k], odd=evidence.odd[k],
            depth=evidence.depth[k],
        )
        for k in range(len(patches))
    ]  # fmt: skip


# --------------------------------------------------------------------------------- one interval


def check_people(
    scans: Sequence[Scan],
    people: People,
    config: PlannerConfig,
    grid: OccupancyGrid | None = None,
) -> None:
    """Compares an interval's map, clusters, people and group.

    Args:
        scans: What went in, with the poses in `people`, and no others.
        people: What came out of a planner without memory.
        config: The planner's configuration.
        grid: What is known of walls and furniture.

    Raises:
        DiffersError: Naming what differs.
    """
    name, fused = f"interval at {people.stamp_ns} ns", people.fused
    tolerance = _SUMS if fused.cells.body.any() else TOLERANCE
    _check_map(name, scans, people)
    walls = None if grid is None else Walls(grid, occupied_from=config.masking.occupied_from)
    speed = config.interval.walking_speed
    placed = placed_of(scans, people.poses, people.stamp_ns, speed)
    found = people_on(fused, people.poses, placed, config, walls)
    label = np.array(found.label, dtype=np.intp)
    same(f"{name}: clusters", people.clusters.label, label)
    _check_clusters(name, people.clusters, found.clusters, fused)
    same(f"{name}: clusters that are too wide", people.too_wide, found.too_wide)
    _check_persons(name, people.persons, found.persons, tolerance)
    group = group_of(found.persons)
    if group is None or people.group is None:
        same(f"{name}: group", people.group, group)
        return
    for field in ("centre", "covariance", "radius", "rms_spread", "size"):
        got, want = (getattr(of, field) for of in (people.group, group))
        near(f"{name}: group: {field}", got, want, tolerance)


def _check_map(name: str, scans: Sequence[Scan], people: People) -> None:
    fused, scans = people.fused, in_order(scans)
    near(f"{name}: map", fused.xy, np.reshape(fused_of(scans, people.poses), (-1, 2)))
    robots = [scan.robot for scan in scans for _ in range(len(scan.cells.x))]
    same(f"{name}: map: robots", [fused.robots[i] for i in fused.robot], robots)
    for field in fields(Cells):
        values = [np.empty(0), *(getattr(scan.cells, field.name) for scan in scans)]
        near(f"{name}: map: cells", getattr(fused.cells, field.name), np.concatenate(values), 0.0)


def _check_persons(
    name: str, got: Sequence[Person], wanted: Sequence[Person], tolerance: float
) -> None:
    same(f"{name}: number of people", len(got), len(wanted))
    for index, (one, other) in enumerate(zip(got, wanted, strict=True)):
        who = f"{name}: person {index}"
        for field in ("position", "covariance", "height", "sigma", "score"):
            near(f"{who}: {field}", getattr(one, field), getattr(other, field), tolerance)
        for field in ("robots", "label", "stamp_ns"):
            same(f"{who}: {field}", getattr(one, field), getattr(other, field))


def _check_clusters(
    name: str, got: Clusters, wanted: Sequence[Cluster], fused: ShortTermMap
) -> None:
    same(f"{name}: number of clusters", len(got.cells), len(wanted))
    for field in ("centroid", "scatter", "sigma", "height", "bottom", "cells", "points"):
        values = np.array([getattr(one, field) for one in wanted])
        near(f"{name}: clusters.{field}", getattr(got, field), values)
    sided = [i for i, one in enumerate(wanted) if one.has_axis]
    for field in ("width", "depth"):
        values = np.array([getattr(wanted[i], field) for i in sided])
        near(f"{name}: clusters.{field}", getattr(got, field)[sided], values, 1e-6)
    seen = np.array([[robot in one.robots for robot in fused.robots] for one in wanted])
    same(f"{name}: clusters.seen_by", got.seen_by, seen.reshape(len(wanted), -1))


# -------------------------------------------------------------------------------- several of them


class _Recorded(PlaceMemory):
    """A place memory that keeps what goes in and comes out."""

    def __init__(self) -> None:
        super().__init__()
        self.looks: list[list[Look]] = []
        self.guests: list[list[Guest]] = []
        self.times_ns: list[int] = []
        self.lost: list[Float] = []

    def step(
        self, joined: Joined, bodies: BodiesOnMap, expected: Expected, time_ns: int, most: float
    ) -> Float:
        of = joined.of_body.tolist()
        self.looks.append([
            Look((x, y), 0.5 * (c[0][0] + c[1][1]), tuple(bodies.score[np.equal(of, number)]))
            for number, ((x, y), c) in enumerate(
                zip(joined.xy.tolist(), joined.covariance.tolist(), strict=True))
        ])  # fmt: skip
        rows = zip(expected.id.tolist(), expected.xy.tolist(), expected.travelled, strict=True)
        self.guests.append([Guest(number, (x, y), bool(far)) for number, (x, y), far in rows])
        self.times_ns.append(time_ns)
        self.lost.append(super().step(joined, bodies, expected, time_ns, most))
        return self.lost[-1]


def check_places(
    intervals: Sequence[tuple[Sequence[Scan], Mapping[str, Pose]]],
    times_ns: Sequence[int],
    config: PlannerConfig,
) -> list[Float]:
    """Compares the log-odds that bodies lose by their places.

    Args:
        intervals: Scans and poses, in each of which there is a body.
        times_ns: Times of the intervals [ns].
        config: The planner's configuration.

    Returns:
        These log-odds, by interval.

    Raises:
        DiffersError: Naming what differs.
    """
    planner, places = Planner(config), _Recorded()
    planner.places = places
    for (scans, poses), time_ns in zip(intervals, times_ns, strict=True):
        planner.step(scans, poses, time_ns)
    same("places: intervals", places.times_ns, list(times_ns))
    most = config.tracking.static_score
    wanted = lost_by(places.looks, places.guests, times_ns, most)
    for k, (got, want) in enumerate(zip(places.lost, wanted, strict=True)):
        near(f"places: log-odds lost in interval {k}", got, np.array(want))
    return places.lost


def check_tracks(
    found: Sequence[Sequence[Person]],
    people: Sequence[Person],
    times_ns: Sequence[int],
    config: PlannerConfig,
) -> None:
    """Compares places and velocities of people who are followed, and their uncertainty.

    Args:
        found: By interval, the people who were found, always in the same order, and so far apart
            that nobody is taken for somebody else.
        people: Who is followed in the end; their labels say which of `found` each is.
        times_ns: Times of the intervals [ns].
        config: The planner's configuration, without a share of the variance that lasts.

    Raises:
        DiffersError: Naming what differs.
    """
    same("number of people who are followed", len(people), len(found[0]))
    for who, person in enumerate(sorted(people, key=lambda one: one.label)):
        mine = [of[who] for of in found]
        x, p = filtered(
            [one.position for one in mine],
            [one.covariance for one in mine],
            [one.stamp_ns for one in mine],
            times_ns,
            config.tracking,
        )[-1]
        nothing = np.full(2, np.nan)
        velocity = nothing if person.velocity is None else person.velocity
        unsure = person.velocity_covariance
        near(f"place of person {who}", person.position, x[:2])
        near(f"velocity of person {who}", velocity, x[2:])
        near(f"covariance of person {who}'s velocity", unsure, p[2:, 2:])
        lasting = config.tracking.lasting_share
        if not lasting:
            near(f"covariance of person {who}'s place", person.covariance, published(x, p))

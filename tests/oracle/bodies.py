"""Which candidates of a view are bodies, where, how sure, how tall, and their cells."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

from mrs_people_loc.config import Bodies as Config
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import Gray
from oracle.appearance import with_appearance
from oracle.arrays import Float
from oracle.evidence import fitted
from oracle.head import lens_of, scale_of
from oracle.numbers import (
    ACROSS,
    APART_ACROSS_M,
    APART_M,
    FARTHEST_RANGES,
    HEIGHTS,
    LEAST_SIGMA_RANGE_M,
    SIGMA_ACROSS_M,
    SIGMA_M,
    SIGMA_PX,
    SILHOUETTE,
    SURE_SCORE,
    TOP_COLUMNS,
    TOP_FROM,
    TOP_GAP,
    TOP_SHARE,
    ZONE_ROWS,
)
from oracle.patches import Patch


@dataclass(frozen=True)
class Body:
    """One body; fields as in `Bodies`, and which candidate it is."""

    candidate: int
    x: float
    y: float
    bearing: float
    range: float
    score: float
    sigma_range: float
    sigma_across: float
    top: float


@dataclass(frozen=True)
class Candidate:
    """What is known of one candidate.

    Attributes:
        bearing: Of its patch, from the lens [rad].
        inverse_range: Likewise [px].
        extent: What the search saw [m].
        patch: Its patch.
        contrast: Of its vote, shape (heights, across).
        shift: Of its vote [px].
        even: Rows of its evidence.
        odd: Likewise.
        depth: Likewise.
    """

    bearing: float
    inverse_range: float
    extent: float
    patch: Patch
    contrast: Float
    shift: float
    even: Float
    odd: Float
    depth: Float


def body_of(number: int, of: Candidate, left: Gray, camera: StereoCamera, config: Config) -> Body:
    """A candidate as a body: its axis, and what the model says of it."""
    scale, lens = scale_of(camera), lens_of(camera)
    least = scale / (FARTHEST_RANGES * config.max_range)
    if config.axis:
        away = scale / max(of.inverse_range + fitted("depth", of.depth), least)
        aside = fitted("across", of.odd)
        sigma_px = math.exp(fitted("depth_log_sigma", of.even))
        sigma_range = max(away * away / scale * sigma_px, LEAST_SIGMA_RANGE_M)
        sigma_across = math.exp(fitted("across_log_sigma", of.even))
    else:
        away, aside = scale / max(of.inverse_range + of.shift, least), 0.0
        sigma_range = math.hypot(SIGMA_M, away * away / scale * SIGMA_PX)
        sigma_across = SIGMA_ACROSS_M
    bearing = of.bearing + math.atan2(aside, away)
    away = math.hypot(away, aside)
    score = fitted("human", of.even) if config.human_test else of.extent
    if config.human_test and config.appearance:
        score = with_appearance(score, left, camera, bearing, away)
    return Body(
        candidate=number,
        x=lens[0] + away * math.cos(bearing),
        y=lens[1] + away * math.sin(bearing),
        bearing=bearing,
        range=away,
        score=score,
        sigma_range=sigma_range,
        sigma_across=sigma_across,
        top=top_of(of.patch.difference, of.patch.tolerance, of.contrast),
    )


def bodies_of(
    candidates: Sequence[Candidate], left: Gray, camera: StereoCamera, config: Config
) -> list[Body]:
    """Those that are likely enough, likeliest first, none of them where a likelier one is."""
    every = [body_of(k, of, left, camera, config) for k, of in enumerate(candidates)]
    kept: list[Body] = []
    for body in sorted(every, key=lambda body: -body.score):
        free = [one for one in every if not any(_are_one(one, other) for other in kept)]
        if body.score >= config.min_score and body in free and not _is_two(body, free):
            kept.append(body)
    return kept


def _is_two(body: Body, every: Sequence[Body]) -> bool:
    """Whether it is what two people have in common who stand to its left and right."""
    rivals = [one for one in every if one is not body and _are_one(one, body)]
    sure = [one for one in rivals if one.score > SURE_SCORE]
    return any(
        left.score + right.score > body.score and not _are_one(left, right)
        for left in sure
        for right in sure
        if left.bearing > body.bearing > right.bearing
    )


def _are_one(one: Body, other: Body) -> bool:
    if math.hypot(one.x - other.x, one.y - other.y) < APART_M:
        return True
    across = abs(one.bearing - other.bearing) * min(one.range, other.range)
    sigma = math.hypot(one.sigma_range, other.sigma_range)
    along = abs(one.range - other.range)
    return across < APART_ACROSS_M and along < max(APART_M, 2.0 * sigma)


def top_of(difference: Float, tolerance: float, contrast: Float) -> float:
    """Height of a body's top [m]: under the first gap of its trunk's column.

    A row is of the body where enough samples are at its depth and, on average, they match no better
    behind it.
    """

    def is_filled(row: int) -> bool:
        if row >= len(HEIGHTS):
            return False
        same = sum(abs(difference[row, column]) < tolerance for column in TOP_COLUMNS)
        match = sum(float(contrast[row, column]) for column in TOP_COLUMNS)
        return bool(same / len(TOP_COLUMNS) >= TOP_SHARE and match >= 0.0)

    row = TOP_FROM
    while any(is_filled(row + k) for k in range(TOP_GAP)):
        row += 1
    # Between the last row before the gap and its first one.
    return 0.5 * float(HEIGHTS[0] + HEIGHTS[1]) + float(HEIGHTS[1] - HEIGHTS[0]) * (row - 1)


# -------------------------------------------------------------------------------- what goes out


@dataclass(frozen=True)
class BodyCell:
    """One cell of a body; fields as in `Cells`."""

    x: float
    y: float
    z: float
    z_min: float
    top: float
    count: int
    body: int
    score: float
    sigma_range: float
    sigma_across: float


def _silhouette(difference: Float, tolerance: float) -> dict[int, list[int]]:
    """By column, the rows whose samples are of a body; one in the middle if there is none."""
    rows = {
        column: [row for row in ZONE_ROWS if abs(difference[row, column]) < tolerance]
        for column in SILHOUETTE
    }
    if not any(rows.values()):
        rows[SILHOUETTE[len(SILHOUETTE) // 2]] = [ZONE_ROWS[0]]
    return {column: mine for column, mine in rows.items() if mine}


def _places(body: Body, rows: dict[int, list[int]]) -> dict[int, tuple[float, float]]:
    """By column, its place in base_link [m]: across the sight through the axis.

    The middle of all samples is at the axis.
    """
    total = sum(len(mine) for mine in rows.values())
    middle = sum(float(ACROSS[column]) * len(mine) for column, mine in rows.items()) / total
    left = {column: float(ACROSS[column]) - middle for column in rows}
    sin, cos = math.sin(body.bearing), math.cos(body.bearing)
    return {column: (body.x - x * sin, body.y + x * cos) for column, x in left.items()}


def cells_of(bodies: Sequence[Body], candidates: Sequence[Candidate]) -> list[BodyCell]:
    """The cells of bodies, body by body, column by column."""
    cells = []
    for number, body in enumerate(bodies, 1):
        of = candidates[body.candidate]
        rows = _silhouette(of.patch.difference, of.patch.tolerance)
        for column, (x, y) in _places(body, rows).items():
            heights = [float(HEIGHTS[row]) for row in rows[column]]
            cells.append(
                BodyCell(
                    x, y, max(heights), min(heights), body.top, len(heights), number,
                    body.score, body.sigma_range, body.sigma_across,
                )
            )  # fmt: skip
    return cells


def points_of(
    bodies: Sequence[Body], candidates: Sequence[Candidate]
) -> list[tuple[float, float, float]]:
    """The samples of bodies, moved to their axes [m]: body by body, row by row."""
    points = []
    for body in bodies:
        of = candidates[body.candidate]
        rows = _silhouette(of.patch.difference, of.patch.tolerance)
        places = _places(body, rows)
        points += [
            (*places[column], float(HEIGHTS[row]))
            for row in ZONE_ROWS
            for column, mine in rows.items()
            if row in mine
        ]
    return points

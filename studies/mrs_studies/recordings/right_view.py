"""Renders the right view of a stereo pair from the left view and its depth."""

from __future__ import annotations

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.errors import BagError
from mrs_people_loc.sensing.images import Gray


def fill_depth(depth: Float) -> Float:
    """Gives a depth to the pixels that have none, in the favour of the background.

    A hole inside a row (the shadow of a body in the depth sensor's light, dark hair) takes the
    farther of its two ends. A hole that reaches the image's border takes the far part of its row
    (90th percentile), since the body beside it may not go on. A row without any depth copies the
    nearest row that has some.

    Args:
        depth: Depth [m], NaN where there is none, shape (height, width).

    Returns:
        Depth [m], finite everywhere.

    Raises:
        BagError: No pixel has a depth.
    """
    valid = np.isfinite(depth)
    if not valid.any():
        raise BagError("no pixel has a depth")
    columns = np.arange(depth.shape[1])
    before = np.maximum.accumulate(np.where(valid, columns, -1), axis=1)
    after = np.minimum.accumulate(np.where(valid, columns, columns.size)[:, ::-1], axis=1)[:, ::-1]
    rows = np.arange(depth.shape[0])[:, None]
    inside = (before >= 0) & (after < columns.size)
    farther = np.maximum(
        depth[rows, np.maximum(before, 0)], depth[rows, np.minimum(after, columns.size - 1)]
    )
    filled = np.where(valid, depth, np.where(inside, farther, np.nan))
    known = np.flatnonzero(valid.any(axis=1))
    far = np.nanpercentile(depth[known], 90, axis=1)
    filled[known] = np.where(np.isfinite(filled[known]), filled[known], far[:, None])
    nearest = known[np.argmin(np.abs(known[None, :] - rows), axis=1)]
    result: Float = filled[nearest]
    return result


#: Sub-pixel steps of the drawn view.
_STEPS = 8
#: Neighbours whose disparities differ by less are one surface [px].
_SAME_SURFACE_PX = 1.0


def render_right(left: Gray, depth: Float, focal_baseline: float) -> Gray:
    """Draws what the right camera of a rectified pair would see, from the left view and its depth.

    Every pixel moves to the left by its disparity; between two neighbours on one surface the
    image goes on linearly, in steps of 1/8 px. Where several points arrive, the nearest is seen.
    What the left camera did not see (beside each body, and at the right border) is filled from
    the background's side with the mirror image of that background, so it has its texture.

    Args:
        left: Grey image, shape (height, width).
        depth: Depth of each pixel [m], finite and positive, the same shape.
        focal_baseline: Focal length times baseline [px m].

    Returns:
        Grey image of the same shape.
    """
    height, width = left.shape
    disparity = focal_baseline / depth
    fine = np.arange((width - 1) * _STEPS + 1)
    first = np.minimum(fine // _STEPS, width - 2)
    weight = fine / _STEPS - first
    step = disparity[:, first + 1] - disparity[:, first]
    # Over an edge of a body nothing is interpolated: the nearer pixel's centre decides.
    weight = np.where(np.abs(step) < _SAME_SURFACE_PX, weight, np.rint(weight))
    grey = left.astype(np.float64)
    fine_disparity = disparity[:, first] + weight * step
    fine_grey = grey[:, first] + weight * (grey[:, first + 1] - grey[:, first])

    target = np.rint(fine - fine_disparity * _STEPS).astype(np.int64)
    rows = np.broadcast_to(np.arange(height)[:, None], target.shape)
    inside = np.flatnonzero(target >= 0)
    near_last = inside[np.argsort(fine_disparity.flat[inside], kind="stable")]
    where = (rows.flat[near_last], target.flat[near_last])
    seen_grey = np.full(target.shape, np.nan)
    seen_disparity = np.full(target.shape, np.nan)
    seen_grey[where] = fine_grey.flat[near_last]  # of repeated places the last one stays
    seen_disparity[where] = fine_disparity.flat[near_last]
    for row_grey, row_disparity in zip(seen_grey, seen_disparity, strict=True):
        _fill_row(row_grey, row_disparity)
    return np.clip(np.rint(seen_grey[:, ::_STEPS]), 0, 255).astype(np.uint8)


def _fill_row(grey: Float, disparity: Float) -> None:
    """Fills the holes (NaN) of one row in place, each from the side that is farther away."""
    hole = np.isnan(disparity)
    edges = np.flatnonzero(np.diff(np.concatenate([[False], hole, [False]]).astype(np.int8)))
    seen = disparity.copy()
    for start, stop in edges.reshape(-1, 2):
        at_left = seen[start - 1] if start > 0 else np.inf
        at_right = seen[stop] if stop < grey.size else np.inf
        from_left = at_left <= at_right
        side = np.arange(start - 1, -1, -1) if from_left else np.arange(stop, grey.size)
        if not side.size:
            grey[start:stop] = 0.0
            continue
        # How far the background goes on from the hole's edge, and that much mirrored about the
        # edge, to and fro where the hole is wider.
        side = side[: stop - start + 1]
        other = ~(np.abs(seen[side] - seen[side[0]]) < _SAME_SURFACE_PX)
        count = int(np.argmax(other)) if other.any() else side.size
        period = max(1, 2 * (count - 1))
        steps = np.arange(1, stop - start + 1) % period
        mirrored = grey[side[np.minimum(steps, period - steps)]]
        grey[start:stop] = mirrored if from_left else mirrored[::-1]

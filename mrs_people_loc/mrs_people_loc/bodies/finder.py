"""Bodies: what a robot makes of one view when it seeks people as bodies.

    search -> patches -> vote -> evidence -> human? where is its axis? -> cells

`bodies` in the configuration switches each step.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from mrs_people_loc import config as cfg
from mrs_people_loc.arrays import Float, Float32, Int, StructOfArrays
from mrs_people_loc.bodies import model as body_model
from mrs_people_loc.bodies import votes as voting
from mrs_people_loc.bodies.model import BodyModel, Evidence, gather_evidence
from mrs_people_loc.bodies.patches import ACROSS, HEIGHTS, SILHOUETTE, Patches, PatchSampler, span
from mrs_people_loc.bodies.search import BodySearch, Candidates
from mrs_people_loc.scan import Cells
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import StereoImages
from mrs_people_loc.timing import StageTimes

#: Where the model does not say how sure a place is: along the line of sight a part that does not
#: depend on range [m] and one in disparity [px], and across [m].
_SIGMA_M, _SIGMA_PX, _SIGMA_ACROSS_M = 0.06, 0.3, 0.06
#: No range is surer than this [m]: with a longer baseline bodies are no thinner.
_LEAST_SIGMA_M = 0.04
#: Two bodies of one view are no closer than this across and in all [m].
_APART_ACROSS, _APART = 0.30, 0.42
#: Heights of a patch whose samples go out as cells.
_ZONE = span((HEIGHTS > 0.2) & (HEIGHTS < 1.95))


@dataclass(frozen=True)
class View:
    """A view with its candidates, before anything is judged.

    Attributes:
        candidates: Where a body may be.
        patches: Their patches, centred.
        vote: What the pixels of each say together.
        evidence: What the patches say.
    """

    candidates: Candidates
    patches: Patches
    vote: voting.Vote
    evidence: Evidence


@dataclass(frozen=True)
class Bodies(StructOfArrays):
    """Bodies of one view, likeliest first, a struct of arrays of one length (n,).

    Attributes:
        x: Place of the axis in base_link [m].
        y: Likewise [m].
        bearing: From the lens [rad].
        range: Horizontal, from the lens [m].
        score: Log-odds of being a person.
        sigma_range: Standard deviation along the line of sight [m].
        sigma_across: Standard deviation across it [m].
        top: Height of its top over the floor [m].
        patches: Its patch.
    """

    x: Float
    y: Float
    bearing: Float
    range: Float
    score: Float
    sigma_range: Float
    sigma_across: Float
    top: Float
    patches: Patches

    @functools.cached_property
    def silhouettes(self) -> tuple[NDArray[np.bool_], Float]:
        """Which samples are of the bodies, and how far to the left of their middle columns are.

        Shape (n, heights of `_ZONE`, columns of `SILHOUETTE`), and [m], shape (n, columns). Each
        body has one sample at least: nobody may get lost.
        """
        difference = self.patches.difference[:, _ZONE, SILHOUETTE]
        with np.errstate(invalid="ignore"):
            same = np.abs(difference) < self.patches.tolerance[:, np.newaxis, np.newaxis]
        count = same.sum(axis=1)
        empty = np.flatnonzero(count.sum(axis=1) == 0)
        across = ACROSS[SILHOUETTE].astype(np.float64)
        same[empty, 0, len(across) // 2] = True
        count[empty, len(across) // 2] = 1
        middle = count @ across / count.sum(axis=1)
        return same, across - middle[:, np.newaxis]


class BodyFinder:
    """Finds the bodies in the views of one head.

    Args:
        camera: The head.
        config: Which steps are taken.
        min_range: Nearest working range [m].
        model: The fitted model; the package's own if None.

    Raises:
        CameraError: The head does not see bodies upright.
    """

    def __init__(
        self,
        camera: StereoCamera,
        config: cfg.Bodies,
        *,
        min_range: float,
        model: BodyModel | None = None,
    ) -> None:
        self.camera = camera
        self.config = config
        self._model = model
        self._search = BodySearch(camera, min_range=min_range, max_range=config.max_range)
        self._sample = PatchSampler(camera)

    def __call__(self, disparity: Float32, images: StereoImages, times: StageTimes) -> Bodies:
        """The bodies of one view.

        Args:
            disparity: [px], float32, shape (height, width), NaN where there is none.
            images: The images that it was made of.
            times: Marked after each step.
        """
        found = self.judge(self.look(disparity, images, times))
        times.mark("judge")
        return found

    def look(self, disparity: Float32, images: StereoImages, times: StageTimes) -> View:
        """Candidates and the evidence for them; arguments as those of a call."""
        config, camera = self.config, self.camera
        candidates = self._search(
            disparity, min_extent=config.min_extent, max_count=config.max_count
        )
        times.mark("search")
        patches = self._sample.centred(disparity, candidates.bearing, candidates.inverse_range)
        times.mark("patches")
        vote = voting.Vote.nothing(len(candidates))
        if config.vote:
            vote = voting.vote(
                images.left, images.right, patches, offset_px=camera.disparity_offset_px
            )
            times.mark("vote")
        evidence = gather_evidence(
            patches, candidates.extent, vote, depth_disparity=camera.depth_disparity
        )
        times.mark("evidence")
        return View(candidates, patches, vote, evidence)

    def judge(self, view: View) -> Bodies:
        """Which candidates may be people, and where their axes are."""
        config, evidence = self.config, view.evidence
        model = self._model or body_model.fitted()
        scale = self.camera.depth_disparity
        inverse = view.patches.inverse_range
        least = scale / (1.5 * config.max_range)
        if config.axis:
            sigma_px = np.exp(model.depth_log_sigma(evidence.even))
            sigma_across = np.exp(model.across_log_sigma(evidence.even))
            ranges = scale / np.maximum(inverse + model.depth(evidence.depth), least)
            across = model.across(evidence.odd)
            sigma_range = np.maximum(ranges * ranges / scale * sigma_px, _LEAST_SIGMA_M)
        else:
            ranges = scale / np.maximum(inverse + view.vote.shift, least)
            across = np.zeros(len(inverse))
            sigma_range = np.hypot(_SIGMA_M, ranges * ranges / scale * _SIGMA_PX)
            sigma_across = np.full(len(inverse), _SIGMA_ACROSS_M)
        bearing = view.patches.bearing + np.arctan2(across, ranges)
        ranges = np.hypot(ranges, across)
        score = model.human(evidence.even) if config.human_test else view.candidates.extent
        _, translation = self.camera.robot_from_optical
        all_bodies = Bodies(
            x=translation[0] + ranges * np.cos(bearing),
            y=translation[1] + ranges * np.sin(bearing),
            bearing=bearing,
            range=ranges,
            score=score,
            sigma_range=sigma_range,
            sigma_across=sigma_across,
            top=_tops(view.patches, view.vote.contrast),
            patches=view.patches,
        )
        return all_bodies.select(self._alone(all_bodies))

    def _alone(self, bodies: Bodies) -> Int:
        """Those that are likely enough, and that no likelier one of this view already is."""
        kept: list[int] = []
        for i in np.argsort(-bodies.score, kind="stable"):
            if bodies.score[i] < self.config.min_score:
                break
            others = np.array(kept, dtype=np.intp)
            nearer = np.minimum(bodies.range[i], bodies.range[others])
            across = np.abs(bodies.bearing[i] - bodies.bearing[others]) * nearer
            along = np.abs(bodies.range[i] - bodies.range[others])
            sigma = np.hypot(bodies.sigma_range[i], bodies.sigma_range[others])
            away = np.hypot(bodies.x[i] - bodies.x[others], bodies.y[i] - bodies.y[others])
            same = (across < _APART_ACROSS) & (along < np.maximum(_APART, 2.0 * sigma))
            if not (same | (away < _APART)).any():
                kept.append(int(i))
        return np.array(kept, dtype=np.intp)


#: Mean contrast of a row that is not of the body.
_BEHIND = 0.0
_TRUNK = np.flatnonzero(np.abs(ACROSS) < 0.13)
_FROM = int(np.searchsorted(HEIGHTS, 0.85))  # rows from here up may be a top
_STEP = float(HEIGHTS[1] - HEIGHTS[0])


def _tops(patches: Patches, contrast: Float32) -> Float:
    """Height of the bodies' tops [m]: where the trunk's column ends in a gap of three samples.

    What matches better behind the body than at it is not the body: windows of matching widen things
    upwards, too.
    """
    tolerance = patches.tolerance[:, np.newaxis, np.newaxis]
    with np.errstate(invalid="ignore"):
        same = np.abs(patches.difference[:, :, _TRUNK]) < tolerance
    behind = contrast[:, _FROM:, _TRUNK].mean(axis=2) < _BEHIND
    filled = (same.mean(axis=2)[:, _FROM:] >= 0.4) & ~behind
    padded = np.pad(filled, ((0, 0), (0, 3)))
    gap = ~(padded[:, :-2] | padded[:, 1:-1] | padded[:, 2:])
    end = gap.argmax(axis=1)  # the first row of the first gap
    top = HEIGHTS[_FROM - 1] + end * _STEP + 0.5 * _STEP
    return np.asarray(top, dtype=np.float64)


def _place(bodies: Bodies, body: Int, left: Float) -> tuple[Float32, Float32]:
    """Where in base_link [m] is what lies so far to the left of a body's axis, across its sight."""
    x = bodies.x[body] - left * np.sin(bodies.bearing[body])
    y = bodies.y[body] + left * np.cos(bodies.bearing[body])
    return x.astype(np.float32), y.astype(np.float32)


def points_of(bodies: Bodies) -> Float32:
    """The samples of the bodies' silhouettes in base_link [m], shape (m, 3)."""
    same, left = bodies.silhouettes
    body, row, column = np.nonzero(same)
    x, y = _place(bodies, body, left[body, column])
    return np.stack([x, y, HEIGHTS[_ZONE][row]]).T


def cells_of(bodies: Bodies) -> Cells:
    """The cells that go out: each body's silhouette, column by column.

    They stand on the upright surface through the axis that faces the lens, so that the centre of
    gravity of a body's cells, weighted with their counts, is its place.

    Returns:
        The cells, body by body; `body` counts from 1 in the order of the bodies.
    """
    same, left = bodies.silhouettes
    body, column = np.nonzero(same.any(axis=1))
    x, y = _place(bodies, body, left[body, column])
    heights = HEIGHTS[_ZONE]
    lowest = heights[same.argmax(axis=1)]
    highest = heights[::-1][same[:, ::-1].argmax(axis=1)]

    def of_cells(values: Float) -> Float32:
        return values[body].astype(np.float32)

    return Cells(
        x=x,
        y=y,
        z=highest[body, column],
        z_min=lowest[body, column],
        top=of_cells(bodies.top),
        count=same.sum(axis=1)[body, column].astype(np.uint32),
        body=(body + 1).astype(np.uint32),
        score=of_cells(bodies.score),
        sigma_range=of_cells(bodies.sigma_range),
        sigma_across=of_cells(bodies.sigma_across),
    )

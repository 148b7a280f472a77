"""Bodies in one view of a robot.

    search -> patches -> vote -> evidence -> score and axis by the model -> appearance -> cells

`bodies.*` in the configuration switches the steps on and off.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass, replace

import numpy as np

from mrs_people_loc import config as cfg
from mrs_people_loc.anthropometry import APART, APART_ACROSS, AXIS_ERROR
from mrs_people_loc.arrays import Bool, Float, Float32, Int, StructOfArrays
from mrs_people_loc.bodies import model as body_model
from mrs_people_loc.bodies import votes as voting
from mrs_people_loc.bodies.appearance import RULED_OUT, Scores
from mrs_people_loc.bodies.model import BodyModel, Evidence, gather_evidence
from mrs_people_loc.bodies.network import PersonNetwork
from mrs_people_loc.bodies.patches import (
    ACROSS,
    CELL_HEIGHTS,
    HEIGHTS,
    PATCH_TUNING,
    ROW,
    SILHOUETTE,
    TRUNK,
    Patches,
    PatchSampler,
    PatchTuning,
)
from mrs_people_loc.bodies.search import SEARCH_TUNING, BodySearch, Candidates, SearchTuning
from mrs_people_loc.bodies.votes import VOTES_TUNING, VotesTuning
from mrs_people_loc.precision import BODY_SIGMA_PX
from mrs_people_loc.scan import Cells
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.images import Gray, StereoImages
from mrs_people_loc.timing import StageTimes


@dataclass(frozen=True)
class FinderTuning:
    """Constants of judging candidates; without another origin, chosen on the training suite.

    Attributes:
        sigma: Standard deviation along the line of sight [m] where the model does not give it, to
            which ...
        sigma_px: ... that of the disparity [px] is added (root sum square).
        sigma_across: Standard deviation across the line of sight [m], likewise.
        min_sigma: No range has a smaller one [m]: a longer baseline makes bodies no thinner.
        apart: Two bodies of one view are no closer than this [m].
        apart_across: Nor closer than this across the line of sight [m] ...
        apart_sigmas: ... where their ranges agree within so many standard deviations.
        sure: Two bodies of more than these log-odds take the place of one between them that is
            less likely than both together.
        beyond: The model moves no body beyond so many times `bodies.max_range`.
        lowest_top: Tops of bodies are this high at least [m].
        filled: A row belongs to a body if at least this share of the trunk's samples does ...
        min_contrast: ... and their mean contrast (`Vote`) is at least this.
    """

    sigma: float = AXIS_ERROR
    sigma_px: float = BODY_SIGMA_PX
    sigma_across: float = AXIS_ERROR
    min_sigma: float = 0.04
    apart_across: float = APART_ACROSS
    apart_sigmas: float = 2.0
    apart: float = APART
    beyond: float = 1.5
    sure: float = 2.0
    lowest_top: float = 0.85
    filled: float = 0.4
    min_contrast: float = 0.0


FINDER_TUNING = FinderTuning()


@dataclass(frozen=True)
class BodyTuning:
    """Constants of the default method on a robot, beside `bodies.*` in the configuration.

    The model was fitted with them: after a change, run `mrs fit`.

    Attributes:
        search: Candidates.
        patches: Centring of patches.
        votes: The vote on a disparity.
        finder: Judging the candidates.
    """

    search: SearchTuning = SEARCH_TUNING
    patches: PatchTuning = PATCH_TUNING
    votes: VotesTuning = VOTES_TUNING
    finder: FinderTuning = FINDER_TUNING


BODY_TUNING = BodyTuning()


@dataclass(frozen=True)
class CandidateEvidence:
    """The candidates of a view and the evidence for them.

    Attributes:
        candidates: Places where a body may be.
        patches: Their patches, centred.
        vote: Their disparities, voted.
        evidence: Input of the model.
    """

    candidates: Candidates
    patches: Patches
    vote: voting.Vote
    evidence: Evidence


@dataclass(frozen=True)
class Bodies(StructOfArrays):
    """Bodies of one view, likeliest first, a struct of arrays of one length (n,).

    Attributes:
        x: Of the axis in base_link [m].
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
    def silhouettes(self) -> tuple[Bool, Float]:
        """Samples that belong to the bodies, and offsets of the columns from their middles.

        Shapes (n, rows of `CELL_HEIGHTS`, columns of `SILHOUETTE`) and (n, columns) [m]. Each body
        has one sample at least, so that none gets lost.
        """
        difference = self.patches.difference[:, CELL_HEIGHTS, SILHOUETTE]
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
        config: Parameters.
        min_range: Nearest working range [m].
        model: The fitted model; the package's own if None.
        tuning: Its constants.

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
        tuning: BodyTuning = BODY_TUNING,
    ) -> None:
        self.camera = camera
        self.config = config
        self.tuning = tuning
        self._model = model
        self._search = BodySearch(
            camera, min_range=min_range, max_range=config.max_range, tuning=tuning.search
        )
        self._sample = PatchSampler(camera, tuning.patches)
        looked_at = config.human_test and config.appearance
        self._network = PersonNetwork(camera) if looked_at else None

    def __call__(self, disparity: Float32, images: StereoImages, times: StageTimes) -> Bodies:
        """The bodies of one view.

        Args:
            disparity: [px], float32, shape (height, width), NaN where there is none.
            images: The images that it was made of.
            times: Marked after each step.
        """
        return self.judge(self.look(disparity, images, times), images.left, times)

    def look(
        self, disparity: Float32, images: StereoImages, times: StageTimes
    ) -> CandidateEvidence:
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
                images.left,
                images.right,
                patches,
                offset_px=camera.disparity_offset_px,
                tuning=self.tuning.votes,
            )
            times.mark("vote")
        evidence = gather_evidence(
            patches,
            candidates.extent,
            vote,
            depth_disparity=camera.depth_disparity,
            focal=camera.fx,
        )
        times.mark("evidence")
        return CandidateEvidence(candidates, patches, vote, evidence)

    def judge(self, view: CandidateEvidence, left: Gray, times: StageTimes) -> Bodies:
        """The candidates that may be people, at their axes.

        Args:
            view: The candidates and the evidence for them.
            left: The left image that they were seen in.
            times: Marked after each step.
        """
        bodies = self.all_bodies(view)
        times.mark("judge")
        if self._network is not None:
            weights = (self._model or body_model.fitted()).appearance.weights
            score, seen = bodies.score.copy(), bodies.score >= RULED_OUT
            some = bodies.select(seen)
            by_network = self._network(left, some.bearing, some.range)
            score[seen] = Scores(score[seen], by_network).combined(weights)
            bodies = replace(bodies, score=score)
            times.mark("appearance")
        bodies = bodies.select(self._alone(bodies))
        times.mark("select")
        return bodies

    def all_bodies(self, view: CandidateEvidence) -> Bodies:
        """All candidates at their axes, scored by the human test."""
        config, tuning, evidence = self.config, self.tuning.finder, view.evidence
        model = self._model or body_model.fitted()
        scale = self.camera.depth_disparity
        inverse = view.patches.inverse_range
        least = scale / (tuning.beyond * config.max_range)
        if config.axis:
            sigma_px = np.exp(model.depth_log_sigma(evidence.even))
            sigma_across = np.exp(model.across_log_sigma(evidence.even))
            ranges = scale / np.maximum(inverse + model.depth(evidence.depth), least)
            across = model.across(evidence.odd)
            sigma_range = np.maximum(ranges * ranges / scale * sigma_px, tuning.min_sigma)
        else:
            ranges = scale / np.maximum(inverse + view.vote.shift, least)
            across = np.zeros(len(inverse))
            sigma_range = np.hypot(tuning.sigma, ranges * ranges / scale * tuning.sigma_px)
            sigma_across = np.full(len(inverse), tuning.sigma_across)
        bearing = view.patches.bearing + np.arctan2(across, ranges)
        ranges = np.hypot(ranges, across)
        score = model.human(evidence.even) if config.human_test else view.candidates.extent
        _, translation = self.camera.robot_from_optical
        return Bodies(
            x=translation[0] + ranges * np.cos(bearing),
            y=translation[1] + ranges * np.sin(bearing),
            bearing=bearing,
            range=ranges,
            score=score,
            sigma_range=sigma_range,
            sigma_across=sigma_across,
            top=_tops(view.patches, view.vote.contrast, tuning),
            patches=view.patches,
        )

    def _alone(self, bodies: Bodies) -> Int:
        """Indices of those that are likely enough, without a likelier one in their place.

        Between two people who stand side by side there often is a third place, as likely as each
        of them, that covers half of both: it gives way to the two.
        """
        same, score = self._same(bodies), bodies.score
        rival = same & (score > self.tuning.finder.sure)
        taken = np.zeros(len(bodies), dtype=bool)
        kept: list[int] = []
        for i in np.argsort(-score, kind="stable").tolist():
            if score[i] < self.config.min_score:
                break
            if taken[i]:
                continue
            rivals = np.flatnonzero(rival[i] & ~taken)
            if len(rivals) > 1:
                left = rivals[bodies.bearing[rivals] > bodies.bearing[i]]
                right = rivals[bodies.bearing[rivals] < bodies.bearing[i]]
                two = ~same[np.ix_(left, right)]
                if (two & (np.add.outer(score[left], score[right]) > score[i])).any():
                    continue
            kept.append(i)
            taken |= same[i]
        return np.array(kept, dtype=np.intp)

    def _same(self, bodies: Bodies) -> Bool:
        """Which of the bodies are in one place, shape (n, n)."""
        tuning = self.tuning.finder

        def differences(values: Float) -> Float:
            return np.abs(np.subtract.outer(values, values))

        across = differences(bodies.bearing) * np.minimum.outer(bodies.range, bodies.range)
        sigma = np.hypot.outer(bodies.sigma_range, bodies.sigma_range)
        deep = np.maximum(tuning.apart, tuning.apart_sigmas * sigma)
        same = (across < tuning.apart_across) & (differences(bodies.range) < deep)
        away = np.hypot(differences(bodies.x), differences(bodies.y))
        same |= away < tuning.apart
        np.fill_diagonal(same, False)
        return np.asarray(same)


def _tops(patches: Patches, contrast: Float32, tuning: FinderTuning) -> Float:
    """Height of the bodies' tops [m]: where the trunk's columns end in a gap of three samples.

    What matches better behind the body than at it is not the body: windows of matching widen things
    upwards, too.
    """
    first = int(np.searchsorted(HEIGHTS, tuning.lowest_top))
    tolerance = patches.tolerance[:, np.newaxis, np.newaxis]
    with np.errstate(invalid="ignore"):
        same = np.abs(patches.difference[:, first:, TRUNK]) < tolerance
    ones = np.ones(same.shape[2], dtype=np.float32)
    behind = contrast[:, first:, TRUNK] @ ones < tuning.min_contrast * len(ones)
    filled = (same.astype(np.float32) @ ones >= tuning.filled * len(ones)) & ~behind
    padded = np.zeros((len(filled), filled.shape[1] + 3), dtype=bool)
    padded[:, :-3] = filled
    gap = ~(padded[:, :-2] | padded[:, 1:-1] | padded[:, 2:])
    end = gap.argmax(axis=1)  # the first row of the first gap
    top = HEIGHTS[first - 1] + end * ROW + 0.5 * ROW
    return np.asarray(top, dtype=np.float64)


def _place(bodies: Bodies, body: Int, left: Float) -> tuple[Float32, Float32]:
    """Points beside the axes of bodies, across the line of sight: x and y in base_link [m]."""
    x = bodies.x[body] - left * np.sin(bodies.bearing[body])
    y = bodies.y[body] + left * np.cos(bodies.bearing[body])
    return x.astype(np.float32), y.astype(np.float32)


def points_of(bodies: Bodies) -> Float32:
    """The samples of the bodies' silhouettes in base_link [m], shape (m, 3)."""
    same, left = bodies.silhouettes
    body, row, column = np.nonzero(same)
    x, y = _place(bodies, body, left[body, column])
    return np.stack([x, y, HEIGHTS[CELL_HEIGHTS][row]]).T


def cells_of(bodies: Bodies) -> Cells:
    """The cells that go out: each body's silhouette, column by column.

    Each lies in the vertical plane through the axis that faces the lens, so that the centre of
    gravity of a body's cells, weighted with their counts, is its place.

    Returns:
        The cells, body by body; `body` counts from 1 in the order of the bodies.
    """
    same, left = bodies.silhouettes
    body, column = np.nonzero(same.any(axis=1))
    x, y = _place(bodies, body, left[body, column])
    heights = HEIGHTS[CELL_HEIGHTS]
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

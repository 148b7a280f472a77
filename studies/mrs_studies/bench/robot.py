"""What a view costs a robot, stage by stage."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from mrs_people_loc import timing
from mrs_people_loc.arrays import Float32
from mrs_people_loc.config import RobotConfig
from mrs_people_loc.guiding.collision_monitor import CollisionMonitor
from mrs_people_loc.guiding.obstacles import HeadObstacles
from mrs_people_loc.robot import RobotPipeline
from mrs_people_loc.sensing.camera import StereoCamera
from mrs_people_loc.sensing.disparity import make_stereo_bm
from mrs_people_loc.sensing.images import StereoImages
from mrs_studies.bench.samples import Samples, blocks
from mrs_tools.bags.sources import RobotView

#: A head's two cameras of three.
PAIR_OF_THREE = "pair of three"
#: Views a second, for the collision monitor.
_VIEWS_HZ = 15.0


class TimedHead:
    """One robot's pipeline and collision monitor, and what to run them on."""

    def __init__(self, pipeline: RobotPipeline, images: Sequence[StereoImages]) -> None:
        self.pipeline, self.images = pipeline, images
        config = pipeline.config
        self._monitor = CollisionMonitor(config.collision_monitor)
        self._obstacles = HeadObstacles(
            pipeline.camera, config.collision_monitor, nearest=config.disparity.min_range
        )
        self._views = 0

    def time_view(self, turn: int) -> tuple[dict[str, float], int]:
        """What each stage of a view takes [ms], and how many bodies its scan has."""
        pipeline, images = self.pipeline, self.images[turn % len(self.images)]
        began = timing.now_ns()
        stages = pipeline.stages(images)
        whole = (timing.now_ns() - began) / 1e6
        stereo_bm = pipeline.matcher.stereo_bm_ms
        after = {stage: ms for stage, ms in stages.times_ms.items() if stage != "disparity"}
        times = {
            "StereoBM": stereo_bm,
            "disparity around it": stages.times_ms["disparity"] - stereo_bm,
            **after,
            "all but StereoBM": whole - stereo_bm,
            "whole": whole,
            "collision monitor, beside it": self._time_monitor(stages.disparity),
        }
        return times, int(stages.scan.cells.body.max(initial=0))

    def _time_monitor(self, disparity: Float32) -> float:
        self._views += 1
        began, now_s = timing.now_ns(), self._views / _VIEWS_HZ
        self._monitor.take_scan("head", self._obstacles(disparity), now_s, now_s)
        return (timing.now_ns() - began) / 1e6


def heads_of(
    views: Iterable[RobotView], robots: Mapping[str, RobotConfig]
) -> dict[str, list[TimedHead]]:
    """The heads of a bag's views, by kind: `binocular`, `trinocular`, `pair of three`.

    The last is a trinocular head without its third camera: in the paper's formation it leads, and
    is the only one that sees everybody.
    """
    images: defaultdict[str, list[StereoImages]] = defaultdict(list)
    cameras: dict[str, StereoCamera] = {}
    for view in views:
        images[view.robot].append(view.images)
        cameras[view.robot] = view.camera
    heads: dict[str, list[TimedHead]] = {}
    for robot, camera in cameras.items():
        kind = "trinocular" if camera.vertical_baseline else "binocular"
        pipeline = RobotPipeline(robot, camera, robots[robot])
        heads.setdefault(kind, []).append(TimedHead(pipeline, images[robot]))
        if camera.vertical_baseline:
            pair = replace(camera, vertical_baseline=0.0, vertical_offset_px=0.0)
            pipeline = RobotPipeline(robot, pair, robots[robot])
            heads.setdefault(PAIR_OF_THREE, []).append(TimedHead(pipeline, images[robot]))
    return heads


def time_robot(
    heads: Mapping[str, Mapping[str, Sequence[TimedHead]]], frames: int
) -> dict[str, dict[str, Any]]:
    """Times the robots' pipelines.

    Args:
        heads: By configuration and kind, the heads to run.
        frames: Views to time for each configuration and kind.

    Returns:
        By configuration and kind: stages [ms], the ratio of everything but StereoBM to StereoBM,
        frames per second, and how many bodies a scan has (0 where none are sought).
    """
    samples: defaultdict[tuple[str, str], Samples] = defaultdict(Samples)
    seen: defaultdict[tuple[str, str], list[int]] = defaultdict(list)
    for block, turns in enumerate(blocks(frames)):
        for name, kinds in heads.items():
            for kind, of_kind in kinds.items():
                sample, head = samples[name, kind], of_kind[block % len(of_kind)]
                for turn, counts in turns:
                    times, bodies = head.time_view(turn)
                    if counts:
                        sample.add(times)
                        seen[name, kind].append(bodies)
                bare = sample.ms["StereoBM on the bare pair"]
                bare += _time_bare_pair(head.pipeline, head.images[0], len(turns))
    result: dict[str, dict[str, Any]] = {}
    for (name, kind), sample in sorted(samples.items(), key=lambda item: item[0][1]):
        pipelines = [head.pipeline for head in heads[name][kind]]
        camera = pipelines[0].camera
        result.setdefault(name, {})[kind] = {
            "robots": [pipeline.robot for pipeline in pipelines],
            "image": f"{camera.width}x{camera.height}",
            "searched_px": list(pipelines[0].matcher.searched_px),
            "frames": len(sample.ms["whole"]),
            "stages_ms": sample.report(),
            "rest_to_stereo_bm": sample.median("all but StereoBM") / sample.median("StereoBM"),
            "frames_per_s": 1000.0 / float(np.mean(sample.ms["whole"])),
            "bodies": float(np.median(seen[name, kind])),
        }
    return result


def _time_bare_pair(pipeline: RobotPipeline, images: StereoImages, count: int) -> list[float]:
    """What StereoBM takes on a pair without the padding, for comparison [ms]."""
    bm = make_stereo_bm(pipeline.config.disparity, pipeline.matcher.searched_px[0])
    times = []
    for _ in range(count):
        began = timing.now_ns()
        bm.compute(images.left, images.right)
        times.append((timing.now_ns() - began) / 1e6)
    return times

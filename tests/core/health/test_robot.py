"""What is wrong with a robot, from plain figures."""

from __future__ import annotations

from dataclasses import replace

import pytest

from mrs_people_loc.health.findings import ERROR, OK, STALE, WARN, Code, Finding
from mrs_people_loc.health.robot import (
    MountingState,
    PairingState,
    PoseState,
    ScanState,
    of_head,
    of_mounting,
    of_pairing,
    of_pose,
    of_scan,
)


def verdict(finding: Finding) -> tuple:
    return finding.level, finding.code, finding.message


@pytest.mark.parametrize(
    ("unpaired", "lately", "frames", "wanted"),
    [
        (0, False, 0, (OK, None, "ok")),
        (3, False, 9, (OK, None, "ok")),  # long ago
        (3, True, 9, (WARN, Code.SOME_UNPAIRED, "3 images found no pair; why")),
        (3, True, 0, (ERROR, Code.NO_PAIR, "3 images found no pair; why")),
        (3, False, 0, (ERROR, Code.NO_PAIR, "3 images found no pair; why")),
    ],
)
def test_pairing(unpaired, lately, frames, wanted):
    finding = of_pairing(PairingState(unpaired, lately, "why", 2, frames))
    assert verdict(finding) == wanted
    assert finding.values == {"unpaired": unpaired, "stamp_resets": 2}


def test_head():
    assert verdict(of_head("", {})) == (STALE, Code.NO_VIEW, "no view yet")
    seen = {"valid_pixels": 0.256}
    assert of_head("", seen) == Finding("head", values={"valid_pixels": "0.26"})
    blind = of_head("left image is black", seen)
    assert verdict(blind) == (
        WARN,
        Code.BLIND,
        "the head is blind: left image is black; check lens caps, light and exposure",
    )
    assert blind.values == {"valid_pixels": "0.26"}


CONFIGURED = MountingState("robot_a", "height 1.00 m")
MEASURED = replace(CONFIGURED, measured="height 1.20 m", floor_part=0.254)


@pytest.mark.parametrize(
    ("state", "watched", "wanted"),
    [
        (None, True, (OK, None, "no view")),
        (None, False, (OK, None, "not watched: floor.watch is false")),
        (CONFIGURED, True, (OK, None, "not enough floor in view to tell: too few views so far")),
        (
            replace(CONFIGURED, why_not="no floor"),
            True,
            (OK, None, "not enough floor in view to tell: no floor"),
        ),
        (MEASURED, True, (OK, None, "ok")),
        (
            replace(MEASURED, moved=True),
            True,
            (
                WARN,
                Code.HEAD_MOVED,
                "the head has moved: by the floor height 1.20 m; configured: height 1.00 m; "
                "run `mrs calibrate --robot robot_a`",
            ),
        ),
        (
            replace(CONFIGURED, moved=True),
            True,
            (
                WARN,
                Code.HEAD_MOVED,
                "the head has moved: by the floor where it was last seen; configured: "
                "height 1.00 m; run `mrs calibrate --robot robot_a`",
            ),
        ),
    ],
)
def test_mounting(state, watched, wanted):
    assert verdict(of_mounting(state, watched=watched)) == wanted


def test_mounting_is_published_as_configured_and_as_measured():
    assert of_mounting(CONFIGURED).values == {"configured": "height 1.00 m"}
    assert of_mounting(MEASURED).values == {
        "configured": "height 1.00 m", "by_the_floor": "height 1.20 m", "floor_part": "0.25",
    }  # fmt: skip


@pytest.mark.parametrize(
    ("silent_s", "ahead_s", "wanted"),
    [
        (0.1, -0.2, (OK, None, "ok")),
        (9.0, -0.2, (STALE, Code.SCAN_SILENT, "no scan for 9 s")),
        (9.0, -9.0, (STALE, Code.SCAN_SILENT, "no scan for 9 s")),
        (0.1, -9.0, (WARN, Code.STAMPS_OFF, "stamps are 9.0 s behind this machine's clock; so")),
        (0.1, 9.0, (WARN, Code.STAMPS_OFF, "stamps are 9.0 s ahead of this machine's clock; so")),
    ],
)
def test_age_of_a_scan_is_not_a_clock_offset(silent_s, ahead_s, wanted):
    finding = of_scan(ScanState(7, silent_s, ahead_s, "; so", {"cells": 3}))
    assert verdict(finding) == wanted
    assert finding.values == {"frames": 7, "cells": 3}


def test_no_scan_yet():
    assert of_scan(ScanState(0)) == Finding(
        "scan", STALE, "no scan yet", {"frames": 0}, Code.NO_SCAN
    )


def test_pose():
    none = PoseState("odom")
    assert verdict(of_pose(none)) == (ERROR, Code.NO_POSE, "no usable pose on odom yet")
    known = replace(none, pose=(1.0, -2.0, 0.5))
    assert of_pose(known) == Finding("pose", values={"x": "1.000", "y": "-2.000", "yaw": "0.500"})
    assert verdict(of_pose(replace(known, error="TF has no map"))) == (
        ERROR, Code.NO_POSE, "TF has no map",
    )  # fmt: skip
    assert of_pose(replace(known, silent_s=2.0, frames="map -> a")).code is None
    assert verdict(of_pose(replace(known, silent_s=2.6, frames="map -> a"))) == (
        ERROR, Code.NO_POSE, "TF has nothing new of map -> a for 3 s",
    )  # fmt: skip

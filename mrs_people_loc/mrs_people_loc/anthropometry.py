"""Sizes of people, and how near to each other two people are told apart: each number once [m].

Measures of the body are of British adults aged 19 to 65, unclothed (S. Pheasant, Bodyspace, 2nd
ed., 1996, table 10.1). The two errors below were fitted on the training half of the suite: with
larger ones two people who touch are one, with smaller ones two estimates of one person are two.

What clusters of cells measure is another quantity, since depth noise smears them along the line of
sight: `human.*` and `splitting.max_width` in the configuration.
"""

from __future__ import annotations

from typing import Final

#: Depth of the chest: median of men and of women.
CHEST_DEPTH: Final = 0.25
#: Breadth of the hips, which are as wide as the trunk gets: median of men (women: 0.37).
HIP_BREADTH: Final = 0.36
#: Breadth of the shoulders with the arms: 95th percentile of men (median 0.465, women 0.395).
SHOULDER_BREADTH: Final = 0.51
#: Stature that hardly anybody exceeds: mean of men, 1.74, and three standard deviations of 0.07.
TALLEST: Final = 1.95
#: The visible surface of one person, arms and legs included, is within this of its middle along
#: the line of sight. Chosen: from half a chest's depth to half the shoulders' breadth is possible.
SURFACE_DEPTH: Final = 0.22

#: Distance of the axes of two standing people, at least: chest to back.
CLOSEST: Final = CHEST_DEPTH

#: An estimate errs by about this across the line of sight: one cell, or one column of a patch.
ACROSS_ERROR: Final = 0.05
#: From the surface that is seen to the axis of the body, an estimate without the fitted model errs
#: by this (standard deviation), along and across the line of sight.
AXIS_ERROR: Final = 0.06

#: Two estimates nearer than this across the line of sight, or an estimate this near to a predicted
#: place, are of one person.
APART_ACROSS: Final = CLOSEST + ACROSS_ERROR
#: Likewise two estimates of one robot in one view, or places that are each the mean of what several
#: robots saw (`joining.apart`), in any direction.
APART: Final = APART_ACROSS + AXIS_ERROR
#: Likewise single estimates of two robots, where their poses are compared: each errs across its
#: line of sight.
APART_AMONG_ROBOTS: Final = APART_ACROSS + ACROSS_ERROR

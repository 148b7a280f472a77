"""Figures that the paper prints (section 6), which ours are compared with."""

from __future__ import annotations

#: Clusters by what the size test says of them, in the order of the table; the paper's numbers.
PAPER_CLUSTERS = {"person": 5, "false_person": 0, "too_low": 1, "too_small": 1, "too_large": 0}
#: People in the robots' views, by the paper (section 4.1; all: section 6.4).
PAPER_SEEN = {"robot_b": 4, "robot_c": 4}
#: Points that the stages remove of a view of Ra, at least (section 6.2).
PAPER_REMOVED = {"robot_a": 15000}
#: The paper's mean error [m].
PAPER_ERROR_M = 0.05
#: What the paper keeps of each stage (section 6).
PAPER_KEPT = {"zones": 0.15, "noise": 0.73, "cells": 0.07}
#: Its stages: what they leave, as the scores of either method name it.
PAPER_STAGES = {"zones": "cropped", "noise": "foreground", "cells": "cells"}

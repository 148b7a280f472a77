"""What stereo matching errs by, in pixels of disparity: one fact, and what follows from it.

Not in `sensing.disparity`, since planner and configuration, which match nothing, use it, too.
"""

from __future__ import annotations

from typing import Final

#: Standard deviation of the disparity of one pixel [px]. Pixels of the chests of bodies beyond 3 m,
#: against their medians: 0.21 px over four bags (two shipped, two of the suite), each 0.10 to 0.30.
PIXEL_SIGMA_PX: Final = 0.25

#: Pixels of one body are no farther from its disparity, apart from what its depth makes [px]: of
#: those chests' pixels 95 % are within it. The factor was fitted on the training half of the suite.
BODY_TOLERANCE_PX: Final = 1.8 * PIXEL_SIGMA_PX
#: Standard deviation of the disparity of a whole body, its surface's shape included [px]; fitted
#: likewise. Pixels of a body err alike, so that many of them are no surer than a few.
BODY_SIGMA_PX: Final = 1.2 * PIXEL_SIGMA_PX
#: Pixels of a plane are no farther from it [px]; while the plane is refined, ever less.
PLANE_TOLERANCES_PX: Final = (1.6 * PIXEL_SIGMA_PX, 1.2 * PIXEL_SIGMA_PX, 0.8 * PIXEL_SIGMA_PX)

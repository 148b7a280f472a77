"""Numbers of the method's definition that are no parameters, with their units."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

# --- cells -------------------------------------------------------------------------------------

#: Columns are followed up in bins of this height [m], so many above the zone.
COLUMN_BIN_M, COLUMN_BINS = 0.05, 60
#: What float32 does to two cell centres that are exactly the clustering distance apart [m].
FLOAT32_ROUNDING_M = 1e-5

# --- search ------------------------------------------------------------------------------------

#: Heights that count [m].
LOWEST_M, HIGHEST_M = 0.25, 1.95
#: Width of a bin of inverse range [px].
SEARCH_BIN_PX = 0.25
#: Pixels whose ray is steeper (its horizontal part per metre of depth) do not count.
LEAST_LEVEL = 0.35
#: Half of a body's width; two candidates are at least so far apart [m].
HALF_WIDTH_M, CANDIDATES_APART_M = 0.18, 0.30
#: What matching errs by [px]; what a body is deep [m]: 0.22 m is what one disparity spreads over.
MATCHING_ERROR_PX, BODY_DEPTH_M = 0.45, 0.22
#: Of the tolerance that this makes, the search takes this share to each side.
SEARCH_SHARE = 0.8

# --- patches -----------------------------------------------------------------------------------

#: Samples of a patch, over the floor and to the left of its middle [m].
HEIGHTS: NDArray[np.float32] = np.array([0.1 + 0.075 * k for k in range(30)], dtype=np.float32)
ACROSS: NDArray[np.float32] = np.array([0.05 * (k - 14) for k in range(29)], dtype=np.float32)
#: Rows of a body, and those that go out as cells; columns of its trunk and of its silhouette.
BODY_ROWS = [k for k, z in enumerate(HEIGHTS) if 0.3 < z < 1.95]
ZONE_ROWS = [k for k, z in enumerate(HEIGHTS) if 0.2 < z < 1.95]
TRUNK = [k for k, left in enumerate(ACROSS) if abs(left) < 0.28]
SILHOUETTE = [k for k, left in enumerate(ACROSS) if abs(left) < 0.33]
#: The sample whose disparity is a patch's own.
MIDDLE = 15, 14
#: A patch is centred so often, by no more than this each time [m], [px].
CENTRINGS, MOST_ASIDE_M, MOST_NEARER_PX = 2, 0.12, 0.6
#: While it is centred, this many tolerances are near.
WIDE = 1.5

# --- votes -------------------------------------------------------------------------------------

BLUR_PX, ITERATIONS, RIDGE = 0.7, 3, 1e-2
#: A vote moves a body by no more than this in all, and in one iteration [px].
FARTHEST_PX, MOST_PER_ITERATION_PX = 1.2, 0.5
#: Gains between the cameras that are believed.
GAINS = 0.3, 3.0
#: Where the background is looked for [px], for a body no deeper than what matching errs by.
BEHIND_PX = 0.8, 1.5, 2.4, 3.6
#: Least variance of grey levels, least texture, cost that says nothing [grey levels].
LEAST_VARIANCE, LEAST_TEXTURE, NOISE_LEVELS = 1.0, 1e-3, 4.0

# --- evidence ----------------------------------------------------------------------------------

#: Bands of height, stripes of distance from the middle, slices whose centroids are compared [m].
BANDS = (0.1, 0.5), (0.5, 0.9), (0.9, 1.25), (1.25, 1.5), (1.5, 1.75), (1.75, 2.0), (2.0, 2.4)
STRIPES = (0.0, 0.14), (0.14, 0.28), (0.34, 0.49), (0.49, 0.71)
SLICES = (0.3, 0.65), (0.6, 0.95), (0.9, 1.25), (1.2, 1.55), (1.4, 1.75), (1.6, 1.95)
#: Quantiles of a body's differences, and from where up its upper half begins [m].
SHARES, UPPER_M = (0.1, 0.25, 0.5, 0.75, 0.9), 1.0
#: Added to the columns' variance before it divides [m^2].
MOMENT = 1e-3
#: The steepest slope across a body [m/m], and the largest sigma of a vote [px], that count.
STEEPEST, LARGEST_VOTE_SIGMA_PX = 3.0, 0.5
#: Ranges beyond each of which what is further counts once more [m].
KNOTS = 2.0, 3.0, 4.0

# --- appearance --------------------------------------------------------------------------------

#: Images are reduced to this focal length [px]; sides of the network's image are a multiple of the
#: second; side of the square around [px]; added to standard deviations.
MAP_FOCAL_PX, SIDE_MULTIPLE, SQUARE_PX, LEAST_DEVIATION = 140.0, 32, 17, 0.5
#: Side of a cell [px].
CELL_PX = 4
#: Rows and columns of a window; its lower and upper edge and half of its width [m]; the pixels of a
#: metre whose logarithm is told as 0.
WINDOW_SHAPE, WINDOW_LOW_M, WINDOW_HIGH_M, WINDOW_HALF_M = (12, 6), -0.1, 2.1, 0.55
WINDOW_SIZE_PX = 60.0
#: What has less by the human test is nobody [log-odds]; the human test counts within these; from
#: there to the last one, what the network says against a person counts less and less.
RULED_OUT, LEAST_HUMAN, MOST_HUMAN, SURE_SHAPE = -8.0, -3.0, 4.0, 5.0

# --- bodies ------------------------------------------------------------------------------------

#: Without the fitted model: standard deviations along the line of sight [m], [px], and across [m].
SIGMA_M, SIGMA_PX, SIGMA_ACROSS_M = 0.06, 0.3, 0.06
#: No range is surer than this [m].
LEAST_SIGMA_RANGE_M = 0.04
#: Nobody is farther than so many times the range in which bodies are sought.
FARTHEST_RANGES = 1.5
#: Two bodies of one view are no closer across and in all [m].
APART_ACROSS_M, APART_M = 0.30, 0.36
#: Two who have more log-odds than this, and together more than one between them, take its place.
SURE_SCORE = 2.0
#: Tops: the trunk's columns, the first row that may be one, the share of a row that must be of the
#: body, and rows without a body that end it.
TOP_COLUMNS = [k for k, left in enumerate(ACROSS) if abs(left) < 0.13]
TOP_FROM, TOP_SHARE, TOP_GAP = 10, 0.4, 3

# --- map ---------------------------------------------------------------------------------------

#: Standard deviations of places that count [m].
LEAST_SIGMA_M, LARGEST_SIGMA_M = 0.01, 100.0
#: Of a plain cell, across the line of sight [m].
CELL_SIGMA_ACROSS_M = 0.03
#: Robots are looked for within so many sigmas and no farther along and across the sight [m].
ROBOT_SIGMAS, REACH_ALONG_M, REACH_ACROSS_M = 2.5, 0.8, 0.4
#: Beyond its radius what is likelier a person than this [log-odds] is no robot.
CLEARLY_A_PERSON = 5.0
#: What is unknown and so near to something occupied is its inside; nearer is beside it [m].
INSIDE_M, BESIDE_M = 0.5, 0.6
#: A wall's cells are looked for no farther along the line of sight [m].
WALL_REACH_M = 0.3
#: Places about one, in sigmas along each axis; no share of them is smaller than this.
DRAWS = [-2.4 + 0.6 * k for k in range(9)]
TINY_SHARE = 1e-9

# --- people ------------------------------------------------------------------------------------

#: More people than this in one cluster are not told apart; so many rounds of k-means.
MOST_PARTS, ROUNDS = 8, 8
#: Log-odds of a person found as plain cells.
PLAIN_SCORE = 6.0
#: One robot says no more against a person than this [log-odds].
LEAST_SCORE = -2.0
#: In a square of this side [m] so many bodies take part in the joining.
SQUARE_M, MOST_IN_SQUARE = 0.5, 100
#: Published standard deviations over those of the filter; what a head leads its trunk by [m], from
#: which speed on [m/s].
PUBLISHED, LEAD_M, LEAD_SPEED = 0.87, 0.05, 0.4

# --- places ------------------------------------------------------------------------------------

#: Log-odds that are lost per unit of ln(1 + T / tau), tau [s].
LOST_PER_LOG, LOST_TAU_S = 2.5, 0.5
#: A look of a person; so many are averaged, none counts for more; share of the present one.
SURE_LOOK, BEST_OF, LARGEST_LOOK, PRESENT_SHARE = 1.5, 3, 2.25, 0.5
#: A look beyond doubt; less counts from so many seconds on, and wholly from so many, where
#: something was seen that soon.
BEYOND_DOUBT, SOON_S, LONG_S, FIRST_S = 4.0, 5.0, 20.0, 2.0
#: Bodies within this distance [m] plus so many sigmas, but no more than this [m], are in one place.
PLACE_M, PLACE_SIGMAS, PLACE_MOST_M = 0.15, 1.5, 0.45
#: Places age by no more than this at once [s], and are forgotten after this [s]; so many are kept.
LONGEST_GAP_S, FORGET_S, MOST_PLACES = 0.5, 30.0, 1000

"""The people of a robot's own view, before whom it sees no wall."""

from __future__ import annotations

import numpy as np

from mrs_people_loc.arrays import Float
from mrs_people_loc.scan import Scan


def people_in(scan: Scan, *, least_score: float = 0.0) -> Float:
    """Middles of the bodies in a scan that are rather people than not, in base_link.

    Args:
        scan: The scan.
        least_score: Log-odds of a person, at least.

    Returns:
        As `walls.NOBODY`, sure; none where the scan has no bodies (the paper's method).
    """
    cells = scan.cells
    people = (cells.body > 0) & (cells.score >= least_score)
    _, of = np.unique(cells.body[people], return_inverse=True)
    counts = np.bincount(of)
    x, y = (np.bincount(of, weights=axis[people]) for axis in (cells.x, cells.y))
    return np.stack([x / counts, y / counts, np.zeros(len(counts))], axis=1)

"""How results are compared."""

from __future__ import annotations

from typing import Any

import numpy as np

from mrs_people_loc.errors import PeopleLocError

#: Sums in another order differ by rounding.
TOLERANCE = 1e-9


class DiffersError(PeopleLocError):
    """A result differs from what it should be."""


def same(what: str, got: Any, wanted: Any) -> None:
    """Holds that two results are the same, NaN where NaN is.

    Raises:
        DiffersError: They are not.
    """
    if isinstance(wanted, np.ndarray):
        same = got.shape == wanted.shape and np.array_equal(
            got, wanted, equal_nan=wanted.dtype.kind == "f"
        )
    else:
        same = got == wanted
    if not same:
        raise DiffersError(f"{what} differs from the oracle: {_difference(got, wanted)}")


def near(what: str, got: Any, wanted: Any, tolerance: float = TOLERANCE) -> None:
    """Holds that two results differ by no more than a tolerance.

    Raises:
        DiffersError: They do.
    """
    got, wanted = np.asarray(got, dtype=np.float64), np.asarray(wanted, dtype=np.float64)
    if got.size == wanted.size == 0:
        return
    if got.shape != wanted.shape or not (np.abs(got - wanted) <= tolerance).all():
        raise DiffersError(f"{what} differs from the oracle: {_difference(got, wanted)}")


def _difference(got: Any, wanted: Any) -> str:
    """Where two results differ first, in a few words."""
    if np.shape(got) != np.shape(wanted):
        return f"shape {np.shape(got)}; wanted: {np.shape(wanted)}"
    if not np.shape(wanted) or isinstance(wanted, tuple):
        return f"{got}; wanted: {wanted}"
    got, wanted = np.asarray(got), np.asarray(wanted)
    differ = got != wanted
    if got.dtype.kind == "f":
        differ &= ~(np.isnan(got) & np.isnan(wanted))
    first = tuple(int(i) for i in np.argwhere(differ)[0])
    return (
        f"{np.count_nonzero(differ)} of {differ.size} values, the first at {first}: "
        f"{got[first]}; wanted: {wanted[first]}"
    )

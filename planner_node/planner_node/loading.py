"""Loads what the method uses of SciPy while a node starts."""

import threading


def load_scipy() -> None:
    """Begins to load it; it takes as long as all else before the start.

    The method would load it itself with the first people or path, and that would be late.
    """
    threading.Thread(target=_load, name="load").start()


def _load() -> None:
    import scipy.optimize
    import scipy.sparse.csgraph
    import scipy.spatial  # noqa: F401

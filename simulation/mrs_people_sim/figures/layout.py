"""Size of figures, and the legend below them."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

#: Width of one panel [inch], and resolution.
_PANEL, DPI = 4.4, 110


def new_figure(rows: int, columns: int, aspect: float, panel: float = _PANEL) -> Figure:
    """A figure for panels that are `panel` inches wide and `aspect` times as high."""
    from matplotlib.figure import Figure

    size = (panel * columns + 1.0, panel * aspect * rows + 0.4)
    return Figure(figsize=size, dpi=DPI, layout="constrained")


def legend_below(figure: Figure, axes: Axes) -> None:
    """Puts the labels of one panel below the figure, if it has any."""
    handles, labels = axes.get_legend_handles_labels()
    if handles:
        figure.legend(handles, labels, loc="outside lower center", ncols=4, frameon=False)

"""How every figure of a report looks: the same colour for the same thing, one small panel a joint."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from typing import TYPE_CHECKING

import numpy as np

from ident.arrays import FloatArray

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

MEASURED = "#2b8cc4"
PREDICTED = "#e0662a"
RESIDUAL = "#1a9e77"
FURTHER = ("#9a6fc0", "#c9a227", "#d15a8c", "#7d8791")
"""Colours of what is neither measured, predicted nor their difference, in this order."""
INK = "#1f2a33"
"""Colour of text and axes; the report shows it in the colour of its own text, light or dark."""
FAINT = "#d3dae0"
"""Colour of grid lines; the report shows it in the colour of its own rules."""

_SETTINGS = {
    "axes.axisbelow": True,
    "axes.edgecolor": INK,
    "axes.facecolor": "none",
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.labelsize": 9,
    "axes.linewidth": 0.6,
    "axes.prop_cycle": f"cycler('color', {[MEASURED, PREDICTED, RESIDUAL, *FURTHER]})",
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlelocation": "left",
    "axes.titlesize": 9,
    "axes.titleweight": "bold",
    "figure.facecolor": "none",
    "font.family": "sans-serif",
    "font.size": 9,
    "grid.color": FAINT,
    "grid.linewidth": 0.6,
    "legend.fontsize": 9,
    "legend.frameon": False,
    "lines.linewidth": 1.1,
    "lines.markersize": 3,
    "savefig.facecolor": "none",
    "svg.fonttype": "none",
    "text.color": INK,
    "xtick.color": INK,
    "xtick.labelsize": 8,
    "ytick.color": INK,
    "ytick.labelsize": 8,
}


@contextmanager
def report_style() -> Iterator[None]:
    """Use the settings of a report's figures in the block, and only there."""
    import matplotlib

    with matplotlib.rc_context(_SETTINGS):
        yield


def joint_grid(
    joints: Sequence[str], xlabel: str, ylabel: str, *, columns: int = 2, height: float = 1.7, share_y: bool = False
) -> tuple[Figure, list[Axes]]:
    """Make a figure with one panel a joint, all with the same horizontal axis.

    Args:
        joints: names of the joints; panels are titled "Joint 1", "Joint 2" ... and the name.
        xlabel, ylabel: what the axes show, with the unit in brackets.
        columns: panels in a row.
        height: of a panel [inch]; the figure is 9 inch wide.
        share_y: whether all panels have the same vertical axis too.

    Returns:
        The figure and its axes, one a joint.
    """
    columns = min(columns, len(joints))
    rows = -(-len(joints) // columns)
    with report_style():
        figure = new_figure(9.0, height * rows + 0.5)
        grid = figure.subplots(rows, columns, sharex=True, sharey=share_y, squeeze=False)
        axes: list[Axes] = list(grid.flat)
        for number, (axis, name) in enumerate(zip(axes, joints, strict=False), start=1):
            axis.set_title(f"Joint {number}" if name in ("", str(number)) else f"Joint {number}: {name}")
        for axis in axes[len(joints) :]:
            axis.remove()
        for k in range(columns):
            # The lowest panel of each column carries the shared axis, also where the last row is not full.
            lowest = axes[max(j for j in range(k, len(joints), columns))]
            lowest.tick_params(labelbottom=True)
            lowest.set_xlabel(xlabel)
        for axis in axes[: len(joints) : columns]:
            axis.set_ylabel(ylabel)
    return figure, axes[: len(joints)]


def new_figure(width: float = 9.0, height: float = 3.5) -> Figure:
    """Make an empty figure of a size [inch] that arranges itself; no global state of pyplot is touched.

    Args:
        width, height: of the figure [inch].
    """
    from matplotlib.figure import Figure

    with report_style():
        return Figure(figsize=(width, height), layout="constrained")


def legend_above(figure: Figure, axis: Axes) -> None:
    """Put one legend for all panels above them, with the lines of one of them.

    Args:
        figure: with several panels.
        axis: whose lines are named.
    """
    handles, labels = axis.get_legend_handles_labels()
    with report_style():
        figure.legend(handles, labels, loc="outside upper right", ncols=len(labels))


def thin(t: FloatArray, y: FloatArray, points: int = 4000) -> tuple[FloatArray, FloatArray]:
    """Reduce a long signal to what a plot can show, keeping its peaks: the least and greatest of each stretch.

    Args:
        t: time, (N,).
        y: values, (N,); NaN where there is none.
        points: about how many to keep.

    Returns:
        Times and values kept, in order; those given where they are few enough.
    """
    stretches = max(points // 2, 1)
    if len(t) <= 2 * stretches:
        return t, y
    size = -(-len(t) // stretches)
    whole = len(t) // size * size
    pieces = np.reshape(y[:whole], (-1, size))
    low = np.argmin(np.where(np.isnan(pieces), np.inf, pieces), axis=1)
    high = np.argmax(np.where(np.isnan(pieces), -np.inf, pieces), axis=1)
    first = np.arange(0, whole, size)
    rows = np.unique(np.concatenate([first + low, first + high, np.arange(whole, len(t))]))
    return t[rows], y[rows]

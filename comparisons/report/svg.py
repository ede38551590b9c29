"""A matplotlib figure as SVG that lives inside an HTML page and takes its colours."""

from __future__ import annotations

import io
import re
from typing import TYPE_CHECKING, Any

from comparisons.report.style import FAINT, INK, report_style

if TYPE_CHECKING:
    from matplotlib.figure import Figure

POINTS = 2500
"""An artist of more points than this is drawn as an image inside the figure: its paths would make the page heavy."""
DOTS_PER_INCH = 200


def inline_svg(figure: Figure, prefix: str) -> str:
    """Return a figure as an ``<svg>`` element.

    Text and axes in `style.INK` and grid lines in `style.FAINT` take the colours of the page. Artists of many points
    become images; the figure itself is left as it was.

    Args:
        figure: the figure.
        prefix: put before every id in it, so that those of two figures on a page differ.
    """
    import matplotlib

    heavy = [artist for axis in figure.axes for artist in axis.get_children() if _points(artist) > POINTS]
    buffer = io.StringIO()
    for artist in heavy:
        artist.set_rasterized(True)
    try:
        # The salt makes ids, and with them the page, the same for the same figure.
        with report_style(), matplotlib.rc_context({"svg.hashsalt": "sensorless"}):
            figure.savefig(buffer, format="svg", dpi=DOTS_PER_INCH, metadata={"Date": None, "Creator": None})
    finally:
        for artist in heavy:
            artist.set_rasterized(False)
    return _for_page(buffer.getvalue(), prefix)


def _points(artist: Any) -> int:
    """Count what would become path elements: vertices of a line, markers of a scatter, cells of a mesh."""
    for getter in ("get_xdata", "get_offsets", "get_array"):
        values = getattr(artist, getter, lambda: None)()
        if values is not None and len(values) > 1:
            return int(getattr(values, "size", len(values)))
    return 0


def _for_page(svg: str, prefix: str) -> str:
    svg = svg[svg.index("<svg") :]
    # Width and height are the page's business; the view box keeps the proportions.
    svg = re.sub(r'(<svg[^>]*?) (?:width|height)="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r'(<svg[^>]*?) (?:width|height)="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r'(\bid="|url\(#|href="#)', rf"\g<1>{prefix}-", svg)
    return svg.replace(INK, "currentColor").replace(FAINT, "var(--rule)")

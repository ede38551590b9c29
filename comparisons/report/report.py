"""A report: sections of text, tables and figures in one HTML file."""

from __future__ import annotations

import dataclasses
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from markupsafe import Markup, escape

from comparisons.report.provenance import Provenance
from comparisons.report.svg import inline_svg

if TYPE_CHECKING:
    from matplotlib.figure import Figure

TEMPLATE = "report.html"
NOTHING = "–"
"""Shown where a table has no value."""


@dataclass(frozen=True)
class Cell:
    """A table cell: what it shows, the number that sorts its column, if it is one, and whether it stands out.

    Attributes:
        text: what it shows.
        number: by which its column is sorted, None for words.
        strong: whether it stands out.
    """

    text: str
    number: float | None
    strong: bool = False


@dataclass
class Section:
    """A titled part of a report; ``blocks`` are (kind, content) in the order they were added.

    Attributes:
        title: the heading.
        anchor: to which links point.
        blocks: what it holds.
    """

    title: str
    anchor: str
    blocks: list[tuple[str, dict[str, Any]]] = field(default_factory=list)


class Report:
    """Collects the parts of a report and writes them as one HTML file that needs nothing else to open.

    ::

        report = Report("Identification of vs060")
        report.section("Fit").text("Trained on `a.csv`.")
        report.table(["joint", "RMSE [A]"], [[1, 0.031], [2, 0.044]], "Error on the test logs")
        report.figure(figure, "Measured against predicted current")
        report.write(Path("out/report.html"))

    Args:
        title: of the page.
        summary: a sentence or two under the title: the result.
    """

    def __init__(self, title: str, summary: str = "") -> None:
        self.title = title
        self.summary = summary
        self._sections: list[Section] = []
        self._provenance: Provenance | None = None
        self._figures = 0

    def section(self, title: str) -> Report:
        """Begin a section; what is added next belongs to it."""
        self._sections.append(Section(title, f"section-{len(self._sections) + 1}"))
        return self

    def text(self, text: str) -> Report:
        """Add text. Nothing in it is read as HTML; an empty line parts paragraphs, `` `code` `` is set as code."""
        paragraphs = [_inline(part) for part in re.split(r"\n\s*\n", text.strip())]
        return self._add("text", {"paragraphs": paragraphs})

    def table(self, columns: Sequence[str], rows: Sequence[Sequence[Any]], caption: str = "") -> Report:
        """Add a table that sorts by a click on a column's title.

        Args:
            columns: their titles, with units in brackets.
            rows: cells; numbers are shown with four digits, None and NaN as a dash, what `strong` returns in bold.
            caption: what the table shows.

        Raises:
            ValueError: a row has not one cell a column.
        """
        cells = [[_cell(value) for value in row] for row in rows]
        for number, row in enumerate(cells, start=1):
            if len(row) != len(columns):
                raise ValueError(f"row {number} has {len(row)} cells where there are {len(columns)} columns")
        numeric = [
            all(row[k].number is not None or row[k].text == NOTHING for row in cells) for k in range(len(columns))
        ]
        content = {"columns": list(zip(columns, numeric, strict=True)), "rows": cells, "caption": _inline(caption)}
        return self._add("table", content)

    def figure(self, figure: Figure, caption: str = "") -> Report:
        """Add a matplotlib figure, best made with the helpers of `comparisons.report.style`."""
        self._figures += 1
        svg = Markup(inline_svg(figure, f"f{self._figures}"))
        return self._add("figure", {"svg": svg, "caption": _inline(caption), "number": self._figures})

    def provenance(self, provenance: Provenance) -> Report:
        """Set what the last section says: command line, date, versions, seed and inputs."""
        self._provenance = provenance
        return self

    def write(self, path: Path) -> None:
        """Write the page."""
        from jinja2 import Environment, FileSystemLoader, StrictUndefined

        environment = Environment(
            loader=FileSystemLoader(Path(__file__).parent),
            autoescape=True,
            undefined=StrictUndefined,
            trim_blocks=True,
            lstrip_blocks=True,
        )
        page = environment.get_template(TEMPLATE).render(
            title=self.title, summary=_inline(self.summary), sections=self._sections, provenance=self._provenance
        )
        path.write_text(page, encoding="utf-8")

    def _add(self, kind: str, content: dict[str, Any]) -> Report:
        if not self._sections:
            raise ValueError("begin a section first")
        self._sections[-1].blocks.append((kind, content))
        return self


def _inline(text: str) -> Markup:
    """Escape text and set what stands in backticks as code."""
    return Markup(re.sub(r"`([^`]+)`", r"<code>\1</code>", str(escape(text))))


def strong(value: Any) -> Cell:
    """Return a value as a cell of a table that stands out from the others of its column.

    Args:
        value: number or text.
    """
    return dataclasses.replace(_cell(value), strong=True)


def _cell(value: Any) -> Cell:
    if isinstance(value, Cell):
        return value
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return Cell(NOTHING, None)
    if isinstance(value, bool):
        return Cell("yes" if value else "no", None)
    if isinstance(value, int):
        return Cell(str(value), float(value))
    if isinstance(value, float):
        # A true minus sign is as wide as a digit, so that columns stay aligned.
        return Cell(f"{value:#.4g}".rstrip(".").replace("-", "−"), value)
    return Cell(str(value), None)

"""The gap workflow: find where simulation and measurement disagree, name what is missing, add it, show the gap shrink.

::

    from ident.gap import baseline_model, find_gap
    model = baseline_model(robot, train)
    report = find_gap(model, train, test)
    report.findings, report.model
"""

from ident.gap.baseline import baseline_model
from ident.gap.report import Finding, GapReport, Unexplained
from ident.gap.workflow import find_gap

__all__ = ["Finding", "GapReport", "Unexplained", "baseline_model", "find_gap"]

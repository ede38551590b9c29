"""Reports: one HTML file that opens offline, with its plots inside."""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from comparisons.report.report import Report

__all__ = ["Report"]


def __getattr__(name: str) -> Any:
    if name == "Report":
        from comparisons.report.report import Report

        return Report
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")

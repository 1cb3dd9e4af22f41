"""Report of a run as a page, and optionally as a picture."""

from hil_bridge.show.report.page import write_report

__all__ = ["write_report"]

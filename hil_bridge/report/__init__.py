"""The report of a run as a picture and a page."""

from hil_bridge.report.page import write_report

__all__ = ["write_report"]

"""Report of a run as a page, and optionally as a picture."""

from hil_bridge.show.report.page import cell_page, write_report

__all__ = ["cell_page", "write_report"]

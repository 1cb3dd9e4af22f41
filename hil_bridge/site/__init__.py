"""Tools for the first hours at a real cell: find a link's settings, check the computer, watch a link."""

from hil_bridge.site.prober import Prober, Said
from hil_bridge.site.search import Finding, Outcome, Query, Reply, Search, Try, likely_lines

__all__ = ["Finding", "Outcome", "Prober", "Query", "Reply", "Said", "Search", "Try", "likely_lines"]

"""Tools for the first hours at an S3 link: find its settings, watch it, capture it."""

from hil_bridge.device_commands.s3.prober import Prober, Said
from hil_bridge.device_commands.s3.search import Finding, Outcome, Query, Reply, Search, Try, likely_lines

__all__ = ["Finding", "Outcome", "Prober", "Query", "Reply", "Said", "Search", "Try", "likely_lines"]

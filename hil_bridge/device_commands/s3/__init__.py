"""Tools for the commissioning of an S3 link: detect its settings, monitor it, capture it."""

from hil_bridge.device_commands.s3.prober import Prober, UnsolicitedMessage
from hil_bridge.device_commands.s3.search import Finding, Outcome, Query, Reply, Search, Try, likely_lines

__all__ = [
    "Finding",
    "Outcome",
    "Prober",
    "Query",
    "Reply",
    "Search",
    "Try",
    "UnsolicitedMessage",
    "likely_lines",
]

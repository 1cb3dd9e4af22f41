"""Faults of emulated devices: the words for them, and the ledger of those that were injected.

Facts of one device stand with that device; `emulators.cell_faults` collects them.
"""

from emulators.faults.kinds import FOREVER, Fault, FaultNews, Parameter, describe_faults
from emulators.faults.ledger import Handler, Injection, Ledger, find, target_of

__all__ = [
    "FOREVER",
    "Fault",
    "FaultNews",
    "Handler",
    "Injection",
    "Ledger",
    "Parameter",
    "describe_faults",
    "find",
    "target_of",
]

"""Faults of emulated devices: their definitions, and the ledger of injected faults.

The faults of a device are defined in the package of the device.
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

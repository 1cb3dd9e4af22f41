"""Stages of an injected fault, used by the emulators, which implement the fault, and by the recording, which
reports it.
"""

from enum import StrEnum


class FaultStage(StrEnum):
    """Stage of an injected fault."""

    BEGINS = "begins"
    HAPPENS = "happens"
    """The fault is instantaneous: it ends as soon as it begins."""
    ENDS = "ends"
    STRUCK = "struck"
    """The run has ended; the report gives the number of effects of the fault."""
    NEVER = "never"
    """The run has ended, and the phase or condition of the fault never occurred."""
    REFUSED = "refused"
    """The cell could not apply the fault when it was due."""
    BY_HAND = "by hand"
    """An operator changed the device at its panel."""

"""Words for an injected fault that the emulators, which have it, and the record, which tells of it, share."""

from enum import StrEnum


class FaultStage(StrEnum):
    """Stage of an injected fault."""

    BEGINS = "begins"
    HAPPENS = "happens"
    """It is over in the moment in which it begins."""
    ENDS = "ends"
    STRUCK = "struck"
    """The run is over; the fault had this many effects."""
    NEVER = "never"
    """The run is over, and its phase or condition never came."""
    REFUSED = "refused"
    """The cell could not have it when its moment came."""
    BY_HAND = "by hand"
    """An operator changed the device at its panel."""

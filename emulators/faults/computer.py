"""Definitions of the faults of the computer that runs the bridge. The bridge carries them out."""

from collections.abc import Mapping

from emulators.faults.kinds import Fault, Parameter

COMPUTER_FAULTS: Mapping[str, Fault] = {
    "pause": Fault("the bridge's process is paused", {"seconds": Parameter(0.5, "duration", 0.0, 60.0, "s")})
}

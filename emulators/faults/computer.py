"""Words for the faults of the bridge's own computer; the bridge carries them out."""

from collections.abc import Mapping

from emulators.faults.kinds import Fault, Parameter

COMPUTER_FAULTS: Mapping[str, Fault] = {
    "pause": Fault(
        "the bridge's process stands still", {"seconds": Parameter(0.5, "how long", 0.0, 60.0, "s")}
    )
}

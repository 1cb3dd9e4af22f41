"""Run the tests marked `driver`: Linux's own jr3_pci driver on the emulated receiver board, inside a virtual machine.

Exit code: pytest's; 77 when they could not run here, after one line that says how to get them; with
HIL_BRIDGE_REQUIRE_VCAN set that is an error, 1. What else is on the command line is handed to pytest.
"""

import signal
import sys
from collections.abc import Sequence

from kernel_machine import CACHE, Unavailable, in_machine, pytest_command, skipped, unpacked_kernel

PART = "driver"
"""Folder of the tests, and their mark."""
TESTS = "tests of the kernel's JR3 driver"
MODULE = "jr3_pci"
PATIENCE_S = 400.0
"""Chosen: four times what it takes emulated."""


class NoDriver(Unavailable):
    """The kernel's package lacks the driver."""


def check() -> None:
    """Raise NoDriver for a kernel without the driver, Unavailable if there is no kernel."""
    unpacked_kernel()
    if not any(CACHE.glob(f"lib/modules/**/{MODULE}.ko*")):
        raise NoDriver(f"the package of the kernel has no module {MODULE}")


def run(arguments: Sequence[str]) -> int:
    """Run them in a machine of their own, and return an exit code."""
    try:
        check()
        return in_machine(pytest_command([PART], arguments), {}, PATIENCE_S)
    except Unavailable as error:
        return skipped(TESTS, error)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))  # so that no machine stays behind
    sys.exit(run(sys.argv[1:]))

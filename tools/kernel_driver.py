"""Run the tests marked `driver`: Linux's own jr3_pci driver on the emulated receiver board, inside a virtual
machine.

The exit code is pytest's. If the tests cannot run here, it is 77, after one line that states what is missing; with
HIL_BRIDGE_REQUIRE_VCAN set, that is an error with exit code 1. Further arguments are passed to pytest.
"""

import signal
import sys
from collections.abc import Sequence

from kernel_machine import CACHE, Unavailable, in_machine, pytest_command, skipped, unpack_kernel

PART = "driver"
"""Folder of the tests, and also their mark."""
TESTS = "tests of the kernel's JR3 driver"
MODULE = "jr3_pci"
PATIENCE_S = 400.0
"""Time limit of the tests, s. Chosen: four times the duration on an emulated computer."""


class NoDriver(Unavailable):
    """Error that the kernel's package does not contain the driver."""


def check() -> None:
    """Raise NoDriver if the kernel does not have the driver, and Unavailable if there is no kernel."""
    unpack_kernel()
    if not any(CACHE.glob(f"lib/modules/**/{MODULE}.ko*")):
        raise NoDriver(f"the package of the kernel has no module {MODULE}")


def run(arguments: Sequence[str]) -> int:
    """Run the tests in a separate machine, and return an exit code."""
    try:
        check()
        return in_machine(pytest_command([PART], arguments), {}, PATIENCE_S)
    except Unavailable as error:
        return skipped(TESTS, error)


if __name__ == "__main__":
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))  # so that no machine remains
    sys.exit(run(sys.argv[1:]))

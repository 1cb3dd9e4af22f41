"""Run the tests marked `vcan`: on this kernel where it has vcan, else inside a small virtual machine.

With --driver the tests of the kernel's own driver run too, in the same machine where there is one. Exit code: pytest's;
77 when no tests could run here, after a line that says how to get them; with HIL_BRIDGE_REQUIRE_VCAN set that is an
error, 1. What else is on the command line is handed to pytest.
"""

import argparse
import os
import signal
import subprocess
import sys
from collections.abc import Sequence

import kernel_driver
from kernel_machine import (
    REQUIRE,
    ROOT,
    SKIPPED,
    Unavailable,
    in_machine,
    pytest_command,
    skipped,
    which,
)

SECONDS = "HIL_BRIDGE_VCAN_SECONDS"
PATIENCE_S = 600.0
"""Longest wait for everything beside the fast stream. Chosen: four times what it takes emulated."""
STREAM_PATIENCE = 20.0
"""And for each second of that. Chosen: four times what it takes emulated."""


def direct() -> list[str] | None:
    """Prefix of a command that may then create vcan interfaces, or None where that cannot be."""
    ip = which("ip")
    if ip is None:
        return None
    unshare = which("unshare")
    # a user may do it in a network namespace of its own, where the kernel lets users have one
    for before in ([], [unshare, "--user", "--map-root-user", "--net"] if unshare else []):
        name = f"vcan{os.getpid()}"
        script = f"{ip} link add dev {name} type vcan && {ip} link delete dev {name}"
        if subprocess.run([*before, "sh", "-c", script], capture_output=True, check=False).returncode == 0:
            return before
    return None


def inside(arguments: Sequence[str], seconds: float, driver: bool) -> int:
    """Run the tests in a machine, with those of the driver if asked for, and return an exit code."""
    parts, limit = ["vcan"], PATIENCE_S + STREAM_PATIENCE * seconds
    codes = []
    try:
        if driver:
            try:
                kernel_driver.check()
                parts.append(kernel_driver.PART)
                limit += kernel_driver.PATIENCE_S
            except kernel_driver.NoDriver as error:
                codes.append(skipped(kernel_driver.TESTS, error))
        codes.append(in_machine(pytest_command(parts, arguments), {SECONDS: f"{seconds:g}"}, limit))
    except Unavailable as error:
        what = f"vcan tests and {kernel_driver.TESTS}" if driver else "vcan tests"
        return skipped(what, f"this kernel gives no vcan (as root: `modprobe vcan`), and {error}")
    return together(codes)


def together(codes: Sequence[int]) -> int:
    """Return the exit code of several: the first failure, else 0 where any tests ran."""
    return next((code for code in codes if code not in (0, SKIPPED)), min(codes))


def main() -> int:
    """Run the tests where they can be run."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3.0, help="length of the 1 kHz stream (default: 3)")
    parser.add_argument("--driver", action="store_true", help="run the tests of the kernel's own driver too")
    options, arguments = parser.parse_known_args()
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))  # so that no machine stays behind
    if (before := direct()) is None:
        return inside(arguments, options.seconds, options.driver)
    environment = {**os.environ, SECONDS: f"{options.seconds:g}", REQUIRE: "1"}
    command = [*before, *pytest_command(["vcan"], arguments)]
    done = subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode
    return together([done, kernel_driver.run(arguments)]) if options.driver else done


if __name__ == "__main__":
    sys.exit(main())

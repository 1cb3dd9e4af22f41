"""Run the tests marked `vcan`: on this kernel if it has vcan, otherwise inside a small virtual machine.

With --driver, the tests of the kernel's own driver also run, in the same machine if one is used. The exit code is
pytest's. If no tests can run here, it is 77, after a line that states what is missing; with HIL_BRIDGE_REQUIRE_VCAN
set, that is an error with exit code 1. Further arguments are passed to pytest.
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
"""Time limit of all tests except the fast stream, s. Chosen: four times the duration on an emulated computer."""
STREAM_PATIENCE = 20.0
"""Additional time limit per second of the fast stream. Chosen: four times the duration on an emulated computer."""


def direct() -> list[str] | None:
    """Return the prefix for a command that creates vcan interfaces; None if they cannot be created here."""
    ip = which("ip")
    if ip is None:
        return None
    unshare = which("unshare")
    # a user can do this in a separate network namespace, if the kernel permits users to create one
    for before in ([], [unshare, "--user", "--map-root-user", "--net"] if unshare else []):
        name = f"vcan{os.getpid()}"
        script = f"{ip} link add dev {name} type vcan && {ip} link delete dev {name}"
        if subprocess.run([*before, "sh", "-c", script], capture_output=True, check=False).returncode == 0:
            return before
    return None


def run_in_machine(arguments: Sequence[str], seconds: float, driver: bool) -> int:
    """Run the tests in a machine, and those of the driver if requested. Return an exit code."""
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
    """Return the combined exit code: the first failure; without a failure, 0 if any tests ran."""
    return next((code for code in codes if code not in (0, SKIPPED)), min(codes))


def main() -> int:
    """Run the tests on this kernel or in a machine."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seconds", type=float, default=3.0, help="length of the 1 kHz stream (default: 3)")
    parser.add_argument("--driver", action="store_true", help="run the tests of the kernel's own driver too")
    options, arguments = parser.parse_known_args()
    signal.signal(signal.SIGTERM, lambda number, _: sys.exit(128 + number))  # so that no machine remains
    if (before := direct()) is None:
        return run_in_machine(arguments, options.seconds, options.driver)
    environment = {**os.environ, SECONDS: f"{options.seconds:g}", REQUIRE: "1"}
    command = [*before, *pytest_command(["vcan"], arguments)]
    done = subprocess.run(command, cwd=ROOT, env=environment, check=False).returncode
    return together([done, kernel_driver.run(arguments)]) if options.driver else done


if __name__ == "__main__":
    sys.exit(main())

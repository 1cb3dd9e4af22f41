"""Time limit of the virtual machine, which does not count the time for which other processes hold it back."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

from tools.kernel_machine import held_back_s

SPIN = "import os; os.sched_setaffinity(0, {min(os.sched_getaffinity(0))})\nwhile True: pass"


@pytest.mark.skipif(not Path("/proc/self/schedstat").exists(), reason="this kernel does not count waiting")
def test_held_back_grows_while_two_share_a_processor() -> None:
    groups = [subprocess.Popen([sys.executable, "-c", SPIN], process_group=0) for _ in range(2)]
    try:
        last = time.monotonic() + 60.0
        while (waited := held_back_s(groups[0].pid)) < 0.2 and time.monotonic() < last:
            time.sleep(0.05)
        assert 0.2 <= waited <= 60.0
    finally:
        for process in groups:
            os.killpg(process.pid, signal.SIGKILL)
            process.wait()


def test_held_back_is_zero_without_processes() -> None:
    done = subprocess.Popen([sys.executable, "-c", ""], process_group=0)
    done.wait()
    assert held_back_s(done.pid) == 0.0

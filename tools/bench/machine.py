"""Facts about the machine on which the figures are measured, and its C compiler."""

import os
import platform
import re
import shutil
import subprocess
import sys
from functools import cache
from importlib.metadata import version
from pathlib import Path

SOURCES = Path(__file__).parent / "c"
CACHE = Path(sys.prefix) / "cache" / "bench"
"""Folder in the environment, which is not under version control."""
NO_COMPILER = "there is no C compiler here (`cc`), so the baseline in C is missing"


def facts() -> dict[str, str]:
    """Return processor, operating system and versions, by name."""
    cpu = re.search(r"model name\s*:\s*(.+)", _text("/proc/cpuinfo"))
    flags = re.search(r"flags\s*:\s*(.+)", _text("/proc/cpuinfo"))
    virtual = flags is not None and "hypervisor" in flags[1].split()
    memory = re.search(r"MemTotal:\s*(\d+)", _text("/proc/meminfo"))
    names = ("numpy", "python-can", "pyserial", "mcap", "msgspec")
    return {
        "processor": (cpu[1].strip() if cpu else platform.machine())
        + (", virtual machine" if virtual else ""),
        "cores": str(len(os.sched_getaffinity(0))),
        "memory": f"{int(memory[1]) / 2**20:.0f} GiB" if memory else "",
        "kernel": f"{platform.system()} {'.'.join(platform.release().split('.')[:2])}",
        "Python": f"{platform.python_implementation()} {platform.python_version()}",
        "hil-bridge": version("hil-bridge"),
        **{name: version(name) for name in names},
    }


def load() -> float:
    """Return the load average of the last minute.

    Figures are worse on a busy machine.
    """
    return os.getloadavg()[0]


@cache
def compile_program(name: str) -> Path | None:
    """Compile the program `c/<name>.c`, unless it is up to date. Return None if there is no compiler."""
    source, program = SOURCES / f"{name}.c", CACHE / name
    compiler = shutil.which("cc")
    if compiler is None:
        return None
    if not program.exists() or program.stat().st_mtime < source.stat().st_mtime:
        CACHE.mkdir(parents=True, exist_ok=True)
        subprocess.run([compiler, "-O2", "-Wall", "-Wextra", "-o", program, source], check=True)
    return program


def _text(path: str) -> str:
    try:
        return Path(path).read_text(encoding="utf-8")
    except OSError:
        return ""


def stolen_s() -> float:
    """Return the processor time that the host has withheld from this virtual machine since its start, s.

    It is the sum over all processors; 0 if the host does not report it. Source: Linux, proc(5), "steal".
    """
    total = Path("/proc/stat").read_text(encoding="ascii").split("\n", 1)[0].split()
    return int(total[8]) / os.sysconf("SC_CLK_TCK")

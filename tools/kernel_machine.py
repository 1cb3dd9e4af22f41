"""Small virtual machine with a Debian kernel, for tests that this computer's kernel cannot run.

The kernel is unpacked from its package, not installed. The machine has read-only access to this computer's files.
It has a PCI device with plain memory, which can represent a board.
"""

import compileall
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path

ROOT = Path(__file__).resolve().parent.parent
BIN = Path(sys.executable).parent
OWN_PACKAGES = ("hil_bridge", "emulators", "protocol", "tools")
CACHE = Path(sys.prefix) / "cache" / "vcan-kernel"
"""Folder in the environment, which is not under version control."""

SKIPPED = 77
"""Exit code of a step that cannot run on this computer."""
REQUIRE = "HIL_BRIDGE_REQUIRE_VCAN"
"""Name of an environment variable. If it is set, tests that cannot run are an error."""
INSIDE = "HIL_BRIDGE_MACHINE"
"""Name of an environment variable that is set inside the machine, where only the tests use the kernel and the
devices.
"""

PACKAGES = {
    "qemu-system-x86_64": "qemu-system-x86",
    "busybox": "busybox-static",
    "modprobe": "kmod",
    "zstd": "zstd",
    "ip": "iproute2",
    "candump": "can-utils",
}
"""Commands that the machine needs, with the Debian packages that contain them."""
KERNEL = "linux-image-amd64"
"""Package of the newest kernel. The cloud kernel does not support CAN."""

KVM_PATIENCE_S = 10.0
"""Time limit for the start of a machine with KVM, s. After that, the machine is emulated, because KVM hangs on some
nested machines.
"""
POLL_S = 0.2
INSTRUCTION_TIME = " -icount shift=0"
"""Options for a clock that advances by 1 ns per instruction, as long as the emulated computer is busy.

To its programs, the computer therefore always executes 10⁹ instructions per second, however slow the emulation is.
Programs that need real time work there. A busy host makes the run longer, but nothing is late.
"""
YIELDING = ("nice", "-n", "19")
"""Prefix of a command that gives an emulated computer only idle processor time. Its clock is not affected."""
PLAIN_MEMORY = " -device bochs-display"
"""Option for a PCI device that consists only of 16 MiB of memory."""
KERNEL_SETTINGS = ("modprobe.blacklist=bochs", "iomem=relaxed")
"""Kernel settings: no driver claims the PCI device, and a program may map its memory while a driver uses it."""

SYSTEM_FOLDERS = "/usr/sbin:/sbin"
"""Folders of Debian commands that are not on an operator's PATH."""


class Unavailable(Exception):
    """Error that the machine is not available on this computer. The text gives the reason, as part of a line."""


def which(command: str) -> str | None:
    """Return the path of a command, including folders that are not on an operator's PATH."""
    return shutil.which(command, path=f"{os.environ.get('PATH', '')}:{SYSTEM_FOLDERS}")


def pytest_command(parts: Sequence[str], arguments: Sequence[str]) -> list[str]:
    """Return the command that runs the tests of these folders, on this computer or in the machine, where the
    checkout is read-only.

    The tests of a folder have its name as their mark.
    """
    return [
        *(sys.executable, "-m", "pytest", *(f"tests/{part}" for part in parts), "-m", " or ".join(parts)),
        *("-p", "no:cacheprovider", "-p", "no:hypothesispytest"),
        *("--timeout", "240", "--durations", "0", "--durations-min", "1", *arguments),
    ]


def skipped(what: str, reason: object) -> int:
    """Print one line that these tests cannot run, and return the exit code for it."""
    required = bool(os.environ.get(REQUIRE))
    print(f"{what} {'cannot run' if required else 'are skipped'}: {reason}", flush=True)
    return 1 if required else SKIPPED


def unpack_kernel() -> Path:
    """Return the kernel's image, and its modules if the package has them.

    Raises Unavailable, also if a required command is missing.
    """
    missing = [package for name, package in PACKAGES.items() if which(name) is None]
    if missing:
        raise Unavailable(f"a virtual machine needs `apt-get install {' '.join(missing)}`")
    if not (BIN / "vng").exists():
        raise Unavailable(f"a virtual machine needs `{sys.executable} -m pip install virtme-ng`")
    if not (images := sorted(CACHE.glob("boot/vmlinuz-*"))):
        _unpack()
        images = sorted(CACHE.glob("boot/vmlinuz-*"))
    if not images:
        raise Unavailable(f"the package of the kernel has no image; delete {CACHE}")
    return images[-1]


def _unpack() -> None:
    def run(*command: str | Path, cwd: Path) -> str:
        try:
            return subprocess.run(
                command, cwd=cwd, check=True, capture_output=True, text=True, timeout=300
            ).stdout
        except (OSError, subprocess.SubprocessError) as error:
            reason = (getattr(error, "stderr", "") or str(error)).strip().splitlines()[-1]
            raise Unavailable(f"{command[0]} cannot get a Debian kernel ({reason})") from error

    CACHE.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=CACHE.parent, prefix="unpacking-") as name:
        place = Path(name)
        depends = run("apt-cache", "depends", KERNEL, cwd=place)
        real = re.search(r"Depends: (linux-image-\S+)", depends)
        if real is None:
            raise Unavailable(f"apt knows no package {KERNEL}; this needs Debian")
        print(f"virtual machine: downloading {real[1]}, once", flush=True)
        run("apt-get", "download", real[1], cwd=place)
        (package,) = place.glob("*.deb")
        run("dpkg-deb", "--extract", package, place / "kernel", cwd=place)
        (modules,) = place.glob("kernel/lib/modules/*")
        run(which("depmod") or "depmod", "--basedir", place / "kernel", modules.name, cwd=place)
        shutil.rmtree(CACHE, ignore_errors=True)
        (place / "kernel").rename(CACHE)


def guest_script(share: Path, command: Sequence[str], settings: dict[str, str]) -> str:
    """Return the script that the machine runs. Its results are written to files, because its console drops
    characters.

    Python and the checkout are mounted a second time, with a cache, over their own paths. Otherwise every start of
    Python would read all its files through the emulated disk again.
    """
    host = "/run/host"
    cached = {str(Path(sys.base_prefix).resolve()), str(Path(sys.prefix).resolve()), str(ROOT)}
    # none of these folders contains a file of the machine itself
    binds = [f"mount --bind {host}{shlex.quote(folder)} {shlex.quote(folder)}" for folder in sorted(cached)]
    exports = [f"export {name}={shlex.quote(value)}" for name, value in settings.items()]
    return "\n".join(
        (
            "#!/bin/sh",
            f"cd {shlex.quote(str(share))}",
            "exec > output 2>&1",
            "touch up",
            "modprobe vcan; modprobe can-raw",
            f"mkdir -p {host}",
            f"mount -t 9p -o ro,trans=virtio,version=9p2000.L,cache=loose,msize=512000 cached {host}",
            *binds,
            *exports,
            f"cd {shlex.quote(str(ROOT))}",
            shlex.join(command),
            f"echo $? > {shlex.quote(str(share))}/code",
        )
    )


def machine_command(image: Path, share: Path, kvm: bool) -> list[str]:
    """Return the command that boots with the computer's files read-only and `share` writable."""
    cached = (
        " -fsdev local,id=cached,path=/,security_model=none,readonly=on,multidevs=remap"
        " -device virtio-9p-pci,fsdev=cached,mount_tag=cached"
    )
    return [
        *(() if kvm else YIELDING),
        *(str(BIN / "vng"), "--run", str(image), "--force-9p", "--disable-microvm", "--verbose"),
        *([] if kvm else ["--disable-kvm"]),
        *("--cpus", "2" if kvm else "1", "--memory", "2G", "--rwdir", str(share)),
        f"--qemu-opts={cached}{PLAIN_MEMORY}{'' if kvm else INSTRUCTION_TIME}",
        *(word for setting in KERNEL_SETTINGS for word in ("--append", setting)),
        *("--exec", f"sh {share}/guest.sh"),
    ]


def held_back_s(group: int) -> float:
    """Return how long a process group has been ready to run while other processes used the processors, s.

    The wait of the thread that waited longest counts. Without such a count in this kernel, the result is 0.
    """
    waits = [0]
    for folder in Path("/proc").glob("[0-9]*"):
        try:
            if os.getpgid(int(folder.name)) == group:
                waits += [int(path.read_text().split()[1]) for path in folder.glob("task/*/schedstat")]
        except OSError:  # the process has ended
            continue
    return max(waits) * 1e-9


def run_machine(
    image: Path, command: Sequence[str], settings: dict[str, str], limit: float, kvm: bool
) -> int:
    """Boot once, print the command's output as it arrives, and return its exit code.

    `limit` is the time limit, s, without the time for which other processes hold the machine back. Raises
    Unavailable if a machine with KVM does not start, and TimeoutError if a machine does not end.
    """
    with tempfile.TemporaryDirectory(prefix="hil-bridge-machine-") as name:
        share = Path(name)
        output, code, console = share / "output", share / "code", share / "console"
        (share / "guest.sh").write_text(guest_script(share, command, settings))
        output.touch()
        began = time.monotonic()
        with console.open("wb") as log, output.open("rb") as text:
            process = subprocess.Popen(
                machine_command(image, share, kvm),
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
                env={**os.environ, "PATH": f"{BIN}:{os.environ.get('PATH', '')}:{SYSTEM_FOLDERS}"},
                # No new session: Linux divides processor time by session first, and `nice` would have no effect.
                process_group=0,
            )
            try:
                while True:
                    ended = process.poll() is not None
                    sys.stdout.buffer.write(text.read())
                    sys.stdout.flush()
                    if code.exists() and (reason := code.read_text().strip()):
                        return int(reason)
                    waited = time.monotonic() - began
                    up = (share / "up").exists()
                    if kvm and not up and (ended or waited > KVM_PATIENCE_S):
                        raise Unavailable("KVM does not come up")
                    if ended or (waited > limit and waited - held_back_s(process.pid) > limit):
                        how = "ended without a result" if ended else f"did not end within {limit:.0f} s"
                        last = console.read_text(errors="replace").splitlines()[-15:]
                        raise TimeoutError("\n".join((*last, f"virtual machine: it {how}")))
                    time.sleep(POLL_S)
            finally:
                if process.poll() is None:
                    os.killpg(process.pid, signal.SIGKILL)
                process.wait()


def in_machine(command: Sequence[str], settings: dict[str, str], limit: float) -> int:
    """Run a command in a machine within a time limit, s, and return its exit code.

    Raises Unavailable if a machine cannot run on this computer.
    """
    image = unpack_kernel()
    for package in OWN_PACKAGES:  # the machine cannot keep what it compiles
        compileall.compile_dir(ROOT / package, quiet=1)
    inside = {
        "PATH": f"{BIN}:{os.environ.get('PATH', '')}:{SYSTEM_FOLDERS}",
        "HOME": "/tmp",
        "PYTHONDONTWRITEBYTECODE": "1",
        REQUIRE: "1",
        INSIDE: "1",
        **settings,
    }
    for kvm in (True, False):
        if kvm and not os.access("/dev/kvm", os.R_OK | os.W_OK):
            continue
        try:
            return run_machine(image, command, inside, limit, kvm)
        except Unavailable as error:
            print(f"virtual machine: {error}; emulated instead", flush=True)
        except TimeoutError as error:
            print(error)
            return 1
    return 1
